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

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import checked, counted
from hbgear.timedomain.exponential import Flight, Stepper, modal_state

WINDOW = 8
"""Periods over which the rate of approach is judged, twice."""

FEWEST = 2 * WINDOW + 4
"""Periods after which motions are judged for the first time."""

OBSERVED = 128
"""Periods a motion that is not periodic is observed for."""


@dataclass(frozen=True)
class Settling:
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
    stepper: Stepper,
    flight: Flight,
    settling: Settling = Settling(),
    progress: Callable[[int, int], None] | None = None,
) -> Settled:
    """Carry motions at tau = 0 on until each is settled, in place.

    ``progress(periods, settled)`` is called now and then.
    """
    out = unsettled(len(flight.d), settling)
    settle_into(out, stepper, flight, settling, progress)
    return out


def unsettled(count: int, settling: Settling) -> Settled:
    """What is known of motions before they are integrated."""
    none = np.zeros(count, dtype=int)
    return Settled(none, np.full(count, settling.longest), np.full(count, np.nan), none.copy())


def settle_into(
    out: Settled, stepper: Stepper, flight: Flight, settling: Settling, progress: Callable[[int, int], None] | None
) -> None:
    """`settle`, noting each motion in out once it is settled: if this is interrupted, those and their places hold."""
    B = len(flight.d)
    weights = mode_weights(stepper)
    going, part, here = np.arange(B), stepper, flight
    past: list[ComplexArray] = []  # strobed states, the latest first
    gaps: list[Array] = []  # D_k (K, B) of the last periods, the latest first
    size = np.linalg.norm(weights * stepper.land(flight), axis=-1)
    for p in range(settling.longest + 1):
        x = weights * here.zeta
        gaps = [_gaps(x, past, settling.periods), *gaps[: 2 * WINDOW - 1]]
        past = [x, *past[: settling.periods - 1]]
        if p % 4 == 0 and p >= FEWEST:
            if p < 50:  # a start at rest says nothing of the size
                size = np.maximum(size, np.linalg.norm(weights * part.land(here), axis=-1))
            period, left, guess = _judge(np.array(gaps), size, settling)
            lost = ~np.isfinite(x).all(axis=-1)
            left[lost] = np.inf
            out.left[going], out.guess[going] = left, guess
            done = (period > 0) | lost
            if done.any():
                flight.put(going[done], here.select(np.flatnonzero(done)))
                out.taken[going[done]] = p
                out.period[going[done]] = period[done]
                keep = np.flatnonzero(~done)
                if keep.size == 0:
                    return
                going, part, here = going[keep], part.select(keep), here.select(keep)
                weights = weights if len(weights) == 1 else weights[keep]
                past, gaps, size = [x[keep] for x in past], [g[:, keep] for g in gaps], size[keep]
            if progress:
                progress(p, B - len(going))
        if p < settling.longest:
            part.advance(here)
    flight.put(going, here)


def mode_weights(stepper: Stepper) -> Array:
    """Size of the motion each mode stands for, in coordinates scaled by the root of their mass: (rows or 1, r)."""
    each = []
    for structure in stepper.structures:
        assert structure.modes is not None
        each.append(np.linalg.norm(np.sqrt(np.abs(np.diag(structure.M)))[:, None] * structure.modes.right, axis=0))
    of_each: Array = np.array(each)[stepper.of]
    return of_each


def _gaps(x: ComplexArray, past: Sequence[ComplexArray], periods: int) -> Array:
    """D_k for k = 1..periods (K, B), inf where the past is too short."""
    out = np.full((periods, len(x)), np.inf)
    for k, before in enumerate(past):
        out[k] = np.linalg.norm(x - before, axis=-1)
    return out


def _judge(gaps: Array, size: Array, settling: Settling) -> tuple[np.ndarray, Array, np.ndarray]:
    """Period of each motion (0: not settled), distance still to go, and the period that is nearest to settling.

    gaps (2 windows, K, B), the latest first.
    """
    k = np.arange(1, gaps.shape[1] + 1)[:, None]
    new, old = gaps[:WINDOW].max(axis=0), gaps[WINDOW:].max(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.minimum((new / old) ** (1.0 / WINDOW), 1.0)
        left = np.where(np.isfinite(new) & (rho < 1), new / (1 - rho**k), np.inf) / size
    left[new <= 1e-14 * size] = 0.0
    settled = left <= settling.tolerance
    best = np.argmin(left, axis=0)
    first = np.argmax(settled, axis=0)
    # a multiple of the period closes before the period does; what is that small is the period
    same = new <= 30 * settling.tolerance * size
    period = np.where(
        settled.any(axis=0), np.minimum(first, np.where(same.any(axis=0), np.argmax(same, axis=0), first)) + 1, 0
    )
    return period, left[best, np.arange(len(best))], best + 1


def lyapunov(stepper: Stepper, flight: Flight, periods: int = 400) -> float:
    """Largest Lyapunov exponent of one motion, per unit of time, from a neighbour pulled close after every period.

        lambda = lim (1 / t) sum_p log(|delta_p| / |delta_0|)

    The first quarter of the periods, in which the disturbance turns to the direction that grows fastest, is left out.
    The flight itself is not changed.
    """
    weights, structure = mode_weights(stepper), stepper.structures[0]
    pair = flight.select(np.array([0, 0]))
    small = 1e-8 * (float(np.linalg.norm(weights * stepper.land(flight)[0])) or 1.0)
    delta = modal_state(structure, np.ones(2 * structure.n))
    logs = []
    for _ in range(periods):
        delta = delta * (small / np.linalg.norm(weights * delta))
        z = stepper.land(pair)
        z[1] = z[0] + delta
        pair = stepper.fly(z)
        stepper.advance(pair)
        delta = pair.zeta[1] - pair.zeta[0]
        logs.append(np.log(np.linalg.norm(weights * delta) / small))
    return float(np.mean(logs[periods // 4 :]) * stepper.Omega[0] / (2 * np.pi))
