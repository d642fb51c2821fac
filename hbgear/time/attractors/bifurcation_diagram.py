"""Bifurcation diagrams: stroboscopic points of settled motions over a parameter, swept up and down, with verdicts.

    (d, d') at tau = 0 after each excitation period,   lambda = lim (1 / t) log(|delta(t)| / |delta(0)|)

The sweeps are those of `hbgear.time.sweep`. Growth of disturbances and weighted averages of all motions that do not
settle are computed together afterwards; the tests are in `verdicts`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import ProgressCallback
from hbgear.common.ranges import checked, counted
from hbgear.mechanics.models import Model
from hbgear.time.attractors.verdicts import Verdict, equal_digits, verdict_of
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.frequency_sweep import Sweep, sweep
from hbgear.time.steady_state import SteadyStateSettings, growth_rates

_MAX_VALUES = 100_000
"""Largest number of values of the parameter [-]."""

_PERIODS_OF_GROWTH = 400
"""Number of excitation periods over which the growth of a disturbance of a motion that did not settle is averaged."""

_PERIODS_OF_DECAY = 64
"""Number of excitation periods over which the decay of a disturbance of a periodic motion is averaged."""


@dataclass(frozen=True)
class Window:
    """Neighbouring values of a sweep with motions of one kind.

    Attributes
    ----------
    low, high : float
        Smallest and largest value of the parameter.
    verdict : Verdict
        Kind of the motions.
    period : int
        Period in excitation periods; 0 if the motions are not periodic.
    count : int
        Number of values.

    Examples
    --------
    >>> import hbgear as hb
    >>> diagram = hb.time.bifurcation_diagram(hb.Duffing(zeta=0.3), "Omega", (0.5, 0.6), "up", values=2)
    >>> (window,) = diagram.windows()
    >>> window.low, window.high, window.period
    (0.5, 0.6, 1)
    """

    low: float
    high: float
    verdict: Verdict
    period: int
    count: int


@dataclass(frozen=True, eq=False)
class BifurcationDiagram:
    """Stroboscopic points over a parameter, with the kind of each motion.

    Attributes
    ----------
    sweeps : tuple of Sweep
        Sweeps, the one with increasing values first; ``points`` of each has the stroboscopic points, ``period`` the
        periods.
    lyapunov : tuple of ndarray, shape (P,)
        Largest Lyapunov exponent of each motion per unit of time, for each sweep.
    digits : tuple of ndarray, shape (P,)
        Equal digits of two weighted averages of each motion that did not settle; inf of periodic motions.
    verdicts : tuple of ndarray, shape (P,)
        `Verdict` of each motion.

    Examples
    --------
    >>> import hbgear as hb
    >>> diagram = hb.time.bifurcation_diagram(hb.Duffing(zeta=0.3), "Omega", (0.5, 0.6), "up", values=3)
    >>> [(window.verdict.value, window.period, window.count) for window in diagram.windows()]
    [('periodic', 1, 3)]
    """

    sweeps: tuple[Sweep, ...]
    lyapunov: tuple[Array, ...]
    digits: tuple[Array, ...]
    verdicts: tuple[np.ndarray, ...]

    @property
    def parameter(self) -> str:
        """Name of the swept parameter."""
        return self.sweeps[0].parameter

    def windows(self, number: int = 0) -> tuple[Window, ...]:
        """Return the windows of a sweep: neighbouring values with motions of the same kind and period.

        Parameters
        ----------
        number : int, optional
            Number of the sweep in ``sweeps``. Default: 0.

        Returns
        -------
        tuple of Window
            Windows in the order of the sweep.
        """
        result, kinds = self.sweeps[number], self.verdicts[number]
        out = []
        for (verdict, period), rows in groupby(range(len(result)), lambda i: (kinds[i], int(result.period[i]))):
            values = result.values[list(rows)]
            out.append(Window(float(values.min()), float(values.max()), verdict, period, len(values)))
        return tuple(out)


@checked_arguments()
def bifurcation_diagram(
    model: Model,
    parameter: str,
    span: tuple[float, float],
    direction: str = "both",
    *,
    values: int = 200,
    at: Mapping[str, float] | None = None,
    start: Array | None = None,
    settling: SteadyStateSettings = SteadyStateSettings(),
    progress: ProgressCallback | None = None,
) -> BifurcationDiagram:
    """Compute stroboscopic points over a parameter, swept up and down, with the period and the kind of each motion.

    A motion is periodic if its state repeats to the tolerance of ``settling``. Of the others, a motion is
    quasi-periodic if its weighted averages over two successive sections of 1000 periods agree to 4 digits, and chaotic
    if they do not and a neighbouring motion moves away by more than 2 % per period.

    Parameters
    ----------
    model : Model
        Model with any number of coordinates for which its modes can be computed.
    parameter : str
        "Omega" or the name of a parameter of the model.
    span : tuple of float
        Smallest and largest value, in any order.
    direction : {"both", "up", "down"}, optional
        Direction of the sweeps. Default: "both". The second sweep starts from the last motion of the first one.
    values : int, optional
        Number of equidistant values. Default: 200.
    at : dict, optional
        Values of fixed parameters, such as ``{"Omega": 0.9}`` if another parameter is swept.
    start : array_like, shape (2n,), optional
        State (q, q') at tau = 0 before the first value. Default: at rest at q = 0.
    settling : SteadyStateSettings, optional
        Conditions under which a motion is periodic.
    progress : callable, optional
        Called with a `Progress`, such as ``print``.

    Returns
    -------
    BifurcationDiagram
        Sweeps and verdicts. After Ctrl-C it has the motions so far, and the status of the last sweep is
        ``interrupted``.

    Raises
    ------
    ValueError, KeyError
        If the direction or a parameter is unknown, the span is empty or not finite, or as of `hbgear.time.sweep`.

    Examples
    --------
    >>> import hbgear as hb
    >>> diagram = hb.time.bifurcation_diagram(hb.Duffing(zeta=0.3), "Omega", (0.5, 0.6), values=2)
    >>> len(diagram.sweeps), bool(diagram.lyapunov[0][0] < 0)
    (2, True)
    """
    if direction not in ("both", "up", "down"):
        raise ValueError(f"direction = {direction!r} must be 'both', 'up' or 'down'")
    for end in span:
        checked("bifurcation_diagram", "an end of the span", end)
    low, high = sorted(map(float, span))
    if low == high:
        raise ValueError(f"span = ({low:g}, {high:g}) is empty; give two different values")
    grid = np.linspace(low, high, counted("values", values, _MAX_VALUES, least=2))
    sweeps: list[Sweep] = []
    for sense in ("up", "down") if direction == "both" else (direction,):
        state = sweeps[-1].states[-1] if sweeps else start
        sweeps.append(
            sweep(model, grid, sense, parameter=parameter, at=at, start=state, settling=settling, progress=progress)
        )
        if not sweeps[-1].status.complete:
            break
    numbers = [_tests(model, result, dict(at or {})) for result in sweeps]
    return BifurcationDiagram(tuple(sweeps), *(tuple(column) for column in zip(*numbers, strict=True)))


def _tests(model: Model, result: Sweep, fixed: dict[str, float]) -> tuple[Array, Array, np.ndarray]:
    """Return Lyapunov exponents, equal digits and verdicts of the motions of a sweep."""
    growth, change = np.full((2, len(result)), np.nan)
    digits = np.where(result.settled, np.inf, np.nan)
    for is_settled, periods in ((True, _PERIODS_OF_DECAY), (False, _PERIODS_OF_GROWTH)):
        rows = np.flatnonzero(result.settled == is_settled)
        if not rows.size:
            continue
        integrator = _integrator(model, result, rows, fixed)
        motions = integrator.start(result.states[rows])
        growth[rows] = growth_rates(integrator, motions, periods)
        if not is_settled:
            digits[rows], change[rows] = equal_digits(integrator, motions, result.likely_period[rows])
    numbers = zip(result.period, growth, digits, change, strict=True)
    kinds = np.array([verdict_of(int(p), *map(float, rest)) for p, *rest in numbers], dtype=object)
    Omega = result.values if result.parameter == "Omega" else fixed["Omega"]
    return growth * Omega / (2 * np.pi), digits, kinds


def _integrator(model: Model, result: Sweep, rows: np.ndarray, parameters: dict[str, float]) -> ExponentialIntegrator:
    """Return the integrator of the motions at some values of a sweep."""
    fixed: dict[str, Any] = {name: value for name, value in parameters.items() if name != "Omega"}
    if result.parameter == "Omega":
        return ExponentialIntegrator(model.replace(**fixed) if fixed else model, result.values[rows])
    models = [model.replace(**fixed, **{result.parameter: float(value)}) for value in result.values[rows]]
    return ExponentialIntegrator(models, np.full(len(rows), parameters["Omega"]))
