"""Figures of run-up and run-down: the motions of a slow sweep, cuts along orders, waterfalls over speed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hbgear.analysis.run_ups import BranchSection, RunUp, run_up
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import Range, checked, counted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump, Point
from hbgear.harmonic.equations.layout import layout_of
from hbgear.plot.curves import name_axes, speed_axes
from hbgear.plot.style import BRANCHES, FONT, GREY, add_legend, axes_or_new, dress, gap_label, heighten, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RUNS = {"up": "#0072b2", "down": "#d55e00"}
"""Colours of a run-up and a run-down."""

_RUN_WIDTHS = {"up": 1.6, "down": 2.6}
"""Line widths [pt] of a run-up and a run-down: the wider one remains visible where both coincide."""


_PALEST_SHADE = 0.15
"""Fraction of the colour map below which its shades are hard to see on white paper; they are not used."""


@checked_arguments()
def runs(
    branch: Branch,
    measure: str = "pp2",
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    others: Sequence[Branch] = (),
    legend: bool = True,
) -> Axes:
    """Draw run-up and run-down along a curve, with their jumps as arrows; the rest of the curve is thin and grey.

    Parameters
    ----------
    branch : Branch
        Curve along which the runs go.
    measure : str, optional
        Measure of amplitude, see `Branch.amplitude`; default "pp2".
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default, with axes of the speeds above if the model has scales.
    others : sequence of Branch, optional
        Other curves on which jumps may land.
    legend : bool, optional
        Whether to add a legend; default True.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> axes = hb.plot.runs(curve)
    """
    found = [run_up(branch, direction, others) for direction in ("down", "up")]  # the wider one first
    own = ax is None
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        for curve in (branch, *branch.others, *others):
            height = curve.amplitude(measure, element)
            ax.plot(curve.values, height, ":", color=GREY, linewidth=0.9, label="curve", zorder=1)
        for one in found:
            for section in one.sections:
                ax.plot(
                    section.values, section.amplitude(measure, element), color=RUNS[one.direction],
                    linewidth=_RUN_WIDTHS[one.direction], label=f"run-{one.direction}", gid=f"run {one.direction}",
                )  # fmt: skip
            _connect(ax, one, measure, element)
            for jump in one.jumps:
                _arrow(ax, jump, measure, element, RUNS[one.direction])
        name_axes(ax, branch, measure, element)
        dress(ax)
        if own and speed_axes(ax, [branch]):
            heighten(ax)
        if legend:
            add_legend(ax)
    return ax


@checked_arguments()
def orders(
    found: RunUp, orders: Sequence[int] = (1, 2, 3), element: int | str = 0, ax: Axes | None = None,
    *, derivative: int = 0, legend: bool = True,
) -> Axes:  # fmt: skip
    """Draw order cuts: amplitudes of harmonics of the excitation along a run, on a logarithmic axis.

    Parameters
    ----------
    found : RunUp
        Result of `hbgear.analysis.run_up`.
    orders : sequence of int, optional
        Harmonics to draw; default 1, 2, 3.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default, with axes of the speeds above if the model has scales.
    derivative : int, optional
        Derivative in time, see `Branch.amplitude`; default 0.
    legend : bool, optional
        Whether to add a legend; default True.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.5, 0.6))
    >>> axes = hb.plot.orders(hb.analysis.run_up(curve, "down"))
    """
    for order in orders:
        counted("orders", order)
    branch, own = found.sections[0].branch, ax is None
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        for i, order in enumerate(orders):
            for section in found.sections:
                ax.plot(section.values, section.amplitude(f"H{order}", element, derivative),
                        color=BRANCHES[i % len(BRANCHES)], label=f"order {order}", gid=f"order {order}")  # fmt: skip
            for jump in found.jumps:
                _arrow(ax, jump, f"H{order}", element, BRANCHES[i % len(BRANCHES)], derivative)
        ax.set_yscale("log")
        name_axes(ax, branch, "rms", element)
        ax.set_ylabel(f"amplitude of {_quantity(branch, element, derivative)}")
        dress(ax)
        if own and speed_axes(ax, [branch]):
            heighten(ax)
        if legend:
            add_legend(ax)
    return ax


@checked_arguments()
def waterfall(
    found: RunUp, element: int | str = 0, ax: Axes | None = None, *, floor: float = 1e-3, derivative: int = 0
) -> Axes:
    """Draw a waterfall from above: spectra along a run, with amplitude as colour; harmonics lie on rays, the orders.

    Parameters
    ----------
    found : RunUp
        Result of `hbgear.analysis.run_up`, along Omega.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default, with axes of the speeds above if the model has scales.
    floor : float, optional
        Fraction of the largest amplitude at which colours begin, between 0 and 1; default 1e-3.
    derivative : int, optional
        Derivative in time, see `Branch.amplitude`; default 0.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the run is along another parameter, or the floor is not between 0 and 1.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.5, 0.6))
    >>> axes = hb.plot.waterfall(hb.analysis.run_up(curve, "up"))
    """
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    checked("waterfall", "floor", floor, Range(above=0, below=1))
    if found.parameter != "Omega":
        raise ValueError(f"a waterfall is over Omega; this run is along {found.parameter}")
    branch, own = found.sections[0].branch, ax is None
    lowest = 20 * np.log10(floor)
    with styled():
        ax = axes_or_new(ax, (5.6, 4.2))
        levels = [_levels(section, element, derivative) for section in found.sections]
        top = max(float(level.max()) for level in levels)
        highest = 0.0
        shades = ListedColormap(colormaps["magma_r"](np.linspace(_PALEST_SHADE, 1.0, 256)))
        for section, level in zip(found.sections, levels, strict=True):
            for k, relative in enumerate(level - top, 1):
                frequency = k / _nu(section.branch) * section.values
                points = np.column_stack([section.values, frequency])
                middle = 0.5 * (relative[1:] + relative[:-1])
                shown = middle > lowest
                highest = max([highest, *frequency[1:][shown]])
                drawn = LineCollection(
                    np.stack([points[:-1], points[1:]], axis=1)[shown], array=middle[shown], cmap=shades,
                    clim=(lowest, 0.0), linewidths=3.0, gid=f"order {k}",
                )  # fmt: skip
                ax.add_collection(drawn)
        values = found.values
        ax.set_xlim(values.min(), values.max())
        ax.set_ylim(0.0, 1.05 * highest)
        name_axes(ax, branch, "rms", element)
        ax.set_ylabel("frequency, in the unit of $\\Omega$")
        dress(ax)
        bar = ax.figure.colorbar(drawn, ax=ax, pad=0.02)
        quantity = re.sub(r"\s*\[[^\[\]]*\]", "", _quantity(branch, element, derivative))  # without unit
        bar.set_label(f"amplitude of {quantity}, run-{found.direction} [dB of the largest]")
        bar.ax.tick_params(direction="in", width=0.6, labelsize=8, labelfontfamily=FONT[0])
        if own and speed_axes(ax, [branch]):
            heighten(ax)
    return ax


def _nu(branch: Branch) -> int:
    layout = layout_of(branch)
    assert layout is not None  # runs consist of motions
    return layout.nu


def _levels(section: BranchSection, element: int | str, derivative: int) -> Array:
    """Return the amplitudes [dB] of all harmonics of the basis (H, values)."""
    layout = layout_of(section.branch)
    assert layout is not None  # runs consist of motions
    names = [f"H{k}/{layout.nu}" if k % layout.nu else f"H{k // layout.nu}" for k in range(1, layout.harmonics + 1)]
    found = np.array([section.amplitude(name, element, derivative) for name in names])
    out: Array = 20 * np.log10(np.maximum(found, 1e-300))
    return out


def _connect(ax: Axes, one: RunUp, measure: str, element: int | str) -> None:
    """Draw thin lines where the run changes to another curve without a jump, such as to a doubled motion."""
    jumps = [jump.value for jump in one.jumps]
    for before, after in pairwise(one.sections):
        if after.values[0] not in jumps:
            x = [before.values[-1], after.values[0]]
            y = [before.amplitude(measure, element)[-1], after.amplitude(measure, element)[0]]
            ax.plot(x, y, color=RUNS[one.direction], linewidth=0.8, gid="on another curve")


def _quantity(branch: Branch, element: int | str, derivative: int) -> str:
    names = ("", "velocity of ", "acceleration of ")
    order = f"derivative {derivative} of " if derivative >= len(names) else names[derivative]
    return order + gap_label(layout_of(branch), element)


def _arrow(ax: Axes, jump: Jump, measure: str, element: int | str, colour: str, derivative: int = 0) -> None:
    """Draw an arrow from the motion before a jump to the motion after it; a cross if the latter is unknown."""
    start = (jump.value, _height(jump.before, measure, element, derivative))
    if jump.after is None:
        ax.plot(*start, "x", color=colour, markersize=5, zorder=4, label="landing unknown", gid="lost")
        return
    end = (jump.value, _height(jump.after, measure, element, derivative))
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
    ax.annotate("", xy=end, xytext=start, arrowprops=style, zorder=3)


def _height(point: Point, measure: str, element: int | str, derivative: int) -> float:
    layout = layout_of(point)
    assert layout is not None  # runs consist of motions
    rows = layout.rows(point.X, element)[None]
    if derivative:
        rows = layout.in_time(rows, {name: np.array([x]) for name, x in point.parameters.items()}, derivative)
    return float(layout.measure_rows(measure, rows)[0])
