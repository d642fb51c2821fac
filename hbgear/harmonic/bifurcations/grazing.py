"""Grazing equations: an extremum of an element displacement reaches a breakpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.columns import monitored_values
from hbgear.continuation.events.event import Event, LocatedEvent, locate_by_newton, locate_root, singular
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem, linearise
from hbgear.continuation.problem.evaluation import AnyProblem, Locating
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.mechanics.series.fourier import waves


class GrazingProblem(MinimallyAugmentedProblem):
    """Grazing contacts (GR): an extremum of an element touches a breakpoint of its law.

        g = d(theta*) - breakpoint,   d'(theta*) = 0;   dg/dX is the row of cosines and sines at theta*

    Parameters
    ----------
    problem : HarmonicBalance or BackboneProblem
        The problem of the curve.
    parameter : str, optional
        The parameter of the curve, such as "Omega".
    which : int, optional
        Index into ``problem.clearance``: the extremum, the element and the breakpoint. The default is 0.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(), 8)
    >>> curve = hb.trace(pair, "Omega", (1.0, 0.6))
    >>> first = curve["GR1"]
    >>> few = hb.StepControl(max_points=4)
    >>> grazing = hb.trace(hb.harmonic.GrazingProblem(pair, "Omega", which=2), "zeta", (0.05, 0.06), start=first,
    ...     steps=few)
    >>> first.kind, bool(grazing.tracked["Omega"][0] == first.parameters["Omega"])
    ('GR', True)
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

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """Return the compiled locator of these equations; see `MinimallyAugmentedProblem.compiled`."""
        out: Locating | None = self.problem.compiled_locator(self.parameter, parameters, self.which)
        return out

    def base_at(self, X: Array, here: dict[str, float]) -> Borders:
        return Borders(linearise(self.problem, X, "", here).size / (1.0 + norm(X)))

    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the residual g and its derivatives; see `MinimallyAugmentedProblem.extra`."""
        now = linearise(self.problem, X, self.parameter, here)
        g, position = self.problem.grazing_distance(X, self.which, **here)
        element = self.problem.clearance_elements[self.which]
        w = waves(position, self.problem.H)[0, self.problem.orders]
        slope, rows = self._rows(len(X))
        rows[element, 0], rows[element, 1::2], rows[element, 2::2] = 1.0, w.real[1:], w.imag[1:]
        k = base.weight
        changes = (self._parameter_derivatives(X, here, name, now.dR_dX) for name in names)
        derivatives = tuple((dR, k * dg) for dR, dg in changes)
        return AugmentedResidual(
            now,
            k * g,
            k * slope,
            k * self._clearance_derivative(X, here, self.parameter, self.which),
            derivatives,
        )

    def _rows(self, size: int) -> tuple[Array, Array]:
        """Return zeros for all unknowns, and a view of the harmonics of the elements as rows (m, 2K + 1)."""
        m, K = self.problem.m, len(self.problem.orders)
        out = np.zeros(size)
        return out, out[: m * (2 * K - 1)].reshape(m, -1)

    def _parameter_derivatives(self, X: Array, here: dict[str, float], name: str, J: Array) -> tuple[Array, float]:
        """Return the derivatives of R and of the clearance in a parameter.

        Where a breakpoint moves away from a motion that grazes it, contact of the duration sqrt(h) begins or ends, and
        finite differences are exact to O(sqrt(h)) only. The motion is therefore moved together with the breakpoint, R_a
        = dR/da - J X_a, in every element that grazes.
        """
        dg = self._clearance_derivative(X, here, name, self.which)
        if not dg:
            return linearise(self.problem, X, name, here).dR_dp, dg
        (X_a, shift), elements = self._rows(len(X)), self.problem.clearance_elements
        for which in np.flatnonzero(
            np.abs(self.problem.clearance(X, **here)) < SIMULTANEOUS_GRAZING_CLEARANCE * (1.0 + norm(X))
        ):
            shift[elements[which], 0] = -self._clearance_derivative(X, here, name, int(which))
        value = here[name]
        (dR,) = parameter_derivatives(
            self.problem, name, here, lambda at: (self.problem.evaluate(X + (at[name] - value) * X_a, **at)[0],)
        )
        return dR - J @ X_a, dg

    def _clearance_derivative(self, X: Array, here: dict[str, float], name: str, which: int) -> float:
        """Return the derivative of a clearance in a parameter that moves the breakpoint."""
        if name == self.problem.usual_parameter:  # of the motion, not of the model
            return 0.0
        (derivative,) = parameter_derivatives(
            self.problem, name, here, lambda at: self.problem.grazing_distance(X, which, **at)[:1]
        )
        return float(derivative)


SIMULTANEOUS_GRAZING_CLEARANCE = 1e-7
"""Clearance, relative to the motion, up to which another element grazes at the same point."""


MAX_CONTACT_EXTRAPOLATION = 4.0
"""Lengths of the last segment within which a contact beyond it is searched."""


class GrazingEvent(Event):
    """Grazing contact: an extremum of an element passes a breakpoint of its law.

    Elements that graze at the same value of the parameter are one point.
    """

    kind, meaning, marker = "GR", "grazing contact: the impact regime changes", "x"

    def __init__(self) -> None:
        pass

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return the clearances at points where they are known."""
        found = [monitored_values(points, quantity) for quantity in ("clearance", "edge")]
        known = [values for values in found if values is not None]
        return np.concatenate(known, axis=1) if known else np.zeros((len(points), 0))

    def find(self, segment: Segment) -> list[LocatedEvent]:
        located: list[LocatedEvent] = []
        for event in (*self._clearances(segment), *self._edges(segment)):
            simultaneous = next((j for j, other in enumerate(located) if abs(other.s - event.s) < 1e-6), None)
            if simultaneous is None:
                located.append(event)
            else:
                located[simultaneous] = replace(
                    located[simultaneous], note=f"{located[simultaneous].note}, {event.note}"
                )
        return located

    def _clearances(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the zeros of the clearances of elements with one displacement."""
        clearances = monitored_values((segment.a, segment.b), "clearance")
        if clearances is None:
            return []
        before, after = clearances
        passed = np.flatnonzero(before * after < 0).tolist()
        return [self._locate(segment, i, float(before[i]), float(after[i])) for i in passed]

    def _edges(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the zeros of the extrema of the edges of vector laws as bracketed roots."""
        extremes = monitored_values((segment.a, segment.b), "edge")
        if extremes is None:
            return []
        problem: Any = segment.problem
        located = []
        for i in np.flatnonzero(extremes[0] * extremes[1] < 0).tolist():

            def test(point: CurvePoint, which: int = i) -> float:
                known = point.observed.get("edge")
                if known is None:
                    known = problem.edge_extremes(point.X, **{**segment.parameters, segment.name: point.value})
                return float(known[which])

            located.append(locate_root(segment, self, test, problem.edge_names[i]))
        return located

    def _locate(self, segment: Segment, which: int, before: float, after: float) -> LocatedEvent:
        """Locate the point by Newton's method on {R, extremum at the breakpoint}, or as a bracketed root."""
        problem: Any = segment.problem
        note = problem.clearance_names[which]

        def test(point: CurvePoint) -> float:
            known = point.observed.get("clearance")
            if known is None:
                known = problem.clearance(point.X, **{**segment.parameters, segment.name: point.value})
            return float(known[which])

        extended = GrazingProblem(problem, segment.name, which)
        with suppress(NoConvergence, np.linalg.LinAlgError):
            return locate_by_newton(segment, self, extended, before / (before - after), note)
        return locate_root(segment, self, test, note)

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """Return the contact that the clearances at both ends approach, by Newton's method from the end."""
        clearances = monitored_values((segment.a, segment.b), "clearance")
        if clearances is None:
            return None
        before, after = clearances
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = np.where(before * after > 0, after / (before - after), np.inf)
        distances[~(distances > 0)] = np.inf
        which = int(np.argmin(distances)) if distances.size else 0
        if not distances.size or distances[which] > MAX_CONTACT_EXTRAPOLATION:
            return None
        problem: Any = segment.problem
        extended = GrazingProblem(problem, segment.name, which)
        try:
            u = extended.located(segment.b.u, {**segment.parameters, segment.name: segment.b.value}).X
        except (NoConvergence, np.linalg.LinAlgError):
            return None
        s = segment.fraction_of(u)
        is_far = np.linalg.norm((u - segment.b.u) / segment.scale) > 2 * MAX_CONTACT_EXTRAPOLATION * segment.length
        point = replace(singular(segment, u, segment.b), parameter_direction=segment.b.parameter_direction)
        return None if is_far or s <= 1 else LocatedEvent(self, s, point, True, problem.clearance_names[which])

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        names, first = list(problem.clearance_names), point.note.split(", ")[0]
        return GrazingProblem(problem, parameter, names.index(first)) if first in names else None
