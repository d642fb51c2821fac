"""Supports of gears: shaft and bearings as springs and dampers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range
from hbgear.common.units import OptionalQuantityField, QuantityField
from hbgear.mechanics.structures.elements import Reaction

AXES = ("x", "y", "z", "theta_x", "theta_y", "theta")
"""Coordinates of a gear in space: across the shaft (x, y), along it (z), tilts, and rotation about it."""


@dataclass(frozen=True)
class Support:  # numpydoc ignore=PR02
    """Shaft and bearings of one gear, reduced to the gear.

    Parameters
    ----------
    stiffness : float or str
        Radial stiffness, equal in all directions [N/m].
    axial : float or str, default 0.0
        Axial stiffness [N/m]; 0 for a floating gear.
    tilt : float or str, optional
        Stiffness against tilting about a diameter [N m/rad]. For two bearings of half the stiffness each, a distance s
        apart, it is k s^2/4.
    damping : float or str, default 0.02
        Damping ratio of each spring with the mass or inertia of the gear.
    clearance : float or str, default 0.0
        Half of the radial clearance [m]; used by the form "bearings" only.
    preload : float or str, default 0.0
        Force on the gear along the line of action [N], positive in the direction in which the loaded mesh pushes it;
        used by the form "bearings" only.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range.

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
    """Return the radial and axial forces in the supports of gears with six coordinates each, in the order of `AXES`.

    Stiffness and damping (6 G,) are those of the supports to ground.
    """
    matrices = np.diag(stiffness), np.diag(damping)
    forces = {}
    for i, name in enumerate(gears):
        for direction, axes in (("radial", [0, 1]), ("axial", [2])):
            rows = [6 * i + axis for axis in axes]
            if stiffness[rows].any():
                forces[f"{name} {direction}"] = Reaction(*(matrix[rows] for matrix in matrices))
    return forces
