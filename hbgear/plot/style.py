"""The style of all figures, and what they are put together from: axes, scales above them, legends, files.

Stable motions are drawn solid, unstable ones dashed, those in doubt dotted, those of unknown stability solid and thin.
On one curve the colour is the impact regime; of several curves each has its own colour, and the width of the line is
the regime. Nothing here changes matplotlib's settings, and matplotlib is imported only when something is drawn.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.atomic_write import atomic_write
from hbgear.continuation.events.event import Event
from hbgear.continuation.results.point import SpecialPoint
from hbgear.harmonic.bifurcations.events import KINDS
from hbgear.harmonic.equations.layout import REGIMES, Layout
from hbgear.harmonic.frequency_units import MESH, PINION
from hbgear.io.branches.columns import MEASURED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


State = tuple[str, bool | str | None]
"""Impact regime, and whether the motion is stable; None if that is not known."""


COLOURS = {"no_impact": "#1f4e8c", "single_sided": "#d9730d", "double_sided": "#9c1f5c", "unknown": "#333333"}
"""Colours of the impact regimes."""


LINES: dict[bool | str | None, tuple[Any, float]] = {
    True: ("-", 1.4), False: ("--", 1.2), "undecided": (":", 1.6), None: ("-", 0.7)
}  # fmt: skip
"""Line style and width of stable and unstable motions, of those in doubt, and of those of which it is not known."""


def legend_entry(event: Event | SpecialPoint) -> str:
    """What a legend says of a kind of special points: its meaning as far as a colon, and the kind.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.plot.legend_entry(hb.Event("limit", lambda point: 1.0, "too large: stop"))
    'too large (limit)'
    """
    what = event.meaning.partition(":")[0]
    return what if what == event.kind else f"{what} ({event.kind})"


MARKERS = {kind: (event.marker, legend_entry(event)) for kind, event in KINDS.items()}
"""Marker and entry of a legend of every kind of special point that hbgear knows itself; users' events bring theirs."""


MEASURES = MEASURED
"""Measures of amplitude in words."""


BRANCHES = ("#0072b2", "#d55e00", "#009e73", "#b3478c", "#000000", "#e69f00", "#56b4e9", "#7a5c00")
"""Colours of several branches in this order (after Okabe and Ito), told apart by colour-blind readers too."""


WIDTHS = {"no_impact": 1.1, "single_sided": 2.0, "double_sided": 3.0, "unknown": 1.3}
"""Line widths of the regimes where the colour is the branch."""


GREY = "#8a8a8a"
"""Of lines that help to read a figure."""


FONT = ["STIXGeneral", "DejaVu Serif"]
"""Families of letters, the first that there is."""


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
"""Settings of matplotlib while a figure is drawn."""


SPEEDS = {PINION: "speed of the pinion [r/min]", MESH: "mesh frequency [Hz]"}
"""Names of axes of frequencies in physical units."""


def scaled_axes(ax: Axes, known: dict[str, float], side: str = "top", title: str = SPEEDS[MESH]) -> list[Any]:
    """Axes at the top or on the right of Omega, or of an order of it, times each scale."""
    titles = {**SPEEDS, MESH: title}
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


def heighten(ax: Axes) -> None:
    """Room for the axes above."""
    figure: Any = ax.figure
    figure.set_figheight(figure.get_figheight() + 0.6)


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
    with matplotlib.rc_context(settings), atomic_write(path) as handle:
        figure.savefig(handle, format=kind, dpi=dpi, metadata=_METADATA[kind])


def styled() -> Any:
    """A context in which matplotlib has the settings of `STYLE`."""
    import matplotlib

    return matplotlib.rc_context(STYLE)


def axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """These axes, or new ones of a size in inches."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=size, layout="constrained")[1]


def dress(ax: Axes) -> None:
    """Ticks are made when they are drawn, outside our settings, so theirs are given to the axes.

    So are the fonts of titles, for axes that were made by somebody else have others.
    """
    for title in (ax.xaxis.label, ax.yaxis.label):
        title.set(fontfamily=FONT, math_fontfamily=STYLE["mathtext.fontset"])
    ax.tick_params(which="both", direction="in", top=True, right=True, width=0.6, labelsize=9, labelfontfamily=FONT[0])
    ax.tick_params(which="major", length=3.5)
    ax.tick_params(which="minor", length=2)


def gap_label(layout: Layout | None, element: int | str) -> str:
    """Symbol of the motion of an element, with its name if there are several."""
    if layout is None:
        return "gap (model units)"
    name = f", {layout.elements[layout.index(element)]}" if len(layout.elements) > 1 else ""
    return layout.labels.get("amplitude", "gap (model units)") + name


def regime_of(layout: Layout | None, codes: NDArray[np.int8], element: int | str) -> str:
    """Regime of one element, "unknown" too for a law without corners: it has no impacts."""
    j = layout.index(element) if layout else 0
    if len(codes) <= j or codes[j] < 0 or (layout and not layout.breakpoints[j]):
        return "unknown"
    return REGIMES[min(codes[j], len(REGIMES) - 1)]


def in_words(regime: str) -> str:
    """The name of a regime as legends write it: "single-sided"."""
    return regime.replace("_sided", "-sided").replace("_", " ")


def add_legend(ax: Axes, outside: bool = False) -> None:
    """One entry for each colour, width, style and symbol that occurs on the axes; if so asked, beside them."""
    from matplotlib.lines import Line2D

    from hbgear.plot.labels import labels_of

    events = [str(mark.line.get_label()) for mark in labels_of(ax).marks]
    ranks = [*map(in_words, REGIMES), "unstable", "undecided", *(name for _, name in MARKERS.values()), *events]
    entries: dict[str, Line2D] = {}
    for line in ax.lines:
        curve, label = str(line.get_gid()).startswith("branch"), str(line.get_label())
        for name, verdict in (("unstable", False), ("undecided", "undecided")):
            style, width = LINES[verdict]
            if curve and line.get_linestyle() == style and name not in entries:
                entries[name] = Line2D([], [], color="#555555", linestyle=style, linewidth=width)
        if curve and outside:  # the width of the line is the regime
            regime = str(line.get_gid()).split()[1]
            if regime != "unknown":
                entries[in_words(regime)] = Line2D([], [], color="#555555", linewidth=WIDTHS[regime])
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
