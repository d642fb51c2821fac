"""Nonlinear least squares of a fit from several starts."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array
from hbgear.common.lru_cache import LRUCache
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.design.fitting.measurements import Measurements
from hbgear.design.fitting.sweep_motions import NotTraced
from hbgear.design.fitting.sweep_prediction import Prediction
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.plausibility import ImplausibleInputWarning

UNIT_ERROR_RATIO = 30.0
"""Ratio of measured to computed amplitudes or frequencies above which the unit is considered wrong."""


MIN_EFFECT = 1e-3
"""Norm of the change of all residuals, for a relative change of 1 of a parameter, below which it has no effect."""


ACCEPTED_MEAN_SQUARE = 4.0
"""Mean square of the residuals, in assumed deviations, below which no further start is tried."""


NOISE_SIGMAS = 4.0
"""Accepted excess of the mean square over 1, with given deviations, in its standard deviations (2 / freedom)^(1/2).

A larger excess is not noise but another minimum or an unsuitable model."""


POOR_MEAN_SQUARE = 25.0
"""Mean square of the residuals above which the curve is first moved toward the points by their distances."""


CANDIDATES_PER_START = 6
"""Number of random candidates that are evaluated for each further start."""


def mean_square_limit(freedom: int, assumed: bool) -> float:
    """Return the mean square of the residuals below which a fit is within the noise.

    ``freedom`` is the number of degrees of freedom; ``assumed`` states that the deviations are assumed values.
    """
    return ACCEPTED_MEAN_SQUARE if assumed else 1.0 + NOISE_SIGMAS * math.sqrt(2.0 / freedom)


class FreeParameters(NamedTuple):
    """Parameters to estimate: names, bounds and values of the model, arrays (p,)."""

    names: tuple[str, ...]
    low: Array
    high: Array
    nominal: Array

    def values_and_sizes(self, best: Prediction) -> tuple[Array, Array]:
        """Return the values (p,) in a prediction and their sizes; the size of a zero is the width of its bounds."""
        x = np.array([best.parameter_values[name] for name in self.names])
        return x, np.where(x, np.abs(x), self.high - self.low)


@dataclass(eq=False)
class FitSearch:
    """Nonlinear least squares from several starts; the best prediction is kept."""

    problem: HarmonicBalance
    data: Measurements
    free: FreeParameters
    span: tuple[float, float]
    progress: ProgressCallback | None = None
    evaluations: int = field(default=0, init=False)
    followed: int = field(default=0, init=False)
    best: Prediction | None = field(default=None, init=False)
    refused: str = field(default="", init=False)
    _predictions: LRUCache[Prediction | None] = field(default_factory=lambda: LRUCache(3), init=False)

    def at(self, x: Array) -> Prediction | None:
        """Return the prediction with these values, or None if the model has no response."""
        return self._predictions.get(x.tobytes(), lambda: self._traced(x))

    def _traced(self, x: Array) -> Prediction | None:
        """Return the prediction of the model at values of the parameters; None if it is refused."""
        self.evaluations += 1
        try:
            values = dict(zip(self.free.names, map(float, x), strict=True))
            # for values during the search
            with warnings.catch_warnings(action="ignore", category=ImplausibleInputWarning):
                prediction = Prediction(self.problem, self.data, values, self.span)
        except (NotTraced, ValueError) as error:
            self.refused = str(error)
            return None
        if self.progress is not None:
            self.progress(Progress(math.nan, ", ".join(f"{name} = {x:.5g}" for name, x in values.items())))
        return prediction

    def evaluate(self, x: Array) -> Prediction | None:
        """Return the prediction with these values, and store it if it is the best so far."""
        prediction = self.at(x)
        if prediction is not None and (self.best is None or cost_of(prediction) < cost_of(self.best)):
            self.best = prediction
        return prediction

    def run(self, starts: int, seed: int) -> None:
        """Minimize from several starts until a result is within the noise.

        ValueError is raised if the model has no response at any start or the unit of the amplitudes is probably wrong.
        """
        freedom = max(1, len(self.data) + len(self.data.jumps) - len(self.free.names))
        for start in self._starts(starts, seed):
            if self.evaluate(start) is None:
                continue
            if not self.followed:
                self._check_unit()
            self.followed += 1
            self._minimize(start)
            assert self.best is not None
            if cost_of(self.best) / freedom < mean_square_limit(freedom, self.data.assumed):
                break
        if self.best is None:
            raise ValueError(f"the model has no response to compare with the data: {self.refused}")

    def restore(self) -> None:
        """Replace parameters of the best prediction without an effect by the values of the model.

        A random start may have changed them.
        """
        best, nominal = self.best, self.free.nominal
        assert best is not None
        x, size = self.free.values_and_sizes(best)
        changed = is_without_effect(best.information(best.deviation) * size) & (x != nominal)
        prediction = self.at(np.where(changed, nominal, x)) if changed.any() else None
        if (
            prediction is not None
            and cost_of(prediction) <= (1.0 + COST_TOLERANCE[True]) * cost_of(best) + MIN_EFFECT**2
        ):
            self.best = prediction

    def _starts(self, starts: int, seed: int) -> Iterator[Array]:
        """Yield the values of the model, then the best ones of several random candidates."""
        low, high = self.free.low, self.free.high
        yield self.free.nominal
        if starts == 1:
            return
        from scipy.stats import qmc

        units = qmc.LatinHypercube(len(low), seed=seed).random(CANDIDATES_PER_START * (starts - 1))
        candidates = [low + u * (high - low) for u in units]
        costs = [math.inf if (prediction := self.evaluate(x)) is None else cost_of(prediction) for x in candidates]
        for i in np.argsort(costs, kind="stable")[: starts - 1]:
            yield candidates[i]

    def _minimize(self, start: Array) -> None:
        """Minimize the sum of squares from a start, first with a loss function that reduces the weight of outliers.

        The deviations are evaluated at the start and again at the end of the first minimization.
        """
        from scipy.optimize import least_squares

        worst = np.full(2 * len(self.data) + len(self.data.jumps), 1e3)
        low, high = self.free.low, self.free.high
        x = self._approach(np.clip(start, low + 1e-6 * (high - low), high - 1e-6 * (high - low)))
        for final in (False, True):
            first = self.at(x)
            if first is None:
                return
            s = first.deviation

            def residuals(x: Array, s: Array = s) -> Array:
                prediction = self.evaluate(x)
                return worst if prediction is None else prediction.residuals(s)

            def jacobian(x: Array, s: Array = s) -> Array:
                prediction = self.at(x)
                if prediction is None:
                    return np.zeros((len(worst), len(x)))
                J = prediction.jacobian(s)
                # without parameters whose effect is rounding
                return J * (np.linalg.norm(J, axis=0) * np.abs(x) > MIN_EFFECT)

            result = least_squares(
                residuals,
                x,
                jacobian,
                (low, high),
                xtol=VALUE_TOLERANCE[final],
                ftol=COST_TOLERANCE[final],
                loss="linear" if final else "soft_l1",
                f_scale=3.0,
                x_scale=np.maximum(np.abs(x), 1e-3 * (high - low)),
                max_nfev=30,
            )
            x = result.x

    def _approach(self, start: Array) -> Array:
        """Return a start whose curve is close to the points, found from the given one if necessary.

        The distances in frequency and amplitude are minimized, because they are continuous functions of the values.
        Distant points have a reduced weight.
        """
        from scipy.optimize import least_squares

        first = self.at(start)
        if first is None or cost_of(first) / (len(self.data) + len(self.data.jumps)) < POOR_MEAN_SQUARE:
            return start
        worst = np.full(len(self.data) + len(self.data.jumps), 100.0)
        low, high = self.free.low, self.free.high

        def distances(x: Array) -> Array:
            prediction = self.at(x)
            return worst if prediction is None else prediction.distances

        def jacobian(x: Array) -> Array:
            prediction = self.at(x)
            return np.zeros((len(worst), len(x))) if prediction is None else prediction.distance_jacobian

        result = least_squares(
            distances,
            start,
            jacobian,
            (low, high),
            loss="soft_l1",
            xtol=2e-2,
            ftol=1e-1,
            x_scale=np.maximum(np.abs(start), 1e-3 * (high - low)),
            max_nfev=20,
        )
        return result.x

    def _check_unit(self) -> None:
        """Raise an error if measured and computed amplitudes differ by orders of magnitude."""
        assert self.best is not None
        finite = np.isfinite(self.best.amplitudes)
        if not finite.any():
            return
        ratio = float(np.median(self.data.amplitude[finite] / self.best.amplitudes[finite]))
        if not 1 / UNIT_ERROR_RATIO < ratio < UNIT_ERROR_RATIO:
            unit = self.data.length or "the model's unit of length"
            raise ValueError(
                f"the measured amplitudes are {ratio:.2g} times those of the model: the unit is probably not {unit}; "
                "give the unit, such as length='um', or the measure of the amplitudes"
            )


VALUE_TOLERANCE = {False: 1e-3, True: 1e-5}
"""Relative change of the values at which the first (False) and the final (True) minimization stop."""


COST_TOLERANCE = {False: 1e-2, True: 3e-4}
"""Relative change of the sum of squares at which the first (False) and the final (True) minimization stop.

With 50 numbers the final one stops about a tenth of a standard error from the minimum.
"""


def is_without_effect(J: Array) -> NDArray[np.bool_]:
    """Return which parameters (p,) have no effect on the residuals, whose derivatives by relative changes are J."""
    return np.linalg.norm(J, axis=0) <= MIN_EFFECT


def cost_of(prediction: Prediction) -> float:
    """Return the sum of the squared residuals."""
    r = prediction.residuals(prediction.deviation)
    return float(r @ r)
