"""Response curves with their uncertainty band for scattered parameters, normal to the curve.

edges of the band:   (Omega, A)(s) +- k S n / sigma   (`hbgear.design.uncertainty.uncertainty_band`)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hbgear.analysis.quantities.length_units import in_figure
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.ranges import POSITIVE, checked
from hbgear.common.text.messages import quoted
from hbgear.design.uncertainty.uncertainty_band import ResponseBand, ellipse_contact
from hbgear.harmonic.equations.layout import layout_of
from hbgear.mechanics.series.measures import axis_text
from hbgear.plot.branch_sections import HEADROOM, bounded, sections
from hbgear.plot.curves import name_axes
from hbgear.plot.style import COLOURS, SPEEDS, add_legend, axes_or_new, dress, in_words, line_of, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path


@checked_arguments()
def band(
    found: ResponseBand, ax: Axes | None = None, *, sigmas: float = 2.0, color: str = "#7a9cc6", legend: bool = True
) -> Axes:
    """Draw a response curve and, shaded, its uncertainty band for scattered parameters.

    Parameters
    ----------
    found : ResponseBand
        Result of `hbgear.design.response_band`.
    ax : Axes, optional
        Axes of the same units with a curve, on which only the band is drawn. By default the curve is drawn on new axes.
    sigmas : float, optional
        Half width of the band in standard deviations, positive; default 2.
    color : str, optional
        Colour of the band.
    legend : bool, optional
        Whether to add a legend; default True.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ValueError
        If sigmas is not positive, or the colour is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.6))
    >>> axes = hb.plot.band(hb.design.response_band(curve, {"zeta": 0.002, "F": 0.005}))
    """
    from matplotlib.colors import is_color_like
    from matplotlib.patches import PathPatch

    if not is_color_like(color):
        raise ValueError(f"there is no colour {quoted(color)}; give one that Matplotlib knows, such as 'tab:blue'")
    checked("band", "sigmas", sigmas, POSITIVE)
    with styled():
        is_new, ax = ax is None, axes_or_new(ax, (5.0, 3.4))
        ax.add_patch(PathPatch(_shade(found, sigmas), color=color, alpha=0.35, linewidth=0, zorder=0.5))
        ax.autoscale_view()
        ax.plot([], [], color=color, alpha=0.5, linewidth=6, label=f"\u00b1 {sigmas:g} standard deviations", gid="band")
        if is_new:
            _curve(ax, found)
            if found.branch.asymptotes:
                low, top = float(found.amplitude.min()), HEADROOM * bounded(found.branch, found.amplitude)
                ax.set_ylim(low - 0.05 * (top - low), top)
            name_axes(ax, found.branch, found.measure, found.element)
            if found.unit != "Omega":
                ax.set_xlabel(SPEEDS[found.unit])
            layout = layout_of(found.branch)
            if found.length and layout:
                element = layout.elements[layout.index(found.element)]
                ax.set_ylabel(in_figure(axis_text(found.measure, f"{element} [{found.length}]")))
            dress(ax)
        if legend:
            add_legend(ax)
    return ax


def _shade(found: ResponseBand, sigmas: float) -> Path:
    """Return the band as triangles of equal orientation, so that overlaps at a sharp fold are filled once."""
    from matplotlib.path import Path

    finite = np.isfinite(found.deviation)
    size = np.array(found.size)
    middle = np.column_stack([found.frequency, found.amplitude])[finite] / size
    angle = np.unwrap(np.arctan2(found.normal[finite, 1], found.normal[finite, 0]))
    points = np.arange(len(angle))
    counts = np.ceil(np.abs(np.diff(angle)) / _MAX_NORMAL_ROTATION).astype(int).clip(1)
    positions = np.append(np.concatenate([i + np.arange(n) / n for i, n in enumerate(counts)]), points[-1])
    middle = np.column_stack([np.interp(positions, points, x) for x in middle.T])
    angle = np.interp(positions, points, angle)
    covariance = np.column_stack([np.interp(positions, points, x) for x in found.covariance[finite].reshape(-1, 4).T])
    offsets = sigmas * ellipse_contact(covariance.reshape(-1, 2, 2), np.column_stack([np.cos(angle), np.sin(angle)]))
    u, v = (middle + offsets) * size, (middle - offsets) * size
    triangles = np.concatenate([np.stack([u[:-1], u[1:], v[:-1]], 1), np.stack([u[1:], v[1:], v[:-1]], 1)])
    side_a, side_b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    clockwise = side_a[:, 0] * side_b[:, 1] < side_a[:, 1] * side_b[:, 0]
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    closed = np.concatenate([triangles, triangles[:, :1]], axis=1).reshape(-1, 2)
    return Path(closed, np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(triangles)))


_MAX_NORMAL_ROTATION = 0.1
"""Largest rotation [rad] of the normal between two edges of a triangle."""


def _curve(ax: Axes, found: ResponseBand) -> None:
    """Draw the curve in the colours of its regimes, dashed where it is unstable."""
    for (regime, stable), first, last in sections(found.branch, found.element):
        x, y = (values[first : last + 1] for values in (found.frequency, found.amplitude))
        look = line_of(stable) | {"color": COLOURS[regime]}
        name = "_curve" if regime == "unknown" else in_words(regime)
        ax.plot(x, y, **look, label=name, gid=f"branch {regime} {stable}")
