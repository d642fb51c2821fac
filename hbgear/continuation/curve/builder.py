"""From the rows of a trace to the `Branch` the user gets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hbgear._version import __version__
from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status


class Found(Protocol):
    """A located special point: its event, its refined location if there is one, its error and a note."""

    @property
    def event(self) -> Any:
        """The event."""

    @property
    def sharp(self) -> Any:
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


@dataclass(frozen=True)
class SpecialPointMark:
    """A special point found on the way: the number of its row, what was found, and its bracket."""

    index: int
    found: Found
    interval: tuple[float, float]


def build_branch(
    problem: ContinuationProblem,
    name: str,
    fixed: dict[str, float],
    rows: list[CurvePoint],
    marks: list[SpecialPointMark],
    status: Status,
    message: str,
    settings: dict[str, Any],
) -> Branch:
    """The branch of these rows, without jumps.

    Rows with fewer unknowns than the problem has are padded; unknowns that are parameters go to ``tracked``. Where only
    some rows were observed, the multipliers of the others are nan and their regimes unknown.
    """
    unknowns, values, own = _unknowns(problem, rows)
    mu = _column(rows, "multipliers", math.nan + 0j)
    regime = _column(rows, "regime", np.int8(-1))
    regime = np.zeros((len(rows), 0), dtype=np.int8) if regime is None else regime.astype(np.int8)
    count: dict[str, int] = {}
    special: list[SpecialPoint] = []
    for mark in marks:
        found, kind = mark.found, mark.found.event.kind
        count[kind] = count.get(kind, 0) + 1
        if found.sharp is not None:
            known = point_fields(found.sharp.problem, name, fixed, found.sharp.row)
        else:
            known = point_fields(problem, name, fixed, rows[mark.index]) | {
                "multipliers": None if mu is None else mu[mark.index], "regime": regime[mark.index]
            }  # fmt: skip
        known["problem"] = problem.original
        special.append(build_special_point(found, known, f"{kind}{count[kind]}", mark.index, mark.interval))
    return Branch(
        parameter=name,
        values=values,
        X=unknowns,
        fixed=dict(fixed),
        tracked={k: np.array([here[k] for here in own]) for k in problem.unknown_parameters},
        multipliers=mu,
        iterations=np.array([r.iterations for r in rows]),
        residual=np.array([r.residual for r in rows]),
        regime=regime,
        error=np.array([r.observed.get("error", math.nan) for r in rows]),
        step=np.array([r.step for r in rows]),
        modulus_error=np.array([r.observed.get("modulus_error", math.nan) for r in rows]),
        special=tuple(special),
        jump_records=(),
        status=status,
        message=message,
        layout=problem.layout,
        meta={
            "hbgear": __version__,
            **problem.describe(),
            "trace": settings,
        },
        problem=problem.original,
    )


def _unknowns(problem: ContinuationProblem, rows: list[CurvePoint]) -> tuple[Array, Array, list[dict[str, float]]]:
    """Unknowns of rows (P, n), their values of the parameter (P,), and the parameters among the unknowns of each."""
    if not problem.unknown_parameters and {len(row.u) - 1 for row in rows} == {problem.size}:
        u = np.array([row.u for row in rows])
        return u[:, :-1].copy(), u[:, -1].copy(), []
    X, own = zip(*(problem.split(row.X) for row in rows), strict=True)
    return np.array(X), np.array([row.value for row in rows]), list(own)


def build_special_point(
    found: Found, known: dict[str, Any], label: str, index: int, interval: tuple[float, float]
) -> SpecialPoint:
    """What was found at a row, with what is known of its motion: `point_fields`."""
    return SpecialPoint(
        **known | {"error": found.error}, truncation=known["error"], label=label, kind=found.event.kind, index=index,
        located=found.located, interval=interval, note=found.note, meaning=found.event.meaning,
        marker=found.event.marker, event=found.event,
    )  # fmt: skip


def _column(rows: list[CurvePoint], name: str, nothing: Any) -> Array | None:
    """What was observed of all rows (P, length), ``nothing`` of those that were not; None if none was."""
    seen = [row.observed.get(name) for row in rows]
    lengths = {len(x) for x in seen if x is not None}
    if not lengths:
        return None
    none = np.full(max(lengths), nothing)
    column: Array = np.array([x if x is not None and len(x) == len(none) else none for x in seen])
    return column


def build_point(problem: ContinuationProblem, name: str, fixed: dict[str, float], row: CurvePoint) -> Point:
    """The `Point` a row stands for."""
    return Point(**point_fields(problem, name, fixed, row))


def point_fields(
    problem: ContinuationProblem, name: str, fixed: Mapping[str, float], row: CurvePoint
) -> dict[str, Any]:
    """What a `Point` says of a row."""
    X, own = problem.split(row.X)
    mu, regime = row.observed.get("multipliers"), row.observed.get("regime", ())
    return {
        "X": X,
        "parameters": {**fixed, **own, name: row.value},
        "residual": row.residual,
        "iterations": row.iterations,
        "multipliers": None if mu is None else np.asarray(mu, dtype=complex),
        "regime": np.asarray(regime, dtype=np.int8),
        "error": row.observed.get("error", math.nan),
        "layout": problem.layout,
        "problem": problem.original,
    }
