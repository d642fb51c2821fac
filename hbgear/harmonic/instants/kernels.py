"""Kernels of exact motions: flows of segments with constant matrices, and gaps along them.

    Z = e^(A h) - 1 = X (1 + X / 2 (1 + X / 3 (...))),   Z(2 X) = 2 Z(X) + Z(X)^2,   X = A h / 2^n

Z has the relative accuracy of A h, so that it holds for short segments.

References
----------
Moler & Van Loan (2003), SIAM Review 45(1), 3-49, section 3, https://doi.org/10.1137/S00361445024180.
Al-Mohy & Higham (2010), SIAM Journal on Matrix Analysis and Applications 31(3), 970-989, bounds by norms of powers,
https://doi.org/10.1137/09074721X.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import kernel
from hbgear.continuation.numerics.gauss_kernels import add_product

EXPONENTIAL_ORDER = 14
"""Order of the series of the exponential; the norm of its argument is at most 1/2: (1/2)^15 / 15! = 2e-17."""

NODES_ORDER, NEGLIGIBLE_TERM = 36, 1e-20
"""Largest order of the series at nodes of panels, in which the fastest mode turns by 3 rad: 3^37 / 37! = 3e-26, and the
size of two successive terms, over the first one, at which it ends. States of different size add their ratio."""

SLOPE_ORDER = 18
"""Order of the series of the derivative of Z / h, for |A h| up to 1: 1 / 20! = 4e-19."""

ROUNDING_OF_GAPS = 1e-14
"""Rounding of a gap, relative to its largest value in a period; contacts that have just begun are not much deeper."""


@kernel
def _exponential(A: Any, h: float, powers: Any, work: Any, Z: Any) -> None:
    """Compute Z (N, N) after a duration h; it is nan if a power of A h is not finite.

        Z = X sum_k X^k / (k + 1)! = X (B_0 + X^4 (B_1 + X^4 (B_2 + X^4 B_3)))        B_j of degree 3 in X

    Results are powers X, ..., X^4 in powers (4, N, N), and work (N, N). The truncation error is bounded by norms of the
    fourth and fifth power, which states of different size affect less than the norm of X.
    """
    N = A.shape[0]
    for i in range(N):
        for j in range(N):
            powers[0, i, j] = h * A[i, j]
    for k in range(1, 4):
        _multiply(powers[0], powers[k - 1], powers[k])
    _multiply(powers[0], powers[3], work)
    size = max(_norm(powers[3]) ** 0.25, _norm(work) ** 0.2)
    if not math.isfinite(size):
        Z[:] = np.nan
        return
    halvings = max(0, math.frexp(size)[1] + 1)
    for k in range(4):
        factor = 0.5 ** (halvings * (k + 1))
        for i in range(N):
            for j in range(N):
                powers[k, i, j] *= factor
    Z[:] = 0.0
    for first in range(EXPONENTIAL_ORDER - EXPONENTIAL_ORDER % 4, -1, -4):
        if first + 4 <= EXPONENTIAL_ORDER:
            for i in range(N):
                for j in range(N):
                    work[i, j] = Z[i, j]
            _multiply(powers[3], work, Z)
        _add_block(powers, first, Z)
    for i in range(N):
        for j in range(N):
            work[i, j] = Z[i, j]
    _multiply(powers[0], work, Z)
    for _ in range(halvings):
        for i in range(N):
            for j in range(N):
                work[i, j] = Z[i, j]
                Z[i, j] *= 2.0
        add_product(work, work, 1.0, Z)


@kernel
def _add_block(powers: Any, first: int, out: Any) -> None:
    """Add the terms X^k / (k + 1)! / X^first of degree first to first + 3, below `EXPONENTIAL_ORDER`, to ``out``."""
    factor = 1.0
    for k in range(2, first + 2):
        factor /= k
    for k in range(min(4, EXPONENTIAL_ORDER - first)):
        if k > 0:
            factor /= first + k + 1
        for i in range(out.shape[0]):
            if k == 0:
                out[i, i] += factor
                continue
            for j in range(out.shape[0]):
                out[i, j] += factor * powers[k - 1, i, j]


@kernel
def _norm(A: Any) -> float:
    """Return the largest sum of the moduli of a column."""
    largest = 0.0
    for j in range(A.shape[1]):
        total = 0.0
        for i in range(A.shape[0]):
            total += abs(A[i, j])
        if not total <= largest:
            largest = total
    return largest


@kernel
def _multiply(A: Any, B: Any, out: Any) -> None:
    """Set out to A B."""
    out[:] = 0.0
    add_product(A, B, 1.0, out)


@kernel
def taylor_growth(A: Any, b: Any, r: Any, kappa: Any, h: float) -> Any:
    """Return Z (N, N) after successive steps with varying stiffness, by the Taylor series of each step.

    Parameters
    ----------
    A, b, r : ndarray, shape (N, N), (S, N), (S, N)
        Matrices of the flow.
    kappa : ndarray, shape (steps, S, J + 1)
        Coefficients of x^j of each stiffness, x from 0 to 1 in a step.
    h : float
        Duration of a step.
    """
    N = A.shape[0]
    Z, T = np.zeros((N, N)), np.empty((kappa.shape[2], N, N))
    for step in range(kappa.shape[0]):
        T[0] = Z
        for i in range(N):
            T[0, i, i] += 1.0
        _taylor_series(A, b, r, kappa[step], h, T)
        for k in range(1, T.shape[0]):
            Z += T[k]
    return Z


@kernel
def taylor_states(A: Any, b: Any, r: Any, kappa: Any, h: float, y: Any, offsets: Any) -> Any:
    """Return the states (steps, G, N) at nodes of successive steps from y (N,); see `taylor_growth`.

    Parameters
    ----------
    A, b, r, kappa, h : ndarray and float
        Flow, coefficients of its stiffness, and duration of a step.
    y : ndarray, shape (N,)
        State at the begin of the first step.
    offsets : ndarray, shape (G,)
        Positions of the nodes in a step, 0 to 1.
    """
    steps, N = kappa.shape[0], A.shape[0]
    states, T = np.empty((steps, offsets.shape[0], N)), np.empty((kappa.shape[2], N, 1))
    T[0, :, 0] = y
    for step in range(steps):
        _taylor_series(A, b, r, kappa[step], h, T)
        for g in range(offsets.shape[0]):
            states[step, g] = _polynomial(T, offsets[g])
        T[0, :, 0] = _polynomial(T, 1.0)
    return states


@kernel
def _polynomial(T: Any, x: float) -> Any:
    """Return sum_k T_k x^k of columns T (J + 1, N, 1)."""
    out = T[T.shape[0] - 1, :, 0].copy()
    for k in range(T.shape[0] - 2, -1, -1):
        for i in range(out.shape[0]):
            out[i] = out[i] * x + T[k, i, 0]
    return out


@kernel
def _taylor_series(A: Any, b: Any, r: Any, kappa: Any, h: float, T: Any) -> None:
    """Compute the Taylor coefficients T (J + 1, N, c) of columns of a flow in a step, from T_0.

    (k + 1) T_{k+1} = h A T_k + h sum_s b_s sum_j kappa_s,j (r_s^T T_{k-j})
    """
    J, N, columns, S = T.shape[0] - 1, T.shape[1], T.shape[2], b.shape[0]
    terms, drive = np.empty((J, S, columns)), np.empty((S, columns))
    for k in range(J):
        _multiply(r, T[k], terms[k])
        drive[:] = 0.0
        for s in range(S):
            for j in range(k + 1):
                for i in range(columns):
                    drive[s, i] += kappa[s, j] * terms[k - j, s, i]
        _multiply(A, T[k], T[k + 1])
        add_product(b.T, drive, 1.0, T[k + 1])
        for i in range(N):
            for j in range(columns):
                T[k + 1, i, j] *= h / (k + 1)


@kernel
def constant_segments(A: Any, h: Any, y: Any) -> Any:
    """Return Z, the changes Z y, the rates A y at both ends of each segment, and d/dh (Z / h) y.

        d/dh (Z / h) = A^2 sum_k k (A h)^(k - 1) / (k + 1)!                 |A h| <= 1

    Parameters
    ----------
    A, h, y : ndarray, shape (K, N, N), (K,), (K, N)
        Matrices, durations and initial states.

    Returns
    -------
    tuple of ndarray
        Z (K, N, N), change, begin, end and slope (K, N).
    """
    K, N = y.shape
    Z, powers, square = np.empty((K, N, N)), np.empty((4, N, N)), np.empty((N, N))
    change, begin, end, slope = np.empty((K, N)), np.empty((K, N)), np.empty((K, N)), np.empty((K, N))
    work, total = np.empty(N), np.empty(N)
    for k in range(K):
        _exponential(A[k], h[k], powers, square, Z[k])
        _apply(Z[k], y[k], change[k])
        _apply(A[k], y[k], begin[k])
        _apply(A[k], y[k] + change[k], end[k])
        if _norm(A[k]) * abs(h[k]) > 1.0:
            slope[k] = (end[k] - change[k] / h[k]) / h[k]
            continue
        total[:] = 0.0
        factorial = 1.0
        for i in range(2, SLOPE_ORDER + 2):
            factorial *= i
        for i in range(SLOPE_ORDER, 0, -1):
            _apply(A[k], total, work)
            for j in range(N):
                total[j] = h[k] * work[j] + y[k, j] * (i / factorial)
            factorial /= i + 1
        _apply(A[k], total, work)
        _apply(A[k], work, slope[k])
    return Z, change, begin, end, slope


@kernel
def _apply(A: Any, x: Any, out: Any) -> None:
    """Set out to A x."""
    for i in range(A.shape[0]):
        total = 0.0
        for j in range(A.shape[1]):
            total += A[i, j] * x[j]
        out[i] = total


@kernel
def dot(a: Any, b: Any) -> float:
    """Return the scalar product."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@kernel
