"""Measured sweeps on response curves, and residuals of a fit.

coordinates on axes of Omega and the amplitude of the model:   Omega_i = f_i / s,   A_i = d_i / L
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.parameter_sensitivity.units import units_of
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.analysis.quantities.length_units import factor_of
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.symbols import unit_of
from hbgear.design.fitting.fit import Fit
from hbgear.design.fitting.measurements import Measurements
from hbgear.harmonic.models.frequency_units import length_scale
from hbgear.mechanics.models import Model
from hbgear.plot.curves import response
from hbgear.plot.style import COLOURS, GREY, add_legend, axes_or_new, dress, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SWEEPS = {1: ("^", COLOURS["no_impact"], "measured, rising"), -1: ("v", COLOURS["single_sided"], "measured, falling")}
"""Marker, colour and name of each sweep direction."""

HOLLOW: Any = {"markersize": 3.6, "markerfacecolor": "white", "markeredgewidth": 0.8}


@checked_arguments()
def measured(
    data: Measurements, model: Model, ax: Axes | None = None, *, legend: bool = True, dimensionless: bool = False
) -> Axes:
    """Draw measured points, and measured jumps as vertical lines, on the axes of a response figure.

    Parameters
    ----------
    data : Measurements
        Measured points and jumps.
    model : Model
        Model whose scales convert data in Hz, r/min or metres.
    ax : Axes, optional
        Axes with a response curve of the same measure; new ones by default.
    legend : bool, optional
        Whether to add a legend; default True.
    dimensionless : bool, optional
        Whether the axes are Omega and the amplitude of the model; default False, as of `hbgear.plot.response`.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the model has no scale for the unit of the data.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.5, 1.6))
    >>> data = hb.design.Measurements([0.8, 0.9, 1.0], [0.4, 0.7, 1.1], direction=1)
    >>> axes = hb.plot.measured(data, hb.Duffing(), hb.plot.response(curve))
    """
    x, amplitude, deviation, abscissa = _in_figure_units(data, model, dimensionless)
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        for direction, (marker, colour, name) in SWEEPS.items():
            rows = data.directions == direction
            if rows.any():
                ax.errorbar(x[rows], amplitude[rows], deviation[rows], fmt="none", ecolor=colour, elinewidth=0.6)
                ax.plot(x[rows], amplitude[rows], marker, color=colour, label=name, zorder=5, **HOLLOW)
        unit = data.frequency_unit(units_of(model))
        for frequency, direction, _ in data.jumps:
            look: Any = {"color": SWEEPS[direction][1], "linewidth": 0.7, "linestyle": ":", "zorder": 0}
            ax.axvline(abscissa.scale * frequency / unit, **look)
        dress(ax)
        if legend:
            add_legend(ax)
    return ax


def _in_figure_units(data: Measurements, model: Model, dimensionless: bool) -> tuple[Array, Array, Array, OmegaAxis]:
    """Return abscissa, amplitude and deviation of measured points in the units of a figure, and its axis."""
    Omega, amplitude, deviation = data.in_units(units_of(model), unit_of(model.labels.get("amplitude", "")))
    abscissa, length = OmegaAxis.of(model, dimensionless), None if dimensionless else length_scale(model, {})
    factor = factor_of(data.measure, length)
    return abscissa.scale * Omega, factor * amplitude, factor * deviation, abscissa


@checked_arguments()
def fitted(found: Fit, *, dimensionless: bool = False) -> Figure:
    """Draw the fitted response with the data, and below the residuals in standard deviations.

    Crosses mark points that no stable motion of the curve reaches.

    Parameters
    ----------
    found : Fit
        Result of `hbgear.design.fit`.
    dimensionless : bool, optional
        Whether the axes are Omega and the amplitude of the model although it has scales; default False.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> import hbgear as hb
    >>> truth = hb.trace(hb.HarmonicBalance(hb.Duffing(zeta=0.06), 3), "Omega", (0.7, 0.9))
    >>> data = hb.design.Measurements(truth.values[1:], truth.amplitude("pp2")[1:], direction=-1)
    >>> figure = hb.plot.fitted(hb.design.fit(hb.Duffing(), data, {"zeta": (0.01, 0.2)}, harmonics=3))
    """
    data = found.data
    x, amplitude, _, abscissa = _in_figure_units(data, found.model, dimensionless)
    with styled():
        figure = new_figure(5.4, 4.8)
        axes: Any = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
        options: Any = {"legend": False, "speeds": False, "dimensionless": dimensionless}
        response(found.curve, data.measure, data.element, axes[0], **options)
        measured(data, found.model, axes[0], legend=False, dimensionless=dimensionless)
        missed = ~found.reached
        if missed.any():
            axes[0].plot(x[missed], amplitude[missed], "x", color="black", markersize=6, label="not reached", zorder=6)
        add_legend(axes[0])
        axes[0].set_xlabel("")
        residual_axes = axes[1]
        for direction, (marker, colour, _) in SWEEPS.items():
            rows = data.directions == direction
            residual_axes.plot(x[rows], found.residuals[rows], marker, color=colour, **HOLLOW)
        residual_axes.axhspan(-2, 2, color=GREY, alpha=0.15, linewidth=0)
        residual_axes.axhline(0.0, color=GREY, linewidth=0.6)
        residual_axes.set_ylabel("residual\n[deviations]")
        residual_axes.set_xlabel(abscissa.label)
        low, high = float(np.min(x)), float(np.max(x))
        residual_axes.set_xlim(low - 0.05 * (high - low), high + 0.05 * (high - low))
        dress(residual_axes)
    return figure
