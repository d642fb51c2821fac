"""Involute gears: geometry, mass and manufacturing limits of a spur or helical external gear, internal gear or rack.

    d = m_n z / cos(beta),   d_b = d cos(alpha_t),   tan(alpha_t) = tan(alpha_n) / cos(beta)
    d_a = d + 2 m_n (h_a + x + k),   d_f = d - 2 m_n (h_f - x)      (internal gears: - and + exchanged)

Lengths are in metres and angles in radians. Every field also accepts a text with another unit, such as ``"3 mm"`` or
``"20 deg"``.

The profile shift x of an internal gear has the sign of ISO 21771: a positive value makes the teeth thicker and moves
the tips inwards. Many catalogues count it outwards; their sign is the opposite.

A rack is computed as an external gear with 1e7 teeth, whose flanks are straight. Its profile shift moves the reference
line away from its tips.

References
----------
ISO 21771:2007, Gears: cylindrical involute gears and gear pairs; concepts and geometry.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from math import acos, ceil, cos, degrees, isnan, pi, radians, sin, tan
from typing import Any

import numpy as np

from hbgear.common.argument_checks import NamedFields, check
from hbgear.common.arrays import Array
from hbgear.common.ranges import ANY, NOT_NEGATIVE, POSITIVE, Range, checked, counted
from hbgear.common.text.messages import quoted
from hbgear.common.units import OptionalQuantityField, QuantityField, to_si
from hbgear.gears.drawing.fillet import RackTip, rack_tip
from hbgear.gears.drawing.geometry import base_helix_angle, involute, transverse_pressure_angle
from hbgear.mechanics.plausibility import warn

TOLERATED_UNDERCUT = 0.02
"""Undercut [module] without a warning. The used part of the involute remains; 17 teeth at 20 degrees have less."""

FILLET_STEPS = 100
"""Points of the fillet at which the thickness of undercut teeth is checked; it has one minimum."""


CURVATURE_OF_RACK = 1e7
"""Number of teeth of the gear that replaces a rack. Its path of contact is exact within 1e-6 base pitches; rounding of
the diameters has an effect of 1e-8 modules."""

BACK_OF_RACK = 3.0
"""Default thickness of a rack below its roots [module], for its mass."""

MAX_TOOTH_ERROR = 1e-3
"""Largest error of the position of a tooth [m]; larger numbers were probably given in another unit."""


@dataclass(frozen=True)
class Gear(NamedFields):  # numpydoc ignore=PR02
    """Involute gear; the module docstring states the equations.

    Parameters
    ----------
    teeth : int
        Number of teeth z, positive for internal gears too. That of a rack determines its length and its mass only.
    module : float or str
        Normal module m_n [m].
    face_width : float or str
        Face width b [m].
    pressure_angle : float or str, optional
        Normal pressure angle alpha_n [rad].
    helix_angle : float or str, default 0.0
        Helix angle beta at the reference circle [rad]; positive for a right-hand gear, negative for a left-hand one.
    profile_shift : float or str, default 0.0
        Profile shift coefficient x [module]; a positive value makes the teeth thicker, of an internal gear too (the
        sign of ISO 21771).
    internal : bool, default False
        True for a ring gear with internal teeth.
    rack : bool, default False
        True for a rack. It moves along its reference line; its kinetic energy follows from the mass.
    addendum, dedendum : float or str, optional
        Addendum h_a (default 1) and dedendum h_f (default 1.25) of the basic rack [module].
    fillet_radius : float or str, default 0.38
        Tip radius of the generating rack [module].
    tip_alteration : float or str, optional
        Tip alteration k [module], negative for shorter teeth. By default 0 for a gear by itself; in a `GearPair` the
        alteration that its contact requires.
    tip_diameter : float or str, optional
        Tip diameter d_a [m]. By default it follows from addendum, profile shift and tip alteration.
    body_diameter : float or str, default 0.0
        Bore of an external gear or outside diameter of a ring gear [m]. Default 0: a solid gear, or a ring whose
        outside diameter is the root diameter plus 6 modules.
    rim_thickness, web_thickness : float or str, optional
        Thickness s_R of the rim, below the roots, and b_s of the web [m]. By default the gear is a solid disc. They
        reduce the stiffness of the teeth by the factor C_R of ISO 6336-1, not the mass.
    tip_relief : float or str, default 0.0
        Material removed at the tip, along the normal in the transverse plane [m].
    tip_relief_length : float or str, optional
        Length of the tip relief along the line of action [m]. By default it ends where the number of pairs in contact
        decreases: for usual gears, at the highest point of single tooth contact.
    crowning : float or str, default 0.0
        Material removed at both ends of the face width of this gear [m], with a parabola in between.
    runout, runout_phase : float or str, default 0.0
        Radial run-out F_r of the teeth [m], twice their eccentricity, and the angle of the eccentricity from the middle
        of tooth 0 [rad], in the direction of rotation.
    pitch_errors : sequence of float or str, optional
        Error of the position of every tooth [m], an arc of the reference circle, positive for a tooth that lags behind
        in the direction of rotation: the sums of the single pitch deviations f_pt of ISO 1328-1. Tooth 0 is in contact
        first. Default (): no errors.
    mass : float or str, optional
        Mass [kg]. By default, the mass of a cylinder with the mean of root and tip diameter, and of a rack with 3
        modules below its roots.
    inertia : float or str, optional
        Polar moment of inertia [kg m^2]. By default, the value of the same cylinder.
    E, poisson, density : float or str, optional
        Young's modulus [Pa], Poisson's ratio and density [kg/m^3]. Default: steel, 206e9, 0.3 and 7850.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range, the teeth are pointed or have no involute, or the diameters
        contradict each other.

    Warns
    -----
    ImplausibleInputWarning
        If the teeth are undercut. The root is the trochoid that the rack cuts, and the involute begins above it.

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
    rack: bool = False
    addendum: QuantityField = QuantityField("", POSITIVE, Range(0.2, 2), 1.0)
    dedendum: QuantityField = QuantityField("", POSITIVE, Range(0.3, 2.5), 1.25)
    fillet_radius: QuantityField = QuantityField("", NOT_NEGATIVE, Range(0, 0.6), 0.38)
    tip_alteration: OptionalQuantityField = OptionalQuantityField("", Range(), Range(-1.5, 1.5))
    tip_diameter: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-4, 50))
    body_diameter: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 50), 0.0)
    tip_relief: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 2e-3), 0.0)
    tip_relief_length: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-6, 1))
    rim_thickness: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-5, 10))
    web_thickness: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-5, 10))
    crowning: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 2e-3), 0.0)
    runout: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 2e-3), 0.0)
    runout_phase: QuantityField = QuantityField("rad", ANY, Range(-100, 100), 0.0)
    pitch_errors: tuple[float, ...] = ()
    mass: OptionalQuantityField = OptionalQuantityField("kg", POSITIVE, Range(1e-7, 1e7))
    inertia: OptionalQuantityField = OptionalQuantityField("kg m^2", POSITIVE, Range(1e-14, 1e8))
    E: QuantityField = QuantityField("Pa", POSITIVE, Range(1e8, 1.2e12), 206e9)
    poisson: QuantityField = QuantityField("", Range(above=-1, below=0.5), Range(0, 0.499), 0.3)
    density: QuantityField = QuantityField("kg/m^3", POSITIVE, Range(100, 25_000), 7850.0)
    default_alteration: float = field(init=False, default=0.0, repr=False)
    """Tip alteration k [module] without a given one, nonzero for gears of a `GearPair` only."""

    def __post_init__(self) -> None:
        counted("Gear: teeth", self.teeth, 10_000, least=5)
        for name in ("internal", "rack"):
            check("Gear", name, getattr(self, name), bool)
        if self.rack:
            _check_rack(self)
        if self.tip_diameter is not None and self.tip_alteration is not None:
            raise ValueError("Gear: tip_diameter and tip_alteration are both given; keep one")
        if (self.rim_thickness is None) != (self.web_thickness is None):
            raise ValueError(
                "Gear: rim_thickness and web_thickness must both be given, or none for a solid disc; the "
                "web of a rim that is as wide as its teeth is the face width"
            )
        object.__setattr__(self, "pitch_errors", _checked_errors(self.pitch_errors, self.teeth))
        _check_diameters(self)
        if not self.internal:
            _check_undercut(self)
            _check_tip(self)

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
    def curvature_teeth(self) -> float:
        """Number of teeth that determines the curvature of the flanks: z, or that of the gear that replaces a rack."""
        return CURVATURE_OF_RACK if self.rack else self.teeth

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
        return self.module * self.curvature_teeth / cos(self.helix_angle)

    @property
    def base_diameter(self) -> float:
        """Base diameter d_b [m]."""
        return self.reference_diameter * cos(self.transverse_pressure_angle)

    @property
    def tip_diameter_used(self) -> float:
        """Tip diameter d_a [m], given or from the addendum."""
        if self.tip_diameter is not None:
            return self.tip_diameter
        k = self.default_alteration if self.tip_alteration is None else self.tip_alteration
        height = self.addendum + self.profile_shift + k
        tip = self.reference_diameter + self.sign * 2 * self.module * height
        return max(tip, self.base_diameter) if self.internal and self.tip_alteration is None else tip

    @property
    def tips_given(self) -> bool:
        """Whether the tip diameter or the tip alteration is given."""
        return self.tip_diameter is not None or self.tip_alteration is not None

    def with_alteration(self, k: float) -> Gear:
        """Return this gear with a default tip alteration [module]."""
        out = copy(self)
        object.__setattr__(out, "default_alteration", k)
        return out

    @property
    def root_diameter(self) -> float:
        """Root diameter d_f [m]."""
        return self.reference_diameter - self.sign * 2 * self.module * (self.dedendum - self.profile_shift)

    @property
    def virtual_teeth(self) -> float:
        """Number of teeth z_n = z / (cos^2(beta_b) cos(beta)) of the virtual spur gear in the normal section."""
        return self.curvature_teeth / (cos(self.base_helix_angle) ** 2 * cos(self.helix_angle))

    @property
    def base_pitch(self) -> float:
        """Transverse base pitch p_bt = pi d_b / z [m]."""
        return pi * self.base_diameter / self.curvature_teeth

    def tooth_thickness(self, diameter: float) -> float:
        """Return the transverse thickness of a tooth along the arc at a diameter [m], without backlash.

        s = d_y ((pi/2 + 2 x tan(alpha_n)) / z + inv(alpha_t) - inv(alpha_y)),   cos(alpha_y) = d_b / d_y
        """
        checked("tooth_thickness", "diameter", diameter, POSITIVE)
        at_reference = (pi / 2 + 2 * self.profile_shift * tan(self.pressure_angle)) / self.curvature_teeth
        alpha_y = acos(min(self.base_diameter / diameter, 1.0))
        rotation = involute(self.transverse_pressure_angle) - involute(alpha_y)
        return diameter * (at_reference + self.sign * rotation)

    @cached_property
    def form_diameter(self) -> float:
        """Diameter at which the involute ends and the fillet of an external gear begins [m].

        It is nan if the trochoid of undercut teeth does not intersect the involute.
        """
        return 2 * float(self.fillet(2)[0][-1])

    def fillet(self, points: int) -> tuple[Array, Array]:
        """Return the fillet of an external gear in the transverse plane, from the root circle to the involute.

        Parameters
        ----------
        points : int
            Number of points.

        Returns
        -------
        radius : ndarray, shape (points,)
            Radii [m].
        half_angle : ndarray, shape (points,)
            Half the angle of the tooth there [rad].
        """
        radius, helix = self.reference_diameter / 2, self.helix_angle
        at_base = self.tooth_thickness(self.base_diameter) / self.base_diameter
        end = self.rack_tip.end(radius, helix, self.base_diameter / 2, pi / self.curvature_teeth - at_base)
        fillet, space = self.rack_tip.trochoid(radius, helix, np.linspace(0.0, end, points))
        return fillet, pi / self.curvature_teeth - space

    @property
    def undercut(self) -> bool:
        """Whether the trochoid cuts away a part of the involute, by more than the tolerated amount."""
        return not self.internal and self.profile_shift < self._smallest_shift - TOLERATED_UNDERCUT

    @property
    def _straight_dedendum(self) -> float:
        """Part of the dedendum of the rack with a straight flank [module]."""
        return self.dedendum - self.rack_fillet * (1 - sin(self.pressure_angle))

    @property
    def _smallest_shift(self) -> float:
        """Smallest profile shift without undercut [module]."""
        alpha_t = self.transverse_pressure_angle
        return self._straight_dedendum - self.curvature_teeth * sin(alpha_t) ** 2 / (2 * cos(self.helix_angle))

    @property
    def rack_fillet(self) -> float:
        """Tip radius of the rack [module], limited by the width of its tooth."""
        alpha = self.pressure_angle
        largest = (pi / 4 - self.dedendum * tan(alpha)) * cos(alpha) / (1 - sin(alpha))
        return min(self.fillet_radius, max(largest, 0.0))

    @property
    def rack_tip(self) -> RackTip:
        """Tip of the generating rack."""
        return rack_tip(self.module, self.pressure_angle, self.dedendum, self.rack_fillet, self.profile_shift)

    # Mass

    @property
    def mass_used(self) -> float:
        """Mass [kg], given or of the cylinder or bar."""
        return self.mass or _section(self) * self.face_width * self.density

    @property
    def inertia_used(self) -> float:
        """Polar moment of inertia [kg m^2], given or of the cylinder; of the gear that replaces a rack."""
        if self.rack:
            return self.mass_used * (self.reference_diameter / 2) ** 2  # m v^2 = J omega^2
        inner, outer = _cylinder(self)
        return self.inertia or pi / 32 * (outer**4 - inner**4) * self.face_width * self.density

    @property
    def transverse_inertia(self) -> float:
        """Moment of inertia J/2 + m b^2/12 about a diameter [kg m^2]."""
        return self.inertia_used / 2 + self.mass_used * self.face_width**2 / 12


