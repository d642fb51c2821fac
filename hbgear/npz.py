"""Branches as .npz files: a JSON header with everything but the arrays, which lie beside it under their path.

header.npy    {"format": "hbgear branch", "schema": 1, "branch": {"__class__": "Branch", "X": {"__array__": "X"}, ...}}
X.npy, ...    the arrays
"""

from __future__ import annotations

import dataclasses
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hbgear.branch import Branch, Jump, Point, SpecialPoint
from hbgear.measures import Layout
from hbgear.replacing import checked_suffix, replacing

SCHEMA = 1
"""Number of the file format `Branch.save` writes; `load` reads this and all earlier ones."""

_FORMAT = "hbgear branch"


def save(branch: Branch, path: str | os.PathLike[str]) -> None:
    """Write to an .npz with a JSON header, whole or not at all; `load` gives back the same numbers."""
    checked_suffix(path, (".npz",), "use export for .csv and .mat")
    arrays: dict[str, Any] = {}
    header = {"format": _FORMAT, "schema": SCHEMA, "branch": encode(branch, "", arrays)}
    text = np.array(json.dumps(header))
    with replacing(path) as handle:
        np.savez(handle, header=text, **arrays)


def load(path: str | os.PathLike[str], problem: Any = None) -> Branch:
    """Read a branch written by `Branch.save`; give the problem too if degrees of freedom are wanted.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it cannot be read, is no branch, or was written by a newer hbgear.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"there is no file '{path}'; give the .npz of a branch saved before")
    try:
        with open(path, "rb") as handle:
            if not zipfile.is_zipfile(handle):
                raise ValueError("it is no .npz at all, or cut off")
            handle.seek(0)
            archive = np.load(handle, allow_pickle=False)
            header = json.loads(str(archive["header"]))
            if header["format"] != _FORMAT:
                raise ValueError(f"its format is {header['format']!r}")
            if header["schema"] <= SCHEMA:
                return dataclasses.replace(_decode(header["branch"], archive), problem=problem)
    except (OSError, EOFError, KeyError, TypeError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(
            f"'{path}' cannot be read as a branch ({error}); need an .npz written by Branch.save or hbgear trace -o"
        ) from error
    raise ValueError(f"'{path}' has schema {header['schema']}, this hbgear reads up to {SCHEMA}; upgrade hbgear")


def encode(value: Any, key: str, arrays: dict[str, Any]) -> Any:
    """A value in the words of JSON; arrays go to ``arrays`` under their path in the tree."""
    if type(value) in _CLASSES.values():
        names = [f.name for f in dataclasses.fields(value) if f.name != "problem"]
        value = {"__class__": type(value).__name__, **{name: getattr(value, name) for name in names}}
    if isinstance(value, np.ndarray):
        arrays[key] = value
        return {"__array__": key}
    if isinstance(value, dict):
        return {name: encode(x, f"{key}.{name}".lstrip("."), arrays) for name, x in value.items()}
    if isinstance(value, list | tuple):
        items = [encode(x, f"{key}.{i}", arrays) for i, x in enumerate(value)]
        return {"__tuple__": items} if isinstance(value, tuple) else items
    return value.item() if isinstance(value, np.generic) else value


def _decode(value: Any, arrays: Mapping[str, Any]) -> Any:
    """Inverse of `encode`."""
    if isinstance(value, list):
        return [_decode(x, arrays) for x in value]
    if not isinstance(value, dict):
        return value
    if "__array__" in value:
        return arrays[value["__array__"]]
    if "__tuple__" in value:
        return tuple(_decode(x, arrays) for x in value["__tuple__"])
    fields = {name: _decode(x, arrays) for name, x in value.items()}
    kind = fields.pop("__class__", None)
    return fields if kind is None else _CLASSES[kind](**fields)


_CLASSES: dict[str, Any] = {kind.__name__: kind for kind in (Layout, Point, SpecialPoint, Jump, Branch)}
