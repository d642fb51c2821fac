"""Calls of every public function, model and method with one or two invalid or extreme arguments.

    python -m tests.fuzz.inputs --count 10000 --seed 0 --processes 2

A call returns a valid result or raises one of the exceptions `ALLOWED` with a message of hbgear: no message of NumPy or
Python about a wrong type, and no IndexError of an internal function.
"""

from __future__ import annotations

import inspect
import itertools
import math
import os
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
from scipy import sparse

import hbgear as hb
from hbgear import plot
from hbgear.plot.simulations import simulation
from hbgear.time.steady_state import SteadyStateSettings

from . import pool
from .files import _Here

Random = np.random.Generator

NASTY: list[Callable[[], Any]] = [
    lambda: math.inf,
    lambda: -math.inf,
    lambda: math.nan,
    lambda: 0,
    lambda: 0.0,
    lambda: -1,
    lambda: -0.5,
    lambda: 0.5,
    lambda: 1,
    lambda: 2,
    lambda: 7,
    lambda: 1e300,
    lambda: -1e300,
    lambda: 1e-300,
    lambda: 10**30,
    lambda: 10**9,
    lambda: 10**400,
    lambda: True,
    lambda: False,
    lambda: None,
    lambda: "",
    lambda: "x",
    lambda: "0.05",
    lambda: "nan",
    lambda: "Omega",
    lambda: b"x",
    lambda: [],
    lambda: [[]],
    lambda: (),
    lambda: {},
    lambda: {"a": 1},
    lambda: {1: 2},
    lambda: [1.0, 2.0],
    lambda: (1.0, 1.0),
    lambda: (math.nan, 1.0),
    lambda: (0.5, math.inf),
    lambda: [[1.0, 2.0], [3.0, 4.0]],
    lambda: [[1], [2, 3]],
    lambda: ["a", "b"],
    lambda: [None],
    lambda: (1.0, 2.0, 3.0),
    lambda: (-1.0, 1.0),
    lambda: [1j],
    lambda: np.array([]),
    lambda: np.zeros((2, 3)),
    lambda: np.array([math.nan]),
    lambda: np.array(["a"]),
    lambda: np.array(1.0),
    lambda: np.array([1.0, 2.0]),
    lambda: np.eye(2) * 1j,
    lambda: np.array([object()]),
    lambda: np.zeros(10**6),
    lambda: np.float32(0.5),
    lambda: np.int64(3),
    lambda: np.bool_(True),
    lambda: np.float64("nan"),
    lambda: np.ma.masked,
    lambda: np.array([1.0, math.inf]),
    lambda: np.datetime64("2020-01-01"),
    lambda: Fraction(1, 3),
    lambda: Decimal("0.1"),
    lambda: 1j,
    lambda: complex(0.5, 0),
    lambda: object(),
    lambda: int,
    lambda: hb,
    lambda: hb.SpurPair,
    lambda: hb.Duffing,
    lambda: hb.Duffing(),
    lambda: hb.Backlash(),
    lambda: hb.mechanics.Series(1.0),
    lambda: lambda *a: 0,
    lambda: range(3),
    lambda: (x for x in (1, 2)),
    lambda: {1.0, 2.0},
    lambda: Path("x"),
    lambda: print,
    lambda: ...,
    lambda: slice(2),
    lambda: hb.StepControl(),
    lambda: hb.NewtonSettings(),
    lambda: hb.Load(),
    lambda: hb.Status.CLOSED,
    lambda: curve(),
    lambda: point(),
    lambda: balance(),
    lambda: sparse.eye_array(2),
    lambda: NotImplementedError,
    lambda: "x" * 5000,
    lambda: "é",
    lambda: "\x00",
]


@cache
def quintic() -> Any:
    """Return a compiled function of a force."""

    def force(d: float, v: float, tau: float, k: Any) -> tuple[float, float, float]:
        return k[0] * d**5, 5 * k[0] * d**4, 0.0

    return numba.njit(force)


@cache
def balance() -> hb.HarmonicBalance:
    return hb.HarmonicBalance(hb.Duffing(), 3)


@cache
def spur() -> hb.HarmonicBalance:
    return hb.HarmonicBalance(hb.SpurPair(), 3)


@cache
def curve() -> hb.Branch:
    return hb.trace(balance(), "Omega", (0.7, 1.4))


@cache
def gears() -> hb.Branch:
    return hb.trace(spur(), "Omega", (1.5, 0.3))


@cache
def some_cases() -> hb.design.Cases:
    few = hb.design.grid(F=[0.1, 0.18])
    return hb.design.cases(hb.Duffing(), few, ("jumps", "curve"), harmonics=2, span=(0.7, 1.4), executor=_Here())


def point() -> hb.Point:
    return curve()["LP1"]


@cache
def swept() -> Any:
    return hb.time.sweep(hb.Duffing(), [0.9, 1.0], settling=SHORT)


@cache
def system() -> hb.System:
    return hb.System(**{name: values[0]() for name, values in SYSTEM.items()})


SHORT = SteadyStateSettings(1e-2, 20, 4)
FEW = hb.StepControl(max_points=8)
Pool = Mapping[str, list[Callable[[], Any]]]


def _is(*values: Any) -> list[Callable[[], Any]]:
    return [lambda value=value: value for value in values]


GEAR: Pool = {
    "teeth": _is(25, 40),
    "module": _is("3 mm", 3e-3),
    "face_width": _is("20 mm", 0.02),
    "pressure_angle": _is("20 deg"),
    "helix_angle": _is("10 deg", 0.0, -0.2),
    "profile_shift": _is(0.2, "0.1"),
    "internal": _is(False),
    "tip_relief": _is("10 um", 0.0),
    "E": _is("206 GPa"),
    "density": _is(7850.0),
}


