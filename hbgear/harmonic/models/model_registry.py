"""Registry of models: models by name for the command line, and models and problems from headers of saved files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hbgear.common.process.signals import defer_signals
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.gears import (
    Beam,
    Bearing,
    BenedictKelley,
    DoubleHelicalPair,
    DrawnPair,
    EpicyclicSet,
    Gear,
    GearPair,
    GearRotorBearing,
    HelicalPair,
    Housing,
    Mesh,
    MeshCycle,
    MeshTable,
    PlanetarySet,
    Shaft,
    SpurPair,
    Support,
    Train,
    Wheel,
)
from hbgear.harmonic.autonomous.backbone import BackboneProblem
from hbgear.harmonic.autonomous.limit_cycle import LimitCycleProblem
from hbgear.harmonic.autonomous.tori.basis import TorusBasis
from hbgear.harmonic.autonomous.tori.problem import TorusProblem
from hbgear.harmonic.autonomous.tori.two_tones import TwoToneProblem
from hbgear.harmonic.autonomous.unforced import unforced_balance
from hbgear.harmonic.contact_instants.problem import CONTACT_INSTANTS, ContactInstants
from hbgear.harmonic.equations.harmonic_selection import HIGHEST, HarmonicSelection
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.fields import check_names, made, plain_kinds_of
from hbgear.mechanics.function_model import SystemOfLaws
from hbgear.mechanics.laws.mesh_contacts import ToothSliding
from hbgear.mechanics.model_lookup import find_model_class, installed
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.oscillators import Duffing
from hbgear.mechanics.serialization import from_plain
from hbgear.mechanics.structures.elements import Element, Load
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
"""Classes of the built-in models by their name on the command line."""

_MODEL_CLASSES: dict[str, type[Model]] = {
    **{cls.__name__: cls for cls in MODELS.values()},
    "Train": Train,
    "System": System,
    "DrawnPair": DrawnPair,
    "EpicyclicSet": EpicyclicSet,
    "SystemOfLaws": SystemOfLaws,
}
"""Classes of hbgear by name, which a file can be loaded with without naming its model."""

_PART_CLASSES: dict[str, type] = {
    cls.__name__: cls
    for cls in (
        Gear,
        GearPair,
        Support,
        Wheel,
        Shaft,
        Bearing,
        Mesh,
        Beam,
        Housing,
        MeshCycle,
        MeshTable,
        Element,
        Load,
        SpeedTerms,
        MatrixTable,
        Receptances,
        BenedictKelley,
        ToothSliding,
    )
}
"""Classes of the parts of these models by name."""


def model_class(name: str) -> type[Model]:
    """Return the class of a model: built-in, from an installed package, FILE.py:NAME or MODULE:NAME.

    Code of packages, files and modules is executed, see `hbgear.mechanics.model_lookup`. KeyError or ValueError is
    raised if there is no model of this name, or its code cannot be loaded.

    Examples
    --------
    >>> model_class("duffing")
    <class 'hbgear.mechanics.oscillators.Duffing'>
    """
    if name in MODELS:
        return MODELS[name]
    if ":" in name:
        return find_model_class(name)
    names = [*MODELS, *installed()]
    if name not in names:
        if name.endswith(".npz"):
            raise KeyError(f"'{name}' is the name of a saved curve; give a model, FILE.toml or FILE.py:NAME")
        if name.endswith(".py"):
            raise KeyError(f"'{name}' is a file of Python: give a model in it, as {name}:NAME")
        if name.endswith((".mat", ".mtx", ".npy", ".csv")):
            raise KeyError(f"'{name}' is a file of matrices or numbers: give FILE.toml, whose [matrices] name it")
        hint = did_you_mean(name, names, "there are")
        files = "" if "did you mean" in hint else "; give one of them, FILE.toml or FILE.py:NAME"
        raise KeyError(f"there is no model '{name}'{hint}{files}")
    return find_model_class(name)


def build(name: str, /, **fields: Any) -> Model:
    """Return a model by its name, see `model_class`, with defaults for all fields that are not given.

    KeyError is raised if there is no model of this name, or it has no field of a given name; ValueError if a value is
    out of its range, or a field without default is missing.
    """
    return made(model_class(name), fields)


def rebuild_model(meta: Any, cls: type[Model] | None = None) -> Model:
    """Return the model from its description by `hbgear.mechanics.models.describe`; lists become tuples.

    No code is loaded: a class that is not part of hbgear must be given. KeyError is raised if it is not given, or does
    not have a field of the description; ValueError if ``meta`` does not have the form of `describe`, names another
    class than ``cls``, or a value has another type, is out of its range, or is missing, like functions and laws of a
    user.
    """
    if not is_description(meta):
        raise ValueError(f"a model is described by {{'class': name, 'fields': {{...}}}}, got {str(meta)[:80]}")
    if cls is not None:
        if meta["class"] != cls.__name__:
            raise ValueError(f"the file is of model {meta['class']}; the given model is {cls.__name__}")
    elif meta["class"] not in _MODEL_CLASSES:
        raise KeyError(f"hbgear has no model class '{meta['class']}'{_advice(meta)}")
    cls = cls or _MODEL_CLASSES[meta["class"]]
    if meta.get("left_out") and cls in _MODEL_CLASSES.values():
        reasons = meta.get("reasons")
        details = f" ({'; '.join(map(str, reasons.values()))[:300]})" if isinstance(reasons, Mapping) else ""
        raise ValueError(
            f"the file of this {cls.__name__} does not hold its {str(meta['left_out'])[:80]}{details}: load it with "
            "problem=..."
        )
    fields = fields_from_plain(meta["fields"])
    _check_types(cls, fields)
    return made(cls, fields)


def fields_from_plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of fields from plain data: tuples in place of lists, and laws, functions and parts."""
    return {name: from_plain(value, _PART_CLASSES) for name, value in values.items()}


