"""Fold equations R = 0, g = 0 with a bordered test function g."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import (
    AugmentedResidual,
    Borders,
    MinimallyAugmentedProblem,
    borders_of,
    null_vectors,
    parameter_derivative_and_jacobian,
)
from hbgear.continuation.numerics.linear import Matrix, norm
from hbgear.continuation.problem.base import linearise
from hbgear.continuation.problem.evaluation import FOLD, Locating


class FoldProblem(MinimallyAugmentedProblem):
    """Folds (LP) of a curve: g is the bordered determinant of dR/dX; see the module.

    Parameters
    ----------
    problem, parameter : as for `MinimallyAugmentedProblem`.

    Examples
    --------
    The curve of a fold in the damping, from a fold of a response curve:

    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.SpurPair(), 8)
    >>> curve = hb.trace(problem, "Omega", (1.0, 0.6))
    >>> folds = hb.trace(hb.continuation.FoldProblem(problem, "Omega"), "zeta", (0.05, 0.2), start=curve["LP1"])
    >>> bool(folds["CP1"].parameters["zeta"] > 0.1)
    True
    """

    turning_kind = "CP"

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """See `Augmented.compiled`."""
        return self.problem.compiled_locator(self.parameter, parameters, FOLD)

    def base_at(self, X: Array, here: dict[str, float]) -> Borders:
        A, size = self.matrix(X, here)
        b, c, largest = borders_of(A)
        return Borders(size / (largest or 1.0), b, c)

    def renewed(self, base: Borders, X: Array, here: dict[str, float]) -> Borders:
        """Borders renewed at X, with positive products with the old ones, so that the sign of g is kept.

        g is det(A) over the bordered determinant, which must not vanish on the way; a curve that goes far renews it.
        """
        assert base.b is not None and base.c is not None
        A, _ = self.matrix(X, here)
        b, c = base.b, base.c
        for _ in range(2):
            v, w, _ = null_vectors(A, b, c)
            b, c = w / norm(w), v / norm(v)
        return Borders(base.weight, b, c)

    def matrix(self, X: Array, here: dict[str, float]) -> tuple[Matrix, float]:
        """The matrix that is singular at the point, and the size of the terms of R."""
        now = linearise(self.problem, X, "", here)
        return now.dR_dX, now.size

    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """See `Augmented.extra`."""
        assert base.b is not None and base.c is not None
        now = linearise(self.problem, X, self.parameter, here)
        v, w, g = null_vectors(now.dR_dX, base.b, base.c)
        k = base.weight
        along, across = self.problem.curvature(X, v, self.parameter, **here)
        changes = (parameter_derivative_and_jacobian(self.problem, X, here, name) for name in names)
        moved = tuple((dR, -k * float(w @ (dJ @ v))) for dR, dJ in changes)
        return AugmentedResidual(now, k * g, -k * (w @ along), -k * float(w @ (across @ v)), moved)

    def direction(self, U: Array, **parameters: float) -> int:
        """+1 if the solutions of this fold exist below it only, -1 if above: the sense in which a sweep meets it.

        Along the curve p'' = -(w^T R_XX v v) / (w^T R_p) at a fold.
        """
        X, own = self.split(U)
        here = {**parameters, **own}
        now = linearise(self.problem, X, self.parameter, here)
        b, c, _ = borders_of(now.dR_dX)
        v, w, _ = null_vectors(now.dR_dX, b, c)
        along, _ = self.problem.curvature(X, v, self.parameter, **here)
        return 1 if float(w @ (along @ v)) * float(w @ now.dR_dp) > 0 else -1
