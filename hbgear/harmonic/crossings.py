"""Instants at which a periodic motion crosses the corners of a law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import cos, pi, sin

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.fourier import waves as harmonic_waves

_ROUNDING = 4e-16  # relative size of a value that is zero


_CLOSE = 4e-16 * np.pi  # distance of instants that are the same


@dataclass(frozen=True)
class Crossings:
    """Instants at which rows of harmonics cross their levels.

    row (R,) which of the levels; theta (R,) in [0, 2 pi], ascending within a row; sign (R,) +1 upwards, -1 downwards.
    above (L,) whether the function starts above its level at theta = 0.
    """

    row: np.ndarray
    theta: Array
    sign: np.ndarray
    above: np.ndarray


def crossings(c: ComplexArray, level: Array, rows: np.ndarray, samples: Array) -> Crossings:
    """All instants where row ``rows[l]`` of the functions c crosses ``level[l]``.

    Parameters
    ----------
    c : (m, H + 1) one-sided coefficients of the functions.
    level : (L,) ; rows : (L,) index of the function that belongs to each level.
    samples : (m, N) the functions at theta_n = 2 pi n / N, N of at least 4H.
    """
    N = samples.shape[-1]
    x = np.empty((len(level), N + 1))  # the first sample again after the last
    np.subtract(samples[rows], level[:, None], out=x[:, :-1])
    x[:, -1] = x[:, 0]
    above = x > 0
    # no second derivative is larger, and no second difference of neighbouring samples larger than that times step^2
    bend = (np.abs(c) @ np.arange(c.shape[-1]) ** 2)[rows]
    changes = np.nonzero(above[:, 1:] != above[:, :-1])
    near = np.nonzero(np.abs(x[:, :-1]) <= ((2 * np.pi / N) ** 2 * bend)[:, None])
    found: list[tuple[int, float, int]] = []
    if near[0].size:
        toward = _toward(x, *near)
        near = tuple(place[toward] for place in near)
    if len(changes[0]) > _FEW:
        found, left = _roots(c[rows], level, bend, x, *changes)
        changes = tuple(place[left] for place in changes)
    waves: dict[int, _Wave] = {}
    for places, instants in ((changes, _in_cell), (near, _beside)):
        for row, i in zip(*(place.tolist() for place in places), strict=True):
            if row not in waves:
                waves[row] = _Wave(c[rows[row]].tolist(), float(level[row]), float(bend[row]))
            found += [(row, theta, sign) for theta, sign in instants(waves[row], x[row], i)]
    found.sort()
    lines, thetas, signs = zip(*found, strict=True) if found else ((), (), ())
    return Crossings(np.array(lines, dtype=int), np.array(thetas, dtype=float), np.array(signs, dtype=int), above[:, 0])


_FEW = 12  # crossings up to which one after the other costs less than all at once


def _toward(x: Array, row: np.ndarray, i: np.ndarray) -> np.ndarray:
    """Whether x[row, i] is an extremum of three neighbours that may reach past zero between them.

    The extremum of a smooth function exceeds its nearest sample by about an eighth of the second difference.
    """
    here, left, right = x[row, i], x[row, np.where(i, i, x.shape[1] - 1) - 1], x[row, i + 1]
    toward = ((left - here) * here >= 0) & ((right - here) * here >= 0) & (here != 0)
    near: Array = toward & (np.abs(here) <= np.abs(left - 2 * here + right))
    return near


def _roots(
    c: ComplexArray, level: Array, bend: Array, x: Array, line: np.ndarray, cell: np.ndarray
) -> tuple[list[tuple[int, float, int]], np.ndarray]:
    """`_in_cell` of many cells at once; and which are left to it: those that may hold three crossings, and rare others.

    Halley's method from the chord of a cell, without a safeguard but looked at in the end.
    """
    N, K = x.shape[1] - 1, c.shape[-1]
    step, table, order = 2 * np.pi / N, _table(N, K - 1), 1j * np.arange(K)
    c, level, bend, first, last = c[line], level[line], bend[line], x[line, cell], x[line, cell + 1]
    parts = np.empty((len(c), 3, K), dtype=complex)  # of the value, the slope and the curvature
    parts[:, 0], parts[:, 1], parts[:, 2] = c, order * c, order * order * c
    ends = np.array([table[cell], table[cell + 1]]).transpose(1, 2, 0)
    slopes = (parts[:, 1:2] @ ends).real.sum(axis=(1, 2))
    mean = (last - first) / step
    left = (1.5 * mean - 0.25 * slopes) * mean < 0
    low = step * cell
    at = low + step * first / (first - last)
    with np.errstate(all="ignore"):
        for _ in range(6):
            value, slope, curvature = (parts @ harmonic_waves(at, K - 1)[..., None])[..., 0].real.T
            newton = (value - level) / slope
            change = newton / (1 - 0.5 * newton * curvature / slope)
            at = at - change
            rest = bend * change / slope  # Halley's next step is smaller than its square times this one
            settled = (np.abs(rest) < 0.5) & (rest * rest * np.abs(change) <= _CLOSE)
            if (settled | left).all():
                break
        left |= ~(settled & (at >= low) & (at <= low + step))
    sign = np.where(last > first, 1, -1)
    found = zip(line[~left].tolist(), at[~left].tolist(), sign[~left].tolist(), strict=True)
    return list(found), left


@lru_cache(maxsize=32)
def _table(N: int, H: int) -> ComplexArray:
    """exp(i k theta_n) on the grid and at its end, (N + 1, H + 1)."""
    return harmonic_waves(2 * np.pi / N * np.arange(N + 1), H)


class _Wave:
    """A function less its level, Re sum_k c_k exp(i k theta) - level, at one theta after the other.

    Plain numbers and Horner's rule: for the few roots of a motion, calls of NumPy would cost more than the sums.
    """

    def __init__(self, c: list[complex], level: float, bend: float) -> None:
        self.backwards = c[:0:-1]
        self.mean = c[0].real - level
        self.bend = bend
        self.rounding = _ROUNDING * (1 + abs(level))

    def __call__(self, theta: float) -> tuple[float, float]:
        """Value and slope."""
        z = complex(cos(theta), sin(theta))
        p = slope = 0j
        for c in self.backwards:
            slope = slope * z + p
            p = p * z + c
        return (p * z).real + self.mean, -((slope * z + p) * z).imag

    def extremum(self, theta: float, step: float) -> float:
        """Where the slope vanishes near theta: Newton with steps of at most step."""
        slopes = [1j * k * c for k, c in enumerate(self.backwards[::-1], 1)]
        derivative = _Wave([0j, *slopes], 0.0, 0.0)
        at = theta
        for _ in range(5):
            slope, bend = derivative(at)
            at += min(step, max(-step, -slope / bend)) if bend else 0.0
        return at


_Instants = list[tuple[float, int]]
"""Crossings of one function: theta, and +1 upwards or -1 downwards."""


_PARTS = 16  # pieces of a cell that may hold three crossings


def _in_cell(wave: _Wave, x: Array, i: int) -> _Instants:
    """Crossings between samples i and i + 1, whose signs differ: one, or three.

    The cubic through the values and slopes at the ends has its middle slope 3/2 of the mean slope less a quarter of the
    end slopes; where that runs against the change of sign, the cell is looked at in parts.
    """
    step = 2 * pi / (len(x) - 1)
    low, high, first, last = step * i, step * (i + 1), float(x[i]), float(x[i + 1])
    slopes = wave(low)[1], wave(high)[1]
    mean = (last - first) / step
    if (1.5 * mean - 0.25 * (slopes[0] + slopes[1])) * mean >= 0:
        return [_root(wave, (low, first, slopes[0]), (high, last, slopes[1]))]
    at = [low + (high - low) * k / _PARTS for k in range(_PARTS + 1)]
    ends = [(theta, *wave(theta)) for theta in at]
    return [_root(wave, a, b) for a, b in pairwise(ends) if (a[1] > 0) != (b[1] > 0)]


def _beside(wave: _Wave, x: Array, i: int) -> _Instants:
    """Two crossings that samples i - 1, i, i + 1 hide: an extremum between them reaches past the level."""
    step = 2 * pi / (len(x) - 1)
    at = wave.extremum(step * i, step)
    value = wave(at)[0]
    past = value * float(x[i]) < 0 and abs(value) > wave.rounding  # less than rounding is no contact
    if not past or abs(at - step * i) > step:
        return []
    low = at % (2 * pi) // step * step
    at %= 2 * pi
    return [_root(wave, (a, *wave(a)), (b, *wave(b))) for a, b in ((low, at), (at, low + step))]


def _root(wave: _Wave, a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, int]:
    """Root between a and b (theta, value, slope each), whose values differ in sign, by safeguarded Newton."""
    (low, value_low, _), (high, value_high, _) = a, b
    rising = value_high > value_low
    at = _guess(a, b)
    for _ in range(60):
        value, slope = wave(at)
        if abs(value) <= wave.rounding:  # Newton on rounding near a double root would run away
            break
        if (value < 0) == rising:
            low = at
        else:
            high = at
        new = at - value / slope if slope else low
        move = abs(new - at)
        if slope and (move <= _CLOSE or wave.bend * move * move <= _CLOSE * abs(slope)):  # Newton leaves half of that
            at = min(max(new, low), high)
            break
        at = new if low < new < high else 0.5 * (low + high)
    return at, 1 if rising else -1


def _guess(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """Root of theta as a cubic of the value through both ends with their slopes; of the chord if that is no guess."""
    (low, value_low, slope_low), (high, value_high, slope_high) = a, b
    u, mean = value_low / (value_low - value_high), (value_high - value_low) / (high - low)
    s = u
    if mean * slope_low > 0 and mean * slope_high > 0:
        s = u * (u * (3 - 2 * u) + (1 - u) * ((1 - u) * mean / slope_low - u * mean / slope_high))
    return low + (high - low) * (s if 0 < s < 1 else u)
