"""Construction of the results: a `Branch` and its special points from the points of a trace."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hbgear._version import __version__
from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import Solution


class Located(Protocol):
    """A located special point: its event, its refined location if there is one, its error and a note."""

    @property
    def event(self) -> Any:
        """The event."""

    @property
    def refined(self) -> Any:
        """The location at a higher resolution, or None."""

    @property
    def error(self) -> float:
        """Estimated error."""

    @property
    def located(self) -> bool:
        """Whether the location converged."""

    @property
    def note(self) -> str:
        """A remark for the user."""

    @property
    def at_all_phases(self) -> bool:
        """Whether a contact begins at all phases at once."""


@dataclass(frozen=True)
class SpecialPointMark:
    """A special point of a branch, the number of its point, and the parameter values at the neighbouring points."""

    index: int
    special: Located
    interval: tuple[float, float]


def build_branch(
    equations: CurveEquations,
    points: list[CurvePoint],
    marks: list[SpecialPointMark],
    end: tuple[Status, str],
    settings: dict[str, Any],
) -> Branch:
    """Return the branch of the points of a trace, special points among them, without jumps.

    The problem of the equations has the largest number of unknowns; points with fewer are padded with zeros. Unknowns
    that are parameters are stored in ``tracked``. Points that were not monitored have multipliers nan and unknown
    regimes. ``end`` is the status and the message; ``settings`` are those of the trace for the header of a file.
    """
    problem = equations.problem
    unknowns, tracked = zip(*(problem.split(point.X) for point in points), strict=True)
    mu = _column(points, "multipliers", math.nan + 0j)
    regime = _column(points, "regime", np.int8(-1))
    regime = np.zeros((len(points), 0), dtype=np.int8) if regime is None else regime.astype(np.int8)
    count: dict[str, int] = {}
    special: list[SpecialPoint] = []
    for mark in marks:
        event, kind = mark.special, mark.special.event.kind
        count[kind] = count.get(kind, 0) + 1
        if event.refined is not None:
            fields = point_fields(equations._replace(problem=event.refined.problem), event.refined.point)
        else:
            fields = point_fields(equations, points[mark.index]) | {
                "multipliers": None if mu is None else mu[mark.index],
                "regime": regime[mark.index],
            }
        fields["problem"] = None  # the branch sets it, at the resolution of the point
        special.append(build_special_point(event, fields, f"{kind}{count[kind]}", mark.index, mark.interval))
    return Branch(
        parameter=equations.name,
        values=np.array([point.value for point in points]),
        X=np.array(unknowns),
        fixed=dict(equations.fixed),
        tracked={k: np.array([row[k] for row in tracked]) for k in problem.unknown_parameters},
        multipliers=mu,
        iterations=np.array([r.iterations for r in points]),
        residual=np.array([r.residual for r in points]),
        regime=regime,
        error=np.array([r.observed.get("error", math.nan) for r in points]),
        step=np.array([r.step for r in points]),
        modulus_error=np.array([r.observed.get("modulus_error", math.nan) for r in points]),
        special=tuple(special),
        jump_records=(),
        status=end[0],
        message=end[1],
        layout=problem.layout,
        meta={
            "hbgear": __version__,
            **problem.describe(),
            "trace": settings,
            **_errors_of_unknowns(points, problem.unknown_parameters),
        },
        problem=problem.original,
    )


def _errors_of_unknowns(points: list[CurvePoint], names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the largest relative error of each unknown parameter, as an entry of a header; empty without errors."""
    checked = [point.observed["unknown_errors"] for point in points if "unknown_errors" in point.observed]
    errors = {name: float(np.fmax.reduce([errors[name] for errors in checked])) for name in names if checked}
    return {"unknown_errors": errors} if errors else {}


def build_special_point(
    event: Located, fields: dict[str, Any], label: str, index: int, interval: tuple[float, float]
) -> SpecialPoint:
    """Return the special point of a branch from its `point_fields`, with label, number of its point and interval."""
    return SpecialPoint(
        **fields | {"error": event.error},
        truncation=fields["error"],
        label=label,
        kind=event.event.kind,
        index=index,
        located=event.located,
        interval=interval,
        note=event.note,
        meaning=event.event.meaning,
        marker=event.event.marker,
        event=event.event,
        at_all_phases=event.at_all_phases,
    )


def _column(points: list[CurvePoint], name: str, missing: Any) -> Array | None:
    """Return a monitored quantity of all points, (P, length), ``missing`` where unknown; None if unknown everywhere."""
    observed = [point.observed.get(name) for point in points]
    lengths = {len(x) for x in observed if x is not None}
    if not lengths:
        return None
    blank = np.full(max(lengths), missing)
    return np.array([x if x is not None and len(x) == len(blank) else blank for x in observed])


def build_point(equations: CurveEquations, point: CurvePoint) -> Point:
    """Return a point of a trace as a `Point`."""
    return Point(**point_fields(equations, point))


def point_fields(
    equations: CurveEquations, point: CurvePoint | Solution, observed: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the fields of the `Point` of a point of a trace, or of a solution with its monitored quantities."""
    if observed is None:
        observed = point.observed if isinstance(point, CurvePoint) else {}
    X, parameters = equations.solution_at(np.append(point.X, point.value))
    mu, regime = observed.get("multipliers"), observed.get("regime", ())
    return {
        "X": X,
        "parameters": parameters,
        "residual": point.residual,
        "iterations": point.iterations,
        "multipliers": None if mu is None else np.asarray(mu, dtype=complex),
        "regime": np.asarray(regime, dtype=np.int8),
        "error": observed.get("error", math.nan),
        "layout": equations.problem.layout,
        "problem": equations.problem.original,
    }
