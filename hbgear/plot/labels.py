"""Labels of special points: unique names, no overlap, one label for a cluster of points; labels of ticks.

The position of a label depends on the other drawn objects and the size of the figure, so positions are chosen whenever
the axes are drawn. Each label in turn gets the position around its point with the least overlap with earlier labels,
symbols, the legend, the border and the curves (a greedy choice, as usual on maps).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.ticker import ScalarFormatter
from matplotlib.transforms import IdentityTransform

from hbgear.common.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
    from matplotlib.text import Annotation


MIN_CLUSTER_SIZE = 3
"""Points of a kind within `CLUSTER_DISTANCE` of their neighbours that share a label, "NS1\N{EN DASH}NS14"."""


CLUSTER_DISTANCE = 11.0
"""Largest distance [pt] between neighbouring symbols of a cluster."""


_DISTANCES = (5.0, 9.0, 14.0, 20.0, 27.0, 35.0, 45.0)
"""Distances [pt] of a label from its symbol, the nearest first."""


TICK_LENGTH = 3.5
"""Length [pt] of the ticks inside of the axes, which labels avoid."""


LEADER_DISTANCE = 7.0
"""Distance [pt] from which a line connects a label and its symbol."""


_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
"""Sides of a label as signs of its horizontal and vertical offset, in order of preference."""


_ALIGN: Any = {1: ("left", "bottom"), 0: ("center", "center"), -1: ("right", "top")}
"""Horizontal and vertical alignment of a text for each sign of its offset."""


_COST = {
    "label": 1000.0,
    "border": 1000.0,
    "legend": 300.0,
    "mark": 60.0,
    "ambiguous": 30.0,
    "crossing": 30.0,
    "curve": 4.0,
    "reach": 0.5,
    "side": 0.4,
}
"""Costs of a label position, dimensionless; their ratios define which overlaps are avoided first.

