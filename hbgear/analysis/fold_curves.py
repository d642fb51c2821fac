"""Folds of response curves in a design parameter: common functions of jump maps and critical parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.augmented.special_point_problem import SpecialPointProblem
from hbgear.continuation.events.fold import FoldEvent, equations_of_fold
from hbgear.continuation.events.residual_form import in_residual_form
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model


def report_progress(progress: ProgressCallback | None, text: str) -> None:
    """Report a line of text as progress, if a function for it is given."""
    if progress:
        progress(Progress(text=text))


def problem_of(model: Model | HarmonicBalance, harmonics: int) -> HarmonicBalance:
    """Return the harmonic balance of a model; a given `HarmonicBalance` is returned as it is."""
    counted("harmonics", harmonics)
    return model if isinstance(model, HarmonicBalance) else HarmonicBalance(model, harmonics)


def check_parameter(problem: HarmonicBalance, parameter: str) -> None:
    """Raise an error if folds cannot be followed in a parameter, or the number of harmonics varies.

    It is a KeyError if the model has no such parameter, a ValueError for Omega, or ``harmonics="auto"``.
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
    """Trace the response curves at a value of a parameter that cover a range of Omega, without stability.

    Without ``frequencies`` it is the range of the model. `Branch.others` are the curves of the rest of the range.
    """
    span = problem.model.default_span if frequencies is None else frequencies
    return raise_if_interrupted(trace(problem, "Omega", span, at={parameter: value}, stability=False, accuracy=None))


def folds_of(curve: Branch) -> list[Point]:
    """Return the located folds of a response curve and of the other curves of its range."""
    return [point for branch in curve.curves for point in branch.special if point.kind == "LP" and point.located]


def fold_equations(problem: HarmonicBalance, point: Point) -> tuple[Any, Point]:
    """Return the equations of a fold of a response curve, and the fold in their unknowns.

    They are those of `FoldEvent`; for exact motions `ContinuationProblem.special_point_equations`. The fold belongs to
    another problem if the curve was traced in contact instants. NoConvergence is raised if the contacts of the fold are
    too short for harmonics.
    """
    source = problem if point.problem is None else as_problem(point.problem)
    exact_equations = source.special_point_equations("Omega", point)
    if exact_equations is not None:
        return exact_equations, point
    residual_form, start = in_residual_form(source, point, "Omega", FoldEvent())
    return FoldEvent().equations(problem if residual_form is source else residual_form, "Omega", start), start


def equations_of_curve(problem: HarmonicBalance, fold: Branch) -> Any:
    """Return the equations of a fold curve, whose number of harmonics may be larger than that of the problem."""
    if isinstance(fold.problem, SpecialPointProblem):
        return fold.problem
    parameters = {**fold.parameters_at(0), "Omega": fold.tracked["Omega"][0]}
    return equations_of_fold(problem, "Omega", problem.resized(fold.X[0]), parameters)


def on_fold_curve(problem: HarmonicBalance, fold: Branch, point: Point, parameter: str) -> bool:
    """Return whether a fold lies on a fold curve: the fold of the curve at the same value has the same frequency.

    The fold curve has Omega in ``tracked``; frequencies agree to `SAME_FOLD_TOLERANCE`.
    """
    value = point.parameters[parameter]
    for crossing in crossings_at(fold, value):
        Omega = float(crossing.interpolate(fold.tracked["Omega"]))
        if abs(Omega - point.parameters["Omega"]) > MAX_FOLD_DISTANCE * Omega:
            continue
        U = np.append(crossing.interpolate(fold.X), Omega)
        try:
            solved = solve(
                equations_of_curve(problem, fold), U, {**fold.parameters_at(crossing.index), parameter: value}
            ).X
        except NoConvergence:
            continue
        if abs(solved[-1] - point.parameters["Omega"]) < SAME_FOLD_TOLERANCE * Omega:
            return True
    return False


MAX_FOLD_DISTANCE = 0.05
"""Difference of two frequencies, relative, above which folds are different without solving for them."""

SAME_FOLD_TOLERANCE = 1e-6
"""Difference of the frequencies of two folds, relative, below which they are the same."""
