"""Disconnected branches: search for all branches in a span of Omega.

Continuation follows one connected branch. Further motions at chosen frequencies are searched by deflated Newton's
method from random starts, in which known motions X_i repel the iterates, and from free motions on backbones,

    M(X) R(X) = 0,   M = prod_i (1 + 1 / |X - X_i|^2),     step  dX / (1 - (grad log M)^T dX),  dX = -J^-1 R

and by continuation of known motions in a second parameter and back. Each new motion is traced.

References
----------
Farrell, Birkisson & Funke (2015), SIAM J. Sci. Comput. 37(4), A2026, https://doi.org/10.1137/140984798.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.branch_search.backbone_starts import BackboneStarts
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
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.series.fourier import to_complex, to_real

MAX_SEGMENT_DEVIATION = 0.15
"""Distance of a branch from the straight line between two points, over their distance; points turn by at most 20 deg.

A motion within this distance lies on the branch.
"""


@dataclass(frozen=True)
class BranchSearch:
    """Branches that `trace_all` found, with a log of the search.

    Attributes
    ----------
    branches : tuple of Branch
        Branches in the order in which they were found.
    log : tuple of str
        One line for each step of the search.
    status : Status
        Complete if the search was not interrupted.
    message : str
        Reason of an early end, and advice; empty if the search is complete.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 3)
    >>> search = hb.trace_all(problem, (0.8, 1.2), frequencies=[1.0], guesses=2)
    >>> search.status.complete, len(search.log) > 0
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
    frequencies="a number of frequencies, or a list of frequencies",
    second="a name and its range, such as ('zeta', (0.05, 0.2))",
)
def trace_all(
    problem: HarmonicBalance,
    span: tuple[float, float],
    *,
    frequencies: Sequence[float] | int = 5,
    guesses: int = 20,
    second: tuple[str, tuple[float, float]] | None = None,
    motions: Sequence[Point] = (),
    seed: int = 0,
    steps: StepControl = StepControl(),
    stability: bool = True,
    progress: ProgressCallback | None = None,
) -> BranchSearch:
    """Search for all branches of periodic motions in a span of Omega.

    The branches from the linear response at both ends are traced first. At each frequency, Newton's method then starts
    from the free motions on the backbones of the lowest modes whose frequency is a multiple of Omega / nu, with several
    phases, and deflated Newton's method from `guesses` random motions of different size and phase. With `second`, the
    known motions at this frequency are also followed in another parameter; each return of the branch to the value of
    the model is a further motion. Each motion that lies on no known branch is traced. A motion and its copies shifted
    by whole periods of the excitation are the same motion.

    Parameters
    ----------
    problem : HarmonicBalance
        Equations. With nu > 1, subharmonic branches are found as well.
    span : tuple of float
        First and last value of Omega.
    frequencies : sequence of float or int, optional
        Frequencies of the search, or their number; a number spreads them evenly over the span. The default is 5.
    guesses : int, optional
        Number of random starts at each frequency. The default is 20. With 0 there are no starts from backbones either.
    second : tuple (str, (float, float)), optional
        Name and range of a parameter of the model, such as ``("zeta", (0.05, 0.2))``. By default no second parameter
        is used.
    motions : sequence of Point, optional
        Known motions, such as ``hb.time.steady_states(model, Omega).points``. They are traced before the search if they
        lie on no branch. Those of more periods than ``nu`` of the problem are left out.
    seed : int, optional
        Seed of the random starts; the same seed finds the same branches. The default is 0.
    steps : StepControl, optional
        Step size control of the continuation, as for `trace`.
    stability : bool, optional
        If True (default), the stability of the points is computed.
    progress : callable, optional
        Function that is called with a `Progress` after each step, such as ``print``. Its fraction is unknown.

    Returns
    -------
    BranchSearch
        The branches. After Ctrl-C or an error it holds the branches found before, the last one as far as it was
        traced; ``status`` and ``message`` report the reason.

    Raises
    ------
    ValueError
        If no frequency lies within the span, or the number of harmonics varies.
    KeyboardInterrupt
        If Ctrl-C is pressed before the first branch is traced.

    Examples
    --------
    >>> import hbgear as hb
    >>> isola = hb.HarmonicBalance(hb.Duffing(zeta=0.01, k3=1, F=3), 5, nu=3)
    >>> search = hb.trace_all(isola, (4.5, 3.5), frequencies=[4.0], guesses=4)
    >>> len(search.branches) >= 1
    True
    """
    problem.require_fixed_resolution("a search for all branches")
    low, high = sorted(map(float, span))
    counted("guesses", guesses, 100_000, least=0)
    search_frequencies = _search_frequencies(frequencies, low, high)
    search = _Search(problem, (float(span[0]), float(span[1])), steps, stability, progress)
    ending, stage = Termination(advice=_ADVICE), "on the branches from the linear response"
    try:
        search.trace_linear_responses()
        search.trace_motions(motions)
        rng = np.random.default_rng(seed)
        for Omega in search_frequencies:
            stage = f"at Omega = {Omega:.5g}"
            if guesses:
                search.search_from_backbones(Omega)
                search.search_by_deflation(Omega, guesses, rng)
            if second is not None:
                search.search_in_parameter(Omega, *second)
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, TraceInterrupted) and error.branch.parameter == "Omega":
            search.branches += [error.branch]
        if not search.branches:
            raise
        ending.record_error(error, stage)
    return BranchSearch(tuple(search.branches), tuple(search.log), ending.status, ending.message_with_advice)


