"""Checks of arguments against their annotations: errors name the function, the argument and the required type.

    @checked_arguments(at="values by name, such as at={'zeta': 0.05}")
    def trace(problem: AnyProblem, parameter: str, span: tuple[float, float], at: Mapping[str, float] | None, ...)

    trace(problem) needs a HarmonicBalance, such as HarmonicBalance(SpurPair(), 16); got a SpurPair: give ...
    trace(at) needs values by name, such as at={'zeta': 0.05}; got a tuple
    trace: span = 0.5 must be two numbers (from, to)

An object of another class raises a TypeError; a number, text or sequence that does not fit raises a ValueError. A
``float`` is a real number of any type, an ``int`` a whole number; True and False are neither. An ``Array`` is an object
that NumPy converts to an array of numbers. Arguments must be finite. Fields need not be finite, because each class
checks its own ranges. Arguments equal to their default, and those with the annotation Any, are not checked. Classes
that a module imports for type checkers only are compared by name.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import os
import re
import sys
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Annotated, Any, Self, TypeVar

import numpy as np

from hbgear.common.text.messages import article, did_you_mean, quoted, shortened

F = TypeVar("F", bound=Callable[..., Any])


def checked_arguments(**needs: str) -> Callable[[F], F]:
    """Return a decorator of a function or method that checks its arguments against their annotations.

    ``needs`` has the requirement of an argument in words with an example, if its annotation is not clear to users. The
    function then raises a ValueError for a number, text or sequence that does not fit, and a TypeError for an object of
    another class. A call takes about 10 microseconds longer, so that it is not suitable for functions that run once per
    Newton step.
    """

    def decorated(call: F) -> F:
        signature = inspect.signature(call)
        parameters = signature.parameters
        variadic = {inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD}
        single = not variadic & {parameter.kind for parameter in parameters.values()}
        names = [name for name, parameter in parameters.items() if parameter.kind is not inspect.Parameter.KEYWORD_ONLY]
        needed = {name for name, parameter in parameters.items() if parameter.default is parameter.empty}
        annotated = {  # type and default of each; to read a Signature takes longer
            name: (parameter.annotation, parameter.default, parameter.kind is parameter.VAR_KEYWORD)
            for name, parameter in parameters.items()
            if parameter.annotation is not parameter.empty
        }
        name = call.__name__

        def bound_to(args: tuple[Any, ...], given: dict[str, Any]) -> Mapping[str, Any]:
            """Return the arguments by name, ten times faster than `Signature.bind` for a correct call."""
            if single and len(args) <= len(names):
                bound = dict(zip(names, args, strict=False), **given)
                if len(bound) == len(args) + len(given) and needed <= bound.keys() <= parameters.keys():
                    return bound
            try:
                return signature.bind(*args, **given).arguments
            except TypeError as error:
                own = [key for key in parameters if key != "self"]
                unknown = [key for key in given if key not in parameters] if single else []
                listed = did_you_mean(unknown[0], own, "its arguments are:") if unknown else ""
                raise TypeError(f"{call.__qualname__.removesuffix('.__init__')}: {error}{listed}") from None

        @functools.wraps(call)
        def checked(*args: Any, **given: Any) -> Any:
            bound = bound_to(args, given)
            owner = type(bound["self"]).__name__ if "self" in bound else name
            if "self" in bound and name != "__init__":
                owner = f"{owner}.{name}"
            for key, (annotation, default, several) in annotated.items():
                if (value := bound.get(key, default)) is default:
                    continue
                kind = _kind(call.__module__, annotation)
                if several:
                    for key, inner in value.items():
                        _check_argument(owner, key, inner, kind)
                else:
                    _check_argument(owner, key, value, kind, needs.get(key, ""))
            return call(*args, **given)

        return typing.cast(F, checked)

    return decorated


def _check_argument(owner: str, name: str, value: Any, kind: Any, need: str = "") -> None:
    """Raise an error for an argument that does not fit its annotation or is not finite."""
    given: Any = type(value)
    if _fits_by_type(given, kind):
        return
    check(owner, name, value, kind, need)
    if kind is not Any:
        _check_finite(owner, name, value)


class NamedFields:
    """Base of classes with many fields: a TypeError names the field similar to an unknown one, and missing fields."""

    __slots__ = ()

    def __new__(cls, *args: Any, **given: Any) -> Self:
        """Return a new instance, which ``__init__`` sets up; copies are made without arguments."""
        if args or given:
            known: type = cls
            parameters, required = _parameters_of(known)
            accepted = (*parameters, *getattr(cls.__init__, "old_names", ()))
            unknown = next((name for name in given if name not in accepted), None)
            if unknown is not None and parameters:
                raise TypeError(f"{cls.__name__} has no parameter '{unknown}'{did_you_mean(unknown, parameters)}")
            missing = [name for name in required if name not in given and name not in parameters[: len(args)]]
            if missing:
                texts = ", ".join(missing), ", ".join(required)
                raise TypeError(f"{cls.__name__}: missing {texts[0]}; its required arguments are {texts[1]}")
        return super().__new__(cls)


@functools.lru_cache(maxsize=256)
def _parameters_of(cls: type) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the arguments of the ``__init__`` of a class, () if it takes any, and the required ones."""
    parameters = list(inspect.signature(cls.__init__).parameters.values())[1:]  # type: ignore[misc]
    if any(parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL) for parameter in parameters):
        return (), ()
    required = tuple(parameter.name for parameter in parameters if parameter.default is parameter.empty)
    return tuple(parameter.name for parameter in parameters), required


