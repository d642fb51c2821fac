"""Basins of attraction: the attractor that the motion from each start approaches.

The starts lie in a plane of state space. The plane of an element contains a state (q0, q0') and has the direction in
which a force of the element accelerates the structure,

    q = q0 + a (d - d0),   q' = q0' + a (v - v0),   a = M^-1 w / (w^T M^-1 w),   w^T a = 1

so that d and v are the coordinate and the rate of the element at tau = 0.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import checked_suffix, csv_table
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination
from hbgear.harmonic.equations.layout import element_index
from hbgear.harmonic.structure.massless import mass_basis
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.plausibility import check_frequency, check_model
from hbgear.mechanics.series.fourier import real_numbers
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.modal_states import StateBatch
from hbgear.time.observation import observe
from hbgear.time.steady_state import OBSERVED, SteadyStateSettings, settle_into, unsettled

_MAX_STARTS = 1_000_000
"""Largest number of starts [-]."""

_NUMBER_OF_BATCHES = 16
"""Number of batches of starts [-], each spread over the plane; a batch uses the attractors of the batches before it."""

_MAX_BATCH_SIZE = 4096
"""Largest number of starts of one batch [-]."""

_CAPTURE_TOLERANCES = 100
"""Distance from a known attractor, in tolerances [-], within which an approaching motion is assigned to it."""

_MAX_CAPTURE_DISTANCE = 1e-3
"""Upper limit of this distance, relative to the state [-]."""


@dataclass(frozen=True, eq=False)
class Attractor:
    """Attractor of a set of starts. All diverging motions form one attractor with rms inf.

    Attributes
    ----------
    period : int
        Period in excitation periods; 0 if the motion is not periodic or diverges.
    points : ndarray, shape (k, 2)
        Poincare points: (d, v) of the element, or for a plane of two given directions the least-squares multiples of
        these. There are none if the motion diverges.
    rms : float
        Root mean square of the element coordinate; inf if the motion diverges.
    share : float
        Fraction of the starts, from 0 to 1.
    """

    period: int
    points: Array
    rms: float
    share: float


@dataclass(frozen=True, eq=False)
class Basins:
    """Attractor of each start in a plane of state space.

    Attributes
    ----------
    Omega : float
        Excitation frequency.
    d, v : ndarray, shape (X,) and (Y,)
        Displacements and rates of the element coordinate at tau = 0, or multiples of two directions.
    label : ndarray, shape (Y, X)
        Index in ``attractors``; -1 if it was not determined before an interruption.
    attractors : tuple of Attractor
        Attractors, the most frequent first.
    labels : dict
        Axis labels of the parameters.
    status : Status
        Status at the end.
    message : str
        Reason for the end.
    element : str
        Name of the element; empty for two given directions.
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

    def __repr__(self) -> str:
        ends = ", ".join(f"period {end.period}" for end in self.attractors)
        return (
            f"<Basins at Omega = {self.Omega:.6g}: {self.label.size} starts, {ends or 'no attractor'}, {self.status}>"
        )

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a table of all starts and their attractors (.csv) by an atomic replacement of the file.

        Parameters
        ----------
        path : str or path-like
            Name of the file, which ends in .csv.

        Raises
        ------
        ValueError
            If the name does not end in .csv.
        """
        checked_suffix(path, (".csv",), "tables are .csv files")
        with csv_table(path) as writer:
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
    """Compute the basins of attraction over a plane of starts.

    Parameters
    ----------
    model : Model
        Model with any number of coordinates for which its modes can be computed.
    Omega : float
        Excitation frequency, > 0.
    d, v : tuple of float, optional
        Ranges of the element coordinate and its rate at tau = 0; with ``plane``, of the multiples of its directions.
        Default: (-2, 2).
    shape : tuple of int, optional
        Numbers of starts along d and v. Default: (60, 60).
    element : int or str, optional
        Index or name of the element whose coordinate and rate are varied; required if there are several elements.
    start : array_like, shape (2n,), optional
        State (q, q') in the plane. Default: at rest at q = 0.
    plane : array_like, shape (2, 2n), optional
        Two directions of state space instead of an element: starts are start + d plane[0] + v plane[1].
    settling : SteadyStateSettings, optional
        Conditions under which a motion is settled. Motions that do not settle form one attractor of period 0, motions
        that diverge another one. A motion that approaches a known attractor and is within 100 tolerances of it (at most
        1e-3 of the state) is not integrated further.
    progress : callable, optional
        Called with a `Progress`, such as ``print``.

    Returns
    -------
    Basins
        Attractor of each start. After Ctrl-C or an error it contains the starts whose motions have settled.

    Raises
    ------
    ValueError
        If there are several elements and none is selected, or an element and a plane are given; if the start or the
        plane does not fit the model, a range is empty or not finite, or the number of starts is out of range.
    KeyError
        If there is no such element.
    KeyboardInterrupt
        If Ctrl-C is pressed before any motion has settled.

    Examples
    --------
    >>> import hbgear as hb
    >>> basins = hb.time.basins(hb.Duffing(zeta=0.2), 1.0, shape=(2, 2))
    >>> basins.label.shape
    (2, 2)
    """
    checked("basins", "Omega", Omega, POSITIVE)
    for end in (*d, *v):
        checked("basins", "an end of d or v", end)
    if not (d[0] < d[1] and v[0] < v[1]):
        raise ValueError(f"ranges must be two ascending finite numbers; given: d = {d}, v = {v}")
    count = counted("shape[0]", shape[0]) * counted("shape[1]", shape[1])
    counted("shape[0] * shape[1]", count, _MAX_STARTS)
    system = model.system()
    index = _element(model, system, element, plane)
    check_model(model, system)
    integrator = ExponentialIntegrator(model, Omega)
    check_frequency(integrator.structures[0], float(Omega))
    origin, directions = _plane(integrator, system, Omega, index, start, plane)
    x, y = np.linspace(*d, shape[0]), np.linspace(*v, shape[1])
    multiples = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    motions = integrator.start(origin + multiples @ directions)
    search = _Search(integrator, settling, index, integrator.modal(np.vstack([origin, directions])))
    label, ending = np.full(count, -1), Termination(message="all starts were integrated", advice=_ADVICE)
    try:
        _follow(search, motions, label, progress)
    except (Exception, KeyboardInterrupt) as error:
        settled_count = np.count_nonzero(label >= 0)
        if not settled_count:
            raise
        ending.record_error(error, f"after {settled_count} of {count} motions had settled")
    name = "" if index is None else system.elements[index].name or f"element {index}"
    label, attractors = search.ranked(label)
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


_ADVICE = "the settled motions are kept; allow more time, or use a coarser grid: shape="
"""Recommended action for basins that are not complete."""


def _element(model: Model, system: System, element: int | str | None, plane: ArrayLike | None) -> int | None:
    """Return the index of the element of the plane; None for a plane of two given directions."""
    names = [e.name for e in system.elements]
    if plane is not None:
        if element is not None:
            raise ValueError(
                f"element = {element!r} and plane both select the plane of the starts: give only one of them"
            )
        return None
    if element is None and len(names) > 1:
        raise ValueError(
            f"{type(model).__name__} has {system.n} coordinates and {len(names)} elements: select one of "
            f"{', '.join(map(repr, names))} by element=0 to {len(names) - 1} or by name"
        )
    return element_index(names, 0 if element is None else element)


def _plane(
    integrator: ExponentialIntegrator, system: System, Omega: float, index: int | None, start: Any, plane: Any
) -> tuple[Array, Array]:
    """Return a state (2n,) and directions (2, 2n) of the plane of the starts."""
    n = system.n
    center = np.zeros(2 * n) if start is None else real_numbers("basins: start", start, "a state (q, q')")
    if center.shape != (2 * n,) or not np.all(np.isfinite(center)):
        raise ValueError(f"start = {start}: give a state (q, q') of {2 * n} finite numbers")
    if index is None:
        directions = real_numbers("basins: plane", plane, "two directions of state space")
        if directions.shape != (2, 2 * n) or not np.all(np.isfinite(directions)):
            raise ValueError(f"plane of shape {directions.shape}: give two directions (2, {2 * n}) of finite numbers")
        if np.linalg.matrix_rank(integrator.modal(directions)) < 2:
            raise ValueError("the directions of the plane must be linearly independent, and must not be free motions")
        return center, directions
    element, w = system.elements[index], system.W[:, index]
    M, e = integrator.structures[0].M, element.displacement
    basis = mass_basis(M)
    a = basis @ np.linalg.lstsq(basis @ M @ basis, basis @ w, rcond=_MASSLESS_RATIO)[0]  # M may be singular
    a /= w @ a
    coordinates = w @ center[:n] - float(e(0.0)), w @ center[n:] - Omega * float(e(0.0, 1))
    directions = np.zeros((2, 2 * n))
    directions[0, :n], directions[1, n:] = a, a
    return center - np.asarray(coordinates) @ directions, directions


_MASSLESS_RATIO = 1e-13
"""Singular value of M with scaled coordinates, relative to the largest, that is zero."""


@dataclass(eq=False)
class _Search:
    """Attractors found so far.

    element_index: index of the element of the plane. plane: modal states (3, 2 q) of its origin and directions.
    states: of each attractor the modal states (k, 2 q) once per period, multiplied by the weights.
    """

    integrator: ExponentialIntegrator
    settling: SteadyStateSettings
    element_index: int | None
    plane: Array
    states: list[Array] = field(default_factory=list)
    attractors: list[Attractor] = field(default_factory=list)

    def __post_init__(self) -> None:
        tolerance = self.settling.tolerance
        self.weights = self.integrator.weights()
        self.capture = max(tolerance, min(_CAPTURE_TOLERANCES * tolerance, _MAX_CAPTURE_DISTANCE))

    def nearby(self, current: Array, before: Array) -> np.ndarray:
        """Return the periods of the known attractors that motions approach and are near, 0 without one."""
        period = np.zeros(len(current), dtype=int)
        for attractor, states in zip(self.attractors, self.states, strict=True):
            if attractor.period:
                distance = self._distance(states, current)
                period[(distance <= self.capture) & (distance < self._distance(states, before))] = attractor.period
        return period

    def _distance(self, states: Array, z: Array) -> Array:
        """Return the distance of modal states (B, 2 q) from the nearest of some states, relative to the largest."""
        x, size = self.weights * z, np.linalg.norm(states, axis=1).max()
        distance = np.min([np.linalg.norm(x - state, axis=1) for state in states], axis=0)
        return distance / (size or 1.0)

    def attractor_indices(self, motions: StateBatch, period: np.ndarray) -> np.ndarray:
        """Return the index of the attractor of each motion; new attractors are added."""
        z, number = self.integrator.to_modal(motions), np.full(len(period), -1)
        bounded = np.asarray(np.isfinite(z).all(axis=1))
        radius = max(2 * self.capture, 10 * self.settling.tolerance)  # of two motions near one attractor
        first_new = 0
        while True:
            for i in range(first_new, len(self.states)):
                k = self.attractors[i].period
                matches = bounded if len(self.states[i]) else ~bounded
                if k:
                    matches = bounded & (self._distance(self.states[i], z) <= radius)
                number[(number < 0) & (period == k) & matches] = i
            first_new = len(self.states)
            unassigned = np.flatnonzero(number < 0)
            if not unassigned.size:
                return number
            if bounded[unassigned[0]]:
                self._add(motions.select(unassigned[:1]), int(period[unassigned[0]]))
            else:
                self.states.append(np.empty((0, z.shape[1])))
                self.attractors.append(Attractor(0, np.empty((0, 2)), np.inf, 0.0))

    def _add(self, motions: StateBatch, period: int) -> None:
        """Add the attractor that a motion has reached."""
        strobes = np.empty((period or OBSERVED, *motions.zeta.shape))
        self.integrator.stroboscopic_map(motions.select(np.array([0])), strobes)
        z = self.integrator.to_modal(StateBatch(strobes[:, 0], motions.d, motions.v, motions.segment))
        observed = observe(self.integrator, motions, period or OBSERVED)
        if self.element_index is None:
            basis = (self.weights * self.plane[1:]).T
            points = np.linalg.lstsq(basis, (self.weights * (z - self.plane[0])).T, rcond=None)[0].T
            rms = float(np.sqrt(np.mean(observed.rms**2)))
        else:
            points, rms = observed.points[:, self.element_index], float(observed.rms[self.element_index])
        self.states.append(self.weights * z)
        self.attractors.append(Attractor(period, points, rms, 0.0))

    def ranked(self, label: np.ndarray) -> tuple[np.ndarray, tuple[Attractor, ...]]:
        """Return labels and attractors, the most frequent first; attractors without a start are left out."""
        counts = np.bincount(label[label >= 0], minlength=len(self.attractors))
        order = [i for i in np.argsort(-counts, kind="stable") if counts[i]]
        rank = np.full(len(counts) + 1, -1)  # the last is for starts without a result
        rank[order] = np.arange(len(order))
        fractions = counts / max(counts.sum(), 1)
        attractors = [self.attractors[i] for i in order]
        return rank[label], tuple(
            Attractor(a.period, a.points, a.rms, float(fractions[i])) for i, a in zip(order, attractors, strict=True)
        )


def _follow(search: _Search, motions: StateBatch, label: np.ndarray, progress: ProgressCallback | None) -> None:
    """Store the attractor of each start, one batch after the other."""
    count, settling = len(label), search.settling
    batches = max(min(_NUMBER_OF_BATCHES, count // 64), -(-count // _MAX_BATCH_SIZE), 1)
    for first in range(batches):
        batch = np.arange(first, count, batches)
        before, part, out = int(np.count_nonzero(label >= 0)), motions.select(batch), unsettled(len(batch), settling)

        def report(periods: int, settled: int, before: int = before) -> None:
            if progress:
                fraction = (before + settled) / count
                progress(Progress(fraction, f"{before + settled} of {count} motions settled after {periods} periods"))

        done = np.arange(0)
        try:
            settle_into(out, search.integrator, part, settling, report, search.nearby if search.states else None)
            done = np.arange(len(batch))
        except (Exception, KeyboardInterrupt):
            done = np.flatnonzero(out.period)
            raise
        finally:
            label[batch[done]] = search.attractor_indices(part.select(done), out.period[done])
