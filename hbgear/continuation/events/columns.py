"""Quantities of points as arrays, one row per point, stored with points that do not change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint, Points
from hbgear.continuation.numerics.linear import norms


def column(points: Sequence[CurvePoint], name: Any, make: Callable[[], Any]) -> Any:
    """Return the result of ``make`` for points; `Points`, which do not change, store it under the name."""
    return points.column(name, make) if isinstance(points, Points) else make()


def unknowns(points: Sequence[CurvePoint]) -> Array:
    """Return the unknowns and parameters u, (P, n + 1), of P points."""
    u: Array = column(points, "u", lambda: np.array([point.u for point in points]))
    return u


def lengths(points: Sequence[CurvePoint], scale: Array) -> Array:
    """Return the scaled lengths (P - 1,) of the segments between P points."""

    def make() -> Array:
        u = unknowns(points)
        return norms((u[1:] - u[:-1]) / scale)

    out: Array = column(points, ("lengths", scale.tobytes()), make)
    return out


def monitored_values(points: Sequence[CurvePoint], name: str) -> Any:
    """Return a monitored quantity of all points, nan where it is unknown.

    The result is None if the quantity is unknown at all points, or its length differs between points.
    """
    return column(points, name, lambda: _stacked_values(points, name))


def _stacked_values(points: Sequence[CurvePoint], name: str) -> Any:
    """Return a monitored quantity of all points as an array; see `monitored_values`."""
    values = [point.observed.get(name) for point in points]
    example = next((value for value in values if value is not None), None)
    if example is None:
        return None
    try:
        return np.array([np.full_like(example, np.nan) if value is None else value for value in values])
    except ValueError:  # a closed gap has no breakpoints
        return None
