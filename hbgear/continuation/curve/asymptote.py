"""Vertical asymptotes: values of the parameter at which solutions tend to infinity.

    R_inf(y, p) = lim R(r y, p) / r = 0,   |y| = 1,   r = |X| -> inf

Equations whose terms grow at most linearly with the unknowns become homogeneous far from the origin. An unbounded curve
approaches a solution (y, p) of the limit equations. With u = 1 / r it is a smooth curve (y, p)(u) that ends at u = 0. A
point belongs to such a curve if its tangent, extrapolated to u = 0, meets a solution of the limit equations up to terms
of second order in u.

    p = p_inf + C r^-k

Free motions of unknown frequency have no such limit equations. An unbounded curve of them approaches its asymptote by a
power of its size, as the damping of a limit cycle with a cubic spring by r^-2. The exponent is the same between r / 8,
r / 4, r / 2 and r, and the limit follows from it. Farther out the parameter changes by less than it is known, so that
any special point there would be a rounding error.
"""

from __future__ import annotations

import math

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.curve_equations import CurveEquations

MAX_ASYMPTOTE_ITERATIONS = 12
"""Maximum number of Newton iterations on the limit equations."""


ROUNDING_SINGULAR_VALUE = 1e-9
"""Singular value, relative to the largest one, below which it is rounding error."""


MAX_LIMIT_RESIDUAL = 0.02
"""Residual of the limit equations at a point, as a relative parameter change, above which it is not far enough out."""


MAX_ASYMPTOTE_DISTANCE = 0.3
"""Extrapolated distance from the asymptote in (y, p), with relative p, up to which the asymptote is computed."""


MAX_TANGENT_MISS = 0.2
"""Largest distance between extrapolation and asymptote, relative to the extrapolated distance."""


SOLUTION_RESIDUAL = 1e-11
"""Residual of a solution of the limit equations, as a relative parameter change. Finite resonances leave more."""


MAX_REMAINING_CHANGE = 1e-4
"""Distance from the limit of a power law, relative to the width of the span, up to which a curve ends there.

Farther out rounding errors of the parameter shorten the steps and change signs of test functions: from a fifth of this
distance on a curve of folds, a hundredth on one of limit cycles.
"""


MAX_DOUBLING_RATIO = 0.75
"""Ratio of the parameter changes of two successive doublings of the size, above which no limit is assumed."""


MAX_RATIO_DIFFERENCE = 0.1
"""Relative difference of two successive ratios up to which the curve follows a power law."""


MIN_LIMIT_ERROR = 0.01
"""Smallest error of the limit of a power law, relative to its distance, because points are interpolated."""


SIZE_RATIO = 8.0
"""Growth of the size over which a power law is compared: three doublings, which have two ratios."""


def unbounded_message(name: str, value: float) -> str:
    """Return the message of a curve that ends at an asymptote."""
    return f"the curve runs off to infinity towards {name} = {value:.6g}"


def vertical_asymptote(equations: CurveEquations, point: CurvePoint) -> float | None:
    """Return the parameter value at which a curve tends to infinity ahead of a point; None if it does not."""
    try:
        return _asymptote_ahead(equations, point)
    except (ValueError, np.linalg.LinAlgError):  # a model refuses the value, or numbers overflow
        return None


def _asymptote_ahead(equations: CurveEquations, point: CurvePoint) -> float | None:
    """Return the asymptote as `vertical_asymptote` does; errors of the model are raised."""
    X, p, r = point.X, point.value, norm(point.X)
    outward = float(X @ point.tangent[:-1]) / r if r else 0.0
    if not outward > 0:
        return None
    # extrapolated to u = 0, the tangent of (y, p)(u) leads to y = dX/dr and p + r dp/dr
    size, y, value = abs(p) or 1.0, point.tangent[:-1] / outward, p + r * float(point.tangent[-1]) / outward
    distance = float(np.hypot(norm(y - X / r), (value - p) / size))
    if not distance < MAX_ASYMPTOTE_DISTANCE:
        return None
    limit_problem = equations.problem.recession(X, equations.parameters_at(p))
    if limit_problem is None:
        return None
    limit_equations = equations._replace(problem=as_problem(limit_problem))
    evaluation = limit_equations.linearise(point.u)
    if not norm(evaluation.R) < MAX_LIMIT_RESIDUAL * size * norm(evaluation.dR_dp):
        return None
    solution = _limit_solution(limit_equations, y, value)
    if solution is None:
        return None
    miss = float(np.hypot(norm(solution[0] - y), (solution[1] - value) / size))
    return solution[1] if miss < MAX_TANGENT_MISS * distance else None


def _limit_solution(equations: CurveEquations, y: Array, p: float) -> tuple[Array, float] | None:
    """Solve R_inf(y, p) = 0 by Newton's method orthogonal to y; return None if it fails.

    Steps are least-squares solutions, because the phase of undamped motions is arbitrary.
    """
    allowed, size = equations.problem.range_of(equations.name), abs(p) or 1.0
    normal = y = y / norm(y)
    for _ in range(MAX_ASYMPTOTE_ITERATIONS):
        evaluation = equations.linearise(np.append(y, p))
        if norm(evaluation.R) <= SOLUTION_RESIDUAL * size * norm(evaluation.dR_dp):
            return y, p
        A = np.block([[evaluation.dR_dX, evaluation.dR_dp[:, None]], [normal[None], np.zeros((1, 1))]])
        step = np.linalg.lstsq(A, np.append(evaluation.R, 0.0), rcond=ROUNDING_SINGULAR_VALUE)[0]
        y, p = y - step[:-1], p - float(step[-1])
        if p not in allowed or not norm(y) > 0:
            return None
        y = y / norm(y)
    return None


def power_law_limit(sizes: Array, values: Array) -> tuple[float, float] | None:
    """Return the limit p_inf of a curve whose parameter follows p_inf + C r^-k as its size r grows, and its error.

    The sizes r (P,) of the last points grow by a factor of eight at least, with the values p (P,). None is returned if
    the changes of p follow no power law.

    Examples
    --------
    >>> r = np.geomspace(1.0, 10.0, 80)
    >>> limit, error = power_law_limit(r, 0.3 - 1e-4 / r**2)
    >>> round(limit, 7), error < 2e-8, power_law_limit(r, np.log(r))
    (0.3, True, None)
    """
    doublings = sizes[-1] / SIZE_RATIO * np.array([1.0, 2.0, 4.0, 8.0])
    changes = np.diff(np.interp(np.log(doublings), np.log(sizes), values))
    if not changes.all():
        return None
    first, last = (changes[1:] / changes[:-1]).tolist()
    difference = abs(first - last) / last
    if not 0 < last < MAX_DOUBLING_RATIO or difference > MAX_RATIO_DIFFERENCE:
        return None
    remaining = float(changes[-1]) * last / (1 - last)  # later ratios differ by as much as the last two together
    return float(values[-1]) + remaining, abs(remaining) * max(2 * difference / (1 - last), MIN_LIMIT_ERROR)


def rounded_to_error(value: float, error: float) -> float:
    """Return a value without the digits that are smaller than its error.

    Examples
    --------
    >>> rounded_to_error(0.123456, 2e-3), rounded_to_error(-3e-9, 1e-6)
    (0.12, 0.0)
    """
    return round(value, -math.ceil(math.log10(error))) + 0.0  # no negative zero
