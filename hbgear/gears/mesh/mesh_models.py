"""Models of the mesh of a gear pair at a torque: pairs of teeth, or one stiffness and one transmission error.

    "teeth"     sum_j k_j(tau) max(x - g_j(tau), 0) - sum_j k_j(tau) max(-x - 2 b - g_j(tau), 0)
    "secant"    k = F / (delta - min_i g_i),   e = min_i g_i
    "tangent"   k = dF/d(delta),               e = delta - F / k

"teeth" is the default. Every pair of teeth has its own stiffness and gap on both flanks, which is correct at every
load. The other two replace all pairs by one stiffness k(tau) and one error e(tau) at the static load F, with the static
deflection delta. They equal "teeth" without relief, crowning and pitch error. With them, "tangent" is correct for
vibration in which no gap opens or closes that is not open or closed under the static load, and "secant" has the correct
static force and loss of contact only.

The damping ratio refers to the stiffness k_0 of the drawing in all models: the mean of the sum of the stiffness of all
pairs of teeth with closed gaps, c = 2 zeta sqrt(m_c k_0). With tables of other programs it refers to their mean
stiffness.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from hbgear.common.text.messages import quoted
from hbgear.gears.drawing.tooth_errors import has_errors
from hbgear.gears.mesh.mesh_cycle import MeshCycle
from hbgear.gears.mesh.tooth_friction import Friction, checked_friction, friction_mesh
from hbgear.gears.mesh.tooth_mesh import tooth_mesh
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.series.periodic import Phased

if TYPE_CHECKING:
    from hbgear.gears.drawing.pair import GearPair

MESHES = ("teeth", "secant", "tangent")
"""Names of the models of the mesh, the default first."""


class MeshModel(NamedTuple):
    """Mesh of a gear pair in SI units.

    Attributes
    ----------
    k_mean : float
        Unit of the stiffness [N/m]: its mean; for contacts, k_0.
    k_0 : float
        Stiffness to which the damping ratio refers [N/m].
    stiffness, error : Phased or None
        k(tau) / k_mean and e(tau) [m] without jumps; None for contacts.
    contacts : MeshContacts or None
        Contacts without backlash, in units of k_mean and m; None for one stiffness.
    load, output : float
        Static state with friction between the teeth, see `hbgear.gears.mesh.tooth_friction.FrictionMesh`.
    """

    k_mean: float
    k_0: float
    stiffness: Phased | None = None
    error: Phased | None = None
    contacts: MeshContacts | None = None
    load: float = 1.0
    output: float = 1.0


def mesh_model(
    owner: str, pair: GearPair, torque: float, mesh: str | None, cycle: MeshCycle | None, friction: Friction, side: int
) -> MeshModel:
    """Return the mesh of a pair under a torque; the module docstring describes the models.

    The torque on the pinion [N m] is positive. The model is "teeth" (None), "secant" or "tangent"; a ``cycle`` are
    tables instead. The loaded ``side`` is -1 if the wheel drives, else 1. ValueError, in the name of the ``owner``, is
    raised if the name is unknown, both a name and tables are given, the torque is not positive, or there is friction or
    errors of single teeth without pairs of teeth.
    """
    if torque <= 0:
        raise ValueError(
            f"{owner}: torque = {torque:g} N m must be positive: the mesh is computed under this load; "
            "signs are those of the torques of the wheels"
        )
    friction = checked_friction(owner, friction)
    if cycle is not None or mesh not in (None, "teeth"):
        source = "a cycle" if cycle is not None else f"mesh = {quoted(mesh)}"
        if friction:
            raise ValueError(
                f"{owner}: friction needs the force on every pair of teeth, and {source} has one for "
                "all; give mesh='teeth', or friction=0"
            )
        if has_errors(pair.pinion) or has_errors(pair.wheel):
            raise ValueError(
                f"{owner}: pitch_errors and runout of gears need the pairs of teeth, and {source} has one gap "
                "for all; give mesh='teeth', or gears without these errors"
            )
    if mesh is not None and mesh not in MESHES:
        raise ValueError(f"{owner}: mesh = {quoted(mesh)} must be one of {', '.join(MESHES)}")
    if cycle is not None:
        if mesh is not None:
            raise ValueError(f"{owner}: mesh = {quoted(mesh)} and a cycle are both given; keep one")
        k_mean, stiffness, error = cycle.functions(pair.transverse_force(torque))
        return MeshModel(k_mean, k_mean, stiffness, error)
    teeth = tooth_mesh(pair, torque)
    if friction:
        friction_fields = friction_mesh(teeth, friction, side)
        return MeshModel(teeth.stiffness, teeth.stiffness, None, None, *friction_fields)
    if mesh in (None, "teeth"):
        return MeshModel(teeth.stiffness, teeth.stiffness, contacts=teeth.contacts(1.0))
    k_mean, stiffness, error = pair.mesh(torque, linearized=mesh).functions(teeth.force)
    return MeshModel(k_mean, teeth.stiffness, stiffness, error)
