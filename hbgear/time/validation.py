"""A traced curve held against time integration, point by point.

For each chosen point, from its harmonic-balance state y0 at tau = 0 and its multipliers mu:

    closure       |y(nu T; y0) - y0| in the element coordinates, relative to their size
    amplitude     rms, half peak-to-peak and harmonics of the periodic motion found by shooting from y0
    multipliers   those of the variational equation integrated along that motion
    growth        (|l y+ - l y-| / 2 delta)^(1/p) after p periods from two states y* +- delta v: it must be |mu|, below
                  1 where the curve says stable and above 1 where it says unstable; v, l right and left eigenvectors of
                  the largest multiplier

A point that disagrees is solved again with 2, 4 and 8 times the harmonics: if one of these motions agrees, the curve is
right but for the harmonics it leaves out, and how much that is, is said. Only a motion that solves its own equations,
with multipliers that are its own, gets this benefit.

Where slow sweeps jump, the motion left is integrated from just beyond that point until it settles (`landing`): the
motion it ends in must be the one that the curve says, or none of the curve if that says none.

Integration of the points is by DOP853 with the corners of the laws met exactly, in the coordinates of the model; it
shares with harmonic balance only the matrices and the laws.
"""

from __future__ import annotations

import csv
import dataclasses
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import scipy

from hbgear._version import __version__
from hbgear.analysis.jump_landings import landings, same_motion
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.atomic_write import atomic_write
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import linearise
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import LANDINGS, Jump, Point
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.harmonic.equations import layout as measures
from hbgear.harmonic.model_registry import is_description, rebuild_problem
from hbgear.harmonic.structure.receptance import LinearStructure
from hbgear.mechanics.models import describe, differing_fields
from hbgear.mechanics.series.fourier import to_complex
from hbgear.time.exponential.integrator import modal_state, physical_state
from hbgear.time.integration import state_of
from hbgear.time.jump_integration import JumpOutcome, arrivals, landed
from hbgear.time.runge_kutta import Flow
from hbgear.time.shooting import Orbit, shoot

LEAST = 1e-9
"""Smallest tolerance that time integration can decide on."""


AGREES = "agrees"


_MOST_POINTS = 1_000_000  # that can be asked for: more is no number of points


_TOLERANCE = 1e-11  # of the integration


_HARMONICS = 5  # of the excitation that are compared


_PERIODS = 3  # at most, over which growth is measured


_DISTURBANCE = 1e-6  # relative to the state


_DOUBLINGS = 3  # of the harmonics of a motion that differs


_SOLVED = 1e-7  # residual, and distance of multipliers, of a motion that does solve its equations


_AWAY = 0.02  # |mu - 1| of the points beside a fold: nearer, the motion at a given frequency is ill-conditioned


_SINGULAR = 1e-3  # |mu - 1| of a located branch point, see `trace`: motions at its frequency are not isolated


@dataclass(frozen=True)
class Check:
    """One point of the curve as traced held against time integration; differences are relative, see the module.

    Parameters
    ----------
    index, reason : row of the branch and why it was chosen.
    value, Omega : of the branch's parameter, and the frequency.
    element : name of the element with the largest difference of rms.
    rms, rms_true : its rms by harmonic balance and by integration.
    closure, rms_error, pp2_error, harmonic_error, multiplier_error : largest over the elements; the closure is inf if
        the motion runs away before its period is over, the others are nan if there is no periodic motion to compare.
    sensitivity : 1 / min |mu - 1|, what an error is amplified by at a given frequency.
    mu, mu_true : the largest multiplier of the branch and of the integrated variational equation.
    growth : measured growth of a disturbance per period, to be held against |mu|; inf if it runs away at once.
    stable : what the branch says; None if it has no multipliers.
    verdict : "agrees", "agrees with H = 32" if that took more harmonics than the curve has, or what does not agree.
    harmonics : H of the motion that agrees; that of the curve, if none does.
    refined_error : largest difference of rms and harmonics of the motion with more harmonics; nan if there is none.
    """

    index: int
    reason: str
    value: float
    Omega: float
    element: str
    rms: float
    rms_true: float
    closure: float
    rms_error: float
    pp2_error: float
    harmonic_error: float
    multiplier_error: float
    sensitivity: float
    mu: complex
    mu_true: complex
    growth: float
    stable: bool | None
    verdict: str
    harmonics: int
    refined_error: float

    @property
    def ok(self) -> bool:
        """Whether it agrees, with more harmonics if need be."""
        return self.verdict.startswith(AGREES)

    @property
    def refined(self) -> bool:
        """Whether it took more harmonics than the curve has to agree."""
        return self.ok and self.verdict != AGREES


