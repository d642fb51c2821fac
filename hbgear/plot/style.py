"""Style of all figures, and their common parts: axes, secondary axes, legends, files.

Stable motions are drawn solid, unstable ones dashed, undecided ones dotted, those of unknown stability solid and thin.
The colour of one curve is the impact regime. Each of several curves has its own colour, and the line width is the
regime. The settings of matplotlib are unchanged, and matplotlib is imported only when a figure is drawn.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbgear.analysis.quantities.axis_quantities import Abscissa, Ordinate
from hbgear.analysis.quantities.length_units import in_figure
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.text.messages import quoted
from hbgear.continuation.events.event import Event
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.harmonic.bifurcations.events import KINDS, named
from hbgear.harmonic.equations.layout import REGIMES, Layout
from hbgear.harmonic.models.frequency_units import MESH, PINION
from hbgear.mechanics.series.measures import motion_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


State = tuple[str, bool | str | None]
"""Impact regime and stability of a point: True, False, "undecided", or None if the stability is unknown."""


COLOURS = {
    "no_impact": "#1f4e8c",
    "single_sided": "#d9730d",
    "double_sided": "#9c1f5c",
    "stick": "#2b7a78",
    "partial_slip": "#8a6d1f",
    "gross_slip": "#b3361b",
    "unknown": "#333333",
}
"""Colours of the regimes of contact and friction."""


LINES: dict[bool | str | None, tuple[Any, float]] = {
    True: ("-", 1.4),
    False: ("--", 1.2),
    "undecided": (":", 1.6),
    None: ("-", 0.7),
}
"""Line style and width [pt] of stable, unstable and undecided motions, and of those of unknown stability (None)."""


def line_of(stable: bool | str | None) -> dict[str, Any]:
    """Return the line style and width of motions of a stability, as properties of a line."""
    style, width = LINES[stable]
    return {"linestyle": style, "linewidth": width}


def symbol_of(point: SpecialPoint) -> dict[str, Any]:
    """Return the symbol of a special point, filled if it is certified, as properties of a line."""
    face = "black" if point.certificate else "white"
    return {"linestyle": "none", "marker": point.marker, "markeredgecolor": "black", "markerfacecolor": face}


def legend_entry(event: Event | SpecialPoint) -> str:
    """Return the legend entry of a kind of special points: its meaning up to a colon, and the kind.

    Parameters
    ----------
    event : Event or SpecialPoint
        Event, or a special point with its meaning.

    Returns
    -------
    str
        Legend entry.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.plot.legend_entry(hb.Event("limit", lambda point: 1.0, "too large: stop"))
    'too large (limit)'
    """
    meaning = event.meaning.partition(": ")[0]
    kind = "" if meaning == event.kind else f" ({event.kind})"
    return f"{meaning}{kind}{', certified' if getattr(event, 'certificate', None) else ''}"


def mark_special_points(
    ax: Axes,
    branch: Branch,
    abscissa: Abscissa,
    height: Ordinate,
    numbered: bool = False,
    labelled: bool = True,
    kinds: Collection[str] | None = None,
) -> None:
    """Draw symbols of the special points of some or all kinds, filled if certified.

    All but grazing points may have labels.
    """
    from hbgear.plot.labels import labels_of

    labels = labels_of(ax)
    labels.curves += 1
    for point in map(named, branch.special):
        if kinds is not None and point.kind not in kinds:
            continue
        x, y = point.parameters[branch.parameter], height.at(point, branch)
        look = {
            "markersize": 4.5,
            "markeredgewidth": 1.6 if point.certificate else 0.9,
            "zorder": 4,
            **symbol_of(point),
        }
        (line,) = ax.plot(abscissa.at(branch, x), y, **look, gid=point.label, label=legend_entry(point))
        around = branch.values[max(point.index - 1, 0) : point.index + 2]
        side = (1 if point.kind != "LP" or x >= around.mean() else -1, 0)
        text = f"{point.label} ({labels.curves})" if numbered else point.label
        labels.add(line, labels.curves, point.kind, text, labelled and point.kind != "GR", side)


MARKERS = {kind: (event.marker, legend_entry(event)) for kind, event in KINDS.items()}
"""Marker and legend entry of each built-in kind of special point; events of users define their own."""


BRANCHES = ("#0072b2", "#d55e00", "#009e73", "#b3478c", "#000000", "#e69f00", "#56b4e9", "#7a5c00")
"""Colours of several branches in this order; also colour-blind readers can distinguish them (after Okabe and Ito)."""


def branch_colours(count: int) -> list[str]:
    """Return the colours of several branches: `BRANCHES`, or from dark to light if there are more branches.

    Examples
    --------
    >>> branch_colours(2) == list(BRANCHES[:2]), len(set(branch_colours(30)))
    (True, 30)
    """
    if count <= len(BRANCHES):
        return list(BRANCHES[:count])
    import matplotlib

    light = 0.9  # the lightest colours are not visible on white
    return [matplotlib.colors.to_hex(x) for x in matplotlib.colormaps["viridis"](np.linspace(0, light, count))]


WIDTHS = {
    "no_impact": 1.1,
    "single_sided": 2.0,
    "double_sided": 3.0,
    "stick": 1.1,
    "partial_slip": 2.0,
    "gross_slip": 3.0,
    "unknown": 1.3,
}
"""Line widths [pt] of the regimes where the colour is the branch."""


GREY = "#8a8a8a"
"""Colour of auxiliary lines."""


FONT = ["STIXGeneral", "DejaVu Serif"]
"""Font families in order of preference."""


_METADATA: dict[str, Any] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": {"Date": None, "Creator": None},
}
"""Metadata without times and versions, so that the same figure gives the same file."""


STYLE: Any = {
    "font.family": FONT,
    "font.size": 9,
    "mathtext.fontset": "stix",
    "axes.linewidth": 0.6,
    "axes.labelsize": 10,
    "axes.titlesize": 9,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "axes.grid": False,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "axes.formatter.limits": (-4, 6),
    "axes.formatter.use_mathtext": True,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.edgecolor": "black",
    "text.color": "black",
}
"""Settings of matplotlib while a figure is drawn in the style "journal"."""


STYLES: dict[str, Any] = {
    "journal": STYLE,
    "screen": {
        **STYLE,
        "font.family": ["DejaVu Sans"],
        "mathtext.fontset": "dejavusans",
        "axes.labelsize": 9,
        "xtick.labelsize": 8,
        "ytick.labelsize": 8,
    },
}
"""Settings of matplotlib by the name of a style."""


SIZES = {"journal": 1.0, "screen": 0.85}
"""Size of new axes over that of "journal"; text and lines keep their size in points."""


_current: ContextVar[str] = ContextVar("style", default="journal")
_windows: ContextVar[bool] = ContextVar("windows", default=True)


@contextmanager
def in_style(name: str) -> Iterator[None]:
    """Draw all figures of a ``with`` block in a style.

    Parameters
    ----------
    name : {"journal", "screen"}
        "journal", the default of all figures, has a serif typeface for print. "screen" has a sans-serif typeface, and
        text and lines that are larger in relation to the axes, for slides.

    Raises
    ------
    ValueError
        If the style does not exist.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9))
    >>> with hb.plot.in_style("screen"):
    ...     axes = hb.plot.response(curve)
    ...
    >>> axes.xaxis.label.get_fontfamily()
    ['DejaVu Sans']
    """
    if name not in STYLES:
        raise ValueError(f"there is no style {quoted(name)}; choose one of {', '.join(map(quoted, STYLES))}")
    token = _current.set(name)
    try:
        yield
    finally:
        _current.reset(token)


@contextmanager
def without_windows() -> Iterator[None]:
    """Draw all figures of a ``with`` block for files only: without pyplot, which keeps each figure for its window."""
    token = _windows.set(False)
    try:
        yield
    finally:
        _windows.reset(token)


def new_figure(width: float, height: float) -> Figure:
    """Return a new figure of a size [in] with constrained layout.

    `matplotlib.pyplot.show` shows it unless it is drawn `without_windows`.
    """
    if _windows.get():
        import matplotlib.pyplot as plt

        return plt.figure(figsize=(width, height), layout="constrained")
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def current_settings() -> Any:
    """Return the settings of the style of the block, for axes that are styled after they are drawn."""
    return STYLES[_current.get()]


def current_font() -> str:
    """Return the first font family of the style of the block."""
    return str(current_settings()["font.family"][0])


SPEEDS = {PINION: "speed of the pinion [r/min]", MESH: "mesh frequency [Hz]"}
"""Labels of axes of frequencies in physical units."""


def scaled_axes(ax: Axes, units: dict[str, float], side: str = "top", title: str = SPEEDS[MESH]) -> list[Any]:
    """Add axes at the top or on the right, which show the values of an axis times each scale.

    The abscissa (top) or ordinate (right) is Omega or an order of it. ``units`` are values of Omega = 1 in physical
    units, with the keys of `SPEEDS`; ``title`` is the label of the axis of the mesh frequency.
    """
    titles = {**SPEEDS, MESH: title}
    added: list[Any] = []
    for name in [name for name in titles if name in units]:
        make = ax.secondary_xaxis if side == "top" else ax.secondary_yaxis
        extra: Any = make(side, functions=_times(units[name]))  # type: ignore[arg-type]
        extra.spines[side].set_position(("outward", (30.0 if side == "top" else 46.0) * len(added)))
        (extra.set_xlabel if side == "top" else extra.set_ylabel)(titles[name], fontsize=9, labelpad=3)
        extra.tick_params(direction="in", width=0.6, length=3.5, labelsize=8, labelfontfamily=current_font(), pad=2)
        added.append(extra)
    if added:
        ax.tick_params(which="both", top=side != "top", right=side != "right")
    return added


def _times(scale: float) -> tuple[Any, Any]:
    """Return the multiplication by a number, and its inverse."""
    return (lambda x: x * scale), (lambda y: y / scale)


def heighten(ax: Axes) -> None:
    """Increase the height of the figure by 0.6 in for the axes above."""
    figure: Any = ax.figure
    figure.set_figheight(figure.get_figheight() + 0.6)


@checked_arguments()
def save(drawing: Axes | Figure, path: str | os.PathLike[str], dpi: int = 200) -> None:
    """Write the figure of these axes as .png, .pdf or .svg; the same figure gives the same bytes.

    The file is replaced only after the figure is complete.

    Parameters
    ----------
    drawing : Axes or Figure
        Figure, or axes of it.
    path : path
        File to write.
    dpi : int, optional
        Resolution of a .png in dots per inch; default 200.

    Raises
    ------
    ValueError
        If the path has another suffix.

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
    with matplotlib.rc_context(settings), atomic_write(path) as handle:
        figure.savefig(handle, format=kind, dpi=dpi, metadata=_METADATA[kind])


