"""Where a curve runs off to infinity.

Far out equations whose terms grow no faster than their unknowns become homogeneous, and a curve without bound nears

    R_inf(y, p) = lim R(r y, p) / r = 0,   |y| = 1

as r = |X| -> inf. With u = 1 / r it is a smooth curve (y, p) of u that ends at u = 0. A row belongs to such a curve if
its tangent, followed to u = 0, meets a solution of these equations: up to terms of the second order in u.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, linearise

_ITERATIONS = 12


_RANK = 1e-9  # singular values, relative to the largest, that are rounding


_REST = 0.02  # what a curve far out may leave of R_inf, as a relative change of the parameter


_NEAR = 0.3  # distance to the asymptote in (y, p), that in p relative, from which it is looked for


_CURVED = 0.2  # share of it by which the tangent may miss


_EXACT = 1e-11  # the same of a solution; a sharp resonance that is finite leaves more


def vertical_asymptote(
    problem: ContinuationProblem, name: str, fixed: Mapping[str, float], row: CurvePoint
) -> float | None:
    """The value of the parameter at which the curve, on its way at a row, runs off to infinity; None if it does not."""
    try:
        return _ahead(problem, name, fixed, row)
    except (ValueError, np.linalg.LinAlgError):  # out of the range of a model, or of numbers
        return None


def _ahead(problem: ContinuationProblem, name: str, fixed: Mapping[str, float], row: CurvePoint) -> float | None:
    X, p, r = row.X, row.value, norm(row.X)
    outward = float(X @ row.tangent[:-1]) / r if r else 0.0
    if not outward > 0:
        return None
    known = problem.recession(X, {**fixed, name: p})
    if known is None:
        return None
    far, size = as_problem(known), abs(p) or 1.0
    now = linearise(far, X, name, {**fixed, name: p})
    if not norm(now.R) < _REST * size * norm(now.dR_dp):
        return None
    # the tangent of (y, p) as a curve of u leads, for what is left of u, to dX/dr and p + r dp/dr
    ahead, value = row.tangent[:-1] / outward, p + r * float(row.tangent[-1]) / outward
    left = float(np.hypot(norm(ahead - X / r), (value - p) / size))
    found = _solved(far, name, fixed, ahead, value) if left < _NEAR else None
    if found is None:
        return None
    missed = float(np.hypot(norm(found[0] - ahead), (found[1] - value) / size))
    return found[1] if missed < _CURVED * left else None


def _solved(
    far: ContinuationProblem, name: str, fixed: Mapping[str, float], y: Array, p: float
) -> tuple[Array, float] | None:
    """Newton on R_inf(y, p) = 0 across y, by least squares: undamped motions may have any phase."""
    allowed, size = far.range_of(name), abs(p) or 1.0
    across = y = y / norm(y)
    for _ in range(_ITERATIONS):
        now = linearise(far, y, name, {**fixed, name: p})
        if norm(now.R) <= _EXACT * size * norm(now.dR_dp):
            return y, p
        A = np.block([[now.dR_dX, now.dR_dp[:, None]], [across[None], np.zeros((1, 1))]])
        step = np.linalg.lstsq(A, np.append(now.R, 0.0), rcond=_RANK)[0]
        y, p = y - step[:-1], p - float(step[-1])
        if p not in allowed or not norm(y) > 0:
            return None
        y = y / norm(y)
    return None
