"""Values of a model as plain data for JSON, and the values rebuilt from them.

    3.0    "plane"    [1.0, ...]    {"function": "Series", ...}    {"part": "Wheel", "fields": {"name": "pinion", ...}}
    {"array": [[...], ...]}    {"real": [...], "imaginary": [...]}
     {"sparse": n, "row": [...], "column": [...], "values": [...]}    {"pairs": [[1, ...]]}
    {"law": "Tanh", "fields": {"k": 1.0}, "from": "mine.py:Tanh"}

Parts are frozen dataclasses of hbgear, such as the wheels of a train, or the elements and loads of a system. Laws of a
user have the name under which they are registered, see `hbgear.mechanics.laws.registry`. Functions and other classes of
a user have no plain form.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.registry import BUILT_IN, law_named, registered
from hbgear.mechanics.series.periodic import Phased, described, undescribed

MAX_MATRIX_ENTRIES = 50_000
"""Largest number of entries of a matrix that is written into the header of a file [-]."""


def to_plain(value: Any) -> Any:
    """Convert a value of a model to plain data: numbers, texts, lists and dictionaries.

    Raises
    ------
    TypeError
        If the value has no plain form: a function, an object of a class of a user, a law that is not registered, or a
        matrix of more than 50 000 entries.
    """
    if type(value) in _PLAIN_TYPES:
        return value
    if isinstance(value, Phased):
        return json.loads(json.dumps(described(value)))
    if isinstance(value, np.ndarray):
        _check_size(value.size)
        if value.dtype.kind == "c":
            return {"real": value.real.tolist(), "imaginary": value.imag.tolist()}
        return {"array": value.tolist()}
    if isinstance(value, Law):
        return _law_to_plain(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        if not type(value).__module__.startswith("hbgear."):
            raise TypeError(f"{type(value).__name__} is not a part of hbgear")
        return {"part": type(value).__name__, "fields": _fields_to_plain(value)}
    if isinstance(value, Mapping):
        return {"pairs": [[to_plain(key), to_plain(item)] for key, item in value.items()]}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if scipy.sparse.issparse(value):  # last, because its import takes long
        entries = scipy.sparse.coo_array(value)
        _check_size(entries.nnz)
        return {
            "sparse": int(entries.shape[0]),
            "row": entries.row.tolist(),
            "column": entries.col.tolist(),
            "values": entries.data.tolist(),
        }
    return json.loads(json.dumps(value.item() if isinstance(value, np.generic) else value))


_PLAIN_TYPES = (float, int, bool, str, type(None))


def _fields_to_plain(value: Any) -> dict[str, Any]:
    """Convert the fields of a dataclass that its constructor takes."""
    return {field.name: to_plain(getattr(value, field.name)) for field in dataclasses.fields(value) if field.init}


def _law_to_plain(law: Law) -> dict[str, Any]:
    """Convert a law: one of hbgear as a part, one of a user under its registered name."""
    entry = registered(law)
    cls = type(law)
    fields = {}
    for field in dataclasses.fields(law):  # type: ignore[arg-type]
        if field.init:
            try:
                fields[field.name] = to_plain(getattr(law, field.name))
            except TypeError as error:
                raise TypeError(f"the field {field.name} of the law {cls.__name__} is not data: {error}") from None
    if BUILT_IN.get(cls.__name__) is cls:
        return {"part": cls.__name__, "fields": fields}
    return {"law": entry.name, "fields": fields, "from": source_of(cls)}


def _check_size(count: int) -> None:
    """Raise TypeError for a matrix that is too large."""
    if count > MAX_MATRIX_ENTRIES:
        raise TypeError(f"a matrix of {count:,} numbers is too large for a header")


def from_plain(data: Any, parts: Mapping[str, type]) -> Any:
    """Rebuild a value from the plain data that `to_plain` returned, with tuples instead of lists.

    ``parts`` has the classes by name of which parts may be. Laws need not be among them.

    Raises
    ------
    ValueError, KeyError, TypeError
        If the data have none of the forms, a law is not registered, or a class refuses its fields.
    """
    if isinstance(data, list):
        return tuple(from_plain(item, parts) for item in data)
    if not isinstance(data, Mapping):
        return data
    if "function" in data:
        return undescribed(data)
    if set(data) == {"array"}:
        return np.array(data["array"], dtype=float)
    if set(data) == {"real", "imaginary"}:
        return np.array(data["real"], dtype=float) + 1j * np.array(data["imaginary"], dtype=float)
    if set(data) == {"sparse", "row", "column", "values"}:
        return _sparse(data)
    if set(data) == {"pairs"}:
        return {from_plain(key, parts): from_plain(item, parts) for key, item in data["pairs"]}
    if set(data) == {"law", "fields", "from"} and isinstance(data["fields"], Mapping):
        entry = law_named(str(data["law"]), str(data["from"]))
        return entry.from_fields({name: from_plain(item, parts) for name, item in data["fields"].items()})
    if set(data) == {"part", "fields"} and isinstance(data["fields"], Mapping):
        classes = {**BUILT_IN, **parts}
        if not isinstance(data["part"], str) or data["part"] not in classes:
            raise KeyError(f"there is no part '{str(data['part'])[:40]}' of a model")
        cls: Any = classes[data["part"]]
        names = {field.name for field in dataclasses.fields(cls)}
        unknown = next((name for name in data["fields"] if name not in names), None)
        if unknown is not None:
            raise KeyError(f"{cls.__name__} has no field '{str(unknown)[:40]}'")
        return cls(**{name: from_plain(item, parts) for name, item in data["fields"].items()})
    raise ValueError(f"{str(data)[:80]} is no value of a model")


def _sparse(data: Mapping[str, Any]) -> Any:
    """Rebuild a square sparse matrix."""
    n, values = data["sparse"], np.array(data["values"], dtype=float)
    if isinstance(n, bool) or not isinstance(n, int) or not 0 < n <= MAX_MATRIX_ENTRIES:
        raise ValueError(f"a sparse matrix has no {str(n)[:40]} rows")
    indices = np.array(data["row"], dtype=int), np.array(data["column"], dtype=int)
    return scipy.sparse.csr_array((values, indices), shape=(n, n))


def source_of(cls: type) -> str:
    """Return where a class was written, as FILE.py:NAME or MODULE:NAME; empty for a class of hbgear.

    A file has its name without folders, which are private.
    """
    if cls.__module__.partition(".")[0] == "hbgear":
        return ""
    module = cls.__module__
    if module == "__main__" or module.endswith(".py"):  # a script, or a file named on the command line
        module = Path(getattr(sys.modules.get(module), "__file__", None) or module).name
    return f"{module}:{cls.__qualname__}"
