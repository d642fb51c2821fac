"""Files in TOML: read whole, and errors by the line they are in."""

from __future__ import annotations

import os
import re
import tomllib
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from hbgear.common.text.decoding import text_of_file
from hbgear.common.text.messages import did_you_mean, quoted, shortened
from hbgear.common.units import QuantityField
from hbgear.io.branches.archive import too_deep

Place = tuple[str | int, ...]
"""Where something is in a file: keys and numbers of entries, from the outside in."""


class TomlFileError(ValueError):
    """What is wrong with a file, one text for each error."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


def parsed(path: str | os.PathLike[str], what: str, error_class: type[TomlFileError]) -> tuple[str, dict[str, Any]]:
    """Text of a file, and what TOML reads in it.

    Parameters
    ----------
    path : of the file.
    what : it is to be, for errors: "a study".
    error_class : raised if it cannot be read.

    Raises
    ------
    TomlFileError
        Of the class given.
    """
    try:
        text = text_of_file(path, what)
    except ValueError as error:
        raise error_class([str(error)]) from None
    try:
        data = tomllib.loads(text)
        if not too_deep(data):
            return text, data
        reason = _nested(text)
    except tomllib.TOMLDecodeError as error:
        reason = shortened(str(error), 200).replace("at end of document", f"at the end, line {len(text.splitlines())}")
    except RecursionError:
        reason = _nested(text)
    except ValueError:  # of Python, which reads no whole number of thousands of digits
        long = re.search(r"[0-9_]{4000,}", text)
        reason = f"a number has too many digits (at line {text.count(chr(10), 0, long.start() if long else 0) + 1})"
    raise error_class([f"'{path}' cannot be read as {what}: {reason}"])


def _nested(text: str) -> str:
    """What is wrong with a text that has a value nested too deeply, with the line that opens the most of it."""
    opened = [line.count("[") + line.count("{") + line.count(".") for line in text.splitlines()]
    return f"a value in it is nested too deeply (at line {opened.index(max(opened)) + 1})"


def checked(
    path: str | os.PathLike[str], what: str, error_class: type[TomlFileError], schema: Any
) -> tuple[str, dict[str, Any]]:
    """Text of a file, and what stands in it if that is of the form of a model of pydantic.

    Raises
    ------
    TomlFileError
        Of the class given, if it cannot be read or is of another form.
    """
    import pydantic

    text, data = parsed(path, what, error_class)
    try:
        return text, schema.model_validate(data).model_dump(exclude_unset=True)
    except pydantic.ValidationError as error:
        raise error_class(located(path, text, [told(schema, each) for each in error.errors()])) from None


def located(path: str | os.PathLike[str], text: str, problems: Sequence[tuple[Place, str]]) -> list[str]:
    """Errors by place as texts with their lines, in the order of the lines."""
    where = lines_of(text)
    lines = sorted((line_of(where, place), message) for place, message in problems)
    return [f"{path}, line {line}: {_in_one_line(message)}" for line, message in lines]


def _in_one_line(message: str) -> str:
    """Names in a file may go over several lines."""
    return " ".join(message.split()) if "\n" in message else message


def lines_of(text: str) -> dict[Place, int]:
    """Line at which the statement begins that brings each key into a TOML text.

    Statements are parsed one by one: a table header, or a key with its value, which may go over several lines.
    """
    found: dict[Place, int] = {}
    header: Place = ()
    start, statement = 1, ""
    for n, line in enumerate(text.splitlines(), 1):
        start, statement = (start, f"{statement}\n{line}") if statement else (n, line)
        if start != n and not any(end in line for end in ("]", "}", '"""', "'''")):
            continue  # within a value of several lines, which ends with one of these
        try:
            data = tomllib.loads(statement)
        except tomllib.TOMLDecodeError:
            continue
        places = list(_places(data))
        if statement.lstrip().startswith("["):
            header = _numbered(places[-1], found)
            places = [header[:k] for k in range(1, len(header) + 1)]
        else:
            places = [(*header, *place) for place in places]
        for place in places:
            found.setdefault(place, start)
        statement = ""
    return found


def _places(data: Any) -> Iterator[Place]:
    """Where keys and entries of lists are, from the outside in."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        yield (key,)
        yield from ((key, *place) for place in _places(value))


def _numbered(header: Place, found: dict[Place, int]) -> Place:
    """The header; of an array of tables, ``[[x]]``, with the number of this one."""
    if not isinstance(header[-1], int):
        return header
    number = 0
    while (*header[:-1], number) in found:
        number += 1
    return (*header[:-1], number)


def line_of(lines: Mapping[Place, int], place: Place) -> int:
    """Line of a key, or of the table it is missing in; 1 if it is nowhere."""
    while place and place not in lines:
        place = place[:-1]
    return lines.get(place, 1)


def told(schema: Any, error: Any) -> tuple[Place, str]:
    """Place and text of an error of pydantic."""
    place: Place = tuple(error["loc"])
    name = ".".join(map(str, place))
    if error["type"] == "extra_forbidden":
        for key in place[:-1]:
            if isinstance(key, str):  # the form of the entries of a list is that of its key
                schema = schema.model_fields[key].annotation
                schema = next(iter(typing.get_args(schema)), schema)
        return place, f"unknown key '{shortened(name)}'{did_you_mean(str(place[-1]), schema.model_fields)}"
    if error["type"] == "missing":
        return place, f"'{shortened(name)}' is missing"
    return (
        place,
        f"{shortened(name)} = {quoted(error['input'])}: {shortened(error['msg'].removeprefix('Value error, '), 300)}",
    )


def exactly() -> Any:
    """Settings of a form of pydantic in which nothing else may stand, and no number is a text."""
    from pydantic import ConfigDict

    return ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def form(
    title: str, cls: type, kinds: Mapping[str, Any], required: Sequence[str], left_out: Sequence[str] = (),
    **more: tuple[Any, Any],
) -> Any:  # fmt: skip
    """The form of a table with the fields of a dataclass, as a model of pydantic.

    Quantities are texts or numbers; other fields are of the kinds given. ``more`` are keys beside the fields, as
    pydantic's (kind, default).
    """
    from pydantic import create_model

    keys: dict[str, Any] = {}
    for field in fields(cls):
        if field.name not in left_out:
            kind: Any = str | float if isinstance(vars(cls).get(field.name), QuantityField) else kinds[field.name]
            keys[field.name] = (kind, ... if field.name in required else None)
    return create_model(title, __config__=exactly(), **{**keys, **more})


def made(
    problems: list[tuple[Place, str]], place: Place, cls: type, values: Mapping[str, Any],
    make: Callable[..., Any] | None = None,
) -> Any:  # fmt: skip
    """An instance by ``cls(**values)``, or by ``make``; None if something is refused, which goes to the problems.

    Each quantity is tried by itself, so that all errors are told at once.
    """
    count = len(problems)
    for name, value in values.items():
        field = vars(cls).get(name)
        if isinstance(field, QuantityField) and value is not None:
            try:
                field.read(cls.__name__, value)
            except ValueError as error:
                problems.append(((*place, name), bare(error)))
    if len(problems) > count:
        return None
    try:
        return (make or cls)(**values)
    except ValueError as error:
        problems.append((place, bare(error)))
        return None


def bare(error: ValueError) -> str:
    """What an error says, without the class or what else is at its head: the place in the file says that."""
    return re.sub(r"^(the machine|[A-Z][A-Za-z]*(\.[a-z]+)?): ", "", str(error))
