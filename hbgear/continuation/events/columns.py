"""Quantities of points as arrays, one row per point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.continuation.numerics.linear import norms


def unknowns(points: Sequence[CurvePoint]) -> Array:
    """Return the unknowns and parameters u, (P, n + 1), of P points."""
    return np.array([point.u for point in points])


def lengths(points: Sequence[CurvePoint], scale: Array) -> Array:
    """Return the scaled lengths (P - 1,) of the segments between P points."""
    return norms(np.diff(unknowns(points), axis=0) / scale)


def monitored_values(points: Sequence[CurvePoint], name: str) -> Any:
    """Return a monitored quantity of all points, nan where it is unknown.

    The result is None if the quantity is unknown at all points, or its length differs between points.
    """
    values = [point.observed.get(name) for point in points]
    example = next((value for value in values if value is not None), None)
    if example is None:
        return None
    try:
        return np.array([np.full_like(example, np.nan) if value is None else value for value in values])
    except ValueError:  # a closed gap has no breakpoints
        return None