Each overlap with a label, border, legend, mark or point of a curve has a cost; so have a curve behind the label
("crossing"), a smaller distance from another symbol ("ambiguous"), each pt of distance ("reach"), and another side than
the preferred one ("side").
"""


_BACKGROUND: Any = {"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 0.6}
"""Background of a label, so that it remains legible where no position is free of curves and leader lines."""


@dataclass
class Mark:
    """A drawn special point: symbol, text, curve and kind; it has a label only if ``has_label``."""

    line: Line2D
    text: Annotation
    curve: int
    kind: str
    name: str
    has_label: bool
    side: tuple[int, int] = field(default=(1, 0))


class Labels(Artist):
    """The marks of axes; drawn before all other objects, it positions their labels."""

    axes: Any

    def __init__(self, ax: Axes) -> None:
        super().__init__()
        self.marks: list[Mark] = []
        self.curves = 0
        self.set_zorder(-1e9)
        self.set_in_layout(False)
        ax.add_artist(self)

    def add(self, line: Line2D, curve: int, kind: str, label: str, has_label: bool, side: tuple[int, int]) -> None:
        """Add a mark with its label; a label that another curve already has gets the number of its curve."""
        other_labels = {mark.text.get_text() for mark in self.marks if mark.curve != curve}
        name = f"{label} ({curve})" if label in other_labels else label
        look: Any = {
            "ha": _ALIGN[side[0]][0],
            "va": _ALIGN[side[1]][1],
            "fontsize": 8,
            "zorder": 7,
            "bbox": _BACKGROUND,
        }
        at, offset = _data_position(line), (5 * side[0], 5 * side[1])
        written = name if has_label else ""
        text = self.axes.annotate(written, at, offset, textcoords="offset points", gid=f"label {label}", **look)
        text.set_in_layout(False)
        self.marks.append(Mark(line, text, curve, kind, name, has_label, side))

    def draw(self, renderer: Any) -> None:
        """Merge clusters, then position each label."""
        ax: Axes = self.axes
        for _, group in groupby(self.marks, lambda mark: mark.curve):
            _merge_clusters(list(group))
        obstacles = _Obstacles(ax, renderer, self.marks)
        for mark in self.marks:
            if mark.text.get_visible() and mark.text.get_text() and ax.viewLim.contains(*_data_position(mark.line)):
                obstacles.place(mark)
                self._lead(mark, renderer)

    def _lead(self, mark: Mark, renderer: Any) -> None:
        """Draw a thin line from a symbol to a distant label."""
        from matplotlib.lines import Line2D

        box, symbol = mark.text.get_window_extent(renderer), _pixel_position(mark.line)
        end = np.clip(symbol, np.asarray(box.min), np.asarray(box.max))
        if np.hypot(*(end - symbol)) > _pixels(mark.line, LEADER_DISTANCE):
            line = Line2D(*np.transpose([symbol, end]), color="#8a8a8a", linewidth=0.5, transform=IdentityTransform())
            line.set_figure(self.axes.get_figure(root=True))
            line.draw(renderer)


def labels_of(ax: Axes) -> Labels:
    """Return the labels of these axes, created if there are none."""
    return next((child for child in ax.get_children() if isinstance(child, Labels)), None) or Labels(ax)


def _merge_clusters(marks: Sequence[Mark]) -> None:
    """Show, for each cluster of one kind on one curve, the first and last symbol and one label."""
    for kind in dict.fromkeys(mark.kind for mark in marks):
        for cluster in _clusters([mark for mark in marks if mark.kind == kind]):
            merged = len(cluster) >= MIN_CLUSTER_SIZE
            for i, mark in enumerate(cluster):
                mark.line.set_visible(not merged or i in (0, len(cluster) - 1))
                mark.text.set_visible(not merged or i == 0)
                mark.text.set_text(mark.name if mark.has_label else "")
            if merged:
                cluster[0].text.set_text(f"{cluster[0].name}\N{EN DASH}{cluster[-1].name}")


def _clusters(marks: Sequence[Mark]) -> Iterator[list[Mark]]:
    """Yield neighbours along the curve that are closer together than `CLUSTER_DISTANCE`."""
    cluster: list[Mark] = []
    for mark in marks:
        if cluster and np.hypot(*(_pixel_position(mark.line) - _pixel_position(cluster[-1].line))) > _pixels(
            mark.line, CLUSTER_DISTANCE
        ):
            yield cluster
            cluster = []
        cluster.append(mark)
    if cluster:
        yield cluster


def _data_position(line: Line2D) -> tuple[float, float]:
    """Return the position of a symbol, in data coordinates."""
    x, y = np.asarray(line.get_xydata())[0]
    return float(x), float(y)


def _pixel_position(line: Line2D) -> Array:
    """Return the position of a symbol in pixels."""
    return np.asarray(line.get_transform().transform(_data_position(line)))


def _pixels(artist: Artist, points: float) -> float:
    """Return a length in pixels, from points."""
    figure: Any = artist.get_figure(root=True)
    return float(points * figure.dpi / 72)


class _Obstacles:
    """Objects that labels avoid, in pixels; boxes are rows (x0, y0, x1, y1)."""

    def __init__(self, ax: Axes, renderer: Any, marks: Sequence[Mark]) -> None:
        self.renderer, self.border = renderer, _box_array([ax.bbox.padded(-_pixels(ax, TICK_LENGTH))])
        half = _pixels(ax, 3.2)
        self.symbols = np.array([_pixel_position(mark.line) for mark in marks if mark.line.get_visible()]).reshape(
            -1, 2
        )
        self.symbol_boxes = np.hstack([self.symbols - half, self.symbols + half])
        legend = ax.get_legend()
        legend_boxes = [] if legend is None else [legend.get_window_extent(renderer)]
        self.legends = _box_array(
            legend_boxes + [p.get_window_extent(renderer) for p in ax.patches if p.get_gid() == "frame"]
        )
        lines = [_resampled(line.get_transform().transform(line.get_xydata())) for line in ax.lines if _is_curve(line)]
        arrows = [text for text in ax.texts if getattr(text, "arrow_patch", None) is not None]
        lines += [_resampled(ax.transData.transform([text.xy, text.xyann])) for text in arrows]  # type: ignore[attr-defined]
        self.curves = np.concatenate([np.empty((0, 2)), *lines])
        self.labels = np.empty((0, 4))

    def place(self, mark: Mark) -> None:
        """Move a label to its best position; later labels avoid it."""
        positions = list(_positions(mark.side))
        boxes = self.boxes(mark, positions)
        best = int(np.argmin(self.cost(mark, positions, boxes)))
        _move(mark.text, *positions[best])
        self.labels = np.vstack([self.labels, boxes[best]])

    def boxes(self, mark: Mark, positions: Sequence[tuple[float, tuple[int, int]]]) -> Array:
        """Return the areas of a label at its positions, with a margin (P, 4)."""
        extent = mark.text.get_window_extent(self.renderer)
        size, margin = np.array([extent.width, extent.height]), _pixels(mark.text, 1.0)
        side_signs = np.array([side for _, side in positions])
        anchors = _pixel_position(mark.line) + _pixels(mark.text, 1.0) * np.array(
            [_offset(*position) for position in positions]
        )
        low = anchors + 0.5 * size * (side_signs - 1)  # the side of the box nearest to the symbol
        return np.hstack([low - margin, low + size + margin])

    def cost(self, mark: Mark, positions: Sequence[tuple[float, tuple[int, int]]], boxes: Array) -> Array:
        """Return the cost of each position (P,)."""
        area = np.maximum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), 1e-9)
        cost = np.array([_COST["reach"] * reach + _COST["side"] * (side != mark.side) for reach, side in positions])
        cost += _COST["label"] * (_overlap_areas(boxes, self.labels) > 0).sum(axis=1)
        cost += _COST["border"] * (1 - _overlap_areas(boxes, self.border)[:, 0] / area > 1e-6)
        cost += _COST["legend"] * (_overlap_areas(boxes, self.legends) > 0).sum(axis=1)
        cost += _COST["mark"] * (_overlap_areas(boxes, self.symbol_boxes) > 0).sum(axis=1)
        own_distance = _box_distances(boxes, _pixel_position(mark.line)[None])
        cost += _COST["ambiguous"] * (_box_distances(boxes, self.symbols) < own_distance).any(axis=1)
        x, y = self.curves.T
        points_inside = np.array(
            [int(((x > x0) & (x < x1) & (y > y0) & (y < y1)).sum()) for x0, y0, x1, y1 in boxes.tolist()]
        )
        return cost + _COST["curve"] * points_inside + _COST["crossing"] * (points_inside > 0)


def _positions(first: tuple[int, int]) -> Iterator[tuple[float, tuple[int, int]]]:
    for reach in _DISTANCES:
        for side in dict.fromkeys((first, *_SIDES)):
            yield reach, side


def _offset(reach: float, side: tuple[int, int]) -> tuple[float, float]:
    """Return the offset of a label from its symbol [pt]."""
    distance = reach if 0 in side else 0.7 * reach
    return distance * side[0], distance * side[1]


def _move(text: Annotation, reach: float, side: tuple[int, int]) -> None:
    text.set_position(_offset(reach, side))
    text.set(ha=_ALIGN[side[0]][0], va=_ALIGN[side[1]][1])


def _is_curve(line: Line2D) -> bool:
    return line.get_linestyle() != "None" and len(np.asarray(line.get_xdata())) > 1 and line.get_visible()


def _resampled(path: Array) -> Array:
    """Return points along a line, at most 3 pixels apart; long lines across the whole figure included."""
    path = np.asarray(path)[np.isfinite(path).all(axis=1)]
    if len(path) < 2:
        return path
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    distances = np.linspace(0.0, along[-1], min(int(along[-1] / 3.0) + 2, 20_000))
    return np.stack([np.interp(distances, along, path[:, 0]), np.interp(distances, along, path[:, 1])], axis=1)


def _box_array(boxes: Sequence[Any]) -> Array:
    """Return boxes as rows (x0, y0, x1, y1)."""
    return np.array([[box.x0, box.y0, box.x1, box.y1] for box in boxes]).reshape(-1, 4)


def _box_distances(boxes: Array, positions: Array) -> Array:
    """Return the distances (P, Q) of positions (Q, 2) from boxes."""
    nearest = np.clip(positions[None], boxes[:, None, :2], boxes[:, None, 2:])
    return np.asarray(np.hypot(*np.moveaxis(nearest - positions[None], -1, 0)))


def _overlap_areas(boxes: Array, obstacles: Array) -> Array:
    """Return the areas (P, Q) of the intersections of boxes with others."""
    low = np.maximum(boxes[:, None, :2], obstacles[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], obstacles[None, :, 2:])
    return np.asarray(np.prod(np.maximum(high - low, 0.0), axis=-1))


class TickLabels(ScalarFormatter):
    """Labels of ticks as plain text; only the common power of ten is mathtext, which takes long to be set.

    The digits of both are the same. The labels of a figure of a gear pair took a fifth of its time as mathtext.
    """

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")
