"""Static transmission error over the mesh cycle for several torques (Harris map).

    sum_i F_i(delta) = T / r_b1,   F_i c_i(F_i) = max(delta - g_i, 0)

delta(tau) is the displacement along the line of action in the static equilibrium of all teeth in contact, with the
compliance of the contacts at their loads (`hbgear.gears.mesh.loaded_mesh`). Its peak-to-peak value over the torque
shows the load for which a relief is best.

References
----------
Harris (1958), Proc. Inst. Mech. Eng. 172(1), 87-112, https://doi.org/10.1243/PIME_PROC_1958_172_017_02.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.units import to_si
from hbgear.gears.mesh.loaded_mesh import loaded_mesh

if TYPE_CHECKING:
    from hbgear.gears.drawing.pair import GearPair


@dataclass(frozen=True, eq=False)
class HarrisMap:
    """Static transmission error for n torques at P phases.

    Attributes
    ----------
    torque : ndarray, shape (n,)
        Torques on the pinion [N m].
    phase : ndarray, shape (P,)
        Fractions of the mesh cycle; a phase that occurs twice marks a jump.
    error : ndarray, shape (n, P)
        Static transmission error [m].

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> curves = hb.gears.HarrisMap(np.array([50.0]), np.array([0.0, 0.5]), np.array([[2e-6, 3e-6]]))
    >>> round(1e6 * float(curves.peak_to_peak[0]), 6)
    1.0
    """

    torque: Array
    phase: Array
    error: Array

    @property
    def peak_to_peak(self) -> Array:
        """Peak-to-peak value of the static transmission error at each torque [m], shape (n,)."""
        return np.ptp(self.error, axis=1)


def harris_map(pair: GearPair, torques: Sequence[Any], *, phases: int = 256) -> HarrisMap:
    """Compute the static transmission error of a gear pair for several torques; see the module header.

    Parameters
    ----------
    pair : GearPair
        Gear pair.
    torques : sequence of float or str
        Torques on the pinion [N m], positive.
    phases : int, default 256
        Number of steps of the cycle, at least 8.

    Returns
    -------
    HarrisMap
        The map.

    Raises
    ------
    ValueError
        If there is no torque, or one is not positive.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (
    ...     hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm", tip_relief="12 um") for z in (25, 40)
    ... )
    >>> curves = hb.gears.harris_map(hb.GearPair(pinion, wheel), ["50 N m", "150 N m"], phases=64)
    >>> bool(curves.peak_to_peak[0] > curves.peak_to_peak[1])
    True
    """
    values = [to_si("harris_map", "torque", torque, "N m") for torque in torques]
    if not values:
        raise ValueError("harris_map: torques is empty; give one torque on the pinion or more")
    tables = [loaded_mesh(pair, torque, phases=phases).static_error for torque in values]
    return HarrisMap(np.array(values), tables[0].phase, np.array([table.value for table in tables]))
