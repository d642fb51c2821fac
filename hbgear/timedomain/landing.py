"""Where jumps land, by integration: from the motion at the end of a stable part, just beyond it, until it settles.

    state of the motion left, at p   ->   integrated at p + direction delta until it is settled   ->   which motion?

Beyond a fold there is no motion left to stay on, so the transient itself decides between the basins of those that there
are. What it ends in is matched with the stable motions of the curve and of others that are given; one that is none of
these is found by harmonic balance from the motion settled on, whatever its period, and is a start for `trace`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.progress import Progress, ProgressCallback
from hbgear.continuation.branch import Branch, Jump, Point
from hbgear.continuation.newton import NoConvergence, solve
from hbgear.harmonic.landings import candidates, same_motion, stable_motions, stable_points
from hbgear.harmonic.observables import Layout, layout_of
from hbgear.mechanics.fourier import to_real
from hbgear.timedomain.exponential import Stepper
from hbgear.timedomain.integrate import state_of
from hbgear.timedomain.settle import OBSERVED, Settling, disturbed, settle

_BEYOND = 1e-4  # of the span of the curve, from the point left to where its motion is integrated


_DISTURBANCE = 1e-6  # of the state: what is alike must not stay alike by rounding alone


@dataclass(frozen=True, eq=False)
class Arrival:
    """What a motion settled on.

    value : of the parameter. period : in excitation periods, 0 if it is not periodic. rms (m,) of the elements, inf if
    the motion runs away. taken : excitation periods integrated. motion : as the unknowns of that period; None without.
    """

    value: float
    period: int
    rms: Array
    taken: int
    motion: Point | None


def land(
    branch: Branch,
    others: Sequence[Branch] = (),
    *,
    problem: Any = None,
    settling: Settling = Settling(),
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
        ``after`` is None and ``note`` says what happens.

    Raises
    ------
    ValueError
        If the branch has no problem, or the structure is too large for its modes.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> [jump.decided for jump in curve.jumps(landing="integrate")]
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
        jumps.append(landed((branch, *others), jump, arrival(branch, jump, settling)))
    return replace(branch, jump_records=tuple(jumps))


def arrival(branch: Branch, jump: Jump, settling: Settling = Settling()) -> Arrival:
    """What the motion left at a jump settles on, just beyond it."""
    problem = branch.problem
    value = jump.value + jump.direction * _BEYOND * float(np.ptp(branch.values))
    here = {**jump.before.parameters, jump.parameter: value}
    Omega = here.pop("Omega")
    model = problem.model.replace(**here) if here else problem.model
    stepper = Stepper(model, Omega)
    flight = stepper.start(state_of(problem, problem.converted(jump.before), **jump.before.parameters))
    flight = disturbed(stepper, flight, _DISTURBANCE, np.random.default_rng(1))
    how = settle(stepper, flight, settling)
    taken, period = int(how.taken[0]), int(how.period[0])
    if not np.isfinite(flight.zeta).all():
        return Arrival(value, 0, np.full(stepper.m, np.inf), taken, None)
    seen = stepper.advance(flight, period or OBSERVED, record=True)
    assert seen is not None
    d = seen[0][0]
    motion = _as_point(problem, d, period, {**here, "Omega": Omega}) if period else None
    return Arrival(value, period, d.std(axis=1), taken, motion)


def _as_point(problem: Any, d: Array, period: int, here: dict[str, float]) -> Point:
    """Samples (m, T) of elements over a period as unknowns of that order."""
    H = problem.H // problem.nu * period
    c = np.fft.rfft(d, axis=1)[:, : H + 1] / d.shape[1]
    c[:, 1:] *= 2
    layout = replace(problem.layout, harmonics=H, nu=period)
    return Point(to_real(c).ravel(), here, np.nan, 0, None, np.full(len(d), -1, dtype=np.int8), np.nan, layout)


def landed(branches: Sequence[Branch], jump: Jump, found: Arrival) -> Jump:
    """A jump of the first of some branches, landing where its motion settled."""
    known = [point for point, _ in candidates(branches, 0, jump)]
    if found.motion is None:
        size = ", ".join(f"{x:.4g}" for x in found.rms)
        text = f"not periodic, rms {size}" if np.isfinite(found.rms).all() else "the motion runs away"
        return replace(jump, after=None, landing="integrate", note=text)
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
    X = own.in_basis(motion.X, layout)
    for here in ({**motion.parameters}, {**motion.parameters, jump.parameter: jump.value}):
        try:
            solution = solve(own, X, here, jump.parameter)
        except NoConvergence:
            break
        seen = own.observe(solution.X, **here)
        mu, regime, error = (seen[name] for name in ("multipliers", "regime", "error"))
        point = Point(solution.X, here, solution.residual, solution.iterations, mu, regime, error, own.layout)
        if same_motion(point, (motion,)) is None:
            break
        X, motion = solution.X, point
    return motion
