"""Models of a gear pair from its drawing: torsional, with bearings, or spatial.

    b_c = b,   omega_n = sqrt(k_mean/m_c),   F_m = T / (r_b1 k_mean b_c),   c = 2 zeta sqrt(m_c k_0)

All forms use the same mesh, `hbgear.gears.mesh.mesh_models`, which states k_mean and k_0, and lengths along the line of
action in the transverse plane.
"""

from __future__ import annotations

from math import degrees, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

from hbgear.common.argument_checks import check
from hbgear.common.ranges import NOT_NEGATIVE, Range
from hbgear.common.text.messages import quoted
from hbgear.common.units import QuantityField, to_si
from hbgear.gears.mesh.mesh_cycle import MeshCycle
from hbgear.gears.mesh.mesh_models import MeshModel, mesh_model
from hbgear.gears.pairs.helical import HelicalPair
from hbgear.gears.pairs.rotor_bearing import GearRotorBearing
from hbgear.gears.pairs.spur import SpurPair
from hbgear.gears.pairs.support import Support

if TYPE_CHECKING:
    from hbgear.gears.drawing.pair import GearPair
    from hbgear.mechanics.models import Model

FORMS = ("torsion", "bearings", "spatial")
"""Forms of a model: one degree of freedom; three, with bearings along the line of action; twelve."""

DAMPING = QuantityField("", NOT_NEGATIVE, Range(0, 1))
"""Damping ratio of a mesh."""
DAMPING.__set_name__(object, "damping")


class _Mesh(NamedTuple):
    """Data of the mesh that every form uses."""

    k_mean: float
    b_c: float
    fields: dict[str, Any]
    """Fields stiffness and error, or contacts, of the model."""


def build_model(
    pair: GearPair,
    torque: Any,
    damping: Any,
    form: str = "torsion",
    *,
    supports: tuple[Support, Support] | None = None,
    mesh: str | None = None,
    cycle: MeshCycle | None = None,
    direction: Any = 0.0,
) -> Model:
    """Return a model of a gear pair under a torque.

    Parameters
    ----------
    pair : GearPair
        Gear pair with backlash.
    torque : float or str
        Torque on the pinion [N m], positive.
    damping : float
        Damping ratio of the mesh. It refers to the mean stiffness of all pairs of teeth with closed gaps in all models
        of the mesh, and to the mean stiffness of tables.
    form : {"torsion", "bearings", "spatial"}, optional
        Form of the model: a `SpurPair` (default), a `GearRotorBearing` or a `HelicalPair`.
    supports : tuple of Support or None, optional
        Supports of pinion and wheel; required by the forms "bearings" and "spatial".
    mesh : {"teeth", "secant", "tangent"}, optional
        Model of the mesh: contacts of every pair of teeth (default), or one stiffness and one error by the secant or
        the tangent of the static load. `hbgear.gears.mesh.mesh_models` states where each is correct.
    cycle : MeshCycle or None, optional
        Tables of mesh stiffness and transmission error of another program instead of a computed mesh.
    direction : float or str, default 0.0
        Direction from the pinion to the wheel [rad], for the form "spatial".

    Raises
    ------
    ValueError
        If the form or a quantity is not valid, supports are missing, or there is no backlash.
    """
    if not isinstance(form, str) or form not in FORMS:
        raise ValueError(f"GearPair.model: form = {quoted(form)} must be one of {', '.join(FORMS)}")
    torque = to_si("GearPair.model", "torque", torque, "N m")
    zeta = DAMPING.read("GearPair.model", damping)
    check("GearPair.model", "cycle", cycle, MeshCycle | None)
    b_c = pair.half_backlash
    if b_c <= 0:
        raise ValueError(
            "GearPair.model: the pair has no backlash; give backlash, or a center_distance that leaves some"
        )
    found = mesh_model("GearPair.model", pair, torque, mesh, cycle)
    zeta *= sqrt(found.k_0 / found.k_mean)
    given = _Mesh(found.k_mean, b_c, _fields(found, b_c))
    if form == "torsion":
        if supports is not None:
            raise ValueError("GearPair.model: the form 'torsion' has no supports; give form='bearings' or 'spatial'")
        return _torsion(pair, torque, zeta, given)
    if supports is None or len(supports) != 2 or not all(isinstance(one, Support) for one in supports):
        raise ValueError(f"GearPair.model: the form {form!r} needs supports=(Support(...), Support(...)), of pinion "
                         "and wheel")  # fmt: skip
    if form == "bearings":
        return _bearings(pair, torque, zeta, given, supports)
    return _spatial(pair, torque, zeta, given, supports, to_si("GearPair.model", "direction", direction, "rad"))


