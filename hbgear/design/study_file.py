"""The file of a study (TOML), checked before anything is computed: every error at once, each with its line."""

from __future__ import annotations

import os
import tomllib
import typing
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from hbgear.common.messages import did_you_mean, quoted, shortened
from hbgear.design.sampling import METHODS, Grid, Sample, distribution, grid
from hbgear.design.study import KINDS, Work
from hbgear.harmonic.catalogue import class_of
from hbgear.io.archive import too_deep
from hbgear.mechanics.fields import made, plain_kinds_of, required_of
from hbgear.mechanics.model import Model

Place = tuple[str | int, ...]


class StudyFileError(ValueError):
    """What is wrong with a study file, one text for each error."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


@dataclass(frozen=True)
class Study:
    """What a study file asks for."""

    model: Model
    vary: Grid | Sample
    work: Work


def read_study(path: str | os.PathLike[str]) -> Study:
    """Read and check a study file.

    Raises
    ------
    StudyFileError
        If it cannot be read, or a key, type or value is wrong.
    """
    text, data = _parsed(path)
    problems, checked = _checked(data)
    if not problems:
        try:
            return _study(checked)
        except _Wrong as wrong:
            problems = [(wrong.place, str(wrong))]
    where = lines_of(text)
    lines = sorted((line_of(where, place), message) for place, message in problems)
    raise StudyFileError([f"{path}, line {line}: {message}" for line, message in lines])


def _parsed(path: str | os.PathLike[str]) -> tuple[str, dict[str, Any]]:
    """Text of the file, and what TOML reads in it."""
    try:
        text = Path(path).read_text(encoding="utf-8")
        data = tomllib.loads(text)
        if not too_deep(data):
            return text, data
        reason = "a value in it is nested too deeply"
    except OSError as error:
        reason = str(error.strerror)
    except UnicodeDecodeError:
        reason = "it is no text (UTF-8)"
    except tomllib.TOMLDecodeError as error:
        reason = shortened(str(error), 200).replace("at end of document", f"at the end, line {len(text.splitlines())}")
    except RecursionError:
        reason = "a value in it is nested too deeply"
    raise StudyFileError([f"'{path}' cannot be read as a study: {reason}"])


class _Wrong(Exception):
    """Values that are right one by one and wrong together; in which table."""

    def __init__(self, table: str, reason: Exception) -> None:
        super().__init__(reason.args[0])
        self.place: Place = (table,)


@contextmanager
def _within(table: str) -> Iterator[None]:
    try:
        yield
    except (ValueError, KeyError) as error:
        raise _Wrong(table, error) from None


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


def _checked(data: dict[str, Any]) -> tuple[list[tuple[Place, str]], Any]:
    """Errors by place, and the data as checked."""
    import pydantic

    name = data.get("model")
    problems: list[tuple[Place, str]] = []
    cls = None
    if isinstance(name, str):
        try:
            cls = class_of(name)
        except (KeyError, ValueError) as error:
            problems.append((("model",), shortened(str(error.args[0]), 300)))
    schema = _schema(cls)
    base = data.get("base", {})
    missing = [field for field in (required_of(cls) if cls else ()) if isinstance(base, dict) and field not in base]
    if missing:
        text = f"the model '{name}' needs {', '.join(missing)}: no default, so give a value in [base]"
        problems.append((("base",) if "base" in data else ("model",), text))
    if ("grid" in data) == ("sample" in data):
        need = "need [grid] or [sample], and not both"
        problems.append((("sample",), need))
    if data.get("grid") == {}:
        problems.append((("grid",), "[grid] names no parameter; need one at least, as in zeta = [0.04, 0.05]"))
    checked = None
    try:
        checked = schema.model_validate(data)
    except pydantic.ValidationError as error:
        problems += [_told(schema, each) for each in error.errors()]
    return problems, checked


def _told(schema: Any, error: Any) -> tuple[Place, str]:
    """Place and text of an error of pydantic."""
    place: Place = tuple(error["loc"])
    name = ".".join(map(str, place))
    if error["type"] == "extra_forbidden":
        for key in place[:-1]:
            schema = schema.model_fields[key].annotation
        return place, f"unknown key '{shortened(name)}'{did_you_mean(str(place[-1]), schema.model_fields)}"
    if error["type"] == "missing":
        return place, f"'{shortened(name)}' is missing"
    return (
        place,
        f"{shortened(name)} = {quoted(error['input'])}: {shortened(error['msg'].removeprefix('Value error, '), 300)}",
    )


def _schema(cls: type[Model] | None) -> Any:
    """The form of the file, as a model of pydantic: its tables have the fields of the model of the machine."""
    from pydantic import AfterValidator, ConfigDict, Field, create_model

    strict = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    def table(title: str, fields: dict[str, Any]) -> Any:
        return create_model(title, __config__=strict, **fields)

    kinds: dict[str, Any] = {}
    if cls is not None:
        kinds = {n: list[float] if typing.get_origin(k) is tuple else k for n, k in plain_kinds_of(cls).items()}
    loose = ConfigDict(extra="allow")
    drawn = Annotated[list[str | float], AfterValidator(_distribution)]
    if cls is None:
        base = several = random = create_model("any", __config__=loose)
    else:
        base = table("base", {n: (k, None) for n, k in kinds.items()})
        several = table("grid", {n: (Annotated[list[k], Field(min_length=1)], None) for n, k in kinds.items()})  # type: ignore[valid-type]
        random = table("parameters", {n: (drawn, None) for n, k in kinds.items() if k is float})
    sample = table("sample", {
        "method": (Literal[METHODS], METHODS[0]), "count": (Annotated[int, Field(ge=1)], ...),
        "seed": (Annotated[int, Field(ge=0)], 0), "parameters": (random, ...),
    })  # fmt: skip
    compute = table("compute", {
        "what": (list[Literal[KINDS]], ["peak", "jumps"]), "critical": (list[str], []),  # type: ignore[valid-type]
        "harmonics": (Annotated[int, Field(ge=1)], 16),
        "span": (Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=2, max_length=2)], None),
        "measure": (str, "pp2"), "element": (int | str, 0),
    })  # fmt: skip
    return table("study", {"model": (str, ...), "base": (base, base()), "grid": (several, None),
                           "sample": (sample, None), "compute": (compute, compute())})  # fmt: skip


def _distribution(given: list[Any]) -> list[Any]:
    try:
        distribution(given)
    except KeyError as error:
        raise ValueError(error.args[0]) from None
    return given


def _study(checked: Any) -> Study:
    data = checked.model_dump(exclude_unset=True)
    with _within("base"):
        base = {name: tuple(v) if isinstance(v, list) else v for name, v in data.get("base", {}).items()}
        model = made(class_of(data["model"]), base)
    if "grid" in data:
        with _within("grid"):
            vary: Grid | Sample = grid(**data["grid"])
    else:
        given = data["sample"]
        with _within("sample"):
            if not given["parameters"]:
                raise ValueError("[sample.parameters] names no parameter")
            vary = Sample(given.get("method", METHODS[0]), given["count"], given.get("seed", 0), given["parameters"])
    asked = checked.compute
    span = tuple(asked.span or model.default_span)
    with _within("compute"):
        if span[0] == span[1]:
            raise ValueError(f"span = {list(span)} is empty; give two different frequencies")
        work = Work(tuple(asked.what), tuple(asked.critical), asked.harmonics, span, asked.measure, asked.element)
    return Study(model, vary, work)
