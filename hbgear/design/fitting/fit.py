"""Parameters of a model from measured response curves, by bounded nonlinear least squares.

    min_a  sum_i ((A(X(Omega_i, a)) - d_i) / s_i)^2 + sum_j ((Omega_j(a) - w_j) / s_j)^2,   low <= a <= high

The sums run over the periodic motions of the sweeps (`hbgear.design.fitting.sweep_prediction`) and over the jump
frequencies Omega_j. The Jacobian J follows from implicit differentiation. The covariance of the estimate is (J^T J)^-1,
multiplied by the mean square of the residuals if no deviations were given. Standard errors follow from the profile
likelihood (`hbgear.design.fitting.profile_likelihood`).

References
----------
Branch, Coleman & Li (1999), SIAM J. Sci. Comput. 21(1), https://doi.org/10.1137/S1064827595289108, for the bounds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hbgear.analysis.fold_curves import problem_of
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.deprecation import renamed_attributes
from hbgear.common.process.progress import ProgressCallback
from hbgear.common.ranges import counted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination
from hbgear.design.bounds import bounds_of
from hbgear.design.fitting.fit_search import (
    ACCEPTED_MEAN_SQUARE,
    UNIT_ERROR_RATIO,
    FitSearch,
    FreeParameters,
    cost_of,
    is_without_effect,
)
from hbgear.design.fitting.measurements import DEFAULT_DEVIATION, Measurements
from hbgear.design.fitting.profile_likelihood import MAX_END_RATIO, profile_interval
from hbgear.design.fitting.sweep_prediction import Prediction
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import scales
from hbgear.mechanics.models import Model

MAX_MISFIT = 0.2
"""Root mean square of the residuals relative to the amplitudes [-] above which a warning names the usual causes."""

DEFAULT_BOUND_FACTOR = 4.0
"""Default bounds are the value of the model divided and multiplied by this factor."""


HIGH_CORRELATION = 0.995
"""Correlation above which a warning states that two parameters cannot be distinguished."""


@renamed_attributes(doubts="warnings")
@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Estimated parameters and their uncertainty.

    Attributes
    ----------
    model : Model
        Model with the estimated values.
    names : tuple of str
        Names of the A estimated parameters.
    values, errors : dict of str to float
        Estimates and standard errors by name. An error is nan if the data do not determine the parameter. It is the
        larger one of the first-order error and the error of the profile likelihood. The latter is half the distance to
        the farther one of the two values at which the sum of squares, minimized over the other parameters, exceeds its
        minimum by 4.
    covariance, correlation : ndarray, shape (A, A)
        First-order covariance and correlation of the estimates.
    data : Measurements
        Measurements.
    curve : Branch
        Response of the model.
    predicted, residuals : ndarray, shape (N,)
        Amplitudes of the model and their differences from the measured ones, in deviations.
    held_against : tuple of str
        Kind of the motion with which each of the N points is compared: "swept", "other", "end" or "unreached".
    jumps : ndarray, shape (J,)
        Jump frequencies of the model; nan if the model does not have the jump.
    mean_square : float
        Sum of the squared residuals in deviations over the degrees of freedom.
    starts, evaluations : int
        Number of minimizations and number of traced curves.
    warnings : tuple of str
        Warnings about the data and the estimates.
    status, message : Status and str
        Reason for the end of the search.

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
    warnings: tuple[str, ...]
    status: Status
    message: str

    def __repr__(self) -> str:
        values_text = ", ".join(f"{name} = {self.values[name]:.6g} +- {self.errors[name]:.2g}" for name in self.names)
        return f"<Fit of {len(self.data)} points: {values_text}, {self.status}>"

    @property
    def reached(self) -> Array:
        """Boolean array, shape (N,): True where the curve has a stable motion at a measured point."""
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
    """Estimate the parameter values for which the response of a model is closest to a measured one.

    Parameters
    ----------
    model : Model or HarmonicBalance
        Model whose values are the first start. A `HarmonicBalance` supplies its settings.
    data : Measurements
        Measured amplitudes and jumps.
    free : mapping of str to tuple or None, or sequence of str
        Names of the parameters to estimate, also entries of tuples such as ``e[0]``, with their bounds. Default bounds
        are a quarter of the value of the model and four times this value, within the range of the parameter.
    harmonics : int, default 16
        Harmonic truncation order if a model is given.
    span : tuple[float, float] or None, optional
        Span of Omega over which curves are traced. Default: the span of the data extended by a fifth at both ends.
    starts : int, default 3
        Largest number of minimizations. Starts after the first one are drawn at random within the bounds; none is drawn
        if the first one ends within the noise.
    seed : int, default 0
        Seed of the random starts.
    progress : ProgressCallback or None, optional
        Function that is called with a `Progress`, such as ``print``.

    Returns
    -------
    Fit
        The estimate. Ctrl-C ends the search with the best values found; ``status`` and ``message`` report this.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If bounds are not valid, there are more parameters than data, the unit of the data is probably wrong, the data
        are transmission errors and the model has a prescribed displacement, or it has no response at any start.

    Notes
    -----
    A measured jump that the model does not have adds a constant to the sum of squares. A point beyond the end of the
    stable segment of its sweep attracts the jump at this end.

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
    problem = problem_of(model, harmonics)
    problem.require_fixed_resolution("fit")
    counted("fit: starts", starts, 1000)
    counted("fit: seed", seed, least=0)
    parameters = _free_parameters(problem, free)
    unknowns, numbers = len(parameters.names), len(data) + len(data.jumps)
    if unknowns > numbers:
        raise ValueError(
            f"fit: {unknowns} parameters from {numbers} measured numbers; give more data or leave parameters out"
        )
    data.check_displacement_of(problem.model)
    span = _span(problem.model, data) if span is None else span
    search = FitSearch(problem, data, parameters, span, progress)
    ending, estimate = Termination(advice="the best fit so far is kept; start again for the whole search"), None
    try:
        search.run(starts, seed)
        search.restore()
        assert search.best is not None
        estimate = _estimate(search.best, search)
        estimate.profile_errors = profile_interval(
            search.best, search.at, estimate.x, estimate.covariance, estimate.unit, parameters.low, parameters.high
        )
        ending.record_end(Status.REACHED_END, f"{search.followed} of {starts} starts were followed")
    except KeyboardInterrupt as error:
        if search.best is None:
            raise
        ending.record_error(error, f"after {search.evaluations} curves")
    assert search.best is not None
    return _result(search, search.best, estimate or _estimate(search.best, search), ending)


