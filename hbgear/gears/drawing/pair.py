"""Pairs of meshing gears: geometry of the contact, backlash and models of their vibration.

    inv(alpha_wt) = inv(alpha_t) + 2 tan(alpha_n) (x_1 + x_2) / (z_1 + z_2),   a = (d_b1 + d_b2) / (2 cos(alpha_wt))
    eps_alpha = [sqrt(r_a1^2 - r_b1^2) + sqrt(r_a2^2 - r_b2^2) - a sin(alpha_wt)] / p_bt
    eps_beta = b sin(beta) / (pi m_n)

Without a given tip diameter or tip alteration, the gears of a pair have the tip alteration k = min(0, (a - a_d)/m_n -
x_1 - x_2) of ISO 21771, which keeps the tip clearance of the basic rack. a_d is the reference centre distance. The tips
of a ring are shortened until they meet the involute of the pinion.

For a ring gear z_2, r_a2, r_b2, a and the second root are negative. A rack is a wheel of very many teeth. Lengths r_b
theta and forces T / r_b along the line of action are in the transverse plane. If a_w is given, cos(alpha_wt) = (d_b1 +
d_b2) / (2 a_w).

References
----------
ISO 21771:2007, Gears: cylindrical involute gears and gear pairs; concepts and geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import acos, cos, degrees, inf, pi, sin, tan
from typing import Any

from hbgear.common.argument_checks import NamedFields, check
from hbgear.common.arrays import Array
from hbgear.common.facade import call
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range
from hbgear.common.text.messages import quoted
from hbgear.common.units import OptionalQuantityField, QuantityField, to_si
from hbgear.gears.drawing.backlash import MEASURES, convert_backlash
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.geometry import inverse_involute, involute
from hbgear.gears.drawing.interference import Engagement, default_alterations, form_position, tip_distance, tip_text


@dataclass(frozen=True)
class GearPair(NamedFields):  # numpydoc ignore=PR02
    """Pair of involute gears on parallel axes; the module docstring states the equations.

    Parameters
    ----------
    pinion, wheel : Gear
        Pinion and wheel. The wheel may be a ring gear (``internal=True``) or a rack (``rack=True``). Their tips are
        altered as described above.
    backlash : float or str, optional
        Backlash [m] in the measure ``backlash_measure``. By default it follows from the centre distance.
    backlash_measure : {"circumferential", "normal", "action"}, optional
        Measure of the backlash: along the working pitch circle (default), normal to the flanks, or along the line of
        action in the transverse plane.
    center_distance : float or str, optional
        Centre distance a_w [m], or of a rack the distance of its reference line from the axis of the pinion. By
        default, the distance without backlash for these profile shifts.
    pitch_error : float or str, default 0.0
        Base pitch of the wheel minus base pitch of the pinion [m], equal for all teeth. Errors of single teeth, which
        repeat with the turns of the shafts, are `Gear.pitch_errors` and `Gear.runout`.
    misalignment : float or str, default 0.0
        Distance of the driving flanks at one end of the face if they touch at the other end [m], along the line of
        action in the transverse plane: the sum of lead errors of both gears and misalignment of the shafts. It is
        positive if the gap is at the end of the face where helical teeth leave contact last, for both hands and for a
        pinion that drives. The back flanks have it at the other end.

    Raises
    ------
    ValueError
        If the gears cannot mesh: different modules or pressure angles, wrong hands, a contact ratio below 1,
        interference, no clearance at the roots, or a backlash as large as a tooth.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> pair = hb.GearPair(pinion, wheel, backlash="80 um")
    >>> round(pair.contact_ratio, 4), round(pair.working_center_distance * 1e3, 3), round(pair.half_backlash * 1e6, 2)
    (1.6626, 97.5, 37.59)
    """

    pinion: Gear
    wheel: Gear
    backlash: OptionalQuantityField = OptionalQuantityField("m", NOT_NEGATIVE)
    backlash_measure: str = "circumferential"
    center_distance: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-4, 50))
    pitch_error: QuantityField = QuantityField("m", Range(), Range(-1e-3, 1e-3), 0.0)
    misalignment: QuantityField = QuantityField("m", Range(), Range(-2e-3, 2e-3), 0.0)

    def __post_init__(self) -> None:
        for name in ("pinion", "wheel"):
            check("GearPair", name, getattr(self, name), Gear)
        if not isinstance(self.backlash_measure, str) or self.backlash_measure not in MEASURES:
            raise ValueError(
                f"GearPair: backlash_measure = {quoted(self.backlash_measure)} must be one of {', '.join(MEASURES)}"
            )
        _check_fit(self)
        _check_distance(self)
        for name, k in zip(("pinion", "wheel"), default_alterations(self.engagement), strict=True):
            if not getattr(self, name).tips_given:
                object.__setattr__(self, name, getattr(self, name).with_alteration(k))
        _check_backlash(self)
        _check_contact(self)

    # Geometry

    @property
    def ratio(self) -> float:
        """Gear ratio z_2 / z_1; inf for a rack."""
        return inf if self.wheel.rack else self.wheel.teeth / self.pinion.teeth

    @property
    def _signed_teeth(self) -> float:
        return self.pinion.teeth + self.wheel.sign * self.wheel.curvature_teeth

    @property
    def _signed_base_radius(self) -> float:
        """(d_b1 + d_b2) / 2, negative for a ring."""
        return (self.pinion.base_diameter + self.wheel.sign * self.wheel.base_diameter) / 2

    @cached_property
    def working_pressure_angle(self) -> float:
        """Transverse working pressure angle alpha_wt [rad]."""
        if self.center_distance is not None:
            return acos(min(abs(self._signed_base_radius) / self.working_center_distance, 1.0))
        return inverse_involute(self._working_involute)

    @property
    def _working_involute(self) -> float:
        """Involute function of alpha_wt, from the profile shifts; not positive if they allow no centre distance."""
        shifts = self.pinion.profile_shift + self.wheel.profile_shift
        return involute(self.pinion.transverse_pressure_angle) + (
            2 * tan(self.pinion.pressure_angle) * shifts / self._signed_teeth
        )

    @property
    def working_center_distance(self) -> float:
        """Centre distance a_w [m], given or from the profile shifts; also positive for a ring gear.

        For a rack it belongs to the gear that replaces it, see `mounting_distance`.
        """
        if self.center_distance is None:
            return abs(self._signed_base_radius) / cos(self.working_pressure_angle)
        return self.center_distance + (self.wheel.reference_diameter / 2 if self.wheel.rack else 0.0)

    @property
    def mounting_distance(self) -> float:
        """Centre distance [m], or the distance of the reference line of a rack from the axis of the pinion."""
        return self.working_center_distance - (self.wheel.reference_diameter / 2 if self.wheel.rack else 0.0)

    @property
    def base_radii(self) -> tuple[float, float]:
        """Base radii r_b1 and r_b2 [m]."""
        return self.pinion.base_diameter / 2, self.wheel.base_diameter / 2

    @property
    def working_radii(self) -> tuple[float, float]:
        """Radii r_w1 and r_w2 of the working pitch circles [m]."""
        c = cos(self.working_pressure_angle)
        return self.base_radii[0] / c, self.base_radii[1] / c

    @property
    def thickness(self) -> tuple[float, float]:
        """Thickness of the teeth on the working pitch circles over the pitch, without backlash [-]."""
        gears = zip((self.pinion, self.wheel), self.working_radii, strict=True)
        first, second = (g.tooth_thickness(2 * r) * g.curvature_teeth / (2 * pi * r) for g, r in gears)
        return first, second

    @property
    def base_pitch(self) -> float:
        """Transverse base pitch p_bt [m]."""
        return self.pinion.base_pitch

    @cached_property
    def path(self) -> tuple[float, float]:
        """Start A and end E of contact along the line of action, from the base circle of the pinion [m].

        They are the tips of the gears, or the ends of the involutes of teeth that are undercut or that the tips pass.
        """
        begin, end = self.engagement.tip_contact, tip_distance(self.pinion)
        if self.pinion.undercut or begin < 0:
            begin = max(begin, form_position(self.pinion))
        if self.wheel.undercut or (not self.wheel.internal and end > self.tangent_length):
            end = min(end, self.tangent_length - form_position(self.wheel))
        return begin, end

    @property
    def engagement(self) -> Engagement:
        """The gears at their centre distance, with checks of interference."""
        return Engagement(self.pinion, self.wheel, self.working_center_distance, self.working_pressure_angle)

    @property
    def tangent_length(self) -> float:
        """Distance a_w sin(alpha_wt) of the base circles on the line of action [m]; negative for a ring gear."""
        return self.wheel.sign * self.working_center_distance * sin(self.working_pressure_angle)

    @property
    def contact_ratio(self) -> float:
        """Transverse contact ratio eps_alpha."""
        begin, end = self.path
        return (end - begin) / self.base_pitch

    @property
    def face_width(self) -> float:
        """Common face width b [m], the smaller one of the two gears."""
        return min(self.pinion.face_width, self.wheel.face_width)

    @property
    def overlap_ratio(self) -> float:
        """Overlap ratio eps_beta."""
        return self.face_width * abs(sin(self.pinion.helix_angle)) / (pi * self.pinion.module)

    @property
    def total_contact_ratio(self) -> float:
        """Total contact ratio eps_gamma = eps_alpha + eps_beta."""
        return self.contact_ratio + self.overlap_ratio

    @property
    def pitch_position(self) -> float:
        """Mesh periods from the first contact of a pair of teeth to the pitch point in the middle of the face [-]."""
        pitch = self.base_radii[0] * tan(self.working_pressure_angle)
        return (pitch - self.path[0]) / self.base_pitch + self.overlap_ratio / 2

    @property
    def equivalent_mass(self) -> float:
        """Equivalent mass m_c = 1 / (r_b1^2 / J_1 + r_b2^2 / J_2) of the motion along the line of action [kg]."""
        r_1, r_2 = self.base_radii
        return 1 / (r_1**2 / self.pinion.inertia_used + r_2**2 / self.wheel.inertia_used)

    # Backlash

    def backlash_as(self, measure: str) -> float:
        """Return the backlash [m] in a measure: "circumferential", "normal" or "action".

        Raises
        ------
        ValueError
            If the measure is not one of these.
        """
        helix = self.pinion.base_helix_angle
        if self.backlash is not None:
            return convert_backlash(self.backlash, self.backlash_measure, measure, self.working_pressure_angle, helix)
        return convert_backlash(
            self.theoretical_backlash, "circumferential", measure, self.working_pressure_angle, helix
        )

    @property
    def theoretical_backlash(self) -> float:
        """Backlash j_wt [m] from the centre distance and the profile shifts; 0 without a given centre distance."""
        if self.center_distance is None:
            return 0.0
        return 2 * pi * self.working_radii[0] / self.pinion.teeth * (1 - sum(self.thickness))

    @property
    def half_backlash(self) -> float:
        """Half backlash b along the line of action in the transverse plane [m]."""
        return self.backlash_as("action") / 2

    def tilt(self, positions: Array) -> Array:
        """Return the gap of the driving flanks [m] by misalignment, at positions -1/2 to 1/2 across the face."""
        return abs(self.misalignment) / 2 + self.misalignment * positions

    @property
    def is_uneven(self) -> bool:
        """Whether the flanks have gaps that vary across the face: crowning or misalignment."""
        return bool(self.pinion.crowning or self.wheel.crowning or self.misalignment)

    # Mesh and models

    def transverse_force(self, torque: Any) -> float:
        """Return the force T / r_b1 along the line of action in the transverse plane [N].

        ``torque`` acts on the pinion [N m].
        """
        return to_si("GearPair", "torque", torque, "N m") / self.base_radii[0]

    def mesh(self, torque: Any, **options: Any) -> Any:
        """Compute mesh stiffness and transmission error over a mesh cycle under a torque on the pinion.

        This method calls `hbgear.gears.mesh.loaded_mesh.loaded_mesh`, which describes the options.

        Parameters
        ----------
        torque : float or str
            Torque on the pinion [N m], positive.
        **options : object
            Options of that function.
        """
        return call("hbgear.gears.mesh.loaded_mesh.loaded_mesh", self, torque, **options)

    def model(self, torque: Any, damping: Any, form: str = "torsion", **options: Any) -> Any:
        """Return a model of this pair under a torque on the pinion.

        This method calls `hbgear.gears.pairs.pair_models.build_model`, which describes the options.

        Parameters
        ----------
        torque : float or str
            Mean torque on the pinion [N m]; negative if the wheel drives, zero with ``torque_orders``.
        damping : float
            Damping ratio of the mesh.
        form : {"torsion", "bearings", "spatial"}, optional
            Form of the model: a `SpurPair` (default), a `GearRotorBearing` or a `HelicalPair`.
        **options : object
            Options of that function.
        """
        return call("hbgear.gears.pairs.pair_models.build_model", self, torque, damping, form, **options)


def _check_fit(pair: GearPair) -> None:
    """Raise ValueError if modules, angles or kinds of the two gears do not fit."""
    p, w = pair.pinion, pair.wheel
    for name, kind in (("internal", "ring"), ("rack", "rack")):
        if getattr(p, name):
            raise ValueError(f"GearPair: {name} = True for the pinion; give the {kind} as the wheel")
    if abs(p.module - w.module) > 1e-6 * p.module:
        raise ValueError(
            f"GearPair: modules of {p.module * 1e3:g} mm and {w.module * 1e3:g} mm do not mesh; "
            "give both gears the same normal module"
        )
    if abs(p.pressure_angle - w.pressure_angle) > 1e-6:
        raise ValueError(
            f"GearPair: pressure angles of {degrees(p.pressure_angle):g} deg and "
            f"{degrees(w.pressure_angle):g} deg do not mesh; give both the same"
        )
    required = p.helix_angle if w.internal else -p.helix_angle
    if abs(w.helix_angle - required) > 1e-6:
        rule = "of the same hand" if w.internal else "of opposite hands"
        raise ValueError(
            f"GearPair: a {p.hand} pinion of {degrees(p.helix_angle):g} deg and a {w.hand} wheel of "
            f"{degrees(w.helix_angle):g} deg do not mesh: on parallel axes helices are equal and {rule}; give the "
            f"wheel helix_angle = '{degrees(required) + 0.0:g} deg'"
        )
    if w.internal and w.teeth <= p.teeth:
        raise ValueError(f"GearPair: a ring of {w.teeth} teeth has no space for a pinion of {p.teeth}")


def _check_distance(pair: GearPair) -> None:
    """Raise ValueError if the centre distance or the profile shifts allow no mesh."""
    minimum = abs(pair._signed_base_radius)
    if pair.center_distance is not None and pair.working_center_distance <= minimum and not pair.wheel.rack:
        raise ValueError(
            f"GearPair: center_distance = {pair.center_distance * 1e3:.6g} mm must be above "
            f"{minimum * 1e3:.6g} mm, where the base circles touch"
        )
    if pair.center_distance is None and pair._working_involute <= 0:
        shifts = f"profile shifts of {pair.pinion.profile_shift:g} and {pair.wheel.profile_shift:g}"
        remedy = "increase them"
        if pair.wheel.internal:
            remedy = (
                "decrease them: a positive shift makes the teeth of a ring thicker; if the drawing counts it outwards, "
                f"as many catalogues do, give the opposite sign, profile_shift = {-pair.wheel.profile_shift:g}"
            )
        raise ValueError(f"GearPair: {shifts} allow no centre distance; {remedy}")


def _check_backlash(pair: GearPair) -> None:
    """Raise ValueError if the backlash is as large as a tooth, or the teeth overlap."""
    thickness = pi * pair.pinion.module / 2
    if pair.backlash is not None and pair.backlash > 0.5 * pair.pinion.module:
        raise ValueError(
            f"GearPair: backlash = {pair.backlash * 1e3:g} mm is as large as a tooth, which is "
            f"{thickness * 1e3:.3g} mm thick; numbers are in m: "
            f"give '{pair.backlash * 1e3:g} um' if these are micrometres"
        )
    if pair.backlash is None and pair.theoretical_backlash < -1e-3 * pair.pinion.module:
        raise ValueError(
            f"GearPair: at center_distance = {pair.mounting_distance * 1e3:.6g} mm the teeth overlap by "
            f"{-pair.theoretical_backlash * 1e6:.0f} um; give a larger one, smaller profile shifts, or backlash if "
            "the teeth are thinned for it"
        )


def _check_contact(pair: GearPair) -> None:
    """Raise ValueError if tips reach into roots, or if the teeth are not always in contact."""
    p, w = pair.pinion, pair.wheel
    mm = 1e3
    if not w.internal:
        for gear, other in ((p, w), (w, p)):
            clearance = pair.working_center_distance - gear.tip_diameter_used / 2 - other.root_diameter / 2
            if clearance < 0:
                cause = f" with tip_alteration = {gear.tip_alteration:g}" if gear.tip_alteration else ""
                raise ValueError(
                    f"GearPair: the tips of the {gear.teeth} teeth{cause} reach {-clearance * mm:.3f} mm into the "
                    f"roots of the other gear; give {tip_text(gear, 'below', gear.tip_diameter_used + 2 * clearance)}, "
                    f"or a larger centre distance than {pair.mounting_distance * mm:.6g} mm"
                )
    if pair.contact_ratio + pair.overlap_ratio < 1 or pair.contact_ratio <= 0:
        undercut = [name for name, gear in (("pinion", p), ("wheel", w)) if gear.undercut]
        raise ValueError(
            f"GearPair: the contact ratio is {pair.total_contact_ratio:.3f}; it must be at least 1, or no tooth "
            "is in contact for a part of the time: give larger tip diameters, more teeth, or a smaller centre "
            f"distance or pressure angle{f', or less undercut of the {undercut[0]}' if undercut else ''}"
        )
    pair.engagement.check()
