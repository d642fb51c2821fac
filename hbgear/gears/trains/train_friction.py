"""Friction between the teeth of a train: its directions, and the motion on which it does work.

    transverse (t, rho_P side) on the first wheel, -(t, ...) on the second one,   slide r_b1 side on both rotations

t is the direction of the surface velocity of the first wheel across the line of action, rho_P = r_b1 tan(alpha) its
radius of curvature at the pitch point. The mean speeds of all wheels are constant: the part of friction that turns the
whole train is removed, M phi (phi^T F) / (phi^T M phi), which changes no other motion. The torques of the wheels are
those of a train without losses.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import tan
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.gears.trains.train_kinematics import line_of_action
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.laws.vector_laws import SlidingTeeth
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.structures.elements import Element, VectorElement

if TYPE_CHECKING:
    from hbgear.gears.trains.train_components import Mesh, Wheel
    from hbgear.gears.trains.train_kinematics import Kinematics

HELD = 1e-9
"""Stiffness of the rotation of the train, over the largest one, below which nothing holds it."""


def friction_elements(
    mesh: Mesh, gap: Element, wheels: Mapping[str, Wheel], kinematics: Kinematics, number: int, onto: Any
) -> tuple[Element, ...]:
    """Return the elements "FIRST-SECOND friction 1" to 3 of mesh ``number`` in SI directions; none without friction.

    ``gap`` is the element of the mesh along its line of action; ``onto`` maps vectors (6,) of wheels by name to a
    dimensionless vector of all coordinates.
    """
    law = gap.law
    if not isinstance(law, MeshContacts) or law.sliding is None:
        return ()
    first, second, side = wheels[mesh.first], wheels[mesh.second], kinematics.sides[number]
    w = line_of_action(mesh, side, kinematics.angles[number], first, second)
    lever = tan(kinematics.angles[number][0])
    transverse = np.zeros((2, 6))
    for row, normal in zip(transverse, w, strict=True):
        row[:2] = side * np.array([-normal[1], normal[0]])
        row[5] = lever * normal[5]
    transverse /= np.hypot(w[0, 0], w[0, 1])
    slide = side * first.base_radius * np.eye(6)[5]
    directions = [
        gap.direction,
        onto({mesh.first: transverse[0], mesh.second: transverse[1]}),
        onto({mesh.first: slide, mesh.second: -slide}),
    ]
    displacements = (gap.displacement, Series(), Series())
    return VectorElement(directions, SlidingTeeth(law), name=f"{mesh.name} friction", displacements=displacements)


def without_rotation(vector: Array, turn: Array, M: Array, K: Array) -> Array:
    """Return a generalised force (n,) without the part that turns the whole train; itself if the rotation is held.

    ``turn`` (n,) is the displacement of the rotation, M and K (n, n) are mass and stiffness.
    """
    if np.abs(K @ turn).max() > HELD * np.abs(K).max() * np.abs(turn).max():
        return vector
    inertia = M @ turn
    return vector - inertia * ((turn @ vector) / (turn @ inertia))
