"""Computations of the explorer: response curves and jump maps for the parameter values of a page.

Each page is a session. A new computation of a session cancels the previous one of the same kind.
"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from hbgear.analysis.jump_maps import jump_map
from hbgear.analysis.parameter_sensitivity.units import units_of
from hbgear.analysis.summary import title_of
from hbgear.common.process.progress import Progress
from hbgear.common.text.messages import shortened
from hbgear.common.text.symbols import in_html, unit_of
from hbgear.continuation.follow import follow
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.tracing.trace import trace
from hbgear.design.fitting.measurement_table import measurements_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.io.branches.npz import packed
from hbgear.mechanics.models import Model
from hbgear.web.editable_model import EditableModel
from hbgear.web.overlay import dots, lines_of_motions
from hbgear.web.reporting import report
from hbgear.web.view import plain, tables, view, views

_MAX_SESSIONS = 16
"""Largest number of pages whose last curve is kept."""

_MAX_HARMONICS = 256
"""Largest number of harmonics of a request."""


class Superseded(Exception):
    """The computation is cancelled because a later request of the session replaces it."""


@dataclass(eq=False)
class Job:
    """A running computation: its last reported progress, and whether the next report ends it."""

    last_progress: Progress = field(default_factory=Progress)
    cancelled: bool = False

    def __call__(self, progress: Progress) -> None:
        self.last_progress = progress
        if self.cancelled:
            raise Superseded


@dataclass(frozen=True)
class Request:
    """A request of a page: values by parameter, range of Omega and number of harmonics."""

    values: dict[str, float]
    span: tuple[float, float]
    harmonics: int

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Request:
        """Return the request that a page sent as JSON, with the keys values, span and harmonics.

        ValueError is raised if an entry is missing or has another form.
        """
        values, span, harmonics = content.get("values"), content.get("span"), content.get("harmonics")
        if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
            raise ValueError("values must be numbers by name")
        if not isinstance(span, list) or len(span) != 2:
            raise ValueError("the span must be two numbers")
        if not isinstance(harmonics, int) or not 1 <= harmonics <= _MAX_HARMONICS:
            raise ValueError(f"the number of harmonics must be from 1 to {_MAX_HARMONICS}")
        numbers = {name: _number(name, value) for name, value in values.items()}
        first, last = _number("the span", span[0]), _number("the span", span[1])
        if first == last or min(first, last) <= 0:  # in words, because the page may have r/min
            raise ValueError("the ends of the curve, from and to, must be positive and different")
        return cls(numbers, (first, last), harmonics)


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number")
    return float(value)


class Explorer:
    """Computations for the pages of one editable model.

    Parameters
    ----------
    subject : EditableModel
        Model and its parameters.
    span : tuple of float
        Initial range of Omega.
    harmonics : int, optional
        Initial number of harmonics; default 16.
    saved : Branch, optional
        Saved branch drawn in the background.
    motions : sequence of Branch, optional
        Tori and backbones drawn on the curves.
    """

    def __init__(
        self,
        subject: EditableModel,
        span: tuple[float, float],
        harmonics: int = 16,
        saved: Branch | None = None,
        motions: Sequence[Branch] = (),
    ) -> None:
        self.subject, self.span, self.harmonics, self.saved = subject, span, harmonics, saved
        self.lines = [line for branch in motions for line in lines_of_motions(branch)]
        self._jobs: dict[tuple[str, str], Job] = {}
        self._curves: OrderedDict[str, Branch] = OrderedDict()
        self._lock = threading.Lock()

    def start(self) -> dict[str, Any]:
        """Return the initial state of the page."""
        model = self.subject.model({})
        return {
            "parameters": [asdict(parameter) for parameter in self.subject.parameters()],
            "span": list(self.span),
            "harmonics": self.harmonics,
            "Omega": in_html(str(model.labels.get("Omega", "Omega"))),
            "behind": [*([] if self.saved is None else _lines_of_curves(self.saved)), *self.lines],
        }

    @contextmanager
    def _job(self, session: str, kind: str) -> Iterator[Job]:
        """Register a computation of a session and cancel the previous one of this kind."""
        job = Job()
        with self._lock:
            earlier = self._jobs.get((session, kind))
            self._jobs[session, kind] = job
        if earlier is not None:
            earlier.cancelled = True
        try:
            yield job
            if job.cancelled:
                raise Superseded
        finally:
            with self._lock:
                if self._jobs.get((session, kind)) is job:
                    del self._jobs[session, kind]

    def progress(self, session: str, kind: str) -> dict[str, Any]:
        """Return the progress of a computation: ``busy``, and if true ``done`` (fraction or None) and ``text``."""
        with self._lock:
            job = self._jobs.get((session, kind))
        if job is None:
            return {"busy": False}
        return {
            "busy": True,
            "done": None if math.isnan(job.last_progress.done) else job.last_progress.done,
            "text": job.last_progress.text,
        }

    def cancel(self, session: str | None = None, kind: str | None = None) -> None:
        """Cancel running computations, by default of all sessions and of both kinds."""
        with self._lock:
            for (job_session, job_kind), job in self._jobs.items():
                if session in (None, job_session) and kind in (None, job_kind):
                    job.cancelled = True

    def curve(self, session: str, request: Request) -> dict[str, Any]:
        """Return the curves of a request for the page, the time [s], and the message of an incomplete branch.

        Superseded is raised if a later request replaces this one, ValueError, KeyError or NoConvergence if a value is
        invalid, or no periodic solution is found.
        """
        started = time.perf_counter()
        with self._job(session, "curve") as job:
            branch = self._traced(request, job)
        with self._lock:
            self._curves[session] = branch
            self._curves.move_to_end(session)
            while len(self._curves) > _MAX_SESSIONS:
                self._curves.popitem(last=False)
        return {
            "curves": views([branch], [title_of(branch)], with_tables=False),
            "seconds": time.perf_counter() - started,
            "ended": "" if branch.status.complete else branch.message,
        }

    def details(self, session: str, request: Request) -> dict[str, Any]:
        """Return the tables of the curve that was last shown, and a Python script that computes it.

        ValueError is raised if the session has no curve yet.
        """
        branch = self._last_curve(session)
        curves = branch.curves
        names = [f"branch {i + 1}" for i in range(len(curves))]
        curve_tables = [tables(curve, curves, names) for curve in curves]
        return {"tables": curve_tables, "model": shortened(title_of(branch), 160), "python": self.python(request)}

    def _last_curve(self, session: str) -> Branch:
        with self._lock:
            branch = self._curves.get(session)
        if branch is None:
            raise ValueError("there is no curve yet")
        return branch

    def _traced(self, request: Request, job: Job) -> Branch:
        problem = HarmonicBalance(self.subject.model(request.values), request.harmonics)
        return trace(problem, "Omega", request.span, progress=job)

    def python(self, request: Request) -> str:
        """Return a Python script that computes the curve of a request."""
        return (
            f"import hbgear as hb\n\n{self.subject.python(request.values)}\n"
            f"curve = hb.trace(hb.HarmonicBalance(model, {request.harmonics}), 'Omega', {request.span!r})\n"
            "for each in curve.curves:\n    for jump in each.jumps():\n"
            "        print(jump.label, jump.value, jump.direction)\n"
        )

    def jump_map(self, session: str, request: Request, axes: Any) -> dict[str, Any]:
        """Return lines and axis labels of a jump map in a plane of two parameters, one of which may be Omega.

        ``axes`` is ``{"x": [name, from, to], "y": [name, from, to], "Omega": value}``; the value of Omega is used if
        neither axis is Omega. A message states that the map is empty or incomplete. Superseded is raised if a later
        request replaces this one, ValueError or KeyError if the axes are invalid or a parameter is unknown.
        """
        ends = _ends(axes)
        x, y = ends
        model = self.subject.model(request.values)
        for name in ends:
            if name != "Omega" and name not in model.parameters | model.entries:
                raise KeyError(f"{type(model).__name__} has no parameter '{name}'")
        with self._job(session, "map") as job:
            if "Omega" in ends:
                lines, message = _map_over_Omega(model, ends, request.harmonics, job)
            else:
                lines, message = _map_over_two(model, ends, request.harmonics, _number("Omega", axes.get("Omega")), job)
        map_lines = [{"x": plain(line[x], 9), "y": plain(line[y], 9), "kind": line["kind"]} for line in lines]
        labels = [in_html(str(model.labels.get(name, name))) for name in ends]
        return {"lines": map_lines, "labels": labels, "message": message}

    def measured(self, request: Request, content: bytes, name: str) -> dict[str, Any]:
        """Return the measured points of a file, whose content the page has read, as groups of dots; see `overlay.dots`.

        The scales of the model convert the data.
        """
        model = self.subject.model(request.values)
        data = measurements_of(content, name)
        amplitude = unit_of(str(model.labels.get("amplitude", "")))
        return {"groups": dots(data, name, units_of(model), amplitude, [model])}

    def saved_as(self, session: str, kind: str, request: Request) -> tuple[str, bytes]:
        """Return name and content of a file: of the curve last shown ("npz", "html") or the design ("toml", "py").

        ValueError is raised if the session has no curve yet, or the kind is unknown.
        """
        if kind == "toml":
            return "design.toml", self.subject.toml(request.values, request.span, request.harmonics).encode()
        if kind == "py":
            return "design.py", self.python(request).encode()
        branch = self._last_curve(session)
        if kind == "npz":
            return "curve.npz", packed(branch)
        if kind == "html":
            return "report.html", report(branch).html.encode()
        raise ValueError("a file is npz, html, toml or py")


def _ends(axes: Any) -> dict[str, tuple[float, float]]:
    """Return the ranges of two parameters by name, the horizontal axis first; raise ValueError if one is invalid."""
    ends: dict[str, tuple[float, float]] = {}
    for axis in ("x", "y"):
        entry = axes.get(axis) if isinstance(axes, dict) else None
        if not isinstance(entry, list) or len(entry) != 3 or not isinstance(entry[0], str):
            raise ValueError("a jump map needs two parameters, each with its range")
        ends[entry[0]] = (_number(entry[0], entry[1]), _number(entry[0], entry[2]))
    if len(ends) < 2:
        raise ValueError("a jump map needs two different parameters")
    return ends


def _lines_of_curves(branch: Branch) -> list[dict[str, Any]]:
    """Return the line of each curve of the span of a saved branch, in all measures and elements.

    Lines end at the upper limit of the axes of a curve that goes to infinity: they would hide the others.
    """
    lines = []
    for one in (view(curve, "") for curve in branch.curves):
        sizes = one["amplitudes"]
        for measure, tops in (one["top"] or {}).items():
            sizes[measure] = [
                [None if y is None or y > top else y for y in by_element]
                for by_element, top in zip(sizes[measure], tops, strict=True)
            ]
        lines.append({"name": "saved curve", "mode": "lines", "x": one["x"], "sizes": sizes})
    return lines


def _map_over_Omega(
    model: Model, ends: Mapping[str, tuple[float, float]], harmonics: int, job: Job
) -> tuple[list[dict[str, Any]], str]:
    """Compute jump frequencies over a parameter."""
    parameter = next(name for name in ends if name != "Omega")
    low, high = sorted(ends["Omega"])
    result = jump_map(model, parameter, ends[parameter], frequencies=(low, high), harmonics=harmonics, progress=job)
    names = {1: "jump, sweep up", -1: "jump, sweep down"}
    lines = [{parameter: arm.values, "Omega": arm.Omega, "kind": names[arm.direction]} for arm in result.arms]
    return lines, "" if result.status.complete and lines else result.message or "no jump found in this range"


def _map_over_two(
    model: Model, ends: Mapping[str, tuple[float, float]], harmonics: int, Omega: float, job: Job
) -> tuple[list[dict[str, Any]], str]:
    """Compute folds of branches in one parameter at a fixed Omega, and continue them in another parameter."""
    (first, span), (second, second_span) = ends.items()
    lines: list[dict[str, Any]] = []
    value = (model.parameters | model.entries)[second]
    contains_value = min(second_span) <= value <= max(second_span)
    for start in [value] if contains_value else np.linspace(*second_span, 3).tolist():
        problem = HarmonicBalance(model.replace(**{second: start}), harmonics)
        curve = trace(problem, first, span, at={"Omega": Omega}, progress=job)
        for point in [p for p in curve.special if p.kind == "LP" and p.located]:
            for end in second_span:
                if end != start:
                    folds = follow(curve, point, second, (start, end), progress=job)
                    x = folds.tracked[first]
                    within = (x >= min(span)) & (x <= max(span))
                    inside_span = np.where(within, x, np.nan)
                    lines.append({first: inside_span, second: folds.values, "kind": f"fold ({point.label})"})
    return lines, "" if lines else f"no fold in {first} at Omega = {Omega:g}: choose a wider range or another Omega"