def styled() -> Any:
    """Return a context in which matplotlib has the settings of the style of the block, see `in_style`."""
    import matplotlib

    return matplotlib.rc_context(current_settings())


def axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """Return these axes, or new ones of a width and height [in] in the style "journal"."""
    if ax is not None:
        return ax
    width, height = (SIZES[_current.get()] * x for x in size)
    return new_figure(width, height).subplots()


def dress(ax: Axes) -> None:
    """Set the style of ticks and axis labels, and write micrometres as in all figures.

    Ticks are created when the figure is drawn, outside the context of `styled`; axes of the caller have other fonts.
    """
    from matplotlib.ticker import ScalarFormatter

    from hbgear.plot.labels import TickLabels

    settings = current_settings()
    for axis in (ax.xaxis, ax.yaxis):
        if type(axis.get_major_formatter()) is ScalarFormatter:  # of linear axes, by default
            axis.set_major_formatter(TickLabels())
    for title in (ax.xaxis.label, ax.yaxis.label):
        title.set(
            text=in_figure(title.get_text()),
            fontfamily=settings["font.family"],
            math_fontfamily=settings["mathtext.fontset"],
        )
    ax.tick_params(
        which="both",
        direction="in",
        top=True,
        right=True,
        width=0.6,
        labelsize=settings["xtick.labelsize"],
        labelfontfamily=current_font(),
    )
    ax.tick_params(which="major", length=3.5)
    ax.tick_params(which="minor", length=2)


