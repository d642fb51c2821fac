"""Registry of force laws: the name and the fields under which a law is written to and read from files.

    @register_law                      header of a file:   {"law": "Tanh", "fields": {"k": 1.0, "w": 0.5}}
    @dataclass(frozen=True)            TOML, [[element]]:  law = "Tanh"
    class Tanh(Law): ...                                   k = 1.0

One entry serves both formats. Keys in TOML are the fields of the dataclass: numbers, texts, lists of numbers, and lists
of rows. A field ``stiffness`` that is a periodic function has the key ``eps``, the list of its cosine amplitudes with
opposite sign. A law with other fields is refused in TOML, and one with fields that are no data is not held by the
header of a file; both messages name the field.

No code is loaded for a file: a law of a user is known after the module that registers it has been imported.
"""

from __future__ import annotations

import dataclasses
import inspect
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, overload

from hbgear.common.text.messages import did_you_mean, origin_of, quoted
from hbgear.mechanics.fields import kinds_of, plain
from hbgear.mechanics.laws.compiled_law import CompiledLaw
from hbgear.mechanics.laws.contact_damping import ClippedKelvinVoigt, HuntCrossley, KelvinVoigt
from hbgear.mechanics.laws.friction import ContactFriction, Coulomb, Iwan, Jenkins, RigidFriction
from hbgear.mechanics.laws.laws import Backlash, Cubic, Law, Parallel, PiecewiseLinear, Unilateral
from hbgear.mechanics.laws.mesh_contacts import MeshContacts, ToothContact
from hbgear.mechanics.laws.vector_laws import Component, Directed, Polynomial, RadialClearance, SlidingTeeth
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased

_Law = TypeVar("_Law", bound=Callable[..., Law])

TOML_KINDS: Mapping[Any, Any] = {
    float: float,
    int: int,
    bool: bool,
    str: str,
    tuple[float, ...]: list[float],
    tuple[int, ...]: list[int],
    tuple[tuple[float, ...], ...]: list[list[float]],
    tuple[tuple[int, ...], ...]: list[list[int]],
}
"""Types of fields that TOML can hold, and the types of their values there."""

ELEMENT_KEYS = ("name", "direction", "law", "damping", "error")
"""Keys of the table of an element that belong to the element itself, so that no field of a law can have them."""


@dataclass(frozen=True)
class RegisteredLaw:
    """Entry of the registry.

    Attributes
    ----------
    name : str
        Name in files and in TOML.
    build : callable
        Class of the law, or a function that returns a law.
    required : tuple of str
        TOML keys without a default, in the order in which messages list them.
    kinds : mapping
        Type of the value of every TOML key.
    no_toml : str
        Reason for which the law has no TOML form. Empty if it has one.
    """

    name: str
    build: Callable[..., Law]
    required: tuple[str, ...]
    kinds: Mapping[str, Any]
    no_toml: str

    @property
    def keys(self) -> tuple[str, ...]:
        """TOML keys, the required ones first."""
        return (*self.required, *(key for key in self.kinds if key not in self.required))

    def from_toml(self, values: Mapping[str, Any]) -> Law:
        """Build the law from the keys of a TOML table, without those of the element.

        Raises
        ------
        ValueError
            If the law has no TOML form, a required key is missing, or a key is unknown.
        """
        if self.no_toml:
            raise ValueError(f"law = '{self.name}' cannot be given in TOML: {self.no_toml}; build it in Python")
        missing = next((key for key in self.required if key not in values), None)
        if missing is not None:
            raise ValueError(f"law = '{self.name}' needs {missing}: give {', '.join(self.required)}")
        unknown = next((key for key in values if key not in self.kinds), None)
        if unknown is not None:
            raise ValueError(f"law = '{self.name}' has no {unknown}; it has {', '.join(self.keys)}")
        fields = dict(values)
        if "eps" in fields:
            fields["stiffness"] = Series(1.0, tuple(-x for x in fields.pop("eps")))
        return self.build(**{key: tuple(x) if isinstance(x, list) else x for key, x in fields.items()})

    def from_fields(self, fields: Mapping[str, Any]) -> Law:
        """Build the law from its fields in the header of a file.

        Raises
        ------
        KeyError
            If the law has no such field.
        ValueError
            If a value is not of the type of its field, or the class refuses it.
        """
        kinds = kinds_of(typing.cast(type, self.build))
        for name, value in fields.items():
            if name not in kinds:
                raise KeyError(f"{self.name} has no field '{str(name)[:40]}'{did_you_mean(str(name), kinds)}")
            if kinds[name] in (float, int) and (isinstance(value, bool) or not isinstance(value, int | float)):
                raise ValueError(f"{self.name}: {name} = {quoted(value)} must be a number")
        return self.build(**fields)


