"""What holds a gear: shaft and bearings as springs and dampers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range
from hbgear.common.units import OptionalQuantityField, QuantityField
from hbgear.mechanics.models import Reaction

AXES = ("x", "y", "z", "theta_x", "theta_y", "theta")
"""Directions in which a gear in space moves: across the shaft, along it (z), tilts, rotation."""


@dataclass(frozen=True)
class Support:
    """Shaft and bearings of one gear, as seen from the gear.

    Parameters
    ----------
    stiffness : float or str
        Radial, the same in all directions [N/m].
    axial : float or str, default 0.0
        [N/m]; 0 for a gear that floats.
    tilt : float or str, optional
        Of tilting about a diameter [N m/rad]; two bearings of half the stiffness each, a distance s apart: k s^2/4.
    damping : float or str, default 0.02
        Damping ratio of each of them with the mass of the gear.
    clearance : float or str, default 0.0
        Half of the radial clearance [m]; only the form "bearings" knows it.
    preload : float or str, default 0.0
        Force on the gear along the line of action, positive as the loaded mesh pushes it [N]; likewise.

    Raises
    ------
    ValueError
        If a quantity is in another unit, or out of range.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.gears.Support(stiffness="3e8 N/m", clearance="5 um").clearance
    5e-06
    """

    stiffness: QuantityField = QuantityField("N/m", POSITIVE, Range(1e3, 1e13))
    axial: QuantityField = QuantityField("N/m", NOT_NEGATIVE, Range(0, 1e13), 0.0)
    tilt: OptionalQuantityField = OptionalQuantityField("N m/rad", POSITIVE, Range(1e-3, 1e14))
    damping: QuantityField = QuantityField("", NOT_NEGATIVE, Range(0, 5), 0.02)
    clearance: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 5e-3), 0.0)
    preload: QuantityField = QuantityField("N", Range(), Range(-1e8, 1e8), 0.0)


def reactions(gears: Sequence[str], stiffness: Array, damping: Array) -> dict[str, Reaction]:
    """Radial and axial forces in the supports of gears of six coordinates each, in the order of `AXES`.

    Parameters
    ----------
    gears : sequence of str
        Their names.
    stiffness, damping : ndarray, shape (6 G,)
        Of the supports to ground.
    """
    rows = np.diag(stiffness), np.diag(damping)
    found = {}
    for i, name in enumerate(gears):
        for what, axes in (("radial", [0, 1]), ("axial", [2])):
            at = [6 * i + axis for axis in axes]
            if stiffness[at].any():
                found[f"{name} {what}"] = Reaction(*(row[at] for row in rows))
    return found
