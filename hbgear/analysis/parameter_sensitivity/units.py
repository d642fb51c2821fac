"""Units of frequency and length of a model and their derivatives in parameters, and derivatives of amplitudes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.special_point_problem import SpecialPointProblem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.layout import LayoutProtocol
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import scales
from hbgear.mechanics.models import Model

LENGTH = "m"
"""Unit of amplitudes of models with `Scales`."""

Units = tuple[dict[str, float], dict[str, Array]]
"""Units by name, and their derivatives in the parameters."""


def base_problem(problem: ContinuationProblem) -> ContinuationProblem:
    """Return the problem of periodic motions inside augmented equations."""
    return base_problem(problem.problem) if isinstance(problem, SpecialPointProblem) else problem


def units_at(problem: ContinuationProblem, parameters: Mapping[str, float], names: Sequence[str]) -> Units:
    """Return the units of a model and their derivatives (A,) in parameters, by name.

    They are "mesh Hz" and "pinion r/min" at Omega = 1, and "m", the unit of length; empty if the model has no `Scales`.
    """
    inner = base_problem(problem)
    if not isinstance(inner, HarmonicBalance) or not (units := units_of(inner.model_at(parameters))):
        return {}, {}
    keys, model_names = list(units), inner.model.parameters | inner.model.entries
    changes = np.zeros((len(names), len(keys)))
    for row, name in zip(changes, names, strict=True):

        def values(changed: dict[str, float], name: str = name) -> tuple[float, ...]:
            return tuple(units_of(inner.model_at({**parameters, name: changed[name]})).values())

        if name in model_names:
            row[:] = parameter_derivatives(problem, name, parameters, values)
    return units, dict(zip(keys, changes.T, strict=True))


def units_of(model: Model) -> dict[str, float]:
    """Return Hz and r/min at Omega = 1 and the unit of length in metres; empty if the model has no `Scales`."""
    units, model_scales = scales(model, {}), model.scales
    return units | {LENGTH: model_scales.length} if units and model_scales else units


def measured_along(layout: LayoutProtocol, measure: str, element: int | str, X: Array, along: Array) -> Array:
    """Return the derivatives (P, A) of an amplitude of motions X (P, n) along directions (P, A, n).

    They are central differences, and nan for directions that are not finite.
    """
    sizes = np.linalg.norm(along, axis=-1)
    finite = np.isfinite(sizes)
    h = 1e-5 * np.maximum(np.linalg.norm(X, axis=-1), 1e-3)[:, None] / np.where(finite & (sizes > 0), sizes, 1.0)
    steps = h[..., None] * np.where(finite[..., None], along, 0.0)
    upper, lower = (layout.measure(measure, X[:, None] + side * steps, element) for side in (1, -1))
    return np.where(finite, upper - lower, math.nan) / (2 * h)
