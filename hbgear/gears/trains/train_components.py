"""Components of a train: wheels, shafts, bearings and meshes. Numbers are in SI units.

A wheel has the coordinates x, y, z (along its axis) and the right-handed rotations about these axes. Bearings and
shafts act on these coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sqrt
from typing import Any, Literal

import numpy as np

from hbgear.common.argument_checks import NamedFields, check
from hbgear.common.arrays import Array
from hbgear.common.ranges import ANY, NOT_NEGATIVE, POSITIVE, Range, counted
from hbgear.common.text.messages import quoted
from hbgear.common.units import OptionalQuantityField, QuantityField, to_si
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.geometry import shaft_stiffness
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.mesh.mesh_cycle import MeshCycle
from hbgear.gears.mesh.mesh_excitation import amplitudes, checked_lags, lagged_series, mesh_stiffness
from hbgear.gears.mesh.mesh_models import mesh_model
from hbgear.gears.torque_orders import torque_orders
from hbgear.mechanics.laws.laws import checked_contact
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.speed_terms import MatrixTable

WHEEL_COORDINATES = {"torsion": (5,), "plane": (0, 1, 5), "space": (0, 1, 2, 3, 4, 5)}
"""Indices of the coordinates of a wheel for each value of `Wheel.moves`."""


MIN_HALF_BACKLASH = 1e-15
"""Smallest half backlash [m] except zero: it is the unit of length, and squares of displacements are finite."""


def check_half_backlash(owner: str, name: str, value: float) -> None:
    """Raise an error for a half backlash that is too small for a unit of length."""
    if 0 < value < MIN_HALF_BACKLASH:
        raise ValueError(f"{owner}: {name} = {value:g} m must be 0 or at least {MIN_HALF_BACKLASH:g} m")


def _check_names(owner: str, *names: Any) -> None:
    """Raise an error if a name is not a non-empty text."""
    for name in names:
        if not isinstance(name, str) or not name:
            raise ValueError(f"{owner}: {quoted(name)} is not the name of a wheel; give a text such as 'pinion'")


def check_ends(owner: str, first: Any, second: Any) -> None:
    """Raise an error if the two ends are not names of two different wheels."""
    _check_names(owner, first, second)
    if first == second:
        raise ValueError(f"{owner}: both ends are '{second}'; name two wheels")


@dataclass(frozen=True)
class Wheel(NamedFields):  # numpydoc ignore=PR02
    """Gear or other turning body of a train: a rotor, a flange, a machine.

    Parameters
    ----------
    name : str
        Name by which shafts, bearings and meshes refer to it.
    inertia : float or str
        Moment of inertia about its axis [kg m^2].
    mass : float or str, default 0.0
        Mass [kg]; required if the wheel moves sideways.
    tilt_inertia : float or str, optional
        Moment of inertia about a diameter [kg m^2]. Default: half of ``inertia``, the value of a thin disc.
    teeth, base_radius : int and float or str, default 0
        Number of teeth and base radius [m] of a gear; 0 for other wheels.
    internal : bool, default False
        True for a ring gear.
    x, y, z : float or str, default 0.0
        Position of the centre [m].
    moves : {"torsion", "plane", "space"}, default "torsion"
        Motion: rotation only; "plane", also sideways; "space", also along the axis and tilting.
    torque : float or str, default 0.0
        Mean external torque [N m], counter-clockwise positive.
    torque_orders : mapping, optional
        Harmonics of the torque by order of the rotation of this wheel, such as ``{2: "60 N m"}`` or ``{2: ("60 N m",
        "30 deg")}`` with a phase; see `hbgear.gears.torque_orders`. The angle of the shaft is counter-clockwise
        positive. Their frequencies are then also multiples of Omega.
    held : bool, default False
        True if the wheel cannot turn.
    angle : float or str, default 0.0
        Angle of the middle of a tooth when the shaft is at angle 0 [rad].
    unbalance : float or str, default 0.0
        Mass times eccentricity [kg m] of a wheel that can move sideways. The frequency of rotation of this wheel is
        then also a multiple of Omega.
    unbalance_angle : float or str, default 0.0
        Angle of the unbalance when the shaft is at angle 0 [rad].

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range, or a required quantity is missing.

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
    torque_orders: Any = ()

    def __post_init__(self) -> None:
        _check_names("Wheel", self.name)
        counted(f"{self.name}: teeth", self.teeth, 10_000, least=0)
        check(self.name, "internal", self.internal, bool)
        check(self.name, "held", self.held, bool)
        if not isinstance(self.moves, str) or self.moves not in WHEEL_COORDINATES:
            raise ValueError(f"{self.name}: moves = {quoted(self.moves)} must be one of {', '.join(WHEEL_COORDINATES)}")
        if (self.teeth > 0) != (self.base_radius > 0):
            raise ValueError(
                f"{self.name}: a gear needs teeth and base_radius, other wheels neither; "
                f"got {self.teeth} teeth and {self.base_radius:g} m"
            )
        if self.moves != "torsion" and not self.mass:
            raise ValueError(f"{self.name} moves in {self.moves}: give its mass [kg]")
        object.__setattr__(self, "torque_orders", torque_orders(self.name, self.torque_orders))
        if self.torque_orders and self.held:
            raise ValueError(f"{self.name} cannot turn, so its torque has no orders of its rotation; omit one of both")
        if self.unbalance and self.moves == "torsion":
            raise ValueError(f"{self.name} has an unbalance and cannot move sideways: give moves='plane' or 'space'")

    @classmethod
    def of(cls, name: str, gear: Gear, **others: Any) -> Wheel:
        """Return the wheel of a `Gear`: its teeth, base radius, inertias and mass; ``others`` are further fields."""
        check("Wheel.of", "gear", gear, Gear)
        if gear.rack:
            raise ValueError("Wheel.of: the gear is a rack, and all wheels of a train turn; use GearPair.model")
        fields = {
            "inertia": gear.inertia_used,
            "mass": gear.mass_used,
            "tilt_inertia": gear.transverse_inertia,
            "teeth": gear.teeth,
            "base_radius": gear.base_diameter / 2,
            "internal": gear.internal,
        }
        return cls(name, **{**fields, **others})

    @property
    def masses(self) -> Array:
        """Inertias (6,) of the six coordinates."""
        tilt = 0.5 * self.inertia if self.tilt_inertia is None else self.tilt_inertia
        return np.array([self.mass] * 3 + [tilt, tilt, self.inertia])


