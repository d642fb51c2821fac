"""Study files (TOML): reading and checking; one message lists every error with its line.

The model is a class by name, whose fields vary, or a file of a machine, whose parameters vary in the units of their
labels or with units of their own.
"""

from __future__ import annotations

import os
import typing
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from hbgear.common.process.signals import defer_signals
from hbgear.common.text.messages import quoted, shortened
from hbgear.common.text.symbols import unit_of
from hbgear.common.units import known_unit, to_si
from hbgear.design.studies.case_results import KINDS, Work
from hbgear.design.studies.case_work import check_work
from hbgear.design.studies.samples import METHODS, Grid, Sample, distribution, grid
from hbgear.harmonic.models.frequency_units import Omega_of
from hbgear.harmonic.models.model_registry import model_class
from hbgear.io.machines.toml_file import KeyPath, TomlFileError, located, parsed, strict_schema, validation_problems
from hbgear.mechanics.fields import defaults_of, entries_among, made, plain_kinds_of, required_of
from hbgear.mechanics.models import Model


@dataclass(frozen=True)
class Study:
    """Content of a study file: name of the model or path of its file, model, cases and results to compute.

    ``of_file`` is the model as its file has it, without the changes of [base]; None if the model is a class.
    """

    source: str
    model: Model
    vary: Grid | Sample
    work: Work
    of_file: Model | None = None


def read_study(path: str | os.PathLike[str], allow_code: bool = False) -> Study:
    """Read and check a study file; with ``allow_code`` its model may be FILE.py:NAME or MODULE:NAME.

    TomlFileError is raised if the file cannot be read, a key, type or value is not valid, or it names code that is not
    allowed.
    """
    text, data = parsed(path, "a study")
    problems, checked, subject = _checked(data, Path(path).parent, allow_code)
    if not problems:
        try:
            return _study(checked, subject)
        except _InconsistentTable as wrong:
            problems = [(wrong.key_path, str(wrong))]
    raise TomlFileError(located(path, text, problems))


class _InconsistentTable(Exception):
    """Values that are valid separately but not together, with the name of their table."""

    def __init__(self, table: str, reason: Exception) -> None:
        super().__init__(reason.args[0])
        self.key_path: KeyPath = (table,)


@contextmanager
def _errors_of_table(table: str) -> Iterator[None]:
    try:
        yield
    except (ValueError, KeyError) as error:
        raise _InconsistentTable(table, error) from None


class _Subject(NamedTuple):
    """Model of a study: a class, or the model of a file; types of the values that may vary, by name."""

    source: str
    model: type[Model] | Model
    kinds: Mapping[str, Any]


def _subject(name: str, data: Mapping[str, Any], folder: Path) -> _Subject:
    """Return the model of a name or of a file relative to a folder; raises KeyError or ValueError if it is unknown."""
    if name.endswith(".toml"):
        from hbgear.io.machines.model_file import read_model

        model = read_model(folder / name)
        kinds = {parameter: _quantity_kind(parameter, model) for parameter in {**model.parameters, **model.entries}}
        return _Subject(str(folder / name), model, kinds)
    cls = model_class(name)
    kinds = {n: list[float] if typing.get_origin(k) is tuple else k for n, k in plain_kinds_of(cls).items()}
    return _Subject(name, cls, kinds | dict.fromkeys(_entries(cls, data), float))


def _quantity_kind(name: str, model: Model) -> Any:
    """Return the type of a parameter of a file: a number in the unit of its label, or a text with a unit."""
    from pydantic import BeforeValidator

    return Annotated[float, BeforeValidator(partial(_quantity, name, model))]


def _quantity(name: str, model: Model, value: Any) -> Any:
    """Return a value in the unit of the label of a parameter."""
    unit = unit_of(str(model.labels.get(name, name)))
    if not isinstance(value, str) or not known_unit(unit):
        return value
    try:
        return to_si("study", name, value, unit)
    except ValueError as error:
        raise ValueError(str(error).removeprefix("study: ")) from None


def _checked(
    data: dict[str, Any], folder: Path, allow_code: bool
) -> tuple[list[tuple[KeyPath, str]], Any, _Subject | None]:
    """Return errors with their locations, the checked data and the model."""
    with defer_signals():
        import pydantic

    name = data.get("model")
    problems: list[tuple[KeyPath, str]] = []
    subject = None
    if isinstance(name, str) and ":" in name and not allow_code:
        text = (
            f"model = {quoted(name)} would run that code, which is not allowed by default: read it, "
            "then add --allow-code, in Python read_study(path, allow_code=True)"
        )
        return [(("model",), text)], None, None
    if isinstance(name, str):
        try:
            subject = _subject(name, data, folder)
        except (KeyError, ValueError) as error:
            problems.append((("model",), shortened(str(error.args[0]), 300)))
    schema = _schema(subject)
    base = data.get("base", {})
    required = required_of(subject.model) if subject is not None and isinstance(subject.model, type) else ()
    missing = [field for field in required if isinstance(base, dict) and field not in base]
    if missing:
        text = f"the model '{name}' needs {', '.join(missing)}: no default, so give a value in [base]"
        problems.append((("base",) if "base" in data else ("model",), text))
    if ("grid" in data) == ("sample" in data):
        need = "need [grid] or [sample], and not both"
        problems.append((("sample",), need))
    if data.get("grid") == {}:
        problems.append((("grid",), "[grid] names no parameter; give at least one, such as zeta = [0.04, 0.05]"))
    checked = None
    try:
        checked = schema.model_validate(data)
    except pydantic.ValidationError as error:
        problems += validation_problems(schema, data, error)
    return problems, checked, subject


