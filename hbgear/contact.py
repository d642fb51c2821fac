"""Exact harmonic projection of piecewise-linear laws.

A continuous piecewise-linear law is a sum of ramps, g(d) = g0 + s0 d + sum_i D_i max(d - x_i, 0). With theta_j the
instants where d crosses the corner x and sigma_j = +1 on going above it, -1 on going below, the indicator of d > x has

    s_n = (1 / 2 pi) sum_j sigma_j exp(-i n theta_j) / (i n),     s_0 = fraction of the period spent above x

so that with kappa = s0 + sum_i D_i s(x_i) and chi = g0 - sum_i D_i x_i s(x_i), both times the Fourier series of the
stiffness,

    P_k = sum_m kappa_{k-m} d_m + chi_k,        dP/dd = Toeplitz(kappa)      (two-sided coefficients)

No boundary term appears in the derivative because g is continuous. Nothing is sampled: the only discrete
decision is which roots exist, and it is checked at the extrema between grid points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.fourier import Array, ComplexArray, Series, derive, stretch, to_complex, waves
from hbgear.laws import PiecewiseLinear

_ROUNDING = 4e-16  # relative size of a value that is zero


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


def _evaluate(c: ComplexArray, theta: Array, derivatives: int) -> list[Array]:
    """Value and derivatives of row r of c (R, H + 1) at theta[r]."""
    terms = c * waves(theta, c.shape[-1] - 1)
    out = [terms.real.sum(-1)]
    for _ in range(derivatives):
        terms = derive(terms)
        out.append(terms.real.sum(-1))
    return out


def _touching(x: Array, c: ComplexArray, theta: Array, level: Array, rows: np.ndarray) -> tuple[Array, Array, Array]:
    """Double roots a grid hides: extrema between samples that reach past the level although the samples do not.

    Returns row, the instant of the extremum, and the value there relative to the level, for those that do.
    """
    closed = np.concatenate([x[:, -1:], x, x[:, :1]], axis=1)
    left, right = closed[:, :-2], closed[:, 2:]
    # an extremum of a smooth function exceeds its nearest sample by about an eighth of the second difference
    r, i = np.nonzero(np.abs(x) <= np.abs(left - 2 * x + right))
    if r.size == 0:
        return r, np.empty(0), np.empty(0)
    here, left, right = x[r, i], left[r, i], right[r, i]
    toward = (np.abs(here) <= np.abs(left)) & (np.abs(here) <= np.abs(right))
    toward &= (np.sign(here) == np.sign(left)) & (np.sign(here) == np.sign(right))
    r, i = r[toward], i[toward]
    if r.size == 0:
        return r, np.empty(0), np.empty(0)
    at, step = theta[i].copy(), theta[1] - theta[0]
    for _ in range(5):
        _, slope, bend = _evaluate(c[rows[r]], at, 2)
        move = np.divide(-slope, bend, out=np.zeros_like(slope), where=bend != 0)
        at += np.clip(move, -step, step)
    value = _evaluate(c[rows[r]], at, 0)[0] - level[r]
    past = np.sign(value) * np.sign(x[r, i]) < 0
    past &= np.abs(value) > _ROUNDING * (1 + np.abs(level[r]))  # less than rounding is no contact
    past &= np.abs(at - theta[i]) <= step
    return r[past], at[past], value[past]


def crossings(c: ComplexArray, level: Array, rows: np.ndarray, samples: Array) -> Crossings:
    """All instants where row ``rows[l]`` of the functions c crosses ``level[l]``.

    Parameters
    ----------
    c : (m, H + 1) one-sided coefficients of the functions.
    level : (L,) ; rows : (L,) index of the function that belongs to each level.
    samples : (m, N) the functions at theta_n = 2 pi n / N, N of at least 4H.
    """
    N = samples.shape[-1]
    theta = 2 * np.pi * np.arange(N) / N
    x = samples[rows] - level[:, None]
    above = x > 0
    changes = np.empty_like(above)
    changes[:, :-1], changes[:, -1] = above[:, :-1] != above[:, 1:], above[:, -1] != above[:, 0]
    r, i = np.nonzero(changes)
    low, high = theta[i], theta[i] + 2 * np.pi / N
    value_low, value_high = x[r, i], x[r, (i + 1) % N]
    low, high, value_low, value_high, r = _split(c[rows[r]], level[r], low, high, value_low, value_high, r)
    tr, tat, tvalue = _touching(x, c, theta, level, rows)
    if tr.size:  # each hidden extremum gives two brackets, one on either side of it
        step = 2 * np.pi / N
        tat = np.mod(tat, 2 * np.pi)
        before, behind = np.floor(tat / step).astype(int) % N, (np.floor(tat / step).astype(int) + 1) % N
        base = np.floor(tat / step) * step
        r = np.concatenate([r, tr, tr])
        low, high = np.concatenate([low, base, tat]), np.concatenate([high, tat, base + step])
        value_low = np.concatenate([value_low, x[tr, before], tvalue])
        value_high = np.concatenate([value_high, tvalue, x[tr, behind]])
    if r.size == 0:
        return Crossings(r, np.empty(0), r, above[:, 0])
    root = _polish(c[rows[r]], level[r], low, high, value_low, value_high)
    sign = np.where(value_high > value_low, 1, -1)
    order = np.lexsort((root, r))
    return Crossings(r[order], root[order], sign[order], above[:, 0])


_PARTS = 16  # pieces of a cell that may hold three crossings


def _split(
    c: ComplexArray, level: Array, low: Array, high: Array, vlow: Array, vhigh: Array, r: np.ndarray
) -> tuple[Array, Array, Array, Array, np.ndarray]:
    """Brackets with three crossings in place of those cells whose slopes at the ends say that they may hold them.

    The cubic through the values and slopes at the ends has its middle slope 3/2 of the mean slope less a quarter of the
    end slopes; where that runs against the change of sign, the cell is looked at in parts.
    """
    if r.size == 0:
        return low, high, vlow, vhigh, r
    mean = (vhigh - vlow) / (high - low)
    ends = _evaluate(c, low, 1)[1] + _evaluate(c, high, 1)[1]
    doubtful = (1.5 * mean - 0.25 * ends) * mean < 0
    if not doubtful.any():
        return low, high, vlow, vhigh, r
    out = [np.array([low, high, vlow, vhigh])[:, ~doubtful], r[~doubtful]]
    for i in np.flatnonzero(doubtful):
        at = np.linspace(low[i], high[i], _PARTS + 1)
        value = _evaluate(np.broadcast_to(c[i], (len(at), c.shape[-1])), at, 0)[0] - level[i]
        cut = np.flatnonzero((value[:-1] > 0) != (value[1:] > 0))
        out[0] = np.concatenate([out[0], [at[cut], at[cut + 1], value[cut], value[cut + 1]]], axis=1)
        out[1] = np.concatenate([out[1], np.full(len(cut), r[i])])
    return (*out[0], out[1])


def _polish(c: ComplexArray, level: Array, low: Array, high: Array, vlow: Array, vhigh: Array) -> Array:
    """Safeguarded Newton for one root in each bracket."""
    low, high = low.copy(), high.copy()
    rising = vhigh > vlow
    enough = _ROUNDING * (1 + np.abs(level))
    at = low + (high - low) * np.clip(vlow / (vlow - vhigh), 0.0, 1.0)
    for _ in range(60):
        value, slope = _evaluate(c, at, 1)
        value = value - level
        below = (value < 0) == rising
        low, high = np.where(below, at, low), np.where(below, high, at)
        new = at - np.divide(value, slope, out=np.full_like(value, np.inf), where=slope != 0)
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        new = np.where(np.abs(value) <= enough, at, new)  # Newton on rounding near a double root would run away
        done = np.abs(new - at) <= 4e-16 * np.pi
        at = new
        if done.all():
            break
    return at


def indicators(found: Crossings, count: int, order: int) -> ComplexArray:
    """Two-sided coefficients s_n, n = 0..order, of the indicators of d > level, (count, order + 1)."""
    s = np.zeros((count, order + 1), dtype=complex)
    never_crossed = np.ones(count, dtype=bool)
    never_crossed[found.row] = False
    s[never_crossed, 0] = found.above[never_crossed]
    if found.row.size == 0:
        return s
    n = np.arange(1, order + 1)
    terms = found.sign[:, None] * waves(-found.theta, order)[:, 1:] / (2j * np.pi * n)
    gather = np.zeros((count, found.row.size))
    gather[found.row, np.arange(found.row.size)] = 1.0
    s[:, 1:] = gather @ terms
    # time above = sum of (falling - rising) instants, plus a turn if the period starts above
    share = gather @ (-found.sign * found.theta) / (2 * np.pi)
    crossed = ~never_crossed
    s[crossed, 0] = share[crossed] + found.above[crossed]
    return s


def modulate(series: ComplexArray, s: ComplexArray, order: int) -> ComplexArray:
    """Coefficients 0..order of products of real functions, row by row, from two-sided coefficients 0, 1, 2, ...

    Parameters
    ----------
    series : (m, L + 1); s : (..., m, order + L + 1) or longer.
    """
    reach = series.shape[-1] - 1
    out = series[:, :1].real * s[..., : order + 1]
    if reach:
        both = np.concatenate([np.conj(s[..., reach:0:-1]), s], axis=-1)
        for shift in np.flatnonzero(np.any(series[:, 1:], axis=0)) + 1:
            factor = series[:, shift, None]
            out += factor * both[..., reach - shift : reach - shift + order + 1]
            out += np.conj(factor) * both[..., reach + shift : reach + shift + order + 1]
    return out


class ContactProjector:
    """Projection of the piecewise-linear laws of some elements, all at once.

    Parameters
    ----------
    laws : the laws, one per element.
    nu : subharmonic order (a stiffness harmonic l is basis harmonic l nu).
    """

    def __init__(self, laws: list[PiecewiseLinear], nu: int) -> None:
        self.laws = laws
        ramps = [law.ramps for law in laws]
        self.rows = np.repeat(np.arange(len(laws)), [len(changes) for _, changes, _ in ramps])
        self.level = np.concatenate([corners for *_, corners in ramps]) if ramps else np.empty(0)
        self.change = np.concatenate([changes for _, changes, _ in ramps]) if ramps else np.empty(0)
        self.base = np.array([(law.slopes[0], g0) for law, (g0, *_) in zip(laws, ramps, strict=True)])
        series = [_two_sided(law.stiffness, nu) for law in laws]
        self.reach = max((len(row) - 1 for row in series), default=0)
        self.series = np.array([np.pad(row, (0, self.reach + 1 - len(row))) for row in series])

    def project(self, c: ComplexArray, samples: Array, order: int) -> tuple[ComplexArray, ComplexArray, Crossings]:
        """kappa and chi, two-sided coefficients 0..order for each element (m, order + 1), and the crossings found."""
        found = crossings(c, self.level, self.rows, samples)
        s = indicators(found, len(self.level), order + self.reach)
        both = np.zeros((2, len(self.laws), order + self.reach + 1), dtype=complex)
        both[:, :, 0] = self.base.T
        for i, j in enumerate(self.rows):
            both[0, j] += self.change[i] * s[i]
            both[1, j] -= self.change[i] * self.level[i] * s[i]
        kappa, chi = modulate(self.series, both, order)
        return kappa, chi, found


def _two_sided(series: Series, nu: int) -> ComplexArray:
    c = to_complex(stretch(series.row(), nu))
    c[1:] *= 0.5
    return c
