"""Basins of attraction: which start ends in which motion.

The starts lie in a plane of state space. That of an element goes through a state (q0, q0') along the direction in which
a force of the element moves the structure,

    q = q0 + a (d - d0),   q' = q0' + a (v - v0),   a = M^-1 w / (w^T M^-1 w),   w^T a = 1

so that d and v are its coordinate and rate at tau = 0.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.plausibility import check_frequency, check_model
from hbgear.mechanics.series.fourier import real_numbers
from hbgear.time.exponential.integrator import ExponentialIntegrator, StateBatch
from hbgear.time.frequency_sweep import index_of, observe
from hbgear.time.steady_state import OBSERVED, SteadyStateSettings, settle_into, unsettled

_MOST_STARTS = 1_000_000


_BATCHES = 16  # of starts, spread over the plane: what the first end in is known to the next


_LARGEST = 4096  # starts in one of them


_CATCH = 100  # tolerances from a motion that has settled at which one that comes nearer is caught by it


_FARTHEST = 1e-3  # the same at most, relative to the state


# ---- basins of attraction


@dataclass(frozen=True, eq=False)
class Attractor:
    """Where motions end: period (0: not periodic), Poincare points (k, 2) in the plane, rms, share of the starts.

    Motions that run away have period 0, no Poincare points (k = 0) and the rms inf.

    The points are (d, v) of the element; in a plane of directions given, the multiples of these that come nearest.
    """

    period: int
    points: Array
    rms: float
    share: float


@dataclass(frozen=True, eq=False)
class Basins:
    """Which attractor each start leads to.

    d, v : (X,), (Y,) displacements and rates of the element coordinate at tau = 0, or multiples of two directions.
    label : (Y, X) number of the attractor in `attractors`; -1 where that was not yet known when Ctrl-C ended the work.
    status, message : whether all starts were followed.
    element : whose coordinate that is; empty for two directions.
    """

    Omega: float
    d: Array
    v: Array
    label: np.ndarray
    attractors: tuple[Attractor, ...]
    labels: dict[str, str]
    status: Status = Status.REACHED_END
    message: str = ""
    element: str = ""

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a table of all starts and what they lead to (.csv), whole or not at all."""
        if not str(path).lower().endswith(".csv"):
            raise ValueError(f"'{path}' must end in .csv")
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(("d", "v", "attractor", "period", "rms"))
            for (y, x), label in np.ndenumerate(self.label):
                end = self.attractors[label] if label >= 0 else None
                writer.writerow((self.d[x], self.v[y], label, end.period if end else "", end.rms if end else ""))


@checked_arguments()
def basins(
    model: Model,
    Omega: float,
    d: tuple[float, float] = (-2.0, 2.0),
    v: tuple[float, float] = (-2.0, 2.0),
    shape: tuple[int, int] = (60, 60),
    *,
    element: int | str | None = None,
    start: Array | Sequence[float] | None = None,
    plane: ArrayLike | None = None,
    settling: SteadyStateSettings = SteadyStateSettings(tolerance=1e-6),
    progress: ProgressCallback | None = None,
) -> Basins:
    """Basins of attraction over a plane of starts.

    Parameters
    ----------
    model : with any number of coordinates, as far as its modes can be computed.
    Omega : excitation frequency.
    d, v : ranges of the element coordinate and its rate at tau = 0; with ``plane``, of the multiples of its directions.
    shape : numbers of starts along d and v.
    element : position or name of the element whose coordinate and rate are varied; need not be given if there is one.
    start : (2n,) state (q, q') the plane goes through; by default at rest at q = 0.
    plane : (2, 2n) two directions of state space instead: starts are start + d plane[0] + v plane[1].
    settling : when a motion counts as settled; those that never are form one attractor of period 0, those that run away
        another. One that comes
        within 100 tolerances (1e-3 of the state at most) of a motion that has settled, and nearer, is not waited for.
    progress : called with a `Progress`, such as ``print``.

    Returns
    -------
    Basins
        Ctrl-C or an error ends it with the starts whose motions have settled until then.

    Raises
    ------
    ValueError
        If there are several elements and none is chosen, or one and a plane; if the start or the plane do not fit, a
        range is empty or not finite, or there are no starts or too many.
    KeyError
        If there is no such element.
    KeyboardInterrupt
        If Ctrl-C comes before any motion has settled.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.time.basins(hb.Duffing(zeta=0.2), 1.0, shape=(2, 2))
    >>> found.label.shape
    (2, 2)
    """
    checked("basins", "Omega", Omega, POSITIVE)
    for end in (*d, *v):
        checked("basins", "an end of d or v", end)
    if not (d[0] < d[1] and v[0] < v[1]):
        raise ValueError(f"need ascending finite ranges of two numbers; got d = {d}, v = {v}")
    count = counted("shape[0]", shape[0]) * counted("shape[1]", shape[1])
    counted("shape[0] * shape[1]", count, _MOST_STARTS)
    system = model.system()
    which = _element(model, system, element, plane)
    check_model(model, system)
    integrator = ExponentialIntegrator(model, Omega)
    check_frequency(integrator.structures[0], float(Omega))
    origin, directions = _plane(integrator, system, Omega, which, start, plane)
    x, y = np.linspace(*d, shape[0]), np.linspace(*v, shape[1])
    multiples = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    motions = integrator.start(origin + multiples @ directions)
    found = _Found(integrator, settling, which, integrator.modal(np.vstack([origin, directions])))
    label, ending = np.full(count, -1), Termination(message="all starts were followed")
    try:
        _follow(found, motions, label, progress)
    except (Exception, KeyboardInterrupt) as error:
        done = np.count_nonzero(label >= 0)
        if not done:
            raise
        ending.record_error(error, f"after {done} of {count} motions had settled")
    name = "" if which is None else system.elements[which].name or f"element {which}"
    label, attractors = found.ranked(label)
    return Basins(
        float(Omega),
        x,
        y,
        label.reshape(len(y), len(x)),
        attractors,
        dict(model.labels),
        ending.status,
        ending.message_with_advice,
        name,
    )