def _fields(mesh: MeshModel, b_c: float) -> dict[str, Any]:
    """Return the fields of the model, in half backlashes."""
    fields: dict[str, Any] = {"eps": (), "e": ()}
    if mesh.contacts is not None:
        return {**fields, "contacts": mesh.contacts.scaled(1.0, 1 / b_c)}
    fields["stiffness"] = mesh.stiffness
    if mesh.error is not None and mesh.error.varies:
        fields["error"] = mesh.error.scaled(1 / b_c)
    return fields


def _reference(pair: GearPair, mesh: _Mesh) -> tuple[float, ...]:
    omega_n = sqrt(mesh.k_mean / pair.equivalent_mass)
    return omega_n, mesh.b_c, mesh.k_mean * mesh.b_c, float(pair.pinion.teeth)


def _torsion(pair: GearPair, torque: float, zeta: float, mesh: _Mesh) -> SpurPair:
    F_m = pair.transverse_force(torque) / (mesh.k_mean * mesh.b_c)
    return SpurPair(zeta=zeta, F_m=F_m, reference=_reference(pair, mesh), **mesh.fields)


def _bearings(
    pair: GearPair, torque: float, zeta: float, mesh: _Mesh, supports: tuple[Support, Support]
) -> GearRotorBearing:
    reference, m_c = _reference(pair, mesh), pair.equivalent_mass
    omega_n, b_c = reference[:2]
    fields: dict[str, Any] = {}
    for i, (gear, support) in enumerate(zip((pair.pinion, pair.wheel), supports, strict=True), 1):
        m = gear.mass_used
        kappa = support.stiffness / (m * omega_n**2)
        fields |= {
            f"mu_{i}": m_c / m, f"kappa_{i}": kappa, f"zeta_{i}": support.damping * sqrt(kappa),
            f"b_{i}": support.clearance / b_c, f"F_{i}": support.preload / (m * b_c * omega_n**2),
        }  # fmt: skip
    F_m = pair.transverse_force(torque) / (mesh.k_mean * b_c)
    return GearRotorBearing(zeta=zeta, F_m=F_m, reference=reference, **fields, **mesh.fields)


def _spatial(
    pair: GearPair, torque: float, zeta: float, mesh: _Mesh, supports: tuple[Support, Support], direction: float
) -> HelicalPair:
    fields: dict[str, Any] = {}
    for name, gear, support in zip("pg", (pair.pinion, pair.wheel), supports, strict=True):
        if support.tilt is None:
            raise ValueError("GearPair.model: the form 'spatial' needs the tilt stiffness of both supports [N m/rad]; "
                             "of two bearings a distance s apart it is stiffness s^2/4")  # fmt: skip
        if support.clearance or support.preload:
            raise ValueError("GearPair.model: the form 'spatial' has no clearance or preload in its supports; "
                             "form='bearings' has")  # fmt: skip
        fields |= {
            f"r_{name}": gear.base_diameter / 2, f"teeth_{name}": gear.teeth, f"m_{name}": gear.mass_used,
            f"I_{name}": gear.inertia_used, f"D_{name}": gear.transverse_inertia, f"k_{name}": support.stiffness,
            f"k_{name}z": support.axial, f"k_{name}t": support.tilt, f"zeta_{name}": support.damping,
        }  # fmt: skip
    return HelicalPair(
        zeta=zeta, torque=torque, k_mean=mesh.k_mean, b_c=mesh.b_c, internal=pair.wheel.internal,
        alpha_deg=degrees(pair.working_pressure_angle), beta_deg=degrees(pair.pinion.base_helix_angle),
        phi_deg=degrees(direction), **fields, **mesh.fields,
    )  # fmt: skip
