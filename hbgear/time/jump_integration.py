"""Landing of jumps by time integration: from the motion at the end of a stable section until it settles.

    state at the end of the section, at p   ->   integrated at p + direction delta until settled   ->   motion after

Beyond a fold no motion continues the section, so that the transient decides between the basins of attraction. The
motion at its end is compared with the stable motions of the curve and of other given curves. A motion that is on none
of them is solved by harmonic balance with its own period, and is a start for `trace`.

Where a boundary of basins passes near the fold, the result depends on the distance beyond the fold at which a sweep
leaves the motion, even in a very slow sweep: the jump is indeterminate. Therefore several distances delta are
integrated. If they result in different motions, the most frequent one is taken and the others are stated in the note.

References
----------
Thompson & Soliman (1991), Proc. R. Soc. Lond. A 432, 101-111, https://doi.org/10.1098/rspa.1991.0007, for such jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hbgear.analysis.jump_landings import candidates, same_motion, stable_motions, stable_points
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump, Point, SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.mechanics.series.fourier import coefficients_of, to_real
from hbgear.time.exponential.integrator import ExponentialIntegrator, structure_of
from hbgear.time.integration import state_of
from hbgear.time.steady_state import OBSERVED, SteadyStateSettings, disturbed, settle

_DISTANCE_RANGE = 5e-5, 2e-4
"""Smallest and largest distance beyond the jump at which the motion is integrated, as a fraction of the parameter span
of the curve [-]."""

_NUMBER_OF_DISTANCES = 8
"""Number of integrated distances beyond the jump [-]."""

_MAX_MOTION_CHANGE = 0.25
"""Largest difference between the motions at the jump and beyond it, relative to the motion, for which they are the same
motion [-]."""

_DISTURBANCE_AT_FOLD = 1e-6
"""Disturbance of the state at a fold, relative to the state [-]; without it a symmetric motion stays symmetric."""

_DISTURBANCE_OF_UNSTABLE = 1e-4
"""Disturbance of the state of an unstable motion, relative to the state [-]."""

_MIN_GROWTH = 0.02
"""Growth of a disturbance in one excitation period [-] from which a sweep leaves an unstable motion."""

_IMMEDIATE_DISTANCE = 2e-3
"""Distance from the loss of stability to the point at which the motion is left, as a fraction of the parameter span of
the curve [-], below which the motion is left at once."""


@dataclass(frozen=True, eq=False)
class JumpOutcome:
    """Motion on which one integration beyond a jump settled.

    Attributes
    ----------
    value : float
        Value of the parameter.
    period : int
        Period in excitation periods; 0 if the motion is not periodic.
    rms : ndarray, shape (m,)
        Root mean square of the element coordinates; inf if the motion diverges.
    integrated_periods : int
        Number of integrated excitation periods.
    motion : Point or None
        Fourier coefficients of the periodic motion; None if it is not periodic.
    """

    value: float
    period: int
    rms: Array
    integrated_periods: int
    motion: Point | None

    @property
    def text(self) -> str:
        """Description of the motion."""
        if not np.isfinite(self.rms).all():
            return "the motion diverges"
        size = "rms " + ", ".join(f"{x:.4g}" for x in self.rms)
        return f"{size}, period {self.period}" if self.period else f"{size}, not periodic"


def integrate_jumps(
    branch: Branch,
    others: Sequence[Branch] = (),
    *,
    problem: Any = None,
    settling: SteadyStateSettings = SteadyStateSettings(),
    progress: ProgressCallback | None = None,
) -> Branch:
    """Determine the landings of the jumps of a branch by time integration.

    Parameters
    ----------
    branch : Branch
        Branch of periodic motions.
    others : sequence of Branch, optional
        Further branches in the same parameter on which jumps may land.
    problem : HarmonicBalance, optional
        Problem of the branch, required if the branch was loaded without it.
    settling : SteadyStateSettings, optional
        Conditions under which a motion is settled.
    progress : callable, optional
        Called with a `Progress`, such as ``print``.

    Returns
    -------
    Branch
        Branch whose jumps have the landing "integrate". ``after`` is a motion of one of the curves, or a motion on none
        of them: then ``note`` states its period, and it is a start for `trace`. If integration does not end in a
        periodic motion, ``after`` is None and ``note`` describes the motion. ``note`` also states that a jump is
        indeterminate.

    Raises
    ------
    ValueError
        If the branch has no problem, or the structure is too large for its modes to be computed.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> [jump.landing_description for jump in curve.jumps(landing="integrate")]
    ['integrated', 'integrated']
    """
    problem = branch.problem if problem is None else problem
    if problem is None or layout_of(branch) is None:
        raise ValueError(
            "landing='integrate' needs a curve of periodic motions with its problem; load it with "
            "load(path, problem=HarmonicBalance(...))"
        )
    branch = replace(branch, problem=problem)
    jumps = []
    for i, jump in enumerate(branch.jumps()):
        if progress:
            progress(Progress(i / len(branch.jumps()), f"jump at {jump.parameter} = {jump.value:.5g}"))
        ends = landings_of((*branch.curves, *others), jump, jump_ends(branch, jump, settling))
        jumps.append(ends[0][0])
    return replace(branch, jump_records=tuple(jumps))


def reason_against(branch: Branch) -> str:
    """Return the reason for which the motions of a branch are not integrated beyond jumps; empty if they are."""
    parameters = branch.parameters_at(0)
    system = branch.problem.model_at(parameters).system()
    structure = structure_of(system if system.speed is None else system.at_speed(parameters["Omega"]))
    return structure if isinstance(structure, str) else ""


def jump_ends(branch: Branch, jump: Jump, settling: SteadyStateSettings = SteadyStateSettings()) -> list[JumpOutcome]:
    """Integrate the motion at a jump of a branch from several values beyond it until it settles, the nearest first."""
    problem = branch.problem
    departure = _motion_left(branch, jump)
    start_value = departure.parameters[jump.parameter]
    values = start_value + jump.direction * np.geomspace(*_DISTANCE_RANGE, _NUMBER_OF_DISTANCES) * float(
        np.ptp(branch.values)
    )
    sets = [{**departure.parameters, jump.parameter: value} for value in values.tolist()]
    Omega = np.array([parameters["Omega"] for parameters in sets])
    models = [problem.model_at(parameters) for parameters in sets]
    integrator = (
        ExponentialIntegrator(models[0], Omega) if jump.parameter == "Omega" else ExponentialIntegrator(models, Omega)
    )
    balance = problem.at_resolution_of(departure)
    state = state_of(balance, balance.from_point(departure), **departure.parameters)
    motions = integrator.start(np.tile(state, (_NUMBER_OF_DISTANCES, 1)))
    ratio = _DISTURBANCE_AT_FOLD if start_value == jump.value else _DISTURBANCE_OF_UNSTABLE
    motions = disturbed(integrator, motions, ratio, np.random.default_rng(1))
    settled = settle(integrator, motions, settling)
    outcomes = []
    for i, parameters in enumerate(sets):
        index, period, periods = np.array([i]), int(settled.period[i]), int(settled.integrated_periods[i])
        last = motions.select(index)
        if not np.isfinite(last.zeta).all():
            outcomes.append(JumpOutcome(values[i], 0, np.full(integrator.m, np.inf), periods, None))
            continue
        samples = integrator.select(index).advance(last, period or OBSERVED, record=True)
        assert samples is not None
        d = samples[0][0]
        motion = _as_point(problem, d, period, parameters) if period else None
        outcomes.append(JumpOutcome(values[i], period, d.std(axis=1), periods, motion))
    return outcomes


def _motion_left(branch: Branch, jump: Jump) -> Point:
    """Return the motion that a sweep leaves at a jump: the motion at the fold.

    If the branch loses stability before the fold, it is the first unstable motion from which a disturbance grows by at
    least `_MIN_GROWTH` per period, or the motion at the fold.
    """
    departure = jump.before
    if not isinstance(departure, SpecialPoint) or departure.kind == "LP":
        return departure
    values, mu = branch.values, branch.multipliers
    is_forward = (values[min(departure.index + 1, len(values) - 1)] - jump.value) * jump.direction > 0
    step, index = (1 if is_forward else -1), departure.index
    while mu is not None and 0 <= index + step < len(values):
        if (values[index + step] - values[index]) * jump.direction <= 0:
            break
        index += step
        if np.abs(mu[index]).max(initial=0.0) >= 1.0 + _MIN_GROWTH:
            break
    return branch[index]


def _as_point(problem: Any, d: Array, period: int, parameters: dict[str, float]) -> Point:
    """Return samples (m, T) of the element coordinates over a period as the Fourier coefficients of a point."""
    H = problem.H // problem.nu * period
    X, regime = to_real(coefficients_of(d, H)).ravel(), np.full(len(d), -1, dtype=np.int8)
    layout = replace(problem.layout, harmonics=H, nu=period, orders=None)
    return Point(X, parameters, np.nan, 0, None, regime, np.nan, layout)


def landings_of(
    branches: Sequence[Branch], jump: Jump, outcomes: Sequence[JumpOutcome]
) -> list[tuple[Jump, list[JumpOutcome]]]:
    """Return the different landings of a jump, the most frequent first, each with its integrations.

    The first branch is that of the jump, the ``outcomes`` are results of `jump_ends`. The note of the first jump states
    the other landings, and whether the motion is left long after it loses stability.
    """
    ends: list[tuple[Jump, list[JumpOutcome]]] = []
    for group in _grouped(outcomes):
        end = _landing_of(branches, jump, group[0])
        existing = next((members for landing, members in ends if _same_end(end, landing)), None)
        if existing is None:
            ends.append((end, group))
        else:
            existing += group
    ends.sort(key=lambda entry: -len(entry[1]))
    (first, largest), *rest = ends
    if rest:
        alternatives = "; ".join(f"{len(group)}: {group[0].text}" for _, group in rest)
        first = _with_note(first, f"indeterminate: {len(largest)} of {len(outcomes)} tries, {alternatives}")
    return [(_with_note(first, _slow_note(branches[0], jump)), largest), *rest]


def _with_note(jump: Jump, note: str) -> Jump:
    """Return a jump with a text added to its note."""
    return replace(jump, note="; ".join(filter(None, (jump.note, note))))


def _slow_note(branch: Branch, jump: Jump) -> str:
    """Return the note for a jump whose motion loses its stability long before it is left; "" otherwise."""
    departure = _motion_left(branch, jump)
    end = departure.parameters[jump.parameter]
    if abs(end - jump.value) <= _IMMEDIATE_DISTANCE * float(np.ptp(branch.values)):
        return ""
    rate = f"slow: disturbances grow by {_MIN_GROWTH:.0%} a period"
    if isinstance(departure, SpecialPoint):
        return f"{rate} nowhere up to {departure.label} at {end:.6g}, where it leaves"
    return f"{rate} from {jump.parameter} = {end:.6g} on, where it leaves"


def _grouped(outcomes: Sequence[JumpOutcome]) -> list[list[JumpOutcome]]:
    """Return the results in groups of the same motion."""
    groups: list[list[JumpOutcome]] = []
    for outcome in outcomes:
        members = next((group for group in groups if _is_same(outcome, group[0])), None)
        if members is None:
            groups.append([outcome])
        else:
            members.append(outcome)
    return groups


def _is_same(a: JumpOutcome, b: JumpOutcome) -> bool:
    """Return whether two results are the same motion."""
    if a.motion is None or b.motion is None:  # all bounded motions that are not periodic form one group
        return a.motion is b.motion and np.isfinite(a.rms).all() == np.isfinite(b.rms).all()
    return a.period == b.period and same_motion(a.motion, (b.motion,)) is not None


def _same_end(a: Jump, b: Jump) -> bool:
    """Return whether two jumps land on the same motion."""
    if a.after is None or b.after is None:
        return False
    return a.landing == b.landing and same_motion(a.after, (b.after,)) is not None


def _landing_of(branches: Sequence[Branch], jump: Jump, outcome: JumpOutcome) -> Jump:
    """Return a jump of the first branch that lands on the motion of one integration."""
    motions = [point for point, _ in candidates(branches, 0, jump)]
    if outcome.motion is None:
        return replace(jump, after=None, landing="integrate", note=outcome.text)
    points = stable_points(branches[0], outcome.value) + [p for p, _ in stable_motions(branches, 0, outcome.value)]
    index = same_motion(outcome.motion, points)
    motion = _solution_near(branches[0].problem, outcome.motion if index is None else points[index], jump)
    if index is None and not motion.stable:  # it has not left its start, or the truncation order is too low
        return replace(jump, note=f"not decided by integration: {_UNKNOWN_MOTION}")
    known_index = same_motion(motion, motions)
    after = motion if known_index is None else motions[known_index]
    note = f"period {outcome.period}, on a curve that was not given" if index is None and known_index is None else ""
    return replace(jump, after=after, landing="integrate", note=note)


_UNKNOWN_MOTION = "the settled motion is not a stable solution with this harmonic truncation order"


def _solution_near(problem: Any, motion: Point, jump: Jump) -> Point:
    """Return the solution at the jump near a motion beyond it, or beyond it if Newton finds no solution at the jump.

    The motion itself is returned if Newton's method does not converge.
    """
    layout = motion.layout
    assert isinstance(layout, Layout)
    balance = problem if layout.nu == problem.nu else problem.with_order(layout.nu, problem.H // problem.nu * layout.nu)
    X = balance.from_layout(motion.X, layout)
    for parameters in ({**motion.parameters}, {**motion.parameters, jump.parameter: jump.value}):  # beyond, then at it
        try:
            solution = solve(balance, X, parameters, jump.parameter)
        except NoConvergence:
            break
        observed = balance.observe(solution.X, **parameters)
        mu, regime, error = (observed[name] for name in ("multipliers", "regime", "error"))
        point = Point(solution.X, parameters, solution.residual, solution.iterations, mu, regime, error, balance.layout)
        if same_motion(point, (motion,), _MAX_MOTION_CHANGE) is None:
            break
        X, motion = solution.X, point
    return motion
