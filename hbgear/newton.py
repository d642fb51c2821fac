"""Newton's method on a problem, at a fixed parameter and on a pseudo-arclength plane.

A *problem* is anything with

    evaluate(X, **parameters) -> (R, dR_dX)          R (n,), dR_dX (n, n)

It may also offer, for speed and accuracy,

    linearise(X, name, **parameters) -> Evaluation   R, dR_dX, dR_d(name) and the size of the terms R is the sum of
    linearise_all(X, Omega, **parameters)            the same, name being Omega, for many X (k, n) and Omega (k,)

Without the first dR_d(name) is a central difference and the size is taken as 1 + |X|. Nothing here knows any physics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.fourier import Array
from hbgear.ranges import POSITIVE, checked, counted


class Problem(Protocol):
    """What continuation needs to know of a problem."""

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Array]:
        """R (n,) and dR/dX (n, n)."""
        ...


class Evaluation(NamedTuple):
    """R (n,), dR_dX (n, n), dR_dp (n,) and the size of the terms of R, against which |R| is judged."""

    R: Array
    dR_dX: Array
    dR_dp: Array
    size: float


class Evaluations(NamedTuple):
    """Evaluations of k points: R (k, n), dR_dX (k, n, n), dR_dp (k, n) and sizes (k,)."""

    R: Array
    dR_dX: Array
    dR_dp: Array
    size: Array


class NoConvergence(RuntimeError):
    """Newton's method failed; carries the last iterate ``X``, ``parameters`` and relative ``residuals``."""

    def __init__(self, message: str, X: Array, parameters: Mapping[str, float], residuals: list[float]) -> None:
        super().__init__(message)
        self.X, self.parameters, self.residuals = X, dict(parameters), residuals


@dataclass(frozen=True)
class Settings:
    """Corrector settings.

    tolerance : largest |R| / size of a converged point. A trace gives a row that is not a hundred times better one
        Newton step more, for predictions are often good enough to be accepted with few digits.
    step_tolerance : largest last Newton step relative to |u| of a converged point.
    max_iterations : Newton steps before giving up.

    Raises
    ------
    ValueError
        If a number is not positive, or max_iterations no whole number.
    """

    tolerance: float = 1e-10
    step_tolerance: float = 1e-6
    max_iterations: int = 12

    def __post_init__(self) -> None:
        for name in ("tolerance", "step_tolerance"):
            checked("Settings", name, getattr(self, name), POSITIVE)
        counted("Settings: max_iterations", self.max_iterations)


@dataclass(frozen=True)
class Solution:
    """A converged point: X, the parameter's value, its evaluation, Newton steps and relative residual."""

    X: Array
    value: float
    evaluation: Evaluation
    iterations: int
    residual: float


def norm(x: Array) -> float:
    """Euclidean norm of all entries, as `numpy.linalg.norm` gives it at several times the cost for short arrays."""
    x = x.ravel().view(float)
    return math.sqrt(x.dot(x))


def norms(x: Array) -> Array:
    """Euclidean norms (P,) of all entries of each x[p], (P, ...)."""
    flat = x.reshape(len(x), math.prod(x.shape[1:]))
    if flat.dtype == complex:
        flat = flat.view(float)
    return np.sqrt(np.einsum("ij,ij->i", flat, flat))


def unit_of(problem: Any, name: str, value: float) -> float:
    """Size against which a change of a parameter is small: its value, near zero a thousandth of the problem's own."""
    own = getattr(problem, "parameters", {}).get(name, 0.0)
    return max(abs(value), 1e-3 * abs(own)) or 1.0


def linearise(problem: Any, X: Array, name: str, parameters: Mapping[str, float]) -> Evaluation:
    """R, dR/dX, dR/dname (zeros without a name) and the size of R's terms, from whatever the problem offers."""
    if hasattr(problem, "linearise"):
        return problem.linearise(X, name, **parameters)
    R, J = problem.evaluate(X, **parameters)
    if not name:
        return Evaluation(np.asarray(R), np.asarray(J), np.zeros(len(X)), 1.0 + float(np.linalg.norm(X)))
    value = parameters[name]
    h = 1e-6 * max(abs(value), 1e-2)
    plus = problem.evaluate(X, **{**parameters, name: value + h})[0]
    minus = problem.evaluate(X, **{**parameters, name: value - h})[0]
    return Evaluation(np.asarray(R), np.asarray(J), (plus - minus) / (2 * h), 1.0 + float(np.linalg.norm(X)))