def check_fields(instance: Any) -> None:
    """Check the fields of a dataclass against their annotations; to be called in its ``__post_init__``.

    Raises
    ------
    ValueError
        If a number, text or sequence does not fit.
    TypeError
        If a field is an object of another class.
    """
    fields = {field.name: field for field in dataclasses.fields(instance)}
    for cls in type(instance).__mro__:
        for name, annotation in vars(cls).get("__annotations__", {}).items():
            field = fields.pop(name, None)
            if field is not None and (value := getattr(instance, name)) is not field.default:
                check(type(instance).__name__, name, value, _kind(cls.__module__, annotation))


def check(owner: str, name: str, value: Any, kind: Any, need: str = "") -> None:
    """Check a value against a type of an annotation.

    Raises
    ------
    ValueError
        If a number, text or sequence does not fit.
    TypeError
        If it is an object of another class.
    """
    if type(value) is kind:  # the usual case and the fastest: models have many fields
        return
    entries = value if isinstance(value, Mapping) else {}
    for key, inner in entries.items() if (inner_kind := _kind_of_entries(kind)) is not None else ():
        if isinstance(key, str) and inner_kind is float:
            check(owner, f"{name}: {shortened(key)}", inner, inner_kind)
    try:
        good = fits(value, kind)
    except (TypeError, ValueError, OverflowError):  # an error that the value itself raises
        good = False
    if good:
        return
    kinds = [alternative for alternative in _alternatives(kind) if alternative is not type(None)]
    if need or all(isinstance(alternative, type) and alternative not in _WORDS for alternative in kinds):
        way = _way(value, kinds)
        raise TypeError(f"{owner}({name}) needs {need or words(kind)}; got {given(value)}{way and f': {way}'}")
    raise ValueError(f"{owner}: {name} = {quoted(value)} must be {words(kind)}")


