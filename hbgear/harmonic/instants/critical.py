"""Special points of curves of exact motions: test functions and their zeros.

    LP   component of the tangent in the parameter              PD   det(P + 1)
    NS   prod_{i<j} (mu_i mu_j - 1), complex multipliers        BP   det [F_u F_p; t^T]

P is the monodromy matrix, the product of the flows, with eigenvalues mu. Each function is computed from a corrected
point without truncation, and its zero is bracketed between two points of a curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.instants.corrector import CurveState, Family, correct, tangent_of
from hbgear.harmonic.instants.shooting import Linearisation

REAL_PAIR_TOLERANCE = 1e-6
"""Imaginary part up to which two multipliers of product one are a real pair and no Neimark-Sacker point."""

UNIT_CIRCLE_DISTANCE = 1e-6
"""Distance of the modulus of a located Neimark-Sacker pair from 1; rounding leaves 1e-10."""

EXACT_BRANCH_POINT_TOLERANCE = 1e-7
"""Fraction of a segment up to which a branch point is located; closer to it the equations are nearly singular."""


@dataclass(frozen=True, eq=False)
class ExactPoint:
    """Point of a curve: state, linearised equations, [F_u F_p], scales and unit tangent in scaled unknowns."""

    state: CurveState
    now: Linearisation
    J: Array
    scale: Array
    tangent: Array
    iterations: int = 0

    @cached_property
    def monodromy(self) -> Array:
        """Monodromy matrix (r, r) of the state."""
        P = self.now.flows[0]
        for flow in self.now.flows[1:]:
            P = flow @ P
        return P

    @cached_property
    def multipliers(self) -> ComplexArray:
        """Multipliers (r,), largest modulus first."""
        mu = np.linalg.eigvals(self.monodromy).astype(complex)
        return mu[np.argsort(-np.abs(mu), kind="stable")]

    @cached_property
    def tests(self) -> dict[str, float]:
        """Values of the test functions."""
        P, mu = self.monodromy, self.multipliers
        first, second = np.triu_indices(len(mu), 1)
        pairs = mu[first] * mu[second]
        return {
            "LP": float(self.tangent[-1]),
            "PD": float(np.linalg.slogdet(P + np.eye(len(P)))[0] * np.abs(mu + 1).min()),
            "NS": float(np.prod(pairs - 1).real) if len(mu) > 2 else 1.0,
            "BP": float(np.linalg.slogdet(np.vstack([self.J * self.scale, self.tangent]))[0])
            * float(np.linalg.svd(np.vstack([self.J * self.scale, self.tangent]), compute_uv=False)[-1]),
        }


def exact_point(family: Family, state: CurveState, row: Array, scale: Array, along: Array) -> ExactPoint:
    """Return the corrected point in the plane across ``row``, with its tangent in the direction of ``along``."""
    state, now, J, iterations = correct(family, state, row, scale)
    return ExactPoint(state, now, J, scale, tangent_of(J, scale, along), iterations)


def special_points(family: Family, a: ExactPoint, b: ExactPoint) -> list[tuple[str, float, ExactPoint]]:
    """Return the special points between two points of one pattern: kind, fraction of the segment, point."""
    found = []
    for kind, value in a.tests.items():
        if value * b.tests[kind] < 0:
            s, point = _locate(family, a, b, kind)
            if kind != "NS" or _is_complex_pair(point.multipliers):
                found.append((kind, s, point))
    return sorted(found, key=lambda one: one[1])


def _locate(family: Family, a: ExactPoint, b: ExactPoint, kind: str) -> tuple[float, ExactPoint]:
    """Return the zero of a test function between two points."""
    last: list[ExactPoint] = [a]

    def test(s: float) -> float:
        if s in (0.0, 1.0):
            return (b if s else a).tests[kind]
        last.append(point_between(family, a, b, s))
        return last[-1].tests[kind]

    tolerance = EXACT_BRANCH_POINT_TOLERANCE if kind == "BP" else 1e-13
    try:
        s = float(scipy.optimize.brentq(test, 0.0, 1.0, xtol=tolerance, rtol=1e-14, maxiter=60))
        return s, point_between(family, a, b, s)
    except NoConvergence:
        if kind != "BP" or len(last) < 2:
            raise
        return 0.5, min(last, key=lambda point: abs(point.tests["BP"]))


def point_between(family: Family, a: ExactPoint, b: ExactPoint, s: float) -> ExactPoint:
    """Return the point of the curve at a fraction of the chord between two points of one pattern."""
    scale = a.scale
    chord = (b.state.z - a.state.z) / scale
    length = float(np.linalg.norm(chord))
    row = chord / length
    ta, tb = (t * length / float(t @ row) for t in (a.tangent, b.tangent * b.scale / scale))
    bend = (ta - chord) * (1 - s) - (tb - chord) * s
    guess = a.state.moved(a.state.z + scale * (s * chord + s * (1 - s) * bend))
    return exact_point(family, guess, row, scale, row)


def _is_complex_pair(mu: ComplexArray) -> bool:
    """Return whether the multipliers nearest to the unit circle are a complex pair."""
    near = mu[np.argmin(np.abs(np.abs(mu) - 1))]
    return bool(abs(near.imag) > REAL_PAIR_TOLERANCE and abs(abs(near) - 1) < UNIT_CIRCLE_DISTANCE)
