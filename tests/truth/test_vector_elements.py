"""Elements with several displacements against closed forms and event-exact motions.

Circular whirl of z'' + 2 zeta z' + k0 z + k max(1 - c / |z|, 0) (1 + i mu) z = e Omega^2 exp(i Omega t):
    |k0 + k (1 - c / r) (1 + i mu) - Omega^2 + 2 i zeta Omega| r = e Omega^2
"""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import scipy
from scipy.io import mmwrite

import hbgear as hb
from hbgear.analysis.summary import leaving_lines, regime_of
from hbgear.continuation.solvers.newton import solve
from hbgear.io.machines.structure_file import read_structure
from hbgear.mechanics.laws.vector_laws import vector_groups
from hbgear.mechanics.serialization import from_plain, to_plain
from hbgear.mechanics.series.fourier import evaluate
from hbgear.plot.branch_sections import sections

UNIT = np.eye(2)


def rotor(mu=0.0, zeta=0.05, weight=0.0, k0=1.0):
    hole = hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(4.0, 1.0, mu), name="seal")
    loads = [hb.Load(cosine={1: [0.3, 0.0]}, sine={1: [0.0, 0.3]}, power=2), hb.Load([0.0, -weight])]
    return hb.System(UNIT, 2 * zeta * UNIT, k0 * UNIT, [*hole], loads)


def whirl(r, Omega, mu=0.0):
    """Return the unknowns with one harmonic of circular whirl in contact, zeta = .05."""
    z = 0.3 * Omega**2 / (1 + 4 * (1 - 1 / r) * (1 + 1j * mu) - Omega**2 + 0.1j * Omega)
    return np.array([0, z.real, -z.imag, 0, z.imag, z.real])


@pytest.mark.parametrize(
    ("mu", "fold", "r"), [(0.0, 2.0976089266449423, 5.940314558802791), (0.1, 1.855192253344421, 2.3338959937986368)]
)
def test_fold_of_circular_whirl(mu, fold, r):
    problem, Omega = hb.HarmonicBalance(rotor(mu), 1), fold - 0.02
    low = solve(problem, whirl(0.9 * r, Omega, mu), {"Omega": Omega}).X
    curve = hb.trace(problem, "Omega", (Omega, fold + 0.01), start=low, cover=False, accuracy=None)
    assert curve["LP1"].parameters["Omega"] == pytest.approx(fold, abs=1e-10)
    assert np.hypot(curve["LP1"].X[1], curve["LP1"].X[2]) == pytest.approx(r, rel=1e-6)


@pytest.mark.parametrize(
    ("Omega", "r", "growth"),
    [(1.5, 1.6224556537822281, 0.019708893418146523), (1.0, 1.0671551520646974, 0.003076397257692265)],
)
def test_stability_of_circular_whirl(Omega, r, growth):
    """The largest growth rate in the rotating frame, by friction above zero."""
    problem = hb.HarmonicBalance(rotor(0.1), 3)
    X = np.zeros((2, 7))
    X[:, :3] = whirl(r, Omega, 0.1).reshape(2, 3)
    X = solve(problem, X.ravel(), {"Omega": Omega}).X
    assert np.hypot(X[1], X[2]) == pytest.approx(r, rel=1e-10)
    assert np.log(np.abs(problem.multipliers(X, Omega=Omega)).max()) / (2 * np.pi / Omega) == pytest.approx(
        growth, abs=1e-9
    )


def test_rub_with_weight():
    """A motion that enters and leaves contact in each period."""
    state = [-0.511032212325911, -0.6146218529986206, 0.18340214362218535, -0.7984193659955277]
    orbit = hb.time.shoot(rotor(zeta=0.1, weight=0.5), 1.5, state, tolerance=1e-9)
    np.testing.assert_allclose(orbit.state, state, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.abs(orbit.multipliers), 0.6577837688198399, rtol=0, atol=1e-8)
    problem = hb.HarmonicBalance(rotor(zeta=0.1, weight=0.5), 15, samples=2048)
    X = solve(problem, orbit.rows(15).ravel(), {"Omega": 1.5}).X.reshape(2, -1)
    rms = np.sqrt(0.5 * (X[:, 1:] ** 2).sum(axis=1))
    np.testing.assert_allclose(rms, [0.37175834650034373, 0.38791869772068943], rtol=0, atol=5e-6)


