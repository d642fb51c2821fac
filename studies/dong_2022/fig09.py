"""Figure 9: torque: more load, larger motion further right, and the folds of light loads vanish.

    python -m studies.dong_2022.fig09 [--quick] [-o DIR]

The paper does not print its loads; these are torques on each half of the pinion around its base case. Light loads have
folds and jumps, heavy ones none, but the teeth lose contact at all of them.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from studies import study
from studies.dong_2022 import base, family

MEMBERS = family.listed("torque", "$T$", base.TORQUE, " N m")
NEAR = (0.9, 0.84)
"""Omega of the second panel."""


def run(quick: bool = False) -> dict[str, family.Family]:
    """One curve for each torque, and with shorter steps near the main resonance."""
    return {"whole": family.traced(MEMBERS, quick), "near": family.traced(MEMBERS, quick, NEAR)}


def plot(results: dict[str, family.Family]) -> Figure:
    """The whole range, and the folds near the main resonance."""
    return family.draw_near(results["whole"], results["near"], "folds of light loads")


def report(results: dict[str, family.Family]) -> str:
    """The table."""
    return family.table(results["whole"])


if __name__ == "__main__":
    study.main()