_ADVICE = "branches found so far are kept; search the other frequencies with frequencies=[...]"
"""Recommended action for a search that is not complete."""


def _search_frequencies(frequencies: Sequence[float] | int, low: float, high: float) -> list[float]:
    """Return the frequencies of the search from a list or their number; refuse values outside the span."""
    if isinstance(frequencies, str | float):
        raise TypeError(f"frequencies: got {frequencies!r}; need a list of frequencies, or their number")
    if isinstance(frequencies, int | np.integer):
        counted("frequencies", frequencies, 10_000, least=0)
        return [float(x) for x in low + (high - low) * (np.arange(frequencies) + 0.5) / max(frequencies, 1)]
    if not isinstance(frequencies, Iterable):
        raise ValueError(f"frequencies = {frequencies!r} must be a number of frequencies, or a list of values of Omega")
    values = [float(x) for x in frequencies]
    if not values or not all(low <= x <= high for x in values):
        raise ValueError(f"frequencies = {values} must lie within the span ({low:g}, {high:g})")
    return values


class _Search:
    """State of a search for all branches."""

    def __init__(
        self,
        problem: HarmonicBalance,
        span: tuple[float, float],
        steps: StepControl,
        stability: bool,
        progress: ProgressCallback | None,
    ) -> None:
        self.problem, self.span, self.steps, self.stability, self.progress = problem, span, steps, stability, progress
        self.starts: BackboneStarts | None = None
        self.branches: list[Branch] = []
        self.log: list[str] = []

    def report(self, text: str) -> None:
        """Append a line to the log and report it as progress."""
        self.log.append(text)
        if self.progress:
            self.progress(Progress(text=text))

    def trace_linear_responses(self) -> None:
        """Trace the branches that start from the linear response at the ends of the span."""
        for span in (self.span, self.span[::-1]):
            try:
                X = self.problem.start(span[0])
            except NoConvergence as error:
                self.report(f"no start at Omega = {span[0]:g}: {error}")
                continue
            if self._on_a_branch(X, span[0]):
                continue
            branch = raise_if_interrupted(
                trace(self.problem, "Omega", span, X, steps=self.steps, stability=self.stability)
            )
            self.branches.append(branch)
            self.report(
                f"branch {len(self.branches)}, from the linear response at Omega = {span[0]:g}: {branch.message}"
            )

    def trace_motions(self, motions: Sequence[Point]) -> None:
        """Trace the branches of given motions whose period divides that of the problem, within the span."""
        low, high = sorted(self.span)
        for point in motions:
            layout, Omega = layout_of(point), point.parameters["Omega"]
            if layout is not None and self.problem.nu % layout.nu == 0 and low <= Omega <= high:
                X = solve(self.problem, self.problem.from_point(point), self._parameters_at(Omega)).X
                self._trace_new(X, Omega, "a given motion")

    def known_motions(self, Omega: float) -> list[Array]:
        """Return the motions of all branches at a frequency, with their copies shifted by excitation periods."""
        out = []
        for branch in self.branches:
            for crossing in crossings_at(branch, Omega):
                try:
                    X = solve(self.problem, crossing.interpolate(branch.X), self._parameters_at(Omega)).X
                except NoConvergence:
                    continue
                out += shifts(self.problem, X)
        return _distinct(out)

    def _on_a_branch(self, X: Array, Omega: float) -> bool:
        """Return whether a motion, or a copy shifted by excitation periods, lies on a branch that was traced."""
        for branch in self.branches:
            for crossing in crossings_at(branch, Omega):
                Z, (a, b) = crossing.interpolate(branch.X), branch.X[crossing.index : crossing.index + 2]
                tolerance = MAX_SEGMENT_DEVIATION * float(np.linalg.norm(b - a)) + 1e-6 * float(np.linalg.norm(X))
                if any(float(np.linalg.norm(Y - Z)) <= tolerance for Y in shifts(self.problem, X)):
                    return True
        return False

    def search_by_deflation(self, Omega: float, guesses: int, rng: np.random.Generator) -> None:
        """Search for new motions by deflated Newton's method from random starts, and trace their branches."""
        motions = self.known_motions(Omega)
        known = len(motions)
        for guess in random_motions(self.problem, motions, guesses, rng):
            X = deflated_newton(self.problem, guess, self._parameters_at(Omega), [])
            if X is None or any(same_solution(X, Y) for Y in motions):
                X = deflated_newton(self.problem, guess, self._parameters_at(Omega), motions)
            if X is not None:
                motions += shifts(self.problem, X)
                self._trace_new(X, Omega, "deflated Newton")
        self.report(f"Omega = {Omega:.5g}: {known} motions known, {guesses} random starts, now {len(motions)}")

    def search_from_backbones(self, Omega: float) -> None:
        """Search for new motions by Newton's method from free motions on the backbones, and trace their branches."""
        motions = self.known_motions(Omega)
        known, count = len(motions), 0
        if self.starts is None:
            self.starts = BackboneStarts(self.problem, motion_size(self.problem, motions))
        for guess in self.starts.at(Omega, motions):
            X, count = deflated_newton(self.problem, guess, self._parameters_at(Omega), []), count + 1
            if X is not None and not any(same_solution(X, Y) for Y in motions):
                motions += shifts(self.problem, X)
                self._trace_new(X, Omega, "Newton's method from a backbone")
        self.report(f"Omega = {Omega:.5g}: {known} motions known, {count} starts from backbones, now {len(motions)}")

    def search_in_parameter(self, Omega: float, name: str, span: tuple[float, float]) -> None:
        """Search for new motions by continuation of each known one in a second parameter and back."""
        value = self.problem.value_of(name)
        pending = self.known_motions(Omega)
        for X in pending:  # new motions are appended and followed as well
            for end in span:
                if end == value:
                    continue
                curve = raise_if_interrupted(
                    trace(
                        self.problem,
                        name,
                        (value, end),
                        X,
                        at={"Omega": Omega},
                        steps=self.steps,
                        stability=False,
                        special=False,
                    )
                )
                last = curve.X[-1]
                # the branch returned to the value of the model with another motion
                if curve.status == Status.LEFT_SPAN and not any(same_solution(last, Y) for Y in pending):
                    pending.append(last)
                    farthest = curve.values[np.argmax(np.abs(curve.values - value))]
                    self._trace_new(last, Omega, f"following {name} to {farthest:.4g} and back")
        self.report(f"Omega = {Omega:.5g}: known motions followed in {name} over ({span[0]:g}, {span[1]:g})")

    def _trace_new(self, X: Array, Omega: float, method: str) -> None:
        """Trace the branch of a motion unless the motion lies on a known branch."""
        if self._on_a_branch(X, Omega):
            return
        try:
            branch = complete_branch(self.problem, X, Omega, self.span, self.steps, self.stability)
        except NoConvergence as error:
            self.report(f"a motion found at Omega = {Omega:.5g} by {method} could not be traced: {error}")
            return
        self.branches.append(branch)
        self.report(f"branch {len(self.branches)}, at Omega = {Omega:.5g} by {method}: {branch.message}")

    def _parameters_at(self, Omega: float) -> dict[str, float]:
        """Return all parameters with this frequency."""
        return {**self.problem.parameters, "Omega": Omega}


