"""Peaks of amplitudes: located on a finished curve, or as events while it is traced."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy  # sub-modules are imported at first use

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.builder import build_special_point, point_fields
from hbgear.continuation.curve.segment import CurvePoint, Segment, normal_of, point_from_solution
from hbgear.continuation.events.accuracy import estimate_error
from hbgear.continuation.events.event import BuiltInEvent, LocatedEvent, locate_by_newton, locate_root
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NewtonSettings, NoConvergence, Solution, on_curve, solve
from hbgear.harmonic.bifurcations.extremum import peak_of
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.mechanics.series.measures import check_peaks

# ---- on a finished curve


@checked_arguments()
def peaks(
    branch: Branch, measure: str = "rms", element: int | str = 0, *, share: float = 0.0, accuracy: float | None = 1e-5
) -> tuple[SpecialPoint, ...]:
    """Locate the local maxima of an amplitude along a branch, labelled PK1, PK2, ... in its order.

    Between the neighbours of each highest point the amplitude is maximised along the curve. Newton's method on its
    equations (`AmplitudeExtremum`) then gives full accuracy. A peak can be followed in a second parameter with
    ``follow(branch, peak, "zeta", span)``.

    Parameters
    ----------
    branch : Branch
        A branch that has its problem.
    measure : str, optional
        Measure of the amplitude, see `Branch.amplitude`. The default is "rms".
    element : int or str, optional
        Number or name of the element. The default is the first one.
    share : float, optional
        Peaks whose highest point is below this fraction of the largest amplitude are left out. The default is 0; 0.99
        locates the largest peak without the work for the others.
    accuracy : float or None, optional
        Largest relative error of the frequency of a peak, as in `trace`. The default is 1e-5. With None the peaks are
        those of the equations of the branch, without error estimates.

    Returns
    -------
    tuple of SpecialPoint
        The peaks in the order of the branch.

    Raises
    ------
    ValueError
        If the branch has no problem, or the measure does not exist or was registered with ``peaks=False``.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> top = hb.analysis.peaks(curve, "rms")[0]
    >>> top.label, bool(top.amplitude("rms") >= curve.amplitude("rms").max())
    ('PK1', True)
    """
    located = locate_peaks(branch, measure, element, share)
    if accuracy is not None:
        located = [(i, segment, estimate_error(segment, event, accuracy)) for i, segment, event in located]
    return tuple(_point(branch, i, number, event) for number, (i, _, event) in enumerate(located, 1))


def locate_peaks(
    branch: Branch, measure: str, element: int | str, share: float
) -> list[tuple[int, Segment, LocatedEvent]]:
    """Locate the peaks of the equations of the branch, each with its highest point and the segment around it."""
    check_peaks(measure)
    layout = layout_of(branch)
    if branch.problem is None or layout is None:
        raise ValueError("peaks need the problem; load the branch with load(path, problem=HarmonicBalance(...))")
    A = branch.amplitude(measure, element)
    maxima = np.flatnonzero((A[:-2] <= A[1:-1]) & (A[1:-1] > A[2:]) & (A[1:-1] >= share * A.max())) + 1
    event = AmplitudePeakEvent(measure, layout.index(element))
    segments = [(i, _segment_around(branch, i)) for i in maxima.tolist()]
    return [(i, segment, _peak_on_segment(segment, i, branch, event)) for i, segment in segments]


def _point(branch: Branch, i: int, number: int, event: LocatedEvent) -> SpecialPoint:
    """Return peak number ``number``, located near point i, with its monitored quantities."""
    problem, point = (
        (event.refined.problem, event.refined.point) if event.refined else (as_problem(branch.problem), event.point)
    )
    fixed = {k: v for k, v in branch.parameters_at(i).items() if k != branch.parameter}
    equations = CurveEquations(problem, branch.parameter, fixed)
    parameters = equations.parameters_at(point.value)
    point.observed.update(problem.observe(point.X, stability=branch.multipliers is not None, **parameters))
    fields = point_fields(equations, point)
    interval = (float(branch.values[i - 1]), float(branch.values[i + 1]))
    fields["problem"] = branch.problem
    return build_special_point(event, fields, f"PK{number}", i, interval)


def _peak_on_segment(segment: Segment, i: int, branch: Branch, event: AmplitudePeakEvent) -> LocatedEvent:
    """Return the peak near point i; that point, marked as not located, if the peak is not found."""
    try:
        return event.find(segment)[0]
    except SOLVER_ERRORS:
        point = _point_with_tangent(branch, i, segment.scale, segment.b.u - segment.a.u)
        return LocatedEvent(event, 0.5, point, False, f"peak of {event.measure}")


def _segment_around(branch: Branch, i: int) -> Segment:
    """Return the segment between the neighbours of point i."""
    problem: Any = branch.problem
    scale = np.append(
        np.full(branch.X.shape[1], problem.solution_norm(branch.X[i]) or 1.0), np.ptp(branch.values) or 1.0
    )
    direction = np.append(branch.X[i + 1] - branch.X[i - 1], branch.values[i + 1] - branch.values[i - 1])
    fixed = {k: v for k, v in branch.parameters_at(i).items() if k != branch.parameter}
    a, b = (_point_with_tangent(branch, j, scale, direction) for j in (i - 1, i + 1))
    return Segment(problem, branch.parameter, fixed, a, b, scale, NewtonSettings())


def _point_with_tangent(branch: Branch, i: int, scale: Array, direction: Array) -> CurvePoint:
    """Return point i of a branch with its tangent."""
    X, value = branch.X[i], float(branch.values[i])
    evaluation = branch.problem.linearise(X, branch.parameter, **branch.parameters_at(i))
    return point_from_solution(
        Solution(X, value, evaluation, int(branch.iterations[i]), float(branch.residual[i])),
        normal_of(direction, scale),
        scale,
    )


# ---- events


class AmplitudePeakEvent(BuiltInEvent):
    """Peak of an amplitude, located by `hbgear.analysis.peaks` on a finished curve, not while it is traced."""

    kind, meaning, marker = "PK", "peak of an amplitude", "^"

    def __init__(self, measure: str = "rms", element: int = 0) -> None:
        self.measure, self.element = measure, element

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        return np.zeros(len(points) - 1, dtype=bool)

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the point of the largest amplitude on a segment."""

        def negative_amplitude(s: float) -> float:
            return -float(self._amplitude(segment, segment.at(s).X))

        def search(xatol: float) -> float:
            best = scipy.optimize.minimize_scalar(
                negative_amplitude, bounds=(0.0, 1.0), method="bounded", options={"xatol": xatol}
            )
            return float(best.x)

        refined = self._refine(segment, self._interpolated_maximum(segment)) or self._refine(
            segment, search(INITIAL_PEAK_TOLERANCE)
        )
        return [
            LocatedEvent(
                self, 0.5, refined or segment.at(search(FINAL_PEAK_TOLERANCE)), True, f"peak of {self.measure}"
            )
        ]

    def _amplitude(self, segment: Segment, X: Array) -> Array:
        layout = segment.problem.layout
        assert isinstance(layout, Layout)
        return layout.measure(self.measure, X, self.element)

    def _interpolated_maximum(self, segment: Segment) -> float:
        """Return the fraction of a segment at which the interpolated amplitude is largest, by a parabola."""
        s = np.linspace(0.0, 1.0, AMPLITUDE_SAMPLES)
        A = self._amplitude(segment, segment.guess(s[:, None])[:, :-1])
        # a parabola through the largest sample and its neighbours
        i = min(max(int(np.argmax(A)), 1), AMPLITUDE_SAMPLES - 2)
        before, value, after = A[i - 1 : i + 2].tolist()
        curvature = before - 2 * value + after
        return float(s[i] + (0.5 * (before - after) / curvature * s[1] if curvature < 0 else 0.0))

    def _refine(self, segment: Segment, s: float) -> CurvePoint | None:
        """Return the peak by Newton's method from a fraction of the segment, if it stays on the segment."""
        peak, u = peak_of(segment.problem, segment.name, self.measure, self.element), segment.guess(s)
        try:
            solution = on_curve(solve(peak, u, segment.parameters_at(float(u[-1]))))
        except NoConvergence:
            return None
        if norm((np.append(solution.X, solution.value) - u) / segment.scale) > 0.1 * segment.length:
            return None
        return point_from_solution(solution, normal_of(segment.b.u - segment.a.u, segment.scale), segment.scale)

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """Return the equations; see `AmplitudeExtremum`."""
        return peak_of(problem, parameter, self.measure, self.element)