@dataclass(frozen=True)
class Shaft(NamedFields):  # numpydoc ignore=PR02
    """Massless connection of two wheels on one axis: springs between their coordinates, each with a damper.

    Parameters
    ----------
    first, second : str
        Names of the wheels.
    torsion : float or str, default 0.0
        Torsional stiffness [N m/rad].
    bending : float or str, default 0.0
        Stiffness between the lateral displacements [N/m].
    axial : float or str, default 0.0
        Axial stiffness [N/m].
    tilt : float or str, default 0.0
        Stiffness between the tilts [N m/rad].
    damping : float or str, default 0.02
        Damping ratio of each spring with the two inertias that it joins.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range, or both ends are the same wheel.

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
        check_ends("Shaft", self.first, self.second)

    @property
    def name(self) -> str:
        """Name in tables and error messages."""
        return f"{self.first}-{self.second}"

    @classmethod
    def section(
        cls,
        first: str,
        second: str,
        outer: Any,
        length: Any,
        inner: Any = 0.0,
        E: Any = 2.06e11,
        poisson: Any = 0.3,
        damping: Any = 0.02,
    ) -> Shaft:
        """Return a shaft of a hollow round section, diameters ``outer`` and ``inner``."""
        size = _Section(outer, length, inner, E, poisson)
        if size.inner >= size.outer:
            raise ValueError(f"Shaft: inner = {size.inner:g} m must be smaller than outer = {size.outer:g} m")
        k = shaft_stiffness(size.E, size.poisson, size.outer, size.inner, size.length)
        return cls(first, second, k.torsional, k.bending, k.axial, 0.0, damping)

    @property
    def stiffness(self) -> Array:
        """Stiffnesses (6,) between the coordinates."""
        return np.array([self.bending, self.bending, self.axial, self.tilt, self.tilt, self.torsion])


@dataclass(frozen=True)
class _Section:
    """Dimensions of a shaft section, with units."""

    outer: QuantityField = QuantityField("m", POSITIVE, Range(1e-4, 20))
    length: QuantityField = QuantityField("m", POSITIVE, Range(1e-4, 1e3))
    inner: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 20))
    E: QuantityField = QuantityField("Pa", POSITIVE, Range(1e6, 1e13))
    poisson: QuantityField = QuantityField("", Range(above=-1, high=0.5))


@dataclass(frozen=True)
class Bearing(NamedFields):  # numpydoc ignore=PR02
    """Springs and dampers between a wheel and the ground or the housing.

    Parameters
    ----------
    at : str
        Name of the wheel.
    x, y, z : float or str, default 0.0
        Stiffness [N/m].
    tilt_x, tilt_y : float or str, default 0.0
        Stiffness against tilting [N m/rad].
    turn : float or str, default 0.0
        Stiffness against rotation [N m/rad], for a flange.
    damping : float or str, default 0.02
        Damping ratio with the inertias of the wheel, for directions without a given damper.
    c_x, c_y, c_z : float or str, optional
        Damping coefficients [N s/m].
    table, damping_table : MatrixTable or None, optional
        Stiffness [N/m] and damping [N s/m] in x and y, (T, 2, 2), over the speed of the wheel [rad/s], added to the
        other springs and dampers.
    clearance : float or str, default 0.0
        Radial clearance [m], half of the diametral one. The springs in x and y act only beyond it. If they are equal,
        the hole is round (`RadialClearance`, evaluated by AFT). If not, each direction acts separately: the hole is the
        square around the round one, and on its diagonal contact begins at 2^(1/2) times the clearance. The dampers
        always act.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range, a table is not for x and y, or a clearance is given without
        springs in x or y or with a stiffness table.

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
        _check_names("Bearing", self.at)
        if self.clearance and (self.table is not None or not (self.x or self.y)):
            raise ValueError(
                f"Bearing: at '{self.at}', clearance = {self.clearance:g} m needs springs x or y that act "
                "beyond it, and no table of the stiffness"
            )
        for name in ("table", "damping_table"):
            table = getattr(self, name)
            check("Bearing", name, table, MatrixTable | None)
            if table is not None and table.matrices.shape[1:] != (2, 2):
                raise ValueError(
                    f"Bearing: {name} has matrices of shape {table.matrices.shape[1:]}; need (2, 2), for x and y"
                )

    @property
    def name(self) -> str:
        """Name in tables and error messages."""
        return self.at

    @property
    def stiffness(self) -> Array:
        """Stiffnesses (6,) of the six coordinates."""
        return np.array([self.x, self.y, self.z, self.tilt_x, self.tilt_y, self.turn])

    def dampers(self, masses: Array) -> Array:
        """Return the damping coefficients (6,) for a wheel with these inertias (6,)."""
        c = 2 * self.damping * np.sqrt(self.stiffness * masses)
        for i, damper in enumerate((self.c_x, self.c_y, self.c_z)):
            c[i] = c[i] if damper is None else damper
        return c