def linearise_all(problem: Any, U: Array, name: str, parameters: Mapping[str, float]) -> Evaluations:
    """`linearise` at points U (k, n + 1) of unknowns and parameter."""
    if name == "Omega" and hasattr(problem, "linearise_all"):
        rest = {key: value for key, value in parameters.items() if key != name}
        return problem.linearise_all(U[:, :-1], U[:, -1], **rest)
    each = [linearise(problem, u[:-1], name, {**parameters, name: float(u[-1])}) for u in U]
    return Evaluations(*(np.array(x) for x in zip(*each, strict=True)))


def observe_all(
    problem: Any, U: Array, name: str, parameters: Mapping[str, float], stability: bool
) -> list[dict[str, Any]]:
    """What a problem says of its motions U (k, n + 1): at once where only Omega differs between them."""
    if name == "Omega" and hasattr(problem, "observe_all"):
        return problem.observe_all(U[:, :-1], U[:, -1], stability=stability, **parameters)
    return [problem.observe(u[:-1], stability=stability, **{**parameters, name: float(u[-1])}) for u in U]


def solution_at(problem: Any, u: Array, name: str, parameters: Mapping[str, float], iterations: int = 0) -> Solution:
    """The solution known to lie at u (n + 1,), with its evaluation."""
    now = linearise(problem, u[:-1], name, {**parameters, name: float(u[-1])})
    return Solution(u[:-1], float(u[-1]), now, iterations, norm(now.R) / now.size)


def jacobians(problem: Any, U: Array, name: str, parameters: Mapping[str, float]) -> Array:
    """dR/dX (k, n, n) at points U (k, n + 1) of unknowns and parameter."""
    if name == "Omega" and hasattr(problem, "linearise_all"):
        return linearise_all(problem, U, name, parameters).dR_dX
    return np.array([problem.evaluate(u[:-1], **{**parameters, name: float(u[-1])})[1] for u in U])


def solve_linear(A: Array, b: Array) -> Array:
    """A^-1 b; a singular or non-finite matrix raises `numpy.linalg.LinAlgError`."""
    *_, x, info = scipy.linalg.lapack.dgesv(A, b)  # the checks of scipy.linalg.solve cost more than the solution
    if info or not math.isfinite(x.sum()):
        raise np.linalg.LinAlgError("singular matrix")
    return x


def is_singular(A: Array) -> bool:
    """Whether a finite matrix is singular up to rounding, once its rows are of one size."""
    if not np.isfinite(A).all():
        return False
    largest = np.abs(A).max(axis=1, keepdims=True)
    return not largest.all() or bool(np.linalg.cond(A / largest) > _SINGULAR)


_SINGULAR = 1e13  # condition of a matrix that is singular to rounding


def solve(
    problem: Any,
    X: Array,
    parameters: Mapping[str, float],
    name: str = "",
    settings: Settings = Settings(),
) -> Solution:
    """Newton with step halving at fixed parameters.

    Parameters
    ----------
    X : (n,) start.
    parameters : all parameters of the problem.
    name : the parameter whose value and derivative the solution holds; if empty they are nan and 0.

    Raises
    ------
    NoConvergence
        If the residual does not fall below the tolerance.
    """
    X = np.array(X, dtype=float)
    now = linearise(problem, X, name, parameters)
    residuals = [norm(now.R) / now.size]
    for iteration in range(settings.max_iterations * 4 + 1):
        if residuals[-1] <= settings.tolerance:
            return Solution(X, parameters[name] if name else math.nan, now, iteration, residuals[-1])
        try:
            dX = -solve_linear(now.dR_dX, now.R)
        except np.linalg.LinAlgError:
            break
        factor = 1.0
        for _ in range(12):
            trial = linearise(problem, X + factor * dX, name, parameters)
            if norm(trial.R) < norm(now.R) * (1 - 0.1 * factor):
                break
            factor *= 0.5
        else:
            break
        X, now = X + factor * dX, trial
        residuals.append(norm(now.R) / now.size)
    if is_singular(now.dR_dX):
        raise NoConvergence(
            "the Jacobian is singular: some motion is not determined by the equations at this point (a gap that stays "
            "open without load, or a fold exactly at the start); move the start or load the system",
            X, parameters, residuals,
        )  # fmt: skip
    raise NoConvergence(
        f"Newton stopped at a relative residual of {residuals[-1]:.2e} (needed {settings.tolerance:.0e}) "
        f"after {len(residuals) - 1} steps at {describe(parameters)}",
        X, parameters, residuals,
    )  # fmt: skip


