"""TOML files: reading, validation by pydantic, and errors with line numbers."""

from __future__ import annotations

import os
import re
import tomllib
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from hbgear.common.text.decoding import text_of_file
from hbgear.common.text.messages import did_you_mean, quoted, shortened
from hbgear.common.units import QuantityField, decimal_mark
from hbgear.io.branches.archive import too_deep
from hbgear.mechanics.fields import kinds_of
from hbgear.mechanics.laws.registry import TOML_KINDS

KeyPath = tuple[str | int, ...]
"""Position in a file: keys and indices of entries, from the outside in."""

Problems = list[tuple[KeyPath, str]]
"""Errors of a file, each with its position."""


class TomlFileError(ValueError):
    """Error: a file is invalid; one text for each problem."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


def parsed(path: str | os.PathLike[str], expected: str) -> tuple[str, dict[str, Any]]:
    """Return the text of a file and its TOML content; TomlFileError if it cannot be read.

    ``expected`` is the expected content in the message, such as "a study".
    """
    try:
        text = text_of_file(path, expected)
    except ValueError as error:
        raise TomlFileError([str(error)]) from None
    try:
        data = tomllib.loads(text)
        if data and not too_deep(data):
            return text, data
        reason = _nested(text) if data else "it is empty, or has only comments"
    except tomllib.TOMLDecodeError as error:
        reason = shortened(str(error), 200).replace("at end of document", f"at the end, line {len(text.splitlines())}")
        at = re.search(r"at line (\d+)", reason)
        reason += decimal_mark(text.splitlines()[int(at[1]) - 1].rpartition("=")[2]) if at else ""
    except RecursionError:
        reason = _nested(text)
    except ValueError:  # Python reads no whole number with thousands of digits
        long = re.search(r"[0-9_]{4000,}", text)
        reason = f"a number has too many digits (at line {text.count(chr(10), 0, long.start() if long else 0) + 1})"
    raise TomlFileError([f"'{path}' cannot be read as {expected}: {reason}"])


def _nested(text: str) -> str:
    """Return the error of a text with a value that is nested too deeply, with the line that opens most levels."""
    opened = [line.count("[") + line.count("{") + line.count(".") for line in text.splitlines()]
    return f"a value in it is nested too deeply (at line {opened.index(max(opened)) + 1})"


def read_checked(
    path: str | os.PathLike[str], expected: str, schema: Any, create: Callable[[dict[str, Any], Path, Problems], object]
) -> Any:
    """Return the object that a file describes.

    ``expected`` is the expected content in messages, such as "a train", ``schema`` the pydantic model with keys and
    types. ``create(data, folder, problems)`` returns the object of valid data, or appends to the list of problems and
    returns None. Other files are searched relative to the folder. TomlFileError is raised if the file cannot be read or
    its content is invalid.
    """
    import pydantic

    text, data = parsed(path, expected)
    problems: Problems = []
    try:
        valid = schema.model_validate(data).model_dump(exclude_unset=True)
    except pydantic.ValidationError as error:
        problems = validation_problems(schema, data, error)
    else:
        content = create(valid, Path(path).parent, problems)
        if content is not None:
            return content
    raise TomlFileError(located(path, text, problems))


def located(path: str | os.PathLike[str], text: str, problems: Sequence[tuple[KeyPath, str]]) -> list[str]:
    """Return the errors with their lines, in the order of the lines."""
    line_numbers = lines_of(text)
    lines = sorted((line_of(line_numbers, key_path), message) for key_path, message in problems)
    return [f"{path}, line {line}: {_in_one_line(message)}" for line, message in lines]


def _in_one_line(message: str) -> str:
    """Return a message without line breaks and with shortened words, which names in a file may contain."""
    text = " ".join(message.split()) if "\n" in message else message
    return re.sub(r"'[^']*'|\S{80,}", lambda match: shortened(match[0]), text)  # quotation marks in pairs


def lines_of(text: str) -> dict[KeyPath, int]:
    """Return the line of the statement that defines each key of a TOML text.

    Statements are parsed one by one: a table header, or a key with its value, which may extend over several lines.
    """
    lines: dict[KeyPath, int] = {}
    header: KeyPath = ()
    start, statement = 1, ""
    for n, line in enumerate(text.splitlines(), 1):
        start, statement = (start, f"{statement}\n{line}") if statement else (n, line)
        if start != n and not any(end in line for end in ("]", "}", '"""', "'''")):
            continue  # inside a value of several lines, which ends with one of these
        try:
            data = tomllib.loads(statement)
        except tomllib.TOMLDecodeError:
            continue
        key_paths = list(_key_paths(data))
        if statement.lstrip().startswith("["):
            header = _numbered(key_paths[-1], lines)
            key_paths = [header[:k] for k in range(1, len(header) + 1)]
        else:
            key_paths = [(*header, *key_path) for key_path in key_paths]
        for key_path in key_paths:
            lines.setdefault(key_path, start)
        statement = ""
    return lines