def _cylinder(gear: Gear) -> tuple[float, float]:
    """Return the inner and outer diameter of the cylinder that replaces a gear."""
    mean = (gear.tip_diameter_used + gear.root_diameter) / 2
    if gear.internal:
        return mean, gear.body_diameter or gear.root_diameter + 6 * gear.module
    return gear.body_diameter, mean


def _section(gear: Gear) -> float:
    """Return the area of the cylinder, or of the bar that replaces a rack [m^2]."""
    if gear.rack:
        height = (gear.tip_diameter_used - gear.root_diameter) / 4 + BACK_OF_RACK * gear.module
        return gear.teeth * pi * gear.module / cos(gear.helix_angle) * height
    inner, outer = _cylinder(gear)
    return pi / 4 * (outer**2 - inner**2)


def _checked_errors(values: Any, teeth: int) -> tuple[float, ...]:
    """Return the errors of the positions of all teeth [m]."""
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise ValueError(f"Gear: pitch_errors = {quoted(values)} must be a sequence with one length for each tooth")
    errors = tuple(to_si("Gear", "pitch_errors", value, "m") for value in values)
    if errors and len(errors) != teeth:
        raise ValueError(
            f"Gear: pitch_errors has {len(errors)} values for {teeth} teeth; give one for each tooth, "
            "the error of its position: numpy.cumsum of the single pitch deviations"
        )
    if any(not abs(error) <= MAX_TOOTH_ERROR for error in errors):
        largest = max(errors, key=lambda error: abs(error) if error == error else float("inf"))
        raise ValueError(
            f"Gear: pitch_errors has the value {largest:g} m, beyond any machine (it must be at most "
            f"{MAX_TOOTH_ERROR:g} m in size); numbers are in m, other units are given as text such as "
            "'5 um'"
        )
    return errors if any(errors) else ()


