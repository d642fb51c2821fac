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

At each jump the motion is integrated from just beyond it until it settles, see `jump_integration`. It must settle on
the motion that the curve states, or on a motion on none of the curves if the curve states none.

Points are integrated by DOP853 with steps that end at the breakpoints of the laws, in the coordinates of the model.
Only the matrices and the laws are shared with harmonic balance.
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
from hbgear.common.deprecation import renamed_attributes
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
from hbgear.harmonic.models.model_registry import is_description, rebuild_problem
from hbgear.harmonic.structure.receptance import LinearStructure
from hbgear.mechanics.models import describe, differing_fields
from hbgear.mechanics.series.fourier import to_complex
from hbgear.time.integration import state_of
from hbgear.time.jump_integration import JumpOutcome, arrivals, landed
from hbgear.time.runge_kutta import Flow
from hbgear.time.shooting import Orbit, from_modal, shoot, to_modal

LEAST = 1e-9
"""Smallest tolerance [-] that time integration can verify."""

AGREES = "agrees"
"""Status of a point or a jump that agrees with time integration."""

_MAX_POINTS = 1_000_000
"""Largest number of points [-]; it detects mistaken input."""

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
"""Largest residual, and largest distance of multipliers [-], of a motion that solves its equations."""

_MIN_DISTANCE_FROM_FOLD = 0.02
"""Smallest |mu - 1| [-] of the points selected near a fold; below it the motion at a given frequency is
ill-conditioned."""

_BRANCH_POINT_TOLERANCE = 1e-3
"""|mu - 1| [-] of a located branch point, see `trace`; motions at its frequency are not isolated."""


