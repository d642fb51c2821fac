"""Kernels of the phi functions, and of the response of modes to a polynomial force in a step; see `gauss_points`.

    phi_0(z) = e^z,   phi_{p+1}(z) = (phi_p(z) - 1 / p!) / z,   phi_p(z) = z phi_{p+1}(z) + 1 / p!

This module is imported when its first kernel is needed, see `hbgear.common.process.compiling`.

References
----------
Hochbruck & Ostermann (2010), Acta Numerica 19, https://doi.org/10.1017/S0962492910000048.
"""

from __future__ import annotations

import math

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import inlined, kernel

INVERSE_FACTORIALS = np.array([1.0 / math.factorial(n) for n in range(100)])
"""1 / n! of n = 0, ..., 99."""

SERIES_RADIUS = 4.0
"""Modulus of z below which the series is summed; the upward recursion would lose digits there."""


@kernel
def phi(z: ComplexArray, out: ComplexArray) -> None:
    """Compute phi_0..phi_s of numbers z (n,) into out (s + 1, n)."""
    order, n, largest, work = len(out) - 1, len(z), 0.0, np.empty((4, len(z)))
    a, b, x, y = work[0], work[1], work[2], work[3]  # real and imaginary parts: the fastest form for many numbers
    for i in range(n):
        a[i], b[i] = z[i].real, z[i].imag
        size = a[i] * a[i] + b[i] * b[i]
        if largest < size < SERIES_RADIUS * SERIES_RADIUS:
            largest = size
    last, term, largest = order, 1.0, math.sqrt(largest)
    while term > 1e-17:
        last += 1
        term *= largest / last
    for i in range(n):
        x[i], y[i] = INVERSE_FACTORIALS[last], 0.0
    for p in range(last - 1, -1, -1):  # sum_k z^k / (k + p)! by Horner's rule, which is phi_p
        for i in range(n):
            x[i], y[i] = x[i] * a[i] - y[i] * b[i] + INVERSE_FACTORIALS[p], x[i] * b[i] + y[i] * a[i]
        if p <= order:
            for i in range(n):
                out[p, i] = complex(x[i], y[i])
    for i in range(n):
        if not a[i] * a[i] + b[i] * b[i] < SERIES_RADIUS * SERIES_RADIUS:
            out[0, i], inverse = np.exp(z[i]), 1.0 / z[i]
            for p in range(order):
                out[p + 1, i] = (out[p, i] - INVERSE_FACTORIALS[p]) * inverse


@inlined
def moments(poles: ComplexArray, h: float, c: Array, turns: ComplexArray, work: ComplexArray) -> None:
    """Compute the response of modes to monomials in a step of length h, up to c_i h.

        e^{lambda c_i h},   int_0^{c_i h} e^{lambda (c_i h - x)} (x / h)^p dx = c_i h c_i^p p! phi_{p+1}(lambda c_i h)

    Parameters
    ----------
    poles : ndarray, shape (q,)
        The poles lambda of the modes.
    h : float
        Length of the step.
    c : ndarray, shape (n,)
        Ends of the integrals, in units of the step.
    turns : ndarray, shape (n, q)
        Overwritten with the exponentials.
    work : ndarray, shape (s + 2, n q)
        Rows 1..s are overwritten with the integrals of p = 0..s-1.
    """
    s, n, q = len(work) - 2, len(c), len(poles)
    z, powers = work[s + 1], work[: s + 1]
    for i in range(n):
        for r in range(q):
            z[i * q + r] = c[i] * h * poles[r]
    phi(z, powers)
    for i in range(n):
        scale = c[i] * h
        for r in range(q):
            turns[i, r] = powers[0, i * q + r]
        for p in range(s):
            for r in range(q):
                powers[p + 1, i * q + r] *= scale
            scale *= c[i] * (p + 1)


@kernel
def integrals(
    poles: ComplexArray, h: float, c: Array, L: Array, turns: ComplexArray, out: ComplexArray, work: ComplexArray
) -> None:
    """Compute the response of modes to a polynomial u through the Gauss points of a step of length h, up to c_i h.

        e^{lambda c_i h},   int_0^{c_i h} e^{lambda (c_i h - x)} l_j(x / h) dx,   u = sum_j l_j u_j

    Parameters
    ----------
    poles : ndarray, shape (q,)
        The poles lambda of the modes.
    h : float
        Length of the step.
    c : ndarray, shape (n,)
        Ends of the integrals, in units of the step.
    L : ndarray, shape (s, s)
        Monomial coefficients of the Lagrange polynomials l_j, as returned by `gauss_nodes`.
    turns : ndarray, shape (n, q)
        Overwritten with the exponentials.
    out : ndarray, shape (s, n, q)
        Overwritten with the integrals.
    work : ndarray, shape (s + 2, n q)
        Overwritten.
    """
    s, n, q = len(L), len(c), len(poles)
    moments(poles, h, c, turns, work)
    flat = out.reshape(s, n * q)
    for j in range(s):
        for i in range(n * q):
            flat[j, i] = L[j, 0] * work[1, i]
        for p in range(1, s):
            for i in range(n * q):
                flat[j, i] += L[j, p] * work[p + 1, i]
