"""Equations of motions at a threshold, at which the force laws change: a contact begins, or a slider begins to slip.

    R(X, p) = 0,   g(X, p) = 0           g: distance from the threshold

The residual R has a kink there: its derivatives on the two sides differ by a multiple of dg. Newton's method uses those
of either side, which agree in all directions along the threshold. In a further parameter, differences are therefore
taken with a motion that stays at the threshold.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import Event, LocatedEvent, locate_by_newton, locate_root
from hbgear.continuation.numerics.linear import norm, solve_linear
from hbgear.continuation.problem.base import linearise
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.solvers.newton import NoConvergence

SIMULTANEOUS_THRESHOLD = 1e-7
"""Distance from a threshold, relative to the motion, up to which another one is reached at the same point."""

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

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", which: int = 0) -> None:
        super().__init__(problem, parameter)
        self._fixed(which=which)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return (self.which,)

    @property
    def is_nonsmooth(self) -> bool:
        """True if the curve has corners: where a motion reaches another threshold too."""
        return bool(self.problem.is_nonsmooth)

    @abstractmethod
    def threshold(self, X: Array, which: int, here: Mapping[str, float]) -> tuple[float, Array]:
        """Return the distance g of a motion from a threshold, and its derivative in the elements, rows (m, 2K - 1)."""

    @abstractmethod
    def distances(self, X: Array, here: Mapping[str, float]) -> Array:
        """Return the distances of a motion from all thresholds."""

    def following(self, rows: Array, slope: Array) -> Array:
        """Return the change of a motion by which it follows its threshold, rows (m, 2K - 1); by default its scale.

        If displacements and threshold change by the same factor, contact and slip do not change anywhere.

        Parameters
        ----------
        rows : ndarray, shape (m, 2K - 1)
            The motion.
        slope : ndarray, shape (m, 2K - 1)
            Derivative of the distance from the threshold.

        Returns
        -------
        ndarray
            The change.
        """
        return np.where(np.any(slope, axis=1, keepdims=True), rows, 0.0)

    def base_at(self, X: Array, here: dict[str, float]) -> Borders:
        return Borders(linearise(self.problem, X, "", here).size / (1.0 + norm(X)))

    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the residual g and its derivatives; see `MinimallyAugmentedProblem.extra`."""
        now, k = linearise(self.problem, X, self.parameter, here), base.weight
        g, rows = self.threshold(X, self.which, here)
        changes = (self._parameter_derivatives(X, here, name, now.dR_dX) for name in names)
        derivatives = tuple((dR, k * dg) for dR, dg in changes)
        slope = np.append(rows, np.zeros(len(X) - rows.size))
        moved = self._threshold_derivative(X, here, self.parameter, self.which)
        return AugmentedResidual(now, k * g, k * slope, k * moved, derivatives)

    def _parameter_derivatives(self, X: Array, here: dict[str, float], name: str, J: Array) -> tuple[Array, float]:
        """Return the derivatives of R and of the distance in a parameter.

        Where the threshold moves away from a motion that has reached it, contact of the duration sqrt(h) begins or
        ends, or slip of the size h, and finite differences are wrong. The motion is therefore moved by X_a so that it
        stays at all thresholds that it has reached: R_a = dR/da - J X_a.
        """
        dg = self._threshold_derivative(X, here, name, self.which)
        if not dg:
            return linearise(self.problem, X, name, here).dR_dp, dg
        X_a = self._change_along_thresholds(X, here, name)
        value = here[name]
        (dR,) = parameter_derivatives(
            self.problem, name, here, lambda at: (self.problem.evaluate(X + (at[name] - value) * X_a, **at)[0],)
        )
        return dR - J @ X_a, dg

    def _change_along_thresholds(self, X: Array, here: dict[str, float], name: str) -> Array:
        """Return the change of a motion over a parameter by which it stays at all thresholds that it has reached."""
        reached = np.flatnonzero(np.abs(self.distances(X, here)) < SIMULTANEOUS_THRESHOLD * (1.0 + norm(X)))
        every = [self.which, *(i for i in reached.tolist() if i != self.which)]
        slopes = np.array([self.threshold(X, i, here)[1] for i in every])
        rows = X[: slopes[0].size].reshape(slopes[0].shape)
        directions = np.array([self.following(rows, slope) for slope in slopes])
        moves = np.array([self._threshold_derivative(X, here, name, i) for i in every])
        shares = np.linalg.lstsq(np.tensordot(slopes, directions, ((1, 2), (1, 2))), -moves)[0]
        return np.append(np.tensordot(shares, directions, 1), np.zeros(len(X) - rows.size))

    def direction(self, U: Array, **parameters: float) -> int:
        """Return the direction of a sweep that reaches a corner at which the curve turns back.

        The curve beyond the threshold has dX/dp = -(dR/dX)^-1 dR/dp, and is on the side of the corner on which g > 0.

        Parameters
        ----------
        U : ndarray, shape (n + 1,)
            Unknowns (X, p) of the corner.
        **parameters
            Values of the other parameters.

        Returns
        -------
        int
            +1 if solutions exist below the corner only, -1 if above; see `FoldProblem.direction`.
        """
        X, own = self.solution_of(U)
        here = {**parameters, **own}
        rows = self.threshold(X, self.which, here)[1]
        slope = np.append(rows, np.zeros(len(X) - rows.size))
        now = linearise(self.problem, X + SIDE_STEP * norm(X) / norm(slope) * slope, self.parameter, here)
        return 1 if float(slope @ solve_linear(now.dR_dX, now.dR_dp)) > 0 else -1

    def _threshold_derivative(self, X: Array, here: dict[str, float], name: str, which: int) -> float:
        """Return the derivative of a distance in a parameter that moves the threshold."""
        if name == self.problem.usual_parameter:  # of the motion, not of the model
            return 0.0
        (derivative,) = parameter_derivatives(self.problem, name, here, lambda at: (self.threshold(X, which, at)[0],))
        return float(derivative)


def locate_threshold(
    segment: Segment, event: Event, extended: ThresholdProblem, quantity: str, s: float, note: str,
    tolerance: float = 1e-13,
) -> LocatedEvent:  # fmt: skip
    """Locate a threshold on a segment by Newton's method on its equations, or else as a bracketed root.

    Parameters
    ----------
    segment : Segment
        Segment with a change of sign of the distance.
    event : Event
        Kind of special point.
    extended : ThresholdProblem
        Equations of the point.
    quantity : str
        Name of the distances among the quantities observed at points.
    s : float
        Fraction of the segment at which the iteration starts.
    note : str
        Remark for the user.
    tolerance : float, optional
        Tolerance of the bracketed root, as a fraction of the segment. The default is 1e-13.

    Returns
    -------
    LocatedEvent
        The special point.
    """

    def test(point: CurvePoint) -> float:
        known = point.observed.get(quantity)
        if known is None:
            known = extended.distances(point.X, {**segment.parameters, segment.name: point.value})
        return float(known[extended.which])

    with suppress(NoConvergence, np.linalg.LinAlgError):
        return locate_by_newton(segment, event, extended, s, note)
    return locate_root(segment, event, test, note, tolerance)
