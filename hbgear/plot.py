"""Figures of branches and points: functions that take one, draw on matplotlib axes and return them.

Stable motions are drawn solid, unstable ones dashed, those of unknown stability solid and thin; the colour is the
impact regime. Nothing here changes matplotlib's settings, and matplotlib is imported only when something is drawn.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbgear.branch import REGIMES, Branch, Jump, Layout, Point, SpecialPoint
from hbgear.fourier import Array
from hbgear.replacing import replacing

State = tuple[str, bool | None]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hbgear.maps import JumpMap

COLOURS = {"no_impact": "#1f4e8c", "single_sided": "#d9730d", "double_sided": "#9c1f5c", "unknown": "#333333"}
LINES: dict[bool | None, tuple[Any, float]] = {True: ("-", 1.4), False: ("--", 1.2), None: ("-", 0.7)}
MARKERS = {"LP": ("o", "fold (LP)"), "PD": ("D", "period doubling (PD)"), "NS": ("s", "Neimark-Sacker (NS)"),
           "BP": ("P", "branch point (BP)"), "GR": ("x", "grazing (GR)"), "CP": ("*", "cusp (CP)")}  # fmt: skip
MEASURES = {"rms": "alternating rms", "pp2": "half peak-to-peak", "max": "largest magnitude", "mean": "mean"}
GREY = "#8a8a8a"
FONT = ["STIXGeneral", "DejaVu Serif"]
STYLE: Any = {
    "font.family": FONT, "font.size": 9, "mathtext.fontset": "stix", "axes.linewidth": 0.6, "axes.labelsize": 10,
    "axes.titlesize": 9, "legend.fontsize": 8, "legend.frameon": False, "lines.linewidth": 1.2, "axes.grid": False,
    "figure.facecolor": "white", "axes.facecolor": "white", "axes.edgecolor": "black", "text.color": "black",
}  # fmt: skip


def response(
    branch: Branch,
    measure: str = "pp2",
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    color: str | None = None,
    label: str | None = None,
    special: bool = True,
    jumps: bool = True,
    legend: bool = True,
) -> Axes:
    """Response curve: a measure of an element against the branch's parameter.

    Parameters
    ----------
    branch, measure, element : see `Branch.amplitude`.
    ax : axes to draw on; new ones by default.
    color : one colour for the whole curve instead of one for each impact regime.
    label : name of the curve in the legend, to tell several apart; it is then drawn in one colour, by default black.
    special, jumps : whether special points are marked and jumps drawn as arrows.
    legend : whether to add one.

    Raises
    ------
    ValueError, KeyError
        If there is no such measure or element.
    """
    amplitude = branch.amplitude(measure, element)
    names = branch.layout.labels if branch.layout else {}
    with _style():
        ax = _axes(ax, (5.0, 3.4))
        _curve(ax, branch, amplitude, element, "black" if label and not color else color, label)
        if jumps:
            for jump in branch.jumps():
                _arrow(ax, branch, jump, measure, element)
        if special:
            for point in branch.special:
                _mark(ax, branch, point, point.amplitude(measure, element))
        ax.set_xlabel(names.get(branch.parameter, r"$\Omega$" if branch.parameter == "Omega" else branch.parameter))
        ax.set_ylabel(f"{MEASURES.get(measure, f'harmonic {measure[1:]}')} of {_gap(branch.layout, element)}")
        _dress(ax)
        if legend:
            _legend(ax)
    return ax


def responses(branches: Sequence[Branch], measure: str = "pp2", element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Several branches on the same axes, drawn as `response` draws one."""
    for branch in branches:
        ax = response(branch, measure, element, ax)
    if ax is None:
        raise ValueError("no branch to draw")
    return ax


