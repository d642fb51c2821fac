"""A curve by algebraic-hbm: polynomial equations without continuation, so a walk in Omega up and one down.

For one coordinate and a polynomial law; runs in its own environment.
"""

from __future__ import annotations

import numpy as np

from studies.speed import peers_curve
from studies.speed.peers_curve import Curve, Problem

POINTS = 60
"""Frequencies of each walk."""


def trace(given: Problem) -> Curve:
    """The motions found at the frequencies up and down by SciPy's fsolve, as its documentation does it."""
    import algebraic_hbm as package  # type: ignore[import-not-found]
    from scipy.optimize import fsolve

    if len(given.M) > 1 or given.gap is not None or given.order or given.constant:
        raise ValueError("only for one coordinate, a polynomial spring and a load that does not depend on Omega")
    # its residual is mass x'' + ... + excitation
    ode = package.ODE_2nd_Order_Poly_Coeffs(
        mass=float(given.M[0, 0]),
        damping=float(given.C[0, 0]),
        stiffness=float(given.K[0, 0]),
        monomials={3: given.k},
        excitation=(0.0, -given.cosine),
    )
    balance = package.Algebraic_HBM(ODE=ode, order=given.harmonics)
    balance.generate_multivariate_polynomials()
    F, (slope, _) = balance.compile()
    c = np.zeros(balance.subspace_dim)
    up = np.linspace(*given.span, POINTS)
    Omegas, found = [], []
    for Omega in (*up, *up[::-1]):
        c, _, status, _ = fsolve(lambda x: F(x, Omega), c, fprime=lambda x: slope(x, Omega), full_output=True)  # noqa: B023
        if status == 1:
            Omegas.append(Omega)
            found.append(np.concatenate([c[:1], c[1::2] - 1j * c[2::2]])[None])
    return np.array(Omegas), np.array(found)


if __name__ == "__main__":
    peers_curve.main(trace, warm_up=False)  # what it compiles it compiles for one curve
