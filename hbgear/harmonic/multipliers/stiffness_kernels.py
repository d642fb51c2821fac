"""Kernels of the stiffness of elements along a motion: its values in a period, and the orders of its harmonics.

    dp/dd (theta) of element j at the gap d_j(theta): slopes of springs, times periodic stiffness, and 3 cubic d^2

The motion is given by its harmonics c_k, and summed by Horner's rule at all phases at once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel
from hbgear.harmonic.forces.piecewise_kernels import add_contact, add_segments, fill_gap, multiply_stiffness

MODULATION_SAMPLES = 32
"""Phases of an excitation period at which the size of the modulations is sampled."""


@kernel
def circle(count: int) -> Any:
    """Return equally spaced phases of a period with their cosines and sines (3, count)."""
    out = np.empty((3, count))
    for i in range(count):
        theta = 2 * math.pi * i / count
        out[0, i], out[1, i], out[2, i] = theta, math.cos(theta), math.sin(theta)
    return out


@kernel
def add_stiffness(packed: Any, c: Any, j: int, phases: Any, T: int, work: Any, out: Any) -> None:
    """Add dp/dd of element j at the first T phases (3, ...) of `circle` to ``out``; c as in `fill_gap`.

    work (6, ...) is overwritten.
    """
    laws = packed.laws
    gap, slope, factor, motion = work[2], work[3], work[4], work[5]
    _sum_series(c, phases, T, work, gap)
    for n in range(T):
        motion[n] = gap[n]
    add_segments(packed.piecewise, j, phases[0], T, gap)
    for n in range(T):
        out[n] += laws.cubic[j, 0] + 3 * laws.cubic[j, 1] * gap[n] * gap[n]
    for s in range(laws.spring_element.shape[0]):
        if laws.spring_element[s] != j:
            continue
        if laws.spring_displacement[s] != j:
            add_contact(packed.piecewise, laws, s, motion, phases[0], T, out)
            continue
        _slope(laws, s, gap, T, slope)
        multiply_stiffness(packed.piecewise, s, phases[0], T, slope)
        _modulation(laws.shifts, laws.series[s], phases, T, work, factor)
        for n in range(T):
            out[n] += slope[n] * factor[n]


@kernel
def _slope(laws: Any, s: int, gap: Any, T: int, out: Any) -> None:
    """Compute the slope of a spring of the packed laws, without its stiffness factor."""
    for n in range(T):
        out[n] = laws.base[s, 0]
    for r in range(laws.ramp_breakpoint.shape[0]):
        if laws.ramp_spring[r] == s:
            level, change = laws.level[laws.ramp_breakpoint[r]], laws.slope_change[r]
            for n in range(T):
                out[n] += change if gap[n] > level else 0.0


@kernel
def _sum_series(c: Any, phases: Any, T: int, work: Any, out: Any) -> None:
    """Compute Re sum_k c_k z^k at all phases (3, T) by Horner's rule; work has at least two rows."""
    x, y = work[0], work[1]
    for n in range(T):
        x[n] = y[n] = 0.0
    for k in range(c.shape[0] - 1, 0, -1):
        _horner_step(c[k], phases, T, x, y)
    for n in range(T):
        out[n] = c[0].real + x[n]


@kernel
def _modulation(shifts: Any, series: Any, phases: Any, T: int, work: Any, out: Any) -> None:
    """Compute the real part of a series with two-sided coefficients at the given shifts, as in `_sum_series`."""
    x, y = work[0], work[1]
    for n in range(T):
        x[n] = y[n] = 0.0
    for i in range(shifts.shape[0] - 1, 0, -1):
        for k in range(shifts[i] - shifts[i - 1]):
            _horner_step(2.0 * series[i] if k == 0 else 0j, phases, T, x, y)
    for n in range(T):
        out[n] = series[0].real + x[n]