LAWS: dict[str, RegisteredLaw] = {}
"""Registered laws by name."""

_BY_CLASS: dict[type[Law], RegisteredLaw] = {}
"""Entries by class. Functions that return a law have none: a file holds the law that they return."""


@overload
def register_law(law: _Law, /, *, name: str | None = None, required: tuple[str, ...] | None = None) -> _Law: ...


@overload
def register_law(*, name: str | None = None, required: tuple[str, ...] | None = None) -> Callable[[_Law], _Law]: ...


def register_law(law: Any = None, /, *, name: str | None = None, required: tuple[str, ...] | None = None) -> Any:
    """Register a force law, so that files and TOML can hold it: a decorator of a class or function, or a call.

    The forms are ``@register_law`` for the default options, ``@register_law(name="septic")`` with options, and
    ``register_law(Septic, name="septic")`` for a class that exists.

    Parameters
    ----------
    law : type or callable
        Frozen dataclass derived from `Law`. A function that returns a law is registered for TOML only; files hold the
        law that it returns.
    name : str, optional
        Name in files and in TOML. Default: the name of the class.
    required : tuple of str, optional
        Keys that TOML must give. Default: the fields without a default value.

    Returns
    -------
    type or callable
        The class itself, or a decorator if it is called with options only.

    Raises
    ------
    TypeError
        If the class is not a dataclass derived from `Law`.
    ValueError
        If another law is registered under the name.

    Notes
    -----
    A class that is defined again, as in a notebook, replaces the first definition.

    Examples
    --------
    >>> import hbgear as hb
    >>> from dataclasses import dataclass
    >>> @hb.mechanics.register_law
    ... @dataclass(frozen=True)
    ... class Septic(hb.mechanics.Law):
    ...     k7: float = 1.0
    ...
    ...     def force(self, d, v, tau):
    ...         return self.k7 * d**7, 7 * self.k7 * d**6, 0 * d
    ...
    >>> bar = hb.System([[1.0]], [[0.1]], [[1.0]], [hb.Element([1.0], Septic(0.3))], hb.Load(cosine={1: [0.2]}))
    >>> curve = hb.trace(hb.HarmonicBalance(bar, 5), "Omega", (0.5, 0.7))
    >>> curve.meta["model"]["fields"]["elements"][0]["fields"]["law"]["fields"]
    {'k7': 0.3}

    With options, of a function:

    >>> @hb.mechanics.register_law(name="soft stop", required=("k",))
    ... def soft_stop(k: float, gap: float = 1.0):
    ...     return hb.Unilateral(k=k, gap=gap)
    ...
    >>> soft_stop(2.0).breakpoints
    (1.0,)
    """
    if law is None:
        return lambda decorated: _register(decorated, name, required)
    return _register(law, name, required)


def _register(law: Any, name: str | None, required: tuple[str, ...] | None) -> Any:
    """Check a law, add its entry to the registry and return it."""
    is_class = isinstance(law, type)
    if is_class and not (issubclass(law, Law) and dataclasses.is_dataclass(law)):
        raise TypeError(
            f"register_law: {law.__name__} must be a dataclass derived from hb.mechanics.Law: put "
            "@dataclass(frozen=True) below @hb.mechanics.register_law"
        )
    if not is_class and not inspect.isfunction(law):
        raise TypeError(f"register_law needs a class derived from hb.mechanics.Law, got {quoted(law)}")
    name = name or law.__name__
    existing = LAWS.get(name)
    if existing is not None and origin_of(existing.build) != origin_of(law):
        raise ValueError(
            f"register_law: the name '{name}' belongs to {'.'.join(origin_of(existing.build))}; "
            "give another one: register_law(name=...)"
        )
    LAWS[name] = _entry(law, name, required)
    if is_class:
        _BY_CLASS[law] = LAWS[name]
    return law


