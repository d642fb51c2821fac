"""Figures of time integration: sweeps over a curve, bifurcation diagrams, basins of attraction, validation.

Functions draw results on matplotlib axes and return them, in the style of `plot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.axis_quantities import Abscissa, OmegaAxis, Ordinate
from hbgear.analysis.quantities.length_units import (
    factor_of,
    in_figure,
    in_figure_unit,
    in_metres_per_second,
    in_micrometres,
)
from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.models.frequency_units import length_scale, model_of, scales
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.measures import axis_text, motion_text
from hbgear.plot.curves import BACKGROUND, response
from hbgear.plot.style import (
    COLOURS,
    GREY,
    add_legend,
    axes_or_new,
    dots,
    dress,
    dress_with_speeds,
    new_figure,
    scaled_axes,
    styled,
)
from hbgear.time.basins_of_attraction import Basins
from hbgear.time.frequency_sweep import Sweep
from hbgear.time.validation.report import Report

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


DIRECTIONS = {1: ("^", "#1b7f5a", "sweep up"), -1: ("v", "#a3334d", "sweep down")}
"""Marker, colour and name of each sweep direction."""


BASINS = ("#dfe8f3", "#eeb67a", "#cfe6c6", "#c98fb1", "#f4f0c9", "#86bcc4", "#d6c8ea", "#a8a8a8")
"""Colours of basins; neighbours also differ in lightness, for prints without colour."""


INKS = ("#1f4e8c", "#8a4100", "#22602a", "#7d1247", "#6b6b1f", "#075463", "#5a3391", "#222222")
"""Colours of attractors."""


SYMBOLS = "os^DvP*h"
"""Markers of attractors."""


REFINED = "agrees with more harmonics"
"""Legend entry of validated points that agree only with more harmonics."""


@checked_arguments()
def sweeps(
    found: Sequence[Sweep],
    branch: Branch | None = None,
    measure: str = "pp2",
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    legend: bool = True,
    model: Model | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw sweeps as dots, over the curve of a branch if one is given.

    Triangles point in the direction of the sweep; they are filled where the motion has the period of the excitation and
    open where it has a multiple of it; crosses are aperiodic motions. Bands are the steps in which a sweep jumped.

    Parameters
    ----------
    found : sequence of Sweep
        Sweeps.
    branch : Branch, optional
        Curve below the dots, with the other curves of its span; special points are marked if there are none.
    measure : str, optional
        Measure of amplitude, see `Branch.amplitude`; default "pp2".
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    legend : bool, optional
        Whether to add a legend; default True.
    model : Model, optional
        Model, whose scales convert Omega to r/min and amplitudes to um; default that of the branch.
    dimensionless : bool, optional
        Whether Omega and amplitudes keep the unit of the model; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError, KeyError
        If there is nothing to draw, the parameters differ, or the measure or element is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> from hbgear.plot.simulations import simulation
    >>> up = hb.time.sweep(hb.Duffing(zeta=0.3), [0.5, 0.6], "up")
    >>> axes = simulation.sweeps([up])
    """
    if not len(found):
        raise ValueError("no sweep to draw")
    parameters = {s.parameter for s in found} | ({branch.parameter} if branch else set())
    if len(parameters) > 1:
        raise ValueError(f"the sweeps and the curve are in different parameters: {', '.join(sorted(parameters))}")
    is_new, model = ax is None, model or (model_of(branch) if branch else None)
    abscissa = _axis(found[0], model, dimensionless)
    length = None if dimensionless or model is None else length_scale(model, {})
    factor = factor_of(measure, length)
    with styled():
        ax = axes_or_new(ax, (7.0, 3.7))
        curves = () if branch is None else branch.curves
        for curve in curves:
            options: Any = {**BACKGROUND, "special": len(curves) == 1, "dimensionless": dimensionless}
            response(curve, measure, element, ax, **options)
        for s in found:
            _dots(ax, s, abscissa.scale * s.values, factor * s.amplitude(measure, element))
        bands = _shade_jumps(ax, found, abscissa.scale)
        if branch is None:
            ax.set_xlabel(abscissa.label)
            motion = _name(found[0], element)
            ax.set_ylabel(in_figure(axis_text(measure, motion if length is None else in_micrometres(motion))))
        dress_with_speeds(ax, abscissa.above if is_new else {})
        if legend:
            _add_legend(ax, bands)
    return ax