@kernel
def _horner_step(c: complex, phases: Any, T: int, x: Any, y: Any) -> None:
    """Replace x + i y by (x + i y + c) z at all phases."""
    a, b, u, v = c.real, c.imag, phases[1], phases[2]
    for n in range(T):
        p, q = x[n] + a, y[n] + b
        x[n] = p * u[n] - q * v[n]
        y[n] = p * v[n] + q * u[n]


@inlined
def modulation_rate(packed: Any, coefficients: Any, mobility: Any, coarse: Any, c: Any, work: Any, k: Any) -> float:
    """Return an estimate of the largest natural frequency due to the modulations [rad per unit of time]; 0 if none.

    Its square is the largest product, over all elements, of the inverse modal mass and the largest stiffness of the law
    at the phases ``coarse``, with all sliders. c (H + 1,), work (6, T) and k (T,) are overwritten.
    """
    largest_square, T = 0.0, coarse.shape[1]
    for j in range(coefficients.shape[0]):
        for i in range(T):
            k[i] = 0.0
        fill_gap(packed.piecewise, coefficients[j], j, c)
        add_stiffness(packed, c, j, coarse, T, work, k)
        stiffness = packed.linear.springs[0, j]
        for i in range(T):
            stiffness = max(stiffness, abs(k[i]))
        stiffness += _slider_stiffness(packed.sliders, j)
        largest_square = max(largest_square, mobility[j] * stiffness)
    return math.sqrt(largest_square)


@kernel
def _slider_stiffness(sliders: Any, j: int) -> float:
    """Return the stiffness of the sliders of element j that stick."""
    total = 0.0
    if sliders is not None:
        for i in range(sliders.element.shape[0]):
            if sliders.element[i] == j:
                total += sliders.k[i]
    return total


@kernel
def slopes(packed: Any, X: Any, out: Any) -> None:
    """Add dp/dd (P, m, T) of motions X (P, n) at T equally spaced phases of the period to ``out``, initially zero."""
    m, T = out.shape[1], out.shape[2]
    phases, work, c = circle(T), np.empty((6, T)), np.empty(X.shape[1] // (2 * m) + 1, np.complex128)
    for p in range(X.shape[0]):
        coefficients = X[p].reshape(m, -1)
        for j in range(m):
            fill_gap(packed.piecewise, coefficients[j], j, c)
            add_stiffness(packed, c, j, phases, T, work, out[p, j])


SMALLEST_RESOLVED_HARMONIC = 1e-9
"""Amplitude of a harmonic of the stiffness, relative to the mean or largest one, below which steps ignore it."""


@kernel
def modulation_order(packed: Any, coefficients: Any, c: Any, exponent: float) -> float:
    """Return the largest n a^exponent of the harmonics n of the stiffness with relative amplitudes a.

    These are the harmonics of periodic stiffness, and products of harmonics of the displacement of cubic springs.
    s Gauss points integrate a harmonic over the angle phi = n h of a step with an error of a phi^(2 s + 1), times the
    constant of `MODE_TURN_PER_SQUARED_POINTS`, so that the exponent is 1 / (2 s + 1). c (H + 1,) is overwritten.
    """
    laws, order, size = packed.laws, 0.0, np.empty(c.shape[0])
    for s in range(laws.series.shape[0]):
        mean = abs(laws.series[s, 0])
        for i in range(1, laws.shifts.shape[0]):
            a = 2 * abs(laws.series[s, i]) / max(mean, 1e-300)
            if a > SMALLEST_RESOLVED_HARMONIC:
                order = max(order, laws.shifts[i] * min(a, 1.0) ** exponent)
    for j in range(coefficients.shape[0]):
        if laws.cubic[j, 1] == 0.0:
            continue
        fill_gap(packed.piecewise, coefficients[j], j, c)
        largest = 0.0
        for k in range(c.shape[0]):
            largest = max(largest, abs(c[k]))
        for k in range(c.shape[0]):
            a = abs(c[k]) / max(largest, 1e-300)
            size[k] = a**exponent if a > SMALLEST_RESOLVED_HARMONIC else 0.0
            for i in range(k + 1):
                order = max(order, (i + k) * size[i] * size[k])
    return order
