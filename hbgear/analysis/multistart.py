"""Every branch in a span, also those that do not touch each other.

Continuation finds only what hangs together. Further motions at chosen frequencies are sought by deflated Newton, which
is repelled by the motions already known,

    M(X) R(X) = 0,   M = prod_i (1 + 1 / |X - X_i|^2),     step  dX / (1 - (grad log M)^T dX),  dX = -J^-1 R

and by following known ones in a second parameter and back. What is new is traced.

References
----------
Farrell, Birkisson & Funke (2015), SIAM J. Sci. Comput. 37(4), A2026, https://doi.org/10.1137/140984798.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination, TraceInterrupted, raise_if_interrupted
from hbgear.continuation.solvers.deflation import deflated_newton, same_solution
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, solve
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.coverage import trace_both_directions
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.series.fourier import to_complex, to_real


@dataclass(frozen=True)
class BranchSearch:
    """What `trace_all` found: branches, how it looked, line by line, and whether it looked everywhere.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 3)
    >>> found = hb.trace_all(problem, (0.8, 1.2), frequencies=[1.0], guesses=2)
    >>> found.status.complete, len(found.log) > 0
    (True, True)
    """

    branches: tuple[Branch, ...]
    log: tuple[str, ...]
    status: Status = Status.REACHED_END
    message: str = ""

    def __len__(self) -> int:
        return len(self.branches)

    def __getitem__(self, i: int) -> Branch:
        return self.branches[i]


@checked_arguments(
    frequencies="how many places to look at, or a list of frequencies",
    second="a name and its range, such as ('zeta', (0.05, 0.2))",
)
def trace_all(
    problem: HarmonicBalance,
    span: tuple[float, float],
    *,
    frequencies: Sequence[float] | int = 5,
    guesses: int = 20,
    second: tuple[str, tuple[float, float]] | None = None,
    seed: int = 0,
    steps: StepControl = StepControl(),
    stability: bool = True,
    progress: ProgressCallback | None = None,
) -> BranchSearch:
    """Every branch of periodic motions in a span of Omega that the searches below find.

    The branches that start from the linear response at both ends are traced first. At each frequency deflated Newton
    then starts from ``initial_guesses`` random motions of different size and phase; with ``second`` the known motions
    there
    are also followed through a range of another parameter, and wherever that curve returns to the model's value a
    motion is taken. Every motion that lies on no branch yet is traced in its turn. A motion and its copies shifted by
    whole periods of the excitation are one.

    Parameters
    ----------
    problem : `HarmonicBalance`; with nu > 1 subharmonic branches are found as well.
    span : of Omega.
    frequencies : where to look, or how many places spread over the span.
    guesses : random starts at each frequency.
    second : ``(name, (low, high))`` of a model parameter to go through and back.
    seed : of the random starts; the same seed finds the same branches.
    steps, stability : as for `trace`.
    progress : called with a `Progress` as work goes on, such as ``print``; how far it is cannot be told.

    Returns
    -------
    Survey
        Ctrl-C or an error ends it with the branches found until then, the one at work as far as it was traced;
        ``status`` and ``message`` say so.

    Raises
    ------
    ValueError
        If no frequency lies within the span, or the number of harmonics varies.
    KeyboardInterrupt
        If Ctrl-C comes before anything is traced.

    Examples
    --------
    >>> import hbgear as hb
    >>> isola = hb.HarmonicBalance(hb.Duffing(zeta=0.01, k3=1, F=3), 5, nu=3)
    >>> found = hb.trace_all(isola, (4.5, 3.5), frequencies=[4.0], guesses=4)
    >>> len(found.branches) >= 1
    True
    """
    problem.require_fixed_resolution("a survey")
    low, high = sorted(map(float, span))
    counted("guesses", guesses, 100_000, least=0)
    places = _places(frequencies, low, high)
    search = _Search(problem, (float(span[0]), float(span[1])), steps, stability, progress)
    ending, place = Termination(), "on the branches from the linear response"
    try:
        search.main()
        rng = np.random.default_rng(seed)
        for Omega in places:
            place = f"at Omega = {Omega:.5g}"
            search.deflated(Omega, guesses, rng)
            if second is not None:
                search.through(Omega, *second)
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, TraceInterrupted) and error.branch.parameter == "Omega":
            search.branches += [error.branch]
        if not search.branches:
            raise
        ending.record_error(error, place)
    return BranchSearch(tuple(search.branches), tuple(search.log), ending.status, ending.message_with_advice)


def _places(frequencies: Sequence[float] | int, low: float, high: float) -> list[float]:
    if isinstance(frequencies, str | float):
        raise TypeError(f"frequencies: got {frequencies!r}; need a list of them, or how many places")
    if isinstance(frequencies, int | np.integer):
        counted("frequencies", frequencies, 10_000, least=0)
        return [float(x) for x in low + (high - low) * (np.arange(frequencies) + 0.5) / max(frequencies, 1)]
    if not isinstance(frequencies, Iterable):
        raise ValueError(f"frequencies = {frequencies!r} must be how many, or a list of values of Omega")
    places = [float(x) for x in frequencies]
    if not places or not all(low <= x <= high for x in places):
        raise ValueError(f"frequencies = {places} must lie within the span ({low:g}, {high:g})")
    return places


class _Search:
    """State of one survey."""

    def __init__(
        self,
        problem: HarmonicBalance,
        span: tuple[float, float],
        steps: StepControl,
        stability: bool,
        progress: ProgressCallback | None,
    ) -> None:
        self.problem, self.span, self.steps, self.stability, self.progress = problem, span, steps, stability, progress
        self.branches: list[Branch] = []
        self.log: list[str] = []

    def say(self, text: str) -> None:
        """Keep a line of the log and pass it on."""
        self.log.append(text)
        if self.progress:
            self.progress(Progress(text=text))

    def main(self) -> None:
        """The branches that start from the linear response at either end of the span."""
        for span in (self.span, self.span[::-1]):
            try:
                X = self.problem.start(span[0])
            except NoConvergence as error:
                self.say(f"no start at Omega = {span[0]:g}: {error}")
                continue
            if self._on_a_branch(X, span[0]):
                continue
            branch = raise_if_interrupted(
                trace(self.problem, "Omega", span, X, steps=self.steps, stability=self.stability)
            )
            self.branches.append(branch)
            self.say(f"branch {len(self.branches)}, from the linear response at Omega = {span[0]:g}: {branch.message}")

    def known(self, Omega: float) -> list[Array]:
        """Motions of all branches at a frequency, with their copies shifted by periods of the excitation."""
        out = []
        for branch in self.branches:
            for place in crossings_at(branch, Omega):
                try:
                    X = solve(self.problem, place.interpolate(branch.X), self._at(Omega)).X
                except NoConvergence:
                    continue
                out += shifts(self.problem, X)
        return _distinct(out)

    def _on_a_branch(self, X: Array, Omega: float) -> bool:
        """Whether a motion, or a copy of it shifted by periods of the excitation, lies on a branch already traced."""
        for branch in self.branches:
            for place in crossings_at(branch, Omega):
                between, (a, b) = place.interpolate(branch.X), branch.X[place.index : place.index + 2]
                # rows turn by at most 20 degrees, so that the curve stays this close to its chord
                near = 0.15 * float(np.linalg.norm(b - a)) + 1e-6 * float(np.linalg.norm(X))
                if any(float(np.linalg.norm(Y - between)) <= near for Y in shifts(self.problem, X)):
                    return True
        return False

    def deflated(self, Omega: float, guesses: int, rng: np.random.Generator) -> None:
        """New motions by deflated Newton from random starts."""
        known = self.known(Omega)
        start = len(known)
        for guess in random_motions(self.problem, known, guesses, rng):
            X = deflated_newton(self.problem, guess, self._at(Omega), [])
            if X is None or any(same_solution(X, Y) for Y in known):
                X = deflated_newton(self.problem, guess, self._at(Omega), known)
            if X is not None:
                known += shifts(self.problem, X)
                self._take(X, Omega, "deflated Newton")
        self.say(f"Omega = {Omega:.5g}: {start} motions known, {guesses} random starts, now {len(known)}")

    def through(self, Omega: float, name: str, span: tuple[float, float]) -> None:
        """New motions by following each known one through a range of a second parameter and back."""
        own = self.problem.value_of(name)
        pending = self.known(Omega)
        for X in pending:  # grows as motions are found: each is followed in its turn
            for end in span:
                if end == own:
                    continue
                curve = raise_if_interrupted(trace(
                    self.problem, name, (own, end), X, at={"Omega": Omega}, steps=self.steps,
                    stability=False, special=False,
                ))  # fmt: skip
                back = curve.X[-1]
                # it came back to the model's own value as another motion
                if curve.status == Status.LEFT_SPAN and not any(same_solution(back, Y) for Y in pending):
                    pending.append(back)
                    self._take(back, Omega, f"following {name} to {_farthest(curve.values, own):.4g} and back")
        self.say(f"Omega = {Omega:.5g}: known motions followed in {name} over ({span[0]:g}, {span[1]:g})")

    def _take(self, X: Array, Omega: float, how: str) -> None:
        """Trace the branch of a motion unless it lies on one already."""
        if self._on_a_branch(X, Omega):
            return
        try:
            branch = whole_branch(self.problem, X, Omega, self.span, self.steps, self.stability)
        except NoConvergence as error:
            self.say(f"a motion found at Omega = {Omega:.5g} by {how} could not be traced: {error}")
            return
        self.branches.append(branch)
        self.say(f"branch {len(self.branches)}, at Omega = {Omega:.5g} by {how}: {branch.message}")

    def _at(self, Omega: float) -> dict[str, float]:
        return {**self.problem.parameters, "Omega": Omega}


def _farthest(values: Array, own: float) -> float:
    return float(values[np.argmax(np.abs(values - own))])


def whole_branch(
    problem: HarmonicBalance, X: Array, Omega: float, span: tuple[float, float], steps: StepControl, stability: bool
) -> Branch:
    """The whole branch through a motion inside the span: a closed curve, or from one of its ends to the other."""
    start = problem_point(problem, X, Omega)
    first = raise_if_interrupted(trace(problem, "Omega", span, start, steps=steps, stability=False, special=False))
    if first.status in (Status.CLOSED, Status.RETRACED) or not first.status.complete:
        return raise_if_interrupted(trace(problem, "Omega", span, start, steps=steps, stability=stability))
    if first.status is Status.UNBOUNDED:
        away = BranchStart(X, start.parameters, np.append(np.zeros(len(X)), 1.0), away=False)
        follow = partial(trace, problem, "Omega", steps=steps, stability=stability)
        return trace_both_directions(
            away, span, lambda span, start: raise_if_interrupted(follow(span, start)), NewtonSettings()
        )
    if first.status is Status.MERGED:
        start, span = _beside_end(problem, first, span)
        return raise_if_interrupted(trace(problem, "Omega", span, start, steps=steps, stability=stability))
    end = float(first.values[-1])
    other = span[0] if end == span[1] else span[1]
    return raise_if_interrupted(trace(problem, "Omega", (end, other), first.X[-1], steps=steps, stability=stability))


def _beside_end(
    problem: HarmonicBalance, branch: Branch, span: tuple[float, float]
) -> tuple[Point, tuple[float, float]]:
    """A motion just before the end of a branch that merged, and the span in the order that leads away from there.

    The subharmonics vanish like the square root of the distance.
    """
    (X, Y), (end, before) = branch.X[[-1, -2]], branch.values[[-1, -2]]
    value, guess = float(end + 0.01 * (before - end)), X + 0.1 * (Y - X)
    try:
        found = solve(problem, guess, {**problem.parameters, "Omega": value}, "Omega").X
        if np.linalg.norm(problem.subharmonic_part(found)) < 0.02 * np.linalg.norm(problem.subharmonic_part(Y)):
            found, value = Y, float(before)
    except NoConvergence:
        found, value = Y, float(before)
    low, high = sorted(span)
    return problem_point(problem, found, value), (low, high) if before > end else (high, low)


def problem_point(problem: HarmonicBalance, X: Array, Omega: float) -> Point:
    """A point any trace can start from."""
    return Point(
        X, {**problem.parameters, "Omega": Omega}, 0.0, 0, None, np.zeros(problem.m, np.int8), math.nan, problem.layout
    )


def shifts(problem: HarmonicBalance, X: Array) -> list[Array]:
    """A motion of order nu and its copies shifted by 1, ..., nu - 1 periods of the excitation."""
    c, k = to_complex(X.reshape(problem.m, -1)), problem.orders
    turns = range(problem.nu) if np.linalg.norm(problem.subharmonic_part(X)) > 1e-9 else range(1)
    return [to_real(c * np.exp(2j * np.pi * k * j / problem.nu)).ravel() for j in turns]


def _distinct(motions: list[Array]) -> list[Array]:
    out: list[Array] = []
    for X in motions:
        if not any(same_solution(X, Y) for Y in out):
            out.append(X)
    return out


def random_motions(problem: HarmonicBalance, known: list[Array], count: int, rng: np.random.Generator) -> list[Array]:
    """Random starts: mean, lowest harmonics and phase of a size between a fifth and fifteen times the known motions."""
    size = max([problem.solution_norm(X) for X in known] + [1e-3])
    corners = [abs(x) for xs in problem.layout.breakpoints for x in xs]
    size = max(size, 0.1 * max(corners, default=0.0))
    means = [X.reshape(problem.m, -1)[:, 0] for X in known] or [np.zeros(problem.m)]
    out = []
    for i in range(count):
        c = np.zeros((problem.m, len(problem.orders)), dtype=complex)
        top = min(len(problem.orders) - 1, problem.nu + 1)
        if i % 2:  # motions of the size of the known ones, the higher harmonics smaller
            scale, weight = size * 10 ** rng.uniform(-0.7, 1.0), np.arange(1, top + 1) ** -0.5
        else:  # large ones, the excitation's own harmonic as strong as its subharmonics
            scale, weight = (
                size * 10 ** rng.uniform(-0.7, 1.2),
                np.where(problem.orders[1 : top + 1] <= problem.nu, 1, 0.5),
            )
        phases = rng.uniform(0, 2 * np.pi, top)
        c[:, 1 : top + 1] = scale * weight * rng.uniform(0, 1, top) * np.exp(1j * phases)
        c[:, 0] = means[i % len(means)] + rng.normal(0, 0.3, problem.m) * scale
        out.append(to_real(c).ravel())
    return out
