"""Kernels: samples, value, slopes and extrema of a Fourier row.

    x(theta) = Re sum_k c_k exp(i k theta)

The one-sided coefficients c of a row are those of `fourier.to_complex`.
"""

from __future__ import annotations

import math
from typing import Any

from hbgear.common.process.compiling import kernel


@kernel
def fill_one_sided(row: Any, c: Any) -> None:
    """Store the one-sided coefficients of a real row (2H + 1,) in the first entries of c."""
    c[0] = row[0]
    for k in range(1, row.shape[0] // 2 + 1):
        c[k] = complex(row[2 * k - 1], -row[2 * k])


@kernel
def sampled(row: Any, basis: Any, out: Any) -> None:
    """Store the samples (N,) of a real row in ``out``; basis (2H + 1, N) holds the basis functions."""
    for n in range(out.shape[0]):
        out[n] = row[0]
    for k in range(1, row.shape[0]):
        a = row[k]
        if a != 0.0:
            for n in range(out.shape[0]):
                out[n] += a * basis[k, n]


@kernel
def value_of(c: Any, level: float, theta: float) -> tuple[float, float, float]:
    """Return x - level, x' and x'' at theta."""
    x, y = math.cos(theta), math.sin(theta)
    p = q = r = s = t = u = 0.0  # real and imaginary parts take half the time of complex numbers
    for k in range(c.shape[0] - 1, 0, -1):
        t, u = (t * x + r) - u * y, (t * y + s) + u * x
        r, s = (r * x + p) - s * y, (r * y + q) + s * x
        p, q = (p * x + c[k].real) - q * y, (p * y + c[k].imag) + q * x
    z, f, g, h = complex(x, y), complex(p, q), complex(r, s), complex(t, u)
    # sum c_k z^k = z f;  its derivatives by i theta: z (f + z g),  z (f + 3 z g + 2 z^2 h)
    first, second = z * (f + z * g), z * (f + z * (3.0 * g + 2.0 * z * h))
    return (z * f).real + (c[0].real - level), -first.imag, -second.real


@kernel
def coefficient(kappa: Any, c: Any, k: int) -> complex:
    """Return the two-sided coefficient k of a product of real functions: kappa is two-sided, c one-sided."""
    x, y = kappa[k].real * c[0].real, kappa[k].imag * c[0].real
    for n in range(1, c.shape[0]):
        r, s = kappa[abs(k - n)].real, kappa[abs(k - n)].imag
        if k < n:
            s = -s
        a, b, p, q = 0.5 * c[n].real, 0.5 * c[n].imag, kappa[k + n].real, kappa[k + n].imag
        x += (r + p) * a - (s - q) * b
        y += (r - p) * b + (s + q) * a
    return complex(x, y)


@kernel
def bend_of(c: Any) -> float:
    """Return an upper bound of |x''|."""
    total = 0.0
    for k in range(1, c.shape[0]):
        total += k * k * math.sqrt(c[k].real * c[k].real + c[k].imag * c[k].imag)  # abs takes five times as long
    return total


@kernel
def size_of(c: Any) -> float:
    """Return the largest real or imaginary part of the coefficients, the size of x within a factor."""
    largest = 0.0
    for k in range(c.shape[0]):
        largest = max(largest, abs(c[k].real), abs(c[k].imag))
    return largest


@kernel
def highest(c: Any, samples: Any, side: float) -> tuple[float, float]:
    """Return the largest value of side x, side +1 or -1, over a period, and its phase.

    Newton's method starts at every sample that can be the nearest to the maximum.
    """
    N = samples.shape[0]
    step, size, largest_sample = 2 * math.pi / N, 0.0, _largest(samples, side)
    for k in range(c.shape[0]):
        size += abs(c[k].real) + abs(c[k].imag)
    margin = 0.125 * step * step * bend_of(c)
    if not margin > 1e-14 * size:  # a constant has its extremum anywhere
        return side * samples[0], 0.0
    largest, theta_max = largest_sample, 0.0
    for n in range(N):
        value = side * samples[n]
        if value < largest_sample - margin:
            continue  # lower than the maximum can be
        before, after = side * samples[n - 1], side * samples[n + 1 - N]
        if value < before or value < after:
            continue  # a neighbouring sample is higher
        difference = before - 2.0 * value + after
        theta = step * (n + 0.5 * (before - after) / difference) if difference < 0.0 else step * n
        for _ in range(16):
            _, slope, curvature = value_of(c, 0.0, theta)
            correction = side * slope / abs(curvature) if abs(curvature) > 1e-300 else 0.0  # |curve|: always uphill
            correction = min(0.5 * step, max(-0.5 * step, correction))
            theta += correction
            if abs(correction) <= 1e-6:  # the next correction is quadratically smaller
                break
        x_max = side * value_of(c, 0.0, theta)[0]
        if x_max > largest or value == largest:
            largest, theta_max = max(x_max, largest), theta
    return largest, theta_max


@kernel
def _largest(samples: Any, side: float) -> float:
    """Return the largest of side times the samples; four independent maxima run faster than one."""
    N = samples.shape[0]
    a = side * samples[0]
    b = c = d = a
    for n in range(0, N - 3, 4):
        a, b = max(a, side * samples[n]), max(b, side * samples[n + 1])
        c, d = max(c, side * samples[n + 2]), max(d, side * samples[n + 3])
    for n in range(N - N % 4, N):
        a = max(a, side * samples[n])
    return max(max(a, b), max(c, d))


@kernel
def extremes(c: Any, samples: Any, low: Any, at_low: Any, high: Any, at_high: Any) -> None:
    """Compute the extrema (P,) of rows c (P, H + 1) and their phases (P,), given samples (P, N)."""
    for p in range(c.shape[0]):
        high[p], at_high[p] = highest(c[p], samples[p], 1.0)
        low[p], at_low[p] = highest(c[p], samples[p], -1.0)
        low[p] = -low[p]