def _advice(meta: Mapping[str, Any]) -> str:
    """Return advice for a file of a class that is not part of hbgear."""
    if not isinstance(meta.get("from"), str):
        return did_you_mean(meta["class"], _MODEL_CLASSES)
    return f"; it was in {meta['from'][:100]}: name it again if you trust it, by --model FILE.py:NAME or problem=..."


def is_description(meta: Any) -> bool:
    """Return whether a value has the form that `hbgear.mechanics.models.describe` returns."""
    complete = (
        isinstance(meta, Mapping) and isinstance(meta.get("class"), str) and isinstance(meta.get("fields"), Mapping)
    )
    return complete and all(isinstance(name, str) for name in meta["fields"])


@defer_signals()  # pydantic panics if Ctrl-C comes while it prepares a check
def _check_types(cls: type[Model], fields: Mapping[str, Any]) -> None:
    """Raise an error for unknown fields, and for values that do not have the types of their fields."""
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

    Branches of tori have a `TorusProblem` or `TwoToneProblem`.

    Raises
    ------
    KeyError, ValueError
        If the model is not part of hbgear (load with ``problem=`` instead), or the header has another form.
    """
    model, settings = _model_and_settings(meta, cls)
    if meta.get("discretisation") == CONTACT_INSTANTS:
        return ContactInstants(model, int(settings["harmonics"]), int(settings["nu"]))
    auto = settings.pop("auto")
    if settings["orders"] is not None:
        settings["orders"] = HarmonicSelection(**{name: tuple(numbers) for name, numbers in settings["orders"].items()})
    if "torus" in meta:
        return _torus_problem(meta["torus"], model, settings)  # type: ignore[return-value]
    out = HarmonicBalance(model, **settings)
    return out if auto is None else out.with_tolerance(auto)


def rebuild_traced_problem(meta: Mapping[str, Any], cls: type[Model] | None = None) -> ContinuationProblem:
    """Return the problem of the motions of a branch from the header of its file; see `rebuild_problem`.

    Backbones have a `BackboneProblem`, limit cycles a `LimitCycleProblem`, and other motions the problem of
    `rebuild_problem`. Curves of special points have the problem of the motions.

    Raises
    ------
    KeyError, ValueError
        As of `rebuild_problem`.
    """
    outer = meta.get("curve")
    curve = outer.get("on", outer) if isinstance(outer, Mapping) else {}
    kind = curve.get("of") if isinstance(curve, Mapping) else None
    if kind not in (BackboneProblem.__name__, LimitCycleProblem.__name__):
        return rebuild_problem(meta, cls)
    model, settings = _model_and_settings(meta, cls)
    if kind == LimitCycleProblem.__name__:
        return LimitCycleProblem(unforced_balance(model, settings["harmonics"], reduce=True))
    return BackboneProblem(model, curve.get("mode", 1), settings["harmonics"])


def _model_and_settings(meta: Mapping[str, Any], cls: type[Model] | None) -> tuple[Model, dict[str, Any]]:
    """Return the model of a header and the settings of its balance; raise an error if they are missing or invalid."""
    if "model" not in meta or "balance" not in meta:
        raise ValueError("the header of the file has no model and balance; load the file with problem=...")
    settings = _settings(meta["balance"])
    return rebuild_model(meta["model"], cls), settings


def _torus_problem(torus: Any, model: Model, settings: dict[str, Any]) -> TorusProblem:
    """Return the problem of tori from its description; raise ValueError if it is invalid."""
    keys = {"odd", "dense", "harmonics"}
    valid = isinstance(torus, Mapping) and set(torus) in (keys, keys | {"ratio", "load", "elements", "band", "half"})
    if not valid or not (type(torus["odd"]) is bool and type(torus["dense"]) is int and 1 <= torus["dense"] <= 100):
        raise ValueError(f"tori are described by {', '.join(sorted(keys))}, got {str(torus)[:80]}")
    H = torus["harmonics"]
    if not (isinstance(H, list) and len(H) == 2 and all(type(count) is int and 1 <= count <= 200 for count in H)):
        raise ValueError(f"the harmonics of tori are two whole numbers, got {str(H)[:40]}")
    if "ratio" not in torus:
        return TorusProblem(
            HarmonicBalance(model, **settings), TorusBasis(H[0], H[1], odd=torus["odd"], dense=torus["dense"])
        )
    load = from_plain(torus["load"], _PART_CLASSES)
    half = None if torus["half"] is None else tuple(torus["half"])
    return TwoToneProblem(model, torus["ratio"], load, torus["elements"], tuple(H), torus["dense"], torus["band"], half)


_MAX_FILE_SAMPLES = 2**22
"""Largest number of samples accepted from a file. No practical trace has more, so the header is invalid."""


def _settings(balance: Any) -> dict[str, Any]:
    """Return the settings of a `HarmonicBalance` from its description, including "auto"; raise an error if invalid."""
    kinds = {"harmonics": (int, str), "samples": (int, type(None)), "nu": (int,), "sampled": (bool,)}
    if not isinstance(balance, Mapping) or any(
        name not in balance or type(balance[name]) not in kind for name, kind in kinds.items()
    ):
        raise ValueError(f"the balance is described by {', '.join(kinds)} and auto, got {str(balance)[:80]}")
    auto, samples, harmonics = balance.get("auto"), balance["samples"], balance["harmonics"]
    if isinstance(harmonics, str) and harmonics != "auto":
        raise ValueError(f"harmonics are a whole number or 'auto', got {harmonics[:40]!r}")
    if (samples or 0) > _MAX_FILE_SAMPLES or not (auto is None or (type(auto) is float and auto > 0)):
        raise ValueError(f"samples = {samples} and tolerance = {str(auto)[:40]} of the balance are out of range")
    orders = balance.get("orders")
    if not (orders is None or _are_orders(orders)):
        raise ValueError(
            f"the orders of a balance are 'tones' or 'given', whole numbers from 1, got {str(orders)[:80]}"
        )
    return {**{name: balance[name] for name in kinds}, "auto": auto, "orders": orders}


def _are_orders(orders: Any) -> bool:
    """Return whether a value has the form of `HarmonicSelection.described`."""
    if not isinstance(orders, Mapping) or set(orders) not in ({"tones"}, {"given"}, {"given", "more"}):
        return False
    return all(
        isinstance(row, list) and 1 <= len(row) <= HIGHEST and all(type(k) is int and 1 <= k <= HIGHEST for k in row)
        for row in orders.values()
    )