def dress_with_speeds(ax: Axes, units: dict[str, float]) -> None:
    """Set the style of ticks and axis labels, and add axes of physical units above; the figure becomes higher for them.

    ``units`` is that of `scaled_axes`; empty for no axes.
    """
    dress(ax)
    if scaled_axes(ax, units):
        heighten(ax)


MAX_VECTOR_DOTS = 1000
"""Largest number of dots of one set that is drawn as vectors; larger sets are drawn as pixels."""


def dots(ax: Axes, x: Array, y: Array, colour: str, size: float, label: str, **style: Any) -> None:
    """Draw dots of a diameter [pt]."""
    style = {"markeredgewidth": 0, "gid": label, "rasterized": len(x) > MAX_VECTOR_DOTS, **style}
    ax.plot(x, y, "o", color=colour, markersize=size, label=label, **style)


def gap_label(layout: Layout | None, element: int | str) -> str:
    """Return the symbol of the motion of an element, with the name of the element if there are several."""
    return motion_text({}) if layout is None else motion_text(layout.labels, layout.elements, layout.index(element))


def regime_of(layout: Layout | None, codes: NDArray[np.int8], element: int | str) -> str:
    """Return the regime of one element; "unknown" also for a law without contacts and friction.

    Parameters
    ----------
    layout : Layout or None
        Layout of the solution.
    codes : ndarray of int8
        Regime codes of the elements at one point.
    element : int or str
        Element by number or name.

    Returns
    -------
    str
        Name of the regime.
    """
    j = layout.index(element) if layout else 0
    if len(codes) <= j or codes[j] < 0 or (layout and not layout.has_regime(j, codes[j])):
        return "unknown"
    return REGIMES[min(codes[j], len(REGIMES) - 1)]


