"""Receptances computed from a known system give the curve of that system."""

import json

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.models import model_registry
from hbgear.mechanics.models import describe

K = np.array([[3.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 2.0]])
M, C = np.diag([1.0, 1.5, 0.8]), 0.06 * K
W = np.linspace(0.0, 16.0, 3201)


def by_force(w, stiffness=K, mass=M, damping=C):
    return np.linalg.inv(stiffness + 1j * w * damping - w**2 * mass)


def machine(directions, n=3):
    """Elements (a stop between two coordinates, backlash to the ground), and constant and harmonic loads."""
    one, other, wave = np.eye(n)[directions[0]], np.eye(n)[directions[1]], np.eye(n)[directions[2]]
    elements = [
        hb.Element(one - other, hb.Unilateral(2.0, 0.2), damping=0.02, name="stop"),
        hb.Element(other, hb.Backlash(0.4, 3.0), hb.mechanics.Series(0.0, (0.02,)), name="gap"),
    ]
    return elements, [hb.Load(0.05 * wave, {1: 0.3 * wave}), hb.Load(sine={2: 0.02 * one}, power=2)]


@pytest.fixture(scope="module")
def known():
    elements, loads = machine((0, 1, 2))
    return hb.System(M, C, K, elements, loads, ["a", "b", "c"])


@pytest.fixture(scope="module")
def measured():
    found = hb.mechanics.Receptances(W, [by_force(w) for w in W], ["a", "b", "c"])
    elements, loads = machine((0, 1, 2))
    return found.system(elements, loads)


@pytest.mark.slow
def test_measured_whole_gives_the_curve_of_the_system(known, measured):
    """Motions agree to the error of the spline, which decreases as the fourth power of the line spacing."""
    one, other = (hb.HarmonicBalance(model, 8) for model in (known, measured))
    for Omega in (0.5027, 1.1021, 1.8993):  # between the lines
        X = one.start(Omega=Omega)
        np.testing.assert_allclose(solve(other, X, {"Omega": Omega}).X, X, rtol=0, atol=1e-7)
        near = X + 0.1 * np.sin(np.arange(one.size))
        each = (problem.linearise(near, "Omega", Omega=Omega) for problem in (one, other))
        for a, b in zip(*(evaluation[:-1] for evaluation in each), strict=True):  # the size has other rounding errors
            np.testing.assert_allclose(b, a, rtol=0, atol=2e-5 * np.abs(a).max())
        np.testing.assert_allclose(other.motion(X, Omega=Omega), one.motion(X, Omega=Omega), atol=1e-7)
    a, b = (hb.trace(problem, "Omega", (0.6, 1.9), accuracy=None) for problem in (one, other))
    assert b.status.complete and b.multipliers is None and b.stable is None
    assert 16 * 0.6 < W[-1] < 16 * 1.9  # the lines cover twice the harmonics on a part of the curve
    assert np.isfinite(b.error).all() and b.error.max() > 1e-5 and (b.regime >= 0).all()
    assert b.meta["stability"].startswith("not available")
    folds = [[p.parameters["Omega"] for p in curve.special if p.kind in ("LP", "GR")] for curve in (a, b)]
    assert len(folds[0]) > 2
    np.testing.assert_allclose(folds[1], folds[0], rtol=1e-5)


def test_a_measured_part_with_masses_and_springs(known):
    """Matrices of the third mass and its springs are combined with receptances of the other two masses."""
    left = K[:2, :2] - np.diag([0.0, 1.0])
    part = hb.mechanics.Receptances(W, [by_force(w, left, M[:2, :2], 0.06 * left) for w in W], ["a", "b"])
    rest = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 2.0]])
    whole = hb.System(
        np.diag([0.0, 0.0, 0.8]), 0.06 * rest, rest, known.elements, known.load, known.dof_names, receptances=part
    )
    one, other = (hb.HarmonicBalance(model, 8) for model in (known, whole))
    X = one.start(Omega=1.2021)
    np.testing.assert_allclose(solve(other, X, {"Omega": 1.2021}).X, X, rtol=0, atol=1e-7)


@pytest.mark.slow
def test_a_curve_goes_on_from_its_file(measured, tmp_path):
    model = hb.mechanics.Receptances(W[::2], [by_force(w) for w in W[::2]], "abc").system(
        measured.elements, measured.load
    )
    about = json.loads(json.dumps(describe(model)))
    assert "left_out" not in about and describe(model_registry.rebuild_model(about)) == about
    part = hb.trace(hb.HarmonicBalance(model, 4), "Omega", (0.6, 0.8), steps=hb.StepControl(max_points=5))
    part.save(tmp_path / "part.npz")
    assert hb.extend(hb.load(tmp_path / "part.npz")).status.complete


