"""Folds of response curves, followed in a design parameter: what jump maps and critical values have in common."""

from __future__ import annotations

import numpy as np

from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model


def report_progress(progress: ProgressCallback | None, text: str) -> None:
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
    problem.require_fixed_resolution("following folds")
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
    return raise_if_interrupted(
        trace(problem, "Omega", span, at={parameter: value}, stability=False, cover=False, accuracy=None)
    )


def on_fold_curve(problem: HarmonicBalance, fold: Branch, point: Point, parameter: str) -> bool:
    """Whether a fold lies on a fold curve already traced: solve for the curve's fold at the same value and compare."""
    value = point.parameters[parameter]
    for place in crossings_at(fold, value):
        Omega = float(place.interpolate(fold.tracked["Omega"]))
        if abs(Omega - point.parameters["Omega"]) > 0.05 * Omega:
            continue
        U = np.append(place.interpolate(fold.X), Omega)
        try:
            there = solve(FoldProblem(problem), U, {**fold.parameters_at(place.index), parameter: value}).X
        except NoConvergence:
            continue
        if abs(there[-1] - point.parameters["Omega"]) < 1e-6 * Omega:
            return True
    return False
