"""Critical values: for which design a jump appears or vanishes.

The two folds of a jump meet at a cusp of the fold curve in the design parameter.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.fold_curves import check_parameter, on_fold_curve, problem_of, report_progress, response_curve
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.process.progress import ProgressCallback
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination, raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model

_REACH = 5.0  # how far a fold is followed, in the model's own value of the parameter


_CAREFUL = StepControl(first_step=0.002, max_step=0.02, max_points=300)


_BARREN = 6  # fold curves without a cusp after which the search is given up


class NoFoldError(ValueError):
    """A critical value was asked for, but no jump was found at any value tried.

    Examples
    --------
    >>> import hbgear as hb
    >>> try:
    ...     hb.analysis.critical_parameter(hb.Duffing(), "zeta", frequencies=(0.5, 0.55), harmonics=1)
    ... except hb.analysis.NoFoldError:
    ...     print("far below its resonance a Duffing oscillator does not jump")
    ...
    far below its resonance a Duffing oscillator does not jump
    """


@dataclass(frozen=True)
class CriticalParameter:
    """A critical value: where a jump appears or vanishes.

    value, Omega : the parameter and the frequency of the cusp.
    point : the motion there.
    folds : the fold curve it was found on.
    jump_below : whether the jump exists below the value (else above).
    others : further cusps met, as (value, Omega).
    status, message : whether all folds of the response curve were followed; if not, another cusp may be nearer.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.analysis.critical_parameter(hb.Duffing(), "zeta", frequencies=(0.9, 1.4), harmonics=1)
    >>> found.point.kind, found.point.parameters["zeta"] == found.value
    ('CP', True)
    """

    parameter: str
    value: float
    Omega: float
    point: SpecialPoint
    folds: Branch
    jump_below: bool
    others: tuple[tuple[float, float], ...] = ()
    status: Status = Status.REACHED_END
    message: str = ""


@checked_arguments(parameter="the name of a parameter, such as 'zeta'")
def critical_parameter(
    model: Model | HarmonicBalance,
    parameter: str,
    *,
    frequencies: tuple[float, float] | None = None,
    harmonics: int = 16,
    progress: ProgressCallback | None = None,
) -> CriticalParameter:
    """The value of a parameter at which a jump appears or vanishes, nearest to the model's own value.

    The response curve of the model is searched for folds; if it has none, those of ever more distant values of the
    parameter on either side, within its range. Each fold curve is followed once in the parameter, to its cusp or over
    five times the model's own value.

    Parameters
    ----------
    model : a model, or a `HarmonicBalance` whose settings are to be used.
    parameter : float field of the model.
    frequencies : range of Omega; the model's by default.
    harmonics : used if a model is given.
    progress : called with a `Progress` as work goes on, such as ``print``; how far it is cannot be told.

    Returns
    -------
    Critical
        Ctrl-C ends it with the nearest cusp found until then, if there is one; ``status`` and ``message`` say so.

    Raises
    ------
    NoFold
        If no value tried has a fold, or no fold curve a cusp; the message gives the steepest slope of the amplitude.
    KeyError, ValueError
        If the model has no such parameter, or it is Omega.
    KeyboardInterrupt
        If Ctrl-C comes before a cusp is found.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.analysis.critical_parameter(hb.Duffing(), "zeta", frequencies=(0.9, 1.4), harmonics=1)
    >>> bool(0.05 < found.value < 0.1), found.jump_below
    (True, True)
    """
    problem = problem_of(model, harmonics)
    check_parameter(problem, parameter)
    own, allowed = problem.value_of(parameter), problem.range_of(parameter)
    followed: list[Branch] = []
    tried: list[float] = []
    slope = ""
    for value in _search(own):
        if len(followed) >= _BARREN:
            break
        if value not in allowed:
            continue
        try:
            curve = response_curve(problem, parameter, value, frequencies)
        except NoConvergence:
            continue
        report_progress(progress, f"response curve at {parameter} = {value:.5g}: {_count_folds(curve)}")
        tried.append(value)
        slope = slope or _steepest(curve)
        found: list[tuple[SpecialPoint, Branch, bool]] = []
        ending = Termination()
        try:
            _cusps_from(problem, parameter, curve, followed, found, progress)
        except KeyboardInterrupt as error:
            if not found:
                raise
            ending.record_error(error, f"after {len(found)} of the points where a jump appears or vanishes")
        if found:
            point, fold, below = min(found, key=lambda f: abs(f[0].parameters[parameter] - own))
            others = [(p.parameters[parameter], p.parameters["Omega"]) for p, *_ in found if p is not point]
            return CriticalParameter(
                parameter, point.parameters[parameter], point.parameters["Omega"], point, fold, below, tuple(others),
                ending.status, ending.message_with_advice,
            )  # fmt: skip
    raise NoFoldError(
        f"no jump that appears or vanishes with {parameter} was found from {parameter} = {min(tried, default=own):.5g} "
        f"to {max(tried, default=own):.5g}; {slope}. Try another parameter, or a model nearer to a jump"
    )


def _search(own: float) -> Iterator[float]:
    """The model's own value, then values ever further away on both sides."""
    yield own
    step = abs(own) or 1.0
    for far in (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9):
        yield own - far * step
        yield own + step * (1 / (1 - far) - 1)


def _count_folds(curve: Branch) -> str:
    count = sum(p.kind == "LP" for p in curve.special)
    return f"{count} folds" if count else "no fold"


def _cusps_from(
    problem: HarmonicBalance, parameter: str, curve: Branch, followed: list[Branch],
    found: list[tuple[SpecialPoint, Branch, bool]], progress: ProgressCallback | None,
) -> None:  # fmt: skip
    """Add to found the cusps reached from the folds of a curve, with the fold curve and whether the jump lies below.

    ``followed`` are the fold curves already followed; those of this curve are added.
    """
    own, allowed = problem.value_of(parameter), problem.range_of(parameter)
    reach = _REACH * (abs(own) or 1.0)
    for point in (p for p in curve.special if p.kind == "LP" and p.located):
        if any(on_fold_curve(problem, fold, point, parameter) for fold in followed):
            continue
        value = point.parameters[parameter]
        first = -1 if own < value else 1  # towards the model's own value
        for side in (first, -first):
            end = allowed.clipped(value + side * reach, value)
            if end == value:
                continue
            report_progress(
                progress, f"fold at Omega = {point.parameters['Omega']:.5g} followed in {parameter} towards {end:.4g}"
            )
            fold = raise_if_interrupted(trace(FoldProblem(problem), parameter, (value, end), point, steps=_CAREFUL))
            followed.append(fold)
            cusp = next((p for p in fold.special if p.kind == "CP" and p.located), None)
            if cusp is not None:
                found.append((cusp, fold, bool(fold.values[0] < cusp.parameters[parameter])))
                break


def _steepest(curve: Branch) -> str:
    """The steepest slope of the rms amplitude, in words."""
    A, Omega = curve.amplitude("rms"), curve.values
    with np.errstate(all="ignore"):
        slope = np.diff(A) / np.diff(Omega)
    i = int(np.nanargmax(np.abs(np.where(np.isfinite(slope), slope, 0.0))))
    return f"the steepest slope of the rms amplitude is {slope[i]:.3g} at Omega = {0.5 * (Omega[i] + Omega[i + 1]):.5g}"