def rotor() -> Any:
    """Return an object with the attributes of a ROSS rotor that hbgear reads."""
    M = np.eye(4)
    return SimpleNamespace(
        M=lambda: M, K=lambda speed: M, C=lambda speed: M, G=lambda: 0 * M, number_dof=4, bearing_elements=[]
    )


def assembly() -> Any:
    """Return an object with the attributes of an openTorsion assembly that hbgear reads."""
    return SimpleNamespace(M=np.eye(2), K=np.eye(2), C=np.eye(2), shaft_elements=[])


@cache
def planets() -> hb.Branch:
    """Return a short curve of a planetary set."""
    return hb.trace(hb.HarmonicBalance(hb.gears.PlanetarySet(), 2), "Omega", (2.3, 2.28), stability=False)


@cache
def train() -> hb.gears.Train:
    """Return a train of two gears; the second one balances the torque of the first."""
    a, b = (hb.gears.Wheel(name, 1e-3, teeth=20, base_radius=0.028, torque=10.0 * (name == "a")) for name in "ab")
    return hb.gears.Train([a, b], [hb.gears.Mesh("a", "b", 4e8, 4e-5, eps=(0.2,), e=(1e-4,))], balance="b")


@cache
def drawing() -> hb.GearPair:
    """Return a gear pair from the data of a drawing."""
    return hb.GearPair(hb.gears.Gear(25, 3e-3, 0.02), hb.gears.Gear(40, 3e-3, 0.02), 8e-5)


SYSTEM: Pool = {
    "M": [lambda: np.eye(2), lambda: [[1, 0], [0, 1]], lambda: sparse.eye_array(2)],
    "C": [lambda: 0.1 * np.eye(2), lambda: None],
    "K": [lambda: np.array([[2.0, -1.0], [-1.0, 2.0]])],
    "elements": [lambda: [hb.Element([1.0, 0.0], hb.Unilateral(gap=1.0))]],
    # loads on both coordinates: with an uncoupled K, a load on the second one alone would leave the element at rest
    "load": [lambda: hb.Load(cosine={1: [0.1, 0.2]})],
    "dof_names": _is((), ("a", "b")),
}

RECORDS = {
    "Branch",
    "Jump",
    "NewtonSettings",
    "NoConvergence",
    "Point",
    "Progress",
    "ProgressCallback",
    "SpecialPoint",
    "Status",
    "StepControl",
    "__version__",
    "save",
}
"""Public names that users do not call: results, exceptions and types."""


@dataclass(frozen=True)
class Target:
    """A callable, valid values by parameter, and its weight in random draws; ``use`` is called with the result."""

    name: str
    call: Callable[..., Any]
    good: Pool
    weight: float = 1.0
    use: Callable[[Any], Any] | None = None
    free: frozenset[str] = frozenset()  # parameters that accept any value, also nan


def _traced(model: hb.mechanics.Model) -> Any:
    """Return a short curve of a model."""
    return hb.trace(hb.HarmonicBalance(model, 3), "Omega", model.default_span, steps=FEW)