@pytest.mark.slow
def test_contact_of_circular_whirl_begins_at_a_grazing_point():
    """Where the linear radius e Omega^2 / |1 - Omega^2 + .1 i Omega| reaches the clearance 1."""
    curve = hb.trace(hb.HarmonicBalance(rotor(), 3), "Omega", (0.7, 1.0), cover=False)
    points = [point for point in curve.special if point.kind == "GR"]
    assert len(points) == 1 and points[0].note == "lowest of seal, highest of seal"
    assert points[0].parameters["Omega"] == pytest.approx(0.8846139636131891, abs=1e-8)


@pytest.mark.slow
def test_regimes_of_a_rub_with_weight():
    """The shaft leaves the hole in each period: single-sided between two grazing points, with and without contact."""
    curve = hb.trace(hb.HarmonicBalance(rotor(zeta=0.1, weight=0.5), 9), "Omega", (0.6, 1.0), cover=False)
    assert {"no_impact", "single_sided"} <= set(curve.regimes)
    first = next(point for point in curve.special if point.kind == "GR")
    W = first.parameters["Omega"]  # without contact: a circle about (0, -weight)
    assert abs(0.3 * W**2 / (1 - W**2 + 0.2j * W)) + 0.5 == pytest.approx(1.0, abs=1e-8)
    assert first.note == "highest of seal"
    drawn = {state[0] for state, _, _ in sections(curve, "seal 2")}  # the colours of a figure
    assert drawn == set(curve.regimes) and regime_of(first) == "single-sided"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k0", "k", "mu", "zeta", "e", "Omega", "weight", "state", "sizes"),
    [
        (
            1.0,
            4.0,
            0.0,
            0.05,
            0.3,
            1.2,
            0.0,
            [1.16212759689539, -0.42542390223962, 0.51050868268755, 1.39455311627447],
            [0.7696654124932397],
        ),
        (
            1.0,
            4.0,
            0.0,
            0.1,
            0.3,
            0.7,
            0.5,
            [0.26803718269575, -0.57357883446550, 0.05150518412585, 0.18762602788702],
            [0.40754745421268007],
        ),
        (
            1.0,
            4.0,
            0.1,
            0.1,
            0.3,
            1.2,
            0.5,
            [0.69498392336470, -1.13259935310911, 1.23882087223446, 0.91745710383738],
            [0.8013084445893579, 0.43793349433403433],
        ),
        (
            0.0,
            1.0,
            0.0,
            0.1,
            0.2,
            0.6,
            0.3,
            [-0.22974144512287, -1.28537001317206, 0.20308568992787, 0.12927554929755],
            [0.35091980717842],
        ),
        (
            0.0,
            1.0,
            0.0,
            0.1,
            0.2,
            1.4,
            0.3,
            [-0.20956563958149, -1.37510501229426, 0.04355606331835, -0.50219309394188],
            [0.7723825041282192, 0.5276497746057052],
        ),
    ],
)
def test_rub_by_shooting(k0, k, mu, zeta, e, Omega, weight, state, sizes):
    """Motions without contact, with contact throughout, and with both, against another event-exact shooting."""
    hole = hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(k, 1.0, mu))
    loads = [hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2), hb.Load([0.0, -weight])]
    system = hb.System(UNIT, 2 * zeta * UNIT, k0 * UNIT, [*hole], loads)
    orbit = hb.time.shoot(system, Omega, np.array(state) + 1e-4, tolerance=1e-9)
    np.testing.assert_allclose(orbit.state, state, rtol=0, atol=1e-9)
    found = np.abs(orbit.multipliers)
    assert all(np.abs(found - one).min() < 1e-8 for one in sizes) and found.max() == pytest.approx(max(sizes), abs=1e-8)


