"""Grazing equations: an extremum of an element displacement reaches a breakpoint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import Segment
from hbgear.continuation.events.columns import monitored_values
from hbgear.continuation.events.event import LocatedEvent, singular
from hbgear.continuation.problem.evaluation import Locating
from hbgear.continuation.solvers.newton import SOLVER_ERRORS
from hbgear.harmonic.bifurcations.threshold import ThresholdEvent, ThresholdProblem


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

    quantity = "clearance"

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """Return the compiled locator of these equations; see `MinimallyAugmentedProblem.compiled`."""
        return self.problem.compiled_locator(self.parameter, parameters, self.which)

    def following(self, rows: Array, slope: Array) -> Array:
        """Return the constant and the scale of the element that grazes; see `ThresholdProblem.following`.

        The constant follows a breakpoint at zero, and both follow two breakpoints that are reached at once.
        """
        out = np.zeros((2, *rows.shape))
        grazing = slope.any(axis=1)
        out[0, grazing, 0] = 1.0
        out[1, grazing] = rows[grazing]
        return out


class InnerGrazingProblem(GrazingProblem):
    """Grazing contacts (GR) at another extremum than the highest and the lowest: one more contact in the period.

    Parameters are the same as for `GrazingProblem`; ``which`` is an index into the distances
    ``problem.threshold_distances("inner", X)``.
    """

    quantity = "inner"

    def compiled(self, parameters: Mapping[str, float]) -> None:
        """Return None: the compiled locator has the highest and lowest extremum only."""


class EdgeProblem(ThresholdProblem):
    """Grazing contacts (GR) of a vector law, such as a radial clearance: an extremum of an edge function is zero.

    Parameters are the same as for `ThresholdProblem`; ``which`` is an index into the distances
    ``problem.threshold_distances("edge", X)``.
    """

    quantity = "edge"


MAX_CONTACT_EXTRAPOLATION = 4.0
"""Lengths of the last segment within which a contact beyond it is searched."""


class GrazingEvent(ThresholdEvent):
    """Grazing contact: an extremum of an element passes a breakpoint of its law.

    Elements that graze at the same value of the parameter are one point.
    """

    kind, meaning, marker = "GR", "grazing contact: a contact begins or vanishes", "x"
    problems = (GrazingProblem, EdgeProblem, InnerGrazingProblem)

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """Return the contact that the clearances at both ends approach, by Newton's method from the end."""
        clearances = monitored_values((segment.a, segment.b), "clearance")
        if clearances is None:
            return None
        before, after = clearances
        with np.errstate(divide="ignore", invalid="ignore"):
            # linear extrapolation: lengths of the segment from its end to each contact
            distances = np.where(before * after > 0, after / (before - after), np.inf)
        distances[~(distances > 0)] = np.inf
        nearest = int(np.argmin(distances)) if distances.size else 0
        if not distances.size or distances[nearest] > MAX_CONTACT_EXTRAPOLATION:
            return None
        problem: Any = segment.problem
        extended = GrazingProblem(problem, segment.name, nearest)
        try:
            u = extended.located(segment.b.u, segment.parameters_at(segment.b.value)).X
        except SOLVER_ERRORS:
            return None
        s = segment.fraction_of(u)
        is_far = np.linalg.norm((u - segment.b.u) / segment.scale) > 2 * MAX_CONTACT_EXTRAPOLATION * segment.length
        point = replace(singular(segment, u, segment.b), parameter_direction=segment.b.parameter_direction)
        note = problem.threshold_names("clearance")[nearest]
        return None if is_far or s <= 1 else LocatedEvent(self, s, point, True, note)
