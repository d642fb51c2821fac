"""From the rows of a trace to the `Branch` the user gets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear._version import __version__
from hbgear.continuation.branch import Branch, Point, SpecialPoint, Status
from hbgear.continuation.problem import FullProblem
from hbgear.continuation.reading import Reader
from hbgear.continuation.segment import CurvePoint

if TYPE_CHECKING:
    from hbgear.continuation.events import Event


@dataclass(frozen=True)
class Mark:
    """A special point found on the way: the row that holds it, event, whether located, bracket, remark."""

    index: int
    event: Event
    located: bool
    interval: tuple[float, float]
    note: str


def branch_of(
    problem: FullProblem, name: str, fixed: dict[str, float], rows: list[CurvePoint], marks: list[Mark],
    status: Status, message: str, settings: dict[str, Any],
) -> Branch:  # fmt: skip
    """The branch of these rows, without jumps.

    Rows with fewer unknowns than the problem has are padded; unknowns that are parameters go to ``tracked``. Where only
    some rows were observed, the multipliers of the others are nan and their regimes unknown.
    """
    layout = problem.layout
    points = [_fields(problem, layout, name, fixed, row) for row in rows]
    own = problem.unknown_parameters
    _fill(points)
    known = points[0]["multipliers"] is not None
    count: dict[str, int] = {}
    special: list[SpecialPoint] = []
    for mark in marks:
        kind = mark.event.kind
        count[kind] = count.get(kind, 0) + 1
        special.append(
            SpecialPoint(
                **points[mark.index],
                label=f"{kind}{count[kind]}",
                kind=kind,
                index=mark.index,
                located=mark.located,
                interval=mark.interval,
                note=mark.note,
                meaning=mark.event.meaning,
                marker=mark.event.marker,
                event=mark.event,
            )
        )
    return Branch(
        parameter=name,
        values=np.array([r.value for r in rows]),
        X=np.array([p["X"] for p in points]),
        fixed=dict(fixed),
        tracked={k: np.array([p["parameters"][k] for p in points]) for k in own},
        multipliers=np.array([p["multipliers"] for p in points]) if known else None,
        iterations=np.array([p["iterations"] for p in points]),
        residual=np.array([p["residual"] for p in points]),
        regime=np.array([p["regime"] for p in points]).reshape(len(rows), -1),
        error=np.array([p["error"] for p in points]),
        step=np.array([r.step for r in rows]),
        special=tuple(special),
        jump_records=(),
        status=status,
        message=message,
        layout=layout,
        meta={
            "hbgear": __version__,
            **problem.describe(),
            "trace": settings,
        },
        problem=problem.original,
    )


def _fill(points: list[dict[str, Any]]) -> None:
    """Give the points that were not observed multipliers and regimes of the length of the others."""
    for name, nothing in (("multipliers", math.nan + 0j), ("regime", np.int8(-1))):
        length = max((len(p[name]) for p in points if p[name] is not None), default=0)
        for point in points:
            if length and (point[name] is None or len(point[name]) < length):
                point[name] = np.full(length, nothing)


def point_of(problem: FullProblem, name: str, fixed: dict[str, float], row: CurvePoint) -> Point:
    """The `Point` a row stands for."""
    return Point(**_fields(problem, problem.layout, name, fixed, row))


def _fields(
    problem: FullProblem, layout: Reader | None, name: str, fixed: dict[str, float], row: CurvePoint
) -> dict[str, Any]:
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
        "layout": layout,
    }
