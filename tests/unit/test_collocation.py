"""The phi functions against their series in exact rational numbers, and the integrals against Gauss quadrature."""

from fractions import Fraction
from math import factorial

import numpy as np
import pytest

from hbgear.harmonic.multipliers import phi_functions as kernels
from hbgear.harmonic.multipliers.gauss_points import gauss_nodes


def phi(z, order):
    out = np.empty((order + 1, z.size), dtype=complex)
    kernels.phi(z.ravel().astype(complex), out)
    return out.reshape(-1, *z.shape)


def series(x, y, p, terms=200):
    """sum_k z^k / (k + p)! of z = x + i y, without rounding."""
    re, im = Fraction(0), Fraction(0)
    for k in reversed(range(terms)):
        re, im = re * x - im * y + Fraction(1, factorial(k + p)), re * y + im * x
    return complex(re, im)


@pytest.mark.parametrize("size", ["0", "1e-9", "0.2", "1.5", "3.99", "4", "12", "40"])
def test_phi(size):
    directions = [(0, 5), (-3, 4), (-4, 3), (-5, 0)]
    z = [(Fraction(size) * x / 5, Fraction(size) * y / 5) for x, y in directions]
    exact = np.array([[series(*each, p) for each in z] for p in range(7)])
    found = phi(np.array([complex(*each) for each in z]), 6)
    np.testing.assert_allclose(found[1:], exact[1:], rtol=3e-13)
    np.testing.assert_allclose(found[0], exact[0], rtol=0, atol=1e-13)


def test_phi_of_near_and_far_at_once():
    z = np.array([[0.1j, -30.0], [5.0j, -1.0]])
    one_by_one = np.array([[phi(np.array([x]), 4)[:, 0] for x in row] for row in z]).transpose(2, 0, 1)
    np.testing.assert_allclose(phi(z, 4), one_by_one, rtol=1e-14)


def test_integrals_of_the_lagrange_polynomials():
    poles, h, s = np.array([-0.3 + 2j, -50.0, 0.01j]), 0.4, 6
    x, L = gauss_nodes(s)
    ends, (fine, _), weights = np.append(x, 1.0), gauss_nodes(40), 0.5 * np.polynomial.legendre.leggauss(40)[1]
    turns, found = np.empty((s + 1, 3), dtype=complex), np.empty((s, s + 1, 3), dtype=complex)
    kernels.integrals(poles, h, ends, L, turns, found, np.empty((s + 2, 3 * (s + 1)), dtype=complex))
    np.testing.assert_allclose(turns, np.exp(h * ends[:, None] * poles), rtol=0, atol=1e-14)
    for i, end in enumerate(ends):
        kernel = np.exp(poles[:, None] * h * end * (1 - fine)) * weights
        lagrange = L @ (end * fine) ** np.arange(s)[:, None]
        np.testing.assert_allclose(found[:, i], h * end * lagrange @ kernel.T, rtol=0, atol=2e-12 * h)