@cache
def targets() -> tuple[Target, ...]:
    """Return the targets for all public names."""
    row = np.array([0.1, 1.0, 0.2, 0.0, 0.0, 0.0, 0.0])
    span = _is((0.8, 1.0), (1.2, 0.9))
    problem, measure = [balance, spur], _is("rms", "pp2", "max", "mean", "H1")
    element, model = _is(0), [hb.Duffing, hb.SpurPair]
    with_Omega = {"Omega": _is(0.9)}
    series = _is(
        hb.mechanics.Series(1.0),
        hb.mechanics.Series(1.0, (0.1,)),
        hb.mechanics.Periodic.trapezoidal(1.2, 0.8, 0.3, 0.1),
    )
    out = [
        Target("Backlash", hb.Backlash, {"b": _is(1.0, 0.0), "stiffness": series}, 2),
        Target("Unilateral", hb.Unilateral, {"gap": _is(0.5), "stiffness": series}),
        Target("Jenkins", hb.mechanics.Jenkins, {"k": _is(1.0), "limit": _is(0.1)}),
        Target("Cubic", hb.Cubic, {"k3": _is(0.1)}),
        Target(
            "CompiledLaw",
            hb.mechanics.CompiledLaw,
            {
                "function": [quintic],
                "parameters": _is((0.3,)),
                "reference": _is(1.0),
                "breakpoints": _is((), (0.5,)),
                "rated": _is(False),
            },
        ),
        Target(
            "PiecewiseLinear",
            hb.mechanics.PiecewiseLinear,
            {"corners": _is((-1.0, 1.0)), "slopes": _is((1.0, 0.0, 1.0)), "stiffness": series},
        ),
        Target("Parallel", hb.mechanics.Parallel, {"laws": _is((hb.Backlash(), hb.Cubic(0.1)))}),
        Target("Series", hb.mechanics.Series, {"mean": _is(1.0), "cosine": _is((0.1,)), "sine": _is((0.1, 0.2))}),
        Target("Series.__call__", hb.mechanics.Series(1.0, (0.1,)), {"tau": _is(0.3, np.zeros(3))}, 0.5),
        Target("Series.row", hb.mechanics.Series(1.0, (0.1,)).row, {"H": _is(3, None)}, 0.5),
        Target(
            "Periodic", hb.mechanics.Periodic, {"phases": _is((0.0, 1.0)), "coefficients": _is(((1.0,), (0.5, 0.1)))}, 2
        ),
        Target(
            "Periodic.rectangular",
            hb.mechanics.Periodic.rectangular,
            {"high": _is(1.2), "low": _is(0.8), "share": _is(0.6)},
            2,
        ),
        Target(
            "Periodic.trapezoidal",
            hb.mechanics.Periodic.trapezoidal,
            {"high": _is(1.2), "low": _is(0.8), "share": _is(0.3), "ramp": _is(0.1)},
            2,
        ),
        Target(
            "Periodic.table",
            hb.mechanics.Periodic.table,
            {
                "phase": _is([0, 1, 2], [0, 1, 2, 3]),
                "values": _is([0.1, 0.2, 0.3], [0.1, 0.2, 0.3, 0.1]),
                "period": _is(3),
                "kind": _is("linear", "cubic"),
            },
            2,
        ),
        Target(
            "Periodic.__call__", hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.6), {"tau": _is(0.3, np.zeros(3))}, 0.5
        ),
        Target("Periodic.row", hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.6).row, {"H": _is(3)}, 0.5),
        Target("Series.shifted", hb.mechanics.Series(1.0, (0.1,)).shifted, {"phase": _is(0.3)}, 0.5),
        Target("Series.scaled", hb.mechanics.Series(1.0, (0.1,)).scaled, {"factor": _is(0.3)}, 0.5),
        Target(
            "Element",
            hb.Element,
            {
                "direction": _is([1.0, 0.0]),
                "law": _is(hb.Backlash()),
                "displacement": series,
                "damping": _is(0.0, 0.1),
                "name": _is("mesh", ""),
            },
            2,
        ),
        Target(
            "Load",
            hb.Load,
            {"constant": _is(None, [0.1, 0.0]), "cosine": _is({1: [0.0, 0.2]}), "sine": _is({}), "power": _is(0, 2)},
            2,
        ),
        Target("System", hb.System, SYSTEM, 3, _traced),
        Target(
            "MatrixTable",
            hb.mechanics.MatrixTable,
            {"Omega": _is([0.1, 2.0]), "matrices": _is([0.1 * np.eye(2), 0.2 * np.eye(2)])},
            1,
            lambda table: table(1.0),
        ),
        Target(
            "SpeedTerms",
            hb.mechanics.SpeedTerms,
            {
                "gyroscopic": _is(None, [[0.0, 0.1], [-0.1, 0.0]]),
                "ratio": _is(1.0, 0.1),
                "damping": _is(None, hb.mechanics.MatrixTable([0.1, 2.0], [0.1 * np.eye(2), 0.2 * np.eye(2)])),
                "stiffness": [lambda: None, lambda: lambda Omega: 0.1 * Omega * np.eye(2)],
            },
            2,
            lambda terms: _traced(hb.System(**{name: each[0]() for name, each in SYSTEM.items()}, speed=terms)),
        ),
        Target(
            "campbell",
            hb.analysis.campbell,
            {
                "model": [hb.SpurPair, hb.gears.GearRotorBearing],
                "span": _is((0.5, 1.5)),
                "orders": _is(None, {"shaft": 0.1}),
                "points": _is(5),
                "modes": _is(None, 1),
                "closed": _is(True, False),
            },
            1,
        ),
        Target(
            "Matrices",
            hb.io.Matrices,
            {
                "M": SYSTEM["M"],
                "K": SYSTEM["K"],
                "C": SYSTEM["C"],
                "G": _is(None, [[0.0, 0.1], [-0.1, 0.0]]),
                "dof_names": SYSTEM["dof_names"],
            },
            2,
            lambda found: _traced(found.system(SYSTEM["elements"][0](), SYSTEM["load"][0]())),
        ),
        Target(
            "from_matrices",
            hb.io.from_matrices,
            {
                "source": [lambda: {"M": np.eye(2), "K": np.eye(2)}],
                "names": _is(None, {"K": "stiffness"}),
                "dof_names": _is((), ("a", "b")),
            },
        ),
        Target(
            "Receptances",
            hb.mechanics.Receptances,
            {
                "omega": [lambda: np.linspace(0.0, 9.0, 10)],
                "values": [lambda: 1 / (1.5 - np.linspace(0.0, 9.0, 10) + 0.5j)[:, None, None]],
                "names": _is(["x"]),
                "static": _is(None, [[0.5]]),
            },
            2,
            lambda found: found.stiffness(2.5),
        ),
        Target(
            "from_receptances",
            hb.io.from_receptances,
            {
                "source": _is({("a", "a"): "a.csv"}, "a.uff"),
                "static": _is(None, "lowest"),
                "quantity": _is(None, "mobility"),
            },
        ),
        Target(
            "load_sharing", hb.analysis.load_sharing, {"curve": [planets], "meshes": _is(None, ["sun-p1", "sun-p3"])}, 1
        ),
        Target("from_ross", hb.io.from_ross, {"rotor": [rotor]}),
        Target("from_opentorsion", hb.io.from_opentorsion, {"assembly": [assembly]}),
        Target("Settings", hb.NewtonSettings, {}),
        Target("StepControl", hb.StepControl, {}, 2, free=frozenset({"first_step"})),  # None is its default
        Target("Settling", SteadyStateSettings, {}),
        *(Target(cls.__name__, cls, {}, 4, _traced) for cls in (hb.Duffing, hb.SpurPair, hb.gears.GearRotorBearing)),
        Target("PlanetarySet", hb.gears.PlanetarySet, {}, 3, lambda model: hb.HarmonicBalance(model, 2)),
        Target("HelicalPair", hb.gears.HelicalPair, {}, 4, lambda model: hb.HarmonicBalance(model, 2)),
        Target("Gear", hb.gears.Gear, GEAR, 4, lambda gear: (gear.mass_used, gear.inertia_used, gear.form_diameter)),
        Target(
            "Wheel",
            hb.gears.Wheel,
            {
                "name": _is("a"),
                "inertia": _is(1e-3, "1e-3 kg m^2"),
                "mass": _is(0.0, 1.0),
                "teeth": _is(20),
                "base_radius": _is(0.028, "28 mm"),
                "x": _is(0.0, "10 mm"),
                "moves": _is("torsion", "plane"),
                "unbalance": _is(0.0, "10 g mm"),
                "torque": _is(0.0, "10 N m"),
            },
            2,
            lambda wheel: wheel.masses,
        ),
        Target("Shaft", hb.gears.Shaft, {"first": _is("a"), "second": _is("b"), "torsion": _is(1e5)}, 1),
        Target(
            "Shaft.section",
            hb.gears.Shaft.section,
            {"first": _is("a"), "second": _is("b"), "outer": _is("20 mm"), "length": _is("100 mm")},
            1,
        ),
        Target(
            "Bearing",
            hb.gears.Bearing,
            {"at": _is("a"), "x": _is(1e8, "1e8 N/m"), "c_x": _is(None, 100.0), "clearance": _is(0.0, "20 um")},
            1,
        ),
        Target(
            "Beam",
            hb.gears.Beam,
            {
                "first": _is("a"),
                "second": _is("b"),
                "outer": _is("40 mm"),
                "length": _is("0.2 m"),
                "inner": _is(0.0, "10 mm"),
                "elements": _is(2),
            },
            2,
            lambda beam: beam.dampers(np.ones(6), np.ones(6)) if beam.length else None,
        ),
        Target(
            "Housing",
            hb.gears.Housing,
            {
                "M": [lambda: np.eye(2)],
                "K": [lambda: np.eye(2)],
                "names": _is((), ("a", "b")),
                "seats": _is({}, {"a": {"x": "h1"}}),
            },
            1,
            lambda housing: housing.seat("a", 0),
        ),
        Target(
            "Mesh",
            hb.gears.Mesh,
            {
                "first": _is("a"),
                "second": _is("b"),
                "k_mean": _is(4e8),
                "half_backlash": _is(4e-5, "40 um"),
                "eps": _is((), (0.2, 0.1)),
                "e": _is((), (1e-6,)),
                "pressure_angle": _is(None, "20 deg"),
                "lag": _is(None, 0.3),
            },
            2,
            lambda mesh: (
                hb.gears.Train(train().wheels, [mesh], balance="b") if (mesh.first, mesh.second) == ("a", "b") else None
            ),
        ),
        Target(
            "Train",
            hb.gears.Train,
            {
                "wheels": [lambda: train().wheels],
                "meshes": [lambda: train().meshes],
                "bearings": _is((), (hb.gears.Bearing("b", 0.0),)),
                "balance": _is("b"),
                "gyroscopic": _is(False, True),
                "torque_scale": _is(1.0, 0.5),
            },
            2,
            _traced,
        ),
        Target("Support", hb.gears.Support, {"stiffness": _is(3e8, "3e8 N/m"), "tilt": _is(None, 5e5)}, 2),
        Target(
            "GearPair",
            hb.GearPair,
            {
                "pinion": [lambda: hb.gears.Gear(25, 3e-3, 0.02)],
                "wheel": [lambda: hb.gears.Gear(40, 3e-3, 0.02)],
                "backlash": _is("80 um", 8e-5, None),
                "backlash_measure": _is("circumferential", "normal"),
                "center_distance": _is(None, 0.098),
                "pitch_error": _is(0.0, "3 um"),
            },
            3,
            lambda pair: pair.mesh(200.0, phases=16).stiffness.mean,
        ),
        Target(
            "GearPair.mesh", drawing().mesh, {"torque": _is("200 N m", 150.0), "phases": _is(16), "slices": _is(3)}, 2
        ),
        Target(
            "GearPair.model",
            drawing().model,
            {"torque": _is("200 N m", 150.0), "damping": _is(0.04, "4 %"), "supports": _is(None), "cycle": _is(None)},
            2,
        ),
        Target("GearPair.backlash_as", drawing().backlash_as, {"measure": _is("normal", "action")}, 0.5),
        Target("Table", hb.gears.MeshTable, {"phase": _is([0.0, 0.5, 1.0]), "value": _is([1e8, 2e8, 1e8])}, 2),
        Target(
            "MeshCycle",
            hb.gears.MeshCycle,
            {
                "stiffness": [lambda: hb.gears.MeshTable([0.0, 0.5, 1.0], [1e8, 2e8, 1e8])],
                "error": [lambda: hb.gears.MeshTable([0.0, 1.0], [0.0, 0.0])],
                "force": _is(None, 100.0),
            },
        ),
        Target(
            "iso_dynamic_factor",
            hb.gears.iso_dynamic_factor,
            {"pair": _is(drawing()), "torque": _is(200.0, "200 N m"), "speed": _is(1000.0, [1.0, 2.0])},
        ),
        Target("Reaction", hb.mechanics.Reaction, {"stiffness": _is([[1.0, 0.0]]), "damping": _is([[0.1, 0.0]])}),
        Target("read_table", hb.io.read_mesh_table, {"path": _is("no.csv")}),
        Target("dynamic_factor", hb.analysis.dynamic_factor, {"model": _is(hb.Duffing()), "point": [point]}),
        Target("DoubleHelicalPair", hb.gears.DoubleHelicalPair, {}, 4, lambda model: hb.HarmonicBalance(model, 2)),
        Target("Model.replace", hb.Duffing().replace, {"zeta": _is(0.05), "k3": _is(0.1)}),
        Target("DoubleHelicalPair.mesh_frequency", hb.gears.DoubleHelicalPair().mesh_frequency, with_Omega, 0.5),
        Target("DoubleHelicalPair.pinion_speed", hb.gears.DoubleHelicalPair().pinion_speed, with_Omega, 0.5),
        Target("ContactInstants", hb.ContactInstants, {"model": model, "harmonics": _is(3), "nu": _is(1, 2)}),
        Target(
            "HarmonicBalance",
            hb.HarmonicBalance,
            {
                "model": model,
                "harmonics": _is(3, "auto"),
                "samples": _is(None, 32),
                "nu": _is(1, 2),
                "sampled": _is(False, True),
                "orders": _is(None, "meshes", (1, 2, 4)),
            },
            5,
        ),
        Target(
            "HarmonicBalance.with_harmonics_of",
            balance().with_harmonics_of,
            {"curve": _is(curve()), "tolerance": _is(1e-6, 1e-3)},
            0.5,
        ),
        Target("HarmonicBalance.start", balance().start, {**with_Omega, "zeta": _is(0.05)}),
        Target("HarmonicBalance.residual", balance().residual, {"X": _is(row), **with_Omega}),
        Target("HarmonicBalance.multipliers", balance().multipliers, {"X": _is(row), **with_Omega}),
        Target("HarmonicBalance.motion", balance().motion, {"X": _is(row), **with_Omega}),
        Target("HarmonicBalance.mesh_forces", balance().mesh_forces, {"X": _is(row), **with_Omega}),
        Target("HarmonicBalance.with_order", balance().with_order, {"nu": _is(2), "harmonics": _is(None, 4)}, 0.5),
        Target("HarmonicBalance.check_parameter", balance().check_parameter, {"name": _is("zeta")}, 0.5),
        Target(
            "trace",
            hb.trace,
            {
                "problem": problem,
                "parameter": _is("Omega"),
                "span": span,
                "start": _is(None, row),
                "at": _is(None, {"zeta": 0.1}),
                "steps": _is(FEW),
                "stability": _is(True, False),
                "special": _is(True, False),
                "accuracy": _is(None, 1e-4),
            },
            8,
        ),
        Target(
            "trace in F",
            hb.trace,
            {
                "problem": _is(balance()),
                "parameter": _is("F"),
                "span": _is((0.1, 0.2)),
                "at": _is({"Omega": 0.9}),
                "steps": _is(FEW),
            },
            3,
        ),
        *(
            Target(
                f"trace of {cls.__name__}",
                cls,
                {
                    "problem": _is(spur()),
                    "parameter": _is("Omega"),
                    "which": _is(0),
                    "measure": measure,
                    "element": element,
                },
                1,
            )
            for cls in (
                hb.continuation.BranchPointProblem,
                hb.continuation.FoldProblem,
                hb.harmonic.GrazingProblem,
                hb.harmonic.NeimarkSackerProblem,
                hb.harmonic.AmplitudeExtremum,
                hb.harmonic.PeriodDoublingProblem,
            )
        ),
        Target(
            "trace a Fold",
            lambda second, span, start: hb.trace(
                hb.continuation.FoldProblem(spur(), "Omega"), second, span, start, steps=FEW
            ),
            {"second": _is("zeta"), "span": _is((0.05, 0.06)), "start": [lambda: gears()["LP1"]]},
            2,
        ),
        Target(
            "switch",
            hb.switch,
            {
                "branch": [curve, gears],
                "label": _is("LP1", "GR1", "PD1"),
                "span": _is(None, (0.5, 1.5)),
                "side": _is(1, -1),
            },
            2,
        ),
        Target(
            "follow",
            hb.follow,
            {"branch": [gears], "point": _is("LP1", "GR1"), "parameter": _is("zeta"), "span": _is((0.05, 0.06))},
            1,
        ),
        Target("extend", hb.extend, {"branch": [curve, gears], "span": _is((0.5, 1.6))}, 1),
        Target("Event", hb.Event, {"kind": _is("limit"), "test": _is(lambda point: point.amplitude("max") - 2.0)}, 0.5),
        Target(
            "Range",
            hb.mechanics.Range,
            {"low": _is(0.0), "high": _is(1.0)},
            0.3,
            free=frozenset({"low", "high", "above", "below"}),  # the default inf means no limit
        ),
        Target(
            "peaks",
            hb.analysis.peaks,
            {"branch": [curve, gears], "measure": measure, "share": _is(0.0, 0.9), "accuracy": _is(None, 1e-4)},
            2,
        ),
        Target(
            "trace_all",
            hb.trace_all,
            {
                "problem": _is(balance()),
                "span": span,
                "frequencies": _is(1, [0.9]),
                "guesses": _is(1),
                "steps": _is(FEW),
            },
            2,
        ),
        Target(
            "critical",
            hb.analysis.critical_parameter,
            {"model": _is(balance()), "parameter": _is("F"), "frequencies": _is((0.8, 1.3)), "harmonics": _is(3)},
            1,
        ),
        Target(
            "jump_map",
            hb.jump_map,
            {
                "model": _is(balance()),
                "parameter": _is("F"),
                "span": _is((0.17, 0.2)),
                "frequencies": _is((0.8, 1.3)),
                "harmonics": _is(3),
                "seeds": _is(2),
                "steps": _is(hb.StepControl(max_points=200)),
            },
            1,
        ),
        Target("grid", lambda zeta, F: hb.design.grid(zeta=zeta, F=F), {"zeta": _is([0.04, 0.05]), "F": _is([0.1])}),
        Target(
            "saltelli",
            lambda blocks, seed, zeta: hb.design.saltelli(blocks, seed, zeta=zeta),
            {"blocks": _is(2, 4), "seed": _is(0), "zeta": _is(("uniform", 0.04, 0.06))},
            0.5,
        ),
        Target(
            "latin_hypercube",
            lambda count, seed, zeta: list(hb.design.latin_hypercube(count, seed, zeta=zeta).rows()),
            {"count": _is(3), "seed": _is(0), "zeta": _is(("uniform", 0.04, 0.06))},
        ),
        Target(
            "monte_carlo",
            lambda count, seed, zeta: list(hb.design.monte_carlo(count, seed, zeta=zeta).rows()),
            {"count": _is(3), "seed": _is(0), "zeta": _is(("normal", 0.05, 0.01), ("triangular", 0.1, 0.2, 0.3))},
        ),
        *(
            Target(
                "monte_carlo",
                lambda a, b, name=name: list(hb.design.monte_carlo(3, 0, zeta=(name, a, b)).rows()),
                {"a": _is(0.1), "b": _is(0.2)},
                0.5,
            )
            for name in ("uniform", "normal", "lognormal")
        ),
        Target(
            "cases",
            lambda **given: hb.design.cases(**given, executor=_Here()),
            {
                "model": _is(hb.Duffing()),
                "vary": _is(hb.design.grid(F=[0.1])),
                "compute": _is(("peak",), ("jumps", "curve")),
                "critical": _is(()),
                "harmonics": _is(2),
                "span": _is((0.7, 0.9)),
                "measure": measure,
                "element": element,
                "retry": _is(False),
                "most": _is(10),
            },
            3,
        ),
        Target(
            "integrate",
            hb.time.integrate,
            {
                "model": model[:1],
                "state": _is([0.1, 0.0]),
                "periods": _is(2),
                "Omega": _is(0.9),
                "tolerance": _is(1e-6),
                "samples": _is(16),
            },
            2,
        ),
        Target(
            "shoot",
            hb.time.shoot,
            {"model": model[:1], "Omega": _is(0.9), "guess": _is([0.1, 0.0]), "tolerance": _is(1e-8)},
            2,
        ),
        Target(
            "sweep",
            hb.time.sweep,
            {
                "model": model[:1],
                "grid": _is([0.9, 1.0]),
                "direction": _is("up", "down"),
                "start": _is(None, [0.1, 0.0]),
                "settling": _is(SHORT),
            },
            3,
        ),
        Target(
            "basins",
            hb.time.basins,
            {
                "model": model[:1],
                "Omega": _is(1.1),
                "d": _is((-1.0, 1.0)),
                "v": _is((-1.0, 1.0)),
                "shape": _is((2, 2)),
                "settling": _is(SHORT),
            },
            2,
        ),
        Target("validate", hb.validate, {"branch": [curve], "points": _is(1, [3], ["LP1"]), "tolerance": _is(1e-3)}, 1),
        Target(
            "reduce",
            hb.mechanics.reduce,
            {"model": [system, hb.SpurPair], "modes": _is(1, 2), "corrections": _is(1, 3)},
            2,
        ),
        Target("load", hb.load, {"path": _is("no.npz")}, free=frozenset({"problem"})),
        Target("second_opinion", hb.time.compare_multipliers, {"branch": [curve, gears], "point": _is(1, "LP1")}, 0.3),
        Target("run", hb.analysis.run_up, {"branch": [curve], "direction": _is("up", "down")}),
        Target("machine_quantities", hb.analysis.machine_quantities, {"found": [curve, point], "dof": _is(None, 0)}),
        Target(
            "sensitivity",
            hb.analysis.sensitivity,
            {
                "point": [point, lambda: curve()[3], lambda: gears()["GR1"]],
                "parameters": _is(None, ["zeta"]),
                "measure": _is(None, "pp2", "H1"),
                "multipliers": _is(False, True),
            },
            2,
        ),
        Target(
            "Sensitivity.percent", hb.analysis.sensitivity(point()).percent, {"quantity": _is("Omega", "rms", "")}, 0.5
        ),
        Target(
            "Sensitivity.scatter",
            hb.analysis.sensitivity(point()).scatter,
            {"spread": _is({"zeta": 0.01}), "quantity": _is("Omega")},
            0.5,
        ),
        Target(
            "Measurements",
            hb.design.Measurements,
            {
                "frequency": _is([0.8, 0.9]),
                "amplitude": _is([0.3, 0.5]),
                "direction": _is(1, [1, -1]),
                "deviation": _is(None, 0.01),
                "jumps": _is((), [(0.9, 1)]),
                "length": _is("", "um"),
            },
            2,
        ),
        Target("read_measurements", hb.design.read_measurements, {"path": _is("no.csv")}, 0.5),
        Target(
            "fit",
            hb.design.fit,
            {
                "model": model[:1],
                "data": _is(hb.design.Measurements([0.8, 0.9], [0.4, 0.6])),
                "free": _is(["zeta"], {"zeta": (0.02, 0.2)}),
                "harmonics": _is(2),
                "span": _is(None, (1.0, 0.7)),
                "starts": _is(1),
            },
            1,
        ),
        Target(
            "jump_tolerance",
            hb.design.jump_tolerance,
            {"branch": [curve], "spread": _is({"zeta": 0.001}), "draws": _is(3)},
            0.5,
        ),
        Target(
            "sobol_indices",
            hb.design.sobol_indices,
            {"found": [some_cases], "quantity": _is("peak", "jump_rising")},
            0.3,
        ),
        Target(
            "response_band",
            hb.design.response_band,
            {
                "branch": [curve],
                "scatter": _is({"zeta": 0.001}),
                "measure": measure,
                "unit": _is("Omega"),
                "length": _is(""),
            },
            0.5,
        ),
        Target("ResponseBand.edges", hb.design.response_band(curve(), {"zeta": 0.001}).edges, {}, 0.5),
        Target(
            "sweep_statistics",
            hb.design.sweep_statistics,
            {"found": [some_cases], "Omega": _is(None, [0.8, 0.85]), "quantiles": _is((0.5,), (0.05, 0.95))},
            0.5,
        ),
        Target("no_jumps", hb.design.no_jumps, {"margin": _is(0.0, 0.1), "parameter": _is("", "zeta")}, 0.3),
        Target("peak_below", hb.design.peak_below, {"limit": _is(0.9), "measure": measure}, 0.5),
        Target(
            "redesign",
            hb.design.redesign,
            {
                "model": model[:1],
                "goal": _is(hb.design.no_jumps(), hb.design.peak_below(2.0)),
                "over": _is(["zeta"]),
                "within": _is(None, {"zeta": (0.02, 0.2)}),
                "scatter": _is(None, {"zeta": 0.001}),
                "tolerances": _is(None, hb.design.monte_carlo(2, zeta=("normal", 0.0, 0.001))),
                "span": _is((1.4, 0.8)),
                "harmonics": _is(2),
            },
            0.5,
        ),
        Target("Branch.__getitem__", lambda key: curve()[key], {"key": _is(0, "LP1", -1)}),
        Target(
            "Branch.amplitude",
            curve().amplitude,
            {"measure": measure, "dof": _is(None, 0), "derivative": _is(0, 1, 2)},
            3,
        ),
        Target("Branch.peak", curve().peak, {"measure": measure}),
        Target("Branch.parameters_at", curve().parameters_at, {"i": _is(0)}, 0.5),
        Target("Branch.save", curve().save, {"path": _is("a.npz")}, 0.5),
        Target("Branch.export", curve().export, {"path": _is("a.csv", "a.mat")}, 0.5),
        Target("Point.amplitude", point().amplitude, {"measure": measure}),
        Target("Point.coefficients", point().coefficients, {}, 0.5),
        Target("Point.samples", point().samples, {"count": _is(16), "order": _is(0, 1)}),
        Target(
            "plot.response",
            plot.response,
            {"branch": [curve, gears], "measure": measure, "color": _is(None, "r"), "label": _is(None, "a")},
            0.5,
            free=frozenset({"label"}),
        ),
        Target("plot.responses", plot.responses, {"branches": [lambda: [curve()]], "measure": measure}, 0.5),
        Target("ProgressBar", hb.ProgressBar, {"text": _is("a")}, 0.1),
        Target(
            "report", hb.report, {"branches": [curve, gears], "title": _is(None, "a"), "names": _is(None, ["a"])}, 0.2
        ),
        Target("plot.portrait", plot.portrait, {"point": [point]}, 0.3),
        Target("plot.spectrum", plot.spectrum, {"point": [point]}, 0.3),
        Target("plot.sweeps", simulation.sweeps, {"found": [lambda: [swept()]], "measure": measure}, 0.3),
    ]
    return tuple(out)


