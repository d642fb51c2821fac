"""Dynamic factor K_v by ISO 6336-1:2006, method B, for comparison with the nonlinear model.

    N = n_1 / n_E1,   n_E1 = 30000/(pi z_1) sqrt(c_gamma/m_red)   [r/min, c_gamma in N/(mm um), m_red in kg/mm]
    N <= N_S          K_v = 1 + N (C_v1 B_p + C_v2 B_f + C_v3 B_k)             below resonance
    N_S < N <= 1.15   K_v = 1 + C_v1 B_p + C_v2 B_f + C_v4 B_k                 main resonance
    1.15 < N < 1.5    linear interpolation between both
    N >= 1.5          K_v = C_v5 B_p + C_v6 B_f + C_v7                         above resonance
    B_p = c' f_pb/(F_t/b),   B_f = c' f_fa/(F_t/b),   B_k = |1 - c' C_a/(F_t/b)|, or 1 from grade 6 on

f_pb and f_fa are the tolerances of base pitch and profile form for the accuracy grade A, for the gear with the larger
tolerance, by ISO 1328-1:2013: f_pt = (0.001 d + 0.4 m + 5) 2^((A - 5)/2), f_fa = (0.55 m + 5) 2^((A - 5)/2) [um, mm],
f_pb = f_pt cos(alpha_t). Running-in is neglected, C_a is the mean of both tip reliefs, and the application factor is 1.
The reduced mass contains the two gears only, without connected shafts and rotors.

References
----------
ISO 6336-1:2006, Calculation of load capacity of spur and helical gears, clause 6. ISO 1328-1:2013.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.common.units import to_si
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.mesh.iso_stiffness import iso_stiffness
from hbgear.mechanics.series.fourier import real_numbers

LOW_LOAD_RESONANCE = 1e5  # [N/m] (100 N/mm); below this load the main resonance range N_S begins at a lower speed


class _Weights(NamedTuple):
    """Factors C_v1 to C_v7 for a total contact ratio."""

    pitch: float
    profile: float
    below: float
    at_resonance: float
    pitch_above: float
    profile_above: float
    above: float

    @staticmethod
    def of(ratio: float) -> _Weights:
        if ratio <= 2:
            above = 0.75 if ratio <= 1.5 else 0.125 * sin(pi * (ratio - 2)) + 0.875
            return _Weights(0.32, 0.34, 0.23, 0.90, 0.47, 0.47, above)
        above = 0.125 * sin(pi * (ratio - 2)) + 0.875 if ratio <= 2.5 else 1.0
        return _Weights(
            0.32,
            0.57 / (ratio - 0.3),
            0.096 / (ratio - 1.56),
            (0.57 - 0.05 * ratio) / (ratio - 1.44),
            0.47,
            0.12 / (ratio - 1.74),
            above,
        )


def deviations(gear: Gear, grade: int) -> tuple[float, float]:
    """Return the tolerances f_pb of the base pitch and f_fa of the profile form of a gear [m]."""
    d, m, grade_factor = gear.reference_diameter * 1e3, gear.module * 1e3, sqrt(2.0) ** (grade - 5)
    pitch = (0.001 * d + 0.4 * m + 5) * grade_factor * cos(gear.transverse_pressure_angle)
    return pitch * 1e-6, (0.55 * m + 5) * grade_factor * 1e-6


def resonance_speed(pair: GearPair, torque: Any) -> float:
    """Return n_E1, the pinion speed of the main resonance by the standard [r/min]."""
    mesh = iso_stiffness(pair, to_si("resonance_speed", "torque", torque, "N m")).mesh * pair.face_width
    return 30 / (pi * pair.pinion.teeth) * sqrt(mesh / pair.equivalent_mass)


@checked_arguments(pair="a GearPair")
def iso_dynamic_factor(pair: GearPair, torque: Any, speed: ArrayLike, grade: int = 6) -> Array:
    """Return K_v by ISO 6336-1, method B, at pinion speeds; the module docstring states the equations.

    Parameters
    ----------
    pair : GearPair
        Gear pair.
    torque : float or str
        Torque on the pinion [N m], positive.
    speed : array_like
        Pinion speeds [r/min], of any shape.
    grade : int, default 6
        Accuracy grade of ISO 1328-1, 1 to 11.

    Raises
    ------
    ValueError
        If the torque is not positive, a speed is not finite or the grade is not from 1 to 11.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> pair = hb.GearPair(pinion, wheel, backlash="80 um")
    >>> hb.gears.iso_dynamic_factor(pair, "200 N m", [1000, 5000, 13000, 25000]).round(2).tolist()
    [1.04, 1.18, 2.19, 1.17]
    """
    torque = to_si("iso_dynamic_factor", "torque", torque, "N m")
    if torque <= 0:
        raise ValueError(f"iso_dynamic_factor: torque = {torque:g} N m must be positive")
    counted("iso_dynamic_factor: grade", grade, 11)
    n = real_numbers("iso_dynamic_factor: speed", speed, "a number or an array of numbers")
    if not np.isfinite(n).all():
        raise ValueError("iso_dynamic_factor: speed must be finite")
    load = torque / (pair.pinion.reference_diameter / 2) / pair.face_width
    gears = (pair.pinion,) if pair.wheel.rack else (pair.pinion, pair.wheel)  # tolerances of a rack: of its pinion
    pitch, profile = (max(values) for values in zip(*(deviations(g, grade) for g in gears), strict=True))
    stiffness_over_load = iso_stiffness(pair, torque).single / load
    relief = (pair.pinion.tip_relief + pair.wheel.tip_relief) / 2
    k = 1.0 if grade >= 6 else abs(1 - stiffness_over_load * relief)
    C = _Weights.of(pair.total_contact_ratio)
    errors = C.pitch * stiffness_over_load * pitch + C.profile * stiffness_over_load * profile
    resonant = 1 + errors + C.at_resonance * k
    above = C.pitch_above * stiffness_over_load * pitch + C.profile_above * stiffness_over_load * profile + C.above
    N = np.abs(n) / resonance_speed(pair, torque)
    low = 0.85 if load >= LOW_LOAD_RESONANCE else 0.5 + 0.35 * sqrt(load / LOW_LOAD_RESONANCE)
    between = above + (resonant - above) * (1.5 - N) / 0.35
    return np.select(
        [low >= N, N <= 1.15, N < 1.5], [1 + N * (errors + C.below * k), np.full(n.shape, resonant), between], above
    )
