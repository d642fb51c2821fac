"""Three thousand further machines of fifteen kinds: ends and times of their traces, errors, verdicts, landings.

    python -m studies.random.further [--quick] [-o DIR]

Stops, stepped stiffness, laws of a user, friction, chains, gyroscopic structures, trains, planetary sets and drawings
(`studies.random.structures`), traced and compared like the machines of `studies.random.campaign`.
"""

from __future__ import annotations

from studies import study
from studies.random.collecting import Results, collected
from studies.random.reporting import plot, report
from studies.random.structures import STRUCTURES

__all__ = ["plot", "report", "run"]

TRACED = dict.fromkeys(STRUCTURES, 210)
"""Machines of each kind that are traced."""

COMPARED = dict.fromkeys(STRUCTURES, 20)
"""Machines of each kind that are compared, the first ones."""


def run(quick: bool = False) -> Results:
    """Return the results; ``quick``: the first machine of each kind is traced, one is compared."""
    return collected(__name__, TRACED, COMPARED, quick)


if __name__ == "__main__":
    study.main()
