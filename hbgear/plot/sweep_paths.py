"""Figures of run-up and run-down: the motions of a slow sweep, cuts along orders, waterfalls over speed."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.axis_quantities import Abscissa, Ordinate, usual_measure
from hbgear.analysis.quantities.length_units import in_figure
from hbgear.analysis.quantities.order_cuts import level_title, order_levels
from hbgear.analysis.run_ups import BranchSection, RunUp, run_up
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import Range, checked, counted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.harmonic.equations.layout import layout_of
from hbgear.plot.curves import name_axes
from hbgear.plot.motions import FLOOR
from hbgear.plot.style import (
    BRANCHES,
    GREY,
    add_legend,
    axes_or_new,
    current_font,
    dress,
    dress_with_speeds,
    gap_label,
    heighten,
    scaled_axes,
    styled,
)

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
    measure: str | None = None,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    others: Sequence[Branch] = (),
    legend: bool = True,
    dimensionless: bool = False,
) -> Axes:
    """Draw run-up and run-down along a curve, with their jumps as arrows; the rest of the curve is thin and grey.

    Parameters
    ----------
    branch : Branch
        Curve along which the runs go.
    measure : str, optional
        Measure of amplitude or name of an engineering quantity, see `hbgear.plot.response`, also for the default.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default, with an axis of the mesh frequency above if the model has scales.
    others : sequence of Branch, optional
        Other curves on which jumps may land.
    legend : bool, optional
        Whether to add a legend; default True.
    dimensionless : bool, optional
        Whether Omega and amplitudes keep the unit of the model; default False.

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
    both_runs = [run_up(branch, direction, others) for direction in ("down", "up")]  # the wider one first
    is_new, curves = ax is None, [branch, *branch.others, *others]
    abscissa = Abscissa(curves, dimensionless)
    height = Ordinate(measure or usual_measure(branch, dimensionless, element), element, dimensionless=dimensionless)
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        for curve in curves:
            ax.plot(abscissa.along(curve), height.along(curve), ":", color=GREY, linewidth=0.9, label="curve", zorder=1)
        for run in both_runs:
            lines = [(abscissa.scale * section.values, _heights(section, height)) for section in run.sections]
            look: Any = {"color": RUNS[run.direction], "linewidth": _RUN_WIDTHS[run.direction]}
            for x, y in lines:
                ax.plot(x, y, **look, label=f"run-{run.direction}", gid=f"run {run.direction}")
            _connect(ax, run, lines)
            for jump in run.jumps:
                ends = [None if end is None else height.at(end, branch) for end in (jump.before, jump.after)]
                _arrow(ax, abscissa.scale * jump.value, ends, RUNS[run.direction])
        name_axes(ax, branch, height.measure, element, dimensionless=dimensionless)
        dress_with_speeds(ax, abscissa.above if is_new else {})
        if legend:
            add_legend(ax)
    return ax


@checked_arguments()
def orders(
    found: RunUp,
    orders: Sequence[int] = (1, 2, 3),
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    derivative: int = 0,
    quantity: str | None = None,
    dof: int | str | None = None,
    legend: bool = True,
    dimensionless: bool = False,
) -> Axes:
    """Draw order cuts: amplitudes of harmonics of the excitation along a run, on a logarithmic axis or in dB.

    The axis ends 120 dB below the largest value if there are smaller ones, such as those without contact.

    Parameters
    ----------
    found : RunUp
        Result of `hbgear.analysis.run_up`.
    orders : sequence of int, optional
        Harmonics to draw; default 1, 2, 3.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default, with an axis of the mesh frequency above if the model has scales.
    derivative : int, optional
        Derivative of the displacement in time, see `Branch.amplitude`; default 0.
    quantity : {"transmission error", "force", "acceleration"}, optional
        Quantity to draw in dB instead of the displacement, see `hbgear.analysis.order_amplitudes`. The axis states the
        reference value.
    dof : int or str, optional
        Coordinate of the acceleration. By default it is that of the element.
    legend : bool, optional
        Whether to add a legend; default True.
    dimensionless : bool, optional
        Whether Omega and amplitudes keep the unit of the model; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the quantity is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.5, 0.6))
    >>> down = hb.analysis.run_up(curve, "down")
    >>> axes = hb.plot.orders(down)
    >>> hb.plot.orders(down, quantity="force").get_ylabel()
    'level of the force [dB re 1 unit of the model]'
    """
    for order in orders:
        counted("orders", order)
    branch, is_new = found.sections[0].branch, ax is None
    abscissa = Abscissa([branch], dimensionless)
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        for i, order in enumerate(orders):
            colour = BRANCHES[i % len(BRANCHES)]
            if quantity is None:
                factor = Ordinate("rms", element, dimensionless=dimensionless).factor(branch)
                cut = partial(_harmonic, order=order, element=element, derivative=derivative, factor=factor)
            else:
                options: Any = {"quantity": quantity, "dof": dof, "dimensionless": dimensionless}
                cut = partial(order_levels, order=order, element=element, **options)
            for section in found.sections:
                x, name = abscissa.scale * section.values, f"order {order}"
                ax.plot(x, _along(section, cut), color=colour, label=name, gid=name)
            for jump in found.jumps:
                ends = [None if end is None else float(cut(end)[0]) for end in (jump.before, jump.after)]
                _arrow(ax, abscissa.scale * jump.value, ends, colour)
        name_axes(ax, branch, "rms", element, dimensionless=dimensionless)
        if quantity is None:
            ax.set_yscale("log")
            ax.set_ylabel(f"amplitude of {_quantity(branch, element, derivative, dimensionless)}")
        else:
            title = level_title(branch, quantity, dimensionless)
            ax.set_ylabel(re.sub(r"re 1 u(?=[mN])", "re 1 \N{MICRO SIGN}", title))
        _end_at_floor(ax, quantity is None)
        dress_with_speeds(ax, abscissa.above if is_new else {})
        if legend:
            add_legend(ax)
    return ax


