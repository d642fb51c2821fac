"""The rest of a span, where the curve that was traced does not lead through all of it.

A curve that begins at one end of a span need not come out at the other: it turns back, or runs off to infinity. What it
leaves is looked for on other curves: that from the other end; those that come back from infinity on its other side,
where X and -X are alike; and those through what the problem finds where nothing was seen yet.
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
from hbgear.continuation.results.concatenation import concatenate, most_resolved, padded_to_common_size
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence
from hbgear.continuation.tracing.jumps import find_jumps

UNCOVERED = (Status.LEFT_SPAN, Status.UNBOUNDED, Status.CLOSED, Status.RETRACED, Status.STEP_TOO_SMALL)
"""Ends of a curve that was followed as far as it goes and may leave something of its span."""


Follow = Callable[[tuple[float, float], BranchStart], Branch]
"""Traces from a point towards one end of a span."""


class Followed(Protocol):
    """Traces from one end of a span to the other."""

    def __call__(self, span: tuple[float, float], start: BranchStart | None, rough: bool) -> Branch: ...


class CoverageSearch(NamedTuple):
    """How curves of a span are found.

    follow : traces from one end of a span to the other, from what the problem finds at its beginning or from a point;
        roughly, if so asked: the rows alone.
    start : a point at a value of the parameter, near unknowns that are given or wherever the problem finds one, to go
        up from in the parameter.
    settings : of the corrector, for jumps on curves that are followed both ways; None not to look for these.
    """

    follow: Followed
    start: Callable[[float, Array | None], BranchStart]
    settings: NewtonSettings | None


def uncovered_intervals(branches: Sequence[Branch], span: tuple[float, float]) -> list[tuple[float, float]]:
    """The parts of a span that no branch passes, from low to high; one that runs off to infinity passes its asymptote.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 0.7))
    >>> gaps([curve], (0.9, 0.4))
    [(0.4, 0.5), (0.7, 0.9)]
    """
    low, high = sorted(map(float, span))
    passed = [np.append(b.values, list(b.asymptotes.values())) for b in branches]
    free, reached, least = [], low, _LEAST * (high - low)
    for begin, end in sorted((float(x.min()), float(x.max())) for x in passed):
        if begin > reached + least:
            free.append((reached, begin))
        reached = max(reached, end)
    return [*free, (reached, high)] if high > reached + least else free


_LEAST = 1e-4  # share of a span that is no gap


_PLACES = (4, 2, 6, 1, 3, 5, 7)  # eighths of a gap at which solutions are looked for, until one is found


_CURVES = 8  # most that are looked for


_NOTHING = (NoConvergence, np.linalg.LinAlgError, ValueError)  # found there, or the model refuses the value


def cover_span(
    first: Branch, others: list[Branch], span: tuple[float, float], search: CoverageSearch, inside: bool = True
) -> None:
    """Add the curves that cover what a branch leaves of its span to ``others``, each as soon as it is whole.

    inside : whether solutions are also searched for away from the ends of the span.
    """
    if any(low <= span[1] <= high for low, high in uncovered_intervals([first], span)):
        with suppress(*_NOTHING):
            others += [search.follow(span[::-1], None, False)]
    tried: set[tuple[float, bytes]] = set()
    while inside and len(others) < _CURVES and (missing := uncovered_intervals([first, *others], span)):
        guess = next((g for g in _guesses([first, *others], missing) if _key(g) not in tried), None)
        if guess is None:
            return
        tried.add(_key(guess))
        with suppress(*_NOTHING):
            other = _found(*guess, span, search)
            others += [other] if uncovered_intervals([first, *others, other], span) != missing else []


def _guesses(
    branches: Sequence[Branch], missing: Sequence[tuple[float, float]]
) -> Iterator[tuple[float, Array | None]]:
    """Values of the parameter at which to look for solutions, and near what: beyond infinity, and in the gaps."""
    for branch in branches:
        for end in branch.asymptotes:
            row = 0 if end == "first" else -1
            yield float(branch.values[row]), -branch.X[row]
    for low, high in missing:
        for place in _PLACES:
            yield low + place / 8 * (high - low), None


def _key(guess: tuple[float, Array | None]) -> tuple[float, bytes]:
    value, near = guess
    return value, b"" if near is None else near.tobytes()


def _found(value: float, near: Array | None, span: tuple[float, float], search: CoverageSearch) -> Branch:
    """The whole curve through what is found at a value of the parameter, near some unknowns or anywhere."""
    start = search.start(value, near)
    if near is not None:
        start = _smallest(trace_both_directions(start, span, partial(search.follow, rough=True), None))
    return trace_both_directions(start, span, partial(search.follow, rough=False), search.settings)


def _smallest(branch: Branch) -> BranchStart:
    """The row of a branch with the smallest unknowns, with the direction of the branch there.

    Steps are measured by the largest unknowns so far: from here the curve is followed more closely than from far out.
    """
    i = min(max(int(np.argmin(np.linalg.norm(branch.X, axis=1))), 1), len(branch) - 2)
    before, after = (np.append(branch.X[k], branch.values[k]) for k in (i - 1, i + 1))
    return BranchStart(branch.X[i], branch.parameters_at(i), after - before, away=False)


def trace_both_directions(
    start: BranchStart, span: tuple[float, float], follow: Follow, settings: NewtonSettings | None
) -> Branch:
    """The curve through a point inside of a span, whole, with its jumps if there are settings to solve for these."""
    low, high = sorted(span)
    forth = follow((low, high), start)
    if forth.status in (Status.CLOSED, Status.RETRACED):
        return forth
    back = follow((high, low), replace(start, direction=-start.direction))
    made = replace(concatenate(*padded_to_common_size(back, forth)), problem=most_resolved(back, forth))
    return made if settings is None else replace(made, jump_records=find_jumps(made, settings))


def coverage_message(first: Branch, others: Sequence[Branch], span: tuple[float, float], inside: bool = True) -> str:
    """What there is to say of a span that a branch leaves something of; nothing if it leaves nothing.

    inside : as of `cover_span`.
    """
    missing = uncovered_intervals([first, *others], span)
    words = []
    if others:
        count = "another curve covers" if len(others) == 1 else f"{len(others)} other curves cover"
        words.append(f"{count} {'more' if missing else 'the rest'} of the span")
    if missing:
        ranges = " and ".join(f"{low:.6g} to {high:.6g}" for low, high in missing)
        words.append(f"no curve was {'found' if inside else 'searched for'} from {first.parameter} = {ranges}")
    return "; ".join(words)
