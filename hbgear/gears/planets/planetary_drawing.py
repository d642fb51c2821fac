"""Fields of a planetary set from the drawings of its two gear pairs.

    F = T / (N r_bs) on every mesh,   tau_n = 0 where a pair of teeth is at the pitch point in the middle of the face

All planets are equal, so that every mesh with the sun has the same contacts, delayed by its phase, and likewise every
mesh with the ring.
"""

from __future__ import annotations

from math import degrees, pi
from typing import Any

from hbgear.common.argument_checks import check
from hbgear.common.units import to_si
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.drawing.tooth_errors import error_period
from hbgear.gears.mesh.tooth_mesh import ToothMesh, tooth_mesh
from hbgear.mechanics.laws.mesh_contacts import MeshContacts


def drawn_fields(sun: GearPair, ring: GearPair, torque: Any, planets: int) -> dict[str, Any]:
    """Return the fields of a `PlanetarySet` from the pairs of sun and planet, and of planet and ring.

    The planets share the torque on the sun [N m] equally.

    Raises
    ------
    ValueError
        If the pairs do not have the same planet, the wheel of the second pair is not a ring, or a gear has errors of
        single teeth.
    """
    check("PlanetarySet.of", "sun", sun, GearPair)
    check("PlanetarySet.of", "ring", ring, GearPair)
    if not ring.wheel.internal or sun.wheel.internal:
        raise ValueError(
            "PlanetarySet.of: give the pair of sun and planet, then the pair of planet and ring, whose "
            "wheel is internal"
        )
    if sun.wheel.teeth != ring.pinion.teeth:
        raise ValueError(
            f"PlanetarySet.of: the planet has {sun.wheel.teeth} teeth at the sun and {ring.pinion.teeth} "
            "at the ring; give the same planet in both pairs"
        )
    if error_period(sun) > 1 or error_period(ring) > 1:
        raise ValueError(
            "PlanetarySet.of: a gear has pitch_errors or runout, and all planets are equal; give gears "
            "without these errors"
        )
    force = to_si("PlanetarySet.of", "torque", torque, "N m") / planets / sun.base_radii[0]
    meshes = tooth_mesh(sun, force * sun.base_radii[0]), tooth_mesh(ring, force * ring.base_radii[0])
    members = {"s": sun.pinion, "p": ring.pinion, "r": ring.wheel}
    return {
        "teeth_s": sun.pinion.teeth,
        "teeth_p": ring.pinion.teeth,
        "teeth_r": ring.wheel.teeth,
        "r_s": sun.base_radii[0],
        "torque": force * planets * sun.base_radii[0],
        **{f"m_{name}": gear.mass_used for name, gear in members.items()},
        **{f"J_{name}": 4 * gear.inertia_used / gear.base_diameter**2 for name, gear in members.items()},
        "alpha_s_deg": degrees(sun.working_pressure_angle),
        "alpha_r_deg": degrees(ring.working_pressure_angle),
        "eps_sp": (),
        "eps_rp": (),
        "k_sp": meshes[0].stiffness,
        "k_rp": meshes[1].stiffness,
        "b_sp": sun.half_backlash,
        "b_rp": ring.half_backlash,
        "thickness_p": (sun.thickness[1] + ring.thickness[0]) / 2,
        "contacts_sp": _contacts_at_pitch_point(sun, meshes[0]),
        "contacts_rp": _contacts_at_pitch_point(ring, meshes[1]),
    }


def _contacts_at_pitch_point(pair: GearPair, mesh: ToothMesh) -> MeshContacts:
    """Return contacts whose phase is zero where a pair of teeth is at the pitch point."""
    return mesh.contacts(1.0).changed(*[lambda function: function.shifted(-2 * pi * pair.pitch_position)] * 2)