# ---- invalid values and results


def parameters(target: Target) -> dict[str, Any]:
    """Return the annotations of the parameters as text, by name."""
    return {
        p.name: str(p.annotation) if p.annotation is not p.empty else ""
        for p in inspect.signature(target.call).parameters.values()
        if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)
        and p.name not in ("progress", "report", "executor", "store", "processes", "ax")
    } | {name: "" for name in target.good if _takes_any(target.call)}


def _takes_any(call: Callable[..., Any]) -> bool:
    return any(p.kind == p.VAR_KEYWORD for p in inspect.signature(call).parameters.values())


def invalid_reason(annotation: str, value: Any) -> str:
    """Return the reason why a value does not agree with an annotation, or an empty string."""
    kinds = {part.strip() for part in annotation.split("|")}
    if not kinds <= {"float", "int", "str", "bool", "None"} or not kinds:
        return "a nan" if _holds_nan(value) and annotation != "" else ""
    if value is None:
        return "" if "None" in kinds else "None"
    if isinstance(value, str | bytes):
        return "" if "str" in kinds and isinstance(value, str) else "a text"
    if isinstance(value, bool | np.bool_):
        return "" if kinds & {"bool", "int", "float"} else "a truth value"
    if isinstance(value, int | float | np.integer | np.floating | Fraction | Decimal):
        if not kinds & {"float", "int"}:
            return "" if "bool" in kinds else "a number"
        if isinstance(value, float) and not math.isfinite(value):
            return "not finite"
        return "no whole number" if "float" not in kinds and value != int(value) else ""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return ""
    return f"a {type(value).__name__}"


