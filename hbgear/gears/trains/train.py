"""Trains of gears: wheels on shafts and bearings with any number of meshes.

    M q'' + (C + Omega G) q' + K q + sum_j w_j [k_j(tau) f(d_j) + c_j d_j'] = F,   d_j = w_j^T q - e_j(tau)

q are the coordinates of the wheels (`hbgear.gears.trains.train_components`). Every mesh is an element with its own
backlash, stiffness, error and phase. All tooth frequencies, and the frequencies of rotation of unbalanced wheels, are
multiples of Omega (`hbgear.gears.trains.train_kinematics`). With a single tooth frequency, as with idlers, Omega is
this frequency. A bearing with a clearance is two elements: a round hole (`RadialClearance`), or one in each direction.

Dimensionless form returned by `Train.system`: the unit of length is the half backlash b_c of the first mesh that has
one. The units of time sqrt(m_c/k_mean) and force k_mean b_c belong to the first mesh, with m_c = 1 / (r_1^2/J_1 +
r_2^2/J_2) of its wheels. A rotation enters as r theta/b_c with the base radius of the wheel. A wheel without one uses
the base radius of the first wheel of the first mesh.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import sqrt

import numpy as np

from hbgear.common.arrays import Array
from hbgear.gears.mesh.mesh_excitation import contacts_in_order, in_order
from hbgear.gears.pairs.support import AXES
from hbgear.gears.torque_orders import exact_order, order_load
from hbgear.gears.trains.beam import Beam
from hbgear.gears.trains.train_components import Bearing, Mesh
from hbgear.gears.trains.train_friction import friction_elements, without_rotation
from hbgear.gears.trains.train_kinematics import inner_first, line_of_action
from hbgear.gears.trains.train_layout import TrainLayout
from hbgear.mechanics.laws.laws import Backlash, Law
from hbgear.mechanics.laws.vector_laws import Component, RadialClearance
from hbgear.mechanics.models import System
from hbgear.mechanics.structures.elements import Element, Load, Reaction
from hbgear.mechanics.structures.speed_terms import MatrixTable, SpeedTerms


@dataclass(frozen=True)
class Train(TrainLayout):  # numpydoc ignore=PR02
    """Gears on shafts and bearings; the module docstring states the equations.

    Parameters
    ----------
    wheels : tuple of Wheel
        Wheels with different names.
    meshes : tuple of Mesh
        Meshes between them, at least one. The first mesh sets the units, and its first wheel sets the direction of
        rotation.
    shafts, bearings : tuple of Shaft and tuple of Bearing, optional
        Shafts and bearings.
    beams : tuple of Beam, optional
        Shafts with distributed mass between wheels that move in space.
    housing : Housing or None, optional
        Housing to which bearings are attached. Default None: the ground.
    balance : str, default ""
        Name of the wheel whose torque balances all others; "" if the given torques are in equilibrium.
    gyroscopic : bool, default False
        True to include the gyroscopic terms of beams and of wheels that move in space.
    torque_scale, backlash_scale, eps_scale, e_scale, clearance_scale, unbalance_scale : float, default 1.0
        Factors of all mean torques, backlashes, stiffness amplitudes, errors, clearances and unbalances, for use as
        continuation parameters.
    fluctuation_scale : float, default 1.0
        Factor of all torque orders, for use as a continuation parameter.

    Raises
    ------
    ValueError
        If a name is unknown or occurs twice, gears collide, do not match, are locked or have no common frequency, or
        torques are not in equilibrium.

    Examples
    --------
    An idler between two gears: two meshes, each with its own backlash.

    >>> import hbgear as hb
    >>> gears = [hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 30, 40)]
    >>> pairs = [hb.GearPair(a, b, backlash="80 um") for a, b in zip(gears, gears[1:])]
    >>> names = ("in", "idler"), ("idler", "out")
    >>> torques = "100 N m", "120 N m"  # on the first wheel of each mesh
    >>> meshes = [hb.gears.Mesh.of(*two, pair, T) for two, pair, T in zip(names, pairs, torques)]
    >>> places = (0.0, 0.0825, 0.1875)
    >>> wheels = [hb.gears.Wheel.of(name, gear, x=x) for name, gear, x in zip(("in", "idler", "out"), gears, places)]
    >>> wheels[0] = hb.gears.Wheel.of("in", gears[0], torque="100 N m")
    >>> train = hb.gears.Train(wheels, meshes, balance="out")
    >>> round(train.torques["out"], 6), train.orders["out"]
    (-160.0, 0.025)
    >>> [element.name for element in train.system().elements]
    ['in-idler', 'idler-out']
    """

    # ---- matrices in SI units

    def _assembled(self, vectors: Mapping[str, Array]) -> Array:
        """Return a vector of all coordinates from vectors (6,) of wheels and (h,) of the housing, under ""."""
        return np.array([vectors[name][axis] if name in vectors else 0.0 for name, axis in self._coordinates])

    def _from_seat(self, bearing: Bearing, axis: int) -> Array:
        """Return the displacement (n,) of a wheel relative to the seat of its bearing, in one direction."""
        seat = {"": -self.housing.seat(bearing.at, axis)} if self.housing else {}
        return self._assembled({bearing.at: np.eye(6)[axis], **seat})

    def structure(self) -> tuple[Array, Array, Array]:
        """Return M, C, K (n, n) in SI units, without the meshes and the springs of bearings with a clearance."""
        n, masses = len(self._coordinates), {wheel.name: wheel.masses for wheel in self.wheels}
        M = np.diag(self._assembled(masses))
        C, K = np.zeros((2, n, n))
        for bearing in self.bearings:
            k, c = bearing.stiffness, bearing.dampers(masses[bearing.at])
            for axis in range(2 if bearing.clearance else 0, 6):
                w = self._from_seat(bearing, axis)
                K += k[axis] * np.outer(w, w)
                C += c[axis] * np.outer(w, w)
        for shaft in self.shafts:
            a, b = masses[shaft.first], masses[shaft.second]
            joined = np.divide(a * b, a + b, out=np.zeros(6), where=a + b > 0)
            k, c = shaft.stiffness, 2 * shaft.damping * np.sqrt(shaft.stiffness * joined)
            for axis in range(6):
                unit = np.eye(6)[axis]
                w = self._assembled({shaft.first: unit, shaft.second: -unit})
                K += k[axis] * np.outer(w, w)
                C += c[axis] * np.outer(w, w)
        for beam in self.beams:
            mass, stiffness, _ = beam.matrices
            damping = beam.dampers(masses[beam.first], masses[beam.second])
            for total, part in ((M, mass), (C, damping), (K, stiffness)):
                self._add(total, beam, part)
        if self.housing:
            for total, part in ((M, self.housing.M), (C, self.housing.C), (K, self.housing.K)):
                total[n - len(part) :, n - len(part) :] += part
        return M, C, K

    def _add(self, total: Array, beam: Beam, part: Array) -> None:
        """Add a matrix of all nodes of a beam to a matrix of all coordinates."""
        indices = {coordinate: i for i, coordinate in enumerate(self._coordinates)}
        nodes = [(name, axis) for name in (beam.first, *beam.nodes, beam.second) for axis in range(6)]
        present = [i for i, coordinate in enumerate(nodes) if coordinate in indices]  # a held wheel has no rotation
        rows = [indices[nodes[i]] for i in present]
        total[np.ix_(rows, rows)] += part[np.ix_(present, present)]

    def mesh_vectors(self) -> Array:
        """Return the directions of the gaps as columns (n, m), in SI units."""
        kinematics, columns = self._kinematics, []
        for mesh, side, angles in zip(self.meshes, kinematics.sides, kinematics.angles, strict=True):
            outer, inner = inner_first(mesh, self._by_name)
            first, second = line_of_action(mesh, side, angles, outer, inner)
            columns.append(self._assembled({outer.name: first, inner.name: second}))
        return np.array(columns).T

    def _speed_terms(self, scale: Array) -> SpeedTerms | None:
        """Return gyroscopic terms and bearing tables, dimensionless and over Omega instead of a wheel speed."""
        kinematics, n = self._kinematics, len(self._coordinates)
        indices = {coordinate: i for i, coordinate in enumerate(self._coordinates)}
        G = np.zeros((n, n))
        for wheel in self.wheels if self.gyroscopic else ():
            i, j = indices.get((wheel.name, 3)), indices.get((wheel.name, 4))
            if i is not None and j is not None:
                G[i, j] = wheel.inertia * float(kinematics.speeds[wheel.name] / kinematics.ratio)
                G[j, i] = -G[i, j]
        for beam in self.beams if self.gyroscopic else ():
            self._add(G, beam, float(kinematics.speeds[beam.first] / kinematics.ratio) * beam.matrices[2])
        products = np.outer(scale, scale)
        units = {"table": self.k_mean, "damping_table": self.m_c * self.omega_n}
        tables = {name: self._tables(name, products / unit) for name, unit in units.items()}
        gyroscopic = products * G / self.m_c if G.any() else None
        if gyroscopic is None and not any(tables.values()):
            return None
        return SpeedTerms(gyroscopic, 1.0, tables["damping_table"], tables["table"])

    def _tables(self, name: str, factor: Array) -> MatrixTable | None:
        """Return the tables of all bearings as one table over Omega, for the common range of frequencies."""
        pairs = [(bearing, getattr(bearing, name)) for bearing in self.bearings if getattr(bearing, name)]
        if not pairs:
            return None
        per_speed = {b.at: self.orders.get(b.at, 0.0) * self.omega_n for b, _ in pairs}  # rad/s at Omega = 1
        stationary = next((name for name, speed in per_speed.items() if not speed), None)
        if stationary is not None:
            raise ValueError(
                f"Train: the bearing at '{stationary}' has a table over a speed, but the wheel does not turn"
            )
        scaled = [(bearing, table, np.asarray(table.Omega) / per_speed[bearing.at]) for bearing, table in pairs]
        low, high = max(speeds[0] for *_, speeds in scaled), min(speeds[-1] for *_, speeds in scaled)
        if low >= high:
            raise ValueError("Train: the tables of the bearings have no speed in common; give longer ones")
        Omega = np.unique(np.concatenate([[low, high], *(speeds for *_, speeds in scaled)]))
        Omega = Omega[(Omega >= low) & (Omega <= high)]
        matrices = np.zeros((len(Omega), *factor.shape))
        for bearing, table, _ in scaled:
            if not {(bearing.at, 0), (bearing.at, 1)} <= set(self._coordinates):
                raise ValueError(
                    f"Train: the bearing at '{bearing.at}' has a table of x and y, in which the wheel cannot move"
                )
            w = np.array([self._from_seat(bearing, axis) for axis in (0, 1)])
            for i, frequency in enumerate(Omega.tolist()):
                matrices[i] += w.T @ table(frequency * per_speed[bearing.at]) @ w
        return MatrixTable(Omega, matrices * factor)

    @property
    def reactions(self) -> dict[str, Reaction]:
        """Radial and axial bearing forces over k_mean b_c, without bearings with speed tables or radial clearances."""
        masses, forces = {wheel.name: wheel.masses for wheel in self.wheels}, {}
        for bearing in self.bearings:
            if bearing.table is not None or bearing.damping_table is not None:
                continue
            k, c = bearing.stiffness / self.k_mean, bearing.dampers(masses[bearing.at]) / (self.m_c * self.omega_n)
            for direction, axes in (("radial", (0, 1)), ("axial", (2,))):
                if k[list(axes)].any() and not (bearing.clearance and direction == "radial"):
                    rows = np.array([self._from_seat(bearing, axis) for axis in axes])
                    forces[f"{bearing.at} {direction}"] = Reaction(
                        k[list(axes), None] * rows, c[list(axes), None] * rows
                    )
        return forces

    # ---- the dimensionless system

    def system(self) -> System:
        """Return the dimensionless equations of motion with one element for each mesh.

        The module docstring states the scaling. A mesh with friction has three more elements, "A-B friction 1" to 3.
        """
        S, motion = self.units / self.b_c, self._kinematics
        SS, m_c, omega_n = np.outer(S, S), self.m_c, self.omega_n
        M, C, K = self.structure()
        gaps = [
            Element(
                direction=S * w,
                law=self._mesh_law(mesh, order, lag),
                displacement=in_order(mesh.error_used().scaled(self.e_scale / self.b_c), order, lag),
                damping=2 * mesh.damping * sqrt(self._equivalent_mass(mesh) * mesh.k_mean) / (m_c * omega_n),
                name=mesh.name,
            )
            for w, mesh, order, lag in zip(
                self.mesh_vectors().T, motion.meshes, motion.orders, motion.lags, strict=True
            )
        ]
        friction = [
            element
            for i, (mesh, gap) in enumerate(zip(self.meshes, gaps, strict=True))
            for element in friction_elements(mesh, gap, self._by_name, motion, i, lambda w: S * self._assembled(w))
        ]
        remove_rotation = self._rotation_remover(SS * M, SS * K, S) if friction else lambda vector: vector
        gaps += [
            x if i % 3 == 0 else dataclasses.replace(x, direction=remove_rotation(np.asarray(x.direction)))
            for i, x in enumerate(friction)
        ]
        gaps += self._clearances(S)
        torques = {name: np.array([0.0] * 5 + [torque]) for name, torque in self.torques.items()}
        force = self.k_mean * self.b_c
        housing = self.housing.names if self.housing else ()
        return System(
            M=SS * M / m_c,
            C=SS * C / (m_c * omega_n),
            K=SS * K / self.k_mean,
            elements=gaps,
            load=[
                Load(constant=remove_rotation(S * self._assembled(torques) / force)),
                *self._unbalances(S / force),
                *self._fluctuations(S / force, remove_rotation),
            ],
            dof_names=[f"{AXES[axis]}_{name}" if name else housing[axis] for name, axis in self._coordinates],
            speed=self._speed_terms(S),
        )

    def _rotation_remover(self, M: Array, K: Array, scale: Array) -> Callable[[Array], Array]:
        """Return a function that removes the part of a force that turns the whole train."""
        speeds = dict(self._kinematics.speeds)
        speeds |= {node: speeds[beam.first] for beam in self.beams for node in beam.nodes}
        turn = (
            np.array([float(speeds[name]) if name and axis == 5 else 0.0 for name, axis in self._coordinates]) / scale
        )
        return lambda vector: without_rotation(vector, turn, M, K)

    def _mesh_law(self, mesh: Mesh, order: int, lag: float) -> Law:
        """Return the dimensionless force law of a mesh."""
        b, ratio = self.backlash_scale * mesh.half_backlash / self.b_c, mesh.k_mean / self.k_mean
        if mesh.contacts is None:
            return Backlash(b=b, stiffness=in_order(mesh.stiffness_used(self.eps_scale), order, lag).scaled(ratio))
        return contacts_in_order(mesh.contacts, order, lag).scaled(ratio, 1 / self.b_c).widened(b)

    def _clearances(self, scale: Array) -> list[Element]:
        """Return the elements of bearings with a clearance.

        A bearing of equal springs in x and y has a round hole; otherwise each direction has a spring beyond a gap.
        """
        elements = []
        for bearing in self.bearings:
            c = bearing.dampers(self._by_name[bearing.at].masses) / (self.m_c * self.omega_n)
            gap, stiffnesses = self.clearance_scale * bearing.clearance / self.b_c, (bearing.x, bearing.y)
            W = [scale * self._from_seat(bearing, axis) for axis in range(2)] if bearing.clearance else []
            is_round = stiffnesses[0] == stiffnesses[1] and all(w.any() for w in W)
            for axis, w in enumerate(W):
                if stiffnesses[axis] and w.any():
                    k, name = stiffnesses[axis] / self.k_mean, f"{bearing.at} {AXES[axis]}"
                    law: Law = Component(RadialClearance(k, gap), axis) if is_round else Backlash(gap, k)
                    elements.append(Element(w, law, damping=float(c[axis]), name=name))
        return elements

    def _unbalances(self, scale: Array) -> list[Load]:
        """Return the load F = U omega^2 (cos theta, sin theta) of every unbalanced wheel.

        theta = start_angle + angle + omega t is the angle of the unbalance.
        """
        loads = []
        for wheel in self.wheels:
            if not wheel.unbalance or not self.unbalance_scale:
                continue
            speed = self._kinematics.speeds[wheel.name] / self._kinematics.ratio
            size = self.unbalance_scale * wheel.unbalance * (float(speed) * self.omega_n) ** 2
            turn = size * np.exp(1j * (self._kinematics.start_angles[wheel.name] + wheel.unbalance_angle))
            direction = 1.0 if speed > 0 else -1.0
            x, y = (scale * self._assembled({wheel.name: np.eye(6)[axis]}) for axis in (0, 1))
            order = abs(int(speed))
            cosine, sine = turn.real * x + turn.imag * y, direction * (turn.real * y - turn.imag * x)
            loads.append(Load(cosine={order: cosine}, sine={order: sine}, power=2))
        return loads

    def _fluctuations(self, scale: Array, remove_rotation: Callable[[Array], Array]) -> list[Load]:
        """Return the load T cos(order theta + phase) of every torque order, theta = start_angle + omega t."""
        loads = []
        for wheel in self.wheels:
            if not self.fluctuation_scale or not wheel.torque_orders:
                continue  # a wheel that does not turn has no angle, and no orders
            speed, start_angle = self._kinematics.speeds[wheel.name], self._kinematics.start_angles[wheel.name]
            direction = remove_rotation(scale * self._assembled({wheel.name: np.eye(6)[5]}) * self.fluctuation_scale)
            for order, amplitude, phase in wheel.torque_orders:
                multiple = int(exact_order(wheel.name, order) * abs(speed) / self._kinematics.ratio)
                angle = (order * start_angle + phase) * (1 if speed > 0 else -1)
                loads.append(order_load(multiple, amplitude, angle, direction))
        return loads