def _check_finite(owner: str, name: str, value: Any) -> None:
    """Raise an error for numbers that are not finite, also in a sequence or dict."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _check_finite(owner, f"{name}: {shortened(str(key))}", inner)
        return
    if isinstance(value, float):
        finite, need = np.isfinite(value), "a finite number"
    elif isinstance(value, list | tuple | np.ndarray | np.generic):
        try:
            array = np.asarray(value)
        except ValueError:  # sequences of different lengths, if they are allowed
            return
        finite, need = array.dtype.kind not in "fc" or np.isfinite(array).all(), "finite"
    else:
        return
    if not finite:
        raise ValueError(f"{owner}: {name} = {quoted(value)} must be {need}")


def fits(value: Any, kind: Any) -> bool:
    """Return whether a value is of a type; numbers too large for a float raise OverflowError."""
    if len(alternatives := _alternatives(kind)) > 1:
        return any(fits(value, alternative) for alternative in alternatives)
    kind = alternatives[0]
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any or isinstance(kind, TypeVar | str):
        return True
    if origin is typing.Literal:
        return isinstance(value, str) and value in inner
    if kind is None or kind is type(None):
        return value is None
    if value is np.ma.masked:  # its value is unknown
        return False
    if isinstance(value, np.ndarray) and value.ndim == 0 and kind in _FITS:
        value = value.item()
    if kind in _FITS:
        return _FITS[kind](value)
    if isinstance(kind, type) and issubclass(kind, np.floating | np.integer):
        return _FITS[float if issubclass(kind, np.floating) else int](value)
    if origin is np.ndarray:
        return np.asarray(value).dtype.kind in "biuf"
    if origin in (tuple, Sequence):
        return _is_sequence(value) and _all_fit(value, origin, inner)
    if origin in (Mapping, dict):
        return isinstance(value, Mapping) and all(fits(k, inner[0]) and fits(v, inner[1]) for k, v in value.items())
    if origin is os.PathLike:
        return isinstance(value, os.PathLike)
    if origin is Callable:
        return callable(value)
    return _is_instance(value, kind) if isinstance(kind, type) else True


@functools.lru_cache(maxsize=1024)
def _fits_by_type(given: type, kind: Any) -> bool:
    """Return whether every value of a class is of a type, and cannot contain numbers that are not finite."""
    if issubclass(given, float | list | tuple | np.ndarray | np.generic | Mapping | type):
        return False
    classes = [cls for cls in _alternatives(kind) if isinstance(cls, type)]
    return given in classes or any(_is_of(given, cls) for cls in classes if cls not in _FITS)


def _is_of(given: type, kind: type) -> bool:
    """Return whether a class is derived from another one, or has the methods of a protocol."""
    if not getattr(kind, "_is_protocol", False):
        return kind in given.__mro__
    has_data = bool(kind.__annotations__) or any(isinstance(member, property) for member in vars(kind).values())
    return getattr(kind, "_is_runtime_protocol", False) and not has_data and issubclass(given, kind)


def words(kind: Any) -> str:
    """Return a type in words, to follow "must be" or "needs"."""
    if len(alternatives := _alternatives(kind)) > 1:
        *others, last = dict.fromkeys(words(alternative) for alternative in alternatives)
        return f"{', '.join(others)} or {last}" if others else last
    kind = alternatives[0]
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Literal:
        return " or ".join(repr(value) for value in inner)
    if origin is np.ndarray:
        return "an array of numbers"
    if origin is os.PathLike:
        return "a path"
    if origin is Callable:
        return "a function"
    if origin in (tuple, Sequence) and inner:
        if inner == (float, float):
            return "two numbers (from, to)"
        noun = _plural(inner[0])
        fixed = origin is tuple and inner[-1] is not ...
        return f"{_COUNTS.get(len(inner), len(inner))} {noun}" if fixed else f"a sequence of {noun}"
    if origin in (Mapping, dict):
        return f"a dict of {_plural(inner[1])}"
    return _WORDS.get(kind) or _NEEDED.get(kind.__name__) or article(kind.__name__)


def given(value: Any) -> str:
    """Return a value in a few words, to follow "got"."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, str | int | float) or value is None:
        return quoted(value)
    return article(type(value).__name__)


# ---- types


