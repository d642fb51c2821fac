"""Jump maps and critical values: where jumps are, and for which design they vanish.

A jump is a fold of the response curve. Its frequency as a function of a design parameter is a fold curve; where the two
folds of a jump meet, at a cusp of that curve, the jump appears or vanishes.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

import csv
import math
import os
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hbgear.analysis.fold_curves import check_parameter, on_fold_curve, problem_of, report_progress, response_curve
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.process.progress import ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.concatenation import concatenate
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination, raise_if_interrupted
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model


@dataclass(frozen=True)
class Arm:
    """A piece of a fold curve on which the parameter is monotonic.

    values, Omega (P,): the parameter, ascending, and the jump frequency; direction: +1 if a sweep jumps there while
    Omega rises, -1 while it falls.
    """

    values: Array
    Omega: Array
    direction: int

    def at(self, value: float) -> float:
        """Jump frequency at a value of the parameter; nan outside the arm."""
        return float(np.interp(value, self.values, self.Omega, left=math.nan, right=math.nan))


@dataclass(frozen=True)
class JumpMap:
    """Jump frequencies against a design parameter.

    Parameters
    ----------
    parameter, span : the design parameter and its range.
    folds : the fold curves, each a `Branch` in the parameter with Omega in ``tracked``.
    arms : their monotonic pieces.
    labels : axis labels of the model.
    status, message : whether everything was traced as far as it goes, and what was not.
    curves : the response curves on which folds were looked for.
    frequencies : range of Omega of these.

    Examples
    --------
    >>> import hbgear as hb
    >>> jumps = hb.jump_map(hb.Duffing(), "zeta", (0.05, 0.06), frequencies=(0.9, 1.4), harmonics=1, seeds=2)
    >>> sorted({arm.direction for arm in jumps.arms})
    [-1, 1]
    """

    parameter: str
    span: tuple[float, float]
    folds: tuple[Branch, ...]
    arms: tuple[Arm, ...]
    labels: dict[str, str]
    status: Status = Status.REACHED_END
    message: str = ""
    curves: tuple[Branch, ...] = ()
    frequencies: tuple[float, float] = (0.0, 0.0)

    @property
    def cusps(self) -> tuple[SpecialPoint, ...]:
        """Where jumps appear or vanish."""
        return tuple(p for fold in self.folds for p in fold.special if p.kind == "CP")

    def jumps_at(self, value: float) -> list[tuple[float, int]]:
        """(Omega, direction) of every jump at a value of the parameter, ascending in Omega."""
        return [(Omega, self.arms[i].direction) for Omega, i in self._met(value)]

    def _met(self, value: float) -> list[tuple[float, int]]:
        """(Omega, number of the arm) at a value of the parameter, ascending in Omega."""
        found = [(arm.at(value), i) for i, arm in enumerate(self.arms)]
        return sorted((Omega, i) for Omega, i in found if not math.isnan(Omega))

    def several_motions(self, value: float) -> list[tuple[float, float]]:
        """Intervals of Omega in which the traced curve holds several motions at a value of the parameter."""
        return [(low[0], high[0]) for low, high in self._intervals(value)]

    def _intervals(self, value: float) -> list[tuple[tuple[float, int], tuple[float, int]]]:
        """The same with the arms that bound them."""
        out, count, start = [], 0, (0.0, -1)
        for Omega, i in self._met(value):
            before, count = count, count - self.arms[i].direction
            if before <= 0 < count:
                start = (Omega, i)
            elif count <= 0 < before:
                out.append((start, (Omega, i)))
        return out

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a .csv with one row per point of every arm: arm, parameter, Omega, direction; whole or not at all."""
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(["arm", self.parameter, "Omega", "direction"])
            for i, arm in enumerate(self.arms, 1):
                writer.writerows(
                    [i, float(x), float(y), arm.direction] for x, y in zip(arm.values, arm.Omega, strict=True)
                )

    def bands(self, values: Array) -> list[tuple[Array, Array]]:
        """Lower and upper Omega, (len(values),) each, of every region of several motions; nan where it is not."""
        found: dict[tuple[int, int], tuple[Array, Array]] = {}
        for n, value in enumerate(values):
            for (low, i), (high, j) in self._intervals(float(value)):
                empty = np.full(len(values), math.nan), np.full(len(values), math.nan)
                band = found.setdefault((i, j), empty)
                band[0][n], band[1][n] = low, high
        return list(found.values())


