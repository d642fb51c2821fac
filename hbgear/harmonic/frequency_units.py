"""Frequencies in physical units: mesh frequency and shaft speed of models that know them.

    f_mesh = Omega model.mesh_frequency(1) [Hz],   n = Omega model.pinion_speed(1) [r/min]

Any model with `Model.scales`, or with methods ``mesh_frequency`` and ``pinion_speed`` of its own, both proportional to
Omega, is understood.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.continuation.results.branch import Branch
from hbgear.harmonic import model_registry
from hbgear.mechanics.models import Model

MESH, PINION = "mesh Hz", "pinion r/min"


def model_of(branch: Branch) -> Model | None:
    """The model a branch was traced with: of its problem, or out of the catalogue after loading; None if unknown."""
    model = getattr(branch.problem, "model", None)
    if model is not None:
        return model  # type: ignore[no-any-return]
    try:
        return model_registry.rebuild_model(branch.meta.get("model", {}))
    except (KeyError, TypeError, ValueError):
        return None


def scales(model: Model | None, parameters: Mapping[str, float]) -> dict[str, float]:
    """Hz and r/min at Omega = 1 with these values of the parameters; nothing if the model does not know its units."""
    known: Any = model
    own = getattr(known, "scales", None)
    if not own and not (hasattr(known, "mesh_frequency") and hasattr(known, "pinion_speed")):
        return {}
    if parameters:
        known = known.at(parameters)
        own = getattr(known, "scales", None)
    known = own or known
    return {MESH: float(known.mesh_frequency(1.0)), PINION: float(known.pinion_speed(1.0))}


def speeds_at(model: Model | None, parameters: Mapping[str, float]) -> dict[str, float]:
    """Mesh frequency [Hz] and speed of the pinion [r/min] at the Omega among the parameters, if both are known."""
    if "Omega" not in parameters:
        return {}
    return {name: parameters["Omega"] * scale for name, scale in scales(model, parameters).items()}


def common_scales(branches: Sequence[Branch]) -> dict[str, float]:
    """`scales` that hold for every row of every branch; nothing if they differ, or the curves are not in Omega."""
    found = []
    for branch in branches:
        if branch.parameter != "Omega" or not len(branch):
            return {}
        model = model_of(branch)
        rows = range(len(branch)) if branch.tracked else (0,)
        found += [scales(model, branch.parameters_at(i)) for i in rows]
    return same_scales(found)


def same_scales(found: Sequence[dict[str, float]]) -> dict[str, float]:
    """The first of these `scales` if all are equal, else nothing."""
    first = found[0] if found else {}
    same = all(one.keys() == first.keys() and np.allclose([*one.values()], [*first.values()]) for one in found)
    return first if same else {}
