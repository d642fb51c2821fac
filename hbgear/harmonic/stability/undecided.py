"""Undecided points: their stability from exact motions, or from motions with more harmonics.

Exact motions are computed first if all laws are piecewise linear with constant stiffness. Where a stiffness varies over
the period they take a hundred times as long: they are computed last, and only for small structures. With other laws
there are none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.refinement import nearest_solution
from hbgear.continuation.numerics.linear import norm, solve_linear
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, SOLVER_ERRORS, NoConvergence, solve
from hbgear.harmonic.instants.equations import NotPiecewiseLinear
from hbgear.harmonic.multipliers.multiplier_error import count_beyond, difference_of, estimate_multiplier_error
from hbgear.harmonic.stability.exact_motion import refine_motion
from hbgear.harmonic.stability.parity import Parity
from hbgear.harmonic.stability.second_set import second_set

MAX_REFINEMENTS = 3
"""Number of times that the harmonics are doubled at an undecided point."""

EXACT_MOTION_COST = 5
"""Least cost of an exact motion, in solutions with the states of the structure as unknowns."""

FAILED_MOTION_COST = 60
"""Additional cost where Newton's method does not converge, or only with Omega as an unknown."""

MAX_EXACT_DISTANCE = 0.02
"""Distance of the exact motion from the solution of the balance, relative to its size, up to which both are the same.
"""

EXACT_MULTIPLIER_ERROR = 1e-7
"""Error of multipliers of exact motions."""

MAX_EXACT_COORDINATES = 2
"""Coordinates of a structure up to which exact motions with varying stiffness are computed."""

REFINED_ERROR_RATIO = 1 / 3
"""Error with 2H harmonics over its change from H to 2H, for errors of order H^-2.

The difference with and without the excited harmonics changes its sign along a curve, so it alone may vanish by chance.
"""

STEPS_ALONG_CURVE = 2
"""Number of steps from a refined motion to the parameter value of its point; one is too long on the steepest curves."""

MAX_CORRECTION = 0.05
"""Distance of a motion from its prediction, relative to its size, up to which it lies on the curve.

The motion is predicted by the tangent, or by the one with fewer harmonics.
"""


def largest_modulus(mu: ComplexArray) -> Any:
    """Return the largest modulus of multipliers (..., r)."""
    return np.abs(mu).max(axis=-1, initial=0.0)


class Stability(NamedTuple):
    """Multipliers (r,) of a motion, the error of their largest modulus, and whether they pass all checks."""

    multipliers: ComplexArray
    error: float
    consistent: bool

    @property
    def determined(self) -> bool:
        """Whether the stability is determined."""
        return self.consistent and abs(float(largest_modulus(self.multipliers)) - 1.0) > self.error

    @property
    def stated_error(self) -> float:
        """The error; it reaches the unit circle if a check failed."""
        if self.consistent:
            return self.error
        return max(self.error, 1.01 * abs(float(largest_modulus(self.multipliers)) - 1.0), 2.0 * STABILITY_TOLERANCE)


