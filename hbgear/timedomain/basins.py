"""Basins of attraction: which start ends in which motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.progress import Progress, ProgressCallback
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.branch import Status
from hbgear.continuation.ending import Ending
from hbgear.mechanics.doubts import of_model
from hbgear.mechanics.fourier import evaluate
from hbgear.mechanics.model import Model
from hbgear.timedomain.exponential import Flight, Stepper
from hbgear.timedomain.settle import OBSERVED, Settling, settle_into, unsettled
from hbgear.timedomain.sweep import observe

_MOST_STARTS = 250_000  # integrated at once


# ---- basins of attraction


@dataclass(frozen=True, eq=False)
class Attractor:
    """Where motions end: period (0: not periodic), Poincare points (k, 2) of (d, v), rms, share of the starts.

    Motions that run away have period 0, no Poincare points (k = 0) and the rms inf.
    """

    period: int
    points: Array
    rms: float
    share: float


@dataclass(frozen=True, eq=False)
class Basins:
    """Which attractor each start leads to.

    d, v : (X,), (Y,) displacements and rates of the element coordinate at tau = 0.
    label : (Y, X) number of the attractor in `attractors`; -1 where that was not yet known when Ctrl-C ended the work.
    status, message : whether all starts were followed.
    """

    Omega: float
    d: Array
    v: Array
    label: np.ndarray
    attractors: tuple[Attractor, ...]
    labels: dict[str, str]
    status: Status = Status.REACHED_END
    message: str = ""


@checked_arguments()
def basins(
    model: Model,
    Omega: float,
    d: tuple[float, float] = (-2.0, 2.0),
    v: tuple[float, float] = (-2.0, 2.0),
    shape: tuple[int, int] = (60, 60),
    *,
    settling: Settling = Settling(tolerance=1e-6),
    progress: ProgressCallback | None = None,
) -> Basins:
    """Basins of attraction of a model with one coordinate, all starts integrated at once.

    Parameters
    ----------
    model : with one coordinate and one element.
    Omega : excitation frequency.
    d, v : ranges of the element coordinate and its rate at tau = 0.
    shape : numbers of starts along d and v.
    settling : when a motion counts as settled; those that never are form one attractor of period 0, those that
        run away another.
    progress : called with a `Progress`, such as ``print``.

    Returns
    -------
    Basins
        Ctrl-C or an error ends it with the starts whose motions have settled until then.

    Raises
    ------
    ValueError
        If the model has more coordinates, a range is empty or not finite, or there are no starts or too many.
    KeyboardInterrupt
        If Ctrl-C comes before any motion has settled.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.basins(hb.Duffing(zeta=0.2), 1.0, shape=(2, 2))
    >>> found.label.shape
    (2, 2)
    """
    system = model.system()
    if system.n != 1 or len(system.elements) != 1:
        raise ValueError(
            f"basins are drawn over one coordinate and its rate; {type(model).__name__} has {system.n} coordinates and "
            f"{len(system.elements)} elements"
        )
    checked("basins", "Omega", Omega, POSITIVE)
    for end in (*d, *v):
        checked("basins", "an end of d or v", end)
    if not (d[0] < d[1] and v[0] < v[1]):
        raise ValueError(f"need ascending finite ranges of two numbers; got d = {d}, v = {v}")
    starts = counted("shape[0]", shape[0]) * counted("shape[1]", shape[1])
    counted("shape[0] * shape[1]", starts, _MOST_STARTS)
    of_model(model, system)
    x, y = np.linspace(*d, shape[0]), np.linspace(*v, shape[1])
    stepper = Stepper(model, Omega)
    flight = stepper.start(_starts(system, Omega, *np.meshgrid(x, y)))
    count = len(flight.d)

    def report(periods: int, settled: int) -> None:
        if progress:
            progress(Progress(settled / count, f"{settled} of {count} motions settled after {periods} periods"))

    how, ending, done = unsettled(count, settling), Ending(message="all starts were followed"), np.arange(count)
    try:
        settle_into(how, stepper, flight, settling, report)
    except (Exception, KeyboardInterrupt) as error:
        done = np.flatnonzero(how.period)
        if not done.size:
            raise
        ending.note(error, f"after {done.size} of {count} motions had settled")
    label = np.full(count, -1)
    tolerance = settling.tolerance
    label[done], attractors = _sort(stepper.select(done), flight.select(done), how.period[done], tolerance)
    return Basins(
        float(Omega), x, y, label.reshape(len(y), len(x)), attractors, dict(model.labels), ending.status, ending.told
    )


def _starts(system: Any, Omega: float, d: Array, v: Array) -> Array:
    """States (B, 2) with these element coordinates and rates at tau = 0: w q = d + e, w q' = v + e'."""
    element = system.elements[0]
    w, row = float(element.direction[0]), element.displacement.row()
    e, de = evaluate(row, 0.0)[0], Omega * evaluate(row, 0.0, 1)[0]
    return np.column_stack([(d.ravel() + e) / w, (v.ravel() + de) / w])


def _sort(
    stepper: Stepper, flight: Flight, period: np.ndarray, tolerance: float
) -> tuple[np.ndarray, tuple[Attractor, ...]]:
    """Number of the attractor each motion has reached, and the attractors, the most frequent first.

    Motions of one period belong together if their Poincare points do, at whichever of its periods they are: within a
    thousandth of the range of all of them, or within what settled motions may still have to go. Those that run away
    belong together too.
    """
    y = np.concatenate([flight.d, flight.v], axis=1)
    number = np.full(len(y), -1)
    found: list[tuple[int, Array, float]] = []
    stays = np.isfinite(y).all(axis=1)
    share = 1e-3 * np.ptp(y[stays], axis=0) if stays.any() else 0.0
    for i in range(len(y)):
        if number[i] >= 0:
            continue
        k = int(period[i])
        if stays[i]:
            seen = observe(stepper, flight.select(np.array([i])), k or OBSERVED)
            size = seen.max[0] * np.array([1.0, stepper.Omega[0]])
            apart = np.abs(y[:, None] - seen.points[:, 0])
            near = (apart <= np.maximum(share, 10 * tolerance * size)).all(axis=-1).any(axis=1)
            alike = near & (period == k) if k else stays & (period == 0)
            found.append((k, seen.points[:, 0], float(seen.rms[0])))
        else:
            alike = ~stays
            found.append((0, np.empty((0, 2)), np.inf))
        number[alike] = number[i] = len(found) - 1
    order = np.argsort(-np.bincount(number, minlength=len(found)), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    attractors = tuple(
        Attractor(k, points, rms, float(np.mean(number == i)))
        for i in order for k, points, rms in [found[i]]
    )  # fmt: skip
    return rank[number], attractors
