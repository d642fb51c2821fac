"""Grazing equations: an extremum of an element displacement reaches a breakpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.columns import monitored_values
from hbgear.continuation.events.event import Event, LocatedEvent, singular
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import Locating
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.bifurcations.threshold import ThresholdProblem, locate_threshold
from hbgear.harmonic.equations.thresholds import basis_values


class GrazingProblem(ThresholdProblem):  # numpydoc ignore=PR02
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

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """Return the compiled locator of these equations; see `MinimallyAugmentedProblem.compiled`."""
        out: Locating | None = self.problem.compiled_locator(self.parameter, parameters, self.which)
        return out

    def threshold(self, X: Array, which: int, here: Mapping[str, float]) -> tuple[float, Array]:
        """Return the distance of an extremum from a breakpoint and its derivative; see `ThresholdProblem.threshold`."""
        g, theta = self.problem.grazing_distance(X, which, **here)
        rows = np.zeros((self.problem.m, 2 * len(self.problem.orders) - 1))
        rows[self.problem.clearance_elements[which]] = basis_values(theta, self.problem.orders)
        return g, rows

    def following(self, rows: Array, slope: Array) -> Array:
        """Return the constant of the element that grazes; see `ThresholdProblem.following`."""
        out = np.zeros_like(rows)
        out[slope.any(axis=1), 0] = 1.0
        return out

    def distances(self, X: Array, here: Mapping[str, float]) -> Array:
        """Return the distances of all extrema from the breakpoints."""
        out: Array = self.problem.clearance(X, **here)
        return out


class EdgeProblem(ThresholdProblem):  # numpydoc ignore=PR02
    """Grazing contacts (GR) of a vector law, such as a radial clearance: an extremum of an edge function is zero.

    Parameters
    ----------
    problem : HarmonicBalance or BackboneProblem
        The problem of the curve.
    parameter : str, optional
        The parameter of the curve, such as "Omega".
    which : int, optional
        Index into ``problem.edge_extremes``. The default is 0.
    """

    def threshold(self, X: Array, which: int, here: Mapping[str, float]) -> tuple[float, Array]:
        """Return an extremum of an edge function and its derivative; see `ThresholdProblem.threshold`."""
        out: tuple[float, Array] = self.problem.edge_threshold(X, which, **here)
        return out

    def distances(self, X: Array, here: Mapping[str, float]) -> Array:
        """Return the extrema of all edge functions."""
        out: Array = self.problem.edge_extremes(X, **here)
        return out


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
            before, after = float(extremes[0][i]), float(extremes[1][i])
            extended = EdgeProblem(problem, segment.name, i)
            located.append(
                locate_threshold(segment, self, extended, "edge", before / (before - after), problem.edge_names[i])
            )
        return located

    def _locate(self, segment: Segment, which: int, before: float, after: float) -> LocatedEvent:
        """Locate the zero of a clearance."""
        problem: Any = segment.problem
        extended, note = GrazingProblem(problem, segment.name, which), problem.clearance_names[which]
        return locate_threshold(segment, self, extended, "clearance", before / (before - after), note)

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
        first = point.note.split(", ")[0]
        for equations, names in ((GrazingProblem, problem.clearance_names), (EdgeProblem, problem.edge_names)):
            if first in names:
                return equations(problem, parameter, names.index(first))
        return None
