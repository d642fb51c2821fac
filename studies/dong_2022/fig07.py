"""Figure 7: damping of the mesh at W = 0 and 0.6: more of it, smaller and smoother motion, the same at both W.

    python -m studies.dong_2022.fig07 [--quick] [-o DIR]

At zeta = 0.07 the teeth still lose contact, at W = 0.6 as at W = 0; at zeta = 0.1 they do not.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from studies import study
from studies.dong_2022 import base, family

MEMBERS = family.listed("zeta", r"$\zeta$", base.ZETA)


def run(quick: bool = False) -> dict[str, family.Family]:
    """One curve for each damping ratio at both W."""
    return family.at_two_backlashes(MEMBERS, quick)


def plot(results: dict[str, family.Family]) -> Figure:
    """A panel for each W."""
    return family.draw_two_backlashes(results)


def report(results: dict[str, family.Family]) -> str:
    """The table of both panels."""
    return family.table(results["narrow"] + results["wide"])


if __name__ == "__main__":
    study.main()
