"""What a train is made of: wheels, the shafts between them, bearings and meshes. Numbers in SI.

A wheel has the coordinates x, y, z (along its axis) and the rotations about these, all positive to the right hand;
bearings and shafts act between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, Literal

import numpy as np

from hbgear.common.argument_checks import check
from hbgear.common.arrays import Array
from hbgear.common.ranges import ANY, NOT_NEGATIVE, POSITIVE, Range, counted
from hbgear.common.text.messages import quoted
from hbgear.common.units import OptionalQuantityField, QuantityField
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.geometry import shaft_stiffness
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.mesh.mesh_cycle import MeshCycle
from hbgear.gears.mesh.mesh_excitation import amplitudes, checked_lags, lagged_series, mesh_stiffness
from hbgear.mechanics.laws.laws import checked_contact
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.speed_terms import MatrixTable

MOTIONS = {"torsion": (5,), "plane": (0, 1, 5), "space": (0, 1, 2, 3, 4, 5)}
"""Coordinates that a wheel has by the way it moves."""


def _named(owner: str, *names: Any) -> None:
    for name in names:
        if not isinstance(name, str) or not name:
            raise ValueError(f"{owner}: {quoted(name)} is no name of a wheel; need a text such as 'pinion'")


def joined(owner: str, first: Any, second: Any) -> None:
    """Refuse what joins a wheel with itself, or no wheels."""
    _named(owner, first, second)
    if first == second:
        raise ValueError(f"{owner}: it ends at '{second}', where it begins; name two wheels")


@dataclass(frozen=True)
class Wheel:
    """A gear, or anything else that turns: a rotor, a flange, a machine.

    Parameters
    ----------
    name : str
        By which shafts, bearings and meshes know it.
    inertia : float or str
        About its axis [kg m^2].
    mass : float or str, default 0.0
        [kg]; needed if it moves sideways.
    tilt_inertia : float or str, optional
        About a diameter [kg m^2]; half of the inertia by default, that of a thin disc.
    teeth, base_radius : int, optional
        Of a gear; 0 and 0 m of anything else.
    internal : bool, default False
        Of a ring.
    x, y, z : float or str, default 0.0
        Where its centre is [m].
    moves : {"torsion", "plane", "space"}, default "torsion"
        "torsion", turning alone; "plane", sideways too; "space", along its axis and tilting too.
    torque : float or str, default 0.0
        On it from outside [N m], counter-clockwise positive.
    held : bool, default False
        Whether it cannot turn.
    angle : float or str, default 0.0
        Of the middle of a tooth, when its shaft is at 0 [rad].
    unbalance : float or str, default 0.0
        Mass times eccentricity [kg m], of a wheel that can move sideways. Omega is then the frequency of which the
        turns of that wheel are a multiple too.
    unbalance_angle : float or str, default 0.0
        Where it is, when its shaft is at 0 [rad].

    Raises
    ------
    ValueError
        If a quantity is in another unit or out of range, or something is missing.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion = hb.gears.Wheel.of("pinion", hb.gears.Gear(teeth=25, module="3 mm", face_width="20 mm"),
    ...     torque="200 N m")
    >>> pinion.teeth, round(pinion.base_radius * 1e3, 2)
    (25, 35.24)
    """

    name: str
    inertia: QuantityField = QuantityField("kg m^2", POSITIVE, Range(1e-10, 1e8))
    mass: QuantityField = QuantityField("kg", NOT_NEGATIVE, Range(0, 1e7), 0.0)
    tilt_inertia: OptionalQuantityField = OptionalQuantityField("kg m^2", POSITIVE, Range(1e-10, 1e8))
    teeth: int = 0
    base_radius: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 50), 0.0)
    internal: bool = False
    x: QuantityField = QuantityField("m", ANY, Range(-1e3, 1e3), 0.0)
    y: QuantityField = QuantityField("m", ANY, Range(-1e3, 1e3), 0.0)
    z: QuantityField = QuantityField("m", ANY, Range(-1e3, 1e3), 0.0)
    moves: Literal["torsion", "plane", "space"] = "torsion"
    torque: QuantityField = QuantityField("N m", ANY, Range(-1e9, 1e9), 0.0)
    held: bool = False
    angle: QuantityField = QuantityField("rad", ANY, Range(-100, 100), 0.0)
    unbalance: QuantityField = QuantityField("kg m", NOT_NEGATIVE, Range(0, 1e4), 0.0)
    unbalance_angle: QuantityField = QuantityField("rad", ANY, Range(-100, 100), 0.0)

    def __post_init__(self) -> None:
        _named("Wheel", self.name)
        counted(f"{self.name}: teeth", self.teeth, 10_000, least=0)
        check(self.name, "internal", self.internal, bool)
        check(self.name, "held", self.held, bool)
        if not isinstance(self.moves, str) or self.moves not in MOTIONS:
            raise ValueError(f"{self.name}: moves = {quoted(self.moves)} must be one of {', '.join(MOTIONS)}")
        if (self.teeth > 0) != (self.base_radius > 0):
            raise ValueError(f"{self.name}: a gear needs teeth and base_radius, anything else neither; "
                             f"got {self.teeth} teeth and {self.base_radius:g} m")  # fmt: skip
        if self.moves != "torsion" and not self.mass:
            raise ValueError(f"{self.name} moves in {self.moves}: give its mass [kg]")
        if self.unbalance and self.moves == "torsion":
            raise ValueError(f"{self.name} has an unbalance and cannot move sideways: give moves='plane' or 'space'")

    @classmethod
    def of(cls, name: str, gear: Gear, **others: Any) -> Wheel:
        """The wheel of a `Gear`, with its teeth, base radius, inertias and mass; other fields as they are given."""
        check("Wheel.of", "gear", gear, Gear)
        own = {
            "inertia": gear.inertia_used, "mass": gear.mass_used, "tilt_inertia": gear.transverse_inertia,
            "teeth": gear.teeth, "base_radius": gear.base_diameter / 2, "internal": gear.internal,
        }  # fmt: skip
        return cls(name, **{**own, **others})

    @property
    def masses(self) -> Array:
        """Inertias (6,) of its coordinates."""
        tilt = 0.5 * self.inertia if self.tilt_inertia is None else self.tilt_inertia
        return np.array([self.mass] * 3 + [tilt, tilt, self.inertia])


@dataclass(frozen=True)
class Shaft:
    """What joins two wheels on one axis: springs between their coordinates, each with a damper.

    Parameters
    ----------
    first, second : str
        Names of the wheels.
    torsion : float or str, default 0.0
        [N m/rad].
    bending : float or str, default 0.0
        Between their displacements sideways [N/m].
    axial : float or str, default 0.0
        [N/m].
    tilt : float or str, default 0.0
        Between their tilts [N m/rad].
    damping : float or str, default 0.02
        Ratio of each spring with the two inertias that it joins.

    Raises
    ------
    ValueError
        If a quantity is in another unit or out of range, or the shaft ends where it begins.

    Examples
    --------
    >>> import hbgear as hb
    >>> shaft = hb.gears.Shaft.section("motor", "pinion", outer="40 mm", length="200 mm")
    >>> round(shaft.torsion)
    99564
    """

    first: str
    second: str
    torsion: QuantityField = QuantityField("N m/rad", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    bending: QuantityField = QuantityField("N/m", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    axial: QuantityField = QuantityField("N/m", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    tilt: QuantityField = QuantityField("N m/rad", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    damping: QuantityField = QuantityField("", NOT_NEGATIVE, Range(0, 5), 0.02)

    def __post_init__(self) -> None:
        joined("Shaft", self.first, self.second)

    @property
    def name(self) -> str:
        """For tables and errors."""
        return f"{self.first}-{self.second}"

    @classmethod
    def section(
        cls, first: str, second: str, outer: Any, length: Any, inner: Any = 0.0, E: Any = 2.06e11, poisson: Any = 0.3,
        damping: Any = 0.02,
    ) -> Shaft:  # fmt: skip
        """Return a shaft of a hollow round section, diameters ``outer`` and ``inner``."""
        size = _Section(outer, length, inner, E, poisson)
        if size.inner >= size.outer:
            raise ValueError(f"Shaft: inner = {size.inner:g} m must be smaller than outer = {size.outer:g} m")
        k = shaft_stiffness(size.E, size.poisson, size.outer, size.inner, size.length)
        return cls(first, second, k.torsional, k.bending, k.axial, 0.0, damping)

    @property
    def stiffness(self) -> Array:
        """Springs (6,) between the coordinates."""
        return np.array([self.bending, self.bending, self.axial, self.tilt, self.tilt, self.torsion])


@dataclass(frozen=True)
class _Section:
    """Sizes of a shaft section as quantities."""

    outer: QuantityField = QuantityField("m", POSITIVE, Range(1e-4, 20))
    length: QuantityField = QuantityField("m", POSITIVE, Range(1e-4, 1e3))
    inner: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 20))
    E: QuantityField = QuantityField("Pa", POSITIVE, Range(1e6, 1e13))
    poisson: QuantityField = QuantityField("", Range(above=-1, high=0.5))


@dataclass(frozen=True)
class Bearing:
    """Springs and dampers from a wheel to the ground.

    Parameters
    ----------
    at : str
        Name of the wheel.
    x, y, z : float or str, default 0.0
        Stiffness [N/m].
    tilt_x, tilt_y : float or str, default 0.0
        Stiffness against tilting [N m/rad].
    turn : float or str, default 0.0
        Stiffness against turning [N m/rad]; of a flange, not of a bearing.
    damping : float or str, default 0.02
        Ratio of the dampers with the inertias of the wheel, where none is given.
    c_x, c_y, c_z : float or str, optional
        Dampers [N s/m].
    table, damping_table : MatrixTable or None, optional
        `MatrixTable` of stiffness [N/m] and dampers [N s/m] in x and y, (T, 2, 2), over the speed of the wheel [rad/s],
        beside the others.
    clearance : float or str, default 0.0
        Radial, half of the diametral one [m]. The springs in x and y then act beyond it only, each direction by itself:
        the hole is a square around the round one, and on its diagonal contact begins at 2^(1/2) of the clearance. The
        dampers always act.

    Raises
    ------
    ValueError
        If a quantity is in another unit or out of range, a table is not of x and y, or there is a clearance without
        springs in x or y, or with a table of them.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.gears.Bearing("pinion", x="3e8 N/m", y="3e8 N/m").damping
    0.02
    """

    at: str
    x: QuantityField = QuantityField("N/m", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    y: QuantityField = QuantityField("N/m", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    z: QuantityField = QuantityField("N/m", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    tilt_x: QuantityField = QuantityField("N m/rad", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    tilt_y: QuantityField = QuantityField("N m/rad", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    turn: QuantityField = QuantityField("N m/rad", NOT_NEGATIVE, Range(0, 1e14), 0.0)
    damping: QuantityField = QuantityField("", NOT_NEGATIVE, Range(0, 5), 0.02)
    c_x: OptionalQuantityField = OptionalQuantityField("N s/m", NOT_NEGATIVE, Range(0, 1e12))
    c_y: OptionalQuantityField = OptionalQuantityField("N s/m", NOT_NEGATIVE, Range(0, 1e12))
    c_z: OptionalQuantityField = OptionalQuantityField("N s/m", NOT_NEGATIVE, Range(0, 1e12))
    table: MatrixTable | None = None
    damping_table: MatrixTable | None = None
    clearance: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 1e-2), 0.0)

    def __post_init__(self) -> None:
        _named("Bearing", self.at)
        if self.clearance and (self.table is not None or not (self.x or self.y)):
            raise ValueError(f"Bearing: at '{self.at}', clearance = {self.clearance:g} m needs springs x or y that act "
                             "beyond it, and no table of the stiffness")  # fmt: skip
        for name in ("table", "damping_table"):
            table = getattr(self, name)
            check("Bearing", name, table, MatrixTable | None)
            if table is not None and table.matrices.shape[1:] != (2, 2):
                raise ValueError(f"Bearing: {name} has matrices of shape {table.matrices.shape[1:]}; need (2, 2), of x "
                                 "and y")  # fmt: skip

    @property
    def name(self) -> str:
        """For tables and errors."""
        return self.at

    @property
    def stiffness(self) -> Array:
        """Springs (6,)."""
        return np.array([self.x, self.y, self.z, self.tilt_x, self.tilt_y, self.turn])

    def dampers(self, masses: Array) -> Array:
        """Dampers (6,) of a wheel of these inertias (6,)."""
        c: Array = 2 * self.damping * np.sqrt(self.stiffness * masses)
        for i, given in enumerate((self.c_x, self.c_y, self.c_z)):
            c[i] = c[i] if given is None else given
        return c


@dataclass(frozen=True)
class Mesh:
    """Two gears that mesh, the first driving the second.

        k(tau) = k_mean [1 - sum_l eps[l-1] cos(l tau - eps_lag[l-1])],   e(tau) = sum_l e[l-1] cos(l tau - e_lag[l-1])

    tau is the phase of its own meshing.

    Parameters
    ----------
    first, second : str
        Names of the wheels.
    k_mean : float or str
        Mean stiffness along the line of action in the transverse plane [N/m].
    half_backlash : float or str, default 0.0
        B along the line of action [m].
    eps, eps_lag : tuple of float, optional
        Amplitudes of the stiffness over its mean, and their lags [rad].
    e, e_lag : tuple of float, optional
        Amplitudes of the transmission error [m], and their lags [rad].
    stiffness, error : Phased or None, optional
        Functions in their place, a `Series` or `Periodic`: k(tau)/k_mean and e(tau) [m].
    damping : float or str, default 0.05
        Ratio of the mesh with the equivalent mass of the two wheels.
    pressure_angle : float or str, optional
        In the transverse plane, at work [rad]; of the places of the wheels by default, or else 20 deg.
    helix_angle : float or str, default 0.0
        At the base circle [rad], positive of a right-handed first wheel.
    direction : float or str, optional
        From the first to the second wheel [rad]; of their places by default.
    lag : float or str, optional
        By which this mesh comes after the first one of the train [rad of its own tau]; of the numbers of teeth by
        default.
    pitch_phase : float or str, default 0.0
        Tau at which a pair of teeth touches in the pitch point [rad].

    Raises
    ------
    ValueError
        If a quantity is in another unit or out of range, or two things are given where one can be.

    Examples
    --------
    >>> import hbgear as hb
    >>> mesh = hb.gears.Mesh("pinion", "wheel", k_mean="4e8 N/m", half_backlash="40 um", eps=(0.2,))
    >>> mesh.k_mean
    400000000.0
    """

    first: str
    second: str
    k_mean: QuantityField = QuantityField("N/m", POSITIVE, Range(1e2, 1e13))
    half_backlash: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 5e-3), 0.0)
    eps: tuple[float, ...] = ()
    eps_lag: tuple[float, ...] = ()
    e: tuple[float, ...] = ()
    e_lag: tuple[float, ...] = ()
    stiffness: Phased | None = None
    error: Phased | None = None
    damping: QuantityField = QuantityField("", NOT_NEGATIVE, Range(0, 1), 0.05)
    pressure_angle: OptionalQuantityField = OptionalQuantityField("rad", Range(above=0, below=pi / 2))
    helix_angle: QuantityField = QuantityField("rad", Range(above=-pi / 2, below=pi / 2), ANY, 0.0)
    direction: OptionalQuantityField = OptionalQuantityField("rad", ANY, Range(-100, 100))
    lag: OptionalQuantityField = OptionalQuantityField("rad", ANY, Range(-1e4, 1e4))
    pitch_phase: QuantityField = QuantityField("rad", ANY, Range(-1e4, 1e4), 0.0)

    def __post_init__(self) -> None:
        _named("Mesh", self.first, self.second)
        if self.first == self.second:
            raise ValueError(f"Mesh: '{self.first}' cannot mesh with itself; name two wheels")
        for name in ("eps", "e"):
            values = amplitudes("Mesh", name, getattr(self, name))
            object.__setattr__(self, name, values)
            object.__setattr__(self, f"{name}_lag", checked_lags("Mesh", name, values, getattr(self, f"{name}_lag")))
        for name, other in (("stiffness", "eps"), ("error", "e")):
            given = getattr(self, name)
            check("Mesh", name, given, Phased | None)
            if given is not None and getattr(self, other):
                raise ValueError(f"Mesh: {name} and {other} are both given; keep one")
        if self.stiffness is not None:
            checked_contact("Mesh", self.stiffness)
        if any(abs(x) > 5e-3 for x in self.e):
            raise ValueError(f"Mesh: e = {self.e} is in m, and beyond any machine: give 5e-6 for 5 um")

    @classmethod
    def of(cls, first: str, second: str, pair: GearPair, torque: Any, damping: Any = 0.05, *,
           cycle: MeshCycle | None = None, **others: Any) -> Mesh:  # fmt: skip
        """The mesh of a `GearPair` whose pinion is the first wheel, under a torque on it.

        Stiffness, error, backlash, angles and the phase of the pitch point are those of ``pair.mesh(torque)``, or of a
        cycle that is given.
        """
        check("Mesh.of", "pair", pair, GearPair)
        cycle = pair.mesh(torque) if cycle is None else cycle
        k_mean, stiffness, error = cycle.functions(pair.transverse_force(torque))
        begin = pair.path[0]
        pitch = (np.sqrt(pair.working_radii[0] ** 2 - pair.base_radii[0] ** 2) - begin) / pair.base_pitch
        own: dict[str, Any] = {
            "k_mean": k_mean, "half_backlash": pair.half_backlash, "stiffness": stiffness,
            "error": error if error.varies else None, "pressure_angle": pair.working_pressure_angle,
            "helix_angle": pair.pinion.base_helix_angle, "pitch_phase": 2 * pi * float(pitch), "damping": damping,
        }  # fmt: skip
        return cls(first, second, **{**own, **others})

    @property
    def name(self) -> str:
        """For tables and legends: "pinion-wheel"."""
        return f"{self.first}-{self.second}"

    def stiffness_used(self, scale: float = 1.0) -> Phased:
        """k(tau)/k_mean, its alternating part times a factor."""
        if self.stiffness is not None:
            return self.stiffness.varied(scale)
        return mesh_stiffness(self.eps, scale, self.eps_lag)

    def error_used(self) -> Phased:
        """e(tau) [m]."""
        return lagged_series(self.e, self.e_lag) if self.error is None else self.error
