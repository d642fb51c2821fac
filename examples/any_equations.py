"""Continuation of other equations than gears: a plane curve, and the Bratu problem on a fine grid.

    x^2 (1 - x^2) = p^2                          a figure of eight with a branch point
    u'' + p exp(u / (1 + q u)) = 0,   u(0) = u(1) = 0        fold at p = 3.513830719125160 for q = 0

The discretised Bratu problem has 10 000 unknowns and a sparse Jacobian; bordered matrices are sparse as well.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import sparse

import hbgear as hb


class Eight:
    """x^2 (1 - x^2) - p^2 = 0: a minimal problem with one equation."""

    def evaluate(self, X: np.ndarray, p: float) -> tuple[np.ndarray, np.ndarray]:
        """Return R (1,) and dR/dX (1, 1)."""
        x = X[0]
        return np.array([x**2 - x**4 - p**2]), np.array([[2 * x - 4 * x**3]])


class Bratu:
    """u'' + p exp(u / (1 + q u)) = 0 on n inner points by second differences.

    Optional parts: the derivatives with respect to p and q, which save evaluations, and a default of q.
    """

    parameters: ClassVar[dict[str, float]] = {"q": 0.0}

    def __init__(self, n: int) -> None:
        self.h = 1 / (n + 1)
        ones = np.ones(n)
        self.D = sparse.diags_array([ones[1:], -2 * ones, ones[1:]], offsets=[-1, 0, 1], format="csc") / self.h**2

    def evaluate(self, X: np.ndarray, p: float, q: float) -> tuple[np.ndarray, sparse.csc_array]:
        """Return R (n,) and the sparse dR/dX (n, n)."""
        now = self.linearise(X, "", p=p, q=q)
        return now.R, now.dR_dX

    def linearise(self, X: np.ndarray, name: str, p: float, q: float) -> hb.continuation.Evaluation:
        """Return R, dR/dX, the derivative of R with respect to p or q, and the size of the terms of R."""
        power = X / (1 + q * X)
        source = np.exp(power)
        bent = self.D @ X
        J = self.D + sparse.diags_array(p * source / (1 + q * X) ** 2, format="csc")
        dR = {"": np.zeros_like(X), "p": source, "q": -p * source * power**2}[name]
        return hb.continuation.Evaluation(
            bent + p * source, J, dR, float(np.linalg.norm(bent) + np.linalg.norm(source))
        )


FINE = hb.NewtonSettings(tolerance=1e-8)
"""The relative rounding error of u'' on n points is 1e-16 n^2."""


def bratu(n: int = 10_000) -> hb.Branch:
    """Return the curve from u = 0 through its fold."""
    high = hb.Event("high", lambda point: float(np.max(point.X)) - 4.0, "u(1/2) = 4", terminal=True)
    return hb.trace(Bratu(n), "p", (0.0, 4.0), np.zeros(n), events=[high], settings=FINE)


def cusp(curve: hb.Branch) -> hb.Branch:
    """Return the curve of folds in q, through the cusp, up to u(1/2) = 10."""
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
    """Return the curve through both lobes and the branch point, up to p = -0.4."""
    return hb.trace(Eight(), "p", (-0.4, 0.6), np.array([0.9]))


if __name__ == "__main__":
    branch = bratu()
    for curve in (eight(), branch, cusp(branch)):
        print(curve)
        for point in curve.special:
            print(f"  {point.label}: p = {point.parameters['p']:.12g}, {point.meaning}")
