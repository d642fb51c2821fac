"""Comparison of a traced curve with time integration, point by point.

For each selected point, from its harmonic-balance state y0 at tau = 0 and its multipliers mu:

    closure       |y(nu T; y0) - y0| in the element coordinates, relative to their size
    amplitude     rms, half peak-to-peak and harmonics of the periodic motion computed by shooting from y0
    multipliers   eigenvalues of the monodromy matrix integrated along that motion
    growth        (|l y+ - l y-| / 2 delta)^(1/p) after p periods from two states y* +- delta v. It must be |mu|: below
                  1 if the curve states stable, above 1 if it states unstable. v and l are the right and left
                  eigenvectors of the largest multiplier

A point that disagrees is solved again with 2, 4 and 8 times the harmonics. If one of these motions agrees, the curve is
correct except for its harmonic truncation, and the truncation error is stated. This applies only to a motion that
solves its own equations and has its own multipliers.

At each jump the motion is integrated from just beyond it until it settles, see `hbgear.time.jump_integration`. It must
settle on the motion that the curve states, or on a motion on none of the curves if the curve states none.

Points are integrated by DOP853 with steps that end at the breakpoints of the laws, in the coordinates of the model.
Only the matrices and the laws are shared with harmonic balance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import scipy

from hbgear.analysis.jump_landings import landings, same_motion
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import BIFURCATING, LANDINGS, Jump, Point
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NewtonSettings, NoConvergence, solve
from hbgear.continuation.tracing.jumps import DISTANCES_FROM_BRANCH_POINT, point_on_new_branch
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.mechanics.series import measures
from hbgear.mechanics.series.fourier import to_complex
from hbgear.time.integration import start_state
from hbgear.time.jump_integration import JumpOutcome, jump_ends, landings_of, reason_against
from hbgear.time.runge_kutta import Flow
from hbgear.time.shooting import Orbit, from_modal, shoot, to_modal
from hbgear.time.validation.point_selection import choose, problem_for
from hbgear.time.validation.report import AGREES, Check, JumpCheck, Report, Units

LEAST = 1e-9
"""Smallest tolerance [-] that time integration can verify."""

_INTEGRATION_TOLERANCE = 1e-11
"""Relative error per step of the integration [-]."""

_COMPARED_HARMONICS = 5
"""Number of harmonics of the excitation that are compared [-]."""

_MAX_GROWTH_PERIODS = 3
"""Largest number of periods over which growth is measured [-]."""

_GROWTH_DISTURBANCE = 1e-6
"""Disturbance for the measurement of growth, relative to the state [-]."""

_MAX_DOUBLINGS = 3
"""Largest number of doublings of the harmonics of a motion that disagrees [-]."""

_CONSISTENCY_TOLERANCE = 1e-7
"""Largest residual [-] of a motion that solves its equations."""

_MULTIPLIER_CONSISTENCY = 1e-5
"""Largest distance of multipliers [-] of one motion: the last Newton step of a trace, which is 1e-6, moves them."""


@checked_arguments(points="a number, or a list of indices and labels, such as ['LP1', 10]")
def validate(
    branch: Branch,
    points: int | Sequence[int | str] = 12,
    tolerance: float = 1e-4,
    *,
    multiplier_tolerance: float | None = None,
    problem: AnyProblem | None = None,
    landing: str = "integrate",
    others: Sequence[Branch] = (),
    progress: ProgressCallback | None = None,
) -> Report:
    """Compare points of a branch, and of the other curves of its span, with time integration.

    Parameters
    ----------
    branch : Branch
        Branch of periodic motions. If it was loaded without its problem, the problem is rebuilt from its header.
    points : int or sequence of int or str, optional
        Number of points, which are selected near special points, at the peak, at the largest estimated error and
        equidistantly, in equal numbers on each of `Branch.curves`; or indices of points and labels of special points
        of the branch itself. Default: 12.
    tolerance : float, optional
        Largest relative difference of rms and harmonics that agrees. Half peak-to-peak is compared with ten times this
        tolerance, because it depends on two single values. Default: 1e-4.
    multiplier_tolerance : float, optional
        Largest difference of multipliers that agrees. Default: 100 times the tolerance.
    problem : HarmonicBalance, optional
        Problem of the branch, required if its model is not in the catalogue.
    landing : {"integrate", "nearest"}, optional
        "integrate" compares jumps as well: all jumps of all curves, or with given points those whose labels are given.
        "nearest" does not compare jumps. Default: "integrate". Jumps of models that the exponential method does not
        integrate, such as those with friction, are not compared; the summary states it.
    others : sequence of Branch, optional
        Further branches in the same parameter on which jumps may land.
    progress : callable, optional
        Called with a `Progress`, such as ``print``.

    Returns
    -------
    Report
        Comparison of all points. After Ctrl-C it contains the points so far, and ``complete`` is False.

    Raises
    ------
    TypeError
        If ``branch`` is not a branch.
    ValueError, KeyError, IndexError
        If the branch does not contain periodic motions, its model is unknown or does not fit it, a point is not on it,
        or a tolerance is below `LEAST`.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 7), "Omega", (0.8, 0.9))
    >>> hb.validate(curve, 1)
    <Report: 1 of 1 points agree within 0.0001 with time integration>
    """
    tolerance = float(tolerance)
    limit = 100 * tolerance if multiplier_tolerance is None else float(multiplier_tolerance)
    for name, value, below in (("tolerance", tolerance, 1.0), ("multiplier_tolerance", limit, np.inf)):
        if not LEAST <= value < below:
            raise ValueError(f"{name} = {value:g} cannot be verified by time integration; give {LEAST:g} or more")
    if landing not in LANDINGS:
        raise ValueError(f"landing = {landing!r}: choose one of {', '.join(map(repr, LANDINGS))}")
    curves = tuple(dataclasses.replace(curve, problem=problem_for(curve, problem)) for curve in branch.curves)
    selected, selected_jumps = _selected(curves, others, points, landing == "integrate")
    reason = reason_against(curves[0]) if selected_jumps else ""
    note = f"jumps not compared ({len(selected_jumps)}): {reason}" if reason else ""
    selected_jumps = [] if reason else selected_jumps
    rows: list[Check] = []
    jumps: list[JumpCheck] = []
    complete = True
    try:
        for count, (number, i, reason) in enumerate(selected):
            if progress:
                fraction = count / (len(selected) + len(selected_jumps))
                progress(Progress(fraction, f"{branch.parameter} = {curves[number].values[i]:.5g} ({reason})"))
            rows.append(_check(curves, number, i, reason, tolerance, limit))
        for count, (number, jump) in enumerate(selected_jumps):
            if progress:
                fraction = (len(selected) + count) / (len(selected) + len(selected_jumps))
                progress(Progress(fraction, f"{branch.parameter} = {jump.value:.5g} (jump at {jump.label})"))
            jumps.append(_check_jump((*curves, *others), number, jump))
    except KeyboardInterrupt:
        complete = False
    return Report(branch.parameter, tolerance, limit, tuple(rows), complete, tuple(jumps), Units.of(branch), note)


def _selected(
    curves: tuple[Branch, ...], others: Sequence[Branch], points: int | Sequence[int | str], integrable: bool
) -> tuple[list[tuple[int, int, str]], list[tuple[int, Jump]]]:
    """Return number of the curve, index and reason of each point; number of the curve and jump of each jump."""
    if not isinstance(points, int | np.integer):
        selected = [(0, *entry) for entry in choose(curves[0], points)]
    else:
        counts = [(points + k) // len(curves) for k in reversed(range(len(curves)))]
        selected = [(k, *entry) for k, n in enumerate(counts) if n or not k for entry in choose(curves[k], n)]
    if not integrable:
        return selected, []
    curve_landings = enumerate(landings((*curves, *others))[: len(curves)])
    jumps = [(k, landing.jump) for k, entries in curve_landings for landing in entries]
    labels = None if isinstance(points, int | np.integer) else points
    return selected, [(k, jump) for k, jump in jumps if labels is None or (k == 0 and jump.label in labels)]


def _check_jump(curves: tuple[Branch, ...], number: int, jump: Jump) -> JumpCheck:
    """Return the comparison of a jump of one of the curves with time integration."""
    branch = curves[number]
    landing = jump.after
    ends = landings_of((branch, *(curve for curve in curves if curve is not branch)), jump, jump_ends(branch, jump))
    decided_jump, (result, *_) = ends[0]
    elements = branch.layout.elements if branch.layout else ()
    before = np.array([jump.before.amplitude("rms", j) for j in range(len(elements))])
    index = int(np.argmax(np.abs(result.rms - before)))
    after = float("nan") if landing is None else landing.amplitude("rms", index)
    return JumpCheck(
        jump.label,
        jump.value,
        jump.direction,
        elements[index],
        float(before[index]),
        after,
        float(result.rms[index]),
        result.period,
        result.integrated_periods,
        decided_jump,
        AGREES if _continues(branch, jump, result) else _landing_status(curves, number, landing, ends),
        number + 1,
    )


def _continues(branch: Branch, jump: Jump, outcome: JumpOutcome) -> bool:
    """Return whether a sweep that continues on a bifurcating branch by the curve does so by integration.

    The motion must lie on the branch that leaves in one of both directions, at the value of the integration.
    """
    if jump.landing != BIFURCATING or outcome.motion is None:
        return False
    point = next(special for special in branch.special if special.label == jump.label)
    for side in (1, -1):
        start = point_on_new_branch(branch, point, side, DISTANCES_FROM_BRANCH_POINT[0], NewtonSettings())
        if start is None:
            continue
        span = (start.parameters[jump.parameter], outcome.value)
        with suppress(NoConvergence, ValueError):
            part = raise_if_interrupted(
                trace(start.problem, jump.parameter, span, start, cover=False, special=False, accuracy=None)
            )
            if part.status.complete and same_motion(outcome.motion, (part[-1],)) is not None:
                return True
    return False


def _landing_status(
    curves: tuple[Branch, ...], number: int, landing: Point | None, ends: list[tuple[Jump, list[JumpOutcome]]]
) -> str:
    """Return the status of a jump: agreement if one of its landings is the motion that the curve states."""
    tries = sum(len(group) for _, group in ends)
    for end, group in ends:
        if landing is not None and end.after is not None and same_motion(end.after, (landing,)) is not None:
            return AGREES if len(ends) == 1 else f"{AGREES} in {len(group)} of {tries} tries: indeterminate"
    main_jump = ends[0][0]
    target = _landing_curve(curves, number, main_jump)
    location = "on another stable motion of the curve" if target == number else f"on curve {(target or 0) + 1}"
    text = main_jump.note if target is None else location
    if main_jump.landing != "integrate":
        return text
    return f"{AGREES}: {text}" if landing is None and target != number else f"lands {text}"


def _landing_curve(curves: tuple[Branch, ...], number: int, jump: Jump) -> int | None:
    """Return the index of the curve on which a jump of a curve lands; None if it is on none of them."""
    branch = dataclasses.replace(curves[number], jump_records=(jump,))
    (landing,) = landings((*curves[:number], branch, *curves[number + 1 :]))[number]
    return landing.branch


# ---- one point


class _Comparison(NamedTuple):
    """Harmonic-balance solution with H harmonics, and the periodic motion computed by shooting from it."""

    H: int
    rows: list[Array]  # real Fourier coefficients of each element
    mu: ComplexArray
    closure: float
    orbit: Orbit | None = None
    growth: float = float("nan")

    def errors(self, orbit: Orbit) -> Array:
        """Return the differences (m, 3) of rms, pp2 and harmonics from a motion computed by shooting."""
        return np.array([_differences(*pair, orbit.nu) for pair in zip(self.rows, orbit.rows(self.H), strict=True)])


def _check(curves: tuple[Branch, ...], number: int, i: int, reason: str, tolerance: float, limit: float) -> Check:
    """Return the comparison of a point of a curve with time integration."""
    branch = curves[number]
    problem: Any = branch.problem
    parameters = branch.parameters_at(i)
    X, layout = branch.X[i], branch.layout
    assert layout is not None
    stored_mu = branch.multipliers[i] if branch.multipliers is not None else None
    stored_mu = None if stored_mu is None or np.isnan(stored_mu).any() else stored_mu
    stable = None if branch.multipliers is None else branch[i].stable

    def status_of(compared: _Comparison) -> str:
        return _status(compared, stable, tolerance, limit)

    original = last = _comparison(problem, X, stored_mu, parameters)
    status = status_of(original)
    if status != AGREES and _has_own_multipliers(problem, X, original, parameters):
        for finer, Y in _refinements(problem, X, parameters):
            last = _comparison(finer, Y, None, parameters, original)
            if status_of(last) != AGREES:
                last = _comparison(finer, Y, None, parameters)
            if status_of(last) == AGREES:
                status = f"{AGREES} with H = {last.H}"
                break
        else:
            status += f", with H = {last.H} too" if last is not original else ""
    refined = status.startswith(AGREES) and last is not original
    best = last if refined else original
    orbit, nan = best.orbit, float("nan")
    errors = np.full((1, 3), nan) if orbit is None else original.errors(orbit)
    element = int(np.argmax(errors[:, 0]))
    true_mu = np.array([complex(nan)]) if orbit is None else orbit.multipliers
    return Check(
        index=i,
        reason=reason,
        value=float(branch.values[i]),
        Omega=parameters["Omega"],
        element=layout.elements[element],
        rms=float(measures.rms(original.rows[element])),
        rms_true=nan if orbit is None else float(measures.rms(orbit.rows(original.H)[element])),
        closure=original.closure,
        rms_error=float(errors[:, 0].max()),
        pp2_error=float(errors[:, 1].max()),
        harmonic_error=float(errors[:, 2].max()),
        multiplier_error=nan if orbit is None else _multiplier_distance(original.mu, true_mu),
        sensitivity=nan if orbit is None else 1 / max(float(np.abs(true_mu - 1).min()), 1e-12),
        mu=complex(original.mu[np.argmax(np.abs(original.mu))]),
        mu_true=complex(true_mu[0]),
        growth=best.growth,
        stable=stable,
        status=status,
        harmonics=best.H,
        refined_error=float(best.errors(orbit)[:, [0, 2]].max()) if refined and orbit else nan,
        curve=number + 1,
    )


def _has_own_multipliers(problem: Any, X: Array, base: _Comparison, parameters: dict[str, float]) -> bool:
    """Return whether multipliers belong to X, or to a more accurate motion: then they are closer to shooting."""
    recomputed = problem.multipliers(X, **parameters)
    allowed = _MULTIPLIER_CONSISTENCY * max(1.0, float(np.abs(base.mu).max()))
    if base.orbit is None:
        return _multiplier_distance(base.mu, recomputed) <= allowed
    stored_error, new_error = (_multiplier_distance(mu, base.orbit.multipliers) for mu in (base.mu, recomputed))
    return stored_error <= new_error + allowed


def _comparison(
    problem: Any, X: Array, mu: ComplexArray | None, parameters: dict[str, float], known: _Comparison | None = None
) -> _Comparison:
    """Return a solution with its periodic motion by shooting; without it if shooting does not converge.

    With a ``known`` comparison, which should be of the same motion, the solution is compared with its periodic motion.
    """
    layout = problem.layout
    rows = [layout.rows(X, j) for j in range(len(layout.elements))]
    mu = problem.multipliers(X, **parameters) if mu is None else mu
    if known is not None:
        return known._replace(H=problem.H, rows=rows, mu=mu)
    model = problem.model_at(parameters)
    y = start_state(problem, X, **parameters)
    closure = _closure(model, y, parameters["Omega"], problem.nu)
    try:
        orbit = shoot(model, parameters["Omega"], y, problem.nu, tolerance=10 * _INTEGRATION_TOLERANCE)
    except (*SOLVER_ERRORS, ArithmeticError):
        return _Comparison(problem.H, rows, mu, closure)
    return _Comparison(problem.H, rows, mu, closure, orbit, _growth(model, orbit))


def _refinements(problem: Any, X: Array, parameters: dict[str, float]) -> Iterator[tuple[Any, Array]]:
    """Yield the same motion with 2, 4, ... times the harmonics, each solved from the one before.

    Nothing is yielded if harmonic truncation is not the reason for the difference: X does not solve its own equations.
    """
    layout = problem.layout
    rows = np.array([layout.rows(X, j) for j in range(len(layout.elements))])
    highest = (int(np.flatnonzero(rows.any(axis=0)).max(initial=1)) + 1) // 2  # smaller where H varies on the curve
    coarse = problem if highest >= problem.orders[-1] else problem.with_order(problem.nu, highest)
    X = coarse.from_layout(X, layout)
    linear = coarse.linearise(X, "", **parameters)
    if not norm(linear.R) <= _CONSISTENCY_TOLERANCE * linear.size:
        return
    for _ in range(_MAX_DOUBLINGS):
        finer = coarse.with_order(coarse.nu, 2 * coarse.H)
        try:
            X = solve(finer, finer.from_layout(X, coarse.layout), parameters).X
        except NoConvergence:
            return
        coarse = finer
        yield coarse, X


def _closure(model: Any, y: Array, Omega: float, nu: int) -> float:
    """Return the change of the element coordinates and of the rates / Omega in one period, relative to their size.

    It is inf if the motion diverges.
    """
    flow = Flow(model.system(), Omega)
    T, y = nu * 2 * np.pi / Omega, flow.states(y)
    try:
        end, _, _ = flow.integrate(0.0, y, T, "DOP853", _INTEGRATION_TOLERANCE)
    except ArithmeticError:
        return np.inf
    (d0, v0), (d1, v1) = flow.gaps(0.0, y), flow.gaps(T, end)
    size = max(float(np.abs(d0).max()), float(np.abs(v0).max()) / Omega, 1e-300)
    return max(float(np.abs(d1 - d0).max()), float(np.abs(v1 - v0).max()) / Omega) / size


def _differences(rows: Array, true_rows: Array, nu: int) -> tuple[float, float, float]:
    """Return the relative differences of rms, pp2, and of the first harmonics (relative to the largest of them)."""
    rms, pp2 = (float(abs(m(rows) - m(true_rows)) / m(true_rows)) for m in (measures.rms, measures.half_peak_to_peak))
    last = _COMPARED_HARMONICS * nu + 1
    a, b = to_complex(rows)[:last], to_complex(true_rows)[:last]
    return rms, pp2, float(np.abs(a - b).max() / np.abs(b[1:]).max())


def _multiplier_distance(mu: ComplexArray, true_mu: ComplexArray) -> float:
    """Return the largest distance of multipliers matched in pairs."""
    D = np.abs(mu[:, None] - true_mu)
    return float(D[scipy.optimize.linear_sum_assignment(D)].max())


def _growth(model: Any, orbit: Orbit) -> float:
    """Return the growth per period of a disturbance in the direction of the largest multiplier.

    It is computed from two disturbed motions, and inf if one of them diverges.
    """
    system = model.system().at_speed(orbit.Omega)
    structure, flow = LinearStructure(system), Flow(system, orbit.Omega)
    mu, U, V = scipy.linalg.eig(orbit.reduced, left=True)
    largest = int(np.argmax(np.abs(mu)))
    left = U[:, largest].conj()
    y = from_modal(structure, V[:, largest], len(flow.sliders))
    delta = y * (_GROWTH_DISTURBANCE * np.linalg.norm(orbit.state) / np.linalg.norm(y))
    # few periods: a decaying disturbance must remain above rounding, a growing one must remain small
    periods = int(np.clip(np.floor(np.log(1e3) / max(abs(np.log(abs(mu[largest]))), 1e-3)), 1, _MAX_GROWTH_PERIODS))
    T = orbit.nu * 2 * np.pi / orbit.Omega
    try:
        ends = [
            flow.integrate(0.0, flow.states(orbit.state + s * delta), periods * T, "DOP853", _INTEGRATION_TOLERANCE)[0]
            for s in (1, -1)
        ]
    except ArithmeticError:
        return np.inf
    first = left @ to_modal(structure, delta)
    a, b = (flow.coordinates(periods * T, end)[:, 0] for end in ends)
    last = left @ to_modal(structure, 0.5 * (a - b))
    return float(abs(last / first) ** (1 / periods))


def _status(compared: _Comparison, stable: bool | None, tolerance: float, limit: float) -> str:
    """Return the quantities that disagree, or `AGREES`."""
    if compared.orbit is None:
        return "no periodic motion found"
    errors = compared.errors(compared.orbit).max(axis=0)
    faults = [
        name
        for name, error, allowed in zip(("rms", "pp2", "harmonics"), errors, (1, 10, 1), strict=True)
        if not error <= allowed * tolerance
    ]
    if not _multiplier_distance(compared.mu, compared.orbit.multipliers) <= limit:
        faults.append("multipliers")
    faults = [f"{', '.join(faults)} differ{'s' if faults in (['rms'], ['pp2']) else ''}"] if faults else []
    largest, growth = abs(compared.orbit.multipliers[0]), compared.growth
    if not abs(growth - largest) <= 1e-3 * max(1.0, largest) + limit:
        faults.append("growth differs from the multiplier")
    if stable is not None and (growth <= 1 + STABILITY_TOLERANCE) != stable and abs(growth - 1) > min(limit, 1e-5):
        faults.append("disturbances grow" if stable else "disturbances decay")
    return ", ".join(faults) or AGREES
