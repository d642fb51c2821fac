"""A curve by harmonicbalance: arclength continuation with a fixed step; runs in its own environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.speed import peers_curve
from studies.speed.peers_curve import Curve, Problem


def trace(given: Problem) -> Curve:
    """All points, converged or not: the package does not distinguish them. One coordinate only."""
    from harmonicbalance.fourier import Fourier  # type: ignore[import-not-found]
    from harmonicbalance.predictorcorrector import PredictorCorrectorSolver  # type: ignore[import-not-found]

    if len(given.M) > 1:
        raise ValueError("its continuation takes one coordinate only")
    H = given.harmonics
    m, c, k = (float(A[0, 0]) for A in (given.M, given.C, given.K))

    def unbalance(x: Any) -> Any:
        load = Fourier(coeff_dc=given.constant, omega=x.omega, n=H)
        load[1] = given.cosine * x.omega**given.order
        velocity = -1.0 * x.dt()  # its dt() of 0.2.0 gives the derivative with the sign turned
        return m * x.dt().dt() + c * velocity + k * x + x.nonlinearity(given.spring) - load

    mean = given.gap + given.constant / given.k if given.gap is not None else 0.0
    start = Fourier(coeff_dc=mean, omega=given.span[0], n=H)
    solver = PredictorCorrectorSolver(unbalance, start, *given.span, 0.04 if given.gap is None else 0.01)
    solver.solve()
    Q = [np.concatenate([[x.coeff_dc], x.coeffs_cos - 1j * x.coeffs_sin]) for x in solver.solutions]
    return np.array([x.omega for x in solver.solutions]), np.array(Q)[:, None]


if __name__ == "__main__":
    peers_curve.main(trace, warm_up=False)
