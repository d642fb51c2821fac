"""Branch: a traced curve of solutions, row by row, with the points that were singled out on it.

    row i:  parameter = values[i],  unknowns X[i], read as the `LayoutProtocol` of the problem says (`Branch.layout`)

A row is stable if none of its multipliers lies outside the unit circle. Saving, loading and plotting need no problem.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.facade import call
from hbgear.common.ranges import counted
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.continuation.results.consistency import stable_on_both_sides, unexplained_changes
from hbgear.continuation.results.facade import BranchFacade
from hbgear.continuation.results.layout import LayoutProtocol, RebuildsProblem, ReconstructsMotion

STABILITY_TOLERANCE = 1e-6
"""A multiplier within this distance outside the unit circle counts as on it (free rotations have mu = 1)."""


class Status(StrEnum):
    """Why a trace ended.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6), steps=hb.StepControl(max_points=10))
    >>> curve.status is hb.Status.MAX_POINTS, curve.status.complete
    (True, False)
    """

    REACHED_END = "reached_end"
    LEFT_SPAN = "left_span"
    UNBOUNDED = "unbounded"
    CLOSED = "closed"
    MERGED = "merged"
    EVENT = "event"
    ARBITRARY = "arbitrary"
    RETRACED = "retraced"
    MAX_POINTS = "max_points"
    STEP_TOO_SMALL = "step_too_small"
    INTERRUPTED = "interrupted"
    FAILED = "failed"

    @property
    def complete(self) -> bool:
        """Whether the curve was followed as far as it goes within the span."""
        return self in (
            Status.REACHED_END, Status.LEFT_SPAN, Status.UNBOUNDED, Status.CLOSED, Status.MERGED, Status.EVENT,
            Status.ARBITRARY,
        )  # fmt: skip

    @property
    def advice(self) -> str:
        """What the user should do about it."""
        return _ADVICE[self]


_ADVICE = {
    Status.REACHED_END: "nothing to do: the end of the span was reached",
    Status.LEFT_SPAN: "the curve turned back and left the span through its start; trace it from the other end as well, "
    "with the ends of the span exchanged",
    Status.UNBOUNDED: "nothing to do: the curve goes on without end, and nears the value that is told",
    Status.MERGED: "nothing to do: the branch ended on the one it came from",
    Status.EVENT: "nothing to do: a terminal event was reached; go on from its point to trace further",
    Status.ARBITRARY: "something of the solutions is arbitrary, as the message says, and was chosen: load the system, "
    "or support the free motion",
    Status.CLOSED: "nothing to do: the curve closed on itself",
    Status.RETRACED: "allow shorter steps or a smaller turning angle: "
    "steps=hb.StepControl(max_step=..., max_turn_deg=...)",
    Status.MAX_POINTS: "allow more points or longer steps, or go on from the last point: hb.extend(curve), "
    "hbgear extend FILE",
    Status.STEP_TOO_SMALL: "go on from the last point with more harmonics or samples: hb.extend(curve, problem=...), "
    "hbgear extend FILE --harmonics 32; or allow shorter steps: steps=hb.StepControl(min_step=...)",
    Status.INTERRUPTED: "what was done is kept; go on from there (a curve: hb.extend(curve), hbgear extend FILE)",
    Status.FAILED: "what was done is kept; go on from there, if need be with other settings (a curve: hb.extend(curve, "
    "problem=...))",
}


def _known(layout: LayoutProtocol | None) -> LayoutProtocol:
    if layout is None:
        raise ValueError("the problem does not say how its unknowns are read (layout is None); read X directly")
    return layout


def name_of_regime(codes: NDArray[np.int8], layout: LayoutProtocol | None) -> str:
    """The most severe regime among codes, by its name, or "unknown"."""
    worst = int(np.max(codes, initial=-1))
    names = layout.regimes if layout else ()
    return names[min(worst, len(names) - 1)] if worst >= 0 and names else "unknown"


def is_stable(multipliers: ComplexArray) -> NDArray[np.bool_]:
    """Whether no multiplier (..., r) lies outside the unit circle; shape (...)."""
    return np.asarray(np.abs(multipliers).max(axis=-1, initial=0.0) <= 1 + STABILITY_TOLERANCE)


ENDS = ("LP", "PD", "NS", "BP")
"""Kinds of special points at which solutions can become stable or unstable."""


STABILITY_STATES = ("unstable", "stable", "undecided", "unknown")
"""What can be said of the stability of a solution."""


def stability_codes(multipliers: ComplexArray, modulus_error: Array) -> NDArray[np.int_]:
    """Numbers in `STABILITY_STATES` for multipliers (..., r) and errors (...) of their largest modulus."""
    modulus = np.abs(multipliers).max(axis=-1, initial=0.0)
    reached = (np.abs(modulus - 1.0) <= modulus_error) & (modulus_error > STABILITY_TOLERANCE)
    codes: NDArray[np.int_] = np.where(reached, 2, modulus <= 1 + STABILITY_TOLERANCE)
    return np.where(np.isnan(modulus), 3, codes)


@dataclass(frozen=True, eq=False, repr=False)
class Point:
    """One solution.

    Parameters
    ----------
    X, layout : (n,) unknowns and how they are to be read; None if the problem does not say.
    parameters : all parameters by name, that in which the curve was traced last.
    residual, iterations : of the corrector.
    multipliers : (r,) multipliers of small disturbances (Floquet), None if they were not computed.
    regime : (m,) code of each element, named by ``layout.regimes``; -1 is unknown.
    error : estimated error of the solution, nan if unknown. Of a special point that of its place; see `SpecialPoint`.
    modulus_error : estimated error of the largest modulus of the multipliers; nan where that is far from 1, or unknown.
    problem : what it solves, perhaps with more unknowns than that; None if it is not known. It is not saved.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> point = curve[3]
    >>> point.stable, bool(point.amplitude("H1") == curve.amplitude("H1")[3])
    (True, True)
    """

    X: Array
    parameters: dict[str, float]
    residual: float
    iterations: int
    multipliers: ComplexArray | None
    regime: NDArray[np.int8]
    error: float
    layout: LayoutProtocol | None
    label: str = ""
    modulus_error: float = dataclasses.field(default=math.nan, kw_only=True)
    problem: Any = dataclasses.field(default=None, kw_only=True)

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: the problem goes with the branch, not with each of its points."""
        return {**vars(self), "problem": None}

    def __repr__(self) -> str:
        place = "".join(f" at {name} = {self.parameters[name]:.6g}" for name in list(self.parameters)[-1:])
        verdict = "stability unknown" if self.verdict == "unknown" else self.verdict
        return f"<{self.label or 'Point'}{place}, {verdict}, {self.regime_name}>"

    @property
    def verdict(self) -> str:
        """One of `STABILITY_STATES`: undecided if the error reaches the unit circle, unknown without multipliers."""
        if self.multipliers is None:
            return "unknown"
        return STABILITY_STATES[int(stability_codes(self.multipliers, np.asarray(self.modulus_error)))]

    @property
    def stable(self) -> bool | None:
        """None if the multipliers are unknown, or the verdict is undecided."""
        return {"stable": True, "unstable": False}.get(self.verdict)

    @property
    def regime_name(self) -> str:
        """The most severe regime among the elements."""
        return name_of_regime(self.regime, self.layout)

    @checked_arguments()
    def coefficients(self, element: int | str = 0) -> Array:
        """The unknowns of an element: for harmonics the row ``(a0, a1, b1, ..., aH, bH)``."""
        return _known(self.layout).rows(self.X, element).copy()

    @checked_arguments()
    def amplitude(self, measure: str = "rms", element: int | str = 0) -> float:
        """A measure of an element: for harmonics "rms", "pp2", "max", "mean", "H1", "H2", ..."""
        return float(_known(self.layout).measure(measure, self.X, element))

    @checked_arguments()
    def samples(self, element: int | str = 0, count: int = 1024, order: int = 0) -> tuple[Array, Array]:
        """``(theta, values)`` of an element over one period, 0 <= theta < 2 pi; order is that of d/dtheta."""
        counted("order", order, least=0)
        counted("count", count, 10_000_000)
        return _known(self.layout).samples(self.X, element, count, order)


