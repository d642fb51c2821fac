"""Fields of a model class: their types, the parameters among them, and instances with given values.

parameter:  a field whose values are real numbers, however its type is written: float, Annotated[float, ...],
            float | numpy.floating, a name for one of these, or any of them as a string
"""

from __future__ import annotations

import builtins
import dataclasses
import re
import types
import typing
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from hbgear.common.text.messages import did_you_mean

_T = TypeVar("_T")

_ENTRY_PATTERN = re.compile(r"([^\[\]]+)\[(\d{1,6})\]", re.ASCII)


@lru_cache(maxsize=256)
def kinds_of(cls: type) -> Mapping[str, Any]:
    """Return the types of the fields of a dataclass that ``__init__`` takes, in the form of `plain`.

    A type given as a string stays a string if its names are known only inside the function that defines the class.
    """
    try:
        field_types = typing.get_type_hints(cls, include_extras=True)
    except (NameError, AttributeError):
        field_types = {}
    kinds = {}
    for field in dataclasses.fields(cls):
        field_type = field_types.get(field.name, field.type)
        if isinstance(field_type, str):
            field_type = vars(builtins).get(field_type, field_type)
        if field.init:
            kinds[field.name] = plain(field_type)
    return types.MappingProxyType(kinds)


def plain(kind: Any) -> Any:
    """Return a type in its simplest form: ``float`` for every way to write a real number.

    >>> plain(typing.Annotated[float, "over 2 m omega"]), plain(float | np.floating), plain(int | np.integer)
    (<class 'float'>, <class 'float'>, <class 'int'>)
    """
    while True:
        if typing.get_origin(kind) is typing.Annotated:
            kind = typing.get_args(kind)[0]
        elif isinstance(kind, typing.NewType):
            kind = kind.__supertype__
        elif type(kind).__name__ == "TypeAliasType":  # a `type` statement, of Python 3.12
            kind = kind.__value__
        else:
            break
    options = [kind]
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        options = [plain(option) for option in typing.get_args(kind)]
    if all(isinstance(option, type) and issubclass(option, int | np.integer) for option in options):
        return kind if kind is bool else int
    if all(isinstance(option, type) and issubclass(option, float | int | np.number) for option in options):
        return kind if any(issubclass(option, np.complexfloating) for option in options) else float
    return kind


def plain_kinds_of(cls: type) -> dict[str, Any]:
    """Return `kinds_of` with Any for every type that is not a number, text, truth value, choice of those, or tuple."""
    kinds = kinds_of(cls)
    return {name: kind if is_plain(kind) else Any for name, kind in kinds.items()}


def is_plain(kind: Any) -> bool:
    """Return whether values of a type are numbers, texts, truth values, choices of them, or tuples of them."""
    if typing.get_origin(kind) is tuple:
        return all(option is ... or is_plain(option) for option in typing.get_args(kind))
    return kind in (float, int, bool, str) or typing.get_origin(kind) is typing.Literal


def parameters_of(cls: type) -> tuple[str, ...]:
    """Return the names of the fields that are real numbers."""
    return tuple(name for name, kind in kinds_of(cls).items() if kind is float)


def entries_of(instance: object) -> dict[str, float]:
    """Return the numbers in tuples among the fields of an instance, by their names in Python: ``eps[0]``."""
    cls: type = type(instance)
    lists = ((name, getattr(instance, name)) for name in _tuple_fields_of(cls))
    return {f"{name}[{i}]": float(x) for name, values in lists for i, x in enumerate(values)}


def entries_among(cls: type, values: Mapping[str, Any]) -> list[str]:
    """Return the names of the entries, such as ``eps[0]``, of tuples of numbers among given values by name of field."""
    fields = {name: values.get(name) for name in _tuple_fields_of(cls)}
    return [f"{name}[{i}]" for name, x in fields.items() if isinstance(x, list | tuple) for i in range(len(x))]


@lru_cache(maxsize=256)
def _tuple_fields_of(cls: type) -> tuple[str, ...]:
    """Return the names of the fields that are tuples of real numbers."""
    kinds = kinds_of(cls)
    return tuple(
        name
        for name, kind in kinds.items()
        if typing.get_origin(kind) is tuple and set(typing.get_args(kind)) <= {float, ...}
    )


def with_entries(instance: object, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes of fields, in which changes of entries such as ``eps[0]`` are merged into their tuples.

    Raises
    ------
    KeyError
        If there is no such entry.
    """
    fields = {name: value for name, value in changes.items() if "[" not in name}
    if len(fields) == len(changes):
        return fields
    cls: type = type(instance)
    for name, value in changes.items():
        if name in fields:
            continue
        match = _ENTRY_PATTERN.fullmatch(name)
        values = []
        if match is not None and match[1] in _tuple_fields_of(cls):
            values = list(fields.get(match[1], getattr(instance, match[1])))
        if match is None or int(match[2]) >= len(values):
            names = entries_of(instance)
            raise KeyError(f"{cls.__name__} has no parameter '{name}'{did_you_mean(name, names)}")
        values[int(match[2])] = float(value)
        fields[match[1]] = tuple(values)
    return fields


def defaults_of(cls: type) -> dict[str, Any]:
    """Return the default values by name of the fields that have one."""
    defaults = {}
    for field in dataclasses.fields(cls):
        if field.init and field.default is not dataclasses.MISSING:
            defaults[field.name] = field.default
        elif field.init and field.default_factory is not dataclasses.MISSING:
            defaults[field.name] = field.default_factory()
    return defaults


def required_of(cls: type) -> tuple[str, ...]:
    """Return the names of the fields that have no default."""
    defaults = defaults_of(cls)
    return tuple(name for name in kinds_of(cls) if name not in defaults)


def check_names(cls: type, names: typing.Iterable[str]) -> None:
    """Raise KeyError for a name that is not a field of a dataclass."""
    for name in names:
        if name not in kinds_of(cls):
            raise KeyError(f"{cls.__name__} has no parameter '{name}'{did_you_mean(name, kinds_of(cls))}")


def made(cls: type[_T], values: Mapping[str, Any]) -> _T:
    """Return an instance with given values of fields and entries, such as ``eps[0]``, and defaults of the other fields.

    Raises
    ------
    KeyError
        If a name is not a field or an entry of a field.
    ValueError
        If a field without a default has no value, or the class refuses a value.
    """
    fields = {name: value for name, value in values.items() if not is_entry(name)}
    check_names(cls, fields)
    missing = [name for name in required_of(cls) if name not in fields]
    if missing:
        raise ValueError(f"{cls.__name__} needs {', '.join(missing)}: no default, so give a value")
    instance = cls(**fields)
    if len(fields) == len(values):
        return instance
    entries = {name: value for name, value in values.items() if name not in fields}
    return dataclasses.replace(instance, **with_entries(instance, entries))  # type: ignore[type-var]


def is_entry(name: str) -> bool:
    """Return whether a name is the name of an entry of a tuple, such as ``eps[0]``.

    Examples
    --------
    >>> is_entry("eps[0]"), is_entry("eps")
    (True, False)
    """
    return _ENTRY_PATTERN.fullmatch(name) is not None
