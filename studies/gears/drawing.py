"""Response curves over a physical speed, several on the same axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes

import hbgear as hb
from hbgear import plot as draw


def response(
    ax: Axes,
    curve: hb.Branch,
    measure: str,
    speed: Callable[[Any], Any],
    length: float,
    color: str,
    label: str,
    element: int | str = 0,
) -> None:
    """A measure of the gap over a speed: stable solid, unstable dashed, jumps as arrows.

    Parameters
    ----------
    ax, curve, measure, color, label, element : as of `hbgear.plot.response`.
    speed : of Omega.
    length : of the unit of the gap.
    """
    for one in curve.curves:
        x, y = speed(one.values), one.amplitude(measure, element) * length
        for stable, style in ((True, "-"), (False, "--")):
            rows = np.asarray(one.stable) == stable
            rows[1:] |= rows[:-1]  # to the first point of the next piece
            name = label if stable and one is curve else None
            ax.plot(np.where(rows, x, np.nan), np.where(rows, y, np.nan), style, color=color, lw=1.4, label=name)
        for jump in one.jumps():
            if jump.after is not None:
                at = speed(jump.value)
                before, after = (point.amplitude(measure, element) for point in (jump.before, jump.after))
                arrow = {"arrowstyle": "-|>", "color": draw.GREY, "lw": 0.9}
                ax.annotate("", (at, after * length), (at, before * length), arrowprops=arrow)
