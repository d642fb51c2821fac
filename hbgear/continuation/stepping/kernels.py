"""Kernels: the rules by which a curve is followed from row to row. They stand here once, for every kind of problem.

    predictor   u_p = Hermite extrapolation through the last rows with their tangents, u = (X, lambda)
    corrector   R(u) = 0,  n^T (u - u_p) = 0    Newton with the bordered matrix [J R_lambda; n^T]

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

from hbgear.common.process.compiling import kernel
from hbgear.continuation.numerics.gauss_kernels import scaled_distance, scaled_norm
from hbgear.continuation.stepping.status import ACCEPTED, LANDED_FAR, PREDICTION_ERROR, TURNED_TOO_FAR

CONTINUE, CONVERGED, DIVERGED = range(3)
"""Verdicts on an iterate of the corrector: go on, converged, given up."""

MIN_EXTRAPOLATION_COSINE = (
    0.3  # share of the step by which the first predicted bend may move the point; cosine of the last turn
)

NO_ERROR_CONTROL_BELOW = 1e3  # steps below so many of the shortest are not shortened for the sake of the prediction

MAX_LANDING_DISTANCE = 1.5  # distance of two rows, in steps, that is too large

POLISH_ABOVE = 1e-2  # part of the tolerance above which a converged point gets one Newton step more


@kernel
def predict(u: Any, t: Any, count: int, scale: Any, step: float, out: Any) -> None:
    """Put the unknowns a step along the tangent of the last row in out (n + 1,): Hermite extrapolation.

    Parameters
    ----------
    u, t : (history, n + 1) the last rows and their tangents, the newest first, ``count`` of them. Through one of them
        with its tangent goes a line, through two a cubic, through r a polynomial of degree 2r - 1, in the distance
        x = unit . (u - u_0) (scaled). As many are used as bring smaller and smaller changes: beyond that the curve is
        not smooth on their scale.
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
        across = 0.0
        cosine[r] = 0.0
        for i in range(n):
            along = t[0, i] / (size * scale[i] * scale[i])
            x[r] += (u[r, i] - u[0, i]) * along
            cosine[r] += t[r, i] * along
            across += (t[r, i] / scale[i]) ** 2
        if cosine[r] < MIN_EXTRAPOLATION_COSINE * math.sqrt(across):
            return
        cosine[0] = size
        for i in range(n):
            guess[i] = 0.0
        for k in range(r + 1):
            value, slope = _hermite(x, k, r + 1, step)
            for i in range(n):
                guess[i] += value * u[k, i] + slope / cosine[k] * t[k, i]
        moved = scaled_distance(guess, out, scale)
        if not moved < change:
            return
        change = moved
        for i in range(n):
            out[i] = guess[i]


@kernel
def _hermite(x: Any, k: int, r: int, at: float) -> tuple[float, float]:
    """Weights at a place of the value and the slope at node k of r: L^2 (1 - 2 (x - x_k) L'(x_k)) and L^2 (x - x_k)."""
    lagrange, steep = 1.0, 0.0
    for j in range(r):
        if j != k:
            lagrange *= (at - x[j]) / (x[k] - x[j])
            steep += 1.0 / (x[k] - x[j])
    off, square = at - x[k], lagrange * lagrange
    return square * (1.0 - 2.0 * off * steep), square * off


@kernel
def newton_status(
    residual: float, step: float, last: float, first: float, best: float, iteration: int,
    tolerance: float, step_tolerance: float, most: int, sharp: float,
) -> tuple[bool, int]:  # fmt: skip
    """Return whether an iterate is converged and the best so far, and `CONTINUE`, `CONVERGED` or `DIVERGED`.

    Parameters
    ----------
    residual, step, last : relative residual, Newton step from here, and the step before. first : least residual of
        those before. best : residual of the converged one known, inf if none is. sharp : share of the tolerance above
        which a converged point gets one Newton step more.
    """
    if best < math.inf:
        return residual < best, CONVERGED
    if residual <= tolerance and (last <= step_tolerance or iteration == 0):
        return True, CONTINUE if residual > sharp * tolerance and step <= step_tolerance else CONVERGED
    diverged = not math.isfinite(residual) or (iteration > 3 and residual > 10 * first)
    return False, DIVERGED if diverged or iteration >= most else CONTINUE


@kernel
def accept_step(
    u: Any, t: Any, predicted: Any, before: Any, tangent: Any, scale: Any, step: float, limits: Any
) -> tuple[int, float, float]:
    """Whether a corrected point u with direction t is a row of the curve; the turn [deg] and the miss, in steps.

    t is made a unit vector in scaled unknowns, given unscaled. limits : largest turn, largest miss (inf for any).
    """
    size, other, product = 0.0, 0.0, 0.0
    for i in range(u.shape[0]):
        a, b = t[i] / scale[i], tangent[i] / scale[i]
        size, other, product = size + a * a, other + b * b, product + a * b
    for i in range(u.shape[0]):
        t[i] /= math.sqrt(size)
    turn = math.degrees(math.acos(min(1.0, max(-1.0, product / math.sqrt(size * other)))))
    missed = scaled_distance(u, predicted, scale) / step
    if scaled_distance(u, before, scale) > MAX_LANDING_DISTANCE * step:
        return LANDED_FAR, turn, missed
    if turn > limits[0]:
        return TURNED_TOO_FAR, turn, missed
    return PREDICTION_ERROR if missed > limits[1] else ACCEPTED, turn, missed


@kernel
def next_step(step: float, iterations: int, turn: float, missed: float, control: Any) -> float:
    """Next step from the Newton count, the turn and the miss of the last, at most doubled or halved.

    control : shortest and longest step, largest turn [deg], Newton steps aimed at, largest miss.
    """
    by_newton = 2.0 ** ((control[3] - iterations) / 2)
    by_turn = 0.5 * control[2] / max(turn, 0.1)
    by_miss = math.sqrt(0.5 * control[4] / max(missed, 1e-9))
    factor = min(2.0, max(0.5, min(by_newton, min(by_turn, by_miss))))
    length: float = min(control[1], max(control[0], factor * step))
    return length


@kernel
def arclength_normal(tangent: Any, scale: Any, out: Any) -> None:
    """Put the unit normal, in unscaled unknowns, of the plane across a direction in scaled ones in out."""
    for i in range(out.shape[0]):
        out[i] = tangent[i] / (scale[i] * scale[i])
    size = scaled_norm(out)
    for i in range(out.shape[0]):
        out[i] /= size