@dataclass(frozen=True)
class UndecidedPoint:
    """Point of a curve whose multipliers do not decide its stability.

    Attributes
    ----------
    name : str
        Parameter of the curve.
    parameters : mapping of str to float
        All parameters.
    stability : Stability
        Stability that is known so far.
    expected : int
        Parity of the real multipliers beyond +1 on its side of a fold: +1 even, -1 odd, 0 unknown.
    work : Work
        Limit of the work.
    """

    name: str
    parameters: Mapping[str, float]
    stability: Stability
    expected: int
    work: Work

    def refined(self, problem: Any, X: Array, more_harmonics: bool) -> Stability:
        """Return the stability of a refined motion near X (n,); more_harmonics : whether more of them may be used."""
        constant = has_constant_stiffness(problem, self.parameters)
        if constant:
            exact = self.exact(problem, X)
            if exact is not None:
                return exact if exact.consistent else self._exact_from_finer(problem, X) or exact
        stability = self.stability
        if more_harmonics:  # many harmonics gain little where Newton's method in the contact instants fails
            stability = self._with_more_harmonics(problem, X, 1 if constant else MAX_REFINEMENTS)
        if constant or stability.determined or problem.compiled(self.parameters).structure.n > MAX_EXACT_COORDINATES:
            return stability
        return replace(self, stability=stability).exact(problem, X) or stability

    def exact(self, problem: Any, X: Array) -> Stability | None:
        """Return the stability of the exact motion next to a motion X (n,); None if it cannot be computed.

        It counts as one small solution for each contact instant, and as more of them if Newton's method fails.

        Where there is no exact motion at this Omega, the nearest one is used if it lies on the same side of a fold. A
        motion of another parity than the expected one is not consistent. Next to the grazing of a hard stop the
        multipliers may be far from +1 on both sides of a fold.
        """
        compiled = problem.compiled(self.parameters)
        try:
            compiled.contact_equations  # noqa: B018  raises NotPiecewiseLinear
            states = 2 * compiled.structure.n + 1
            if not self.work.verifies(states, max(EXACT_MOTION_COST, len(compiled.crossings(X).theta))):
                return None
            try:
                exact = refine_motion(problem, X, self.parameters)
            except NoConvergence:
                self.work.verifies(states, FAILED_MOTION_COST)
                if self.name != "Omega":
                    return None
                exact = refine_motion(problem, X, self.parameters, free=True)
        except (*SOLVER_ERRORS, NotPiecewiseLinear):
            return None
        if exact.distance > MAX_EXACT_DISTANCE:
            return None
        mu = np.zeros(len(self.stability.multipliers), dtype=complex)
        count = min(len(mu), len(exact.multipliers))
        mu[:count] = exact.multipliers[:count]
        other_fold_side = bool(self.expected) and self.expected != _parity_beyond_one(mu)
        error = EXACT_MULTIPLIER_ERROR
        if exact.Omega != self.parameters["Omega"]:
            error = max(error, abs(float(largest_modulus(mu) - largest_modulus(self.stability.multipliers))))
            if _parity_beyond_one(mu) < 0:  # unstable, however large the multiplier is
                error = min(error, 0.99 * float(largest_modulus(mu) - 1.0))
        return Stability(mu, error, not other_fold_side)

    def _exact_from_finer(self, problem: Any, X: Array) -> Stability | None:
        """Return the stability of the exact motion on the same side of a fold, from a solution with more harmonics.

        Next to a fold, Newton's method in the contact instants may converge to the motion on the other side. None if no
        number of harmonics gives a motion of the expected parity.
        """
        for _ in range(MAX_REFINEMENTS):
            finer = self._finer(problem)
            if finer is None:
                return None
            try:
                X, problem = solve(finer, finer.resized(X), dict(self.parameters)).X, finer
            except SEARCH_ERRORS:
                return None
            exact = self.exact(problem, X)
            if exact is not None and exact.consistent:
                return exact
        return None

    def _finer(self, problem: Any) -> Any:
        """Return the problem with twice the harmonics, or None without one within the limit of the work."""
        finer = problem.refined_problem
        return finer if finer is not None and self.work.allows(finer.equivalent_size) else None

    def _with_more_harmonics(self, problem: Any, X: Array, doublings: int) -> Stability:
        """Return the stability of the motion, or of the nearest one, with enough harmonics to determine it."""
        values, stability = dict(self.parameters), self.stability
        for _ in range(doublings):
            finer = self._finer(problem)
            if finer is None:
                break
            coarse = largest_modulus(stability.multipliers)
            try:
                X, values[self.name], stability = self._near(finer, finer.resized(X), values)
            except SEARCH_ERRORS:
                break
            problem = finer
            change = REFINED_ERROR_RATIO * abs(float(largest_modulus(stability.multipliers) - coarse))
            stability = stability._replace(error=max(stability.error, change))
            if stability.determined:
                break
        return stability

    def _near(self, problem: Any, guess: Array, parameters: Mapping[str, float]) -> tuple[Array, float, Stability]:
        """Return a motion next to a guess with its parameter value and its stability.

        Newton's method at the parameter value of the point takes half as long as steps of least norm from the guess.
        Next to a fold it may fail, or lead to the motion on the other side.
        """
        if self.expected:
            try:
                X = solve(problem, guess, dict(self.parameters)).X
                if norm(X - guess) <= MAX_CORRECTION * problem.solution_norm(X):
                    stability = self._at(problem, X, self.parameters)
                    if stability.consistent:
                        return X, self.parameters[self.name], stability
            except SEARCH_ERRORS:
                pass
        X, value = nearest_solution(problem, guess, self.name, parameters)
        X, value = self._at_fixed_parameter(problem, X, value)
        return X, value, self._at(problem, X, {**self.parameters, self.name: value})

    def _at(self, problem: Any, X: Array, parameters: Mapping[str, float]) -> Stability:
        """Return the multipliers of one motion with their error, and whether both determinants agree with them."""
        mu, value = problem.multipliers(X, **parameters), np.array([parameters[self.name]])
        motion = CurveSolutions(X[None], self.name, value, parameters)
        less_accurate = second_set(problem, motion)
        error = float(estimate_multiplier_error(mu[None], difference_of(mu[None], less_accurate))[0])
        parity = Parity.of(problem, motion)
        return Stability(mu, error, parity.agrees(problem, X, parameters, mu, self.expected))

    def _at_fixed_parameter(self, problem: Any, X: Array, value: float) -> tuple[Array, float]:
        """Return the motion at the parameter value of the point, if there is one next to a motion X at another value.

        Close to a fold, where there may be none, multipliers change so fast with the parameter that the small
        difference matters. The curve is followed from X by tangent and Newton's method. It may be so steep that the
        motion changes by a quarter of its size while the parameter changes by 2e-5, where Newton's method from X does
        not converge.
        """
        motion, values, name = X, dict(self.parameters), self.name
        change = self.parameters[name] - value
        try:
            for i in range(STEPS_ALONG_CURVE):
                values[name] = value + change * i / STEPS_ALONG_CURVE
                evaluation = problem.linearise(motion, name, **values)
                predicted = motion - solve_linear(evaluation.dR_dX, evaluation.dR_dp) * (change / STEPS_ALONG_CURVE)
                values[name] = value + change * (i + 1) / STEPS_ALONG_CURVE
                motion = solve(problem, predicted, values).X
                if not norm(motion - predicted) <= MAX_CORRECTION * problem.solution_norm(X):
                    return X, value
        except SEARCH_ERRORS:
            return X, value
        return motion, self.parameters[name]


def _parity_beyond_one(mu: ComplexArray) -> int:
    """Return +1 for an even number of real multipliers (r,) above +1, and -1 for an odd one."""
    return int(1 - 2 * (count_beyond(mu)[0] % 2))


def has_constant_stiffness(problem: Any, parameters: Mapping[str, float]) -> bool:
    """Return whether all laws are piecewise linear without memory, with a stiffness that does not vary."""
    compiled = problem.compiled(parameters)
    springs = [law.piecewise for law in compiled.laws]
    return not compiled.sliders and not any(
        law_springs is None or any(spring.stiffness.varies for spring in law_springs) for law_springs in springs
    )