def table(folder, name, f, H, kind="real"):
    path = folder / name
    columns, head = {
        "real": ((H.real, H.imag), ""),
        "polar": ((np.abs(H), np.degrees(np.angle(H))), "frequency [Hz], magnitude, phase [deg]\n"),
        "radians": ((np.abs(H), np.angle(H)), "frequency [rad/s]; amplitude; phase [rad]\n"),
    }[kind]
    f = 2 * np.pi * f if kind == "radians" else f
    mark = ";" if kind == "radians" else ","
    path.write_text(
        "# a test\n" + head + "\n".join(mark.join(map(repr, map(float, row))) for row in zip(f, *columns, strict=True))
    )
    return path


@pytest.mark.parametrize(("quantity", "power"), [("receptance", 0), ("mobility", 1), ("accelerance", 2)])
@pytest.mark.parametrize("kind", ["real", "polar", "radians"])
def test_tables(quantity, power, kind, tmp_path):
    f = np.linspace(0.1, 2.5, 40)
    H = np.array([by_force(2 * np.pi * each)[:2, :2] for each in f])
    given = H * ((2j * np.pi * f) ** power)[:, None, None]
    files = {
        (a, b): table(tmp_path, f"{a}{b}.csv", f, given[:, i, j], kind)
        for i, a in enumerate("ab")
        for j, b in enumerate("ab")
        if i <= j
    }
    static = by_force(0.0)[:2, :2].real
    found = hb.io.from_receptances(files, static, quantity)
    np.testing.assert_allclose(found.omega, 2 * np.pi * f, rtol=1e-12)
    np.testing.assert_allclose(found.values, H, rtol=1e-11)
    assert found.names == ("a", "b") and np.array_equal(found.static, static)
    lowest = hb.io.from_receptances(files, "lowest", quantity)
    np.testing.assert_allclose(lowest.static, H[0].real, rtol=1e-11)


def test_universal_files(tmp_path):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed; pip install 'hbgear[measured]'")
    f = np.linspace(0.0, 2.5, 41)
    H = np.array([by_force(2 * np.pi * each)[:2, :2] for each in f])
    path = tmp_path / "test.uff"
    for i, j, binary in ((0, 0, 0), (1, 0, 1), (1, 1, 0)):
        sign = -1 if i != j else 1  # a response in the negative direction
        one = pyuff.prepare_58(
            binary=binary,
            func_type=4,
            rsp_node=i + 1,
            rsp_dir=3 * sign,
            ref_node=j + 1,
            ref_dir=3,
            data=-sign * H[:, i, j] * (2 * np.pi * f) ** 2,
            x=f,
            abscissa_spacing=1,
            abscissa_spec_data_type=18,
            ordinate_spec_data_type=12,
            orddenom_spec_data_type=13,
            rsp_ent_name="a",
            ref_ent_name="b",
            id1="test",
        )
        pyuff.UFF(str(path)).write_sets(one, "add")
    static = by_force(0.0)[:2, :2].real
    found = hb.io.from_receptances(path, static)
    assert found.names == ("1z", "2z") and len(found.omega) == 40  # the line at 0 Hz of an accelerance is omitted
    np.testing.assert_allclose(found.values, H[1:], rtol=1e-5, atol=1e-6 * np.abs(H).max())
    named = hb.io.from_receptances(path, [[0.5]], names={"2z": "case"})
    assert named.names == ("case",)
    np.testing.assert_array_equal(named.values[:, 0, 0], found.values[:, 1, 1])
    with pytest.raises(ValueError, match="no coordinate '3z'"):
        hb.io.from_receptances(path, static, names={"3z": "case"})
    (tmp_path / "bad.uff").write_text("nothing")
    with pytest.raises(ValueError, match=r"frequency responses|cannot be read as a universal file"):
        hb.io.from_receptances(tmp_path / "bad.uff")


def test_missing_pyuff_is_reported(tmp_path, monkeypatch):
    (tmp_path / "test.uff").write_text("")
    monkeypatch.setitem(__import__("sys").modules, "pyuff", None)
    with pytest.raises(ValueError, match=r"pip install 'hbgear\[measured\]'"):
        hb.io.from_receptances(tmp_path / "test.uff")


def test_lines_far_apart_are_reported(measured):
    coarse = hb.mechanics.Receptances(W[::80], [by_force(w) for w in W[::80]], "abc").system(
        measured.elements, measured.load
    )
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="lines of the receptances are far apart"):
        hb.HarmonicBalance(coarse, 8)


@pytest.mark.parametrize(("step", "tolerance"), [(1, 0.02), (2, 0.06), (4, 0.3)])
def test_coarseness_is_the_error_of_the_spline_between_the_lines(step, tolerance):
    """Error relative to the peak, against the exact receptance of one mass at the midpoints of the intervals."""
    w = W[:801]

    def exact(w):
        return (1 / (1.0 + 0.4j * w - w**2))[:, None, None]

    found = hb.mechanics.Receptances(w[::step], exact(w[::step]), ["x"])
    middle = (found.omega[2:] + found.omega[1:-1]) / 2  # above the lowest line
    spline = np.array([np.linalg.inv(found.stiffness(x)[0]) for x in middle])
    error = np.abs(spline - exact(middle)).max() / np.abs(found.values).max()
    assert found.coarseness == pytest.approx(error, rel=tolerance)