@dataclass(frozen=True, eq=False, repr=False)
class SpecialPoint(Point):
    """A point at which something happens to the branch: kind "LP", "PD", "NS", "BP", "GR", "CP", ..., label "LP1".

    ``index`` is the row of the branch that holds it, ``interval`` the parameter values of the rows that bracketed it.
    If it was not ``locate``, that is solved for, it is only known to lie in the interval. ``meaning`` says what
    happens there, ``marker`` is what figures draw, ``event`` what located it; that is not saved.

    ``error`` is the estimated error of its place, that is of the value of the parameter in which the curve was traced,
    nan if unknown, and ``truncation`` that of its solution. A point whose error was too large with the unknowns of the
    curve is solved for with more of them, which ``layout`` tells; its row of the curve is then only near it.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> fold = curve["LP1"]
    >>> fold.kind, fold.located, round(fold.parameters["Omega"], 3)
    ('LP', True, 1.103)
    """

    kind: str = ""
    index: int = -1
    located: bool = True
    interval: tuple[float, float] = (float("nan"), float("nan"))
    note: str = ""
    meaning: str = ""
    marker: str = ""
    event: Any = None
    truncation: float = math.nan

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: an event may hold any function."""
        return {**super().__getstate__(), "event": None}


def coordinate(dof: int | str, names: Sequence[str]) -> int:
    """Position of a degree of freedom given by number or name.

    Raises
    ------
    KeyError
        If there is none.
    """
    if isinstance(dof, str):
        if dof not in names:
            raise KeyError(f"the model has no degree of freedom '{dof}'{did_you_mean(dof, list(names))}")
        return list(names).index(dof)
    if not 0 <= dof < len(names):
        raise KeyError(f"the model has no degree of freedom {dof}; there are {len(names)}, from 0")
    return dof


@dataclass(frozen=True, eq=False)
class Jump:
    """Where a slow sweep leaves the branch at the special point ``label``, and where it lands.

    The direction is +1 while the parameter increases and -1 while it decreases.

    Parameters
    ----------
    before, after : the solutions on both sides; ``after`` is None if no stable one is known at that value.
    landing : how ``after`` was chosen: "nearest", of the stable solutions known there; "integrate", by integration
        in time from ``before``; or "bifurcating": nothing jumps, the sweep continues on a stable branch that leaves the
        branch point ``before``, of which ``after`` is the first solution.
    candidates : the stable solutions of the curve there; where several curves are looked at, of all of them.
    note : what integration ended in, if that is no motion of the curves given.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> jump = curve.jumps()[0]
    >>> jump.label, jump.direction, round(jump.value, 3)
    ('LP1', 1, 1.103)
    >>> jump.before.amplitude("H1") > jump.after.amplitude("H1")
    True
    """

    label: str
    parameter: str
    value: float
    direction: int
    before: Point
    after: Point | None
    landing: str = "nearest"
    candidates: tuple[Point, ...] = ()
    note: str = ""

    @property
    def decided(self) -> str:
        """How the landing was chosen, in words."""
        if self.landing == "integrate":
            return "integrated"
        if self.landing == BIFURCATING:
            return "continues on the bifurcating branch"
        return f"nearest of {len(self.candidates)}" if len(self.candidates) > 1 else "nearest"


def relative_errors(X: Array, error: Array) -> Array:
    """Errors (P,) of solutions X (P, n), relative to their norms over sqrt 2; not finite where a solution is zero."""
    with np.errstate(all="ignore"):
        relative: Array = error * math.sqrt(2) / np.linalg.norm(X, axis=1)
    return relative


_ROUGH = 1e-2  # relative error of a motion above which a curve is only a sketch


LANDINGS = ("nearest", "integrate")
"""Ways to decide where a jump lands: `Jump.landing`."""


BIFURCATING = "bifurcating"
"""`Jump.landing` where nothing jumps: the sweep continues on a branch that bifurcates."""


def saved_fields(value: Any) -> dict[str, Any]:
    """Fields of a point, jump or branch that are written to files: all but what is code."""
    fields = dataclasses.fields(value)
    return {field.name: getattr(value, field.name) for field in fields if field.name not in _NOT_SAVED}


_NOT_SAVED = ("problem", "event", "recorded")  # what is code, and what files have beside the branch


@dataclass(frozen=True, eq=False)
class FullMotion:
    """Coordinates of every row as a file has them: names (n,), and rows (P, n, ...) like those of an element."""

    names: tuple[str, ...]
    rows: Array


_ARRAYS: dict[str, tuple[Any, int]] = {
    "values": (float, 1), "X": (float, 2), "multipliers": (complex, 2), "iterations": (int, 1), "residual": (float, 1),
    "regime": (np.int8, 2), "error": (float, 1), "step": (float, 1), "modulus_error": (float, 1),
}  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Branch(BranchFacade):
    """A curve of P solutions in one parameter.

    Parameters
    ----------
    parameter, values : name and (P,) values of what was varied.
    X : (P, n) unknowns, read as `layout` says.
    fixed, tracked : the other parameters, constant or (P,).
    multipliers : (P, r) multipliers, None if they were not computed; nan where they failed.
    iterations, residual, error, step : (P,) Newton count, residual, estimated error, arclength step to the row.
    regime : (P, m) code of each element, named by ``layout.regimes``.
    modulus_error : (P,) estimated error of the largest modulus of the multipliers, nan where that is far from 1.
    special, jump_records, status, message : what was found on the way and why it ended.
    meta : versions, model and settings, fit for JSON; of a curve that runs off to infinity
        ``{"asymptotes": {"last": value}}``, the value of the parameter it nears behind its last row (or its first).
    problem : what was traced; not saved.
    others : further curves that cover what this one leaves of its span; see ``cover`` of `trace`.
    recorded : all coordinates, of the file of a model that is none of hbgear.

    Raises
    ------
    ValueError
        If an array does not have P rows, or two special points have the same label.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> curve.message
    'Omega = 1.6 reached'
    >>> curve.values.shape == curve.stable.shape == curve.amplitude("pp2").shape
    True
    >>> curve.special
    (<LP1 at Omega = 1.10338, stable, no_impact>, <LP2 at Omega = 1.10016, stable, no_impact>)
    """

    parameter: str
    values: Array
    X: Array
    fixed: dict[str, float]
    tracked: dict[str, Array]
    multipliers: ComplexArray | None
    iterations: NDArray[np.int_]
    residual: Array
    regime: NDArray[np.int8]
    error: Array
    step: Array
    special: tuple[SpecialPoint, ...]
    jump_records: tuple[Jump, ...]
    status: Status
    message: str
    layout: LayoutProtocol | None
    meta: dict[str, Any]
    problem: Any = None
    others: tuple[Branch, ...] = ()
    modulus_error: Array | None = None
    recorded: FullMotion | None = None

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._tell_points()

    def _tell_points(self) -> None:
        """Tell the points that were singled out which problem they solve, as far as they do not know."""
        if self.problem is None:
            return
        set_ = object.__setattr__
        set_(self, "special", tuple(_knowing(point, self.problem) for point in self.special))
        set_(self, "jump_records", tuple(_jump_knowing(jump, self.problem) for jump in self.jump_records))

    def __post_init__(self) -> None:
        self._tell_points()
        set_ = object.__setattr__
        if self.modulus_error is None:
            set_(self, "modulus_error", np.full(np.size(self.values), math.nan))
        for name, (kind, _) in _ARRAYS.items():
            if (value := getattr(self, name)) is not None:
                set_(self, name, np.asarray(value, dtype=kind))
        set_(self, "tracked", {name: np.asarray(x, dtype=float) for name, x in self.tracked.items()})
        set_(self, "status", Status(self.status))
        arrays = {name: (getattr(self, name), ndim) for name, (_, ndim) in _ARRAYS.items()}
        for name, (array, ndim) in (arrays | {name: (x, 1) for name, x in self.tracked.items()}).items():
            if array is not None and (array.ndim != ndim or len(array) != len(self)):
                raise ValueError(f"Branch: {name} has shape {array.shape}; need {len(self)} rows, one for each value")
        if self.layout and self.X.shape[1] != self.layout.width:
            raise ValueError(f"Branch: rows of {self.X.shape[1]} unknowns do not fit {self.layout}")
        labels = [point.label for point in self.special]
        if len(set(labels)) < len(labels):
            raise ValueError(f"Branch: labels of special points must be unique, got {', '.join(labels)}")

    def __repr__(self) -> str:
        span = f"{self.values[0]:.6g} to {self.values[-1]:.6g}, " if len(self) else ""
        labels = " ".join(point.label for point in self.special) or "no special points"
        others = f", {len(self.others)} other curve{'s' * (len(self.others) > 1)}" if self.others else ""
        return f"<Branch in {self.parameter}: {span}{len(self)} points, {labels}, {self.status}{others}>"

    def __len__(self) -> int:
        return self.values.size

    def __getitem__(self, key: int | str) -> Point:
        """Row by number, or special point by label."""
        if isinstance(key, str):
            found = {point.label: point for point in self.special}
            if key not in found:
                raise KeyError(f"no special point '{key}' on this branch; it has: {', '.join(found) or 'none'}")
            return found[key]
        if not isinstance(key, int | np.integer):
            raise TypeError(f"Branch[{key!r}]: need the number of a row or the label of a special point")
        if not -len(self) <= key < len(self):
            raise IndexError(f"no row {key}; the branch has {len(self)} points")
        mu = None if self.multipliers is None else self.multipliers[key]
        return Point(
            self.X[key], self.parameters_at(key), float(self.residual[key]), int(self.iterations[key]),
            mu, self.regime[key], float(self.error[key]), self.layout,
            modulus_error=float(np.asarray(self.modulus_error)[key]), problem=self.problem,
        )  # fmt: skip

    @property
    def stable(self) -> NDArray[np.bool_] | None:
        """(P,) whether each row is known to be stable; None if no multipliers were computed."""
        return None if self.multipliers is None else np.asarray(self._verdict_codes == 1)

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """(P,) whether the error of the largest multiplier of a row reaches the unit circle."""
        return np.zeros(len(self), dtype=bool) if self.multipliers is None else np.asarray(self._verdict_codes == 2)

    @property
    def _verdict_codes(self) -> NDArray[np.int_]:
        assert self.multipliers is not None and self.modulus_error is not None
        return stability_codes(self.multipliers, self.modulus_error)

    @property
    def verdicts(self) -> list[str]:
        """What can be said of the stability of each row; see `Point.verdict`."""
        if self.multipliers is None:
            return ["unknown"] * len(self)
        return [STABILITY_STATES[code] for code in self._verdict_codes]

    @property
    def relative_error(self) -> float:
        """Largest estimated error of a row, relative to the norm of its unknowns over sqrt 2; nan if unknown."""
        relative = relative_errors(self.X, self.error)
        return math.nan if np.isnan(relative).all() else float(np.nanmax(relative))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the branch cannot be trusted everywhere, in words; empty if it can, or nothing is known of its errors."""
        out = []
        accuracy = self.meta.get("trace", {}).get("accuracy") or math.inf
        truncated = math.isfinite(accuracy) and bool(np.isfinite(self.error).any())  # then an unknown error is a doubt
        size = {p.label: abs(p.parameters[self.parameter]) or 1.0 for p in self.special}
        vague = [
            p.label for p in self.special
            if not p.located or (truncated if math.isnan(p.error) else p.error > 2 * accuracy * size[p.label])
        ]  # fmt: skip
        if vague:
            out.append(f"{', '.join(vague)} not known to the accuracy of {accuracy:g}")
        undecided = np.flatnonzero(self.undecided)
        if undecided.size:
            low, high = self.values[undecided].min(), self.values[undecided].max()
            where = f"= {low:.6g}" if low == high else f"from {low:.6g} to {high:.6g}"
            out.append(f"stability undecided at {undecided.size} points with {self.parameter} {where}")
        if self.stable is not None and len(self) and "stable" not in self.verdicts and "unstable" in self.verdicts:
            out.append(
                "no point of the curve is stable: a machine does not stay on it; trace from another start, or look for "
                "other curves with hb.trace_all"
            )
        out += self._contradictions()
        if self.relative_error > _ROUGH:
            at = self.values[int(np.nanargmax(self.error))]
            out.append(f"motions are known to {self.relative_error:.0e} only, at {self.parameter} = {at:.6g}")
        return tuple(out)

    def _contradictions(self) -> list[str]:
        """What special points and verdicts say against each other, in words; see `consistency`."""
        if self.multipliers is None or not self.meta.get("trace", {}).get("special", True):
            return []
        marks: dict[int, list[str]] = {}
        for point in self.special:
            if point.kind in ENDS:
                marks.setdefault(point.index, []).append(point.kind)
        codes, name = self._verdict_codes, self.parameter
        out = [
            f"stability changes between {name} = {self.values[a]:.9g} and {self.values[b]:.9g} without a special point"
            for a, b in unexplained_changes(codes, marks)
        ]
        folds = {point.index: point.label for point in self.special if point.kind == "LP"}
        both = [folds[i] for i in stable_on_both_sides(codes, marks)]
        return out + ([f"both sides of {', '.join(both)} are stable"] if both else [])

    @property
    def asymptotes(self) -> dict[str, float]:
        """Values of the parameter at which it runs off to infinity, behind its "first" or its "last" row; often {}."""
        known: dict[str, float] = self.meta.get("asymptotes", {})
        return known

    @property
    def regimes(self) -> list[str]:
        """Most severe regime among the elements, for each row."""
        return [name_of_regime(codes, self.layout) for codes in self.regime]

    @checked_arguments()
    def parameters_at(self, i: int) -> dict[str, float]:
        """All parameters of a row."""
        if not -len(self) <= i < len(self):
            raise IndexError(f"there is no row {quoted(i)}; the branch has {len(self)}")
        tracked = {name: float(x[i]) for name, x in self.tracked.items()}
        return {**self.fixed, **tracked, self.parameter: float(self.values[i])}

    @checked_arguments()
    def jumps(self, landing: str | Lander | None = None, others: Sequence[Branch] = ()) -> tuple[Jump, ...]:
        """Where slow sweeps leave the branch, and where they land.

        Parameters
        ----------
        landing : None as it was decided so far, at first "nearest": the stable solution of the branch whose distance
            from the one left is least, whatever their phase. "integrate" follows the motion in time from just beyond
            the point where it is left until it settles; see `hbgear.time.jump_integration`. Or a function
            ``(branch, others) -> branch`` that returns the branch with decided jumps.
        others : further branches on which integration may end.

        Raises
        ------
        ValueError
            If there is no such way, or the branch is integrated without its problem.
        """
        if callable(landing):
            return landing(self, others).jump_records
        if landing not in (None, *LANDINGS):
            raise ValueError(f"landing = {quoted(landing)}: choose one of {', '.join(map(quoted, LANDINGS))}")
        if landing == "integrate":
            decided: Branch = call("hbgear.time.jump_integration.integrate_jumps", self, others)
            return decided.jump_records
        return self.jump_records

    @checked_arguments()
    def amplitude(
        self, measure: str = "rms", element: int | str = 0, dof: int | str | None = None, derivative: int = 0
    ) -> Array:
        """A measure of every row, (P,); see `Point.amplitude`.

        Parameters
        ----------
        measure : "rms", "pp2", "max", "mean", "H1", "H2", ...
        element : which element, by number or name.
        dof : a degree of freedom of the model instead, by number or name; files have what it needs, except of large
            models that are none of hbgear: these need the branch's problem.
        derivative : 0 for displacement, 1 for velocity, 2 for acceleration (in time).

        Raises
        ------
        ValueError, KeyError
            If there is no such measure, element or degree of freedom, or no problem where one is needed.
        """
        counted("derivative", derivative, 10, least=0)
        layout = _known(self.layout)
        rows = layout.rows(self.X, element) if dof is None else self._motion(dof)
        if derivative:
            each = [self.parameters_at(i) for i in range(len(self))]
            rows = layout.in_time(rows, {name: np.array([here[name] for here in each]) for name in each[0]}, derivative)
        return layout.measure_rows(measure, rows)

    @property
    def known_problem(self) -> Any:
        """The problem; of a curve out of a file that of its model, made again, if the file tells it; else None."""
        if self.problem is None and isinstance(layout := self.layout, RebuildsProblem):
            return layout.problem_of(self.meta)
        return self.problem

    @checked_arguments()
    def amplitude_error(
        self, measure: str = "rms", element: int | str = 0, dof: int | str | None = None, derivative: int = 0
    ) -> Array:
        """Estimated error of `amplitude` of every row, (P,): what twice the harmonics change of it.

        Rows of which no better solution is found are nan. For several measures compare with `refine_branch` yourself.

        Raises
        ------
        ValueError, KeyError
            As of `amplitude` and `refine_branch`.

        Examples
        --------
        >>> import hbgear as hb
        >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.0))
        >>> bool(curve.amplitude_error("max").max() < 1e-3)
        True
        """
        plain = self.amplitude(measure, element, dof, derivative)
        better = self.refined().amplitude(measure, element, dof, derivative)
        error: Array = np.abs(better - plain)
        return error

    def _motion(self, dof: int | str) -> Array:
        """Rows of a degree of freedom, (P, ...), from the problem."""
        known = self.recorded if self.problem is None else None
        if known is not None and len(known.rows) == len(self):
            return known.rows[:, coordinate(dof, known.names)]
        problem = self.known_problem
        if not isinstance(problem, ReconstructsMotion):
            raise ValueError(f"dof={dof!r} needs the model; load the branch with hbgear.load(path, problem=...)")
        q = np.array([problem.motion(X, **self.parameters_at(i)) for i, X in enumerate(self.X)])
        return q[:, coordinate(dof, problem.dof_names)]

    @checked_arguments()
    def peak(self, measure: str = "rms", element: int | str = 0) -> Point:
        """The row with the largest measure."""
        return self[int(np.nanargmax(self.amplitude(measure, element)))]


