"""Piecewise polynomials over a period and their moments.

    f(theta) = sum_q rows[i][q] (theta - at[i])^q,     at[i] <= theta < at[i + 1]

The harmonics are sums of moments, integrals of polynomials times exponentials,

    int_0^w p(x) exp(-i n x) dx = sum_q [p^(q)(0) - exp(-i n w) p^(q)(w)] / (i n)^(q + 1)

by parts where n w is large. Where n w is small, the terms would cancel; a Gauss rule that is exact to rounding is used
instead. Nothing is truncated: any number of harmonics can be computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array, ComplexArray

TURN = 2 * math.pi
"""Period of the phase [rad]."""

MIN_PHASE_BY_PARTS = 6.0
"""Value of n w [rad] from which moments are computed by parts: each term is then at most a few times the sum."""


_PHASE_ROUNDING = 1e-13
"""Difference of phases that count as equal [rad]."""

_ROW_ROUNDING = 1e-11
"""Difference of coefficients, relative to the largest of their order [-], up to which segments count as equal."""


def rule() -> tuple[Array, Array]:
    """Return nodes and weights (16,) on (0, 1) for moments with n w below `MIN_PHASE_BY_PARTS`."""
    x, w = np.polynomial.legendre.leggauss(16)
    return 0.5 + 0.5 * x, 0.5 * w


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """Piecewise polynomials over one period [0, 2 pi) of a phase.

    Attributes
    ----------
    at : ndarray, shape (T,)
        Beginnings of the segments; the first is 0.
    rows : ndarray, shape (T, D + 1)
        Coefficients of the polynomials.
    """

    at: Array
    rows: Array

    @property
    def widths(self) -> Array:
        """Widths (T,) of the segments."""
        return np.diff(np.append(self.at, TURN))

    @classmethod
    def over_periods(cls, phases: Array, rows: Array, nu: int) -> PiecewisePolynomial:
        """Return a function with segments (P,) of its phase tau over nu periods of it, of the phase tau / nu."""
        n, first = len(phases), float(phases[0])
        turns = math.floor(first / TURN)
        starts = np.concatenate([phases - (turns + 1) * TURN, phases - turns * TURN])  # phases from at or below 0
        start = int(np.searchsorted(starts, 0.0, side="right")) - 1
        starts, rows = starts[start : start + n + 1], np.concatenate([rows, rows])[start : start + n + 1]
        starts[0], rows[0] = 0.0, shift_origin(rows[:1], -starts[:1])[0]
        inside = starts < TURN
        return cls(starts[inside], rows[inside]).repeated(nu)

    def times(self, other: PiecewisePolynomial) -> PiecewisePolynomial:
        """Return the product with another function, on the segments of both."""
        starts, a, b = self._on_segments_of_both(other)
        rows = np.zeros((len(starts), a.shape[1] + b.shape[1] - 1))
        for q in range(a.shape[1]):
            rows[:, q : q + b.shape[1]] += a[:, q : q + 1] * b
        return PiecewisePolynomial(starts, rows)

    def _on_segments_of_both(self, other: PiecewisePolynomial) -> tuple[Array, Array, Array]:
        """Return the phases at which segments of either function start, and the polynomials of both from there on."""
        merged = np.unique(np.concatenate([self.at, other.at]))
        starts = merged[np.diff(merged, prepend=-np.inf) > _PHASE_ROUNDING]
        return starts, self.rows_at(starts), other.rows_at(starts)

    def rows_at(self, starts: Array) -> Array:
        """Return the polynomials from given phases on.

        Each is the polynomial at the middle up to the next phase, because beginnings are equal only to rounding.
        """
        middle = starts + 0.5 * np.diff(np.append(starts, TURN))
        piece = np.searchsorted(self.at, middle, side="right") - 1
        return shift_origin(self.rows[piece], starts - self.at[piece])

    def plus(self, other: PiecewisePolynomial) -> PiecewisePolynomial:
        """Return the sum with another function, on the segments of both."""
        starts, a, b = self._on_segments_of_both(other)
        rows = np.zeros((len(starts), max(a.shape[1], b.shape[1])))
        rows[:, : a.shape[1]] += a
        rows[:, : b.shape[1]] += b
        return PiecewisePolynomial(starts, rows)

    def repeated(self, nu: int) -> PiecewisePolynomial:
        """Return the function over nu of its periods, of the phase theta = tau / nu."""
        theta = (self.at[None, :] + TURN * np.arange(nu)[:, None]) / nu
        return PiecewisePolynomial(
            theta.ravel(), np.tile(self.rows * float(nu) ** np.arange(self.rows.shape[1]), (nu, 1))
        )

    def scaled(self, factor: float) -> PiecewisePolynomial:
        """Return the function times a factor."""
        return PiecewisePolynomial(self.at, factor * self.rows)

    def on(self, starts: Array) -> PiecewisePolynomial:
        """Return the same function with additional beginnings of segments.

        Beginnings that equal others to rounding are merged.
        """
        new = starts[np.abs(starts[:, None] - self.at).min(axis=1) > _PHASE_ROUNDING]
        merged = np.sort(np.concatenate([self.at, new]))
        piece = np.searchsorted(self.at, merged, side="right") - 1
        return PiecewisePolynomial(merged, shift_origin(self.rows[piece], merged - self.at[piece]))

    def integrals(self, count: int, parts: int = 1) -> ComplexArray:
        """Return int_0^theta f exp(-i n x) dx (T + 1, count), n = 0 .. count - 1, over the first of equal parts.

        theta are the beginnings of its T segments and its end. Functions have equal parts by `equal_parts`.
        """
        T = len(self.at) // parts
        at, widths = self.at[:T], np.diff(np.append(self.at[:T], TURN / parts))
        factors = np.exp(-1j * np.outer(at, np.arange(count)))
        out = np.zeros((T + 1, count), dtype=complex)
        np.cumsum(moments(self.rows[:T], widths, count) * factors, axis=0, out=out[1:])
        return out


ONE = PiecewisePolynomial(np.zeros(1), np.ones((1, 1)))
"""The constant function 1."""


def equal_parts(functions: Sequence[PiecewisePolynomial]) -> tuple[list[PiecewisePolynomial], int]:
    """Return functions on segments that begin at parts of the period on which all of them repeat, and their number.

    A mesh of z teeth repeats z times in a revolution. The number is 1 for functions that do not repeat.
    """
    T = len(functions[0].at)
    for number in range(T, 1, -1):
        if T % number and (T - 1) % number:  # a segment through phase 0 is cut there
            continue
        divided = [function.on(TURN * np.arange(number) / number) for function in functions]
        if all(_repeats(function, number) for function in divided):
            return divided, number
    return list(functions), 1


def _repeats(function: PiecewisePolynomial, number: int) -> bool:
    """Return whether segments that begin at equal parts of the period are equal on all parts, to rounding."""
    if len(function.at) % number:
        return False
    at = function.at.reshape(number, -1)
    rows = function.rows.reshape(number, at.shape[1], -1)
    if np.abs(at - at[:, :1] - at[0]).max() > _PHASE_ROUNDING:
        return False
    size = np.abs(rows).max(axis=(0, 1))
    return bool((np.abs(rows - rows[0]).max(axis=(0, 1)) <= _ROW_ROUNDING * size).all())


def moments(rows: Array, widths: Array, count: int) -> ComplexArray:
    """Return int_0^w p(x) exp(-i n x) dx (P, count), n = 0 .. count - 1, of polynomials (P, D + 1) of widths w (P,)."""
    n, (x, weight) = np.arange(count), rule()
    out = np.empty((len(rows), count), dtype=complex)
    for row, w, result in zip(rows, widths, out, strict=True):
        direct = min(count, int(MIN_PHASE_BY_PARTS / w) + 1) if w * (count - 1) > MIN_PHASE_BY_PARTS else count
        p = np.polynomial.polynomial.polyval(w * x, row) * (w * weight)
        result[:direct] = np.exp(-1j * np.outer(n[:direct], w * x)) @ p
        if direct < count:
            start, end = derivatives(np.array([row, row]), np.array([0.0, w]))
            total, power, orders = np.zeros(count - direct, dtype=complex), 1.0 / (1j * n[direct:]), n[direct:]
            factor = power.copy()
            end_factors = np.exp(-1j * w * orders)
            for q in range(len(row)):
                total += factor * (start[q] - end_factors * end[q])
                factor = factor * power
            result[direct:] = total
    return out


def integral(rows: Array, widths: Array) -> float:
    """Return the sum of the integrals of polynomials (P, D + 1) over their widths (P,)."""
    powers = np.arange(1, rows.shape[1] + 1)
    return float(np.sum(rows / powers * widths[:, None] ** powers))


def derivatives(rows: Array, x: Array) -> Array:
    """Return values and all derivatives (P, D + 1) of polynomials (P, D + 1) at x (P,)."""
    return shift_origin(rows, x) * [math.factorial(q) for q in range(rows.shape[1])]


def shift_origin(rows: Array, x: Array) -> Array:
    """Return the coefficients (P, D + 1) of the polynomials p(x + y) in y."""
    out = rows.copy()
    for first in range(rows.shape[1] - 1):
        for q in range(rows.shape[1] - 2, first - 1, -1):
            out[:, q] += x * out[:, q + 1]
    return out


def extremes(rows: Array, widths: Array) -> tuple[float, float]:
    """Return the smallest and the largest value of cubic polynomials (P, 4 or fewer) of widths (P,)."""
    rows = as_cubic(rows)
    candidates = [0 * widths, widths]
    with np.errstate(all="ignore"):
        a, b, c = 3 * rows[:, 3], rows[:, 2], rows[:, 1]  # a x^2 + 2 b x + c = 0
        q = -(b + np.where(b < 0, -1.0, 1.0) * np.sqrt(b * b - a * c))
        for x in (q / a, c / q):
            candidates.append(np.where((x > 0) & (x < widths), x, 0.0))
    x = np.array(candidates)
    values = rows[:, 0] + x * (rows[:, 1] + x * (rows[:, 2] + x * rows[:, 3]))
    return float(values.min()), float(values.max())


def as_cubic(rows: Array) -> Array:
    """Return polynomials (P, D + 1) of degree three or less with four coefficients (P, 4)."""
    out = np.zeros((len(rows), 4))
    out[:, : rows.shape[1]] = rows
    return out
