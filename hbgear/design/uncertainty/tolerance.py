"""Scatter of jump frequencies for small deviations of parameters: to first order, and by Monte Carlo beside it.

    first order   s^2 = sum_a (dOmega/da s_a)^2
    Monte Carlo   Omega(a + s xi),  xi independent and normal: the equations of the jump solved for each draw

The difference of the two says how good the first order is. Draws for which the equations have no solution near are
those in which the jump has vanished, or nearly so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.parameter_sensitivity import RelocatedPoint, sensitivity
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, checked, counted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.solvers.newton import NoConvergence


@dataclass(frozen=True, eq=False, repr=False)
class JumpTolerance:
    """Scatter of the frequency of one jump.

    Parameters
    ----------
    label, direction, value : str
        Of the jump.
    effects : dict of str to float
        By parameter, the change of the frequency for one standard deviation, to first order.
    first : float
        Standard deviation to first order.
    draws : ndarray, shape (D,)
        Frequencies of the draws.
    lost : int
        Number of draws in which there is no such jump.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.6))
    >>> rising = hb.design.jump_tolerance(curve, {"zeta": 0.0005, "F": 0.001}, draws=20)[0]
    >>> rising.label, rising.lost, len(rising.draws)
    ('LP1', 0, 20)
    """

    label: str
    direction: int
    value: float
    effects: dict[str, float]
    first: float
    draws: Array
    lost: int

    def __repr__(self) -> str:
        drawn = f"{self.sampled:.3g} of {len(self.draws)} draws, {self.lost} lost"
        return f"<JumpScatter of {self.label} at {self.value:.6g}: +- {self.first:.3g} to first order, {drawn}>"

    @property
    def sampled(self) -> float:
        """Standard deviation of the draws; nan without any."""
        return float(np.std(self.draws, ddof=1)) if len(self.draws) > 1 else math.nan

    @property
    def error(self) -> float:
        """Relative error of the first order, as far as the draws tell it."""
        return self.first / self.sampled - 1.0 if self.sampled else math.nan


@checked_arguments(spread="standard deviations by name, such as {'zeta': 0.002}")
def jump_tolerance(
    branch: Branch, spread: Mapping[str, float], *, draws: int = 300, seed: int = 0,
    progress: ProgressCallback | None = None,
) -> tuple[JumpTolerance, ...]:  # fmt: skip
    """How jump frequencies scatter if parameters do, independently and normally.

    Parameters
    ----------
    branch : Branch
        A response curve that knows its problem.
    spread : mapping of str to float
        Standard deviations of parameters, entries of tuples as ``e[0]``.
    draws, seed : int, optional
        Of the Monte Carlo sample.
    progress : ProgressCallback or None, optional
        Called with a `Progress` as work goes on, such as ``print``.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If a deviation is negative, or the curve has no jumps or has lost its problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 5), "Omega", (1.2, 0.6))
    >>> for jump in hb.design.jump_tolerance(curve, {"zeta": 0.001}, draws=50):
    ...     print(jump.label, abs(jump.error) < 0.2)
    ...
    LP1 True
    LP2 True
    """
    counted("jump_tolerance: draws", draws, 1_000_000)
    counted("jump_tolerance: seed", seed, least=0)
    if not spread:
        raise ValueError("jump_tolerance: name at least one parameter that scatters, such as {'zeta': 0.002}")
    for name, deviation in spread.items():
        checked("jump_tolerance", name, deviation, NOT_NEGATIVE)
    if not branch.jumps():
        raise ValueError("the curve has no jumps that could scatter; trace it with stability, where it has folds")
    names, s = tuple(spread), np.array([float(x) for x in spread.values()])
    xi = np.random.default_rng(seed).normal(size=(draws, len(names)))
    found = []
    for number, jump in enumerate(branch.jumps()):
        slopes = sensitivity(jump.before, names).slopes[0]
        effects = dict(zip(names, (slopes * s).tolist(), strict=True))
        places: list[float] = []
        lost = 0
        again = RelocatedPoint(jump.before, names)
        for i, row in enumerate(xi):
            if progress is not None:
                done = (number + i / draws) / len(branch.jumps())
                progress(Progress(done, f"{jump.label}: {i} of {draws} draws"))
            try:
                with np.errstate(all="ignore"):  # of draws in which there is no such point
                    places.append(again.at(s * row))
            except (NoConvergence, ValueError, np.linalg.LinAlgError):
                lost += 1
        found.append(JumpTolerance(
            jump.label, jump.direction, jump.value, effects, float(np.linalg.norm(slopes * s)), np.array(places), lost,
        ))  # fmt: skip
    return tuple(found)
