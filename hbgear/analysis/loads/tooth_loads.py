"""Loads of single pairs of teeth in a periodic motion of a tooth-resolved mesh.

    factor = max F_p / max F_static            over all pairs p, slices and positions u on the path of contact
    sigma_p(u) = cos(alpha_t) / (b m_n) sum_l F_pl(u) Y_F(u_l) Y_S(u_l)
    root factor = max sigma_p / max sigma_static

F_pl are the forces on the slices l of pair p along the line of action (`hbgear.gears.mesh.tooth_forces`); F_static is
the force of a pair in the static state of the same mesh. sigma is the nominal root stress of ISO 6336-3 with the form
factors at the position of each slice (`hbgear.gears.drawing.root_stress`), averaged over the face width b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.gears.drawing.root_stress import root_factors
from hbgear.gears.mesh.mesh_excitation import contacts_in_order
from hbgear.gears.mesh.tooth_contacts import Flank
from hbgear.gears.mesh.tooth_forces import STEPS_PER_MESH, PairForces, pair_forces, static_displacement
from hbgear.gears.mesh.tooth_mesh import ToothMesh, tooth_centre
from hbgear.harmonic.equations.layout import layout_of
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.series.fourier import evaluate
from hbgear.mechanics.series.piecewise_polynomial import TURN

COARSE_STEPS = 32
"""Positions per mesh period of estimates of the largest loads."""

COMPARED_PHASES, UNIT_ROUNDING = 256, 1e-9
"""Phases at which the contacts of a model are compared with a mesh, and their largest difference by rounding."""


@dataclass(frozen=True, eq=False)
class ToothLoads:
    """Loads of the M pairs of teeth that enter contact within a period, at P positions on their path.

    Attributes
    ----------
    forces : PairForces
        Forces of all pairs and slices [N] and the displacement [m].
    static : PairForces
        The same in the static state, of one pair without errors of single teeth.
    root_stress, static_root_stress : ndarray, shape (2, M, P) and (2, 1, P)
        Nominal root stress of the pinion and of the wheel [N/m^2]; nan for a ring gear.
    side : {1, -1}
        Flanks that carry the mean load: -1 for the back flanks, under a negative torque. They are then the driving
        flanks of ``forces``, whose displacement has the opposite sign.

    Examples
    --------
    >>> import hbgear as hb
    >>> [name for name in ("force", "share", "force_factor", "root_factor") if hasattr(hb.analysis.ToothLoads, name)]
    ['force', 'share', 'force_factor', 'root_factor']
    """

    forces: PairForces
    static: PairForces
    root_stress: Array
    static_root_stress: Array
    side: int = 1

    @property
    def position(self) -> Array:
        """Position on the path of contact [mesh periods], shape (P,)."""
        return self.forces.position

    @property
    def force(self) -> Array:
        """Force on the loaded flanks of each pair [N], shape (M, P)."""
        return self.forces.force

    @property
    def back(self) -> Array:
        """Force on the other flanks of each pair [N], shape (M, P)."""
        return self.forces.back.sum(axis=0)

    @property
    def share(self) -> Array:
        """Part of each pair in the mesh force at the same time, shape (M, P)."""
        return self.forces.share

    @property
    def largest(self) -> tuple[int, float]:
        """Pair with the largest force, counted from 0, and the position of this force [mesh periods]."""
        pair, index = np.unravel_index(int(np.argmax(self.force)), self.force.shape)
        return int(pair), float(self.position[index])

    @property
    def force_factor(self) -> float:
        """Largest force of a pair over its largest static force."""
        return float(self.force.max() / self.static.force.max())

    @property
    def root_factor(self) -> tuple[float, float]:
        """Largest root stress of the pinion and of the wheel over the largest static one; nan for a ring gear."""
        pinion, wheel = (self.root_stress.max(axis=(1, 2)) / self.static_root_stress.max(axis=(1, 2))).tolist()
        return pinion, wheel

    @property
    def separated(self) -> Array:
        """Part of its static path of contact on which each pair is not in contact, shape (M,)."""
        path = self.static.force[0] > 0
        return np.mean(self.force[:, path] <= 0, axis=1)

    @property
    def back_contact(self) -> Array:
        """Duration of the contact of each pair on its flank without mean load [mesh periods], shape (M,)."""
        return np.sum(self.back > 0, axis=1) * float(self.position[1] - self.position[0])


@checked_arguments()
def tooth_loads(point: Point, mesh: ToothMesh, element: int | str = 0) -> ToothLoads:
    """Compute the loads of single pairs of teeth; see the equations in the module header.

    Parameters
    ----------
    point : Point
        Point of a branch of a model with this mesh, ``pair.model(torque, damping, mesh="teeth")``.
    mesh : ToothMesh
        The mesh, from ``hb.gears.tooth_mesh(pair, torque)``.
    element : int or str, optional
        Element by number or name. The default is the first element.

    Returns
    -------
    ToothLoads
        Forces and root stresses over the path of contact.

    Raises
    ------
    ValueError
        If the point has no problem, or its element has not the contacts of this mesh.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> pair = hb.GearPair(pinion, wheel, backlash="80 um")
    >>> problem = hb.HarmonicBalance(pair.model("200 N m", 0.04, mesh="teeth"), 12)
    >>> curve = hb.trace(problem, "Omega", (1.5, 1.4), stability=False, special=False)
    >>> loads = hb.analysis.tooth_loads(curve[0], hb.gears.tooth_mesh(pair, "200 N m"))
    >>> round(loads.force_factor, 2), loads.separated.tolist()
    (0.71, [0.0])
    """
    motion = _Motion(point, mesh, element)
    side_forces = {side: motion.forces(point, side) for side in (1, -1)}
    side = 1 if side_forces[1].drive.sum() >= side_forces[-1].drive.sum() else -1
    b, flanks = mesh.pair.half_backlash, _loaded(mesh.flanks, side)
    phase, delta = static_displacement(flanks, mesh.force, b)
    static = pair_forces(flanks, lambda t: np.interp(t, phase, delta, period=1.0), 1, b)
    stress, static_stress = (
        _root_stress(forces, _stress_per_force(mesh, forces.position, side)) for forces in (side_forces[side], static)
    )
    return ToothLoads(side_forces[side], static, stress, static_stress, side)


def load_estimates(branch: Branch, numbers: Sequence[int], mesh: ToothMesh, side: int) -> Array:
    """Return the largest loads of the first element at few positions, to select motions for `tooth_loads`.

    The mesh does not change along the branch; ``numbers`` are numbers of its points, and ``side`` is -1 for the back
    flanks, else 1. Each row of the result (len(numbers), 3) is the largest force of a pair [N] and the root stress of
    pinion and wheel [N/m^2]; nan for a ring gear.
    """
    motion = _Motion(branch[numbers[0]], mesh, 0)
    forces = [motion.forces(branch[i], side, COARSE_STEPS) for i in numbers]
    factors = _stress_per_force(mesh, forces[0].position, side)
    return np.array([[pairs.force.max(), *_root_stress(pairs, factors).max(axis=(1, 2))] for pairs in forces])


class _Motion:
    """Displacement of an element that has the contacts of a mesh, in metres over the time in mesh periods."""

    def __init__(self, point: Point, mesh: ToothMesh, element: int | str) -> None:
        layout = layout_of(point)
        if layout is None or point.problem is None or point.problem.model is None:
            raise ValueError(
                "tooth_loads: the point has no model; give a point of a traced branch of a HarmonicBalance"
            )
        model = point.problem.model.at(point.parameters)
        model = getattr(model, "equations", model)
        self.mesh, self.index, scales = mesh, layout.index(element), model.scales
        law, order = model.system().elements[self.index].law, getattr(model, "mesh_order", 1)
        b, contacts = mesh.pair.half_backlash, mesh.contacts(1.0)
        length = b if scales is None else scales.length
        stiffness = 1.0 if scales is None else mesh.stiffness * length / scales.force
        self.length, self.meshes = length, layout.nu * order
        flanks = mesh.flanks_with_errors(self.meshes)
        self.flanks = {side: _loaded(flanks, side) for side in (1, -1)}
        scaled = contacts.scaled(stiffness, 1 / length).widened(b / length)
        if (
            not isinstance(law, MeshContacts)
            or order % contacts.meshes
            or not _are_equal(law.normal, contacts_in_order(scaled, order))
        ):
            raise ValueError(
                f"tooth_loads: the element {quoted(layout.elements[self.index])} has not the contacts of this mesh; "
                'give the tooth_mesh of the same pair and torque as the model, and build the model with mesh="teeth"'
            )

    def forces(self, point: Point, side: int, steps: int = STEPS_PER_MESH) -> PairForces:
        """Return the forces at a point; the flanks of a side are the driving ones."""
        row = side * self.length * point.coefficients(self.index)

        def displacement(t: Array) -> Array:
            return evaluate(row, TURN * t / self.meshes)

        return pair_forces(self.flanks[side], displacement, self.meshes, self.mesh.pair.half_backlash, steps)


def _are_equal(first: MeshContacts, second: MeshContacts) -> bool:
    """Return whether contacts are equal but for the rounding of their units, at some phases."""
    if [contact.side for contact in first.contacts] != [contact.side for contact in second.contacts]:
        return False
    phases = TURN * (np.arange(COMPARED_PHASES) + 0.3) / COMPARED_PHASES
    return all(
        np.allclose(one(phases), other(phases), rtol=UNIT_ROUNDING, atol=UNIT_ROUNDING)
        for pair in zip(first.contacts, second.contacts, strict=True)
        for one, other in zip(*((contact.stiffness, contact.level) for contact in pair), strict=True)
    )


def _loaded(flanks: Sequence[Flank], side: int) -> list[Flank]:
    """Return copies of the flanks in which the flanks of a side are the driving ones."""
    return [replace(flank, side=side * flank.side) for flank in flanks]


def _root_stress(forces: PairForces, factors: Array) -> Array:
    """Return the root stress of pinion and wheel [N/m^2], shape (2, M, P), for the factors of `_stress_per_force`."""
    return (forces.drive * factors).sum(axis=1)


def _stress_per_force(mesh: ToothMesh, position: Array, side: int) -> Array:
    """Return the root stress of pinion and wheel per force on each slice [1/m^2], shape (2, S, 1, P); nan for a ring.

    ``side`` is -1 for the back flanks, whose contact moves from the tip of the pinion to its root.
    """
    pair = mesh.pair
    begin, end = pair.path
    u = position - np.array([flank.lag for flank in mesh.flanks if flank.side == side])[:, None]
    s = np.clip(begin + (u if side > 0 else 2 * tooth_centre(pair) - u) * pair.base_pitch, begin, end)
    out = np.full((2, len(s), 1, len(position)), np.nan)
    for i, (gear, distance) in enumerate(((pair.pinion, s), (pair.wheel, pair.tangent_length - s))):
        if not gear.internal:
            factors = root_factors(gear, 2 * np.hypot(distance, gear.base_diameter / 2))
            scale = cos(gear.transverse_pressure_angle) / (pair.face_width * gear.module)
            out[i, :, 0] = scale * factors.form * factors.correction
    return out
