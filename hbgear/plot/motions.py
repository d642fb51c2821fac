"""Figures of single motions: functions that draw a point on matplotlib axes and return them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hbgear.analysis.quantities.length_units import in_figure, in_metres_per_second, in_micrometres
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import Range, checked
from hbgear.continuation.results.point import Point
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.models.frequency_units import MESH, PINION, scales_with, speeds_at
from hbgear.plot.style import (
    COLOURS,
    GREY,
    axes_or_new,
    current_font,
    dress,
    gap_label,
    in_words,
    new_figure,
    regime_of,
    scaled_axes,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hbgear.mechanics.models import Model


FLOOR = 1e-6
"""Lines of a spectrum below this fraction of the largest line are not drawn (-120 dB)."""


@checked_arguments()
def time_history(
    point: Point,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    model: Model | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw the motion of an element over its period, with thin lines at the breakpoints of its law.

    Parameters
    ----------
    point : Point
        Point of a curve.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    model : Model, optional
        Model, whose scales convert displacements to um and velocities to m/s; default that of the point.
    dimensionless : bool, optional
        Whether the units of the model are kept; default False.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.time_history(curve["LP1"])
    """
    units = _units(point, element, model, dimensionless)
    with styled():
        return _draw_history(axes_or_new(ax, (4.2, 2.8)), point, element, units)


def _draw_history(ax: Axes, point: Point, element: int | str, units: _Units) -> Axes:
    layout, periods, d = _cycle(point, element)
    ax.plot(periods, units.length * d, color=_colour(point, element))
    ax.set_xlim(0, layout.nu)
    ax.set_xlabel("excitation periods [-]")
    ax.set_ylabel(units.displacement)
    dress(ax)
    _breakpoints(layout, element, d, units.length, ax.axhline, ax.set_ylim)
    return ax


