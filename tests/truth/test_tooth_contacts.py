"""Meshes of unilateral contacts against event-exact integration: motions, multipliers, folds and period doublings.

The reference numbers are in ``tests/data/tooth_contacts.json``: spur pairs with and without relief, an overload, a
contact ratio above 2, a pitch error of one pair in ten, helical slices, a fluctuating torque without load in between,
and tables of a pair of gears. Displacements are in half backlashes, zero where teeth without relief touch.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from machines import gear_pair

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.gears.mesh.tooth_contacts import Flank, PathFunction, mesh_contacts
from hbgear.gears.mesh.tooth_forces import pair_forces, static_displacement
from hbgear.harmonic.equations.motion import with_driven_harmonics
from hbgear.harmonic.multipliers.floquet import floquet_multipliers
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.series.fourier import evaluate

CASES = {
    c["name"]: c for c in json.loads((Path(__file__).parents[1] / "data/tooth_contacts.json").read_text())["cases"]
}
TURN = 2 * np.pi


def flanks_of(inputs: dict) -> list[Flank]:
    length, slices = inputs["contact_ratio"], inputs.get("slices", 1)
    if "k_table" in inputs:
        u = np.linspace(0.0, length, inputs["nodes"] + 1)
        stiffness, gap = (PathFunction.linear(u, inputs[name]) for name in ("k_table", "g_table"))
    else:
        kappa, slope = inputs["kappa"], 2 / length
        mean = 1 / (slices * length * (1 - kappa / 3))
        row = mean * np.array([1 - kappa, 2 * kappa * slope, -kappa * slope**2])
        stiffness = PathFunction(np.array([0.0, length]), row[None])
        entry, leave = (inputs.get(f"relief_{end}", (0.0, 0.1, 1)) for end in ("entry", "exit"))
        u = np.array([0.0, entry[1], length - leave[1], length])
        rise = [(r * np.maximum(1 - x / L, 0.0)) for (r, L, _), x in ((entry, u), (leave, length - u))]
        gap = PathFunction.linear(u, rise[0] + rise[1])
    flanks = []
    for slice_ in range(slices):
        lag = inputs.get("overlap_ratio", 0.0) * (slice_ + 0.5) / slices
        for side, flank, backlash in ((1, "drive", 0.0), (-1, "back", inputs.get("backlash", 2.0))):
            errors = {int(pair): x for pair, x in inputs.get(f"pitch_error_{flank}", {}).items()}
            flanks.append(Flank(side, stiffness, gap, backlash, lag, errors))
    return flanks


def law(inputs: dict) -> MeshContacts:
    return mesh_contacts(flanks_of(inputs), inputs.get("period_meshes", 1))


def system(inputs: dict, mesh: hb.mechanics.Law | None = None, load: float | None = None) -> hb.System:
    element = hb.Element([1.0], mesh or law(inputs), name="mesh")
    varying = {1: [inputs["F1"]]} if "F1" in inputs else {}
    return hb.System(
        [[1.0]], [[2 * inputs["zeta"]]], [[0.0]], [element], hb.Load(constant=[load or inputs["F0"]], cosine=varying)
    )


def problem_of(name: str, harmonics: int, nu: int = 1) -> hb.HarmonicBalance:
    return hb.HarmonicBalance(system(CASES[name]["inputs"]), harmonics, nu=nu)


@pytest.mark.parametrize(
    "name, motion",
    [
        pytest.param(name, m, id=f"{name}-{m['Omega']}-{i}")
        for name, c in CASES.items()
        for i, m in enumerate(c["motions"])
    ],
)
def test_motion(name, motion):
    base = CASES[name]["inputs"].get("period_meshes", 1)
    H = 64 * motion["meshes"] if motion["meshes"] <= 2 else 400
    problem = problem_of(name, H, motion["meshes"] // base)
    X, known = np.zeros(2 * H + 1), len(motion["cosine"])
    X[0], X[1 : 2 * known : 2], X[2 : 2 * known + 1 : 2] = motion["mean"], motion["cosine"], motion["sine"]
    found = solve(problem, X, {"Omega": motion["Omega"] / base}).X
    compiled, Omega = problem.compiled({}), np.array([motion["Omega"] / base])
    whole = with_driven_harmonics(compiled, found[None], Omega)
    x = evaluate(whole[0], TURN * np.arange(64 * H) / (64 * H))
    assert abs(found[0] - motion["mean"]) < 1e-6
    assert abs(np.sqrt(np.mean((x - x.mean()) ** 2)) - motion["rms"]) < 1e-6
    np.testing.assert_allclose(found[1 : 2 * known : 2], motion["cosine"], rtol=0, atol=1.2e-6)
    np.testing.assert_allclose(found[2 : 2 * known + 1 : 2], motion["sine"], rtol=0, atol=1.2e-6)
    np.testing.assert_allclose([x.min(), x.max()], [motion["min"], motion["max"]], rtol=0, atol=1e-5)
    mu = floquet_multipliers(compiled, whole, Omega)[0]
    exact = np.array([complex(*z) for z in motion["multipliers"]])
    exact = exact[np.argsort(-np.abs(exact), kind="stable")]
    error = min(np.abs(mu - exact).max(), np.abs(mu - exact[::-1]).max())
    assert error < 1e-4 * max(1.0, np.abs(exact).max())
    assert problem.regime(found, Omega=float(Omega[0])).tolist() == [motion["regime"]]


SPANS = {"T1": (1.7, 0.45), "S9": (0.12, 0.07)}


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, c in CASES.items() if c["special"]])
def test_folds_and_period_doublings(name):
    meshes = CASES[name]["inputs"].get("period_meshes", 1)
    problem = problem_of(name, 24 if meshes == 1 else 16 * meshes)
    curve = hb.trace(problem, "Omega", SPANS.get(name, (2.3, 0.42)), accuracy=5e-7 if meshes == 1 else 1e-6)
    found = [(p.kind, meshes * p.parameters["Omega"]) for p in curve.special if p.kind in ("LP", "PD")]
    assert [kind for kind, _ in found] == [kind for kind, _ in CASES[name]["special"]]
    for (_, value), (_, exact) in zip(found, CASES[name]["special"], strict=True):
        assert abs(value - exact) < 1e-6


def test_force_and_its_derivative():
    """Projected force harmonics equal integrals of the law, the Jacobian equals differences of the residual."""
    problem = problem_of("S5", 12)
    compiled, mesh = problem.compiled({}), system(CASES["S5"]["inputs"]).elements[0].law
    X = np.zeros(25)
    X[[0, 1, 4, 7]] = -0.3, 1.5, 0.4, 0.2
    tau = TURN * (np.arange(400_000) + 0.5) / 400_000
    p = mesh.force(evaluate(X, tau), np.zeros(1), tau)[0]
    waves = [np.ones_like(tau), *(2 * f(k * tau) for k in range(1, 13) for f in (np.cos, np.sin))]
    np.testing.assert_allclose(compiled.forces(X, 1.0)[0], [np.mean(p * w) for w in waves], rtol=0, atol=1e-9)
    J, h = compiled.linearise(X, 1.0)[1], 1e-6
    steps = [compiled.linearise(X + s, 1.0)[0] - compiled.linearise(X - s, 1.0)[0] for s in h * np.eye(25)]
    np.testing.assert_allclose(J, np.transpose(steps) / (2 * h), rtol=0, atol=1e-8)


def test_without_relief_the_mesh_is_that_of_its_mean_stiffness():
    inputs = CASES["S1"]["inputs"]
    length, kappa = inputs["contact_ratio"], inputs["kappa"]
    mean = 1 / (length * (1 - kappa / 3))

    def pair(u: np.ndarray) -> np.ndarray:
        return mean * (1 - kappa * (2 * u / length - 1) ** 2)

    u = np.linspace(0.0, 1.0, 101)
    both = length - 1.0
    k = hb.mechanics.Periodic(
        (0.0, TURN * both),
        tuple(
            tuple(np.polynomial.polynomial.polyfit((u * w) * TURN, sum(pair(a + u * w) for a in starts), 2))
            for w, starts in ((both, (0.0, 1.0)), (1.0 - both, (both,)))
        ),
    )
    shifted = system(inputs, hb.Backlash(1.0, stiffness=k))
    curve = hb.trace(hb.HarmonicBalance(shifted, 24), "Omega", (1.2, 0.5))
    resolved = hb.trace(problem_of("S1", 24), "Omega", (1.2, 0.5))
    for label in ("LP1", "LP2", "LP3", "LP4"):
        assert abs(curve[label].parameters["Omega"] - resolved[label].parameters["Omega"]) < 2e-8


@pytest.mark.parametrize(
    ("name", "which", "pair", "slice_", "back", "open_"),
    [
        ("S3", 9, 1.0493096064153, 1.0493096064153, 0.20225250852488, 0.66746317655687),
        ("H1", 8, 0.73589168790844, 0.15805892406106, 0.0, 0.67593183994462),
        ("S9", 0, 0.39180173115378, 0.39180173115378, 0.0, 0.060104570874965),
    ],
)
def test_forces_of_single_pairs(name, which, pair, slice_, back, open_):
    """Largest forces of a pair, a slice and a back flank, and the time without contact, of the same integration."""
    inputs, motion = CASES[name]["inputs"], CASES[name]["motions"][which]
    M = motion["meshes"]
    H, base = 48 * M, inputs.get("period_meshes", 1)
    problem = problem_of(name, H, M // base)
    X, known = np.zeros(2 * H + 1), len(motion["cosine"])
    X[0], X[1 : 2 * known : 2], X[2 : 2 * known + 1 : 2] = motion["mean"], motion["cosine"], motion["sine"]
    X = solve(problem, X, {"Omega": motion["Omega"] / base}).X
    found = pair_forces(flanks_of(inputs), lambda t: evaluate(X, TURN * t / M), M)
    assert found.force.max() == pytest.approx(pair, rel=2e-4)
    assert found.drive.max() == pytest.approx(slice_, rel=2e-4)
    assert found.back.max(initial=0.0) == pytest.approx(back, abs=2e-5)
    assert np.mean(found.total[:, :1024] <= 0) == pytest.approx(open_, abs=1.5e-3)
    t = M * (np.arange(4) + 0.3) / 4
    x = evaluate(X, TURN * t / M)
    driving = MeshContacts(tuple(c for c in law(inputs).contacts if c.side > 0))
    drive = driving.force(x, np.zeros(4), TURN * t / base % TURN)[0]
    sums = [np.interp(s - int(s), found.position[:1024], found.total[int(s), :1024]) for s in t]
    np.testing.assert_allclose(sums, drive, atol=2e-4)


@pytest.mark.parametrize(
    ("name", "force", "low", "high"),
    [
        ("S3", 0.15, 0.20063492063492, 0.21333333333333),
        ("S3", 0.5, 0.50086419753086, 0.71111111111111),
        ("H1", 0.3, 0.31100541683181, 0.3958837116974),
    ],
)
def test_static_transmission_error(name, force, low, high):
    """Extremes of the equilibrium of all contacts, by another program."""
    delta = static_displacement(flanks_of(CASES[name]["inputs"]), force)[1]
    assert delta.min() == pytest.approx(low, abs=2e-7)
    assert delta.max() == pytest.approx(high, abs=2e-7)


def test_static_displacement_of_constant_stiffness():
    """Slices of stiffness 1/2 that each have one or two pairs in contact, and jumps resolved on both sides."""
    ends, length, lags, F, b = [0.0, 1.6], 1.6, (0.0, 0.5), 0.7, 0.3
    half, gap = PathFunction.linear(ends, [0.5, 0.5]), PathFunction.linear(ends, [0.05, 0.05])
    phase, found = static_displacement([Flank(1, half, gap, 0.02, lag) for lag in lags], F, b)

    def exact(x):
        return F / sum(0.5 + 0.5 * ((x - lag) % 1.0 < length - 1) for lag in lags) + 0.05 + 0.02 + b

    np.testing.assert_allclose(found, exact(phase), rtol=1e-12)
    jumps = np.array([0.1, 0.5, 0.6])
    for x in (jumps - 2e-8, jumps + 2e-8):
        np.testing.assert_allclose(np.interp(x, phase, found), exact(x), rtol=1e-12)


def test_changes_of_functions_over_the_path():
    """Sections and mirror images have the values of the function at the same positions and at their images."""
    rows = np.array([[0.3, 1.0, -2.0, 0.7], [0.5, -0.4, 0.2, 1.1], [0.1, 0.2, 0.0, -0.6]])
    nodes, u = np.array([0.2, 0.7, 1.0, 1.9]), np.linspace(0.4, 1.6, 96)
    values = [sum(c * (u - begin) ** q for q, c in enumerate(row)) for row, begin in zip(rows, nodes[:-1], strict=True)]
    values = np.select([u < 0.7, u < 1.0], values[:2], values[2])
    function = PathFunction(nodes, rows)
    np.testing.assert_allclose(function.at(u), values, rtol=1e-13)
    np.testing.assert_allclose(function.section(0.35, 1.65).at(u), values, rtol=1e-12)
    np.testing.assert_allclose(function.mirrored(0.8).at(1.6 - u), values, rtol=1e-12)
    np.testing.assert_allclose(function.plus(0.3, -2.0).at(u), 0.3 - 2 * values, rtol=1e-12)
    assert (function.mirrored(0.8).nodes[0], function.length) == (pytest.approx(-0.3), 1.9)


def test_a_fluctuating_torque_is_a_field_of_a_pair():
    """The pair with one mesh period of contacts, of order 10, has the equations of the case over ten meshes."""
    inputs = CASES["R1"]["inputs"]
    pair = hb.SpurPair(
        inputs["zeta"],
        inputs["F0"],
        e=(),
        contacts=law({**inputs, "period_meshes": 1, "backlash": 0.0}),
        mesh_order=10,
        fluctuation=hb.mechanics.Series(cosine=(inputs["F1"],)),
    )
    motion = CASES["R1"]["motions"][0]
    X, Omega, known = np.zeros(81), motion["Omega"] / 10, len(motion["cosine"])
    X[0], X[1 : 2 * known : 2], X[2 : 2 * known + 1 : 2] = motion["mean"], motion["cosine"], motion["sine"]
    ten = problem_of("R1", 40).evaluate(X, Omega=Omega)[0]
    X[0] += 1.0  # displacements of the pair are zero in the middle of the backlash
    np.testing.assert_allclose(hb.HarmonicBalance(pair, 40).evaluate(X, Omega=Omega)[0], ten, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_folds_of_a_drawn_pair_pass_grazing_contacts_of_teeth():
    """Over the damping three folds meet motions at which a pair of teeth begins to touch: corners of their curves.

    Beyond them they are the folds of a curve traced there, to rounding; one of them has turned back before.
    """
    model = hb.gears.DrawnPair(gear_pair(tip_relief="12 um"), 200.0, 0.04)
    curve, other = (
        hb.trace(hb.HarmonicBalance(model.replace(damping=z), 16), "Omega", model.default_span) for z in (0.04, 0.034)
    )
    true = np.array([p.parameters["Omega"] for one in other.curves for p in one.special if p.kind == "LP"])
    for label in ("LP2", "LP3", "LP4"):
        folds = hb.follow(curve, label, "damping", (0.04, 0.034))
        assert folds.status is hb.Status.REACHED_END
        assert np.abs(true - folds.tracked["Omega"][-1]).min() < 1e-10
        if label != "LP2":
            assert any(point.kind == "CP" for point in folds.special)
