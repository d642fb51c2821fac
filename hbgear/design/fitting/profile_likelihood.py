"""How far measurements let each parameter go: standard errors of a likelihood, at the price of two curves for each.

    S(a) = sum_i r_i^2,    S_j(x) = min of S over the other parameters, a_j = x held,    S_j(x) <= S(a*) + 4

are the values of a_j within two standard errors of the estimate a*. If r is linear in a, S_j is a parabola, and the
ends are a*_j -+ 2 s_j with s_j^2 = C_jj, the others at a* -+ 2 C_j / s_j. It is not beside folds, where amplitudes bend
like the root of the distance and points leave the part of the curve they are on: there S rises far more to one side
than to the other. So a curve is traced at both of these ends. With the rise q of S, the others readjusted by the linear
model, the parabola through it ends at

    a*_j -+ 2 s_j (4 / q)^1/2

and the standard error of a_j is half the distance to the farther end, at least s_j.

References
----------
Bates & Watts (1988), Nonlinear Regression Analysis and Its Applications, ch. 6, https://doi.org/10.1002/9780470316757.
Venzon & Moolgavkar (1988), J. R. Stat. Soc. C 37(1), 87-94, https://doi.org/10.2307/2347496.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hbgear.common.arrays import Array
from hbgear.design.fitting.sweep_prediction import Prediction

SIGMAS = 2.0
"""Standard errors from the estimate at which the sum of squares is looked at."""

MOST = 3.0
"""An end is put at most so many times as far off as the linear model puts it."""

_LEAST = 0.1  # standard errors to a bound from which it is worth looking


def profile_interval(
    best: Prediction, at: Callable[[Array], Prediction | None], x: Array, covariance: Array, unit: float, low: Array,
    high: Array,
) -> Array:  # fmt: skip
    """Standard errors (A,) to the side to which the sum of squares rises more slowly; nan where nothing can be traced.

    Parameters
    ----------
    best, x : Prediction
        The estimate (A,), and what the model says with it.
    at : callable or None
        The same with other values; None where the model has no response.
    covariance : ndarray, shape (A, A)
        To first order, nan where there is none.
    unit : float
        What the sum of squares rises by for one standard error: 1, or its mean where no deviations are known.
    low, high : ndarray, shape (A,)
        Bounds.
    """
    s = best.deviation
    J, least = best.information(s), float(np.square(best.residuals(s)).sum())
    out = np.full(len(x), math.nan)
    known = np.flatnonzero(np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0))
    for j in known:
        error = math.sqrt(covariance[j, j])
        way = np.where(np.isfinite(covariance[:, j]), covariance[:, j], 0.0) / error
        others = [k for k in known if k != j]
        for side in (-1, 1):
            there = np.clip(x + side * SIGMAS * way, low, high)
            t = abs(there[j] - x[j]) / error
            now = at(there) if t > _LEAST else None
            if now is not None:
                rise = max(_least(now.residuals(s), J[:, others]) - least, unit * (t / MOST) ** 2)
                out[j] = np.fmax(out[j], error * t * math.sqrt(unit / rise))
    return out


def _least(r: Array, J: Array) -> float:
    """The sum of squares after a step of Gauss and Newton."""
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    if J.size:
        r = r - J @ np.linalg.lstsq(J, r, rcond=1e-9)[0]
    return float(r @ r)
