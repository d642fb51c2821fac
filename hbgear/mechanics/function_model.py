"""Models from functions and files: the parameters of a function or of its elements are the parameters of the machine.

machine(zeta, gap, ...)  ->  M q'' + C q' + K q + sum_j w_j [p_j + c_j d_j'] = F      (see `hbgear.mechanics.models`)
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import typing
from collections import Counter
from collections.abc import Callable, Mapping
from numbers import Integral
from typing import Any, ClassVar, Literal, ParamSpec, Self, overload

import numpy as np

from hbgear.common.ranges import Range, checked
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.mechanics.fields import defaults_of, is_plain, kinds_of, plain
from hbgear.mechanics.laws.registry import LAWS
from hbgear.mechanics.models import Model, System

P = ParamSpec("P")


@dataclasses.dataclass(frozen=True, eq=False)
class SystemOfLaws(System):  # numpydoc ignore=PR02
    """A `System` whose parameters are the numbers of its laws and dampers, by their keys in files.

    A key that several elements have is preceded by the name of the element: ``stop.gap``.

    Parameters
    ----------
    M, C, K : array_like
        Mass, damping and stiffness, see `System`.
    elements : sequence of Element
        Elements.
    load : Load or sequence of Load, optional
        Loads.
    dof_names : sequence of str, optional
        Names of the coordinates.
    speed : SpeedTerms, optional
        Terms that depend on speed.
    receptances : Receptances, optional
        Measured part of the structure.
    laws : sequence of (str, dict)
        Name of the law of each element and the values of its keys, see `hbgear.mechanics.laws.registry`.

    Examples
    --------
    >>> import hbgear as hb
    >>> stop = hb.Element([1.0], hb.Unilateral(k=5.0, gap=1.0), name="stop")
    >>> model = SystemOfLaws([[1.0]], [[0.1]], [[1.0]], [stop], laws=[("unilateral", {"k": 5.0, "gap": 1.0})])
    >>> model.parameters, model.replace(gap=0.5).elements[0].law.breakpoints
    ({'k': 5.0, 'gap': 1.0}, (0.5,))
    """

    laws: Any = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "laws", tuple((str(name), dict(values)) for name, values in self.laws))
        if len(self.laws) != len(self.elements):
            raise ValueError(f"SystemOfLaws: {len(self.laws)} laws for {len(self.elements)} elements")

    def _places(self) -> dict[str, tuple[int, str]]:
        """Return the number of the element and the key of each parameter."""
        keys = [(i, key) for i, (_, values) in enumerate(self.laws) for key, x in values.items() if _is_number(x)]
        keys += [(i, "damping") for i, element in enumerate(self.elements) if element.damping]
        count = Counter(key for _, key in keys)
        return {(key if count[key] == 1 else f"{self.elements[i].name}.{key}"): (i, key) for i, key in keys}

    def _value(self, i: int, key: str) -> float:
        return float(self.elements[i].damping if key == "damping" else self.laws[i][1][key])

    @property
    def parameters(self) -> dict[str, float]:
        """Numbers of the laws and dampers by name."""
        return {name: self._value(*key) for name, key in self._places().items()}

    def replace(self, /, **changes: Any) -> Self:
        """Return a copy with other values of parameters or fields by name; KeyError if there is no such parameter."""
        places = self._places()
        elements, laws = list(self.elements), [(name, dict(values)) for name, values in self.laws]
        for name in [name for name in changes if name in places]:
            i, key = places[name]
            value = float(changes.pop(name))
            if key == "damping":
                elements[i] = dataclasses.replace(elements[i], damping=value)
            else:
                laws[i][1][key] = value
                elements[i] = dataclasses.replace(elements[i], law=LAWS[laws[i][0]].from_toml(laws[i][1]))
        for name in changes:
            if name not in kinds_of(type(self)):
                raise KeyError(f"the structure has no parameter '{name}'{did_you_mean(name, places)}")
        return dataclasses.replace(self, **{"elements": elements, "laws": laws, **changes})


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


class FunctionModel(Model):
    """Frozen dataclass that `model` creates from a function, with a field for each parameter of the function."""

    function: ClassVar[Callable[..., Any]]
    """Function that builds the system."""

    def __post_init__(self) -> None:
        super().__post_init__()
        owner = type(self).__name__
        for name, kind in kinds_of(type(self)).items():
            if typing.get_origin(kind) is tuple and isinstance(getattr(self, name), list | np.ndarray):
                object.__setattr__(self, name, tuple(getattr(self, name)))
            _check_value(owner, name, kind, getattr(self, name))

    def __repr__(self) -> str:
        """Return the call that creates the model, with the values that differ from the defaults."""
        defaults = defaults_of(type(self))
        values = {name: getattr(self, name) for name in kinds_of(type(self))}
        changes = [f"{name}={x!r}" for name, x in values.items() if name not in defaults or x != defaults[name]]
        return f"{type(self).__name__}({', '.join(changes)})"

    def system(self) -> System:
        """Return the system that the function builds.

        Raises
        ------
        ValueError
            If the function does not return a `System`.
        """
        result = type(self).function(**{name: getattr(self, name) for name in kinds_of(type(self))})
        if not isinstance(result, System):
            raise ValueError(f"{self!r} returned {str(result)[:40]}; need a System: return hb.System(...) from it")
        return result


@overload
def model(function: Callable[P, System], /) -> Callable[P, FunctionModel]: ...


@overload
def model(
    *,
    labels: Mapping[str, str] | None = None,
    ranges: Mapping[str, Range] | None = None,
    usual: Mapping[str, Range] | None = None,
    default_span: tuple[float, float] | None = None,
) -> Callable[[Callable[P, System]], Callable[P, FunctionModel]]: ...


def model(
    function: Callable[..., System] | None = None,
    /,
    *,
    labels: Mapping[str, str] | None = None,
    ranges: Mapping[str, Range] | None = None,
    usual: Mapping[str, Range] | None = None,
    default_span: tuple[float, float] | None = None,
) -> Any:
    """Create a model from a function that builds a `System`: a decorator, or a call.

    The forms are ``@model`` for the default options, ``@model(labels=..., ranges=...)`` with options, and
    ``model(function)`` for a function that exists.

    The result is a class of models with one field for each parameter of the function. Parameters of type float can be
    continuation parameters in addition to Omega. The class is used like any model: in `trace`, `FoldProblem`,
    `critical_parameter`, `jump_map`, `cases`, saved files, and on the command line as ``hbgear trace mine.py:stop``,
    where its description is the docstring of the function.

    Parameters
    ----------
    function : callable
        Function. Its parameters have one of the types float, int, bool, str, ``Literal`` and ``tuple[float, ...]``; a
        parameter without a default must be given.
    labels, ranges, usual, default_span : optional
        Class attributes of `Model`. Default: those of `Model`.

    Returns
    -------
    type
        Class of models, or a decorator if it is called with options only.

    Raises
    ------
    ValueError
        If a parameter has no type, another type, or the name of a method of models; if the function has ``*args``; or
        if labels, ranges or a span have other types, or names that the function does not have.

    Examples
    --------
    >>> import hbgear as hb
    >>> @hb.mechanics.model(ranges={"zeta": hb.mechanics.Range(low=0)}, default_span=(0.5, 1.6))
    ... def stop(zeta: float = 0.05, gap: float = 1.0) -> hb.System:
    ...     "A mass on a spring that meets a stop."
    ...     element = hb.Element([1.0], hb.Unilateral(k=5.0, gap=gap), name="stop")
    ...     return hb.System([[1.0]], [[2 * zeta]], [[1.0]], [element], hb.Load(cosine={1: [0.2]}))
    >>> stop(zeta=0.1)
    stop(zeta=0.1)
    >>> stop(zeta=0.1).parameters
    {'zeta': 0.1, 'gap': 1.0}
    >>> curve = hb.trace(hb.HarmonicBalance(stop(), 8), "gap", (1.5, 1.4), at={"Omega": 1.1})
    >>> curve.status.complete
    True

    Without options, the decorator is written without parentheses:

    >>> @hb.mechanics.model
    ... def spring(k: float = 1.0) -> hb.System:
    ...     return hb.System([[1.0]], [[0.1]], [[k]], [hb.Element([1.0], hb.Cubic(0.5))], hb.Load(cosine={1: [0.2]}))
    >>> spring(k=2.0).parameters
    {'k': 2.0}
    """
    options = {"labels": labels, "ranges": ranges, "usual": usual, "default_span": default_span}
    given = {name: value for name, value in options.items() if value is not None}
    _check_options(given)
    return (lambda other: _model_class(other, given)) if function is None else _model_class(function, given)


def _check_options(options: Mapping[str, Any]) -> None:
    """Raise ValueError for labels, ranges or a span whose types are not those of `Model`."""
    for name, kind, kinds in (("labels", str, "texts"), ("ranges", Range, "Range"), ("usual", Range, "Range")):
        values = options.get(name, {})
        if not isinstance(values, Mapping) or not all(isinstance(value, kind) for value in values.values()):
            example = "{'zeta': 'damping'}" if kind is str else "{'zeta': hb.mechanics.Range(low=0)}"
            raise ValueError(f"model: {name} = {quoted(values)} must be a dict of {kinds} by name, such as {example}")
    span = options.get("default_span", (0.5, 1.5))
    try:
        first, last = (float(end) for end in span)
        is_valid = 0 < first < math.inf and 0 < last < math.inf and first != last
    except (TypeError, ValueError, OverflowError):
        is_valid = False
    if not is_valid:
        raise ValueError(f"model: default_span = {quoted(span)} must be two different frequencies, such as (0.5, 1.5)")


def _model_class(function: Callable[..., Any], options: Mapping[str, Any]) -> type[FunctionModel]:
    """Create the class of models of a function."""
    if not inspect.isfunction(function):
        raise ValueError(f"@model decorates a function, got {function!r}")
    name = function.__name__
    fields = [_field(name, parameter, function) for parameter in inspect.signature(function).parameters.values()]
    names = [field[0] for field in fields]
    for option, extra_keys in (("labels", ("Omega", "amplitude")), ("ranges", ()), ("usual", ())):
        for key in options.get(option, {}):
            if key not in (*names, *extra_keys):
                raise ValueError(f"{name}: {option} of '{key}', which is no parameter{did_you_mean(key, names)}")
    namespace = {"function": staticmethod(function), "__doc__": function.__doc__ or "", **options}
    cls = dataclasses.make_dataclass(name, fields, bases=(FunctionModel,), namespace=namespace, frozen=True, repr=False)
    cls.__module__, cls.__qualname__ = function.__module__, function.__qualname__  # for pickle
    return cls


def _field(owner: str, parameter: inspect.Parameter, function: Callable[..., Any]) -> tuple[str, Any, Any]:
    """Return name, type and default of a field."""
    name = parameter.name
    if parameter.kind not in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
        raise ValueError(f"{owner}({parameter}): a model needs parameters with names, such as zeta: float = 0.05")
    if parameter.annotation is parameter.empty:
        raise ValueError(f"{owner}: {name} has no type; write {name}: float = 1.0, for instance")
    if name in _RESERVED or name.startswith("_"):
        raise ValueError(f"{owner}: no parameter of a model can be called '{name}'; choose another name")
    kind = parameter.annotation
    if isinstance(kind, str):
        try:
            kind = eval(kind, function.__globals__)  # as Python evaluates types that are not strings
        except Exception as error:
            raise ValueError(f"{owner}: the type of {name}, {kind}, cannot be understood: {error}") from None
    kind = plain(kind)
    if not is_plain(kind):
        raise ValueError(f"{owner}: {name} is of type {kind}; need float, int, bool, str, Literal or tuple[float, ...]")
    default = parameter.default
    if isinstance(default, list | np.ndarray):
        default = tuple(default)
    return name, kind, dataclasses.field() if default is parameter.empty else dataclasses.field(default=default)


_RESERVED = frozenset({"Omega", "function", *(name for name in dir(FunctionModel))})


def _check_value(owner: str, name: str, kind: Any, value: Any) -> None:
    """Raise ValueError for a value of another type than its field; floats are checked by `Model`."""
    requirement = None
    if kind is int and (isinstance(value, bool) or not isinstance(value, Integral)):
        requirement = "a whole number"
    elif kind is bool and not isinstance(value, bool | np.bool_):
        requirement = "True or False"
    elif kind is str and not isinstance(value, str):
        requirement = "a text"
    elif typing.get_origin(kind) is Literal and value not in typing.get_args(kind):
        requirement = "one of " + ", ".join(map(repr, typing.get_args(kind)))
    elif typing.get_origin(kind) is tuple:
        if not isinstance(value, tuple):
            requirement = "a sequence such as (0.1, 0.05)"
        elif set(typing.get_args(kind)) <= {float, int, ...}:
            for i, entry in enumerate(value):
                checked(owner, f"{name}[{i}]", entry)
    if requirement:
        raise ValueError(f"{owner}: {name} = {value!r} must be {requirement}")