def coupled(law, directions=UNIT, **keys):
    K = np.array([[2.0, -1.0], [-1.0, 3.0]])
    return hb.System(
        UNIT, 0.1 * UNIT, K, [*hb.mechanics.VectorElement(directions, law, **keys)], hb.Load(cosine={1: [0.5, 0.2]})
    )


@pytest.mark.slow
def test_polynomial_coupling():
    """The springs of V = q1^2 q2^2 / 2 + q1^4 / 4, against shooting."""
    law = hb.mechanics.Polynomial([[1, 2], [2, 1], [3, 0]], [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
    orbit = hb.time.shoot(coupled(law), 1.1, [0.3, 0.2, 0.0, 0.1])
    problem = hb.HarmonicBalance(coupled(law), 11)
    X = solve(problem, orbit.rows(11).ravel(), {"Omega": 1.1}).X
    np.testing.assert_allclose(evaluate(X.reshape(2, -1), [0.0])[:, 0], orbit.state[:2], rtol=0, atol=1e-8)
    for mu in orbit.multipliers:
        assert np.abs(problem.multipliers(X, Omega=1.1) - mu).min() < 1e-8


def test_directed_spring_is_part_of_a_matrix_that_is_not_symmetric():
    """A linear spring that measures q1 and acts on q2 is an entry of K."""
    K, W = np.array([[2.0, -1.0], [-0.3, 3.0]]), [[1.0, 0.0], [0.0, 1.0]]
    law = hb.mechanics.Directed(hb.Cubic(k3=0.0, k1=0.7))
    rest = [hb.Element([1.0, 1.0], hb.Cubic(0.2))]
    load = hb.Load(cosine={1: [0.5, 0.2]})
    one = hb.System(UNIT, 0.1 * UNIT, [[2.0, -1.0], [-1.0, 3.0]], [*hb.mechanics.VectorElement(W, law), *rest], load)
    two = hb.System(UNIT, 0.1 * UNIT, K, rest, load)
    first, second = (hb.HarmonicBalance(model, 5) for model in (one, two))
    X = solve(second, np.zeros(11), {"Omega": 1.3}).X
    Y = solve(first, np.zeros(33), {"Omega": 1.3}).X
    np.testing.assert_allclose(Y[22:], X, rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        np.sort_complex(first.multipliers(Y, Omega=1.3)), np.sort_complex(second.multipliers(X, Omega=1.3)), atol=1e-8
    )


def test_derivatives_and_headers():
    law = hb.mechanics.RadialClearance(2.0, 0.2, 0.3)
    problem, h = hb.HarmonicBalance(coupled(law), 3), 1e-7
    X = np.random.default_rng(2).standard_normal(14)
    found = problem.linearise(X, "Omega", Omega=0.8)
    difference = [problem.residual(X + e, Omega=0.8) - problem.residual(X - e, Omega=0.8) for e in h * np.eye(14)]
    np.testing.assert_allclose(found.dR_dX, np.transpose(difference) / (2 * h), rtol=0, atol=1e-6)
    elements = from_plain(json.loads(json.dumps(to_plain(coupled(law).elements))), {"Element": hb.Element})
    assert vector_groups([element.law for element in elements])[0][1] == law


def test_machine_file(tmp_path):
    mmwrite(tmp_path / "unit.mtx", UNIT)
    (tmp_path / "rotor.toml").write_text("""
        [matrices]
        M = "unit.mtx"
        K = "unit.mtx"
        names = ["x", "y"]
        [[element]]
        name = "seal"
        direction = [{ x = 1.0 }, { y = 1.0 }]
        law = "radial clearance"
        k = 4.0
        clearance = 1.0
        friction = 0.1
        [[load]]
        cosine = { 1 = { x = 1.0 } }
        """)
    system = read_structure(tmp_path / "rotor.toml")
    assert system.elements[1].law.law == hb.mechanics.RadialClearance(4.0, 1.0, 0.1)
    assert system.elements[1].name == "seal 2"


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: hb.Element([1.0, 0.0], hb.mechanics.RadialClearance(1.0, 0.1)), "use VectorElement"),
        (lambda: hb.mechanics.VectorElement([[1.0, 0.0]], hb.mechanics.RadialClearance(1.0, 0.1)), "needs 2 rows"),
        (lambda: hb.mechanics.VectorElement(UNIT, hb.Cubic(1.0)), "must be a VectorLaw"),
        (
            lambda: hb.System(
                UNIT, UNIT, UNIT, [hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(1.0, 0.1))[0]]
            ),
            "follow",
        ),
        (lambda: hb.mechanics.Directed(hb.mechanics.Jenkins(1.0, 0.1)), "acts where it measures"),
        (lambda: hb.mechanics.Polynomial([[1, 2]], [[1.0]]), "shape"),
    ],
)
def test_refusals(make, match):
    with pytest.raises((ValueError, TypeError), match=match):
        make()


