"""Figures of many cases: envelope of the response curves, distribution of the jumps, numbers against parameters.

Functions take the `Cases`, draw on matplotlib axes and return them, in the style of `plot`.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.cases import Cases
from hbgear.fourier import Array
from hbgear.plot import COLOURS, MEASURES, _axes, _dress, _style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

JUMPS = {
    "jump_rising": ("^", "-", COLOURS["no_impact"], r"jump while $\Omega$ rises"),
    "jump_falling": ("v", "-.", COLOURS["single_sided"], r"jump while $\Omega$ falls"),
}
"""Of each direction: marker, line, colour, name."""
PERCENTILES = (0, 5, 50, 95, 100)
_MANY = 2000  # dots in one panel that are kept as pixels


def stable_amplitudes(found: Cases, Omega: Array) -> Array:
    """Amplitudes of the stable motions of every case at these frequencies, by linear interpolation of the curves.

    Returns
    -------
    (rows, Omega), one row for each stable stretch of a curve that Omega passes in one direction; nan where it is not.

    Raises
    ------
    ValueError
        If no curve was kept.
    """
    rows = [row for curve in found.curves.values() for row in _stretches(curve, Omega)]
    if not rows:
        raise ValueError("there are no curves with stable motions; compute them: compute=('curve',)")
    return np.array(rows)


def _stretches(curve: Array, Omega: Array) -> Iterator[Array]:
    values, amplitude, stable = curve
    way = np.sign(np.diff(values)) * stable[:-1] * stable[1:]  # of each piece: direction, 0 if it is not stable
    ends = [0, *(np.flatnonzero(np.diff(way)) + 1), len(way)]
    for first, last in pairwise(ends):
        if first < last and way[first]:
            rows = slice(first, last + 1)
            x, y = (values[rows], amplitude[rows]) if way[first] > 0 else (values[rows][::-1], amplitude[rows][::-1])
            yield np.interp(Omega, x, y, left=np.nan, right=np.nan)


def percentiles(found: Cases, Omega: Array) -> Array:
    """`PERCENTILES` of the stable amplitude, (5, Omega): where a curve has several stable motions, each counts.

    Raises
    ------
    ValueError
        If no curve was kept.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a frequency without a stable motion gives nan
        return np.asarray(np.nanpercentile(stable_amplitudes(found, Omega), PERCENTILES, axis=0))


def envelope(found: Cases, ax: Axes | None = None, *, points: int = 600, legend: bool = True) -> Axes:
    """Stable amplitude over Omega in all cases: least to largest, 5 to 95 percent of the motions, median.

    Raises
    ------
    ValueError
        If no curve was kept.
    """
    Omega = np.linspace(min(found.work.span), max(found.work.span), points)
    least, low, middle, high, largest = percentiles(found, Omega)
    colour = COLOURS["no_impact"]
    with _style():
        ax = _axes(ax, (5.0, 3.4))
        ax.fill_between(Omega, least, largest, color=colour, alpha=0.15, linewidth=0, label="all cases")
        ax.fill_between(Omega, low, high, color=colour, alpha=0.35, linewidth=0, label="5 to 95 %")
        ax.plot(Omega, middle, color="black", linewidth=1.0, label="median")
        none = np.isnan(middle)
        if none.any():  # the curve is unstable there in every case, as where its period has doubled
            ax.fill_between(
                Omega, 0, 1, where=none.tolist(), transform=ax.get_xaxis_transform(), color="0.9", linewidth=0,
                label="none stable",
            )  # fmt: skip
        ax.set_xlim(Omega[0], Omega[-1])
        ax.set_ylim(bottom=0.0)
        ax.set_xlabel(_label(found, "Omega"))
        ax.set_ylabel(f"{_measure(found)}, stable")
        _dress(ax)
        if legend:
            ax.legend(loc="best")
    return ax


def jump_distribution(found: Cases, ax: Axes | None = None, *, bins: int = 30) -> Axes:
    """Number of cases over the frequency of their greatest jump, for each direction of a slow sweep.

    Raises
    ------
    ValueError
        If jumps were not computed.
    """
    if "jump_rising" not in found.table:
        raise ValueError("there are no jump frequencies; compute them: compute=('jumps',)")
    columns = {name: _finite(found.table[name]) for name in JUMPS}
    every = np.concatenate(list(columns.values()))
    with _style():
        ax = _axes(ax, (5.0, 3.4))
        if len(every):
            count = max(4, min(bins, int(np.ceil(2 * np.sqrt(len(every) / 2)))))
            edges = np.histogram_bin_edges(every, count)
            for name, values in columns.items():
                _, line, colour, label = JUMPS[name]
                label = f"{label}: {len(values)} of {len(found)} cases"
                heights = np.histogram(values, edges)[0]
                ax.stairs(heights, edges, fill=True, color=colour, alpha=0.25, linewidth=0)
                ax.stairs(heights, edges, color=colour, linestyle=line, linewidth=1.2, label=label)
            ax.set_ylim(top=1.3 * ax.get_ylim()[1])  # room for the legend
            ax.legend(loc="upper left")
        else:
            ax.text(0.5, 0.5, "no jump in any case", transform=ax.transAxes, ha="center")
        ax.locator_params(axis="y", integer=True)
        ax.set_xlabel(f"jump frequency, {_label(found, 'Omega')}")
        ax.set_ylabel("cases")
        _dress(ax)
    return ax


