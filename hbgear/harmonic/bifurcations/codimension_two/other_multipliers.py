"""Curves of special points along which another multiplier passes the unit circle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, NewBranch, Segment
from hbgear.continuation.events.event import LocatedEvent, locate_root
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.stability import scaled_determinant, sign_of_pairs
from hbgear.continuation.solvers.newton import SEARCH_ERRORS
from hbgear.harmonic.bifurcations.codimension_two.event import CodimensionTwoEvent, other_curve
from hbgear.harmonic.bifurcations.codimension_two.pair_resonances import EXPONENT, angle_of_pair, exponent_at
from hbgear.harmonic.bifurcations.codimension_two.resonances import FlipOnFoldEvent, FoldOnFlipEvent
from hbgear.harmonic.bifurcations.multiplier_events import PAIR_LOCATION_TOLERANCE, refine_root
from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem, PairModulusProblem, exponent_of_pair
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
from hbgear.harmonic.multipliers.sampled_slopes import has_sampled_slopes


def has_exponents(balance: Any) -> bool:
    """Return whether Hill's determinant has the exponents of a motion: slopes of all laws are known."""
    return bool(balance.smooth and has_sampled_slopes(balance.compiled({})))


class OtherPairProblem(MinimallyAugmentedProblem):
    """Equations of a curve of special points, and Re s = 0 for the exponent s of another pair.

    Parameters
    ----------
    problem : FoldProblem, PeriodDoublingProblem or NeimarkSackerProblem
        Equations of the curve.
    parameter : str
        Parameter of the curve.
    near : complex
        Exponent near that of the other pair.
    """

    argument_names = ("near",)
    pair: NeimarkSackerProblem

    def __init__(self, problem: Any, parameter: str, near: complex) -> None:
        super().__init__(problem, parameter)
        self._fixed(near=near, pair=NeimarkSackerProblem(problem.problem, problem.parameter, near))

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        motion, values = self._motion(X, parameters)
        return self.pair.base_at(motion, values)

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the equations; see `MinimallyAugmentedProblem.extra`."""
        motion, values = self._motion(X, parameters)
        names = (self.parameter, *names)
        evaluation, rates = self.problem.linearised(X, names, **parameters)  # type: ignore[attr-defined]
        pair = self.pair.extra(motion, values, names, base)
        (_, g_p), *others = pair.derivatives
        derivatives = tuple((dR, dg) for dR, (_, dg) in zip(rates[1:], others, strict=True))
        return AugmentedResidual(
            evaluation._replace(dR_dp=rates[0]), pair.g, np.append(pair.g_X, pair.g_p), g_p, derivatives
        )

    def _motion(self, X: Array, parameters: dict[str, float]) -> tuple[Array, dict[str, float]]:
        """Return the motion and all parameters."""
        motion, unknown = self.problem.solution_of(X)  # type: ignore[attr-defined]
        return motion, {**parameters, **unknown}


class OtherMultiplierEvent(CodimensionTwoEvent):
    """Multipliers other than those of the point itself pass the unit circle along a curve of special points.

    own : real multiplier of the point itself, 0 for a complex pair.
    """

    regular_at_corners = True
    own = 0.0

    def _value(self, equations: CurveEquations, point: CurvePoint) -> float:
        """Return the test function of the other multipliers; zero within rounding, as without damping."""
        try:
            value = self._size(self._others(equations, point))
        except SEARCH_ERRORS:
            return math.nan
        return 0.0 if abs(value) < ROUNDING_OF_FACTOR else value

    def _others(self, equations: CurveEquations, point: CurvePoint) -> ComplexArray:
        """Return the multipliers without those of the point itself."""
        X, parameters = equations.solution_at(point.u)
        mu: ComplexArray = equations.problem.problem.multipliers(X, points=8, **parameters)
        for own in self._own(equations, point):
            mu = np.delete(mu, np.argmin(np.abs(mu - own)))
        return mu

    def _size(self, mu: ComplexArray) -> float:
        """Return the test function of multipliers (r,)."""
        return sign_of_pairs(mu)

    def _own(self, equations: CurveEquations, point: CurvePoint) -> tuple[complex, ...]:
        """Return the multipliers of the point itself: by default `own`, or those of its pair."""
        if self.own:
            return (self.own,)
        s = point.observed.get(EXPONENT) or exponent_at(equations, point, None)
        if s is None:
            return ()
        mu = np.exp(1j * angle_of_pair(equations, point, s))
        return complex(mu), complex(mu.conjugate())


class OtherPairEvent(OtherMultiplierEvent):
    """Another complex pair of multipliers passes the unit circle along a curve of special points.

    near : exponent of this pair, if it has been located already.
    """

    def __init__(self, near: complex | None = None) -> None:
        self.near = near

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the points at which the two multipliers of the zero are complex: neutral saddles are none."""

        def test(point: CurvePoint) -> float:
            return self._value(segment.equations, point)

        if not test(segment.a) * test(segment.b) < 0:
            return []
        rough, problem = locate_root(segment, self, test, fine=PAIR_LOCATION_TOLERANCE), segment.problem
        mu = self._others(segment.equations, rough.point)
        balance: Any = problem.problem  # type: ignore[attr-defined]
        Omega = segment.equations.solution_at(rough.point.u)[1]["Omega"]
        s = exponent_of_pair(mu, balance.nu, Omega)
        if s is None or abs(s.real) > MAX_RATE_OF_PAIR * Omega:
            return []
        rough = replace(rough, event=type(self)(s))
        equations = rough.event.equations(problem, segment.name, rough)
        return [rough if equations is None else refine_root(segment, rough, equations)]

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """Return the equations of the curve and of the pair; None for laws without slopes."""
        if self.near is None or not has_exponents(problem.problem):
            return None
        return OtherPairProblem(problem, parameter, self.near)

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> NewBranch | None:
        """Return the curve of Neimark-Sacker points of the other pair, in the direction of ``side``."""
        curve: Any = as_problem(branch.problem)
        equations = NeimarkSackerProblem if has_exponents(curve.problem) else PairModulusProblem
        return other_curve(branch, point, side, partial(equations, near=self.near))


