"""Folds of response curves, followed in a design parameter: what jump maps and critical values have in common."""

from __future__ import annotations

import numpy as np

from hbgear.common.progress import Progress, ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.bordered import Fold
from hbgear.continuation.branch import Branch, Point
from hbgear.continuation.ending import whole
from hbgear.continuation.newton import NoConvergence, solve
from hbgear.continuation.passing import passings
from hbgear.continuation.tracer import trace
from hbgear.harmonic.balance import HarmonicBalance
from hbgear.mechanics.model import Model


def say(progress: ProgressCallback | None, text: str) -> None:
    """Pass a line of progress on."""
    if progress:
        progress(Progress(text=text))


def problem_of(model: Model | HarmonicBalance, harmonics: int) -> HarmonicBalance:
    """The harmonic balance of a model; one that is given as it is."""
    counted("harmonics", harmonics)
    return model if isinstance(model, HarmonicBalance) else HarmonicBalance(model, harmonics)


def check_parameter(problem: HarmonicBalance, parameter: str) -> None:
    """Refuse a parameter in which folds cannot be followed, and a number of harmonics that varies.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If it is Omega, or ``harmonics="auto"``.
    """
    problem.check_fixed("following folds")
    problem.check_parameter(parameter)
    if parameter == "Omega":
        raise ValueError(
            "the design parameter must differ from Omega, which is the frequency of the jumps; choose one of: "
            + ", ".join(problem.parameters)
        )


def response_curve(
    problem: HarmonicBalance, parameter: str, value: float, frequencies: tuple[float, float] | None
) -> Branch:
    """Response curve at a value of a parameter, over a range of Omega or the model's own, without stability."""
    span = problem.model.default_span if frequencies is None else frequencies
    return whole(trace(problem, "Omega", span, at={parameter: value}, stability=False, cover=False, accuracy=None))


def on_fold_curve(problem: HarmonicBalance, fold: Branch, point: Point, parameter: str) -> bool:
    """Whether a fold lies on a fold curve already traced: solve for the curve's fold at the same value and compare."""
    value = point.parameters[parameter]
    for place in passings(fold, value):
        Omega = float(place.between(fold.tracked["Omega"]))
        if abs(Omega - point.parameters["Omega"]) > 0.05 * Omega:
            continue
        U = np.append(place.between(fold.X), Omega)
        try:
            there = solve(Fold(problem), U, {**fold.parameters_at(place.index), parameter: value}).X
        except NoConvergence:
            continue
        if abs(there[-1] - point.parameters["Omega"]) < 1e-6 * Omega:
            return True
    return False
