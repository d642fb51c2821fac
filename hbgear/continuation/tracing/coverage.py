"""Coverage of a span: search for further curves where the traced curve does not cover the whole span.

A curve that starts at one end of a span may not reach the other end: it turns back, or its solutions tend to infinity.
The remaining intervals are searched for other curves, in this order:

1. the curve that starts at the other end of the span,
2. curves that return from infinity with the opposite sign: far from the origin, -X nearly is a solution if X is one,
3. curves through initial solutions that the problem computes inside an uncovered interval.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.concatenation import concatenate
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, NewtonSettings
from hbgear.continuation.tracing.jumps import find_jumps

UNCOVERED = (Status.LEFT_SPAN, Status.UNBOUNDED, Status.CLOSED, Status.RETRACED, Status.STEP_TOO_SMALL)
"""Status of curves that were traced as far as possible and may not cover their span."""


Follow = Callable[[tuple[float, float], BranchStart], Branch]
"""Type of a function ``(span, start) -> branch`` that traces from a start towards the second end of a span."""


class TraceFunction(Protocol):
    """Function that traces from one end of a span to the other; ``rough`` requests the points alone."""

    def __call__(self, span: tuple[float, float], start: BranchStart | None, rough: bool) -> Branch: ...


class CoverageSearch(NamedTuple):
    """Functions and settings of a search for further curves.

    ``follow`` traces from one end of a span to the other: from a start, or from the initial solution of the problem.
    With ``rough=True`` stability and special points are not computed. ``start`` returns a solution at a value of the
    parameter, near given unknowns or, for None, as computed by the problem; its direction leads to larger values.
    ``settings`` are those of the corrector for the jumps of curves that are traced in both directions; None for no
    jumps.
    """

    follow: TraceFunction
    start: Callable[[float, Array | None], BranchStart]
    settings: NewtonSettings | None


def uncovered_intervals(branches: Sequence[Branch], span: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the lower and upper ends of the intervals of a span that no branch covers, in ascending order.

    A branch whose solutions tend to infinity covers the interval up to its asymptote.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 0.7))
    >>> uncovered_intervals([curve], (0.9, 0.4))
    [(0.4, 0.5), (0.7, 0.9)]
    """
    low, high = sorted(map(float, span))
    values = [np.append(b.values, list(b.asymptotes.values())) for b in branches]
    uncovered, reached, min_width = [], low, MIN_INTERVAL_RATIO * (high - low)
    for begin, end in sorted((float(x.min()), float(x.max())) for x in values):
        if begin > reached + min_width:
            uncovered.append((reached, begin))
        reached = max(reached, end)
    return [*uncovered, (reached, high)] if high > reached + min_width else uncovered


def _width(intervals: Sequence[tuple[float, float]]) -> float:
    """Return the total width of intervals."""
    return sum(high - low for low, high in intervals)


MIN_INTERVAL_RATIO = 1e-4
"""Smallest width of an uncovered interval, and smallest gain by a further curve, relative to the span.

A known curve that is traced again ends at other rounding errors: it covers more by less than this ratio.
"""


SEARCHED_EIGHTHS = (4, 2, 6, 1, 3, 5, 7)
"""Positions in an uncovered interval, in eighths of its width, at which solutions are searched: the middle first."""


MAX_CURVES = 8
"""Largest number of further curves of one span."""


def cover_span(
    first: Branch, others: list[Branch], span: tuple[float, float], search: CoverageSearch, inside: bool = True
) -> None:
    """Search the intervals that a branch does not cover for further curves, and append them to ``others``.

    Each curve is appended when its trace is finished, so that an interrupted search keeps the curves found. With
    ``inside=False`` solutions are searched at the ends of the span only. The search ends with a curve that takes the
    largest number of points: further starts lead to other parts of such a curve, at the same cost.
    """
    if any(low <= span[1] <= high for low, high in uncovered_intervals([first], span)):
        with suppress(*SEARCH_ERRORS):
            others += [search.follow(span[::-1], None, False)]
    searched: set[tuple[float, bytes]] = set()
    while inside and len(others) < MAX_CURVES and (missing := uncovered_intervals([first, *others], span)):
        guess = next((g for g in _guesses([first, *others], missing) if _key(g) not in searched), None)
        if guess is None:
            return
        searched.add(_key(guess))
        with suppress(*SEARCH_ERRORS):
            branch = _trace_from_guess(*guess, span, search)
            gain = _width(missing) - _width(uncovered_intervals([first, *others, branch], span))
            others += [branch] if gain > MIN_INTERVAL_RATIO * abs(span[1] - span[0]) else []
            if branch.status is Status.MAX_POINTS:
                return