class Wrong(hb.mechanics.VectorLaw):
    size = 2

    def __init__(self, factor, shape=2):
        self.factor, self.shape = factor, shape

    def force(self, d, v, tau):
        kd = self.factor * np.repeat(np.eye(2)[:, :, None], d.shape[1], axis=2)
        return d[: self.shape], kd, 0 * kd


@pytest.mark.parametrize(("law", "match"), [(Wrong(2.0), r"dp/dd\[0, 0\] = 2"), (Wrong(1.0, 1), "of shapes")])
def test_wrong_laws(law, match):
    with pytest.raises(ValueError, match=match):
        hb.HarmonicBalance(coupled(law), 3)


def rubbing_rotor() -> hb.System:
    """Return a rotor with a static load and a destabilising cross-coupling, which rubs in a seal with friction."""
    seal = hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(10.0, 0.68, friction=0.144), name="seal")
    load = hb.Load([0.0, -0.288], cosine={1: [0.184, 0.0]}, sine={1: [0.0, 0.184]})
    return hb.System(np.eye(2), 0.0336 * np.eye(2), [[1.0, 0.0168], [-0.0168, 0.814]], seal, load)


def forces_of_a_rub(rows, samples=None):
    """Return force harmonics (2, 13) and their derivatives (26, 26) at coefficients of the displacements (2, 13)."""
    problem = hb.HarmonicBalance(rubbing_rotor(), 6, samples=samples)
    R, J = np.zeros(26), np.zeros((26, 26))
    (law,) = problem.compiled({}).python_forces
    law.add_to(rows, 0.5, R, J, np.zeros(26))
    return R.reshape(2, 13), J


def basis(theta):
    angles = np.multiply.outer(np.arange(1, 7), theta)
    return np.concatenate([np.ones((1, len(theta))), np.stack([np.cos(angles), np.sin(angles)], 1).reshape(12, -1)])


def test_forces_of_a_rub_are_integrated_between_the_crossings_of_the_clearance():
    rows = 0.02 * np.random.default_rng(5).normal(size=(2, 13))
    rows[0, 1], rows[1, 2] = 0.72, 0.66  # an ellipse that leaves the clearance twice
    law, x, w = rubbing_rotor().elements[0].law.law, *np.polynomial.legendre.leggauss(60)

    def distance(theta):
        return float(np.hypot(*(rows @ basis(np.array([theta]))))[0] - law.clearance)

    grid = np.linspace(0, 2 * np.pi, 400)
    signs = np.sign([distance(theta) for theta in grid])
    roots = [scipy.optimize.brentq(distance, *grid[i : i + 2], xtol=1e-14) for i in np.flatnonzero(np.diff(signs))]
    assert len(roots) >= 2
    expected = np.zeros((2, 13))
    for a, b in itertools.pairwise([*roots, roots[0] + 2 * np.pi]):
        theta = a + 0.5 * (b - a) * (1 + x)
        d = rows @ basis(theta)
        p = law.force(d, np.zeros_like(d), theta)[0] * w * 0.5 * (b - a) / np.pi
        expected += p @ (basis(theta) * np.array([0.5, *np.ones(12)])[:, None]).T
    found, J = forces_of_a_rub(rows)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    change = 1e-6 * np.random.default_rng(6).normal(size=(2, 13))
    difference = (forces_of_a_rub(rows + change)[0] - forces_of_a_rub(rows - change)[0]) / 2
    np.testing.assert_allclose(difference.ravel(), J @ change.ravel(), atol=1e-13)