class PairOnFoldEvent(OtherPairEvent):
    """Fold-Neimark-Sacker point on a curve of folds: a pair passes the unit circle."""

    kind, marker, own = "LPNS", "4", 1.0
    meaning = "fold-Neimark-Sacker: a multiplier +1 and a pair on the unit circle"


class PairOnFlipEvent(OtherPairEvent):
    """Flip-Neimark-Sacker point on a curve of period doublings: a pair passes the unit circle."""

    kind, marker, own = "PDNS", "3", -1.0
    meaning = "flip-Neimark-Sacker: a multiplier -1 and a pair on the unit circle"


class PairOnPairEvent(OtherPairEvent):
    """Double Neimark-Sacker point on a curve of Neimark-Sacker points: a second pair passes the unit circle."""

    kind, marker = "NSNS", "2"
    meaning = "double Neimark-Sacker: two pairs on the unit circle"


class MultiplierOnPairEvent(CodimensionTwoEvent):
    """Real multiplier that passes +1 or -1 on a curve of Neimark-Sacker points.

    Where the curve ends, its own pair has this value, and the sign of the function is rounding.
    """

    def find(self, segment: Segment) -> list[LocatedEvent]:
        ends = self.values((segment.a, segment.b), segment.equations)
        return super().find(segment) if np.abs(ends).min() > ROUNDING_OF_SINGULAR_VALUE else []


class FoldOnPairEvent(MultiplierOnPairEvent):
    """Fold-Neimark-Sacker point on a curve of Neimark-Sacker points: a multiplier passes +1."""

    kind, meaning, marker = PairOnFoldEvent.kind, PairOnFoldEvent.meaning, PairOnFoldEvent.marker
    function, other = staticmethod(FoldOnFlipEvent.function), FoldProblem


class FlipOnPairEvent(MultiplierOnPairEvent):
    """Flip-Neimark-Sacker point on a curve of Neimark-Sacker points: a multiplier passes -1."""

    kind, meaning, marker = PairOnFlipEvent.kind, PairOnFlipEvent.meaning, PairOnFlipEvent.marker
    function, other = staticmethod(FlipOnFoldEvent.function), PeriodDoublingProblem


class RealOnPairEvent(OtherMultiplierEvent):
    """Real multiplier that passes +1 or -1 on a curve of Neimark-Sacker points, for laws whose dR/dX may jump.

    Parameters
    ----------
    like : FoldOnPairEvent or FlipOnPairEvent
        The same point of other laws.
    multiplier : {1, -1}
        The real multiplier.
    """

    def __init__(self, like: type[CodimensionTwoEvent], multiplier: int) -> None:
        super().__init__()
        self.kind, self.meaning, self.marker, self.other = like.kind, like.meaning, like.marker, like.other
        self.multiplier = multiplier

    def _size(self, mu: ComplexArray) -> float:
        """Return the smallest distance from the multiplier, with the sign of the product of all differences."""
        return math.copysign(np.abs(mu - self.multiplier).min(), scaled_determinant(mu[None], self.multiplier)[0])


MAX_RATE_OF_PAIR = 1e-6
"""Rate of growth of a pair on the unit circle, over Omega, that is rounding of its location."""

ROUNDING_OF_FACTOR = 1e-9
"""Value of the test function of other multipliers, mu_i mu_j - 1 or mu -+ 1, up to which it is rounding."""

ROUNDING_OF_SINGULAR_VALUE = 1e-12
"""Smallest singular value of a matrix, over its largest one, up to which the matrix is singular."""
