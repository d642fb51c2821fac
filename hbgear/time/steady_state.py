"""Settled motions: integrate until what is still to go is below a tolerance, not for a fixed number of periods.

With x_p the state after p excitation periods and D_k = |x_p - x_{p-k}|, a motion of period k that is approached like
rho^p is still

    D_k / (1 - rho^k)

away; it is settled when that is below a tolerance. The smallest such k is the period. A motion that never settles is
called not periodic and gets its largest Lyapunov exponent. One that runs away beyond all numbers is given up.

References
----------
Benettin, Galgani, Giorgilli & Strelcyn (1980), Meccanica 15, https://doi.org/10.1007/BF02128236, for the exponent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import checked, counted
from hbgear.time.exponential.integrator import ExponentialIntegrator, StateBatch

WINDOW = 8
"""Periods over which the rate of approach is judged, twice."""

FEWEST = 2 * WINDOW + 4
"""Periods after which motions are judged for the first time."""

OBSERVED = 128
"""Periods a motion that is not periodic is observed for."""


@dataclass(frozen=True)
class SteadyStateSettings:
    """When a motion counts as settled.

    tolerance : distance it may still have to go, relative to the size of the state.
    longest : excitation periods after which it is given up, at least `FEWEST`.
    periods : largest period, in excitation periods, that is looked for.

    Raises
    ------
    ValueError
        If the tolerance is beyond double precision, a number is out of range, or no motion could be judged in so few
        periods.
    """

    tolerance: float = 1e-7
    longest: int = 3000
    periods: int = 16

    def __post_init__(self) -> None:
        checked("Settling", "tolerance", self.tolerance)
        if not 1e-12 <= self.tolerance < 1:
            raise ValueError(f"tolerance = {self.tolerance} cannot be met in double precision; need 1e-12 to 1")
        counted("periods", self.periods, 1000)
        if counted("longest", self.longest, 1_000_000) < FEWEST:
            raise ValueError(
                f"longest = {self.longest} periods are too few to tell whether a motion settles; need {FEWEST} or more"
            )
        if self.periods > self.longest:
            raise ValueError(f"need 1 <= periods <= longest, got periods = {self.periods}, longest = {self.longest}")


@dataclass(frozen=True, eq=False)
class Settled:
    """How B motions settled.

    period : (B,) in excitation periods, 0 if it did not. taken : (B,) excitation periods integrated.
    left : (B,) distance still to go relative to the state, for the period ``guess`` (B,) that is nearest to settling;
        inf where the motion runs away or comes no nearer.
    """

    period: np.ndarray
    taken: np.ndarray
    left: Array
    guess: np.ndarray


def settle(
    integrator: ExponentialIntegrator,
    motions: StateBatch,
    settling: SteadyStateSettings = SteadyStateSettings(),
    progress: Callable[[int, int], None] | None = None,
) -> Settled:
    """Carry motions at tau = 0 on until each is settled, in place.

    ``progress(periods, settled)`` is called now and then.
    """
    out = unsettled(len(motions.d), settling)
    settle_into(out, integrator, motions, settling, progress)
    return out


def unsettled(count: int, settling: SteadyStateSettings) -> Settled:
    """What is known of motions before they are integrated."""
    none = np.zeros(count, dtype=int)
    return Settled(none, np.full(count, settling.longest), np.full(count, np.nan), none.copy())


Caught = Callable[[Array, Array], np.ndarray]


def settle_into(
    out: Settled,
    integrator: ExponentialIntegrator,
    motions: StateBatch,
    settling: SteadyStateSettings,
    progress: Callable[[int, int], None] | None,
    caught: Caught | None = None,
) -> None:
    """`settle`, noting each motion in out once it is settled: if this is interrupted, those and their places hold.

    ``caught(now, before)`` may give the periods of known motions that others, from their modal states now and some
    periods before, are certain to settle on, 0 for none: these need not be waited for.
    """
    B, r = motions.zeta.shape
    together = max(_ROOM // (_kept(settling) * r), 64)
    for first in range(0, B, together):
        batch = np.arange(first, min(first + together, B))
        _settle_batch(out, batch, integrator.select(batch), motions, settling, progress, caught)


_ROOM = 2**19  # numbers of past states kept at once: what stays close to the processor


_EVERY = 4  # periods between two judgements


def _kept(settling: SteadyStateSettings) -> int:
    """Periods whose states are kept, a multiple of _EVERY."""
    return -(-(2 * WINDOW + settling.periods) // _EVERY) * _EVERY


def _settle_batch(
    out: Settled,
    going: np.ndarray,
    part: ExponentialIntegrator,
    motions: StateBatch,
    settling: SteadyStateSettings,
    progress: Callable[[int, int], None] | None,
    caught: Caught | None,
) -> None:
    """`settle_into` for the motions going (B,), whose integrator is given."""
    from hbgear.time.exponential.periodicity_kernel import is_periodic

    here, weights = motions.select(going), part.weights()
    past = np.zeros((_kept(settling), *here.zeta.shape))
    past[-1] = here.zeta
    size, p = np.linalg.norm(weights * part.to_modal(here), axis=-1), 0
    while p < settling.longest:
        count = min(_EVERY * (1 + 2 * WINDOW // _EVERY) if p == 0 else _EVERY, settling.longest - p)
        at = p % len(past)
        part.stroboscopic_map(here, past[at : at + count])
        p += count
        if p % _EVERY or p < FEWEST:
            continue
        if p < 50:  # a start at rest says nothing of the size
            size = np.maximum(size, np.linalg.norm(weights * part.to_modal(here), axis=-1))
        period, left, guess = (np.empty(len(going), dtype=kind) for kind in (np.int64, float, np.int64))
        is_periodic(past, p, settling.periods, WINDOW, weights, size, settling.tolerance, period, left, guess)
        if caught:
            before = past[(p - _EVERY - 1) % len(past)] - here.zeta  # the steady part is the same at both
            period = np.where(period > 0, period, caught(part.to_modal(here), part.to_modal(here) + before))
        lost = ~np.isfinite(here.zeta).all(axis=-1)
        left[lost], period[lost] = np.inf, 0
        out.left[going], out.guess[going] = left, guess
        done = (period > 0) | lost
        if done.any():
            motions.replace(going[done], here.select(np.flatnonzero(done)))
            out.taken[going[done]] = p
            out.period[going[done]] = period[done]
            keep = np.flatnonzero(~done)
            if keep.size:
                going, part, here = going[keep], part.select(keep), here.select(keep)
                weights = weights if len(weights) == 1 else weights[keep]
                past, size = np.ascontiguousarray(past[:, keep]), size[keep]
        if progress:
            progress(p, int(np.count_nonzero(out.period)))
        if done.all():
            return
    motions.replace(going, here)


def disturbed(
    integrator: ExponentialIntegrator, motions: StateBatch, share: float, random: np.random.Generator
) -> StateBatch:
    """Motions a little beside: by a share of their states, all in one random direction."""
    weights, z = integrator.weights(), integrator.to_modal(motions)
    one = random.standard_normal((1, 2 * integrator.structures[0].n))
    beside = integrator.modal(np.tile(one, (len(z), 1)))
    size, unit = (np.array([[np.linalg.norm(x)] for x in weights * states]) for states in (z, beside))
    return integrator.from_modal(z + share * (size / unit) * beside)


def lyapunov(integrator: ExponentialIntegrator, motions: StateBatch, periods: int = 400) -> float:
    """Largest Lyapunov exponent of one motion, per unit of time, from a neighbour pulled close after every period.

        lambda = lim (1 / t) sum_p log(|delta_p| / |delta_0|)

    The first quarter of the periods, in which the disturbance turns to the direction that grows fastest, is left out.
    The motions itself is not changed.
    """
    weights = integrator.weights()
    pair = motions.select(np.array([0, 0]))
    small = 1e-8 * (float(np.linalg.norm(weights * integrator.to_modal(motions)[0])) or 1.0)
    delta = integrator.modal(np.ones((1, 2 * integrator.structures[0].n)))[0]
    logs = []
    for _ in range(periods):
        delta = delta * (small / np.linalg.norm(weights * delta))
        z = integrator.to_modal(pair)
        z[1] = z[0] + delta
        pair = integrator.from_modal(z)
        integrator.advance(pair)
        delta = pair.zeta[1] - pair.zeta[0]
        logs.append(np.log(np.linalg.norm(weights * delta) / small))
    return float(np.mean(logs[periods // 4 :]) * integrator.Omega[0] / (2 * np.pi))