@pytest.mark.parametrize("depth", [1e-3, 1e-5, 1e-7])
def test_a_contact_between_two_samples_has_a_force(depth):
    """The mean normal force of a parabola of height h and curvature a is k h (2 / 3) (2 sqrt(2 h / a)) / (2 pi)."""
    rows = np.zeros((2, 13))
    rows[0, :2] = 0.18 + depth, 0.5  # largest at theta = 0, between samples after the shift
    shift = 0.5 * 2 * np.pi / 128
    rows[0, 1:3] = 0.5 * np.array([np.cos(shift), np.sin(shift)])
    k, a = 10.0, 0.5
    mean = k * depth * 2 / 3 * 2 * np.sqrt(2 * depth / a) / (2 * np.pi)
    assert forces_of_a_rub(rows, samples=128)[0][0, 0] == pytest.approx(mean, rel=3 * depth + 1e-6)


@pytest.mark.slow
def test_a_rub_is_followed_through_its_first_contact():
    """The curve with 128 samples ended where a sample entered the contact; with 2048 its fold was at .50025225."""
    few, many = (
        hb.trace(hb.HarmonicBalance(rubbing_rotor(), 16, samples=N), "Omega", (0.49, 0.51), cover=False, accuracy=None)
        for N in (128, 8192)
    )
    assert few.status is many.status is hb.Status.LEFT_SPAN and [p.kind for p in few.special] == ["GR", "LP"]
    np.testing.assert_allclose(*([p.parameters["Omega"] for p in c.special] for c in (few, many)), rtol=1e-10)


@pytest.mark.slow
def test_neimark_sacker_points_of_circular_whirl_in_two_parameters():
    """In the rotating frame disturbances have constant coefficients: a root of their polynomial is imaginary.

    u'' + (c + 2 i W) u' + (1 - W^2 + i c W) u + k (1 + i mu) ((1 - g / r) u + g / r Re u) = 0
    |1 + k (1 - g / r)(1 + i mu) - W^2 + i c W| r = e W^2
    """
    k, gap, c, e, J = 2.0, 0.3, 0.1, 0.2, np.array([[0.0, -1.0], [1.0, 0.0]])

    @hb.mechanics.model
    def rubbing(friction: float = 0.1) -> hb.System:
        seal = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(k, gap, friction))
        unbalance = hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2)
        return hb.System(np.eye(2), c * np.eye(2), np.eye(2), list(seal), unbalance)

    curve = hb.trace(hb.HarmonicBalance(rubbing(), 1), "Omega", (1.8, 1.6), accuracy=None)
    whirl = hb.follow(curve, "NS1", "friction", (0.0925, 0.105), accuracy=None)
    assert whirl.status is hb.Status.REACHED_END and len(whirl) > 20
    for i in range(len(whirl)):
        mu, W, r = whirl.values[i], whirl.tracked["Omega"][i], np.hypot(*whirl.X[i][1:3])
        force = 1 + k * (1 - gap / r) * (1 + 1j * mu) - W**2 + 1j * c * W
        assert abs(force) * r == pytest.approx(e * W**2, rel=1e-9)
        stiffness = (1 - W**2) * np.eye(2) + c * W * J
        stiffness += k * np.array([[1.0, -mu], [mu, 1.0]]) @ np.diag([1.0, 1 - gap / r])
        rates = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -c * np.eye(2) - 2 * W * J]]))
        assert abs(rates.real.max()) < 1e-10
        assert abs(rates[rates.real.argmax()].imag) > 0.1


