"""Kernels of the phi functions, and of the response of modes to a polynomial force in a step; see `gauss_points`.

    phi_0(z) = e^z,   phi_{p+1}(z) = (phi_p(z) - 1 / p!) / z,   phi_p(z) = z phi_{p+1}(z) + 1 / p!

The matrices of a collocation step, which are sums of this response over the modes, are those of `floquet`.

This module is imported when its first kernel is needed, see `hbgear.common.process.compiling`.

References
----------
Hochbruck & Ostermann (2010), Acta Numerica 19, https://doi.org/10.1017/S0962492910000048.
"""

from __future__ import annotations

import math
from typing import Any

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


@kernel
def fill_step_matrices(modes: Any, L: Any, workspace: Any) -> None:
    """Compute the matrices A, R and B of a step from `moments`, for the independent ports of `SymmetricPair.base`.

    Rows and columns are Gauss points and ports, modes in real numbers. The modes are summed before the monomials are
    combined to Lagrange polynomials, at a fraction of the cost.
    """
    turns, work, w = workspace.turns, workspace.moments, workspace.weighted_output
    A, R, B, base = workspace.A, workspace.R, workspace.B, modes.base
    s, q, orders = turns.shape[0] - 1, modes.poles.shape[0], A.shape[0]
    c, b = base.output.shape[0], base.input.shape[1]
    A[:, :, :] = 0.0
    for o in range(orders):
        for p in range(c):
            for k in range(q):
                w[k] = base.output[p, k] * (modes.poles[k] if o else 1.0)
            for i in range(s):
                for k in range(q):
                    observed = w[k] * turns[i, k]
                    R[o, i * c + p, k], R[o, i * c + p, q + k] = observed.real, -observed.imag
            for e in range(b):
                _add_observed_output(w, base.input[:, e], work, L, A[o, p::c, e::b])
                if o == 0:
                    for i in range(s):
                        A[0, i * c + p, i * b + e] += base.flexibility[p, e]
    for j in range(s):
        for k in range(q):
            z = 0j
            for n in range(s):
                z += L[j, n] * work[n + 1, s * q + k]
            for p in range(b):
                excited = z * base.input[k, p]
                B[k, j * b + p], B[q + k, j * b + p] = excited.real, excited.imag


@kernel
def _add_observed_output(output: Any, excited: Any, work: Any, L: Any, out: Any) -> None:
    """Add the output of a port at the Gauss points (s, s), excited by Lagrange polynomials at another port."""
    s, q = L.shape[0], output.shape[0]
    for n in range(s):
        for i in range(s):
            real = imaginary = 0.0
            for k in range(q):
                product, z = output[k] * excited[k], work[n + 1, i * q + k]
                real += product.real * z.real
                imaginary += product.imag * z.imag
            for j in range(s):
                out[i, j] += (real - imaginary) * L[j, n]
