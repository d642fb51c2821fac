"""Parameters of a model from measured response curves.

    min_a  sum_i ((A(X(Omega_i, a)) - d_i) / s_i)^2 + sum_j ((Omega_j(a) - w_j) / s_j)^2,   low <= a <= high

over the motions that the sweeps are on (`hbgear.design.fitting.sweep_prediction`), Omega_j the frequencies of jumps,
with the
Jacobian J by implicit differentiation. The covariance of the estimate is (J^T J)^-1, times the mean square of the
residuals where no deviations were given. Standard errors are those of the likelihood
(`hbgear.design.fitting.profile_likelihood`).

References
----------
Branch, Coleman & Li (1999), SIAM J. Sci. Comput. 21(1), https://doi.org/10.1137/S1064827595289108, for the bounds.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.lru_cache import LRUCache
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.results.branch import Branch, Status
from hbgear.continuation.results.termination import Termination
from hbgear.design.bounds import bounds_of
from hbgear.design.fitting.measurements import Measurements
from hbgear.design.fitting.profile_likelihood import MOST, profile_interval
from hbgear.design.fitting.sweep_prediction import NotTraced, Prediction
from hbgear.harmonic.frequency_units import scales
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import ImplausibleInputWarning

_APART = 30.0  # ratio of measured to computed amplitudes, or frequencies, from which the unit is doubted

_WIDE = 4.0  # default bounds: the model's value divided and multiplied by this

_ALIKE = 0.995  # correlation from which two parameters cannot be told apart

_NOTHING = 1e-3  # change of all residuals for a change of a parameter by its own size that is none

_GOOD = 4.0
"""Mean square of the residuals, in assumed deviations, below which no other start is tried. In known ones it is 1 with
a standard deviation of (2 / freedom)^(1/2); four of these more are not noise but another minimum, or another model."""

_NEAR = 25.0  # mean square of the residuals beyond which the curve is first brought near to the points

_LOOKED_AT = 6  # random starts looked at for each that is followed


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The estimate and how well it is known.

    Parameters
    ----------
    model : Model
        With the estimated values.
    names : tuple of str, shape (A,)
        Of the parameters that were sought.
    values, errors : dict of str to float
        Estimates and standard errors by name; an error is nan where the data do not determine it. It is that of the
        likelihood where that is larger than the one to first order: half the distance to the farther of the two values
        at which the sum of squares, the other parameters readjusted, is 4 above its least.
    covariance, correlation : ndarray, shape (A, A)
        Of the estimates, to first order.
    data : Measurements
        What was measured.
    curve : Branch
        The response of the model.
    predicted, residuals : ndarray, shape (N,)
        Amplitudes of the model, and their differences to the measured ones in deviations.
    held_against : tuple of str, shape (N,)
        What each point was held against: "swept", "other", "end" or "unreached".
    jumps : ndarray, shape (J,)
        Frequencies of the model's jumps, nan where it has none.
    mean_square : float
        Of all residuals in deviations, over the degrees of freedom.
    starts, evaluations : int
        How many starts were followed, and how many curves were traced.
    doubts : tuple of str
        What is to be doubted, in words.
    status, message : Status
        Why it ended.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> truth = hb.trace(hb.HarmonicBalance(hb.Duffing(zeta=0.06), 3), "Omega", (0.7, 0.9))
    >>> data = hb.design.Measurements(truth.values[1:], truth.amplitude("pp2")[1:], direction=-1)
    >>> found = hb.design.fit(hb.Duffing(), data, {"zeta": (0.01, 0.2)}, harmonics=3)
    >>> round(found.values["zeta"], 6)
    0.06
    """

    model: Model
    names: tuple[str, ...]
    values: dict[str, float]
    errors: dict[str, float]
    covariance: Array
    correlation: Array
    data: Measurements
    curve: Branch
    predicted: Array
    residuals: Array
    held_against: tuple[str, ...]
    jumps: Array
    mean_square: float
    starts: int
    evaluations: int
    doubts: tuple[str, ...]
    status: Status
    message: str

    def __repr__(self) -> str:
        found = ", ".join(f"{name} = {self.values[name]:.6g} +- {self.errors[name]:.2g}" for name in self.names)
        return f"<Fit of {len(self.data)} points: {found}, {self.status}>"

    @property
    def reached(self) -> Array:
        """(N,) whether a stable motion of the curve is where the point was measured."""
        return np.array([kind in ("swept", "other") for kind in self.held_against], dtype=bool)


