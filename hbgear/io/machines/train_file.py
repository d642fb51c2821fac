"""Files of gear trains (TOML), checked before any computation.

    balance = "wheel"

    [[wheel]]
    name = "pinion"
    torque = "200 N m"
    torque_orders = { 2 = "60 N m" }        # of this wheel; optional
    gear = { teeth = 25, module = "3 mm", face_width = "20 mm" }

    [[wheel]]
    name = "wheel"
    gear = { teeth = 40, module = "3 mm", face_width = "20 mm" }

    [[mesh]]
    first = "pinion"
    second = "wheel"
    torque = "200 N m"
    pair = { backlash = "80 um" }

Keys are the fields of `Train`, `Wheel`, `Shaft`, `Beam`, `Bearing`, `Mesh` and `Housing`; quantities are text with a
unit, or numbers in SI. A wheel is given by its fields or by those of its `Gear`; a mesh by its fields, or by those of
its `GearPair` and a torque on the first wheel, which determine stiffness, error, angles and backlash. This torque is
the static torque by default, unless several meshes share the load; in an epicyclic set it is the share of one planet.

    [[bearing]]             # a table over the wheel speed
    at = "pinion"
    table = { speed = ["600 r/min", "3000 r/min"], matrices = [[[1e8, 0.0], [0.0, 1e8]], [[2e8, 0.0], [0.0, 2e8]]] }

    [housing]               # rows of numbers, or files as for `hb.io.from_matrices`
    M = "mass.mtx"
    K = "stiffness.mtx"
    names = ["left", "right"]
    seats = { pinion = { y = "left" } }

    [epicyclic]             # the gears turn on a carrier: an `EpicyclicSet`, without shafts, bearings and housing
    planets = 3
    torque = "100 N m"      # of the driver; the other fields have the defaults of `EpicyclicSet`
    bodies = [["large", "small"]]
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from hbgear.common.process.signals import defer_signals
from hbgear.common.units import to_si
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.planets.epicyclic import EpicyclicSet
from hbgear.gears.trains.beam import Beam
from hbgear.gears.trains.housing import Housing
from hbgear.gears.trains.train import Train
from hbgear.gears.trains.train_components import Bearing, Mesh, Shaft, Wheel
from hbgear.gears.trains.train_layout import check_mesh_torque
from hbgear.io.machines.toml_file import (
    MESH_MODEL,
    QUANTITY,
    TORQUE_ORDERS,
    KeyPath,
    Problems,
    bare,
    constructed,
    form,
    read_checked,
    recorded,
    strict_schema,
)
from hbgear.io.matrices import from_matrices
from hbgear.mechanics.structures.speed_terms import MatrixTable


def read_train(path: str | os.PathLike[str]) -> Train | EpicyclicSet:
    """Read and check the .toml file of a train, or of an epicyclic set if it has a table ``[epicyclic]``.

    TomlFileError is raised if the file cannot be read, a key, type, unit or value is wrong, or the gears cannot be
    made or do not mesh.
    """
    return read_checked(path, "a train", _schema(), _train)


@defer_signals()  # pydantic panics on Ctrl-C while it creates a model
def _schema() -> Any:
    """Return the schema of the file, a pydantic model."""
    gear = form("gear", Gear, ("teeth", "module", "face_width"))
    pair = form("pair", GearPair, (), ("pinion", "wheel"))
    of_pair = {
        "pair": (pair, None),
        "torque": (QUANTITY, None),
        "mesh_model": (MESH_MODEL, None),
        "friction": (float, 0.0),
    }
    table = strict_schema("table", speed=(list[QUANTITY], ...), matrices=(list[list[list[float]]], ...))
    matrix: Any = str | list[list[float]]
    housing = strict_schema(
        "housing",
        **{"M": (matrix, ...), "K": (matrix, ...), "C": (matrix, None)},
        names=(list[str], ()),
        seats=(dict[str, dict[str, str]], {}),
    )
    epicyclic = strict_schema(
        "epicyclic",
        planets=(int, ...),
        torque=(QUANTITY, ...),
        carrier_inertia=(QUANTITY, 0.01),
        bodies=(list[list[str]], ()),
        **dict.fromkeys(("driver", "output", "fixed"), (str, "")),
        torque_orders=(TORQUE_ORDERS, ()),
    )
    lists: dict[str, Any] = {
        "wheel": form("wheel", Wheel, ("name",), gear=(gear, None)),
        "shaft": form("shaft", Shaft, ("first", "second")),
        "beam": form("beam", Beam, ("first", "second", "outer")),
        "bearing": form("bearing", Bearing, ("at",), _TABLES, **dict.fromkeys(_TABLES, (table, None))),
        "mesh": form("mesh", Mesh, ("first", "second"), _FUNCTIONS, **of_pair),
    }
    keys: dict[str, Any] = {
        name: (list[schema], ... if name in ("wheel", "mesh") else [])  # type: ignore[valid-type]
        for name, schema in lists.items()
    } | {"balance": (str, ""), "gyroscopic": (bool, False), "housing": (housing, None), "epicyclic": (epicyclic, None)}
    return strict_schema("train", **keys)


_TABLES = ("table", "damping_table")
"""Fields of a bearing that are tables over speed."""

_FUNCTIONS = ("stiffness", "error", "contacts")
"""Fields of a mesh that a file cannot hold."""


def _train(data: Mapping[str, Any], folder: Path, problems: Problems) -> Train | EpicyclicSet | None:
    """Return the train or epicyclic set; None if a value was refused."""
    gears: dict[str, Gear] = {}
    wheels = [_wheel(("wheel", i), table, gears, problems) for i, table in enumerate(data["wheel"])]
    shafts, beams = (
        [constructed(problems, (name, i), cls, table) for i, table in enumerate(data.get(name, []))]
        for name, cls in (("shaft", Shaft), ("beam", Beam))
    )
    set_fields = _epicyclic_fields(data, problems) if "epicyclic" in data else None

    def machine(meshes: list[Mesh]) -> Train | EpicyclicSet:
        if set_fields is not None:
            return EpicyclicSet(wheels, meshes, **set_fields)  # type: ignore[arg-type]
        return Train(wheels, meshes, shafts, beams=beams, balance=data.get("balance", ""))  # type: ignore[arg-type]

    tables = data["mesh"] if problems else _with_torques(data["mesh"], machine)
    meshes = [_mesh(("mesh", i), table, gears, problems) for i, table in enumerate(tables)]
    if set_fields is not None:
        return _epicyclic(wheels, meshes, set_fields, problems)
    bearings = [_bearing(("bearing", i), table, problems) for i, table in enumerate(data.get("bearing", []))]
    housing = _housing(data["housing"], folder, problems) if "housing" in data else None
    if problems:
        return None
    options = {name: data[name] for name in ("balance", "gyroscopic") if name in data}
    parts = {"wheels": wheels, "meshes": meshes, "shafts": shafts, "bearings": bearings, "beams": beams}
    return constructed(problems, ("mesh", 0), Train, {**parts, "housing": housing, **options})


def _with_torques(
    tables: list[dict[str, Any]], machine: Callable[[list[Mesh]], Train | EpicyclicSet]
) -> list[dict[str, Any]]:
    """Return the tables of the meshes, with the static torque of meshes of a pair that state none, if it is known."""
    if all("torque" in table or "pair" not in table for table in tables):
        return tables
    try:
        torques = machine([Mesh(table["first"], table["second"], "1e8 N/m", "0 um") for table in tables]).mesh_torques
    except (ValueError, KeyError):
        return tables  # the machine itself is refused with the reason
    return [
        {"torque": float(f"{torque:.12g}"), **table} if torque is not None and "pair" in table else table
        for table, torque in zip(tables, torques.values(), strict=True)
    ]


_QUANTITIES = {"torque": "N m", "carrier_inertia": "kg m^2"}
"""Units of the quantities of an epicyclic set."""


def _epicyclic_fields(data: Mapping[str, Any], problems: Problems) -> dict[str, Any]:
    """Return the fields of the table [epicyclic] in SI."""
    fields = dict(data["epicyclic"])
    for name in data.keys() - {"wheel", "mesh", "epicyclic"}:
        problems.append(((name,), f"an epicyclic set has no {name}; remove it, or the table [epicyclic]"))
    for name, unit in _QUANTITIES.items():
        if name in fields:
            with recorded(problems, ("epicyclic", name)):
                fields[name] = to_si("EpicyclicSet", name, fields[name], unit)
    return fields


def _epicyclic(
    wheels: list[Wheel | None], meshes: list[Mesh | None], fields: Mapping[str, Any], problems: Problems
) -> EpicyclicSet | None:
    """Return the epicyclic set; None if a value was refused."""
    if problems:
        return None
    made = constructed(problems, ("epicyclic",), EpicyclicSet, {"wheels": wheels, "meshes": meshes, **fields})
    if made is not None and not made.torque_orders:
        for i, (mesh, static) in enumerate(zip(made.meshes, made.mesh_torques.values(), strict=True)):
            with recorded(problems, ("mesh", i)):
                check_mesh_torque("EpicyclicSet", "the share of one planet", mesh, static)
    return None if problems else made


def _wheel(key_path: KeyPath, table: Mapping[str, Any], gears: dict[str, Gear], problems: Problems) -> Wheel | None:
    """Return a wheel given by its fields, or by its gear, which is stored by the name of the wheel."""
    fields = {name: value for name, value in table.items() if name != "gear"}
    if "gear" not in table:
        if "inertia" not in fields:
            problems.append((key_path, f"wheel '{fields['name']}' needs its inertia, or a gear that determines it"))
            return None
        return constructed(problems, key_path, Wheel, fields)
    gear = constructed(problems, (*key_path, "gear"), Gear, table["gear"])
    if gear is None:
        return None
    gears[fields["name"]] = gear
    return constructed(problems, key_path, Wheel, fields, partial(Wheel.of, gear=gear))


def _bearing(key_path: KeyPath, table: Mapping[str, Any], problems: Problems) -> Bearing | None:
    """Return a bearing with its tables over the wheel speed."""
    fields = dict(table)
    for name in _TABLES:
        if fields.get(name) is not None:
            try:
                speeds = [to_si("Bearing", f"{name}.speed", speed, "rad/s") for speed in fields[name]["speed"]]
                fields[name] = MatrixTable(speeds, fields[name]["matrices"])
            except ValueError as error:
                problems.append(((*key_path, name), bare(error)))
                return None
    return constructed(problems, key_path, Bearing, fields)


def _housing(table: Mapping[str, Any], folder: Path, problems: Problems) -> Housing | None:
    """Return the housing with its matrices from files or rows of numbers."""
    with recorded(problems, ("housing",)):
        sources = {name: table[name] for name in ("M", "K", "C") if table.get(name) is not None}
        matrices = from_matrices({name: folder / x if isinstance(x, str) else x for name, x in sources.items()})
        return Housing(matrices.M, matrices.K, matrices.C, table.get("names", ()), table.get("seats", {}))
    return None


_OF_PAIR = ("mesh_model", "friction")
"""Keys of a mesh that is computed from a pair of gears."""


def _mesh(key_path: KeyPath, table: Mapping[str, Any], gears: Mapping[str, Gear], problems: Problems) -> Mesh | None:
    """Return a mesh given by its fields, or by a pair of two of the gears under a torque."""
    fields = {name: value for name, value in table.items() if name not in ("pair", "torque", *_OF_PAIR)}
    if "pair" not in table and "torque" not in table:
        for name in _OF_PAIR:
            if name in table:
                problems.append(
                    ((*key_path, name), f"{name} needs a mesh that is computed from pair and torque; give them")
                )
                return None
        if "k_mean" not in fields:
            problems.append((key_path, "a mesh needs its k_mean, or pair and torque, which determine it"))
            return None
        return constructed(problems, key_path, Mesh, fields)
    missing = [name for name in (fields["first"], fields["second"]) if name not in gears]
    if missing or "torque" not in table:
        need = f"a wheel '{missing[0]}' with a gear" if missing else "the torque on the first wheel"
        problems.append((key_path, f"a mesh of a pair needs {need}"))
        return None
    gears_of_pair = {"pinion": gears[fields["first"]], "wheel": gears[fields["second"]]}
    pair = constructed(problems, (*key_path, "pair"), GearPair, {**gears_of_pair, **table.get("pair", {})})
    if pair is None:
        return None
    options = {"mesh": table.get("mesh_model"), "friction": table.get("friction", 0.0)}
    make = partial(Mesh.of, pair=pair, torque=table["torque"], **options)
    return constructed(problems, key_path, Mesh, fields, make)