def _element(model: Model, system: System, element: int | str | None, plane: ArrayLike | None) -> int | None:
    """Which element's plane it is; None for one of given directions."""
    names = [each.name for each in system.elements]
    if plane is not None:
        if element is not None:
            raise ValueError(f"element = {element!r} and a plane are two ways to say where the starts lie: give one")
        return None
    if element is None and len(names) > 1:
        raise ValueError(
            f"{type(model).__name__} has {system.n} coordinates and {len(names)} elements: say which of "
            f"{', '.join(map(repr, names))} the starts differ in, by element=0 to {len(names) - 1} or by name"
        )
    return index_of(names, 0 if element is None else element)


def _plane(
    integrator: ExponentialIntegrator, system: System, Omega: float, which: int | None, start: Any, plane: Any
) -> tuple[Array, Array]:
    """A state (2n,) and directions (2, 2n): starts are the state and multiples of these."""
    n = system.n
    through = np.zeros(2 * n) if start is None else real_numbers("basins: start", start, "a state (q, q')")
    if through.shape != (2 * n,) or not np.all(np.isfinite(through)):
        raise ValueError(f"start = {start}: need a state (q, q') of {2 * n} finite numbers")
    if which is None:
        directions = real_numbers("basins: plane", plane, "two directions of state space")
        if directions.shape != (2, 2 * n) or not np.all(np.isfinite(directions)):
            raise ValueError(f"plane of shape {directions.shape}: need two directions (2, {2 * n}) of finite numbers")
        if np.linalg.matrix_rank(integrator.modal(directions)) < 2:
            raise ValueError("the directions of the plane must differ, and not be those of a free motion")
        return through, directions
    element, w = system.elements[which], system.W[:, which]
    e, a = element.displacement, np.linalg.solve(integrator.structures[0].M, w)
    a /= w @ a
    here = w @ through[:n] - float(e(0.0)), w @ through[n:] - Omega * float(e(0.0, 1))
    directions = np.zeros((2, 2 * n))
    directions[0, :n], directions[1, n:] = a, a
    return through - np.asarray(here) @ directions, directions


