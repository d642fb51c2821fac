"""Tooth-resolved mesh of a drawing: stiffness and initial gap of a pair of teeth over its path of contact.

    k(u) = 1 / (c_1(u) + c_2(u) + c_h(u, F_static(u))),   g(u) = relief + crowning + pitch error,   u = tau / 2 pi - p

The compliances are those of `hbgear.gears.mesh.loaded_mesh`. The compliance c_h of the contact depends on its load; it
is evaluated at the load of the pair in the static equilibrium, and at no less than a tenth of an equal share of the
mesh force. For steel gears of module 1 to 10 mm, 18 to 200 teeth and 50 to 600 N/mm, the force of a pair at the same
displacement exceeds that of these contacts by 3.9 to 4.9 % at three times the load and by 5.2 to 6.5 % at 4.2 times;
at a third of the load it is 3.6 to 4.5 % smaller, at a tenth 7.3 to 8.9 %.

The back flank touches along the other line of action. A pair of teeth is symmetric about its middle: at the phase u_c
at which the tooth of the pinion lies on the line of centres, both flanks are at the same distance from the base circle.
The driving flank moves towards the tip of the pinion and the back flank towards its root:

    s(u) = s_A + u p_bt,   s_back(u) = s(2 u_c - u),   s(u_c) = r_b1 (tan(alpha_wt) + s_w1 / (2 r_w1))

s_w1 is the thickness of the tooth of the pinion on its working pitch circle. Slices of helical teeth follow each other
with a lag; the back flank of a slice is the driving flank of the opposite slice, mirrored. The part of a slice within
the path of contact grows linearly at the ends of the path. The gap is the mean over the contact line of a slice, so
that a slice comes into contact at once; the gradual contact of `hbgear.gears.mesh.loaded_mesh` is approached with the
number of slices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from math import ceil, tan
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.gears.drawing.tooth_errors import error_period, gap_waves, pair_gaps
from hbgear.gears.mesh.loaded_mesh import (
    Contacts,
    contact_compliance,
    contacts_at,
    cycle_phases,
    loading_torque,
    possible_contacts,
    relief_length,
    static_equilibrium,
)
from hbgear.gears.mesh.tooth_contacts import Flank, PathFunction, mesh_contacts
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.plausibility import warn
from hbgear.mechanics.series.piecewise_polynomial import integral

if TYPE_CHECKING:
    from hbgear.gears.drawing.pair import GearPair

STATIC_PHASES = 256
"""Steps of the mesh cycle at which the static equilibrium is computed."""

MIN_LOAD_SHARE = 0.1
"""Smallest load at which the contact compliance is evaluated, over an equal share of the mesh force."""

SECTION_POINTS = 65
"""Points at which each smooth section of the path is computed before it is fitted by cubics."""

CUBIC_FIT_TOLERANCE = 1e-5
"""Largest fit error: of the stiffness relative to its largest value, of the gap relative to the static displacement.
The backlash has no effect, so that the contacts of a model and those of `tooth_mesh` are equal."""

ONE_SIDED = 1e-8
"""Distance [mesh periods] from the end of a section at which its values are computed, because the load jumps there."""

SLICES_PER_OVERLAP, MIN_HELICAL_SLICES = 10, 10
"""Slices of helical teeth for an overlap ratio of one, and their smallest number. With 10 slices the jumps of a pair
with overlap ratio 0.55 and tip relief differ from those with 40 slices by less than 0.2 %."""

MIN_SHARED_PART = 0.15
"""Part of the contact ratio above one [-] that must carry load; with less the relief is probably too large for the
load."""

CROWNED_SLICES = 12
"""Slices of the face width of crowned or misaligned spur gears; those at equal distances from the middle are one
contact if the pair is aligned."""


@dataclass(frozen=True, eq=False)
class ToothMesh:
    """Contacts of a gear pair in SI units.

    Attributes
    ----------
    flanks : tuple of Flank
        Both flanks of all slices: stiffness [N/m] and initial gap [m] over the path of contact, without errors of
        single teeth.
    stiffness : float
        Mean of the sum of the stiffness of all pairs, with their gaps closed [N/m].
    force : float
        Static mesh force at which the compliance of the contacts was evaluated [N].
    pair : GearPair
        Gear pair.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> mesh = hb.gears.tooth_mesh(hb.GearPair(pinion, wheel, backlash="80 um"), "200 N m")
    >>> len(mesh.flanks), f"{mesh.stiffness:.3g}"
    (2, '3.95e+08')
    """

    flanks: tuple[Flank, ...]
    stiffness: float
    force: float
    pair: GearPair

    @property
    def meshes(self) -> int:
        """Number of meshes after which the errors of the teeth repeat; 1 without errors."""
        return error_period(self.pair)

    def flanks_with_errors(self, meshes: int) -> tuple[Flank, ...]:
        """Return the flanks with the gaps by run-out and by errors of single teeth of a number of pairs."""
        errors = {side: (pair_gaps(self.pair, side, meshes), gap_waves(self.pair, side)) for side in (1, -1)}
        return tuple(replace(flank, errors=errors[flank.side][0], waves=errors[flank.side][1]) for flank in self.flanks)

    def contacts(self, length: float) -> MeshContacts:
        """Return the contacts without backlash over a period, in units of a length [m] and of ``stiffness``.

        The period has the number of meshes after which the errors of the teeth repeat.
        """
        return _contacts(self, length)


@lru_cache(maxsize=16)  # a change of the damping or of the units of a model leaves them
def _contacts(mesh: ToothMesh, length: float) -> MeshContacts:
    meshes = mesh.meshes
    scaled = [flank.scaled(1 / mesh.stiffness, 1 / length) for flank in mesh.flanks_with_errors(meshes)]
    return mesh_contacts(scaled, meshes)


@checked_arguments()
def tooth_mesh(pair: GearPair, torque: Any, *, slices: int | None = None) -> ToothMesh:
    """Compute the contacts of a gear pair from its drawing; the module docstring states the equations.

    Parameters
    ----------
    pair : GearPair
        Gear pair.
    torque : float or str
        Torque on the pinion [N m], positive.
    slices : int or None, optional
        Number of slices of the face width. By default 10 for each unit of the overlap ratio of helical gears and at
        least 10, 12 for crowned or misaligned spur gears and 1 for other spur gears.

    Returns
    -------
    ToothMesh
        The contacts.

    Raises
    ------
    ValueError
        If the torque is not positive or the number of slices is not valid.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> mesh = hb.gears.tooth_mesh(hb.GearPair(pinion, wheel, backlash="80 um"), "200 N m")
    >>> f"{mesh.force:.4g}"
    '5676'
    """
    torque = loading_torque("tooth_mesh", torque)
    if slices is None:
        helical = max(MIN_HELICAL_SLICES, ceil(SLICES_PER_OVERLAP * pair.overlap_ratio)) if pair.overlap_ratio else 0
        slices = helical or (CROWNED_SLICES if pair.is_uneven else 1)
    counted("GearPair.model: slices", slices, 1_000)
    return _tooth_mesh(pair, torque, slices)


@lru_cache(maxsize=8)
def _tooth_mesh(pair: GearPair, torque: float, slices: int) -> ToothMesh:
    """Return the contacts; cached, because variants of a model and the mean-mesh models use the same ones."""
    force = pair.transverse_force(torque)
    path = _Path(pair, force, slices)
    symmetric = not pair.overlap_ratio and slices > 1 and not pair.misalignment
    factors = [2.0 if 2 * n + 1 < slices else 1.0 for n in range((slices + 1) // 2)] if symmetric else [1.0] * slices
    driving = [path.slice(number, factor) for number, factor in enumerate(factors)]
    opposite = driving if symmetric else driving[::-1]
    flanks: list[Flank] = []
    for (stiffness, gap), (back_stiffness, back_gap), lag in zip(driving, opposite, path.lag, strict=False):
        flanks.append(Flank(1, stiffness, gap, lag=lag))
        flanks.append(Flank(-1, back_stiffness.mirrored(path.centre), back_gap.mirrored(path.centre), lag=lag))
    path.check_sharing()
    mean = sum(integral(flank.stiffness.rows, np.diff(flank.stiffness.nodes)) for flank in flanks if flank.side > 0)
    return ToothMesh(tuple(flanks), mean, force, pair)


def tooth_centre(pair: GearPair) -> float:
    """Return the phase [mesh periods] at which the tooth of the pinion lies on the line of centres, u_c."""
    radius = pair.working_radii[0]
    thickness = pair.pinion.tooth_thickness(2 * radius)
    middle = pair.base_radii[0] * (tan(pair.working_pressure_angle) + thickness / (2 * radius))
    return float((middle - pair.path[0]) / pair.base_pitch)


def mirror_phase(pair: GearPair) -> float:
    """Return the phase c [mesh periods]: the mesh of the back flanks at tau is that of the driving flanks at c - tau.

    It is 2 u_c for each slice, and the last slice of the driving flanks is the first one of the back flanks.
    """
    return 2 * tooth_centre(pair) + pair.overlap_ratio


class _Path:
    """Stiffness and gap over the path of contact of the slices of a pair of teeth.

    Positions are in mesh periods from the beginning of the path. ``centre`` is the position at which the tooth of the
    pinion lies on the line of centres, ``lag`` the delay of each slice, ``displacement`` the mean static one [m].
    """

    def __init__(self, pair: GearPair, force: float, slices: int) -> None:
        self.pair, self.force, self.slices = pair, force, slices
        begin, end = pair.path
        self.length = (end - begin) / pair.base_pitch
        self.half_width = pair.overlap_ratio / (2 * slices)
        self.z = (np.arange(slices) + 0.5) / slices - 0.5
        self.lag = (pair.overlap_ratio * (self.z + 0.5)).tolist()
        self.centre = tooth_centre(pair)
        phase, side = cycle_phases(pair, STATIC_PHASES)
        delta, _, loads = static_equilibrium(pair, possible_contacts(pair, phase, side, slices), force)
        self.displacement = float(delta.mean())
        self.loads = loads.reshape(len(phase), -1, slices)
        self.phase = phase

    def check_sharing(self) -> None:
        """Warn if relief or pitch error leaves less than a part of the contact ratio of loaded spur teeth."""
        loaded = self.loads.sum(axis=2) > 0
        ratio = float(np.mean(loaded.sum(axis=1)))
        if self.pair.overlap_ratio or ratio - 1 >= MIN_SHARED_PART * (self.length - 1):
            return
        position = (self.phase[:, None] + np.arange(loaded.shape[1]))[loaded]
        radii = [
            np.hypot(self.pair.path[0] + x * self.pair.base_pitch, self.pair.base_radii[0])
            for x in (position.min(), min(position.max(), self.length))
        ]
        has_relief = self.pair.pinion.tip_relief or self.pair.wheel.tip_relief
        cause, remedy = ("relief", "the relief or its length") if has_relief else ("pitch error", "it")
        warn(
            f"GearPair: under the mesh force of {self.force:.4g} N the {cause} leaves a contact ratio of {ratio:.3f} "
            f"of {self.length:.3f}: a pair of teeth carries load only on diameters {2e3 * radii[0]:.4f} to "
            f"{2e3 * radii[1]:.4f} mm of the pinion; reduce {remedy}, or increase the torque"
        )

    def slice(self, number: int, factor: float) -> tuple[PathFunction, PathFunction]:
        """Return stiffness [N/m] and gap [m] of a slice, the stiffness times a factor."""
        pairs = np.arange(self.loads.shape[1])
        phases = (self.phase[:, None] + pairs - self.lag[number]).T.ravel()
        load = self.loads[:, :, number].T.ravel()
        cuts = self._cuts()
        nodes, stiffness, gap = [], [], []
        for a, b in pairwise(cuts):
            u = np.linspace(a, b, SECTION_POINTS)
            within = np.clip(u, a + ONE_SIDED, b - ONE_SIDED)
            nodes.append(u)
            stiffness.append(factor * self._stiffness_at(within, number, np.interp(within, phases, load)))
            gap.append(self._contacts_at(u, number)[0].gap[:, 0])
        largest = max(float(k.max()) for k in stiffness)
        return (
            PathFunction.fitted(nodes, stiffness, CUBIC_FIT_TOLERANCE * largest),
            PathFunction.fitted(nodes, gap, CUBIC_FIT_TOLERANCE * self.displacement),
        )

    def _cuts(self) -> Array:
        """Return the positions at which stiffness or gap may have breakpoints."""
        pair, h, length = self.pair, self.half_width, self.length
        cuts = [-h, h, length - h, length + h]
        for gear, from_end in ((pair.wheel, False), (pair.pinion, True)):
            if gear.tip_relief:
                x = relief_length(pair, gear) / pair.base_pitch
                cuts.append(length - x if from_end else x)
        if not pair.overlap_ratio:  # another pair enters or leaves contact
            cuts += [*range(1, ceil(length)), *(length - n for n in range(1, ceil(length)))]
        cuts = sorted(x for x in cuts if -h <= x <= length + h)
        return np.array([x for i, x in enumerate(cuts) if not i or x - cuts[i - 1] > 1e-7])

    def _contacts_at(self, u: Array, number: int) -> tuple[Contacts, Array]:
        """Return the contacts of a slice at positions, and the part of the slice that is on the path."""
        h = self.half_width
        first, last = np.clip(u - h, 0.0, self.length), np.clip(u + h, 0.0, self.length)
        part = (last - first) / (2 * h) if h else np.ones_like(u)
        z = np.full((len(u), 1), self.z[number])
        return contacts_at(self.pair, first[:, None], last[:, None], z, part[:, None], self.slices), part

    def _stiffness_at(self, u: Array, number: int, load: Array) -> Array:
        """Return the stiffness [N/m] of a slice at positions under loads [N]."""
        c, part = self._contacts_at(u, number)
        min_load = MIN_LOAD_SHARE * self.force / self.slices * part
        contact = contact_compliance(self.pair, c, np.maximum(load, min_load)[:, None])[0]
        return np.where(part > 0, 1 / (c.teeth + contact)[:, 0], 0.0)
