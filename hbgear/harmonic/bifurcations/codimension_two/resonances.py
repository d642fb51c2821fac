"""Resonances 1:1 and 1:2, at which curves of Neimark-Sacker points begin, and fold-flips."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.null_vectors import least_singular_vectors
from hbgear.continuation.curve.segment import BranchStart, NewBranch
from hbgear.continuation.numerics.linear import as_dense, bordered, norm
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, Solution, solve
from hbgear.harmonic.bifurcations.codimension_two.event import CodimensionTwoEvent
from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem, exponent_of_pair
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
from hbgear.harmonic.multipliers.hill import CondensedHillMatrix
from hbgear.mechanics.series.fourier import places, to_real


def hill_matrices(balance: Any, X: Array, parameters: Mapping[str, float], unknowns: Array) -> tuple[Array, Array]:
    """Return Hill's determinant D(0) and its derivative in the exponent, (k, k) each, for real coefficients.

    The disturbance of a motion X (n,) has the given unknowns (k,).
    """
    hill = CondensedHillMatrix.of(balance.compiled(parameters), X, parameters["Omega"])
    G, dG = hill.receptances(0.0)
    D, D_s = (
        _in_real_coefficients(matrix, balance.m, balance.orders)[np.ix_(unknowns, unknowns)]
        for matrix in (hill.matrix(G, 0.0), hill.rate(G, dG, 0.0))
    )
    return D, D_s


def _in_real_coefficients(matrix: ComplexArray, m: int, orders: Array) -> Array:
    """Return a matrix for coefficients -H..H of m elements as the matrix for real coefficients of some orders."""
    H = len(matrix) // m // 2
    rows = matrix.reshape(2 * H + 1, m, 2 * H + 1, m)[H:]
    above, below = rows[:, :, H:], rows[:, :, H::-1]
    image = np.empty_like(rows)
    image[:, :, 0] = above[:, :, 0]
    image[:, :, 1::2], image[:, :, 2::2] = 0.5 * (above + below)[:, :, 1:], 0.5j * (below - above)[:, :, 1:]
    image[1:] *= 2.0
    i = places(orders)
    real = to_real(image.transpose(1, 3, 2, 0))[..., i].transpose(0, 3, 1, 2)[..., i]  # row, column by element
    return real.reshape(m * len(i), -1)


def rate_of_exponent(D: Array, D_s: Array) -> float:
    """Return the derivative of det D(s) at s = 0, up to a positive factor, with a singular D: zero if it is double."""
    w, v = least_singular_vectors(D)
    return float(w @ D_s @ v) * border_sign(D, w, v)


def border_sign(A: Array, w: Array, v: Array) -> float:
    """Return the sign of the determinant of [A w; v^T 0]."""
    return float(np.linalg.slogdet(bordered(A, w, v))[0])


def _signed_singular_value(A: Array) -> float:
    """Return the smallest singular value relative to the largest, with the sign of the determinant."""
    s = scipy.linalg.svdvals(A)
    return float(np.linalg.slogdet(A)[0] * s[-1] / s[0])


class ResonanceEvent(CodimensionTwoEvent):
    """Double real multiplier on a curve of folds or period doublings, at which a curve of Neimark-Sacker points begins.

    Attributes
    ----------
    multiplier : {1, -1}
        The double multiplier.
    """

    multiplier: int

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> NewBranch | None:
        """Return a Neimark-Sacker point near the resonance, which does not depend on the side; None without one.

        It is searched near the points of the branch next to the resonance. On one side of it the pair is complex.
        """
        for distance, sign in product(range(1, MAX_NEIGHBOURS + 1), (1, -1)):
            i = point.index + sign * distance
            start = self._complex_pair_near(branch, i) if 0 <= i < len(branch) else None
            if start is not None:
                direction = np.zeros(len(start[1].X) + 1)
                direction[-1] = branch.values[i] - branch.values[point.index]
                return start[0], BranchStart(start[1].X, branch.parameters_at(i), direction, bifurcating=False)
        return None

    def _complex_pair_near(self, branch: Branch, i: int) -> tuple[NeimarkSackerProblem, Solution] | None:
        """Return a Neimark-Sacker point near point i of a branch, with its equations; None if the pair is real.

        The parameters have their values at point i, except the tracked one. On the curve of motions through point i,
        with tangent t, the sum of the two exponents is zero at the distance -f / (df/dt) from it, f the function of
        this event.
        """
        equations: Any = as_problem(branch.problem)
        balance, name, parameters = equations.problem, equations.parameter, branch.parameters_at(i)
        X = balance.from_point(branch[i])
        evaluation = balance.linearise(X, name, **parameters)
        t = scipy.linalg.svd(np.column_stack([as_dense(evaluation.dR_dX), evaluation.dR_dp]))[2][-1]
        h = DIFFERENCE_STEP * (norm(X) or 1.0)

        def point_at(distance: float) -> tuple[Array, dict[str, float]]:
            return X + distance * t[:-1], {**parameters, name: parameters[name] + distance * float(t[-1])}

        try:
            before, value, after = (type(self).function(equations, *point_at(distance)) for distance in (-h, 0.0, h))
            # Newton step along the curve of motions to the zero of the function
            distance = -2 * h * value / (after - before)
            nearby, changed = point_at(distance)
            mu = balance.multipliers(nearby, **changed)
            two = np.argsort(np.abs(mu - self.multiplier))[:2]
            s = exponent_of_pair(mu[two], balance.nu, changed["Omega"])
            if s is None:
                return None
            pair = NeimarkSackerProblem(balance, name, 1j * s.imag)
            fixed = {key: value for key, value in parameters.items() if key != name}
            solution = solve(pair, pair.join(nearby, changed), fixed)
        except SEARCH_ERRORS:
            return None
        return (pair, solution) if norm(pair.split(solution.X)[0] - nearby) <= abs(distance) else None


DIFFERENCE_STEP = 5e-3
"""Step of the differences of Jacobians, relative to the motion: the errors of fourth order and of rounding are 1e-8."""

MAX_NEIGHBOURS = 8
"""Points of a branch on each side of a resonance near which a complex pair of multipliers is searched."""


class FirstResonanceEvent(ResonanceEvent):
    """1:1 resonance on a curve of folds: a second multiplier is +1, and a curve of Neimark-Sacker points begins."""

    kind, meaning, marker, multiplier = "RI", "1:1 resonance: a double multiplier +1", "p", 1

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the derivative of the determinant in the exponent."""
        return rate_of_exponent(*hill_matrices(problem.problem, X, parameters, np.arange(len(X))))


