"""Families of response curves of the pair: what Figures 5 to 9 share.

A family is a list of `Member`, each a change of the base case. The amplitude A is half the peak-to-peak of the left
gap in units of b_c. The slope is dA/dOmega between neighbouring points of a curve, "vertical" where it has a fold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.dong_2022 import base
from studies.dong_2022.claims import case

OMEGA = r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]"
AMPLITUDE = "half peak-to-peak of the gap $d/b_c$ [-]"
BLACK = "#222222"
"""Colour of the base case in every family."""
COLOURS = (study.BLUE, study.ORANGE, study.PURPLE, study.GREEN)
"""Of the members that are not the base case, in this order."""


@dataclass(frozen=True)
class Member:
    """One curve of a family.

    name : in the table. label : in the legend. color : of its line.
    changes : fields of `DoubleHelicalPair`; none for the base case.
    """

    name: str
    label: str
    color: str
    changes: dict[str, Any] = field(default_factory=dict)


Family = list[tuple[Member, hb.Branch]]
"""Members with their curves."""


def listed(field_name: str, symbol: str, values: Sequence[Any], unit: str = "") -> list[Member]:
    """A member for each value of a field of `DoubleHelicalPair`; its default value is the base case.

    Parameters
    ----------
    field_name, symbol : of the field, and in the legend.
    values : numbers, or tuples of the harmonics of the mesh, () standing for 0.
    unit : in the legend, after the value.
    """
    default = getattr(hb.gears.DoubleHelicalPair(), field_name)
    colours = iter(COLOURS)
    members = []
    for value in values:
        text = (", ".join(f"{x:g}" for x in value) or "0") if isinstance(value, tuple) else f"{value:g}"
        label = f"{symbol} = {text}{unit}".replace("-", "\N{MINUS SIGN}")
        is_base = value == default
        changes = {} if is_base else {field_name: value}
        members.append(Member(f"{field_name} = {text}", label, BLACK if is_base else next(colours), changes))
    return members


SECOND_W = 0.6
"""Backlash of the second panel of Figures 6 and 7."""


def with_backlash(members: Sequence[Member], W: float) -> list[Member]:
    """The same members at another W."""
    return [replace(m, name=f"{m.name}, W = {W:g}", changes={**m.changes, "W": W}) for m in members]


def base_of(family: Family) -> Family:
    """The member in black alone."""
    return [(member, curve) for member, curve in family if member.color == BLACK]


def traced(members: Sequence[Member], quick: bool = False, span: tuple[float, float] = base.SPAN) -> Family:
    """The curves; the quick form has those of the first and the last member, around the main resonance."""
    if quick:
        return [(m, base.curve(8, (1.1, 0.75), **m.changes)) for m in (members[0], members[-1])]
    return [(member, base.curve(span=span, **member.changes)) for member in members]


def panels() -> tuple[Figure, Any]:
    """Figure and axes of two panels side by side."""
    return plt.subplots(1, 2, figsize=(7.4, 3.7), layout="constrained")


def draw_family(
    ax: Axes, family: Family, kinds: Sequence[str], title: str, measure: str = "pp2", jumps: bool = True
) -> None:
    """Each curve as a line in its colour; unstable dashed, jumps and special points of these kinds marked."""
    for member, curve in family:
        options: Any = {"special": False, "jumps": jumps, "legend": False, "dimensionless": True}
        draw.response(curve, measure, ax=ax, color=member.color, **options)
        for point in curve.special:
            if point.kind in kinds:
                marker, name = draw.MARKERS[point.kind]
                ax.plot(
                    point.parameters["Omega"],
                    point.amplitude(measure),
                    marker,
                    ms=4.5,
                    mfc="white",
                    mec=member.color,
                    mew=0.9,
                    zorder=6,
                    label=name,
                )
    ax.set(xlabel=OMEGA, ylabel=AMPLITUDE)
    ax.set_ylim(bottom=0)
    ax.set_xlim(min(curve.values.min() for _, curve in family), max(curve.values.max() for _, curve in family))
    ax.set_title(title, loc="left")


def draw_dots(ax: Axes, family: Family, measure: str = "pp2", count: int = 24) -> None:
    """Each curve as few open circles, for one that coincides with a line drawn before; the circles take turns."""
    for i, (member, curve) in enumerate(family):
        x, A = curve.values, curve.amplitude(measure)
        size = np.hypot(np.diff(x) / np.ptp(x), np.diff(A) / (np.ptp(A) or 1.0))
        along = np.append(0.0, np.cumsum(size))
        at = (np.arange(count) + (i + 0.5) / len(family)) / count * along[-1]
        ax.plot(
            np.interp(at, along, x),
            np.interp(at, along, A),
            "o",
            ms=3.6,
            mfc="white",
            mec=member.color,
            mew=0.9,
            zorder=5,
            gid="coincides",
        )


def legend(figure: Figure, family: Family, extra: Sequence[Line2D] = ()) -> None:
    """Legend above the panels: the members, extra lines, then the styles and symbols that occur."""
    handles: list[Line2D] = [Line2D([], [], color=m.color, lw=1.4, label=m.label) for m, _ in family]
    lines = [line for ax in figure.axes for line in ax.lines]
    seen = {str(line.get_label()) for line in lines}
    handles += extra
    if any(line.get_linestyle() == "--" for line in lines):
        handles.append(Line2D([], [], color="#555555", ls="--", lw=1.2, label="unstable"))
    for marker, name in draw.MARKERS.values():
        if name in seen:
            handles.append(Line2D([], [], ls="none", marker=marker, ms=4.5, mfc="white", mec="#555555", label=name))
    figure.legend(handles=handles, loc="outside upper center", ncols=5 if len(family) > 4 else 4)


def at_two_backlashes(members: Sequence[Member], quick: bool = False) -> dict[str, Family]:
    """The curves at W = 0 and at the W of the second panel."""
    return {"narrow": traced(members, quick), "wide": traced(with_backlash(members, SECOND_W), quick)}


def draw_two_backlashes(results: dict[str, Family]) -> Figure:
    """Panels of `at_two_backlashes`, the curves at W = 0 as circles over the second."""
    narrow, wide = results["narrow"], results["wide"]
    figure, (left, right) = panels()
    draw_family(left, narrow, ("GR", "PD"), "(a) $W = 0$")
    draw_family(right, wide, (), f"(b) $W = {SECOND_W:g}$: the same curves")
    draw_dots(right, narrow)
    circle = Line2D([], [], ls="none", marker="o", ms=3.6, mfc="white", mec="#555555", label="in (b): the curve of (a)")
    legend(figure, narrow, [circle])
    return figure


def draw_near(whole: Family, near: Family, title: str) -> Figure:
    """Panels of the whole range, and of curves near the main resonance with folds and jumps."""
    figure, (left, right) = panels()
    draw_family(left, whole, ("GR", "PD"), "(a) whole range", jumps=False)
    draw_family(right, near, ("GR", "LP", "NS"), f"(b) {title}")
    legend(figure, whole)
    return figure


# ---- the table


def stretches(curve: hb.Branch, rows: np.ndarray) -> list[tuple[float, float]]:
    """Ranges of the parameter in which consecutive rows are true, up to the special points that border them."""
    border = {point.index for point in curve.special}
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    out = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        first = first - 1 if first - 1 in border else first
        end = end + 1 if end in border else end
        x = curve.values[first:end]
        out.append((float(x.min()), float(x.max())))
    return out


def parted(curve: hb.Branch) -> list[tuple[float, float]]:
    """Ranges of Omega in which the teeth lose contact."""
    return stretches(curve, np.array([name != "no_impact" for name in curve.regimes]))


def unstable(curve: hb.Branch) -> list[tuple[float, float]]:
    """Ranges of Omega in which the motion is unstable."""
    assert curve.stable is not None
    return stretches(curve, ~curve.stable)


def table(family: Family) -> str:
    """Peak, folds, jumps, slope, impact and stability of each curve, in Markdown."""
    head = ["set", "peak A", "at Omega", "folds", "jumps", "steepest dA/dOmega", "impact regime", "unstable in Omega"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join([member.name, *cells(curve)]) + " |" for member, curve in family]
    return "\n".join([*lines, ""])


def cells(curve: hb.Branch) -> list[str]:
    """Cells of the table after the name."""
    numbers = case(curve)
    folds = [f"{point.label} {point.parameters['Omega']:.5f}" for point in curve.special if point.kind == "LP"]
    jumps = [f"{'up' if jump.direction > 0 else 'down'} {jump.value:.5f} ({jump.label})" for jump in curve.jumps()]
    slope = "vertical" if folds else f"{numbers.slope:.1f} at {numbers.slope_at:.4f}"
    impact = [f"{low:.5f}-{high:.5f}" for low, high in parted(curve)]
    worst = "double-sided" if "double_sided" in curve.regimes else "single-sided"
    lost = [f"{low:.5f}-{high:.5f}" for low, high in unstable(curve)]
    return [
        f"{numbers.peak:.4f}",
        f"{numbers.peak_at:.4f}",
        ", ".join(folds) or "none",
        ", ".join(jumps) or "none",
        slope,
        f"{worst} in {', '.join(impact)}" if impact else "no impact",
        ", ".join(lost) or "none",
    ]