def jump_map(jumps: JumpMap, ax: Axes | None = None, *, legend: bool = True) -> Axes:
    """Jump frequencies against a design parameter, several motions shaded, cusps marked with their value.

    Solid: the jump a sweep meets while Omega rises; dash-dotted: while it falls.
    """
    names = {1: (r"jump while $\Omega$ rises", "-"), -1: (r"jump while $\Omega$ falls", "-.")}
    with _style():
        ax = _axes(ax, (5.0, 3.4))
        _shade(ax, jumps)
        for arm in jumps.arms:
            name, style = names[arm.direction]
            ax.plot(arm.values, arm.Omega, style, color=COLOURS["no_impact"], label=name)
        for cusp in jumps.cusps:
            x, y = cusp.parameters[jumps.parameter], cusp.parameters["Omega"]
            marker, name = MARKERS["CP"]
            ax.plot(x, y, marker, markersize=8, color="black", markerfacecolor="white", label=name, gid=cusp.label)
            place = (x - jumps.span[0]) / (jumps.span[1] - jumps.span[0])
            side = "left" if place < 0.1 else "right" if place > 0.9 else "center"
            ax.annotate(f"{x:.5g}, {y:.4g}", (x, y), (0, 8), textcoords="offset points", fontsize=8, ha=side)
        ax.set_xlim(*jumps.span)
        ax.margins(y=0.12)
        ax.set_xlabel(jumps.labels.get(jumps.parameter, jumps.parameter))
        ax.set_ylabel(jumps.labels.get("Omega", r"$\Omega$"))
        _dress(ax)
        if not jumps.arms:
            ax.text(0.5, 0.5, "no jump found in this range", transform=ax.transAxes, ha="center")
        elif legend:
            drawn: list[Any] = [*ax.lines, *ax.collections]
            handles = {str(artist.get_label()): artist for artist in drawn}
            shown = {label: artist for label, artist in handles.items() if not label.startswith("_")}
            ax.legend(list(shown.values()), list(shown), loc="best")
    return ax


def _shade(ax: Axes, jumps: JumpMap) -> None:
    """The frequencies at which the curve holds several motions, for every value of the parameter."""
    ends = [x for arm in jumps.arms for x in (arm.values[0], arm.values[-1])]
    values = np.unique(np.concatenate([np.linspace(*jumps.span, 600), ends]))
    for low, high in jumps.bands(values):
        ax.fill_between(values, low, high, color=COLOURS["single_sided"], alpha=0.18, linewidth=0,
                        label="several motions")  # fmt: skip


def time_history(point: Point, element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Motion of an element over its period, in periods of the excitation; thin lines at the corners of its law."""
    layout, periods, d = _cycle(point, element)
    with _style():
        ax = _axes(ax, (4.2, 2.8))
        ax.plot(periods, d, color=_colour(point, element))
        ax.set_xlim(0, layout.nu)
        ax.set_xlabel("excitation periods")
        ax.set_ylabel(_gap(layout, element))
        _dress(ax)
        _corners(layout, element, d, ax.axhline, ax.set_ylim)
    return ax


def phase_diagram(point: Point, element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Velocity against displacement, d' = (Omega / nu) dd/dtheta, with a dot once per period of the excitation.

    Raises
    ------
    ValueError
        If the point has no parameter Omega.
    """
    layout, periods, d = _cycle(point, element)
    if "Omega" not in point.parameters:
        raise ValueError(f"a phase diagram needs Omega; the point has {', '.join(point.parameters) or 'no parameters'}")
    v = point.parameters["Omega"] / layout.nu * _cycle(point, element, order=1)[2]
    starts = np.searchsorted(periods, np.arange(layout.nu))
    with _style():
        ax = _axes(ax, (3.2, 2.8))
        colour = _colour(point, element)
        ax.plot(d, v, color=colour)
        ax.plot(d[starts], v[starts], "o", color=colour, markersize=3.5)
        ax.set_xlabel(_gap(layout, element))
        ax.set_ylabel(layout.labels.get("velocity", f"velocity of {_gap(layout, element)}"))
        _dress(ax)
        _corners(layout, element, d, ax.axvline, ax.set_xlim)
    return ax


def spectrum(point: Point, element: int | str = 0, ax: Axes | None = None, *, log: bool = False) -> Axes:
    """Amplitude of each harmonic, the mean left out, over multiples of the excitation frequency."""
    from matplotlib.ticker import MaxNLocator

    row = point.coefficients(element)
    layout = _cycle(point, element)[0]
    order = np.arange(1, layout.harmonics + 1) / layout.nu
    height = np.hypot(row[1::2], row[2::2])
    floor = max(height.min() / 2, height.max() * 1e-8) if log else 0.0
    order, height = order[height >= floor], height[height >= floor]
    with _style():
        ax = _axes(ax, (4.2, 2.8))
        ax.vlines(order, floor, height, color=_colour(point, element), linewidth=1.2)
        ax.plot(order, height, "o", color=_colour(point, element), markersize=3, clip_on=False)
        if log:
            ax.set_yscale("log")
        ax.set_ylim(bottom=floor)
        ax.set_xlim(0, (layout.harmonics + 1) / layout.nu)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        ax.set_xlabel("frequency / excitation frequency")
        ax.set_ylabel(f"amplitude of {_gap(layout, element)}")
        _dress(ax)
    return ax


def portrait(point: Point, element: int | str = 0) -> Figure:
    """Time history, phase diagram and spectrum of a point side by side."""
    import matplotlib.pyplot as plt

    with _style():
        figure, axes = plt.subplots(1, 3, figsize=(9.0, 2.9), layout="constrained")
        for draw, ax in zip((time_history, phase_diagram, spectrum), axes, strict=True):
            draw(point, element, ax)
        figure.suptitle(_title(point, element), fontsize=10)
    return figure


def save(drawing: Axes | Figure, path: str | os.PathLike[str], dpi: int = 200) -> None:
    """Write the figure of these axes as .png, .pdf or .svg, whole or not at all.

    Raises
    ------
    ValueError
        If the path ends in something else.
    """
    import matplotlib

    kind = Path(path).suffix.lower().removeprefix(".")
    if kind not in ("png", "pdf", "svg"):
        raise ValueError(f"'{path}' must end in .png, .pdf or .svg")
    figure: Any = drawing if hasattr(drawing, "savefig") else drawing.figure
    with matplotlib.rc_context({"pdf.fonttype": 42, "svg.fonttype": "path"}), replacing(path) as handle:
        figure.savefig(handle, format=kind, dpi=dpi)


def _style() -> Any:
    import matplotlib

    return matplotlib.rc_context(STYLE)


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=size, layout="constrained")[1]


