"""Figures of branches and points: functions that take one, draw on matplotlib axes and return them.

Stable motions are drawn solid, unstable ones dashed, those of unknown stability solid and thin. On one curve the colour
is the impact regime; of several curves each has its own colour, and the width of the line is the regime. Nothing here
changes matplotlib's settings, and matplotlib is imported only when something is drawn.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.messages import quoted
from hbgear.common.replacing import replacing
from hbgear.continuation.branch import Branch, Jump, Point, SpecialPoint
from hbgear.continuation.events import Event
from hbgear.harmonic.events import KINDS, named
from hbgear.harmonic.landings import landings
from hbgear.harmonic.observables import REGIMES, Layout, layout_of
from hbgear.harmonic.speeds import MESH, PINION, common_scales, model_of, same_scales, scales, speeds_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hbgear.harmonic.jump_map import JumpMap
    from hbgear.mechanics.model import Model


State = tuple[str, bool | None]


COLOURS = {"no_impact": "#1f4e8c", "single_sided": "#d9730d", "double_sided": "#9c1f5c", "unknown": "#333333"}


LINES: dict[bool | None, tuple[Any, float]] = {True: ("-", 1.4), False: ("--", 1.2), None: ("-", 0.7)}


def legend_entry(event: Event | SpecialPoint) -> str:
    """What a legend says of a kind of special points: its meaning as far as a colon, and the kind."""
    what = event.meaning.partition(":")[0]
    return what if what == event.kind else f"{what} ({event.kind})"


MARKERS = {kind: (event.marker, legend_entry(event)) for kind, event in KINDS.items()}
"""Marker and entry of a legend of every kind of special point that hbgear knows itself; users' events bring theirs."""


MEASURES = {"rms": "alternating rms", "pp2": "half peak-to-peak", "max": "largest magnitude", "mean": "mean"}


BRANCHES = ("#0072b2", "#d55e00", "#009e73", "#b3478c", "#000000", "#e69f00", "#56b4e9", "#7a5c00")
"""Colours of several branches in this order (after Okabe and Ito), told apart by colour-blind readers too."""


WIDTHS = {"no_impact": 1.1, "single_sided": 2.0, "double_sided": 3.0, "unknown": 1.3}
"""Line widths of the regimes where the colour is the branch."""


FLOOR = 1e-6
"""Lines of a spectrum below this share of the largest are not drawn (-120 dB)."""


GREY = "#8a8a8a"


FONT = ["STIXGeneral", "DejaVu Serif"]


_METADATA: dict[str, Any] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": {"Date": None, "Creator": None},
}
"""Neither times nor versions, so that a figure made again is the same file."""


STYLE: Any = {
    "font.family": FONT, "font.size": 9, "mathtext.fontset": "stix", "axes.linewidth": 0.6, "axes.labelsize": 10,
    "axes.titlesize": 9, "legend.fontsize": 8, "legend.frameon": False, "lines.linewidth": 1.2, "axes.grid": False,
    "figure.facecolor": "white", "axes.facecolor": "white", "axes.edgecolor": "black", "text.color": "black",
}  # fmt: skip


@checked_arguments()
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
    speeds: bool | None = None,
) -> Axes:
    """Response curve: a measure of an element against the branch's parameter.

    Parameters
    ----------
    branch, measure, element : see `Branch.amplitude`.
    ax : axes to draw on; new ones by default. On these an unstable piece too short to be seen is also drawn enlarged.
    color : one colour for the whole curve instead of one for each impact regime.
    label : name of the curve in the legend, to tell several apart; it is then drawn in one colour, by default black.
    special, jumps : whether special points are marked and jumps drawn as arrows.
    legend : whether to add one.
    speeds : whether to add axes of the mesh frequency [Hz] and the speed of the pinion [r/min] if the model knows
        them; by default on new axes only.

    Raises
    ------
    ValueError, KeyError
        If there is no such measure or element.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.response(curve, "pp2")
    >>> len(axes.lines) > 0
    True
    """
    from matplotlib.colors import is_color_like

    if color is not None and not is_color_like(color):
        raise ValueError(f"there is no colour {quoted(color)}; give one that Matplotlib knows, such as 'tab:blue'")
    amplitude = branch.amplitude(measure, element)
    own = ax is None
    with _style():
        ax = _axes(ax, (5.0, 3.4))
        _curve(ax, branch, amplitude, element, "black" if label and not color else color, label)
        if jumps:
            for jump in branch.jumps():
                _arrow(ax, branch, jump, measure, element)
        if special:
            _marks(ax, branch, measure, element)
        _name_axes(ax, branch, measure, element)
        if (own if speeds is None else speeds) and speed_axes(ax, [branch]) and own:
            _heighten(ax)
        if own:
            _enlarge(ax, branch, amplitude, element, color)
        if legend:
            _legend(ax)
    return ax


