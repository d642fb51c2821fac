"""Figures of backbones and tori: amplitudes, also on the axes of response curves; sections and spectra of tori."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.axis_quantities import Abscissa, OmegaAxis, Ordinate, kind_of
from hbgear.analysis.quantities.length_units import in_figure, in_metres_per_second, in_micrometres
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.autonomous.backbone import AMPLITUDE
from hbgear.harmonic.autonomous.mode_stability import BackboneStability
from hbgear.harmonic.autonomous.tori.layout import TorusLayout
from hbgear.harmonic.models.frequency_units import model_of, scales_at
from hbgear.mechanics.series.measures import axis_text
from hbgear.plot.branch_sections import sections
from hbgear.plot.style import (
    BRANCHES,
    COLOURS,
    add_legend,
    axes_or_new,
    dress,
    dress_with_speeds,
    line_of,
    mark_special_points,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked_arguments()
def backbone(
    curve: Branch,
    measure: str = "pp2",
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    label: str = "backbone",
    stability: BackboneStability | None = None,
    dimensionless: bool = False,
    **style: Any,
) -> Axes:
    """Draw a backbone: an amplitude over the modal frequency, also on the axes of a response curve.

    With its stability, unstable motions are dashed, and circles mark the changes of stability.

    Parameters
    ----------
    curve : Branch
        Curve of `hbgear.analysis.backbone`.
    measure : str, optional
        Measure of amplitude, see `Branch.amplitude`; default "pp2".
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on, such as those of `response`; new ones by default.
    label : str, optional
        Text of the legend; default "backbone". No legend if it is empty.
    stability : BackboneStability, optional
        Result of `hbgear.analysis.backbone_stability` for this curve. None by default: one line for all motions.
    dimensionless : bool, optional
        Whether frequency and amplitude keep the units of the model. By default they are the speed of the pinion [r/min]
        and the amplitude [um] if the model has scales, as in `response`.
    **style
        Properties of the line, such as ``color``.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If the curve is not a backbone, or the stability is that of another curve.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.analysis.backbone(hb.Duffing(), span=(0.01, 2.0), harmonics=5)
    >>> axes = hb.plot.backbone(curve, "H1")
    >>> len(axes.lines)
    1
    """
    if curve.parameter != AMPLITUDE or "Omega" not in curve.tracked:
        raise ValueError("this curve is no backbone; give the curve of hb.analysis.backbone(model)")
    if stability is not None and len(stability.states) != len(curve):
        raise ValueError(
            f"the stability of {len(stability.states)} points is given for a curve of {len(curve)} points: give "
            "hb.analysis.backbone_stability(curve)"
        )
    is_new, abscissa = ax is None, OmegaAxis.of(model_of(curve), dimensionless)
    height = Ordinate(measure, element, dimensionless=dimensionless)
    with styled():
        ax = axes_or_new(ax, (4.6, 3.2))
        colour, line = (COLOURS["no_impact"], "-") if is_new else ("black", "-.")
        look = {"color": colour, "linestyle": line, "linewidth": 1.2, **style}
        x = abscissa.scale * curve.tracked["Omega"]
        _add_line(ax, x, height.along(curve), stability, look, label or "_")
        if is_new:
            unit = " [-]" if abscissa.above and not abscissa.is_speed else ""
            ax.set_xlabel(
                f"modal frequency, {abscissa.label}" if abscissa.is_speed else r"modal frequency $\Omega$" + unit
            )
            ax.set_ylabel(height.label(curve))
            ax.set_ylim(0, None)
            ax.margins(x=0.05)
            dress_with_speeds(ax, abscissa.above)
        if (label and not is_new) or (stability and stability.changes):
            add_legend(ax)
    return ax


def _add_line(
    ax: Axes, x: Array, y: Array, stability: BackboneStability | None, style: dict[str, Any], label: str
) -> None:
    """Draw the line of a backbone, dashed where it is unstable, and the changes of stability."""
    states = stability.states if stability else ("unknown",) * len(x)
    unstable = np.array([state == "unstable" for state in states])
    ax.plot(x, np.where(unstable, np.nan, y), **style, label=label, zorder=4, gid="backbone")
    if unstable.any():
        from scipy.ndimage import binary_dilation

        joined = binary_dilation(unstable)  # the dashes reach the stable neighbours
        ax.plot(x, np.where(joined, y, np.nan), **{**style, "linestyle": "--"}, label="_", zorder=4, gid="unstable")
    if stability and stability.changes:
        positions, numbers = [change.position for change in stability.changes], np.arange(len(x))
        circles: dict[str, Any] = {"marker": "o", "ls": "", "ms": 4, "mfc": "white", "mec": "black", "mew": 0.8}
        heights = np.interp(positions, numbers, y)
        ax.plot(
            np.interp(positions, numbers, x), heights, **circles, label="change of stability", zorder=5, gid="changes"
        )


def with_other_kinds(
    responses: Callable[..., Axes],
    branches: Sequence[Branch],
    measure: str | None,
    element: int | str,
    ax: Axes | None,
    *,
    names: Sequence[str] | None = None,
    legend: bool = True,
    dimensionless: bool = False,
    **options: Any,
) -> Axes:
    """Draw response curves, and tori and backbones on their axes; see `responses`.

    Parameters
    ----------
    responses : callable
        Function that draws response curves, `responses`.
    branches : sequence of Branch
        Branches of any kind.
    measure : str or None
        Measure of amplitude; by default "pp2".
    element : int or str
        Element by number or name.
    ax : Axes or None
        Axes to draw on; new ones by default.
    names : sequence of str, optional
        Names in the legend.
    legend : bool, optional
        Whether to add a legend; default True.
    dimensionless : bool, optional
        Whether the axes are in the units of the model; default False.
    **options
        Arguments of `responses`.

    Returns
    -------
    Axes
        The axes.
    """
    labels = (
        list(names) if names else [{"tori": "quasi-periodic"}.get(kind_of(branch), "backbone") for branch in branches]
    )
    periodic = [i for i, branch in enumerate(branches) if kind_of(branch) == "periodic"]
    if periodic:
        ax = responses(
            [branches[i] for i in periodic],
            measure or "pp2",
            element,
            ax,
            legend=legend,
            dimensionless=dimensionless,
            names=[names[i] for i in periodic] if names and len(periodic) > 1 else None,
            **options,
        )
    for i, branch in enumerate(branches):
        if i not in periodic:
            draw = torus if kind_of(branch) == "tori" else backbone
            ax = draw(
                branch, measure or "pp2", element, ax, label=labels[i] if legend else "", dimensionless=dimensionless
            )
    assert ax is not None
    return ax


# ---- tori

_LARGEST_SPECTRUM = 1e-5
"""Amplitude over the largest one from which lines of a spectrum are drawn."""


def _torus_layout(tori: Branch) -> TorusLayout:
    if not isinstance(tori.layout, TorusLayout):
        raise ValueError("the branch has no tori: give the branch of hb.analysis.torus(curve, 'NS1')")
    return tori.layout


@checked_arguments()
def torus(
    tori: Branch,
    measure: str = "pp2",
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    label: str = "quasi-periodic",
    dimensionless: bool = False,
    **style: Any,
) -> Axes:
    """Draw an amplitude of tori over the parameter, also on the axes of a response curve.

    Stable sections are solid, unstable ones dashed and undecided ones dotted. Folds LP and losses of smoothness SM
    are marked.

    Parameters
    ----------
    tori : Branch
        Branch of `hbgear.analysis.torus`.
    measure : str, optional
        Measure of the whole torus: "pp2" (default), "rms", "max" or "mean".
    element : int or str, optional
        Element by number or name; default 0.
    ax : Axes, optional
        Axes to draw on, such as those of `response` with the same measure, which for a machine is "dte" by default; new
        ones by default. The "pp2" of a torus is that of the gaps, without the prescribed error.
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
    layout, is_new = _torus_layout(tori), ax is None
    abscissa, height = Abscissa([tori], dimensionless), Ordinate(measure, element, dimensionless=dimensionless)
    layout.check_measure(measure, element)
    x, y = abscissa.along(tori), height.along(tori)
    with styled():
        ax = axes_or_new(ax, (4.6, 3.2))
        parts = sections(tori, element)
        named = next((i for i, ((_, stable), *_) in enumerate(parts) if stable is True), 0)
        for i, ((_, stable), first, last) in enumerate(parts):
            rows, name = slice(first, last + 1), label if label and i == named else "_"
            look = {"color": BRANCHES[0], **line_of(stable), "marker": "." if first == last else None, **style}
            ax.plot(x[rows], y[rows], **look, label=name, zorder=4, gid="tori")
        mark_special_points(ax, tori, abscissa, height, kinds=("LP", "SM"))
        if is_new:
            name = _element_name(layout, element)
            physical = height.header(tori) != measure
            ax.set_xlabel(abscissa.label)
            ax.set_ylabel(in_figure(axis_text(measure, f"{name} [um]" if physical else name)))
            dress_with_speeds(ax, abscissa.above)
        if label:
            add_legend(ax)
    return ax


