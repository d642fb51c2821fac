"""Loaded contact of a gear pair over a mesh cycle: stiffness and transmission error from the teeth in contact.

    sum_i F_i = F,   F_i c_i(F_i) = max(delta - g_i, 0)
    e = min_i g_i,   k = F / (delta - e)

i runs over the pairs of teeth and, of helical gears, over slices of the face width; c_i is the compliance of both teeth
(`hbgear.gears.drawing.tooth`) and of the contact, g_i >= 0 the material that is missing there (relief, crowning, pitch
error)
and delta the displacement along the line of action. k is the secant of the loaded mesh, so that force and loss of
contact are right at rest; the tangent dF/d(delta), with e = delta - F/k, is right for small vibration about it.

The contact of two cylinders of width b, h_1 and h_2 deep behind it, by Weber and Banaschek:

    c_h = 2/(pi b) sum_i (1 - nu_i^2)/E_i [ln(2 h_i/a) - nu_i/(2 (1 - nu_i))],   a^2 = 4/pi (F/b) rho sum_i (1 -
    nu_i^2)/E_i

rho is the radius of relative curvature and a half the width of contact. Slices do not hold each other, contact outside
of the line of action (of tips, under load) is left out, and so is the compliance of wheel bodies and shafts.

References
----------
Weber & Banaschek (1953), Formaenderung und Profilruecknahme bei gerad- und schraegverzahnten Raedern, Vieweg.
Chaari, Fakhfakh & Haddar (2009), Eur. J. Mech. A 28, 461-468 (teeth side by side).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, pi
from typing import Any, Literal

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.common.text.messages import quoted
from hbgear.common.units import to_si
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.drawing.tooth import Tooth
from hbgear.gears.mesh.mesh_cycle import MeshCycle, MeshTable

_ALONG = 160  # places along the path of contact at which the compliance of teeth is computed
_TIGHT = 1e-12  # relative change of the displacement at which it is found
_LEAST = 1e-9  # of the force, for a pair that barely touches


@dataclass(frozen=True)
class _Contacts:
    """All that may touch, (N phases, M places): whether it is there, compliance of teeth, gap, data of contact."""

    there: Array
    teeth: Array
    gap: Array
    depth: tuple[Array, Array]
    rho: Array
    widths: Array


def loaded_mesh(
    pair: GearPair,
    torque: Any,
    *,
    phases: int = 256,
    slices: int | None = None,
    linearized: Literal["secant", "tangent"] = "secant",
) -> MeshCycle:
    """Mesh stiffness and transmission error over a mesh cycle; equations at the head of this file.

    Parameters
    ----------
    pair : `GearPair`.
    torque : on the pinion [N m], > 0.
    phases : steps of a cycle; where teeth of a spur pair come and go, there are more.
    slices : of the face width of helical or crowned gears; chosen from the overlap by default.
    linearized : "secant" or "tangent" of the loaded mesh.

    Raises
    ------
    ValueError
        If the torque is not positive, or an option is none.
    """
    torque = to_si("GearPair.mesh", "torque", torque, "N m")
    if torque <= 0:
        raise ValueError(f"GearPair.mesh: torque = {torque:g} N m must be positive: the mesh is computed under load")
    if not isinstance(linearized, str) or linearized not in ("secant", "tangent"):
        raise ValueError(f"GearPair.mesh: linearized = {quoted(linearized)} must be 'secant' or 'tangent'")
    counted("GearPair.mesh: phases", phases, 100_000, least=8)
    crowned = pair.pinion.crowning > 0 or pair.wheel.crowning > 0
    if slices is None:
        slices = max(48, 48 * ceil(pair.overlap_ratio)) if pair.overlap_ratio else 24 if crowned else 1
    counted("GearPair.mesh: slices", slices, 10_000)
    force = pair.transverse_force(torque)
    phase, twice = _phases(pair, phases)
    contacts = _contacts(pair, phase, twice, slices)
    delta, tangent = _balanced(pair, contacts, force)
    least = np.min(np.where(contacts.there, contacts.gap, np.inf), axis=1)
    error = least if linearized == "secant" else delta - force / tangent
    return MeshCycle(MeshTable(phase, force / (delta - error)), MeshTable(phase, error), force)


def _phases(pair: GearPair, count: int) -> tuple[Array, Array]:
    """Phases of a cycle, and for those that are there twice, -1 before the jump and +1 after it.

    A pair of spur teeth comes at phase 0 and goes where the fraction of the contact ratio is.
    """
    phase = np.linspace(0.0, 1.0, count + 1)
    side = np.zeros(count + 1)
    side[0], side[-1] = 1, -1
    if pair.overlap_ratio:
        return phase, side
    leaves = pair.contact_ratio % 1.0
    phase = phase[np.abs(phase - leaves) > 1e-9]
    side = np.concatenate([[1.0], np.zeros(len(phase) - 2), [-1.0]])
    at = int(np.searchsorted(phase, leaves))
    return np.insert(phase, at, [leaves, leaves]), np.insert(side, at, [-1.0, 1.0])


def _contacts(pair: GearPair, phase: Array, side: Array, slices: int) -> _Contacts:
    begin, end = pair.path
    length = (end - begin) / pair.base_pitch
    z = (np.arange(slices) + 0.5) / slices - 0.5  # over the face width
    lag = pair.overlap_ratio * (z + 0.5)
    pairs = np.arange(ceil(length + pair.overlap_ratio) + 1)
    where = (phase[:, None, None] + pairs[None, :, None] - lag[None, None, :]).reshape(len(phase), -1)
    nudge = side[:, None] * 1e-9  # whether a pair that comes or goes right here is counted
    reach = pair.overlap_ratio / (2 * slices)  # half of what a slice covers of the path, in base pitches
    first, last = np.clip(where - reach, 0.0, length), np.clip(where + reach, 0.0, length)
    share = (last - first) / (2 * reach) if reach else ((where + nudge > 0) & (where + nudge < length)).astype(float)
    s = np.clip(begin + (first + last) / 2 * pair.base_pitch, begin, end)
    across = np.tile(z, len(pairs))[None, :]
    gap = _gaps(pair, s, across)
    grid = np.linspace(begin, end, _ALONG)
    teeth, depth = np.zeros_like(s), []
    helix = cos(pair.pinion.base_helix_angle)
    for gear, way in ((pair.pinion, grid), (pair.wheel, pair.tangent_length - grid)):
        radius = np.hypot(way, gear.base_diameter / 2)
        found, deep = Tooth(gear).compliance(gear.sign * (radius - gear.reference_diameter / 2))
        teeth = teeth + np.interp(s, grid, found)
        depth.append(np.interp(s, grid, deep))
    far = pair.tangent_length - s
    rho = np.abs(s * far / pair.tangent_length) / helix
    width = pair.face_width / slices
    # k_t = k_n cos^2(beta_b) over the length of contact, width / cos(beta_b)
    widths = width * np.maximum(share, _LEAST)
    return _Contacts(share > _LEAST, teeth / (widths * helix), gap, (depth[0], depth[1]), rho, widths)


def _gaps(pair: GearPair, s: Array, across: Array) -> Array:
    """Material missing at places along the line of action and across the face [m]."""
    begin, end = pair.path
    gap = pair.pitch_error * (s - (begin + end) / 2) / pair.base_pitch
    for gear, from_tip in ((pair.pinion, end - s), (pair.wheel, s - begin)):
        gap = gap + gear.crowning * (2 * across) ** 2
        if gear.tip_relief:
            length = relief_length(pair, gear)
            gap = gap + gear.tip_relief * np.maximum(1 - from_tip / length, 0.0)
    return gap


def relief_length(pair: GearPair, gear: Gear) -> float:
    """Length of the tip relief along the line of action [m]; by default to where the fewest pairs begin."""
    if gear.tip_relief_length is not None:
        return gear.tip_relief_length
    return max(pair.contact_ratio % 1.0, 0.1) * pair.base_pitch


def _balanced(pair: GearPair, c: _Contacts, force: float) -> tuple[Array, Array]:
    """Displacement delta (N,) under the force, and dF/d(delta) there.

    The contact's compliance is that of the load last found; within, the sum of springs with gaps is piecewise linear in
    delta and solved by Newton's method, which ends on the right piece.
    """
    load = np.where(c.there, force / np.maximum(c.there.sum(axis=1, keepdims=True), 1), 0.0)
    delta = np.zeros(len(load))
    for _ in range(200):
        contact, _ = _hertz(pair, c, np.maximum(load, _LEAST * force))
        k = np.where(c.there, 1 / (c.teeth + contact), 0.0)
        found = _of_springs(k, np.where(c.there, c.gap, np.inf), force)
        load = np.where(c.there, k * np.maximum(found[:, None] - c.gap, 0.0), 0.0)
        done = bool(np.all(np.abs(found - delta) <= _TIGHT * np.abs(found).max()))
        delta = found
        if done:
            break
    contact, change = _hertz(pair, c, np.maximum(load, _LEAST * force))
    stiff = np.where(load > 0, 1 / np.maximum(c.teeth + contact - change, 0.5 * c.teeth), 0.0)
    return delta, np.sum(stiff, axis=1)


def _of_springs(k: Array, gap: Array, force: float) -> Array:
    """delta (N,) of sum_i k_i max(delta - g_i, 0) = F, from the smallest gap up."""
    order = np.argsort(gap, axis=1)
    g = np.take_along_axis(gap, order, axis=1)
    ks = np.take_along_axis(k, order, axis=1)
    stiff = np.cumsum(ks, axis=1)
    with np.errstate(invalid="ignore"):
        moment = np.cumsum(np.where(np.isfinite(g), ks * g, 0.0), axis=1)
        tried = (force + moment) / stiff  # with the first j of them in contact
        following = np.concatenate([g[:, 1:], np.full((len(g), 1), np.inf)], axis=1)
    right = np.argmax(tried <= following, axis=1)
    out: Array = tried[np.arange(len(g)), right]
    return out


def _hertz(pair: GearPair, c: _Contacts, load: Array) -> tuple[Array, Array]:
    """Compliance c_h of the contacts in the transverse plane, and -F dc_h/dF, by which the tangent is smaller."""
    helix = cos(pair.pinion.base_helix_angle)
    length = c.widths / helix
    elastic = [(1 - gear.poisson**2) / gear.E for gear in (pair.pinion, pair.wheel)]
    line = np.maximum(
        load / helix / length, 1.0
    )  # N/m, normal to the flank; of a load of nothing, a number all the same
    a = np.sqrt(4 / pi * line * np.maximum(c.rho, 1e-9) * sum(elastic))
    total = np.zeros_like(load)
    for gear, soft, deep in zip((pair.pinion, pair.wheel), elastic, c.depth, strict=True):
        logs = np.log(np.maximum(2 * deep / a, 1.5))
        total = total + soft * (logs - gear.poisson / (2 * (1 - gear.poisson)))
    scale = 2 / (pi * c.widths * helix)
    return scale * total, scale * sum(elastic) / 2