def _dress(ax: Axes) -> None:
    """Ticks are made when they are drawn, outside our settings, so theirs are given to the axes."""
    ax.tick_params(which="both", direction="in", top=True, right=True, width=0.6, labelsize=9, labelfontfamily=FONT[0])
    ax.tick_params(which="major", length=3.5)
    ax.tick_params(which="minor", length=2)


def _gap(layout: Layout | None, element: int | str) -> str:
    """Symbol of the motion of an element, with its name if there are several."""
    if layout is None:
        return "gap (model units)"
    name = f", {layout.elements[layout.index(element)]}" if len(layout.elements) > 1 else ""
    return layout.labels.get("amplitude", "gap (model units)") + name


def _regime(layout: Layout | None, codes: NDArray[np.int8], element: int | str) -> str:
    """Regime of one element, "unknown" too for a law without corners: it has no impacts."""
    j = layout.index(element) if layout else 0
    if len(codes) <= j or codes[j] < 0 or (layout and not layout.breakpoints[j]):
        return "unknown"
    return REGIMES[min(codes[j], len(REGIMES) - 1)]


def _colour(point: Point, element: int | str) -> str:
    return COLOURS[_regime(point.layout, point.regime, element)]


def _words(regime: str) -> str:
    return regime.replace("_sided", "-sided").replace("_", " ")


def _title(point: Point, element: int | str) -> str:
    """What a point is: label, Omega, stability, regime."""
    regime = _regime(point.layout, point.regime, element)
    parts = [point.label, {True: "stable", False: "unstable", None: ""}[point.stable]]
    parts += [_words(regime) if regime != "unknown" else ""]
    if "Omega" in point.parameters:
        parts.insert(1, rf"$\Omega$ = {point.parameters['Omega']:.5g}")
    return ", ".join(part for part in parts if part)


def _states(branch: Branch, element: int | str) -> list[State]:
    """Regime of the element and stability of each row."""
    stable: list[bool | None] = [None] * len(branch)
    if branch.multipliers is not None and branch.stable is not None:
        failed = np.asarray(np.isnan(branch.multipliers).any(axis=1))
        stable = [None if failed[i] else bool(ok) for i, ok in enumerate(branch.stable)]
    return [(_regime(branch.layout, codes, element), s) for codes, s in zip(branch.regime, stable, strict=True)]


def _runs(branch: Branch, element: int | str) -> list[tuple[State, int, int]]:
    """Stretches ``(state, first row, last row)`` of one regime and stability; each starts where the last one ended.

    A special point is the border between two stretches: the piece of curve beside it has the state of its other end.
    """
    states = _states(branch, element)
    border = {point.index for point in branch.special}
    runs = [(states[0], 0, 0)] if len(states) == 1 else []
    for i in range(len(states) - 1):
        state = states[i + 1] if i in border and i + 1 not in border else states[i]
        if runs and runs[-1][0] == state:
            runs[-1] = (state, runs[-1][1], i + 1)
        else:
            runs.append((state, i, i + 1))
    return runs