def _free_parameters(
    problem: HarmonicBalance, free: Mapping[str, tuple[float, float] | None] | Sequence[str]
) -> FreeParameters:
    """Return the parameters to estimate, with given or default bounds."""
    bounds_by_name = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    if not bounds_by_name:
        raise ValueError("fit: name at least one parameter, such as free=['zeta']")
    ends = np.array(
        [
            bounds_of(problem, name, bounds, (1 / DEFAULT_BOUND_FACTOR, DEFAULT_BOUND_FACTOR), "fit")
            for name, bounds in bounds_by_name.items()
        ]
    ).T
    values = problem.model.parameters | problem.model.entries
    nominal = np.clip([values[name] for name in bounds_by_name], ends[0], ends[1])
    return FreeParameters(tuple(bounds_by_name), ends[0], ends[1], nominal)


def _span(model: Model, data: Measurements) -> tuple[float, float]:
    """Return the span of Omega that contains all data.

    A `ValueError` is raised if the unit of the frequencies is probably wrong.
    """
    units = scales(model, {})
    if data.unit != "Omega" and data.unit not in units:
        raise ValueError(
            f"the data are in {data.unit}, and {type(model).__name__} does not know its units; give frequencies as "
            "Omega"
        )
    if data.length and model.scales is None:
        raise ValueError(
            f"the data are in {data.length}, and {type(model).__name__} does not know its unit of length; give "
            "amplitudes in the unit of the model"
        )
    measured = np.concatenate([data.frequency, [jump[0] for jump in data.jumps]]) / units.get(data.unit, 1.0)
    typical = float(np.mean(model.default_span))
    ratio = float(np.median(measured)) / typical
    if not 1 / UNIT_ERROR_RATIO < ratio < UNIT_ERROR_RATIO:
        raise ValueError(
            f"the measured frequencies are near Omega = {np.median(measured):.3g} and the frequencies of the model "
            f"near {typical:.3g}: the unit {data.unit} is probably wrong; give unit='mesh Hz', 'pinion r/min' or "
            "'Omega'"
        )
    return 1.2 * float(measured.max()), float(measured.min()) / 1.2


@dataclass
class _Estimate:
    """Values, first-order covariance, mean square and profile errors.

    ``unit`` is the increase of the sum of squares for one standard error.
    """

    x: Array
    covariance: Array
    mean_square: float
    unit: float
    profile_errors: Array
    warnings: list[str]


def _estimate(best: Prediction, search: FitSearch) -> _Estimate:
    names, data, (x, size) = best.names, search.data, search.free.values_and_sizes(best)
    freedom = len(data) + len(data.jumps) - len(names)
    mean_square = cost_of(best) / freedom if freedom > 0 else math.nan
    covariance, messages = _covariance(best.information(best.deviation) * size, names)
    unit = mean_square if data.assumed and freedom > 0 else 1.0
    covariance = unit * covariance * np.outer(size, size)
    return _Estimate(x, covariance, mean_square, unit, np.full(len(names), math.nan), messages)