@checked_arguments(
    data="measurements, such as Measurements(frequency, amplitude, direction=1)",
    free="parameters that are sought, such as {'zeta': (0.01, 0.2)} or ['zeta', 'b']",
)
def fit(
    model: Model | HarmonicBalance,
    data: Measurements,
    free: Mapping[str, tuple[float, float] | None] | Sequence[str],
    *,
    harmonics: int = 16,
    span: tuple[float, float] | None = None,
    starts: int = 3,
    seed: int = 0,
    progress: ProgressCallback | None = None,
) -> Fit:
    """Values of parameters with which the response of a model is nearest to a measured one.

    Parameters
    ----------
    model : Model or HarmonicBalance
        Its values are the first start; a `HarmonicBalance` brings its settings.
    data : Measurements
        See `Measurements`.
    free : mapping of str, tuple[float to float]] | Sequence[str or None
        Names of the parameters that are sought, entries of tuples as ``e[0]``, with their bounds; without bounds from a
        quarter of the model's value to four times it, within the range of the parameter.
    harmonics : int, default 16
        Used if a model is given.
    span : tuple[float, float] or None, optional
        Of Omega over which curves are traced; by default that of the data and a fifth more on both sides.
    starts : int, default 3
        How many starts are followed at most; others than the first are drawn at random within the bounds, and none is
        if the first ends within the noise.
    seed : int, default 0
        Of the random starts.
    progress : ProgressCallback or None, optional
        Called with a `Progress` as work goes on, such as ``print``.

    Returns
    -------
    Fit
        Ctrl-C ends it with the best values until then; ``status`` and ``message`` say so.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If the bounds do not fit, there are more parameters than data, the data are in a unit that cannot be meant, or
        the model has no response at any start.

    Notes
    -----
    A measured jump that the model does not have counts as one far away, and pulls nowhere; points beyond the end of the
    part that their sweep is on pull at the jump there.

    References
    ----------
    Branch, Coleman & Li (1999), SIAM J. Sci. Comput. 21(1), https://doi.org/10.1137/S1064827595289108.

    Examples
    --------
    >>> import hbgear as hb
    >>> truth = hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=0.06), 4), "Omega", (1.4, 1.0))
    >>> data = hb.design.Measurements(truth.values[1:], truth.amplitude("pp2")[1:], direction=-1)
    >>> found = hb.design.fit(hb.SpurPair(), data, {"zeta": (0.01, 0.2), "e[0]": None}, harmonics=4)
    >>> round(found.values["zeta"], 5), found.reached.all().item()
    (0.06, True)
    """
    problem = model if isinstance(model, HarmonicBalance) else HarmonicBalance(model, harmonics)
    problem.require_fixed_resolution("fit")
    counted("fit: starts", starts, 1000)
    counted("fit: seed", seed, least=0)
    names, low, high, own = _bounds(problem, free)
    if len(names) > len(data) + len(data.jumps):
        raise ValueError(
            f"fit: {len(names)} parameters from {len(data) + len(data.jumps)} measured numbers; give more data or "
            "leave parameters out"
        )
    span = _span(problem.model, data) if span is None else span
    search = _Search(problem, data, names, span, progress)
    ending, estimate = Termination(), None
    try:
        followed = search.run(own, low, high, starts, seed)
        assert search.best is not None
        estimate = _estimate(search.best, data, low, high)
        estimate.reach = profile_interval(
            search.best, search.at, estimate.x, estimate.covariance, estimate.unit, low, high
        )
        ending.reached(Status.REACHED_END, f"{followed} of {starts} starts were followed")
    except KeyboardInterrupt as error:
        if search.best is None:
            raise
        followed = search.followed
        ending.note(error, f"after {search.evaluations} curves")
    assert search.best is not None
    estimate = estimate or _estimate(search.best, data, low, high)
    return _result(problem, search, search.best, followed, estimate, low, high, ending)


