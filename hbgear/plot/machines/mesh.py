"""Figures of a mesh: stiffness and transmission error over a mesh cycle, with the response."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.quantities.length_units import MICROMETRE, in_figure_unit
from hbgear.continuation.results.branch import Branch
from hbgear.gears.mesh.mesh_cycle import MeshCycle, MeshTable
from hbgear.plot.curves import response
from hbgear.plot.style import BRANCHES, dress, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def mesh_cycles(
    cycles: MeshCycle | Sequence[MeshCycle], names: Sequence[str] = (), axes: Sequence[Axes] | None = None
) -> Figure:
    """Draw mesh stiffness and, below it, static transmission error over two mesh cycles.

    Parameters
    ----------
    cycles : MeshCycle or sequence of MeshCycle
        Mesh cycles to draw.
    names : sequence of str, optional
        Names of the cycles in a legend, one for each; by default there is no legend.
    axes : sequence of Axes, optional
        Two axes to draw on, for stiffness and error; new ones by default.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    ValueError
        If the names are not one for each cycle.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> figure = hb.plot.mesh_cycles(hb.GearPair(pinion, wheel).mesh("200 N m"))
    >>> [len(ax.lines) for ax in figure.axes]
    [1, 1]
    """
    drawn = [cycles] if isinstance(cycles, MeshCycle) else list(cycles)
    if names and len(names) != len(drawn):
        raise ValueError(f"{len(names)} names for {len(drawn)} mesh cycles; give one for each")
    with styled():
        if axes is None:
            axes = new_figure(5.4, 4.6).subplots(2, 1, sharex=True)
        top, bottom = axes
        for i, cycle in enumerate(drawn):
            look: Any = {"color": BRANCHES[i % len(BRANCHES)], "label": names[i] if names else None, "linewidth": 1.3}
            top.plot(*_twice(cycle.stiffness, 1e-8), **look)
            bottom.plot(*_twice(cycle.static_error, 1e6), **look)
        top.set_ylabel(r"mesh stiffness $k$ [$10^8$ N/m]")
        bottom.set_ylabel(f"static transmission error [{in_figure_unit(MICROMETRE)}]")
        bottom.set_xlabel(r"mesh cycles $\tau / 2\pi$ [-]")
        for ax in (top, bottom):
            dress(ax)
            ax.set_xlim(0, 2)
            low, high = ax.get_ylim()
            ax.set_ylim(low, high + 0.04 * (high - low))
        if names:
            top.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(names), borderaxespad=0.2)
        return top.figure  # type: ignore[return-value]


def _twice(table: MeshTable, factor: float) -> tuple[Any, Any]:
    """Return phases and scaled values of two cycles."""
    return np.concatenate([table.phase, table.phase + 1]), factor * np.concatenate([table.value] * 2)


def drive(cycle: MeshCycle, curve: Branch, measure: str | None = None) -> Figure:
    """Draw mesh stiffness, static transmission error and response of a gear pair side by side.

    Parameters
    ----------
    cycle : MeshCycle
        Mesh cycle of the pair.
    curve : Branch
        Branch in Omega of a model with this mesh.
    measure : str, optional
        Measure of amplitude or engineering quantity, see `response`; default the dynamic transmission error.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> pair = hb.GearPair(pinion, wheel, backlash="80 um")
    >>> problem = hb.HarmonicBalance(pair.model("200 N m", 0.04), 8)
    >>> figure = hb.plot.drive(pair.mesh("200 N m"), hb.trace(problem, "Omega", (1.5, 1.2)))
    """
    with styled():
        figure = new_figure(10.5, 4.9)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.75))
        top = figure.add_subplot(grid[0, 0])
        mesh_cycles(cycle, axes=(top, figure.add_subplot(grid[1, 0], sharex=top)))
        top.tick_params(labelbottom=False)
        response(curve, measure, ax=figure.add_subplot(grid[:, 1]), speeds=True)
        return figure
