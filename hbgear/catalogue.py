"""The models the command line knows by name, and models from the headers of saved files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hbgear.balance import HarmonicBalance
from hbgear.gears import DoubleHelicalPair, GearRotorBearing, SpurPair
from hbgear.model import Model, did_you_mean
from hbgear.oscillators import Duffing

MODELS: dict[str, type[Model]] = {
    "duffing": Duffing,
    "spur-pair": SpurPair,
    "gear-rotor-bearing": GearRotorBearing,
    "double-helical": DoubleHelicalPair,
}


def build(name: str, /, **fields: Any) -> Model:
    """The model of that name, with its defaults except for the given fields.

    Raises
    ------
    KeyError
        If there is no such model, or it has no such field.
    ValueError
        If a value is out of its range.
    """
    if name not in MODELS:
        raise KeyError(f"there is no model '{name}'{did_you_mean(name, MODELS)}")
    return MODELS[name]().replace(**fields)


def rebuild(meta: Mapping[str, Any]) -> Model:
    """The model that `hbgear.model.describe` was given; lists become tuples.

    Raises
    ------
    KeyError
        If the class is not in the catalogue or has no such field.
    ValueError
        If ``meta`` is not of the form `describe` returns, or a value is out of its range.
    """
    if not isinstance(meta.get("class"), str) or not isinstance(meta.get("fields"), Mapping):
        raise ValueError(f"a model is described by {{'class': name, 'fields': {{...}}}}, got {dict(meta)}")
    classes = {cls.__name__: cls for cls in MODELS.values()}
    if meta["class"] not in classes:
        raise KeyError(f"the catalogue has no class '{meta['class']}'{did_you_mean(meta['class'], classes)}")
    fields = {name: tuple(v) if isinstance(v, list) else v for name, v in meta["fields"].items()}
    return classes[meta["class"]]().replace(**fields)


def problem_of(meta: Mapping[str, Any]) -> HarmonicBalance:
    """The harmonic balance a branch was traced with, from the header of its file (``Branch.meta``).

    Raises
    ------
    KeyError, ValueError
        If the model is not in the catalogue (a `System` of your own: load with ``problem=`` instead) or the header is
        of another kind.
    """
    if "model" not in meta or "balance" not in meta:
        raise ValueError("the file does not say which model and balance it was traced with; load it with problem=...")
    settings = dict(meta["balance"])
    auto = settings.pop("auto", None)
    out = HarmonicBalance(rebuild(meta["model"]), **settings)
    return out if auto is None else out.with_tolerance(auto)
