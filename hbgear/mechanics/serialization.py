"""Values of a model as plain data, fit for JSON, and back: what a file must hold to make the model again.

    3.0    "plane"    [1.0, ...]    {"function": "Series", ...}    {"part": "Wheel", "fields": {"name": "pinion", ...}}
    {"array": [[...], ...]}    {"real": [...], "imaginary": [...]}
     {"sparse": n, "row": [...], "column": [...], "values": [...]}    {"pairs": [[1, ...]]}

Parts are frozen dataclasses of hbgear: wheels of a train, elements and loads of a system. Functions and classes of a
user are no data.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from hbgear.mechanics.series.periodic import Phased, described, undescribed

MOST_NUMBERS = 50_000
"""Entries of one matrix up to which it is written into the header of a file."""


def to_plain(value: Any) -> Any:
    """A value as plain data.

    Raises
    ------
    TypeError
        If it is none: a function, an object of a class of a user, a matrix of more than 50 000 numbers.
    """
    if type(value) in _PLAIN:
        return value
    if isinstance(value, Phased):
        return json.loads(json.dumps(described(value)))
    if isinstance(value, np.ndarray):
        _check_size(value.size)
        if value.dtype.kind == "c":
            return {"real": value.real.tolist(), "imaginary": value.imag.tolist()}
        return {"array": value.tolist()}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        if not type(value).__module__.startswith("hbgear."):
            raise TypeError(f"{type(value).__name__} is no part of hbgear")
        fields = {each.name: to_plain(getattr(value, each.name)) for each in dataclasses.fields(value) if each.init}
        return {"part": type(value).__name__, "fields": fields}
    if isinstance(value, Mapping):
        return {"pairs": [[to_plain(key), to_plain(each)] for key, each in value.items()]}
    if isinstance(value, list | tuple):
        return [to_plain(each) for each in value]
    if scipy.sparse.issparse(value):  # last, for to import it takes a while
        entries = scipy.sparse.coo_array(value)
        _check_size(entries.nnz)
        return {"sparse": int(entries.shape[0]), "row": entries.row.tolist(), "column": entries.col.tolist(),
                "values": entries.data.tolist()}  # fmt: skip
    return json.loads(json.dumps(value.item() if isinstance(value, np.generic) else value))


_PLAIN = (float, int, bool, str, type(None))


def _check_size(count: int) -> None:
    if count > MOST_NUMBERS:
        raise TypeError(f"a matrix of {count:,} numbers is too large for a header")


def from_plain(data: Any, parts: Mapping[str, type]) -> Any:
    """The value that `told` was given, lists as tuples; parts only of these classes, by name.

    Raises
    ------
    ValueError, KeyError, TypeError
        If data are of none of its forms, or a class refuses them.
    """
    if isinstance(data, list):
        return tuple(from_plain(each, parts) for each in data)
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
        return {from_plain(key, parts): from_plain(each, parts) for key, each in data["pairs"]}
    if set(data) == {"part", "fields"} and isinstance(data["fields"], Mapping):
        if not isinstance(data["part"], str) or data["part"] not in parts:
            raise KeyError(f"there is no part '{str(data['part'])[:40]}' of a model")
        cls: Any = parts[data["part"]]
        known = {each.name for each in dataclasses.fields(cls)}
        wrong = next((name for name in data["fields"] if name not in known), None)
        if wrong is not None:
            raise KeyError(f"{cls.__name__} has no field '{str(wrong)[:40]}'")
        return cls(**{name: from_plain(each, parts) for name, each in data["fields"].items()})
    raise ValueError(f"{str(data)[:80]} is no value of a model")


def _sparse(data: Mapping[str, Any]) -> Any:
    n, values = data["sparse"], np.array(data["values"], dtype=float)
    if isinstance(n, bool) or not isinstance(n, int) or not 0 < n <= MOST_NUMBERS:
        raise ValueError(f"a sparse matrix has no {str(n)[:40]} rows")
    places = np.array(data["row"], dtype=int), np.array(data["column"], dtype=int)
    return scipy.sparse.csr_array((values, places), shape=(n, n))