def against_parameters(found: Cases, figure: Figure | SubFigure | None = None) -> Figure | SubFigure:
    """Largest peak, jump frequencies and critical values of each case, against each parameter that varies.

    Raises
    ------
    ValueError
        If no parameter that varies is a number, or there is nothing to draw.
    """
    names = [name for name in found.names if np.issubdtype(found.table[name].dtype, np.number)]
    rows = _rows(found)
    if not (names and rows):
        raise ValueError("there is no number to draw against a parameter")
    with _style():
        if figure is None:
            import matplotlib.pyplot as plt

            figure = plt.figure(figsize=(1.0 + 1.9 * len(names), 0.6 + 2.1 * len(rows)), layout="constrained")
        axes: Any = figure.subplots(len(rows), len(names), sharex="col", sharey="row", squeeze=False)
        for line, (label, columns) in zip(axes, rows, strict=True):
            for ax, name in zip(line, names, strict=True):
                for column in columns:
                    _dots(ax, found, name, column)
                _dress(ax)
            line[0].set_ylabel(_wrapped(label, 27))
        for ax, name in zip(axes[-1], names, strict=True):
            ax.set_xlabel(_wrapped(_label(found, name)))
            ax.locator_params(axis="x", nbins=4)
        handles, labels = _legend_of(axes)
        if labels:
            figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def figures(found: Cases) -> dict[str, Any]:
    """Each figure there is something to draw for, by name: envelope, jump_distribution, against_parameters."""
    drawn: dict[str, Any] = {}
    for draw in (envelope, jump_distribution, against_parameters):
        try:
            drawn[draw.__name__] = draw(found)
        except ValueError:  # these numbers were not computed
            continue
    return drawn


def _rows(found: Cases) -> list[tuple[str, list[str]]]:
    """Axis label of each row of panels, and the columns of the table drawn there."""
    rows = []
    if "peak" in found.table:
        rows.append((f"largest {_measure(found)}", ["peak"]))
    if "jump_rising" in found.table:
        rows.append((f"jumps, {_label(found, 'Omega')}", list(JUMPS)))
    return rows + [(f"critical {name}", [f"critical_{name}"]) for name in found.work.critical]


def _dots(ax: Axes, found: Cases, name: str, column: str) -> None:
    marker, _, colour, label = JUMPS.get(column, ("o", "", COLOURS["no_impact"], "_"))
    x, y = found.table[name], found.table[column]
    which = np.isfinite(y)
    ax.plot(x[which], y[which], marker, color=colour, markersize=3.0 if len(x) < 300 else 1.8, alpha=0.75,
            markeredgewidth=0, label=label, rasterized=len(x) > _MANY, gid=column)  # fmt: skip


def _legend_of(axes: Any) -> tuple[list[Any], list[str]]:
    """One entry for each label of any panel."""
    entries = {str(line.get_label()): line for ax in axes.flat for line in ax.lines}
    shown = {label: line for label, line in entries.items() if not label.startswith("_")}
    return list(shown.values()), list(shown)


def _wrapped(label: str, width: int = 24) -> str:
    """A label in lines of about this many characters; formulas are not broken."""
    lines = [""]
    for word in re.findall(r"(?:\$[^$]*\$|\S)+", label):
        length = len(re.sub(r"\\\w+", "x", f"{lines[-1]} {word}"))  # a command is about one character
        if lines[-1] and length > width:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


def _finite(column: Array) -> Array:
    return np.asarray(column[np.isfinite(column)])


def _measure(found: Cases) -> str:
    """Name of the measure and of what it is of."""
    name = MEASURES.get(found.work.measure, f"harmonic {found.work.measure[1:]}")
    return f"{name} of {found.model.labels.get('amplitude', 'gap (model units)')}"


def _label(found: Cases, name: str) -> str:
    return found.model.labels.get(name, r"$\Omega$" if name == "Omega" else name)