def _key_paths(data: Any) -> Iterator[KeyPath]:
    """Yield the positions of keys and entries of lists, from the outside in."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        yield (key,)
        yield from ((key, *key_path) for key_path in _key_paths(value))


def _numbered(header: KeyPath, lines: dict[KeyPath, int]) -> KeyPath:
    """Return the header; for an array of tables, ``[[x]]``, with the index of this one."""
    if not isinstance(header[-1], int):
        return header
    number = 0
    while (*header[:-1], number) in lines:
        number += 1
    return (*header[:-1], number)


def line_of(lines: Mapping[KeyPath, int], key_path: KeyPath) -> int:
    """Return the line of a key, or of the table in which it is missing; 1 if there is neither."""
    while key_path and key_path not in lines:
        key_path = key_path[:-1]
    return lines.get(key_path, 1)


NEEDED = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text in quotation marks",
    "bool_type": "true or false",
    "list_type": "a list in brackets",
    "tuple_type": "a list in brackets",
    "dict_type": "a table",
    "model_type": "a table",
}
"""What a value must be, by the type of an error of pydantic."""


def validation_problems(schema: Any, data: Mapping[str, Any], error: Any) -> Problems:
    """Return position and text of the errors of a validation by pydantic.

    A value of a wrong type has one error that names all allowed types; pydantic has one for each.
    """
    needed: dict[KeyPath, list[str]] = {}
    problems: Problems = []
    for details in error.errors():
        key_path = _path_in(data, details["loc"], details["type"] == "missing")
        text = NEEDED.get(details["type"]) or details.get("ctx", {}).get("expected")
        is_list_of_tables = details["type"] == "list_type" and isinstance(details["input"], dict)
        if text and details["type"] in (*NEEDED, "literal_error") and not is_list_of_tables:
            needed.setdefault(key_path, []).append(text)
        else:
            problems.append(_location_and_text(schema, key_path, details))
    wrong = {*needed, *(key_path for key_path, _ in problems)}
    for key_path, texts in needed.items():
        if any(len(other) > len(key_path) and other[: len(key_path)] == key_path for other in wrong):
            continue  # a table, whose entries have errors, is one of the allowed types
        name = shortened(".".join(map(str, key_path)))
        value: Any = data
        for key in key_path:
            value = value[key]
        if texts == ["a table"] and isinstance(value, list):
            problems.append((key_path, f"'{name}' is one table: write [{name}], not [[{name}]]"))
            continue
        problems.append((key_path, f"{name} = {_as_toml(value)} must be {' or '.join(dict.fromkeys(texts))}"))
    return problems


def _as_toml(value: Any) -> str:
    """Return a value in the notation of TOML, shortened."""
    return str(value).lower() if isinstance(value, bool) else quoted(value)


def _path_in(data: Any, loc: Sequence[str | int], missing: bool) -> KeyPath:
    """Return the position of an error without the names that pydantic gives to the members of a union.

    If a key is ``missing``, the last entry of the location is this key.
    """
    key_path: list[str | int] = []
    for key in loc[: len(loc) - missing]:
        if (isinstance(data, dict) and key in data) or (isinstance(data, list) and isinstance(key, int)):
            key_path.append(key)
            data = data[key]  # type: ignore[index]
    return (*key_path, loc[-1]) if missing else tuple(key_path)


def _location_and_text(schema: Any, key_path: KeyPath, error: Any) -> tuple[KeyPath, str]:
    """Return position and text of an error of pydantic."""
    name = ".".join(map(str, key_path))
    if error["type"] == "extra_forbidden":
        for key in key_path[:-1]:
            if isinstance(key, str):  # the schema of the entries of a list is that of its key
                schema = schema.model_fields[key].annotation
                schema = next((kind for kind in typing.get_args(schema) if hasattr(kind, "model_fields")), schema)
        return key_path, f"unknown key '{shortened(name)}'{did_you_mean(str(key_path[-1]), schema.model_fields)}"
    if error["type"] == "missing":
        return key_path, f"'{shortened(name)}' is missing"
    if error["type"] == "list_type" and isinstance(error["input"], dict):
        return key_path, f"'{shortened(name)}' is a list of tables: write [[{shortened(name)}]] for each of them"
    return (
        key_path,
        f"{shortened(name)} = {quoted(error['input'])}: {shortened(error['msg'].removeprefix('Value error, '), 300)}",
    )


def strict_schema(title: str, /, **keys: Any) -> Any:
    """Return a pydantic model with keys of (type, default), which forbids other keys and converts no types."""
    from pydantic import ConfigDict, create_model

    return create_model(title, __config__=ConfigDict(extra="forbid", strict=True, allow_inf_nan=False), **keys)


QUANTITY: Any = str | float
"""Type of a quantity: a text with a unit, or a number in the SI unit."""

TORQUE_ORDERS: Any = dict[str, QUANTITY | list[QUANTITY]]
"""Type of a table of torque orders: amplitude, or amplitude and phase, by order."""

MESH_MODEL: Any = Literal["teeth", "secant", "tangent"]

_KINDS: dict[str, Any] = {
    "backlash_measure": Literal["circumferential", "normal", "action"],
    "pitch_errors": list[QUANTITY],
    "torque_orders": TORQUE_ORDERS,
}
"""Types of fields whose values in files have another type than in Python."""


def form(title: str, cls: type, required: Sequence[str], excluded: Sequence[str] = (), **extra: Any) -> Any:
    """Return the schema of a table with the fields of a dataclass, and additional keys with (type, default)."""
    keys: dict[str, Any] = {}
    for name, kind in kinds_of(cls).items():
        if name not in excluded:
            is_quantity = isinstance(vars(cls).get(name), QuantityField)
            toml_kind = QUANTITY if is_quantity else _KINDS.get(name, TOML_KINDS.get(kind, kind))
            keys[name] = (toml_kind, ... if name in required else None)
    return strict_schema(title, **(keys | extra))


@contextmanager
def recorded(problems: Problems, key_path: KeyPath) -> Iterator[None]:
    """Add the ValueError of a block to the problems."""
    try:
        yield
    except ValueError as error:
        problems.append((key_path, bare(error)))


def constructed(
    problems: Problems, key_path: KeyPath, cls: type, values: Mapping[str, Any], make: Callable[..., Any] | None = None
) -> Any:
    """Return an instance by ``cls(**values)``, or by ``make``; None if a value is refused, which is added to problems.

    Each quantity is read separately, so that all errors are reported at once.
    """
    count = len(problems)
    for name, value in values.items():
        field = vars(cls).get(name)
        if isinstance(field, QuantityField) and value is not None:
            with recorded(problems, (*key_path, name)):
                field.read(cls.__name__, value)
    if len(problems) == count:
        with recorded(problems, key_path):
            return (make or cls)(**values)
    return None


def bare(error: ValueError) -> str:
    """Return the text of an error without the class at its start, which the line in the file replaces."""
    return re.sub(r"^(the machine|[A-Z][A-Za-z]*(\.[a-z]+)?): ", "", str(error))