def _check_rack(gear: Gear) -> None:
    """Raise an error if a rack has properties of a body that turns."""
    if gear.internal:
        raise ValueError("Gear: internal and rack are both True; a rack has straight flanks: keep one")
    names = [
        name
        for name in ("tip_diameter", "body_diameter", "inertia", "rim_thickness", "runout", "pitch_errors")
        if getattr(gear, name)
    ]
    if names:
        remedy = {"tip_diameter": "addendum or tip_alteration", "inertia": "mass", "body_diameter": "mass"}
        raise ValueError(
            f"Gear: {names[0]} belongs to a gear that turns, and this is a rack; "
            f"{f'give its {remedy[names[0]]}' if names[0] in remedy else f'omit {names[0]}'}"
        )


def _check_diameters(gear: Gear) -> None:
    """Raise ValueError if the diameters of root, base circle, tip and body are not possible together."""
    tip, root, base, body = gear.tip_diameter_used, gear.root_diameter, gear.base_diameter, gear.body_diameter
    mm = 1e3
    if root <= 0:
        raise ValueError(f"Gear: the root diameter would be {root * mm:.4g} mm; give more teeth or a larger module")
    if gear.sign * (tip - root) <= 0:
        raise ValueError(
            f"Gear: tip_diameter = {tip * mm:.6g} mm must be {'below' if gear.internal else 'above'} "
            f"the root diameter of {root * mm:.6g} mm"
        )
    if tip < base or (tip == base and not gear.internal):
        reason = "below the base circle there is no involute"
        raise ValueError(
            f"Gear: the tip diameter of {tip * mm:.6g} mm must be above the base diameter of "
            f"{base * mm:.6g} mm: {reason}; give a larger profile_shift, tip_diameter or more teeth"
            if not gear.internal
            else f"Gear: the tip diameter of {tip * mm:.6g} mm of the ring must be above its base diameter "
            f"of {base * mm:.6g} mm: {reason}; give a larger tip_diameter, more "
            "teeth, or a smaller profile_shift (positive values make the teeth of a ring thicker and "
            "move its tips inwards; many catalogues count the shift of rings outwards, with the "
            "opposite sign)"
        )
    if body and gear.sign * (root - body) <= 0:
        raise ValueError(
            f"Gear: body_diameter = {body * mm:.6g} mm must be {'above' if gear.internal else 'below'}"
            f" the root diameter of {root * mm:.6g} mm: it is the "
            f"{'outside of the ring' if gear.internal else 'bore'}"
        )


