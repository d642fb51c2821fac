"""Without nonlinearity every model is its transfer function: (K + i w C - w^2 M) q_k = F_k, solved densely here."""

import numpy as np
import pytest
from scipy import sparse

from hbgear import Cubic, DoubleHelicalPair, Duffing, Element, HarmonicBalance, Load, Series, SpurPair, System
from hbgear.fourier import to_complex

TOLERANCE = 1e-12


def compare(found, expected):
    """Complex harmonics (n, H + 1), relative to the largest of each harmonic."""
    for k in range(expected.shape[1]):
        scale = np.abs(expected[:, k]).max()
        np.testing.assert_allclose(found[:, k], expected[:, k], atol=TOLERANCE * max(scale, 1e-3), rtol=0)


@pytest.mark.parametrize("Omega", [0.3, 1.0, 1.7])
def test_duffing_without_cubic_spring(Omega):
    m = Duffing(k3=0.0)
    problem = HarmonicBalance(m, 3)
    expected = np.array([[0, m.F / (1 - Omega**2 + 2j * m.zeta * Omega), 0, 0]])
    X = problem.start(Omega)
    compare(to_complex(X)[None], expected)
    compare(to_complex(problem.motion(X, Omega=Omega)), expected)


@pytest.mark.parametrize("phase", ["cos", "sin"])
@pytest.mark.parametrize("Omega", [0.3, 1.0, 1.7])
def test_spur_pair_without_backlash(Omega, phase):
    m = SpurPair(b=0.0, e=(0.05, 0.0, 0.02), phase=phase, e_scale=2.0)
    X = HarmonicBalance(m, 4).start(Omega)
    w = Omega * np.arange(5)
    load = np.array([0, 0.1, 0, 0.04, 0]) * w**2 * (1 if phase == "cos" else -1j)
    load[0] = m.F_m
    compare(to_complex(X)[None], (load / (1 - w**2 + 2j * m.zeta * w))[None])


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
    (load,) = system.load
    for k in range(4):
        w = k * Omega
        F = (load.constant if k == 0 else 0) + W @ ((1 + 1j * w * c) * e[:, k])
        if k:
            expected = np.linalg.solve(K + 1j * w * C - w**2 * system.M, F)
        else:
            expected = np.linalg.lstsq(K, F.real, rcond=1e-11)[0]
            free = np.linalg.svd(K)[2][-1]
            q[:, 0] -= free * (free @ (q[:, 0] - expected))
        compare(q[:, k, None], expected[:, None])
        compare(d[:, k, None], (W.T @ expected - e[:, k])[:, None])


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
    expected = np.empty((n, H + 1), dtype=complex)
    for h in range(H + 1):
        w = h * Omega
        closed = K + 1j * w * C - w**2 * M + (W * (k + 1j * w * c)) @ W.T
        expected[:, h] = np.linalg.solve(closed, F[h] + W @ ((k + 1j * w * c) * e[:, h]))
    compare(to_complex(problem.motion(X, Omega=Omega)), expected)
    compare(to_complex(X.reshape(2, -1)), W.T @ expected - e)
    mesh = to_complex(problem.mesh_forces(X, Omega=Omega))
    compare(mesh, (k[:, None] + 1j * Omega * np.arange(H + 1) * c[:, None]) * (W.T @ expected - e))
