"""Minimally augmented equations of special points: the equations of the solution and one scalar equation.

    R(X, p) = 0,   g(X, p) = 0           unknowns U = (X, p), p the parameter of the curve

The same Newton's method locates special points, and the same continuation traces them in a second parameter.

`FoldProblem`: g is the bordered determinant of A = dR/dX. With borders b and c that are not orthogonal to the null
vectors,

    [A    b] [v]   [0]            [A^T  c] [w]   [0]
    [c^T  0] [g] = [1]            [b^T  0] [g] = [1]

are regular where A is singular. By Cramer's rule g = det A / det [A b; c^T 0]. It is zero exactly where A is singular,
is as smooth as A, and has the derivative dg = -w^T dA v. In the notation of Govaerts (2000, ch. 3) b and c border the
matrix; v and w become its right and left null vectors. The borders are the left and right singular vectors of the
smallest singular value of A at one point (`ContinuationProblem.with_borders_at`). At this point g is the smallest
singular value with the sign of det A. A problem without fixed borders uses the borders of each point, and g is this
signed value everywhere. In both cases g does not depend on previous evaluations.

`ScalarConditionProblem`: g is any function of the point, with a gradient by central differences.

The derivative of g requires second derivatives of R in one direction only (`ContinuationProblem.curvature`).

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

import copy
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.special_point_problem import SpecialPointProblem
from hbgear.continuation.numerics.linear import Matrix, bordered, norm, solve_linear
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import Evaluation, Locating
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution, refine, solve

LOCATION_ITERATIONS = 5
"""Number of Newton iterations of a location, which starts close to the point; four times as many with damping.