@dataclass(frozen=True)
class Mesh(NamedFields):  # numpydoc ignore=PR02
    """Pair of meshing gears.

        k(tau) = k_mean [1 - sum_l eps[l-1] cos(l tau - eps_lag[l-1])],   e(tau) = sum_l e[l-1] cos(l tau - e_lag[l-1])

    tau is the phase of this mesh if the first wheel drives the second. In a train in which the second one drives, all
    functions of tau run backwards.

    Parameters
    ----------
    first, second : str
        Names of the wheels.
    k_mean : float or str
        Mean stiffness along the normal of the flanks [N/m], which is the line of action of spur gears.
    half_backlash : float or str, default 0.0
        Half backlash b along the normal [m].
    eps, eps_lag : tuple of float, optional
        Amplitudes of the stiffness over its mean and their phase lags [rad].
    e, e_lag : tuple of float, optional
        Amplitudes of the transmission error [m] and their phase lags [rad].
    stiffness, error : Phased or None, optional
        Functions instead of the amplitudes, a `Series` or a `Periodic`: k(tau)/k_mean and e(tau) [m].
    contacts : MeshContacts or None, optional
        Contacts of a tooth-resolved mesh instead of eps and stiffness: stiffness over k_mean and initial gaps [m],
        without backlash. `Mesh.of` computes them from a drawing.
    damping : float or str, default 0.05
        Damping ratio of the mesh with the equivalent mass of the two wheels.
    pressure_angle : float or str, optional
        Working pressure angle in the transverse plane [rad]. Default: from the positions of the wheels, else 20 deg.
    helix_angle : float or str, default 0.0
        Helix angle at the base circle [rad], positive for a right-hand first wheel.
    direction : float or str, optional
        Direction from the first to the second wheel [rad]. Default: from their positions.
    lag : float or str, optional
        Phase lag of this mesh behind the first mesh of the train, in its own tau [rad]. Default: from the tooth
        numbers.
    pitch_phase : float or str, default 0.0
        Value of tau at which a pair of teeth is in contact at the pitch point, in the middle of the face [rad].
    thickness : tuple of float, default (0.5, 0.5)
        Thickness of the teeth of the first and the second wheel on their working pitch circles, over the pitch. The
        phases of the meshes of an idler depend on it; profile shifts change it.
    torque : float or str, optional
        Torque on the first wheel for which stiffness and error were computed [N m]; a train checks it against its
        static torques. Default: no check.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range, or the stiffness or the error is given twice.

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
    contacts: MeshContacts | None = None
    torque: OptionalQuantityField = OptionalQuantityField("N m", POSITIVE, Range(0, 1e9))
    thickness: tuple[float, ...] = (0.5, 0.5)

    def __post_init__(self) -> None:
        _check_names("Mesh", self.first, self.second)
        object.__setattr__(self, "thickness", amplitudes("Mesh", "thickness", self.thickness))
        if len(self.thickness) != 2 or not all(0 < x < 1 for x in self.thickness):
            raise ValueError(f"Mesh: thickness = {self.thickness} must be two numbers between 0 and 1, over the pitch")
        check_half_backlash("Mesh", "half_backlash", self.half_backlash)
        if self.first == self.second:
            raise ValueError(f"Mesh: '{self.first}' cannot mesh with itself; name two wheels")
        for name in ("eps", "e"):
            values = amplitudes("Mesh", name, getattr(self, name))
            object.__setattr__(self, name, values)
            object.__setattr__(self, f"{name}_lag", checked_lags("Mesh", name, values, getattr(self, f"{name}_lag")))
        for name, amplitude_name in (("stiffness", "eps"), ("error", "e")):
            function = getattr(self, name)
            check("Mesh", name, function, Phased | None)
            if function is not None and getattr(self, amplitude_name):
                raise ValueError(f"Mesh: {name} and {amplitude_name} are both given; keep one")
        if self.stiffness is not None:
            checked_contact("Mesh", self.stiffness)
        check("Mesh", "contacts", self.contacts, MeshContacts | None)
        if self.contacts is not None and (self.stiffness is not None or self.eps):
            raise ValueError("Mesh: contacts and a stiffness are both given; give eps=() and no stiffness")
        if any(abs(x) > 5e-3 for x in self.e):
            raise ValueError(f"Mesh: e = {self.e} is in m and too large for any machine; give 5e-6 for 5 um")

    @classmethod
    def of(
        cls,
        first: str,
        second: str,
        pair: GearPair,
        torque: Any,
        damping: Any = 0.05,
        *,
        mesh: str | None = None,
        cycle: MeshCycle | None = None,
        friction: Any = 0.0,
        **others: Any,
    ) -> Mesh:
        """Return the mesh of a `GearPair` whose pinion is the first wheel, under a torque on the pinion.

        Contacts or stiffness and error, backlash, angles, the phase of the pitch point and the thickness of the teeth
        follow from the pair. The options ``mesh``, the model of the mesh, ``cycle``, tables of it, and ``friction``,
        the coefficient of friction between the teeth, are those of `GearPair.model`. The mean torques of a train remain
        those without losses, also behind a mesh with friction. The damping ratio refers to the same stiffness in all
        models of the mesh. The transverse stiffness and gaps of helical teeth are converted to
        the normal of the flanks, k_n = k_t / cos^2(beta_b), b_n = b_t cos(beta_b).
        """
        check("Mesh.of", "pair", pair, GearPair)
        check("Mesh.of", "cycle", cycle, MeshCycle | None)
        if pair.wheel.rack:
            raise ValueError("Mesh.of: the wheel is a rack, and all wheels of a train turn; use GearPair.model")
        torque = to_si("Mesh.of", "torque", torque, "N m")
        model = mesh_model("Mesh.of", pair, torque, mesh, cycle, friction, 1)
        c = cos(pair.pinion.base_helix_angle)
        contacts = model.contacts if model.contacts is None or c == 1 else model.contacts.scaled(1.0, c)
        if contacts is not None and contacts.sliding is not None:  # its forces are those of the transverse displacement
            sliding = contacts.sliding.changed(lambda function: function.scaled(c))
            contacts = replace(contacts, sliding=replace(sliding, cosine=c))
        error = model.error if model.error is not None and model.error.varies else None
        fields: dict[str, Any] = {
            "k_mean": model.k_mean / c**2,
            "half_backlash": pair.half_backlash * c,
            "stiffness": model.stiffness,
            "error": None if error is None else error.scaled(c),
            "contacts": contacts,
            "pressure_angle": pair.working_pressure_angle,
            "helix_angle": pair.pinion.base_helix_angle,
            "pitch_phase": 2 * pi * pair.pitch_position,
            "thickness": pair.thickness,
            "damping": damping,
            "torque": torque,
        }
        result = cls(first, second, **{**fields, **others})
        return replace(result, damping=result.damping * sqrt(model.k_0 / model.k_mean) / c)

    @property
    def name(self) -> str:
        """Name in tables and legends: "pinion-wheel"."""
        return f"{self.first}-{self.second}"

    def backward(self) -> Mesh:
        """Return the mesh of a second wheel that drives: all functions of tau run backwards."""

        def reverse(function: Phased) -> Phased:
            return function.reversed()

        return replace(
            self,
            pitch_phase=-self.pitch_phase,
            eps_lag=tuple(-x for x in self.eps_lag),
            e_lag=tuple(-x for x in self.e_lag),
            stiffness=None if self.stiffness is None else reverse(self.stiffness),
            error=None if self.error is None else reverse(self.error),
            contacts=None if self.contacts is None else self.contacts.changed(reverse, reverse),
        )

    def stiffness_used(self, scale: float = 1.0) -> Phased:
        """Return k(tau)/k_mean with its alternating part times a factor."""
        if self.stiffness is not None:
            return self.stiffness.varied(scale)
        return mesh_stiffness(self.eps, scale, self.eps_lag)

    def error_used(self) -> Phased:
        """Return e(tau) [m]."""
        return lagged_series(self.e, self.e_lag) if self.error is None else self.error


def tooth_counts(wheels: Sequence[Wheel], meshes: Sequence[Mesh]) -> str:
    """Return the tooth counts of meshes in words: "25/40 and 20/60"."""
    teeth = {wheel.name: wheel.teeth for wheel in wheels}
    pairs = [f"{teeth.get(mesh.first, 0)}/{teeth.get(mesh.second, 0)}" for mesh in meshes]
    return " and ".join([", ".join(pairs[:-1]), pairs[-1]]) if len(pairs) > 1 else "".join(pairs)