def _end_at_floor(ax: Axes, log: bool) -> None:
    """End the axis of amplitudes (``log``) or of levels 120 dB below the largest one: less is rounding error."""
    low, top = ax.dataLim.intervaly
    floor = FLOOR * top if log else top + 20 * np.log10(FLOOR)
    if low < floor:
        ax.set_ylim(floor, 2 * top if log else top + 6)


@checked_arguments()
def waterfall(
    found: RunUp,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    floor: float = 1e-3,
    derivative: int = 0,
    dimensionless: bool = False,
) -> Axes:
    """Draw a waterfall from above: spectra along a run, with amplitude as colour.

    Harmonics lie on rays, the orders of the excitation. Dashed lines continue them to numbers at the edge. The axes are
    the speed of the pinion [r/min] and the frequency [Hz] if the model has scales.

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
    dimensionless : bool, optional
        Whether the axes are in units of Omega; default False.

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
    branch, is_new = found.sections[0].branch, ax is None
    abscissa = Abscissa([branch], dimensionless)
    lowest = 20 * np.log10(floor)
    with styled():
        ax = axes_or_new(ax, (5.6, 4.2))
        levels = [_levels(section, element, derivative) for section in found.sections]
        top = max(float(level.max()) for level in levels)
        highest = 0.0
        shades = ListedColormap(colormaps["magma_r"](np.linspace(_PALEST_SHADE, 1.0, 256)))
        for section, level in zip(found.sections, levels, strict=True):
            for k, relative in enumerate(level - top, 1):
                frequency = abscissa.hertz * k / _nu(section.branch) * section.values
                points = np.column_stack([abscissa.scale * section.values, frequency])
                middle = 0.5 * (relative[1:] + relative[:-1])
                visible = middle > lowest
                highest = max([highest, *frequency[1:][visible]])
                chords = np.stack([points[:-1], points[1:]], axis=1)[visible]
                look: Any = {"array": middle[visible], "cmap": shades, "clim": (lowest, 0.0), "linewidths": 3.0}
                segments = LineCollection(chords, **look, gid=f"order {k}")
                ax.add_collection(segments)
        values = abscissa.scale * found.values
        ax.set_xlim(values.min(), values.max())
        ax.set_ylim(0.0, 1.05 * highest)
        _order_lines(ax, abscissa.hertz / abscissa.scale)
        name_axes(ax, branch, "rms", element, dimensionless=dimensionless)
        ax.set_ylabel("frequency, in the unit of $\\Omega$" if abscissa.hertz == 1.0 else "frequency [Hz]")
        dress(ax)
        bar = ax.figure.colorbar(segments, ax=ax, pad=0.02)
        quantity = re.sub(r"\s*\[[^\[\]]*\]", "", _quantity(branch, element, derivative, dimensionless))
        bar.set_label(f"amplitude of {quantity}, run-{found.direction} [dB of the largest]")
        bar.ax.tick_params(direction="in", width=0.6, labelsize=8, labelfontfamily=current_font())
        if is_new and scaled_axes(ax, abscissa.above):
            heighten(ax)
    return ax


def _order_lines(ax: Axes, slope: float) -> None:
    """Draw thin lines along the first orders, with their numbers at the edges; ``slope`` is that of order 1."""
    right, top = ax.get_xlim()[1], ax.get_ylim()[1]
    line: Any = {"color": GREY, "linewidth": 0.5, "zorder": 0.5, "scalex": False, "scaley": False}
    for order in range(1, _NUMBERED_ORDERS + 1):
        ax.plot([0, 2 * right], [0, 2 * right * order * slope], "--", **line, gid=f"line of order {order}")
        x, y = (right, right * order * slope) if right * order * slope < top else (top / (order * slope), top)
        if x < ax.get_xlim()[0]:
            continue
        text: Any = {"textcoords": "offset points", "ha": "right", "va": "top", "fontsize": 8, "color": "#444444"}
        ax.annotate(f"{order}", (x, y), (-3, -3), **text, gid=f"number of order {order}")


_NUMBERED_ORDERS = 5
"""Number of orders that have lines and numbers in a waterfall."""


def _nu(branch: Branch) -> int:
    layout = layout_of(branch)
    assert layout is not None  # runs consist of motions
    return layout.nu


def _levels(section: BranchSection, element: int | str, derivative: int) -> Array:
    """Return the amplitudes [dB] of all harmonics of the basis (H, values)."""
    layout = layout_of(section.branch)
    assert layout is not None  # runs consist of motions
    names = [f"H{k}/{layout.nu}" if k % layout.nu else f"H{k // layout.nu}" for k in range(1, layout.harmonics + 1)]
    amplitudes = np.array([section.amplitude(name, element, derivative) for name in names])
    return 20 * np.log10(np.maximum(amplitudes, 1e-300))


def _heights(section: BranchSection, height: Ordinate) -> Array:
    """Return the values of a measure or quantity along a section."""
    heights = height.along(section.branch)[section.points]
    return heights if section.landed is None else np.append(height.at(section.landed, section.branch), heights)


def _along(section: BranchSection, cut: Callable[[Branch | Point], Array]) -> Array:
    """Return the values of an order cut along a section."""
    values = cut(section.branch)[section.points]
    return values if section.landed is None else np.append(cut(section.landed), values)


def _harmonic(motion: Branch | Point, order: int, element: int | str, derivative: int, factor: float) -> Array:
    """Return the amplitude of a harmonic of the displacement, or of its derivative, at one or all points."""
    if isinstance(motion, Branch):
        return factor * motion.amplitude(f"H{order}", element, derivative=derivative)
    layout = layout_of(motion)
    assert layout is not None  # runs consist of motions
    rows = layout.rows(motion.X, element)[None]
    if derivative:
        rows = layout.in_time(rows, {name: np.array([x]) for name, x in motion.parameters.items()}, derivative)
    return factor * layout.measure_rows(f"H{order}", rows)


def _connect(ax: Axes, run: RunUp, lines: Sequence[tuple[Array, Array]]) -> None:
    """Draw thin lines where the run changes to another curve without a jump, such as to a doubled motion."""
    jumps = [jump.value for jump in run.jumps]
    for section, before, after in zip(run.sections[1:], lines, lines[1:], strict=False):
        if section.values[0] not in jumps:
            x, y = ([end[-1], start[0]] for end, start in zip(before, after, strict=True))
            ax.plot(x, y, color=RUNS[run.direction], linewidth=0.8, gid="on another curve")


def _quantity(branch: Branch, element: int | str, derivative: int, dimensionless: bool) -> str:
    """Return the text of a displacement or its derivative, with its unit."""
    names = ("", "velocity of ", "acceleration of ")
    order = f"derivative {derivative} of " if derivative >= len(names) else names[derivative]
    text = in_figure(Ordinate("rms", element, dimensionless=dimensionless).motion(branch))
    if not derivative or text == gap_label(layout_of(branch), element):
        return order + text
    power = f"^{derivative}" if derivative > 1 else ""
    return order + text[:-1] + f"/(unit of time{power})]"


def _arrow(ax: Axes, x: float, ends: Sequence[float | None], colour: str) -> None:
    """Draw an arrow from the motion before a jump to the motion after it; a cross if the latter is unknown."""
    before, after = ends
    if before is None:
        return
    if after is None:
        ax.plot(x, before, "x", color=colour, markersize=5, zorder=4, label="landing unknown", gid="lost")
        return
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
    ax.annotate("", xy=(x, after), xytext=(x, before), arrowprops=style, zorder=3)