def _entry(law: Any, name: str, required: tuple[str, ...] | None) -> RegisteredLaw:
    """Derive the TOML keys from the fields of a class, or from the parameters of a function."""
    fields = kinds_of(law) if isinstance(law, type) else _parameter_kinds(law)
    defaults = {p.name for p in inspect.signature(law).parameters.values() if p.default is not inspect.Parameter.empty}
    kinds, no_toml = {}, ""
    for field, kind in fields.items():
        if field in ELEMENT_KEYS:
            no_toml = no_toml or f"its field {field} has the name of a key of the element"
        elif field == "stiffness" and kind == Phased:
            kinds["eps"] = list[float]
        elif kind in TOML_KINDS or typing.get_origin(kind) is typing.Literal:
            kinds[field] = TOML_KINDS.get(kind, kind)
        else:
            no_toml = no_toml or f"its field {field} is no number, text or list of numbers"
    without_default = tuple(field for field in kinds if field not in defaults and field != "eps")
    return RegisteredLaw(name, law, without_default if required is None else required, kinds, no_toml)


def _parameter_kinds(function: Callable[..., Law]) -> dict[str, Any]:
    """Return the types of the parameters of a function by name."""
    hints = typing.get_type_hints(function)
    return {name: plain(hints.get(name)) for name in inspect.signature(function).parameters}


def registered(law: Law) -> RegisteredLaw:
    """Return the entry of the class of a law; raise TypeError if it is not registered."""
    cls = type(law)
    if cls not in _BY_CLASS:
        raise TypeError(
            f"the law {cls.__name__} is not registered: put @hb.mechanics.register_law before the class, which must be "
            "a dataclass"
        )
    return _BY_CLASS[cls]


def law_named(name: str, source: str = "") -> RegisteredLaw:
    """Return the entry of a law of a user by its name in a file; the message names the file or module of its class.

    Raises
    ------
    KeyError
        If no class is registered under the name.
    """
    entries = {entry.name: entry for entry in _BY_CLASS.values()}
    if name not in entries:
        origin = f" ({source[:100]})" if source else ""
        raise KeyError(
            f"the law '{name[:40]}'{origin} is not registered: import the module that defines it and registers it by "
            f"@hb.mechanics.register_law{did_you_mean(name, entries)}"
        )
    return entries[name]


register_law(name="cubic")(Cubic)
register_law(name="piecewise")(PiecewiseLinear)
register_law(name="parallel")(Parallel)
register_law(name="compiled")(CompiledLaw)
register_law(name="tooth contact")(ToothContact)
register_law(name="mesh contacts")(MeshContacts)
register_law(name="jenkins")(Jenkins)
register_law(name="contact friction")(ContactFriction)
register_law(name="iwan")(Iwan)
register_law(name="rigid friction")(RigidFriction)
register_law(name="hunt-crossley")(HuntCrossley)
register_law(name="kelvin-voigt")(KelvinVoigt)
register_law(name="clipped kelvin-voigt")(ClippedKelvinVoigt)
register_law(name="component")(Component)
register_law(name="radial clearance")(RadialClearance)
register_law(name="polynomial")(Polynomial)
register_law(name="directed")(Directed)
register_law(name="sliding teeth")(SlidingTeeth)
register_law(name="coulomb")(Coulomb)
register_law(name="backlash", required=("k", "b"))(Backlash)
register_law(name="unilateral", required=("k", "gap"))(Unilateral)

_DAMPED = KelvinVoigt, ClippedKelvinVoigt
_LATER = ContactFriction, RigidFriction, *_DAMPED, Component, RadialClearance, Polynomial, Directed, SlidingTeeth

BUILT_IN: Mapping[str, type[Law]] = {
    cls.__name__: cls
    for cls in (Cubic, PiecewiseLinear, Parallel, ToothContact, MeshContacts, Jenkins, Iwan, HuntCrossley, *_LATER)
}
"""Classes of hbgear that a file can hold, by name. Headers name them as parts of a model, as earlier versions did."""
