"""Frequencies and lengths in physical units: mesh frequency, shaft speed and amplitudes of models with scales.

    f_mesh = Omega model.mesh_frequency(1) [Hz],   n = Omega model.pinion_speed(1) [r/min],   x = length xbar [m]

A model provides them by `Model.scales`, or by methods ``mesh_frequency`` and ``pinion_speed`` that are proportional to
Omega.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hbgear.common.units import decimal_mark, to_si
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.models import model_registry
from hbgear.mechanics.models import Model
from hbgear.mechanics.structures.scales import Scales

MESH, PINION = "mesh Hz", "pinion r/min"
"""Keys of the mesh frequency [Hz] and the pinion speed [r/min]."""

_MAX_SPEED = 1e6
"""Largest speed of a pinion [r/min]; micro-turbines reach 5e5. A larger Omega was meant as a speed."""


def model_of(branch: Branch) -> Model | None:
    """Return the model of a branch, from its problem or from its file header; None if it is unknown."""
    model = getattr(branch.problem, "model", None)
    if model is not None:
        return model
    try:
        return model_registry.rebuild_model(branch.meta.get("model", {}))
    except (KeyError, TypeError, ValueError):
        return None


def scales(model: Model | None, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return Hz and r/min at Omega = 1 with these parameters; an empty dict if the model has no physical scales."""
    physical = scales_with(model, parameters)
    if physical is None:
        return {}
    return {MESH: float(physical.mesh_frequency(1.0)), PINION: float(physical.pinion_speed(1.0))}


def length_scale(model: Model | None, parameters: Mapping[str, float]) -> float | None:
    """Return the unit of element coordinates [m] with these parameters; None if the model has no scales."""
    physical = scales_with(model, parameters)
    return None if physical is None else physical.length


def scales_at(branch: Branch, row: int) -> Scales | None:
    """Return the scales of the model at a point of a branch; None if it has none."""
    return scales_with(model_of(branch), branch.parameters_at(row))


def scales_with(model: Model | None, parameters: Mapping[str, float]) -> Scales | None:
    """Return the scales of a model with these parameters; None if it has none."""
    physical: Scales | None = getattr(model, "scales", None)  # a problem of the user may have a model of another kind
    return physical if model is None or physical is None or not parameters else model.at(parameters).scales


def speeds_at(model: Model | None, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return mesh frequency [Hz] and pinion speed [r/min] at the parameter Omega; an empty dict if unknown."""
    if "Omega" not in parameters:
        return {}
    return {name: parameters["Omega"] * scale for name, scale in scales(model, parameters).items()}


def common_scales(branches: Sequence[Branch]) -> dict[str, float]:
    """Return the `scales` of all points of all branches; an empty dict if they differ, or for other parameters."""
    scale_sets = []
    for branch in branches:
        if branch.parameter != "Omega" or not len(branch):
            return {}
        model = model_of(branch)
        points = range(len(branch)) if branch.tracked else (0,)
        scale_sets += [scales(model, branch.parameters_at(i)) for i in points]
    return same_scales(scale_sets)


def same_scales(scale_sets: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the first of these `scales` if all are equal, else an empty dict."""
    first = scale_sets[0] if scale_sets else {}
    equal = all(
        entry.keys() == first.keys() and np.allclose([*entry.values()], [*first.values()]) for entry in scale_sets
    )
    return first if equal else {}


def Omega_of(model: Model, setting: str, text: str) -> float:
    """Return a frequency as Omega: a number is Omega, r/min is the speed of the pinion, Hz is the mesh frequency.

    ``setting`` is the name of the option, for messages. ValueError is raised if the text is no finite number or
    frequency, the model has no scales, or the speed is beyond that of any machine.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25))
    >>> Omega_of(pair, "span", "0.5"), round(Omega_of(pair, "span", "14515 r/min"), 3)
    (0.5, 1.0)
    """
    try:
        value = float(text)
    except ValueError:
        if any(letter.isalpha() for letter in text):
            return _converted_frequency(model, setting, text)
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{setting}={text}: need a finite number{decimal_mark(text)}")
    speed = speeds_at(model, {"Omega": value}).get(PINION, 0.0)
    if abs(speed) > _MAX_SPEED:
        raise ValueError(
            f"{setting} {text}: Omega = {value:g} is a speed of {speed:.2g} r/min; give a speed with its unit, such as "
            f"{setting} 9000r/min"
        )
    return value


def _converted_frequency(model: Model, setting: str, text: str) -> float:
    """Return a frequency with a unit as Omega."""
    physical = model.scales
    if physical is None:
        if not any(character.isdigit() for character in text):
            raise ValueError(f"{setting} {text}: need a number, such as {setting} 0.9")
        raise ValueError(
            f"{setting} {text}: this model has no scales, so speeds in r/min or Hz are unknown; give Omega, such as 0.9"
        )
    if text.strip().lower().endswith("hz"):
        return float(physical.from_mesh_frequency(to_si(setting, "frequency", text, "Hz")))
    try:
        rate = to_si(setting, "speed", text, "rad/s")
    except ValueError:
        raise ValueError(
            f"{setting} {text}: need a speed with its unit, such as {setting} 9000r/min{decimal_mark(text)}"
        ) from None
    return float(physical.from_pinion_speed(rate * 30 / math.pi))