def test_polynomial_in_toml(tmp_path):
    text = """
[matrices]
M = [[1.0, 0.0], [0.0, 1.0]]
C = [[0.1, 0.0], [0.0, 0.1]]
K = [[2.0, -1.0], [-1.0, 3.0]]

[[element]]
name = "coupling"
direction = [[1.0, 0.0], [0.0, 1.0]]
law = "polynomial"
exponents = [[1, 2], [2, 1]]
coefficients = [[1.0, 0], [0, 1.0]]

[[load]]
cosine = { 1 = [0.5, 0.2] }
"""
    (tmp_path / "thin.toml").write_text(text)
    law = hb.mechanics.Polynomial([[1, 2], [2, 1]], [[1.0, 0.0], [0.0, 1.0]])
    X = np.linspace(0.1, 0.9, 14)
    found, expected = (
        hb.HarmonicBalance(model, 3).evaluate(X, Omega=0.8)[0]
        for model in (read_structure(tmp_path / "thin.toml"), coupled(law, name="coupling"))
    )
    np.testing.assert_array_equal(found, expected)
    (tmp_path / "thin.toml").write_text(text.replace("[1, 2]", "[1.5, 2]"))
    with pytest.raises(ValueError, match=r"line 11.*exponents"):
        read_structure(tmp_path / "thin.toml")


@pytest.mark.slow
def test_a_torus_is_offered_for_a_rub():
    seal = hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(4.0, 1.0, 0.1))
    loads = hb.Load([0.0, -0.3], cosine={1: [0.3, 0.0]}, sine={1: [0.0, 0.3]}, power=2)
    rubbing = hb.System(UNIT, 0.1 * UNIT, UNIT, [*seal], loads)
    curve = hb.trace(hb.HarmonicBalance(rubbing, 5), "Omega", (1.067, 1.08), accuracy=None)
    assert leaving_lines(curve) == [
        "stability also ends at NS1, where quasi-periodic motions leave: hbgear torus FILE LABEL"
    ]


@pytest.mark.slow
def test_no_torus_is_offered_for_several_elements_on_one_displacement():
    C, K = [[0.015, -0.013], [-0.013, 0.013]], [[1.0453, -0.0453], [-0.0453, 0.0453]]
    laws = [([1.0, 0.0], 0.5), ([1.0, 0.0], 0.5), ([1.0, -1.0], 0.0042)]
    springs = [hb.Element(w, hb.Cubic(k3)) for w, k3 in laws]
    masses = hb.System(np.diag([1.0, 0.05]), C, K, springs, hb.Load(cosine={1: [0.13, 0.0]}))
    curve = hb.trace(hb.HarmonicBalance(masses, 5), "Omega", (1.0, 1.15), accuracy=None)
    assert leaving_lines(curve) == ["stability also ends at NS1, where quasi-periodic motions leave"]
    with pytest.raises(ValueError, match="tori need elements with independent displacements"):
        hb.analysis.torus(curve, "NS1")


@pytest.mark.parametrize(
    ("law", "largest"),
    [
        (hb.mechanics.RadialClearance(k=1.0, clearance=1.0, friction=1e-3), 1.0 + 0.3 / 1e-3),
        (hb.mechanics.Polynomial([[1, 0], [0, 1]], [[0.0, 0.01], [-0.01, 0.0]]), 0.3 / 0.01),
    ],
    ids=("rub", "cross coupling"),
)
def test_friction_bounds_a_whirl_without_damping(law, largest):
    """Friction k mu (r - c) balances the load; the machine without gaps and friction has its resonance at infinity."""
    load = hb.Load(cosine={1: [0.3, 0.0]}, sine={1: [0.0, 0.3]})
    system = hb.System(UNIT, 0.0 * UNIT, UNIT, [*hb.mechanics.VectorElement(UNIT, law)], load)
    curve = hb.trace(hb.HarmonicBalance(system, 1), "Omega", (2.0, 0.8), stability=False, special=False)
    assert curve.status.complete and not curve.asymptotes and not curve.others
    assert curve.amplitude("rms").max() == pytest.approx(largest / np.sqrt(2), rel=1e-3)


