"""The models the command line knows by name, and models from the headers of saved files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hbgear.common.process.signals import defer_signals
from hbgear.common.text.messages import did_you_mean
from hbgear.gears import (
    Beam,
    Bearing,
    DoubleHelicalPair,
    Gear,
    GearPair,
    GearRotorBearing,
    HelicalPair,
    Housing,
    Mesh,
    PlanetarySet,
    Shaft,
    SpurPair,
    Support,
    Train,
    Wheel,
)
from hbgear.harmonic.equations.harmonic_selection import HIGHEST, HarmonicSelection
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.fields import check_names, made, plain_kinds_of
from hbgear.mechanics.model_lookup import find_model_class, installed
from hbgear.mechanics.models import Element, Load, Model, System
from hbgear.mechanics.oscillators import Duffing
from hbgear.mechanics.serialization import from_plain
from hbgear.mechanics.structures.receptances import Receptances
from hbgear.mechanics.structures.speed_terms import MatrixTable, SpeedTerms

MODELS: dict[str, type[Model]] = {
    "duffing": Duffing,
    "spur-pair": SpurPair,
    "gear-rotor-bearing": GearRotorBearing,
    "helical-pair": HelicalPair,
    "double-helical": DoubleHelicalPair,
    "planetary": PlanetarySet,
}

_MADE: dict[str, type[Model]] = {
    **{each.__name__: each for each in MODELS.values()}, "Train": Train, "System": System
}  # fmt: skip
"""Classes that a file may be of without being named again."""

_PARTS: dict[str, type] = {
    each.__name__: each
    for each in (
        Gear, GearPair, Support, Wheel, Shaft, Bearing, Mesh, Beam, Housing, Element, Load, SpeedTerms, MatrixTable,
        Receptances,
    )
}  # fmt: skip
"""What such models consist of."""


def model_class(name: str) -> type[Model]:
    """The class of models of that name: of the catalogue, of an installed package, FILE.py:NAME or MODULE:NAME.

    The code of the last three is run; see `hbgear.mechanics.model_lookup`.

    Raises
    ------
    KeyError, ValueError
        If there is no such model, or its code cannot be loaded.

    Examples
    --------
    >>> class_of("duffing")
    <class 'hbgear.mechanics.oscillators.Duffing'>
    """
    if name in MODELS:
        return MODELS[name]
    if ":" in name:
        return find_model_class(name)
    known = [*MODELS, *installed()]
    if name not in known:
        raise KeyError(f"there is no model '{name}'{did_you_mean(name, known)}")
    return find_model_class(name)


def build(name: str, /, **fields: Any) -> Model:
    """The model of that name, as of `model_class`, with its defaults except for the given fields.

    Raises
    ------
    KeyError
        If there is no such model, or it has no such field.
    ValueError
        If a value is out of its range, or one without a default is missing.
    """
    return made(model_class(name), fields)


def rebuild_model(meta: Any, cls: type[Model] | None = None) -> Model:
    """The model that `hbgear.mechanics.models.describe` was given; lists become tuples.

    No code is loaded for it: a class that is not in the catalogue must be given.

    Raises
    ------
    KeyError
        If the class is not in the catalogue and none is given, or has no such field.
    ValueError
        If ``meta`` is not of the form `describe` returns, is of another class than the one given, or a value is of
        another type, out of its range or missing, as functions and laws of a user are.
    """
    if not is_description(meta):
        raise ValueError(f"a model is described by {{'class': name, 'fields': {{...}}}}, got {str(meta)[:80]}")
    if cls is not None:
        if meta["class"] != cls.__name__:
            raise ValueError(f"it is of a {meta['class']}; the model given is {cls.__name__}")
    elif meta["class"] not in _MADE:
        raise KeyError(f"the catalogue has no class '{meta['class']}'{_advice(meta)}")
    cls = cls or _MADE[meta["class"]]
    if meta.get("left_out") and cls in _MADE.values():
        reasons = meta.get("reasons")
        why = f" ({'; '.join(map(str, reasons.values()))[:300]})" if isinstance(reasons, Mapping) else ""
        raise ValueError(
            f"the file of this {cls.__name__} does not hold its {str(meta['left_out'])[:80]}{why}: load it with "
            "problem=..."
        )
    fields = {name: from_plain(value, _PARTS) for name, value in meta["fields"].items()}
    _check_types(cls, fields)
    return made(cls, fields)


def _advice(meta: Mapping[str, Any]) -> str:
    """How to go on with a file of a class that is not in the catalogue."""
    if not isinstance(meta.get("from"), str):
        return did_you_mean(meta["class"], _MADE)
    return f"; it was in {meta['from'][:100]}: name it again if you trust it, by --model FILE.py:NAME or problem=..."


def is_description(meta: Any) -> bool:
    """Whether this is of the form that `hbgear.mechanics.models.describe` returns."""
    whole = isinstance(meta, Mapping) and isinstance(meta.get("class"), str) and isinstance(meta.get("fields"), Mapping)
    return whole and all(isinstance(name, str) for name in meta["fields"])


@defer_signals()  # pydantic panics if Ctrl-C comes while it prepares a check
def _check_types(cls: type[Model], fields: Mapping[str, Any]) -> None:
    """Refuse values that are not of the types of their fields; the model itself refuses unknown fields."""
    import pydantic

    check_names(cls, fields)
    hints = plain_kinds_of(cls)
    for name in fields.keys() & hints.keys():
        try:
            pydantic.TypeAdapter(hints[name]).validate_python(fields[name], strict=True)
        except pydantic.ValidationError as error:
            reason = error.errors()[0]["msg"]
            raise ValueError(f"{cls.__name__}: {name} = {str(fields[name])[:40]}: {reason}") from None


def rebuild_problem(meta: Mapping[str, Any], cls: type[Model] | None = None) -> HarmonicBalance:
    """Return the harmonic balance of a branch from the header of its file (``Branch.meta``); see `rebuild_model`.

    Raises
    ------
    KeyError, ValueError
        If the model is not in the catalogue (one of your own: load with ``problem=`` instead) or the header is of
        another kind.
    """
    if "model" not in meta or "balance" not in meta:
        raise ValueError("the file does not say which model and balance it was traced with; load it with problem=...")
    settings = _settings(meta["balance"])
    auto = settings.pop("auto")
    if settings["orders"] is not None:
        settings["orders"] = HarmonicSelection(**{name: tuple(some) for name, some in settings["orders"].items()})
    out = HarmonicBalance(rebuild_model(meta["model"], cls), **settings)
    return out if auto is None else out.with_tolerance(auto)


_MOST_SAMPLES = 2**22  # no trace that anybody waited for had more


def _settings(balance: Any) -> dict[str, Any]:
    """Settings of `HarmonicBalance` as `HarmonicBalance.describe` gives them, "auto" among them."""
    kinds = {"harmonics": (int, str), "samples": (int, type(None)), "nu": (int,), "sampled": (bool,)}
    if not isinstance(balance, Mapping) or any(
        name not in balance or type(balance[name]) not in kind for name, kind in kinds.items()
    ):
        raise ValueError(f"the balance is described by {', '.join(kinds)} and auto, got {str(balance)[:80]}")
    auto, samples, harmonics = balance.get("auto"), balance["samples"], balance["harmonics"]
    if isinstance(harmonics, str) and harmonics != "auto":
        raise ValueError(f"harmonics are a whole number or 'auto', got {harmonics[:40]!r}")
    if (samples or 0) > _MOST_SAMPLES or not (auto is None or (type(auto) is float and auto > 0)):
        raise ValueError(f"no balance has {samples} samples and the tolerance {str(auto)[:40]}")
    orders = balance.get("orders")
    if not (orders is None or _are_orders(orders)):
        raise ValueError(
            f"the orders of a balance are 'tones' or 'given', whole numbers from 1, got {str(orders)[:80]}"
        )
    return {**{name: balance[name] for name in kinds}, "auto": auto, "orders": orders}


def _are_orders(orders: Any) -> bool:
    """Whether this is of the form of `Selection.described`."""
    if not isinstance(orders, Mapping) or set(orders) not in ({"tones"}, {"given"}, {"given", "more"}):
        return False
    return all(
        isinstance(some, list) and 1 <= len(some) <= HIGHEST and all(type(k) is int and 1 <= k <= HIGHEST for k in some)
        for some in orders.values()
    )
