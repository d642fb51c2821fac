"""Mesh stiffness by ISO 6336-1:2006, method B: a regression of measured gears of steel, for the mean over a mesh cycle.

    c' = c'_th C_M C_R C_B cos(beta) E/E_steel,   c_gamma = c' (0.75 eps_alpha + 0.25),   c'_th = 1/q'
    q' = 0.04723 + 0.15551/z_n1 + 0.25791/z_n2 - 0.00635 x_1 - 0.11654 x_1/z_n1 - 0.00193 x_2 - 0.24188 x_2/z_n2
         + 0.00529 x_1^2 + 0.00182 x_2^2   [mm um / N]

In the transverse plane along the line of action, over the face width; C_M = 0.8, C_R = 1 (solid discs), C_B of the
basic racks. Below a load of 100 N/mm c' goes with its fourth root. A ring counts as a rack, 1/z_n2 = 0.

References
----------
ISO 6336-1:2006, Calculation of load capacity of spur and helical gears, 9.3.
"""

from __future__ import annotations

from math import cos, degrees
from typing import NamedTuple

from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair

_STEEL = 206e9
_MEASURED = 0.8  # C_M: measured over theoretical stiffness
_LIGHT = 1e5  # N/m, the load below which the stiffness falls
_WIDTH = 1e9  # N/(mm um) in N/m^2


class IsoStiffness(NamedTuple):
    """Stiffness over the face width [N/m^2]."""

    single: float
    """c', of a pair of teeth at its stiffest [N/m^2]; over 1e9, in N/(mm um)."""
    mesh: float
    """c_gamma, the mean over a mesh cycle [N/m^2]."""


def iso_stiffness(pair: GearPair, torque: float | None = None) -> IsoStiffness:
    """Stiffness by ISO 6336-1, method B; equations at the head of this file.

    Parameters
    ----------
    pair : `GearPair`.
    torque : on the pinion [N m], for loads below 100 N/mm; None for larger ones.
    """
    p, w = pair.pinion, pair.wheel
    x_1, x_2, u_1, u_2 = p.profile_shift, w.profile_shift, 1 / p.virtual_teeth, 1 / w.virtual_teeth
    u_2 = 0.0 if w.internal else u_2
    q = (
        0.04723 + 0.15551 * u_1 + 0.25791 * u_2 - 0.00635 * x_1 - 0.11654 * x_1 * u_1 - 0.00193 * x_2
        - 0.24188 * x_2 * u_2 + 0.00529 * x_1**2 + 0.00182 * x_2**2
    )  # fmt: skip
    rack = (_of_rack(p) + _of_rack(w)) / 2
    modulus = 2 * p.E * w.E / (p.E + w.E) / _STEEL
    single = _MEASURED * rack * cos(p.helix_angle) * modulus / q * _WIDTH
    if torque is not None:
        load = pair.transverse_force(torque) * cos(pair.working_pressure_angle) / pair.face_width
        single *= min(load / _LIGHT, 1.0) ** 0.25
    return IsoStiffness(single, single * (0.75 * pair.contact_ratio + 0.25))


def _of_rack(gear: Gear) -> float:
    """C_B of one gear."""
    return (1 + 0.5 * (1.2 - gear.dedendum)) * (1 - 0.02 * (20 - degrees(gear.pressure_angle)))