@pytest.mark.slow
def test_a_curve_through_the_first_rub_of_an_isotropic_rotor():
    """All phases of the circular whirl touch at once, and the equations change in many directions: the curve ended."""
    k, F, c = 4.0, 0.2, 0.1
    rub = hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(k, 1.0))
    load = hb.Load(cosine={1: [F, 0.0]}, sine={1: [0.0, F]}, power=2)
    curve = hb.trace(
        hb.HarmonicBalance(hb.System(np.eye(2), c * np.eye(2), np.eye(2), list(rub), load), 7), "Omega", (0.5, 2.5)
    )
    assert curve.status.complete and not curve.warnings
    r, W = np.hypot(*curve.X.reshape(len(curve), 2, 15)[:, 0, 1:3].T), curve.values
    Z = 1 - W**2 + 1j * c * W
    np.testing.assert_allclose(np.abs(Z * r + k * np.maximum(r - 1, 0)), F * W**2, rtol=1e-9)
    folds = [point.parameters["Omega"] for point in curve.special if point.kind == "LP"]
    assert len(folds) == 2 and r.max() > 1.5


def exponents_of_whirl(r, Omega, zeta, stiffness):
    """Exponents of disturbances of circular whirl in the rotating frame, clearance 1; stiffness k (1 + i mu)."""
    s = stiffness if r > 1 else 0.0
    a = 1 - Omega**2 + 2j * zeta * Omega + s * (1 - 1 / r)
    K = np.array([[a.real + np.real(s) / r, -a.imag], [a.imag + np.imag(s) / r, a.real]])
    C = 2 * np.array([[zeta, -Omega], [Omega, zeta]])
    return np.linalg.eigvals(np.block([[np.zeros((2, 2)), UNIT], [-K, -C]]))


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_stability_of_an_isotropic_rotor_is_lost_at_its_first_rub(mu):
    """The multipliers jump where all phases touch at once: a warning stated a change without a special point.

    With mu = 0.3 branch points were found between points that differ by rounding, and took minutes.
    """
    k, zeta, e = 10.0, 0.05, 0.2
    seal = hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(k, 1.0, mu))
    load = hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2)
    balance = hb.HarmonicBalance(hb.System(UNIT, 2 * zeta * UNIT, UNIT, [*seal], load), 5)
    curve = hb.trace(balance, "Omega", (0.5, 1.6), cover=False, accuracy=None)
    assert curve.status.complete and not curve.warnings
    assert [p.kind for p in curve.special] == {0.1: ["GR"], 0.3: ["GR", "LP", "GR", "LP"]}[mu]
    first = curve["GR1"].parameters["Omega"]
    assert e * first**2 == pytest.approx(abs(1 - first**2 + 2j * zeta * first), rel=1e-12)
    special = {p.index for p in curve.special}
    for i in set(range(0, len(curve), 5)) - special:
        r, Omega = np.hypot(*curve.X[i].reshape(2, 11)[0, 1:3]), curve.values[i]
        growth = exponents_of_whirl(r, Omega, zeta, k * (1 + 1j * mu)).real.max()
        assert np.abs(curve.multipliers[i]).max() == pytest.approx(np.exp(2 * np.pi * growth / Omega), rel=1e-5)
        assert curve.stability[i] == ("stable" if growth < 0 else "unstable")
    # a contact that begins at one phase explains nothing
    touching = replace(curve["GR1"], at_all_phases=False)
    contradicting = replace(curve, special=(touching, *curve.special[1:]))
    assert any("without a special point" in line for line in contradicting.warnings)
