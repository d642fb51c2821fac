"""Results of a problem at one point: residual, Jacobian and parameter derivative. The minimal problem.

R(X, p) = 0        X (n,) unknowns, p named parameters, one of which is the continuation parameter
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import Matrix


class Evaluation(NamedTuple):
    """Residual, Jacobian and parameter derivative at one point.

    A residual is small if it is small relative to ``size``.

    Attributes
    ----------
    R : ndarray, shape (n,)
        Residual.
    dR_dX : Matrix, shape (n, n)
        Jacobian, dense or sparse.
    dR_dp : ndarray, shape (n,)
        Derivative in the continuation parameter.
    size : float
        Size of the terms of R.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> class Circle:
    ...     def evaluate(self, X, p):
    ...         evaluation = self.linearise(X, "p", p)
    ...         return evaluation.R, evaluation.dR_dX
    ...
    ...     def linearise(self, X, name, p):
    ...         return hb.continuation.Evaluation(np.array([X[0] ** 2 + p**2 - 1]), np.array([[2 * X[0]]]),
    ...         np.array([2 * p]), 1.0)
    ...
    >>> hb.trace(Circle(), "p", (0.0, 2.0), np.array([1.0])).special[0].parameters["p"] == 1.0
    True
    """

    R: Array
    dR_dX: Matrix
    dR_dp: Array
    size: float


@runtime_checkable
class Problem(Protocol):
    """Minimal problem: any object with ``evaluate``."""

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Matrix]:
        """Return R of shape (n,) and dR/dX of shape (n, n), a dense array or a scipy.sparse matrix."""


AnyProblem = Annotated[Any, Problem]
"""A `Problem`, whose ``evaluate`` may name its parameters."""


Pursuit: TypeAlias = Callable[[Array, int, Array, float, Array, Array, Array, Array], tuple[int, float, int, float]]
"""Compiled continuation loop that follows the rules of `hbgear.continuation.stepping.kernels`.

The arguments are those of `hbgear.harmonic.equations.continuation_kernel.trace_compiled` without the first.
"""


Locating: TypeAlias = Callable[[Array, int, float, int, Array, Array], tuple[int, float]]
"""Compiled Newton iteration for a point of a curve.

The arguments are those of `hbgear.harmonic.equations.newton_kernels.locate` without the first two.
"""

FOLD, HELD = -1, -2
"""Targets of `Locating` other than a numbered special point: a fold, or the solution at the given parameter value."""
