"""Standard errors of a profile likelihood, estimated from two additional curves for each parameter.

    S(a) = sum_i r_i^2,    S_j(x) = min of S over the other parameters at a_j = x,    S_j(x) <= S(a*) + 4

The inequality holds for values of a_j within two standard errors of the estimate a*. If r is linear in a, S_j is a
parabola with the ends a*_j -+ 2 s_j, s_j^2 = C_jj, and the parameters there are a* -+ 2 C_j / s_j. Close to folds S_j
is not a parabola: amplitudes change like the square root of the distance, and points leave the stable segment of their
sweep. S then increases much more to one side than to the other. Therefore a curve is traced at both ends. With the
increase q of S, minimized over the other parameters by the linear model, the parabola through this point has the ends

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
"""Distance from the estimate at which the sum of squares is evaluated, in standard errors."""

MAX_END_RATIO = 3.0
"""Largest ratio of the distance of an end to the distance in the linear model."""

MIN_BOUND_DISTANCE = 0.1
"""Smallest distance from the estimate to a bound, in standard errors, at which a curve is traced."""


def profile_interval(
    best: Prediction,
    at: Callable[[Array], Prediction | None],
    x: Array,
    covariance: Array,
    unit: float,
    low: Array,
    high: Array,
) -> Array:
    """Return standard errors (A,) for the side with the slower increase of the sum of squares; nan without a curve.

    x (A,) is the estimate, ``covariance`` (A, A) that of first order, nan where it is not determined. ``at`` returns
    the prediction with other values, or None if the model has no response. ``unit`` is the increase of the sum of
    squares for one standard error: 1, or the mean square if no deviations are given.
    """
    s = best.deviation
    J, minimum = best.information(s), float(np.square(best.residuals(s)).sum())
    errors = np.full(len(x), math.nan)
    determinate = np.flatnonzero(np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0))
    for j in determinate:
        error = math.sqrt(covariance[j, j])
        direction = np.where(np.isfinite(covariance[:, j]), covariance[:, j], 0.0) / error
        others = [k for k in determinate if k != j]
        for side in (-1, 1):
            shifted = np.clip(x + side * SIGMAS * direction, low, high)
            t = abs(shifted[j] - x[j]) / error
            prediction = at(shifted) if t > MIN_BOUND_DISTANCE else None
            if prediction is not None:
                rise = max(
                    _minimized_sum(prediction.residuals(s), J[:, others]) - minimum, unit * (t / MAX_END_RATIO) ** 2
                )
                errors[j] = np.fmax(errors[j], error * t * math.sqrt(unit / rise))
    return errors


def _minimized_sum(r: Array, J: Array) -> float:
    """Return the sum of squares after one Gauss-Newton step."""
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    if J.size:
        r = r - J @ np.linalg.lstsq(J, r, rcond=1e-9)[0]
    return float(r @ r)
