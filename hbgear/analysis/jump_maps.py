"""Jump maps: frequencies of jumps over a design parameter.

A jump is a fold of the response curve. Its frequency as a function of a design parameter is a fold curve. At a cusp of
this curve two folds meet, and the jump appears or vanishes.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from hbgear.analysis.fold_curves import (
    check_parameter,
    equations_of_curve,
    fold_equations,
    folds_of,
    on_fold_curve,
    problem_of,
    report_progress,
    response_curve,
)
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import csv_table
from hbgear.common.process.progress import ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.events.fold import TURNING_KINDS
from hbgear.continuation.follow import trace_to_both_ends
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import interpolate_along
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination, raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.coverage import coverage_message, uncovered_intervals
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model


@dataclass(frozen=True)
class Arm:
    """Section of a fold curve on which the parameter is monotonic, with ascending values (P,) and Omega (P,).

    ``direction`` is 1 if a sweep with rising Omega jumps there, -1 for falling Omega.
    """

    values: Array
    Omega: Array
    direction: int

    def at(self, value: float) -> float:
        """Return the jump frequency at a value of the parameter; nan outside the section."""
        return float(np.interp(value, *self._dense, left=math.nan, right=math.nan))

    @cached_property
    def _dense(self) -> tuple[Array, Array]:
        """Values and frequencies at `_DENSITY` points between two points of the section, by cubic splines."""
        count = len(self.values) - 1
        values = np.interp(np.arange(_DENSITY * count + 1) / _DENSITY, np.arange(count + 1), self.values)
        Omega = interpolate_along(values, self.values, self.Omega)
        Omega[::_DENSITY] = self.Omega  # exact at a cusp, where two sections end
        return values, Omega


_DENSITY = 32
"""Interpolated points [-] between two points of a fold curve; linear interpolation between them is exact to 1e-7."""


@dataclass(frozen=True)
class JumpMap:
    """Jump frequencies over a design parameter.

    Attributes
    ----------
    parameter : str
        Name of the design parameter.
    span : tuple of float
        Range of the design parameter, the lower end first.
    folds : tuple of Branch
        Fold curves in the design parameter, with Omega in ``tracked``.
    arms : tuple of Arm
        Sections of the fold curves on which the parameter is monotonic.
    labels : dict of str to str
        Axis labels of the model.
    status : Status
        Complete if all curves were traced to their ends.
    message : str
        Reason of an early end, and advice; or sections of the range in which no response curve was found, and folds
        on curves that were not traced.
    curves : tuple of Branch
        Response curves whose folds are the starts of the fold curves; `Branch.others` are further curves of the range.
    frequencies : tuple of float
        Range of Omega of the response curves.

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

    def __repr__(self) -> str:
        low, high = self.span
        cusps = "".join(f", {point!r}" for point in self.cusps)
        return f"<JumpMap over {self.parameter}: {low:.6g} to {high:.6g}, {len(self.arms)} arms{cusps}, {self.status}>"

    @property
    def cusps(self) -> tuple[SpecialPoint, ...]:
        """Points of the fold curves at which jumps appear or vanish: cusps (CP), and where curves join (IC)."""
        return tuple(p for p in self.special if p.kind in TURNING_KINDS)

    @property
    def special(self) -> tuple[SpecialPoint, ...]:
        """All special points of the fold curves, also resonances 1:1 (RI), fold-flips (FF) and LPNS points."""
        return tuple(p for fold in self.folds for p in fold.special)

    @checked_arguments()
    def jumps_at(self, value: float) -> list[tuple[float, int]]:
        """Return the jumps at a value of the parameter.

        Parameters
        ----------
        value : float
            Value of the design parameter.

        Returns
        -------
        list of tuple (float, int)
            Omega, ascending, and direction of each jump.
        """
        return [(Omega, self.arms[i].direction) for Omega, i in self._arms_at(value)]

    def _arms_at(self, value: float) -> list[tuple[float, int]]:
        """Return Omega, ascending, and the number of the section of each jump; at a cusp the lower jump is first."""
        crossings = [(arm.at(value), arm.direction, i) for i, arm in enumerate(self.arms)]
        return [(Omega, i) for Omega, _, i in sorted(crossings) if not math.isnan(Omega)]

    @cached_property
    def _detached(self) -> set[int]:
        """Numbers of the sections that go to infinity and contain no fold of a response curve.

        They belong to curves that were not traced, whose asymptotes are unknown.
        """
        infinite = {(fold.values[k], fold.tracked["Omega"][k]) for fold in self.folds for k, _ in fold.unbounded_ends}
        known = [point.parameters for curve in self.curves for point in folds_of(curve)]
        return {
            i
            for i, arm in enumerate(self.arms)
            if infinite & {(arm.values[k], arm.Omega[k]) for k in (0, -1)}
            and not any(abs(arm.at(at[self.parameter]) / at["Omega"] - 1) < SAME_SECTION_TOLERANCE for at in known)
        }

    @cached_property
    def _asymptotes(self) -> list[tuple[float, list[tuple[float, int]]]]:
        """Values of the parameter, ascending, with the asymptotes of the response curves there."""
        return sorted((curve.fixed[self.parameter], _asymptotes_of(curve)) for curve in self.curves)

    def _asymptotes_at(self, value: float) -> list[tuple[float, int]]:
        """Return the asymptotes at a value of the parameter, between the nearest curves if they have the same ones.

        If they differ, those of the curve are taken from which the number of motions at the ends of the range does not
        change; if this does not decide, those of the nearer one.
        """
        entries = self._asymptotes
        if not any(asymptotes for _, asymptotes in entries):
            return []
        k = min(max(int(np.searchsorted([x for x, _ in entries], value)), 1), len(entries) - 1)
        (low, below), (high, above) = entries[max(k - 1, 0)], entries[k]
        fraction = (value - low) / (high - low) if high > low else 0.0
        if [change for _, change in below] != [change for _, change in above]:
            near, far = ((low, below), (high, above)) if fraction < 0.5 else ((high, above), (low, below))
            return far[1] if self._total(value, far[1]) == self._total(*far) != self._total(value, near[1]) else near[1]
        return [((1 - fraction) * a + fraction * b, change) for (a, change), (b, _) in zip(below, above, strict=True)]

    def _total(self, value: float, asymptotes: list[tuple[float, int]]) -> int:
        """Return the change of the number of motions over the range of Omega."""
        folds = sum(-2 * self.arms[i].direction for _, i in self._arms_at(value) if i not in self._detached)
        return folds + sum(change for _, change in asymptotes)

    @checked_arguments()
    def several_motions(self, value: float) -> list[tuple[float, float]]:
        """Return the intervals of Omega with several motions at a value of the parameter.

        The number of motions changes by two at each jump, and by one where a curve grows without bound. These
        frequencies are interpolated between the response curves. An interval without an end extends to the end of the
        range of Omega. Folds that go to infinity on curves that were not traced are left out. Where other folds lie on
        such curves, the intervals may be wrong, and ``message`` reports it.

        Parameters
        ----------
        value : float
            Value of the design parameter.

        Returns
        -------
        list of tuple of float
            Lower and upper end of each interval in which the traced curves have several motions.
        """
        return [(low[0], high[0]) for low, high in self._intervals(value)]

    def _intervals(self, value: float) -> list[tuple[tuple[float, int], tuple[float, int]]]:
        """Return the intervals of `several_motions`, each end with a number: of its section, or below zero."""
        arms = [(Omega, i) for Omega, i in self._arms_at(value) if i not in self._detached]
        changes = [(Omega, i, -2 * self.arms[i].direction) for Omega, i in arms]
        if not changes:
            return []
        changes += [(Omega, -3 - k, change) for k, (Omega, change) in enumerate(self._asymptotes_at(value))]
        changes.sort(key=lambda change: change[0])
        ends = [(min(*self.frequencies, changes[0][0]), -1), *((Omega, i) for Omega, i, _ in changes)]
        ends += [(max(*self.frequencies, changes[-1][0]), -2)]
        counts = np.cumsum([0, *(change for *_, change in changes)])
        several = np.concatenate([[False], counts > counts.min(), [False]])
        starts, stops = np.flatnonzero(several[1:] & ~several[:-1]), np.flatnonzero(several[:-1] & ~several[1:])
        return [(ends[i], ends[k]) for i, k in zip(starts.tolist(), stops.tolist(), strict=True)]

    @checked_arguments()
    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a .csv file with one row for each point of each section; no file is left after an error.

        Parameters
        ----------
        path : str or path-like
            File. Its columns are arm, parameter, Omega and direction, and the speed of the pinion if the model has
            scales.
        """
        axis = OmegaAxis.of_ends(self.folds, "")
        speed = [axis.name] if axis.is_speed else []
        with csv_table(path) as writer:
            writer.writerow(["arm", self.parameter, "Omega", "direction", *speed])
            for i, arm in enumerate(self.arms, 1):
                writer.writerows(
                    [i, float(x), float(y), arm.direction, *(float(axis.scale * y) for _ in speed)]
                    for x, y in zip(arm.values, arm.Omega, strict=True)
                )

    def bands(self, values: Array) -> list[tuple[Array, Array]]:
        """Return the regions of several motions.

        Parameters
        ----------
        values : ndarray, shape (P,)
            Values of the design parameter.

        Returns
        -------
        list of tuple of ndarray
            Lower and upper Omega of each region, shape (P,) each; nan where the region does not exist.
        """
        regions, before = list[tuple[Array, Array]](), dict[tuple[int, int], tuple[Array, Array]]()
        close = SAME_BAND_TOLERANCE * abs(self.frequencies[1] - self.frequencies[0])
        for n, value in enumerate(values):
            now = {}
            for (low, i), (high, j) in self._intervals(float(value)):
                ends = np.array([low, high])
                near = (b for b in before.values() if np.all(abs(np.array([b[0][n - 1], b[1][n - 1]]) - ends) < close))
                band = before.get((i, j)) or next(near, None)
                if band is None:
                    band = np.full(len(values), math.nan), np.full(len(values), math.nan)
                    regions.append(band)
                band[0][n], band[1][n] = low, high
                now[i, j] = band
            before = now
        return regions


SAME_BAND_TOLERANCE = 0.02
"""Change of the ends of a region of several motions from one value to the next, relative to the range of Omega, up to
which it is the same region; where two sections cross, the end passes from one to the other."""


SAME_SECTION_TOLERANCE = 1e-3
"""Difference of the frequencies of a fold and of a section, which is interpolated, relative, below which they agree."""


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
    """Compute the jump-up and jump-down frequencies over a design parameter.

    Response curves that cover the range of Omega at `seeds` values of the parameter, and at the value of the model if
    it is within the span, are searched for folds, and each fold is followed in the parameter through the span. A fold
    curve that intersects none of the response curves is missed: use more seeds if jumps appear and vanish within the
    span.

    Parameters
    ----------
    model : Model or HarmonicBalance
        Model, or its equations with their settings.
    parameter : str
        Name of a float parameter of the model.
    span : tuple of float
        Range of the parameter.
    frequencies : tuple of float, optional
        Range of Omega of the response curves. By default the range of the model.
    harmonics : int, optional
        Harmonic truncation order H if a model is given. The default is 16.
    seeds : int, optional
        Number of equidistant values of response curves, 2 to 1000. The default is 3.
    steps : StepControl, optional
        Step size control of the fold curves.
    progress : callable, optional
        Function that is called with a `Progress` after each step, such as ``print``. Its fraction is unknown.
    known : JumpMap, optional
        Incomplete map of the same model, parameter and ranges, such as one that Ctrl-C ended. Its curves are not traced
        again.

    Returns
    -------
    JumpMap
        The map. After Ctrl-C or an error it holds the complete curves; ``status`` and ``message`` report the reason.

    Raises
    ------
    ValueError
        If the parameter is Omega, the span is empty or outside the range of the parameter, or `seeds` is not from 2 to
        1000.
    KeyError
        If the model has no such parameter.
    KeyboardInterrupt
        If Ctrl-C is pressed before the first response curve is complete.
    NoConvergence
        If an error occurs before the first fold curve is complete.

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
        raise ValueError("jump_map: known is a map of another parameter, span or range of Omega; give known=None")
    search = _MapSearch(problem, parameter, (low, high), frequencies, steps, progress)
    if known is not None:
        search.folds = [(fold, _arms(problem, fold)) for fold in known.folds]
        search.curves = {curve.fixed[parameter]: curve for curve in known.curves}
    value, gap = low, ""
    try:
        for value in _seed_values(low, high, seeds, problem.value_of(parameter)):
            search.follow_folds_at(value)
        gap = search.gap()
    except (Exception, KeyboardInterrupt) as error:
        if not search.folds and not (search.curves and isinstance(error, KeyboardInterrupt)):
            raise
        search.ending.record_error(error, f"at the response curve at {parameter} = {value:.5g} or its folds")
    message = "; ".join(text for text in (search.ending.message_with_advice, gap) if text)
    return JumpMap(
        parameter,
        (low, high),
        tuple(fold for fold, _ in search.folds),
        tuple(arm for _, arms in search.folds for arm in arms),
        dict(problem.model.labels),
        search.ending.status,
        message,
        tuple(search.curves.values()),
        frequencies,
    )


