"""Figures of free motions: backbones over frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hbgear.analysis.quantities.axis_quantities import OmegaAxis, factor_of, in_figure, in_micrometres
from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.autonomous.backbone import AMPLITUDE
from hbgear.harmonic.equations.layout import axis_text, layout_of
from hbgear.harmonic.models.frequency_units import length_scale, model_of
from hbgear.plot.style import COLOURS, add_legend, axes_or_new, dress, gap_label, heighten, scaled_axes, styled

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
        Whether Omega and amplitudes keep the unit of the model although it has scales; default False.
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
    own, model = ax is None, model_of(curve)
    across, length = OmegaAxis.of(model, dimensionless), None if dimensionless else length_scale(model, {})
    with styled():
        ax = axes_or_new(ax, (4.6, 3.2))
        line = {"color": COLOURS["no_impact"] if own else "black", "linestyle": "-" if own else "-.", "linewidth": 1.2}
        x, y = across.scale * curve.tracked["Omega"], factor_of(measure, length) * curve.amplitude(measure, element)
        ax.plot(x, y, **(line | style), label=label or "_", zorder=4)
        if own:
            ax.set_xlabel(f"modal frequency, {across.label}" if across.is_speed else r"modal frequency $\Omega$")
            motion = gap_label(layout_of(curve), element)
            ax.set_ylabel(in_figure(axis_text(measure, motion if length is None else in_micrometres(motion))))
            ax.set_ylim(0, None)
            ax.margins(x=0.05)
            dress(ax)
            if scaled_axes(ax, across.above):
                heighten(ax)
        if label and not own:
            add_legend(ax)
    return ax
