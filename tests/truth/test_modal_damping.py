"""Damping matrices from damping ratios, by the eigenvalues of the first-order form."""

import numpy as np
import pytest
import scipy
from machines import state_matrix

import hbgear as hb


def chain(n: int, free: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return masses and stiffness of a chain, held at its first mass unless it is free."""
    rng = np.random.default_rng(4)
    M, K = np.diag(rng.uniform(0.5, 2.0, n)), np.zeros((n, n))
    for i, k in enumerate(rng.uniform(1.0, 4.0, n - 1)):
        K[i : i + 2, i : i + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    K[0, 0] += 0.0 if free else 2.0
    return M + 0.1 * np.ones((n, n)), K


def ratios_of(M, C, K):
    """Return frequencies and damping ratios of the eigenvalues s = omega (-zeta +- i sqrt(1 - zeta^2))."""
    s = np.linalg.eigvals(state_matrix(M, C, K))
    s = s[s.imag > 0]
    s = s[np.argsort(np.abs(s))]
    return np.abs(s), -s.real / np.abs(s)


@pytest.mark.parametrize(("ratios", "expected"), [(0.03, 6 * [0.03]), ([0.01, 0.02, 0.05], [0.01, 0.02] + 4 * [0.05])])
def test_modes_have_the_given_ratios(ratios, expected):
    M, K = chain(6)
    C = hb.mechanics.modal_damping(scipy.sparse.csr_array(M), K, ratios)
    omega, zeta = ratios_of(M, C, K)
    np.testing.assert_allclose(zeta, expected, rtol=1e-9)
    np.testing.assert_allclose(omega**2, scipy.linalg.eigh(K, M, eigvals_only=True), rtol=1e-9)


def test_a_mode_at_rest_has_no_damping():
    M, K = chain(4, free=True)
    C = hb.mechanics.modal_damping(M, K, 0.04)
    assert np.abs(C @ np.ones(4)).max() < 1e-6 * np.abs(C).max()
    assert ratios_of(M, C, K)[1][-3:] == pytest.approx([0.04] * 3, rel=1e-6)


def test_matrices_get_it_once():
    M, K = chain(3)
    given = hb.io.Matrices(M, K).with_modal_damping([0.02])
    np.testing.assert_array_equal(given.C, hb.mechanics.modal_damping(M, K, 0.02))
    with pytest.raises(ValueError, match="has a damping matrix C; give either"):
        given.with_modal_damping(0.02)


@pytest.mark.parametrize(
    ("M", "K", "ratios", "said"),
    [
        (np.eye(2), [[1.0, 0.2], [0.0, 1.0]], 0.1, "K is not symmetric, so it has no real modes; give C"),
        (np.diag([1.0, 0.0]), np.eye(2), 0.1, "M is not positive definite"),
        (np.eye(2), np.diag([1.0, -1.0]), 0.1, "K has a negative eigenvalue, omega\\^2 = -1"),
        (np.eye(2), np.eye(2), [0.1, -0.1], "ratios = -0.1 must not be negative"),
        (np.eye(2), np.eye(2), [], "ratios must be a number, or a list"),
    ],
)
def test_damping_that_is_refused(M, K, ratios, said):
    with pytest.raises(ValueError, match=said):
        hb.mechanics.modal_damping(M, K, ratios)
