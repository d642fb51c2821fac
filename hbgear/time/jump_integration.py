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
from hbgear.mechanics.series.fourier import to_real
from hbgear.time.exponential.integrator import ExponentialIntegrator
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
        ends = landed((*branch.curves, *others), jump, arrivals(branch, jump, settling))
        jumps.append(ends[0][0])
    return replace(branch, jump_records=tuple(jumps))


def arrivals(branch: Branch, jump: Jump, settling: SteadyStateSettings = SteadyStateSettings()) -> list[JumpOutcome]:
    """Integrate the motion at a jump from several values beyond it until it settles.

    Parameters
    ----------
    branch : Branch
        Branch of periodic motions with its problem.
    jump : Jump
        Jump of the branch.
    settling : SteadyStateSettings, optional
        Conditions under which a motion is settled.

    Returns
    -------
    list of JumpOutcome
        Result of each integration, with increasing distance from the jump.
    """
    problem = branch.problem
    left = _motion_left(branch, jump)
    begin = left.parameters[jump.parameter]
    values = begin + jump.direction * np.geomspace(*_DISTANCE_RANGE, _NUMBER_OF_DISTANCES) * float(
        np.ptp(branch.values)
    )
    each = [{**left.parameters, jump.parameter: value} for value in values.tolist()]
    Omega = np.array([here["Omega"] for here in each])
    models = [problem.model.replace(**{k: x for k, x in here.items() if k != "Omega"}) for here in each]
    integrator = (
        ExponentialIntegrator(models[0], Omega) if jump.parameter == "Omega" else ExponentialIntegrator(models, Omega)
    )
    own = problem.at_resolution_of(left)
    state = state_of(own, own.from_point(left), **left.parameters)
    motions = integrator.start(np.tile(state, (_NUMBER_OF_DISTANCES, 1)))
    ratio = _DISTURBANCE_AT_FOLD if begin == jump.value else _DISTURBANCE_OF_UNSTABLE
    motions = disturbed(integrator, motions, ratio, np.random.default_rng(1))
    how = settle(integrator, motions, settling)
    found = []
    for i, here in enumerate(each):
        this, period, periods = np.array([i]), int(how.period[i]), int(how.integrated_periods[i])
        last = motions.select(this)
        if not np.isfinite(last.zeta).all():
            found.append(JumpOutcome(values[i], 0, np.full(integrator.m, np.inf), periods, None))
            continue
        seen = integrator.select(this).advance(last, period or OBSERVED, record=True)
        assert seen is not None
        d = seen[0][0]
        motion = _as_point(problem, d, period, here) if period else None
        found.append(JumpOutcome(values[i], period, d.std(axis=1), periods, motion))
    return found


def _motion_left(branch: Branch, jump: Jump) -> Point:
    """Return the motion that a sweep leaves at a jump: the motion at the fold.

    If the branch loses stability before the fold, it is the first unstable motion from which a disturbance grows by at
    least `_MIN_GROWTH` per period, or the motion at the fold.
    """
    left = jump.before
    if not isinstance(left, SpecialPoint) or left.kind == "LP":
        return left
    values, mu = branch.values, branch.multipliers
    ahead = (values[min(left.index + 1, len(values) - 1)] - jump.value) * jump.direction > 0
    step, at = (1 if ahead else -1), left.index
    while mu is not None and 0 <= at + step < len(values):
        if (values[at + step] - values[at]) * jump.direction <= 0:
            break
        at += step
        if np.abs(mu[at]).max(initial=0.0) >= 1.0 + _MIN_GROWTH:
            break
    return branch[at]


def _as_point(problem: Any, d: Array, period: int, here: dict[str, float]) -> Point:
    """Return samples (m, T) of the element coordinates over a period as the Fourier coefficients of a point."""
    H = problem.H // problem.nu * period
    c = np.fft.rfft(d, axis=1)[:, : H + 1] / d.shape[1]
    c[:, 1:] *= 2
    layout = replace(problem.layout, harmonics=H, nu=period, orders=None)
    return Point(to_real(c).ravel(), here, np.nan, 0, None, np.full(len(d), -1, dtype=np.int8), np.nan, layout)