AMPLITUDE_SAMPLES = 17
"""Number of points of a segment at which its interpolated amplitude is evaluated."""


INITIAL_PEAK_TOLERANCE, FINAL_PEAK_TOLERANCE = 1e-2, 1e-7
"""Fractions of a segment to which a peak is minimised: before Newton's method, and instead of it."""


class TracedPeakEvent(AmplitudePeakEvent):
    """Peak of the rms amplitude of an element, located while a curve is traced: opt-in event "PK".

    X^T S t = 0, from + to -,   t the tangent of the curve, S the weights of the alternating part
    """

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        """Return the derivative of half the squared amplitude along the curve at points, shape (points, 1)."""
        return np.array([[self._slope(equations.problem, point)] for point in points])

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        """Return where the amplitude has a maximum: the derivative changes from positive to negative."""
        return np.asarray((values[:-1, 0] > 0) & (values[1:, 0] < 0))

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the maximum by Newton's method, or as a bracketed root of the derivative."""
        before, after = self._slope(segment.problem, segment.a), self._slope(segment.problem, segment.b)
        if not before > 0 > after:
            return []
        note = f"peak of {self.measure}"
        try:
            equations = peak_of(segment.problem, segment.name, self.measure, self.element)
            return [locate_by_newton(segment, self, equations, before / (before - after), note)]
        except SOLVER_ERRORS:
            return [locate_root(segment, self, lambda point: self._slope(segment.problem, point), note)]

    def _slope(self, problem: Any, point: CurvePoint) -> float:
        """Return the derivative of half the squared rms amplitude along the curve."""
        motion, change = (problem.rows(problem.resized(x))[self.element, 1:] for x in (point.X, point.tangent[:-1]))
        return float(motion @ change) / 2