@checked_arguments()
def phase_diagram(
    point: Point,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    model: Model | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw velocity against displacement, d' = (Omega / nu) dd/dtheta, with a dot once per excitation period.

    Parameters
    ----------
    point : Point
        Point of a curve.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    model : Model, optional
        Model, whose scales convert displacements to um and velocities to m/s; default that of the point.
    dimensionless : bool, optional
        Whether the units of the model are kept; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the point has no parameter Omega.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.phase_diagram(curve["LP1"])
    """
    units = _units(point, element, model, dimensionless)
    with styled():
        return _draw_phase(axes_or_new(ax, (3.2, 2.8)), point, element, units)


def _draw_phase(ax: Axes, point: Point, element: int | str, units: _Units) -> Axes:
    """Draw the velocity over the displacement, with a dot at each period of the excitation."""
    if "Omega" not in point.parameters:
        raise ValueError(f"a phase diagram needs Omega; the point has {', '.join(point.parameters) or 'no parameters'}")
    layout, periods, d = _cycle(point, element)
    v = point.parameters["Omega"] / layout.nu * _cycle(point, element, order=1)[2]
    starts, colour = np.searchsorted(periods, np.arange(layout.nu)), _colour(point, element)
    x, y = units.length * d, units.rate * v
    ax.plot(x, y, color=colour)
    ax.plot(x[starts], y[starts], "o", color=colour, markersize=3.5)
    ax.set_xlabel(units.displacement)
    ax.set_ylabel(units.velocity)
    dress(ax)
    _breakpoints(layout, element, d, units.length, ax.axvline, ax.set_xlim)
    return ax


@checked_arguments()
def spectrum(
    point: Point,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    log: bool = True,
    floor: float = FLOOR,
    model: Model | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw the amplitude of each harmonic, without the mean, against multiples of the excitation frequency.

    Parameters
    ----------
    point : Point
        Point of a curve.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    log : bool, optional
        Logarithmic axis (default), with decibels relative to the largest line on the right; else linear.
    floor : float, optional
        Fraction of the largest line below which no line is drawn on the logarithmic axis; the figure states it.
        Default 1e-6.
    model : Model, optional
        Model; if it has scales, amplitudes are in um, and an axis above gives the frequencies in Hz. Default that of
        the point.
    dimensionless : bool, optional
        Whether the units of the model are kept; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the floor is not between 0 and 1.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> axes = hb.plot.spectrum(curve["LP1"])
    """
    checked("spectrum", "floor", floor, Range(above=0, below=1))
    units = _units(point, element, model, dimensionless)
    with styled():
        return _draw_spectrum(axes_or_new(ax, (4.2, 2.8)), point, element, units, log, floor)


def _draw_spectrum(
    ax: Axes, point: Point, element: int | str, units: _Units, log: bool = True, floor: float = FLOOR
) -> Axes:
    """Draw the amplitudes of the harmonics down to a fraction of the largest."""
    from matplotlib.ticker import MaxNLocator

    row, layout = point.coefficients(element), _cycle(point, element)[0]
    order = np.arange(1, layout.harmonics + 1) / layout.nu
    height = units.length * np.hypot(row[1::2], row[2::2])
    top = float(height.max()) or 1.0
    low = top * floor if log else 0.0
    order, height = order[height >= low], height[height >= low]
    ax.vlines(order, low, height, color=_colour(point, element), linewidth=1.2)
    ax.plot(order, height, "o", color=_colour(point, element), markersize=3, clip_on=False)
    if log:
        ax.set_yscale("log")
        ax.set_ylim(low, 3 * top)
        _decibels(ax, top, floor)
    ax.set_ylim(bottom=low)
    ax.set_xlim(0, (layout.harmonics + 1) / layout.nu)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    ax.set_xlabel("frequency / excitation frequency [-]")
    ax.set_ylabel(f"amplitude of {units.displacement}")
    dress(ax)
    mesh = units.speeds.get(MESH)
    if mesh:
        scaled_axes(ax, {MESH: mesh}, title="frequency [Hz]")
    ax.tick_params(which="both", right=not log)
    return ax


def _decibels(ax: Axes, top: float, floor: float) -> None:
    """Add an axis on the right in decibels relative to the largest line; it states the floor."""
    right: Any = ax.secondary_yaxis(
        "right",
        functions=(
            lambda y: 20 * np.log10(np.maximum(y, 1e-300) / top),
            lambda level: top * 10 ** (np.asarray(level) / 20),
        ),
    )
    right.set_yscale("linear")
    lowest = 20 * np.log10(floor)
    right.set_yticks(np.linspace(0.0, lowest, 7 if round(lowest) % 6 == 0 else 5))
    right.minorticks_off()
    right.set_ylabel(f"level re largest line [dB], floor \N{MINUS SIGN}{-lowest:.0f}", fontsize=8)
    right.tick_params(direction="in", width=0.6, labelsize=8, labelfontfamily=current_font())


@checked_arguments()
def portrait(
    point: Point, element: int | str = 0, model: Model | None = None, *, dimensionless: bool = False
) -> Figure:
    """Draw time history, phase diagram and spectrum of a point side by side.

    Parameters
    ----------
    point : Point
        Point of a curve.
    element : int or str, optional
        Element by number or name; default 0.
    model : Model, optional
        Model; if it has scales, axes are in um, m/s and Hz, and the title states the mesh frequency and the speed of
        the pinion. Default that of the point.
    dimensionless : bool, optional
        Whether the units of the model are kept; default False.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> figure = hb.plot.portrait(curve["LP1"])
    >>> len(figure.axes)
    3
    """
    with styled():
        figure = new_figure(9.6, 2.9)
        units, axes = _units(point, element, model, dimensionless), figure.subplots(1, 3)
        for draw, ax in zip((_draw_history, _draw_phase, _draw_spectrum), axes, strict=True):
            draw(ax, point, element, units)
        speeds = [
            f"{units.speeds[name]:.5g} {unit}" for name, unit in ((MESH, "Hz"), (PINION, "r/min")) if units.speeds
        ]
        figure.suptitle(", ".join([_title(point, element), *speeds]), fontsize=10)
    return figure


class _Units(NamedTuple):
    """Factors and labels of the axes of a displacement and its rate; speeds as in `speeds_at`."""

    length: float
    rate: float
    displacement: str
    velocity: str
    speeds: dict[str, float]


def _units(point: Point, element: int | str, model: Model | None, dimensionless: bool) -> _Units:
    """Return physical units if the model, by default that of the point, has scales; else those of the model."""
    model = model or getattr(point.problem, "model", None)
    layout, scales = layout_of(point), None if dimensionless else scales_with(model, point.parameters)
    label, speeds = gap_label(layout, element), speeds_at(model, point.parameters)
    if scales is None:
        velocity = getattr(layout, "labels", {}).get("velocity", f"velocity of {label}")
        return _Units(1.0, 1.0, label, velocity, speeds)
    symbol, comma, name = label.partition(", ")
    displacement = in_figure(in_micrometres(symbol)) + comma + name
    velocity = f"velocity of {in_metres_per_second(symbol)}{comma}{name}"
    return _Units(1e6 * scales.length, scales.velocity, displacement, velocity, speeds)


def _colour(point: Point, element: int | str) -> str:
    return COLOURS[regime_of(layout_of(point), point.regime, element)]


def _title(point: Point, element: int | str) -> str:
    """Return a description of a point: label, Omega, stability, regime."""
    regime = regime_of(layout_of(point), point.regime, element)
    texts = [point.label, "" if point.stability == "unknown" else point.stability_in_words]
    texts += [in_words(regime) if regime != "unknown" else ""]
    if "Omega" in point.parameters:
        texts.insert(1, rf"$\Omega$ = {point.parameters['Omega']:.5g}")
    return ", ".join(text for text in texts if text)


def _cycle(point: Point, element: int | str, order: int = 0) -> tuple[Layout, Array, Array]:
    """Return layout, time in excitation periods, and motion or its derivative in theta over one closed period."""
    theta, d = point.samples(element, order=order)
    layout = layout_of(point)
    assert layout is not None  # a point without layout has no samples
    return layout, np.append(theta / (2 * np.pi), 1.0) * layout.nu, np.append(d, d[0])


def _breakpoints(layout: Layout, element: int | str, d: Array, unit: float, line: Any, limits: Any) -> None:
    """Draw thin lines at the breakpoints of the law; the limits include those near the motion."""
    low, high = d.min(), d.max()
    reach = max(high - low, 1e-12 * abs(high), 1e-300)
    breakpoints = layout.breakpoints[layout.index(element)]
    for x in breakpoints:
        line(unit * x, color=GREY, linewidth=0.7, zorder=0, gid="breakpoint")
    visible = [low, high, *(x for x in breakpoints if low - reach <= x <= high + reach)]
    margin = 0.06 * (max(visible) - min(visible)) or 0.5
    limits(unit * (min(visible) - margin), unit * (max(visible) + margin))
