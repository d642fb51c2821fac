"""Form factor Y_F and stress correction factor Y_S of an external tooth, by ISO 6336-3, method B.

    sigma_F0 = F_t / (b m_n) Y_F Y_S
    Y_F = 6 (h_Fe / m_n) cos(alpha_Fen) / ((s_Fn / m_n)^2 cos(alpha_n))
    Y_S = (1.2 + 0.13 L) q_s^(1 / (1.21 + 2.3 / L)),   L = s_Fn / h_Fe,   q_s = s_Fn / (2 rho_F)

s_Fn is the thickness of the root in the normal section where the fillet is inclined by 30 degrees to the centre line,
rho_F the radius of the fillet there, and h_Fe the arm of a force on the flank. With z_n virtual teeth and lengths in
modules:

    E = pi/4 - h_f tan(alpha_n) - (1 - sin(alpha_n)) rho / cos(alpha_n),   G = rho - h_f + x
    theta = 2 G / z_n tan(theta) - H,   H = 2 / z_n (pi/2 - E) - pi/3
    s_Fn = z_n sin(pi/3 - theta) + sqrt(3) (G / cos(theta) - rho)
    rho_F = rho + 2 G^2 / (cos(theta) (z_n cos^2(theta) - 2 G))
    h_Fe = ((cos(gamma_e) - sin(gamma_e) tan(alpha_Fen)) d_en - z_n cos(pi/3 - theta) - G / cos(theta) + rho) / 2
    gamma_e = (pi/2 + 2 x tan(alpha_n)) / z_n + inv(alpha_n) - inv(alpha_en),   alpha_Fen = alpha_en - gamma_e

The force acts at the diameter d_en of the virtual gear, at the same height above its reference circle as on the gear.
The standard evaluates the factors at the outer point of single contact, or at the tip. Here they are functions of this
position, for the stress of a tooth over its path of contact. The factors for the helix angle, thin rims and deep teeth
are not included.

References
----------
ISO 6336-3:2019, Calculation of load capacity of spur and helical gears, part 3: Calculation of tooth bending strength.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.geometry import involute

ANGLE_ITERATIONS = 12
"""Newton iterations for the angle of the root; four to eight give all digits."""


class RootFactors(NamedTuple):
    """Factors of the root stress of a tooth.

    Attributes
    ----------
    form : ndarray
        Form factor Y_F at each diameter.
    correction : ndarray
        Stress correction factor Y_S at each diameter.
    thickness : float
        Thickness s_Fn of the root in the normal section [m].
    fillet_radius : float
        Radius rho_F of the fillet there [m].

    Examples
    --------
    >>> import hbgear as hb
    >>> gear = hb.gears.Gear(teeth=20, module="3 mm", face_width="20 mm")
    >>> hb.gears.root_factors(gear, gear.tip_diameter_used)._fields[:2]
    ('form', 'correction')
    """

    form: Array
    correction: Array
    thickness: float
    fillet_radius: float


@checked_arguments()
def root_factors(gear: Gear, diameter: ArrayLike) -> RootFactors:
    """Compute the form factor and the stress correction factor of a tooth; see the equations in the module header.

    Parameters
    ----------
    gear : Gear
        External gear.
    diameter : array_like
        Diameters at which the force acts on the flank [m], from the base circle to the tip circle.

    Returns
    -------
    RootFactors
        The factors.

    Raises
    ------
    ValueError
        If the gear is a ring gear or a diameter is not on the involute.

    Examples
    --------
    >>> import hbgear as hb
    >>> gear = hb.gears.Gear(teeth=20, module="3 mm", face_width="20 mm")
    >>> factors = hb.gears.root_factors(gear, gear.tip_diameter_used)
    >>> round(float(factors.form), 2), round(float(factors.correction), 2)
    (2.8, 1.55)
    """
    if gear.internal:
        raise ValueError("root_factors: the gear is a ring gear; form factors are known for external gears only")
    d = np.asarray(diameter, dtype=float)
    base, tip = gear.base_diameter, gear.tip_diameter_used
    if not np.all((d >= base * (1 - 1e-9)) & (d <= tip * (1 + 1e-9))):
        raise ValueError(
            f"root_factors: diameters from {d.min() * 1e3:.6g} mm to {d.max() * 1e3:.6g} mm are not on the involute; "
            f"give values from the base diameter {base * 1e3:.6g} mm to the tip diameter {tip * 1e3:.6g} mm"
        )
    z, m, alpha, x = gear.virtual_teeth, gear.module, gear.pressure_angle, gear.profile_shift
    rho, theta = gear.rack_fillet, _root_angle(gear)
    G = rho - gear.dedendum + x
    s = z * sin(pi / 3 - theta) + sqrt(3) * (G / cos(theta) - rho)
    radius = rho + 2 * G**2 / (cos(theta) * (z * cos(theta) ** 2 - 2 * G))
    d_en = np.maximum(z + (d - gear.reference_diameter) / m, z * cos(alpha))
    alpha_en = np.arccos(np.minimum(z * cos(alpha) / d_en, 1.0))
    gamma = (pi / 2 + 2 * x * tan(alpha)) / z + involute(alpha) - (np.tan(alpha_en) - alpha_en)
    slope = alpha_en - gamma
    arm = (np.cos(gamma) - np.sin(gamma) * np.tan(slope)) * d_en - z * cos(pi / 3 - theta) - G / cos(theta) + rho
    h = arm / 2
    form = 6 * h * np.cos(slope) / (s**2 * cos(alpha))
    L = s / h
    correction = (1.2 + 0.13 * L) * (s / (2 * radius)) ** (1 / (1.21 + 2.3 / L))
    return RootFactors(form, correction, s * m, radius * m)


def _root_angle(gear: Gear) -> float:
    """Return the angle theta [rad] of the point of the fillet with the inclination of 30 degrees.

    The equation theta = 2 G / z tan(theta) - H is solved by Newton's method from -H. Convergence is monotonic, because
    tan is convex.
    """
    z, alpha, rho = gear.virtual_teeth, gear.pressure_angle, gear.rack_fillet
    E = pi / 4 - gear.dedendum * tan(alpha) - (1 - sin(alpha)) * rho / cos(alpha)
    G = rho - gear.dedendum + gear.profile_shift
    H = 2 / z * (pi / 2 - E) - pi / 3
    theta = -H
    for _ in range(ANGLE_ITERATIONS):
        theta -= (theta - 2 * G / z * tan(theta) + H) / (1 - 2 * G / z / cos(theta) ** 2)
    return theta
