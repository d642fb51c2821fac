"""Three thousand further machines of fifteen kinds: ends and times of their traces, errors, verdicts, landings.

    python -m studies.random.further [--quick] [-o DIR]

Stops, stepped stiffness, laws of a user, friction, chains, gyroscopic structures, trains, planetary sets and drawings
(`studies.random.structures`), traced and compared with the truth like the machines of `studies.random.campaign`.
"""

from __future__ import annotations

from studies import study
from studies.random.collecting import Results, collected
from studies.random.reporting import plot, report
from studies.random.structures import STRUCTURES

__all__ = ["plot", "report", "run"]

TRACED = dict.fromkeys(STRUCTURES, 210)
"""Machines of each kind that are traced."""

HELD = dict.fromkeys(STRUCTURES, 20)
"""Machines of each kind, the first, that are compared with the truth."""


def run(quick: bool = False) -> Results:
    """All machines; ``quick``: the first of each kind, and one of them compared with the truth."""
    return collected(__name__, TRACED, HELD, quick)


if __name__ == "__main__":
    study.main()
