"""All steady motions at one frequency: stable ones from sampled basins, unstable ones by deflation, and what may miss.

    sum over all motions of period nu or a divisor of it, each with its shifted copies, of (-1)^n = 1

n is the number of real multipliers of nu periods above +1. The sum of these indices of the fixed points of the
stroboscopic map is 1 (Brouwer degree) if all motions stay in a bounded region, as with damping. Another sum proves that
motions are missing. The number of motions that no start reached is estimated from those that one or two starts reached,

    unseen = f_1 (f_1 - 1) / (2 (f_2 + 1))                        f_i motions that exactly i starts reached

References
----------
Farrell, Birkisson & Funke (2015), SIAM J. Sci. Comput. 37(4), https://doi.org/10.1137/140984798, for deflation.
Chao (1984), Scand. J. Stat. 11(4), 265-270, https://www.jstor.org/stable/4615964, for the estimate.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbgear.analysis.branch_search.multistart import problem_point, random_motions, shifts
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.deflation import deflated_newton, same_solution
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import coefficients_of, to_real
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.modal_states import StateBatch
from hbgear.time.integration import state_of
from hbgear.time.steady_state import SteadyStateSettings, settle

_REAL = 1e-9
"""Imaginary part of a multiplier, relative to its modulus, up to which it is real."""


_MAX_ROUNDS = 4
"""Largest number of rounds of deflation [-] for one period, while the sum of indices shows that motions are missing."""


@dataclass(frozen=True, eq=False)
class SteadyMotion:
    """One periodic motion.

    Attributes
    ----------
    point : Point
        Point of a harmonic balance, from which `hbgear.trace` starts.
    period : int
        Period in excitation periods.
    stable : bool
        Whether all multipliers lie within the unit circle.
    share : float
        Fraction of the sampled starts whose motions approach it; 0 of unstable motions.
    hits : int
        Number of starts that reached it, of time integration and of Newton's method together.

    Examples
    --------
    >>> import hbgear as hb
    >>> states = hb.time.steady_states(hb.Duffing(zeta=0.2), 1.0, starts=5, guesses=2, periods=1)
    >>> (motion,) = states.motions
    >>> motion.period, motion.stable, motion.share
    (1, True, 1.0)
    """

    point: Point
    period: int
    stable: bool
    share: float
    hits: int


@dataclass(frozen=True, eq=False)
class SteadyStates:
    """Steady motions at one frequency.

    Attributes
    ----------
    Omega : float
        Excitation frequency.
    motions : tuple of SteadyMotion
        Periodic motions: the stable ones first, the most frequent first.
    aperiodic : float
        Fraction of the sampled starts whose motions did not become periodic, or diverged.
    indices : dict of int to int
        Sum of the indices of the motions for each searched period; 1 if no motion is missing by this test.
    unseen : float
        Estimated number of motions that no start reached.

    Examples
    --------
    >>> import hbgear as hb
    >>> states = hb.time.steady_states(hb.Duffing(zeta=0.2), 1.0, starts=5, guesses=2, periods=1)
    >>> [(motion.period, motion.stable) for motion in states.motions], states.missing
    ([(1, True)], 0)
    """

    Omega: float
    motions: tuple[SteadyMotion, ...]
    aperiodic: float
    indices: dict[int, int]
    unseen: float

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def points(self) -> tuple[Point, ...]:
        """Points of the motions, for ``trace_all(..., motions=...)``."""
        return tuple(motion.point for motion in self.motions)

    @property
    def missing(self) -> int:
        """Number of motions that are missing at least by the sums of indices; 0 if they are all 1."""
        return max(abs(1 - total) for total in self.indices.values())


@checked_arguments()
def steady_states(
    model: Model,
    Omega: float,
    *,
    harmonics: int = 20,
    starts: int = 60,
    guesses: int = 30,
    periods: int = 2,
    extent: float | None = None,
    seed: int = 0,
    settling: SteadyStateSettings = SteadyStateSettings(tolerance=1e-6, longest=1000),
) -> SteadyStates:
    """Search for all steady motions at one frequency: stable ones by time integration, unstable ones by deflation.

    Motions from random states are integrated until they are periodic; each attractor is refined by harmonic balance.
    Deflated Newton's method then starts from random motions for every period up to ``periods`` and those found.

    Parameters
    ----------
    model : Model
        Model without friction sliders.
    Omega : float
        Excitation frequency, > 0.
    harmonics : int, optional
        H, number of harmonics for each excitation period. Default: 20.
    starts : int, optional
        Number of states from which motions are integrated. Default: 60.
    guesses : int, optional
        Number of starts of deflated Newton's method for each period. Default: 30. The search is repeated up to three
        times while the sum of indices shows that motions are missing.
    periods : int, optional
        Longest period, in excitation periods, of the search by deflation. Default: 2.
    extent : float, optional
        Largest displacement of the states [length of the model]. By default three times the larger one of the linear
        response and the largest breakpoint of a law; 3 if both are zero.
    seed : int, optional
        Seed of the random starts. Default: 0.
    settling : SteadyStateSettings, optional
        Conditions under which a motion is periodic.

    Returns
    -------
    SteadyStates
        Motions with their stability and shares, the sums of indices, and the estimated number of unseen motions.

    Raises
    ------
    ValueError
        If the model has friction sliders, or a number is out of range.

    Examples
    --------
    Between its folds the Duffing oscillator has three motions:

    >>> import hbgear as hb
    >>> states = hb.time.steady_states(hb.Duffing(), 1.102, harmonics=7, starts=20, guesses=6, periods=1)
    >>> [motion.stable for motion in states.motions], states.indices
    ([True, True, False], {1: 1})
    """
    checked("steady_states", "Omega", Omega, POSITIVE)
    counted("starts", starts, 100_000)
    counted("guesses", guesses, 100_000, least=0)
    counted("periods", periods, 64)
    if extent is not None:
        checked("steady_states", "extent", extent, POSITIVE)
    search = _Search(HarmonicBalance(model, harmonics), float(Omega), np.random.default_rng(seed))
    search.sample(starts, extent, settling)
    for nu in sorted({*range(1, periods + 1), *(motion.period for motion in search.motions)}):
        search.deflate(nu, guesses)
    return search.result(starts)


@dataclass(eq=False)
class _Motion:
    """A motion in the basis of its own period, with its multipliers and the numbers of starts that reached it."""

    X: Array
    period: int
    multipliers: Array
    sampled: int = 0
    guessed: int = 0

    @property
    def stable(self) -> bool:
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0)

    def index(self, nu: int) -> int:
        """Return the index of the motion for the map of nu periods."""
        mu = self.multipliers ** (nu // self.period)
        above = (np.abs(mu.imag) <= _REAL * np.abs(mu)) & (mu.real > 1.0)
        return 1 - 2 * (int(np.count_nonzero(above)) % 2)


class _Search:
    """Motions found so far."""

    def __init__(self, problem: HarmonicBalance, Omega: float, rng: np.random.Generator) -> None:
        self.problem, self.Omega, self.rng = problem, Omega, rng
        self.motions: list[_Motion] = []
        self.aperiodic = 0

    # ---- stable motions

    def sample(self, starts: int, extent: float | None, settling: SteadyStateSettings) -> None:
        """Integrate motions from random states and refine each periodic attractor by harmonic balance."""
        integrator = ExponentialIntegrator(self.problem.model, self.Omega)
        motions = integrator.start(self._random_states(starts, extent))
        settled = settle(integrator, motions, settling)
        self.aperiodic = int(np.count_nonzero(settled.period == 0))
        attractors: list[tuple[int, Array, _Motion | None]] = []
        z = integrator.weights() * integrator.to_modal(motions)

        def is_near(states: Array, state: Array) -> bool:
            size = max(float(np.linalg.norm(states, axis=1).max()), 1e-9)
            return bool(np.linalg.norm(states - state, axis=1).min() < 100 * settling.tolerance * size)

        for i in np.flatnonzero(settled.period > 0):
            period = int(settled.period[i])
            matches = [entry for entry in attractors if entry[0] == period and is_near(entry[1], z[i])]
            if not matches:
                d, states = self._recorded(integrator, motions.select(np.array([i])), period)
                matches = [(period, states, self._refined(d, period))]
                attractors += matches
            motion = matches[0][2]
            if motion is not None:
                motion.sampled += 1

    def _random_states(self, count: int, extent: float | None) -> Array:
        """Return random states (count, 2n) of sizes up to ``extent``."""
        try:
            state = state_of(self.problem, self.problem.start(self.Omega), Omega=self.Omega)
        except NoConvergence:
            state = np.zeros(2 * self.problem.model.system().n)
        n = len(state) // 2
        levels = [abs(x) for breakpoints in self.problem.layout.breakpoints for x in breakpoints if np.isfinite(x)]
        size = extent or 3.0 * max([float(np.abs(state[:n]).max()), *levels]) or 3.0
        scale = size * self.rng.uniform(0.0, 1.0, (count, 1))
        unit = self.rng.uniform(-1.0, 1.0, (count, 2 * n))
        unit[:, n:] *= self.Omega
        return scale * unit

    @staticmethod
    def _recorded(integrator: ExponentialIntegrator, motion: StateBatch, period: int) -> tuple[Array, Array]:
        """Return displacements (m, T) over one period of a motion, and its weighted modal states (period, 2 q)."""
        states, samples = [], []
        for _ in range(period):
            states.append((integrator.weights() * integrator.to_modal(motion))[0])
            fine = integrator.advance(motion, 1, record=True)
            assert fine is not None
            samples.append(fine[0][0])
        return np.concatenate(samples, axis=1), np.array(states)

    def _refined(self, d: Array, period: int) -> _Motion | None:
        """Return the motion of the harmonic balance near displacements (m, T) over its period; None without one."""
        problem = self._problem(period)
        try:
            X = solve(problem, to_real(coefficients_of(d, problem.H)).ravel(), self._at()).X
        except NoConvergence:
            self.aperiodic += 1
            return None
        return self._add(X, period)

    # ---- other motions

    def deflate(self, nu: int, guesses: int) -> None:
        """Search for further motions of nu periods by deflated Newton's method from random starts."""
        for _ in range(_MAX_ROUNDS):
            self._deflate_once(nu, guesses)
            if self.index(nu) == 1:
                break

    def index(self, nu: int) -> int:
        """Return the sum of the indices of all motions of nu periods or a divisor of nu."""
        return sum(motion.index(nu) * len(self._copies(motion, nu)) for motion in self.motions)

    def _deflate_once(self, nu: int, guesses: int) -> None:
        """Search from random motions, and from random points between two known motions, where unstable ones lie."""
        problem = self._problem(nu)
        solutions = [Y for motion in self.motions for Y in self._copies(motion, nu)]
        starts = random_motions(problem, solutions, guesses, self.rng)
        for i in range(1, guesses if len(solutions) > 1 else 0, 2):
            first, second = self.rng.choice(len(solutions), 2, replace=False)
            starts[i] = solutions[first] + self.rng.uniform(0.2, 0.8) * (solutions[second] - solutions[first])
        for guess in starts:
            X = deflated_newton(problem, guess, self._at(), [])
            if X is not None:
                self._reached(X, nu).guessed += 1
            solutions = [Y for motion in self.motions for Y in self._copies(motion, nu)]
            X = deflated_newton(problem, guess, self._at(), solutions)
            if X is not None:
                self._reached(X, nu).guessed += 1

    def _reached(self, X: Array, nu: int) -> _Motion:
        """Return the motion of a solution in the basis of nu periods; it is added if it is new."""
        for motion in self.motions:
            if any(same_solution(X, Y) for Y in self._copies(motion, nu)):
                return motion
        period = nu
        for divisor in (k for k in range(1, nu) if nu % k == 0):
            shortened = self._shortened(X, nu, divisor)
            if shortened is not None:
                X, period = shortened, divisor
                break
        return self._add(X, period)

    def _shortened(self, X: Array, nu: int, period: int) -> Array | None:
        """Return a motion of nu periods in the basis of a shorter period; None if it does not have this period."""
        problem, short_problem = self._problem(nu), self._problem(period)
        rows = problem.rows(X)
        step = nu // period
        c = rows[:, 1::2] - 1j * rows[:, 2::2]
        remainder = np.delete(c, np.arange(step - 1, c.shape[1], step), axis=1)
        if np.linalg.norm(remainder) > 1e-7 * (1e-6 + np.linalg.norm(X)):
            return None
        coefficients = np.column_stack([rows[:, 0], c[:, step - 1 :: step]])[:, : short_problem.H + 1]
        try:
            return solve(short_problem, to_real(coefficients).ravel(), self._at()).X
        except NoConvergence:
            return None

    # ---- common

    def _at(self) -> dict[str, float]:
        return {**self.problem.parameters, "Omega": self.Omega}

    def _problem(self, nu: int) -> HarmonicBalance:
        return self.problem if nu == 1 else self.problem.with_order(nu, nu * self.problem.H)

    def _copies(self, motion: _Motion, nu: int) -> list[Array]:
        """Return a motion and its copies shifted by excitation periods in the basis of nu periods, if it has one."""
        if nu % motion.period:
            return []
        problem, own_problem = self._problem(nu), self._problem(motion.period)
        return [problem.from_layout(Y, own_problem.layout) for Y in shifts(own_problem, motion.X)]

    def _add(self, X: Array, period: int) -> _Motion:
        """Return the motion of a solution; a new motion is added to the list."""
        problem = self._problem(period)
        for motion in self.motions:
            if motion.period == period and any(same_solution(X, Y) for Y in self._copies(motion, period)):
                return motion
        self.motions.append(_Motion(X, period, problem.multipliers(X, Omega=self.Omega)))
        return self.motions[-1]

    def result(self, starts: int) -> SteadyStates:
        """Return all motions found."""
        orders = sorted({motion.period for motion in self.motions} | {1})
        indices = {nu: self.index(nu) for nu in orders}
        motions = [
            SteadyMotion(
                replace(problem_point(self._problem(m.period), m.X, self.Omega), multipliers=m.multipliers),
                m.period,
                m.stable,
                m.sampled / starts,
                m.sampled + m.guessed,
            )
            for m in self.motions
        ]
        motions.sort(key=lambda motion: (not motion.stable, -motion.share, -motion.hits))
        return SteadyStates(
            self.Omega, tuple(motions), self.aperiodic / starts, indices, unseen([motion.hits for motion in motions])
        )


def unseen(hits: Sequence[int]) -> float:
    """Return the estimated number of motions that no start reached, from the numbers of starts that reached each."""
    count = Counter(hits)
    return count[1] * (count[1] - 1) / (2.0 * (count[2] + 1))