def gaps_along(A: Any, y: Any, rows: Any, h: Any, counts: Any, offsets: Any) -> Any:
    """Return gaps and their derivatives at nodes of all panels of K segments of constant matrices.

    Parameters
    ----------
    A, y, rows : ndarray, shape (K, N, N), (K, N), (K, m, N)
        Matrices, initial states and rows of the gaps.
    h, counts : ndarray, shape (K,)
        Durations and numbers of the panels of each segment.
    offsets : ndarray, shape (G,)
        Positions of the nodes in a panel, 0 to 1.

    Returns
    -------
    tuple of ndarray
        Gaps and slopes (P, G, m); P is the number of all panels.
    """
    (K, m, N), G, P = rows.shape, offsets.shape[0], 0
    for k in range(K):
        P += counts[k]
    gaps, slopes, p = np.empty((P, G, m)), np.empty((P, G, m)), 0
    state, change, Z = np.empty(N), np.empty(N), np.empty((N, N))
    powers, square, along = np.empty((4, N, N)), np.empty((N, N)), np.empty((G, 2 * m, N))
    terms = np.empty((NODES_ORDER + 1, 2 * m, N))
    for k in range(K):
        _exponential(A[k], h[k], powers, square, Z)
        _rows_along(A[k], h[k], rows[k], offsets, terms, along)
        state[:] = y[k]
        for _ in range(counts[k]):
            for g in range(G):
                for j in range(m):
                    gaps[p, g, j], slopes[p, g, j] = dot(along[g, j], state), dot(along[g, m + j], state)
            _apply(Z, state, change)
            state += change
            p += 1
    return gaps, slopes


