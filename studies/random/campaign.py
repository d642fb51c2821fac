"""Ten thousand random machines: status of traces, accuracy of special points, stability and motions after jumps.

    python -m studies.random.campaign [--quick] [-o DIR]

Spur pairs, double-helical pairs, pairs on bearings and two masses with one or two elements (`studies.random.machines`),
each traced by the default call on one core. Every status is checked: whether the curve ends at its stated end, solves
its equations, and covers the span or reports the rest. Two hundred machines are compared (`studies.random.truth`):
special points and stability with shooting, landings of jumps with another integration.
Results are stored in the folder ``.store`` by the state of the sources; a stopped run can be resumed.
"""

from __future__ import annotations

from studies import study
from studies.random.collecting import Results, collected
from studies.random.reporting import plot, report

__all__ = ["plot", "report", "run"]

TRACED = {"spur": 8000, "helical": 1250, "bearings": 600, "two": 450}
"""Machines of each kind that are traced; fewer of kinds that take longer."""

COMPARED = {"spur": 80, "helical": 30, "bearings": 40, "two": 50}
"""Machines of each kind that are compared, the first ones."""


def run(quick: bool = False) -> Results:
    """Return the results; ``quick``: the first machine of each kind is traced, one is compared."""
    return collected(__name__, TRACED, COMPARED, quick)


if __name__ == "__main__":
    study.main()
