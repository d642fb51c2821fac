"""Branches that leave curves in contact instants at period doublings and branch points, in the unknowns of a state."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any, NamedTuple, cast

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.bifurcations.multiplier_events import PeriodDoublingEvent
from hbgear.harmonic.instants.corrector import CurveState, Family, jacobian
from hbgear.harmonic.instants.pattern import Pattern
from hbgear.harmonic.instants.sampling import coefficients
from hbgear.harmonic.instants.shooting import Iterate


class ExactStart(NamedTuple):
    """First state of a branch, and in its unknowns the direction in which the branch leaves another one, if it does."""

    state: CurveState
    direction: Array | None


class ExactPeriodDoubling(PeriodDoublingEvent):
    """Period doubling of exact motions: the branch of twice the period is traced in contact instants as well."""

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> tuple[Any, BranchStart]:
        """Return the problem of twice the period and the start at the point; both sides are the same motion."""
        problem = point.problem or branch.require_problem()
        doubled = problem.with_order(2 * problem.nu, 2 * problem.H)
        single = problem.exact_state(point.X, branch.parameter, point.parameters)
        fixed = {name: value for name, value in point.parameters.items() if name != branch.parameter}
        state, direction = _doubled_state(single, math.tau * problem.nu, doubled.family(branch.parameter, fixed))
        return doubled, _branch_start(doubled, point, ExactStart(state, side * direction))


class ExactBranchPoint(BranchPointEvent):
    """Branch point of exact motions: the other branch is traced in contact instants as well."""

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> tuple[Any, BranchStart]:
        """Return the problem, and the start of the branch that crosses the traced curve."""
        problem, i, name = point.problem or branch.require_problem(), point.index, branch.parameter
        state = _state_near(problem, branch, i)
        fixed = {key: value for key, value in point.parameters.items() if key != name}
        family, scale = problem.family(name, fixed), state.scale(float(np.ptp(branch.values)) or 1.0)
        null = np.linalg.svd(jacobian(family, state)[1] * scale)[2][-2:]
        changes = np.array([_change_of_gaps(family, state, direction * scale, problem.H) for direction in null])
        before, after = max(i - 1, 0), min(i + 1, len(branch) - 1)
        along_curve = np.linalg.lstsq(changes.T, branch.X[after] - branch.X[before])[0]
        along_curve = along_curve / np.linalg.norm(along_curve)
        transverse = np.array([-along_curve[1], along_curve[0]]) @ null
        return problem, _branch_start(problem, point, ExactStart(state, side * transverse * scale))


def _state_near(problem: Any, branch: Branch, i: int) -> CurveState:
    """Return the state of a branch point, where Newton's method does not converge, or of a point next to it."""
    states = problem.nearest_states(branch.X[i], branch.parameters_at(i))
    if states:
        return cast(CurveState, states[0])
    for k in (i, max(i - 1, 0), min(i + 1, len(branch) - 1)):
        with suppress(NoConvergence):
            return cast(CurveState, problem.exact_state(branch.X[k], branch.parameter, branch.parameters_at(k)))
    raise NoConvergence("no exact motion was found at the branch point", branch.X[i], branch.parameters_at(i), [])


def _change_of_gaps(family: Family, state: CurveState, direction: Array, H: int) -> Array:
    """Return the derivatives of the coefficients of all gaps in a direction of the state."""
    rows = []
    for sign in (1, -1):
        shifted = state.with_z(state.z + sign * DIFFERENCE * direction)
        rows.append(coefficients(family(shifted.value), shifted.iterate, H)[0].ravel())
    return (rows[0] - rows[1]) / (2 * DIFFERENCE)


DIFFERENCE = 1e-5
"""Step in scaled unknowns of the derivatives of coefficients, which select one of two directions."""


def _branch_start(problem: Any, point: SpecialPoint, start: ExactStart) -> BranchStart:
    """Return a start of a problem that follows curves itself: it has no coefficients and no direction of them."""
    X = np.zeros(problem.size)
    return BranchStart(X, dict(point.parameters), np.append(X, 0.0), event=start)


def _doubled_state(single: CurveState, period: float, family: Family) -> tuple[CurveState, Array]:
    """Return a motion over two periods, and the null vector that a shift by one period reverses."""
    iterate = single.iterate
    pattern = Pattern(iterate.pattern.switches * 2, iterate.pattern.contacts * 2)
    doubled = Iterate(pattern, np.concatenate([iterate.tau, iterate.tau + period]), np.concatenate([iterate.x] * 2))
    state = CurveState.of(doubled, single.value)
    J, scale = jacobian(family, state)[1], state.scale(1.0)
    n, free = iterate.x.size, len(single.z) - 1 - iterate.x.size
    blocks = [np.r_[0:n, 2 * n : 2 * n + free], np.r_[n : 2 * n, 2 * n + free : 2 * n + 2 * free]]
    antisymmetric = np.zeros((len(state.z), n + free))
    antisymmetric[blocks[0], range(n + free)], antisymmetric[blocks[1], range(n + free)] = 1.0, -1.0
    null = np.linalg.svd((J * scale) @ antisymmetric)[2][-1]
    return state, (antisymmetric @ null) * scale