class SecondResonanceEvent(ResonanceEvent):
    """1:2 resonance on a curve of period doublings: a second multiplier is -1."""

    kind, meaning, marker, multiplier = "RII", "1:2 resonance: a double multiplier -1", "h", -1

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the derivative of the determinant of the half-integer block in the exponent."""
        return rate_of_exponent(*hill_matrices(problem.doubled, problem.embed(X), parameters, problem.odd))


class FlipOnFoldEvent(CodimensionTwoEvent):
    """Fold-flip on a curve of folds: a multiplier passes -1."""

    kind, meaning, marker = "FF", "fold-flip: multipliers +1 and -1", "H"

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the smallest singular value of the half-integer block, with the sign of its determinant."""
        return _signed_singular_value(
            PeriodDoublingProblem(problem.problem, problem.parameter).matrix(X, parameters)[0]
        )


class FoldOnFlipEvent(CodimensionTwoEvent):
    """Fold-flip on a curve of period doublings: a multiplier passes +1."""

    kind, meaning, marker = "FF", FlipOnFoldEvent.meaning, FlipOnFoldEvent.marker

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the smallest singular value of dR/dX, with the sign of its determinant."""
        return _signed_singular_value(as_dense(problem.problem.linearise(X, "", **parameters).dR_dX))
