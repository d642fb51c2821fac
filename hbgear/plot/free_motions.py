"""Figures of free motions: backbones over frequency; response curves with backbones and tori on the same axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hbgear.analysis.quantities.axis_quantities import OmegaAxis, Ordinate, kind_of
from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.autonomous.backbone import AMPLITUDE
from hbgear.harmonic.models.frequency_units import model_of
from hbgear.plot.style import COLOURS, add_legend, axes_or_new, dress, heighten, scaled_axes, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked_arguments()
def backbone(
    curve: Branch, measure: str = "pp2", element: int | str = 0, ax: Axes | None = None, *, label: str = "backbone",
    dimensionless: bool = False, **style: Any,
) -> Axes:  # fmt: skip
    """Draw a backbone: an amplitude over the modal frequency, also on the axes of a response curve.

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
        If the curve is not a backbone.

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
    own, across = ax is None, OmegaAxis.of(model_of(curve), dimensionless)
    height = Ordinate(measure, element, dimensionless=dimensionless)
    with styled():
        ax = axes_or_new(ax, (4.6, 3.2))
        line = {"color": COLOURS["no_impact"] if own else "black", "linestyle": "-" if own else "-.", "linewidth": 1.2}
        x = across.scale * curve.tracked["Omega"]
        ax.plot(x, height.along(curve), **(line | style), label=label or "_", zorder=4, gid="backbone")
        if own:
            unit = " [-]" if across.above and not across.is_speed else ""
            ax.set_xlabel(f"modal frequency, {across.label}" if across.is_speed else r"modal frequency $\Omega$" + unit)
            ax.set_ylabel(height.label(curve))
            ax.set_ylim(0, None)
            ax.margins(x=0.05)
            dress(ax)
            if scaled_axes(ax, across.above):
                heighten(ax)
        if label and not own:
            add_legend(ax)
    return ax


def with_other_kinds(
    branches: Sequence[Branch], measure: str | None, element: int | str, ax: Axes | None, *,
    names: Sequence[str] | None = None, legend: bool = True, dimensionless: bool = False, **options: Any,
) -> Axes:  # fmt: skip
    """Draw response curves, and tori and backbones on their axes; see `responses`.

    Parameters
    ----------
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
    from hbgear.plot.attractors import torus
    from hbgear.plot.curves import responses

    called = list(names) if names else [{"tori": "quasi-periodic"}.get(kind_of(each), "backbone") for each in branches]
    periodic = [i for i, branch in enumerate(branches) if kind_of(branch) == "periodic"]
    if periodic:
        ax = responses(
            [branches[i] for i in periodic], measure or "pp2", element, ax, legend=legend, dimensionless=dimensionless,
            names=[names[i] for i in periodic] if names and len(periodic) > 1 else None, **options,
        )  # fmt: skip
    for i, branch in enumerate(branches):
        if i not in periodic:
            draw = torus if kind_of(branch) == "tori" else backbone
            ax = draw(branch, measure or "pp2", element, ax, label=called[i] if legend else "",
                      dimensionless=dimensionless)  # fmt: skip
    assert ax is not None
    return ax
