"""Where jumps land, by integration: from the motion at the end of a stable part, just beyond it, until it settles.

    state of the motion left, at p   ->   integrated at p + direction delta until it is settled   ->   which motion?

Beyond a fold there is no motion left to stay on, so the transient itself decides between the basins of those that there
are. What it ends in is matched with the stable motions of the curve and of others that are given; one that is none of
these is found by harmonic balance from the motion settled on, whatever its period, and is a start for `trace`.

Where a boundary of basins crosses the way away from the fold, the end depends on how far beyond the fold a sweep has
come when the motion leaves, however slow the sweep: the jump is indeterminate. So several distances delta are tried,
and if they disagree the most frequent end is taken and the others are told.

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

_BEYOND = 5e-5, 2e-4  # of the span of the curve, from the point left to where its motion is integrated


_TRIES = 8  # distances between these


_MOVED = 0.25  # difference, relative to its size, that a motion may take on between the jump and beyond it


_DISTURBANCE = 1e-6  # of the state: what is alike must not stay alike by rounding alone


@dataclass(frozen=True, eq=False)
class JumpOutcome:
    """What a motion settled on.

    value : of the parameter. period : in excitation periods, 0 if it is not periodic. rms (m,) of the elements, inf if
    the motion diverges. taken : excitation periods integrated. motion : as the unknowns of that period; None without.
    """

    value: float
    period: int
    rms: Array
    taken: int
    motion: Point | None

    @property
    def text(self) -> str:
        """The motion in words."""
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
    """The branch with its jumps decided by integration.

    Parameters
    ----------
    branch : a curve of periodic motions.
    others : further curves in the same parameter on which jumps may land.
    problem : the `HarmonicBalance` of the branch, if it was loaded without.
    settling : when a motion counts as settled.
    progress : called with a `Progress`, such as ``print``.

    Returns
    -------
    Branch
        Its jumps have the landing "integrate". ``after`` is a motion of one of the curves, or of none: then ``note``
        says so with its period, and it is a start for `trace`. Where integration does not end in a periodic motion,
        ``after`` is None and ``note`` says what happens; it also says where a jump is indeterminate.

    Raises
    ------
    ValueError
        If the branch has no problem, or the structure is too large for its modes.

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
        ends = landed((branch, *branch.others, *others), jump, arrivals(branch, jump, settling))
        jumps.append(ends[0][0])
    return replace(branch, jump_records=tuple(jumps))


def arrivals(branch: Branch, jump: Jump, settling: SteadyStateSettings = SteadyStateSettings()) -> list[JumpOutcome]:
    """What the motion left at a jump settles on, from several values just beyond it, the nearest first."""
    problem = branch.problem
    left = _left(branch, jump)
    begin = left.parameters[jump.parameter]
    values = begin + jump.direction * np.geomspace(*_BEYOND, _TRIES) * float(np.ptp(branch.values))
    each = [{**left.parameters, jump.parameter: value} for value in values.tolist()]
    Omega = np.array([here["Omega"] for here in each])
    models = [problem.model.replace(**{k: x for k, x in here.items() if k != "Omega"}) for here in each]
    integrator = (
        ExponentialIntegrator(models[0], Omega) if jump.parameter == "Omega" else ExponentialIntegrator(models, Omega)
    )
    own = problem.at_resolution_of(left)
    state = state_of(own, own.from_point(left), **left.parameters)
    motions = integrator.start(np.tile(state, (_TRIES, 1)))
    share = _DISTURBANCE if begin == jump.value else _PUSH
    motions = disturbed(integrator, motions, share, np.random.default_rng(1))
    how = settle(integrator, motions, settling)
    found = []
    for i, here in enumerate(each):
        this, period, taken = np.array([i]), int(how.period[i]), int(how.taken[i])
        last = motions.select(this)
        if not np.isfinite(last.zeta).all():
            found.append(JumpOutcome(values[i], 0, np.full(integrator.m, np.inf), taken, None))
            continue
        seen = integrator.select(this).advance(last, period or OBSERVED, record=True)
        assert seen is not None
        d = seen[0][0]
        motion = _as_point(problem, d, period, here) if period else None
        found.append(JumpOutcome(values[i], period, d.std(axis=1), taken, motion))
    return found


