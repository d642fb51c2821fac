"""Bound of the work for solutions with more unknowns: errors, accurate special points, verdicts in doubt.

    sum_i w_i <= limit,    w_i = c_i [(n_i / 700)^3 + 2e-3] <= (limit - sum_{j < i} w_j) / 2

n_i is the number of unknowns of a solution, c_i the number of solutions that take as long. Dense factorisations take
n^3 operations, so the sum is proportional to the time, but it is counted: results do not depend on the processor, or on
its load. No solution takes more than half of what is left, so that less remains for large ones first. The first
estimate of the error of a special point is no part of this sum: for all of them together there is a second sum with the
same limit, which only problems with many unknowns reach. Without an estimate a point is worth nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

LARGEST = 700
"""Unknowns of a solution that counts 1."""

_SMALL = 2e-3  # of a solution with few unknowns, whose time is that of Python

_SHARE = 0.5  # of what is left, that one solution may take

USUAL = 25.0
"""Limit by default: half a minute at most."""


@dataclass
class Work:
    """Work that was done, up to a limit.

    Parameters
    ----------
    limit : float
        Largest sum, in solutions with 700 unknowns.
    spent : float, optional
        The sum so far.
    estimated : float, optional
        The sum so far of first estimates.
    refused : int, optional
        Number of solutions that were refused.
    """

    limit: float
    spent: float = 0.0
    estimated: float = 0.0
    refused: int = 0

    @property
    def told(self) -> str:
        """A message if something was refused."""
        if not self.refused:
            return ""
        return (
            f"{self.refused} errors or verdicts were not improved: the bound work = {self.limit:g} allows no more; "
            "raise it, or trace a part of the span with more harmonics"
        )

    def allows(self, unknowns: int, solutions: int = 1) -> bool:
        """Count solutions with this many unknowns; False, and nothing is counted, if they would take too much."""
        more = _weight(unknowns, solutions)
        if more > _SHARE * (self.limit - self.spent):
            self.refused += 1
            return False
        self.spent += more
        return True

    def estimates(self, unknowns: int, solutions: int = 1) -> bool:
        """As `allows`, for the first estimate of an error, from the second sum, of which one may take all that is left.

        Examples
        --------
        >>> work = Work(1.0, spent=1.0)
        >>> work.allows(70), work.estimates(70), work.estimates(700)
        (False, True, False)
        """
        more = _weight(unknowns, solutions)
        if more > self.limit - self.estimated:
            self.refused += 1
            return False
        self.estimated += more
        return True

    def affords(self, unknowns: int, solutions: int = 1) -> bool:
        """Whether solutions with this many unknowns would be allowed if nothing was spent; False is a refusal too."""
        afforded = _weight(unknowns, solutions) <= _SHARE * self.limit
        self.refused += not afforded
        return afforded


def _weight(unknowns: int, solutions: int) -> float:
    return solutions * ((unknowns / LARGEST) ** 3 + _SMALL)
