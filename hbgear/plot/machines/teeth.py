"""Figures of single pairs of teeth: forces over the path of contact, and static transmission error over torque."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hbgear.analysis.loads.tooth_loads import ToothLoads
from hbgear.analysis.quantities.length_units import MICROMETRE, in_figure_unit
from hbgear.gears.mesh.harris_map import HarrisMap
from hbgear.plot.style import BRANCHES, GREY, axes_or_new, dress, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_PAIRS = 6
"""Largest number of pairs whose forces are drawn; of more, those with the largest forces."""


def tooth_loads(loads: ToothLoads) -> Figure:
    """Draw the force of pairs of teeth over their path of contact and, below it, their share in the mesh force.

    Parameters
    ----------
    loads : ToothLoads
        Loads of one motion.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> pair = hb.GearPair(pinion, wheel, backlash="80 um")
    >>> problem = hb.HarmonicBalance(pair.model("200 N m", 0.04, mesh="teeth"), 12)
    >>> curve = hb.trace(problem, "Omega", (1.5, 1.4), stability=False, special=False)
    >>> mesh = hb.gears.tooth_mesh(pair, "200 N m")
    >>> figure = hb.plot.tooth_loads(hb.analysis.tooth_loads(curve[0], mesh))
    """
    with styled():
        figure = new_figure(5.4, 4.8)
        top, bottom = figure.subplots(2, 1, sharex=True)
        u, count = loads.position, len(loads.force)
        pairs = np.sort(np.argsort(loads.force.max(axis=1))[-MAX_PAIRS:])
        top.plot(u, loads.static.force[0] / 1e3, color=GREY, ls="--", lw=1.2, label="static")
        bottom.plot(u, loads.static.share[0], color=GREY, ls="--", lw=1.2)
        for i, p in enumerate(pairs.tolist()):
            color = BRANCHES[i % len(BRANCHES)]
            name = "pair of teeth" if count == 1 else f"pair {p + 1} of {count}"
            top.plot(u, loads.force[p] / 1e3, color=color, lw=1.4, label=name)
            if loads.back[p].any():
                top.plot(u, -loads.back[p] / 1e3, color=color, lw=1.0, ls=":", label=f"{name}, back flank")
            bottom.plot(u, loads.share[p], color=color, lw=1.4)
        top.set_ylabel("force of a pair of teeth [kN]")
        top.set_title(f"largest force {loads.force_factor:.2f} times the static one", loc="left")
        bottom.set_ylabel("share in the mesh force [-]")
        bottom.set_xlabel("position on the path of contact [mesh periods]")
        loaded = np.flatnonzero(loads.static.force[0] > 0)
        bottom.set_xlim(u[loaded[0]] - 0.1, u[loaded[-1]] + 0.1)
        bottom.set_ylim(-0.04, 1.08)
        for ax in (top, bottom):
            dress(ax)
        top.legend(loc="best")
        return figure


def harris_map(found: HarrisMap, ax: Axes | None = None) -> Axes:
    """Draw the static transmission error over two mesh cycles, one line for each torque.

    Parameters
    ----------
    found : HarrisMap
        The map.
    ax : Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> ax = hb.plot.harris_map(hb.gears.harris_map(hb.GearPair(pinion, wheel), [50.0, 100.0], phases=64))
    >>> len(ax.lines)
    2
    """
    with styled():
        from matplotlib import colormaps

        ax = axes_or_new(ax, (5.4, 4.2))
        x = np.concatenate([found.phase, found.phase + 1])
        colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(found.torque)))
        for torque, error, pp, color in zip(found.torque, found.error, found.peak_to_peak, colours, strict=True):
            label = f"{torque:g} N m, {pp * 1e6:.2f} {in_figure_unit(MICROMETRE)} peak to peak"
            ax.plot(x, -1e6 * np.concatenate([error, error]), color=color, lw=1.3, label=label)
        dress(ax)
        ax.set_xlim(0, 2)
        ax.set_xlabel(r"mesh cycles $\tau / 2\pi$ [-]")
        ax.set_ylabel(f"static transmission error, negative [{in_figure_unit(MICROMETRE)}]")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, fontsize=7)
        return ax
