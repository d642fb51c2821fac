"""Sensitivities of a frequency or an amplitude as bars, one for each parameter.

change of the quantity [%] = percent of the parameter x dquantity/da a / quantity
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hbgear.analysis.parameter_sensitivity.table import Sensitivity
from hbgear.analysis.parameter_sensitivity.units import LENGTH
from hbgear.analysis.quantities.length_units import MICROMETRE, in_figure_unit
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.harmonic.models.frequency_units import MESH, PINION
from hbgear.plot.style import COLOURS, GREY, axes_or_new, dress, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked_arguments()
def tornado(
    found: Sensitivity, quantity: str = "", ax: Axes | None = None, *, percent: float = 1.0, most: int = 12
) -> Axes:
    """Draw the change of a quantity for a change of each parameter, the largest changes at the top.

    Parameters
    ----------
    found : Sensitivity
        Result of `hbgear.analysis.sensitivity`.
    quantity : str, optional
        One of ``found.quantities``; default the first of `Sensitivity.shown`: the speed of the pinion if the model has
        scales.
    ax : Axes, optional
        Axes to draw on; new ones by default.
    percent : float, optional
        Increase and decrease of each parameter [%], positive; default 1.
    most : int, optional
        Largest number of parameters shown; default 12.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    KeyError, ValueError
        If the quantity has no derivatives, or no parameter has an influence.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> axes = hb.plot.tornado(hb.analysis.sensitivity(curve["LP1"]), "Omega")
    """
    checked("tornado", "percent", percent, POSITIVE)
    counted("tornado: most", most)
    quantity = quantity or found.shown()[0]
    effects = {name: effect for name, effect in found.percent(quantity).items() if effect and np.isfinite(effect)}
    if not effects:
        raise ValueError(f"no parameter that is not zero changes {quantity} of {found.label}")
    names = list(effects)[:most]
    change = percent * np.array([effects[name] for name in names])
    positions = np.arange(len(names))
    with styled():
        ax = axes_or_new(ax, (5.4, 1.2 + 0.24 * len(names)))
        for sign, colour, word in ((1, COLOURS["no_impact"], "+"), (-1, COLOURS["single_sided"], "\u2212")):
            ax.barh(positions, sign * change, 0.72, color=colour, label=f"parameter {word}{percent:g} %")
        ax.axvline(0.0, color=GREY, linewidth=0.6)
        values = dict(zip(found.parameters, found.values.tolist(), strict=True))
        units = {name: in_figure_unit(unit) for name, unit in found.units.items()}
        ax.set_yticks(positions, [f"{name} = {_number(values[name])} {units.get(name, '')}".strip() for name in names])
        ax.set_ylim(len(names) - 0.4, -0.6)
        ax.margins(x=0.08)
        name, unit, factor = _quantity(quantity)
        size = f"{factor * found.size(quantity):.6g} {unit}".strip()
        ax.set_xlabel(f"change of {name} at {found.label}, {size} [%]")
        dress(ax)
        ax.tick_params(axis="y", length=0)
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)  # bars may be anywhere on the axes
    return ax


_SPEEDS = {PINION: ("the speed of the pinion", "r/min", 1.0), MESH: ("the mesh frequency", "Hz", 1.0)}
"""Name, unit and factor of frequencies in physical units."""


def _quantity(quantity: str) -> tuple[str, str, float]:
    """Return name, unit and factor of a quantity of `Sensitivity` in a figure."""
    name = quantity.removesuffix(f" {LENGTH}")
    if name == quantity:
        return _SPEEDS.get(quantity, (quantity, "", 1.0))
    return name, in_figure_unit(MICROMETRE), 1e6


def _number(value: float) -> str:
    """Return a number with four digits, with a power of ten instead of an exponent."""
    mantissa, e, exponent = f"{value:.4g}".partition("e")
    return rf"${mantissa} \times 10^{{{int(exponent)}}}$" if e else mantissa
