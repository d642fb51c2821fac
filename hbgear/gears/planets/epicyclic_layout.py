"""Members of an `EpicyclicSet`: checks, speeds, torques, and the train in the frame of the carrier."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import cos, pi, sin
from typing import Any, ClassVar

import numpy as np

from hbgear.common.argument_checks import check
from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, Range, counted
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.gears.mesh.mesh_excitation import parameters_of_meshes
from hbgear.gears.torque_orders import mesh_multiple, torque_orders
from hbgear.gears.trains.train import Train
from hbgear.gears.trains.train_components import Mesh, Shaft, Wheel, tooth_counts
from hbgear.gears.trains.train_kinematics import MAX_ORDER, RADIUS_TOLERANCE, inner_first, kinematics, phase_mismatch
from hbgear.mechanics.models import Model
from hbgear.mechanics.structures.scales import Scales

CARRIER = "carrier"
"""Name of the carrier among the members."""

PHASE_TOLERANCE = 1e-3
"""Accepted mismatch of the teeth of a planet [mesh periods], caused by rounding of positions."""


@dataclass(frozen=True)
class EpicyclicLayout(Model):
    """Members of an epicyclic set with their speeds, torques, phases and units; `EpicyclicSet` states the fields."""

    wheels: tuple[Wheel, ...]
    meshes: tuple[Mesh, ...]
    carrier_inertia: float = 0.01
    planets: int = 3
    bodies: tuple[tuple[str, ...], ...] = ()
    driver: str = "sun"
    output: str = CARRIER
    fixed: str = "ring"
    torque: float = 100.0
    torque_scale: float = 1.0
    backlash_scale: float = 1.0
    eps_scale: float = 1.0
    e_scale: float = 1.0
    torque_orders: Any = ()
    fluctuation_scale: float = 1.0

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega$, common frequency of the meshes $/ \omega_n$ [-]",
        "amplitude": r"$d / b_c$ [-]",
        "carrier_inertia": r"inertia of the carrier [kg m$^2$]",
        "torque": "torque on the driver [N m]",
        "torque_scale": "factor of the torque [-]",
        "backlash_scale": "factor of the backlashes [-]",
        "eps_scale": r"factor of the stiffness amplitudes $\varepsilon_l$ [-]",
        "e_scale": r"factor of the errors [-]",
        "fluctuation_scale": "factor of the torque orders [-]",
    }
    ranges: ClassVar[Mapping[str, Range]] = {
        "carrier_inertia": POSITIVE,
        "torque": POSITIVE,
        "backlash_scale": Range(low=0, high=1e6),
    }

    @property
    def title(self) -> str:
        """Tooth counts of all meshes, number of planets and torque."""
        teeth = tooth_counts(self.wheels, self.meshes)
        return f"Epicyclic set {teeth}, {self.planets} planet{'s' * (self.planets != 1)}, {self.torque:g} N m"

    def __post_init__(self) -> None:
        for name, kind in (("wheels", Wheel), ("meshes", Mesh)):
            components = getattr(self, name)
            if (
                not isinstance(components, tuple | list)
                or not components
                or not all(isinstance(x, kind) for x in components)
            ):
                raise ValueError(f"EpicyclicSet: {name} = {quoted(components)} must be a list of {kind.__name__}(...)")
            object.__setattr__(self, name, tuple(components))
        check("EpicyclicSet", "bodies", self.bodies, tuple | list)
        object.__setattr__(self, "bodies", tuple(tuple(body) for body in self.bodies))
        object.__setattr__(self, "torque_orders", torque_orders("EpicyclicSet", self.torque_orders))
        super().__post_init__()
        counted("EpicyclicSet: planets", self.planets, 40)
        self._check_components()
        self._check_members()
        self._check_period()

    # ---- checks

    def _check_components(self) -> None:
        """Raise an error if a wheel or mesh has what this model does not have."""
        names = [wheel.name for wheel in self.wheels]
        for wheel in self.wheels:
            if wheel.name == CARRIER or names.count(wheel.name) > 1:
                raise ValueError(f"EpicyclicSet: the name '{wheel.name}' is taken; give every wheel its own name")
            if wheel.moves != "torsion" or wheel.held or wheel.torque or wheel.torque_orders or not wheel.teeth:
                raise ValueError(
                    f"EpicyclicSet: '{wheel.name}' must be a gear with moves='torsion' and without torque, "
                    "torque_orders and held; give driver, output, fixed and torque of the set"
                )
        for mesh in self.meshes:
            contacts = mesh.contacts
            if contacts is not None and (contacts.sliding is not None or contacts.meshes > 1):
                raise ValueError(
                    f"EpicyclicSet: the mesh {mesh.name} has friction or errors of single teeth, which "
                    "are equal for all planets here; give a mesh without them"
                )
        for body in self.bodies:
            wrong = next((name for name in body if name not in self._planet_gears), None)
            if wrong is not None:
                raise ValueError(
                    f"EpicyclicSet: bodies: '{wrong}' is no gear of a planet{did_you_mean(wrong, self._planet_gears)}"
                )
            axes = {(self._by_name[name].x, self._by_name[name].y) for name in body}
            if len(axes) > 1:
                raise ValueError(f"EpicyclicSet: bodies: the gears {', '.join(body)} of one planet have different axes")

    def _check_members(self) -> None:
        members = [*self._central, CARRIER]
        chosen = [self.driver, self.output, self.fixed]
        for name in chosen:
            if name not in members:
                raise ValueError(f"EpicyclicSet: there is no member {quoted(name)}; give one of {', '.join(members)}")
        if len(set(chosen)) < 3:
            raise ValueError(f"EpicyclicSet: driver, output and fixed = {', '.join(chosen)} must be different members")
        if not self.speeds[self.output]:
            raise ValueError(f"EpicyclicSet: with the {self.fixed} at rest the {self.output} does not turn")

    def _check_assembly(self, wheels: Sequence[Wheel], shafts: tuple[Shaft, ...], meshes: Sequence[Mesh]) -> None:
        """Raise an error if the teeth of a planet do not match the teeth of both gears that it meshes with."""
        by_name = {wheel.name: wheel for wheel in wheels}
        mismatches = phase_mismatch(by_name, meshes, kinematics(by_name, shafts, meshes))
        for mesh, mismatch in zip(meshes, mismatches, strict=True):
            if abs(mismatch) > PHASE_TOLERANCE:
                raise ValueError(
                    f"EpicyclicSet: in the mesh {mesh.name} the teeth are {abs(mismatch):.3g} pitches apart, so that "
                    f"{self.planets} equal planets cannot be assembled at equal distances; change the numbers of teeth "
                    "or of planets (for simple planets (z_s + z_r) / N must be whole)"
                )

    def _check_period(self) -> None:
        """Raise an error if meshes and torque orders have a common period that is too long."""
        largest = max(self.train._kinematics.orders) * self.common_order
        if largest > MAX_ORDER:
            raise ValueError(
                f"EpicyclicSet: over the common frequency with the torque_orders of the {self.driver} the meshes have "
                f"orders up to {largest}; at most {MAX_ORDER:,} can be computed: give orders with a simpler ratio to "
                "the tooth frequencies, or other numbers of teeth"
            )

    # ---- members

    @cached_property
    def _by_name(self) -> dict[str, Wheel]:
        """Wheels by name, with base radii exactly in the ratio of the teeth of gears that mesh."""
        wheels, connected = {wheel.name: wheel for wheel in self.wheels}, set[str]()
        pending = [mesh for mesh in self.meshes if {mesh.first, mesh.second} <= wheels.keys()]
        while pending:
            mesh = next((m for m in pending if connected & {m.first, m.second}), pending[0])
            pending.remove(mesh)
            a, b = (mesh.second, mesh.first) if mesh.second in connected else (mesh.first, mesh.second)
            exact = wheels[a].base_radius * wheels[b].teeth / max(wheels[a].teeth, 1)
            if b not in connected and exact and abs(wheels[b].base_radius - exact) <= RADIUS_TOLERANCE * exact:
                wheels[b] = dataclasses.replace(wheels[b], base_radius=exact)
            connected |= {a, b}
        return wheels

    @property
    def _central(self) -> list[str]:
        """Names of the central gears."""
        return [wheel.name for wheel in self.wheels if not wheel.x and not wheel.y]

    @property
    def _planet_gears(self) -> list[str]:
        return [wheel.name for wheel in self.wheels if wheel.x or wheel.y]

    @cached_property
    def _relative(self) -> dict[str, Fraction]:
        """Speeds of the gears relative to the carrier, over that of one of them."""
        return dict(kinematics(self._by_name, self._shafts(("",)), self.meshes).speeds)

    @cached_property
    def speeds(self) -> dict[str, Fraction]:
        """Speeds of the carrier and of all gears over the speed of the driver."""
        s = {**self._relative, CARRIER: Fraction(0)}
        difference = s[self.driver] - s[self.fixed]
        if not difference:
            raise ValueError(f"EpicyclicSet: with the {self.fixed} at rest the {self.driver} cannot turn")
        return {name: (value - s[self.fixed]) / difference for name, value in s.items()}

    @property
    def ratio(self) -> Fraction:
        """Speed of the driver over the speed of the output."""
        return 1 / self.speeds[self.output]

    @property
    def torques(self) -> dict[str, float]:
        """Mean external torques on driver, output and fixed member [N m], in equilibrium."""
        return self._external_torques(self.torque_scale * self.torque)

    def _external_torques(self, driving: float) -> dict[str, float]:
        """Return the torques in equilibrium with a torque on the driver [N m]."""
        output = -driving * float(self.ratio)
        return {self.driver: driving, self.output: output, self.fixed: -driving - output}

    # ---- the train in the frame of the carrier

    def _shafts(self, groups: tuple[str, ...]) -> tuple[Shaft, ...]:
        """Return shafts that join the gears of each body; their stiffness has no effect."""
        return tuple(
            Shaft(a + group, b + group, torsion=1.0)
            for group in groups
            for body in self.bodies
            for a, b in pairwise(body)
        )

    @cached_property
    def train(self) -> Train:
        """All gears in the frame of the carrier; the first wheel of each mesh drives."""
        groups = tuple(str(n + 1) for n in range(self.planets))
        torques = self.torques
        wheels = [dataclasses.replace(self._by_name[name], torque=torques.get(name, 0.0)) for name in self._central]
        for n, group in enumerate(groups):
            c, s = cos(2 * pi * n / self.planets), sin(2 * pi * n / self.planets)
            for name in self._planet_gears:
                original = self._by_name[name]
                wheels.append(
                    dataclasses.replace(
                        original,
                        name=name + group,
                        x=c * original.x - s * original.y,
                        y=s * original.x + c * original.y,
                    )
                )
        meshes = [self._copied(mesh, n, group) for n, group in enumerate(groups) for mesh in self.meshes]
        shafts = self._shafts(groups)
        by_name = {wheel.name: wheel for wheel in wheels}
        push_signs = kinematics(by_name, shafts, meshes).sides
        for j, (mesh, side) in enumerate(zip(meshes, push_signs, strict=True)):
            outer = inner_first(mesh, by_name)[0].name
            drives = side * self._turning(outer) > 0
            if drives != (mesh.first == outer):
                meshes[j] = driven(mesh, by_name)
        stepped = [f"{name}{n + 1}" for n in range(1, self.planets) for body in self.bodies for name in body]
        _orient(wheels, shafts, meshes, stepped)
        self._check_assembly(wheels, shafts, meshes)
        return Train(
            tuple(wheels),
            tuple(meshes),
            shafts,
            backlash_scale=self.backlash_scale,
            eps_scale=self.eps_scale,
            e_scale=self.e_scale,
        )

    def _turning(self, name: str) -> Fraction:
        """Return the speed of a gear relative to the carrier over the speed of the driver."""
        copies = {f"{gear}{n + 1}": gear for gear in self._planet_gears for n in range(self.planets)}
        return self.speeds[copies.get(name, name)] - self.speeds[CARRIER]

    def _copied(self, mesh: Mesh, n: int, group: str) -> Mesh:
        """Return the mesh of a group."""
        first, second = (name if name in self._central else name + group for name in (mesh.first, mesh.second))
        direction = None if mesh.direction is None else mesh.direction + 2 * pi * n / self.planets
        return dataclasses.replace(mesh, first=first, second=second, direction=direction, torque=None, lag=None)

    # ---- names and units

    @property
    def parameters(self) -> dict[str, float]:
        """Float fields by name, without eps_scale if a mesh has contacts."""
        return parameters_of_meshes(super().parameters, [mesh.contacts for mesh in self.meshes])

    @property
    def sharing(self) -> list[str]:
        """Names of all meshes, between which the load is shared."""
        return [mesh.name for mesh in self.train.meshes]

    @property
    def _mesh_speed(self) -> Fraction:
        """Common frequency of the meshes over the speed of the driver."""
        motion = self.train._kinematics
        first = self.train.meshes[0].first
        return abs(motion.ratio * self._turning(first) / motion.speeds[first])

    @cached_property
    def common_order(self) -> int:
        """Common frequency of the meshes over Omega: above 1 if the torque has orders of the driver."""
        return mesh_multiple("EpicyclicSet", self.torque_orders, self._mesh_speed)

    @property
    def orders(self) -> dict[str, float]:
        """Frequencies over Omega of every mesh of the first group, and of the carrier and the central gears."""
        motion, p = self.train._kinematics, self.common_order
        names = (mesh.name for mesh in self.meshes)
        meshes = {name: float(order * p) for name, order in zip(names, motion.orders, strict=False)}
        turning = {name: abs(float(self.speeds[name] * p / self._mesh_speed)) for name in (*self._central, CARRIER)}
        return meshes | {name: order for name, order in turning.items() if order}

    @property
    def lags(self) -> dict[str, float]:
        """Phase lag of each mesh behind the first one, in its own tau [rad]."""
        return self.train.lags

    @property
    def scales(self) -> Scales:
        """Scales with the frequency of the first mesh, whose pinion is the driver."""
        train, order = self.train, self.train._kinematics.orders[0]
        teeth = float(order * self._mesh_speed)
        return Scales(train.omega_n, train.b_c, train.k_mean * train.b_c, teeth, float(order * self.common_order))

    default_span = Train.default_span


def driven(mesh: Mesh, wheels: Mapping[str, Wheel]) -> Mesh:
    """Return a mesh whose second wheel drives, as one whose first wheel drives: its functions of tau run backwards."""
    internal = wheels[mesh.first].internal or wheels[mesh.second].internal
    direction = None if mesh.direction is None else mesh.direction + pi
    return dataclasses.replace(
        mesh.backward(),
        first=mesh.second,
        second=mesh.first,
        direction=direction,
        thickness=mesh.thickness[::-1],
        helix_angle=mesh.helix_angle if internal else -mesh.helix_angle,
    )


def _orient(wheels: list[Wheel], shafts: tuple[Shaft, ...], meshes: list[Mesh], stepped: list[str]) -> None:
    """Turn stepped planets by whole teeth of one gear until their other gears match the teeth of the mates."""
    indices = {wheel.name: i for i, wheel in enumerate(wheels)}

    def mismatch() -> Array:
        by_name = {wheel.name: wheel for wheel in wheels}
        return np.array(phase_mismatch(by_name, meshes, kinematics(by_name, shafts, meshes)))

    mismatches = mismatch()
    for name in stepped:
        if np.abs(mismatches).max() <= PHASE_TOLERANCE:
            return
        i = indices[name]
        original = wheels[i]
        wheels[i] = dataclasses.replace(original, angle=original.angle - 2 * pi / original.teeth)
        step = (mismatch() - mismatches + 0.5) % 1.0 - 0.5
        wheels[i] = original
        affected = np.abs(step) > PHASE_TOLERANCE
        if not affected.any():
            continue
        turns = np.arange(original.teeth)
        residuals = np.abs((mismatches[affected] + turns[:, None] * step[affected] + 0.5) % 1.0 - 0.5).max(axis=1)
        best = int(np.argmin(residuals))
        if residuals[best] <= PHASE_TOLERANCE:
            wheels[i] = dataclasses.replace(
                original, angle=(original.angle - 2 * pi * best / original.teeth) % (2 * pi)
            )
            mismatches = mismatch()