Of 2 500 locations that converged in curves of eight random machines none took more than 19. The others took 48
iterations of 12 residuals each, and up to two thirds of the time of a curve.
"""

MAX_LOCATION_HALVINGS = 6
"""Largest number of halvings of a Newton step of a location. With more of them 0.5 % more locations converge."""


class AugmentedResidual(NamedTuple):
    """Values and derivatives of the augmented equations.

    ``evaluation`` holds R with its derivatives in X and p. g is the added equation, with gradient g_X (n,) in X and
    derivative g_p. ``derivatives`` are those of R and g in each requested further parameter. g and its derivatives
    are multiplied by `Borders.weight` later.
    """

    evaluation: Evaluation
    g: float
    g_X: Array
    g_p: float
    derivatives: tuple[tuple[Array, float], ...]


def parameter_derivative_and_jacobian(
    problem: ContinuationProblem, X: Array, parameters: Mapping[str, float], name: str
) -> tuple[Array, Matrix]:
    """Return the derivatives of R and dR/dX in a parameter, by finite differences."""
    perturbed, step = problem.perturbed(parameters, 2), problem.difference_step(X, parameters)
    dR, dJ = parameter_derivatives(problem, name, parameters, lambda values: perturbed.evaluate(X, **values), step)
    return dR, dJ


@dataclass(frozen=True)
class Borders:
    """Fixed data of the added equation: borders b and c, None without, and the weight that gives g the size of R."""

    weight: float
    b: Array | None = None
    c: Array | None = None


class MinimallyAugmentedProblem(SpecialPointProblem):
    """Base class of equations of special points: one more unknown and one more equation.

    Parameters and errors: see `SpecialPointProblem`.
    """

    base: Borders | None = None
    argument_names: ClassVar[tuple[str, ...]] = ()
    """Names of the attributes that the constructor takes after problem and parameter."""

    # ---- the added equation

    @abstractmethod
    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return R and g at X (n,) and all parameters, with derivatives in the further parameters ``names``."""

    @abstractmethod
    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        """Return the borders defined by a point itself."""

    def with_borders_at(self, U: Array, parameters: Mapping[str, float], renew: bool = False) -> Self:
        """Return the problem with the borders of the point U = (X, p); itself if it has borders and ``renew`` is False.

        If `problem` consists of equations of special points too, its borders are fixed as well. Otherwise the signs of
        its null vectors could differ between the two points of a finite difference.
        """
        X, unknown = self.solution_of(U)
        values = {**parameters, **unknown}
        inner = self.problem.with_borders_at(X, values, renew)
        out, base = copy.copy(self), self.base
        out._fixed(problem=inner)
        if base is None:
            base = out.base_at(X, values)
        elif renew:
            base = out.update_borders(base, X, values)
        if inner is self.problem and base is self.base:
            return self
        out._fixed(base=base)
        return out

    def update_borders(self, base: Borders, X: Array, parameters: dict[str, float]) -> Borders:
        """Return borders for points near X that keep the weight and the sign of g."""
        return base

    # ---- locating

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """Return a compiled Newton iteration for these equations; by default None."""
        return None

    def located(
        self,
        U: Array,
        parameters: Mapping[str, float],
        settings: NewtonSettings = NewtonSettings(max_iterations=LOCATION_ITERATIONS),
    ) -> Solution:
        """Locate the special point near U = (X, p) by Newton's method, with one more iteration after convergence.

        NoConvergence or LinAlgError is raised if the iteration does not converge.
        """
        compiled = self.compiled(parameters)
        if compiled is None:
            problem = self.with_borders_at(U, parameters)
            solution = solve(problem, U, parameters, settings=settings, max_halvings=MAX_LOCATION_HALVINGS)
            return refine(problem, solution, parameters)
        U, R, A = np.array(U), np.empty(len(U)), np.empty((len(U), len(U)))
        steps, size = compiled(U, 0, settings.tolerance, 4 * settings.max_iterations, R, A)
        if steps < 0:
            raise NoConvergence("Newton's method found no special point", U, parameters, [norm(R) / size])
        return Solution(U, math.nan, Evaluation(R, A, np.zeros(len(U)), size), steps, norm(R) / size)

    def stepped(self, U: Array, parameters: Mapping[str, float], steps: int) -> tuple[Self, Array]:
        """Apply a fixed number of undamped Newton steps to a guess U = (X, p).

        Returns
        -------
        problem : MinimallyAugmentedProblem
            The problem with borders at U, if it needs borders.
        U : ndarray, shape (n + 1,)
            Last iterate, converged or not.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the equations are singular.
        """
        compiled = self.compiled(parameters)
        if compiled is None:
            problem = self.with_borders_at(U, parameters)
            for _ in range(steps):
                evaluation = problem.linearise(U, "", **parameters)
                U = U - solve_linear(evaluation.dR_dX, evaluation.R)
            return problem, U
        U = np.array(U)
        if compiled(U, steps, math.nan, steps, np.empty(len(U)), np.empty((len(U), len(U))))[0] < 0:
            raise np.linalg.LinAlgError("singular matrix")
        return self, U

    # ---- as a problem

    def events(self, parameter: str) -> tuple[Any, ...]:
        """Return the points of codimension two along a curve of special points."""
        return self.problem.codimension_two_events(self)

    @property
    def refined_problem(self) -> Self | None:
        """The equations of the refined problem."""
        finer = self.problem.refined_problem
        return None if finer is None else self.for_problem(finer)

    @property
    def comparisons(self) -> Sequence[tuple[ContinuationProblem, float]]:
        """The equations of the problems for comparisons, with their weights."""
        return tuple((self.for_problem(problem), weight) for problem, weight in self.problem.comparisons)

    def for_problem(self, problem: ContinuationProblem) -> Self:
        """Return these equations for another problem."""
        return type(self)(problem, self.parameter, *(getattr(self, name) for name in self.argument_names))

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return {R, g} (n + 1,), its Jacobian and its derivative in a further parameter.

        The argument X holds the unknowns (X, p).
        """
        evaluation, derivatives = self.linearised(X, (name,) if name else (), **parameters)
        return evaluation._replace(dR_dp=derivatives[0]) if name else evaluation

    def linearised(self, X: Array, names: Sequence[str], **parameters: float) -> tuple[Evaluation, Array]:
        """Return {R, g} with its Jacobian, and the derivatives (A, n + 1) of {R, g} in A further parameters."""
        X, unknown = self.solution_of(X)
        values = {**parameters, **unknown}
        base = self.base or replace(self.base_at(X, values), weight=1.0)
        extra, k = self.extra(X, values, names, base), base.weight
        R, dR_dX, dR_dp, size = extra.evaluation
        derivatives = np.array([np.append(dR, k * dg) for dR, dg in extra.derivatives]).reshape(len(names), len(X) + 1)
        J = bordered(dR_dX, dR_dp, k * extra.g_X, k * extra.g_p)
        return Evaluation(np.append(R, k * extra.g), J, np.zeros(len(X) + 1), size), derivatives