def complete_branch(
    problem: HarmonicBalance, X: Array, Omega: float, span: tuple[float, float], steps: StepControl, stability: bool
) -> Branch:
    """Return the complete branch through a motion inside the span: a closed branch, or one from end to end."""
    start = problem_point(problem, X, Omega)

    def follow(span: tuple[float, float], start: Point | BranchStart | Array) -> Branch:
        return raise_if_interrupted(trace(problem, "Omega", span, start, steps=steps, stability=stability))

    first = raise_if_interrupted(trace(problem, "Omega", span, start, steps=steps, stability=False, special=False))
    if first.status in (Status.CLOSED, Status.RETRACED) or not first.status.complete:
        return follow(span, start)
    if first.status is Status.UNBOUNDED:
        branch_start = BranchStart(X, start.parameters, np.append(np.zeros(len(X)), 1.0), bifurcating=False)
        return trace_both_directions(branch_start, span, follow, NewtonSettings())
    if first.status is Status.MERGED:
        start, span = _point_before_end(problem, first, span)
        return follow(span, start)
    end = float(first.values[-1])
    return follow((end, span[0] if end == span[1] else span[1]), first.X[-1])


def _point_before_end(
    problem: HarmonicBalance, branch: Branch, span: tuple[float, float]
) -> tuple[Point, tuple[float, float]]:
    """Return a motion just before the end of a branch that merged, and the span with the direction away from it.

    The subharmonic amplitudes are proportional to the square root of the distance from the end: 1 % of the distance
    to the next point leaves a tenth of the amplitudes. If the solution is the branch without subharmonics, the next
    point is returned.
    """
    (X, Y), (end, before) = branch.X[[-1, -2]], branch.values[[-1, -2]]
    value, guess = float(end + 0.01 * (before - end)), X + 0.1 * (Y - X)
    try:
        solution = solve(problem, guess, {**problem.parameters, "Omega": value}, "Omega").X
        if np.linalg.norm(problem.subharmonic_part(solution)) < 0.02 * np.linalg.norm(problem.subharmonic_part(Y)):
            solution, value = Y, float(before)
    except NoConvergence:
        solution, value = Y, float(before)
    low, high = sorted(span)
    return problem_point(problem, solution, value), (low, high) if before > end else (high, low)


