"""Steps of a period that resolve the slopes of laws evaluated by AFT.

    | int_step f - sum_i int_part_i f | <= 1e-10,   f = dp/dv and h dp/dd, over the inertia of the element

The variational equation is solved by collocation at the Gauss points of steps of length h. Steep places of a law, such
as friction tanh(v / v0) where the velocity reverses, may lie between these points.
"""

from __future__ import annotations

import math

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.multipliers.gauss_points import gauss_rule
from hbgear.harmonic.multipliers.sampled_slopes import slopes_at, vector_slopes_at

MAX_INTEGRAL_CHANGE = 1e-10
"""Change of the integral of a slope over a step that is divided, relative to the inertia of its element, up to which
the step resolves the slope [-]."""

DETECTION_POINTS = 1024
"""Number of Gauss points per excitation period that detect steep places of a law; kinks are known in advance."""

MAX_DIVISIONS = 30
"""Number of successive divisions of a step."""

MAX_DIVIDED_STEPS = 2000
"""Number of steps of a period from which none is divided: slopes that jump everywhere, such as noise."""

MAX_DECAY_PER_POINT = 0.2
"""Exponent by which a damper slows its element down in a step, per Gauss point."""


def resolved_steps(
    compiled: Evaluator, rows: Array, omega: float, mobility: Array, segments: Array, points: int
) -> tuple[Array, list[int]]:
    """Divide the steps of segments in which Gauss points do not resolve the slopes of laws evaluated by AFT.

    A step is divided where the integrals of slopes over it and over its parts differ, or a damper is too strong for
    it. Steps thus become short at steep places of a law, such as friction tanh(v / v0) where the velocity reverses. The
    Gauss points of the parts are as dense as the samples of the balance (at most 1024 per excitation period), and the
    parts at most half of the step.

    Segments (S, 3) have a first phase, the length of their steps in radians, and a number of steps. Return the resolved
    segments (T, 3), and the number of the first new segment of each old one.
    """
    begin = np.concatenate([a + h * np.arange(n) for a, h, n in segments])
    width = np.repeat(segments[:, 1], segments[:, 2].astype(int))
    source = np.repeat(np.arange(len(segments)), segments[:, 2].astype(int))
    steps, done = (begin, width, source), []
    density = min(compiled.N, DETECTION_POINTS * compiled.nu) / (2 * np.pi * points)
    level = math.ceil(math.log2(max(width.max() * density, 2.0)))
    for _ in range(MAX_DIVISIONS):
        coarse_sums, decay = _integrals(compiled, rows, omega, mobility, *steps[:2], points)
        parts = _divided_steps(*steps, 2**level)
        fine_sums = _integrals(compiled, rows, omega, mobility, *parts[:2], points)[0].reshape(
            len(coarse_sums), -1, *coarse_sums.shape[1:]
        )
        stiffness, damping = np.abs(coarse_sums - fine_sums.sum(axis=1)).max(axis=2, initial=0.0).T
        change = np.maximum(stiffness * steps[1] / omega, damping)
        coarse = (change > MAX_INTEGRAL_CHANGE) | (decay > MAX_DECAY_PER_POINT * points)
        done.append(tuple(values[~coarse] for values in steps))
        begin, width, source = (values[coarse] for values in steps)
        steps = _divided_steps(begin, width, source, 2)
        level = max(level - 1, 1)
        if not coarse.any() or sum(len(values[0]) for values in done) + len(steps[0]) > MAX_DIVIDED_STEPS:
            break
    begin, width, source = (np.concatenate(values) for values in zip(*done, steps, strict=True))
    return _merged_segments(begin, width, source, len(segments))


def _divided_steps(begin: Array, width: Array, source: np.ndarray, divisor: int) -> tuple[Array, Array, np.ndarray]:
    """Return the equal parts (T parts,) of steps."""
    width = width / divisor
    start = begin[:, None] + width[:, None] * np.arange(divisor)
    return start.ravel(), np.repeat(width, divisor), np.repeat(source, divisor)


def _integrals(
    compiled: Evaluator, rows: Array, omega: float, mobility: Array, begin: Array, width: Array, points: int
) -> tuple[Array, Array]:
    """Return the integrals (T, 2, channels) of dp/dd and dp/dv over steps, and the largest exponents (T,) of dampers.

    They are divided by the inertia of the elements.
    """
    x, weights = gauss_rule(points)
    theta = (begin[:, None] + width[:, None] * x).ravel()
    blocks = [slopes_at(compiled, rows, omega, theta) * mobility[:, None]]
    for elements, slopes in vector_slopes_at(compiled, rows, omega, theta):
        blocks.append(slopes.reshape(2, -1, len(theta)) * mobility[elements].max())
    slopes = np.concatenate(blocks, axis=1).reshape(2, -1, len(begin), len(x))
    time = width / omega
    return np.moveaxis(slopes @ weights * time, 2, 0), np.abs(slopes[1]).max(axis=(0, 2), initial=0.0) * time


def _merged_segments(begin: Array, width: Array, source: np.ndarray, count: int) -> tuple[Array, list[int]]:
    """Return segments (T, 3) of successive steps of one length, and the first one of each of ``count`` old segments."""
    order = np.argsort(begin, kind="stable")
    begin, width, source = begin[order], width[order], source[order]
    first = np.flatnonzero(np.append(True, (np.abs(np.diff(width)) > 1e-9 * width[1:]) | (np.diff(source) != 0)))
    number = np.diff(np.append(first, len(begin)))
    segments = np.column_stack([begin[first], width[first], number.astype(float)])
    return segments, [int(np.argmax(source[first] == i)) for i in range(count)]
