"""Interference of the teeth of a pair outside the line of action, and the tip diameters that avoid it.

    begin = max(L -+ sqrt(r_a2^2 - r_b2^2), s_F1)                 contact of the tips, or where the involute begins
    z_1/z_2 (theta_1 + inv(alpha_a1) - inv(alpha_wt)) + inv(alpha_wt) - inv(alpha_a2) >= theta_2       tips of a ring
    cos(theta_1) = (r_a2^2 - r_a1^2 - a^2) / (2 a r_a1),   cos(theta_2) = (a^2 + r_a2^2 - r_a1^2) / (2 a r_a2)
    theta_1 + inv(alpha_a1) - inv(alpha_wt) >= z_2/z_1 (theta_2 + inv(alpha_a2) - inv(alpha_wt))       radial assembly

L = a sin(alpha_wt) is the distance of the base circles along the line of action, negative for a ring, and s_F the
position of the end of the involute. The tips of a gear must not touch the other one outside its involute. The root of
undercut teeth is compared with the path of the tip of the other gear, a trochoid. The teeth of pinion and ring must
pass each other where their tip circles intersect. For radial assembly sin(theta_i)^2 = (1 - (cos(alpha_ai) /
cos(alpha_aj))^2) / (1 - (z_i/z_j)^2) with the other gear j.

References
----------
ISO 21771:2007. Litvin & Fuentes (2004), Gear Geometry and Applied Theory, chapter 11 (internal gears),
https://doi.org/10.1017/CBO9780511547126. Colbourne (1987), The Geometry of Involute Gears, chapter 8,
https://doi.org/10.1007/978-1-4612-4764-7.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, asin, cos, hypot, pi, sin, sqrt

import numpy as np

from hbgear.gears.drawing.gear import FILLET_STEPS, TOLERATED_UNDERCUT, Gear
from hbgear.gears.drawing.geometry import involute

DEPTH_TOLERANCE = 1e-3
"""Overlap [module] that counts as contact: below the accuracy with which roots are cut."""

TIP_MARGIN = 2e-3
"""Distance [mm] of a recommended tip diameter from the one at which the tips touch; it outlasts the rounding of the
message."""

PATH_STEPS = 801
"""Positions of the tip of the other gear within the tooth space of undercut teeth; they are some 1e-2 module apart."""


@dataclass(frozen=True)
class Engagement:
    """Two gears at a centre distance.

    Attributes
    ----------
    pinion, wheel : Gear
        Gears; the wheel may be a ring.
    distance : float
        Centre distance a [m], positive.
    pressure : float
        Transverse working pressure angle alpha_wt [rad].
    """

    pinion: Gear
    wheel: Gear
    distance: float
    pressure: float

    @property
    def tangent_length(self) -> float:
        """Distance L of the base circles on the line of action [m], negative for a ring."""
        return self.wheel.sign * self.distance * sin(self.pressure)

    @property
    def swapped(self) -> Engagement:
        """The same external pair with the wheel as the pinion."""
        return Engagement(self.wheel, self.pinion, self.distance, self.pressure)

    @property
    def tip_contact(self) -> float:
        """Position of the tip of the wheel on the line of action, from the base circle of the pinion [m]."""
        return self.tangent_length - self.wheel.sign * tip_distance(self.wheel)

    def wheel_tip(self, position: float) -> float:
        """Return the tip diameter of the wheel that is on the line of action at a position [m]."""
        return 2 * hypot(self.wheel.base_diameter / 2, self.tangent_length - position)

    def root_overlap(self, tip: float) -> float:
        """Return the depth [m] by which the tip of the wheel reaches into the root of undercut teeth of the pinion.

        ``tip`` is the tip diameter of the wheel [m].
        """
        g, sign = self.pinion, self.wheel.sign
        r_1, r_2 = g.base_diameter / 2, self.wheel.base_diameter / 2
        position = self.tangent_length - sign * sqrt(max((tip / 2) ** 2 - r_2**2, 0.0))
        centre = sign * self.distance + 0j
        foot = r_1 * np.exp(-1j * self.pressure)
        along = 1j * np.exp(-1j * self.pressure)
        travel = np.linspace(-1.0, 1.0, PATH_STEPS) * g.base_pitch
        corner = centre + (foot + position * along - centre) * np.exp(-1j * sign * travel / r_2)
        corner = corner * np.exp(-1j * travel / r_1)
        tooth = -self.pressure + position / r_1 - g.tooth_thickness(g.base_diameter) / g.base_diameter
        radius, half_angle = g.fillet(FILLET_STEPS)
        distance = np.abs(corner)
        within = (distance < radius[-1]) & (distance > radius[0])
        if not within.any():
            return 0.0
        flank = tooth + np.interp(distance[within], radius, half_angle)
        return float((distance[within] * (flank - np.angle(corner[within]))).max())

    def tip_margin(self, pinion_tip: float, ring_tip: float) -> float:
        """Return the angle [rad] by which the tips of pinion and ring of two tip diameters pass each other."""
        p, w, a = self.pinion, self.wheel, self.distance
        r_1, r_2 = pinion_tip / 2, ring_tip / 2
        cosines = (r_2**2 - r_1**2 - a**2) / (2 * a * r_1), (a**2 + r_2**2 - r_1**2) / (2 * a * r_2)
        if not all(-1 <= cosine <= 1 for cosine in cosines):
            return pi if r_2 > r_1 else -pi  # the tip circle of the pinion lies within that of the ring, or around it
        alpha_1, alpha_2 = (acos(min(g.base_diameter / d, 1.0)) for g, d in ((p, 2 * r_1), (w, ring_tip)))
        inv = involute(self.pressure)
        rotation = (acos(cosines[0]) + involute(alpha_1) - inv) * p.teeth / w.teeth
        return rotation + inv - involute(alpha_2) - acos(cosines[1])

    @property
    def radial_assembly(self) -> bool:
        """Whether a pinion can be moved radially into its ring, without trimming of the tips."""
        p, w = self.pinion, self.wheel
        ratio = w.teeth / p.teeth
        alpha_1, alpha_2 = (acos(min(g.base_diameter / g.tip_diameter_used, 1.0)) for g in (p, w))
        squares = [
            (1 - (cos(alpha) / cos(mate)) ** 2) / (1 - part**2)
            for alpha, mate, part in ((alpha_1, alpha_2, 1 / ratio), (alpha_2, alpha_1, ratio))
        ]
        if not all(0 <= square <= 1 for square in squares):
            return True  # the tip circles do not intersect in the middle position
        theta_1, theta_2 = (asin(sqrt(square)) for square in squares)
        inv = involute(self.pressure)
        return theta_1 + involute(alpha_1) - inv >= ratio * (theta_2 + involute(alpha_2) - inv)

    # Checks

    def check(self) -> None:
        """Raise an error if the teeth interfere; the message states the tip diameter that avoids it.

        Raises
        ------
        ValueError
            If the tips of a gear touch the other one outside its involute or its root, or tips of pinion and ring
            strike each other.
        """
        self._check_pinion("pinion")
        if self.wheel.internal:
            self._check_ring()
        else:
            self.swapped._check_pinion("wheel")

    def _check_pinion(self, name: str) -> None:
        """Raise ValueError if the tips of the other gear touch the pinion outside its involute."""
        g, s, tip, mm = self.pinion, self.tip_contact, self.wheel.tip_diameter_used, 1e3
        form = g.form_diameter
        beyond = -s * sin(self.pressure)  # depth below the point at which the line of action touches the base circle
        if g.undercut or (not g.rack and 0 < beyond <= TOLERATED_UNDERCUT * g.module):
            depth = self.root_overlap(tip)
            if depth <= DEPTH_TOLERANCE * g.module:
                return
            location = f"{depth * 1e6:.0f} um deep in its root"
        else:
            diameter = 2 * hypot(s, g.base_diameter / 2) if s > 0 else 0.0
            if diameter >= form - DEPTH_TOLERANCE * g.module:
                return
            location = f"{f'at {diameter * mm:.6g} mm' if s > 0 else 'below its base circle'}, outside its involute"
        limit = self.wheel_tip(sqrt(max(form**2 - g.base_diameter**2, 0.0)) / 2)
        bound = "of at least" if self.wheel.internal else "of at most"
        if g.rack:
            raise ValueError(
                "GearPair: interference: the tips of the pinion reach below the straight flanks of the rack, into its "
                f"fillets: give the pinion {tip_text(self.wheel, bound, limit)}, or the rack a larger dedendum"
            )
        tips = "of the rack" if self.wheel.rack else f"of the other gear (diameter {tip * mm:.6g} mm)"
        raise ValueError(
            f"GearPair: interference: the tips {tips} touch the {name} {location} "
            f"(which ends at {form * mm:.6g} mm): give the other gear {tip_text(self.wheel, bound, limit)}, "
            f"or the {name} a larger profile_shift or more teeth"
        )

    def _check_ring(self) -> None:
        """Raise ValueError if the tips of the pinion meet the roots or the tips of the ring."""
        p, w, mm = self.pinion, self.wheel, 1e3
        clearance = w.root_diameter / 2 - self.distance - p.tip_diameter_used / 2
        if clearance < -1e-9:
            limit = p.tip_diameter_used + 2 * clearance
            raise ValueError(
                f"GearPair: the tips of the {p.teeth} teeth reach {-clearance * mm:.3f} mm into the roots of the ring "
                f"of {w.teeth}; give the pinion a tip_diameter of at most {limit * mm:.6g} mm"
            )
        tips = p.tip_diameter_used, w.tip_diameter_used
        if self.tip_margin(*tips) < 0:
            raise ValueError(
                f"GearPair: interference: the tips of {p.teeth} teeth (diameter {tips[0] * mm:.6g} mm) strike the tips "
                f"of the ring of {w.teeth} (diameter {tips[1] * mm:.6g} mm): {self._tips_that_pass(*tips)}a larger "
                "difference of tooth numbers, or profile shifts"
            )

    def _tips_that_pass(self, pinion_tip: float, ring_tip: float) -> str:
        """Return the text of the tip diameters whose teeth pass each other with a contact ratio of at least 1."""
        from scipy.optimize import brentq

        pitch, mm = self.pinion.base_pitch, 1e3
        remedies = []
        largest = self.wheel_tip(tip_distance(self.pinion) - pitch)
        if largest > ring_tip and self.tip_margin(pinion_tip, largest) >= 0:
            ring = brentq(lambda d: self.tip_margin(pinion_tip, d), ring_tip, largest, xtol=1e-9)
            remedies.append(f"the ring a tip_diameter of at least {ring * mm + TIP_MARGIN:.6g} mm")
        smallest = 2 * hypot(self.pinion.base_diameter / 2, self.tip_contact + pitch)
        if smallest < pinion_tip and self.tip_margin(smallest, ring_tip) >= 0:
            pinion = brentq(lambda d: self.tip_margin(d, ring_tip), smallest, pinion_tip, xtol=1e-9)
            remedies.append(f"the pinion a tip_diameter of at most {pinion * mm - TIP_MARGIN:.6g} mm")
        if not remedies:
            return "no tip diameter of one of them avoids it; give "
        return f"give {' or '.join(remedies)}, "


def tip_text(gear: Gear, limit: str, diameter: float) -> str:
    """Return a requirement on the tips for messages, such as "a tip_diameter below 81 mm"."""
    if gear.rack:
        height = (diameter - gear.reference_diameter) / 2 / gear.module - gear.profile_shift
        return f"an addendum {limit} {height:.4f} modules"
    return f"a tip_diameter {limit} {diameter * 1e3:.6g} mm"


def tip_distance(gear: Gear) -> float:
    """Return the distance sqrt(r_a^2 - r_b^2) of the tip along the line of action [m]."""
    return sqrt(max(gear.tip_diameter_used**2 - gear.base_diameter**2, 0.0)) / 2


def form_position(gear: Gear) -> float:
    """Return the distance of the end of the involute of an external gear along the line of action [m]."""
    return sqrt(max(gear.form_diameter**2 - gear.base_diameter**2, 0.0)) / 2


def default_alterations(pair: Engagement) -> tuple[float, float]:
    """Return the tip alterations of pinion and wheel [module] that a pair has without given ones.

    k = min(0, (a - a_d) / m_n - x_1 - x_2) keeps the tip clearance of the basic rack (ISO 21771; a and the reference
    distance a_d are negative for a ring). The tips of a ring end where the involute of the pinion begins, or at the
    base circle.
    """
    p, w, m = pair.pinion, pair.wheel, pair.pinion.module
    reference = (w.reference_diameter + w.sign * p.reference_diameter) / 2
    k = min(w.sign * (pair.distance - reference) / m - p.profile_shift - w.profile_shift, 0.0)
    k = 0.0 if k > -1e-9 else k
    if not w.internal:
        return k, k
    smallest = max(pair.wheel_tip(form_position(p)), w.base_diameter)
    height = (w.reference_diameter - smallest) / (2 * m)
    return k, min(k, height - w.addendum - w.profile_shift)
