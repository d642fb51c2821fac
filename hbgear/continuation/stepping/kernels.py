"""Kernels: predictor, acceptance of a corrected point and step size, for every kind of problem.

    predictor   u_p = Hermite extrapolation through the last points with their tangents, u = (X, p)
    corrector   R(u) = 0,  n^T (u - u_p) = 0    Newton's method with the bordered matrix [dR/dX dR/dp; n^T]

Lengths and angles are measured in scaled unknowns u / scale.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel
from hbgear.continuation.numerics.gauss_kernels import scaled_distance, scaled_norm
from hbgear.continuation.stepping.status import ACCEPTED, LANDED_FAR, PREDICTION_ERROR, TURNED_TOO_FAR

CONTINUE, CONVERGED, DIVERGED = range(3)
"""Status of an iterate of the corrector."""

MIN_EXTRAPOLATION_COSINE = 0.3
"""Smallest cosine of the angle between the tangents of points used by the predictor.

It is also the largest change of the prediction by the second point, relative to the step size.
"""

NO_ERROR_CONTROL_BELOW = 1e3
"""Ratio of the step size to the smallest one below which the prediction error does not reduce the step."""

MAX_LANDING_DISTANCE = 1.5
"""Largest distance of two successive points, relative to the step size."""

POLISH_ABOVE = 1e-2
"""Residual of a converged point, relative to the tolerance, above which one more Newton iteration is applied."""


@inlined
def predict(u: Any, t: Any, count: int, scale: Any, step: float, out: Any) -> None:
    """Fill ``out`` with the unknowns predicted by Hermite extrapolation.

    One point with its tangent defines a line, two a cubic, r a polynomial of degree 2r - 1, in the scaled distance
    x = unit . (u - u_0) along the last tangent. Points are added as long as each one changes the prediction by less
    than the previous one. Otherwise the curve is not smooth on the scale of their distances.

    Parameters
    ----------
    u : ndarray, shape (history, n + 1)
        Last points, the newest first.
    t : ndarray, shape (history, n + 1)
        Their tangents.
    count : int
        Number of points.
    scale : ndarray, shape (n + 1,)
        Scales of the unknowns.
    step : float
        Step size.
    out : ndarray, shape (n + 1,)
        Result: the predicted unknowns.
    """
    n = u.shape[1]
    size = 0.0
    for i in range(n):
        size += (t[0, i] / scale[i]) ** 2
    size = math.sqrt(size)
    x, cosine, guess = np.zeros(count), np.ones(count), np.empty(n)
    for i in range(n):
        out[i] = u[0, i] + step * t[0, i] / size
    change = MIN_EXTRAPOLATION_COSINE * step
    for r in range(1, count):
        squared = 0.0
        cosine[r] = 0.0
        for i in range(n):
            along = t[0, i] / (size * scale[i] * scale[i])
            x[r] += (u[r, i] - u[0, i]) * along
            cosine[r] += t[r, i] * along
            squared += (t[r, i] / scale[i]) ** 2
        if cosine[r] < MIN_EXTRAPOLATION_COSINE * math.sqrt(squared):
            return
        cosine[0] = size
        for i in range(n):
            guess[i] = 0.0
        for k in range(r + 1):
            value, slope = _hermite(x, k, r + 1, step)
            for i in range(n):
                guess[i] += value * u[k, i] + slope / cosine[k] * t[k, i]
        difference = scaled_distance(guess, out, scale)
        if not difference < change:
            return
        change = difference
        for i in range(n):
            out[i] = guess[i]


@kernel
def _hermite(x: Any, k: int, r: int, position: float) -> tuple[float, float]:
    """Return the Hermite weights at x of value and slope at node k: L^2 (1 - 2 (x - x_k) L'(x_k)), L^2 (x - x_k)."""
    lagrange, steep = 1.0, 0.0
    for j in range(r):
        if j != k:
            lagrange *= (position - x[j]) / (x[k] - x[j])
            steep += 1.0 / (x[k] - x[j])
    off, square = position - x[k], lagrange * lagrange
    return square * (1.0 - 2.0 * off * steep), square * off


@kernel
def newton_status(
    residual: float, step: float, last: float, first: float, best: float, iteration: int, limits: Any
) -> tuple[bool, int]:
    """Return whether an iterate is converged and the best so far, and `CONTINUE`, `CONVERGED` or `DIVERGED`.

    Parameters
    ----------
    residual : float
        Relative residual of the iterate.
    step : float
        Relative size of the Newton step from this iterate.
    last : float
        Relative size of the previous Newton step.
    first : float
        Smallest residual of the previous iterates.
    best : float
        Residual of a converged iterate, inf if there is not any.
    iteration : int
        Number of the iteration.
    limits : ndarray, shape (4,)
        Largest residual and largest last Newton step of a converged iterate; maximum number of iterations; residual of
        a converged iterate, relative to the tolerance, above which one more iteration is applied.

    Returns
    -------
    (bool, int)
        Whether the iterate is the best converged one, and the status.
    """
    tolerance, step_tolerance, max_iterations, polish_above = limits[0], limits[1], limits[2], limits[3]
    if best < math.inf:
        return residual < best, CONVERGED
    if residual <= tolerance and (last <= step_tolerance or iteration == 0):
        return True, CONTINUE if residual > polish_above * tolerance and step <= step_tolerance else CONVERGED
    diverged = not math.isfinite(residual) or (iteration > 3 and residual > 10 * first)
    return False, DIVERGED if diverged or iteration >= max_iterations else CONTINUE


@kernel
def accept_step(
    u: Any, t: Any, predicted: Any, previous: Any, tangent: Any, scale: Any, step: float, limits: Any
) -> tuple[int, float, float]:
    """Return the status of a corrected point, its turning angle and its prediction error.

    Parameters
    ----------
    u : ndarray, shape (n + 1,)
        Corrected point.
    t : ndarray, shape (n + 1,)
        Direction of the curve. It is scaled in place to unit length in scaled unknowns.
    predicted : ndarray, shape (n + 1,)
        Prediction.
    previous : ndarray, shape (n + 1,)
        Previous point.
    tangent : ndarray, shape (n + 1,)
        Its tangent.
    scale : ndarray, shape (n + 1,)
        Scales of the unknowns.
    step : float
        Step size.
    limits : ndarray, shape (2,)
        Largest turning angle [deg] and largest prediction error relative to the step size.

    Returns
    -------
    (int, float, float)
        Status of `stepping.status`, turning angle [deg], prediction error relative to the step size.
    """
    size, previous_size, product = 0.0, 0.0, 0.0
    for i in range(u.shape[0]):
        a, b = t[i] / scale[i], tangent[i] / scale[i]
        size, previous_size, product = size + a * a, previous_size + b * b, product + a * b
    for i in range(u.shape[0]):
        t[i] /= math.sqrt(size)
    turn = math.degrees(math.acos(min(1.0, max(-1.0, product / math.sqrt(size * previous_size)))))
    prediction_error = scaled_distance(u, predicted, scale) / step
    if scaled_distance(u, previous, scale) > MAX_LANDING_DISTANCE * step:
        return LANDED_FAR, turn, prediction_error
    if turn > limits[0]:
        return TURNED_TOO_FAR, turn, prediction_error
    return PREDICTION_ERROR if prediction_error > limits[1] else ACCEPTED, turn, prediction_error


@kernel
def next_step(step: float, iterations: int, turn: float, prediction_error: float, control: Any) -> float:
    """Return the next step size, at most doubled or halved.

    Parameters
    ----------
    step : float
        Last step size.
    iterations : int
        Number of Newton iterations.
    turn : float
        Turning angle [deg].
    prediction_error : float
        Prediction error relative to the step size.
    control : ndarray, shape (5,)
        Smallest and largest step size, largest turning angle [deg], target number of iterations, largest prediction
        error.

    Returns
    -------
    float
        The next step size.
    """
    by_newton = 2.0 ** ((control[3] - iterations) / 2)
    by_turn = 0.5 * control[2] / max(turn, 0.1)
    by_miss = math.sqrt(0.5 * control[4] / max(prediction_error, 1e-9))
    factor = min(2.0, max(0.5, min(by_newton, min(by_turn, by_miss))))
    return min(control[1], max(control[0], factor * step))


@kernel
def arclength_normal(tangent: Any, scale: Any, out: Any) -> None:
    """Fill ``out`` with the unit normal, in unscaled unknowns, of the plane orthogonal to a scaled tangent."""
    for i in range(out.shape[0]):
        out[i] = tangent[i] / (scale[i] * scale[i])
    size = scaled_norm(out)
    for i in range(out.shape[0]):
        out[i] /= size
