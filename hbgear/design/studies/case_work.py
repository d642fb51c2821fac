"""Computation of one case of a study, in any process: peak, jumps, curve and critical values of a model."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from hbgear.analysis.critical_parameters import NoFoldError, critical_parameter
from hbgear.analysis.jump_landings import landings
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.tracing.coverage import uncovered_intervals
from hbgear.continuation.tracing.trace import trace
from hbgear.design.studies.case_results import Work
from hbgear.design.studies.processes import is_stop_requested
from hbgear.design.studies.store import Result
from hbgear.harmonic.bifurcations.peaks import locate_peaks
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.model_registry import fields_from_plain
from hbgear.io.branches.npz import packed
from hbgear.mechanics.fields import kinds_of, made
from hbgear.mechanics.model_lookup import find_model_class
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import ImplausibleInputWarning

_MAX_GROUP_SECONDS = 1.0
"""Computing time [s] after which a group returns its finished cases; the others are submitted again."""


def run_case(cls: type[Model] | str, fields: Mapping[str, Any], work: Work) -> Result:
    """Compute one case, in any process; return its numbers and its time, or the reason of the failure.

    The class of the model may be a reference from `reference_of`. ``fields`` are the values of its fields, and of
    parameters that are no fields.
    """
    started = time.perf_counter()
    try:
        model_type = find_model_class(cls) if isinstance(cls, str) else cls
        result = _computed_result(_model_with(model_type, fields_from_plain(fields)), work)
        return replace(result, seconds=time.perf_counter() - started)
    except Exception as error:  # an error in one case must not end the others
        text = error.args[0] if error.args else type(error).__name__
        is_expected = isinstance(error, ValueError | KeyError)
        reason = str(text) if is_expected else f"{type(error).__name__}: {text}"
        return Result(reason=" ".join(reason.split()), seconds=time.perf_counter() - started)


def _model_with(cls: type[Model], values: Mapping[str, Any]) -> Model:
    """Return the model of values of fields and their entries, and of parameters that are no fields (of a drawing)."""
    field_names = kinds_of(cls)
    parameters = {name: value for name, value in values.items() if name.partition("[")[0] not in field_names}
    model = made(cls, {name: value for name, value in values.items() if name not in parameters})
    return model.replace(**parameters) if parameters else model


def run_cases(cls: type[Model] | str, group: Sequence[Mapping[str, Any]], work: Work) -> list[Result]:
    """Compute the cases of a group with one thread; return the finished ones if the others would take too long.

    After Ctrl-C of the study no further case is begun.
    """
    started, results = time.perf_counter(), list[Result]()
    with _libraries(len(sys.modules)).limit(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore", ImplausibleInputWarning)  # was given before the first case
        for fields in group:
            if is_stop_requested():
                break
            results.append(run_case(cls, fields, work))
            if time.perf_counter() - started > _MAX_GROUP_SECONDS:
                break
    return results


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """Return the controller of the loaded threaded libraries; the number of modules changes if others are loaded."""
    return ThreadpoolController()


def _computed_result(model: Model, work: Work) -> Result:
    """Return all results of one case."""
    numbers: dict[str, float] = {}
    arrays: dict[str, Array] = {}
    packed_branch = b""
    problem = HarmonicBalance(model, work.harmonics)
    if work.compute:
        curves = _traced(problem, work)
        for kind, take in _CURVE_RESULTS.items():
            if kind in work.compute:
                take(curves, work, numbers, arrays)
        if "branch" in work.compute:
            packed_branch = packed(curves[0])
    for name in work.critical:
        try:
            critical = critical_parameter(problem, name, frequencies=work.span)
            if critical.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            numbers |= {f"critical_{name}": critical.value, f"critical_{name}_Omega": critical.Omega}
        except NoFoldError:
            numbers |= {f"critical_{name}": np.nan, f"critical_{name}_Omega": np.nan}
    return Result(numbers, arrays, packed_branch)


def _traced(problem: HarmonicBalance, work: Work) -> list[Branch]:
    """Return the curves that cover the span; ValueError if a curve ended early, or a part of the span has no curve."""
    stability = set(work.compute) != {"peak"}
    branch = trace(problem, "Omega", work.span, stability=stability, special=stability, accuracy=None)
    if not stability and any(curve.asymptotes for curve in branch.curves):
        branch = trace(problem, "Omega", work.span, accuracy=None)  # peaks are then those of stable motions
    curves = [raise_if_interrupted(branch), *branch.others]
    incomplete = next((curve for curve in curves if not curve.status.complete), branch)
    if not incomplete.status.complete or uncovered_intervals(curves, work.span):
        raise ValueError(f"the curve ended early: {incomplete.message}")
    return curves


def _peak(curves: list[Branch], work: Work, numbers: dict[str, float], arrays: dict[str, Array]) -> None:
    """Store the largest amplitude and its frequency: a located peak or an end of a curve.

    Of a curve that grows without bound only stable motions count; if they are unbounded, the amplitude is inf.
    """
    candidates = list[tuple[float, float]]()
    for branch in curves:
        if branch.asymptotes:
            candidates += _largest_stable(branch, work)
            continue
        rows = [row.point for *_, row in locate_peaks(branch, work.measure, work.element, share=0.99)]
        Omega = [*(row.value for row in rows), *branch.values[[0, -1]].tolist()]
        candidates += zip(_amplitudes(branch, work, [*(row.X for row in rows), *branch.X[[0, -1]]]), Omega, strict=True)
    numbers["peak"], numbers["peak_Omega"] = max(candidates)


def _largest_stable(branch: Branch, work: Work) -> list[tuple[float, float]]:
    """Return the largest amplitude of the stable motions of an unbounded curve and its frequency; [] without any."""
    stable, A = branch.stable, branch.amplitude(work.measure, work.element)
    assert stable is not None
    unbounded = [(np.inf, Omega) for i, Omega in branch.unbounded_ends if stable[i]]
    if unbounded:
        return unbounded[:1]
    i = int(np.argmax(np.where(stable, A, -np.inf)))
    return [(float(A[i]), float(branch.values[i]))] if stable[i] else []


def _amplitudes(branch: Branch, work: Work, X: Sequence[Array]) -> list[float]:
    """Return the amplitudes of motions of a branch, computed together."""
    layout = layout_of(branch)
    assert layout is not None  # a branch of a harmonic balance has a layout
    return layout.measure(work.measure, np.array(X), work.element).tolist()


def _jumps(curves: list[Branch], work: Work, numbers: dict[str, float], arrays: dict[str, Array]) -> None:
    """Store all jumps, and the frequency of the largest jump in each direction."""
    rows = []
    for branch, landed in zip(curves, landings(curves), strict=True):
        jumps = [landing.jump for landing in landed]
        ends = [point for jump in jumps for point in (jump.before, jump.after) if point is not None]
        amplitudes = iter(_amplitudes(branch, work, [point.X for point in ends]) if ends else [])
        rows += [
            [jump.value, jump.direction, next(amplitudes), np.nan if jump.after is None else next(amplitudes)]
            for jump in jumps
        ]
    arrays["jumps"] = np.array(rows, dtype=float).reshape(-1, 4)
    numbers["jumps"] = float(len(rows))
    for name, direction in (("jump_rising", 1), ("jump_falling", -1)):
        jumps_in_direction = [row for row in rows if row[1] == direction]
        top = max(jumps_in_direction, key=lambda row: np.nan_to_num(abs(row[3] - row[2])), default=None)
        numbers[name] = np.nan if top is None else float(top[0])


def _curve(curves: list[Branch], work: Work, numbers: dict[str, float], arrays: dict[str, Array]) -> None:
    """Store Omega, amplitude and stability; a column of nan separates curves."""
    columns = []
    for branch in curves:
        assert branch.stable is not None
        rows = np.array([branch.values, branch.amplitude(work.measure, work.element), branch.stable])
        columns += [np.full((3, 1), np.nan), rows]
    arrays["curve"] = np.hstack(columns[1:])


_CURVE_RESULTS = {"peak": _peak, "jumps": _jumps, "curve": _curve}


def check_result(result: Result, work: Work) -> None:
    """Raise an error for a result that does not contain the required numbers and arrays."""
    if result.reason:
        return
    shapes = {"jumps": (-1, 4), "curve": (3, -1)}
    for kind, (rows, columns) in shapes.items():
        if kind in work.compute:
            array = result.arrays.get(kind, np.empty(0))
            if array.ndim != 2 or rows not in (-1, array.shape[0]) or columns not in (-1, array.shape[1]):
                raise ValueError(f"it has no {kind}")
    if "branch" in work.compute and not result.has_branch:
        raise ValueError("it has no branch")
    needed = [kind for kind in ("peak", "jumps") if kind in work.compute]
    for name in (*needed, *(f"critical_{name}" for name in work.critical)):
        if name not in result.numbers:
            raise ValueError(f"it has no number '{name}'")


def check_work(model: Model, work: Work) -> None:
    """Raise ValueError or KeyError if span, measure, element or critical parameters are not valid for a model."""
    problem = HarmonicBalance(model, work.harmonics)
    problem.check_trace("Omega", min(work.span), max(work.span), {})
    problem.layout.check_measure(work.measure, work.element)
    for name in work.critical:
        problem.check_parameter(name)
