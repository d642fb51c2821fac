"""Segments between the breakpoints of force laws, and the instants at which a motion leaves its segment.

On its segment a law is smooth, so that a time step that ends at the breakpoint integrates a smooth function.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import Law, PiecewiseLinear
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased

Integers = np.ndarray
"""Array of integers."""

Bools = np.ndarray
"""Array of booleans."""

SAMPLES_PER_STEP = 16
"""Number of samples of a step [-] on which exits from a segment are detected."""

BREAKPOINT_TOLERANCE = 1e-13
"""Distance from a breakpoint, relative to its size [-], that counts as on it."""

ROOT_TOLERANCE = 1e-15
"""Relative tolerance [-] of the instant at which a motion reaches a breakpoint."""


def segment_at(high: Array, d: Array, v: Array) -> Integers:
    """Return the segments of elements at d (..., m) with upper ends ``high`` (..., m, segments).

    On a breakpoint it is the segment into which the rate v leads.
    """
    beyond = d[..., None] - high
    rounding = BREAKPOINT_TOLERANCE * (np.abs(d[..., None]) + np.where(np.isfinite(high), np.abs(high), 0.0))
    return np.sum(np.where(np.abs(beyond) <= rounding, v[..., None] >= 0, beyond > 0), axis=-1)


def single_spring(law: Law) -> PiecewiseLinear | None:
    """Return a law as one piecewise-linear spring, linear on its segments; None if it is not one spring."""
    springs = law.piecewise or ()
    return springs[0] if len(springs) == 1 else None


def stiffness_of(law: Law) -> Phased:
    """Return the stiffness that multiplies the linear segments of a law."""
    spring = single_spring(law)
    return Series(1.0) if spring is None else spring.stiffness


def first_exit(
    x: Array, d: Array, v: Array, low: Array, high: Array, value: Callable[[Integers, Array], Array]
) -> tuple[Array, Integers]:
    """Return where rows first leave (low, high), and through which end.

    d and v (S, K) are values and slopes at the samples x (K,). ``value(rows, x)`` returns the values of rows, each at
    its own x. The extrema between samples are evaluated in addition, so that short excursions beyond a breakpoint are
    detected. The exits (S,) are inf where a row stays inside; the ends (S,) are -1 for low, +1 for high, 0 without
    exit.
    """
    exits, side = np.full(len(d), np.inf), np.zeros(len(d), dtype=int)
    tolerance = BREAKPOINT_TOLERANCE * (1 + np.abs(d).max(axis=1))

    rows, cells = np.nonzero(v[:, :-1] * v[:, 1:] < 0)
    a, b = v[rows, cells], v[rows, cells + 1]
    extrema = x[cells] + (x[cells + 1] - x[cells]) * a / (a - b)
    row = np.concatenate([np.repeat(np.arange(len(d)), len(x)), rows])
    abscissa = np.concatenate([np.tile(x, len(d)), extrema])
    y = np.concatenate([d.ravel(), value(rows, extrema) if rows.size else extrema])
    order = np.lexsort((abscissa, row))
    row, abscissa, y = row[order], abscissa[order], y[order]
    out = (y > high[row] + tolerance[row]).astype(int) - (y < low[row] - tolerance[row])
    out[np.searchsorted(row, np.arange(len(d)))] = 0  # the start is on its segment, to rounding
    outside = np.flatnonzero(out)
    leaving, first = np.unique(row[outside], return_index=True)
    if leaving.size == 0:
        return exits, side
    index = outside[first]
    side[leaving] = out[index]
    level = np.where(side[leaving] > 0, high[leaving], low[leaving])
    before, after = (abscissa[index - 1], y[index - 1] - level), (abscissa[index], y[index] - level)
    exits[leaving] = _bracketed_roots(lambda z: value(leaving, z) - level, before[0], after[0], before[1], after[1])
    return exits, side


def _bracketed_roots(f: Callable[[Array], Array], a: Array, b: Array, fa: Array, fb: Array) -> Array:
    """Return the roots in the intervals (a, b) by the Illinois method.

    Where f(a) has the sign of f(b), a is on the level but for rounding; if f keeps its sign, a is returned to rounding.
    """
    a, b, fa, fb = a.copy(), b.copy(), np.where(fa * fb < 0, fa, -fb), fb.copy()
    for _ in range(60):
        c = b - fb * np.divide(b - a, fb - fa, out=np.zeros_like(b), where=fb != fa)
        fc = f(c)
        crosses = fc * fb < 0
        a, fa = np.where(crosses, b, a), np.where(crosses, fb, 0.5 * fa)
        change = np.abs(c - b)
        b, fb = c, fc
        if np.all((change <= ROOT_TOLERANCE * np.abs(b)) | (fc == 0)):
            break
    return b
