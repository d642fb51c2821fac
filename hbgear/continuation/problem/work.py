"""Bound of the work for solutions at a higher resolution: errors, accurate special points, undecided stability.

    sum_i w_i <= limit,    w_i = c_i [(n_i / 700)^3 + 2e-3] <= (limit - sum_{j < i} w_j) / 2

n_i is the number of unknowns of a solution, or of a dense solution of the same cost, and c_i the number of such
solutions. Dense factorisations take n^3 operations, so the sum is proportional to the time. It is counted and not
measured: results do not depend on the processor or its load. No solution takes more than half of the remaining work,
so that large solutions are refused first. The first error estimates of special points have a second sum with the same
limit, because a special point without an estimate is of little use, and exact motions that verify the stability of
points a third one. Only problems with many unknowns, or curves with many contacts in a period, reach these limits.
"""

from __future__ import annotations

from dataclasses import dataclass

REFERENCE_SIZE = 700
"""Number of unknowns of a solution that counts as 1."""

MIN_WEIGHT = 2e-3
"""Work of a solution with few unknowns, whose time does not depend on their number."""

MAX_FRACTION = 0.5
"""Fraction of the remaining work that one solution may take."""

DEFAULT_LIMIT = 25.0
"""Default limit. Each of the three sums corresponds to about twelve seconds."""


@dataclass
class Work:
    """Limit of the work, in solutions with 700 unknowns, and the three sums so far.

    ``spent`` is the sum of solutions, ``estimated`` that of first error estimates, ``verified`` that of exact motions,
    and ``refused`` the number of solutions that were refused.
    """

    limit: float
    spent: float = 0.0
    estimated: float = 0.0
    verified: float = 0.0
    refused: int = 0

    @property
    def message(self) -> str:
        """Message if solutions were refused, else empty."""
        if not self.refused:
            return ""
        return (
            f"{self.refused} errors or stabilities were not improved: the bound work = {self.limit:g} was reached; "
            "raise it, or trace a part of the span with more harmonics"
        )

    def allows(self, unknowns: int, solutions: int = 1) -> bool:
        """Count solutions with a number of unknowns if the bound allows them; return False if they are refused."""
        weight = _weight(unknowns, solutions)
        if weight > MAX_FRACTION * (self.limit - self.spent):
            self.refused += 1
            return False
        self.spent += weight
        return True

    def estimates(self, unknowns: int, solutions: int = 1) -> bool:
        """Count solutions of a first error estimate if the second sum allows them; return False if they are refused.

        One estimate may take all of the remaining work.

        Examples
        --------
        >>> work = Work(1.0, spent=1.0)
        >>> work.allows(70), work.estimates(70), work.estimates(700)
        (False, True, False)
        """
        weight = _weight(unknowns, solutions)
        if weight > self.limit - self.estimated:
            self.refused += 1
            return False
        self.estimated += weight
        return True

    def verifies(self, unknowns: int, solutions: int = 1) -> bool:
        """Count solutions for an exact motion with a number of states if the third sum allows them, else False."""
        if self.verified >= self.limit:
            self.refused += 1
            return False
        self.verified += _weight(unknowns, solutions)
        return True

    def renewed(self) -> Work:
        """Return the bound for a curve that is traced again: at most half of each sum counts for it.

        Examples
        --------
        >>> again = Work(10.0, spent=9.0, estimated=2.0).renewed()
        >>> again.spent, again.estimated
        (5.0, 2.0)
        """
        half = 0.5 * self.limit
        return Work(self.limit, min(self.spent, half), min(self.estimated, half), min(self.verified, half))

    def affords(self, unknowns: int, solutions: int = 1) -> bool:
        """Return whether a curve may be traced again at the cost of solutions. False counts as a refusal.

        The solutions may take half of the limit, and at most half of it may be spent.
        """
        afforded = max(_weight(unknowns, solutions), self.spent) <= MAX_FRACTION * self.limit
        self.refused += not afforded
        return afforded


def _weight(unknowns: int, solutions: int) -> float:
    """Return the work of solutions with a number of unknowns."""
    return solutions * ((unknowns / REFERENCE_SIZE) ** 3 + MIN_WEIGHT)