_ADVICE = "complete curves are kept; continue from them (in Python: jump_map(..., known=this map))"
"""Recommended action for a map that is not complete."""


@dataclass(eq=False)
class _MapSearch:
    """Response curves and fold curves of a jump map, found so far.

    Attributes
    ----------
    problem, parameter, span, frequencies, steps, progress : object
        See `jump_map`.
    curves : dict of float to Branch
        Response curves by value of the parameter.
    folds : list of tuple of Branch and list of Arm
        Fold curves with their arms.
    ending : Termination
        How the traces ended.
    unconverged : list of str
        Sentences on folds that are not in the map.
    """

    problem: HarmonicBalance
    parameter: str
    span: tuple[float, float]
    frequencies: tuple[float, float]
    steps: StepControl
    progress: ProgressCallback | None
    curves: dict[float, Branch] = field(default_factory=dict)
    folds: list[tuple[Branch, list[Arm]]] = field(default_factory=list)
    ending: Termination = field(default_factory=lambda: Termination(advice=_ADVICE))
    unconverged: list[str] = field(default_factory=list)

    def follow_folds_at(self, value: float) -> None:
        """Trace the response curve at a value of the parameter, and follow its folds that are on no fold curve yet."""
        report_progress(self.progress, f"response curve at {self.parameter} = {value:.5g}")
        if value not in self.curves:
            self.curves[value] = response_curve(self.problem, self.parameter, value, self.frequencies)
        for branch in self.curves[value].curves:
            self.ending.merge(branch, f"the response curve at {self.parameter} = {value:.5g}")
        for point in folds_of(self.curves[value]):
            if not any(on_fold_curve(self.problem, fold, point, self.parameter) for fold, _ in self.folds):
                self._follow(point, value)

    def _follow(self, point: Point, value: float) -> None:
        """Follow a fold of the response curve at a value of the parameter through the span."""
        text = f"fold at Omega = {point.parameters['Omega']:.5g}"
        report_progress(self.progress, f"{text}, followed in {self.parameter}")
        try:
            fold = _fold_curve(*fold_equations(self.problem, point), self.parameter, self.span, self.steps)
        except NoConvergence:
            self.unconverged.append(
                f"the {text} at {self.parameter} = {value:.5g} is not in the map: its equations do not converge"
            )
            return
        self.folds.append((fold, _arms(self.problem, fold)))
        self.ending.merge(fold, f"the curve of the {text}")

    def gap(self) -> str:
        """Return sentences on what is not in the map, or ""."""
        infinite = [_to_infinity(fold) for fold, _ in self.folds if fold.unbounded_ends]
        arms = [arm for _, arms in self.folds for arm in arms]
        untraced = _untraced_folds(self.parameter, self.curves, arms, self.frequencies)
        texts = _without_curve(self.parameter, self.curves, self.frequencies), *self.unconverged, *infinite, untraced
        return "; ".join(filter(None, texts))