@kernel
def _rows_along(A: Any, h: float, rows: Any, offsets: Any, terms: Any, out: Any) -> None:
    """Compute rows (m, N) and their products with A after fractions ``offsets`` (G,) of a panel in out (G, 2 m, N).

    row e^(A h x) = sum_k x^k row (A h)^k / k!
    """
    m, N = rows.shape
    terms[0, :m] = rows
    _multiply(rows, A, terms[0, m:])
    order, small, largest = 0, 0, _largest(terms[0])
    while order < NODES_ORDER and small < 2 and offsets[offsets.shape[0] - 1] > 0:
        order += 1
        _multiply(terms[order - 1], A, terms[order])
        for i in range(2 * m):
            for j in range(N):
                terms[order, i, j] *= h / order
        small = small + 1 if _largest(terms[order]) <= NEGLIGIBLE_TERM * largest else 0
    for g in range(offsets.shape[0]):
        x = offsets[g]
        for i in range(2 * m):
            for j in range(N):
                out[g, i, j] = terms[order, i, j]
        for k in range(order - 1, -1, -1):
            for i in range(2 * m):
                for j in range(N):
                    out[g, i, j] = out[g, i, j] * x + terms[k, i, j]


@kernel
def _largest(A: Any) -> float:
    """Return the largest modulus of an entry."""
    largest = 0.0
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            largest = max(largest, abs(A[i, j]))
    return largest