@checked_arguments()
def responses(
    branches: Sequence[Branch],
    measure: str = "pp2",
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    names: Sequence[str] | None = None,
    legend: bool = True,
    speeds: bool | None = None,
) -> Axes:
    """Several branches on the same axes: the colour is the branch, the width of the line the impact regime.

    Labels of special points carry the number of their branch, "LP1 (2)", which stands before its name in the legend.
    Jumps are drawn to wherever they land on any of the branches. One branch alone is drawn as by `response`.

    Parameters
    ----------
    branches, measure, element : see `Branch.amplitude`.
    ax : axes to draw on; new ones by default.
    names : of the branches in the legend; "branch 1", ... by default.
    legend, speeds : as of `response`.

    Raises
    ------
    ValueError, KeyError
        If there is no branch, not a name for each, or no such measure or element.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curves = [hb.trace(problem, "Omega", (0.8, 0.9), at={"F": F}) for F in (0.1, 0.2)]
    >>> axes = hb.plot.responses(curves, names=["F = 0.1", "F = 0.2"])
    """
    if not branches:
        raise ValueError("no branch to draw")
    if names is not None and len(names) != len(branches):
        raise ValueError(f"{len(names)} names for {len(branches)} branches; give one for each")
    if len(branches) == 1:
        return response(branches[0], measure, element, ax, legend=legend, speeds=speeds)
    own = ax is None
    with _style():
        ax = _axes(ax, (6.4, 3.8))
        for i, branch in enumerate(branches):
            name = f"({i + 1}) {names[i]}" if names else f"branch {i + 1}"
            colour = BRANCHES[i % len(BRANCHES)]
            _curve(ax, branch, branch.amplitude(measure, element), element, colour, name, WIDTHS)
        for branch, found in zip(branches, landings(branches), strict=True):
            for landing in found:
                _arrow(ax, branch, landing.jump, measure, element)
        for branch in branches:
            _marks(ax, branch, measure, element, numbered=True)
        _name_axes(ax, branches[0], measure, element)
        if (own if speeds is None else speeds) and speed_axes(ax, branches) and own:
            _heighten(ax)
        if legend:
            _legend(ax, outside=own)
    return ax


def speed_axes(ax: Axes, branches: Sequence[Branch]) -> list[Any]:
    """Axes above these of the speed of the pinion [r/min] and the mesh frequency [Hz].

    None are added if the model does not know its units, or the branches differ in what Omega = 1 is.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.DoubleHelicalPair(), 4)
    >>> curve = hb.trace(pair, "Omega", (1.6, 1.5))
    >>> axes = hb.plot.response(curve, speeds=False)
    >>> [axis.get_xlabel() for axis in hb.plot.speed_axes(axes, [curve])]
    ['speed of the pinion [r/min]', 'mesh frequency [Hz]']
    """
    return _scaled_axes(ax, common_scales(branches))


def _scaled_axes(ax: Axes, known: dict[str, float], side: str = "top", title: str = "mesh frequency [Hz]") -> list[Any]:
    """Axes at the top or on the right of Omega, or of an order of it, times each scale."""
    titles = {PINION: "speed of the pinion [r/min]", MESH: title}
    added: list[Any] = []
    for name in [name for name in titles if name in known]:
        make = ax.secondary_xaxis if side == "top" else ax.secondary_yaxis
        extra: Any = make(side, functions=_times(known[name]))  # type: ignore[arg-type]
        extra.spines[side].set_position(("outward", (30.0 if side == "top" else 46.0) * len(added)))
        (extra.set_xlabel if side == "top" else extra.set_ylabel)(titles[name], fontsize=9, labelpad=3)
        extra.tick_params(direction="in", width=0.6, length=3.5, labelsize=8, labelfontfamily=FONT[0], pad=2)
        added.append(extra)
    if added:
        ax.tick_params(which="both", top=side != "top", right=side != "right")
    return added