@dataclass(frozen=True)
class JumpCheck:
    """A jump of the curve held against integration in time.

    label, value, direction : of the `Jump`. before, after : rms of the element with the largest change before it, and
    after it as the curve says (nan if it has no motion there). rms : of that element in the motion that integration
    settles on, of ``period`` excitation periods (0: not periodic) after ``taken`` of them. jump : where it lands by
    integration; ``jump.after`` is a start for `trace` if its ``note`` says that it is on no curve given.
    verdict : "agrees", or what does not.
    """

    label: str
    value: float
    direction: int
    element: str
    before: float
    after: float
    rms: float
    period: int
    taken: int
    jump: Jump
    verdict: str

    @property
    def ok(self) -> bool:
        """Whether it lands where the curve says."""
        return self.verdict.startswith(AGREES)


@dataclass(frozen=True)
class Report:
    """Checks in the order of the branch, the tolerances they were judged by, and whether all were made.

    jumps : the jumps of the curve, where they were looked at.
    """

    parameter: str
    tolerance: float
    multiplier_tolerance: float
    rows: tuple[Check, ...]
    complete: bool = True
    jumps: tuple[JumpCheck, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether every point agrees, with more harmonics if need be, every jump does, and all were checked."""
        return self.complete and bool(self.rows) and all(row.ok for row in self.rows) and all(j.ok for j in self.jumps)

    def __repr__(self) -> str:
        return f"<Report: {self.summary}>"

    @property
    def summary(self) -> str:
        """How many points agree, and how far the curve as traced is off where more harmonics were needed."""
        good, finer = sum(row.ok for row in self.rows), [row for row in self.rows if row.refined]
        text = f"{good} of {len(self.rows)} points agree within {self.tolerance:g} with time integration"
        if finer:
            off = max(max(row.rms_error, row.harmonic_error) for row in finer)
            H, rest = max(row.harmonics for row in finer), max(row.refined_error for row in finer)
            text += (
                f", {len(finer)} of them with more harmonics: as traced off by {off:.1e}, with H = {H} by {rest:.1e}"
            )
        if self.jumps:
            text += f"; {sum(jump.ok for jump in self.jumps)} of {len(self.jumps)} jumps land where the curve says"
        return text + ("" if self.complete else "; interrupted")

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Headers and rows of text."""
        headers = ["point", self.parameter, "rms", "rms diff.", "pp2 diff.", "harmonics", "closure", "|mu|", "mu diff.",
                   "growth", "verdict"]  # fmt: skip
        return headers, [_texts(row) for row in self.rows]

    def jump_table(self) -> tuple[list[str], list[list[str]]]:
        """Headers and rows of text of the jumps."""
        headers = ["jump", self.parameter, "while", "rms before", "rms after", "integrated", "period", "after periods",
                   "verdict"]  # fmt: skip
        return headers, [
            [j.label, f"{j.value:.6g}", "increasing" if j.direction > 0 else "decreasing", f"{j.before:.5g}",
             f"{j.after:.5g}" if np.isfinite(j.after) else "-", f"{j.rms:.5g}", str(j.period or "-"), str(j.taken),
             j.verdict] for j in self.jumps
        ]  # fmt: skip

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write all numbers (.csv), whole or not at all."""
        if not str(path).lower().endswith(".csv"):
            raise ValueError(f"'{path}' must end in .csv")
        names = [f.name for f in fields(Check)]
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(names)
            writer.writerows([getattr(row, name) for name in names] for row in self.rows)


def _texts(row: Check) -> list[str]:
    def text(x: float, form: str = ".1e") -> str:
        return f"{x:{form}}" if np.isfinite(x) else "-"

    sizes = [text(x, ".5f" if x < 1e4 else ".4g") for x in (abs(row.mu), row.growth)]
    numbers = [text(x) for x in (row.rms_error, row.pp2_error, row.harmonic_error, row.closure)]
    return [f"{row.index} {row.reason}", f"{row.value:.6g}", f"{row.rms:.6g}", *numbers, sizes[0],
            text(row.multiplier_error), sizes[1],
            f"{row.verdict} to {row.refined_error:.1e}" if row.refined else row.verdict]  # fmt: skip


@checked_arguments(points="a number, or rows and labels in a list, such as ['LP1', 10]")
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
    """Hold points of a branch against time integration.

    Parameters
    ----------
    branch : a curve of periodic motions; if it was loaded without its problem, that is rebuilt from its header.
    points : how many, chosen around the folds, at the peak, where the estimated error is worst, around changes of the
        impact regime and evenly between; or which: rows, or labels of special points.
    tolerance : largest relative difference of rms and harmonics that agrees; ten times as much of pp2, which rests on
        two single values.
    multiplier_tolerance : largest difference of multipliers; by default 100 times the tolerance.
    problem : `HarmonicBalance` of the branch, if its model is not in the catalogue.
    landing : "integrate" looks at the jumps too: at all of them, or with points given at those with such labels.
        "nearest" takes them as they are.
    others : further curves in the same parameter on which jumps may land.
    progress : called with a `Progress`, such as ``print``.

    Returns
    -------
    Report
        Ctrl-C ends it with the points checked so far, ``complete`` False.

    Raises
    ------
    TypeError
        If it is no branch.
    ValueError, KeyError, IndexError
        If the branch is no curve of motions, its model is unknown or does not fit it, a point is not on it, or a
        tolerance is below `LEAST`.

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
            raise ValueError(
                f"{name} = {value:g} cannot be met: time integration itself decides to about {LEAST:g}; give more"
            )
    if landing not in LANDINGS:
        raise ValueError(f"landing = {landing!r}: choose one of {', '.join(map(repr, LANDINGS))}")
    problem = problem_for(branch, problem)
    chosen = choose(branch, points)
    rows: list[Check] = []
    left = [jump for jump in branch.jumps() if landing == "integrate" and (isinstance(points, int | np.integer) or
            jump.label in points)]  # fmt: skip
    jumps: list[JumpCheck] = []
    complete = True
    try:
        for done, (i, reason) in enumerate(chosen):
            if progress:
                share = done / (len(chosen) + len(left))
                progress(Progress(share, f"{branch.parameter} = {branch.values[i]:.5g} ({reason})"))
            rows.append(_check(branch, problem, i, reason, tolerance, limit))
        curves = (dataclasses.replace(branch, problem=problem), *branch.others, *others)
        for done, jump in enumerate(left):
            if progress:
                share = (len(chosen) + done) / (len(chosen) + len(left))
                progress(Progress(share, f"{branch.parameter} = {jump.value:.5g} (jump at {jump.label})"))
            jumps.append(_check_jump(curves, jump))
    except KeyboardInterrupt:
        complete = False
    return Report(branch.parameter, tolerance, limit, tuple(rows), complete, tuple(jumps))


# ---- what is checked


def problem_for(branch: Branch, problem: Any = None) -> Any:
    """The harmonic balance of a branch: the one given, its own, or one rebuilt from its header.

    Raises
    ------
    ValueError, KeyError
        If the branch does not hold motions, or the problem does not fit it.
    """
    layout = measures.layout_of(branch)
    if layout is None or "Omega" not in branch.parameters_at(0):
        raise ValueError(
            "only curves of periodic motions can be validated, with harmonics and a frequency; this is none"
        )
    if "Omega" in branch.tracked:
        raise ValueError(
            "this is a curve of special points, whose motions are singular at their frequency; validate response "
            "curves traced through them instead"
        )
    written = branch.meta.get("hbgear")
    if written not in (None, __version__):
        text = f"the curve was traced with hbgear {written}, this is {__version__}; differences may come from that"
        warnings.warn(text, stacklevel=3)
    if problem is None:
        problem = branch.problem or rebuild_problem(branch.meta)
    own = problem.layout
    if (own.elements, own.breakpoints) != (layout.elements, layout.breakpoints):
        raise ValueError(
            f"the curve has elements {layout.elements} with corners {layout.breakpoints}, the model {own.elements} "
            f"with {own.breakpoints}: it was traced with another model; give the problem it was traced with"
        )
    same_model(branch.meta.get("model"), problem.model)
    if (own.nu, problem.size) != (layout.nu, branch.X.shape[1]):
        problem = problem.with_order(layout.nu, layout.harmonics)
    for name in branch.parameters_at(0):
        problem.check_parameter(name)
    return problem


def same_model(written: Any, model: Any) -> None:
    """Refuse a model that is not the one in the header of the branch."""
    own = describe(model)
    if not written:
        return
    if not is_description(written):
        raise ValueError("the curve does not say which model it was traced with: trace it again")
    other = differing_fields(written, own)
    if written["class"] == own["class"] and not other:
        return
    what = (
        f"with other {', '.join(other)}"
        if written["class"] == own["class"]
        else f"a {written['class']}, not {own['class']}"
    )
    raise ValueError(f"the curve was traced with another model ({what}): give the problem it was traced with")


def choose(branch: Branch, points: int | Sequence[int | str]) -> list[tuple[int, str]]:
    """Rows to check and why, in the order of the branch.

    Raises
    ------
    ValueError, IndexError, KeyError
        If no point is asked for, or one is not on the branch.
    """
    if isinstance(points, int | np.integer):
        return _worthwhile(branch, counted("points", points, _MOST_POINTS))
    picked: dict[int, str] = {}
    for key in points:
        if isinstance(key, str):
            picked.setdefault(branch[key].index, key)  # type: ignore[attr-defined]
        elif not -len(branch) <= key < len(branch):
            raise IndexError(f"point {key} is outside the branch, which has rows 0 to {len(branch) - 1}")
        else:
            picked.setdefault(int(key) % len(branch), "asked for")
    if not picked:
        raise ValueError("no points to validate; give a number, rows or labels")
    return sorted(picked.items())


def _worthwhile(branch: Branch, count: int) -> list[tuple[int, str]]:
    """The most interesting rows first, up to three quarters of the number, then evenly between."""
    wanted: list[tuple[int, str]] = []
    for point in branch.special:
        if point.kind == "LP":
            wanted += [(_beside(branch, point.index, side), f"beside {point.label}") for side in (-1, 1)]
    wanted.append((int(np.nanargmax(branch.amplitude("rms"))), "peak"))
    if not np.isnan(branch.error).all():
        wanted.append((int(np.nanargmax(branch.error)), "worst error"))
    for point in branch.special:
        if point.kind not in ("LP", "CP"):
            wanted += [(_inside(branch, point.index + side), f"beside {point.label}") for side in (-1, 1)]
    picked: dict[int, str] = {}
    # there the motion is singular, or neither stable nor unstable
    taken = {p.index for p in branch.special if p.kind in ("LP", "BP", "CP", "PD", "NS")} | _singular_ends(branch)
    for i, reason in wanted:
        if len(picked) < max(count - count // 4, 1) and i not in picked and i not in taken:
            picked[i] = reason
    free = [i for i in range(len(branch)) if i not in taken]
    while len(picked) < min(count, len(free)):
        picked[_farthest(branch, free, picked)] = "between"
    return sorted(picked.items())


def _singular_ends(branch: Branch) -> set[int]:
    """Numbers of the first and the last row if they are the special point at which the branch leaves another one."""
    if branch.multipliers is None:
        return set()
    return {i for i in (0, len(branch) - 1) if np.abs(branch.multipliers[i] - 1).min(initial=np.inf) <= _SINGULAR}


def _inside(branch: Branch, i: int) -> int:
    return min(max(i, 0), len(branch) - 1)


def _beside(branch: Branch, fold: int, side: int) -> int:
    """The first row beside a fold that is not nearly singular."""
    for away in range(1, 6):
        i = _inside(branch, fold + side * away)
        if branch.multipliers is None or np.abs(branch.multipliers[i] - 1).min() > _AWAY:
            return i
    return _inside(branch, fold + 2 * side)


def _farthest(branch: Branch, free: list[int], picked: dict[int, str]) -> int:
    """The row farthest along the curve from those picked."""
    size = max(float(np.linalg.norm(np.ptp(branch.X, axis=0))), 1e-300)
    span = float(np.ptp(branch.values)) or 1.0
    steps = np.hypot(np.diff(branch.values) / span, np.linalg.norm(np.diff(branch.X, axis=0), axis=1) / size)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    near = [np.abs(arc[i] - arc[list(picked)]).min() if picked else -i for i in free]
    return free[int(np.argmax([-1.0 if i in picked else x for i, x in zip(free, near, strict=True)]))]


# ---- jumps


def _check_jump(curves: tuple[Branch, ...], jump: Jump) -> JumpCheck:
    """Where a jump of the first of some curves lands, held against what the curve says."""
    said = jump.after
    ends = landed(curves, jump, arrivals(curves[0], jump))
    decided, (found, *_) = ends[0]
    elements = curves[0].layout.elements if curves[0].layout else ()
    before = np.array([jump.before.amplitude("rms", j) for j in range(len(elements))])
    which = int(np.argmax(np.abs(found.rms - before)))
    after = float("nan") if said is None else said.amplitude("rms", which)
    return JumpCheck(
        jump.label, jump.value, jump.direction, elements[which], float(before[which]), after, float(found.rms[which]),
        found.period, found.taken, decided, _landing_verdict(curves, said, ends),
    )  # fmt: skip


def _landing_verdict(curves: tuple[Branch, ...], said: Point | None, ends: list[tuple[Jump, list[JumpOutcome]]]) -> str:
    """Whether one of the ends of a jump is the one that the curve says."""
    tries = sum(len(group) for _, group in ends)
    for end, group in ends:
        if said is not None and end.after is not None and same_motion(end.after, (said,)) is not None:
            return AGREES if len(ends) == 1 else f"{AGREES} in {len(group)} of {tries} tries: indeterminate"
    decided = ends[0][0]
    place = _place(curves, decided)
    where = f"on curve {place + 1} of them" if place else "on another stable motion of the curve"
    text = decided.note if place is None else where
    if decided.landing != "integrate":
        return text
    return f"{AGREES}: {text}" if said is None and place != 0 else f"lands {text}"


def _place(curves: tuple[Branch, ...], jump: Jump) -> int | None:
    """The curve that a jump of the first of them lands on; None if on none of them."""
    ((found, *_), *_) = landings((dataclasses.replace(curves[0], jump_records=(jump,)), *curves[1:]))
    return found.branch


# ---- one point


class _Held(NamedTuple):
    """One motion of harmonic balance, with H harmonics, against the periodic motion found by shooting from it."""

    H: int
    rows: list[Array]  # of each element
    mu: ComplexArray
    closure: float
    orbit: Orbit | None = None
    growth: float = float("nan")

    def errors(self, orbit: Orbit) -> Array:
        """Differences (m, 3) of rms, pp2 and harmonics from a motion found by shooting."""
        return np.array([_differences(*pair, orbit.nu) for pair in zip(self.rows, orbit.rows(self.H), strict=True)])


def _check(branch: Branch, problem: Any, i: int, reason: str, tolerance: float, limit: float) -> Check:
    here = branch.parameters_at(i)
    X, layout = branch.X[i], branch.layout
    assert layout is not None
    stored = branch.multipliers[i] if branch.multipliers is not None else None
    stored = None if stored is None or np.isnan(stored).any() else stored
    stable = None if branch.multipliers is None else branch[i].stable

    def judged(held: _Held) -> str:
        return _verdict(held, stable, tolerance, limit)

    own = last = _held(problem, X, stored, here)
    verdict = judged(own)
    if verdict != AGREES:
        for finer, Y in _finer(problem, X, stored, here):
            last = _held(finer, Y, None, here)
            if judged(last) == AGREES:
                verdict = f"{AGREES} with H = {last.H}"
                break
        else:
            verdict += f", with H = {last.H} too" if last is not own else ""
    refined = verdict.startswith(AGREES) and last is not own
    judge = last if refined else own
    orbit, nan = judge.orbit, float("nan")
    errors = np.full((1, 3), nan) if orbit is None else own.errors(orbit)
    worst = int(np.argmax(errors[:, 0]))
    true_mu = np.array([complex(nan)]) if orbit is None else orbit.multipliers
    return Check(
        index=i,
        reason=reason,
        value=float(branch.values[i]),
        Omega=here["Omega"],
        element=layout.elements[worst],
        rms=float(measures.rms(own.rows[worst])),
        rms_true=nan if orbit is None else float(measures.rms(orbit.rows(own.H)[worst])),
        closure=own.closure,
        rms_error=float(errors[:, 0].max()),
        pp2_error=float(errors[:, 1].max()),
        harmonic_error=float(errors[:, 2].max()),
        multiplier_error=nan if orbit is None else _apart(own.mu, true_mu),
        sensitivity=nan if orbit is None else 1 / max(float(np.abs(true_mu - 1).min()), 1e-12),
        mu=complex(own.mu[np.argmax(np.abs(own.mu))]),
        mu_true=complex(true_mu[0]),
        growth=judge.growth,
        stable=stable,
        verdict=verdict,
        harmonics=judge.H,
        refined_error=float(judge.errors(orbit)[:, [0, 2]].max()) if refined and orbit else nan,
    )


def _held(problem: Any, X: Array, mu: ComplexArray | None, here: dict[str, float]) -> _Held:
    """A motion and what integration makes of it; without an orbit if none is found from it."""
    changes = {k: v for k, v in here.items() if k != "Omega"}
    model = problem.model.replace(**changes) if changes else problem.model
    y = state_of(problem, X, **here)
    layout = problem.layout
    rows = [layout.rows(X, j) for j in range(len(layout.elements))]
    mu = problem.multipliers(X, **here) if mu is None else mu
    closure = _closure(model, y, here["Omega"], problem.nu)
    try:
        orbit = shoot(model, here["Omega"], y, problem.nu, tolerance=10 * _TOLERANCE)
    except (NoConvergence, ArithmeticError, np.linalg.LinAlgError):
        return _Held(problem.H, rows, mu, closure)
    return _Held(problem.H, rows, mu, closure, orbit, _growth(model, orbit))


def _finer(problem: Any, X: Array, mu: ComplexArray | None, here: dict[str, float]) -> Iterator[tuple[Any, Array]]:
    """The same motion with 2, 4, ... times the harmonics, solved from the one before.

    Nothing, if it is not the number of harmonics that is to blame: X does not solve the equations with those it has, or
    mu are not its multipliers.
    """
    layout = problem.layout
    rows = np.array([layout.rows(X, j) for j in range(len(layout.elements))])
    used = (int(np.flatnonzero(rows.any(axis=0)).max(initial=1)) + 1) // 2  # fewer in places, if H varies on the curve
    own = problem if used >= problem.orders[-1] else problem.with_order(problem.nu, used)
    X = own.from_layout(X, layout)
    now = linearise(own, X, "", here)
    if not norm(now.R) <= _SOLVED * now.size:
        return
    if mu is not None and not _apart(mu, own.multipliers(X, **here)) <= _SOLVED * max(1.0, float(np.abs(mu).max())):
        return
    for _ in range(_DOUBLINGS):
        finer = own.with_order(own.nu, 2 * own.H)
        try:
            X = solve(finer, finer.from_layout(X, own.layout), here).X
        except NoConvergence:
            return
        own = finer
        yield own, X


def _closure(model: Any, y: Array, Omega: float, nu: int) -> float:
    """How far element coordinates and rates over Omega are from where they were a period before, over their size.

    inf if the motion runs away.
    """
    flow = Flow(model.system(), Omega)
    T = nu * 2 * np.pi / Omega
    try:
        end, _, _ = flow.march(0.0, y, T, "DOP853", _TOLERANCE)
    except ArithmeticError:
        return np.inf
    (d0, v0), (d1, v1) = flow.gaps(0.0, y), flow.gaps(T, end)
    size = max(float(np.abs(d0).max()), float(np.abs(v0).max()) / Omega, 1e-300)
    return max(float(np.abs(d1 - d0).max()), float(np.abs(v1 - v0).max()) / Omega) / size


def _differences(found: Array, true: Array, nu: int) -> tuple[float, float, float]:
    """Relative differences of rms, pp2, and of the first harmonics (against the largest of them)."""
    rms, pp2 = (float(abs(m(found) - m(true)) / m(true)) for m in (measures.rms, measures.half_peak_to_peak))
    last = _HARMONICS * nu + 1
    a, b = to_complex(found)[:last], to_complex(true)[:last]
    return rms, pp2, float(np.abs(a - b).max() / np.abs(b[1:]).max())


def _apart(mu: ComplexArray, true: ComplexArray) -> float:
    """Largest distance of multipliers matched in pairs."""
    D = np.abs(mu[:, None] - true)
    return float(D[scipy.optimize.linear_sum_assignment(D)].max())


def _growth(model: Any, orbit: Orbit) -> float:
    """Growth per period of a disturbance in the direction of the largest multiplier, from two disturbed motions.

    inf if one of them runs away.
    """
    system = model.system().at_speed(orbit.Omega)
    structure, flow = LinearStructure(system), Flow(system, orbit.Omega)
    mu, V = np.linalg.eig(orbit.reduced)
    top = int(np.argmax(np.abs(mu)))
    left = np.linalg.inv(V)[top]
    y = physical_state(structure, V[:, top])
    delta = y * (_DISTURBANCE * np.linalg.norm(orbit.state) / np.linalg.norm(y))
    # few enough periods that what decays stays above rounding and what grows stays small
    periods = int(np.clip(np.floor(np.log(1e3) / max(abs(np.log(abs(mu[top]))), 1e-3)), 1, _PERIODS))
    T = orbit.nu * 2 * np.pi / orbit.Omega
    try:
        ends = [flow.march(0.0, orbit.state + s * delta, periods * T, "DOP853", _TOLERANCE)[0] for s in (1, -1)]
    except ArithmeticError:
        return np.inf
    first = left @ modal_state(structure, delta)
    last = left @ modal_state(structure, 0.5 * (ends[0] - ends[1]))
    return float(abs(last / first) ** (1 / periods))


def _verdict(held: _Held, stable: bool | None, tolerance: float, limit: float) -> str:
    """What does not agree, or `AGREES`."""
    if held.orbit is None:
        return "no periodic motion found from here"
    errors = held.errors(held.orbit).max(axis=0)
    wrong = [
        name
        for name, error, allowed in zip(("rms", "pp2", "harmonics"), errors, (1, 10, 1), strict=True)
        if not error <= allowed * tolerance
    ]
    if not _apart(held.mu, held.orbit.multipliers) <= limit:
        wrong.append("multipliers")
    wrong = [f"{', '.join(wrong)} differ{'s' if wrong in (['rms'], ['pp2']) else ''}"] if wrong else []
    largest, growth = abs(held.orbit.multipliers[0]), held.growth
    if not abs(growth - largest) <= 1e-3 * max(1.0, largest) + limit:
        wrong.append("growth is not that of the multiplier")
    if stable is not None and (growth <= 1 + STABILITY_TOLERANCE) != stable and abs(growth - 1) > min(limit, 1e-5):
        wrong.append("it leaves" if stable else "it stays")
    return ", ".join(wrong) or AGREES
