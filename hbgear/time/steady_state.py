"""Steady-state detection: integrate until the extrapolated remaining distance is below a tolerance.

With the state x_p after p excitation periods and D_k = |x_p - x_{p-k}|, a motion that approaches a motion of period k
like rho^p has the remaining distance

    D_k / (1 - rho^k)

The motion is settled when this distance is below a tolerance. The smallest such k is its period. A motion that does not
settle is classified as not periodic, and its largest Lyapunov exponent is computed. A motion that diverges is no longer
integrated.

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
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.modal_states import StateBatch

WINDOW = 8
"""Number of excitation periods of each of the two windows from which the rate of convergence is estimated [-]."""

FEWEST = 2 * WINDOW + 4
"""Number of excitation periods before the first test [-]: both windows, and the smallest periods."""

OBSERVED = 128
"""Number of excitation periods over which amplitudes of a motion that is not periodic are evaluated [-]."""

MIN_CHAOTIC_GROWTH = 0.02
"""Logarithmic growth of a disturbance per period [-] above which a motion is chaotic."""

_MAX_STORED_NUMBERS = 2**19
"""Largest number of entries [-] of the stored states; they then stay in the cache of the processor."""

_TEST_INTERVAL = 4
"""Number of excitation periods between two tests [-]."""


@dataclass(frozen=True)
class SteadyStateSettings:
    """Conditions under which a motion is settled.

    Attributes
    ----------
    tolerance : float, optional
        Largest remaining distance, relative to the size of the state, from 1e-12 to 1. Default: 1e-7.
    longest : int, optional
        Largest number of excitation periods, at least `FEWEST`. Default: 3000.
    periods : int, optional
        Largest period that is tested, in excitation periods. Default: 16.

    Raises
    ------
    ValueError
        If the tolerance cannot be reached in double precision, a number is out of range, or ``longest`` is too small
        for a test.
    """

    tolerance: float = 1e-7
    longest: int = 3000
    periods: int = 16

    def __post_init__(self) -> None:
        checked("SteadyStateSettings", "tolerance", self.tolerance)
        if not 1e-12 <= self.tolerance < 1:
            raise ValueError(
                f"tolerance = {self.tolerance} cannot be reached in double precision; give a value from 1e-12 to 1"
            )
        counted("periods", self.periods, 1000)
        if counted("longest", self.longest, 1_000_000) < FEWEST:
            raise ValueError(
                f"longest = {self.longest} periods are too few to test whether a motion settles; give {FEWEST} or more"
            )
        if self.periods > self.longest:
            raise ValueError(
                f"periods = {self.periods} exceeds longest = {self.longest}; give a smaller number of periods"
            )


@dataclass(frozen=True, eq=False)
class Settled:
    """Results of the steady-state detection of B motions.

    Attributes
    ----------
    period : ndarray, shape (B,)
        Period in excitation periods; 0 if the motion did not settle.
    integrated_periods : ndarray, shape (B,)
        Number of integrated excitation periods.
    remaining_distance : ndarray, shape (B,)
        Remaining distance, relative to the state, for the period ``likely_period``; inf if the motion diverges or
        does not converge.
    likely_period : ndarray, shape (B,)
        Period with the smallest remaining distance.
    """

    period: np.ndarray
    integrated_periods: np.ndarray
    remaining_distance: Array
    likely_period: np.ndarray


def settle(
    integrator: ExponentialIntegrator, motions: StateBatch, settling: SteadyStateSettings = SteadyStateSettings()
) -> Settled:
    """Integrate motions from tau = 0 until each is settled, in place."""
    out = unsettled(len(motions.d), settling)
    settle_into(out, integrator, motions, settling, None)
    return out


def unsettled(count: int, settling: SteadyStateSettings) -> Settled:
    """Return the results of a number of motions before they are integrated."""
    zeros = np.zeros(count, dtype=int)
    return Settled(zeros, np.full(count, settling.longest), np.full(count, np.nan), zeros.copy())


KnownPeriods = Callable[[Array, Array], np.ndarray]
"""Function of the modal states now and at the test before, see `settle_into`."""


def settle_into(
    out: Settled,
    integrator: ExponentialIntegrator,
    motions: StateBatch,
    settling: SteadyStateSettings,
    progress: Callable[[int, int], None] | None,
    nearby: KnownPeriods | None = None,
) -> None:
    """Integrate motions until each is settled, in place, and store each result as soon as it is known.

    After an interruption, ``out`` and ``motions`` contain the motions that have settled. ``progress(periods, settled)``
    is called after each test. ``nearby(now, before)`` returns the period of a known motion that each motion approaches,
    0 without one, from the modal states now and some periods before. These motions are not integrated further.
    """
    B, r = motions.zeta.shape
    block = max(_MAX_STORED_NUMBERS // (_stored_periods(settling) * r), 64)
    for first in range(0, B, block):
        batch = np.arange(first, min(first + block, B))
        _settle_batch(out, batch, integrator.select(batch), motions, settling, progress, nearby)


def _stored_periods(settling: SteadyStateSettings) -> int:
    """Return the number of periods whose states are stored, a multiple of the test interval."""
    return -(-(2 * WINDOW + settling.periods) // _TEST_INTERVAL) * _TEST_INTERVAL


def _settle_batch(
    out: Settled,
    active: np.ndarray,
    integrator: ExponentialIntegrator,
    motions: StateBatch,
    settling: SteadyStateSettings,
    progress: Callable[[int, int], None] | None,
    nearby: KnownPeriods | None,
) -> None:
    """Integrate the motions ``active`` (B,), with the integrator of these, until each is settled."""
    from hbgear.time.exponential.kernels.periodicity import is_periodic

    part, weights = motions.select(active), integrator.weights()
    history = np.zeros((_stored_periods(settling), *part.zeta.shape))
    history[-1] = part.zeta
    size, p = np.linalg.norm(weights * integrator.to_modal(part), axis=-1), 0
    while p < settling.longest:
        count = min(
            _TEST_INTERVAL * (1 + 2 * WINDOW // _TEST_INTERVAL) if p == 0 else _TEST_INTERVAL, settling.longest - p
        )
        row = p % len(history)
        integrator.stroboscopic_map(part, history[row : row + count])
        p += count
        if p % _TEST_INTERVAL or p < FEWEST:
            continue
        if p < 50:  # the size of a start at rest is zero
            size = np.maximum(size, np.linalg.norm(weights * integrator.to_modal(part), axis=-1))
        tested = is_periodic(history, p, settling.periods, WINDOW, weights, size, settling.tolerance)
        period, distance, likely = tested
        if nearby:
            before = history[(p - _TEST_INTERVAL - 1) % len(history)] - part.zeta  # the steady part is equal at both
            period = np.where(period > 0, period, nearby(integrator.to_modal(part), integrator.to_modal(part) + before))
        diverged = ~np.isfinite(part.zeta).all(axis=-1)
        distance[diverged], period[diverged] = np.inf, 0
        out.remaining_distance[active], out.likely_period[active] = distance, likely
        finished = (period > 0) | diverged
        if finished.any():
            motions.replace(active[finished], part.select(np.flatnonzero(finished)))
            out.integrated_periods[active[finished]] = p
            out.period[active[finished]] = period[finished]
            remaining = np.flatnonzero(~finished)
            if remaining.size:
                active, integrator, part = active[remaining], integrator.select(remaining), part.select(remaining)
                weights = weights if len(weights) == 1 else weights[remaining]
                history, size = np.ascontiguousarray(history[:, remaining]), size[remaining]
        if progress:
            progress(p, int(np.count_nonzero(out.period)))
        if finished.all():
            return
    motions.replace(active, part)


def disturbed(
    integrator: ExponentialIntegrator, motions: StateBatch, ratio: float, random: np.random.Generator
) -> StateBatch:
    """Return the motions with a disturbance of their states, relative to their size, in one random direction."""
    weights, z = integrator.weights(), integrator.to_modal(motions)
    state = random.standard_normal((1, 2 * integrator.structures[0].n))
    direction = integrator.modal(np.tile(state, (len(z), 1)))
    size, unit = (np.array([[np.linalg.norm(x)] for x in weights * states]) for states in (z, direction))
    return integrator.from_modal(z + ratio * (size / unit) * direction)


def growth_rates(integrator: ExponentialIntegrator, motions: StateBatch, periods: int) -> Array:
    """Return the mean logarithmic growth (B,) of a disturbance per period: the largest Lyapunov exponent times T.

        sum_p log(|delta_p| / |delta_0|) / P

    Each motion has a neighbour at a distance of 1e-8, which is rescaled after each period. The first quarter of the
    periods, in which the disturbance turns to the direction of largest growth, is left out. The motions are not
    changed.
    """
    count = len(motions.d)
    indices = np.tile(np.arange(count), 2)
    pair, pair_integrator = motions.select(indices), integrator.select(indices)
    weights = integrator.weights()
    small = 1e-8 * np.maximum(np.linalg.norm(weights * integrator.to_modal(motions), axis=1), 1e-12)
    delta = integrator.modal(np.ones((count, 2 * integrator.structures[0].n)))
    logs = np.empty((periods, count))
    for p in range(periods):
        delta = delta * (small / np.linalg.norm(weights * delta, axis=1))[:, None]
        z = pair_integrator.to_modal(pair)
        z[count:] = z[:count] + delta
        pair = pair_integrator.from_modal(z)
        pair_integrator.advance(pair)
        delta = pair.zeta[count:] - pair.zeta[:count]
        logs[p] = np.log(np.maximum(np.linalg.norm(weights * delta, axis=1), 1e-300) / small)
    return logs[periods // 4 :].mean(axis=0)


def lyapunov(integrator: ExponentialIntegrator, motions: StateBatch, periods: int = 400) -> float:
    """Return the largest Lyapunov exponent of one motion, per unit of time; see `growth_rates`."""
    return float(growth_rates(integrator, motions, periods)[0] * integrator.Omega[0] / (2 * np.pi))
