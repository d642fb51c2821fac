"""Figures of bifurcation diagrams."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.analysis.quantities.length_units import MICROMETRE, factor_of, in_figure
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.models.frequency_units import length_scale, model_of, scales
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import evaluate
from hbgear.mechanics.series.measures import axis_text
from hbgear.plot.branch_sections import sections
from hbgear.plot.curves import BACKGROUND, response
from hbgear.plot.style import GREY, add_legend, axes_or_new, dots, dress_with_speeds, styled
from hbgear.time.attractors.bifurcation_diagram import BifurcationDiagram
from hbgear.time.attractors.verdicts import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

VERDICTS = {
    Verdict.PERIODIC: "black",
    Verdict.QUASI_PERIODIC: "#0072b2",
    Verdict.CHAOTIC: "#d55e00",
    Verdict.UNDECIDED: "#8a8a8a",
}
"""Colours of motions of each kind."""

_DOT, _SMALL_DOT = 2.6, 0.9
"""Diameters [pt] of points of periodic and of other motions."""


@checked_arguments()
def bifurcation_diagram(
    found: BifurcationDiagram,
    measure: str = "",
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    curves: Sequence[Branch] = (),
    rate: bool = False,
    legend: bool = True,
    model: Model | None = None,
    dimensionless: bool = False,
) -> Axes:
    """Draw a bifurcation diagram: stroboscopic points, or an amplitude, coloured by the kind of the motion.

    Points of both sweep directions have the same colours. With ``curves`` the periodic motions are drawn below, stable
    ones solid and unstable ones dashed, so that windows without stable periodic motion are visible.

    Parameters
    ----------
    found : BifurcationDiagram
        Result of `hbgear.time.bifurcation_diagram`.
    measure : str, optional
        Measure of amplitude, see `Branch.amplitude`, for points on response curves. By default the displacement at
        tau = 0 after every excitation period is drawn.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default, with axes of the speeds above if the model of the curves has scales.
    curves : sequence of Branch, optional
        Curves of periodic motions in the same parameter.
    rate : bool, optional
        Whether the rate at tau = 0 is drawn instead of the displacement; default False.
    legend : bool, optional
        Whether to add a legend; default True.
    model : Model, optional
        Model, whose scales convert Omega to r/min and displacements to um; default that of the first curve.
    dimensionless : bool, optional
        Whether Omega and displacements keep the unit of the model; default False.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError, KeyError
        If a curve is in another parameter or has no Fourier coefficients, or the measure or the element is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.time.bifurcation_diagram(hb.Duffing(zeta=0.3), "Omega", (0.5, 0.6), "up", values=3)
    >>> axes = hb.plot.bifurcation_diagram(found)
    >>> len(axes.lines)
    1
    """
    for curve in curves:
        if curve.parameter != found.parameter:
            raise ValueError(
                f"the curve is in {curve.parameter}, the diagram in {found.parameter}: trace the curve in "
                f"{found.parameter}"
            )
    is_new, first = ax is None, found.sweeps[0]
    name = first.elements[first.index(element)] or f"element {first.index(element)}"
    model = model or (model_of(curves[0]) if curves else None)
    length = None if dimensionless or rate else length_scale(model, {})
    factor = factor_of(measure, length) if measure else factor_of("max", length)
    units = scales(model, {}) if found.parameter == "Omega" else {}
    abscissa = OmegaAxis(units, first.labels.get(found.parameter, found.parameter), dimensionless)
    with styled():
        ax = axes_or_new(ax, (5.6, 3.7))
        for curve in curves:
            if measure:
                options: Any = {**BACKGROUND, "color": GREY, "dimensionless": dimensionless}
                response(curve, measure, element, ax, label="periodic motions", **options)
            else:
                _section_lines(ax, curve, element, rate, abscissa.scale, factor)
        for verdict, colour in VERDICTS.items():
            x, y = _dots(found, verdict, measure, element, rate)
            if not len(x):
                continue
            size = _DOT if verdict is Verdict.PERIODIC or measure else _SMALL_DOT
            dots(ax, abscissa.scale * x, factor * y, colour, size, verdict.value, zorder=5)
        ax.set_xlabel(abscissa.label)
        motion = name if length is None else f"{name} [{MICROMETRE}]"
        section = f"{'rate of ' if rate else ''}{name} at " + r"$\tau = 0$" + motion.removeprefix(name)
        ax.set_ylabel(in_figure(axis_text(measure, motion) if measure else section))
        ax.margins(y=0.08)  # space for labels
        dress_with_speeds(ax, abscissa.above if is_new else {})
        if legend:
            add_legend(ax)
    return ax


def _dots(
    found: BifurcationDiagram, verdict: Verdict, measure: str, element: int | str, rate: bool
) -> tuple[Array, Array]:
    """Return values of the parameter and heights of the points of the motions of one kind."""
    x, y = [], []
    for sweep, kinds in zip(found.sweeps, found.verdicts, strict=True):
        rows = np.flatnonzero(kinds == verdict)
        if measure:
            points = sweep.values[rows], sweep.amplitude(measure, element)[rows]
        else:
            points = sweep.section_points(rows, element, rate)
        x.append(points[0])
        y.append(points[1])
    return np.concatenate(x), np.concatenate(y)


def _section_lines(ax: Axes, curve: Branch, element: int | str, rate: bool, scale: float, factor: float) -> None:
    """Draw the displacement, or its rate, at tau = 0 after each period along a curve."""
    layout = layout_of(curve)
    if layout is None:
        raise ValueError("the curve has no Fourier coefficients of motions; give a curve of a harmonic balance")
    theta = 2 * np.pi * np.arange(layout.nu) / layout.nu
    height = factor * evaluate(layout.rows(curve.X, element), theta, int(rate))
    if rate:
        Omega = np.array([curve.parameters_at(i)["Omega"] for i in range(len(curve))])
        height = height * (Omega / layout.nu)[:, None]
    for (_, stable), i, j in sections(curve, element):
        line, state = ("--", "unstable") if stable is False else ("-", "stable")
        look: Any = {"color": GREY, "linewidth": 0.9, "zorder": 1, "gid": state, "label": f"curve, {state}"}
        for column in height.T:
            ax.plot(scale * curve.values[i : j + 1], column[i : j + 1], line, **look)
