"""Step over a corner of a curve, at which the tangent is discontinuous because derivatives of the equations are.

dR/dX jumps where a friction slider begins to slip, or where a sampled law has a breakpoint. The derivatives of the
equations of a special point jump where a contact begins, or have the slope of a square root there:

    g = y   for x <= 0,   g = y + b sqrt(x)   for x > 0          x distance beyond the grazing motion

The curve g = 0 of folds arrives along y = 0 and leaves along y = -b sqrt(x), tangent to the boundary x = 0, or the
other way round. x grows in the direction n of the largest change of the derivatives. A probe is moved beyond it: in
the direction of the old tangent, or along n if that tangent lies in the boundary. There one Newton step at constant x
predicts a point of the curve. The orientation of the curve is kept, also if it turns by more than 90 degrees, so that
the parameter turns back as at a fold:

    sign det [dR_dX dR_dp; t^T] as before

References
----------
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154, for
piecewise smooth curves and their orientation.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import as_dense, bordered, norm, solve_signed
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.corrector import CorrectedPoint, correct
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, SOLVER_ERRORS, NewtonSettings, NoConvergence, solve

PROBE_DISTANCES = (1e2, 1e3, 1e4)
"""Distances of the probes from the last point, over the smallest step. The last point lies within a few smallest steps
before the corner."""

SHORTEST_STEP = 10.0
"""Shortest step beyond the corner, over the smallest step: a nearer point may lie on the boundary."""

LONGEST_STEP_OVER_ROOT = 10.0
"""Longest step beyond the corner, over the square root of the distance of the probe: farther points may lie on another
curve."""


MIN_CROSSING_SHARE = 1e-3
"""Smallest change of an equation along the curve at a crossing of the boundary, over the largest in any direction."""


class Corner(NamedTuple):
    """Equations of a curve, and its last point near a corner.

    Attributes
    ----------
    equations : CurveEquations
        The equations.
    settings : NewtonSettings
        Settings of the corrector.
    u, tangent : ndarray, shape (n + 1,)
        Unknowns and tangent of the point.
    orientation : int
        Orientation of the point, see `CurvePoint`.
    scale : ndarray, shape (n + 1,)
        Scales of the unknowns.
    """

    equations: CurveEquations
    settings: NewtonSettings
    u: Array
    tangent: Array
    orientation: int
    scale: Array


def step_over_corner(corner: Corner, smallest: float, turn: float) -> tuple[CorrectedPoint, float] | None:
    """Return a point beyond a corner near the last point u (n + 1,) of a curve, and the size of the step; None without.

    ``smallest`` is the smallest step size, at which the usual step failed, and ``turn`` the largest angle [deg] between
    the step to the new point and the direction of the curve there. The direction of the point is oriented along the
    curve.
    """
    for distance in PROBE_DISTANCES:
        delta = distance * smallest
        limits = (SHORTEST_STEP * smallest, LONGEST_STEP_OVER_ROOT * math.sqrt(delta), turn)
        try:
            result = _point_beyond(corner, delta, limits)
        except SEARCH_ERRORS:  # ValueError of a model
            continue
        if result is not None:
            return result
    return None


def _point_beyond(
    corner: Corner, delta: float, limits: tuple[float, float, float]
) -> tuple[CorrectedPoint, float] | None:
    """Return the point beyond the corner with one distance of the probes, and its distance; None without one.

    limits : shortest and longest step, and largest angle [deg] between the step and the direction of the curve.
    """
    u, scale, orientation = corner.u, corner.scale, corner.orientation
    tangent = corner.tangent / norm(corner.tangent / scale)
    n = _largest_change(corner, u + delta * tangent)
    for direction in (tangent, n, -n):
        with suppress(*SOLVER_ERRORS):
            candidate = _nearer(corner, _from_probe(corner, u + delta * direction, n), limits[1])
            oriented = candidate.direction * (candidate.orientation * orientation or 1)
            chord = candidate.u - u
            length, size = norm(chord / scale), norm(oriented / scale)
            cosine = float((chord / scale) @ (oriented / scale)) / (length * size)
            if limits[0] <= length <= limits[1] and cosine >= math.cos(math.radians(limits[2])):
                return CorrectedPoint(candidate.solution, oriented / size, orientation), length
    return None


def _largest_change(corner: Corner, probe: Array) -> Array:
    """Return the direction in which the derivatives change between two points, of unit length.

    It is that of the equation whose change is largest along the line through the points. If the line lies in the
    boundary, it is that of the largest change. Where many contacts begin at once, as all around a circular whirl, some
    equations change in directions across the curve only.
    """
    u, scale = corner.u, corner.scale
    evaluations = (corner.equations.linearise(point) for point in (u, probe))
    before, beyond = (np.column_stack([as_dense(e.dR_dX), e.dR_dp]) * scale for e in evaluations)
    change, along = beyond - before, (probe - u) / scale
    sizes, changes = np.linalg.norm(change, axis=1), np.abs(change @ along) / np.linalg.norm(along)
    crosses = changes.max() > MIN_CROSSING_SHARE * sizes.max()
    i = int(np.argmax(changes if crosses else sizes))
    return change[i] * scale / (float(sizes[i]) or 1.0)


def _from_probe(corner: Corner, probe: Array, n: Array) -> CorrectedPoint:
    """Return the point of the curve that one Newton step from the probe, in the plane across n, predicts."""
    from hbgear.continuation.stepping.kernels import arclength_normal

    normal, probed = np.empty(len(probe)), corner.equations.linearise(probe)
    arclength_normal(n, corner.scale, normal)
    step = solve_signed(bordered(probed.dR_dX, probed.dR_dp, normal), np.append(probed.R, 0.0)[:, None])[0][:, 0]
    arclength_normal(probe - step - corner.u, corner.scale, normal)
    return _corrected(corner, probe - step, normal)


def _nearer(corner: Corner, point: CorrectedPoint, longest: float) -> CorrectedPoint:
    """Return the point of the curve at most the longest step away: half the way from the last point, repeatedly.

    Where the coefficient b of the root is small, one Newton step from a probe leads far along the curve.
    """
    from hbgear.continuation.stepping.kernels import arclength_normal

    u, scale = corner.u, corner.scale
    normal, length = np.empty(len(u)), norm((point.u - u) / scale)
    for _ in range(math.ceil(math.log2(max(length / longest, 1.0)))):
        chord = point.u - u
        arclength_normal(chord, scale, normal)
        point = _corrected(corner, u + 0.5 * chord, normal)
    return point


def _corrected(corner: Corner, predicted: Array, normal: Array) -> CorrectedPoint:
    """Return the solution near a predicted point, if necessary after Newton's method with step halving.

    The slope of a square root lets Newton's method oscillate between both sides of the corner.
    """
    from hbgear.continuation.stepping.kernels import POLISH_ABOVE

    equations, settings = corner.equations, corner.settings
    try:
        return correct(equations, predicted, normal, settings, POLISH_ABOVE)
    except NoConvergence:
        parameters = equations.parameters_at(float(predicted[-1]))
        nearby = solve(equations.problem, predicted[:-1], parameters, settings=settings)
    return correct(equations, np.append(nearby.X, predicted[-1]), normal, settings, POLISH_ABOVE)