_AnyPoint = TypeVar("_AnyPoint", bound=Point)


def _knowing(point: _AnyPoint, problem: Any) -> _AnyPoint:
    """The point, which knows its problem."""
    return point if point.problem is not None else dataclasses.replace(point, problem=problem)


def _jump_knowing(jump: Jump, problem: Any) -> Jump:
    """The jump, whose points know their problem."""
    points = (jump.before, *(() if jump.after is None else (jump.after,)), *jump.candidates)
    if all(point.problem is not None for point in points):
        return jump
    return dataclasses.replace(
        jump, before=_knowing(jump.before, problem), after=jump.after and _knowing(jump.after, problem),
        candidates=tuple(_knowing(point, problem) for point in jump.candidates),
    )  # fmt: skip


Lander: TypeAlias = Callable[[Branch, Sequence[Branch]], Branch]
"""Returns a branch with decided landings of its jumps."""


def continued(first: Branch, second: Branch) -> Branch:
    """A branch and one that goes on from its last row, as one; special points are numbered on, jumps are not known."""
    n = len(first)
    names = ["values", "X", "iterations", "residual", "regime", "error", "step", "modulus_error"]
    if first.multipliers is not None and second.multipliers is not None:
        names.append("multipliers")
    arrays: dict[str, Any] = {name: np.concatenate([getattr(first, name), getattr(second, name)[1:]]) for name in names}
    count: dict[str, int] = {}
    special = []
    for p in (*first.special, *(dataclasses.replace(p, index=n - 1 + p.index) for p in second.special)):
        count[p.kind] = count.get(p.kind, 0) + 1
        special.append(dataclasses.replace(p, label=f"{p.kind}{count[p.kind]}"))
    tracked = {k: np.concatenate([first.tracked[k], x[1:]]) for k, x in second.tracked.items()}
    return dataclasses.replace(
        second, **{"multipliers": None, **arrays}, special=tuple(special), jump_records=(), tracked=tracked,
        recorded=None,
        meta=with_asymptotes(second.meta, first=first.asymptotes.get("first"), last=second.asymptotes.get("last")),
        others=first.others,
    )  # fmt: skip


