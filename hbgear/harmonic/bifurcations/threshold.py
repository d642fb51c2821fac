"""Equations of motions at a threshold, at which the force laws change: a contact begins, or a slider begins to slip.

    R(X, p) = 0,   g(X, p) = 0           g: distance from the threshold

The residual R has a kink there: its derivatives on the two sides differ by a multiple of dg. Newton's method uses those
of either side, which agree in all directions along the threshold. In a further parameter, differences are therefore
taken with a motion that stays at the threshold.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.columns import monitored_values
from hbgear.continuation.events.event import BuiltInEvent, LocatedEvent, locate_by_newton, locate_root
from hbgear.continuation.numerics.linear import norm, solve_linear
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.solvers.newton import SOLVER_ERRORS

SIMULTANEOUS_THRESHOLD = 1e-7
"""Distance from a threshold, relative to the motion, up to which another one is reached at the same point."""

SAME_POINT_FRACTION = 1e-6
"""Fraction of a segment up to which several thresholds are reached at the same point."""

TWO_ENDS = ("clearance", "edge")
"""Kinds of thresholds whose distances are those of the lowest and of the highest extremum, one after the other."""

CORNER_DISTANCE = 1e-9
"""Distance from a threshold, relative to the motion, up to which a fold lies at it, a corner of the curve; such folds
are located to 1e-13 of a segment."""

SIDE_STEP = 1e-6
"""Change of a motion, relative to it, with which the derivatives of R beyond a threshold are evaluated."""


class ThresholdProblem(MinimallyAugmentedProblem):
    """Base class of the equations of motions at a threshold.

    Parameters
    ----------
    problem : HarmonicBalance or BackboneProblem
        The problem of the curve.
    parameter : str, optional
        The parameter of the curve, such as "Omega".
    which : int, optional
        Number of the threshold. The default is 0.
    """

    problem: Any  # a HarmonicBalance or BackboneProblem
    which: int

    quantity: ClassVar[str]
    """Name of the distances among the quantities observed at points."""

    argument_names = ("which",)

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", which: int = 0) -> None:
        super().__init__(problem, parameter)
        self._fixed(which=which)

    @property
    def is_nonsmooth(self) -> bool:
        """True if the curve has corners: where a motion reaches another threshold too."""
        return bool(self.problem.is_nonsmooth)

    def threshold(self, X: Array, number: int, parameters: Mapping[str, float]) -> tuple[float, Array]:
        """Return the distance g of a motion from a threshold, and its derivative in the elements, rows (m, 2K - 1)."""
        return self.problem.threshold(self.quantity, X, number, **parameters)

    def distances(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Return the distances of a motion from all thresholds."""
        return self.problem.threshold_distances(self.quantity, X, **parameters)

    def following(self, rows: Array, slope: Array) -> Array:
        """Return changes of a motion by which it can follow its thresholds, rows (D, m, 2K - 1); by default its scale.

        If displacements and threshold change by the same factor, contact and slip do not change anywhere. The motion
        and the derivative ``slope`` of the distance are rows (m, 2K - 1).
        """
        return np.where(np.any(slope, axis=1, keepdims=True), rows, 0.0)[None]

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        return Borders(self.problem.linearise(X, "", **parameters).size / (1.0 + norm(X)))

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the residual g and its derivatives; see `MinimallyAugmentedProblem.extra`."""
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        g, rows = self.threshold(X, self.which, parameters)
        derivatives = tuple(self._parameter_derivatives(X, parameters, name, evaluation.dR_dX) for name in names)
        slope = _padded(rows, len(X))
        derivative = self._threshold_derivative(X, parameters, self.parameter, self.which)
        return AugmentedResidual(evaluation, g, slope, derivative, derivatives)

    def _parameter_derivatives(
        self, X: Array, parameters: dict[str, float], name: str, J: Array
    ) -> tuple[Array, float]:
        """Return the derivatives of R and of the distance in a parameter.

        Where the threshold moves away from a motion that has reached it, contact of the duration sqrt(h) begins or
        ends, or slip of the size h, and finite differences are wrong. The motion is therefore moved by X_a so that it
        stays at all thresholds that it has reached: R_a = dR/da - J X_a.
        """
        dg = self._threshold_derivative(X, parameters, name, self.which)
        if not dg:
            return self.problem.linearise(X, name, **parameters).dR_dp, dg
        X_a = self._change_along_thresholds(X, parameters, name, dg)
        value = parameters[name]
        (dR,) = parameter_derivatives(
            self.problem, name, parameters, lambda p: (self.problem.evaluate(X + (p[name] - value) * X_a, **p)[0],)
        )
        return dR - J @ X_a, dg

    def _change_along_thresholds(self, X: Array, parameters: dict[str, float], name: str, dg: float) -> Array:
        """Return the change of a motion over a parameter by which it stays at all thresholds that it has reached.

        ``dg`` is the derivative of the own distance in the parameter.
        """
        reached = np.flatnonzero(np.abs(self.distances(X, parameters)) < SIMULTANEOUS_THRESHOLD * norm(X))
        simultaneous = [i for i in reached.tolist() if i != self.which]
        slopes = np.array([self.threshold(X, i, parameters)[1] for i in (self.which, *simultaneous)])
        rows = X[: slopes[0].size].reshape(slopes[0].shape)
        directions = np.concatenate([self.following(rows, slope) for slope in slopes])
        derivatives = np.array([dg, *(self._threshold_derivative(X, parameters, name, i) for i in simultaneous)])
        # there may be more directions than thresholds: the smallest change is used
        factors = np.linalg.lstsq(np.tensordot(slopes, directions, ((1, 2), (1, 2))), -derivatives)[0]
        return _padded(np.tensordot(factors, directions, 1), len(X))

    def direction(self, U: Array, **parameters: float) -> int:
        """Return the direction of a sweep that reaches a corner (X, p) at which the curve turns back.

        +1 if solutions exist below the corner only, -1 if above; see `FoldProblem.direction`. The curve beyond the
        threshold has dX/dp = -(dR/dX)^-1 dR/dp, and is on the side of the corner on which g > 0.
        """
        X, tracked = self.solution_of(U)
        values = {**parameters, **tracked}
        rows = self.threshold(X, self.which, values)[1]
        slope = _padded(rows, len(X))
        evaluation = self.problem.linearise(X + SIDE_STEP * norm(X) / norm(slope) * slope, self.parameter, **values)
        return 1 if float(slope @ solve_linear(evaluation.dR_dX, evaluation.dR_dp)) > 0 else -1

    def _threshold_derivative(self, X: Array, parameters: dict[str, float], name: str, number: int) -> float:
        """Return the derivative of a distance in a parameter that moves the threshold."""
        if name == self.problem.usual_parameter:  # of the motion, not of the model
            return 0.0
        (derivative,) = parameter_derivatives(
            self.problem, name, parameters, lambda p: (self.threshold(X, number, p)[0],)
        )
        return float(derivative)


def _padded(rows: Array, size: int) -> Array:
    """Return the rows of the elements as unknowns, with zeros for the further ones."""
    return np.append(rows, np.zeros(size - rows.size))


class ThresholdEvent(BuiltInEvent):
    """Base class of the events at which a motion reaches a threshold."""

    problems: ClassVar[tuple[type[ThresholdProblem], ...]]
    """Equations of each kind of threshold."""

    regular_at_corners = True

    root_tolerance: ClassVar[float] = 1e-13
    """Tolerance of a bracketed root, as a fraction of the segment; see `locate_root`."""

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        """Return the distances from the thresholds at points, nan where they are unknown."""
        monitored = [monitored_values(points, kind.quantity) for kind in self.problems]
        distances = [values for values in monitored if values is not None]
        return np.concatenate(distances, axis=1) if distances else np.zeros((len(points), 0))

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the zeros of all distances on a segment; an event names all thresholds that are reached at its point.

        A contact begins at all phases if the lowest and the highest distance from it are zero.
        """
        located: list[LocatedEvent] = []
        reached: list[set[tuple[type[ThresholdProblem], int]]] = []
        for event, kind, which in self._zeros(segment):
            for i, earlier in enumerate(located):
                if abs(earlier.s - event.s) < SAME_POINT_FRACTION:
                    both = kind.quantity in TWO_ENDS and (kind, which ^ 1) in reached[i]
                    note, at_all_phases = f"{earlier.note}, {event.note}", earlier.at_all_phases or both
                    located[i] = replace(earlier, note=note, at_all_phases=at_all_phases)
                    reached[i].add((kind, which))
                    break
            else:
                located.append(event)
                reached.append({(kind, which)})
        return located

    def _zeros(self, segment: Segment) -> Iterator[tuple[LocatedEvent, type[ThresholdProblem], int]]:
        for kind in self.problems:
            distances = monitored_values((segment.a, segment.b), kind.quantity)
            if distances is not None:
                before, after = distances
                for i in np.flatnonzero(before * after < 0).tolist():
                    equations = kind(segment.problem, segment.name, i)
                    yield self._located(segment, equations, float(before[i] / (before[i] - after[i]))), kind, i

    def _located(self, segment: Segment, equations: ThresholdProblem, s: float) -> LocatedEvent:
        """Locate a threshold by Newton's method from a fraction s of a segment, or else as a bracketed root."""
        problem: Any = segment.problem
        note = problem.threshold_names(equations.quantity)[equations.which]

        def test(point: CurvePoint) -> float:
            distances = point.observed.get(equations.quantity)
            if distances is None:
                distances = equations.distances(point.X, segment.parameters_at(point.value))
            return float(distances[equations.which])

        with suppress(*SOLVER_ERRORS):
            return locate_by_newton(segment, self, equations, s, note)
        return locate_root(segment, self, test, note, self.root_tolerance)

    def corner(
        self, problem: Any, parameter: str, X: Array, parameters: Mapping[str, float]
    ) -> MinimallyAugmentedProblem | None:
        """Return the equations of a threshold that a motion reaches, else None; see `Event.corner`.

        dR/dX jumps where a slider begins to slip and where a clipped contact damper begins to act.
        """
        for kind in self.problems:
            distances = np.abs(kind(problem, parameter).distances(X, parameters))
            if distances.size and distances.min() <= CORNER_DISTANCE * norm(X):
                return kind(problem, parameter, int(np.argmin(distances)))
        return None

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        for kind in self.problems:
            for i, name in enumerate(problem.threshold_names(kind.quantity)):
                if f"{point.note}, ".startswith(f"{name}, "):  # the first threshold that the note names
                    return kind(problem, parameter, i)
        return None