def _guesses(
    branches: Sequence[Branch], missing: Sequence[tuple[float, float]]
) -> Iterator[tuple[float, Array | None]]:
    """Yield values of the parameter, each with a guess X or None, at which solutions are searched.

    Beyond an asymptote the guess is -X. Inside the uncovered intervals there is no guess.
    """
    for branch in branches:
        for i, _ in branch.unbounded_ends:
            yield float(branch.values[i]), -branch.X[i]
    for low, high in missing:
        for eighth in SEARCHED_EIGHTHS:
            yield low + eighth / 8 * (high - low), None


def _key(guess: tuple[float, Array | None]) -> tuple[float, bytes]:
    """Return a hashable form of a guess."""
    value, X = guess
    return value, b"" if X is None else X.tobytes()


def _trace_from_guess(value: float, X: Array | None, span: tuple[float, float], search: CoverageSearch) -> Branch:
    """Return the curve through a solution at a value of the parameter, near a guess or computed by the problem."""
    start = search.start(value, X)
    if X is not None:
        start = _smallest(trace_both_directions(start, span, partial(search.follow, rough=True), None))
    return trace_both_directions(start, span, partial(search.follow, rough=False), search.settings)


def _smallest(branch: Branch) -> BranchStart:
    """Return the point of a branch with the smallest norm, with the direction of the branch there.

    Steps are scaled by the largest norm so far. A trace from the smallest point takes smaller steps than one that
    starts far from the origin.
    """
    i = min(max(int(np.argmin(np.linalg.norm(branch.X, axis=1))), 1), len(branch) - 2)
    before, after = (np.append(branch.X[k], branch.values[k]) for k in (i - 1, i + 1))
    return BranchStart(branch.X[i], branch.parameters_at(i), after - before, bifurcating=False)


def trace_both_directions(
    start: BranchStart, span: tuple[float, float], follow: Follow, settings: NewtonSettings | None
) -> Branch:
    """Trace the curve through a point inside a span in both directions; return both parts in one.

    ``follow`` traces from a start towards the second end of a span. ``settings`` are those of the corrector for jumps;
    None for a branch without jumps.
    """
    low, high = sorted(span)
    forward = follow((low, high), start)
    if forward.status in (Status.CLOSED, Status.RETRACED):
        return forward
    backward = follow((high, low), replace(start, direction=-start.direction))
    branch = concatenate(backward, forward)
    return branch if settings is None else replace(branch, jump_records=find_jumps(branch, settings))


def reversed_span_message(name: str, value: float) -> str:
    """Return the sentence for a curve that is followed from the other end, because it has no solution at a value."""
    return f"no solution was found at {name} = {value:.6g}: followed from the other end"


def coverage_message(first: Branch, others: Sequence[Branch], span: tuple[float, float], inside: bool = True) -> str:
    """Return the message on the coverage of a span by a traced branch and others; empty if the first one covers it.

    ``inside`` is the same as in `cover_span`.
    """
    missing = uncovered_intervals([first, *others], span)
    texts = []
    if others:
        count = "another curve covers" if len(others) == 1 else f"{len(others)} other curves cover"
        texts.append(f"{count} {'more' if missing else 'the rest'} of the span")
    if missing:
        ranges = " and ".join(f"{low:.6g} to {high:.6g}" for low, high in missing)
        texts.append(f"no curve was {'found' if inside else 'searched for'} from {first.parameter} = {ranges}")
    return "; ".join(texts)
