"""Kinematics of a gear train: speeds, tooth frequencies and mesh phases from tooth counts and positions.

    z_1 omega_1 = -+ z_2 omega_2  (+ for a ring),   f_j = z |omega| = order_j f,   f the common frequency
    tau_j = sgn(omega) z (theta + angle + flank - alpha) = order_j tau - lag_j

The second equation holds for both gears of mesh j. A loaded flank passes the pitch point, which lies in the direction
alpha from the centre, at tau_j = 0. ``flank`` is half the angle of a tooth on its working pitch circle. The loaded
flanks of an idler, which is driven in one mesh and drives in another, are the thickness of its teeth apart, half a
pitch without profile shifts. A gear that drives in two meshes uses the same flanks in both.

References
----------
Parker and Lin (2004), Mesh phasing relationships in planetary and epicyclic gears, J. Mech. Des. 126(2), 365-370,
https://doi.org/10.1115/1.1667892.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import acos, atan2, cos, hypot, pi, radians, sin
from typing import Protocol

import numpy as np
import scipy

from hbgear.common.text.messages import did_you_mean
from hbgear.gears.torque_orders import common_divisor, exact_order
from hbgear.gears.trains.train_components import Mesh, Wheel

MAX_ORDER = 10_000
"""Largest order of a mesh over the common frequency. The motion of longer common periods has too many contacts."""

DEFAULT_PRESSURE_ANGLE = radians(20.0)
"""Pressure angle of a mesh without a given angle or positions of its wheels [rad]."""

RADIUS_TOLERANCE = 1e-3
"""Accepted relative difference between the ratios of radii and of teeth, caused by rounding in drawings."""


class Joint(Protocol):
    """Protocol of a connection of two wheels on one axis: a `Shaft` or a `Beam`."""

    @property
    def first(self) -> str:
        """Name of the first wheel."""

    @property
    def second(self) -> str:
        """Name of the second wheel."""

    @property
    def torsion(self) -> float:
        """Torsional stiffness [N m/rad]."""


@dataclass(frozen=True)
class Kinematics:
    """Speeds, orders and phases of a train.

    Attributes
    ----------
    speeds : mapping of str to Fraction
        Speed of each wheel over the speed of the first wheel of the first mesh, counter-clockwise positive.
    orders : tuple of int
        Tooth frequency of each mesh as a multiple of the common frequency.
    ratio : Fraction
        Common frequency over the speed of that wheel.
    sides : tuple of int
        For each mesh, +1 if the outer wheel pushes counter-clockwise, else -1. Without a torque the first wheel drives.
    backward : tuple of bool
        For each mesh, whether the second wheel drives the first.
    meshes : tuple of Mesh
        Meshes with functions of tau in the direction of the rotation, see `Mesh.backward`.
    lags : tuple of float
        Phase lag of each mesh in its own tau [rad].
    angles : tuple of tuple of float
        Pressure angle and direction of the line of centres for each mesh [rad].
    start_angles : mapping of str to float
        Angle of each turning wheel at tau = 0 [rad].
    forces : tuple of float or None
        Static force of each mesh by the mean torques [N]; None where several meshes share the load.
    """

    speeds: Mapping[str, Fraction]
    orders: tuple[int, ...]
    ratio: Fraction
    sides: tuple[int, ...]
    backward: tuple[bool, ...]
    meshes: tuple[Mesh, ...]
    lags: tuple[float, ...]
    angles: tuple[tuple[float, float], ...]
    start_angles: Mapping[str, float]
    forces: tuple[float | None, ...]


def inner_first(mesh: Mesh, wheels: Mapping[str, Wheel]) -> tuple[Wheel, Wheel]:
    """Return the wheels of a mesh; the first one has external teeth."""
    a, b = wheels[mesh.first], wheels[mesh.second]
    return (b, a) if a.internal else (a, b)


def kinematics(
    wheels: Mapping[str, Wheel], shafts: Sequence[Joint], meshes: Sequence[Mesh], backward: bool = False
) -> Kinematics:
    """Return the kinematics of a train.

    ``backward`` states that the second wheel of the first mesh drives the first.

    Raises
    ------
    ValueError
        If the train cannot turn, its meshes have no common frequency up to `MAX_ORDER`, or gears do not match.
    """
    for mesh in meshes:
        _check_gears(mesh, wheels)
    groups = _groups(wheels, shafts)
    speeds = _speeds(wheels, groups, meshes)
    frequencies = [abs(wheels[mesh.first].teeth * speeds[mesh.first]) for mesh in meshes]
    slow = _shaft_frequencies(wheels, speeds)
    slow += [
        frequency / mesh.contacts.meshes
        for frequency, mesh in zip(frequencies, meshes, strict=True)
        if mesh.contacts is not None and mesh.contacts.meshes > 1
    ]
    ratio = frequencies[0]
    for frequency in (*frequencies, *slow):
        ratio = common_divisor(ratio, frequency)
    orders = tuple(int(frequency / ratio) for frequency in frequencies)
    if max(orders) > MAX_ORDER:
        orders_text = ", ".join(f"{mesh.name} {order}" for mesh, order in zip(meshes, orders, strict=True))
        raise ValueError(
            f"the tooth frequencies{' and those of unbalance, torque orders and tooth errors' if slow else ''} have no "
            f"simple ratio: over their common frequency they are {orders_text}; at most {MAX_ORDER:,} can be computed: "
            "give tooth counts with a simpler ratio, or fewer wheels with unbalance, torque orders or errors of teeth"
        )
    angles = tuple(mesh_angles(mesh, wheels) for mesh in meshes)
    push_signs, forces = _static_forces(wheels, groups, meshes, speeds)
    outer_signs = [-1 if wheels[mesh.first].internal else 1 for mesh in meshes]  # sign of the push of the first wheel
    turning = (push_signs[0] or 1) * outer_signs[0] * (-1 if backward else 1)
    signed = {name: turning * speed for name, speed in speeds.items()}
    forward = [sign if signed[mesh.first] > 0 else -sign for mesh, sign in zip(meshes, outer_signs, strict=True)]
    sides = ((push_signs[0] or 1), *(push or side for push, side in zip(push_signs[1:], forward[1:], strict=True)))
    backward_meshes = tuple(side != sign for side, sign in zip(sides, forward, strict=True))
    running = tuple(mesh.backward() if back else mesh for mesh, back in zip(meshes, backward_meshes, strict=True))
    lags, start_angles = mesh_lags(wheels, groups, running, signed, sides, angles)
    return Kinematics(signed, orders, ratio, sides, backward_meshes, running, lags, angles, start_angles, forces)


def _shaft_frequencies(wheels: Mapping[str, Wheel], speeds: Mapping[str, Fraction]) -> list[Fraction]:
    """Return the frequencies of unbalances and torque orders over the speed of the first wheel."""
    frequencies = []
    for name, wheel in wheels.items():
        source = (
            "an unbalance" if wheel.unbalance else "a torque with orders of its rotation" * bool(wheel.torque_orders)
        )
        if source and not speeds[name]:
            raise ValueError(f"'{name}' has {source} and does not turn; join it to a wheel that turns, or omit it")
        orders = [exact_order(name, order) for order, _, _ in wheel.torque_orders]
        frequencies += [order * abs(speeds[name]) for order in [*orders, *[Fraction(1)] * bool(wheel.unbalance)]]
    return frequencies


def _check_gears(mesh: Mesh, wheels: Mapping[str, Wheel]) -> None:
    """Raise ValueError if the gears of a mesh do not fit."""
    for name in (mesh.first, mesh.second):
        if name not in wheels:
            raise ValueError(f"mesh {mesh.name}: there is no wheel '{name}'{did_you_mean(name, wheels)}")
        if not wheels[name].teeth:
            raise ValueError(f"mesh {mesh.name}: '{name}' has no teeth; give teeth and base_radius")
    a, b = inner_first(mesh, wheels)
    if a.internal:
        raise ValueError(f"mesh {mesh.name}: two rings cannot mesh; one of them must be a gear with external teeth")
    if b.internal and a.teeth >= b.teeth:
        raise ValueError(f"mesh {mesh.name}: {a.name} with {a.teeth} teeth does not fit into {b.name} with {b.teeth}")
    if abs(a.base_radius * b.teeth - b.base_radius * a.teeth) > RADIUS_TOLERANCE * a.base_radius * b.teeth:
        raise ValueError(
            f"mesh {mesh.name}: base radii {a.base_radius:g} and {b.base_radius:g} m are not in the ratio of the "
            f"teeth, {a.teeth}:{b.teeth}; gears that mesh have the same base pitch"
        )


def _groups(wheels: Mapping[str, Wheel], shafts: Sequence[Joint]) -> dict[str, int]:
    """Return the number of the rotor of each wheel; shafts with torsional stiffness join wheels to rotors."""
    groups = {name: i for i, name in enumerate(wheels)}
    for shaft in shafts:
        if shaft.torsion:
            old, new = groups[shaft.second], groups[shaft.first]
            groups = {name: new if group == old else group for name, group in groups.items()}
    return groups


def _speeds(wheels: Mapping[str, Wheel], groups: Mapping[str, int], meshes: Sequence[Mesh]) -> dict[str, Fraction]:
    """Return the speeds over the speed of the first wheel of the first mesh."""
    rotor_speeds = {groups[meshes[0].first]: Fraction(1)}
    pending = list(meshes)
    while pending:
        mesh = next((m for m in pending if groups[m.first] in rotor_speeds or groups[m.second] in rotor_speeds), None)
        if mesh is None:
            raise ValueError(
                f"mesh {pending[0].name} does not turn with the first one: join their wheels by a shaft with torsional "
                "stiffness or by a mesh"
            )
        pending.remove(mesh)
        a, b = mesh.first, mesh.second
        if groups[a] not in rotor_speeds:
            a, b = b, a
        sign = 1 if wheels[a].internal or wheels[b].internal else -1
        speed = sign * rotor_speeds[groups[a]] * Fraction(wheels[a].teeth, wheels[b].teeth)
        known_speed = rotor_speeds.setdefault(groups[b], speed)
        if known_speed != speed:
            raise ValueError(
                f"the train is locked: by mesh {mesh.name} '{b}' would turn {float(speed):g} times as fast as "
                f"'{meshes[0].first}', by the others {float(known_speed):g} times; check teeth and shafts"
            )
    for name, wheel in wheels.items():
        if wheel.held and groups[name] in rotor_speeds:
            raise ValueError(
                f"'{name}' is held, so nothing that meshes with it can turn; for planets, see PlanetarySet"
            )
    return {name: rotor_speeds.get(groups[name], Fraction(0)) for name in wheels}


def mesh_angles(mesh: Mesh, wheels: Mapping[str, Wheel]) -> tuple[float, float]:
    """Return the pressure angle and the direction from the centre of the outer wheel to the pitch point."""
    a, b = inner_first(mesh, wheels)
    distance = hypot(b.x - a.x, b.y - a.y)
    if mesh.direction is not None:
        phi = mesh.direction + (pi if wheels[mesh.first] is not a else 0.0)
    else:
        phi = atan2(b.y - a.y, b.x - a.x) if distance else (pi if b.internal else 0.0)
    phi += pi if b.internal else 0.0
    base_distance = abs(b.base_radius - a.base_radius) if b.internal else a.base_radius + b.base_radius
    if not distance:
        return (DEFAULT_PRESSURE_ANGLE if mesh.pressure_angle is None else mesh.pressure_angle), phi
    if distance <= base_distance:
        raise ValueError(
            f"mesh {mesh.name}: the wheels are {distance:g} m apart, their base circles need more than "
            f"{base_distance:g} m: they collide; check x and y of both"
        )
    alpha = acos(base_distance / distance)
    if (
        mesh.pressure_angle is not None
        and abs(base_distance / cos(mesh.pressure_angle) / distance - 1) > RADIUS_TOLERANCE
    ):
        raise ValueError(
            f"mesh {mesh.name}: with the pressure angle {mesh.pressure_angle:.4g} rad the wheels are "
            f"{base_distance / cos(mesh.pressure_angle):.6g} m apart, by their positions {distance:.6g} m; omit one"
        )
    return (alpha if mesh.pressure_angle is None else mesh.pressure_angle), phi


def _static_forces(
    wheels: Mapping[str, Wheel], groups: Mapping[str, int], meshes: Sequence[Mesh], speeds: Mapping[str, Fraction]
) -> tuple[tuple[int, ...], tuple[float | None, ...]]:
    """Return the directions in which the outer wheels push under the torques, 0 without a torque, and the forces.

    A force is None where several meshes share the load.
    """
    rotors = sorted({groups[name] for name in wheels})
    A = np.zeros((len(rotors), len(meshes)))
    for j, mesh in enumerate(meshes):
        a, b = inner_first(mesh, wheels)
        A[rotors.index(groups[a.name]), j] += a.base_radius
        A[rotors.index(groups[b.name]), j] += -b.base_radius if b.internal else b.base_radius
    torque = np.zeros(len(rotors))
    for name, wheel in wheels.items():
        torque[rotors.index(groups[name])] += wheel.torque
    work = sum(wheel.torque * float(speeds[name]) for name, wheel in wheels.items())
    size = sum(abs(wheel.torque * float(speeds[name])) for name, wheel in wheels.items())
    if abs(work) > 1e-9 * size:
        raise ValueError(
            f"the torques do not balance: together they do the work {work:.6g} N m per radian of '{meshes[0].first}'; "
            "correct one, or name the wheel that holds the rest as balance"
        )
    forces = np.linalg.lstsq(A, torque, rcond=None)[0]
    forces[np.abs(forces) <= 1e-9 * np.abs(forces).max(initial=0.0)] = 0.0
    null_space = scipy.linalg.null_space(A)  # forces that add up to no torque
    determinate = [
        None if len(row) and np.abs(row).max(initial=0.0) > 1e-9 else abs(force)
        for row, force in zip(null_space, forces.tolist(), strict=True)
    ]
    return tuple(np.sign(forces).astype(int).tolist()), tuple(determinate)


def mesh_lags(
    wheels: Mapping[str, Wheel],
    groups: Mapping[str, int],
    meshes: Sequence[Mesh],
    speeds: Mapping[str, Fraction],
    sides: Sequence[int],
    angles: Sequence[tuple[float, float]],
) -> tuple[tuple[float, ...], dict[str, float]]:
    """Return the phase lag of each mesh in its own tau and the angles of the wheels at tau = 0.

    A lag is between zero and the period of the mesh, which is longer than 2 pi with errors of single teeth.
    """
    rotor_angles: dict[int, float] = {}  # angle of each rotor at tau = 0
    lags: dict[int, float] = {}
    periods = [2 * pi * (1 if mesh.contacts is None else mesh.contacts.meshes) for mesh in meshes]

    def mesh_position(j: int, name: str) -> tuple[float, float]:
        return _mesh_position(meshes[j], name, wheels, speeds, sides[j], angles[j][1])

    def record_mesh(j: int, phase: float) -> None:
        """Store the lag of mesh j and the angles of its rotors."""
        lags[j] = (-phase - meshes[j].pitch_phase) % periods[j]
        for name in (meshes[j].first, meshes[j].second):
            z, tooth_angle = mesh_position(j, name)
            rotor_angles.setdefault(groups[name], tooth_angle + phase / z)

    record_mesh(0, -meshes[0].pitch_phase)
    while len(lags) < len(meshes):
        for j, mesh in enumerate(meshes):
            known_name = next((name for name in (mesh.first, mesh.second) if groups[name] in rotor_angles), None)
            if j not in lags and known_name:
                z, tooth_angle = mesh_position(j, known_name)
                record_mesh(j, z * (rotor_angles[groups[known_name]] - tooth_angle))
    used_lags = [lags[j] if mesh.lag is None else mesh.lag for j, mesh in enumerate(meshes)]
    start_angles = {name: rotor_angles[group] for name, group in groups.items() if group in rotor_angles}
    return tuple(
        0.0 if abs(lag - period) < 1e-9 else lag for lag, period in zip(used_lags, periods, strict=True)
    ), start_angles


def _mesh_position(
    mesh: Mesh, name: str, wheels: Mapping[str, Wheel], speeds: Mapping[str, Fraction], side: int, phi: float
) -> tuple[float, float]:
    """Return signed tooth number and the angle of the rotor at which the mesh is in the pitch point of a wheel."""
    wheel, (a, b) = wheels[name], inner_first(mesh, wheels)
    pushes = side * (-1 if b.internal and wheel is b else 1)
    alpha = phi + (0.0 if wheel is a or b.internal else pi)
    turn = 1 if speeds[name] > 0 else -1
    half = pi * mesh.thickness[0 if name == mesh.first else 1] / wheel.teeth  # half the angle of a tooth
    return turn * wheel.teeth, alpha - wheel.angle - pushes * half


def phase_mismatch(wheels: Mapping[str, Wheel], meshes: Sequence[Mesh], motion: Kinematics) -> list[float]:
    """Return the difference of the phases of each mesh by its two wheels [mesh periods], between -1/2 and 1/2.

    It is zero except for a mesh that closes a loop of wheels whose positions are given, such as planets.
    """
    mismatches = []
    for mesh, side, (_, phi) in zip(meshes, motion.sides, motion.angles, strict=True):
        ends = [
            (*_mesh_position(mesh, name, wheels, motion.speeds, side, phi), motion.start_angles[name])
            for name in (mesh.first, mesh.second)
        ]
        first, second = (z * (rotor_angle - tooth_angle) / (2 * pi) for z, tooth_angle, rotor_angle in ends)
        mismatches.append((first - second + 0.5) % 1.0 - 0.5)
    return mismatches


def line_of_action(mesh: Mesh, side: int, angles: tuple[float, float], outer: Wheel, inner: Wheel) -> np.ndarray:
    """Return the direction (2, 6) of the gap of a mesh in the coordinates of both wheels, the outer one first.

        w_a = (n, r_a e x n),   w_b = -(n, -r_b e x n),   e = (cos phi, sin phi, 0) / cos alpha
        n = (c sin(alpha), side c cos(alpha), s) rotated by phi about z,   c = cos beta_b,   s = -side sin beta_b

    Both forces act at the pitch point, so that they are in equilibrium: in equal and opposite directions on one line.
    The arm of a ring is +r_b e.
    """
    alpha, phi = angles
    c, s = cos(mesh.helix_angle), -side * sin(mesh.helix_angle)
    turn = np.array([[cos(phi), -sin(phi), 0.0], [sin(phi), cos(phi), 0.0], [0.0, 0.0, 1.0]])
    n, e = turn @ [c * sin(alpha), side * c * cos(alpha), s], turn @ [1 / cos(alpha), 0.0, 0.0]
    arms = outer.base_radius * e, (1 if inner.internal else -1) * inner.base_radius * e
    return np.array([sign * np.concatenate([n, np.cross(arm, n)]) for sign, arm in zip((1.0, -1.0), arms, strict=True)])
