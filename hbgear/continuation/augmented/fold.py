"""Fold equations R = 0, g = 0 with a bordered test function g."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import (
    AugmentedResidual,
    Borders,
    MinimallyAugmentedProblem,
    parameter_derivative_and_jacobian,
)
from hbgear.continuation.augmented.null_vectors import borders_of, null_vectors
from hbgear.continuation.numerics.linear import Matrix, norm
from hbgear.continuation.problem.evaluation import FOLD, Locating


class FoldProblem(MinimallyAugmentedProblem):
    """Equations of folds (LP) of a curve: g is the bordered determinant of dR/dX; see `minimally_augmented`.

    The arguments are the problem and the parameter of the curve, as for `MinimallyAugmentedProblem`.

    Examples
    --------
    The curve of a fold for a range of damping ratios, from a fold of a response curve:

    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.SpurPair(), 8)
    >>> curve = hb.trace(problem, "Omega", (1.0, 0.6))
    >>> folds = hb.trace(hb.continuation.FoldProblem(problem, "Omega"), "zeta", (0.05, 0.2), start=curve["LP1"])
    >>> bool(folds["CP1"].parameters["zeta"] > 0.1)
    True
    """

    turning_kind = "CP"

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """Return the compiled Newton iteration; see `MinimallyAugmentedProblem.compiled`."""
        return self.problem.compiled_locator(self.parameter, parameters, FOLD)

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        A, size = self.matrix(X, parameters)
        b, c, largest = borders_of(A)
        return Borders(size / (largest or 1.0), b, c)

    def stall(self, X: Array, name: str, parameters: Mapping[str, float]) -> tuple[str, str]:
        """Return the corners of the response curve at the fold: beyond one, dR/dX is another matrix."""
        inner, unknown = self.solution_of(X)
        met = " and ".join(self.problem.corners_met(inner, {**parameters, **unknown}))
        if not met:
            return "", ""
        advice = f"trace a response curve at this {name}, and follow {met} on it"
        return f"the curve meets {met}, where derivatives jump", advice

    def update_borders(self, base: Borders, X: Array, parameters: dict[str, float]) -> Borders:
        """Return the borders at X, with positive products with the previous ones, which keeps the sign of g.

        g is det(A) over the bordered determinant. New borders along a curve prevent a zero of this determinant.
        """
        assert base.b is not None and base.c is not None
        A, _ = self.matrix(X, parameters)
        b, c = base.b, base.c
        for _ in range(2):
            v, w, _ = null_vectors(A, b, c)
            b, c = w / norm(w), v / norm(v)
        return Borders(base.weight, b, c)

    def matrix(self, X: Array, parameters: dict[str, float]) -> tuple[Matrix, float]:
        """Return the matrix that is singular at the point, and the size of the terms of R."""
        evaluation = self.problem.linearise(X, "", **parameters)
        return evaluation.dR_dX, evaluation.size

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the equations; see `MinimallyAugmentedProblem.extra`."""
        assert base.b is not None and base.c is not None
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        v, w, g = null_vectors(evaluation.dR_dX, base.b, base.c)
        along, dJ_dp = self.problem.curvature(X, v, self.parameter, **parameters)
        changes = (parameter_derivative_and_jacobian(self.problem, X, parameters, name) for name in names)
        derivatives = tuple((dR, -float(w @ (dJ @ v))) for dR, dJ in changes)
        return AugmentedResidual(evaluation, g, -(w @ along), -float(w @ (dJ_dp @ v)), derivatives)

    def direction(self, U: Array, **parameters: float) -> int:
        """Return +1 if the solutions exist below the fold only, -1 if above: the direction of a sweep that reaches it.

        At a fold p'' = -(w^T R_XX v v) / (w^T R_p) along the curve.

        Parameters
        ----------
        U : ndarray, shape (n + 1,)
            Unknowns (X, p) of the fold.
        **parameters
            Values of the other parameters.

        Returns
        -------
        int
            The direction.
        """
        X, unknown = self.solution_of(U)
        values = {**parameters, **unknown}
        evaluation = self.problem.linearise(X, self.parameter, **values)
        b, c, _ = borders_of(evaluation.dR_dX)
        v, w, _ = null_vectors(evaluation.dR_dX, b, c)
        along, _ = self.problem.curvature(X, v, self.parameter, **values)
        return 1 if float(w @ (along @ v)) * float(w @ evaluation.dR_dp) > 0 else -1
