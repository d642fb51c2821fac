"""Campbell diagrams of rotors: natural frequencies over speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hbgear.analysis.campbell_diagram import Campbell, whirl_word
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.plot.style import BRANCHES, COLOURS, GREY, axes_or_new, dress_with_speeds, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@checked_arguments()
def campbell(found: Campbell, ax: Axes | None = None, *, legend: bool = True, dimensionless: bool = False) -> Axes:
    """Draw a Campbell diagram: natural frequencies over speed, orders of the excitation, and critical speeds as dots.

    Modes of backward whirl are dash-dotted.

    Parameters
    ----------
    found : Campbell
        Result of `hbgear.analysis.campbell`.
    ax : Axes, optional
        Axes to draw on; new ones by default, with an axis of the mesh frequency above if the model has scales.
    legend : bool, optional
        Whether to add a legend to the right of the axes; default True.
    dimensionless : bool, optional
        Whether the axes are in units of Omega. By default they are the speed of the pinion [r/min] and Hz if the model
        has scales.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> axes = hb.plot.campbell(hb.analysis.campbell(hb.gears.GearRotorBearing(), (0.2, 2.0)))
    """
    is_new, abscissa = ax is None, OmegaAxis(found.scales, r"$\Omega$, frequency of the excitation", dimensionless)
    speeds, unit = abscissa.scale * found.Omega, abscissa.hertz
    senses = [whirl_word(_middle(column)) for column in found.whirl.T]
    with styled():
        ax = axes_or_new(ax, (5.6, 3.6))
        for i, column in enumerate(found.frequencies.T):
            word, first = senses[i], senses.index(senses[i]) == i
            line, label = "-." if word == "backward" else "-", _label(word) if first else "_"
            colour, gid = COLOURS["no_impact"], f"mode {i + 1}"
            ax.plot(speeds, column * unit, line, color=colour, linewidth=1.1, label=label, gid=gid)
        # modes above 1.5 times the highest order are left out
        highest = 1.5 * max(found.orders.values(), default=np.inf) * found.Omega[-1]
        top = 1.05 * unit * min(float(np.nanmax(found.frequencies, initial=0.0)), highest) or 1.0
        for i, (name, order) in enumerate(found.orders.items()):
            word = "mesh" if name == "Omega" and abscissa.is_speed else name
            colour, label = BRANCHES[(i + 1) % len(BRANCHES)], f"order {order:.4g}: {word}"
            frequency = order * found.Omega * unit
            ax.plot(speeds, frequency, "--", color=colour, linewidth=0.9, label=label, gid=f"order {name}")
        if found.critical:
            points = [(abscissa.scale * speed.Omega, speed.frequency * unit) for speed in found.critical]
            ax.plot(*zip(*points, strict=True), "o", color="black", markersize=3.4, label="critical speed", zorder=3)
        ax.set_xlim(speeds[0], speeds[-1])
        ax.set_ylim(0, top)
        ax.set_xlabel(abscissa.label)
        ax.set_ylabel(
            "natural frequency [Hz]" if abscissa.is_speed else r"natural frequency $\omega$ (unit of $\Omega$)"
        )
        ax.grid(color=GREY, linewidth=0.3, alpha=0.5)
        dress_with_speeds(ax, abscissa.above if is_new else {})
        if legend:
            ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.2)
    return ax


def _label(word: str) -> str:
    return "natural frequency" if word == "-" else f"natural frequency, {word} whirl"


def _middle(column: Array) -> float:
    """Return the median of the finite values of a column; nan if there are none."""
    finite = column[np.isfinite(column)]
    return float(np.median(finite)) if len(finite) else np.nan
