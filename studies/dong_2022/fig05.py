"""Figure 5: backlash W: all curves of the alternating motion are one; only the largest displacement grows with W.

    python -m studies.dong_2022.fig05 [--quick] [-o DIR]

The teeth lose contact at d = 1 + W. While no tooth makes contact at its back, d - W obeys equations without W: every
motion is shifted by W and keeps its shape, its stability and the frequencies of its special points.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from studies import study
from studies.dong_2022 import base, family

MEMBERS = family.listed("W", "$W$", base.W)


def run(quick: bool = False) -> family.Family:
    """One curve for each W."""
    return family.traced(MEMBERS, quick)


def plot(results: family.Family) -> Figure:
    """Alternating motion, where the curves coincide, and largest displacement, where they do not."""
    figure, (left, right) = family.panels()
    line = family.base_of(results) or results[:1]
    family.draw_family(left, line, ("GR", "PD"), "(a) alternating motion: all $W$ coincide (circles)")
    family.draw_dots(left, [pair for pair in results if pair not in line], count=16)
    family.draw_family(right, results, (), "(b) largest displacement", "max")
    right.set_ylabel("largest gap $|d|/b_c$ [-]")
    family.legend(figure, results)
    return figure


def report(results: family.Family) -> str:
    """The table, with the largest displacement of each curve."""
    largest = ", ".join(f"{curve.amplitude('max').max():.4f} ({member.name})" for member, curve in results)
    return f"{family.table(results)}\nLargest displacement: {largest}.\n"


if __name__ == "__main__":
    study.main()