def _element_name(layout: TorusLayout, element: int | str) -> str:
    return layout.elements[layout.index(element)] or f"element {layout.index(element)}"


@checked_arguments()
def torus_section(
    tori: Branch,
    point: int = -1,
    element: int | str = 0,
    ax: Axes | None = None,
    *,
    phases: int = 400,
    dimensionless: bool = False,
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
    dimensionless : bool, optional
        Whether the axes are in the units of the model. By default they are in um and m/s if the model has scales.

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
    layout, motion = _torus_layout(tori), tori[point]
    basis = layout.basis
    theta = np.column_stack([np.zeros(phases + 1), np.linspace(0.0, 2 * np.pi, phases + 1)])
    rows = layout.rows(motion.X, element)
    parameters = {name: np.array([x]) for name, x in motion.parameters.items()}
    rate = layout.in_time(rows[None], parameters, 1)[0]
    d, v = (basis.evaluate(basis.to_complex(x), theta) for x in (rows, rate))
    name, scales = _element_name(layout, element), None if dimensionless else scales_at(tori, point)
    x, y = name, name
    if scales is not None:
        d, v = 1e6 * scales.length * d, scales.velocity * v
        x, y = in_figure(in_micrometres(name)), in_metres_per_second(name)
    with styled():
        ax = axes_or_new(ax, (3.6, 3.2))
        ax.plot(d, v, color=BRANCHES[0], linewidth=1.2, gid="section")
        ax.set_xlabel(f"{x} at " + r"$\tau = 0$")
        ax.set_ylabel(f"rate of {y} at " + r"$\tau = 0$")
        dress(ax)
    return ax


@checked_arguments()
def torus_spectrum(
    tori: Branch, point: int = -1, element: int | str = 0, ax: Axes | None = None, *, dimensionless: bool = False
) -> Axes:
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
    dimensionless : bool, optional
        Whether the axes are in the units of the model. By default they are in Hz and um if the model has scales.

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
    layout, motion = _torus_layout(tori), tori[point]
    basis = layout.basis
    size = np.abs(basis.to_complex(layout.rows(motion.X, element)))
    w = np.abs(basis.k @ np.array([motion.parameters["Omega"] / layout.nu, motion.parameters["Omega_2"]]))
    name, scales = _element_name(layout, element), None if dimensionless else scales_at(tori, point)
    frequency = r"frequency, in the unit of $\Omega$"
    if scales is not None:
        w, size = scales.frequency / (2 * np.pi) * w, 1e6 * scales.length * size
        frequency, name = "frequency [Hz]", in_figure(in_micrometres(name))
    visible = size > _LARGEST_SPECTRUM * size[1:].max()
    with styled():
        ax = axes_or_new(ax, (4.6, 3.2))
        kinds = (
            (basis.k[:, 1] > 0, BRANCHES[0], r"with $\Omega_2$"),
            (basis.k[:, 1] == 0, "black", r"multiples of $\Omega$"),
        )
        for selected, colour, label in kinds:
            rows = visible & selected
            floor = _LARGEST_SPECTRUM * size[1:].max()
            ax.vlines(w[rows], floor, size[rows], color=colour, linewidth=1.2, label=label, gid=label)
        ax.set_yscale("log")
        ax.set_xlabel(frequency)
        ax.set_ylabel(f"amplitude of {name}")
        dress(ax)
        add_legend(ax)
    return ax