ONE = np.ones((5, 1, 1))
LINES = np.arange(1.0, 6.0)


def on(measured, **changes):
    return hb.System(
        np.eye(3), None, np.eye(3), measured.elements, measured.load, receptances=measured.receptances, **changes
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda m: hb.trace(hb.HarmonicBalance(m, 8), "Omega", (0.6, 2.5)),
            "Omega from 0.6 to 2.5 with 8 harmonics needs receptances from 0.6 to 20; the lines are from 0.005 to 16",
        ),
        (lambda m: hb.HarmonicBalance(m, 8).start(Omega=2.5), "a motion has the frequency 17.5"),
        (lambda m: hb.trace(hb.HarmonicBalance(m, 8, nu=2), "Omega", (0.008, 0.3)), "of Omega / 2 needs receptances"),
        (lambda m: hb.time.integrate(m, np.zeros(6), 1, 1.0), "a, b, c are known by receptances only"),
        (lambda m: hb.time.integrate(m, np.zeros(6), 1, 1.0, method="exponential"), "known by receptances only"),
        (lambda m: hb.time.shoot(m, 1.0, np.zeros(6)), "known by receptances only"),
        (lambda m: hb.analysis.campbell(m, (1.0, 2.0)), "known by receptances only"),
        (lambda m: hb.mechanics.reduce(m, 1), "known by receptances only"),
        (lambda m: hb.HarmonicBalance(m, 3).multipliers(np.zeros(14), Omega=1.0), "known by receptances only"),
        (lambda m: on(m), "no coordinate 'a'"),
        (lambda m: on(m, dof_names="abc", speed=hb.mechanics.SpeedTerms(np.zeros((3, 3)))), "not both"),
        (lambda m: hb.mechanics.Receptances(LINES, ONE, ["x"]), "lowest frequency is 1; the mean of a motion needs"),
        (lambda m: hb.mechanics.Receptances(LINES[:3], ONE[:3], ["x"], [[1.0]]), "four or more frequencies"),
        (lambda m: hb.mechanics.Receptances(LINES[::-1], ONE, ["x"], [[1.0]]), "ascend"),
        (lambda m: hb.mechanics.Receptances(LINES, ONE[:4], ["x"], [[1.0]]), r"need \(F, p, p\)"),
        (lambda m: hb.mechanics.Receptances(LINES, np.nan * ONE, ["x"], [[1.0]]), "not finite"),
        (lambda m: hb.mechanics.Receptances(LINES, ONE, ["x", "y"], [[1.0]]), "must be 1 different names"),
        (lambda m: hb.mechanics.Receptances(LINES, ONE, ["x"], [[1.0, 2.0]]), "static has shape"),
        (lambda m: hb.mechanics.Receptances(LINES, "some", ["x"], [[1.0]]), "complex numbers"),
        (
            lambda m: hb.mechanics.Receptances(LINES, np.ones((5, 2, 2)), "xy", np.eye(2)),
            "at omega = 1 different forces",
        ),
        (lambda m: hb.io.from_receptances({}), "there are no tables"),
        (lambda m: hb.io.from_receptances({"a": "a.csv"}), "names of response and force"),
        (lambda m: hb.io.from_receptances({("a", "a"): "a.csv"}, names={"a": "b"}), "leave names out"),
        (
            lambda m: hb.io.from_receptances({("a", "a"): "nowhere.csv"}),
            "cannot be read as a frequency response: No such",
        ),
        (lambda m: hb.io.from_receptances("nowhere.uff"), "there is no file 'nowhere.uff'"),
    ],
)
def test_bad_input(make, message, measured):
    with pytest.raises(ValueError, match=message):
        make(measured)


def test_bad_tables(tmp_path):
    f, H = np.linspace(0.0, 2.0, 9), np.ones(9, dtype=complex)
    good, other = table(tmp_path, "good.csv", f, H), table(tmp_path, "other.csv", f[:8], H[:8])
    with pytest.raises(ValueError, match="no function of 'a' by a force on 'b', or of 'b' by a force on 'a'"):
        hb.io.from_receptances({("a", "a"): good, ("b", "b"): good})
    with pytest.raises(ValueError, match="need the same lines"):
        hb.io.from_receptances({("a", "a"): good, ("a", "b"): other, ("b", "b"): good})
    with pytest.raises(ValueError, match="must be a matrix, 'lowest' or None"):
        hb.io.from_receptances({("a", "a"): good}, "zero")
    for text, message in (
        ("1,2\n3,4", "need a frequency with real and imaginary part, or with magnitude and phase"),
        ("a,b,c", "no rows of numbers"),
        ("", "no rows of numbers"),
        ("1,2,x", "line 1: 'x' in the column 'imag' must be"),
    ):
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(ValueError, match=message):
            hb.io.from_receptances({("a", "a"): tmp_path / "bad.csv"})
