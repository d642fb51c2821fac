"""A step: prediction, Newton's iteration for w at the Gauss points, and the state at the end."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import kernel
from hbgear.time.exponential.kernels.breakpoints import level_at
from hbgear.time.exponential.kernels.data import ROW, Breakpoints, Method, Plan, Tables, Work
from hbgear.time.exponential.kernels.tables import plan_row, table_row, work_row
from hbgear.time.exponential.segments import Integers


@kernel
def predict(observe: Array, drive: Array, cell: int, zeta: Array, free: Array, y: Array, w: Array) -> None:
    """Compute d and v in a step without w."""
    for i in range(len(free)):
        free[i] = drive[cell, i]
    for r in range(len(zeta)):
        z = zeta[r]
        for i in range(len(free)):
            free[i] += observe[r, i] * z
    for i in range(len(free)):
        y[i] = free[i]
    for i in range(len(w)):
        w[i] = 0.0


@kernel
def linearise(laws: Any, step: Any, breakpoints: Breakpoints | None) -> float:
    """Compute the equations J step = right of the next Newton step for w, and return the size of the forces."""
    kr, cubic, element, contact, slope, offset, segment, in_python, nodes, levels = laws
    forces, k, feedback, progress, y, w, J, right, scratch = step
    s, m, size, cell = k.shape[1], len(kr), 0.0, progress[ROW]
    for i in range(s):
        for j in range(m):
            a, d = i * m + j, y[i * 2 * m + j]
            right[a] = (cubic[j, 0] + cubic[j, 1] * d * d) * d
            scratch[0, a] = cubic[j, 0] + 3.0 * cubic[j, 1] * d * d
    for spring in range(len(element)):
        j = element[spring]
        row = j if contact[spring] < 0 else m + contact[spring]
        gradient, constant = slope[spring, segment[row]], offset[spring, segment[row]]
        if gradient == 0.0 and constant == 0.0:
            continue
        for i in range(s):
            x = y[i * 2 * m + j] if row == j else y[i * 2 * m + j] - level_at(levels, row, nodes[i])
            right[i * m + j] += k[cell, i, spring] * (gradient * x + constant)
            scratch[0, i * m + j] += k[cell, i, spring] * gradient
    for i in range(s):
        for j in range(m):
            a, row = i * m + j, i * 2 * m + j
            if in_python[j]:
                right[a], scratch[0, a] = forces[0, i, j], forces[1, i, j]
            linear, gradient = kr[j] * y[row], scratch[0, a] - kr[j]
            size = max(size, abs(right[a]) + abs(linear))
            right[a] -= linear + w[a]
            if breakpoints is not None:
                right[a] -= k[cell, i, len(element) + j]
            for e in range(s * m):
                J[a, e] = gradient * feedback[row, e]
            if in_python[j]:
                for e in range(s * m):
                    J[a, e] += forces[2, i, j] * feedback[row + m, e]
            J[a, a] += 1.0
    return size


@kernel
def correct(J: Array, right: Array, feedback: Array, free: Array, y: Array, w: Array) -> float:
    """Apply the Newton step to w, d and v, and return the largest change of w."""
    _solve(J, right)
    change = 0.0
    for a in range(len(w)):
        change = max(change, abs(right[a]))
        w[a] += right[a]
    for i in range(len(y)):
        total = free[i]
        for a in range(len(w)):
            total -= feedback[i, a] * w[a]
        y[i] = total
    return change


@kernel
def law_arguments(plan: Plan, method: Method, segment: Integers, work: Work) -> Any:
    """Return the first argument of `linearise` for rows of the plan and the work."""
    laws = plan.kr, plan.cubic, method.element, method.contact, plan.slope, plan.offset, segment, method.in_python
    return (*laws, method.nodes, work.levels)


@kernel
def newton_arguments(table: Tables, work: Work) -> Any:
    """Return the second argument of `linearise` and the arguments of `correct` for rows of the tables and the work."""
    step = work.forces, table.k, table.feedback, work.progress, work.y, work.w, work.J, work.right, work.scratch
    return step, (work.J, work.right, table.feedback, work.free, work.y, work.w)


@kernel
def _solve(A: Array, b: Array) -> None:
    """Solve A x = b by Gaussian elimination with partial pivoting; x replaces b, A is overwritten."""
    n = len(b)
    for i in range(n):
        best = i
        for j in range(i + 1, n):
            if abs(A[j, i]) > abs(A[best, i]):
                best = j
        if best != i:
            b[i], b[best] = b[best], b[i]
            for e in range(i, n):
                A[i, e], A[best, e] = A[best, e], A[i, e]
        inverse = 1.0 / A[i, i]
        for j in range(i + 1, n):
            factor = A[j, i] * inverse
            if factor != 0.0:
                b[j] -= factor * b[i]
                for e in range(i + 1, n):
                    A[j, e] -= factor * A[i, e]
    for i in range(n - 1, -1, -1):
        x = b[i]
        for e in range(i + 1, n):
            x -= A[i, e] * b[e]
        b[i] = x / A[i, i]


@kernel
def propagate_state(turn: ComplexArray, push: Array, w: Array, zeta: Array) -> None:
    """Compute zeta at the end of the step."""
    q = len(turn)
    for r in range(q):
        re, im = zeta[r], zeta[q + r]
        zeta[r] = turn[r].real * re - turn[r].imag * im
        zeta[q + r] = turn[r].real * im + turn[r].imag * re
    for a in range(len(w)):
        for r in range(2 * q):
            zeta[r] -= push[a, r] * w[a]


@kernel
def fold(plan: Plan, method: Method, breakpoints: Breakpoints | None, cells: Tables, work: Work, out: Array) -> None:
    """Compute steps over whole cells with laws that are linear on their segments: linear maps of zeta.

    out (N, combinations of segments, 2 q + 1, (s + 1) 2 m + 2 q): contribution of each component of zeta, and last of
    the loads, to d and v at the nodes and to zeta at the end.
    """
    m, P, size = plan.kr.shape[1], plan.low.shape[2], plan.output.shape[2] * 2
    n = out.shape[3] - size
    row, table, step = plan_row(plan, 0), table_row(cells, 0), work_row(work, 0)
    segment, zeta, y, w = np.zeros(m, dtype=np.int64), work.zeta_end, step.y, step.w
    of_laws, (of_equations, of_correction) = law_arguments(row, method, segment, step), newton_arguments(table, step)
    for cell in range(out.shape[0]):
        for combination in range(out.shape[1]):
            for j in range(m):
                segment[j] = combination // P**j % P
            for u in range(size, -1, -1):  # the response to the loads first, which is subtracted from the others
                for r in range(size):
                    zeta[r] = 1.0 if r == u else 0.0
                predict(table.observe, table.drive, cell, zeta, step.free, y, w)
                step.progress[ROW] = cell
                linearise(of_laws, of_equations, breakpoints)
                correct(*of_correction)
                propagate_state(table.turn, table.push, w, zeta)
                for i in range(n + size):
                    loads = 0.0 if u == size else out[cell, combination, size, i]
                    out[cell, combination, u, i] = (y[i] if i < n else zeta[i - n]) - loads


@kernel
def folded_step(maps: Array, cell: int, segment: Integers, P: int, zeta: Array, y: Array, zeta_end: Array) -> None:
    """Compute a step over a whole cell by its linear map: d and v at the nodes, zeta at the end."""
    combination, size, n = 0, len(zeta), len(y)
    for j in range(len(segment) - 1, -1, -1):
        combination = combination * P + segment[j]
    for i in range(n):
        y[i] = maps[cell, combination, size, i]
    for i in range(size):
        zeta_end[i] = maps[cell, combination, size, n + i]
    for r in range(size):
        z = zeta[r]
        for i in range(n):
            y[i] += maps[cell, combination, r, i] * z
        for i in range(size):
            zeta_end[i] += maps[cell, combination, r, n + i] * z
