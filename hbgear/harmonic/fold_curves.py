"""Folds of response curves, followed in a design parameter: what jump maps and critical values have in common."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hbgear.common.ranges import counted
from hbgear.continuation.bordered import Fold
from hbgear.continuation.branch import Branch, Point
from hbgear.continuation.ending import whole
from hbgear.continuation.newton import NoConvergence, solve
from hbgear.continuation.tracer import trace
from hbgear.harmonic.balance import HarmonicBalance
from hbgear.mechanics.model import Model

Report = Callable[[str], None]
"""Called with a line of text as work goes on."""


def say(report: Report | None, text: str) -> None:
    """Pass a line of progress on."""
    if report:
        report(text)


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
    return whole(trace(problem, "Omega", span, at={parameter: value}, stability=False))


def on_fold_curve(problem: HarmonicBalance, fold: Branch, point: Point, parameter: str) -> bool:
    """Whether a fold lies on a fold curve already traced: solve for the curve's fold at the same value and compare."""
    value = point.parameters[parameter]
    x = fold.values - value
    for i in np.flatnonzero(x[:-1] * x[1:] <= 0):
        s = x[i] / (x[i] - x[i + 1]) if x[i] != x[i + 1] else 0.0
        Omega = (1 - s) * fold.tracked["Omega"][i] + s * fold.tracked["Omega"][i + 1]
        if abs(Omega - point.parameters["Omega"]) > 0.05 * Omega:
            continue
        U = np.append((1 - s) * fold.X[i] + s * fold.X[i + 1], Omega)
        try:
            there = solve(Fold(problem), U, {**fold.parameters_at(int(i)), parameter: value}).X
        except NoConvergence:
            continue
        if abs(there[-1] - point.parameters["Omega"]) < 1e-6 * Omega:
            return True
    return False
