"""Receptances of the linear structure at the elements, against dense solves of the whole structure."""

import dataclasses

import numpy as np
import pytest
from machines import cantilever
from scipy import sparse
from scipy.linalg import block_diag

from hbgear import Backlash, Cubic, Duffing, Element, HarmonicBalance, Load, System, Unilateral, trace, validate
from hbgear.gears import DoubleHelicalPair, GearRotorBearing
from hbgear.harmonic.structure import linear_structure
from hbgear.harmonic.structure.linear_structure import LinearStructure, UnbalancedLoadError
from hbgear.harmonic.structure.receptance import Receptance
from hbgear.mechanics import Jenkins, Parallel, Series, model, reduce
from hbgear.mechanics.series.fourier import to_real

H = 4


def structure(rng, n=6, m=2, sparse_matrices=False, **load):
    """Return a random structure with unsymmetric stiffness, non-proportional damping and m elements."""
    A, B, C = rng.standard_normal((3, n, n)) / 3
    M, K, C = np.eye(n) + A @ A.T, np.eye(n) + B @ B.T + 0.1 * A, 0.1 * (np.eye(n) + C)
    form = sparse.csr_array if sparse_matrices else np.asarray
    elements = [
        Element(rng.standard_normal(n), Backlash(1.0, 2.0), Series(0.1, (0.2,), (0.3, 0.4)), damping=0.1 * (j + 1))
        for j in range(m)
    ]
    load = Load(rng.standard_normal(n), {1: rng.standard_normal(n)}, {2: rng.standard_normal(n)}, **load)
    return System(form(M), form(C), form(K), elements, load)


def by_hand(system, Omega, nu):
    """Return Z_k (H+1, m, m) and g_k (H+1, m) of Z d + g + f = 0 from dense solves without reference springs."""
    W, c = system.W, np.diag([e.damping for e in system.elements])
    dense = [A.toarray() if sparse.issparse(A) else A for A in (system.M, system.C, system.K)]
    M, C, K = dense
    (load,) = system.load
    Z, g = [], []
    for k in range(H + 1):
        w, order = k * Omega / nu, k // nu if k % nu == 0 else None
        F = Omega**load.power * load.complex(system.n).get(order, np.zeros(system.n, dtype=complex))
        e = np.zeros(len(system.elements), dtype=complex)
        for j, element in enumerate(system.elements):
            s = element.displacement
            pairs = {0: s.mean, 1: s.cosine[0] - 1j * s.sine[0], 2: -1j * s.sine[1]}
            e[j] = pairs.get(order, 0.0)
        # D q = F - W (f + i w c d), W^T q = d + e
        D = K + 1j * w * C - w**2 * M
        G = W.T @ np.linalg.solve(D, W)
        Z.append(np.linalg.inv(G) + 1j * w * c)
        g.append(np.linalg.solve(G, e - W.T @ np.linalg.solve(D, F)))
    return np.array(Z), np.array(g)


