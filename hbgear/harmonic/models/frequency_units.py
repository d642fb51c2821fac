"""Frequencies and lengths in physical units: mesh frequency, shaft speed and amplitudes of models with scales.

    f_mesh = Omega model.mesh_frequency(1) [Hz],   n = Omega model.pinion_speed(1) [r/min],   x = length xbar [m]

A model provides them by `Model.scales`, or by methods ``mesh_frequency`` and ``pinion_speed`` that are proportional to
Omega.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.models import model_registry
from hbgear.mechanics.models import Model
from hbgear.mechanics.structures.scales import Scales

MESH, PINION = "mesh Hz", "pinion r/min"
"""Keys of the mesh frequency [Hz] and the pinion speed [r/min]."""


def model_of(branch: Branch) -> Model | None:
    """Return the model of a branch, from its problem or from its file header; None if it is unknown."""
    model = getattr(branch.problem, "model", None)
    if model is not None:
        return model  # type: ignore[no-any-return]
    try:
        return model_registry.rebuild_model(branch.meta.get("model", {}))
    except (KeyError, TypeError, ValueError):
        return None


def scales(model: Model | None, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return Hz and r/min at Omega = 1 with these parameters; an empty dict if the model has no physical scales."""
    known: Any = model
    own = getattr(known, "scales", None)
    if not own and not (hasattr(known, "mesh_frequency") and hasattr(known, "pinion_speed")):
        return {}
    if parameters:
        known = known.at(parameters)
        own = getattr(known, "scales", None)
    known = own or known
    return {MESH: float(known.mesh_frequency(1.0)), PINION: float(known.pinion_speed(1.0))}


def length_scale(model: Model | None, parameters: Mapping[str, float]) -> float | None:
    """Return the unit of element coordinates [m] with these parameters; None if the model has no scales."""
    own = _scales_with(model, parameters)
    return None if own is None else own.length


def scales_at(branch: Branch, row: int) -> Scales | None:
    """Return the scales of the model at a point of a branch; None if it has none."""
    return _scales_with(model_of(branch), branch.parameters_at(row))


def _scales_with(model: Model | None, parameters: Mapping[str, float]) -> Scales | None:
    own = None if model is None else model.scales
    return own if model is None or own is None or not parameters else model.at(parameters).scales


def speeds_at(model: Model | None, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return mesh frequency [Hz] and pinion speed [r/min] at the parameter Omega; an empty dict if unknown."""
    if "Omega" not in parameters:
        return {}
    return {name: parameters["Omega"] * scale for name, scale in scales(model, parameters).items()}


def common_scales(branches: Sequence[Branch]) -> dict[str, float]:
    """Return the `scales` of all points of all branches; an empty dict if they differ, or for other parameters."""
    found = []
    for branch in branches:
        if branch.parameter != "Omega" or not len(branch):
            return {}
        model = model_of(branch)
        points = range(len(branch)) if branch.tracked else (0,)
        found += [scales(model, branch.parameters_at(i)) for i in points]
    return same_scales(found)


def same_scales(found: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the first of these `scales` if all are equal, else an empty dict."""
    first = found[0] if found else {}
    same = all(one.keys() == first.keys() and np.allclose([*one.values()], [*first.values()]) for one in found)
    return first if same else {}