def _shade_jumps(ax: Axes, found: Sequence[Sweep], scale: float) -> dict[str, Any]:
    """Shade the steps in which sweeps jumped; return one band of each direction by its legend entry."""
    bands: dict[str, Any] = {}
    for s in found:
        _, colour, name = DIRECTIONS[s.direction]
        for jump in s.jumps:
            ends = sorted(scale * x for x in jump.interval)
            bands[f"{name}, jump"] = ax.axvspan(*ends, color=colour, alpha=0.12, linewidth=0, zorder=0)
    return bands


def _add_legend(ax: Axes, bands: dict[str, Any]) -> None:
    """Add a legend to the right of the axes, of all lines and of bands by their entries."""
    add_legend(ax)
    lines: Any = ax.get_legend()
    handles = [*lines.legend_handles, *bands.values()]
    names = [*(text.get_text() for text in lines.get_texts()), *bands]
    ax.legend(handles, names, loc="upper left", bbox_to_anchor=(1.01, 1.0), handlelength=2.2)


def _axis(s: Sweep, model: Model | None, dimensionless: bool) -> OmegaAxis:
    """Return the axis of the parameter of a sweep."""
    units = scales(model, {}) if s.parameter == "Omega" else {}
    name = r"$\Omega$" if s.parameter == "Omega" else s.parameter
    return OmegaAxis(units, s.labels.get(s.parameter, name), dimensionless)


def _dots(ax: Axes, s: Sweep, x: Any, height: Any) -> None:
    """Draw the values of a sweep, with a marker for each kind of period."""
    marker, colour, name = DIRECTIONS[s.direction]
    kinds: tuple[tuple[Any, dict[str, Any], str], ...] = (
        (s.period == 1, {"marker": marker, "markerfacecolor": colour}, name),
        (s.period > 1, {"marker": marker, "markerfacecolor": "white"}, f"{name}, longer period"),
        (s.period == 0, {"marker": "+"}, f"{name}, not periodic"),
    )
    common = {"markersize": 3.6, "markeredgecolor": colour, "markeredgewidth": 0.7, "zorder": 5}
    for selected, style, label in kinds:
        _draw_selected(ax, x, height, selected, label, **common, **style)


def _draw_selected(ax: Axes, x: Any, y: Any, selected: Any, label: str, **style: Any) -> None:
    """Draw selected points as markers, if there are any."""
    if selected.any():
        ax.plot(x[selected], y[selected], linestyle="none", label=label, gid=label, **style)