def landed(
    branches: Sequence[Branch], jump: Jump, found: Sequence[JumpOutcome]
) -> list[tuple[Jump, list[JumpOutcome]]]:
    """Return the different landings of a jump, the most frequent first, each with its integrations.

    The note of the first jump states the other landings, and whether the motion is left long after it loses stability.

    Parameters
    ----------
    branches : sequence of Branch
        Branch of the jump, followed by the branches on which it may land.
    jump : Jump
        Jump of the first branch.
    found : sequence of JumpOutcome
        Results of `arrivals`.

    Returns
    -------
    list of tuple
        Jump with its landing, and the results of `arrivals` that landed there.
    """
    ends: list[tuple[Jump, list[JumpOutcome]]] = []
    for group in _grouped(found):
        end = _landed(branches, jump, group[0])
        known = next((others for other, others in ends if _same_end(end, other)), None)
        if known is None:
            ends.append((end, group))
        else:
            known += group
    ends.sort(key=lambda one: -len(one[1]))
    (first, most), *rest = ends
    if rest:
        others = "; ".join(f"{len(group)}: {group[0].text}" for _, group in rest)
        first = _with_note(first, f"indeterminate: {len(most)} of {len(found)} tries, {others}")
    return [(_with_note(first, _slow_note(branches[0], jump)), most), *rest]


def _with_note(jump: Jump, note: str) -> Jump:
    """Return a jump with a text added to its note."""
    return replace(jump, note="; ".join(filter(None, (jump.note, note))))


def _slow_note(branch: Branch, jump: Jump) -> str:
    """Return the note for a jump whose motion loses its stability long before it is left; "" otherwise."""
    left = _motion_left(branch, jump)
    end = left.parameters[jump.parameter]
    if abs(end - jump.value) <= _IMMEDIATE_DISTANCE * float(np.ptp(branch.values)):
        return ""
    rate = f"slow: disturbances grow by {_MIN_GROWTH:.0%} a period"
    if isinstance(left, SpecialPoint):
        return f"{rate} nowhere up to {left.label} at {end:.6g}, where it leaves"
    return f"{rate} from {jump.parameter} = {end:.6g} on, where it leaves"


def _grouped(found: Sequence[JumpOutcome]) -> list[list[JumpOutcome]]:
    """Return the results in groups of the same motion."""
    groups: list[list[JumpOutcome]] = []
    for one in found:
        own = next((group for group in groups if _is_same(one, group[0])), None)
        if own is None:
            groups.append([one])
        else:
            own.append(one)
    return groups


def _is_same(one: JumpOutcome, other: JumpOutcome) -> bool:
    """Return whether two results are the same motion."""
    if one.motion is None or other.motion is None:  # all bounded motions that are not periodic form one group
        return one.motion is other.motion and np.isfinite(one.rms).all() == np.isfinite(other.rms).all()
    return one.period == other.period and same_motion(one.motion, (other.motion,)) is not None


def _same_end(one: Jump, other: Jump) -> bool:
    """Return whether two jumps land on the same motion."""
    if one.after is None or other.after is None:
        return False
    return one.landing == other.landing and same_motion(one.after, (other.after,)) is not None


def _landed(branches: Sequence[Branch], jump: Jump, found: JumpOutcome) -> Jump:
    """Return a jump of the first branch that lands on the motion of one integration."""
    known = [point for point, _ in candidates(branches, 0, jump)]
    if found.motion is None:
        return replace(jump, after=None, landing="integrate", note=found.text)
    beyond = stable_points(branches[0], found.value) + [p for p, _ in stable_motions(branches, 0, found.value)]
    same = same_motion(found.motion, beyond)
    motion = _solution_near(branches[0].problem, found.motion if same is None else beyond[same], jump)
    if same is None and not motion.stable:  # it has not left its start, or the truncation order is too low
        return replace(jump, note=f"not decided by integration: {_UNKNOWN_MOTION}")
    at = same_motion(motion, known)
    after = motion if at is None else known[at]
    note = f"period {found.period}, on a curve that was not given" if same is None and at is None else ""
    return replace(jump, after=after, landing="integrate", note=note)


_UNKNOWN_MOTION = "the settled motion is not a stable solution with this harmonic truncation order"


def _solution_near(problem: Any, motion: Point, jump: Jump) -> Point:
    """Return the solution at the jump near a motion beyond it, or beyond it if Newton finds no solution at the jump.

    The motion itself is returned if Newton's method does not converge.
    """
    layout = motion.layout
    assert isinstance(layout, Layout)
    own = problem if layout.nu == problem.nu else problem.with_order(layout.nu, problem.H // problem.nu * layout.nu)
    X = own.from_layout(motion.X, layout)
    for here in ({**motion.parameters}, {**motion.parameters, jump.parameter: jump.value}):
        try:
            solution = solve(own, X, here, jump.parameter)
        except NoConvergence:
            break
        seen = own.observe(solution.X, **here)
        mu, regime, error = (seen[name] for name in ("multipliers", "regime", "error"))
        point = Point(solution.X, here, solution.residual, solution.iterations, mu, regime, error, own.layout)
        if same_motion(point, (motion,), _MAX_MOTION_CHANGE) is None:
            break
        X, motion = solution.X, point
    return motion