def _times(scale: float) -> tuple[Any, Any]:
    """Multiplication by a number, and its inverse."""
    return (lambda x: x * scale), (lambda y: y / scale)


def _heighten(ax: Axes) -> None:
    """Room for the axes above."""
    figure: Any = ax.figure
    figure.set_figheight(figure.get_figheight() + 0.6)


@checked_arguments()
def jump_map(jumps: JumpMap, ax: Axes | None = None, *, legend: bool = True) -> Axes:
    """Jump frequencies against a design parameter, several motions shaded, cusps marked with their value.

    Solid: the jump a sweep meets while Omega rises; dash-dotted: while it falls.

    Examples
    --------
    >>> import hbgear as hb
    >>> jumps = hb.jump_map(hb.Duffing(), "zeta", (0.05, 0.06), frequencies=(0.9, 1.4), harmonics=1, seeds=2)
    >>> axes = hb.plot.jump_map(jumps)
    """
    names = {1: (r"jump while $\Omega$ rises", "-"), -1: (r"jump while $\Omega$ falls", "-.")}
    own = ax is None
    with _style():
        ax = _axes(ax, (5.0, 3.4))
        _shade(ax, jumps)
        for arm in jumps.arms:
            name, style = names[arm.direction]
            ax.plot(arm.values, arm.Omega, style, color=COLOURS["no_impact"], label=name)
        for cusp in jumps.cusps:
            x, y = cusp.parameters[jumps.parameter], cusp.parameters["Omega"]
            ax.plot(x, y, cusp.marker, markersize=8, color="black", markerfacecolor="white", label=legend_entry(cusp),
                    gid=cusp.label)  # fmt: skip
            place = (x - jumps.span[0]) / (jumps.span[1] - jumps.span[0])
            side = "left" if place < 0.1 else "right" if place > 0.9 else "center"
            ax.annotate(f"{x:.5g}, {y:.4g}", (x, y), (0, 8), textcoords="offset points", fontsize=8, ha=side)
        ax.set_xlim(*jumps.span)
        ax.margins(y=0.12)
        ax.set_xlabel(jumps.labels.get(jumps.parameter, jumps.parameter))
        ax.set_ylabel(jumps.labels.get("Omega", r"$\Omega$"))
        _dress(ax)
        rows = [scales(model_of(fold), fold.parameters_at(i)) for fold in jumps.folds for i in (0, -1)]
        if own and _scaled_axes(ax, same_scales(rows), "right"):
            ax.figure.set_figwidth(6.2)  # type: ignore[union-attr]
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


