"""Figures show the data of the branch. The curves are closed-form one-harmonic resonance curves."""

import dataclasses
import subprocess
import sys
from itertools import pairwise

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator
from scipy.optimize import brentq, minimize_scalar

import hbgear as hb
from hbgear import plot
from hbgear.analysis.jump_landings import landings
from hbgear.analysis.jump_maps import Arm, JumpMap
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump, Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.harmonic.equations.layout import Layout
from hbgear.mechanics.models import describe
from hbgear.plot.branch_sections import SmoothCurve, akima
from hbgear.plot.style import dress

LABELS = {"Omega": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$", "amplitude": r"$d / b_c$"}
FIXED = {"zeta": 0.04, "F": 0.12}


def frequency(A, side, k3, zeta, F):
    """Return Omega at which x'' + 2 zeta x' + x + k3 x^3 = F cos(Omega t) has amplitude A, with one harmonic.

    (p - s)^2 + 4 zeta^2 s = F^2 / A^2,   s = Omega^2,   p = 1 + 3/4 k3 A^2
    """
    p = 1 + 0.75 * k3 * A**2
    return np.sqrt(p - 2 * zeta**2 + side * np.sqrt(np.maximum((p - 2 * zeta**2) ** 2 - p**2 + (F / A) ** 2, 0.0)))


def resonance(k3=-0.12, mean=1.9, corners=((-1.0, 1.0),), multipliers=True, harmonics=5):
    """Return a softening resonance curve from high to low Omega, with its folds, grazing contacts and jumps."""
    zeta, F = FIXED["zeta"], FIXED["F"]
    # at the peak the two sides of the curve meet: the root in `frequency` vanishes
    peak = brentq(lambda A: 4 * zeta**4 - 4 * zeta**2 * (1 + 0.75 * k3 * A**2) + (F / A) ** 2, 0.5, 2)

    def points(u):  # u in (-1, 1): up one side of the peak and down the other
        A = peak * (1 - np.abs(u))
        return frequency(A, np.where(u < 0, 1, -1), k3, zeta, F), A

    grid = np.linspace(-0.9, 0.9, 400)
    Omega, _ = points(grid)
    turns = [i for i in range(1, len(grid) - 1) if (Omega[i] - Omega[i - 1]) * (Omega[i + 1] - Omega[i]) < 0]
    sign = [1 if Omega[i] > Omega[i - 1] else -1 for i in turns]
    folds = [
        minimize_scalar(lambda u, s=s: -s * float(points(u)[0]), (grid[i - 1], grid[i], grid[i + 1]), tol=1e-12).x
        for i, s in zip(turns, sign, strict=True)
    ]
    grazes = [side * (1 - (mean - 1) / peak) for side in (-1, 1)] if corners[0] and mean > 1 else []
    special = sorted([(u, "LP") for u in folds] + [(u, "GR") for u in grazes])
    u = np.unique(np.concatenate([grid, folds, grazes]))
    Omega, A = points(u)
    unstable = (u > min(folds)) & (u < max(folds)) if folds else np.zeros(len(u), bool)
    mu = np.where(unstable, 1.3, 0.7)[:, None] + 0j if multipliers else None
    if mu is not None:
        mu[np.isin(u, folds)] = 1.0
    p, s = 1 + 0.75 * k3 * A**2, Omega**2
    phase = np.arctan2(2 * zeta * Omega, p - s)
    X = np.zeros((len(u), 2 * harmonics + 1))
    X[:, 0], X[:, 1], X[:, 2] = mean, A * np.cos(phase), A * np.sin(phase)
    low = mean - A
    regime = ((low < 1) & ~np.isin(u, grazes)).astype(np.int8)[:, None] + (low < -1)[:, None]
    layout = Layout(harmonics, 1, ("mesh",), corners, LABELS)
    branch = Branch(
        "Omega",
        Omega,
        X,
        FIXED,
        {},
        mu,
        np.full(len(u), 3),
        np.zeros(len(u)),
        regime,
        np.zeros(len(u)),
        np.zeros(len(u)),
        (),
        (),
        Status.REACHED_END,
        "",
        layout,
        {},
    )
    found, count = [], {"LP": 0, "GR": 0}
    for at, kind in special:
        i = int(np.searchsorted(u, at))
        count[kind] += 1
        found.append(as_special(branch, i, kind, f"{kind}{count[kind]}"))
    jumps = [jump(branch, point) for point in found if point.kind == "LP"]
    return rebuilt(branch, special=tuple(found), jump_records=tuple(jumps))


def rebuilt(branch, **changes):
    fields = {name: getattr(branch, name) for name in branch.__dataclass_fields__}
    return Branch(**{**fields, **changes})


def as_special(branch, i, kind, label):
    p = branch[i]
    return SpecialPoint(
        p.X,
        p.parameters,
        p.residual,
        p.iterations,
        p.multipliers,
        p.regime,
        p.error,
        p.layout,
        label,
        kind,
        i,
        True,
        (branch.values[i - 1], branch.values[i + 1]),
    )


def jump(branch, point):
    """Return the jump to the stable point of the nearest parameter value, more than 30 points away from the fold."""
    i = point.index
    direction = 1 if branch.values[i] > branch.values[i + 1] else -1
    target = np.abs(np.arange(len(branch)) - i) > 30
    if branch.stable is not None:
        target &= branch.stable
    gap = np.where(target, np.abs(branch.values - branch.values[i]), np.inf)
    return Jump(point.label, "Omega", float(branch.values[i]), direction, point, branch[int(np.argmin(gap))])


def curves(ax):
    return [line for line in ax.lines if str(line.get_gid()).startswith("branch")]


def rich_point(nu=1):
    X = np.zeros(2 * 8 * nu + 1)
    X[0] = 1.2
    for k, (a, b) in {1: (0.9, 0.4), 2: (-0.25, 0.3), 3: (0.1, -0.12), 4: (0.03, 0.02), 6: (0.01, 0)}.items():
        X[2 * k * nu - 1], X[2 * k * nu] = a, b
    if nu > 1:
        X[1], X[2], X[5], X[6] = 0.15, 0.1, -0.06, 0.1
    layout = Layout(8 * nu, nu, ("mesh",), ((-1.0, 1.0),), LABELS)
    return Point(X, {"Omega": 0.85, "zeta": 0.05}, 0.0, 3, np.array([0.5 + 0.2j]), np.array([1], np.int8), 0.0, layout)


def runs_of(flags):
    return int(np.sum(np.diff(np.concatenate([[0], np.asarray(flags, dtype=int)])) == 1))


def test_helper_curve_satisfies_its_equation():
    b = resonance()
    A = b.amplitude("H1")
    p, s = 1 - 0.75 * 0.12 * A**2, b.values**2
    assert np.max(np.abs((p - s) ** 2 + 4 * FIXED["zeta"] ** 2 * s - (FIXED["F"] / A) ** 2)) < 1e-12
    assert [point.label for point in b.special] == ["GR1", "LP1", "LP2", "GR2"]


def test_each_run_is_one_line_in_its_style_and_colour():
    b = resonance()
    ax = plot.response(b)
    lines = curves(ax)
    unstable = [line for line in lines if line.get_linestyle() == "--"]
    assert len(unstable) == runs_of(~b.stable) == 1
    fold = [b["LP1"].index, b["LP2"].index]
    assert np.isin(b.values[fold[0] : fold[1] + 1], unstable[0].get_xdata()).all()
    borders = [0, *(point.index for point in b.special), len(b) - 1]
    ends = [(line.get_xdata()[0], line.get_xdata()[-1]) for line in lines]
    assert ends == [(b.values[i], b.values[j]) for i, j in pairwise(borders)]
    assert [line.get_color() for line in lines] == [
        plot.COLOURS[r] for r in ("no_impact", "single_sided", "single_sided", "single_sided", "no_impact")
    ]


def test_curve_is_continuous_and_complete():
    b = resonance()
    lines = curves(plot.response(b, "rms"))
    for one, two in pairwise(lines):
        assert one.get_xdata()[-1] == two.get_xdata()[0] and one.get_ydata()[-1] == two.get_ydata()[0]
    y = np.concatenate([lines[0].get_ydata()[:1], *(line.get_ydata()[1:] for line in lines)])
    assert np.array_equal(y[np.isin(y, b.amplitude("rms"))], b.amplitude("rms"))


def test_points_are_joined_by_a_smooth_line():
    """Thirteen points of half a circle, with a fold: the smooth line is accurate to 1.5e-3, the polygon to 9e-3."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
    x, y = np.cos(angle), np.sin(angle)
    smooth = SmoothCurve(x, y).between(0, 12)
    assert np.isin(y, smooth[1]).all() and len(smooth[0]) > 60
    assert np.abs(np.hypot(*smooth) - 1).max() < 1.5e-3 < 0.2 * (1 - np.cos(np.pi / 24))


def test_smooth_line_is_akima_interpolation():
    """Points at random, with equal neighbouring slopes, and on a straight line, against SciPy."""
    rng = np.random.default_rng(3)
    for values in (rng.normal(size=(2, 30)), rng.integers(0, 2, (2, 30)).astype(float), np.ones((2, 30))):
        x, y = np.arange(30) + values[0], values[1]
        smooth = SmoothCurve(x, y)
        knots, positions = smooth.along[smooth.distinct], np.linspace(0.0, smooth.along[-1], 500)
        expected = Akima1DInterpolator(knots, np.stack([x, y])[:, smooth.distinct], axis=1)(positions)
        np.testing.assert_allclose(akima(knots, np.stack([x, y])[:, smooth.distinct], positions), expected, atol=1e-12)


def test_alternating_stability_without_special_points():
    b = resonance()
    mu = np.full((len(b), 1), 0.5 + 0j)
    for start in (50, 150, 250):
        mu[start : start + 20] = 2.0
    b = rebuilt(b, multipliers=mu, special=(), jump_records=(), regime=np.zeros((len(b), 1)))
    lines = curves(plot.response(b))
    assert [line.get_linestyle() for line in lines] == ["-", "--", "-", "--", "-", "--", "-"]
    assert runs_of(~b.stable) == 3


def test_unknown_stability_is_thin_and_solid():
    lines = curves(plot.response(resonance(multipliers=False)))
    assert {line.get_linestyle() for line in lines} == {"-"}
    assert {line.get_linewidth() for line in lines} == {plot.LINES[None][1]}
    b = resonance(corners=((),))
    mu = b.multipliers.copy()
    mu[10:20] = np.nan
    widths = [line.get_linewidth() for line in curves(plot.response(rebuilt(b, multipliers=mu)))]
    assert widths.count(plot.LINES[None][1]) == 1


def test_legend_names_only_drawn_lines():
    def names(ax):
        return [text.get_text() for text in ax.get_legend().get_texts()]

    assert names(plot.response(resonance())) == [
        "no impact",
        "single-sided",
        "unstable",
        "jump",
        "fold (LP)",
        "grazing contact (GR)",
    ]
    assert names(plot.response(resonance(corners=((),)))) == ["unstable", "jump", "fold (LP)"]
    assert names(plot.response(resonance(multipliers=False), special=False)) == ["no impact", "single-sided", "jump"]
    assert plot.response(resonance(), legend=False).get_legend() is None
    ax = plot.response(resonance(), label="one", color="red", special=False)
    plot.response(resonance(k3=-0.05), label="two", special=False, ax=ax)
    assert names(ax) == ["one", "two", "unstable", "jump"]
    linear = plot.response(resonance(k3=-1e-9, corners=((),)))
    assert linear.get_legend() is None


def test_folds_are_marked_where_they_are_and_labelled_outside():
    b = resonance()
    ax = plot.response(b, "H1")
    marks = {line.get_gid(): line for line in ax.lines if line.get_gid() in ("LP1", "LP2", "GR1", "GR2")}
    for label, line in marks.items():
        assert line.get_xdata()[0] == b[label].parameters["Omega"]
        assert abs(line.get_ydata()[0] - b[label].amplitude("H1")) < 1e-15
        assert line.get_marker() == plot.MARKERS[label[:2]][0]
    texts = {text.get_text(): text.get_ha() for text in ax.texts if text.get_text()}
    assert texts == {"LP1": "right", "LP2": "left"}  # LP1 opens to the right, LP2 to the left


def test_jump_arrows_are_vertical_from_before_to_after():
    b = resonance()
    b = rebuilt(b, jump_records=(*b.jumps(), Jump("LP1", "Omega", 0.8, -1, b["LP1"], None)))
    arrows = [text for text in plot.response(b).texts if text.arrow_patch is not None]
    assert len(arrows) == 2  # no arrow for the jump without a landing
    for arrow, jump in zip(arrows, b.jumps(), strict=False):
        assert arrow.xy == (jump.value, jump.after.amplitude("pp2"))
        assert arrow.xyann == (jump.value, jump.before.amplitude("pp2"))
    assert not [t for t in plot.response(b, jumps=False).texts if t.arrow_patch is not None]


def test_axis_labels_come_from_the_layout_or_fall_back():
    ax = plot.response(resonance())
    assert ax.get_xlabel() == LABELS["Omega"] and ax.get_ylabel() == r"half peak-to-peak of $d / b_c$"
    b = resonance()
    plain = rebuilt(b, layout=Layout(5, 1, ("mesh",), ((-1.0, 1.0),)), special=(), jump_records=())
    ax = plot.response(plain)
    assert ax.get_xlabel() == r"$\Omega$" and ax.get_ylabel() == "half peak-to-peak of $d$, mesh (model units)"
    layout = Layout(2, 1, ("left", "right"), ((), ()))
    two = rebuilt(plain, layout=layout, X=plain.X[:, :10], regime=np.zeros((len(b), 2)))
    assert plot.response(two, "H2", "right").get_ylabel() == "harmonic 2 of $d$, right (model units)"


def test_one_row_is_a_dot():
    b = resonance(corners=((),))
    names = ("values", "X", "multipliers", "iterations", "residual", "regime", "modulus_error")
    cut = {name: getattr(b, name)[:1] for name in names}
    one = rebuilt(b, **cut, error=[0.0], step=[0.0], special=(), jump_records=())
    assert [line.get_marker() for line in curves(plot.response(one))] == ["."]


def test_time_history_and_phase_diagram_of_a_known_motion():
    X = np.array([1.5, 0.8, 0.0, 0.0, 0.3])  # 1.5 + 0.8 cos theta + 0.3 sin 2 theta
    layout = Layout(2, 2, ("mesh",), ((-1.0, 1.0),))
    point = Point(X, {"Omega": 0.6}, 0.0, 1, None, np.array([1], np.int8), 0.0, layout)
    t, d = plot.time_history(point).lines[0].get_data()
    assert t[0] == 0 and t[-1] == 2 and d[-1] == d[0]  # two periods of the excitation
    theta = np.pi * t
    assert np.allclose(d, 1.5 + 0.8 * np.cos(theta) + 0.3 * np.sin(2 * theta), rtol=0, atol=1e-13)
    ax = plot.phase_diagram(point)
    x, v = ax.lines[0].get_data()
    assert np.allclose(x, d, rtol=0, atol=1e-15)
    assert np.allclose(v, 0.3 * (-0.8 * np.sin(theta) + 0.6 * np.cos(2 * theta)), rtol=0, atol=1e-13)
    dots = ax.lines[1].get_data()
    assert np.allclose(dots, [[2.3, 0.7], [0.18, 0.18]], rtol=0, atol=1e-13)  # theta = 0 and pi


def test_corners_are_drawn_and_shown_only_within_reach():
    point = rich_point()
    assert [line.get_ydata()[0] for line in plot.time_history(point).lines if line.get_gid() == "breakpoint"] == [-1, 1]
    assert [line.get_xdata()[0] for line in plot.phase_diagram(point).lines if line.get_gid() == "breakpoint"] == [
        -1,
        1,
    ]
    low, high = plot.time_history(point).get_ylim()
    assert low < -1 and high > 2
    small = Point(point.X * np.r_[1, np.full(16, 0.05)], point.parameters, 0, 1, None, point.regime, 0.0, point.layout)
    low, high = plot.time_history(small).get_ylim()
    assert low > 1  # both breakpoints are far: the limits fit the motion


@pytest.mark.parametrize("log", [False, True])
def test_spectrum_heights(log):
    point = rich_point(nu=2)
    order, height = plot.spectrum(point, log=log).lines[0].get_data()
    found = dict(zip(order, height, strict=True))
    for k, expected in {1: np.hypot(0.9, 0.4), 2: np.hypot(0.25, 0.3), 0.5: np.hypot(0.15, 0.1)}.items():
        assert abs(found[k] - expected) < 1e-15
    assert (4.5 in found) != log  # harmonics that are zero have no place on a logarithmic axis


def test_portrait_has_three_axes_and_a_title():
    figure = plot.portrait(rich_point())
    assert len(figure.axes) == 3
    assert figure.get_suptitle() == r"$\Omega$ = 0.85, stable, single-sided"


def test_draws_on_given_axes_and_leaves_settings_alone():
    before = dict(matplotlib.rcParams)
    figure, (one, two) = plt.subplots(1, 2)
    assert plot.response(resonance(), ax=one) is one
    assert plot.spectrum(rich_point(), ax=two) is two
    plot.portrait(rich_point())
    figure.canvas.draw()
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("a.pdf", b"%PDF"), ("a.svg", b"<?xml")])
def test_save_writes_the_format_of_the_name(tmp_path, name, start):
    plot.save(plot.response(resonance()), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(start)
    plot.save(plot.portrait(rich_point()), tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_save_refuses_other_kinds_and_leaves_nothing_behind(tmp_path, monkeypatch):
    ax = plot.response(resonance())
    with pytest.raises(ValueError, match=r"\.png, \.pdf or \.svg"):
        plot.save(ax, tmp_path / "a.bmp")
    with pytest.raises(FileNotFoundError, match="create it first"):
        plot.save(ax, tmp_path / "missing" / "a.png")

    def fail(handle, **_):
        handle.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(ax.figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        plot.save(ax, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_no_omega_no_phase_diagram():
    point = rich_point()
    with pytest.raises(ValueError, match="needs Omega"):
        plot.phase_diagram(Point(point.X, {"zeta": 1.0}, 0.0, 1, None, point.regime, 0.0, point.layout))


def test_names_of_the_first_releases_lead_to_the_new_ones():
    for name, function in (("plot_time", "sweeps"), ("plot_cases", "envelope")):
        with pytest.warns(DeprecationWarning, match=f"hbgear.{name} is deprecated: use hbgear.plot$"):
            module = getattr(hb, name)
        assert getattr(module, function) is getattr(plot, function)


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'plot_nothing'"):
        _ = hb.plot_nothing


def test_everything_that_is_public_is_drawn_by_one_name():
    assert all(getattr(plot, name) is not None for name in plot.__all__)
    own = {name for name, thing in vars(plot).items() if callable(thing) and not name.startswith("_")}
    assert own <= {*plot.__all__}


def test_importing_plot_does_not_import_matplotlib():
    code = "import sys, hbgear.plot, hbgear.continuation.results.branch; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# ---- several branches, labels, units


def drawn(ax):
    """Draw the figure, which places the labels, and return the renderer."""
    ax.figure.canvas.draw()
    return ax.figure.canvas.get_renderer()


def label_boxes(ax):
    renderer = drawn(ax)
    texts = [text for text in ax.texts if text.get_text() and text.get_visible() and text.arrow_patch is None]
    return {text.get_text(): text.get_window_extent(renderer) for text in texts}


def test_curves_of_events_of_the_user_have_their_meaning_and_a_colour_each(tmp_path):
    """Also after loading; all of them, and peaks, were black "special points"."""
    events = [
        hb.Event(kind, lambda point, a=a: point.amplitude("max") - a, f"deflection of {a}")
        for kind, a in (("low", 0.5), ("high", 0.8))
    ]
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 1.05), events=[*events, "PK"], accuracy=None)
    followed = [hb.follow(curve, label, "zeta", (0.05, 0.06), accuracy=None) for label in ("low1", "high1")]
    followed[0].save(tmp_path / "a.npz")
    ax = plot.special_curves([hb.load(tmp_path / "a.npz"), followed[1]])
    assert [line.get_label() for line in ax.lines] == ["deflection of 0.5", "deflection of 0.8"]
    assert len({line.get_color() for line in ax.lines}) == 2


def test_peaks_of_files_are_followed(tmp_path):
    """The linear oscillator: the amplitude is largest at Omega^2 = 1 - 2 zeta^2."""
    problem = hb.HarmonicBalance(hb.Duffing(k3=0.0), 1)
    hb.trace(problem, "Omega", (0.5, 1.5), events=["PK"]).save(tmp_path / "a.npz")
    peaks = hb.follow(hb.load(tmp_path / "a.npz"), "PK1", "zeta", (0.05, 0.3))
    assert peaks.tracked["Omega"][-1] == pytest.approx(np.sqrt(1 - 2 * 0.3**2), rel=1e-9)
    assert plot.special_curves([peaks]).lines[0].get_label() == "peaks of the amplitude"


def test_thirty_curves_leave_space_for_the_axes():
    """Thirty entries of the legend were higher than the figure, and eight colours were repeated."""
    ax = plot.responses([resonance()] * 30, names=[f"design {i}" for i in range(1, 31)])
    ax.figure.canvas.draw()
    assert ax.get_position().height > 0.6 and ax.get_position().width > 0.4
    lines = [line for line in ax.lines if str(line.get_gid()).startswith("branch")]
    assert len({str(line.get_color()) for line in lines}) == 30
    texts = [text.get_text() for text in ax.get_legend().get_texts() if "design" in text.get_text()]
    assert len(texts) == 8 and (texts[0], texts[-1]) == ("(1) design 1", "(30) design 30")
    assert not any("(" in text.get_text() for text in ax.texts)


def test_several_branches_have_their_own_colours_names_and_labels():
    one, two = resonance(), resonance(k3=-0.11)
    ax = plot.responses((one, two))
    colours = {
        line.get_label(): {other.get_color() for other in curves(ax) if other.get_label() == line.get_label()}
        for line in curves(ax)
    }
    assert colours == {"branch 1": {plot.BRANCHES[0]}, "branch 2": {plot.BRANCHES[1]}}
    assert {line.get_linewidth() for line in curves(ax) if line.get_linestyle() == "-"} == {
        plot.WIDTHS["no_impact"],
        plot.WIDTHS["single_sided"],
    }
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names[:2] == ["branch 1", "branch 2"] and {"no impact", "single-sided", "unstable"} <= set(names)
    on_given_axes = plot.responses((one, two), ax=plt.figure().add_subplot()).get_legend()
    widths = {
        text.get_text(): line.get_linewidth()
        for text, line in zip(on_given_axes.get_texts(), on_given_axes.get_lines(), strict=True)
    }
    assert (widths["no impact"], widths["single-sided"]) == (plot.WIDTHS["no_impact"], plot.WIDTHS["single_sided"])
    assert list(label_boxes(ax)) == ["LP1 (1)", "LP2 (1)", "LP1 (2)", "LP2 (2)"]
    named = plot.responses((one, two), names=("before", "after")).get_legend().get_texts()
    assert [text.get_text() for text in named[:2]] == ["(1) before", "(2) after"]
    with pytest.raises(TypeError, match=r"needs one Branch, .*; responses draws several"):
        plot.response([one, two])
    with pytest.raises(ValueError, match="1 names for 2 branches"):
        plot.responses((one, two), names=("before",))
    with pytest.raises(ValueError, match="no branch"):
        plot.responses(())
    with pytest.raises(ValueError, match="no branch"):
        plot.responses(np.array([]))


def test_a_label_that_is_taken_gets_the_number_of_its_curve():
    ax = plot.response(resonance())
    plot.response(resonance(k3=-0.11), ax=ax)
    assert list(label_boxes(ax)) == ["LP1", "LP2", "LP1 (2)", "LP2 (2)"]


def test_a_jump_is_drawn_to_the_other_branch_that_has_a_stable_motion():
    b = resonance()
    first = b["LP1"]
    lost = rebuilt(b, jump_records=(Jump("LP1", "Omega", b.jumps()[0].value, -1, first, None),))
    other = resonance(k3=-1e-9, corners=((-1.0, 1.0),))
    assert not [text for text in plot.responses((lost,)).texts if text.arrow_patch is not None]
    (arrow,) = (text for text in plot.responses((lost, other)).texts if text.arrow_patch is not None)
    x, y = arrow.xy
    sides = np.flatnonzero((other.values[:-1] - x) * (other.values[1:] - x) <= 0)
    heights = [
        np.interp(x, *np.sort([other.values[i : i + 2], other.amplitude("pp2")[i : i + 2]], axis=1)) for i in sides
    ]
    assert x == lost.jump_records[0].value and min(abs(y - height) for height in heights) < 1e-2


def arrows_out(ax):
    return [text for text in ax.texts if text.get_gid() == "to infinity"]


def test_a_curve_that_runs_off_to_infinity_ends_in_an_arrow():
    """The axes end at twice the amplitude up to the fold; an arrow marks the exit, a dotted line the asymptote."""
    b = resonance()
    growth = 1 + 300 * np.linspace(0, 1, len(b)) ** 8
    far = rebuilt(
        b, X=b.X * growth[:, None], meta={"asymptotes": {"last": 1.5}}, special=b.special[:1], jump_records=()
    )
    heights = far.amplitude("pp2")
    ax = plot.response(far)
    (arrow,), (low, high) = arrows_out(ax), ax.get_ylim()
    assert high == pytest.approx(2 * heights[: far.special[0].index + 1].max()) and high < heights.max()
    assert -0.1 * high < low < heights.min()
    assert arrow.xyann[1] < arrow.xy[1] and arrow.xy[1] == pytest.approx(high, rel=0.01)
    i = int(np.flatnonzero(heights > arrow.xy[1])[0])
    assert np.interp(arrow.xy[1], heights[i - 1 : i + 1], far.values[i - 1 : i + 1]) == pytest.approx(arrow.xy[0])
    (line,) = (line for line in ax.lines if line.get_gid() == "asymptote")
    assert list(line.get_xdata()) == [1.5, 1.5] and line.get_linestyle() == ":"
    assert "asymptote" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_arrows_point_out_of_both_ends():
    b = resonance()
    both = rebuilt(b, meta={"asymptotes": {"first": 0.4, "last": 1.9}}, special=(), jump_records=())
    first, last = arrows_out(plot.response(both))
    heights = both.amplitude("pp2")
    assert first.xy == (both.values[0], heights[0]) and first.xyann == (both.values[1], heights[1])
    assert last.xy == (both.values[-1], heights[-1]) and last.xyann == (both.values[-2], heights[-2])
    assert not arrows_out(plot.response(b))


def test_the_others_of_a_span_are_drawn_with_a_curve():
    one, two = resonance(), resonance(k3=-0.11)
    whole = rebuilt(one, others=(two,))
    names = {line.get_label() for line in curves(plot.response(whole))}
    assert names == {"branch 1", "branch 2"} == {line.get_label() for line in curves(plot.responses([whole]))}
    assert {line.get_color() for line in curves(plot.response(whole, color="tab:red"))} == {"tab:red"}
    assert len(curves(plot.response(whole, special=False))) == len(curves(plot.response(one, special=False)))


def test_landings_look_at_all_branches_of_the_same_machine():
    b = resonance()
    jump = Jump("LP1", "Omega", b.jumps()[0].value, -1, b["LP1"], None)
    lost, other = rebuilt(b, jump_records=(jump,)), resonance(k3=-1e-9)
    (found,), _ = landings((lost, other))
    assert found.branch == 1 and found.jump.after.stable and found.jump.after.parameters["Omega"] == jump.value
    (alone,) = landings((lost,))[0]
    assert alone.branch is None and alone.jump.after is None
    elsewhere = rebuilt(other, fixed={**FIXED, "F": 0.2})
    assert landings((lost, elsewhere))[0][0].branch is None
    assert [found.branch for found in landings((other, b))[1]] == [1, 0]  # each lands on the nearest branch


def test_labels_do_not_overlap_each_other_or_leave_the_axes():
    many = resonance()
    crowd = [
        as_special(many, many["LP1"].index + 3 * i, kind, f"{kind}{i + 1}")
        for i, kind in enumerate(("NS", "PD", "BP", "NS", "PD", "BP"))
    ]
    b = rebuilt(many, special=tuple(sorted((*many.special, *crowd), key=lambda point: point.index)))
    for ax in (plot.response(b), plot.responses((b, resonance(k3=-0.11)))):
        boxes = list(label_boxes(ax).values())
        assert len(boxes) >= 8
        for i, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[i + 1 :])
            assert ax.bbox.x0 <= box.x0 and box.x1 <= ax.bbox.x1 and ax.bbox.y0 <= box.y0 and box.y1 <= ax.bbox.y1
            legend = ax.get_legend().get_window_extent(ax.figure.canvas.get_renderer())
            assert not box.overlaps(legend)


def test_curves_with_and_without_a_unit_of_length_are_drawn_without_units():
    """Amplitudes in um and in x / b do not share an axis; amplitudes of two scales in um do."""
    scales, longer = ({"reference": (38000.0, length, 15000.0, 25)} for length in (37.6e-6, 2 * 37.6e-6))
    one, two, other = (
        hb.trace(hb.HarmonicBalance(hb.SpurPair(**given), 4), "Omega", (1.5, 1.2)) for given in (scales, longer, {})
    )
    for pair in ((one, other), (other, one)):
        ax = plot.responses(pair)
        assert "[-]" in ax.get_xlabel() and "um" not in ax.get_ylabel() and "µm" not in ax.get_ylabel()
        heights = [line.get_ydata().max() for line in curves(ax)]
        assert max(heights) == pytest.approx(one.amplitude("pp2").max(), rel=0.01)
    ax = plot.responses((one, two))
    tops = [max(line.get_ydata().max() for line in curves(ax) if line.get_label() == f"branch {k}") for k in (1, 2)]
    assert "m]" in ax.get_ylabel() and tops[1] == pytest.approx(2 * tops[0], rel=1e-9)


def test_machines_of_different_scales_are_drawn_over_the_speed():
    """Each curve, jump and special point has the scale of its own machine; no jump lands on another machine."""
    one, two = (
        hb.trace(
            hb.HarmonicBalance(hb.SpurPair(zeta=0.05, reference=(k, 37.6e-6, 15000.0, 25)), 6), "Omega", (1.2, 0.6)
        )
        for k in (38000.0, 45000.0)
    )
    ax = plot.responses((one, two))
    assert ax.get_xlabel() == "speed of the pinion [r/min]"
    for k, branch in ((1, one), (2, two)):
        speed = branch.problem.model.scales.pinion_speed
        ends = [
            f(line.get_xdata()) for line in curves(ax) if line.get_label() == f"branch {k}" for f in (np.min, np.max)
        ]
        assert (min(ends), max(ends)) == pytest.approx((speed(0.6), speed(1.2)))
        marked = [line.get_xdata()[0] for line in ax.lines if line.get_gid() == "LP1"]
        assert marked[k - 1] == pytest.approx(speed(branch["LP1"].parameters["Omega"]), rel=1e-12)
    assert [[landing.branch for landing in found] for found in landings((one, two))] == [[0, 0], [1, 1]]


def test_jumps_do_not_land_on_another_structure():
    """The stiffness matrix is no parameter: two structures have equal fixed parameters but different landings."""
    stop, load = hb.Element([1.0], hb.Unilateral(k=3.0, gap=0.5)), hb.Load(cosine={1: [0.2]})
    soft, hard = (
        hb.trace(hb.HarmonicBalance(hb.System([[1.0]], [[0.06]], [[K]], [stop], load), 8), "Omega", (0.8, 1.8))
        for K in (1.0, 1.2)
    )
    assert soft.fixed == hard.fixed == {}
    for k, (found, own) in enumerate(zip(landings((soft, hard)), (soft, hard), strict=True)):
        assert [landing.branch for landing in found] == [k, k]
        for landing, jump in zip(found, own.jumps(), strict=True):
            assert landing.jump.after.amplitude("pp2") == pytest.approx(jump.after.amplitude("pp2"), rel=1e-9)


@pytest.mark.parametrize("side", ["top", "bottom", "left"])
def test_labels_keep_clear_of_ticks(side):
    """The usual place of this label, to the left of its point, would end two pixels from a border of the axes."""
    b = resonance()
    b, ax = rebuilt(b, special=(b["LP1"],), jump_records=()), plt.figure().add_subplot()
    plot.response(b, ax=ax)
    x, y = b["LP1"].parameters["Omega"], b["LP1"].amplitude("pp2")
    width, height = np.ptp(b.values), b.amplitude("pp2").max()
    ax.set(xlim=(x - width, x + width), ylim=(y - height, y + height))
    box, (px, _) = label_boxes(ax)["LP1"], ax.transData.transform((x, y))
    assert box.x1 < px
    if side == "left":
        share = (px - box.x0 + 2) / ax.bbox.width
        ax.set_xlim(x - 2 * width * share, x + 2 * width * (1 - share))
    else:
        share = (box.height / 2 + 2) / ax.bbox.height
        low, high = (share, 1 - share) if side == "bottom" else (1 - share, share)
        ax.set_ylim(y - 2 * height * low, y + 2 * height * high)
    tick = ax.xaxis.get_major_ticks()[0].tick1line.get_markersize() * ax.figure.dpi / 72
    box = label_boxes(ax)["LP1"]
    assert tick > 3 and ax.bbox.x0 + tick <= box.x0 and box.x1 <= ax.bbox.x1 - tick
    assert ax.bbox.y0 + tick <= box.y0 and box.y1 <= ax.bbox.y1 - tick


def test_a_heap_of_points_has_one_label_and_two_symbols():
    b = resonance()
    start = b["LP1"].index + 5
    heap = [as_special(b, start + i, "NS", f"NS{i + 1}") for i in range(14)]
    b = rebuilt(b, special=tuple(sorted((*b.special, *heap), key=lambda point: point.index)))
    ax = plot.response(b)
    assert set(label_boxes(ax)) == {"LP1", "LP2", "NS1\N{EN DASH}NS14"}
    shown = [line.get_gid() for line in ax.lines if str(line.get_gid()).startswith("NS") and line.get_visible()]
    assert shown == ["NS1", "NS14"]
    assert "Neimark-Sacker (NS)" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_an_unstable_piece_between_two_symbols_is_drawn_enlarged():
    b = resonance(k3=-1e-9)
    mu = np.full((len(b), 1), 0.5 + 0j)
    at = len(b) // 4
    mu[at : at + 4] = 1.5
    ends = [as_special(b, i, "PD", f"PD{k}") for k, i in enumerate((at, at + 3), 1)]
    hidden = rebuilt(b, multipliers=mu, special=tuple(ends))
    ax = plot.response(hidden)
    (inset,) = (child for child in ax.child_axes if child.get_label() == "inset")
    (dashed,) = (line for line in curves(inset) if line.get_linestyle() == "--")
    size = inset.bbox.width
    drawn(ax)
    x = inset.transData.transform(np.transpose(dashed.get_data()))[:, 0]
    assert np.ptp(x) > 0.3 * size  # it fills more than 30 % of the enlarged axes
    box = inset.get_tightbbox(drawn(ax))
    assert not ax.get_legend().get_window_extent().overlaps(box)
    on_curve = ax.transData.transform(np.stack([hidden.values, hidden.amplitude("pp2")], axis=1))
    assert not any(inset.bbox.contains(*place) for place in on_curve)
    assert not [child for child in plot.response(resonance()).child_axes if child.get_label() == "inset"]
    given = plt.subplots()[1]
    assert not plot.response(hidden, ax=given).child_axes


def with_model(branch, **fields):
    return rebuilt(branch, meta={"model": describe(hb.gears.DoubleHelicalPair(**fields))})


@pytest.mark.slow
def test_axes_of_speed_and_frequency_after_loading():
    model = hb.gears.DoubleHelicalPair()
    physical = plot.response(with_model(resonance()), "pp2")
    (above,) = physical.child_axes
    assert physical.get_xlabel() == "speed of the pinion [r/min]" and above.get_xlabel() == "mesh frequency [Hz]"
    assert physical.get_ylabel().endswith("[\N{MICRO SIGN}m]")
    line, length = curves(physical)[0], 1e6 * model.scales.length
    assert line.get_xdata()[0] == pytest.approx(model.pinion_speed(resonance().values[0]), rel=1e-12)
    assert line.get_ydata()[0] == pytest.approx(length * resonance().amplitude("pp2")[0], rel=1e-12)
    ax = plot.response(with_model(resonance()), dimensionless=True)
    speed, mesh = ax.child_axes
    assert (speed.get_xlabel(), mesh.get_xlabel()) == ("speed of the pinion [r/min]", "mesh frequency [Hz]")
    drawn(ax)
    low, high = ax.get_xlim()
    np.testing.assert_allclose(speed.get_xlim(), model.pinion_speed(np.array([low, high])), rtol=1e-12)
    np.testing.assert_allclose(mesh.get_xlim(), model.mesh_frequency(np.array([low, high])), rtol=1e-12)
    assert not plot.response(resonance()).child_axes  # a model without units
    given = plt.subplots()[1]
    assert not plot.response(with_model(resonance()), "pp2", ax=given).child_axes
    assert plot.response(with_model(resonance()), "pp2", ax=given, speeds=True).child_axes
    both = with_model(resonance()), with_model(resonance(), k_mean=1e9)
    assert not plot.responses(both, "pp2", dimensionless=True).child_axes  # Omega = 1 is not the same speed on both


@pytest.mark.parametrize("floor", [-1.0, 0.0, 1.0])
def test_a_floor_of_a_spectrum_that_is_no_share_is_refused(floor):
    with pytest.raises(ValueError, match=f"floor = {floor} must lie between 0 and 1"):
        plot.spectrum(rich_point(), floor=floor)


def test_spectrum_states_its_floor_and_draws_nothing_below():
    point = rich_point()
    faint = Point(point.X.copy(), point.parameters, 0, 1, None, point.regime, 0.0, point.layout)
    faint.X[15] = 1e-9  # harmonic 8
    ax = plot.spectrum(faint)
    order, height = ax.lines[0].get_data()
    assert ax.get_yscale() == "log" and 8 not in order and height.min() >= plot.FLOOR * height.max()
    (right,) = ax.child_axes
    assert right.get_ylabel() == "level re largest line [dB], floor \N{MINUS SIGN}120"
    assert ax.get_ylim()[0] == pytest.approx(plot.FLOOR * np.hypot(0.9, 0.4))
    drawn(ax)
    low, high = right.get_ylim()
    assert (low, high) == pytest.approx((-120.0, 20 * np.log10(3.0)))
    assert 8 in plot.spectrum(faint, floor=1e-12).lines[0].get_xdata()


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_a_figure_made_again_is_the_same_file(tmp_path, kind, monkeypatch):
    files = []
    for name, now in (("a", "100000"), ("b", "900000000")):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", now)
        plot.save(plot.response(resonance()), tmp_path / f"{name}.{kind}")
        files.append((tmp_path / f"{name}.{kind}").read_bytes())
    assert files[0] == files[1]
    assert not any(word in files[0] for word in (b"Matplotlib v", b"CreationDate", b"matplotlib.org"))


def test_the_title_of_a_motion_at_a_fold_states_the_limit_of_stability():
    """There a multiplier is one up to truncation, whose sign would decide; with a second one outside it is unstable."""
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    for label in ("LP1", "LP2"):
        fold = curve[label]
        assert ", at its stability limit" in plot.portrait(fold).get_suptitle()
        assert "stable," not in repr(fold) and ", at its stability limit, " in repr(fold)
        outside = dataclasses.replace(fold, multipliers=np.array([1.5, 1.0]))
        assert ", unstable" in plot.portrait(outside).get_suptitle()
        displaced = dataclasses.replace(fold, multipliers=np.array([1.004, 0.6]))  # of a fold next to a grazing
        assert displaced.stability_in_words == "at its stability limit"
        assert dataclasses.replace(displaced, kind="PD").stability_in_words == "unstable"
        assert dataclasses.replace(displaced, located=False).stability_in_words == "unstable"
    between = curve[(curve["LP1"].index + curve["LP2"].index) // 2]
    assert ", unstable" in plot.portrait(between).get_suptitle() and ", unstable, " in repr(between)


def test_the_units_of_a_portrait_are_derived_once(monkeypatch):
    from hbgear.plot import motions

    calls, units = [], motions._units
    monkeypatch.setattr(motions, "_units", lambda *arguments: calls.append(arguments) or units(*arguments))
    plot.portrait(rich_point())
    assert len(calls) == 1


def test_spectrum_and_portrait_in_hertz_with_the_model():
    model, point = hb.gears.DoubleHelicalPair(), rich_point()
    ax = plot.spectrum(point, model=model)
    (hertz,) = (child for child in ax.child_axes if child.get_xlabel() == "frequency [Hz]")
    drawn(ax)
    np.testing.assert_allclose(hertz.get_xlim()[1], ax.get_xlim()[1] * model.mesh_frequency(0.85), rtol=1e-12)
    with_units = model.replace(zeta=0.05)  # the parameters of the point are used
    assert f"{with_units.pinion_speed(0.85):.5g} r/min" in plot.portrait(point, 0, model).get_suptitle()


def test_jump_map_has_axes_of_speed_only_if_omega_means_the_same_everywhere():
    def drawn_map(parameter):
        meta = {"model": describe(hb.gears.DoubleHelicalPair())}
        value = hb.gears.DoubleHelicalPair().parameters[parameter]
        grid = np.linspace(0.9, 1.1, 5) * value
        b = resonance()
        fold = rebuilt(
            b,
            parameter=parameter,
            values=grid,
            fixed={},
            tracked={"Omega": np.linspace(0.8, 0.9, 5)},
            X=b.X[:5],
            multipliers=b.multipliers[:5],
            iterations=b.iterations[:5],
            residual=b.residual[:5],
            regime=b.regime[:5],
            error=b.error[:5],
            step=b.step[:5],
            modulus_error=b.modulus_error[:5],
            jump_records=(),
            meta=meta,
            special=(dataclasses.replace(b.special[0], index=2, parameters={parameter: grid[2], "Omega": 0.85}),),
        )
        arm = Arm(grid, fold.tracked["Omega"], 1)
        return plot.jump_map(JumpMap(parameter, (grid[0], grid[-1]), (fold,), (arm,), {}))

    axes = drawn_map("torque")
    (mesh,) = axes.child_axes
    assert (axes.get_ylabel(), mesh.get_ylabel()) == ("speed of the pinion [r/min]", "mesh frequency [Hz]")
    per_unit = float(hb.gears.DoubleHelicalPair().scales.pinion_speed(1.0))
    np.testing.assert_allclose(axes.lines[0].get_ydata(), per_unit * np.linspace(0.8, 0.9, 5), rtol=1e-12)
    drawn(axes)
    texts = [text.get_text() for text in axes.texts]
    assert f"1400, {float(f'{0.85 * per_unit:.4g}'):.0f} r/min" in texts
    axes = drawn_map("k_mean")
    assert not axes.child_axes and "Omega" in axes.get_ylabel()


@pytest.mark.parametrize("share", [0.27, 0.75])
def test_a_legend_keeps_clear_of_enlarged_axes(monkeypatch, share):
    """The legend is on the axes if there is room for it, otherwise to the right of them."""
    monkeypatch.setattr("hbgear.plot.insets._INSET_SIZE", (share, share))
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=0.117), 16), "Omega", (1.5, 0.3))
    ax = hb.plot.response(curve)
    ax.figure.draw_without_rendering()
    inset = next(each for each in ax.child_axes if each.get_label() == "inset").get_window_extent()
    legend = ax.get_legend().get_window_extent()
    assert not legend.overlaps(inset)
    assert (legend.x0 > ax.get_window_extent().x1) == (share > 0.5)


SCALED = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25))


def test_measured_points_in_physical_units_lie_on_the_axes_of_the_response():
    data = hb.design.Measurements([15000.0, 16000.0], [5.0, 4.0], direction=-1, unit="pinion r/min", length="um")
    axes = plot.measured(data, SCALED)
    np.testing.assert_allclose(axes.lines[-1].get_xydata(), [[15000.0, 5.0], [16000.0, 4.0]], rtol=1e-12)
    bare = plot.measured(data, SCALED, dimensionless=True)
    expected = [
        [15000.0 / SCALED.scales.pinion_speed(1.0), 5.0 / 37.6],
        [16000.0 / SCALED.scales.pinion_speed(1.0), 4.0 / 37.6],
    ]
    np.testing.assert_allclose(bare.lines[-1].get_xydata(), expected, rtol=1e-12)


def test_sweeps_are_in_physical_units():
    sweep = hb.time.sweep(SCALED, [1.4, 1.45], "up")
    axes = hb.plot.sweeps([sweep], model=SCALED)
    (dots,) = [line for line in axes.lines if len(line.get_xdata()) == 2]
    np.testing.assert_allclose(dots.get_xdata(), SCALED.scales.pinion_speed(sweep.values), rtol=1e-12)
    np.testing.assert_allclose(dots.get_ydata(), 37.6 * sweep.amplitude("pp2"), rtol=1e-9)
    assert axes.get_xlabel() == "speed of the pinion [r/min]" and "[\N{MICRO SIGN}m]" in axes.get_ylabel()
    section = hb.plot.bifurcation([sweep], model=SCALED).lines[0]
    np.testing.assert_allclose(section.get_ydata(), [37.6 * points[0, 0, 0] for points in sweep.points], rtol=1e-9)


def test_motions_are_in_physical_units():
    """The model is that of the point; displacements are in um, velocities in m/s."""
    curve = hb.trace(hb.HarmonicBalance(SCALED, 5), "Omega", (1.5, 1.45), accuracy=None)
    point, scales = curve[0], SCALED.scales
    history, plane = plot.time_history(point), plot.phase_diagram(point)
    bare = plot.phase_diagram(point, dimensionless=True)
    d, v = bare.lines[0].get_data()
    np.testing.assert_allclose(history.lines[0].get_ydata(), 1e6 * scales.length * d, rtol=1e-12)
    np.testing.assert_allclose(plane.lines[0].get_data(), [37.6 * d, 37.6e-6 * 38000.0 * v], rtol=1e-12)
    assert history.get_ylabel() == "$x$ [\N{MICRO SIGN}m]" and plane.get_ylabel() == "velocity of $x$ [m/s]"
    (line,) = [line for line in history.lines if line.get_gid() == "breakpoint" and line.get_ydata()[0] > 0]
    assert line.get_ydata()[0] == pytest.approx(37.6)
    heights = [plot.spectrum(point, dimensionless=bare).lines[0].get_ydata() for bare in (False, True)]
    np.testing.assert_allclose(heights[0], 37.6 * heights[1], rtol=1e-12)
    assert "r/min" in plot.portrait(point).get_suptitle()


def test_styles_for_print_and_for_slides(tmp_path):
    """The screen style has sans-serif text, larger relative to the figure; the default is restored after the block."""
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.2), accuracy=None)
    with hb.plot.in_style("screen"):
        slide = hb.plot.response(curve)
        hb.plot.save(slide, tmp_path / "slide.png")
    paper = hb.plot.response(curve)
    assert slide.xaxis.label.get_fontfamily() == ["DejaVu Sans"] != paper.xaxis.label.get_fontfamily()
    assert slide.get_legend().get_texts()[0].get_fontfamily() == ["DejaVu Sans"]
    assert slide.xaxis.get_ticklabels()[0].get_fontfamily() == ["DejaVu Sans"]
    assert slide.figure.get_figwidth() < paper.figure.get_figwidth()
    sizes = [ax.xaxis.get_ticklabels()[0].get_size() / ax.figure.get_figwidth() for ax in (slide, paper)]
    assert sizes[0] > sizes[1]
    with pytest.raises(ValueError, match="no style 'poster'; choose one of 'journal', 'screen'"):
        hb.plot.in_style("poster").__enter__()


@pytest.mark.slow
def test_a_tall_legend_covers_no_curve():
    stop = hb.Element([1.0, -1.0], hb.Unilateral(k=20.0, gap=0.3))
    C = hb.mechanics.modal_damping(np.diag([1.0, 0.5]), [[3.0, -1.0], [-1.0, 1.0]], 0.03)
    load = hb.Load(cosine={1: [0.2, 0.0]})
    model = hb.System(np.diag([1.0, 0.5]), C, [[3.0, -1.0], [-1.0, 1.0]], [stop], load)
    ax = hb.plot.response(hb.trace(hb.HarmonicBalance(model, 6), "Omega", (0.3, 3.0), accuracy=None))
    ax.figure.draw_without_rendering()
    extent = ax.get_legend().get_window_extent()
    assert len(ax.get_legend().get_texts()) > 5
    lines = [line for line in ax.lines if str(line.get_gid()).startswith("branch")]
    assert lines
    for line in lines:
        assert not line.get_transform().transform_path(line.get_path()).intersects_bbox(extent, filled=False)
    for inset in ax.child_axes:
        assert not extent.overlaps(inset.get_window_extent())


def test_micrometres_have_one_sign_in_all_labels():
    """The labels of a drawing have the unit of tables, "backlash [um]"; Greek mu in mathtext is italic."""
    axes = plt.figure().subplots()
    axes.set(xlabel="backlash [um]", ylabel="inertia [kg m^2]")
    dress(axes)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("backlash [\N{MICRO SIGN}m]", "inertia [kg m\N{SUPERSCRIPT TWO}]")
    pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    figure = plot.mesh_cycles(hb.GearPair(pinion, wheel, "80 um").mesh("200 N m"))
    assert "static transmission error [\N{MICRO SIGN}m]" in [ax.get_ylabel() for ax in figure.axes]


def test_labels_are_legible_on_curves():
    """Where no position is free of curves, the background of a label covers the curve and leader lines."""
    axes = plot.response(resonance())
    labels = [text for text in axes.texts if (text.get_gid() or "").startswith("label ")]
    assert labels and all(text.get_bbox_patch().get_facecolor()[:3] == (1.0, 1.0, 1.0) for text in labels)


def test_small_amplitudes_have_a_power_of_ten_at_the_axis():
    """Labels such as 0.00002 have too many digits. They are plain text, which is set faster than mathtext."""
    ax = hb.plot.response(hb.trace(hb.HarmonicBalance(hb.Duffing(F=1e-6), 1), "Omega", (0.9, 1.1)))
    ax.figure.canvas.draw()
    assert "10^{" in ax.yaxis.get_offset_text().get_text()
    texts = [text.get_text() for text in ax.get_yticklabels()]
    assert max(map(len, texts)) <= 4 and not any("$" in text for text in texts), texts


def test_constant_amplitude_is_a_level_line():
    """Without loss of contact the motion does not depend on the backlash; its rounding errors are no range."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 4), "b", (0.9, 1.1), at={"Omega": 1.5})
    amplitude = curve.amplitude("rms")
    assert 0 < np.ptp(amplitude) < 1e-9 * amplitude[0]
    for draw in (hb.plot.response, lambda branch, measure: hb.plot.responses([branch], measure)):
        ax = draw(curve, "rms")
        low, high = ax.get_ylim()
        assert low < 0.92 * amplitude[0] and high > 1.08 * amplitude[0]
        assert all((np.diff(line.get_xdata()) > 0).all() for line in ax.lines if len(line.get_xdata()) > 2)
        plt.close(ax.figure)
