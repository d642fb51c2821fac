"""Figures of motions that are not periodic: bifurcation diagrams; amplitudes, sections and spectra of tori."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.axis_quantities import MICROMETRE, Abscissa, OmegaAxis, Ordinate, factor_of, in_figure
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.autonomous.tori.layout import TorusLayout
from hbgear.harmonic.equations.layout import axis_text, layout_of
from hbgear.harmonic.models.frequency_units import length_scale, model_of, scales
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import evaluate
from hbgear.plot.branch_sections import sections
from hbgear.plot.curves import response
from hbgear.plot.style import GREY, LINES, add_legend, axes_or_new, dress, heighten, scaled_axes, styled
from hbgear.time.attractors.bifurcation_diagram import BifurcationDiagram
from hbgear.time.attractors.verdicts import Verdict
from hbgear.time.frequency_sweep import Sweep

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

_MAX_VECTOR_DOTS = 1000
"""Largest number of dots of one set that is drawn as vectors; larger sets are drawn as pixels."""


@checked_arguments()
def bifurcation_diagram(
    found: BifurcationDiagram, measure: str = "", element: int | str = 0, ax: Axes | None = None, *,
    curves: Sequence[Branch] = (), rate: bool = False, legend: bool = True, model: Model | None = None,
    dimensionless: bool = False,
) -> Axes:  # fmt: skip
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
    own, first = ax is None, found.sweeps[0]
    name = first.elements[first.index(element)] or f"element {first.index(element)}"
    model = model or (model_of(curves[0]) if curves else None)
    length = None if dimensionless or rate else length_scale(model, {})
    factor = factor_of(measure, length) if measure else factor_of("max", length)
    known = scales(model, {}) if found.parameter == "Omega" else {}
    across = OmegaAxis(known, first.labels.get(found.parameter, found.parameter), dimensionless)
    with styled():
        ax = axes_or_new(ax, (5.6, 3.7))
        for curve in curves:
            if measure:
                response(curve, measure, element, ax, color=GREY, label="periodic motions", jumps=False, legend=False,
                         speeds=False, dimensionless=dimensionless)  # fmt: skip
            else:
                _section_lines(ax, curve, element, rate, across.scale, factor)
        for verdict, colour in VERDICTS.items():
            x, y = (np.concatenate(parts) for parts in zip(*(
                _dots(sweep, kinds == verdict, measure, element, rate)
                for sweep, kinds in zip(found.sweeps, found.verdicts, strict=True)
            ), strict=True))  # fmt: skip
            if not len(x):
                continue
            size = _DOT if verdict is Verdict.PERIODIC or measure else _SMALL_DOT
            ax.plot(
                across.scale * x, factor * y, "o", color=colour, markersize=size, markeredgewidth=0, zorder=5,
                label=verdict.value, gid=verdict.value, rasterized=len(x) > _MAX_VECTOR_DOTS,
            )  # fmt: skip
        ax.set_xlabel(across.label)
        motion = name if length is None else f"{name} [{MICROMETRE}]"
        section = f"{'rate of ' if rate else ''}{name} at " + r"$\tau = 0$" + motion.removeprefix(name)
        ax.set_ylabel(in_figure(axis_text(measure, motion) if measure else section))
        ax.margins(y=0.08)  # space for labels
        dress(ax)
        if own and scaled_axes(ax, across.above):
            heighten(ax)
        if legend:
            add_legend(ax)
    return ax


def _dots(sweep: Sweep, which: np.ndarray, measure: str, element: int | str, rate: bool) -> tuple[Array, Array]:
    """Return values of the parameter and heights of the points of some motions of a sweep."""
    rows, j = np.flatnonzero(which), sweep.index(element)
    if measure:
        return sweep.values[rows], sweep.amplitude(measure, element)[rows]
    heights = [sweep.points[i][:, j, int(rate)] for i in rows]
    if not heights:
        return np.empty(0), np.empty(0)
    return np.concatenate([np.full(len(y), sweep.values[i]) for i, y in zip(rows, heights, strict=True)]), (
        np.concatenate(heights)
    )


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
        for column in height.T:
            ax.plot(
                scale * curve.values[i : j + 1], column[i : j + 1], "--" if stable is False else "-", color=GREY,
                linewidth=0.9, zorder=1, gid="unstable" if stable is False else "stable",
                label=f"curve, {'unstable' if stable is False else 'stable'}",
            )  # fmt: skip


# ---- tori

_LARGEST_SPECTRUM = 1e-5
"""Amplitude over the largest one from which lines of a spectrum are drawn."""


def _torus_layout(tori: Branch) -> TorusLayout:
    if not isinstance(tori.layout, TorusLayout):
        raise ValueError("the branch has no tori: give the branch of hb.analysis.torus(curve, 'NS1')")
    return tori.layout


@checked_arguments()
def torus(
    tori: Branch, measure: str = "pp2", element: int | str = 0, ax: Axes | None = None, *,
    label: str = "quasi-periodic", dimensionless: bool = False, **style: Any,
) -> Axes:  # fmt: skip
    """Draw an amplitude of tori over the parameter, also on the axes of a response curve.

    Stable sections are solid, unstable ones dashed and undecided ones dotted.

    Parameters
    ----------
    tori : Branch
        Branch of `hbgear.analysis.torus`.
    measure : str, optional
        Measure of the whole torus: "pp2" (default), "rms", "max" or "mean".
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on, such as those of `response`; new ones by default.
    label : str, optional
        Text of the legend; default "quasi-periodic". No legend if it is empty.
    dimensionless : bool, optional
        Whether the axes are in the units of the model. By default they are the speed of the pinion [r/min] and the
        amplitude [um] if the model has scales, as in `response`.
    **style
        Properties of the line, such as ``color``.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the branch has no tori, or the measure is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> hb.plot.torus(curve)  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    ValueError: the branch has no tori
    """
    layout, own = _torus_layout(tori), ax is None
    across, height = Abscissa([tori], dimensionless), Ordinate(measure, element, dimensionless=dimensionless)
    layout.check_measure(measure, element)
    x, y = across.along(tori), height.along(tori)
    with styled():
        ax = axes_or_new(ax, (4.6, 3.2))
        for i, ((_, stable), first, last) in enumerate(sections(tori, element)):
            kind, width = LINES[stable]
            line: dict[str, Any] = {
                "color": VERDICTS[Verdict.QUASI_PERIODIC], "linewidth": width, "linestyle": kind,
                "marker": "." if first == last else None,
            }  # fmt: skip
            ax.plot(x[first : last + 1], y[first : last + 1], **(line | style),
                    label=label if label and not i else "_", zorder=4, gid="tori")  # fmt: skip
        if own:
            name = _element_name(layout, element)
            physical = height.header(tori) != measure
            ax.set_xlabel(layout.labels.get(tori.parameter, tori.parameter) if across.scale == 1 else across.label)
            ax.set_ylabel(in_figure(axis_text(measure, f"{name} [um]" if physical else name)))
            dress(ax)
            if scaled_axes(ax, across.above):
                heighten(ax)
        if label:
            add_legend(ax)
    return ax


def _element_name(layout: TorusLayout, element: int | str) -> str:
    return layout.elements[layout.index(element)] or f"element {layout.index(element)}"


@checked_arguments()
def torus_section(
    tori: Branch, point: int = -1, element: int | str = 0, ax: Axes | None = None, *, phases: int = 400
) -> Axes:
    """Draw the section of a torus at tau = 0: rate over displacement, a closed curve that the motion fills.

    Parameters
    ----------
    tori : Branch
        Branch of `hbgear.analysis.torus`.
    point : int, optional
        Number of the point; default the last one.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    phases : int, optional
        Number of points of the curve; default 400.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the branch has no tori.

    Examples
    --------
    See `hbgear.analysis.torus` for a branch.

    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> hb.plot.torus_section(curve)  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    ValueError: the branch has no tori
    """
    layout, found = _torus_layout(tori), tori[point]
    basis = layout.basis
    theta = np.column_stack([np.zeros(phases + 1), np.linspace(0.0, 2 * np.pi, phases + 1)])
    rows = layout.rows(found.X, element)
    here = {name: np.array([x]) for name, x in found.parameters.items()}
    rate = layout.in_time(rows[None], here, 1)[0]
    d, v = (basis.evaluate(basis.to_complex(x), theta) for x in (rows, rate))
    name = _element_name(layout, element)
    with styled():
        ax = axes_or_new(ax, (3.6, 3.2))
        ax.plot(d, v, color=VERDICTS[Verdict.QUASI_PERIODIC], linewidth=1.2, gid="section")
        ax.set_xlabel(f"{name} at " + r"$\tau = 0$")
        ax.set_ylabel(f"rate of {name}")
        dress(ax)
    return ax


@checked_arguments()
def torus_spectrum(tori: Branch, point: int = -1, element: int | str = 0, ax: Axes | None = None) -> Axes:
    """Draw the spectrum of a torus: amplitudes at the frequencies |k_1 Omega / nu + k_2 Omega_2|.

    Parameters
    ----------
    tori : Branch
        Branch of `hbgear.analysis.torus`.
    point : int, optional
        Number of the point; default the last one.
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    Axes
        The axes. Lines without the second frequency are black.

    Raises
    ------
    ValueError
        If the branch has no tori.

    Examples
    --------
    See `hbgear.analysis.torus` for a branch.

    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> hb.plot.torus_spectrum(curve)  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    ValueError: the branch has no tori
    """
    layout, found = _torus_layout(tori), tori[point]
    basis = layout.basis
    size = np.abs(basis.to_complex(layout.rows(found.X, element)))
    w = np.abs(basis.k @ np.array([found.parameters["Omega"] / layout.nu, found.parameters["Omega_2"]]))
    shown = size > _LARGEST_SPECTRUM * size[1:].max()
    with styled():
        ax = axes_or_new(ax, (4.6, 3.2))
        kinds = (
            (basis.k[:, 1] > 0, VERDICTS[Verdict.QUASI_PERIODIC], r"with $\Omega_2$"),
            (basis.k[:, 1] == 0, "black", r"multiples of $\Omega$"),
        )
        for which, colour, label in kinds:
            rows = shown & which
            floor = _LARGEST_SPECTRUM * size[1:].max()
            ax.vlines(w[rows], floor, size[rows], color=colour, linewidth=1.2, label=label, gid=label)
        ax.set_yscale("log")
        ax.set_xlabel(r"frequency, in the unit of $\Omega$")
        ax.set_ylabel(f"amplitude of {_element_name(layout, element)}")
        dress(ax)
        add_legend(ax)
    return ax