def _result(search: FitSearch, best: Prediction, estimate: _Estimate, ending: Termination) -> Fit:
    """Return the fit with standard errors, correlations and warnings."""
    names, data, x, covariance = best.names, search.data, estimate.x, estimate.covariance
    first = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(first, first)
    errors = np.fmax(first, estimate.profile_errors)
    messages = [
        *estimate.warnings,
        *_correlation_warnings(names, correlation),
        *_data_warnings(best, estimate.mean_square),
    ]
    messages += [*_one_sided_warnings(names, first, errors), *_bound_warnings(x, search.free)]
    count, values = len(data), dict(zip(names, x.tolist(), strict=True))
    return Fit(
        search.problem.model.replace(**values),
        names,
        values,
        dict(zip(names, errors.tolist(), strict=True)),
        covariance,
        correlation,
        data,
        best.curve,
        best.amplitudes,
        best.residuals(best.deviation)[:count],
        tuple(reference.kind for reference in best.references),
        best.jump_frequencies,
        estimate.mean_square,
        search.followed,
        search.evaluations,
        tuple(messages),
        ending.status,
        ending.message_with_advice,
    )


def _one_sided_warnings(names: tuple[str, ...], first: Array, errors: Array) -> Iterator[str]:
    """Yield a warning for each parameter for which the sum of squares increases only slightly to one side."""
    for name, linear, error in zip(names, first, errors, strict=True):
        if error > 0.99 * MAX_END_RATIO * linear:
            yield f"{name} may have a larger error than stated: the sum of squares increases only slightly to one side"


def _covariance(J: Array, names: tuple[str, ...]) -> tuple[Array, list[str]]:
    """Return (J^T J)^-1, nan where the data determine nothing, and warnings."""
    messages = []
    size = np.linalg.norm(J, axis=0)
    without_effect = is_without_effect(J)
    covariance = np.full((len(names), len(names)), math.nan)
    messages += [f"{name} has no effect on the data" for name, idle in zip(names, without_effect, strict=True) if idle]
    effective = np.flatnonzero(~without_effect)
    if not effective.size:
        return covariance, messages
    s, vt = np.linalg.svd(J[:, effective] / size[effective], full_matrices=False)[1:]
    undetermined = s <= 1e-7 * s[0]
    if undetermined.any():
        combined = effective[np.abs(vt[undetermined]).max(axis=0) > 0.1]
        messages.append(f"{', '.join(names[i] for i in combined)} cannot be distinguished with these data")
    inverse = (vt[~undetermined].T / s[~undetermined] ** 2) @ vt[~undetermined]
    indeterminate = np.abs(vt[undetermined]).max(axis=0, initial=0.0) > 0.1
    inverse[indeterminate, :] = inverse[:, indeterminate] = math.nan
    covariance[np.ix_(effective, effective)] = inverse / np.outer(size[effective], size[effective])
    return covariance, messages


def _correlation_warnings(names: tuple[str, ...], correlation: Array) -> Iterator[str]:
    """Yield a warning for each pair of parameters with a high correlation."""
    for i, j in combinations(range(len(names)), 2):
        if abs(correlation[i, j]) > HIGH_CORRELATION:
            yield f"{names[i]} and {names[j]} can barely be distinguished: correlation {correlation[i, j]:+.4f}"


def _data_warnings(best: Prediction, mean_square: float) -> Iterator[str]:
    """Yield warnings about points that the curve does not reach and about residuals above the noise."""
    kinds = [reference.kind for reference in best.references]
    for kind, text in KIND_TEXTS.items():
        if count := kinds.count(kind):
            yield f"{count} of {len(kinds)} points {text}"
    for (frequency, direction, _), computed in zip(best.data.jumps, best.jump_frequencies.tolist(), strict=True):
        if math.isnan(computed):
            change = "rises" if direction > 0 else "falls"
            yield f"the model has no jump like the one measured at {frequency:.6g} while the frequency {change}"
    if not best.data.assumed and mean_square > ACCEPTED_MEAN_SQUARE:
        yield f"the residuals are {math.sqrt(mean_square):.2g} times the deviations of the data"
    misfit = DEFAULT_DEVIATION * math.sqrt(mean_square)
    if best.data.assumed and misfit > MAX_MISFIT:
        yield (
            f"the model differs from the measured amplitudes by {misfit:.0%} (root mean square): check the units, the "
            "measure of the amplitude, and the parameters that are not free"
        )


KIND_TEXTS = {
    "unreached": "are at frequencies without a stable motion of the curve",
    "end": "are beyond the end of the stable segment of their sweep",
    "other": "are on another motion than the sweep of the model",
}


def _bound_warnings(x: Array, free: FreeParameters) -> Iterator[str]:
    for name, value, low, high in zip(free.names, x, free.low, free.high, strict=True):
        if min(value - low, high - value) < 1e-4 * (high - low):
            yield f"{name} = {value:.6g} is at its bound"
