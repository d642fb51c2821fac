"""Figures: what is drawn is what the branch holds. The curves are closed-form one-harmonic resonance curves."""

import subprocess
import sys
from itertools import pairwise

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from hbgear import plot
from hbgear.branch import Branch, Jump, Layout, Point, SpecialPoint, Status

LABELS = {"Omega": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$", "amplitude": r"$d / b_c$"}
FIXED = {"zeta": 0.04, "F": 0.12}


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def frequency(A, side, k3, zeta, F):
    """Omega at which x'' + 2 zeta x' + x + k3 x^3 = F cos(Omega t) has the amplitude A, with one harmonic.

    (p - s)^2 + 4 zeta^2 s = F^2 / A^2,   s = Omega^2,   p = 1 + 3/4 k3 A^2
    """
    p = 1 + 0.75 * k3 * A**2
    return np.sqrt(p - 2 * zeta**2 + side * np.sqrt(np.maximum((p - 2 * zeta**2) ** 2 - p**2 + (F / A) ** 2, 0.0)))


def resonance(k3=-0.12, mean=1.9, corners=((-1.0, 1.0),), multipliers=True, harmonics=5):
    """Softening resonance curve in Omega, from high to low frequency, with its folds, grazings and jumps."""
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
        "Omega", Omega, X, FIXED, {}, mu, np.full(len(u), 3), np.zeros(len(u)), regime, np.zeros(len(u)),
        np.zeros(len(u)), (), (), Status.REACHED_END, "", layout, {},
    )  # fmt: skip
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
        p.X, p.parameters, p.residual, p.iterations, p.multipliers, p.regime, p.error, p.layout, label,
        kind, i, True, (branch.values[i - 1], branch.values[i + 1]),
    )  # fmt: skip


def jump(branch, point):
    """To the stable row of the nearest parameter value, other than those beside the fold."""
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
    assert np.array_equal(unstable[0].get_xdata(), b.values[fold[0] : fold[1] + 1])
    borders = [0, *(point.index for point in b.special), len(b) - 1]
    assert [len(line.get_xdata()) for line in lines] == [j - i + 1 for i, j in pairwise(borders)]
    assert [line.get_color() for line in lines] == [
        plot.COLOURS[r] for r in ("no_impact", "single_sided", "single_sided", "single_sided", "no_impact")
    ]


def test_curve_is_continuous_and_complete():
    b = resonance()
    lines = curves(plot.response(b, "rms"))
    for one, two in pairwise(lines):
        assert one.get_xdata()[-1] == two.get_xdata()[0] and one.get_ydata()[-1] == two.get_ydata()[0]
    y = np.concatenate([lines[0].get_ydata()[:1], *(line.get_ydata()[1:] for line in lines)])
    assert np.array_equal(y, b.amplitude("rms"))


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


def test_legend_names_only_what_occurs():
    def names(ax):
        return [text.get_text() for text in ax.get_legend().get_texts()]

    assert names(plot.response(resonance())) == [
        "no impact", "single-sided", "unstable", "fold (LP)", "grazing (GR)"
    ]  # fmt: skip
    assert names(plot.response(resonance(corners=((),)))) == ["unstable", "fold (LP)"]
    assert names(plot.response(resonance(multipliers=False), special=False)) == ["no impact", "single-sided"]
    assert plot.response(resonance(), legend=False).get_legend() is None
    ax = plot.response(resonance(), label="one", color="red", special=False)
    assert names(plot.response(resonance(k3=-0.05), label="two", special=False, ax=ax)) == ["one", "two", "unstable"]
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
    assert len(arrows) == 2  # none for the jump that lands nowhere
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
    assert ax.get_xlabel() == r"$\Omega$" and ax.get_ylabel() == "half peak-to-peak of gap (model units)"
    layout = Layout(2, 1, ("left", "right"), ((), ()))
    two = rebuilt(plain, layout=layout, X=plain.X[:, :10], regime=np.zeros((len(b), 2)))
    assert plot.response(two, "H2", "right").get_ylabel() == "harmonic 2 of gap (model units), right"


def test_one_row_is_a_dot():
    b = resonance(corners=((),))
    cut = {name: getattr(b, name)[:1] for name in ("values", "X", "multipliers", "iterations", "residual", "regime")}
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
    assert [line.get_ydata()[0] for line in plot.time_history(point).lines if line.get_gid() == "corner"] == [-1, 1]
    assert [line.get_xdata()[0] for line in plot.phase_diagram(point).lines if line.get_gid() == "corner"] == [-1, 1]
    low, high = plot.time_history(point).get_ylim()
    assert low < -1 and high > 2
    small = Point(point.X * np.r_[1, np.full(16, 0.05)], point.parameters, 0, 1, None, point.regime, 0.0, point.layout)
    low, high = plot.time_history(small).get_ylim()
    assert low > 1  # neither corner is near: the motion fills the figure


@pytest.mark.parametrize("log", [False, True])
def test_spectrum_heights(log):
    point = rich_point(nu=2)
    order, height = plot.spectrum(point, log=log).lines[0].get_data()
    found = dict(zip(order, height, strict=True))
    for k, expected in {1: np.hypot(0.9, 0.4), 2: np.hypot(0.25, 0.3), 0.5: np.hypot(0.15, 0.1)}.items():
        assert abs(found[k] - expected) < 1e-15
    assert (4.5 in found) != log  # harmonics that are zero have no place on a logarithmic axis


def test_portrait_has_three_axes_and_says_what_it_shows():
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
def test_save_writes_the_kind_its_name_says(tmp_path, name, start):
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


def test_importing_plot_does_not_import_matplotlib():
    code = "import sys, hbgear.plot, hbgear.branch; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