def problem_point(problem: HarmonicBalance, X: Array, Omega: float) -> Point:
    """Return a point with the unknowns X from which `trace` can start."""
    return Point(
        X, {**problem.parameters, "Omega": Omega}, 0.0, 0, None, np.zeros(problem.m, np.int8), math.nan, problem.layout
    )


def shifts(problem: HarmonicBalance, X: Array) -> list[Array]:
    """Return a motion of order nu and its copies shifted by 1, ..., nu - 1 periods of the excitation."""
    c, k = to_complex(X.reshape(problem.m, -1)), problem.orders
    periods = range(problem.nu) if np.linalg.norm(problem.subharmonic_part(X)) > 1e-9 else range(1)
    return [to_real(c * np.exp(2j * np.pi * k * j / problem.nu)).ravel() for j in periods]


def _distinct(motions: list[Array]) -> list[Array]:
    """Return the motions without repetitions."""
    out: list[Array] = []
    for X in motions:
        if not any(same_solution(X, Y) for Y in out):
            out.append(X)
    return out


def motion_size(problem: HarmonicBalance, motions: Sequence[Array]) -> float:
    """Return the size of the largest known motion, or a tenth of the largest breakpoint; 1 without motion and gap."""
    size = max([problem.solution_norm(X) for X in motions], default=0.0)
    breakpoints = [abs(x) for xs in problem.layout.breakpoints for x in xs]
    return max(size, 0.1 * max(breakpoints, default=0.0)) or 1.0


def random_motions(problem: HarmonicBalance, motions: list[Array], count: int, rng: np.random.Generator) -> list[Array]:
    """Return random starts: mean, lowest harmonics and phases, with sizes from 1/5 to 15 times the known motions."""
    size = motion_size(problem, motions)
    means = [X.reshape(problem.m, -1)[:, 0] for X in motions] or [np.zeros(problem.m)]
    out = []
    for i in range(count):
        c = np.zeros((problem.m, len(problem.orders)), dtype=complex)
        highest = min(len(problem.orders) - 1, problem.nu + 1)
        if i % 2:  # motions of the size of the known ones, with smaller higher harmonics
            scale, weight = size * 10 ** rng.uniform(-0.7, 1.0), np.arange(1, highest + 1) ** -0.5
        else:  # large motions, the harmonic of the excitation as large as the subharmonics
            scale = size * 10 ** rng.uniform(-0.7, 1.2)
            weight = np.where(problem.orders[1 : highest + 1] <= problem.nu, 1, 0.5)
        phases = rng.uniform(0, 2 * np.pi, highest)
        c[:, 1 : highest + 1] = scale * weight * rng.uniform(0, 1, highest) * np.exp(1j * phases)
        c[:, 0] = means[i % len(means)] + rng.normal(0, 0.3, problem.m) * scale
        out.append(to_real(c).ravel())
    return out