def _check_undercut(gear: Gear) -> None:
    """Warn of undercut teeth; raise an error if no involute is left."""
    if not gear.undercut:
        return
    min_teeth = (
        2
        * (gear._straight_dedendum - TOLERATED_UNDERCUT - gear.profile_shift)
        * cos(gear.helix_angle)
        / sin(gear.transverse_pressure_angle) ** 2
    )
    teeth = (
        f"{gear.teeth} teeth with profile_shift = {gear.profile_shift:g} and a pressure angle of "
        f"{degrees(gear.pressure_angle):g} deg"
    )
    remedy = f"profile_shift of at least {gear._smallest_shift:.3f}, or {ceil(min_teeth)} teeth or more"
    form, tip, mm = gear.form_diameter, gear.tip_diameter_used, 1e3
    if isnan(form) or form >= tip or float(gear.fillet(FILLET_STEPS)[1].min()) <= 0:
        raise ValueError(
            f"Gear: {teeth} are undercut, which leaves no involute below the tip diameter of "
            f"{tip * mm:.6g} mm: give {remedy}"
        )
    warn(
        f"Gear: {teeth} are undercut: the involute begins at a diameter of {form * mm:.6g} mm above the base "
        f"diameter of {gear.base_diameter * mm:.6g} mm; {remedy} avoid it"
    )


def _check_tip(gear: Gear) -> None:
    thickness = gear.tooth_thickness(gear.tip_diameter_used)
    if thickness <= 0:
        raise ValueError(
            f"Gear: the teeth are pointed below the tip diameter of {gear.tip_diameter_used * 1e3:.6g} mm "
            f"(thickness there {thickness * 1e3:.3f} mm): give a smaller profile_shift than {gear.profile_shift:g},"
            " a smaller tip_diameter or addendum, or a negative tip_alteration"
        )
