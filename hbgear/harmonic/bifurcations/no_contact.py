"""Motions without contact, whose position in the gap is arbitrary.

    dR/dd_0 N = 0:   d and d + N a are motions,    R + k N N^T (d_0 - c) = 0  has the one with its mean in the middle c

Where no load presses teeth together and nothing makes them touch, no force depends on the means of the gaps. The means
form a continuum, along which a continuation would drift. Everything else of the motion is determined. Springs on the
means fix them, and exert no force on the computed motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import Segment
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.results.status import Status
from hbgear.harmonic.bifurcations.grazing import GrazingEvent


class Pins(NamedTuple):
    """Springs on the means of the elements: matrix (m, m) of stiffness, and centre (m,) where they exert no force."""

    matrix: Array
    centre: Array


MAX_RELATIVE_MEAN_STIFFNESS = 1e-9
"""Change of the balance with a mean, relative to the reference stiffness, that is attributed to rounding."""


MAX_RELATIVE_RESIDUAL = 1e-9
"""Residual of a motion without contact, relative to the reference stiffness times its size, that is attributed to the
contact of a computed motion which touches the edge of its gap."""


def pins_of(problem: Any, X: Array, parameters: Mapping[str, float]) -> Pins | None:
    """Return the springs for a motion X (n,) of a `HarmonicBalance` in an arbitrary position, else None.

    A computed motion may touch the edge of its gap by less than the tolerance of the residual: it is in an arbitrary
    position if it is a motion in the middle of the gap too.
    """
    compiled = problem.compiled(parameters)
    kr = float(compiled.structure.kr.max(initial=0.0))
    if not kr or problem.subharmonic_part(X).any():
        return None
    centre = np.array([_middle(law.breakpoints, row) for law, row in zip(compiled.laws, problem.rows(X), strict=True)])
    free = _free_means(problem, X, parameters, kr)
    if not free.size:
        middle = X.copy()
        middle[problem.means] = centre
        free = _free_means(problem, middle, parameters, kr)
        if not free.size:
            return None
        middle[problem.means] = X[problem.means] + free @ (free.T @ (centre - X[problem.means]))
        residual = np.abs(problem.evaluate(middle, **parameters)[0]).max()
        if residual > MAX_RELATIVE_RESIDUAL * kr * np.abs(X).max():
            return None
    return Pins(kr * free @ free.T, centre)


def _free_means(problem: Any, X: Array, parameters: Mapping[str, float], kr: float) -> Array:
    """Return the directions (m, f) of the means of the elements on which the balance does not depend at X."""
    J = problem.evaluate(X, **parameters)[1]
    _, s, vt = np.linalg.svd(J[:, problem.means], full_matrices=False)
    return vt[s <= MAX_RELATIVE_MEAN_STIFFNESS * kr].T


def _middle(breakpoints: tuple[float, ...], row: Array) -> float:
    """Return the middle of the gap in which a motion has its mean; the mean itself if the gap has one side only."""
    mean = float(row[0])
    below, above = [x for x in breakpoints if x < mean], [x for x in breakpoints if x >= mean]
    return 0.5 * (max(below) + min(above)) if below and above else mean


class FirstContact(GrazingEvent):
    """First contact of a motion in the middle of its gap with a breakpoint; beyond it its position is determined."""

    meaning, terminal = "first contact", True

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the first grazing, at points whose clearance may be unknown."""
        problem: Any = segment.problem
        for point in (segment.a, segment.b):
            if "clearance" not in point.observed:
                parameters = segment.parameters_at(point.value)
                point.observed.setdefault("clearance", problem.clearance(point.X, **parameters))
        return super().find(segment)

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        """Return the status and message of a trace that ends there."""
        return Status.EVENT, f"{self.meaning} at {name} = {value:.6g}"


ARBITRARY = "no contact: the position in the gap is arbitrary, here its middle; the rest of the motion is determined"
"""The message of such a curve."""