@defer_signals()  # pydantic fails if Ctrl-C interrupts the creation of a model
def _schema(subject: _Subject | None) -> Any:
    """Return the schema of the file as a model of pydantic; its tables have the parameters of the subject."""
    from pydantic import AfterValidator, ConfigDict, Field, create_model

    if subject is None:
        base = several = random = create_model("any", __config__=ConfigDict(extra="allow"))
    else:
        kinds, model = subject.kinds, subject.model
        drawn = {n: Annotated[list[str | float], AfterValidator(partial(_distribution, n, model))] for n in kinds}
        base = strict_schema("base", **{n: (k, None) for n, k in kinds.items()})
        lists = {n: Annotated[list[k], Field(min_length=1)] for n, k in kinds.items()}  # type: ignore[valid-type]
        several = strict_schema("grid", **{n: (k, None) for n, k in lists.items()})
        random = strict_schema("parameters", **{n: (drawn[n], None) for n, k in kinds.items() if _is_float(k)})
    sample = strict_schema(
        "sample",
        method=(Literal[METHODS], METHODS[0]),
        count=(Annotated[int, Field(ge=1)], ...),
        seed=(Annotated[int, Field(ge=0)], 0),
        parameters=(random, ...),
    )
    compute = strict_schema(
        "compute",
        what=(list[Literal[KINDS]], ["peak", "jumps"]),  # type: ignore[valid-type]
        critical=(list[str], []),
        harmonics=(Annotated[int, Field(ge=1)], 16),
        span=(Annotated[list[Annotated[float, Field(gt=0)] | str], Field(min_length=2, max_length=2)], None),
        measure=(str, "pp2"),
        element=(int | str, 0),
    )
    return strict_schema(
        "study",
        model=(str, ...),
        base=(base, base()),
        grid=(several, None),
        sample=(sample, None),
        compute=(compute, compute()),
    )


def _entries(cls: type[Model], data: Mapping[str, Any]) -> list[str]:
    """Return names such as ``eps[0]`` for the tuples of [base] or the defaults that do not vary as a whole."""
    base, varied = (table if isinstance(table := data.get(key), dict) else {} for key in ("base", "grid"))
    return entries_among(cls, {n: v for n, v in {**defaults_of(cls), **base}.items() if n not in varied})


def _is_float(kind: Any) -> bool:
    """Return whether a type is that of numbers, with or without units; tuples have no distribution."""
    return kind is float or typing.get_origin(kind) is Annotated


def _distribution(name: str, model: type[Model] | Model, definition: list[Any]) -> list[Any]:
    """Return a distribution with its numbers in the unit of the label of a parameter."""
    if definition and isinstance(model, Model):
        definition = [definition[0], *(_quantity(name, model, value) for value in definition[1:])]
    try:
        distribution(definition)
    except KeyError as error:
        raise ValueError(error.args[0]) from None
    return definition


def _study(checked: Any, subject: _Subject | None) -> Study:
    """Return the study of checked data."""
    assert subject is not None
    data = checked.model_dump(exclude_unset=True)
    with _errors_of_table("base"):
        base = {name: tuple(v) if isinstance(v, list) else v for name, v in data.get("base", {}).items()}
        model = subject.model.replace(**base) if isinstance(subject.model, Model) else made(subject.model, base)
    if "grid" in data:
        with _errors_of_table("grid"):
            vary: Grid | Sample = grid(**data["grid"])
    else:
        given = data["sample"]
        with _errors_of_table("sample"):
            if not given["parameters"]:
                raise ValueError("[sample.parameters] names no parameter; give at least one")
            vary = Sample(given.get("method", METHODS[0]), given["count"], given.get("seed", 0), given["parameters"])
    compute = checked.compute
    with _errors_of_table("compute"):
        given = compute.span or model.default_span
        first, last = (Omega_of(model, "span", x) if isinstance(x, str) else x for x in given)
        if first == last or min(first, last) <= 0:
            raise ValueError(f"span = {list(given)}: need two different positive frequencies")
        what, critical, span = tuple(compute.what), tuple(compute.critical), (first, last)
        work = Work(what, critical, compute.harmonics, span, compute.measure, compute.element)
        with warnings.catch_warnings(action="ignore"):  # are given when the study is computed
            check_work(model, work)
    return Study(subject.source, model, vary, work, subject.model if isinstance(subject.model, Model) else None)