def refine(problem: Any, solution: Solution, parameters: Mapping[str, float]) -> Solution:
    """The solution after one more Newton step; as it was if that does not lower its residual.

    For equations so flat that a residual at the tolerance leaves digits of the unknowns open, as at special points.
    """
    try:
        X = solution.X - solve_linear(solution.evaluation.dR_dX, solution.evaluation.R)
    except np.linalg.LinAlgError:
        return solution
    now = linearise(problem, X, "", parameters)
    residual = norm(now.R) / now.size
    if not residual < solution.residual:
        return solution
    return replace(solution, X=X, evaluation=now, iterations=solution.iterations + 1, residual=residual)


class _Homotopy:
    """R(X) - (1 - s) R(X0) = 0: solved by X0 at s = 0, and by a solution of the problem at s = 1."""

    def __init__(self, problem: Any, X0: Array, parameters: Mapping[str, float]) -> None:
        self.problem, self.parameters = problem, parameters
        self.R0 = linearise(problem, X0, "", parameters).R

    def linearise(self, X: Array, name: str, s: float) -> Evaluation:
        now = linearise(self.problem, X, "", self.parameters)
        return Evaluation(now.R - (1 - s) * self.R0, now.dR_dX, self.R0, now.size)


def solve_from_afar(
    problem: Any,
    X: Array,
    parameters: Mapping[str, float],
    settings: Settings = Settings(),
    steps: int = 300,
) -> Solution:
    """Solution at fixed parameters from a poor start, along the path that joins the two (Newton homotopy).

    The path R(X) = (1 - s) R(X0) is followed from s = 0 to 1 by arclength, through its folds.

    Raises
    ------
    NoConvergence
        If the path does not reach s = 1 within the given number of steps.
    """
    path = _Homotopy(problem, X, parameters)
    size = float(np.linalg.norm(X)) or 1.0
    scale = np.append(np.full(len(X), size), 1.0)
    u, h = np.append(X, 0.0), 0.05
    normal = np.append(np.zeros(len(X)), 1.0)
    for _ in range(steps):
        try:
            B = bordered(path.linearise(u[:-1], "s", float(u[-1])), normal)
            t = solve_linear(B, np.append(np.zeros(len(X)), 1.0))
            t = t / np.linalg.norm(t / scale)
            across = t / scale**2 / np.linalg.norm(t / scale**2)
            found = correct(path, u + h * t, across, "s", {"s": 0.0}, Settings(1e-6, 1e-2, 6))
        except (NoConvergence, np.linalg.LinAlgError):
            h *= 0.5
            if h < 1e-6:
                break
            continue
        if found.value >= 1.0:
            share = (1.0 - u[-1]) / (found.value - u[-1])
            return solve(problem, u[:-1] + share * (found.X - u[:-1]), parameters, settings=settings)
        u, normal, h = np.append(found.X, found.value), across, min(0.3, h * (1.6 if found.iterations <= 3 else 1.0))
    raise NoConvergence(f"no path leads from the start to a solution at {describe(parameters)}", X, parameters, [])


def describe(parameters: Mapping[str, float]) -> str:
    """The parameters as ``Omega = 0.9, zeta = 0.05`` (at most four)."""
    shown = [f"{k} = {v:.6g}" for k, v in list(parameters.items())[:4]]
    return ", ".join(shown)


def correct(
    problem: Any,
    u: Array,
    normal: Array,
    name: str,
    parameters: Mapping[str, float],
    settings: Settings = Settings(),
) -> Solution:
    """Newton from the predicted point u = (X, value) in the plane normal^T (u' - u) = 0.

    Raises
    ------
    NoConvergence
        If Newton diverges, meets a singular bordered matrix or takes more than ``settings.max_iterations`` steps.
    """
    start, rhs = u, np.empty_like(u)
    residuals: list[float] = []
    step = np.inf
    for iteration in range(settings.max_iterations + 1):
        here = {**parameters, name: float(u[-1])}
        now = linearise(problem, u[:-1], name, here)
        residuals.append(norm(now.R) / now.size)
        if residuals[-1] <= settings.tolerance and (step <= settings.step_tolerance or iteration == 0):
            return Solution(u[:-1], float(u[-1]), now, iteration, residuals[-1])
        if not math.isfinite(residuals[-1]) or (iteration > 3 and residuals[-1] > 10 * residuals[0]):
            break
        rhs[:-1], rhs[-1] = now.R, normal @ (u - start)
        try:
            du = solve_linear(bordered(now, normal), rhs)
        except np.linalg.LinAlgError:
            break
        u = u - du
        step = norm(du) / (norm(u) or 1.0)
    raise NoConvergence(
        f"the corrector stopped at a relative residual of {residuals[-1]:.2e} after {len(residuals) - 1} steps",
        u[:-1], {**parameters, name: float(u[-1])}, residuals,
    )  # fmt: skip


