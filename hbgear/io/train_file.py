"""A train of gears as a file (TOML), checked before anything is computed.

    balance = "wheel"

    [[wheel]]
    name = "pinion"
    torque = "200 N m"
    gear = { teeth = 25, module = "3 mm", face_width = "20 mm" }

    [[wheel]]
    name = "wheel"
    gear = { teeth = 40, module = "3 mm", face_width = "20 mm" }

    [[mesh]]
    first = "pinion"
    second = "wheel"
    torque = "200 N m"
    pair = { backlash = "80 um" }

Keys are the fields of `Train`, `Wheel`, `Shaft`, `Bearing` and `Mesh`; quantities are text with a unit, or numbers in
SI. A wheel is given by its fields or by those of its `Gear`, a mesh by its fields or by those of its `GearPair` and a
torque on the first wheel, from which stiffness, error, angles and backlash are computed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Literal

from hbgear.gears.gear import Gear
from hbgear.gears.pair import GearPair
from hbgear.gears.train import Train
from hbgear.gears.train_parts import Bearing, Mesh, Shaft, Wheel
from hbgear.io.toml_file import Place, TomlFileError, exactly, form, located, made, parsed, told

_KINDS: dict[str, Any] = {
    "name": str, "first": str, "second": str, "at": str, "teeth": int, "internal": bool, "held": bool,
    "moves": Literal["torsion", "plane", "space"], "eps": list[float], "eps_lag": list[float], "e": list[float],
    "e_lag": list[float], "backlash_measure": Literal["circumferential", "normal", "action"],
}  # fmt: skip


class TrainFileError(TomlFileError):
    """What is wrong with the file of a train, one text for each error."""


def is_train(path: str | os.PathLike[str]) -> bool:
    """Whether a file is to be a train: it has wheels in a list. False of what cannot be read."""
    try:
        return isinstance(parsed(path, "a train", TrainFileError)[1].get("mesh"), list)
    except TrainFileError:
        return False


def read_train(path: str | os.PathLike[str]) -> Train:
    """Read and check the file of a train.

    Raises
    ------
    TrainFileError
        If it cannot be read, or a key, type, unit or value is wrong, or the gears cannot be made or do not mesh.
    """
    import pydantic

    text, data = parsed(path, "a train", TrainFileError)
    schema = _schema()
    try:
        checked = schema.model_validate(data).model_dump(exclude_unset=True)
    except pydantic.ValidationError as error:
        raise TrainFileError(located(path, text, [told(schema, each) for each in error.errors()])) from None
    problems: list[tuple[Place, str]] = []
    train = _train(checked, problems)
    if train is None:
        raise TrainFileError(located(path, text, problems))
    return train


def _schema() -> Any:
    """The form of the file, as a model of pydantic."""
    from pydantic import create_model

    gear = form("gear", Gear, _KINDS, ("teeth", "module", "face_width"))
    pair = form("pair", GearPair, _KINDS, (), ("pinion", "wheel"))
    mesh = form("mesh", Mesh, _KINDS, ("first", "second"), _FUNCTIONS, pair=(pair, None), torque=(str | float, None))
    lists: dict[str, Any] = {
        "wheel": form("wheel", Wheel, _KINDS, ("name",), gear=(gear, None)),
        "shaft": form("shaft", Shaft, _KINDS, ("first", "second")),
        "bearing": form("bearing", Bearing, _KINDS, ("at",), _TABLES),
        "mesh": mesh,
    }
    whole: dict[str, Any] = {
        name: (list[each], ... if name in ("wheel", "mesh") else [])  # type: ignore[valid-type]
        for name, each in lists.items()
    } | {"balance": (str, ""), "gyroscopic": (bool, False)}
    return create_model("train", __config__=exactly(), **whole)


_TABLES = ("table", "damping_table")
"""Fields of a bearing that a file has no place for."""

_FUNCTIONS = ("stiffness", "error")
"""The same of a mesh."""


def _train(data: Mapping[str, Any], problems: list[tuple[Place, str]]) -> Train | None:
    """The train; None if something was refused."""
    gears: dict[str, Gear] = {}
    wheels = [_wheel(("wheel", i), table, gears, problems) for i, table in enumerate(data["wheel"])]
    meshes = [_mesh(("mesh", i), table, gears, problems) for i, table in enumerate(data["mesh"])]
    shafts, bearings = (
        [made(problems, (name, i), cls, table) for i, table in enumerate(data.get(name, []))]
        for name, cls in (("shaft", Shaft), ("bearing", Bearing))
    )
    if problems:
        return None
    rest = {name: data[name] for name in ("balance", "gyroscopic") if name in data}
    values = {"wheels": wheels, "meshes": meshes, "shafts": shafts, "bearings": bearings, **rest}
    return made(problems, ("mesh", 0), Train, values)  # type: ignore[no-any-return]


def _wheel(
    place: Place, table: Mapping[str, Any], gears: dict[str, Gear], problems: list[tuple[Place, str]]
) -> Wheel | None:
    """A wheel by its fields, or of its gear; that is kept by the name of the wheel."""
    own = {name: value for name, value in table.items() if name != "gear"}
    if "gear" not in table:
        if "inertia" not in own:
            problems.append((place, f"wheel '{own['name']}' needs its inertia, or a gear of which it follows"))
            return None
        return made(problems, place, Wheel, own)  # type: ignore[no-any-return]
    gear = made(problems, (*place, "gear"), Gear, table["gear"])
    if gear is None:
        return None
    gears[own["name"]] = gear
    return made(problems, place, Wheel, own, lambda **given: Wheel.of(gear=gear, **given))  # type: ignore[no-any-return]


def _mesh(
    place: Place, table: Mapping[str, Any], gears: Mapping[str, Gear], problems: list[tuple[Place, str]]
) -> Mesh | None:
    """A mesh by its fields, or of a pair of two of the gears under a torque."""
    own = {name: value for name, value in table.items() if name not in ("pair", "torque")}
    if "pair" not in table and "torque" not in table:
        if "k_mean" not in own:
            problems.append((place, "a mesh needs its k_mean, or pair and torque of which it follows"))
            return None
        return made(problems, place, Mesh, own)  # type: ignore[no-any-return]
    missing = [name for name in (own["first"], own["second"]) if name not in gears]
    if missing or "torque" not in table:
        need = f"a wheel '{missing[0]}' with a gear" if missing else "the torque on the first wheel"
        problems.append((place, f"a mesh of a pair needs {need}"))
        return None
    sides = {"pinion": gears[own["first"]], "wheel": gears[own["second"]]}
    pair = made(problems, (*place, "pair"), GearPair, {**sides, **table.get("pair", {})})
    if pair is None:
        return None
    return made(  # type: ignore[no-any-return]
        problems, place, Mesh, own, lambda **given: Mesh.of(pair=pair, torque=table["torque"], **given)
    )
