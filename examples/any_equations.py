"""Continuation of equations that have nothing to do with gears: a plane curve, and Bratu's problem on a fine grid.

    x^2 (1 - x^2) = p^2                          a figure of eight, its crossing point a branch point
    u'' + p exp(u / (1 + q u)) = 0,   u(0) = u(1) = 0        for q = 0 a fold at p = 3.513830719125160

The discretised Bratu problem has 10 000 unknowns and a sparse Jacobian: what is bordered stays sparse.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import sparse

import hbgear as hb


class Eight:
    """x^2 (1 - x^2) - p^2 = 0: one equation, and the least that a problem can be."""

    def evaluate(self, X: np.ndarray, p: float) -> tuple[np.ndarray, np.ndarray]:
        """R (1,) and dR/dX (1, 1)."""
        x = X[0]
        return np.array([x**2 - x**4 - p**2]), np.array([[2 * x - 4 * x**3]])


class Bratu:
    """u'' + p exp(u / (1 + q u)) = 0 on n inner points by second differences.

    It says more than it must: the derivatives in p and q, which spares evaluations, and the usual value of q.
    """

    parameters: ClassVar[dict[str, float]] = {"q": 0.0}

    def __init__(self, n: int) -> None:
        self.h = 1 / (n + 1)
        ones = np.ones(n)
        self.D = sparse.diags_array([ones[1:], -2 * ones, ones[1:]], offsets=[-1, 0, 1], format="csc") / self.h**2

    def evaluate(self, X: np.ndarray, p: float, q: float) -> tuple[np.ndarray, sparse.csc_array]:
        """R (n,) and dR/dX (n, n), sparse."""
        now = self.linearise(X, "", p=p, q=q)
        return now.R, now.dR_dX

    def linearise(self, X: np.ndarray, name: str, p: float, q: float) -> hb.continuation.Evaluation:
        """R, dR/dX, the derivative of R in p or q, and the size of the terms of R."""
        power = X / (1 + q * X)
        source = np.exp(power)
        bent = self.D @ X
        J = self.D + sparse.diags_array(p * source / (1 + q * X) ** 2, format="csc")
        dR = {"": np.zeros_like(X), "p": source, "q": -p * source * power**2}[name]
        return hb.continuation.Evaluation(
            bent + p * source, J, dR, float(np.linalg.norm(bent) + np.linalg.norm(source))
        )


FINE = hb.NewtonSettings(tolerance=1e-8)
"""Rounding of u'' on n points is 1e-16 n^2 of its size."""


def bratu(n: int = 10_000) -> hb.Branch:
    """The curve from u = 0 around its fold."""
    high = hb.Event("high", lambda point: float(np.max(point.X)) - 4.0, "u(1/2) = 4", terminal=True)
    return hb.trace(Bratu(n), "p", (0.0, 4.0), np.zeros(n), events=[high], settings=FINE)


def cusp(curve: hb.Branch) -> hb.Branch:
    """The fold as q rises, to the cusp where it meets the upper one, and that one until u(1/2) = 10 as q falls."""
    far = hb.Event("far", lambda point: float(np.max(point.X)) - 10.0, "u(1/2) = 10", terminal=True)
    return hb.trace(
        hb.continuation.FoldProblem(curve.problem, "p"),
        "q",
        (0.0, 0.3),
        start=curve["LP1"],
        events=[far],
        settings=FINE,
    )


def eight() -> hb.Branch:
    """One lobe, through the crossing point to the other, and out at p = -0.4."""
    return hb.trace(Eight(), "p", (-0.4, 0.6), np.array([0.9]))


if __name__ == "__main__":
    branch = bratu()
    for curve in (eight(), branch, cusp(branch)):
        print(curve)
        for point in curve.special:
            print(f"  {point.label}: p = {point.parameters['p']:.12g}, {point.meaning}")