@pytest.mark.parametrize("nu", [1, 2])
@pytest.mark.parametrize("power", [0, 2])
@pytest.mark.parametrize("sparse_matrices", [False, True])
def test_against_dense_solves(rng, nu, power, sparse_matrices):
    system = structure(rng, sparse_matrices=sparse_matrices, power=power)
    part = Receptance(LinearStructure(system), system, H, nu).at(0.7)
    Z, g = by_hand(system, 0.7, nu)
    np.testing.assert_allclose(part.Z, Z, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(part.g, g, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("power", [0, 2])
def test_dependent_directions_against_dense_solves(rng, power):
    """Five elements on three coordinates: the displacements of q = D^-1 (F - W f) solve the constrained balance."""
    system, Omega, nu = structure(rng, n=3, m=5, power=power), 0.7, 2
    s = LinearStructure(system)
    part = Receptance(s, system, H, nu).at(Omega)
    (load,), c = system.load, np.array([e.damping for e in system.elements])
    D0 = system.K + (system.W * s.kr) @ system.W.T
    for k in range(H + 1):
        w, order = k * Omega / nu, k // nu if k % nu == 0 else None
        F = Omega**load.power * load.complex(system.n).get(order, np.zeros(3, dtype=complex))
        f = rng.standard_normal(5) + 1j * rng.standard_normal(5)  # beyond the reference springs and dampers
        D = D0 + 1j * w * (system.C + (system.W * c) @ system.W.T) - w**2 * system.M
        d_plus_e = system.W.T @ np.linalg.solve(D, F - system.W @ f)
        e = np.array(
            [
                {0: x.mean, 1: x.cosine[0] - 1j * x.sine[0], 2: -1j * x.sine[1]}.get(order, 0.0)
                for x in (element.displacement for element in system.elements)
            ]
        )
        d = d_plus_e - e
        law_forces = f + s.kr * d_plus_e + 1j * w * c * e
        residual = s.force_sums @ (part.Z[k] @ d + part.g[k] + law_forces) + s.compatibility @ d_plus_e
        np.testing.assert_allclose(residual, 0.0, atol=1e-11)


def test_constrained_balance_of_kernels(rng):
    """Sums of forces and conditions of compatibility, and their derivatives, are those of the structure."""
    compiled = HarmonicBalance(structure(rng, n=3, m=5), H).compiled({})
    s, X, identity = compiled.structure, rng.standard_normal(5 * (2 * H + 1)), np.eye(2 * H + 1)
    S, T = np.kron(s.force_sums, identity), np.kron(s.compatibility, identity)
    R, J, dR, size = compiled.linearise(X, 0.7)
    apart, J_apart, dR_apart, _ = compiled._balance(X, 0.7, compiled.linear(0.7))
    np.testing.assert_allclose(R, S @ apart + T @ (X + to_real(compiled.receptance.e.T).ravel()), atol=1e-13 * size)
    np.testing.assert_allclose(J, S @ J_apart + T, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(dR, S @ dR_apart, rtol=1e-13, atol=1e-13)


def test_elements_on_one_displacement_are_one_law():
    """A stop and a cubic spring on the same displacement, as two elements and as one: the compiled loop traces both."""
    M, C, K, stop, cubic = np.eye(2), 0.05 * np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], Unilateral(1.0, 0.3), Cubic(0.5)
    load = Load(cosine={1: [0.2, 0.0]})
    one, two = (
        trace(HarmonicBalance(System(M, C, K, elements, load), 9), "Omega", (0.8, 1.5))
        for elements in ([Element([1, 0], Parallel((stop, cubic)))], [Element([1, 0], stop), Element([-1, 0], cubic)])
    )
    assert two.problem.compiled_continuation("Omega", {}) is not None and {"LP", "GR"} <= {p.kind for p in one.special}
    points = [[(p.label, p.parameters["Omega"]) for p in curve.special] for curve in (one, two)]
    assert [label for label, _ in points[0]] == [label for label, _ in points[1]]
    for (_, a), (_, b) in zip(*points, strict=True):
        assert a == pytest.approx(b, abs=1e-10)


@pytest.mark.parametrize(("n", "m"), [(6, 2), (3, 5)])
@pytest.mark.parametrize("power", [0, 1, 2])
def test_derivative_in_frequency(rng, slope, power, n, m):
    system = structure(rng, n, m, power=power)
    receptance = Receptance(LinearStructure(system), system, H, 2)
    here = receptance.at(0.7)
    np.testing.assert_allclose(
        here.matrices[1], slope(lambda Omega: receptance.at(Omega).Z, 0.7, 1e-4), rtol=1e-7, atol=1e-9
    )
    np.testing.assert_allclose(
        here.constants[1], slope(lambda Omega: receptance.at(Omega).g, 0.7, 1e-4), rtol=1e-7, atol=1e-9
    )


@pytest.mark.parametrize("sparse_matrices", [False, True])
def test_solutions_at_many_frequencies_are_those_of_the_whole_matrices(rng, sparse_matrices):
    """solve_all: the dynamic stiffness with reference springs times the displacements is the force, also at w = 0."""
    system = structure(rng, sparse_matrices=sparse_matrices)
    some, w = LinearStructure(system), np.array([0.0, 0.7, 1.9])
    F = rng.standard_normal((3, system.n, 2)) + 1j * rng.standard_normal((3, system.n, 2))
    M, C, K = (A.toarray() if sparse.issparse(A) else A for A in (system.M, system.C, system.K))
    C, K = (A + system.W @ np.diag(k) @ system.W.T for A, k in ((C, some.c), (K, some.kr)))
    for wk, x, f in zip(w, some.solve_all(w, F), F, strict=True):
        assert np.abs((K + 1j * wk * C - wk**2 * M) @ x - f).max() < 1e-11


def test_large_sparse_structure_is_solved_directly(slope):
    """A chain of 2000 masses: Z and g agree with sparse solves, and a start point satisfies the equations."""
    n = 2000
    K = sparse.diags_array([np.full(n - 1, -1.0), np.full(n, 2.1), np.full(n - 1, -1.0)], offsets=[-1, 0, 1])
    direction = np.zeros(n)
    direction[[700, 900]] = 1.0, -1.0
    load = Load(None, {1: np.ones(n)})
    system = System(sparse.eye_array(n), 0.05 * sparse.eye_array(n), K, [Element(direction, Cubic(0.3, 0.5))], load)
    receptance = Receptance(LinearStructure(system), system, 2, 1)
    part = receptance.at(0.8)
    D = (K + 0.8j * system.C - 0.64 * system.M).tocsc()
    G = direction @ sparse.linalg.spsolve(D, direction)
    y = direction @ sparse.linalg.spsolve(D, np.ones(n))
    np.testing.assert_allclose(part.Z[1, 0, 0], 1 / G, rtol=1e-10)
    np.testing.assert_allclose(part.g[1, 0], -y / G, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        part.matrices[1], slope(lambda Omega: receptance.at(Omega).Z, 0.8, 1e-4), rtol=1e-6, atol=1e-8
    )
    problem = HarmonicBalance(system, 3)
    X = problem.start(0.8)
    assert np.linalg.norm(problem.residual(X, Omega=0.8)) < 1e-9


def two_masses(load=None, C=None, damping=0.1):
    """Return two free masses connected by an element with backlash only."""
    gap = Element([1.0, -2.0], Backlash(1.0), damping=damping)
    return System(np.diag([1.0, 3.0]), C, np.zeros((2, 2)), [gap], load or (), dof_names=["gear", "wheel"])


def test_free_motion_is_removed():
    """The motion q1 = 2, q2 = 1 is free; a load without work on it leaves d'' / (1/m1 + 4/m2) + p = load share."""
    system = two_masses(Load([0.5, -1.0], {1: [0.2, 0.0]}))
    part = Receptance(LinearStructure(system), system, H, 1).at(0.9)
    w, mass = 0.9 * np.arange(H + 1), 1 / (1 + 4 / 3)
    np.testing.assert_allclose(part.Z[:, 0, 0], -(w**2) * mass + 0.1j * w, atol=1e-12)
    np.testing.assert_allclose(part.g[:2, 0], [-0.5, -0.2 * mass], atol=1e-12)


def test_unbalanced_load_names_the_motion():
    with pytest.raises(UnbalancedLoadError, match=r"work .* on a motion that nothing holds \(gear = 1, wheel = 0.5\)"):
        HarmonicBalance(two_masses(Load([0.5, 0.0])), 3)


def test_a_damped_drift_cannot_carry_a_constant_load():
    """A constant load drives a damped free motion at constant speed, so no periodic motion exists."""
    with pytest.raises(UnbalancedLoadError, match="gear"):
        HarmonicBalance(two_masses(Load([0.5, 0.0]), C=np.diag([0.1, 0.1])), 3)


def test_a_free_motion_with_an_unloaded_coordinate():
    """A coordinate without elements and springs does not change Z and g."""
    base = two_masses(Load([0.5, -1.0], {1: [0.2, 0.0]}))
    gap = Element([1.0, -2.0, 0.0], Backlash(1.0), damping=0.1)
    wider = System(block_diag(base.M, 2.0), None, np.zeros((3, 3)), [gap], Load([0.5, -1, 0], {1: [0.2, 0, 0]}))
    parts = [Receptance(LinearStructure(s), s, H, 1).at(0.9) for s in (base, wider)]
    np.testing.assert_allclose(parts[1].Z, parts[0].Z, atol=1e-12)
    np.testing.assert_allclose(parts[1].g, parts[0].g, atol=1e-12)


def test_units_do_not_matter():
    """The same structure with coordinates in other units (1e-6 and 1e4) and another unit of time."""
    system = two_masses(Load([0.5, -1.0], {1: [0.2, 0.0]}))
    S, clock = np.diag([1e-6, 1e4]), 1e3
    scaled = System(
        S @ system.M @ S / clock**2,
        None,
        system.K,
        [Element(S @ [1.0, -2.0], Backlash(1.0), damping=0.1 / clock)],
        Load(S @ [0.5, -1.0], {1: S @ [0.2, 0.0]}),
    )
    a = Receptance(LinearStructure(system), system, H, 1).at(0.9)
    b = Receptance(LinearStructure(scaled), scaled, H, 1).at(0.9 * clock)
    np.testing.assert_allclose(b.Z, a.Z, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(b.g, a.g, rtol=1e-9, atol=1e-10)


def test_singular_mass():
    system = System(np.diag([1.0, 0.0]), None, np.eye(2), [Element([1.0, 1.0], Cubic(1.0))], dof_names=["a", "b"])
    with pytest.raises(ValueError, match=r"'element 1' acts on coordinate 'b' without mass and damping"):
        HarmonicBalance(system, 3)


TWO = (np.eye(2), [[0.1, -0.05], [-0.05, 0.1]], [[2.0, -1.0], [-1.0, 2.0]])
DRIVEN = Load(constant=[0.1, 0.05], cosine={1: [0.0, 0.3]})


def test_two_elements_along_one_direction_are_one_of_both_laws():
    """2 p(2 q - e) of stiffness k and gap b is a spring of stiffness 4 k and gap (b + e) / 2 along q."""
    both = Parallel((Backlash(b=0.3, k=2.0), Unilateral(k=4.0, gap=0.25)))
    one = System(*TWO, [Element([1, 0], both, damping=0.009)], DRIVEN)
    near, far = Backlash(b=0.3, k=2.0), Unilateral(k=1.0, gap=0.5)
    apart = [Element([1, 0], near, damping=0.005, name="near"), Element([2, 0], far, damping=0.001, name="far")]
    curves = [trace(HarmonicBalance(system, 12), "Omega", (0.6, 1.5)) for system in (one, System(*TWO, apart, DRIVEN))]
    assert len(curves[0]["LP1"].X) * 2 == len(curves[1]["LP1"].X)
    for a, b in zip(*(curve.special for curve in curves), strict=True):
        assert a.label == b.label and a.parameters["Omega"] == pytest.approx(b.parameters["Omega"], abs=1e-9)
        mu = np.sort_complex(a.multipliers)
        np.testing.assert_allclose(np.sort_complex(b.multipliers), mu, rtol=0, atol=1e-6 * np.abs(mu).max())
        np.testing.assert_allclose(b.coefficients(1), 2 * b.coefficients(0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(curves[1]["LP1"].coefficients(0), curves[0]["LP1"].X, rtol=0, atol=1e-8)


def between_three():
    """Return two masses with a stop each and a gap between them: three directions on two coordinates."""
    elements = [
        Element([1, 0], Unilateral(k=2.0, gap=0.6), name="1"),
        Element([0, 1], Backlash(b=0.4, k=1.0), displacement=Series(cosine=[0.03]), damping=0.02, name="2"),
        Element([1, -1], Backlash(b=0.2, k=3.0), displacement=Series(sine=[0.05]), damping=0.03, name="12"),
    ]
    return System(*TWO, elements, DRIVEN)


@pytest.mark.parametrize("sampled", [False, True])
def test_directions_that_depend_on_each_other(sampled):
    problem = HarmonicBalance(between_three(), 10, sampled=sampled)
    X = problem.start(1.1) + 0.01 * np.cos(np.arange(problem.size))
    e = 1e-6
    here = problem.linearise(X, "Omega", Omega=1.1)
    for j in (0, 5, 21, 30, 47, 62):
        step = e * np.eye(problem.size)[j]
        two_sided = (problem.residual(X + step, Omega=1.1) - problem.residual(X - step, Omega=1.1)) / (2 * e)
        np.testing.assert_allclose(here.dR_dX[:, j], two_sided, rtol=0, atol=2e-3 if sampled else 2e-7)
    change = (problem.residual(X, Omega=1.1 + e) - problem.residual(X, Omega=1.1 - e)) / (2 * e)
    np.testing.assert_allclose(here.dR_dp, change, rtol=0, atol=1e-7)
    v = np.sin(np.arange(problem.size))
    ends = [problem.evaluate(X + sign * 1e-7 * v, Omega=1.1)[1] for sign in (1, -1)]
    along, across = problem.curvature(X, v, "Omega", Omega=1.1)
    if not sampled:
        np.testing.assert_allclose(along, (ends[0] - ends[1]) / 2e-7, rtol=0, atol=1e-3 * np.abs(along).max())
    ends = [problem.evaluate(X, Omega=1.1 + sign * e)[1] for sign in (1, -1)]
    np.testing.assert_allclose(across, (ends[0] - ends[1]) / (2 * e), rtol=0, atol=1e-6)


@pytest.mark.slow
def test_dependent_directions_agree_with_integration():
    curve = trace(HarmonicBalance(between_three(), 24), "Omega", (0.9, 1.6))
    assert curve.status.complete and curve.residual.max() < 1e-10
    rows = [curve.layout.rows(curve.X, j) for j in range(3)]
    unit = np.eye(rows[0].shape[1])  # with as many harmonics as the curve needed
    gaps = [rows[0], rows[1] + 0.03 * unit[1], rows[2] + 0.05 * unit[2]]
    np.testing.assert_allclose(gaps[2], gaps[0] - gaps[1], rtol=0, atol=1e-10)
    report = validate(curve, 4, landing="nearest")
    assert all(row.status in ("agrees", "agrees with H = 48") for row in report.rows)  # next to LP1 the error is 1e-4


def test_a_reduced_structure_with_dependent_directions():
    chain, at = 2 * np.eye(12) - np.eye(12, k=1) - np.eye(12, k=-1), np.eye(12)
    stops = [Element(w, Backlash(b=0.3, k=1.0), name=str(i)) for i, w in enumerate((at[3], at[8], at[3] - at[8]))]
    full = System(np.eye(12), 0.02 * np.eye(12), chain, stops, Load(cosine={1: 0.1 * at[3]}))
    reduced = reduce(full, modes=9)
    X = [HarmonicBalance(system, 5).start(0.15) for system in (full, reduced.system)]
    np.testing.assert_allclose(X[1], X[0], rtol=0, atol=1e-3 * np.abs(X[0]).max())
    assert np.abs(X[0][:11]).max() > 0.3  # one mass touches its stop


@pytest.mark.parametrize("zeta", [np.sqrt(1.1), np.sqrt(1.1) + 1e-9, np.sqrt(1.1) + 1e-5])
def test_critically_damped_structure(zeta):
    """Two poles and their modes coincide: Z is 1 - w^2 + 2 zeta i w to 1e-9, and multipliers have the exact product."""
    problem = HarmonicBalance(Duffing(zeta=zeta), H)
    part = problem.compiled({}).receptance.at(0.8)
    w = 0.8 * np.arange(H + 1)
    np.testing.assert_allclose(part.Z[:, 0, 0], 1 - w**2 + 2j * zeta * w, rtol=1e-9)
    X = problem.start(0.8)
    product = np.prod(problem.multipliers(X, Omega=0.8, max_step=0.1))
    # absolute error from the cancellation of two modes with condition numbers up to 1e8
    assert product == pytest.approx(np.exp(-2 * zeta * 2 * np.pi / 0.8), rel=1e-6, abs=2e-10)


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
def test_numbers_too_far_apart_are_reported():
    """A damper of extreme size: the receptance of an element is zero within rounding and has no inverse."""
    with pytest.raises(ValueError, match="the receptance of the structure is zero or infinite"):
        HarmonicBalance(GearRotorBearing(zeta_2=1e30), 5).start(Omega=0.5)


PERTURBED_NAMES = ("k_gz", "k_pz", "zeta", "m_p", "module", "beta_deg", "torque", "k_mean", "b_c", "e[1]")


def of_balance(problem, name, value, Omega, s):
    """Return Z and g with derivatives in Omega, and receptances at exponents s with derivatives, as two vectors."""
    compiled = problem.compiled({name: value})
    matrices, constants = compiled.receptance.at(Omega)
    G, dG = compiled.structure.transfer(s)
    return [np.concatenate([part.ravel() for part in parts]) for parts in ((matrices, constants), (G, dG))]


@pytest.mark.parametrize("name", PERTURBED_NAMES)
def test_structures_next_to_one_are_exact_in_differences(name):
    """Free rotation, repeated modes: differences of perturbed structures agree with differences of higher order."""
    model = DoubleHelicalPair(zeta=0.05)
    problem, Omega, s = HarmonicBalance(model, 5), 0.83, 0.01 + 1j * np.array([-0.4, 0.3, 1.1])
    perturbed, value = problem.perturbed({}, 4), (model.parameters | model.entries)[name]
    h = 1e-5 * problem.unit_of(name, value)
    one = not value  # one-sided at the end of the range
    near = [of_balance(perturbed, name, value + side * h, Omega, s) for side in ((0, 1, 2) if one else (-1, 1))]
    far = [
        of_balance(problem, name, value + side * 20 * h, Omega, s) for side in ((0, 1, 2, 3) if one else (-2, -1, 1, 2))
    ]
    for i in range(2):
        if one:
            found = (4 * near[1][i] - near[2][i] - 3 * near[0][i]) / (2 * h)
            expected = (-11 * far[0][i] + 18 * far[1][i] - 9 * far[2][i] + 2 * far[3][i]) / (120 * h)
        else:
            found = (near[1][i] - near[0][i]) / (2 * h)
            expected = (8 * (far[2][i] - far[1][i]) - (far[3][i] - far[0][i])) / (240 * h)
        size = np.abs(expected).max()
        assert size > 0 or name in ("torque", "b_c", "e[1]")  # these change no receptance
        rounding = 2e-13 * np.abs(near[0][i]).max() / h
        np.testing.assert_allclose(found, expected, atol=1e-6 * size + rounding, rtol=0)


def test_stability_next_to_a_structure_is_that_of_itself():
    problem = HarmonicBalance(DoubleHelicalPair(zeta=0.05), 5)
    X = problem.start(Omega=1.1)
    here = {"Omega": 1.1, "k_gz": 1.1e8}
    mu = [one.multipliers(X, **here) for one in (problem, problem.perturbed({}, 4))]
    np.testing.assert_allclose(mu[1], mu[0], atol=1e-9)


def test_a_load_with_a_balanced_one_is_refused():
    """Two free masses with balanced loads: changing one of the loads makes them unbalanced."""

    @model()
    def pair(drive: float = 0.3, k: float = 1.0) -> System:
        element = Element([1, -1], Backlash(1.0, k), name="mesh", damping=0.1)
        return System(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), [element], Load([drive, -0.3], {1: [0.1, -0.1]}))

    perturbed = HarmonicBalance(pair(), 3).perturbed({}, 4)
    assert perturbed.compiled({"k": 1.00001}).structure is perturbed.compiled({}).structure  # same matrices
    for problem in (perturbed, HarmonicBalance(pair(), 3)):
        with pytest.raises(UnbalancedLoadError, match="nothing holds"):
            problem.compiled({"drive": 0.300003})


def test_structures_do_not_depend_on_loads():
    problem = HarmonicBalance(DoubleHelicalPair(), 3)
    assert problem.compiled({"torque": 1500.0}).structure is problem.compiled({}).structure
    assert problem.compiled({"zeta": 0.05}).structure is not problem.compiled({}).structure


def test_differences_for_an_oscillating_load_on_a_free_motion():
    """Modes omit the free motion, which an oscillating load excites and a changed mass or damper affects."""

    @model()
    def swung(mass: float = 1.0, damper: float = 0.05) -> System:
        element, C = Element([1, -1], Backlash(1.0), name="mesh", damping=0.1), damper * np.array([[1, -1], [-1, 1]])
        return System(np.diag([mass, 2.0]), C, np.zeros((2, 2)), [element], Load([0.3, -0.3], {1: [0.1, 0]}))

    problem = HarmonicBalance(swung(), 3)
    for name, value in (("mass", 1.0), ("damper", 0.05)):
        near, far = (
            [
                np.concatenate([part.ravel() for part in one.compiled({name: value + h}).receptance.at(0.8)])
                for h in steps
            ]
            for one, steps in ((problem.perturbed({}, 2), (1e-5, -1e-5)), (problem, (1e-4, -1e-4)))
        )
        np.testing.assert_allclose((near[0] - near[1]) / 2e-5, (far[0] - far[1]) / 2e-4, atol=1e-6)


def test_far_poles_are_the_same_as_a_series():
    """A chain of 60 masses: the power series of far poles agrees with the sum over all poles to 1e-9."""
    n = 60
    K = 1e4 * (np.diag(np.full(n, 2.0)) - np.eye(n, k=1) - np.eye(n, k=-1)) + 0.1 * np.eye(n)
    elements = [Element(row, Backlash()) for row in np.eye(n)[[0, 30]]]
    system = System(np.eye(n), 1e-4 * K + 0.01 * np.eye(n), K, elements, Load(cosine={1: np.eye(n)[3]}))
    whole = HarmonicBalance(system, 5).compiled({}).receptance
    assert len(whole.packed.near_count) > 1
    for Omega in (0.1, 1.0, 8.0, 40.0):
        found = whole.at(Omega)
        whole.packed, packed = whole.packed._replace(radius=whole.packed.radius[:0]), whole.packed
        expected = whole.at(Omega)
        whole.packed = packed
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(other).max())


def test_stacked_direct_solutions_are_those_of_one_harmonic_at_a_time(rng, monkeypatch):
    """More elements than coordinates, one free motion: all harmonics in one call agree with separate calls to 1e-13."""
    K = np.array([[1.0, -1.0], [-1.0, 1.0]])
    elements = [Element(row, Backlash()) for row in ([1.0, 0.0], [0.0, 1.0], [1.0, -1.0])]
    system = System(np.eye(2), 0.1 * K, K, elements, Load(cosine={1: [0.2, 0.1]}))
    linear = HarmonicBalance(system, 5).compiled({}).receptance.structure
    w, F = np.arange(6) * 0.7, rng.standard_normal((6, 2, 3)) + 0j
    stacked = linear._direct(w, F)
    monkeypatch.setattr(linear_structure, "_MAX_STACKED_COORDINATES", 0)
    for one, other in zip(stacked, linear._direct(w, F), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("damper", [0.0, 0.3])
def test_modes_of_a_fine_mesh_give_its_direct_receptance(damper):
    """Poles of damping in proportion to K reach 1e10 times the lowest one, which was left out as a drift."""
    n = 200
    (M, K), tip = cantilever(n), np.eye(1, 2 * n, 2 * n - 2)[0]
    C = 1e-3 * K + damper * np.outer(tip, tip)
    stop = Element(tip, Unilateral(k=1.0, gap=0.1))
    structure = LinearStructure(System(M, C, K, [stop], Load(cosine={1: tip})))
    modes, w = structure.modes, 3.0
    assert modes is not None and structure.accurate_modes
    direct = tip @ np.linalg.solve(structure.K + 1j * w * structure.C - w**2 * structure.M, tip)
    by_modes = (modes.output / (1j * w - modes.poles)) @ modes.input
    assert by_modes[0, 0] == pytest.approx(direct, rel=1e-5)


def bordered(structure, Omega, F):
    """Return forces Z - kr at fixed independent elements for unit displacements, and -u for a load F, from one solve.

    D q + W u = F and W^T q = t, with the reference springs and dampers in D.
    """
    W = structure.W[:, structure.independent]
    n, a = W.shape
    D = structure.K + 1j * Omega * structure.C - Omega**2 * structure.M
    right = np.zeros((n + a, a + 1), dtype=complex)
    right[n:, :a], right[:n, a] = np.eye(a), F
    u = np.linalg.solve(np.block([[D, W], [W.T, np.zeros((a, a))]]), right)[n:]
    return -u[:, :a], -u[:, a]


@pytest.mark.parametrize("step", [1, 4, 20])
@pytest.mark.parametrize("Omega", [0.1, 3.5, 40.0])
def test_elements_next_to_each_other_against_the_schur_complement(step, Omega):
    """The inverse of the receptance has errors of 1e-10 (5 elements) to 3e-7 (90 elements)."""
    nodes = np.arange(8, 98, step)
    system = beam_with(nodes, Unilateral(k=1.0, gap=0.1))
    D, inner = system.K + 1j * Omega * system.C - Omega**2 * system.M, 2 * nodes
    outer = np.setdiff1d(np.arange(200), inner)
    tip = system.load[0].complex(200)[1]
    solved = np.linalg.solve(D[np.ix_(outer, outer)], np.column_stack([D[np.ix_(outer, inner)], tip[outer]]))
    exact = np.column_stack([D[np.ix_(inner, inner)], tip[inner]]) - D[np.ix_(inner, outer)] @ solved
    part = Receptance(LinearStructure(system), system, 1, 1).at(Omega)
    for found, expected in ((part.Z[1], exact[:, :-1]), (part.g[1], -exact[:, -1])):
        np.testing.assert_allclose(
            found, expected, rtol=0, atol=(1e-9 if step == 20 else 1e-12) * np.abs(expected).max()
        )


def test_close_elements_of_a_large_structure(monkeypatch):
    """The inverse of the receptance has an error of 1e-7 there; derivatives are differences."""
    system = beam_with(np.arange(8, 98), Unilateral(k=1.0, gap=0.1))
    expected = Receptance(LinearStructure(system), system, 2, 1)
    monkeypatch.setattr("hbgear.harmonic.structure.linear_structure.MODAL_LIMIT", 100)
    structure = LinearStructure(system)
    direct = Receptance(structure, system, 2, 1)
    assert structure.large and not structure.accurate_modes
    for Omega in (0.5, 3.4):
        for found, exact in zip(direct.at(Omega), expected.at(Omega), strict=True):
            np.testing.assert_allclose(found[0], exact[0], rtol=0, atol=1e-11 * np.abs(exact[0]).max())
            np.testing.assert_allclose(found[1], exact[1], rtol=0, atol=1e-8 * np.abs(exact[1]).max())


def beam_with(nodes, law, force=0.1):
    """Return a clamped beam of 100 elements with a law at each of the nodes and a force at its end."""
    (M, K), at = cantilever(100), np.eye(200)
    laws = [Element(at[2 * i], law) for i in nodes]
    return System(M, 0.05 * M + 1e-3 * K, K, laws, Load(cosine={1: force * at[-2]}))


def of_chain(C, fixed=0.2, mass=1.0, stiffness=lambda K: K):
    """Return a chain of ten masses, some of size ``mass``, with elements between neighbours and at its ends."""
    at, m = np.eye(10), np.where(np.isin(np.arange(10), (1, 3, 6)), mass, 1.0)
    K = np.diag([1.0, *8 * [2.0], 1.0]) - np.eye(10, k=1) - np.eye(10, k=-1)
    directions = (at[0], at[1] - at[2], at[6]) if fixed else (at[0] - at[3], at[5] - at[6], at[9] - at[8])
    elements = [Element(w, Backlash(1.0, 2.0), damping=0.1 * j) for j, w in enumerate(directions)]
    return System(np.diag(m), C(K), stiffness(K + fixed * np.eye(10)), elements)


DAMPERS, GYROSCOPIC = np.diag([0.1, 0.2, 0.1, 0, *6 * [0.1]]), 0.3 * (np.eye(10, k=5) - np.eye(10, k=-5))
STRUCTURES = {
    "undamped": of_chain(lambda K: 0 * K),
    "damping in proportion": of_chain(lambda K: 0.05 * K + 0.02 * np.eye(10)),
    "any damping": of_chain(lambda K: 0.05 * K + DAMPERS),
    "gyroscopic": of_chain(lambda K: 0.05 * K + GYROSCOPIC),
    "unsymmetric": of_chain(lambda K: 0.05 * K, stiffness=lambda K: K + 0.1 * GYROSCOPIC),
    "without mass": of_chain(lambda K: 0.05 * K + DAMPERS, mass=0.0),
    "static": of_chain(lambda K: DAMPERS, mass=0.0),
    "free": of_chain(lambda K: 0.05 * K, fixed=0.0),
    "free with a damper": of_chain(lambda K: 0.05 * K + 0.03 * np.diag(np.eye(10)[2]), fixed=0.0),
    "free with damping of the masses": of_chain(lambda K: 0.05 * K + 0.03 * np.eye(10), fixed=0.0),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_modes_with_fixed_elements_give_the_dynamic_stiffness(rng, name, monkeypatch):
    """Against one solution of the whole equations; derivatives in Omega, and those of the loads, by differences."""
    monkeypatch.setattr("hbgear.harmonic.structure.receptance.MAX_AMPLIFICATION", 0.0)
    F = rng.standard_normal(10)
    system = dataclasses.replace(STRUCTURES[name], load=Load(cosine={1: F}, power=2))
    structure = LinearStructure(system)
    receptance = Receptance(structure, system, 2, 1)
    assert len(receptance.packed.polynomial)
    for Omega in (0.3, 0.9, 3.0):
        part, (Z, g) = receptance.at(Omega), bordered(structure, Omega, Omega**2 * F)
        np.testing.assert_allclose(part.Z[1] + np.diag(structure.kr), Z, rtol=0, atol=1e-12 * np.abs(Z).max())
        np.testing.assert_allclose(part.g[1], g, rtol=0, atol=1e-12 * np.abs(g).max())
        h = 1e-5
        for i in range(2):
            slope = (receptance.at(Omega + h)[i] - receptance.at(Omega - h)[i]) / (2 * h)
            np.testing.assert_allclose(part[i][1], slope[0], rtol=0, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize("elements", [2, 3])
def test_one_mode_or_none_with_fixed_elements(elements):
    """Coupled masses: the modal mass of a single mode is not one, as it is with a diagonal mass matrix."""
    M, K = 4 * np.eye(3) + 1, np.array([[1e4 + 1, -1e4, 0], [-1e4, 1e4 + 2, -2], [0, -2, 3]])
    W = np.array([[1.0, 0, 0], [-1, 1, 0], [0, -1, 1]])[:, :elements]
    structure = LinearStructure(System(M, 1e-3 * K, K, [Element(w, Backlash(1.0)) for w in W.T]))
    for w in (0.1, 0.6, 3.0):
        Z = np.linalg.inv(W.T @ np.linalg.solve(structure.K + 1j * w * structure.C - w**2 * structure.M, W))
        np.testing.assert_allclose(structure.fixed_interface.stiffness(1j * w), Z, rtol=0, atol=1e-12 * abs(Z).max())


def test_defective_modes_with_fixed_elements_are_not_used():
    """Between two elements is a critically damped mass: the inverse of the receptance serves instead."""
    C, K, at = np.diag([0.1, 2.0, 0.1]), np.eye(3) - 0.3 * (np.eye(3, k=1) + np.eye(3, k=-1)), np.eye(3)
    structure = LinearStructure(System(at, C, K, [Element(at[i], Backlash(1.0)) for i in (0, 2)]))
    assert structure.accurate_modes and structure.fixed_interface is None


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:no friction slider slips")
def test_a_curve_with_ninety_sliders_that_stick():
    """With the inverse of the receptance, steps were 1e-5. The motion is that of the beam with 90 springs."""
    beam = beam_with(np.arange(8, 98), Jenkins(k=1.0, limit=0.01))
    curve = trace(HarmonicBalance(beam, 1), "Omega", (3.3, 3.6), accuracy=None, stability=False)
    assert curve.status.complete and len(curve) < 40
    X, Omega = curve.X[-1].reshape(90, -1), curve.values[-1]
    D = beam.K + beam.W @ beam.W.T + 1j * Omega * beam.C - Omega**2 * beam.M
    expected = beam.W.T @ np.linalg.solve(D, beam.load[0].complex(200)[1])
    np.testing.assert_allclose(X[:, 1] - 1j * X[:, 2], expected, rtol=0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.slow
def test_a_curve_with_ninety_sliders_that_slip():
    """The motion is that of all coordinates under the sampled forces of the sliders."""
    beam = beam_with(np.arange(8, 98), Jenkins(k=20 / 90, limit=0.2 / 90))
    problem = HarmonicBalance(beam, 3)
    curve = trace(problem, "Omega", (3.0, 3.4), accuracy=None, stability=False)
    assert curve.status.complete and len(curve) < 80 and len(curve.special) > 10
    X, Omega = curve.X[-1].reshape(90, -1), curve.values[-1]
    tau = 2 * np.pi * np.arange(4096) / 4096
    d = X @ np.array([0 * tau + 1, *(f(k * tau) for k in (1, 2, 3) for f in (np.cos, np.sin))])
    f = np.zeros_like(d)
    for _ in range(2):  # a sampled slider, from its state after one period
        for i in range(4096):
            f[:, i] = np.clip(f[:, i - 1] + 20 / 90 * (d[:, i] - d[:, i - 1]), -0.2 / 90, 0.2 / 90)
    for k in (1, 3):
        force = -2 * (f @ np.exp(-1j * k * tau)) / 4096
        F = beam.W @ force + (beam.load[0].complex(200)[1] if k == 1 else 0.0)
        q = np.linalg.solve(beam.K + 1j * k * Omega * beam.C - (k * Omega) ** 2 * beam.M, F)
        motion = X[:, 2 * k - 1] - 1j * X[:, 2 * k]
        np.testing.assert_allclose((beam.W.T @ q), motion, rtol=0, atol=1e-5 * np.abs(motion).max())
