"""Monitored quantities of points, and test functions of their Floquet multipliers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import ComplexArray
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.columns import monitored_values
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.harmonic.multipliers.multiplier_error import is_complex


def multipliers_of(points: Sequence[CurvePoint]) -> ComplexArray | None:
    """Return multipliers (points, r), if any are known."""
    return monitored_values(points, "multipliers")


def multipliers_at(segment: Segment, point: CurvePoint) -> ComplexArray:
    """Return the multipliers of a point, computed if they are unknown."""
    stored: ComplexArray | None = point.observed.get("multipliers")
    return computed_multipliers(segment, point) if stored is None else stored


def computed_multipliers(segment: Segment, point: CurvePoint) -> ComplexArray:
    """Return the multipliers of a point with the harmonics of the curve; known ones may have been refined."""
    values = segment.parameters_at(point.value)
    problem: Any = segment.problem  # a HarmonicBalance, whose events these are
    return problem.multipliers(point.X, points=8, **values)


def count_unstable(mu: ComplexArray) -> np.ndarray:
    """Return the number of unstable multipliers of sets (P, r)."""
    return (np.abs(mu) > 1 + STABILITY_TOLERANCE).sum(axis=1)


def complex_multipliers(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers that are not real."""
    return mu[is_complex(mu)]


def negative_real(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers on the negative real axis, and zero in the place of others."""
    return np.where(~is_complex(mu) & (mu.real < 0), mu, 0.0)


def without_negative_real(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers with zero in the place of those on the negative real axis."""
    return np.where(is_complex(mu) | (mu.real > 0), mu, 0.0)


def unstable_complex_counts(ends: ComplexArray) -> tuple[int, int]:
    """Return the smaller and the larger number of unstable complex multipliers at two ends."""
    smaller, larger = sorted(count_unstable(np.where(is_complex(ends), ends, 0.0)).tolist())
    return smaller, larger


def ranked_modulus(mu: ComplexArray, k: int) -> float:
    """Return the modulus of a rank k from the largest; nan if there are fewer multipliers."""
    sizes = np.sort(np.abs(mu))[::-1]
    return float(sizes[k]) if k < len(sizes) else math.nan
