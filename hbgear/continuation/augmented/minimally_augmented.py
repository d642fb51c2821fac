"""Special points as problems of their own: the equations of the solution and one more.

    R(X, p) = 0,   g(X, p) = 0           unknowns U = (X, p), p the parameter in which the curve was traced

so that the same Newton locates them and the same trace follows them in a second parameter.

`FoldProblem`: g is the bordered determinant of A = dR/dX. With borders b and c that are not orthogonal to the null
vectors,

    [A    b] [v]   [0]            [A^T  c] [w]   [0]
    [c^T  0] [g] = [1]            [b^T  0] [g] = [1]

are regular where A is singular, and by Cramer's rule g = det A / det [A b; c^T 0]: zero exactly where A is singular,
as smooth as A, and with the derivative dg = -w^T dA v. In the notation of Govaerts (2000, ch. 3) b and c border the
matrix, v and w are the vectors that become its right and left null vectors. The borders are those of one point
(`ContinuationProblem.with_borders_at`): the left and right singular vectors of its least singular value, so that there
g is that value
with the sign of det A. A problem without a base takes each point as its own, and g is this signed value everywhere.
Either way it depends on nothing that was asked before.

`ScalarConditionProblem`: g is any function of the point, its gradient by central differences.

The derivative of g needs second derivatives of R only in one direction (`problem.Curved`).

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
from typing import Any, NamedTuple, Self

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import Range
from hbgear.continuation.numerics.linear import (
    SMALL,
    Factors,
    Matrix,
    bordered,
    dense,
    norm,
    slogdet,
    solve_linear,
    solve_signed,
)
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, linearise
from hbgear.continuation.problem.evaluation import AnyProblem, Evaluation, Locating
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.layout import LayoutProtocol
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution, refine, solve


class AugmentedResidual(NamedTuple):
    """The equations of the solution and g, and their derivatives.

    now : R with its derivatives in X and p. g, g_X, g_p : g with its own. moved : derivatives of R and g in each of
    the further parameters that were asked for.
    """

    now: Evaluation
    g: float
    g_X: Array
    g_p: float
    moved: tuple[tuple[Array, float], ...]


def parameter_derivative_and_jacobian(
    problem: ContinuationProblem, X: Array, here: Mapping[str, float], name: str
) -> tuple[Array, Matrix]:
    """Derivatives of R and dR/dX in a parameter."""
    near = problem.beside(here, 2)
    dR, dJ = parameter_derivatives(problem, name, here, lambda at: near.evaluate(X, **at))
    return dR, dJ


@dataclass(frozen=True)
class Borders:
    """What the added equation refers to: its weight, which gives g the size of R, and the borders b and c, if any."""

    weight: float
    b: Array | None = None
    c: Array | None = None


class MinimallyAugmentedProblem(ContinuationProblem):
    """A problem with one more unknown parameter and one more equation; immutable.

    Parameters
    ----------
    problem : the problem whose special points are meant.
    parameter : the parameter of the curve they lie on; it becomes the last unknown. By default the problem's usual one.
    """

    smooth = False
    batch_size = 1  # special points of curves of special points take long to find: Ctrl-C waits for one row at most
    problem: ContinuationProblem
    parameter: str
    base: Borders | None = None

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "") -> None:
        problem = as_problem(problem)
        parameter = parameter or problem.usual_parameter
        if not parameter:
            raise ValueError(f"{type(self).__name__} needs the parameter of the curve its points lie on, such as 'p'")
        problem.check_parameter(parameter)
        self._fixed(problem=problem, parameter=parameter)

    def _fixed(self, **values: Any) -> None:
        """Attributes of a problem that is being made: the only way to set them."""
        vars(self).update(values)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__} cannot be changed; make another one with another {name}")

    # ---- the added equation

    @abstractmethod
    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """R and g at X with all parameters, and their derivatives, in further parameters too."""

    @abstractmethod
    def base_at(self, X: Array, here: dict[str, float]) -> Borders:
        """The base that a point is for itself."""

    def with_borders_at(self, U: Array, parameters: Mapping[str, float], renew: bool = False) -> Self:
        """The same problem with the base of the point U; as it is if it has one, unless that is to be renewed.

        The problem within, if it is one of special points too, is based likewise: null vectors are known but for their
        sign, which a base of its own at each end of a difference would turn.
        """
        X, own = self.split(U)
        here = {**parameters, **own}
        inner = self.problem.with_borders_at(X, here, renew)
        renewing = self.base is None or (renew and self.base.b is not None)
        if inner is self.problem and not renewing:
            return self
        out = copy.copy(self)
        out._fixed(problem=inner)
        if renewing:
            out._fixed(base=out.base_at(X, here) if self.base is None else out.renewed(self.base, X, here))
        return out

    def renewed(self, base: Borders, X: Array, here: dict[str, float]) -> Borders:
        """A base for points near X that keeps the weight and the sign of g."""
        return base

    # ---- locating

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """Newton on these equations without Python, if the problem has it."""
        return None

    def located(
        self, U: Array, parameters: Mapping[str, float], settings: NewtonSettings = NewtonSettings()
    ) -> Solution:
        """The special point near U by Newton, one step further than its tolerance asks for.

        Raises
        ------
        NoConvergence, numpy.linalg.LinAlgError
            If it does not converge.
        """
        compiled = self.compiled(parameters)
        if compiled is None:
            own = self.with_borders_at(U, parameters)
            return refine(own, solve(own, U, parameters, settings=settings), parameters)
        U, R, A = np.array(U), np.empty(len(U)), np.empty((len(U), len(U)))
        steps, size = compiled(U, 0, settings.tolerance, 4 * settings.max_iterations, R, A)
        if steps < 0:
            raise NoConvergence("Newton found no special point", U, parameters, [norm(R) / size])
        return Solution(U, math.nan, Evaluation(R, A, np.zeros(len(U)), size), steps, norm(R) / size)

    def stepped(self, U: Array, parameters: Mapping[str, float], steps: int) -> tuple[Self, Array]:
        """So many Newton steps from U, whatever they lead to, and the same problem with a base there, if it needs one.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the equations are singular.
        """
        compiled = self.compiled(parameters)
        if compiled is None:
            own = self.with_borders_at(U, parameters)
            for _ in range(steps):
                now = linearise(own, U, "", parameters)
                U = U - solve_linear(now.dR_dX, now.R)
            return own, U
        U = np.array(U)
        if compiled(U, steps, math.nan, steps, np.empty(len(U)), np.empty((len(U), len(U))))[0] < 0:
            raise np.linalg.LinAlgError("singular matrix")
        return self, U

    # ---- as a problem

    @property
    def arguments(self) -> tuple[Any, ...]:
        """What it was made with besides problem and parameter."""
        return ()

    @property
    def refined_problem(self) -> Self | None:
        """The same special points of the problem with more unknowns."""
        finer = self.problem.refined_problem
        return None if finer is None else type(self)(finer, self.parameter, *self.arguments)

    @property
    def comparisons(self) -> Sequence[tuple[ContinuationProblem, float]]:
        """The same special points of the problems that its solutions are compared with."""
        others = self.problem.comparisons
        return tuple((type(self)(other, self.parameter, *self.arguments), weight) for other, weight in others)

    def resized(self, X: Array) -> Array:
        """Unknowns (X, p) with the X of this problem."""
        return np.append(self.problem.resized(X[:-1]), X[-1])

    @property
    def unknown_parameters(self) -> tuple[str, ...]:  # type: ignore[override]
        """Parameters that are unknowns here."""
        return (self.parameter,)

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the problem."""
        return dict(self.problem.parameters)

    @property
    def size(self) -> int | None:  # type: ignore[override]
        """Number of unknowns; None if the problem does not say its own."""
        return None if self.problem.size is None else self.problem.size + 1

    @property
    def layout(self) -> LayoutProtocol | None:
        """How X, the solution's part of the unknowns, is to be read."""
        return self.problem.layout

    @property
    def singular_hint(self) -> str:  # type: ignore[override]
        return self.problem.singular_hint

    def describe(self) -> dict[str, Any]:
        """Header of a saved branch."""
        return {**self.problem.describe(), "curve": {"of": type(self).__name__, "in": self.parameter}}

    def check_parameter(self, name: str) -> None:
        """Refuse a parameter that is unknown to the problem or already an unknown."""
        if name == self.parameter:
            raise ValueError(
                f"a {type(self).__name__} in {name} cannot be followed in {name} again; choose a second parameter"
            )
        self.problem.check_parameter(name)

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """Nothing is said of curves of special points."""

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """As of the problem."""
        return self.problem.missing([*known, self.parameter])

    def range_of(self, name: str) -> Range:
        """Values a parameter may have."""
        return self.problem.range_of(name)

    def is_expensive(self, name: str) -> bool:
        """As of the problem."""
        return self.problem.is_expensive(name)

    def split(self, U: Array) -> tuple[Array, dict[str, float]]:
        """X of the problem and the parameter that belongs to it."""
        return U[:-1], {self.parameter: float(U[-1])}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Unknowns (X, parameter) of this problem.

        Raises
        ------
        ValueError
            If the motion has another number of harmonics.
        """
        size = self.problem.size
        if size is not None and len(X) != size:
            raise ValueError(
                f"the start has {len(X)} coefficients, this problem {size}: follow special points with the harmonics "
                "of the curve they are on, such as FoldProblem(curve.problem, 'Omega')"
            )
        return np.append(X, parameters[self.parameter])

    def from_point(self, point: Point) -> Array:
        """X of a point of another problem of the kind."""
        return self.problem.from_point(point)

    def solution_norm(self, U: Array) -> float:
        """Size of the solution, which scales the arclength."""
        return self.problem.solution_norm(U[:-1])

    def observe(self, X: Array, stability: bool = False, **parameters: float) -> dict[str, Any]:
        """Regime and error of the solution; X are the unknowns U = (X, p) here."""
        X, own = self.split(X)
        here = {**parameters, **own}
        seen = self.problem.observe_many(X[None], self.parameter, np.array([here[self.parameter]]), False, **{
            k: v for k, v in here.items() if k != self.parameter})[0]  # fmt: skip
        return {k: seen[k] for k in ("regime", "error") if k in seen}

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """{R, g} (n + 1,), its Jacobian in (X, p) and its derivative in a further parameter; X are U = (X, p) here."""
        now, moved = self.linearised(X, (name,) if name else (), **parameters)
        return now._replace(dR_dp=moved[0]) if name else now

    def linearised(self, X: Array, names: Sequence[str], **parameters: float) -> tuple[Evaluation, Array]:
        """As `linearise` without a name, and the derivatives (len(names), n + 1) of {R, g} in many parameters."""
        X, own = self.split(X)
        here = {**parameters, **own}
        extra = self.extra(X, here, names, self.base or replace(self.base_at(X, here), weight=1.0))
        J = bordered(extra.now.dR_dX, extra.now.dR_dp, extra.g_X, extra.g_p)
        moved = np.array([np.append(dR, dg) for dR, dg in extra.moved]).reshape(len(names), len(X) + 1)
        return Evaluation(np.append(extra.now.R, extra.g), J, np.zeros(len(X) + 1), extra.now.size), moved


def borders_of(A: Matrix) -> tuple[Array, Array, float]:
    """Borders b and c for a matrix that is nearly singular, and its size.

    The left and right singular vectors of the least singular value, of signs for which g has the sign of det A. Of a
    large or sparse matrix by inverse iteration, b ~ A^-T c and c ~ A^-1 b, each solved for in a bordered matrix, which
    is regular where A is not.
    """
    sign = -1.0 if slogdet(A)[0] > 0 else 1.0
    if dense(A) and len(A) <= SMALL:
        u, s, vt = scipy.linalg.svd(A)
        return sign * u[:, -1], vt[-1], float(s[0])
    b, c = least_singular_vectors(A)
    g = null_vectors(A, b, c)[2]
    return (-b if g * sign > 0 else b), c, float(abs(A).sum(axis=0).max())


def least_singular_vectors(A: Matrix, most: int = 200) -> tuple[Array, Array]:
    """Left and right singular vector of the least singular value of a matrix, whatever their signs.

    By inverse iteration, at most so many times: 200 are enough where two singular values differ by 5 %, a few near a
    fold. With A v = -g b and c^H v = 1, and x, s from the same bordered matrix with A x + s b = y and c^H x = 0,
    A (g x - s v) = g y: the direction of A^-1 y without division by g, which is zero where A is singular.
    """
    n = A.shape[0]
    first = np.random.default_rng(0).normal(size=(2, n))  # not orthogonal to the null vectors, whatever they are
    b, c = first[0] / norm(first[0]), first[1] / norm(first[1])
    lu = Factors(bordered(A, b, c))
    corner = np.zeros(n + 1)
    corner[-1] = 1.0
    right, left = lu.solve(corner), lu.adjoint_solve(corner)
    g = right[-1]
    for _ in range(most):
        x, y = lu.solve(np.append(b, 0.0)), lu.adjoint_solve(np.append(c, 0.0))
        new_c, new_b = g * x[:-1] - x[-1] * right[:-1], g.conj() * y[:-1] - y[-1] * left[:-1]
        new_b, new_c = new_b / norm(new_b), new_c / norm(new_c)
        turned = max(1.0 - abs(np.vdot(new_b, b)), 1.0 - abs(np.vdot(new_c, c)))
        b, c = new_b, new_c
        if turned < _STEADY:
            break
    return b, c


_STEADY = 1e-15  # one minus the cosine of the angle by which the vectors still turn


def null_vectors(A: Matrix, b: Array, c: Array) -> tuple[Array, Array, float]:
    """v, w and g of a matrix with borders b and c; see the module."""
    B, e = bordered(A, b, c), np.zeros((len(b) + 1, 1))
    e[-1] = 1.0
    if dense(B) and len(B) <= SMALL:
        right, left = (solve_signed(one, e)[0][:, 0] for one in (B, B.T))
    else:
        lu = Factors(B)
        right, left = lu.solve(e[:, 0]), lu.solve(e[:, 0], transposed=True)
    return right[:-1], left[:-1], float(right[-1])