def _is_float(value: Any) -> bool:
    """Return whether a value is a real number that fits into a float."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_) and isinstance(float(value), float)


_FITS: dict[Any, Callable[[Any], bool]] = {
    float: _is_float,
    int: lambda value: isinstance(value, int | np.integer) and not isinstance(value, bool),
    bool: lambda value: isinstance(value, bool | np.bool_),
}


_WORDS: dict[Any, str] = {
    float: "a finite number",
    int: "a whole number",
    bool: "True or False",
    str: "a text",
    type(None): "None",
}


_COUNTS = {2: "two", 3: "three"}


def _plural(kind: Any) -> str:
    """Return the name of a type in the plural, for the elements of a sequence."""
    kinds = _alternatives(kind)
    names = ["number" if member is float else re.sub("^an? ", "", words(member)).partition(",")[0] for member in kinds]
    return " or ".join(dict.fromkeys(f"{name}{'es' if name.endswith('ch') else 's'}" for name in names))


@functools.cache
def _alternatives(kind: Any) -> tuple[Any, ...]:
    """Return the types of a union, or the type itself. ``Annotated[Any, Problem]`` is a Problem."""
    if isinstance(kind, TypeVar) and kind.__constraints__:
        return kind.__constraints__
    union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    kinds = typing.get_args(kind) if union else (kind,)
    return tuple(typing.get_args(member)[1] if typing.get_origin(member) is Annotated else member for member in kinds)


@functools.cache
def _kind_of_entries(kind: Any) -> Any:
    """Return the type of the values of a dict; None for other types."""
    mappings = (mapping for mapping in _alternatives(kind) if typing.get_origin(mapping) in (Mapping, dict))
    return next((typing.get_args(mapping)[1] for mapping in mappings), None)


def _is_sequence(value: Any) -> bool:
    """Return whether a value is a sequence or an array, but no text."""
    return isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes)


def _all_fit(values: Any, origin: Any, inner: tuple[Any, ...]) -> bool:
    """Return whether the elements of a sequence fit the types of its elements."""
    if origin is tuple and inner[-1] is not ...:
        return len(values) == len(inner) and all(fits(x, kind) for x, kind in zip(values, inner, strict=True))
    if isinstance(values, np.ndarray) and inner[0] is float:
        return values.ndim == 1 and values.dtype.kind in "iuf"
    return all(fits(x, inner[0]) for x in values)


def _is_instance(value: Any, kind: type) -> bool:
    """Return whether a value is an instance of a class, which may be known by name only."""
    if isinstance(value, type):  # a class has the methods of its instances, but is no instance
        return issubclass(type, kind)
    return kind.__name__ in _names(type(value)) if issubclass(kind, _ByName) else isinstance(value, kind)


class _ByName:
    """Base of the placeholders of classes that a module imports for type checkers only."""


class _Namespace(dict[str, Any]):
    """Names of a module; a missing name becomes a placeholder of the class of that name."""

    def __missing__(self, name: str) -> Any:
        import builtins

        return vars(builtins).get(name) or type(name, (_ByName,), {})


@functools.cache
def _evaluated(module: str, annotation: str) -> Any:
    """Return the type of an annotation that is a text."""
    try:
        return eval(annotation, {}, _Namespace(vars(sys.modules[module])))
    except (AttributeError, TypeError):  # the module or generic class is not imported
        return Any


def _kind(module: str, annotation: Any) -> Any:
    """Return the type of an annotation."""
    return _evaluated(module, annotation) if isinstance(annotation, str) else annotation


# ---- words


def _names(cls: type) -> list[str]:
    """Return the names of a class and its base classes."""
    return [base.__name__ for base in cls.__mro__]


_NEEDED = {
    "Branch": "a Branch, as trace and load give it",
    "Model": "a model, such as SpurPair() or a System",
    "HarmonicBalance": "a HarmonicBalance, such as HarmonicBalance(SpurPair(), 16)",
    "Problem": "a HarmonicBalance, such as HarmonicBalance(SpurPair(), 16), or another problem with evaluate",
    "StepControl": "StepControl(...), such as StepControl(max_points=100)",
    "NewtonSettings": "NewtonSettings(...), such as NewtonSettings(tolerance=1e-12)",
    "SteadyStateSettings": "SteadyStateSettings(...), such as SteadyStateSettings(tolerance=1e-6)",
    "Point": "a Point, such as curve['LP1'] or curve[-1]",
    "Cases": "Cases, as cases gives them",
    "JumpMap": "a JumpMap, as jump_map gives it",
}


_CONVERSIONS = {
    ("Model", "Problem"): "give HarmonicBalance(model)",
    ("Model", "HarmonicBalance"): "give HarmonicBalance(model)",
    ("Model", "Branch"): "trace it first: trace(HarmonicBalance(model), 'Omega', span)",
    ("HarmonicBalance", "Branch"): "trace it first: trace(problem, 'Omega', span)",
    ("HarmonicBalance", "Model"): "give its model: problem.model",
    ("Branch", "Model"): "give the model it was traced with: branch.problem.model",
    ("Branch", "Problem"): "give the problem it was traced with: branch.problem",
    ("Branch", "HarmonicBalance"): "give the problem it was traced with: branch.problem",
    ("Branch", "Point"): "take one of it: branch[-1]",
    ("str", "Branch"): "load a file first: load(path)",
    ("Path", "Branch"): "load a file first: load(path)",
    ("Point", "Branch"): "give the whole curve",
}
"""Instructions by class that was given and class that is required."""


def _way(value: Any, kinds: Sequence[Any]) -> str:
    """Return the instruction for a frequent mistake: how to convert the value to the required type."""
    needed = [kind.__name__ for kind in kinds if isinstance(kind, type)]
    if isinstance(value, type):
        return f"call it: {value.__name__}()"
    return next(
        (_CONVERSIONS[name, kind] for name in _names(type(value)) for kind in needed if (name, kind) in _CONVERSIONS),
        "",
    )
