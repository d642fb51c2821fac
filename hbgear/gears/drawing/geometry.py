"""Geometry of involute gears and stiffness of shaft sections.

    inv(alpha) = tan(alpha) - alpha

Angles are in radians, lengths in metres.
"""

from __future__ import annotations

from math import asin, atan, cos, pi, sin, tan
from typing import NamedTuple


def involute(alpha: float) -> float:
    """Return the involute function inv(alpha) = tan(alpha) - alpha."""
    return tan(alpha) - alpha


def inverse_involute(value: float) -> float:
    """Return the angle [rad] between 0 and pi/2 with a given value of the involute function.

    Newton's method starts above the root, where the function is convex, so it converges for every value.

    Raises
    ------
    ValueError
        If the value is negative.
    """
    if value < 0:
        raise ValueError(f"no pressure angle has the involute function {value:g}, which must not be negative")
    alpha = min((3 * value) ** (1 / 3), pi / 2 - 1 / (value + 2))  # both bounds lie above the root
    for _ in range(60):
        step = (involute(alpha) - value) / max(tan(alpha) ** 2, 1e-300)
        if not step > 1e-16 * alpha:  # converged to rounding
            break
        alpha -= step
    return alpha


def transverse_pressure_angle(alpha_n: float, beta: float) -> float:
    """Return alpha_t [rad], tan(alpha_t) = tan(alpha_n) / cos(beta), of normal pressure angle and helix angle [rad]."""
    return atan(tan(alpha_n) / cos(beta))


def base_helix_angle(alpha_n: float, beta: float) -> float:
    """Return beta_b [rad], sin(beta_b) = sin(beta) cos(alpha_n), of helix angle and normal pressure angle [rad]."""
    return asin(sin(beta) * cos(alpha_n))


def base_radius(teeth: int, module: float, alpha_n: float, beta: float) -> float:
    """Return the base radius z m cos(alpha_t) / (2 cos(beta)) [m], for a normal module [m] and angles [rad]."""
    return teeth * module * cos(transverse_pressure_angle(alpha_n, beta)) / (2 * cos(beta))


class ShaftStiffness(NamedTuple):
    """Stiffnesses between the two ends of a shaft section."""

    bending: float
    """Transverse stiffness of one end against the other, without tilt of either [N/m]."""
    axial: float
    """Axial stiffness [N/m]."""
    torsional: float
    """Torsional stiffness [N m/rad]."""


def shaft_stiffness(E: float, poisson: float, outer: float, inner: float, length: float) -> ShaftStiffness:
    """Return the stiffnesses of a hollow round shaft section of diameters D, d and length l [m].

        bending 12 E I / l^3,   axial E A / l,   torsional G J / l,   G = E / (2 (1 + poisson))
        A = pi (D^2 - d^2) / 4,   I = pi (D^4 - d^4) / 64,   J = 2 I

    The bending formula neglects shear, so it overestimates the stiffness of a section that is as short as it is thick.
    Dong et al. (2022), eqs. (12), (13).
    """
    area = pi * (outer**2 - inner**2) / 4
    second_moment = pi * (outer**4 - inner**4) / 64
    shear_modulus = E / (2 * (1 + poisson))
    return ShaftStiffness(
        bending=12 * E * second_moment / length**3,
        axial=E * area / length,
        torsional=shear_modulus * 2 * second_moment / length,
    )
