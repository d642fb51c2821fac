"""Period-doubling equations: a multiplier -1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import (
    AugmentedResidual,
    Borders,
    parameter_derivative_and_jacobian,
)
from hbgear.continuation.augmented.null_vectors import null_vectors
from hbgear.continuation.problem.evaluation import AnyProblem


class PeriodDoublingProblem(FoldProblem):
    """Period doublings (PD): singular half-integer block of the doubled problem.

    In the basis of twice the period, a motion of the single period has even harmonics only. The Jacobian then splits
    into the block of the even harmonics, which is dR/dX, and the block of the odd ones, whose null vector is the
    disturbance that doubles the period.

    Parameters
    ----------
    problem : HarmonicBalance
        The problem of the curve.
    parameter : str, optional
        The parameter of the curve, such as "Omega".

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 5)
    >>> curve = hb.trace(pair, "Omega", (2.1, 1.8))
    >>> few = hb.StepControl(max_points=4)
    >>> doublings = hb.trace(hb.harmonic.PeriodDoublingProblem(pair, "Omega"), "zeta", (0.05, 0.06),
    ...     start=curve["PD1"], steps=few)
    >>> doublings.parameter, bool(doublings.tracked["Omega"][0] == curve["PD1"].parameters["Omega"])
    ('zeta', True)
    """

    turning_kind = "LP"
    doubled: Any
    odd: NDArray[np.int_]
    even: NDArray[np.int_]

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "") -> None:
        super().__init__(problem, parameter)
        doubled = problem.doubled
        harmonic = np.tile(np.concatenate([[0], np.repeat(doubled.orders[1:], 2)]), problem.m)
        self._fixed(doubled=doubled, odd=np.flatnonzero(harmonic % 2), even=np.flatnonzero(harmonic % 2 == 0))

    def compiled(self, parameters: Mapping[str, float]) -> None:
        """Return None: the compiled locator is made for dR/dX, not for this block."""
        return None

    def embed(self, X: Array) -> Array:
        """Return the motion in the basis of twice the period."""
        out = np.zeros(self.doubled.size)
        out[self.even] = X
        return out

    def null_vector(self, X: Array, **parameters: float) -> Array:
        """Return the doubling disturbance at or near a period doubling, a unit vector with twice the period."""
        A, _ = self.matrix(X, parameters)
        out = np.zeros(self.doubled.size)
        out[self.odd] = scipy.linalg.svd(A)[2][-1]
        return out

    def matrix(self, X: Array, parameters: dict[str, float]) -> tuple[Array, float]:
        """Return the half-integer block, and the size of the terms of R."""
        evaluation = self.doubled.linearise(self.embed(X), "", **parameters)
        return evaluation.dR_dX[np.ix_(self.odd, self.odd)], evaluation.size

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the residual g and its derivatives; see `MinimallyAugmentedProblem.extra`."""
        assert base.b is not None and base.c is not None
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        embedded, direction = self.embed(X), np.zeros(self.doubled.size)
        v, w, g = null_vectors(self.matrix(X, parameters)[0], base.b, base.c)
        direction[self.odd] = v
        odd, even = self.odd, self.even
        dJ_v, dJ_p = self.doubled.curvature(embedded, direction, self.parameter, **parameters)
        changes = (parameter_derivative_and_jacobian(self.doubled, embedded, parameters, name) for name in names)
        derivatives = tuple((dR[even], -float(w @ dJ[np.ix_(odd, odd)] @ v)) for dR, dJ in changes)
        g_p = -float(w @ dJ_p[np.ix_(odd, odd)] @ v)
        return AugmentedResidual(evaluation, g, -(w @ dJ_v[np.ix_(odd, even)]), g_p, derivatives)