def _asymptotes_of(curve: Branch) -> list[tuple[float, int]]:
    """Return Omega, ascending, where curves grow without bound; -1 if they approach it from below, 1 from above."""
    return sorted(
        (Omega, -1 if branch.values[i] < Omega else 1) for branch in curve.curves for i, Omega in branch.unbounded_ends
    )


def _without_curve(parameter: str, curves: Mapping[float, Branch], frequencies: tuple[float, float]) -> str:
    """Return a sentence on the first value of a parameter at which no curve covers a part of the range, or ""."""
    for value, curve in curves.items():
        if uncovered_intervals([curve, *curve.others], frequencies):
            gap = coverage_message(curve, curve.others, frequencies)
            return f"at {parameter} = {value:.5g} {gap}; jumps there are not in the map"
    return ""


def _untraced_folds(
    parameter: str, curves: Mapping[float, Branch], arms: Sequence[Arm], frequencies: tuple[float, float]
) -> str:
    """Return a sentence on folds that belong to none of the response curves at a value of a parameter, or ""."""
    for value, curve in curves.items():
        known = [point.parameters["Omega"] for point in folds_of(curve)]
        untraced = [
            Omega
            for Omega in sorted(arm.at(value) for arm in arms)
            if min(frequencies) <= Omega <= max(frequencies)
            and not any(abs(Omega / other - 1) < SAME_SECTION_TOLERANCE for other in known)
        ]
        if untraced:
            places = ", ".join(f"{Omega:.5g}" for Omega in untraced)
            return (
                f"folds at {parameter} = {value:.5g}, Omega = {places} lie on curves that were not traced, so that "
                "regions of several motions may be wrong there"
            )
    return ""