def _bounds(
    problem: HarmonicBalance, free: Mapping[str, tuple[float, float] | None] | Sequence[str]
) -> tuple[tuple[str, ...], Array, Array, Array]:
    """Names, lower and upper bounds and the model's values of the parameters that are sought."""
    given = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    if not given:
        raise ValueError("fit: name at least one parameter, such as free=['zeta']")
    ends = np.array([bounds_of(problem, name, bounds, (1 / _WIDE, _WIDE), "fit") for name, bounds in given.items()]).T
    values = problem.model.parameters | problem.model.entries
    return tuple(given), ends[0], ends[1], np.clip([values[name] for name in given], ends[0], ends[1])


def _span(model: Model, data: Measurements) -> tuple[float, float]:
    """The span of Omega that holds all of the data; refuses frequencies in a unit that cannot be meant."""
    own = scales(model, {})
    if data.unit != "Omega" and data.unit not in own:
        raise ValueError(
            f"the data are in {data.unit}, and {type(model).__name__} does not know its units; give frequencies as "
            "Omega"
        )
    if data.length and model.scales is None:
        raise ValueError(
            f"the data are in {data.length}, and {type(model).__name__} does not know its unit of length; give "
            "amplitudes in that of the model"
        )
    every = np.concatenate([data.frequency, [jump[0] for jump in data.jumps]]) / own.get(data.unit, 1.0)
    usual = float(np.mean(model.default_span))
    off = float(np.median(every)) / usual
    if not 1 / _APART < off < _APART:
        raise ValueError(
            f"the frequencies are at Omega = {np.median(every):.3g}, and those of the model near {usual:.3g}: they are "
            f"hardly in {data.unit}; give unit='mesh Hz' or 'pinion r/min', or the right one"
        )
    return 1.2 * float(every.max()), float(every.min()) / 1.2


