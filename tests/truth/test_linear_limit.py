"""Without nonlinearity every model is its transfer function: (K + i w C - w^2 M) q_k = F_k, solved densely here."""

import numpy as np
import pytest
from scipy import sparse

from hbgear import Cubic, Duffing, Element, HarmonicBalance, Load, SpurPair, System
from hbgear.gears import DoubleHelicalPair
from hbgear.mechanics import Series
from hbgear.mechanics.series.fourier import to_complex

EPS = np.finfo(float).eps
SUMS = 32
"""Roundings of order eps in the harmonics of a motion of well-conditioned equations."""


def stiffness(M, C, K, w):
    """K + i w_k C - w_k^2 M (H + 1, n, n) of closed matrices, or of numbers."""
    M, C, K = (np.atleast_2d(A) for A in (M, C, K))
    return K + 1j * w[:, None, None] * C - w[:, None, None] ** 2 * M


def tolerances(M, C, K, w, q):
    """What rounding may change harmonic k of the solution of D_k q_k = F_k by, for D of `stiffness`, q (n, H + 1).

    Relative to the harmonic: a few eps (eigenvalues, then a solve) times the condition of D_k as a sum,
    |K| + w |C| + w^2 |M| over the least singular value; what D_0 leaves free takes no part. Relative to the whole
    motion: the sums of its transform.
    """
    s = np.linalg.svd(stiffness(M, C, K, w), compute_uv=False)
    least = np.min(s, axis=1, initial=np.inf, where=s > 1e-11 * s[:, :1])
    M, C, K = (np.linalg.norm(np.atleast_2d(A), 2) for A in (M, C, K))
    sizes = np.linalg.norm(q, axis=0)
    return EPS * (4 * (K + w * C + w**2 * M) / least * sizes + SUMS * sizes.max())


def compare(found, expected, tolerance):
    """Complex harmonics (n, H + 1), each to its tolerance (H + 1,)."""
    for k, limit in enumerate(tolerance):
        np.testing.assert_allclose(found[:, k], expected[:, k], atol=limit, rtol=0)


@pytest.mark.parametrize("Omega", [0.3, 1.0, 1.7])
def test_duffing_without_cubic_spring(Omega):
    m = Duffing(k3=0.0)
    problem = HarmonicBalance(m, 3)
    X, w = problem.start(Omega), Omega * np.arange(4)
    expected = np.array([[0, m.F, 0, 0]]) / (1 - w**2 + 2j * m.zeta * w)
    tolerance = tolerances(1.0, 2 * m.zeta, 1.0, w, expected)
    compare(to_complex(X)[None], expected, tolerance)
    compare(to_complex(problem.motion(X, Omega=Omega)), expected, tolerance)


@pytest.mark.parametrize("phase", ["cos", "sin"])
@pytest.mark.parametrize("Omega", [0.3, 1.0, 1.7])
def test_spur_pair_without_backlash(Omega, phase):
    m = SpurPair(b=0.0, e=(0.05, 0.0, 0.02), phase=phase, e_scale=2.0)
    X = HarmonicBalance(m, 4).start(Omega)
    w = Omega * np.arange(5)
    load = np.array([0, 0.1, 0, 0.04, 0]) * w**2 * (1 if phase == "cos" else -1j)
    load[0] = m.F_m
    expected = (load / (1 - w**2 + 2j * m.zeta * w))[None]
    compare(to_complex(X)[None], expected, tolerances(1.0, 2 * m.zeta, 1.0, w, expected))


@pytest.mark.parametrize("Omega", [0.25, 0.9359, 2.0])
@pytest.mark.parametrize("changes", [{}, {"stagger": 1.0, "mesh_helix": "base", "support_damping": "zeta"}], ids=str)
def test_double_helical_pair_without_backlash(Omega, changes):
    """All 24 coordinates; the free rotation takes no part in the constant harmonic."""
    m = DoubleHelicalPair(W=-1.0, eps=(), **changes)
    system = m.system()
    problem = HarmonicBalance(m, 3)
    X = problem.start(Omega)
    q, d = to_complex(problem.motion(X, Omega=Omega)), to_complex(X.reshape(2, -1))
    W, c = system.W, system.elements[0].damping
    K, C = system.K + W @ W.T, system.C + c * W @ W.T
    e = np.array([to_complex(element.displacement.row(3)) for element in system.elements])
    w = Omega * np.arange(4)
    F = W @ ((1 + 1j * w * c) * e)
    F[:, 0] += system.load[0].constant
    expected = np.array(
        [np.linalg.lstsq(Dk, Fk, rcond=1e-11)[0] for Dk, Fk in zip(stiffness(system.M, C, K, w), F.T, strict=True)]
    ).T
    free = np.linalg.svd(K)[2][-1]
    q[:, 0] -= free * (free @ (q[:, 0] - expected[:, 0]))
    tolerance = tolerances(system.M, C, K, w, expected)
    compare(q, expected, tolerance)
    compare(d, W.T @ expected - e, np.linalg.norm(W, 2) * tolerance)
    assert (10 * tolerance < 1e-8 * np.linalg.norm(expected, axis=0)).all()
    for k in range(4):
        with pytest.raises(AssertionError):
            compare(q * np.where(np.arange(4) == k, 1 + 10 * tolerance / np.abs(q).max(axis=0), 1), expected, tolerance)


@pytest.mark.parametrize("form", [np.asarray, sparse.csr_array])
def test_random_system(rng, form):
    """Six coordinates, two linear elements with dampers and prescribed displacements, an unbalance."""
    n, H, Omega = 6, 4, 0.8
    A, B, D = rng.standard_normal((3, n, n))
    M, K, C = np.eye(n) + 0.2 * A @ A.T, 2 * np.eye(n) + B @ B.T + 0.3 * A, 0.1 * (np.eye(n) + 0.3 * D)
    k, c = np.array([0.7, 1.3]), np.array([0.2, 0.0])
    series = [Series(0.3, (0.1, 0.2), (0.4,)), Series(0.0, (0.0, 0.0, 0.5))]
    elements = [Element(rng.standard_normal(n), Cubic(k3=0.0, k1=k[j]), series[j], damping=c[j]) for j in range(2)]
    F0, F1, F2, S3 = rng.standard_normal((4, n))
    loads = [Load(F0, {2: F2}), Load(None, {1: F1}, {3: S3}, power=2)]
    problem = HarmonicBalance(System(form(M), form(C), form(K), elements, loads), H)
    X = problem.start(Omega)

    W = np.column_stack([element.direction for element in elements])
    e = np.array([to_complex(s.row(H)) for s in series])
    F = np.array([F0, Omega**2 * F1, F2, -1j * Omega**2 * S3, 0 * F0], dtype=complex)
    w = Omega * np.arange(H + 1)
    spring = k[:, None] + 1j * w * c[:, None]
    closed = M, C + (W * c) @ W.T, K + (W * k) @ W.T, w
    expected = np.linalg.solve(stiffness(*closed), (F + (W @ (spring * e)).T)[..., None])[..., 0].T
    gaps, tolerance = W.T @ expected - e, tolerances(*closed, expected)
    compare(to_complex(problem.motion(X, Omega=Omega)), expected, tolerance)
    compare(to_complex(X.reshape(2, -1)), gaps, np.linalg.norm(W, 2) * tolerance)
    mesh = to_complex(problem.mesh_forces(X, Omega=Omega))
    compare(mesh, spring * gaps, np.abs(spring).max() * np.linalg.norm(W, 2) * tolerance)
