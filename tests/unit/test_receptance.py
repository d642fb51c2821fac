"""The linear part seen from the element coordinates, against dense solves of the whole structure."""

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import block_diag

from hbgear import Backlash, Cubic, Duffing, Element, GearRotorBearing, HarmonicBalance, Load, Series, System
from hbgear.harmonic.receptance import Receptance, Structure, UnbalancedLoad

H = 4


def structure(rng, n=6, m=2, sparse_matrices=False, **load):
    """A random damped structure, neither symmetric nor proportionally damped, with two elements."""
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
    """Z_k (H+1, m, m) and g_k (H+1, m) of the balance Z d + g + f = 0 from dense solves without reference springs."""
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
    part = Receptance(Structure(system), system, H, nu).at(0.7)
    Z, g = by_hand(system, 0.7, nu)
    np.testing.assert_allclose(part.Z, Z, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(part.g, g, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("power", [0, 1, 2])
def test_derivative_in_frequency(rng, slope, power):
    system = structure(rng, power=power)
    receptance = Receptance(Structure(system), system, H, 2)
    here = receptance.at(0.7)
    np.testing.assert_allclose(
        here.matrices[1], slope(lambda Omega: receptance.at(Omega).Z, 0.7, 1e-4), rtol=1e-7, atol=1e-9
    )
    np.testing.assert_allclose(
        here.constants[1], slope(lambda Omega: receptance.at(Omega).g, 0.7, 1e-4), rtol=1e-7, atol=1e-9
    )


def test_large_sparse_structure_is_solved_directly(slope):
    """A chain of 2000 masses: the same receptance with and without modes, and both solve the equations."""
    n = 2000
    K = sparse.diags_array([np.full(n - 1, -1.0), np.full(n, 2.1), np.full(n - 1, -1.0)], offsets=[-1, 0, 1])
    direction = np.zeros(n)
    direction[[700, 900]] = 1.0, -1.0
    load = Load(None, {1: np.ones(n)})
    system = System(sparse.eye_array(n), 0.05 * sparse.eye_array(n), K, [Element(direction, Cubic(0.3, 0.5))], load)
    receptance = Receptance(Structure(system), system, 2, 1)
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
    """Two masses held by nothing but the gap between them."""
    gap = Element([1.0, -2.0], Backlash(1.0), damping=damping)
    return System(np.diag([1.0, 3.0]), C, np.zeros((2, 2)), [gap], load or (), dof_names=["gear", "wheel"])


def test_free_motion_is_removed():
    """q1 = 2, q2 = 1 is free; a load that does no work on it leaves d'' (1/m1 + 4/m2)^-1 + p = load share."""
    system = two_masses(Load([0.5, -1.0], {1: [0.2, 0.0]}))
    part = Receptance(Structure(system), system, H, 1).at(0.9)
    w, mass = 0.9 * np.arange(H + 1), 1 / (1 + 4 / 3)
    np.testing.assert_allclose(part.Z[:, 0, 0], -(w**2) * mass + 0.1j * w, atol=1e-12)
    np.testing.assert_allclose(part.g[:2, 0], [-0.5, -0.2 * mass], atol=1e-12)


def test_unbalanced_load_names_the_motion():
    with pytest.raises(UnbalancedLoad, match=r"work .* on a motion that nothing holds \(gear = 1, wheel = 0.5\)"):
        HarmonicBalance(two_masses(Load([0.5, 0.0])), 3)


def test_a_damped_drift_cannot_carry_a_constant_load():
    """A damper on a free motion would let a constant load drive it away at constant speed: still no periodic motion."""
    with pytest.raises(UnbalancedLoad, match="gear"):
        HarmonicBalance(two_masses(Load([0.5, 0.0]), C=np.diag([0.1, 0.1])), 3)


def test_a_free_motion_beside_an_unloaded_coordinate():
    """A coordinate that no element and no spring touches does no harm."""
    base = two_masses(Load([0.5, -1.0], {1: [0.2, 0.0]}))
    gap = Element([1.0, -2.0, 0.0], Backlash(1.0), damping=0.1)
    wider = System(block_diag(base.M, 2.0), None, np.zeros((3, 3)), [gap], Load([0.5, -1, 0], {1: [0.2, 0, 0]}))
    parts = [Receptance(Structure(s), s, H, 1).at(0.9) for s in (base, wider)]
    np.testing.assert_allclose(parts[1].Z, parts[0].Z, atol=1e-12)
    np.testing.assert_allclose(parts[1].g, parts[0].g, atol=1e-12)


def test_units_do_not_matter():
    """The same structure with coordinates in other units (1e-6 and 1e4) and another unit of time."""
    system = two_masses(Load([0.5, -1.0], {1: [0.2, 0.0]}))
    S, clock = np.diag([1e-6, 1e4]), 1e3
    scaled = System(
        S @ system.M @ S / clock**2, None, system.K,
        [Element(S @ [1.0, -2.0], Backlash(1.0), damping=0.1 / clock)],
        Load(S @ [0.5, -1.0], {1: S @ [0.2, 0.0]}),
    )  # fmt: skip
    a = Receptance(Structure(system), system, H, 1).at(0.9)
    b = Receptance(Structure(scaled), scaled, H, 1).at(0.9 * clock)
    np.testing.assert_allclose(b.Z, a.Z, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(b.g, a.g, rtol=1e-9, atol=1e-10)


def test_singular_mass():
    system = System(np.diag([1.0, 0.0]), None, np.eye(2), [Element([1.0, 1.0], Cubic(1.0))], dof_names=["a", "b"])
    with pytest.raises(ValueError, match=r"M is singular .*'b' carries no mass"):
        HarmonicBalance(system, 3)


def test_dependent_directions():
    elements = [Element([1.0, 2.0], Cubic(1.0), name="one"), Element([-2.0, -4.0], Backlash(), name="two")]
    with pytest.raises(ValueError, match=r"\(one, two\) are linearly dependent; .* Parallel"):
        HarmonicBalance(System(np.eye(2), None, np.eye(2), elements), 3)


@pytest.mark.parametrize("zeta", [np.sqrt(1.1), np.sqrt(1.1) + 1e-9, np.sqrt(1.1) + 1e-5])
def test_critically_damped_structure(zeta):
    """Two poles meet and their modes with them: Z is still 1 - w^2 + 2 zeta i w, and the multipliers stay small."""
    problem = HarmonicBalance(Duffing(zeta=zeta), H)
    part = problem.compiled({}).receptance.at(0.8)
    w = 0.8 * np.arange(H + 1)
    np.testing.assert_allclose(part.Z[:, 0, 0], 1 - w**2 + 2j * zeta * w, rtol=1e-9)
    X = problem.start(0.8)
    product = np.prod(problem.multipliers(X, Omega=0.8, width=0.1))
    # two modes of a condition up to 1e8 cancel
    assert product == pytest.approx(np.exp(-2 * zeta * 2 * np.pi / 0.8), rel=1e-6, abs=2e-10)


@pytest.mark.filterwarnings("ignore::hbgear.Unlikely")
def test_numbers_too_far_apart_are_told():
    """A damper that holds all: the receptance of an element is zero to the last digit, and has no inverse."""
    with pytest.raises(ValueError, match="the structure does not give way"):
        HarmonicBalance(GearRotorBearing(zeta_2=1e30), 5).start(Omega=0.5)