class _Search:
    """Least squares from several starts; the best prediction found is kept."""

    def __init__(
        self, problem: HarmonicBalance, data: Measurements, names: tuple[str, ...], span: tuple[float, float],
        progress: ProgressCallback | None,
    ) -> None:  # fmt: skip
        self.problem, self.data, self.names, self.span, self.progress = problem, data, names, span, progress
        self.evaluations = self.followed = 0
        self.best: Prediction | None = None
        self.refused = ""
        self._known: LRUCache[Prediction | None] = LRUCache(3)

    def at(self, x: Array) -> Prediction | None:
        """The prediction with these values; None where the model has no response."""
        return self._known.get(x.tobytes(), lambda: self._traced(x))

    def _traced(self, x: Array) -> Prediction | None:
        self.evaluations += 1
        try:
            values = dict(zip(self.names, map(float, x), strict=True))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ImplausibleInputWarning)  # of values on the way
                now = Prediction(self.problem, self.data, values, self.span)
        except (NotTraced, ValueError) as error:
            self.refused = str(error)
            return None
        if self.progress is not None:
            self.progress(Progress(math.nan, ", ".join(f"{name} = {x:.5g}" for name, x in values.items())))
        return now

    def judged(self, x: Array) -> Prediction | None:
        """The same, which is kept if it is the best so far."""
        now = self.at(x)
        if now is not None and (self.best is None or _cost(now) < _cost(self.best)):
            self.best = now
        return now

    def run(self, own: Array, low: Array, high: Array, starts: int, seed: int) -> int:
        """Follow starts until one ends within the noise; how many were.

        Raises
        ------
        ValueError
            If the model has no response at any start, or amplitudes are in a unit that cannot be meant.
        """
        freedom = max(1, len(self.data) + len(self.data.jumps) - len(own))
        for start in self._starts(own, low, high, starts, seed):
            if self.judged(start) is None:
                continue
            if not self.followed:
                self._check_unit()
            self.followed += 1
            self._follow(start, low, high)
            assert self.best is not None
            if _cost(self.best) / freedom < (_GOOD if self.data.assumed else 1.0 + 4.0 * math.sqrt(2.0 / freedom)):
                break
        if self.best is None:
            raise ValueError(f"the model has no response to hold against the data: {self.refused}")
        return self.followed

    def _starts(self, own: Array, low: Array, high: Array, starts: int, seed: int) -> Iterator[Array]:
        """The model's values, then the best of many random ones."""
        yield own
        if starts == 1:
            return
        from scipy.stats import qmc

        drawn = qmc.LatinHypercube(len(own), seed=seed).random(_LOOKED_AT * (starts - 1))
        every = [low + u * (high - low) for u in drawn]
        costs = [math.inf if (now := self.judged(x)) is None else _cost(now) for x in every]
        for i in np.argsort(costs, kind="stable")[: starts - 1]:
            yield every[i]

    def _follow(self, start: Array, low: Array, high: Array) -> None:
        """Least squares from a start, first with little weight of points far off.

        Deviations are those at the start, and then those at the first end.
        """
        from scipy.optimize import least_squares

        worst = np.full(2 * len(self.data) + len(self.data.jumps), 1e3)
        x = self._nearer(np.clip(start, low + 1e-6 * (high - low), high - 1e-6 * (high - low)), low, high)
        for final in (False, True):
            first = self.at(x)
            if first is None:
                return
            s = first.deviation

            def residuals(x: Array, s: Array = s) -> Array:
                now = self.judged(x)
                return worst if now is None else now.residuals(s)

            def jacobian(x: Array, s: Array = s) -> Array:
                now = self.at(x)
                if now is None:
                    return np.zeros((len(worst), len(x)))
                J = now.jacobian(s)
                felt: Array = J * (np.linalg.norm(J, axis=0) * np.abs(x) > _NOTHING)
                return felt  # rounding moves nothing

            found = least_squares(residuals, x, jacobian, (low, high), xtol=_ENOUGH[final], ftol=_SPENT[final],
                                  loss="linear" if final else "soft_l1", f_scale=3.0,
                                  x_scale=np.maximum(np.abs(x), 1e-3 * (high - low)), max_nfev=30)  # fmt: skip
            x = found.x

    def _nearer(self, start: Array, low: Array, high: Array) -> Array:
        """A start whose curve is near to the points, if that of the given one is not.

        Least squares of the distances in frequency and amplitude, which have no jumps; points far off count less.
        """
        from scipy.optimize import least_squares

        first = self.at(start)
        if first is None or _cost(first) / (len(self.data) + len(self.data.jumps)) < _NEAR:
            return start
        worst = np.full(len(self.data) + len(self.data.jumps), 100.0)

        def distances(x: Array) -> Array:
            now = self.at(x)
            return worst if now is None else now.distances

        def jacobian(x: Array) -> Array:
            now = self.at(x)
            return np.zeros((len(worst), len(x))) if now is None else now.distances_moved

        found = least_squares(distances, start, jacobian, (low, high), loss="soft_l1", xtol=2e-2, ftol=1e-1,
                              x_scale=np.maximum(np.abs(start), 1e-3 * (high - low)), max_nfev=20)  # fmt: skip
        x: Array = found.x
        return x

    def _check_unit(self) -> None:
        """Refuse amplitudes that are orders of magnitude off."""
        assert self.best is not None
        known = np.isfinite(self.best.amplitudes)
        if not known.any():
            return
        ratio = float(np.median(self.data.amplitude[known] / self.best.amplitudes[known]))
        if not 1 / _APART < ratio < _APART:
            unit = self.data.length or "the model's unit of length"
            raise ValueError(
                f"the measured amplitudes are {ratio:.2g} times those of the model: they are hardly in {unit}; give "
                "the right one by length='um', say, or the measure they are of"
            )


_ENOUGH = {False: 1e-3, True: 1e-5}
"""Relative change of the values at which a search ends, and the final one."""

_SPENT = {False: 1e-2, True: 3e-4}
"""The same of the sum of squares: the final one ends a tenth of a standard error or so from the least of 50 numbers."""


def _cost(now: Prediction) -> float:
    r = now.residuals(now.deviation)
    return float(r @ r)


@dataclass
class _Estimate:
    """Values and covariance to first order, mean square, what the sum rises by for one standard error, and `reach`."""

    x: Array
    covariance: Array
    mean_square: float
    unit: float
    reach: Array
    doubts: list[str]


def _estimate(best: Prediction, data: Measurements, low: Array, high: Array) -> _Estimate:
    names = best.names
    x = np.array([best.here[name] for name in names])
    freedom = len(data) + len(data.jumps) - len(names)
    mean_square = _cost(best) / freedom if freedom > 0 else math.nan
    size = np.where(x, np.abs(x), high - low)
    covariance, doubts = _covariance(best.information(best.deviation) * size, names)
    unit = mean_square if data.assumed and freedom > 0 else 1.0
    covariance = unit * covariance * np.outer(size, size)
    return _Estimate(x, covariance, mean_square, unit, np.full(len(names), math.nan), doubts)


