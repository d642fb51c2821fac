"""Figure 6: variation of the mesh stiffness at W = 0 and 0.6: less variation, smaller motion, and no impact.

    python -m studies.dong_2022.fig06 [--quick] [-o DIR]

The teeth no longer lose contact with the second set. They do not at W = 0 either: the curves of both W are the same.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from studies import study
from studies.dong_2022 import base, family

MEMBERS = family.listed("eps", r"$\varepsilon_l$", base.EPS)


def run(quick: bool = False) -> dict[str, family.Family]:
    """One curve for each set of stiffness harmonics at both W."""
    return family.at_two_backlashes(MEMBERS, quick)


def plot(results: dict[str, family.Family]) -> Figure:
    """A panel for each W."""
    return family.draw_two_backlashes(results)


def report(results: dict[str, family.Family]) -> str:
    """The table of both panels."""
    return family.table(results["narrow"] + results["wide"])


if __name__ == "__main__":
    study.main()
