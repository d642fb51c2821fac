"""Gaussian elimination of small dense systems, against LAPACK."""

import numpy as np
import pytest
import scipy

from hbgear.continuation.numerics.gauss_kernels import scaled_distance, scaled_norm, solve_in_place
from hbgear.continuation.numerics.linear import solve_signed

EPS = np.finfo(float).eps


def eliminated(A, b):
    """Return A^-1 b and the sign of det A."""
    both = np.hstack([A, b])
    return both[:, len(A) :], solve_in_place(both)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 21, 60])
@pytest.mark.parametrize("columns", [1, 2, 5])
def test_solution_and_sign(n, columns, rng):
    """The solution agrees with scipy within rounding times the condition number; the sign equals the sign of det A."""
    signs = set()
    for _ in range(20):
        A, b = rng.standard_normal((n, n)), rng.standard_normal((n, columns))
        x, sign = eliminated(A, b)
        signs.add(sign)
        assert sign == np.linalg.slogdet(A)[0]
        expected = scipy.linalg.solve(A, b)
        tolerance = 4 * n * EPS * np.linalg.cond(A) * np.abs(expected).max()
        np.testing.assert_allclose(x, expected, rtol=0, atol=tolerance)
        assert np.abs(A @ x - b).max() < 40 * n * EPS * np.abs(A).max() * max(np.abs(x).max(), 1)
    assert signs == {-1, 1}


def test_rows_are_exchanged_for_the_largest_pivot():
    """Without row exchanges a pivot of 1e-20 loses all digits, and a pivot of 0 divides by zero."""
    for small in (1e-20, 0.0):
        for side in (1, -1):
            x, sign = eliminated(np.array([[small, 1.0], [side, 1.0]]), np.array([[1.0], [2.0]]))
            assert sign == -side
            np.testing.assert_allclose(x, [[side], [1.0]], rtol=1e-15)


def test_permutations_have_their_parity(rng):
    for _ in range(30):
        order = rng.permutation(7)
        P = np.eye(7)[order]
        x, sign = eliminated(P, np.arange(7.0)[:, None])
        assert sign == round(np.linalg.det(P))
        np.testing.assert_array_equal(x[order, 0], np.arange(7.0))


def test_a_singular_matrix_is_reported(rng):
    """The sign is 0 if a pivot is zero or NaN; `solve_signed` raises LinAlgError then and on overflow."""
    column = rng.integers(-3, 4, (5, 5)).astype(float)
    column[:, 2] = 0.0
    equal = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [0.0, 1.0, 4.0]])
    for A in (np.zeros((3, 3)), column, equal, np.full((2, 2), np.nan)):
        assert eliminated(A, np.ones((len(A), 1)))[1] == 0
        with pytest.raises(np.linalg.LinAlgError, match="singular"):
            solve_signed(A, np.ones((len(A), 1)))
    with pytest.raises(np.linalg.LinAlgError, match="singular"), np.errstate(all="ignore"):
        solve_signed(np.diag([1e-320, 1.0]), np.ones((2, 1)))


@pytest.mark.parametrize("n", [5, 100, 101])
def test_arguments_are_not_changed(n, rng):
    """Elimination (small n) and LAPACK (larger n) solve the system without overwriting A or b."""
    A, b = rng.standard_normal((n, n)), rng.standard_normal((n, 2))
    kept = A.copy(), b.copy()
    x, sign = solve_signed(A, b)
    assert sign == np.linalg.slogdet(A)[0]
    np.testing.assert_allclose(A @ x, b, rtol=0, atol=1e-11 * np.abs(x).max())
    np.testing.assert_array_equal(A, kept[0])
    np.testing.assert_array_equal(b, kept[1])


def test_norms(rng):
    x, y, scale = rng.standard_normal((3, 9))
    assert scaled_norm(x) == pytest.approx(np.linalg.norm(x), rel=1e-15)
    assert scaled_distance(x, y, scale) == pytest.approx(np.linalg.norm((x - y) / scale), rel=1e-14)
