"""Figure 8: transmission error e: larger error, larger motion, but only the largest set makes folds and jumps.

    python -m studies.dong_2022.fig08 [--quick] [-o DIR]

Errors are in units of b_c, in the sign of the default reading, where they add to the stiffness variation.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from studies import study
from studies.dong_2022 import base, family

MEMBERS = family.listed("e", "$e_l$", base.E)
NEAR = (0.9, 0.78)
"""Omega of the second panel."""


def run(quick: bool = False) -> dict[str, family.Family]:
    """One curve for each set of error harmonics, and with shorter steps near the main resonance."""
    return {"whole": family.traced(MEMBERS, quick), "near": family.traced(MEMBERS, quick, NEAR)}


def plot(results: dict[str, family.Family]) -> Figure:
    """The whole range, and the folds near the main resonance."""
    return family.draw_near(results["whole"], results["near"], "folds of the largest error")


def report(results: dict[str, family.Family]) -> str:
    """The table."""
    return family.table(results["whole"])


if __name__ == "__main__":
    study.main()
