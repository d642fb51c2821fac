"""Consistency of a branch: what its points and its special points must say of each other.

A branch changes its stability only at a fold, a branch point, a period doubling or a Neimark-Sacker point, and the
two sides of a fold are never both stable, for one real multiplier passes +1 there. What contradicts this is wrong
somewhere: a multiplier, or a special point that was not found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

UNSTABLE, STABLE = 0, 1
"""Codes of verdicts that are sure; see `branch.VERDICTS`."""


def unexplained_changes(codes: NDArray[np.int_], marks: Mapping[int, Sequence[str]]) -> list[tuple[int, int]]:
    """Pairs of neighbouring points with different verdicts and no special point between them.

    Parameters
    ----------
    codes : (P,) verdict of each point.
    marks : kinds of the special points at which stability can change, by the number of their point.

    Returns
    -------
    Numbers of both points of each pair. Points that are undecided, and special points, whose critical multiplier lies
    on the unit circle, are no part of a pair.

    Examples
    --------
    >>> unexplained_changes(np.array([1, 1, 0, 0]), {})
    [(1, 2)]
    >>> unexplained_changes(np.array([1, 1, 0, 0]), {1: ["LP"]})
    []
    """
    return [(a, b) for a, b in _neighbours(codes, marks) if codes[a] != codes[b] and not _between(a, b, marks)]


def stable_on_both_sides(codes: NDArray[np.int_], marks: Mapping[int, Sequence[str]]) -> list[int]:
    """Numbers of the folds with stable points on both sides; parameters as of `unexplained_changes`.

    Examples
    --------
    >>> stable_on_both_sides(np.array([1, 1, 1]), {1: ["LP"]})
    [1]
    """
    return [
        some[0] for a, b in _neighbours(codes, marks)
        if codes[a] == codes[b] == STABLE and len(some := _between(a, b, marks)) == 1 and list(marks[some[0]]) == ["LP"]
    ]  # fmt: skip


def _neighbours(codes: NDArray[np.int_], marks: Mapping[int, Sequence[str]]) -> Iterator[tuple[int, int]]:
    """Pairs of decided points with nothing but special points between them."""
    last: int | None = None
    for i, code in enumerate(codes.tolist()):
        if i in marks:
            continue
        sure = code in (UNSTABLE, STABLE)
        if sure and last is not None:
            yield last, i
        last = i if sure else None


def _between(a: int, b: int, marks: Mapping[int, Sequence[str]]) -> list[int]:
    """Special points from point a to point b; one that was not located has the number of the point before it."""
    return [i for i in range(a, b + 1) if i in marks]