def in_words(regime: str) -> str:
    """Return the name of a regime such as "single_sided" in a legend, "single-sided"."""
    return regime.replace("_sided", "-sided").replace("_", " ")


def legend_handles(artists: Iterable[Any]) -> dict[str, Any]:
    """Return the first artist of each visible label, for a legend with one entry for each."""
    handles: dict[str, Any] = {}
    for artist in artists:
        if not str(artist.get_label()).startswith("_"):
            handles.setdefault(str(artist.get_label()), artist)
    return handles


def add_legend(ax: Axes, outside: bool = False, widths: bool = False) -> None:
    """Add a legend with one entry for each colour, line width, line style and symbol on the axes.

    It may lie to the right of the axes, ``outside``. With ``widths`` the line widths are regimes, which then have
    entries.
    """
    from matplotlib.lines import Line2D

    from hbgear.plot.labels import labels_of

    events = [str(mark.line.get_label()) for mark in labels_of(ax).marks]
    ranks = [*map(in_words, REGIMES), "unstable", "undecided", "jump", *(name for _, name in MARKERS.values()), *events]
    entries: dict[str, Line2D] = {}
    for line in ax.lines:
        curve, label = str(line.get_gid()).startswith("branch"), str(line.get_label())
        for name, state in (("unstable", False), ("undecided", "undecided")):
            style, width = LINES[state]
            if curve and line.get_linestyle() == style and name not in entries:
                entries[name] = Line2D([], [], color="#555555", linestyle=style, linewidth=width)
        if curve and widths:
            regime = str(line.get_gid()).split()[1]
            if regime != "unknown":
                entries[in_words(regime)] = Line2D([], [], color="#555555", linewidth=WIDTHS[regime])
        if not label.startswith("_") and label not in entries:
            entries[label] = Line2D([], [])
            entries[label].update_from(line)
            if curve:
                entries[label].set(linestyle="-", linewidth=LINES[True][1], marker="None")
            entries[label].set_visible(True)
    if any(text.get_gid() == "jump" for text in ax.texts):
        entries["jump"] = Line2D([], [], linestyle="None", marker=r"$\uparrow$", color="#777777", markersize=8)
    labels = sorted(entries, key=lambda label: ranks.index(label) if label in ranks else -1)
    if not labels:
        return
    position: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)} if outside else {"loc": "best"}
    ax.legend([entries[label] for label in labels], labels, handlelength=2.2, borderaxespad=0.8, **position)
