"""Wheels, meshes and connections of a `Train`: checks, kinematics, units and coordinates."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import ClassVar

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import Range
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.gears.mesh.mesh_excitation import check_contact_scale, parameters_of_meshes
from hbgear.gears.trains.assembly import check_assembly
from hbgear.gears.trains.beam import Beam
from hbgear.gears.trains.housing import Housing
from hbgear.gears.trains.train_components import WHEEL_COORDINATES, Bearing, Mesh, Shaft, Wheel, tooth_counts
from hbgear.gears.trains.train_kinematics import Kinematics, kinematics
from hbgear.mechanics.models import Model
from hbgear.mechanics.structures.scales import Scales

MESH_TORQUE_TOLERANCE = 0.02
"""Accepted difference of the torque of a mesh from the static torque: it changes the contact stiffness by .1 %."""

DEFAULT_LENGTH = 1e-6  # [m], unit of length of a train without backlash


@dataclass(frozen=True)
class TrainLayout(Model):
    """Parts of a train with their torques, speeds, units and coordinates; `Train` states the fields."""

    wheels: tuple[Wheel, ...]
    meshes: tuple[Mesh, ...]
    shafts: tuple[Shaft, ...] = ()
    bearings: tuple[Bearing, ...] = ()
    balance: str = ""
    gyroscopic: bool = False
    torque_scale: float = 1.0
    backlash_scale: float = 1.0
    eps_scale: float = 1.0
    e_scale: float = 1.0
    beams: tuple[Beam, ...] = ()
    housing: Housing | None = None
    clearance_scale: float = 1.0
    unbalance_scale: float = 1.0
    fluctuation_scale: float = 1.0

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega$, common frequency of the meshes $/ \omega_n$ [-]",
        "amplitude": r"$d / b_c$ [-]",
        "torque_scale": "factor of the torques [-]",
        "backlash_scale": "factor of the backlashes [-]",
        "eps_scale": r"factor of the stiffness amplitudes $\varepsilon_l$ [-]",
        "e_scale": r"factor of the errors [-]",
        "clearance_scale": "factor of the clearances [-]",
        "unbalance_scale": "factor of the unbalances [-]",
        "fluctuation_scale": "factor of the torque orders [-]",
    }
    ranges: ClassVar[Mapping[str, Range]] = dict.fromkeys(("backlash_scale", "clearance_scale"), Range(low=0, high=1e6))

    @property
    def title(self) -> str:
        """Tooth counts of all meshes."""
        return f"Gear train {tooth_counts(self.wheels, self.meshes)}"

    def __post_init__(self) -> None:
        lists = {"wheels": Wheel, "meshes": Mesh, "shafts": Shaft, "bearings": Bearing, "beams": Beam}
        for name, kind in lists.items():
            items = getattr(self, name)
            if not isinstance(items, tuple | list) or not all(isinstance(item, kind) for item in items):
                raise ValueError(f"Train: {name} = {quoted(items)} must be a list of {kind.__name__}(...)")
            object.__setattr__(self, name, tuple(items))
        super().__post_init__()
        if not self.meshes:
            raise ValueError("Train: give at least one Mesh(...)")
        names = [wheel.name for wheel in self.wheels]
        duplicate = next((name for name in names if names.count(name) > 1), None)
        if duplicate:
            raise ValueError(f"Train: two wheels have the name '{duplicate}'; give each wheel its own name")
        self._check_places(names)
        object.__setattr__(self, "beams", tuple(self._placed(beam) for beam in self.beams))
        check_contact_scale("Train", self.eps_scale, [mesh.contacts for mesh in self.meshes])
        self._check_mesh_torques()
        self._check_drivers()
        check_assembly(self._by_name, self.meshes, self._kinematics)

    @property
    def mesh_torques(self) -> dict[str, float | None]:
        """Static torque of each mesh on its first wheel [N m]; None where several meshes share the load."""
        return {
            mesh.name: None if force is None else force * self._by_name[mesh.first].base_radius
            for mesh, force in zip(self.meshes, self._kinematics.forces, strict=True)
        }

    def _check_mesh_torques(self) -> None:
        """Raise an error if a mesh was computed for another torque than the static one; also if nothing can turn."""
        torques = self.mesh_torques
        if not any(wheel.torque_orders for wheel in self.wheels):
            for mesh in self.meshes:
                check_mesh_torque("Train", "the train", mesh, torques[mesh.name])

    def _check_drivers(self) -> None:
        """Raise an error if friction or errors of single teeth were computed for a wheel that does not drive."""
        for mesh, backward in zip(self.meshes, self._kinematics.backward, strict=True):
            contacts = mesh.contacts
            if not backward or contacts is None or (contacts.sliding is None and contacts.meshes == 1):
                continue
            what, remedy = ("friction", "friction=0") if contacts.sliding else ("errors of single teeth", "omit them")
            raise ValueError(
                f"Train: {what} of the mesh {mesh.name} {'is' if contacts.sliding else 'are'} computed for a first "
                f"wheel that drives, and '{mesh.second}' drives '{mesh.first}'; exchange them in Mesh.of, or "
                f"{'give ' if contacts.sliding else ''}{remedy}"
            )

    def _check_places(self, names: list[str]) -> None:
        references = [(f"shaft {s.name}", name) for s in self.joints for name in (s.first, s.second)]
        references += [(f"bearing at {b.at}", b.at) for b in self.bearings]
        references += [
            (f"seat of the housing at {name}", name) for name in (self.housing.seats if self.housing else ())
        ]
        references += [("balance", self.balance)] if self.balance else []
        for owner, name in references:
            if name not in names:
                raise ValueError(f"Train: {owner}: there is no wheel '{name}'{did_you_mean(name, names)}")

    def _placed(self, beam: Beam) -> Beam:
        """Return a beam with its length, after checks of the wheels at its ends."""
        ends = [next(wheel for wheel in self.wheels if wheel.name == name) for name in (beam.first, beam.second)]
        stiff = next((wheel for wheel in ends if wheel.moves != "space"), None)
        if stiff is not None:
            raise ValueError(
                f"Train: beam {beam.name}: '{stiff.name}' moves in {stiff.moves}; a beam bends and tilts the wheels at "
                "its ends, so they need moves='space'"
            )
        distance = ends[1].z - ends[0].z
        if beam.length is None and distance <= 0:
            raise ValueError(
                f"Train: beam {beam.name}: its wheels are at z = {ends[0].z:g} and {ends[1].z:g} m; give its length, "
                "or a larger z of the second wheel"
            )
        if beam.length is not None and distance and abs(distance - beam.length) > 1e-6 * beam.length:
            raise ValueError(
                f"Train: beam {beam.name} is {beam.length:g} m long and its wheels are {distance:g} m apart in z; "
                "leave one out"
            )
        return beam if beam.length is not None else dataclasses.replace(beam, length=distance)

    @property
    def parameters(self) -> dict[str, float]:
        """Float fields by name, without eps_scale if a mesh has contacts."""
        return parameters_of_meshes(super().parameters, [mesh.contacts for mesh in self.meshes])

    # ---- kinematics

    @property
    def joints(self) -> tuple[Shaft | Beam, ...]:
        """Connections of wheels on one axis: shafts and beams."""
        return (*self.shafts, *self.beams)

    @cached_property
    def _by_name(self) -> dict[str, Wheel]:
        """Wheels by name, with the torque of the balancing wheel."""
        wheels = {wheel.name: wheel for wheel in self.wheels}
        if not self.balance:
            return wheels
        holder = wheels[self.balance]
        if holder.torque:
            raise ValueError(f"Train: '{holder.name}' balances the torques and has its own torque; keep one")
        free = {name: dataclasses.replace(wheel, torque=0.0) for name, wheel in wheels.items()}
        speeds = kinematics(free, self.joints, self.meshes).speeds
        if not speeds[holder.name]:
            raise ValueError(f"Train: '{holder.name}' does not turn with the others, so it cannot hold their torques")
        work = sum(wheel.torque * float(speeds[name]) for name, wheel in wheels.items())
        return {**wheels, holder.name: dataclasses.replace(holder, torque=-work / float(speeds[holder.name]))}

    @cached_property
    def _kinematics(self) -> Kinematics:
        return kinematics(self._by_name, self.joints, self.meshes)

    @property
    def torques(self) -> dict[str, float]:
        """Mean external torque on each wheel [N m]."""
        return {name: self.torque_scale * wheel.torque for name, wheel in self._by_name.items()}

    @property
    def orders(self) -> dict[str, float]:
        """Frequencies over Omega of every mesh and of every wheel that turns."""
        motion = self._kinematics
        meshes = {mesh.name: float(order) for mesh, order in zip(self.meshes, motion.orders, strict=True)}
        return meshes | {name: abs(float(speed / motion.ratio)) for name, speed in motion.speeds.items() if speed}

    @property
    def sharing(self) -> list[str]:
        """Names of all meshes, between which the load is shared."""
        return [mesh.name for mesh in self.meshes]

    @property
    def lags(self) -> dict[str, float]:
        """Phase lag of each mesh behind the first one, in its own tau [rad].

        With errors of single teeth it is the lag of the contact of tooth 0, up to some turns.
        """
        return {mesh.name: lag for mesh, lag in zip(self.meshes, self._kinematics.lags, strict=True)}

    # ---- units

    @property
    def k_mean(self) -> float:
        """Unit of stiffness, from the first mesh [N/m]."""
        return self.meshes[0].k_mean

    @property
    def b_c(self) -> float:
        """Unit of length, the half backlash of the first mesh that has one [m]."""
        return next((mesh.half_backlash for mesh in self.meshes if mesh.half_backlash), DEFAULT_LENGTH)

    @property
    def m_c(self) -> float:
        """Unit of mass, from the first mesh [kg]."""
        return self._equivalent_mass(self.meshes[0])

    def _equivalent_mass(self, mesh: Mesh) -> float:
        wheels = (self._by_name[name] for name in (mesh.first, mesh.second))
        return 1 / sum(wheel.base_radius**2 / wheel.inertia for wheel in wheels if not wheel.held)

    @property
    def omega_n(self) -> float:
        """Angular frequency of Omega = 1 [rad/s]."""
        return sqrt(self.k_mean / self.m_c)

    @property
    def default_span(self) -> tuple[float, float]:  # type: ignore[override]
        """Usual range of Omega: the frequency of the first mesh from 1.5 to 0.3 times its natural frequency."""
        order = self.orders[self.meshes[0].name]
        return 1.5 / order, 0.3 / order

    @property
    def scales(self) -> Scales:
        """Scales with the frequency of the first mesh, whose pinion is its first wheel."""
        order, first = self.orders[self.meshes[0].name], self.orders[self.meshes[0].first]
        return Scales(self.omega_n, self.b_c, self.k_mean * self.b_c, round(order / first, 12), order)

    @cached_property
    def _coordinates(self) -> list[tuple[str, int]]:
        """Name and axis of every coordinate: wheel or beam node and index in `AXES`; "" and index for the housing."""
        wheels = [
            (wheel.name, axis)
            for wheel in self.wheels
            for axis in WHEEL_COORDINATES[wheel.moves]
            if not (wheel.held and axis == 5)
        ]
        nodes = [(node, axis) for beam in self.beams for node in beam.nodes for axis in range(6)]
        return wheels + nodes + [("", i) for i in range(self.housing.n if self.housing else 0)]

    @property
    def units(self) -> Array:
        """Physical size of a coordinate of value one, shape (n,): b_c [m], for a rotation b_c / r [rad]."""
        radii = {wheel.name: wheel.base_radius for wheel in self.wheels}
        default_radius = radii[self.meshes[0].first]
        return np.array(
            [
                self.b_c / ((radii.get(name) or default_radius) if name and axis > 2 else 1.0)
                for name, axis in self._coordinates
            ]
        )


def check_mesh_torque(owner: str, machine: str, mesh: Mesh, static: float | None) -> None:
    """Raise ValueError if a mesh was computed for another torque than its static torque on the first wheel [N m]."""
    if mesh.torque is not None and static and abs(mesh.torque - static) > MESH_TORQUE_TOLERANCE * static:
        raise ValueError(
            f"{owner}: the mesh {mesh.name} is computed for {mesh.torque:.6g} N m on '{mesh.first}', {machine} "
            f"loads it with {static:.6g} N m: give Mesh.of this torque, or the mesh torque=None to omit this check"
        )
