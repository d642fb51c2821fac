"""Events: kinds of special points of a curve, their detection by test functions, and their location.

    tau(u(s)) = 0,    detected where tau(u_i) tau(u_(i+1)) < 0

An `Event` is one kind of special point. It detects the segments between neighbouring points of a curve on which its
test function tau changes sign. It locates the special point there, by default as a bracketed root of tau along the
segment; each iterate is corrected onto the curve. Two events on one segment leave no sign change. Where a test function
comes close to zero (`Event.near_zeros`), additional points are computed on the segment (`even_crossings`).

LP  fold: dR/dX is singular, the parameter direction changes (`FoldEvent`); CP, a cusp, on a curve of folds.
    Newton's method on {R = 0, g = 0} with the bordered determinant g, or a bracketed root of the tangent.
BP  branch point: two curves cross, det [dR/dX dR/dp; t^T] changes sign (`BranchPointEvent`).
    Newton's method on {(1 - b b^T) R, g_1, g_2}, see `BranchPointProblem`, from a bracketed root of the determinant.

A problem supplies further events (`ContinuationProblem.events`). Users add their own::

    trace(problem, "Omega", span, events=[Event("limit", lambda point: point.amplitude("max") - 2.0)])

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.level import ScalarConditionProblem
from hbgear.continuation.augmented.minimally_augmented import LOCATION_ITERATIONS, MinimallyAugmentedProblem
from hbgear.continuation.curve.builder import build_point
from hbgear.continuation.curve.segment import CurvePoint, NewBranch, Segment, point_from_solution
from hbgear.continuation.events.columns import lengths
from hbgear.continuation.events.near_tangency import near_zeros
from hbgear.continuation.numerics.bracketed_root import find_root_bracketed
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, SOLVER_ERRORS, NoConvergence, on_curve, solution_at


@dataclass(frozen=True)
class RefinedLocation:
    """Special point located with a problem of more unknowns than its curve has."""

    problem: ContinuationProblem
    point: CurvePoint


@dataclass(frozen=True)
class LocatedEvent:
    """Special point found on a segment.

    Attributes
    ----------
    event : Event
        The kind of special point.
    s : float
        Fraction of the segment, from 0 to 1. More accurate equations may locate the point slightly beyond an end.
    point : CurvePoint
        The point.
    located : bool
        Whether the location converged.
    note : str
        Remark for the user.
    error : float
        Estimated error of the parameter value, of ``refined`` if there is one; nan if unknown. See `accuracy`.
    refined : RefinedLocation or None
        The point located with more unknowns.
    finder : Event or None
        The event that found the point, if it is not its own.
    at_all_phases : bool
        Whether a contact begins at all phases at once.
    """

    event: Event
    s: float
    point: CurvePoint
    located: bool
    note: str = ""
    error: float = math.nan
    refined: RefinedLocation | None = None
    finder: Event | None = None
    at_all_phases: bool = False

    @property
    def value(self) -> float:
        """The most accurate value of the parameter."""
        return self.refined.point.value if self.refined else self.point.value


class Event:
    """Kind of special point: a zero of a function of the point.

        test(point) = 0,   located on the curve to rounding, labelled kind1, kind2, ...

    Parameters
    ----------
    kind : str
        First part of the labels, in letters.
    test : callable
        Continuous function of a `Point`. It may use unknowns, parameters and monitored quantities.
    meaning : str, optional
        Description for tables and legends. The default is the kind.
    marker : str, optional
        Marker of matplotlib for figures, one character. The default is "v".
    terminal : bool, optional
        Whether the trace ends at the first event of this kind. The default is False.

    Raises
    ------
    ValueError
        If the kind does not consist of letters or is reserved by hbgear, or the marker does not exist.
    TypeError
        If the test is not callable.

    Examples
    --------
    >>> import hbgear as hb
    >>> limit = hb.Event("limit", lambda point: point.amplitude("max") - 1.3, "the largest deflection is 1.3")
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6), events=[limit])
    >>> [round(point.amplitude("max"), 9) for point in curve.special if point.kind == "limit"]
    [1.3, 1.3]
    """

    kind: str
    meaning: str
    marker: str = "v"
    terminal: bool = False
    needs_two_sides: bool = False
    """Whether the search uses a point on either side of the special point, where the test function is undefined."""
    alone: bool = False
    """Whether no other event is searched on the segment that ends at this terminal event."""

    regular_at_corners: bool = False
    """Whether the equations can be solved at a corner of the curve, where dR/dX is discontinuous."""

    @checked_arguments(test="a function of a point, such as lambda point: point.amplitude('max') - 2.0")
    def __init__(
        self, kind: str, test: Callable[[Point], float], meaning: str = "", marker: str = "v", terminal: bool = False
    ) -> None:
        if not isinstance(kind, str) or not re.fullmatch(r"[A-Za-z_]*[A-Za-z]", kind):
            raise ValueError(f"Event: kind = {kind!r} must be letters, such as 'limit'; labels add the number")
        if kind in RESERVED:
            reserved = ", ".join(RESERVED)
            raise ValueError(f"Event: kind = {kind!r} is reserved by hbgear ({reserved}); choose another")
        if not is_marker(marker):
            raise ValueError(f"Event: marker = {marker!r} must be one of {' '.join(MARKERS)}")
        self.kind, self._test, self.meaning = kind, test, meaning or kind
        self.marker, self.terminal = marker, terminal

    def __repr__(self) -> str:
        return f"<Event {self.kind}: {self.meaning}>"

    @property
    def test_function(self) -> Callable[[Point], float] | None:
        """Function of the user; None for a class that overrides `test` or locates in another way."""
        return getattr(self, "_test", None)

    def test(self, point: Point) -> float:
        """Return the value of the test function at a point.

        Parameters
        ----------
        point : Point
            Point of a curve.

        Returns
        -------
        float
            The value.

        Raises
        ------
        ValueError
            If the value is not finite.
        """
        value = float(self._test(point))
        if not math.isfinite(value):
            raise ValueError(f"the test of the event '{self.kind}' is {value} at {point}; it must be finite")
        return value

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        """Return the test functions at P points of a curve.

        Parameters
        ----------
        points : sequence of CurvePoint
            Points.
        equations : CurveEquations
            Equations of the curve.

        Returns
        -------
        ndarray, shape (P, T)
            Values of T functions that change sign at the event. T may be 0.
        """
        return np.array([[self.test(build_point(equations, point))] for point in points])

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        """Return the smallest number of events on each segment between successive points.

        Parameters
        ----------
        points : sequence of CurvePoint
            P points.
        values : ndarray, shape (P, T)
            Result of `values`.

        Returns
        -------
        ndarray, shape (P - 1,)
            Numbers of events, or bool.
        """
        return np.asarray((values[1:] * values[:-1] < 0).any(axis=1))

    def near_zeros(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return the segments on which a test function may cross zero an even number of times.

        Parameters
        ----------
        points : sequence of CurvePoint
            P points.
        values : ndarray, shape (P, T)
            Result of `values`.
        scale : ndarray, shape (n + 1,)
            Scales of the unknowns and of the parameter.

        Returns
        -------
        list of (int, float)
            Number of each segment, and the fraction at which the test function is closest to zero.
        """
        return near_zeros(values, lengths(points, scale)) if values.shape[1] else []

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the located events of this kind on a segment.

        Parameters
        ----------
        segment : Segment
            The segment.

        Returns
        -------
        list of LocatedEvent
            The events; empty if the test function does not change sign.
        """

        def test(point: CurvePoint) -> float:
            return self.test(build_point(segment.equations, point))

        return [locate_root(segment, self, test)] if test(segment.a) * test(segment.b) < 0 else []

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """Return the special point slightly beyond the last segment of a curve that no step can continue.

        Equations that are not smooth at a special point can prevent every step from reaching it.

        Parameters
        ----------
        segment : Segment
            The last segment.

        Returns
        -------
        LocatedEvent or None
            The special point; by default None.
        """
        return None

    def deviation(self, multipliers: ComplexArray) -> float:
        """Return the distance of multipliers from the values that the event requires.

        Parameters
        ----------
        multipliers : ndarray of complex, shape (r,)
            Multipliers of the point.

        Returns
        -------
        float
            The distance; by default 0, for events without such a requirement.
        """
        return 0.0

    def location_error(self, segment: Segment, location: RefinedLocation) -> float:
        """Return the error of the parameter value from that of the test function, in addition to the truncation.

        Parameters
        ----------
        segment : Segment
            Segment on which the point was found.
        location : RefinedLocation
            The point, with the problem that located it.

        Returns
        -------
        float
            The error; by default 0, for test functions that are known to rounding.
        """
        return 0.0

    def corner(
        self, problem: Any, parameter: str, X: Array, parameters: Mapping[str, float]
    ) -> MinimallyAugmentedProblem | None:
        """Return the equations of this event if it makes a corner of the curve at a solution; None (default) if not.

        A fold at a corner has these equations, because dR/dX is regular on both sides.
        """
        return None

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """Return the equations of the special point, with which it is located and followed in a second parameter.

        Parameters
        ----------
        problem : ContinuationProblem or object with ``evaluate``
            The problem.
        parameter : str
            Parameter of the curve.
        point : SpecialPoint
            The special point.

        Returns
        -------
        MinimallyAugmentedProblem or None
            The equations; None if there are none for this kind.

        Raises
        ------
        ValueError
            If the test function uses other data of a point than unknowns, parameters and problem, such as multipliers.
        """
        level = ScalarConditionProblem(problem, parameter, self.test, self.meaning)
        try:
            level.value(level.problem.join(point.X, point.parameters), point.parameters)
        except Exception as error:
            raise ValueError(
                f"the event '{self.kind}' cannot be followed: its test may use only the unknowns, parameters "
                f"and problem of a point ({type(error).__name__}: {error})"
            ) from error
        return level

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> NewBranch | None:
        """Return the problem and the start of another branch that leaves at a special point.

        Parameters
        ----------
        branch : Branch
            Traced branch.
        point : SpecialPoint
            Special point of this kind.
        side : {1, -1}
            Direction in which the other branch leaves.

        Returns
        -------
        (ContinuationProblem, BranchStart) or None
            Problem and start; by default None: no branch leaves.
        """
        return None

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        """Return status and message of a trace that ends at this event.

        Parameters
        ----------
        name : str
            Name of the continuation parameter.
        value : float
            Its value at the event.

        Returns
        -------
        (Status, str)
            Status and message.
        """
        return Status.EVENT, f"{self.meaning} at {name} = {value:.6g}"


class BuiltInEvent(Event):
    """Event whose kind, meaning and marker are those of its class, without a function of the user.

    By default it has no test function and no equations.
    """

    def __init__(self) -> None:
        """Keep the kind, the meaning and the marker of the class."""

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        return np.zeros((len(points), 0))

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return None


MARKERS = ".,ov^<>12348spP*hH+xXdD|_"
"""Markers of matplotlib that have one character."""


def is_marker(text: str) -> bool:
    """Return whether a text is one of the `MARKERS`."""
    return isinstance(text, str) and len(text) == 1 and text in MARKERS


RESERVED = (
    *("LP", "CP", "IC", "BP", "PD", "NS", "GR", "SL", "PK", "EP"),
    *("RI", "RII", "RIII", "RIV", "FF", "LPNS", "PDNS", "NSNS", "GPD"),
)
"""Kinds reserved by hbgear, which events of users cannot have."""


# ---- locating

MAX_FRACTION_BEYOND_END = 1e-6
"""Largest fraction of a segment by which a point may lie beyond its ends. Farther points are on another segment."""


ROUNDING_FRACTION = 1e-6
"""Distance from a root, as a fraction of the segment, within which the test function may be rounding error."""


SINGULAR_POINT_OFFSETS = 1e-5, 1e-4
"""Distances from a singular point, as fractions of the segment, at which both sides of it are evaluated."""


def locate_root(
    segment: Segment,
    event: Event,
    test: Callable[[CurvePoint], float],
    note: str = "",
    fine: float = 1e-13,
    first: float = math.nan,
) -> LocatedEvent:
    """Locate a special point as the bracketed root of a test function along a segment.

    ``fine`` is the tolerance of the root, as a fraction of the segment; at a fold, its square enters the parameter. The
    test function is evaluated at the fraction ``first`` at first, if that is not nan. If the corrector fails, the
    result is the end with the smaller test function, which is not located.
    """
    points: dict[float, CurvePoint] = {0.0: segment.a, 1.0: segment.b}
    values: dict[float, float] = {}

    def value(s: float) -> float:
        if s not in values:
            points[s] = points[s] if s in points else segment.at(s)
            values[s] = test(points[s])
        return values[s]

    def value_or_zero(s: float) -> float:
        """Return the test function; zero at a singular point with a sign change, which is the special point."""
        try:
            return value(s)
        except SOLVER_ERRORS:
            for offset in SINGULAR_POINT_OFFSETS:
                low, high = max(s - offset, 0.0), min(s + offset, 1.0)
                if value(low) * value(high) < 0:
                    weight = value(low) / (value(low) - value(high))
                    points[s], values[s] = _interpolated_point(segment, points[low], points[high], weight), 0.0
                    return 0.0
            raise

    try:
        root = find_root_bracketed(value_or_zero, 0.0, 1.0, fine, first)
        candidates = [x for x in values if abs(x - root) <= ROUNDING_FRACTION]
        s = min(candidates, key=lambda x: abs(values[x]))  # near a singular point the last value may be rounding error
        return LocatedEvent(event, s, points[s], True, note)
    except SEARCH_ERRORS:
        f0, f1 = abs(test(segment.a)), abs(test(segment.b))
        s = 0.0 if f0 < f1 else 1.0
        return LocatedEvent(event, s, points[s], False, note)


def _interpolated_point(segment: Segment, a: CurvePoint, b: CurvePoint, weight: float) -> CurvePoint:
    """Return the point between two close points by linear interpolation, where the equations are singular."""
    tangent = (1 - weight) * a.tangent + weight * b.tangent
    return singular(segment, (1 - weight) * a.u + weight * b.u, replace(a, tangent=tangent))


def singular(segment: Segment, u: Array, neighbour: CurvePoint) -> CurvePoint:
    """Return the point at u, where the equations are singular, with tangent and orientation of a point nearby."""
    point = solution_at(segment.problem, u, segment.name, segment.parameters)
    return CurvePoint(u, neighbour.tangent, neighbour.orientation, point.residual, point.iterations)


def locate_by_newton(
    segment: Segment,
    event: Event,
    extended: MinimallyAugmentedProblem,
    s: float,
    note: str = "",
    margin: float = MAX_FRACTION_BEYOND_END,
) -> LocatedEvent:
    """Locate a special point by Newton's method on its equations, from the fraction s of a segment.

    The point may lie beyond the ends by the fraction ``margin``, for equations that are more accurate than the test
    function. NoConvergence is raised if Newton's method fails or leaves the segment.
    """
    u = segment.guess(s)
    settings = replace(segment.settings, max_iterations=LOCATION_ITERATIONS)
    solution = extended.located(u, segment.parameters, settings)
    U = solution.X
    chord, fraction = (segment.b.u - segment.a.u) / segment.scale, segment.fraction_of(U)
    inside = -margin <= fraction <= 1 + margin
    if not inside or np.linalg.norm((U - u) / segment.scale) > (0.5 + margin) * np.linalg.norm(chord):
        raise NoConvergence("Newton's method left the segment", U, segment.parameters, [])
    return LocatedEvent(
        event, fraction, point_from_solution(on_curve(solution), chord / segment.scale, segment.scale), True, note
    )
