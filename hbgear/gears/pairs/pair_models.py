"""Models of a gear pair from its drawing: torsional, with bearings, or spatial.

    b_c = b,   omega_n = sqrt(k_mean/m_c),   F_m = T / (r_b1 k_mean b_c),   c = 2 zeta sqrt(m_c k_0)

All forms use the same mesh, `hbgear.gears.mesh.mesh_models`, which states k_mean and k_0, and lengths along the line of
action in the transverse plane.

A torque with shaft orders has the harmonics T_j cos(o_j theta + phase_j) of the angle theta = tau / z_1 of the pinion.
Omega is then the largest common frequency of mesh and orders, the mesh has the order p, and the mesh is computed at the
root mean square of the torque. The load on the relative rotation is the share (r_b1^2/J_1) m_c of T_j / r_b1.

Errors of single teeth and run-out repeat after some meshes (`hbgear.gears.drawing.tooth_errors`): then Omega is the
largest common frequency of them, too.

A negative torque loads the back flank: the wheel drives, and F_m < 0. A pair of teeth is symmetric about its middle, so
that the back flank at the phase tau is the driving flank at 2 tau_c - tau, where tau_c is the phase at which the tooth
of the pinion lies on the line of centres in the middle of the face width: k(2 tau_c - tau) and -e(2 tau_c - tau)
replace a mean mesh.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import cos, degrees, pi, sin, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hbgear.common.argument_checks import check, checked_arguments
from hbgear.common.ranges import NOT_NEGATIVE, Range
from hbgear.common.text.messages import quoted
from hbgear.common.units import QuantityField, to_si
from hbgear.gears.mesh.mesh_cycle import MeshCycle
from hbgear.gears.mesh.mesh_models import MeshModel, mesh_model
from hbgear.gears.mesh.tooth_mesh import mirror_phase
from hbgear.gears.pairs.helical import HelicalPair
from hbgear.gears.pairs.rotor_bearing import GearRotorBearing
from hbgear.gears.pairs.spur import SpurPair
from hbgear.gears.pairs.support import Support
from hbgear.gears.torque_orders import TorqueOrders, common_divisor, effective_torque, exact_order
from hbgear.gears.torque_orders import torque_orders as checked_orders
from hbgear.mechanics.series.fourier import Series

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
    """Unit of the stiffness [N/m]: the mean stiffness by default."""
    b_c: float
    """Unit of length [m]: half the backlash by default."""
    load: float
    """Load of the relative rotation over T / r_b1."""
    output: float
    """Power of the wheel over that of the pinion in the static state."""
    fields: dict[str, Any]
    """Fields b, stiffness and error, or contacts, of the model."""


@checked_arguments()
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
    torque_orders: Any = (),
    units: tuple[float, float] | None = None,
    friction: Any = 0.0,
) -> Model:
    """Return a model of a gear pair under a torque.

    Parameters
    ----------
    pair : GearPair
        Gear pair with backlash.
    torque : float or str
        Mean torque on the pinion [N m]. It is negative if the wheel drives, so that the back flanks are loaded, and may
        be zero if torque_orders are given.
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
    torque_orders : mapping, optional
        Harmonics of the torque on the pinion by order of its rotation, such as ``{2: "60 N m"}``, or ``{2: ("60 N m",
        "30 deg")}`` with a phase; see `hbgear.gears.torque_orders`.
    units : tuple of float, optional
        Angular frequency [rad/s] of Omega = 1 and unit of length [m], default omega_n and b_c of this pair.
    friction : float or BenedictKelley, optional
        Coefficient of friction between the teeth, which needs the pairs of teeth of ``mesh="teeth"``; see
        `hbgear.gears.mesh.tooth_friction`. Default 0.

    Raises
    ------
    ValueError
        If the form or a quantity is not valid, supports are missing, or there is no backlash.
    """
    if not isinstance(form, str) or form not in FORMS:
        raise ValueError(f"GearPair.model: form = {quoted(form)} must be one of {', '.join(FORMS)}")
    if pair.wheel.rack and form != "torsion":
        raise ValueError(
            f"GearPair.model: the form {form!r} has a wheel that turns, and this wheel is a rack, which "
            "moves along its length only; give form='torsion'"
        )
    torque = to_si("GearPair.model", "torque", torque, "N m")
    zeta = DAMPING.read("GearPair.model", damping)
    check("GearPair.model", "cycle", cycle, MeshCycle | None)
    b_c = pair.half_backlash
    if b_c <= 0:
        raise ValueError(
            "GearPair.model: the pair has no backlash; give backlash, or a center_distance that leaves some"
        )
    orders = checked_orders("GearPair.model", torque_orders)
    if not torque and not any(amplitude for _, amplitude, _ in orders):
        raise ValueError(
            "GearPair.model: torque = 0 N m: the mesh is computed under load; give a torque, or "
            "torque_orders of a torque without a mean"
        )
    # the mesh of pairs that differ in backlash is computed once
    shape = pair if pair.center_distance is not None else replace(pair, backlash=None)
    side = 1 if torque >= 0 else -1
    mesh_data = mesh_model("GearPair.model", shape, effective_torque(torque, orders), mesh, cycle, friction, side)
    k_unit, length = mesh_data.k_mean, b_c
    if units is not None:
        k_unit, length = pair.equivalent_mass * units[0] ** 2, units[1]
    zeta *= sqrt(mesh_data.k_0 / k_unit)
    fields = _fields(mesh_data if torque >= 0 else _on_back_flanks(mesh_data, pair), mesh_data.k_mean / k_unit, length)
    fields["b"] = b_c / length
    meshes = 1 if mesh_data.contacts is None else mesh_data.contacts.meshes
    varying = _fluctuation(pair, orders, meshes, k_unit * length, form)
    scaled_mesh = _Mesh(k_unit, length, mesh_data.load, mesh_data.output, fields | varying)
    if form == "torsion":
        if supports is not None:
            raise ValueError("GearPair.model: the form 'torsion' has no supports; give form='bearings' or 'spatial'")
        return _torsion(pair, torque, zeta, scaled_mesh)
    if supports is None or len(supports) != 2 or not all(isinstance(support, Support) for support in supports):
        raise ValueError(_NO_SUPPORTS.format(form=form, more=_SPATIAL_KEYS if form == "spatial" else ""))
    if form == "bearings":
        return _bearings(pair, torque, zeta, scaled_mesh, supports)
    return _spatial(pair, torque, zeta, scaled_mesh, supports, to_si("GearPair.model", "direction", direction, "rad"))


def _on_back_flanks(mesh: MeshModel, pair: GearPair) -> MeshModel:
    """Return a mean mesh whose loaded flanks are the back flanks; contacts have both flanks."""
    if mesh.stiffness is None:
        return mesh
    shift = 2 * pi * mirror_phase(pair)
    error = None if mesh.error is None else mesh.error.reversed().shifted(shift).scaled(-1.0)
    return mesh._replace(stiffness=mesh.stiffness.reversed().shifted(shift), error=error)


def _fluctuation(pair: GearPair, orders: TorqueOrders, meshes: int, force: float, form: str) -> dict[str, Any]:
    """Return the fields of contacts with a period of some meshes and of a torque with shaft orders.

    Forces are over a unit of force [N].
    """
    if not orders:
        return {"mesh_order": meshes} if meshes > 1 else {}
    fractions = [exact_order("GearPair.model", order) / pair.pinion.teeth for order, _, _ in orders]
    base = Fraction(1, meshes)
    for fraction in fractions:
        base = common_divisor(base, fraction)
    radius = pair.base_radii[0]
    inertia_ratio = 1.0 if form == "spatial" else pair.equivalent_mass * radius**2 / pair.pinion.inertia_used
    row = np.zeros((2, max(int(fraction / base) for fraction in fractions)))
    for fraction, (_, amplitude, phase) in zip(fractions, orders, strict=True):
        size = inertia_ratio * amplitude / (radius * force)
        row[:, int(fraction / base) - 1] = size * cos(phase), -size * sin(phase)
    return {"mesh_order": int(1 / base), "fluctuation": Series(0.0, tuple(row[0]), tuple(row[1]))}


def _fields(mesh: MeshModel, stiffness: float, length: float) -> dict[str, Any]:
    """Return the fields of the model, with a factor of the stiffness and in a unit of length [m]."""
    fields: dict[str, Any] = {"eps": (), "e": ()}
    if mesh.contacts is not None:
        return {**fields, "contacts": mesh.contacts.scaled(stiffness, 1 / length)}
    assert mesh.stiffness is not None
    fields["stiffness"] = mesh.stiffness if stiffness == 1 else mesh.stiffness.scaled(stiffness)
    if mesh.error is not None and mesh.error.varies:
        fields["error"] = mesh.error.scaled(1 / length)
    return fields


def _reference(pair: GearPair, mesh: _Mesh) -> tuple[float, ...]:
    omega_n = sqrt(mesh.k_mean / pair.equivalent_mass)
    return omega_n, mesh.b_c, mesh.k_mean * mesh.b_c, float(pair.pinion.teeth)


def _torsion(pair: GearPair, torque: float, zeta: float, mesh: _Mesh) -> SpurPair:
    F_m = mesh.load * pair.transverse_force(torque) / (mesh.k_mean * mesh.b_c)
    return SpurPair(zeta=zeta, F_m=F_m, reference=_reference(pair, mesh), **mesh.fields)


def _bearings(
    pair: GearPair, torque: float, zeta: float, mesh: _Mesh, supports: tuple[Support, Support]
) -> GearRotorBearing:
    """Return the pair on bearings with clearance."""
    reference, m_c = _reference(pair, mesh), pair.equivalent_mass
    omega_n, b_c = reference[:2]
    fields: dict[str, Any] = {}
    for i, (gear, support) in enumerate(zip((pair.pinion, pair.wheel), supports, strict=True), 1):
        m = gear.mass_used
        kappa = support.stiffness / (m * omega_n**2)
        fields |= {
            f"mu_{i}": m_c / m,
            f"kappa_{i}": kappa,
            f"zeta_{i}": support.damping * sqrt(kappa),
            f"b_{i}": support.clearance / b_c,
            f"F_{i}": support.preload / (m * b_c * omega_n**2),
        }
    F_m = mesh.load * pair.transverse_force(torque) / (mesh.k_mean * b_c)
    return GearRotorBearing(zeta=zeta, F_m=F_m, reference=reference, **fields, **mesh.fields)


_SPATIAL_KEYS = ', axial = "3e8 N/m", tilt = "4e5 N m/rad"'


_IN_A_FILE = 'In a file: support.pinion = {{ stiffness = "6e8 N/m"{more} }}, and the same for support.wheel.'


_NO_SUPPORTS = f"""GearPair.model: the form {{form!r}} needs a support of the pinion and one of the wheel: \
supports=(Support(...), Support(...)). {_IN_A_FILE}"""
"""Message for a form without supports."""


_NO_TILT = f"""GearPair.model: the form 'spatial' needs the key tilt in both supports, which is stiffness s^2/4 of two \
bearings a distance s apart; axial is 0 by default, which suits spur gears only. \
{_IN_A_FILE.format(more=_SPATIAL_KEYS)}"""
"""Message for supports without tilt stiffness."""


def _spatial(
    pair: GearPair, torque: float, zeta: float, mesh: _Mesh, supports: tuple[Support, Support], direction: float
) -> HelicalPair:
    """Return the pair with twelve degrees of freedom."""
    fields: dict[str, Any] = {}
    for name, gear, support in zip("pg", (pair.pinion, pair.wheel), supports, strict=True):
        if support.tilt is None:
            raise ValueError(_NO_TILT)
        if support.clearance or support.preload:
            raise ValueError(
                "GearPair.model: the form 'spatial' has no clearance or preload in its supports; form='bearings' has"
            )
        fields |= {
            f"r_{name}": gear.base_diameter / 2,
            f"teeth_{name}": gear.teeth,
            f"m_{name}": gear.mass_used,
            f"I_{name}": gear.inertia_used,
            f"D_{name}": gear.transverse_inertia,
            f"k_{name}": support.stiffness,
            f"k_{name}z": support.axial,
            f"k_{name}t": support.tilt,
            f"zeta_{name}": support.damping,
        }
    return HelicalPair(
        zeta=zeta,
        torque=torque,
        k_mean=mesh.k_mean,
        b_c=mesh.b_c,
        internal=pair.wheel.internal,
        alpha_deg=degrees(pair.working_pressure_angle),
        beta_deg=degrees(pair.pinion.base_helix_angle),
        phi_deg=degrees(direction),
        output=None if mesh.output == 1 else mesh.output,
        **fields,
        **mesh.fields,
    )