def _holds_nan(value: Any) -> bool:
    try:
        array = np.asarray(value)
        return array.dtype.kind in "fc" and bool(np.isnan(array).any())
    except (TypeError, ValueError):
        return False


def nonsense(value: Any, depth: int = 0) -> str:
    """Return the reason why a result is invalid, such as non-finite values or a large residual, or an empty string."""
    if isinstance(value, hb.Branch):
        if not (np.isfinite(value.values).all() and np.isfinite(value.X).all()):
            return "rows that are not finite"
        if len(value) == 0:
            return "a branch without rows"
        if np.nanmax(value.residual) > 1e-3:
            return f"a residual of {np.nanmax(value.residual):.1e}"
        if value.layout and len(value) > 2 and not np.any(value.X.reshape(len(value), -1)):
            return "a branch of zeros"
        return ""
    if isinstance(value, float | np.floating):
        return "" if math.isfinite(value) else f"{value}"
    if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
        return "" if np.isfinite(value).all() else "numbers that are not finite"
    if isinstance(value, tuple | list) and depth < 3:
        return next((text for x in value if (text := nonsense(x, depth + 1))), "")
    if isinstance(value, hb.analysis.BranchSearch):
        return nonsense(list(value.branches))
    if isinstance(value, hb.SpurPair | hb.Duffing | hb.gears.GearRotorBearing | hb.gears.DoubleHelicalPair):
        return "" if all(math.isfinite(x) for x in value.parameters.values()) else "parameters that are not finite"
    return ""


