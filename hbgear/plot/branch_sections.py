"""Sections of a curve with the same line style: one impact regime of an element and one stability state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.equations.layout import layout_of
from hbgear.plot.style import State, regime_of


def states(branch: Branch, element: int | str) -> list[State]:
    """Return the regime of the element and the stability at each point."""
    stable_by_word: dict[str, bool | str] = {
        "stable": True,
        "neutral": True,
        "unstable": False,
        "undecided": "undecided",
    }
    stable = [stable_by_word.get(state) for state in branch.stability]
    layout = layout_of(branch)
    return [(regime_of(layout, codes, element), s) for codes, s in zip(branch.regime, stable, strict=True)]


def sections(branch: Branch, element: int | str) -> list[tuple[State, int, int]]:
    """Return sections ``(state, first point, last point)`` of one regime and stability, which share their end points.

    A special point ends a section: the segment after it has the state of its other end.
    """
    point_states = states(branch, element)
    borders = {point.index for point in branch.special}
    runs = [(point_states[0], 0, 0)] if len(point_states) == 1 else []
    for i in range(len(point_states) - 1):
        state = point_states[i + 1] if i in borders and i + 1 not in borders else point_states[i]
        if runs and runs[-1][0] == state:
            runs[-1] = (state, runs[-1][1], i + 1)
        else:
            runs.append((state, i, i + 1))
    return runs


HEADROOM = 2.0
"""Ratio of the upper limit of the axes to the largest bounded amplitude, for a curve that goes to infinity."""


CONSTANT_RANGE = 1e-8
"""Range of values, relative to the largest one, that is rounding errors: residuals of points are up to 1e-10."""


def bounded_points(branch: Branch) -> slice:
    """Return the points of a branch up to its last special points before it goes to infinity."""
    marks = [point.index for point in branch.special]
    first = min(marks, default=len(branch) - 1) if "first" in branch.asymptotes else 0
    last = max(marks, default=0) if "last" in branch.asymptotes else len(branch) - 1
    return slice(min(first, last), max(first, last) + 1)


def bounded(branch: Branch, amplitude: Array) -> float:
    """Return the largest amplitude of the `bounded_points` of a branch."""
    return float(amplitude[bounded_points(branch)].max())


class SmoothCurve:
    """A line through the points of a curve without visible corners: Akima interpolation along the polygon.

    Parameters
    ----------
    x, y : ndarray, shape (P,)
        Coordinates of the points. A curve with unknown values is drawn as the polygon of the others.

    Examples
    --------
    >>> import numpy as np
    >>> angle = np.linspace(0, np.pi, 9)
    >>> x, y = SmoothCurve(np.cos(angle), np.sin(angle)).between(0, 8)
    >>> bool(np.abs(np.hypot(x, y) - 1).max() < 0.005), len(x)
    (True, 65)
    """

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y
        xy = np.stack([x, y])
        if not np.isfinite(xy).all():
            self.along = np.zeros(0)
            return
        ranges, sizes = np.ptp(xy, axis=1, keepdims=True), np.abs(xy).max(axis=1, keepdims=True)
        steps = np.hypot(*np.diff(xy / np.where(ranges > CONSTANT_RANGE * sizes, ranges, np.inf), axis=1))
        self.along = np.concatenate([[0.0], np.cumsum(steps)])
        self.xy, self.distinct = xy, np.concatenate([[True], steps > _COINCIDENCE])

    def between(self, first: int, last: int, enlarged: float = 1.0) -> tuple[Array, Array]:
        """Return the coordinates of the line from one point to another, with chords for a factor of enlargement."""
        points = slice(first, last + 1)
        if last - first < 2 or not len(self.along) or self.distinct.sum() < 5:
            return self.x[points], self.y[points]
        knots = self.along[points]
        chord_counts = np.ceil(np.diff(knots) / (_LONGEST_CHORD / enlarged)).clip(1, _MOST_CHORDS).astype(int)
        positions = np.append(
            np.repeat(knots[:-1], chord_counts) + _division_points(np.diff(knots), chord_counts), knots[-1]
        )
        x, y = akima(self.along[self.distinct], self.xy[:, self.distinct], positions)
        corners = np.concatenate([[0], np.cumsum(chord_counts)])
        x[corners], y[corners] = self.x[points], self.y[points]
        return x, y


def akima(knots: Array, values: Array, at: Array) -> Array:
    """Return the Akima interpolation (c, A) of values (c, K) at increasing knots (K,), at positions (A,) between them.

    The slope at a knot is the mean of the slopes of both segments there. The weight of each is the change of slope on
    the other side. `scipy.interpolate` is not used, because importing it takes longer than drawing a curve.
    """
    steps = np.diff(knots)
    inner = np.diff(values) / steps
    before, after = (2 * near - far for near, far in ((inner[:, 0], inner[:, 1]), (inner[:, -1], inner[:, -2])))
    slopes = np.column_stack([2 * before - inner[:, 0], before, inner, after, 2 * after - inner[:, -1]])
    changes = np.abs(np.diff(slopes))
    left, right = changes[:, :-2], changes[:, 2:]
    total = left + right
    is_bent = total > 1e-9 * total.max()
    weight = np.where(is_bent, left / np.where(is_bent, total, 1.0), 0.0)
    bent = slopes[:, 1:-2] + weight * (slopes[:, 2:-1] - slopes[:, 1:-2])
    at_knots = np.where(is_bent, bent, 0.5 * (slopes[:, :-3] + slopes[:, 3:]))
    k = np.searchsorted(knots, at, "right").clip(1, len(steps)) - 1
    s, h = ((at - knots[k]) / steps[k]).clip(0.0, 1.0), steps[k]
    departure = s * (1 - s) * ((1 - s) * (at_knots[:, k] - inner[:, k]) - s * (at_knots[:, k + 1] - inner[:, k])) * h
    return values[:, k] + s * inner[:, k] * h + departure


def _division_points(lengths: Array, counts: NDArray[np.int64]) -> Array:
    """Return the distances from the start of each segment that divide it into equal parts."""
    return np.concatenate([length * np.arange(n) / n for length, n in zip(lengths, counts, strict=True)])


_LONGEST_CHORD, _MOST_CHORDS = 0.004, 8
"""Length of the chords of a drawn line, relative to the range of its values, and the most chords of a segment."""

_COINCIDENCE = 1e-9
"""Distance, relative to the range of the values, below which two points are one."""
