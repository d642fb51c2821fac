"""Figures of single motions: functions that draw a point on matplotlib axes and return them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import Range, checked
from hbgear.continuation.results.point import Point
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.models.frequency_units import MESH, PINION, speeds_at
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
def time_history(point: Point, element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Draw the motion of an element over its period, with thin lines at the breakpoints of its law.

    Parameters
    ----------
    point : Point
        Point of a curve.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.

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
    layout, periods, d = _cycle(point, element)
    with styled():
        ax = axes_or_new(ax, (4.2, 2.8))
        ax.plot(periods, d, color=_colour(point, element))
        ax.set_xlim(0, layout.nu)
        ax.set_xlabel("excitation periods")
        ax.set_ylabel(gap_label(layout, element))
        dress(ax)
        _breakpoints(layout, element, d, ax.axhline, ax.set_ylim)
    return ax


@checked_arguments()
def phase_diagram(point: Point, element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Draw velocity against displacement, d' = (Omega / nu) dd/dtheta, with a dot once per excitation period.

    Parameters
    ----------
    point : Point
        Point of a curve.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.

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
    layout, periods, d = _cycle(point, element)
    if "Omega" not in point.parameters:
        raise ValueError(f"a phase diagram needs Omega; the point has {', '.join(point.parameters) or 'no parameters'}")
    v = point.parameters["Omega"] / layout.nu * _cycle(point, element, order=1)[2]
    starts = np.searchsorted(periods, np.arange(layout.nu))
    with styled():
        ax = axes_or_new(ax, (3.2, 2.8))
        colour = _colour(point, element)
        ax.plot(d, v, color=colour)
        ax.plot(d[starts], v[starts], "o", color=colour, markersize=3.5)
        ax.set_xlabel(gap_label(layout, element))
        ax.set_ylabel(layout.labels.get("velocity", f"velocity of {gap_label(layout, element)}"))
        dress(ax)
        _breakpoints(layout, element, d, ax.axvline, ax.set_xlim)
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
        Model; if it has scales, axes above give the frequencies in Hz.

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
    from matplotlib.ticker import MaxNLocator

    checked("spectrum", "floor", floor, Range(above=0, below=1))
    row = point.coefficients(element)
    layout = _cycle(point, element)[0]
    order = np.arange(1, layout.harmonics + 1) / layout.nu
    height = np.hypot(row[1::2], row[2::2])
    top = float(height.max()) or 1.0
    low = top * floor if log else 0.0
    order, height = order[height >= low], height[height >= low]
    with styled():
        ax = axes_or_new(ax, (4.2, 2.8))
        ax.vlines(order, low, height, color=_colour(point, element), linewidth=1.2)
        ax.plot(order, height, "o", color=_colour(point, element), markersize=3, clip_on=False)
        if log:
            ax.set_yscale("log")
            ax.set_ylim(low, 3 * top)
            _decibels(ax, top, floor)
        ax.set_ylim(bottom=low)
        ax.set_xlim(0, (layout.harmonics + 1) / layout.nu)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        ax.set_xlabel("frequency / excitation frequency")
        ax.set_ylabel(f"amplitude of {gap_label(layout, element)}")
        dress(ax)
        mesh = speeds_at(model, point.parameters).get(MESH)
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
    right.set_ylabel(f"dB of the largest line, floor \N{MINUS SIGN}{-lowest:.0f} dB", fontsize=8)
    right.tick_params(direction="in", width=0.6, labelsize=8, labelfontfamily=current_font())


@checked_arguments()
def portrait(point: Point, element: int | str = 0, model: Model | None = None) -> Figure:
    """Draw time history, phase diagram and spectrum of a point side by side.

    Parameters
    ----------
    point : Point
        Point of a curve.
    element : int or str, optional
        Element by number or name; default 0.
    model : Model, optional
        Model; if it has scales, the title states the mesh frequency and the speed of the pinion.

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
        axes = figure.subplots(1, 3)
        time_history(point, element, axes[0])
        phase_diagram(point, element, axes[1])
        spectrum(point, element, axes[2], model=model)
        known = speeds_at(model, point.parameters)
        units = [f"{known[name]:.5g} {unit}" for name, unit in ((MESH, "Hz"), (PINION, "r/min")) if known]
        figure.suptitle(", ".join([_title(point, element), *units]), fontsize=10)
    return figure


def _colour(point: Point, element: int | str) -> str:
    return COLOURS[regime_of(layout_of(point), point.regime, element)]


def _title(point: Point, element: int | str) -> str:
    """Return a description of a point: label, Omega, stability, regime."""
    regime = regime_of(layout_of(point), point.regime, element)
    parts = [point.label, "" if point.stability == "unknown" else point.stability]
    parts += [in_words(regime) if regime != "unknown" else ""]
    if "Omega" in point.parameters:
        parts.insert(1, rf"$\Omega$ = {point.parameters['Omega']:.5g}")
    return ", ".join(part for part in parts if part)


def _cycle(point: Point, element: int | str, order: int = 0) -> tuple[Layout, Array, Array]:
    """Return layout, time in excitation periods, and motion or its derivative in theta over one closed period."""
    theta, d = point.samples(element, order=order)
    layout = layout_of(point)
    assert layout is not None  # a point without layout has no samples
    return layout, np.append(theta / (2 * np.pi), 1.0) * layout.nu, np.append(d, d[0])


def _breakpoints(layout: Layout, element: int | str, d: Array, line: Any, limits: Any) -> None:
    """Draw thin lines at the breakpoints of the law; the limits include those near the motion."""
    low, high = d.min(), d.max()
    reach = max(high - low, 1e-12 * abs(high), 1e-300)
    breakpoints = layout.breakpoints[layout.index(element)]
    for x in breakpoints:
        line(x, color=GREY, linewidth=0.7, zorder=0, gid="breakpoint")
    shown = [low, high, *(x for x in breakpoints if low - reach <= x <= high + reach)]
    margin = 0.06 * (max(shown) - min(shown)) or 0.5
    limits(min(shown) - margin, max(shown) + margin)