def _curve(
    ax: Axes, branch: Branch, amplitude: Array, element: int | str, color: str | None, label: str | None
) -> None:
    for (regime, stable), first, last in _runs(branch, element):
        name = "_curve" if color or regime == "unknown" else _words(regime)
        style, width = LINES[stable]
        rows = slice(first, last + 1)
        ax.plot(
            branch.values[rows], amplitude[rows], linestyle=style, linewidth=width, color=color or COLOURS[regime],
            marker="." if first == last else None, label=label or name, gid=f"branch {regime} {stable}",
        )  # fmt: skip


def _arrow(ax: Axes, branch: Branch, jump: Jump, measure: str, element: int | str) -> None:
    """Vertical arrow from the amplitude before a jump to the one after it."""
    if jump.after is None or jump.parameter != branch.parameter:
        return
    start, end = ((jump.value, point.amplitude(measure, element)) for point in (jump.before, jump.after))
    style = {"arrowstyle": "-|>", "color": "#777777", "linewidth": 0.8, "shrinkA": 3, "shrinkB": 0, "mutation_scale": 8}
    ax.annotate("", xy=end, xytext=start, arrowprops=style, zorder=3)


def _mark(ax: Axes, branch: Branch, point: SpecialPoint, height: float) -> None:
    """Symbol of a special point; folds also carry their label, on the side the curve leaves free."""
    marker, name = MARKERS.get(point.kind, ("+", point.kind))
    x = point.parameters[branch.parameter]
    ax.plot(
        x, height, marker, markersize=4.5, markerfacecolor="white", markeredgecolor="black", markeredgewidth=0.9,
        label=name, zorder=4, gid=point.label,
    )  # fmt: skip
    if point.kind == "LP":
        around = branch.values[max(point.index - 1, 0) : point.index + 2]
        side = 1 if x >= around.mean() else -1
        where: Any = {"textcoords": "offset points", "va": "center", "ha": "left" if side > 0 else "right"}
        ax.annotate(point.label, (x, height), (5 * side, 0), fontsize=8, **where)


def _legend(ax: Axes) -> None:
    """One entry for each colour, style and symbol that occurs on the axes."""
    from matplotlib.lines import Line2D

    ranks = [*map(_words, REGIMES), "unstable", *(name for _, name in MARKERS.values())]
    entries: dict[str, Line2D] = {}
    for line in ax.lines:
        curve, label = str(line.get_gid()).startswith("branch"), str(line.get_label())
        if curve and line.get_linestyle() == "--" and "unstable" not in entries:
            style, width = LINES[False]
            entries["unstable"] = Line2D([], [], color="#555555", linestyle=style, linewidth=width)
        if not label.startswith("_") and label not in entries:
            entries[label] = Line2D([], [])
            entries[label].update_from(line)
            if curve:
                entries[label].set(linestyle="-", linewidth=LINES[True][1], marker="None")
    labels = sorted(entries, key=lambda label: ranks.index(label) if label in ranks else -1)
    if labels:
        ax.legend([entries[label] for label in labels], labels, loc="best", handlelength=2.2, borderaxespad=0.8)


def _cycle(point: Point, element: int | str, order: int = 0) -> tuple[Layout, Array, Array]:
    """Layout, time in excitation periods, and motion or its derivative in theta, the end joined to the start."""
    theta, d = point.samples(element, order=order)
    layout = point.layout
    assert layout is not None  # else there are no samples
    return layout, np.append(theta / (2 * np.pi), 1.0) * layout.nu, np.append(d, d[0])


def _corners(layout: Layout, element: int | str, d: Array, line: Any, limits: Any) -> None:
    """Thin lines where the law has a corner; the view takes in those within reach of the motion."""
    low, high = d.min(), d.max()
    reach = max(high - low, 1e-12 * abs(high), 1e-300)
    corners = layout.breakpoints[layout.index(element)]
    for x in corners:
        line(x, color=GREY, linewidth=0.7, zorder=0, gid="corner")
    seen = [low, high, *(x for x in corners if low - reach <= x <= high + reach)]
    margin = 0.06 * (max(seen) - min(seen)) or 0.5
    limits(min(seen) - margin, max(seen) + margin)
