"""Figures of a plane of two parameters: jump maps, and curves of special points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.text.digits import short
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.harmonic.bifurcations.events import named
from hbgear.plot.labels import labels_of
from hbgear.plot.style import BRANCHES, COLOURS, axes_or_new, dress, legend_entry, legend_handles, scaled_axes, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hbgear.analysis.jump_maps import JumpMap

CURVES = {
    "FoldProblem": ("folds", "-", COLOURS["no_impact"]),
    "PeriodDoublingProblem": ("period doublings", "--", COLOURS["single_sided"]),
    "NeimarkSackerProblem": ("Neimark-Sacker points", "-.", COLOURS["double_sided"]),
    "BranchPointProblem": ("branch points", ":", "black"),
    "GrazingProblem": ("grazing contacts", (0, (1, 2)), "grey"),
    "EdgeProblem": ("grazing contacts", (0, (1, 2)), "grey"),
    "SlipProblem": ("first slips", (0, (5, 1, 1, 1, 1, 1)), "grey"),
    "AmplitudeExtremum": ("peaks of the amplitude", "-", "black"),
}
"""Legend entry, line style and colour of each kind of curve, by the class of its equations."""


@checked_arguments()
def special_curves(
    curves: Sequence[Branch], ax: Axes | None = None, *, legend: bool = True, dimensionless: bool = False
) -> Axes:
    r"""Draw curves of special points in the plane of two parameters, with their points of codimension two.

    Parameters
    ----------
    curves : sequence of Branch
        Results of `hbgear.follow` in one second parameter, from curves in one first parameter.
    ax : Axes, optional
        Axes to draw on, such as those of `jump_map`; new ones by default.
    legend : bool, optional
        Whether to add a legend; default True.
    dimensionless : bool, optional
        Whether Omega is kept. By default it is the speed of the pinion [r/min] if the model has scales that do not
        depend on the parameter.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If a curve is no curve of special points, or the parameters of the curves differ.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 5), "Omega", (1.0, 0.6), accuracy=None)
    >>> folds = hb.follow(curve, "LP1", "zeta", (0.05, 0.2), accuracy=None)
    >>> axes = hb.plot.special_curves([folds])
    >>> axes.get_xlabel(), len(axes.lines)
    ('damping ratio $\zeta$', 2)
    """
    planes = {(curve.parameter, curve.meta.get("curve", {}).get("in", "")) for curve in curves}
    if len(planes) != 1 or (plane := next(iter(planes)))[1] not in curves[0].tracked:
        raise ValueError("special_curves needs results of hb.follow in one second parameter, from one first parameter")
    x, y = plane
    is_new, labels = ax is None, getattr(curves[0].layout, "labels", {})
    abscissa = OmegaAxis.of_ends(curves, labels.get("Omega", r"$\Omega$"), dimensionless)
    scale = abscissa.scale if y == "Omega" else 1.0
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        kinds: list[dict[str, str]] = [curve.meta.get("curve", {}) for curve in curves]
        meanings = [kind.get("meaning", "special points") for kind in kinds]
        colours = dict(zip(dict.fromkeys(meanings), cycle(BRANCHES[2:]), strict=False))  # of events of the user
        for curve, kind, meaning in zip(curves, kinds, meanings, strict=True):
            name, line, colour = CURVES.get(kind.get("of", ""), (meaning, "-", colours[meaning]))
            ax.plot(curve.values, scale * curve.tracked[y], linestyle=line, color=colour, label=name)
        _mark(ax, [p for curve in curves for p in curve.special], (x, y), scale)
        if is_new:
            ax.set_xlabel(labels.get(x, x))
            rms = f"rms of {labels.get('amplitude', 'all elements')}"  # the parameter of a backbone
            ax.set_ylabel({"Omega": abscissa.label, "amplitude": rms}.get(y, labels.get(y, y)))
            dress(ax)
        if legend:
            _add_legend(ax)
    return ax


def _mark(
    ax: Axes,
    points: Sequence[SpecialPoint],
    plane: tuple[str, str],
    scale: float,
    with_values: bool = False,
    unit: str = "",
) -> None:
    """Mark special points in the plane of two parameters, with their values on request."""
    for point in map(named, points):
        position = point.parameters[plane[0]], scale * point.parameters[plane[1]]
        look: Any = {"marker": point.marker, "color": "black", "markerfacecolor": "white", "linestyle": "none"}
        (symbol,) = ax.plot(*position, **look, markersize=8, label=legend_entry(point), gid=point.label)
        if with_values:
            text = f"{short(position[0], 5)}, {short(position[1], 4)}{unit}"
            labels_of(ax).add(symbol, 0, text, text, True, (0, 1))


def _add_legend(ax: Axes) -> None:
    """Add a legend with one entry for lines, markers and areas of the same label."""
    handles = legend_handles([*ax.lines, *ax.collections])
    ax.legend(handles.values(), handles.keys(), loc="best")


@checked_arguments()
def jump_map(jumps: JumpMap, ax: Axes | None = None, *, legend: bool = True, dimensionless: bool = False) -> Axes:
    """Draw jump frequencies against a design parameter; special points are marked.

    Ranges with several motions are shaded. Solid lines are jumps of a sweep with increasing Omega, dash-dotted lines
    jumps with decreasing Omega.

    Parameters
    ----------
    jumps : JumpMap
        Result of `hbgear.jump_map`.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    legend : bool, optional
        Whether to add a legend; default True.
    dimensionless : bool, optional
        Whether the ordinate is Omega. By default it is the speed of the pinion [r/min] if the model has scales that do
        not depend on the parameter.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> jumps = hb.jump_map(hb.Duffing(), "zeta", (0.05, 0.06), frequencies=(0.9, 1.4), harmonics=1, seeds=2)
    >>> axes = hb.plot.jump_map(jumps)
    """
    names = {1: ("jump, sweep up", "-"), -1: ("jump, sweep down", "-.")}
    is_new = ax is None
    abscissa = OmegaAxis.of_ends(jumps.folds, jumps.labels.get("Omega", r"$\Omega$"), dimensionless)
    with styled():
        ax = axes_or_new(ax, (5.0, 3.4))
        _shade(ax, jumps, abscissa.scale)
        for arm in jumps.arms:
            name, style = names[arm.direction]
            ax.plot(arm.values, abscissa.scale * arm.Omega, style, color=COLOURS["no_impact"], label=name)
        unit = " r/min" if abscissa.is_speed else ""
        _mark(ax, jumps.special, (jumps.parameter, "Omega"), abscissa.scale, True, unit)
        ax.set_xlim(*jumps.span)
        ax.margins(y=0.12)
        ax.set_xlabel(jumps.labels.get(jumps.parameter, jumps.parameter))
        ax.set_ylabel(abscissa.label)
        dress(ax)
        if is_new and scaled_axes(ax, abscissa.above, "right"):
            ax.figure.set_figwidth(6.2)  # type: ignore[union-attr]
        if not jumps.arms:
            found = "no jump found in this range" if jumps.status.complete else "no jump yet: the map is not complete"
            ax.text(0.5, 0.5, found, transform=ax.transAxes, ha="center")
        elif legend:
            _add_legend(ax)
    return ax


def _shade(ax: Axes, jumps: JumpMap, scale: float) -> None:
    """Shade the frequencies at which the curve has several motions, for each value of the parameter."""
    ends = [x for arm in jumps.arms for x in (arm.values[0], arm.values[-1])]
    values = np.unique(np.concatenate([np.linspace(*jumps.span, 600), ends]))
    look: Any = {"color": COLOURS["single_sided"], "alpha": 0.18, "linewidth": 0, "label": "several motions"}
    for low, high in jumps.bands(values):
        ax.fill_between(values, scale * low, scale * high, **look)
