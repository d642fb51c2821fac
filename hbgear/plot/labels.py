"""Labels of special points on a figure: unique names, no overlap, one label for a heap of points.

Where a label fits depends on what else is drawn and on the size of the figure, so the places are chosen each time the
axes are drawn: for each label in turn the place around its point with the least overlap with labels placed before,
symbols, the legend, the border and the curves (a greedy choice, as is usual on maps).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.transforms import IdentityTransform

from hbgear.common.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
    from matplotlib.text import Annotation


HEAP = 3
"""So many points of a kind closer together than `NEAR` share a label, "NS1\N{EN DASH}NS14", and lose those between."""


NEAR = 11.0  # points


_REACH = (5.0, 9.0, 14.0, 20.0, 27.0, 35.0, 45.0)  # points from a mark to its label, the nearest first


_LEADER = 7.0  # points: a label farther away is joined to its symbol by a line


_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))


_ALIGN: Any = {1: ("left", "bottom"), 0: ("center", "center"), -1: ("right", "top")}


_COST = {"label": 1000.0, "border": 1000.0, "legend": 300.0, "mark": 60.0, "astray": 30.0, "curve": 4.0, "reach": 0.5,
         "side": 0.4}  # fmt: skip


@dataclass
class Mark:
    """A special point as drawn: its symbol and text, the curve it is on, and its kind; ``shown`` alone has a label."""

    line: Line2D
    text: Annotation
    curve: int
    kind: str
    name: str
    shown: bool
    side: tuple[int, int] = field(default=(1, 0))


class Labels(Artist):
    """The marks of an axes; drawn before everything else, it puts their labels where there is room."""

    axes: Any

    def __init__(self, ax: Axes) -> None:
        super().__init__()
        self.marks: list[Mark] = []
        self.curves = 0
        self.set_zorder(-1e9)
        self.set_in_layout(False)
        ax.add_artist(self)

    def add(self, line: Line2D, curve: int, kind: str, label: str, shown: bool, side: tuple[int, int]) -> None:
        """A mark with its label; one that another curve has on these axes already gets the number of its own curve."""
        taken = {mark.text.get_text() for mark in self.marks if mark.curve != curve}
        name = f"{label} ({curve})" if label in taken else label
        across, up = _ALIGN[side[0]][0], _ALIGN[side[1]][1]
        text = self.axes.annotate(
            name if shown else "", _at(line), (5 * side[0], 5 * side[1]), textcoords="offset points",
            fontsize=8, ha=across, va=up, zorder=7, gid=f"label {label}",
        )  # fmt: skip
        text.set_in_layout(False)
        self.marks.append(Mark(line, text, curve, kind, name, shown, side))

    def draw(self, renderer: Any) -> None:
        """Merge heaps, then place each label."""
        ax: Axes = self.axes
        for _, group in groupby(self.marks, lambda mark: mark.curve):
            _merge(list(group))
        obstacles = _Obstacles(ax, renderer, self.marks)
        for mark in self.marks:
            if mark.text.get_visible() and mark.text.get_text() and ax.viewLim.contains(*_at(mark.line)):
                obstacles.place(mark)
                self._lead(mark, renderer)

    def _lead(self, mark: Mark, renderer: Any) -> None:
        """A thin line from a symbol to a label that is not right beside it."""
        from matplotlib.lines import Line2D

        box, at = mark.text.get_window_extent(renderer), _pixel(mark.line)
        end = np.clip(at, np.asarray(box.min), np.asarray(box.max))
        if np.hypot(*(end - at)) > _pixels(mark.line, _LEADER):
            line = Line2D(*np.transpose([at, end]), color="#8a8a8a", linewidth=0.5, transform=IdentityTransform())
            line.set_figure(self.axes.get_figure(root=True))
            line.draw(renderer)


def labels_of(ax: Axes) -> Labels:
    """The labels of these axes, begun if there are none."""
    return next((child for child in ax.get_children() if isinstance(child, Labels)), None) or Labels(ax)


def _merge(marks: Sequence[Mark]) -> None:
    """Of the marks of one curve: heaps of one kind show their first and last symbol and one label."""
    for kind in dict.fromkeys(mark.kind for mark in marks):
        for heap in _heaps([mark for mark in marks if mark.kind == kind]):
            merged = len(heap) >= HEAP
            for i, mark in enumerate(heap):
                mark.line.set_visible(not merged or i in (0, len(heap) - 1))
                mark.text.set_visible(not merged or i == 0)
                mark.text.set_text(mark.name if mark.shown else "")
            if merged:
                heap[0].text.set_text(f"{heap[0].name}\N{EN DASH}{heap[-1].name}")


def _heaps(marks: Sequence[Mark]) -> Iterator[list[Mark]]:
    """Neighbours along the curve that are closer together than `NEAR`."""
    heap: list[Mark] = []
    for mark in marks:
        if heap and np.hypot(*(_pixel(mark.line) - _pixel(heap[-1].line))) > _pixels(mark.line, NEAR):
            yield heap
            heap = []
        heap.append(mark)
    if heap:
        yield heap


def _at(line: Line2D) -> tuple[float, float]:
    """Place of a symbol, in data."""
    x, y = np.asarray(line.get_xydata())[0]
    return float(x), float(y)


def _pixel(line: Line2D) -> Array:
    return np.asarray(line.get_transform().transform(_at(line)))


def _pixels(artist: Artist, points: float) -> float:
    figure: Any = artist.get_figure(root=True)
    return float(points * figure.dpi / 72)


class _Obstacles:
    """What labels keep clear of, in pixels; boxes are rows (x0, y0, x1, y1)."""

    def __init__(self, ax: Axes, renderer: Any, marks: Sequence[Mark]) -> None:
        self.renderer, self.border = renderer, _rows([ax.bbox])
        half = _pixels(ax, 3.2)
        self.symbols = np.array([_pixel(mark.line) for mark in marks if mark.line.get_visible()]).reshape(-1, 2)
        self.around = np.hstack([self.symbols - half, self.symbols + half])
        legend = ax.get_legend()
        others = [] if legend is None else [legend.get_window_extent(renderer)]
        self.others = _rows(others + [p.get_window_extent(renderer) for p in ax.patches if p.get_gid() == "frame"])
        lines = [_dense(line.get_transform().transform(line.get_xydata())) for line in ax.lines if _is_curve(line)]
        arrows = [text for text in ax.texts if getattr(text, "arrow_patch", None) is not None]
        lines += [_dense(ax.transData.transform([text.xy, text.xyann])) for text in arrows]  # type: ignore[attr-defined]
        self.curves = np.concatenate([np.empty((0, 2)), *lines])
        self.labels = np.empty((0, 4))

    def place(self, mark: Mark) -> None:
        """Give a label the best of its places; the later ones keep clear of it."""
        places = list(_places(mark.side))
        boxes = self.boxes(mark, places)
        best = int(np.argmin(self.cost(mark, places, boxes)))
        _put(mark.text, *places[best])
        self.labels = np.vstack([self.labels, boxes[best]])

    def boxes(self, mark: Mark, places: Sequence[tuple[float, tuple[int, int]]]) -> Array:
        """The areas of a label at its places, with a little room around (P, 4)."""
        now = mark.text.get_window_extent(self.renderer)
        size, room = np.array([now.width, now.height]), _pixels(mark.text, 1.0)
        sides = np.array([side for _, side in places])
        at = _pixel(mark.line) + _pixels(mark.text, 1.0) * np.array([_offset(*place) for place in places])
        low = at + 0.5 * size * (sides - 1)  # the side of the box that lies at the place
        return np.hstack([low - room, low + size + room])

    def cost(self, mark: Mark, places: Sequence[tuple[float, tuple[int, int]]], boxes: Array) -> Array:
        """How bad each place is (P,); areas count in label areas."""
        area = np.maximum((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]), 1e-9)
        cost = np.array([_COST["reach"] * reach + _COST["side"] * (side != mark.side) for reach, side in places])
        cost += _COST["label"] * (_shared(boxes, self.labels) > 0).sum(axis=1)
        cost += _COST["border"] * (1 - _shared(boxes, self.border)[:, 0] / area > 1e-6)
        cost += _COST["legend"] * (_shared(boxes, self.others) > 0).sum(axis=1)
        cost += _COST["mark"] * (_shared(boxes, self.around) > 0).sum(axis=1)
        own = _apart(boxes, _pixel(mark.line)[None])
        cost += _COST["astray"] * (_apart(boxes, self.symbols) < own).any(axis=1)
        x, y = self.curves.T
        inside = [int(((x > x0) & (x < x1) & (y > y0) & (y < y1)).sum()) for x0, y0, x1, y1 in boxes.tolist()]
        return cost + _COST["curve"] * np.array(inside)


def _places(first: tuple[int, int]) -> Iterator[tuple[float, tuple[int, int]]]:
    for reach in _REACH:
        for side in dict.fromkeys((first, *_SIDES)):
            yield reach, side


def _offset(reach: float, side: tuple[int, int]) -> tuple[float, float]:
    """From a symbol to its label [points]."""
    far = reach if 0 in side else 0.7 * reach
    return far * side[0], far * side[1]


def _put(text: Annotation, reach: float, side: tuple[int, int]) -> None:
    text.set_position(_offset(reach, side))
    text.set(ha=_ALIGN[side[0]][0], va=_ALIGN[side[1]][1])


def _is_curve(line: Line2D) -> bool:
    return line.get_linestyle() != "None" and len(np.asarray(line.get_xdata())) > 1 and line.get_visible()


def _dense(path: Array, step: float = 3.0) -> Array:
    """Points along a line, at most so many pixels apart; long lines across the whole figure included."""
    path = np.asarray(path)[np.isfinite(path).all(axis=1)]
    if len(path) < 2:
        return path
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    at = np.linspace(0.0, along[-1], min(int(along[-1] / step) + 2, 20_000))
    return np.stack([np.interp(at, along, path[:, 0]), np.interp(at, along, path[:, 1])], axis=1)


def _rows(boxes: Sequence[Any]) -> Array:
    """Boxes as rows (x0, y0, x1, y1)."""
    return np.array([[box.x0, box.y0, box.x1, box.y1] for box in boxes]).reshape(-1, 4)


def _apart(boxes: Array, at: Array) -> Array:
    """Distances (P, Q) of places (Q, 2) from boxes."""
    inside = np.clip(at[None], boxes[:, None, :2], boxes[:, None, 2:])
    return np.asarray(np.hypot(*np.moveaxis(inside - at[None], -1, 0)))


def _shared(boxes: Array, others: Array) -> Array:
    """Areas (P, Q) that boxes have in common with others."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    return np.asarray(np.prod(np.maximum(high - low, 0.0), axis=-1))