@checked_arguments()
def bifurcation(
    found: Sequence[Sweep],
    element: int | str = 0,
    rate: bool = False,
    ax: Axes | None = None,
    *,
    model: Model | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw Poincare points at tau = 0 against the parameter: displacement of an element, or its rate.

    Points of aperiodic motions are smaller; large sets of them are drawn as pixels in a .pdf or .svg.

    Parameters
    ----------
    found : sequence of Sweep
        Sweeps.
    element : int or str, optional
        Element by number or name; default 0.
    rate : bool, optional
        Whether to draw the rate instead of the displacement; default False.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    model : Model, optional
        Model, whose scales convert Omega to r/min.
    dimensionless : bool, optional
        Whether Omega is kept; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError, KeyError
        If there is nothing to draw, or the element is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> from hbgear.plot.simulations import simulation
    >>> up = hb.time.sweep(hb.Duffing(zeta=0.3), [0.5, 0.6], "up")
    >>> axes = simulation.bifurcation([up])
    """
    if not len(found):
        raise ValueError("no sweep to draw")
    is_new, abscissa = ax is None, _axis(found[0], model, dimensionless)
    units = None if dimensionless or model is None else model.scales
    factor = 1.0 if units is None else units.velocity if rate else 1e6 * units.length
    with styled():
        ax = axes_or_new(ax, (5.6, 3.7))
        for s in found:
            name = DIRECTIONS[s.direction][2]
            colour = DIRECTIONS[s.direction][1] if len(found) > 1 else "black"
            for selected, size, label in ((s.settled, 2.0, name), (~s.settled, 0.9, f"{name}, not periodic")):
                if not selected.any():
                    continue
                x, y = s.section_points(np.flatnonzero(selected), element, rate)
                dots(ax, abscissa.scale * x, factor * y, colour, size, label)
        s = found[0]
        ax.set_xlabel(abscissa.label)
        label = _name(s, element)
        if units is not None:
            label = in_metres_per_second(label) if rate else in_figure(in_micrometres(label))
        ax.set_ylabel(f"{'rate of ' if rate else ''}{label} at " + r"$\tau = 0$")
        dress_with_speeds(ax, abscissa.above if is_new else {})
        if len(found) > 1:
            ax.legend(loc="best", markerscale=3)
    return ax


@checked_arguments()
def basins(found: Basins, ax: Axes | None = None, *, model: Model | None = None, dimensionless: bool = False) -> Axes:
    """Draw initial states coloured by the attractor that they reach, with the Poincare points of the attractors.

    Parameters
    ----------
    found : Basins
        Result of `hbgear.time.basins`.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    model : Model, optional
        Model, whose scales convert displacements to um, rates to m/s and Omega to r/min.
    dimensionless : bool, optional
        Whether the units of the model are kept; default False.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> from hbgear.plot.simulations import simulation
    >>> axes = simulation.basins(hb.time.basins(hb.Duffing(zeta=0.2), 1.0, shape=(2, 2)))
    """
    from matplotlib.colors import ListedColormap

    count = len(found.attractors)
    physical = None if dimensionless or model is None or not found.element else model.scales
    units = np.array([1.0, 1.0] if physical is None else [1e6 * physical.length, physical.velocity])
    d, v = units[0] * found.d, units[1] * found.v
    with styled():
        ax = axes_or_new(ax, (4.6, 3.9))
        half_d, half_v = (0.5 * (np.ptp(x) / max(len(x) - 1, 1) or 1.0) for x in (d, v))
        extent = (d[0] - half_d, d[-1] + half_d, v[0] - half_v, v[-1] + half_v)
        shades = ListedColormap([BASINS[i % len(BASINS)] for i in range(count)])
        labels = np.ma.masked_less(found.label, 0)  # initial states that were not integrated to the end are masked
        colours: Any = {"cmap": shades, "vmin": -0.5, "vmax": count - 0.5, "interpolation": "nearest"}
        ax.imshow(labels, origin="lower", extent=extent, aspect="auto", **colours)
        for i, a in enumerate(found.attractors):
            aperiodic = "not periodic" if np.isfinite(a.rms) else "unbounded"
            size = f"{a.rms:.4g}" if physical is None else f"{units[0] * a.rms:.4g} {in_figure_unit('um')}"
            name = f"period {a.period}, rms {size}" if a.period else aperiodic
            cloud = not a.period and len(a.points) > 0
            symbol = "o" if cloud else SYMBOLS[i % len(SYMBOLS)]
            style: dict[str, Any] = {"markersize": 1.5} if cloud else {"markersize": 6, "markeredgewidth": 0.6}
            style |= {"color": INKS[i % len(INKS)], "markeredgecolor": "white", "zorder": 5}
            label = f"{name}: {a.share:.0%} of initial states"
            ax.plot(*(units * a.points).T, symbol, **style, label=label, gid=f"attractor {i}")
        ax.set_xlim(extent[0], extent[1])
        ax.set_ylim(extent[2], extent[3])
        quantity = found.labels.get("amplitude", "element coordinate")
        x, y = "multiple of the first direction", "of the second"
        if found.element:
            x, y = quantity, f"rate of {quantity}"
        if physical is not None:
            x, y = in_figure(in_micrometres(quantity)), f"rate of {in_metres_per_second(quantity)}"
        ax.set_xlabel(rf"{x} at $\tau = 0$")
        ax.set_ylabel(rf"{y} at $\tau = 0$")
        ax.set_title(OmegaAxis.of(model, dimensionless).title(found.Omega))
        dress(ax)
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), handletextpad=0.3)
    return ax


@checked_arguments()
def validation(report: Report, branch: Branch, element: int | str = 0, *, dimensionless: bool = False) -> Figure:
    """Draw the validated points on the curve, numbered along it, and below their differences from time integration.

    Points that agree only with more harmonics have their own symbols, also for the remaining difference.

    Parameters
    ----------
    report : Report
        Result of `hbgear.validate`.
    branch : Branch
        The validated curve, with the other curves of its span.
    element : int or str, optional
        Element by number or name; default 0.
    dimensionless : bool, optional
        Whether Omega and amplitudes keep the unit of the model; default False.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> import hbgear as hb
    >>> from hbgear.plot.simulations import simulation
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 7), "Omega", (0.8, 0.9))
    >>> figure = simulation.validation(hb.validate(curve, 1), curve)
    """
    from hbgear.plot.labels import labels_of

    with styled():
        figure = new_figure(6.4, 7.2)
        top, low = figure.subplots(2, 1)
        for curve in branch.curves:
            response(curve, "rms", element, top, special=False, **BACKGROUND, dimensionless=dimensionless)
        abscissa = Abscissa([branch], dimensionless)
        factor = Ordinate("rms", element, dimensionless=dimensionless).factor(branch)
        x = abscissa.scale * np.array([row.value for row in report.rows])
        sizes = [curve.amplitude("rms", element) for curve in branch.curves]
        rms = factor * np.array([sizes[row.curve - 1][row.index] for row in report.rows])
        common = {"markersize": 4.5, "markeredgecolor": "white", "markeredgewidth": 0.5, "zorder": 6}
        for kind, name, colour, marker in (
            ((True, False), "agrees with integration", "#1b7f5a", "o"),
            ((True, True), REFINED, "#b36b00", "D"),
            ((False, False), "differs from integration", "#c01818", "X"),
        ):
            selected = np.array([(row.ok, row.refined) == kind for row in report.rows], dtype=bool)
            _draw_selected(top, x, rms, selected, name, marker=marker, color=colour, **common)
        labels = labels_of(top)
        for number, (value, height) in enumerate(zip(x, rms, strict=True), 1):
            (line,) = top.plot(value, height, linestyle="none", label="_number", gid=f"point {number}")
            labels.add(line, 1, "checked", f"{number}", True, (1, 0))
        add_legend(top)
        _differences(low, report)
        for ax in (top, low):
            dress(ax)
        scaled_axes(top, abscissa.above)
        low.tick_params(axis="x", which="both", top=False, length=0)
    return figure


def _differences(ax: Axes, report: Report) -> None:
    """Draw one column for each validated point, in the order of the curve, with the reason of its choice."""
    kinds = (
        ("rms_error", "o", COLOURS["no_impact"], "rms"),
        ("pp2_error", "s", COLOURS["single_sided"], "half peak-to-peak"),
        ("harmonic_error", "D", COLOURS["double_sided"], "harmonics"),
        ("multiplier_error", "x", "#444444", "multipliers"),
        ("closure", "_", GREY, "closure of the period, not compared"),
    )
    number = np.arange(1, len(report.rows) + 1)
    hollow: Any = {"markerfacecolor": "none", "linestyle": "none"}
    for i, (name, marker, colour, label) in enumerate(kinds):
        y = np.array([max(getattr(row, name), 1e-16) for row in report.rows])
        x = number + 0.13 * (i - 2)
        ax.plot(x, y, marker=marker, color=colour, markersize=4, label=label, gid=name, **hollow)
    refined = np.array([row.refined for row in report.rows], dtype=bool)
    if refined.any():
        x, y = number[refined], np.array([row.refined_error for row in report.rows])[refined]
        look = {"marker": "*", "color": "#b36b00", "markersize": 7, **hollow}
        ax.plot(x, y, **look, label="rms, with more harmonics", gid="refined_error")
    _draw_tolerances(ax, {"tolerance": report.tolerance, "tolerance,\nmultipliers": report.multiplier_tolerance})
    ax.set_yscale("log")
    ax.set_xlim(0.4, len(number) + 0.6)
    _name_points(ax, report)
    ax.set_ylabel("relative difference from time integration [-]")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, columnspacing=1.0, handletextpad=0.2)


def _draw_tolerances(ax: Axes, levels: dict[str, float]) -> None:
    """Draw a level line for each tolerance, with its name to the right of the axes."""
    position: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points", "va": "center"}
    for name, level in levels.items():
        ax.axhline(level, color=GREY, linewidth=0.7, zorder=0, gid=name)
        ax.annotate(name, (1, level), (3, 0), **position, fontsize=8, color="#555555")


def _name_points(ax: Axes, report: Report) -> None:
    """Write the number of each point and the reason of its choice along the axis, in red if it disagrees."""
    several = any(row.curve > 1 for row in report.rows)
    texts = [f"{row.reason} ({row.curve})" if several else row.reason for row in report.rows]
    names = [f"{n}  {text}" for n, text in enumerate(texts, 1)]
    ax.set_xticks(range(1, len(names) + 1), names, rotation=60, ha="right", rotation_mode="anchor")
    for row, tick in zip(report.rows, ax.get_xticklabels(), strict=True):
        tick.set_color("black" if row.ok else "#c01818")
    ax.set_xlabel("validated point, in the order of the curve")


def _name(s: Sweep, element: int | str) -> str:
    return motion_text(s.labels, s.elements, s.index(element))
