"""Loaded contact of a gear pair over a mesh cycle: mesh stiffness and transmission error from the teeth in contact.

    sum_i F_i = F,   F_i c_i(F_i) = mean of max(delta - g, 0) over the contact line of i
    e = min g,   k = F / (delta - e)

The index i counts the pairs of teeth and, for helical or crowned gears, slices of the face width. The gap g is linear
along the contact line of a slice and continuous between slices, so that a slice comes into contact gradually: the force
and its derivative have no steps from the division into slices. c_i is the compliance
of both teeth (`hbgear.gears.drawing.tooth`) and of the contact. g_i is the gap: the material missing there because of
relief, crowning, pitch error and misalignment. delta is the displacement along the line of action. k is the secant
stiffness of the loaded mesh, so that the static force and the loss of contact are correct. The tangent stiffness
dF/d(delta), with e = delta - F/k, is correct for small vibration about the static state.

The compliance of the contact of two cylinders of width b, with the tooth centre lines at depths h_1 and h_2, by Weber
and Banaschek:

    c_h = 2/(pi b) sum_i (1 - nu_i^2)/E_i [ln(2 h_i/a) - nu_i/(2 (1 - nu_i))]
    a^2 = 4/pi (F/b) rho sum_i (1 - nu_i^2)/E_i

rho is the radius of relative curvature and a is half the contact width. Slices are not coupled. Contact outside the
line of action (of tips under load) and the compliance of wheel bodies and shafts are neglected. A rim on a thin web
increases the compliance of the teeth of its gear by 1/C_R of `hbgear.gears.mesh.iso_stiffness`.

References
----------
Weber & Banaschek (1953), Formaenderung und Profilruecknahme bei gerad- und schraegverzahnten Raedern, Vieweg. Chaari,
Fakhfakh & Haddar (2009), Eur. J. Mech. A 28, 461-468 (several pairs of teeth in contact).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, cos, pi
from typing import Any, Literal

import numpy as np

from hbgear.common.argument_checks import check, checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.common.units import to_si
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.drawing.tooth import Tooth
from hbgear.gears.mesh.iso_stiffness import blank_factor
from hbgear.gears.mesh.mesh_cycle import MeshCycle, MeshTable

PATH_POINTS = 160  # points of the path of contact at which the tooth compliance is computed; linear in between
DISPLACEMENT_TOLERANCE = 1e-12  # relative change of the displacement at which the iteration has converged
NEWTON_ITERATIONS = 50  # Newton's method for a convex sum of springs needs a few; more only by rounding
MIN_SPREAD = 1e-13  # half the difference of the gaps at the ends of a slice that is attributed to rounding [m]
MIN_LOAD_FRACTION = 1e-9  # smallest load of a contact (fraction of the force) and smallest fraction of a slice


@dataclass(frozen=True)
class Contacts:
    """Possible contacts, arrays (N phases, M contacts): presence, tooth compliance, gap, Hertzian contact data.

    The gap is the mean over the contact line of a slice, and ``spread`` half the difference between its ends.
    """

    present: Array
    teeth: Array
    gap: Array
    spread: Array
    depth: tuple[Array, Array]
    rho: Array
    widths: Array


@checked_arguments()
def loaded_mesh(
    pair: GearPair,
    torque: Any,
    *,
    phases: int = 256,
    slices: int | None = None,
    linearized: Literal["secant", "tangent"] = "secant",
) -> MeshCycle:
    """Compute mesh stiffness and transmission error over a mesh cycle; the module docstring states the equations.

    The torque on the pinion [N m] is positive. ``phases`` is the number of steps of the cycle, at least 8; two points
    are added where a pair of spur teeth leaves contact. The number of slices of the face width is 1 for spur gears, 24
    if they are crowned or misaligned, and follows from the overlap ratio of helical gears. ``linearized`` is the
    "secant" or "tangent" stiffness of the loaded mesh. ValueError is raised if an argument is not valid.
    """
    torque = loading_torque("GearPair.mesh", torque)
    check("GearPair.mesh", "linearized", linearized, Literal["secant", "tangent"])
    counted("GearPair.mesh: phases", phases, 100_000, least=8)
    if slices is None:
        slices = max(24, 24 * ceil(pair.overlap_ratio)) if pair.overlap_ratio else 24 if pair.is_uneven else 1
    counted("GearPair.mesh: slices", slices, 10_000)
    force = pair.transverse_force(torque)
    phase, side = cycle_phases(pair, phases)
    contacts = possible_contacts(pair, phase, side, slices)
    delta, tangent, _ = static_equilibrium(pair, contacts, force)
    smallest_gap = np.min(np.where(contacts.present, contacts.gap - contacts.spread, np.inf), axis=1)
    error = smallest_gap if linearized == "secant" else delta - force / tangent
    return MeshCycle(MeshTable(phase, force / (delta - error)), MeshTable(phase, error), force)


def loading_torque(caller: str, torque: Any) -> float:
    """Return a torque [N m]; ValueError, which names the caller, if it is not positive."""
    value = to_si(caller, "torque", torque, "N m")
    if value <= 0:
        raise ValueError(
            f"{caller}: torque = {value:g} N m must be positive: the mesh is computed under load, and a "
            "model without a mean torque needs torque orders"
        )
    return value


def cycle_phases(pair: GearPair, count: int) -> tuple[Array, Array]:
    """Return the phases of a cycle and, for phases that occur twice, -1 before the jump and +1 after it.

    A pair of spur teeth enters contact at phase 0 and leaves it at the fractional part of the contact ratio.
    """
    phase = np.linspace(0.0, 1.0, count + 1)
    side = np.zeros(count + 1)
    side[0], side[-1] = 1, -1
    if pair.overlap_ratio:
        return phase, side
    exit_phase = pair.contact_ratio % 1.0
    phase = phase[np.abs(phase - exit_phase) > 1e-9]
    side = np.concatenate([[1.0], np.zeros(len(phase) - 2), [-1.0]])
    index = int(np.searchsorted(phase, exit_phase))
    return np.insert(phase, index, [exit_phase, exit_phase]), np.insert(side, index, [-1.0, 1.0])


def possible_contacts(pair: GearPair, phase: Array, side: Array, slices: int) -> Contacts:
    """Return the possible contacts at all phases.

    ``side`` states on which side of a jump a phase lies.
    """
    begin, end = pair.path
    length = (end - begin) / pair.base_pitch
    z = (np.arange(slices) + 0.5) / slices - 0.5  # position across the face, in face widths
    lag = pair.overlap_ratio * (z + 0.5)
    pairs = np.arange(ceil(length + pair.overlap_ratio) + 1)
    position = (phase[:, None, None] + pairs[None, :, None] - lag[None, None, :]).reshape(len(phase), -1)
    offset = side[:, None] * 1e-9  # shift [base pitch] that selects the state before or after a jump
    half_width = pair.overlap_ratio / (2 * slices)  # half the section of the path covered by a slice [base pitch]
    first, last = np.clip(position - half_width, 0.0, length), np.clip(position + half_width, 0.0, length)
    inside = (position + offset > 0) & (position + offset < length)
    fraction = (last - first) / (2 * half_width) if half_width else inside.astype(float)
    return contacts_at(pair, first, last, np.tile(z, len(pairs))[None, :], fraction, slices)


def contacts_at(pair: GearPair, first: Array, last: Array, z: Array, fraction: Array, slices: int) -> Contacts:
    """Return the contacts of slices whose contact line covers a section of the path.

    ``first`` and ``last`` are the ends of the section [base pitch], ``z`` is the middle of the slice, see `_gaps`,
    and ``fraction`` is the part of the slice within the path of contact.
    """
    begin, end = pair.path
    middle = (first + last) / 2
    first, s, last = (np.clip(begin + u * pair.base_pitch, begin, end) for u in (first, middle, last))
    gap_last, gap_first = _gaps(pair, last, z - 0.5 / slices), _gaps(pair, first, z + 0.5 / slices)
    gap, spread = (gap_last + gap_first) / 2, np.abs(gap_last - gap_first) / 2
    grid, compliance, depths = _teeth_over_path(_without_errors(pair))
    teeth, depth = np.interp(s, grid, compliance), [np.interp(s, grid, d) for d in depths]
    cos_helix = cos(pair.pinion.base_helix_angle)
    rho = np.abs(s * (pair.tangent_length - s) / pair.tangent_length) / cos_helix
    width = pair.face_width / slices
    # k_t = k_n cos^2(beta_b), and the length of contact is width / cos(beta_b)
    widths = width * np.maximum(fraction, MIN_LOAD_FRACTION)
    present, teeth = fraction > MIN_LOAD_FRACTION, teeth / (widths * cos_helix)
    return Contacts(present, teeth, gap, spread, (depth[0], depth[1]), rho, widths)


@lru_cache(maxsize=8)
def _without_errors(pair: GearPair) -> GearPair:
    """Return the pair without backlash, modifications and errors, on which the compliance of teeth does not depend."""
    pinion, wheel = (
        replace(gear, tip_relief=0.0, tip_relief_length=None, crowning=0.0, runout=0.0, pitch_errors=())
        for gear in (pair.pinion, pair.wheel)
    )
    backlash = None if pair.backlash is None else 0.0
    return replace(pair, pinion=pinion, wheel=wheel, backlash=backlash, pitch_error=0.0, misalignment=0.0)


@lru_cache(maxsize=8)
def _teeth_over_path(pair: GearPair) -> tuple[Array, Array, tuple[Array, Array]]:
    """Return positions on the path of contact, the compliance of both teeth there, and the depth of each tooth.

    They are cached, because they do not depend on the torque, and on the errors that `_without_errors` omits.
    """
    grid = np.linspace(*pair.path, PATH_POINTS)
    teeth, depth = np.zeros(PATH_POINTS), []
    for gear, curvature_radius in ((pair.pinion, grid), (pair.wheel, pair.tangent_length - grid)):
        radius = np.hypot(curvature_radius, gear.base_diameter / 2)
        compliance, gear_depth = Tooth(gear).compliance(gear.sign * (radius - gear.reference_diameter / 2))
        teeth += compliance / blank_factor(gear)
        depth.append(gear_depth)
    return grid, teeth, (depth[0], depth[1])


def _gaps(pair: GearPair, s: Array, z: Array) -> Array:
    """Return the material missing at positions along the line of action and across the face [m].

    ``s`` is measured from the base circle of the pinion [m]; ``z`` is the position across the face over the common face
    width, -1/2 to 1/2. The middles of both gears are at the same position.
    """
    begin, end = pair.path
    gap = pair.pitch_error * (s - (begin + end) / 2) / pair.base_pitch + pair.tilt(z)
    for gear, from_tip in ((pair.pinion, end - s), (pair.wheel, s - begin)):
        gap = gap + gear.crowning * (2 * z * pair.face_width / gear.face_width) ** 2
        if gear.tip_relief:
            length = relief_length(pair, gear)
            gap = gap + gear.tip_relief * np.maximum(1 - from_tip / length, 0.0)
    return gap


def relief_length(pair: GearPair, gear: Gear) -> float:
    """Return the length of the tip relief along the line of action [m].

    By default the relief ends where the fewest pairs are in contact.

    Raises
    ------
    ValueError
        If a given length exceeds the path of contact.
    """
    if gear.tip_relief_length is not None:
        path = pair.path[1] - pair.path[0]
        if gear.tip_relief_length > path:
            raise ValueError(
                f"GearPair: the tip relief of the {gear.teeth} teeth is {gear.tip_relief_length * 1e3:.4g} mm long and "
                f"the path of contact {path * 1e3:.4g} mm; give a shorter tip_relief_length, along the line of action"
            )
        return gear.tip_relief_length
    return max(pair.contact_ratio % 1.0, 0.1) * pair.base_pitch


def static_equilibrium(pair: GearPair, c: Contacts, force: float) -> tuple[Array, Array, Array]:
    """Return the displacement delta (N,) under the force, the tangent stiffness dF/d(delta) (N,) and loads (N, M).

    A fixed-point iteration updates the contact compliance with the loads of the last iteration. In each iteration the
    sum of springs is solved for delta by Newton's method from above, where it is convex. ValueError is raised if the
    teeth yield by more than a module.
    """
    load = np.where(c.present, force / np.maximum(c.present.sum(axis=1, keepdims=True), 1), 0.0)
    delta = np.zeros(len(load))
    for _ in range(200):
        contact, _ = contact_compliance(pair, c, np.maximum(load, MIN_LOAD_FRACTION * force))
        k = np.where(c.present, 1 / (c.teeth + contact), 0.0)
        new_delta = spring_displacement(k, np.where(c.present, c.gap, np.inf), force)
        for _ in range(NEWTON_ITERATIONS if c.spread.any() else 0):
            closed, part = closed_gap(new_delta[:, None], c)
            step = (np.sum(k * closed, axis=1) - force) / np.sum(k * part, axis=1)
            new_delta = new_delta - step
            if np.all(np.abs(step) <= DISPLACEMENT_TOLERANCE * np.abs(new_delta).max()):
                break
        closed, part = closed_gap(new_delta[:, None], c)
        load = np.where(c.present, k * closed, 0.0)
        change = np.abs(new_delta - delta)
        converged = bool(np.all(change <= DISPLACEMENT_TOLERANCE * np.abs(new_delta).max()))
        delta = new_delta
        if converged:
            break
    module, largest = pair.pinion.module, float(delta.max())
    if force > 0 and largest - float(np.min(c.gap[c.present])) > module:
        raise ValueError(
            f"GearPair: torque = {force * pair.base_radii[0]:g} N m on the pinion would deflect the teeth by "
            f"{1e3 * largest:.3g} mm, more than their module of {1e3 * module:g} mm, at which teeth break: give a "
            "smaller torque (is it in N m?) or a larger face_width or module"
        )
    contact, decrease = contact_compliance(pair, c, np.maximum(load, MIN_LOAD_FRACTION * force))
    stiffness = np.where(load > 0, part / np.maximum(c.teeth + contact - decrease, 0.5 * c.teeth), 0.0)
    return delta, np.sum(stiffness, axis=1), load


def closed_gap(delta: Array, c: Contacts) -> tuple[Array, Array]:
    """Return the mean of max(delta - g, 0) over the contact line of each slice, and its derivative.

    The derivative is the part of the contact line on which the gap is closed.
    """
    x = delta - c.gap
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(c.spread > MIN_SPREAD, np.clip((x + c.spread) / (2 * c.spread), 0.0, 1.0), x > 0)
    partial = (part > 0) & (part < 1)
    return np.where(partial, part**2 * c.spread, np.maximum(x, 0.0)), part


def spring_displacement(k: Array, gap: Array, force: float) -> Array:
    """Return delta (N,) that solves sum_i k_i max(delta - g_i, 0) = F, found by closing the gaps in ascending order."""
    order = np.argsort(gap, axis=1)
    g = np.take_along_axis(gap, order, axis=1)
    ks = np.take_along_axis(k, order, axis=1)
    total_stiffness = np.cumsum(ks, axis=1)
    with np.errstate(invalid="ignore"):
        moment = np.cumsum(np.where(np.isfinite(g), ks * g, 0.0), axis=1)
        candidate = (force + moment) / total_stiffness  # with the first j springs in contact
        next_gap = np.concatenate([g[:, 1:], np.full((len(g), 1), np.inf)], axis=1)
    in_contact = np.argmax(candidate <= next_gap, axis=1)
    return candidate[np.arange(len(g)), in_contact]


def contact_compliance(pair: GearPair, c: Contacts, load: Array) -> tuple[Array, Array]:
    """Return the contact compliance c_h in the transverse plane and its decrease in the tangent, -F dc_h/dF."""
    cos_helix = cos(pair.pinion.base_helix_angle)
    length = c.widths / cos_helix
    plane_strain = [(1 - gear.poisson**2) / gear.E for gear in (pair.pinion, pair.wheel)]
    line_load = np.maximum(load / cos_helix / length, 1.0)  # normal to the flank; at least 1 N/m to bound the logarithm
    a = np.sqrt(4 / pi * line_load * np.maximum(c.rho, 1e-9) * sum(plane_strain))
    total = np.zeros_like(load)
    for gear, strain, depth in zip((pair.pinion, pair.wheel), plane_strain, c.depth, strict=True):
        logs = np.log(np.maximum(2 * depth / a, 1.5))
        total = total + strain * (logs - gear.poisson / (2 * (1 - gear.poisson)))
    scale = 2 / (pi * c.widths * cos_helix)
    return scale * total, scale * sum(plane_strain) / 2
