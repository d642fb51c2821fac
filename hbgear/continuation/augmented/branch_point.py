"""Branch-point equations: points at which two curves of solutions cross.

    (1 - b b^T) R(X, p) + b k g_1(X, p) = 0,   k g_2(X, p) = 0           unknowns U = (X, p)

The rank of A = [dR/dX, dR/dp], n by n + 1, is n - 1 at a branch point. Its bordered matrix is regular,

    [A    b] [V  ]   [0]            [A^T  C] [w]   [0]
    [C^T  0] [g^T] = [1]            [b^T  0] [g] = [1]

with one column b and two rows C^T. g = (g_1, g_2) is zero if the null space of A has two dimensions. The columns of V
span this null space, which contains the tangents of both curves, and dg_j = -w^T dA V_j. The two equations g = 0 add
one unknown only, because the rows of A are linearly dependent at the point: the component b^T R is left out. This
component is the imperfection that would separate the two curves. A symmetry of the system keeps it zero. A solution
with b^T R != 0 is not a branch point.

References
----------
Moore (1980), Numer. Funct. Anal. Optim. 2(6), https://doi.org/10.1080/01630568008816070, for the unfolding parameter.
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.numerics.linear import Factors, as_dense, dense, norm
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.branch import Branch


@dataclass(frozen=True)
class BranchPointResidual(Borders):
    """Borders b (n,) and c (n + 1, 2) of the branch-point equations, and the scales (n + 1,) of (X, p)."""

    scale: Array | None = None


class BranchPointProblem(MinimallyAugmentedProblem):
    """Equations of branch points (BP): two curves cross where [dR/dX, dR/dp] is rank-deficient; see the module.

    The arguments are the problem and the parameter of the curve, as for `MinimallyAugmentedProblem`.

    Raises
    ------
    ValueError
        If the matrices are sparse, or more than two curves cross.

    Examples
    --------
    The branch point at which the motion of a hardening spring loses its symmetry, for a range of damping ratios:

    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(k3=1.0, F=20.0), 9)
    >>> curve = hb.trace(problem, "Omega", (1.0, 1.4), stability=False)
    >>> few = hb.StepControl(max_points=4)
    >>> held = hb.trace(hb.continuation.BranchPointProblem(problem, "Omega"), "zeta", (0.05, 0.06),
    ...     start=curve["BP1"], steps=few)
    >>> bool(abs(held.tracked["Omega"][0] - curve.values[curve["BP1"].index]) < 1e-9)
    True
    """

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        if not dense(evaluation.dR_dX):
            raise ValueError("branch points require dense matrices; reduce the problem")
        scale = np.full(len(X) + 1, self.problem.solution_norm(X) or 1.0)
        scale[-1] = self.problem.unit_of(self.parameter, parameters[self.parameter])
        u, s, vt = scipy.linalg.svd(_matrix(evaluation) * scale)
        if len(s) > 1 and s[-2] <= MIN_SECOND_SINGULAR_VALUE * s[0]:
            raise ValueError("more than two curves cross here: the point is not a simple branch point")
        largest = float(s[0]) or 1.0  # zero if all entries are
        return BranchPointResidual(evaluation.size / largest, u[:, -1], vt[-2:].T, scale)

    def update_borders(self, base: Borders, X: Array, parameters: dict[str, float]) -> Borders:
        """Return the borders at X with the orientation of the previous ones."""
        assert isinstance(base, BranchPointResidual)
        w, V, _ = self._null(self.problem.linearise(X, self.parameter, **parameters), base)
        u, _, vt = scipy.linalg.svd(V, full_matrices=False)  # the orthonormal pair nearest to V
        return BranchPointResidual(base.weight, w / norm(w), u @ vt, base.scale)

    def require_solutions(self, branch: Branch) -> None:
        """Raise ValueError if the points of a curve of branch points do not solve R = 0.

        The component b^T R is left out of the equations. It vanishes along the curve only if the second parameter keeps
        the symmetry that makes the curves cross.
        """
        name = branch.parameter
        for i in range(len(branch)):
            parameters = branch.parameters_at(i)
            X = self.problem.join(branch.X[i], parameters)
            evaluation = self.problem.with_borders_at(X, parameters, renew=True).linearise(X, "", **parameters)
            if norm(evaluation.R) > MAX_IMPERFECTION * evaluation.size:
                last = branch.values[max(i - 1, 0)]
                raise ValueError(
                    f"branch points exist at single values of {name} only: beyond {name} = {last:.6g} the curves no "
                    f"longer cross, because {name} breaks their symmetry; follow a fold instead"
                )

    def _null(self, evaluation: Evaluation, base: Borders) -> tuple[Array, Array, Array]:
        """Return w (n,), V (n + 1, 2) in scaled unknowns, and g (2,); see the module."""
        assert isinstance(base, BranchPointResidual) and base.b is not None and base.c is not None
        n = len(base.b)
        B = np.zeros((n + 2, n + 2))
        B[:n, : n + 1], B[:n, -1], B[n:, : n + 1] = _matrix(evaluation) * base.scale, base.b, base.c.T
        factors, unit = Factors(B), np.eye(n + 2)
        right, left = factors.solve(unit[:, n:]), factors.solve(unit[-1], transposed=True)
        return left[:n], right[: n + 1], right[-1]

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the equations; see `MinimallyAugmentedProblem.extra`."""
        assert isinstance(base, BranchPointResidual) and base.b is not None and base.scale is not None
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        w, V, g = self._null(evaluation, base)
        V, k, b = V * base.scale[:, None], base.weight, base.b

        def residual_and_matrix(values: dict[str, float]) -> tuple[Array, Array]:
            evaluation = self.problem.linearise(X, self.parameter, **values)
            return evaluation.R, _matrix(evaluation)

        def slopes_in(name: str) -> tuple[Array, Array]:
            """Return the derivatives of R and g in a parameter."""
            dR, dA = parameter_derivatives(self.problem, name, parameters, residual_and_matrix)
            return dR, -(w @ dA @ V)

        g_X, g_p = self._slopes(X, parameters, w, V), slopes_in(self.parameter)[1]
        first = Evaluation(
            _with_component(b, evaluation.R, k * g[0]),
            _with_component(b, as_dense(evaluation.dR_dX), k * g_X[0]),
            _with_component(b, evaluation.dR_dp, k * g_p[0]),
            evaluation.size,
        )
        derivatives = tuple((_with_component(b, dR, k * dg[0]), float(dg[1])) for dR, dg in map(slopes_in, names))
        return AugmentedResidual(first, float(g[1]), g_X[1], float(g_p[1]), derivatives)

    def _slopes(self, X: Array, parameters: dict[str, float], w: Array, V: Array) -> Array:
        """Return the gradients (2, n) of g in X: -w^T (R_XX v + R_Xp r) for each column (v, r) of V."""
        out = []
        for *v, rate in V.T:
            moves = any(v)  # otherwise only the parameter changes along the column
            Jv, Jp = self.problem.curvature(X, np.array(v) if moves else np.ones(len(X)), self.parameter, **parameters)
            out.append(-rate * (w @ Jp) - (w @ Jv if moves else 0.0))
        return np.array(out)


MIN_SECOND_SINGULAR_VALUE = 1e-7
"""Second smallest singular value, relative to the largest, below which the null space has three dimensions."""


MAX_IMPERFECTION = 1e-6
"""Residual, over the size of its terms, above which a point of a curve of branch points is no solution."""


def _with_component(b: Array, array: Array, value: Array) -> Array:
    """Return a vector or matrix whose component along b is replaced by a value."""
    return array + np.multiply.outer(b, value - b @ array)


def _matrix(evaluation: Evaluation) -> Array:
    """Return [dR/dX, dR/dp], (n, n + 1)."""
    return np.column_stack([as_dense(evaluation.dR_dX), evaluation.dR_dp])