def _result(
    problem: HarmonicBalance, search: _Search, best: Prediction, followed: int, estimate: _Estimate, low: Array,
    high: Array, ending: Termination,
) -> Fit:  # fmt: skip
    names, data, x, covariance = search.names, search.data, estimate.x, estimate.covariance
    first = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(first, first)
    errors = np.fmax(first, estimate.reach)
    doubts = [*estimate.doubts, *_alike(names, correlation), *_of_data(best, estimate.mean_square)]
    doubts += [*_loose(names, first, errors), *_at_bounds(names, x, low, high)]
    count, values = len(data), dict(zip(names, x.tolist(), strict=True))
    return Fit(
        problem.model.replace(**values), names, values, dict(zip(names, errors.tolist(), strict=True)), covariance,
        correlation, data, best.curve, best.amplitudes, best.residuals(best.deviation)[:count],
        tuple(place.kind for place in best.places), best.jump_frequencies, estimate.mean_square, followed,
        search.evaluations, tuple(doubts), ending.status, ending.told,
    )  # fmt: skip


def _loose(names: tuple[str, ...], first: Array, errors: Array) -> Iterator[str]:
    """Parameters that the data hardly bound to one side."""
    for name, linear, error in zip(names, first, errors, strict=True):
        if error > 0.99 * MOST * linear:
            yield f"{name} may be farther off than its error says: the sum of squares hardly rises to one side"


def _covariance(J: Array, names: tuple[str, ...]) -> tuple[Array, list[str]]:
    """(J^T J)^-1, nan of what the data do not determine, and which that is in words."""
    doubts = []
    size = np.linalg.norm(J, axis=0)
    nothing = size <= _NOTHING
    out = np.full((len(names), len(names)), math.nan)
    doubts += [f"{name} has no effect on the data" for name, none in zip(names, nothing, strict=True) if none]
    felt = np.flatnonzero(~nothing)
    if not felt.size:
        return out, doubts
    s, vt = np.linalg.svd(J[:, felt] / size[felt], full_matrices=False)[1:]
    flat = s <= 1e-7 * s[0]
    if flat.any():
        together = felt[np.abs(vt[flat]).max(axis=0) > 0.1]
        doubts.append(f"{', '.join(names[i] for i in together)} cannot be told apart by these data")
    inverse = (vt[~flat].T / s[~flat] ** 2) @ vt[~flat]
    lost = np.abs(vt[flat]).max(axis=0, initial=0.0) > 0.1
    inverse[lost, :] = inverse[:, lost] = math.nan
    out[np.ix_(felt, felt)] = inverse / np.outer(size[felt], size[felt])
    return out, doubts


def _alike(names: tuple[str, ...], correlation: Array) -> Iterator[str]:
    """Pairs that the data hardly tell apart."""
    for i, j in combinations(range(len(names)), 2):
        if abs(correlation[i, j]) > _ALIKE:
            yield f"{names[i]} and {names[j]} can hardly be told apart: their correlation is {correlation[i, j]:+.4f}"


def _of_data(best: Prediction, mean_square: float) -> Iterator[str]:
    """Data that the curve does not reach, and a fit that is worse than the noise."""
    kinds = [place.kind for place in best.places]
    for kind, text in _KINDS.items():
        if count := kinds.count(kind):
            yield f"{count} of {len(kinds)} points {text}"
    for (frequency, direction, _), found in zip(best.data.jumps, best.jump_frequencies.tolist(), strict=True):
        if math.isnan(found):
            way = "rises" if direction > 0 else "falls"
            yield f"the model has no jump like the one measured at {frequency:.6g} while the frequency {way}"
    if not best.data.assumed and mean_square > _GOOD:
        yield f"the residuals are {math.sqrt(mean_square):.2g} times the deviations of the data"


_KINDS = {
    "unreached": "are where no stable motion of the curve is",
    "end": "lie beyond the end of the part of the curve that the sweep is on",
    "other": "are on another motion than the model's sweep",
}


def _at_bounds(names: tuple[str, ...], x: Array, low: Array, high: Array) -> Iterator[str]:
    for name, value, a, b in zip(names, x, low, high, strict=True):
        if min(value - a, b - value) < 1e-4 * (b - a):
            yield f"{name} = {value:.6g} is at its bound"