def _left(branch: Branch, jump: Jump) -> Point:
    """The motion that a sweep leaves at a jump: that at the fold beyond which it is gone.

    Where it loses its stability before, one of the unstable ones that follow: the first from which a disturbance grows
    fast enough to be waited for, or that at the fold.
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
        if np.abs(mu[at]).max(initial=0.0) >= 1.0 + _GROWTH:
            break
    return branch[at]


_GROWTH = 0.02  # of a disturbance in an excitation period


_PUSH = 1e-4  # disturbance of an unstable motion, of its state


def _as_point(problem: Any, d: Array, period: int, here: dict[str, float]) -> Point:
    """Samples (m, T) of elements over a period as unknowns of that order."""
    H = problem.H // problem.nu * period
    c = np.fft.rfft(d, axis=1)[:, : H + 1] / d.shape[1]
    c[:, 1:] *= 2
    layout = replace(problem.layout, harmonics=H, nu=period, orders=None)
    return Point(to_real(c).ravel(), here, np.nan, 0, None, np.full(len(d), -1, dtype=np.int8), np.nan, layout)


def landed(
    branches: Sequence[Branch], jump: Jump, found: Sequence[JumpOutcome]
) -> list[tuple[Jump, list[JumpOutcome]]]:
    """The ends of a jump of the first of some branches and the tries that took it there, the most frequent first.

    Its note tells the others, and whether it is left much later than it loses its stability.
    """
    ends: list[tuple[Jump, list[JumpOutcome]]] = []
    for group in _alike(found):
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
        first = _noted(first, f"indeterminate: {len(most)} of {len(found)} tries, {others}")
    return [(_noted(first, _slowly(branches[0], jump)), most), *rest]


def _noted(jump: Jump, told: str) -> Jump:
    return replace(jump, note="; ".join(filter(None, (jump.note, told))))


def _slowly(branch: Branch, jump: Jump) -> str:
    """What is to be said of a jump at which the motion loses its stability long before it is left."""
    left = _left(branch, jump)
    end = left.parameters[jump.parameter]
    if abs(end - jump.value) <= _SOON * float(np.ptp(branch.values)):
        return ""
    rate = f"slow: disturbances grow by {_GROWTH:.0%} a period"
    if isinstance(left, SpecialPoint):
        return f"{rate} nowhere up to {left.label} at {end:.6g}, where it leaves"
    return f"{rate} from {jump.parameter} = {end:.6g} on, where it leaves"


_SOON = 2e-3  # of the span of the curve, from where a motion loses its stability to where it is left at once


def _alike(found: Sequence[JumpOutcome]) -> list[list[JumpOutcome]]:
    """Arrivals in groups of the same motion, as far as it shows."""
    groups: list[list[JumpOutcome]] = []
    for one in found:
        own = next((group for group in groups if _is_like(one, group[0])), None)
        if own is None:
            groups.append([one])
        else:
            own.append(one)
    return groups


def _is_like(one: JumpOutcome, other: JumpOutcome) -> bool:
    if one.motion is None or other.motion is None:  # all that stay and are not periodic are alike
        return one.motion is other.motion and np.isfinite(one.rms).all() == np.isfinite(other.rms).all()
    return one.period == other.period and same_motion(one.motion, (other.motion,)) is not None


def _same_end(one: Jump, other: Jump) -> bool:
    if one.after is None or other.after is None:
        return False
    return one.landing == other.landing and same_motion(one.after, (other.after,)) is not None


def _landed(branches: Sequence[Branch], jump: Jump, found: JumpOutcome) -> Jump:
    """A jump of the first of some branches, landing where its motion settled in one try."""
    known = [point for point, _ in candidates(branches, 0, jump)]
    if found.motion is None:
        return replace(jump, after=None, landing="integrate", note=found.text)
    beyond = stable_points(branches[0], found.value) + [p for p, _ in stable_motions(branches, 0, found.value)]
    same = same_motion(found.motion, beyond)
    motion = _solved(branches[0].problem, found.motion if same is None else beyond[same], jump)
    if same is None and not motion.stable:  # it has not left the motion it began at, or harmonics do not suffice
        return replace(jump, note=f"not decided by integration: {_UNKNOWN}")
    at = same_motion(motion, known)
    after = motion if at is None else known[at]
    note = f"period {found.period}, on a curve that was not given" if same is None and at is None else ""
    return replace(jump, after=after, landing="integrate", note=note)


_UNKNOWN = "what it settles on is no stable motion of so many harmonics"


def _solved(problem: Any, motion: Point, jump: Jump) -> Point:
    """A motion found just beyond a jump, at its own value; beyond it if there is none, as it is if Newton fails."""
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
        if same_motion(point, (motion,), _MOVED) is None:
            break
        X, motion = solution.X, point
    return motion
