"""Ten thousand random machines: status of traces, accuracy of special points, stability and motions after jumps.

    python -m studies.random.campaign [--quick] [-o DIR]

Spur pairs, double-helical pairs, pairs on bearings and two masses with one or two elements (`studies.random.machines`),
each traced by the default call on one core. Every status is looked at: whether the curve ends where it says, solves its
equations, and covers the span or says what it does not. Two hundred machines are compared with the truth
(`studies.random.truth`): special points and verdicts against shooting, landings of jumps against another integration.
Results are stored in the folder ``.store`` by the state of the sources; a stopped run can be resumed.
"""

from __future__ import annotations

from studies import study
from studies.random.collecting import Results, collected
from studies.random.reporting import plot, report

__all__ = ["plot", "report", "run"]

TRACED = {"spur": 8000, "helical": 1250, "bearings": 600, "two": 450}
"""Machines of each kind that are traced, the fewer the longer they take."""

HELD = {"spur": 80, "helical": 30, "bearings": 40, "two": 50}
"""Those of them, the first, that are compared with the truth."""


def run(quick: bool = False) -> Results:
    """All machines; ``quick``: the first of each kind, and one of them compared with the truth."""
    return collected(__name__, TRACED, HELD, quick)


if __name__ == "__main__":
    study.main()
