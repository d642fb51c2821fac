"""Continuation of equations that have nothing to do with gears: a plane curve, and Bratu's problem on a fine grid.

    x^2 (1 - x^2) = p^2                          a figure of eight, its crossing point a branch point
    u'' + p exp(u) = 0,   u(0) = u(1) = 0        folds at p = 3.513830719125160

The discretised Bratu problem has 10 000 unknowns and a sparse Jacobian: what is bordered stays sparse.
"""

from __future__ import annotations

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
    """u'' + p exp(u) = 0 on n inner points by second differences; also says dR/dp, which spares two evaluations."""

    def __init__(self, n: int) -> None:
        self.h = 1 / (n + 1)
        ones = np.ones(n)
        self.D = sparse.diags_array([ones[1:], -2 * ones, ones[1:]], offsets=[-1, 0, 1], format="csc") / self.h**2

    def evaluate(self, X: np.ndarray, p: float) -> tuple[np.ndarray, sparse.csc_array]:
        """R (n,) and dR/dX (n, n), sparse."""
        now = self.linearise(X, "", p=p)
        return now.R, now.dR_dX

    def linearise(self, X: np.ndarray, name: str, p: float) -> hb.Evaluation:
        """R, dR/dX, dR/dp, and the size of the terms of R."""
        source = np.exp(X)
        bent = self.D @ X
        size = float(np.linalg.norm(bent) + np.linalg.norm(source))
        return hb.Evaluation(bent + p * source, self.D + sparse.diags_array(p * source, format="csc"), source, size)


def bratu(n: int = 10_000) -> hb.Branch:
    """The curve from u = 0 around its fold."""
    high = hb.Event("high", lambda point: float(np.max(point.X)) - 4.0, "u(1/2) = 4", terminal=True)
    fine = hb.Settings(tolerance=1e-8)  # rounding of u'' on this grid is 1e-16 n^2 of its size
    return hb.trace(Bratu(n), "p", (0.0, 4.0), np.zeros(n), events=[high], settings=fine)


def eight() -> hb.Branch:
    """One lobe, through the crossing point to the other, and out at p = -0.4."""
    return hb.trace(Eight(), "p", (-0.4, 0.6), np.array([0.9]))


if __name__ == "__main__":
    for curve in (eight(), bratu()):
        print(curve)
        for point in curve.special:
            print(f"  {point.label}: p = {point.parameters['p']:.12g}, {point.meaning}")