@renamed_attributes(verdict="status")
@dataclass(frozen=True)
class Check:
    """Comparison of one point of the curve with time integration; differences are relative, see the module.

    Attributes
    ----------
    index : int
        Index of the point.
    reason : str
        Reason for which the point was selected.
    value : float
        Value of the parameter of the branch.
    Omega : float
        Excitation frequency.
    element : str
        Name of the element with the largest difference of rms.
    rms, rms_true : float
        Root mean square of this element by harmonic balance and by integration.
    closure : float
        Closure, the largest of the elements; inf if the motion diverges within its period.
    rms_error, pp2_error, harmonic_error : float
        Largest differences of the elements; nan if shooting finds no periodic motion.
    multiplier_error : float
        Largest difference of the multipliers; nan if shooting finds no periodic motion.
    sensitivity : float
        1 / min |mu - 1|, the factor by which an error is amplified at a given frequency.
    mu, mu_true : complex
        Largest multiplier of the branch and of the integrated variational equation.
    growth : float
        Measured growth of a disturbance per period, to be compared with |mu|; inf if the motion diverges.
    stable : bool or None
        Stability by the branch; None if it has no multipliers.
    status : str
        "agrees", "agrees with H = 32" if more harmonics than those of the curve are required, or the quantities that
        disagree.
    harmonics : int
        Harmonic truncation order H of the motion that agrees; the order of the curve if none agrees.
    refined_error : float
        Largest difference of rms and harmonics of the motion with more harmonics; nan without such a motion.
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
    status: str
    harmonics: int
    refined_error: float

    @property
    def ok(self) -> bool:
        """True if the point agrees, if necessary with more harmonics."""
        return self.status.startswith(AGREES)

    @property
    def refined(self) -> bool:
        """True if the point agrees only with more harmonics than those of the curve."""
        return self.ok and self.status != AGREES


class Units(NamedTuple):
    """Units of a table of a `Report`.

    Attributes
    ----------
    name : str
        Header of the parameter, such as "pinion r/min".
    scale : float
        Value for a parameter of one; default 1.
    size : str
        Unit of amplitudes in the header, such as " [um]"; default none.
    length : float
        Value for an amplitude of one; default 1.
    """

    name: str
    scale: float = 1.0
    size: str = ""
    length: float = 1.0


@renamed_attributes(verdict="status")
@dataclass(frozen=True)
class JumpCheck:
    """Comparison of a jump of the curve with time integration.

    Attributes
    ----------
    label : str
        Label of the special point at which the jump begins.
    value : float
        Value of the parameter.
    direction : int
        +1 for an increasing, -1 for a decreasing parameter.
    element : str
        Name of the element with the largest change of rms.
    before, after : float
        Root mean square of this element before the jump, and after it by the curve; nan if the curve has no motion.
    rms : float
        Root mean square of this element in the motion on which integration settles.
    period : int
        Period of that motion in excitation periods; 0 if it is not periodic.
    integrated_periods : int
        Number of integrated excitation periods.
    jump : Jump
        Jump by integration. ``jump.after`` is a start for `trace` if ``jump.note`` states that it is on no given curve.
    status : str
        "agrees", or a description of the landing.
    """

    label: str
    value: float
    direction: int
    element: str
    before: float
    after: float
    rms: float
    period: int
    integrated_periods: int
    jump: Jump
    status: str

    @property
    def ok(self) -> bool:
        """True if the jump lands on the motion that the curve states."""
        return self.status.startswith(AGREES)


@dataclass(frozen=True)
class Report:
    """Comparison of a branch with time integration.

    Attributes
    ----------
    parameter : str
        Parameter of the branch.
    tolerance : float
        Largest relative difference of rms and harmonics that agrees.
    multiplier_tolerance : float
        Largest difference of multipliers that agrees.
    rows : tuple of Check
        Compared points in the order of the branch.
    complete : bool
        True unless the comparison was interrupted.
    jumps : tuple of JumpCheck
        Compared jumps.
    """

    parameter: str
    tolerance: float
    multiplier_tolerance: float
    rows: tuple[Check, ...]
    complete: bool = True
    jumps: tuple[JumpCheck, ...] = ()

    @property
    def ok(self) -> bool:
        """True if all points, if necessary with more harmonics, and all jumps agree, and none is missing."""
        return self.complete and bool(self.rows) and all(row.ok for row in self.rows) and all(j.ok for j in self.jumps)

    def __repr__(self) -> str:
        return f"<Report: {self.summary}>"

    @property
    def summary(self) -> str:
        """Number of points that agree, and the truncation error where more harmonics are required."""
        good, finer = sum(row.ok for row in self.rows), [row for row in self.rows if row.refined]
        text = f"{good} of {len(self.rows)} points agree within {self.tolerance:g} with time integration"
        if finer:
            truncation_error = max(max(row.rms_error, row.harmonic_error) for row in finer)
            H, rest = max(row.harmonics for row in finer), max(row.refined_error for row in finer)
            text += f", {len(finer)} of them with more harmonics: difference {truncation_error:.1e}"
            text += f", with H = {H} {rest:.1e}"
        if self.jumps:
            text += f"; {sum(jump.ok for jump in self.jumps)} of {len(self.jumps)} jumps agree"
        return text + ("" if self.complete else "; interrupted")

    def table(self, units: Units | None = None) -> tuple[list[str], list[list[str]]]:
        """Return the headers and rows of a table of the points, in units of the model or in other ones."""
        name, scale, size, length = units or Units(self.parameter)
        headers = ["point", name, f"rms{size}", "rms diff.", "pp2 diff.", "harmonics", "closure", "|mu|", "mu diff.",
                   "growth", "status"]  # fmt: skip
        return headers, [_texts(row, scale, length) for row in self.rows]

    def jump_table(self, units: Units | None = None) -> tuple[list[str], list[list[str]]]:
        """Return the headers and rows of a table of the jumps, in units of the model or in other ones."""
        name, scale, size, length = units or Units(self.parameter)
        headers = ["jump", name, "while", f"rms{size} before", "rms after", "integrated", "period", "after periods",
                   "status"]  # fmt: skip
        return headers, [
            [j.label, f"{scale * j.value:.6g}", "increasing" if j.direction > 0 else "decreasing",
             f"{length * j.before:.5g}", f"{length * j.after:.5g}" if np.isfinite(j.after) else "-",
             f"{length * j.rms:.5g}", str(j.period or "-"), str(j.integrated_periods), j.status] for j in self.jumps
        ]  # fmt: skip

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write all numbers (.csv) by an atomic replacement of the file.

        Parameters
        ----------
        path : str or path-like
            Name of the file, which ends in .csv.

        Raises
        ------
        ValueError
            If the name does not end in .csv.
        """
        if not str(path).lower().endswith(".csv"):
            raise ValueError(f"'{path}' must end in .csv")
        names = [f.name for f in fields(Check)]
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(names)
            writer.writerows([getattr(row, name) for name in names] for row in self.rows)


