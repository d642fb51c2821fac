"""Involute gears: geometry, mass and manufacturing limits of a spur or helical, external or internal gear.

    d = m_n z / cos(beta),   d_b = d cos(alpha_t),   tan(alpha_t) = tan(alpha_n) / cos(beta)
    d_a = d + 2 m_n (h_a + x),   d_f = d - 2 m_n (h_f - x)      (internal gears: - and + exchanged)

Lengths are in metres and angles in radians. Every field also accepts a text with another unit, such as ``"3 mm"`` or
``"20 deg"``.

References
----------
ISO 21771:2007, Gears: cylindrical involute gears and gear pairs; concepts and geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, ceil, cos, degrees, pi, radians, sin, sqrt, tan

from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, counted
from hbgear.common.units import OptionalQuantityField, QuantityField
from hbgear.gears.drawing.geometry import base_helix_angle, involute, transverse_pressure_angle

TOLERATED_UNDERCUT = 0.02
"""Accepted undercut [module]. The used part of the involute remains; 17 teeth at 20 degrees are accepted."""


@dataclass(frozen=True)
class Gear:  # numpydoc ignore=PR02
    """Involute gear; the module docstring states the equations.

    Parameters
    ----------
    teeth : int
        Number of teeth z, positive for internal gears too.
    module : float or str
        Normal module m_n [m].
    face_width : float or str
        Face width b [m].
    pressure_angle : float or str, optional
        Normal pressure angle alpha_n [rad].
    helix_angle : float or str, default 0.0
        Helix angle beta at the reference circle [rad]; positive for a right-hand gear, negative for a left-hand one.
    profile_shift : float or str, default 0.0
        Profile shift coefficient x [module]; a positive value makes the teeth thicker, of an internal gear too.
    internal : bool, default False
        True for a ring gear with internal teeth.
    addendum, dedendum : float or str, optional
        Addendum h_a (default 1) and dedendum h_f (default 1.25) of the basic rack [module].
    fillet_radius : float or str, default 0.38
        Tip radius of the generating rack [module].
    tip_diameter : float or str, optional
        Tip diameter d_a [m]. By default it follows from addendum and profile shift.
    body_diameter : float or str, default 0.0
        Bore of an external gear or outside diameter of a ring gear [m]. Default 0: a solid gear, or a ring whose
        outside diameter is the root diameter plus 6 modules.
    tip_relief : float or str, default 0.0
        Material removed at the tip, along the normal in the transverse plane [m].
    tip_relief_length : float or str, optional
        Length of the tip relief along the line of action [m]. By default it ends where the number of pairs in contact
        decreases: for usual gears, at the highest point of single tooth contact.
    crowning : float or str, default 0.0
        Material removed at both ends of the face width [m], with a parabola in between.
    mass : float or str, optional
        Mass [kg]. By default, the mass of a cylinder with the mean of root and tip diameter.
    inertia : float or str, optional
        Polar moment of inertia [kg m^2]. By default, the value of the same cylinder.
    E, poisson, density : float or str, optional
        Young's modulus [Pa], Poisson's ratio and density [kg/m^3]. Default: steel, 206e9, 0.3 and 7850.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range, the teeth are undercut or pointed, or the diameters
        contradict each other.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion = hb.gears.Gear(teeth=25, module="3 mm", face_width="20 mm")
    >>> round(pinion.reference_diameter, 6), round(pinion.base_diameter, 6), round(pinion.tip_diameter_used, 6)
    (0.075, 0.070477, 0.081)
    """

    teeth: int
    module: QuantityField = QuantityField("m", POSITIVE, Range(5e-5, 0.1))
    face_width: QuantityField = QuantityField("m", POSITIVE, Range(1e-4, 5.0))
    pressure_angle: QuantityField = QuantityField("rad", POSITIVE, Range(radians(10), radians(35)), radians(20))
    helix_angle: QuantityField = QuantityField("rad", Range(), Range(-radians(60), radians(60)), 0.0)
    profile_shift: QuantityField = QuantityField("", Range(), Range(-2, 2), 0.0)
    internal: bool = False
    addendum: QuantityField = QuantityField("", POSITIVE, Range(0.2, 2), 1.0)
    dedendum: QuantityField = QuantityField("", POSITIVE, Range(0.3, 2.5), 1.25)
    fillet_radius: QuantityField = QuantityField("", NOT_NEGATIVE, Range(0, 0.6), 0.38)
    tip_diameter: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-4, 50))
    body_diameter: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 50), 0.0)
    tip_relief: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 2e-3), 0.0)
    tip_relief_length: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-6, 1))
    crowning: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 2e-3), 0.0)
    mass: OptionalQuantityField = OptionalQuantityField("kg", POSITIVE, Range(1e-7, 1e7))
    inertia: OptionalQuantityField = OptionalQuantityField("kg m^2", POSITIVE, Range(1e-14, 1e8))
    E: QuantityField = QuantityField("Pa", POSITIVE, Range(1e8, 1.2e12), 206e9)
    poisson: QuantityField = QuantityField("", Range(above=-1, below=0.5), Range(0, 0.499), 0.3)
    density: QuantityField = QuantityField("kg/m^3", POSITIVE, Range(100, 25_000), 7850.0)

    def __post_init__(self) -> None:
        counted("Gear: teeth", self.teeth, 10_000, least=5)
        if not isinstance(self.internal, bool):
            raise ValueError(f"Gear: internal = {self.internal!r} must be True or False")
        self._check_diameters()
        if not self.internal:
            self._check_undercut()
            self._check_tip()

    # Angles and diameters

    @property
    def hand(self) -> str:
        """Hand of the helix: "spur", "right" or "left"."""
        return "spur" if self.helix_angle == 0 else "right" if self.helix_angle > 0 else "left"

    @property
    def sign(self) -> int:
        """Sign of z, d and a in the equations of the standards: +1 for external, -1 for internal gears."""
        return -1 if self.internal else 1

    @property
    def transverse_pressure_angle(self) -> float:
        """Transverse pressure angle alpha_t [rad]."""
        return transverse_pressure_angle(self.pressure_angle, self.helix_angle)

    @property
    def base_helix_angle(self) -> float:
        """Helix angle beta_b at the base circle [rad]."""
        return base_helix_angle(self.pressure_angle, self.helix_angle)

    @property
    def reference_diameter(self) -> float:
        """Reference diameter d [m]."""
        return self.module * self.teeth / cos(self.helix_angle)

    @property
    def base_diameter(self) -> float:
        """Base diameter d_b [m]."""
        return self.reference_diameter * cos(self.transverse_pressure_angle)

    @property
    def tip_diameter_used(self) -> float:
        """Tip diameter d_a [m], given or from the addendum."""
        if self.tip_diameter is not None:
            return self.tip_diameter
        return self.reference_diameter + self.sign * 2 * self.module * (self.addendum + self.profile_shift)

    @property
    def root_diameter(self) -> float:
        """Root diameter d_f [m]."""
        return self.reference_diameter - self.sign * 2 * self.module * (self.dedendum - self.profile_shift)

    @property
    def virtual_teeth(self) -> float:
        """Number of teeth z_n = z / (cos^2(beta_b) cos(beta)) of the virtual spur gear in the normal section."""
        return self.teeth / (cos(self.base_helix_angle) ** 2 * cos(self.helix_angle))

    @property
    def base_pitch(self) -> float:
        """Transverse base pitch p_bt = pi d_b / z [m]."""
        return pi * self.base_diameter / self.teeth

    def tooth_thickness(self, diameter: float) -> float:
        """Return the transverse thickness of a tooth along the arc at a diameter [m], without backlash.

        s = d_y ((pi/2 + 2 x tan(alpha_n)) / z + inv(alpha_t) - inv(alpha_y)),   cos(alpha_y) = d_b / d_y
        """
        at_reference = (pi / 2 + 2 * self.profile_shift * tan(self.pressure_angle)) / self.teeth
        alpha_y = acos(min(self.base_diameter / diameter, 1.0))
        rotation = involute(self.transverse_pressure_angle) - involute(alpha_y)
        return diameter * (at_reference + self.sign * rotation)

    @property
    def form_diameter(self) -> float:
        """Diameter at which the involute ends and the fillet of an external gear begins [m].

        d_F^2 = d_b^2 + (d sin(alpha_t) - 2 m_n (h_f - rho (1 - sin(alpha_n)) - x) / sin(alpha_t))^2
        """
        alpha_t = self.transverse_pressure_angle
        straight_dedendum = self.dedendum - self.rack_fillet * (1 - sin(self.pressure_angle)) - self.profile_shift
        from_pitch_point = self.reference_diameter * sin(alpha_t) - 2 * self.module * straight_dedendum / sin(alpha_t)
        return sqrt(self.base_diameter**2 + max(from_pitch_point, 0.0) ** 2)

    @property
    def rack_fillet(self) -> float:
        """Tip radius of the rack [module], limited by the width of its tooth."""
        alpha = self.pressure_angle
        largest = (pi / 4 - self.dedendum * tan(alpha)) * cos(alpha) / (1 - sin(alpha))
        return min(self.fillet_radius, max(largest, 0.0))

    # Mass

    @property
    def mass_used(self) -> float:
        """Mass [kg], given or of the cylinder."""
        inner, outer = self._cylinder()
        return self.mass or pi / 4 * (outer**2 - inner**2) * self.face_width * self.density

    @property
    def inertia_used(self) -> float:
        """Polar moment of inertia [kg m^2], given or of the cylinder."""
        inner, outer = self._cylinder()
        return self.inertia or pi / 32 * (outer**4 - inner**4) * self.face_width * self.density

    @property
    def transverse_inertia(self) -> float:
        """Moment of inertia J/2 + m b^2/12 about a diameter [kg m^2]."""
        return self.inertia_used / 2 + self.mass_used * self.face_width**2 / 12

    def _cylinder(self) -> tuple[float, float]:
        """Return the inner and outer diameter of the cylinder that replaces the gear."""
        mean = (self.tip_diameter_used + self.root_diameter) / 2
        if self.internal:
            return mean, self.body_diameter or self.root_diameter + 6 * self.module
        return self.body_diameter, mean

    # Checks

    def _check_diameters(self) -> None:
        tip, root, base, body = self.tip_diameter_used, self.root_diameter, self.base_diameter, self.body_diameter
        mm = 1e3
        if root <= 0:
            raise ValueError(f"Gear: the root diameter would be {root * mm:.4g} mm; give more teeth or a larger module")
        if self.sign * (tip - root) <= 0:
            raise ValueError(f"Gear: tip_diameter = {tip * mm:.6g} mm must be {'below' if self.internal else 'above'} "
                             f"the root diameter of {root * mm:.6g} mm")  # fmt: skip
        if tip <= base:
            reason = "below the base circle there is no involute"
            raise ValueError(f"Gear: the tip diameter of {tip * mm:.6g} mm must be above the base diameter of "
                             f"{base * mm:.6g} mm: {reason}; give a larger profile_shift, tip_diameter or more teeth"
                             if not self.internal else
                             f"Gear: the tip diameter of {tip * mm:.6g} mm of the ring must be above its base diameter "
                             f"of {base * mm:.6g} mm: {reason}; give tip_diameter, or more teeth")  # fmt: skip
        if body and self.sign * (root - body) <= 0:
            raise ValueError(f"Gear: body_diameter = {body * mm:.6g} mm must be {'above' if self.internal else 'below'}"
                             f" the root diameter of {root * mm:.6g} mm: it is the "
                             f"{'outside of the ring' if self.internal else 'bore'}")  # fmt: skip

    def _check_undercut(self) -> None:
        alpha_t, straight_dedendum = self.transverse_pressure_angle, self.dedendum - self.rack_fillet * (
            1 - sin(self.pressure_angle))  # fmt: skip
        min_shift = straight_dedendum - self.teeth * sin(alpha_t) ** 2 / (2 * cos(self.helix_angle))
        if self.profile_shift < min_shift - TOLERATED_UNDERCUT:
            min_teeth = (
                2
                * (straight_dedendum - TOLERATED_UNDERCUT - self.profile_shift)
                * cos(self.helix_angle)
                / sin(alpha_t) ** 2
            )
            raise ValueError(
                f"Gear: {self.teeth} teeth with profile_shift = {self.profile_shift:g} and a pressure angle of "
                f"{degrees(self.pressure_angle):g} deg are undercut: give profile_shift of at least {min_shift:.3f}, "
                f"or {ceil(min_teeth)} teeth or more"
            )

    def _check_tip(self) -> None:
        thickness = self.tooth_thickness(self.tip_diameter_used)
        if thickness <= 0:
            raise ValueError(
                f"Gear: the teeth are pointed below the tip diameter of {self.tip_diameter_used * 1e3:.6g} mm "
                f"(thickness there {thickness * 1e3:.3f} mm): give a smaller profile_shift than {self.profile_shift:g},"
                " a smaller tip_diameter or addendum"
            )
