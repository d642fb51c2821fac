"""Mesh stiffness by ISO 6336-1:2006, method B: a regression of measured steel gears for the mean over a mesh cycle.

    c' = c'_th C_M C_R C_B cos(beta) E/E_steel,   c_gamma = c' (0.75 eps_alpha + 0.25),   c'_th = 1/q'
    q' = 0.04723 + 0.15551/z_n1 + 0.25791/z_n2 - 0.00635 x_1 - 0.11654 x_1/z_n1 - 0.00193 x_2 - 0.24188 x_2/z_n2
         + 0.00529 x_1^2 + 0.00182 x_2^2   [mm um / N]

    C_R = 1 + ln(b_s/b) / (5 exp(s_R/(5 m_n))),   0.2 <= b_s/b <= 1.2,   s_R/m_n >= 1

Stiffnesses act in the transverse plane along the line of action, per face width. C_M = 0.8. C_R is 1 for solid discs,
and otherwise follows from the thickness s_R of the rim and b_s of the web. C_R and C_B, which follows from the basic
rack, are the means of both gears. Below a load F_t/b of 100 N/mm, F_t at the reference circle, c' is proportional to
the fourth root of the load. A ring gear is treated as a rack: 1/z_n2 = 0.

References
----------
ISO 6336-1:2006, Calculation of load capacity of spur and helical gears, 9.3.
"""

from __future__ import annotations

from math import cos, degrees, exp, log
from typing import NamedTuple

from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair

STEEL_MODULUS = 206e9  # [Pa], Young's modulus of the gears of the regression
THEORY_CORRECTION = 0.8  # C_M, ratio of measured to theoretical stiffness
LOW_LOAD = 1e5  # [N/m] (100 N/mm); the stiffness decreases below this load
NEWTON_PER_MM_UM = 1e9  # 1 N/(mm um) in N/m^2


class IsoStiffness(NamedTuple):
    """Stiffnesses per face width [N/m^2]."""

    single: float
    """Largest stiffness c' of one pair of teeth [N/m^2]; 1e9 N/m^2 are 1 N/(mm um)."""
    mesh: float
    """Mean c_gamma over a mesh cycle [N/m^2]."""


def iso_stiffness(pair: GearPair, torque: float | None = None) -> IsoStiffness:
    """Return the stiffnesses by ISO 6336-1, method B; the module docstring states the equations.

    The torque on the pinion [N m] matters for loads below 100 N/mm; None is a larger one.
    """
    p, w = pair.pinion, pair.wheel
    x_1, x_2, u_1, u_2 = p.profile_shift, w.profile_shift, 1 / p.virtual_teeth, 1 / w.virtual_teeth
    u_2 = 0.0 if w.internal else u_2
    q = (
        0.04723
        + 0.15551 * u_1
        + 0.25791 * u_2
        - 0.00635 * x_1
        - 0.11654 * x_1 * u_1
        - 0.00193 * x_2
        - 0.24188 * x_2 * u_2
        + 0.00529 * x_1**2
        + 0.00182 * x_2**2
    )
    rack_factor = (_rack_factor(p) + _rack_factor(w)) / 2
    modulus_ratio = 2 * p.E * w.E / (p.E + w.E) / STEEL_MODULUS
    rim_factor = (blank_factor(p) + blank_factor(w)) / 2
    single = THEORY_CORRECTION * rim_factor * rack_factor * cos(p.helix_angle) * modulus_ratio / q * NEWTON_PER_MM_UM
    if torque is not None:
        load = torque / (p.reference_diameter / 2) / pair.face_width  # F_t acts at the reference circle
        single *= min(load / LOW_LOAD, 1.0) ** 0.25
    return IsoStiffness(single, single * (0.75 * pair.contact_ratio + 0.25))


def blank_factor(gear: Gear) -> float:
    """Return the gear blank factor C_R of one gear, the stiffness of teeth on a rim and web over that on a solid disc.

    Examples
    --------
    >>> import hbgear as hb
    >>> wheel = hb.gears.Gear(40, "3 mm", "20 mm", rim_thickness="9 mm", web_thickness="5 mm")
    >>> round(blank_factor(wheel), 4)
    0.8478
    """
    if gear.rim_thickness is None or gear.web_thickness is None:
        return 1.0
    web = min(max(gear.web_thickness / gear.face_width, 0.2), 1.2)
    return 1 + log(web) / (5 * exp(max(gear.rim_thickness / gear.module, 1.0) / 5))


def _rack_factor(gear: Gear) -> float:
    """Return the basic rack factor C_B of one gear."""
    return (1 + 0.5 * (1.2 - gear.dedendum)) * (1 - 0.02 * (20 - degrees(gear.pressure_angle)))