def with_asymptotes(meta: dict[str, Any], **ends: float | None) -> dict[str, Any]:
    """The header of a branch that runs off to infinity at these values of its parameter behind its ends."""
    known = {end: value for end, value in ends.items() if value is not None}
    return {name: x for name, x in meta.items() if name != "asymptotes"} | ({"asymptotes": known} if known else {})


def concatenate(back: Branch, forth: Branch) -> Branch:
    """Two traces that left one point in opposite directions, as one branch from the end of back to that of forth.

    Special points are numbered anew along it; the status is that of the worse end, the message tells of both.
    """
    names = ("values", "X", "multipliers", "iterations", "residual", "regime", "error", "step", "modulus_error")
    arrays: dict[str, Any] = {name: x[::-1] for name in names if (x := getattr(back, name)) is not None}
    special = tuple(dataclasses.replace(p, index=len(back) - 1 - p.index) for p in reversed(back.special))
    tracked = {k: x[::-1] for k, x in back.tracked.items()}
    whole = continued(dataclasses.replace(back, **arrays, special=special, tracked=tracked), forth)
    worse = back if not back.status.complete else forth
    meta = with_asymptotes(forth.meta, first=back.asymptotes.get("last"), last=forth.asymptotes.get("last"))
    message = f"{forth.message}; the other way {back.message}"
    return dataclasses.replace(whole, status=worse.status, message=message, meta=meta)


def most_resolved(*branches: Branch) -> Any:
    """The problem with the most harmonics."""
    return max((b for b in reversed(branches) if b.problem is not None), key=lambda b: b.X.shape[1]).problem


def padded_to_common_size(*branches: Branch) -> list[Branch]:
    """The branches with the harmonics of the widest."""
    widest = max(branches, key=lambda b: b.X.shape[1])
    return [b if b.layout == widest.layout else _padded(b, widest) for b in branches]


def _padded(branch: Branch, like: Branch) -> Branch:
    layout = like.layout
    fit = like.problem.from_point
    special = tuple(
        p if p.layout != branch.layout else dataclasses.replace(p, X=fit(p), layout=layout) for p in branch.special
    )
    X = np.array([fit(branch[i]) for i in range(len(branch))])
    return dataclasses.replace(branch, X=X, special=special, layout=layout)