@kernel
def fourier_sums(theta: Any, weights: Any, gaps: Any, H: int) -> Any:
    """Return sum_t w_t d_tj e^(-i k theta_t), (m, H + 1), of gaps d (T, m) with weights w (T,), as powers of a wave."""
    sums = np.zeros((gaps.shape[1], H + 1), dtype=np.complex128)
    for t in range(theta.shape[0]):
        step = complex(math.cos(theta[t]), -math.sin(theta[t]))
        wave = complex(weights[t], 0.0)
        for k in range(H + 1):
            for j in range(gaps.shape[1]):
                sums[j, k] += gaps[t, j] * wave
            wave *= step
    return sums


@kernel
def unexpected_crossings(tau: Any, gaps: Any, slopes: Any, counts: Any, bounds: Any, rounding: Any) -> Any:
    """Return the intervals in which gaps lie beyond their breakpoints between two switches.

    Between two samples an extremum is estimated by cubic interpolation, and its value by interpolation of degree 7.

    Parameters
    ----------
    tau, gaps, slopes : ndarray, shape (P,), (P, m), (P, m)
        Phases, gaps and their derivatives, from the begin to the end of each segment.
    counts : ndarray, shape (K,)
        Number of samples of each segment.
    bounds : ndarray, shape (K, m, 2)
        Breakpoints below and above each gap; -inf or inf without one.
    rounding : tuple of float
        Distance beyond a breakpoint, relative to the size of the motion of a gap in the segment, that is attributed to
        rounding; duration up to which the switches at the ends of a segment are simultaneous. Their order is rounding,
        and there the distance is relative to the size of the gap in the period.

    Returns
    -------
    ndarray, shape (C, 5)
        Number of the segment, of the element, side (-1 or +1), begin and end of each interval.
    """
    K, m, C, first = bounds.shape[0], bounds.shape[1], 0, 0
    intervals = np.empty((2 * gaps.shape[0] * m, 5))
    excess, slope = np.empty(gaps.shape[0]), np.empty(gaps.shape[0])
    for k in range(K):
        last = first + counts[k]
        for j in range(m):
            extent, largest = np.max(gaps[first:last, j]) - np.min(gaps[first:last, j]), np.max(np.abs(gaps[:, j]))
            if abs(tau[last - 1] - tau[first]) < rounding[1]:
                extent = largest
            for side in (1, -1):
                bound = bounds[k, j, (1 + side) // 2]
                if not math.isfinite(bound):
                    continue
                for p in range(first, last):
                    excess[p], slope[p] = side * (gaps[p, j] - bound), side * slopes[p, j]
                first_interval = C
                allowed = max(ROUNDING_OF_GAPS * largest, rounding[0] * max(extent, abs(bound)))
                C = _add_intervals(tau[first:last], excess[first:last], slope[first:last], allowed, intervals, C)
                for c in range(first_interval, C):
                    intervals[c, 0], intervals[c, 1], intervals[c, 2] = k, j, side
        first = last
    return intervals[:C]


@kernel
def _add_intervals(tau: Any, h: Any, slope: Any, rounding: float, intervals: Any, count: Any) -> Any:
    """Add begin and end of each interval where h is positive to ``intervals`` from entry ``count`` on; return its end.

    An interval that the samples begin or end in has their first or last phase.
    """
    s, end = 0, tau.shape[0] - 1
    while s <= end:
        if h[s] > rounding:
            last = s
            while last < end and h[last + 1] > rounding:
                last += 1
            intervals[count, 3] = _linear_root(tau, h, s - 1) if s > 0 else tau[0]
            intervals[count, 4] = _linear_root(tau, h, last) if last < end else tau[end]
            count, s = count + 1, last
        elif s < end and not h[s + 1] > rounding:
            width = tau[s + 1] - tau[s]
            offset, curvature = _cubic_maximum(h[s], h[s + 1], slope[s] * width, slope[s + 1] * width)
            maximum = 0.0
            if curvature > 0:
                first = min(max(s - 1, 0), end - 3)
                maximum = _interpolated(h[first : first + 4], slope[first : first + 4], width, s - first + offset)
            if maximum > rounding:
                half, middle = width * math.sqrt(2 * maximum / curvature), tau[s] + offset * width
                intervals[count, 3], intervals[count, 4] = max(middle - half, tau[s]), min(middle + half, tau[s + 1])
                count += 1
        s += 1
    return count


@kernel
def _linear_root(tau: Any, h: Any, s: int) -> float:
    """Return the zero of the line between samples s and s + 1."""
    fraction = h[s] / (h[s] - h[s + 1]) if h[s] != h[s + 1] else 0.5
    return tau[s] + min(max(fraction, 0.0), 1.0) * (tau[s + 1] - tau[s])


@kernel
def _cubic_maximum(begin: float, end: float, a: float, b: float) -> tuple[float, float]:
    """Return position and curvature, as a positive number, of the maximum of a cubic inside of [0, 1]; 0 without one.

    The cubic has values ``begin`` and ``end`` and slopes a and b at 0 and 1. If a and b have one sign, it may have a
    minimum and a maximum between them, as where a gap ends its contact and returns at once.
    """
    if max(begin, end) + 0.25 * (abs(a) + abs(b)) < 0:
        return 0.5, 0.0  # it is negative
    c, d = 3 * (end - begin) - 2 * a - b, 2 * (begin - end) + a + b
    root = math.sqrt(max(c * c - 3 * d * a, 0.0))  # -half of the second derivative at the maximum
    # the root of a + 2 c x + 3 d x^2 at the maximum, in the form without cancellation
    above, below = (-(c + root), 3 * d) if c > 0 else (a, root - c)
    x = above / below if below != 0 else -1.0
    return (x, 2 * root) if 0 < x < 1 else (0.5, 0.0)


@kernel
def _interpolated(h: Any, slope: Any, width: float, x: float) -> float:
    """Return the polynomial of degree 7 through values and slopes at 0, 1, 2, 3 times the width, at x times the width.

    A cubic underestimates the maximum of a motion that turns by .5 rad between samples by 2e-4 of its size, and would
    miss the begin of a contact; this polynomial by 1e-7.
    """
    value = 0.0
    for j in range(4):
        basis, slope_of_basis = 1.0, 0.0
        for k in range(4):
            if k != j:
                basis *= (x - k) / (j - k)
                slope_of_basis += 1.0 / (j - k)
        value += basis * basis * ((1 - 2 * slope_of_basis * (x - j)) * h[j] + (x - j) * width * slope[j])
    return value