class Corrected(NamedTuple):
    """A corrected point with the direction t of the curve there: A t = (0, ..., 0, 1), A = [dR_dX dR_dp; normal^T]."""

    solution: Solution
    direction: Array
    A: Array


_PATIENCE = 2  # Newton steps in which all points but the first must converge: where they do not, they are too far
_SHARP = 1e-2  # part of the tolerance above which a converged point gets one Newton step more


@dataclass
class _Iterate:
    """One point of `correct_all` on its way: its last Newton step and first residual, and the best it came to."""

    patience: int
    last: float = math.inf
    first: float = math.inf
    best: Corrected | None = None
    failed: bool = False

    def judge(self, residual: float, iteration: int, step: float, settings: Settings) -> tuple[bool, bool]:
        """Whether the point where it is now is converged and the best so far, and whether to take the next step."""
        close = residual <= settings.tolerance and (self.last <= settings.step_tolerance or iteration == 0)
        self.first = residual if iteration == 0 else min(self.first, residual)
        self.last = step
        if self.best is not None:
            return residual < self.best.solution.residual, False
        if close:
            return True, residual > _SHARP * settings.tolerance and step <= settings.step_tolerance
        diverged = not math.isfinite(residual) or (iteration > 3 and residual > 10 * self.first)
        self.failed = diverged or iteration >= self.patience
        return False, not self.failed


def correct_all(
    problem: Any, predicted: Array, normal: Array, name: str, parameters: Mapping[str, float], settings: Settings
) -> tuple[list[Corrected], str]:
    """`correct` for predicted points (k, n + 1) of one curve together, each in its plane across the same normal.

    A point whose residual is not a hundred times below the tolerance gets one Newton step more, for predictions are
    often good enough to be accepted with few digits.

    Returns
    -------
    The points in order, up to the first that fails, and why it did.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a bordered matrix is singular.
    """
    most = settings.max_iterations
    points = [_Iterate(min(_PATIENCE, most) if i else most) for i in range(len(predicted))]
    u, left, reason = predicted, list(range(len(predicted))), ""
    for iteration in range(most + 2):
        now = linearise_all(problem, u, name, parameters)
        A, rhs = all_bordered(now, normal), np.zeros((*u.shape, 2))
        rhs[:, :-1, 0], rhs[:, -1, 0], rhs[:, -1, 1] = now.R, (u - predicted[left]) @ normal, 1.0
        both = np.linalg.solve(A, rhs)
        onward = u - both[..., 0]
        residuals = (norms(now.R) / now.size).tolist()
        steps = (norms(both[..., 0]) / np.maximum(norms(onward), 1e-300)).tolist()
        onto = []
        for j, point in enumerate(points[i] for i in left):
            best, on = point.judge(residuals[j], iteration, steps[j], settings)
            if best:  # copied, or it would hold on to the arrays of all
                here = Evaluation(now.R[j].copy(), now.dR_dX[j].copy(), now.dR_dp[j].copy(), float(now.size[j]))
                solution = Solution(u[j, :-1].copy(), float(u[j, -1]), here, iteration, residuals[j])
                point.best = Corrected(solution, both[j, :, 1].copy(), A[j].copy())
            if on:
                onto.append(j)
            if point.failed:
                reason = f"the corrector stopped at a relative residual of {residuals[j]:.2e} after {iteration} steps"
                break
        if not onto:
            break
        u, left = onward[onto], [left[j] for j in onto]
    return [point.best for point in takewhile(lambda p: p.best is not None, points)], reason  # type: ignore[misc]


def all_bordered(now: Evaluations, normal: Array) -> Array:
    """`bordered` of stacked evaluations, (k, n + 1, n + 1), with one normal (n + 1,) or one each (k, n + 1)."""
    k, n = now.R.shape
    A = np.empty((k, n + 1, n + 1))
    A[:, :n, :n], A[:, :n, n], A[:, n] = now.dR_dX, now.dR_dp, normal
    return A


def corrected(solution: Solution, normal: Array) -> Corrected:
    """A solution with its direction.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the bordered matrix is singular: a branch point, or a normal that is no direction of the curve.
    """
    A = bordered(solution.evaluation, normal)
    rhs = np.zeros(len(A))
    rhs[-1] = 1.0
    return Corrected(solution, solve_linear(A, rhs), A)


def bordered(now: Evaluation, normal: Array) -> Array:
    """[dR_dX dR_dp; normal^T]."""
    n = now.R.size
    A = np.empty((n + 1, n + 1))
    A[:n, :n], A[:n, n], A[n] = now.dR_dX, now.dR_dp, normal
    return A
