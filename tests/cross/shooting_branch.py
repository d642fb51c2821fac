"""Branches of periodic motions by event-driven shooting: folds, period doublings and Neimark-Sacker points without harmonics.

    F(y, Omega) = y(2 pi nu; y, Omega) - y = 0,   y = (q, q') at tau = 0,   Phi = dy(2 pi nu)/dy

While every element stays on one straight piece of its law the motion is linear, z' = B(tau) z with z = (y, 1), and its
fundamental matrix over each of ``CELLS`` equal cells of the period comes from collocation at ``STAGES`` Gauss points. A
motion goes from cell to cell and changes pieces at the root of the cell's polynomial. Forces are continuous at the corners, so
Phi is the product of the matrices passed.

    LP  det(Phi - 1) = 0        PD  det(Phi + 1) = 0        NS  a complex pair of eigenvalues of Phi of modulus 1

each a bracketed root along the curve, where every point is corrected onto it. `cross.shooting` integrates the same equations in
another way; `tests/cross/test_two_masses.py` holds the two against each other.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

STAGES = 10


def _gauss(s):
    """Gauss points c on (0, 1); A (s, s) with int_0^c_i L_j; the same to 1, b (s,)."""
    c = 0.5 * (np.polynomial.legendre.leggauss(s)[0] + 1.0)
    powers = np.arange(1, s + 1)
    inverse = np.linalg.inv(np.vander(c, increasing=True))  # L_j(x) = sum_p inverse[p, j] x^p
    A = (c[:, None] ** powers / powers) @ inverse
    return c, A, (1.0 / powers) @ inverse


C, A, B = _gauss(STAGES)
_NODES = np.concatenate([[0.0], C])
_WEIGHTS = np.array([1.0 / np.prod(x - np.delete(_NODES, i)) for i, x in enumerate(_NODES)])


def _lagrange(x):
    """Values at x of the Lagrange polynomials on 0 and the Gauss points."""
    away = x - _NODES
    if np.any(away == 0):
        return (away == 0).astype(float)
    terms = _WEIGHTS / away
    return terms / terms.sum()
