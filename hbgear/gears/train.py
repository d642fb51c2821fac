"""Trains of gears: wheels on shafts and bearings with any number of meshes.

    M q'' + (C + Omega G) q' + K q + sum_j w_j [k_j(tau) f(d_j) + c_j d_j'] = F,   d_j = w_j^T q - e_j(tau)

q are the coordinates that the wheels have (`train_parts`), every mesh is an element with its own backlash, stiffness,
error and phase. Omega is the frequency of which all tooth frequencies are multiples (`phasing`): that of the teeth if
there is one only, as with idlers.

Dimensionless form, which `Train.system` returns
------------------------------------------------
Of the first mesh: unit of length its half backlash b_c (of the first that has one), of time sqrt(m_c/k_mean), of force
k_mean b_c, with m_c = 1 / (r_1^2/J_1 + r_2^2/J_2) of its wheels. A rotation enters as r theta/b_c with the base radius
of the wheel, or that of the first wheel of the first mesh where there is none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import ClassVar

import numpy as np

from hbgear.common.arguments import check
from hbgear.common.arrays import Array
from hbgear.common.messages import did_you_mean, quoted
from hbgear.common.ranges import Range
from hbgear.gears.phasing import Kinematics, inner_first, kinematics, line_of_action
from hbgear.gears.support import AXES
from hbgear.gears.train_parts import MOTIONS, Bearing, Mesh, Shaft, Wheel
from hbgear.mechanics.fourier import Series, stretch, to_complex
from hbgear.mechanics.laws import Backlash
from hbgear.mechanics.model import Element, Load, Model, Reaction, System
from hbgear.mechanics.periodic import TURN, Periodic, Phased
from hbgear.mechanics.scales import Scales
from hbgear.mechanics.speed import MatrixTable, SpeedTerms

_NO_LENGTH = 1e-6  # unit of length of a train without backlash [m]


@dataclass(frozen=True)
class Train(Model):
    """Gears on shafts and bearings; equations at the head of this file.

    Parameters
    ----------
    wheels : `Wheel`s, each with its name.
    meshes : `Mesh`es between them, at least one; the first sets the units, and its first wheel the direction.
    shafts, bearings : `Shaft`s and `Bearing`s.
    balance : name of the wheel whose torque is what holds all others; "" if the torques balance as they are.
    gyroscopic : whether wheels that move in space have gyroscopic terms.
    torque_scale, backlash_scale, eps_scale, e_scale : factors of all torques, backlashes, amplitudes of the stiffness
        and errors, to continue in.

    Raises
    ------
    ValueError
        If names do not fit, gears collide, do not fit, are locked or have no common frequency, or torques do not
        balance.

    Examples
    --------
    An idler between two gears: two meshes in line, each with its own backlash.

    >>> import hbgear as hb
    >>> gears = [hb.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 30, 40)]
    >>> pairs = [hb.GearPair(a, b, backlash="80 um") for a, b in zip(gears, gears[1:])]
    >>> names = ("in", "idler"), ("idler", "out")
    >>> meshes = [hb.Mesh.of(*two, pair, "100 N m") for two, pair in zip(names, pairs)]
    >>> places = (0.0, 0.0825, 0.1875)
    >>> wheels = [hb.Wheel.of(name, gear, x=x) for name, gear, x in zip(("in", "idler", "out"), gears, places)]
    >>> wheels[0] = hb.Wheel.of("in", gears[0], torque="100 N m")
    >>> train = hb.Train(wheels, meshes, balance="out")
    >>> round(train.torques["out"], 6), train.orders["out"]
    (-160.0, 0.025)
    >>> [element.name for element in train.system().elements]
    ['in-idler', 'idler-out']
    """

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

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega$, common frequency of the meshes $/ \omega_n$ [-]",
        "amplitude": r"$d / b_c$ [-]",
        "torque_scale": "factor of the torques [-]",
        "backlash_scale": "factor of the backlashes [-]",
        "eps_scale": r"factor of the stiffness amplitudes $\varepsilon_l$",
        "e_scale": r"factor of the errors",
    }
    default_span: ClassVar[tuple[float, float]] = (1.5, 0.3)
    ranges: ClassVar[Mapping[str, Range]] = {"backlash_scale": Range(low=0, high=1e6)}

    def __post_init__(self) -> None:
        for name, kind in (("wheels", Wheel), ("meshes", Mesh), ("shafts", Shaft), ("bearings", Bearing)):
            given = getattr(self, name)
            if not isinstance(given, tuple | list) or not all(isinstance(one, kind) for one in given):
                raise ValueError(f"Train: {name} = {quoted(given)} must be a list of {kind.__name__}(...)")
            object.__setattr__(self, name, tuple(given))
        super().__post_init__()
        check("Train", "gyroscopic", self.gyroscopic, bool)
        if not self.meshes:
            raise ValueError("Train: give at least one Mesh(...)")
        names = [wheel.name for wheel in self.wheels]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise ValueError(f"Train: two wheels are called '{twice}'; each needs a name of its own")
        self._check_places(names)
        self._kinematics  # noqa: B018 refuses trains that cannot turn

    def _check_places(self, names: list[str]) -> None:
        asked = [(f"shaft {s.first}-{s.second}", name) for s in self.shafts for name in (s.first, s.second)]
        asked += [(f"bearing at {b.at}", b.at) for b in self.bearings]
        asked += [("balance", self.balance)] if self.balance else []
        for what, name in asked:
            if name not in names:
                raise ValueError(f"Train: {what}: there is no wheel '{name}'{did_you_mean(name, names)}")

    # ---- how it turns

    @cached_property
    def _by_name(self) -> dict[str, Wheel]:
        """The wheels, the one that holds the rest with its torque."""
        wheels = {wheel.name: wheel for wheel in self.wheels}
        if not self.balance:
            return wheels
        holder = wheels[self.balance]
        if holder.torque:
            raise ValueError(f"Train: '{holder.name}' holds the rest of the torques and has one of its own; keep one")
        free = {name: dataclasses.replace(wheel, torque=0.0) for name, wheel in wheels.items()}
        speeds = kinematics(free, self.shafts, self.meshes).speeds
        if not speeds[holder.name]:
            raise ValueError(f"Train: '{holder.name}' does not turn with the others, so it cannot hold their torques")
        work = sum(wheel.torque * float(speeds[name]) for name, wheel in wheels.items())
        return {**wheels, holder.name: dataclasses.replace(holder, torque=-work / float(speeds[holder.name]))}

    @cached_property
    def _kinematics(self) -> Kinematics:
        return kinematics(self._by_name, self.shafts, self.meshes)

    @property
    def torques(self) -> dict[str, float]:
        """Torque on each wheel from outside [N m]."""
        return {name: self.torque_scale * wheel.torque for name, wheel in self._by_name.items()}

    @property
    def orders(self) -> dict[str, float]:
        """Frequencies over Omega: of every mesh, and of every wheel that turns."""
        found = self._kinematics
        meshes = {mesh.name: float(order) for mesh, order in zip(self.meshes, found.orders, strict=True)}
        return meshes | {name: abs(float(speed / found.ratio)) for name, speed in found.speeds.items() if speed}

    @property
    def lags(self) -> dict[str, float]:
        """By how much each mesh comes after the first one [rad of its own tau]."""
        return {mesh.name: lag for mesh, lag in zip(self.meshes, self._kinematics.lags, strict=True)}

    # ---- units

    @property
    def k_mean(self) -> float:
        """Unit of stiffness, of the first mesh [N/m]."""
        return self.meshes[0].k_mean

    @property
    def b_c(self) -> float:
        """Unit of length, the half backlash of the first mesh that has one [m]."""
        return next((mesh.half_backlash for mesh in self.meshes if mesh.half_backlash), _NO_LENGTH)

    @property
    def m_c(self) -> float:
        """Unit of mass, of the first mesh [kg]."""
        return self._equivalent_mass(self.meshes[0])

    def _equivalent_mass(self, mesh: Mesh) -> float:
        wheels = (self._by_name[name] for name in (mesh.first, mesh.second))
        return 1 / sum(wheel.base_radius**2 / wheel.inertia for wheel in wheels if not wheel.held)

    @property
    def omega_n(self) -> float:
        """Angular frequency of Omega = 1 [rad/s]."""
        return sqrt(self.k_mean / self.m_c)

    @property
    def scales(self) -> Scales:
        """Of the first wheel of the first mesh, as the pinion."""
        teeth = 1 / abs(self.orders[self.meshes[0].first])
        return Scales(self.omega_n, self.b_c, self.k_mean * self.b_c, teeth)

    @cached_property
    def _coordinates(self) -> list[tuple[str, int]]:
        """Wheel and number among `AXES` of every coordinate."""
        return [(wheel.name, axis) for wheel in self.wheels for axis in MOTIONS[wheel.moves]
                if not (wheel.held and axis == 5)]  # fmt: skip

    @property
    def units(self) -> Array:
        """(n,) Physical size of a coordinate of value one: b_c [m], of a rotation b_c / r [rad]."""
        usual = self._by_name[self.meshes[0].first].base_radius
        return np.array([
            self.b_c / ((self._by_name[name].base_radius or usual) if axis > 2 else 1.0)
            for name, axis in self._coordinates
        ])  # fmt: skip

    # ---- matrices in SI units

    def _onto(self, parts: Mapping[str, Array]) -> Array:
        """A vector of the coordinates from those (6,) of some wheels."""
        return np.array([parts[name][axis] if name in parts else 0.0 for name, axis in self._coordinates])

    def structure(self) -> tuple[Array, Array, Array]:
        """M, C, K (n, n) of all but the meshes, in SI units."""
        n, masses = len(self._coordinates), {wheel.name: wheel.masses for wheel in self.wheels}
        M = np.diag(self._onto(masses))
        C, K = np.zeros((2, n, n))
        for bearing in self.bearings:
            K += np.diag(self._onto({bearing.at: bearing.stiffness}))
            C += np.diag(self._onto({bearing.at: bearing.dampers(masses[bearing.at])}))
        for shaft in self.shafts:
            a, b = masses[shaft.first], masses[shaft.second]
            joined = np.divide(a * b, a + b, out=np.zeros(6), where=a + b > 0)
            k, c = shaft.stiffness, 2 * shaft.damping * np.sqrt(shaft.stiffness * joined)
            for axis in range(6):
                unit = np.eye(6)[axis]
                w = self._onto({shaft.first: unit, shaft.second: -unit})
                K += k[axis] * np.outer(w, w)
                C += c[axis] * np.outer(w, w)
        return M, C, K

    def mesh_vectors(self) -> Array:
        """Directions of the gaps as columns (n, m), in SI units."""
        found, columns = self._kinematics, []
        for mesh, side, angles in zip(self.meshes, found.sides, found.angles, strict=True):
            outer, inner = inner_first(mesh, self._by_name)
            first, second = line_of_action(mesh, side, angles, outer, inner)
            columns.append(self._onto({outer.name: first, inner.name: second}))
        return np.array(columns).T

    def _speed_terms(self, scale: Array) -> SpeedTerms | None:
        """Gyroscopic terms and tables of bearings, dimensionless; over Omega, not over the speed of a wheel."""
        found, n = self._kinematics, len(self._coordinates)
        at = {place: i for i, place in enumerate(self._coordinates)}
        G = np.zeros((n, n))
        for wheel in self.wheels if self.gyroscopic else ():
            i, j = at.get((wheel.name, 3)), at.get((wheel.name, 4))
            if i is not None and j is not None:
                G[i, j] = wheel.inertia * float(found.speeds[wheel.name] / found.ratio)
                G[j, i] = -G[i, j]
        both = np.outer(scale, scale)
        units = {"table": self.k_mean, "damping_table": self.m_c * self.omega_n}
        tables = {name: self._tables(name, at, both / unit) for name, unit in units.items()}
        gyroscopic = both * G / self.m_c if G.any() else None
        if gyroscopic is None and not any(tables.values()):
            return None
        return SpeedTerms(gyroscopic, 1.0, tables["damping_table"], tables["table"])

    def _tables(self, name: str, at: Mapping[tuple[str, int], int], factor: Array) -> MatrixTable | None:
        """The tables of all bearings as one over Omega, of the frequencies that all have."""
        found = [(bearing.at, getattr(bearing, name)) for bearing in self.bearings if getattr(bearing, name)]
        if not found:
            return None
        per_speed = {wheel: self.orders.get(wheel, 0.0) * self.omega_n for wheel, _ in found}  # rad/s at Omega = 1
        if not all(per_speed.values()):
            raise ValueError(
                f"Train: the bearing at '{found[0][0]}' has a table over a speed, but the wheel does not turn"
            )
        scaled = [(wheel, table, np.asarray(table.Omega) / per_speed[wheel]) for wheel, table in found]
        low, high = max(each[0] for *_, each in scaled), min(each[-1] for *_, each in scaled)
        if low >= high:
            raise ValueError("Train: the tables of the bearings have no speed in common; give longer ones")
        Omega = np.unique(np.concatenate([[low, high], *(each for *_, each in scaled)]))
        Omega = Omega[(Omega >= low) & (Omega <= high)]
        matrices = np.zeros((len(Omega), *factor.shape))
        for wheel, table, _ in scaled:
            place = [at[wheel, axis] for axis in (0, 1) if (wheel, axis) in at]
            if len(place) < 2:
                raise ValueError(
                    f"Train: the bearing at '{wheel}' has a table of x and y, in which the wheel cannot move"
                )
            for i, w in enumerate(Omega.tolist()):
                matrices[i][np.ix_(place, place)] += table(w * per_speed[wheel])
        return MatrixTable(Omega, matrices * factor)

    @property
    def reactions(self) -> dict[str, Reaction]:
        """Radial and axial forces in the bearings, over k_mean b_c; not of bearings with tables over the speed."""
        masses, found = {wheel.name: wheel.masses for wheel in self.wheels}, {}
        for bearing in self.bearings:
            if bearing.table is not None or bearing.damping_table is not None:
                continue
            k, c = bearing.stiffness / self.k_mean, bearing.dampers(masses[bearing.at]) / (self.m_c * self.omega_n)
            for what, axes in (("radial", (0, 1)), ("axial", (2,))):
                if k[list(axes)].any():
                    rows = np.array([self._onto({bearing.at: np.eye(6)[axis]}) for axis in axes])
                    found[f"{bearing.at} {what}"] = Reaction(k[list(axes), None] * rows, c[list(axes), None] * rows)
        return found

    # ---- the dimensionless system

    def system(self) -> System:
        """Dimensionless equations of motion, an element for each mesh; scaling at the head of this file."""
        S, found = self.units / self.b_c, self._kinematics
        SS, m_c, omega_n = np.outer(S, S), self.m_c, self.omega_n
        M, C, K = self.structure()
        gaps = [
            Element(
                direction=S * w,
                law=Backlash(
                    b=self.backlash_scale * mesh.half_backlash / self.b_c,
                    stiffness=in_order(mesh.stiffness_used(self.eps_scale), order, lag).scaled(
                        mesh.k_mean / self.k_mean
                    ),
                ),
                displacement=in_order(mesh.error_used().scaled(self.e_scale / self.b_c), order, lag),
                damping=2 * mesh.damping * sqrt(self._equivalent_mass(mesh) * mesh.k_mean) / (m_c * omega_n),
                name=mesh.name,
            )
            for w, mesh, order, lag in zip(self.mesh_vectors().T, self.meshes, found.orders, found.lags, strict=True)
        ]
        torques = {name: np.array([0.0] * 5 + [torque]) for name, torque in self.torques.items()}
        return System(
            M=SS * M / m_c,
            C=SS * C / (m_c * omega_n),
            K=SS * K / self.k_mean,
            elements=gaps,
            load=Load(constant=S * self._onto(torques) / (self.k_mean * self.b_c)),
            dof_names=[f"{AXES[axis]}_{name}" for name, axis in self._coordinates],
            speed=self._speed_terms(S),
        )


def in_order(function: Phased, order: int, lag: float) -> Phased:
    """f(order tau - lag) of a function of tau."""
    late: Phased = function.shifted(lag) if lag else function
    if order == 1:
        return late
    if isinstance(late, Series):
        c = to_complex(stretch(late.row(), order))
        return Series(late.mean, tuple(c.real[1:]), tuple(-c.imag[1:]))
    phases = [(phase + TURN * i) / order for i in range(order) for phase in late.phases]
    rows = [tuple(x * float(order) ** q for q, x in enumerate(row)) for row in late.coefficients] * order
    return Periodic(tuple(phases), tuple(rows))