def _to_infinity(fold: Branch) -> str:
    """Return a sentence on a fold whose motion grows without bound at a value of the parameter."""
    Omega = fold.tracked["Omega"]
    ends = " and ".join(f"{fold.parameter} = {p:.5g}, Omega = {Omega[i]:.5g}" for i, p in fold.unbounded_ends)
    return f"the motion of a fold grows without bound at {ends}"


def _seed_values(low: float, high: float, count: int, model_value: float) -> list[float]:
    """Return equidistant values, both ends first, and the value of the model if it is between the ends."""
    values = [low, high, *map(float, np.linspace(low, high, count)[1:-1])]
    return [*values, model_value] if low < model_value < high and model_value not in values else values


def _fold_curve(equations: Any, point: Point, parameter: str, span: tuple[float, float], steps: StepControl) -> Branch:
    """Trace the curve of a fold in both directions to the ends of the span."""
    ends = span[::-1] if point.parameters[parameter] == span[1] else span
    return raise_if_interrupted(trace_to_both_ends(equations, parameter, ends, point, steps=steps))


def _arms(problem: HarmonicBalance, fold: Branch) -> list[Arm]:
    """Return the monotonic sections of a fold curve between its cusps; a closed curve starts within one of them."""
    cuts = [p.index for p in fold.special if p.kind in TURNING_KINDS]
    sections = [np.arange(a, b + 1) for a, b in pairwise([0, *cuts, len(fold) - 1])]
    if fold.status is Status.CLOSED and cuts:
        sections = [np.append(sections[-1], sections[0][1:]), *sections[1:-1]]
    extended = equations_of_curve(problem, fold)
    out = []
    for section in sections:
        if len(section) < 2:
            continue
        middle = int(section[(len(section) - 1) // 2])
        U = np.append(fold.X[middle], fold.tracked["Omega"][middle])
        parameters = {k: v for k, v in fold.parameters_at(middle).items() if k != "Omega"}
        ascending = section[np.argsort(fold.values[section])]
        out.append(Arm(fold.values[ascending], fold.tracked["Omega"][ascending], extended.direction(U, **parameters)))
    return out