@checked_arguments(parameter="the name of a parameter, such as 'zeta'")
def jump_map(
    model: Model | HarmonicBalance,
    parameter: str,
    span: tuple[float, float],
    *,
    frequencies: tuple[float, float] | None = None,
    harmonics: int = 16,
    seeds: int = 3,
    steps: StepControl = StepControl(),
    progress: ProgressCallback | None = None,
    known: JumpMap | None = None,
) -> JumpMap:
    """Jump-up and jump-down frequencies against a design parameter.

    Response curves at ``seeds`` values across the span give the folds; each is followed in the parameter as far as it
    goes. A fold curve that no seed meets is missed: use more seeds where jumps come and go.

    Parameters
    ----------
    model : a model, or a `HarmonicBalance` whose settings are to be used.
    parameter : float field of the model.
    span : its range.
    frequencies : range of Omega of the response curves; the model's by default.
    harmonics : used if a model is given.
    seeds : number of response curves, at least 2.
    progress : called with a `Progress` as work goes on, such as ``print``; how far it is cannot be told.
    known : a map of the same model, parameter and ranges that was interrupted: its response curves and fold curves are
        not traced again.

    Returns
    -------
    JumpMap
        Ctrl-C or an error ends it with the curves that are whole; ``status`` and ``message`` say so.

    Raises
    ------
    ValueError
        If the parameter is Omega, the span empty or outside the range of the parameter, or seeds not from 2 to 1000.
    KeyError
        If the model has no such parameter.
    KeyboardInterrupt
        If it ends before the first response curve is whole.
    NoConvergence
        If there is an error before the first fold curve is whole.

    Examples
    --------
    >>> import hbgear as hb
    >>> jumps = hb.jump_map(hb.Duffing(), "zeta", (0.05, 0.06), frequencies=(0.9, 1.4), harmonics=1, seeds=2)
    >>> len(jumps.folds) > 0, jumps.status.complete
    (True, True)
    """
    problem = problem_of(model, harmonics)
    check_parameter(problem, parameter)
    low, high = sorted(map(float, span))
    if not (math.isfinite(low) and math.isfinite(high)) or low == high:
        raise ValueError(f"span = {span}: need two different finite values of {parameter}")
    if low not in (allowed := problem.range_of(parameter)) or high not in allowed:
        raise ValueError(f"span = {span}: {parameter} must {allowed}")
    counted("seeds", seeds, 1000, least=2)
    begin, end = map(float, problem.model.default_span if frequencies is None else frequencies)
    frequencies = (begin, end)
    if known is not None and (known.parameter, known.span, known.frequencies) != (parameter, (low, high), frequencies):
        raise ValueError("jump_map: known is a map of another parameter, span or range of Omega; leave it out")
    folds = [(fold, _arms(problem, fold)) for fold in (known.folds if known is not None else ())]
    curves = {curve.fixed[parameter]: curve for curve in (known.curves if known is not None else ())}
    ending, value = Termination(), low
    try:
        for value in _spread(low, high, seeds):
            report_progress(progress, f"response curve at {parameter} = {value:.5g}")
            if value not in curves:
                curves[value] = response_curve(problem, parameter, value, frequencies)
            curve = curves[value]
            ending.merge(curve, f"the response curve at {parameter} = {value:.5g}")
            for point in (p for p in curve.special if p.kind == "LP" and p.located):
                if not any(on_fold_curve(problem, fold, point, parameter) for fold, _ in folds):
                    report_progress(
                        progress, f"fold at Omega = {point.parameters['Omega']:.5g}, followed in {parameter}"
                    )
                    fold = _fold_curve(problem, parameter, (low, high), point, steps)
                    folds += [(fold, _arms(problem, fold))]
                    ending.merge(fold, f"the curve of the fold at Omega = {point.parameters['Omega']:.5g}")
    except (Exception, KeyboardInterrupt) as error:
        if not folds and not (curves and isinstance(error, KeyboardInterrupt)):
            raise
        ending.record_error(error, f"at the response curve at {parameter} = {value:.5g} or its folds")
    return JumpMap(
        parameter, (low, high), tuple(fold for fold, _ in folds), tuple(arm for _, arms in folds for arm in arms),
        dict(problem.model.labels), ending.status, ending.message_with_advice, tuple(curves.values()), frequencies,
    )  # fmt: skip


def _spread(low: float, high: float, count: int) -> list[float]:
    """Both ends first, then the values between."""
    inner = list(np.linspace(low, high, count)[1:-1])
    return [low, high, *map(float, inner)]


def _fold_curve(
    problem: HarmonicBalance, parameter: str, span: tuple[float, float], point: Point, steps: StepControl
) -> Branch:
    """A fold followed both ways, from where it leaves the span to where it leaves it again."""
    low, high = span
    value = point.parameters[parameter]
    forth = raise_if_interrupted(trace(FoldProblem(problem), parameter, (low, high), point, steps=steps))
    if value == low or forth.status == "closed":
        return forth
    back = raise_if_interrupted(trace(FoldProblem(problem), parameter, (high, low), point, steps=steps))
    return concatenate(back, forth) if value != high else back


def _arms(problem: HarmonicBalance, fold: Branch) -> list[Arm]:
    """Monotonic pieces of a fold curve, cut at its cusps."""
    cuts = [0, *(p.index for p in fold.special if p.kind == "CP"), len(fold) - 1]
    extended = FoldProblem(problem)
    out = []
    for a, b in pairwise(cuts):
        if b - a < 1:
            continue
        middle = (a + b) // 2 if b - a > 1 else a
        U = np.append(fold.X[middle], fold.tracked["Omega"][middle])
        here = {k: v for k, v in fold.parameters_at(middle).items() if k != "Omega"}
        order = np.argsort(fold.values[a : b + 1])
        out.append(
            Arm(
                fold.values[a : b + 1][order],
                fold.tracked["Omega"][a : b + 1][order],
                extended.direction(U, **here),
            )
        )
    return out