ALLOWED = (ValueError, KeyError, TypeError, IndexError, hb.NoConvergence, hb.analysis.NoFoldError, OSError)


def ours(error: BaseException) -> bool:
    """Return whether a statement of hbgear raised the error, not NumPy, SciPy or Python."""
    frames = traceback.extract_tb(error.__traceback__)
    last = frames[-1]
    if "hbgear" not in Path(last.filename).parts:
        return isinstance(error, hb.NoConvergence | OSError)
    return (last.line or "").startswith("raise") or last.line is None or _within_raise(last)


def _within_raise(frame: Any) -> bool:
    """Return whether the line is part of a raise statement over several lines."""
    lines = Path(frame.filename).read_text().splitlines()
    above = [line.strip() for line in lines[max(0, frame.lineno - 6) : frame.lineno]]
    return any(line.startswith("raise") for line in above)


def shortened(value: Any, limit: int = 60) -> str:
    """Return the representation of a value, shortened to ``limit`` characters."""
    text = repr(value).replace("\n", " ")
    return text if len(text) <= limit else f"{text[:limit]}... ({type(value).__name__})"


def make() -> pool.Attempt:
    """Return the attempt of this fuzzer."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot

    all_targets = targets()
    weights = np.array([t.weight for t in all_targets])
    shares = weights / weights.sum()
    swept()

    def attempt(seed: int, folder: Path, note: pool.Note) -> pool.Wrong | None:
        rng = np.random.default_rng([2, seed])
        target = all_targets[int(rng.choice(len(all_targets), p=shares))]
        work = folder / "work"
        work.mkdir(exist_ok=True)
        os.chdir(work)
        try:
            return tried(target, rng, note)
        finally:
            matplotlib.pyplot.close("all")
            for path in work.iterdir():
                path.unlink()

    return attempt


def tried(target: Target, rng: Random, note: pool.Note) -> pool.Wrong | None:
    """Try one call with one or two invalid or extreme arguments."""
    annotations = parameters(target)
    given = {
        name: values[int(rng.integers(len(values)))]() for name, values in target.good.items() if name in annotations
    }
    names = list(annotations)
    count = min(int(rng.choice([1, 2], p=[0.8, 0.2])), len(names))
    nasty = {str(n): NASTY[int(rng.integers(len(NASTY)))]() for n in rng.choice(names, count, replace=False)}
    note(f"{target.name}({', '.join(f'{n}={shortened(v)}' for n, v in nasty.items())}), the rest as usual")
    given |= nasty
    positional = [p.name for p in inspect.signature(target.call).parameters.values() if p.kind == p.POSITIONAL_ONLY]
    args = [given.pop(name) for name in positional if name in given]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = target.call(*args, **given)
            used = result
            reasons = [f"{n} = {invalid_reason(annotations[n], v)}" for n, v in nasty.items() if n not in target.free]
            if (reasons := [text for text in reasons if not text.endswith(" = ")]) and not caught:
                return pool.Wrong("accepted", f"{target.name}: {reasons[0]}", f"gave {shortened(result, 200)}")
            if target.use is not None:
                used = target.use(result)
        except (*ALLOWED, ArithmeticError) as error:
            if isinstance(error, ArithmeticError) and "ArithmeticError" not in (target.call.__doc__ or ""):
                raise
            return refused(target, nasty, error)
    if loud := [str(w.message) for w in caught if "encountered in" in str(w.message)]:
        return pool.Wrong("numpy warns", f"{target.name}: {loud[0][:60]}", f"{loud}"[:300])
    if (text := nonsense(used)) and not caught:
        return pool.Wrong("nonsense", f"{target.name}: {text}", f"{shortened(used, 200)}")
    return None


def refused(target: Target, nasty: dict[str, Any], error: BaseException) -> pool.Wrong | None:
    """Return the invalid outcome of a call that raised an error, if any."""
    text = str(error.args[0]) if error.args else ""
    if not ours(error):
        return pool.Wrong("raw", pool.place(error), f"{type(error).__name__}: {text}"[:300])
    words = pool.raw_words(text)
    if words and not any(words in repr(value) for value in nasty.values()):  # a message may quote the given value
        return pool.Wrong("raw", f"{pool.place(error)}: {words}", text[:300])
    if isinstance(error, IndexError) and target.name not in ("Branch.__getitem__", "Branch.parameters_at"):
        return pool.Wrong("raw", pool.place(error), text[:300])
    quoted = sum(len(repr(value)) for value in nasty.values())
    if len(text) < 15 or len(text) > 1000 + quoted:
        return pool.Wrong("raw", f"{pool.place(error)}: {len(text)} characters", text[:300])
    return None


def uncovered() -> set[str]:
    """Return the public names that have no target and are not in `RECORDS`."""
    called = {name for t in targets() for name in itertools.chain([t.name.split(".")[0]], t.name.split())}
    own = {name for name in hb.__all__ if not isinstance(getattr(hb, name), ModuleType)}  # packages are not called
    return own - called - RECORDS


if __name__ == "__main__":
    pool.main("inputs", make)