@checked_arguments()
def time_history(point: Point, element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Motion of an element over its period, in periods of the excitation; thin lines at the corners of its law.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.time_history(curve["LP1"])
    """
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


@checked_arguments()
def phase_diagram(point: Point, element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Velocity against displacement, d' = (Omega / nu) dd/dtheta, with a dot once per period of the excitation.

    Raises
    ------
    ValueError
        If the point has no parameter Omega.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.phase_diagram(curve["LP1"])
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


@checked_arguments()
def spectrum(
    point: Point,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    log: bool = True,
    floor: float = FLOOR,
    model: Model | None = None,
) -> Axes:
    """Amplitude of each harmonic, the mean left out, over multiples of the excitation frequency.

    Parameters
    ----------
    point, element, ax : as of `time_history`.
    log : amplitudes on a logarithmic axis, with decibels of the largest line on the right; else linear.
    floor : share of the largest line below which none is drawn on the logarithmic axis; the figure says so.
    model : if it knows its mesh frequency, axes above give the frequencies in Hz.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.spectrum(curve["LP1"])
    """
    from matplotlib.ticker import MaxNLocator

    row = point.coefficients(element)
    layout = _cycle(point, element)[0]
    order = np.arange(1, layout.harmonics + 1) / layout.nu
    height = np.hypot(row[1::2], row[2::2])
    top = float(height.max()) or 1.0
    low = top * floor if log else 0.0
    order, height = order[height >= low], height[height >= low]
    with _style():
        ax = _axes(ax, (4.2, 2.8))
        ax.vlines(order, low, height, color=_colour(point, element), linewidth=1.2)
        ax.plot(order, height, "o", color=_colour(point, element), markersize=3, clip_on=False)
        if log:
            ax.set_yscale("log")
            ax.set_ylim(low, 3 * top)
            _decibels(ax, top, floor)
        ax.set_ylim(bottom=low)
        ax.set_xlim(0, (layout.harmonics + 1) / layout.nu)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        ax.set_xlabel("frequency / excitation frequency")
        ax.set_ylabel(f"amplitude of {_gap(layout, element)}")
        _dress(ax)
        mesh = speeds_at(model, point.parameters).get(MESH)
        if mesh:
            _scaled_axes(ax, {MESH: mesh}, title="frequency [Hz]")
        ax.tick_params(which="both", right=not log)
    return ax


def _decibels(ax: Axes, top: float, floor: float) -> None:
    """An axis on the right in decibels of the largest line; it names the floor."""
    right: Any = ax.secondary_yaxis(
        "right",
        functions=(
            lambda y: 20 * np.log10(np.maximum(y, 1e-300) / top),
            lambda level: top * 10 ** (np.asarray(level) / 20),
        ),
    )
    right.set_yscale("linear")
    lowest = 20 * np.log10(floor)
    right.set_yticks(np.linspace(0.0, lowest, 7 if round(lowest) % 6 == 0 else 5))
    right.minorticks_off()
    right.set_ylabel(f"dB of the largest line, floor \N{MINUS SIGN}{-lowest:.0f} dB", fontsize=8)
    right.tick_params(direction="in", width=0.6, labelsize=8, labelfontfamily=FONT[0])


@checked_arguments()
def portrait(point: Point, element: int | str = 0, model: Model | None = None) -> Figure:
    """Time history, phase diagram and spectrum of a point side by side.

    With the model the title tells the mesh frequency and the speed of the pinion too, if the model knows them.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> figure = hb.plot.portrait(curve["LP1"])
    >>> len(figure.axes)
    3
    """
    import matplotlib.pyplot as plt

    with _style():
        figure, axes = plt.subplots(1, 3, figsize=(9.6, 2.9), layout="constrained")
        time_history(point, element, axes[0])
        phase_diagram(point, element, axes[1])
        spectrum(point, element, axes[2], model=model)
        known = speeds_at(model, point.parameters)
        units = [f"{known[name]:.5g} {unit}" for name, unit in ((MESH, "Hz"), (PINION, "r/min")) if known]
        figure.suptitle(", ".join([_title(point, element), *units]), fontsize=10)
    return figure


@checked_arguments()
def save(drawing: Axes | Figure, path: str | os.PathLike[str], dpi: int = 200) -> None:
    """Write the figure of these axes as .png, .pdf or .svg, whole or not at all; the same figure as the same bytes.

    Raises
    ------
    ValueError
        If the path ends in something else.

    Examples
    --------
    >>> import hbgear as hb
    >>> import os, tempfile
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     hb.plot.save(hb.plot.response(curve), os.path.join(folder, "curve.png"))
    ...
    """
    import matplotlib

    kind = Path(path).suffix.lower().removeprefix(".")
    if kind not in ("png", "pdf", "svg"):
        raise ValueError(f"'{path}' must end in .png, .pdf or .svg")
    figure: Any = drawing if hasattr(drawing, "savefig") else drawing.figure
    settings: Any = {"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "hbgear"}
    with matplotlib.rc_context(settings), replacing(path) as handle:
        figure.savefig(handle, format=kind, dpi=dpi, metadata=_METADATA[kind])


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
    return COLOURS[_regime(layout_of(point), point.regime, element)]


def _words(regime: str) -> str:
    return regime.replace("_sided", "-sided").replace("_", " ")


def _title(point: Point, element: int | str) -> str:
    """What a point is: label, Omega, stability, regime."""
    regime = _regime(layout_of(point), point.regime, element)
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
    layout = layout_of(branch)
    return [(_regime(layout, codes, element), s) for codes, s in zip(branch.regime, stable, strict=True)]


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
    ax: Axes,
    branch: Branch,
    amplitude: Array,
    element: int | str,
    color: str | None,
    label: str | None,
    widths: dict[str, float] | None = None,
) -> None:
    for (regime, stable), first, last in _runs(branch, element):
        name = "_curve" if color or regime == "unknown" else _words(regime)
        style, width = LINES[stable]
        if widths:
            width = widths[regime] * width / LINES[True][1]
        rows = slice(first, last + 1)
        ax.plot(
            branch.values[rows], amplitude[rows], linestyle=style, linewidth=width, color=color or COLOURS[regime],
            marker="." if first == last else None, label=label or name, gid=f"branch {regime} {stable}",
        )  # fmt: skip


def _name_axes(ax: Axes, branch: Branch, measure: str, element: int | str) -> None:
    layout = layout_of(branch)
    names = layout.labels if layout else {}
    ax.set_xlabel(names.get(branch.parameter, r"$\Omega$" if branch.parameter == "Omega" else branch.parameter))
    ax.set_ylabel(f"{MEASURES.get(measure, f'harmonic {measure[1:]}')} of {_gap(layout, element)}")
    _dress(ax)


def _arrow(ax: Axes, branch: Branch, jump: Jump, measure: str, element: int | str) -> None:
    """Vertical arrow from the amplitude before a jump to the one after it."""
    if jump.after is None or jump.parameter != branch.parameter:
        return
    start, end = ((jump.value, point.amplitude(measure, element)) for point in (jump.before, jump.after))
    style = {"arrowstyle": "-|>", "color": "#777777", "linewidth": 0.8, "shrinkA": 3, "shrinkB": 0, "mutation_scale": 8}
    ax.annotate("", xy=end, xytext=start, arrowprops=style, zorder=3)


def _marks(ax: Axes, branch: Branch, measure: str, element: int | str, numbered: bool = False) -> None:
    """Symbols of the special points; all but grazings carry their label, folds on the side the curve leaves free."""
    from hbgear.plot.labels import labels_of

    labels = labels_of(ax)
    labels.curves += 1
    for point in map(named, branch.special):
        x, height = point.parameters[branch.parameter], point.amplitude(measure, element)
        (line,) = ax.plot(
            x, height, point.marker, markersize=4.5, markerfacecolor="white", markeredgecolor="black",
            markeredgewidth=0.9, label=legend_entry(point), zorder=4, gid=point.label,
        )  # fmt: skip
        around = branch.values[max(point.index - 1, 0) : point.index + 2]
        side = (1 if point.kind != "LP" or x >= around.mean() else -1, 0)
        text = f"{point.label} ({labels.curves})" if numbered else point.label
        labels.add(line, labels.curves, point.kind, text, point.kind != "GR", side)


def _legend(ax: Axes, outside: bool = False) -> None:
    """One entry for each colour, width, style and symbol that occurs on the axes; if so asked, beside them."""
    from matplotlib.lines import Line2D

    from hbgear.plot.labels import labels_of

    events = [str(mark.line.get_label()) for mark in labels_of(ax).marks]
    ranks = [*map(_words, REGIMES), "unstable", *(name for _, name in MARKERS.values()), *events]
    entries: dict[str, Line2D] = {}
    for line in ax.lines:
        curve, label = str(line.get_gid()).startswith("branch"), str(line.get_label())
        if curve and line.get_linestyle() == "--" and "unstable" not in entries:
            style, width = LINES[False]
            entries["unstable"] = Line2D([], [], color="#555555", linestyle=style, linewidth=width)
        if curve and outside:  # the width of the line is the regime
            regime = str(line.get_gid()).split()[1]
            if regime != "unknown":
                entries[_words(regime)] = Line2D([], [], color="#555555", linewidth=WIDTHS[regime])
        if not label.startswith("_") and label not in entries:
            entries[label] = Line2D([], [])
            entries[label].update_from(line)
            if curve:
                entries[label].set(linestyle="-", linewidth=LINES[True][1], marker="None")
            entries[label].set_visible(True)
    labels = sorted(entries, key=lambda label: ranks.index(label) if label in ranks else -1)
    if not labels:
        return
    place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)} if outside else {"loc": "best"}
    ax.legend([entries[label] for label in labels], labels, handlelength=2.2, borderaxespad=0.8, **place)


_HIDDEN = 18.0  # points: an unstable piece shorter than that is lost between the symbols at its ends


def _enlarge(ax: Axes, branch: Branch, amplitude: Array, element: int | str, color: str | None) -> None:
    """The longest unstable piece that is too short to be seen, drawn once more on axes within these, enlarged."""
    figure: Any = ax.figure
    size = 72 * 0.85 * np.array(figure.get_size_inches())
    box = np.array([ax.get_xlim(), ax.get_ylim()])
    inside = (np.stack([branch.values, amplitude], axis=1) - box[:, 0]) / (box[:, 1] - box[:, 0])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*(np.diff(inside, axis=0) * size).T))])
    pieces = [(along[last] - along[first], first, last) for first, last in _unstable(branch, element)]
    hidden = [piece for piece in pieces if 0 < piece[0] < _HIDDEN]
    if not hidden:
        return
    _, first, last = max(hidden)
    middle = 0.5 * (inside[first] + inside[last])
    spot = _empty(inside, middle)
    ax.add_patch(_frame(ax, spot))  # legends keep clear of patches
    zoomed = ax.inset_axes((*spot, *_INSET), label="inset")
    _curve(zoomed, branch, amplitude, element, color, None)
    for point in map(named, branch.special):
        at = (point.parameters[branch.parameter], float(amplitude[point.index]))
        zoomed.plot(*at, point.marker, markersize=4.0, markerfacecolor="white",
                    markeredgecolor="black", markeredgewidth=0.9, zorder=4)  # fmt: skip
    rows = slice(first, last + 1)
    for values, limits in ((branch.values[rows], zoomed.set_xlim), (amplitude[rows], zoomed.set_ylim)):
        low, high = float(values.min()), float(values.max())
        room = 0.6 * (high - low) or 0.01 * abs(high) or 1.0
        limits(low - room, high + room)
    zoomed.locator_params(nbins=4)
    zoomed.tick_params(direction="in", top=True, right=True, width=0.6, labelsize=7, labelfontfamily=FONT[0], pad=2)
    ax.indicate_inset_zoom(zoomed, edgecolor=GREY, linewidth=0.6)


_INSET = (0.27, 0.29)  # width and height of enlarged axes, as shares of the whole


_ROOM = (0.085, 0.08)  # what their tick labels take on the left and below


def _unstable(branch: Branch, element: int | str) -> list[tuple[int, int]]:
    """First and last row of every unstable stretch."""
    out: list[tuple[int, int]] = []
    for (_, stable), first, last in _runs(branch, element):
        if stable is False and out and out[-1][1] == first:
            out[-1] = (out[-1][0], last)
        elif stable is False:
            out.append((first, last))
    return out


def _empty(inside: Array, near: Array) -> tuple[float, float]:
    """Lower left corner of the place for enlarged axes that a curve leaves free, the nearest to a point of it."""
    steps = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(inside, axis=0).T))])
    at = np.linspace(0.0, steps[-1], 2000)
    x, y = (np.interp(at, steps, column) for column in inside.T)

    def cost(corner: tuple[float, float]) -> float:
        left, low = corner[0] - _ROOM[0], corner[1] - _ROOM[1]
        right, high = corner[0] + _INSET[0] + 0.02, corner[1] + _INSET[1] + 0.02
        covered = np.mean((x > left) & (x < right) & (y > low) & (y < high))
        centre = np.add(corner, np.divide(_INSET, 2))
        return 1e3 * float(covered) + float(np.hypot(*(centre - near)))

    across = np.linspace(_ROOM[0] + 0.01, 0.98 - _INSET[0], 30)
    up = np.linspace(_ROOM[1] + 0.01, 0.97 - _INSET[1], 30)
    return min(((float(a), float(b)) for a in across for b in up), key=cost)


def _frame(ax: Axes, corner: tuple[float, float]) -> Any:
    """An invisible rectangle under enlarged axes and their tick labels."""
    from matplotlib.patches import Rectangle

    low = (corner[0] - _ROOM[0], corner[1] - _ROOM[1])
    size = (_INSET[0] + _ROOM[0] + 0.02, _INSET[1] + _ROOM[1] + 0.02)
    return Rectangle(low, *size, transform=ax.transAxes, facecolor="none", edgecolor="none", gid="frame")


def _cycle(point: Point, element: int | str, order: int = 0) -> tuple[Layout, Array, Array]:
    """Layout, time in excitation periods, and motion or its derivative in theta, the end joined to the start."""
    theta, d = point.samples(element, order=order)
    layout = layout_of(point)
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
