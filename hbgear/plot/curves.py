"""Figures of response curves, drawn on matplotlib axes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.jump_landings import landings
from hbgear.analysis.quantities.axis_quantities import (
    Abscissa,
    Ordinate,
    kind_of,
    same_unit_of_amplitude,
    usual_measure,
)
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump
from hbgear.harmonic.models.frequency_units import common_scales
from hbgear.plot.branch_sections import CONSTANT_RANGE, HEADROOM, SmoothCurve, bounded, sections
from hbgear.plot.free_motions import with_other_kinds
from hbgear.plot.insets import enlarge, move_legend_off
from hbgear.plot.style import (
    BRANCHES,
    COLOURS,
    GREY,
    LINES,
    WIDTHS,
    add_legend,
    axes_or_new,
    branch_colours,
    dress,
    heighten,
    in_words,
    line_of,
    mark_special_points,
    scaled_axes,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


BACKGROUND: Any = {"jumps": False, "legend": False, "speeds": False}
"""Options of `response` for a curve on which other results are drawn."""


@checked_arguments(branch="one Branch, as trace and load give it; responses draws several")
def response(
    branch: Branch,
    measure: str | None = None,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    color: str | None = None,
    label: str | None = None,
    special: bool = True,
    jumps: bool = True,
    legend: bool = True,
    speeds: bool | None = None,
    dof: int | str | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw a response curve: an amplitude or an engineering quantity of an element against the branch parameter.

    Stable sections are solid, unstable ones dashed and undecided ones dotted. The other branches of the same range
    (`Branch.others`) are drawn too, as by `responses`, unless a colour or a label is given, or special points or jumps
    are left out. Where the curve goes to infinity, an arrow marks its end and a dotted line its asymptote.

    Parameters
    ----------
    branch : Branch
        Branch to draw, also of tori or a backbone; see `torus` and `backbone`.
    measure : str, optional
        Measure of amplitude, see `Branch.amplitude`, or the name of an engineering quantity: "dte", "dynamic factor",
        "force", "acceleration" or another one of `hbgear.analysis.machine_quantities`. Default: "dte", the dynamic
        transmission error, if the model has scales, else "pp2".
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default. On new axes a very short unstable section is also drawn enlarged.
    color : str, optional
        One colour for the whole curve. By default each impact regime has its colour.
    label : str, optional
        Name of the curve in the legend. The curve then has one colour, black by default.
    special : bool, optional
        Whether to mark special points; default True.
    jumps : bool, optional
        Whether to draw jumps as arrows; default True.
    legend : bool, optional
        Whether to add a legend; default True.
    speeds : bool, optional
        Whether to add axes of the mesh frequency [Hz] above, with `dimensionless` also of the pinion speed [r/min],
        if the model has scales. By default only new axes have them.
    dof : int or str, optional
        Coordinate of the model, for quantities such as "acceleration, level".
    dimensionless : bool, optional
        Whether the axes are Omega and the amplitude in the unit of the model. By default they are the speed of the
        pinion [r/min] and the amplitude [um] if the model has scales.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError, KeyError
        If the measure or the element is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.response(curve, "pp2")
    >>> len(axes.lines) > 0
    True
    >>> axes = hb.plot.response(curve, "force, largest")
    """
    from matplotlib.colors import is_color_like

    if color is not None and not is_color_like(color):
        raise ValueError(f"there is no colour {quoted(color)}; give one that Matplotlib knows, such as 'tab:blue'")
    options: Any = {"legend": legend, "speeds": speeds, "dof": dof, "dimensionless": dimensionless}
    if branch.others and special and jumps and color is None and label is None:
        return responses(branch.curves, measure, element, ax, **options)
    if kind_of(branch) != "periodic":
        names = [label] if label else None
        return with_other_kinds(responses, [branch], measure, element, ax, names=names, **options)
    height = Ordinate(measure or usual_measure(branch, dimensionless, element), element, dof, dimensionless)
    branch = height.prepared(branch)
    abscissa = Abscissa([branch], dimensionless)
    amplitude = height.along(branch)
    is_new, is_empty = ax is None, ax is None or not ax.has_data()
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        x = abscissa.along(branch)
        _curve(ax, branch, x, amplitude, element, "black" if label and not color else color, label)
        if jumps:
            for jump in branch.jumps():
                _arrow(ax, branch, jump, abscissa, height)
        if special:
            mark_special_points(ax, branch, abscissa, height)
        _widen_constant(ax)
        _mark_infinity(ax, [branch], [color or "black"], abscissa, height, is_empty)
        _name(ax, branch, abscissa, height)
        if (is_new if speeds is None else speeds) and scaled_axes(ax, abscissa.above) and is_new:
            heighten(ax)
        frame = None
        if is_new:
            draw = partial(_curve, branch=branch, x=x, amplitude=amplitude, element=element, color=color, label=None)
            frame = enlarge(ax, branch, abscissa, amplitude, element, draw)
        if legend:
            add_legend(ax)
        if legend and is_new:
            move_legend_off(ax, frame)
    return ax