@dataclass(eq=False)
class _Found:
    """The attractors met so far.

    which : element whose plane it is. plane : (3, 2 q) modal states of its origin and directions.
    states : of each attractor, modal states (k, 2 q) once a period, scaled to sizes.
    """

    integrator: ExponentialIntegrator
    settling: SteadyStateSettings
    which: int | None
    plane: Array
    states: list[Array] = field(default_factory=list)
    attractors: list[Attractor] = field(default_factory=list)

    def __post_init__(self) -> None:
        tolerance = self.settling.tolerance
        self.weights = self.integrator.weights()
        self.catch = max(tolerance, min(_CATCH * tolerance, _FARTHEST))

    def caught(self, now: Array, before: Array) -> np.ndarray:
        """`settle.Caught`: the periods of the motions found that others are near, and nearer than before."""
        period = np.zeros(len(now), dtype=int)
        for attractor, states in zip(self.attractors, self.states, strict=True):
            if attractor.period:
                near = self._distance(states, now)
                period[(near <= self.catch) & (near < self._distance(states, before))] = attractor.period
        return period

    def _distance(self, states: Array, z: Array) -> Array:
        """Of modal states (B, 2 q) from the nearest of these, relative to the largest."""
        x, size = self.weights * z, np.linalg.norm(states, axis=1).max()
        apart: Array = np.min([np.linalg.norm(x - state, axis=1) for state in states], axis=0)
        return apart / (size or 1.0)

    def numbers(self, motions: StateBatch, period: np.ndarray) -> np.ndarray:
        """Number of the attractor each motion has reached; new ones are added."""
        z, number = self.integrator.to_modal(motions), np.full(len(period), -1)
        stays = np.asarray(np.isfinite(z).all(axis=1))
        same = max(2 * self.catch, 10 * self.settling.tolerance)
        known = 0
        while True:
            for i in range(known, len(self.states)):
                k = self.attractors[i].period
                near = stays if len(self.states[i]) else ~stays
                if k:
                    near = stays & (self._distance(self.states[i], z) <= same)
                number[(number < 0) & (period == k) & near] = i
            known = len(self.states)
            left = np.flatnonzero(number < 0)
            if not left.size:
                return number
            if stays[left[0]]:
                self._add(motions.select(left[:1]), int(period[left[0]]))
            else:
                self.states.append(np.empty((0, z.shape[1])))
                self.attractors.append(Attractor(0, np.empty((0, 2)), np.inf, 0.0))

    def _add(self, motions: StateBatch, period: int) -> None:
        """An attractor that a motion has reached."""
        seen = np.empty((period or OBSERVED, *motions.zeta.shape))
        self.integrator.stroboscopic_map(motions.select(np.array([0])), seen)
        z = self.integrator.to_modal(StateBatch(seen[:, 0], motions.d, motions.v, motions.segment))
        watched = observe(self.integrator, motions, period or OBSERVED)
        if self.which is None:
            way = (self.weights * self.plane[1:]).T
            points = np.linalg.lstsq(way, (self.weights * (z - self.plane[0])).T, rcond=None)[0].T
            rms = float(np.sqrt(np.mean(watched.rms**2)))
        else:
            points, rms = watched.points[:, self.which], float(watched.rms[self.which])
        self.states.append(self.weights * z)
        self.attractors.append(Attractor(period, points, rms, 0.0))

    def ranked(self, label: np.ndarray) -> tuple[np.ndarray, tuple[Attractor, ...]]:
        """Labels and attractors, the most frequent first; those of which no start is known are left out."""
        counts = np.bincount(label[label >= 0], minlength=len(self.attractors))
        order = [i for i in np.argsort(-counts, kind="stable") if counts[i]]
        rank = np.full(len(counts) + 1, -1)  # the last is for starts that were not followed
        rank[order] = np.arange(len(order))
        shares = counts / max(counts.sum(), 1)
        attractors = [self.attractors[i] for i in order]
        return rank[label], tuple(
            Attractor(a.period, a.points, a.rms, float(shares[i])) for i, a in zip(order, attractors, strict=True)
        )


def _follow(found: _Found, motions: StateBatch, label: np.ndarray, progress: ProgressCallback | None) -> None:
    """Label the starts, batch after batch."""
    count, settling = len(label), found.settling
    batches = max(min(_BATCHES, count // 64), -(-count // _LARGEST), 1)
    for first in range(batches):
        batch = np.arange(first, count, batches)
        before, here, how = int(np.count_nonzero(label >= 0)), motions.select(batch), unsettled(len(batch), settling)

        def report(periods: int, settled: int, before: int = before) -> None:
            if progress:
                share = (before + settled) / count
                progress(Progress(share, f"{before + settled} of {count} motions settled after {periods} periods"))

        done = np.arange(0)
        try:
            settle_into(how, found.integrator, here, settling, report, found.caught if found.states else None)
            done = np.arange(len(batch))
        except (Exception, KeyboardInterrupt):
            done = np.flatnonzero(how.period)
            raise
        finally:
            label[batch[done]] = found.numbers(here.select(done), how.period[done])