def _texts(row: Check, scale: float, length: float) -> list[str]:
    """Return the cells of one row of the table; the parameter is multiplied by a scale, the amplitude by a length."""

    def text(x: float, form: str = ".1e") -> str:
        return f"{x:{form}}" if np.isfinite(x) else "-"

    sizes = [text(x, ".5f" if x < 1e4 else ".4g") for x in (abs(row.mu), row.growth)]
    numbers = [text(x) for x in (row.rms_error, row.pp2_error, row.harmonic_error, row.closure)]
    return [f"{row.index} {row.reason}", f"{scale * row.value:.6g}", f"{length * row.rms:.6g}", *numbers, sizes[0],
            text(row.multiplier_error), sizes[1],
            f"{row.status} to {row.refined_error:.1e}" if row.refined else row.status]  # fmt: skip


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
    """Compare points of a branch with time integration.

    Parameters
    ----------
    branch : Branch
        Branch of periodic motions. If it was loaded without its problem, the problem is rebuilt from its header.
    points : int or sequence of int or str, optional
        Number of points, which are selected near special points, at the peak, at the largest estimated error and
        equidistantly; or indices of points and labels of special points. Default: 12.
    tolerance : float, optional
        Largest relative difference of rms and harmonics that agrees. Half peak-to-peak is compared with ten times this
        tolerance, because it depends on two single values. Default: 1e-4.
    multiplier_tolerance : float, optional
        Largest difference of multipliers that agrees. Default: 100 times the tolerance.
    problem : HarmonicBalance, optional
        Problem of the branch, required if its model is not in the catalogue.
    landing : {"integrate", "nearest"}, optional
        "integrate" compares jumps as well: all jumps, or with given points those whose labels are given. "nearest" does
        not compare jumps. Default: "integrate". Jumps of models with friction are not compared.
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
    problem = problem_for(branch, problem)
    chosen = choose(branch, points)
    rows: list[Check] = []
    integrable = landing == "integrate" and not problem.compiled({}).sliders
    left = [jump for jump in branch.jumps() if integrable and (isinstance(points, int | np.integer) or
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


# ---- selection of points


def problem_for(branch: Branch, problem: Any = None) -> Any:
    """Return the harmonic balance of a branch: the given one, its own, or one rebuilt from its header.

    Parameters
    ----------
    branch : Branch
        Branch of periodic motions.
    problem : HarmonicBalance, optional
        Problem of the branch.

    Returns
    -------
    HarmonicBalance
        Problem with the harmonics of the branch.

    Raises
    ------
    ValueError, KeyError
        If the branch does not contain periodic motions, or the problem does not fit it.
    """
    layout = measures.layout_of(branch)
    if layout is None or "Omega" not in branch.parameters_at(0):
        raise ValueError(
            "only curves of periodic motions with harmonics and a frequency can be validated; give such a curve"
        )
    if "Omega" in branch.tracked:
        raise ValueError(
            "a curve of special points has singular motions and cannot be validated; validate response "
            "curves traced through them instead"
        )
    written = branch.meta.get("hbgear")
    if written not in (None, __version__):
        text = f"the curve was traced with hbgear {written}, this is {__version__}; differences may result"
        warnings.warn(text, stacklevel=3)
    if problem is None:
        problem = branch.problem or rebuild_problem(branch.meta)
    own = problem.layout
    if (own.elements, own.breakpoints) != (layout.elements, layout.breakpoints):
        raise ValueError(
            f"the curve has elements {layout.elements} with breakpoints {layout.breakpoints}, the model {own.elements} "
            f"with {own.breakpoints}: it was traced with another model; give the problem it was traced with"
        )
    same_model(branch.meta.get("model"), problem.model)
    if (own.nu, problem.size) != (layout.nu, branch.X.shape[1]):
        problem = problem.with_order(layout.nu, layout.harmonics)
    for name in branch.parameters_at(0):
        problem.check_parameter(name)
    return problem


def same_model(written: Any, model: Any) -> None:
    """Raise if a model is not the one in the header of a branch.

    Parameters
    ----------
    written : dict or None
        Description of the model in the header; without it every model is accepted.
    model : Model
        Model to be compared.

    Raises
    ------
    ValueError
        If the model differs, or the header has no description.
    """
    own = describe(model)
    if not written:
        return
    if not is_description(written):
        raise ValueError("the curve does not contain its model: trace it again")
    other = differing_fields(written, own)
    if written["class"] == own["class"] and not other:
        return
    difference = (
        f"with other {', '.join(other)}"
        if written["class"] == own["class"]
        else f"a {written['class']}, not {own['class']}"
    )
    raise ValueError(f"the curve was traced with another model ({difference}): give the problem it was traced with")


def choose(branch: Branch, points: int | Sequence[int | str]) -> list[tuple[int, str]]:
    """Select the points to be compared.

    Parameters
    ----------
    branch : Branch
        Branch of periodic motions.
    points : int or sequence of int or str
        Number of points, or indices of points and labels of special points.

    Returns
    -------
    list of tuple
        Index and reason of each point, in the order of the branch.

    Raises
    ------
    ValueError, IndexError, KeyError
        If no point is given, or a point is not on the branch.
    """
    if isinstance(points, int | np.integer):
        return _selected_points(branch, counted("points", points, _MAX_POINTS))
    selected: dict[int, str] = {}
    for key in points:
        if isinstance(key, str):
            selected.setdefault(branch[key].index, key)  # type: ignore[attr-defined]
        elif not -len(branch) <= key < len(branch):
            raise IndexError(f"point {key} is outside the branch, which has points 0 to {len(branch) - 1}")
        else:
            selected.setdefault(int(key) % len(branch), "selected")
    if not selected:
        raise ValueError("no points to validate; give a number, indices or labels")
    return sorted(selected.items())


def _selected_points(branch: Branch, count: int) -> list[tuple[int, str]]:
    """Return up to 3/4 of the points near special points, the peak and the largest error, and others between."""
    wanted: list[tuple[int, str]] = []
    for point in branch.special:
        if point.kind == "LP":
            wanted += [(_regular_neighbour(branch, point.index, side), f"near {point.label}") for side in (-1, 1)]
    wanted.append((int(np.nanargmax(branch.amplitude("rms"))), "peak"))
    if not np.isnan(branch.error).all():
        wanted.append((int(np.nanargmax(branch.error)), "worst error"))
    for point in branch.special:
        if point.kind not in ("LP", "CP", "IC", "SL"):
            wanted += [(_clipped_index(branch, point.index + side), f"near {point.label}") for side in (-1, 1)]
    selected: dict[int, str] = {}
    # at these points the motion is singular or its stability changes
    taken = {p.index for p in branch.special if p.kind in ("LP", "BP", "CP", "IC", "PD", "NS")} | _singular_ends(branch)
    # at first slip the growth of a disturbance is not that of a multiplier: some disturbances slip, others do not
    taken |= {p.index + side for p in branch.special if p.kind == "SL" for side in (-1, 0, 1)}
    for i, reason in wanted:
        if len(selected) < max(count - count // 4, 1) and i not in selected and i not in taken:
            selected[i] = reason
    free = [i for i in range(len(branch)) if i not in taken]
    while len(selected) < min(count, len(free)):
        selected[_farthest_point(branch, free, selected)] = "between"
    return sorted(selected.items())


def _singular_ends(branch: Branch) -> set[int]:
    """Return the indices of the ends that are the branch point at which the branch leaves another branch."""
    if branch.multipliers is None:
        return set()
    return {
        i
        for i in (0, len(branch) - 1)
        if np.abs(branch.multipliers[i] - 1).min(initial=np.inf) <= _BRANCH_POINT_TOLERANCE
    }


def _clipped_index(branch: Branch, i: int) -> int:
    """Return an index limited to the branch."""
    return min(max(i, 0), len(branch) - 1)


def _regular_neighbour(branch: Branch, fold: int, side: int) -> int:
    """Return the index of the first point on one side of a fold that is not nearly singular."""
    for distance in range(1, 6):
        i = _clipped_index(branch, fold + side * distance)
        if branch.multipliers is None or np.abs(branch.multipliers[i] - 1).min() > _MIN_DISTANCE_FROM_FOLD:
            return i
    return _clipped_index(branch, fold + 2 * side)


def _farthest_point(branch: Branch, free: list[int], selected: dict[int, str]) -> int:
    """Return the index of the point with the largest arclength from the selected points."""
    size = max(float(np.linalg.norm(np.ptp(branch.X, axis=0))), 1e-300)
    span = float(np.ptp(branch.values)) or 1.0
    steps = np.hypot(np.diff(branch.values) / span, np.linalg.norm(np.diff(branch.X, axis=0), axis=1) / size)
    arclength = np.concatenate([[0.0], np.cumsum(steps)])
    near = [np.abs(arclength[i] - arclength[list(selected)]).min() if selected else -i for i in free]
    return free[int(np.argmax([-1.0 if i in selected else x for i, x in zip(free, near, strict=True)]))]


# ---- jumps


def _check_jump(curves: tuple[Branch, ...], jump: Jump) -> JumpCheck:
    """Return the comparison of a jump of the first curve with time integration."""
    stated = jump.after
    ends = landed(curves, jump, arrivals(curves[0], jump))
    decided, (found, *_) = ends[0]
    elements = curves[0].layout.elements if curves[0].layout else ()
    before = np.array([jump.before.amplitude("rms", j) for j in range(len(elements))])
    which = int(np.argmax(np.abs(found.rms - before)))
    after = float("nan") if stated is None else stated.amplitude("rms", which)
    return JumpCheck(
        jump.label, jump.value, jump.direction, elements[which], float(before[which]), after, float(found.rms[which]),
        found.period, found.integrated_periods, decided, _landing_status(curves, stated, ends),
    )  # fmt: skip


def _landing_status(
    curves: tuple[Branch, ...], stated: Point | None, ends: list[tuple[Jump, list[JumpOutcome]]]
) -> str:
    """Return the status of a jump: agreement if one of its landings is the motion that the curve states."""
    tries = sum(len(group) for _, group in ends)
    for end, group in ends:
        if stated is not None and end.after is not None and same_motion(end.after, (stated,)) is not None:
            return AGREES if len(ends) == 1 else f"{AGREES} in {len(group)} of {tries} tries: indeterminate"
    decided = ends[0][0]
    target = _landing_curve(curves, decided)
    where = f"on curve {target + 1} of them" if target else "on another stable motion of the curve"
    text = decided.note if target is None else where
    if decided.landing != "integrate":
        return text
    return f"{AGREES}: {text}" if stated is None and target != 0 else f"lands {text}"


def _landing_curve(curves: tuple[Branch, ...], jump: Jump) -> int | None:
    """Return the index of the curve on which a jump of the first curve lands; None if it is on none of them."""
    ((found, *_), *_) = landings((dataclasses.replace(curves[0], jump_records=(jump,)), *curves[1:]))
    return found.branch


# ---- one point


class _Compared(NamedTuple):
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


def _check(branch: Branch, problem: Any, i: int, reason: str, tolerance: float, limit: float) -> Check:
    here = branch.parameters_at(i)
    X, layout = branch.X[i], branch.layout
    assert layout is not None
    stored = branch.multipliers[i] if branch.multipliers is not None else None
    stored = None if stored is None or np.isnan(stored).any() else stored
    stable = None if branch.multipliers is None else branch[i].stable

    def status_of(compared: _Compared) -> str:
        return _status(compared, stable, tolerance, limit)

    own = last = _compared(problem, X, stored, here)
    status = status_of(own)
    if status != AGREES:
        for finer, Y in _refinements(problem, X, stored, here):
            last = _compared(finer, Y, None, here)
            if status_of(last) == AGREES:
                status = f"{AGREES} with H = {last.H}"
                break
        else:
            status += f", with H = {last.H} too" if last is not own else ""
    refined = status.startswith(AGREES) and last is not own
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
        multiplier_error=nan if orbit is None else _multiplier_distance(own.mu, true_mu),
        sensitivity=nan if orbit is None else 1 / max(float(np.abs(true_mu - 1).min()), 1e-12),
        mu=complex(own.mu[np.argmax(np.abs(own.mu))]),
        mu_true=complex(true_mu[0]),
        growth=judge.growth,
        stable=stable,
        status=status,
        harmonics=judge.H,
        refined_error=float(judge.errors(orbit)[:, [0, 2]].max()) if refined and orbit else nan,
    )


def _compared(problem: Any, X: Array, mu: ComplexArray | None, here: dict[str, float]) -> _Compared:
    """Return a solution with its periodic motion by shooting; without it if shooting does not converge."""
    changes = {k: v for k, v in here.items() if k != "Omega"}
    model = problem.model.replace(**changes) if changes else problem.model
    y = state_of(problem, X, **here)
    layout = problem.layout
    rows = [layout.rows(X, j) for j in range(len(layout.elements))]
    mu = problem.multipliers(X, **here) if mu is None else mu
    closure = _closure(model, y, here["Omega"], problem.nu)
    try:
        orbit = shoot(model, here["Omega"], y, problem.nu, tolerance=10 * _INTEGRATION_TOLERANCE)
    except (NoConvergence, ArithmeticError, np.linalg.LinAlgError):
        return _Compared(problem.H, rows, mu, closure)
    return _Compared(problem.H, rows, mu, closure, orbit, _growth(model, orbit))


def _refinements(
    problem: Any, X: Array, mu: ComplexArray | None, here: dict[str, float]
) -> Iterator[tuple[Any, Array]]:
    """Yield the same motion with 2, 4, ... times the harmonics, each solved from the one before.

    Nothing is yielded if harmonic truncation is not the reason for the difference: X does not solve its own equations,
    or mu are not its multipliers.
    """
    layout = problem.layout
    rows = np.array([layout.rows(X, j) for j in range(len(layout.elements))])
    used = (int(np.flatnonzero(rows.any(axis=0)).max(initial=1)) + 1) // 2  # smaller where H varies on the curve
    own = problem if used >= problem.orders[-1] else problem.with_order(problem.nu, used)
    X = own.from_layout(X, layout)
    now = linearise(own, X, "", here)
    if not norm(now.R) <= _CONSISTENCY_TOLERANCE * now.size:
        return
    if mu is not None and not _multiplier_distance(mu, own.multipliers(X, **here)) <= _CONSISTENCY_TOLERANCE * max(
        1.0, float(np.abs(mu).max())
    ):
        return
    for _ in range(_MAX_DOUBLINGS):
        finer = own.with_order(own.nu, 2 * own.H)
        try:
            X = solve(finer, finer.from_layout(X, own.layout), here).X
        except NoConvergence:
            return
        own = finer
        yield own, X


def _closure(model: Any, y: Array, Omega: float, nu: int) -> float:
    """Return the change of the element coordinates and of the rates / Omega in one period, relative to their size.

    It is inf if the motion diverges.
    """
    flow = Flow(model.system(), Omega)
    T = nu * 2 * np.pi / Omega
    try:
        end, _, _ = flow.integrate(0.0, y, T, "DOP853", _INTEGRATION_TOLERANCE)
    except ArithmeticError:
        return np.inf
    (d0, v0), (d1, v1) = flow.gaps(0.0, y), flow.gaps(T, end)
    size = max(float(np.abs(d0).max()), float(np.abs(v0).max()) / Omega, 1e-300)
    return max(float(np.abs(d1 - d0).max()), float(np.abs(v1 - v0).max()) / Omega) / size


def _differences(found: Array, true: Array, nu: int) -> tuple[float, float, float]:
    """Return the relative differences of rms, pp2, and of the first harmonics (relative to the largest of them)."""
    rms, pp2 = (float(abs(m(found) - m(true)) / m(true)) for m in (measures.rms, measures.half_peak_to_peak))
    last = _COMPARED_HARMONICS * nu + 1
    a, b = to_complex(found)[:last], to_complex(true)[:last]
    return rms, pp2, float(np.abs(a - b).max() / np.abs(b[1:]).max())


def _multiplier_distance(mu: ComplexArray, true: ComplexArray) -> float:
    """Return the largest distance of multipliers matched in pairs."""
    D = np.abs(mu[:, None] - true)
    return float(D[scipy.optimize.linear_sum_assignment(D)].max())


def _growth(model: Any, orbit: Orbit) -> float:
    """Return the growth per period of a disturbance in the direction of the largest multiplier.

    It is computed from two disturbed motions, and inf if one of them diverges.
    """
    system = model.system().at_speed(orbit.Omega)
    structure, flow = LinearStructure(system), Flow(system, orbit.Omega)
    mu, U, V = scipy.linalg.eig(orbit.reduced, left=True)
    top = int(np.argmax(np.abs(mu)))
    left = U[:, top].conj()
    y = from_modal(structure, V[:, top], len(flow.sliders))
    delta = y * (_GROWTH_DISTURBANCE * np.linalg.norm(orbit.state) / np.linalg.norm(y))
    # few periods: a decaying disturbance must remain above rounding, a growing one must remain small
    periods = int(np.clip(np.floor(np.log(1e3) / max(abs(np.log(abs(mu[top]))), 1e-3)), 1, _MAX_GROWTH_PERIODS))
    T = orbit.nu * 2 * np.pi / orbit.Omega
    try:
        ends = [
            flow.integrate(0.0, orbit.state + s * delta, periods * T, "DOP853", _INTEGRATION_TOLERANCE)[0]
            for s in (1, -1)
        ]
    except ArithmeticError:
        return np.inf
    first = left @ to_modal(structure, delta)
    last = left @ to_modal(structure, 0.5 * (ends[0] - ends[1]))
    return float(abs(last / first) ** (1 / periods))


def _status(compared: _Compared, stable: bool | None, tolerance: float, limit: float) -> str:
    """Return the quantities that disagree, or `AGREES`."""
    if compared.orbit is None:
        return "no periodic motion found"
    errors = compared.errors(compared.orbit).max(axis=0)
    wrong = [
        name
        for name, error, allowed in zip(("rms", "pp2", "harmonics"), errors, (1, 10, 1), strict=True)
        if not error <= allowed * tolerance
    ]
    if not _multiplier_distance(compared.mu, compared.orbit.multipliers) <= limit:
        wrong.append("multipliers")
    wrong = [f"{', '.join(wrong)} differ{'s' if wrong in (['rms'], ['pp2']) else ''}"] if wrong else []
    largest, growth = abs(compared.orbit.multipliers[0]), compared.growth
    if not abs(growth - largest) <= 1e-3 * max(1.0, largest) + limit:
        wrong.append("growth differs from the multiplier")
    if stable is not None and (growth <= 1 + STABILITY_TOLERANCE) != stable and abs(growth - 1) > min(limit, 1e-5):
        wrong.append("disturbances grow" if stable else "disturbances decay")
    return ", ".join(wrong) or AGREES