@checked_arguments()
def responses(
    branches: Sequence[Branch],
    measure: str | None = None,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    names: Sequence[str] | None = None,
    legend: bool = True,
    speeds: bool | None = None,
    dof: int | str | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw several branches on the same axes; the colour is the branch, the line width the impact regime.

    Labels of special points contain the number of their branch, such as "LP1 (2)"; the legend has the same numbers.
    A jump may land on any of the branches. Branches of tori and backbones may be among them; the default measure is
    then "pp2". Where a branch goes to infinity, an arrow marks its end and a dotted line
    its asymptote. One branch alone is drawn as by `response`. Colours of more than eight branches run from dark to
    light, the legend names eight of them, and special points have no labels.

    Parameters
    ----------
    branches : sequence of Branch
        Branches to draw.
    measure : str, optional
        Measure of amplitude or name of an engineering quantity, see `response`, also for the default.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    names : sequence of str, optional
        Names of the branches in the legend; default "branch 1", "branch 2", ...
    legend : bool, optional
        Whether to add a legend; default True.
    speeds : bool, optional
        Whether to add axes of the mesh frequency [Hz] above, with `dimensionless` also of the pinion speed [r/min],
        if the model has scales. By default only new axes have them.
    dof : int or str, optional
        Coordinate of the model, for quantities such as "acceleration, level".
    dimensionless : bool, optional
        Whether the axes are Omega and the amplitude in the unit of the model. By default they are the speed of the
        pinion [r/min] and the amplitude [um] if the model has scales.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError, KeyError
        If there are no branches, the names are not one for each branch, or the measure or element is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curves = [hb.trace(problem, "Omega", (0.8, 0.9), at={"F": F}) for F in (0.1, 0.2)]
    >>> axes = hb.plot.responses(curves, names=["F = 0.1", "F = 0.2"])
    """
    if not len(branches):
        raise ValueError("no branch to draw")
    if names is not None and len(names) != len(branches):
        raise ValueError(f"{len(names)} names for {len(branches)} branches; give one for each")
    options: Any = {"legend": legend, "speeds": speeds, "dof": dof, "dimensionless": dimensionless}
    if any(kind_of(branch) != "periodic" for branch in branches):
        return with_other_kinds(responses, branches, measure, element, ax, names=names, **options)
    if len(branches) == 1:
        return response(branches[0], measure, element, ax, **options)
    is_new, is_empty, abscissa = ax is None, ax is None or not ax.has_data(), Abscissa(branches, dimensionless)
    dimensionless = dimensionless or not same_unit_of_amplitude(branches)
    height = Ordinate(measure or usual_measure(branches[0], dimensionless, element), element, dof, dimensionless)
    branches = [height.prepared(branch) for branch in branches]
    with styled():
        ax = axes_or_new(ax, (6.4, 3.8))
        colours, shown = branch_colours(len(branches)), _evenly(len(branches), len(BRANCHES))
        for i, branch in enumerate(branches):
            name = "_curve" if i not in shown else f"({i + 1}) {names[i]}" if names else f"branch {i + 1}"
            x, amplitude = abscissa.along(branch), height.along(branch)
            _curve(ax, branch, x, amplitude, element, colours[i], name, WIDTHS)
        for branch, branch_landings in zip(branches, landings(branches), strict=True):
            for landing in branch_landings:
                _arrow(ax, branch, landing.jump, abscissa, height)
        for branch in branches:
            mark_special_points(ax, branch, abscissa, height, numbered=True, labelled=len(shown) == len(branches))
        _widen_constant(ax)
        _mark_infinity(ax, branches, colours, abscissa, height, is_empty)
        _name(ax, branches[0], abscissa, height)
        if (is_new if speeds is None else speeds) and scaled_axes(ax, abscissa.above) and is_new:
            heighten(ax)
        if legend:
            add_legend(ax, outside=is_new, widths=True)
    return ax


def _evenly(count: int, largest: int) -> set[int]:
    """Return the numbers of all of ``count`` items, or those of ``largest`` items from the first to the last one."""
    return set(np.linspace(0, count - 1, min(count, largest)).round().astype(int).tolist())


def speed_axes(ax: Axes, branches: Sequence[Branch]) -> list[Any]:
    """Add axes of the pinion speed [r/min] and the mesh frequency [Hz] above the axes of a response.

    No axes are added if the model has no scales, or if Omega = 1 is another frequency in another branch.

    Parameters
    ----------
    ax : Axes
        Axes with Omega as abscissa.
    branches : sequence of Branch
        Branches drawn on the axes.

    Returns
    -------
    list of SecondaryAxis
        The added axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), 4)
    >>> curve = hb.trace(pair, "Omega", (1.6, 1.5))
    >>> axes = hb.plot.response(curve, speeds=False, dimensionless=True)
    >>> [axis.get_xlabel() for axis in hb.plot.speed_axes(axes, [curve])]
    ['speed of the pinion [r/min]', 'mesh frequency [Hz]']
    """
    return scaled_axes(ax, common_scales(branches))


def _curve(
    ax: Axes,
    branch: Branch,
    x: Array,
    amplitude: Array,
    element: int | str,
    color: str | None,
    label: str | None,
    widths: dict[str, float] | None = None,
    enlarged: float = 1.0,
) -> None:
    """Draw the sections of a branch; ``widths`` are line widths of the regimes [pt], see `SmoothCurve.between`."""
    smooth = SmoothCurve(x, amplitude)
    for (regime, stable), first, last in sections(branch, element):
        name = "_curve" if color or regime == "unknown" else in_words(regime)
        look = line_of(stable) | {"color": color or COLOURS[regime], "marker": "." if first == last else None}
        if widths:
            look["linewidth"] = widths[regime] * look["linewidth"] / LINES[True][1]
        ax.plot(*smooth.between(first, last, enlarged), **look, label=label or name, gid=f"branch {regime} {stable}")


def _widen_constant(ax: Axes) -> None:
    """Show a constant amplitude as a level line: the range of its rounding errors is no range of an axis."""
    low, high = ax.get_ylim()
    if high - low < CONSTANT_RANGE * abs(high):
        ax.set_ylim(*sorted((0.9 * low, 1.1 * high)), auto=True)  # further curves may widen it


def _mark_infinity(
    ax: Axes, branches: Sequence[Branch], colours: Sequence[str], abscissa: Abscissa, height: Ordinate, is_empty: bool
) -> None:
    """Draw arrows where curves go to infinity, and asymptotes; empty axes end above the bounded part by `HEADROOM`."""
    if not any(branch.asymptotes for branch in branches):
        return
    amplitudes = [height.along(branch) for branch in branches]
    top = HEADROOM * max(bounded(branch, amplitude) for branch, amplitude in zip(branches, amplitudes, strict=True))
    if is_empty and 0 < top < max(float(amplitude.max()) for amplitude in amplitudes):
        low = min(float(amplitude.min()) for amplitude in amplitudes)
        ax.set_ylim(low - 0.05 * (top - low), top)
    else:
        top = np.inf
    lines = [abscissa.at(branch, value) for branch in branches for value in branch.asymptotes.values()]
    for value in {float(f"{value:.9g}"): value for value in lines}.values():
        ax.axvline(value, linestyle=":", linewidth=0.8, color=GREY, zorder=0, label="asymptote", gid="asymptote")
    for branch, amplitude, colour in zip(branches, amplitudes, colours, strict=True):
        for end in branch.asymptotes:
            order = slice(None, None, -1) if end == "first" else slice(None)
            _arrow_out(ax, abscissa.along(branch)[order], amplitude[order], colour, top)


def _arrow_out(ax: Axes, x: Array, y: Array, colour: str, top: float) -> None:
    """Draw an arrow at the end of a curve, or where it leaves the axes."""
    cut, limit = len(y) - 1, _ARROW_TIP_FRACTION * top
    while cut > 1 and y[cut - 1] > limit:
        cut -= 1
    s = min((limit - y[cut - 1]) / (y[cut] - y[cut - 1]), 1.0) if y[cut] > limit else 1.0
    tip = x[cut - 1] + s * (x[cut] - x[cut - 1]), y[cut - 1] + s * (y[cut] - y[cut - 1])
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 0, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 17}
    ax.annotate("", xy=tip, xytext=(x[cut - 1], y[cut - 1]), arrowprops=style, zorder=3, gid="to infinity")


_ARROW_TIP_FRACTION = 0.995
"""Fraction of the height of the axes at which an arrow ends, so that its tip is inside."""


def name_axes(ax: Axes, branch: Branch, measure: str, element: int | str, dimensionless: bool = True) -> None:
    """Set the axis labels: the parameter of a branch, and a measure or an engineering quantity with its unit.

    Parameters
    ----------
    ax : Axes
        Axes to label.
    branch : Branch
        Branch drawn on the axes.
    measure : str
        Measure of amplitude or name of an engineering quantity, see `response`.
    element : int or str
        Element by number or name.
    dimensionless : bool, optional
        Whether the axes are Omega and the amplitude in the unit of the model; default True.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9))
    >>> axes = hb.plot.time_history(curve[0])
    >>> hb.plot.curves.name_axes(axes, curve, "rms", 0)
    >>> axes.get_ylabel()
    'alternating rms of $x$ [-]'
    """
    _name(ax, branch, Abscissa([branch], dimensionless), Ordinate(measure, element, None, dimensionless))


def _name(ax: Axes, branch: Branch, abscissa: Abscissa, height: Ordinate) -> None:
    """Set the axis labels."""
    ax.set_xlabel(abscissa.label)
    ax.set_ylabel(height.label(branch))
    dress(ax)


def _arrow(ax: Axes, branch: Branch, jump: Jump, abscissa: Abscissa, height: Ordinate) -> None:
    """Draw a vertical arrow from the value before a jump to the value after it."""
    if jump.after is None or jump.parameter != branch.parameter:
        return
    x = abscissa.at(branch, jump.value)
    start, end = ((x, height.at(point, branch)) for point in (jump.before, jump.after))
    style = {"arrowstyle": "-|>", "color": "#777777", "linewidth": 0.8, "shrinkA": 3, "shrinkB": 0, "mutation_scale": 8}
    ax.annotate("", xy=end, xytext=start, arrowprops=style, zorder=3, gid="jump")
