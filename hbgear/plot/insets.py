"""Inset axes that show short unstable sections of a curve, and legends that keep clear of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.axis_quantities import Abscissa
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.bifurcations.events import named
from hbgear.plot.branch_sections import sections
from hbgear.plot.style import GREY, current_font, symbol_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_INSET_SIZE = (0.27, 0.29)
"""Width and height of inset axes, as fractions of the axes."""


_TICK_LABEL_SIZE = (0.085, 0.08)
"""Width and height of the tick labels to the left of and below inset axes, as fractions of the axes."""


_MIN_VISIBLE_LENGTH = 18.0
"""Length [pt] below which an unstable section is not visible between the symbols at its ends."""


def enlarge(
    ax: Axes, branch: Branch, abscissa: Abscissa, amplitude: Array, element: int | str, draw: Callable[..., None]
) -> Any:
    """Draw the longest of the unstable sections below `_MIN_VISIBLE_LENGTH` enlarged on inset axes.

    ``amplitude`` (P,) has the heights of the points of the branch. ``draw(axes, factor)`` draws the curve on other
    axes, enlarged by a factor. The result is the frame of the inset axes; None if there is no such section.
    """
    figure: Any = ax.figure
    x = abscissa.along(branch)
    size = 72 * 0.85 * np.array(figure.get_size_inches())
    box = np.array([ax.get_xlim(), ax.get_ylim()])
    fractions = (np.stack([x, amplitude], axis=1) - box[:, 0]) / (box[:, 1] - box[:, 0])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*(np.diff(fractions, axis=0) * size).T))])
    lengths = [(along[last] - along[first], first, last) for first, last in _unstable(branch, element)]
    short = [section for section in lengths if 0 < section[0] < _MIN_VISIBLE_LENGTH]
    if not short:
        return None
    _, first, last = max(short)
    middle = 0.5 * (fractions[first] + fractions[last])
    corner = _free_position(fractions, middle)
    frame = ax.add_patch(_frame(ax, corner))  # legends avoid patches
    zoomed = ax.inset_axes((*corner, *_INSET_SIZE), label="inset")
    points = slice(first, last + 1)
    ends = [_with_margin(values[points]) for values in (x, amplitude)]
    enlarged = max(float(np.ptp(v) / np.ptp(limits)) for v, limits in zip((x, amplitude), ends, strict=True))
    draw(zoomed, enlarged=enlarged)
    for point in map(named, branch.special):
        position = (abscissa.at(branch, point.parameters[branch.parameter]), float(amplitude[point.index]))
        zoomed.plot(*position, **symbol_of(point), markersize=4.0, markeredgewidth=0.9, zorder=4)
    zoomed.set(xlim=ends[0], ylim=ends[1])
    zoomed.locator_params(nbins=4)
    ticks: Any = {"direction": "in", "top": True, "right": True, "width": 0.6, "pad": 2}
    zoomed.tick_params(**ticks, labelsize=7, labelfontfamily=current_font())
    ax.indicate_inset_zoom(zoomed, edgecolor=GREY, linewidth=0.6)
    return frame


def _with_margin(values: Array) -> tuple[float, float]:
    """Return the limits of an enlarged axis."""
    margin = 0.6 * float(np.ptp(values)) or 0.01 * abs(float(values.max())) or 1.0
    return float(values.min()) - margin, float(values.max()) + margin


def move_legend_off(ax: Axes, frame: Any) -> None:
    """Move the legend to the right of the axes if it covers the curve or the frame of inset axes, else fix its place.

    Labels are placed later, and the best place of a legend that is not fixed might change.
    """
    figure: Any = ax.figure
    figure.draw_without_rendering()
    legend: Any = ax.get_legend()
    if legend is None:
        return
    extent = legend.get_window_extent()
    covered = frame is not None and extent.overlaps(frame.get_window_extent())
    for line in ax.lines if not covered else ():
        if str(line.get_gid()).startswith("branch"):
            covered = covered or line.get_transform().transform_path(line.get_path()).intersects_bbox(extent, False)
    if covered:
        legend.set_loc("upper left")
        legend.set_bbox_to_anchor((1.01, 1.0))
    else:
        legend.set_loc(tuple(ax.transAxes.inverted().transform(extent.p0)))


def _unstable(branch: Branch, element: int | str) -> list[tuple[int, int]]:
    """Return the first and last point of every unstable section."""
    ranges: list[tuple[int, int]] = []
    for (_, stable), first, last in sections(branch, element):
        if stable is False and ranges and ranges[-1][1] == first:
            ranges[-1] = (ranges[-1][0], last)
        elif stable is False:
            ranges.append((first, last))
    return ranges


def _free_position(fractions: Array, point: Array) -> tuple[float, float]:
    """Return the lower left corner of inset axes that cover no curve, as near as possible to a point of the curve."""
    steps = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(fractions, axis=0).T))])
    distances = np.linspace(0.0, steps[-1], 2000)
    x, y = (np.interp(distances, steps, column) for column in fractions.T)

    def cost(corner: tuple[float, float]) -> float:
        left, low = corner[0] - _TICK_LABEL_SIZE[0], corner[1] - _TICK_LABEL_SIZE[1]
        right, high = corner[0] + _INSET_SIZE[0] + 0.02, corner[1] + _INSET_SIZE[1] + 0.02
        covered = np.mean((x > left) & (x < right) & (y > low) & (y < high))
        centre = np.add(corner, np.divide(_INSET_SIZE, 2))
        return 1e3 * float(covered) + float(np.hypot(*(centre - point)))

    lefts = np.linspace(_TICK_LABEL_SIZE[0] + 0.01, 0.98 - _INSET_SIZE[0], 30)
    bottoms = np.linspace(_TICK_LABEL_SIZE[1] + 0.01, 0.97 - _INSET_SIZE[1], 30)
    return min(((float(a), float(b)) for a in lefts for b in bottoms), key=cost)


def _frame(ax: Axes, corner: tuple[float, float]) -> Any:
    """Return an invisible rectangle under inset axes and their tick labels."""
    from matplotlib.patches import Rectangle

    low = (corner[0] - _TICK_LABEL_SIZE[0], corner[1] - _TICK_LABEL_SIZE[1])
    size = (_INSET_SIZE[0] + _TICK_LABEL_SIZE[0] + 0.02, _INSET_SIZE[1] + _TICK_LABEL_SIZE[1] + 0.02)
    return Rectangle(low, *size, transform=ax.transAxes, facecolor="none", edgecolor="none", gid="frame")
