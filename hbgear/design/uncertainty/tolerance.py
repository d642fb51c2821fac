"""Scatter of jump frequencies for small deviations of parameters: to first order and by Monte Carlo sampling.

    first order   s^2 = sum_a (dOmega/da s_a)^2
    Monte Carlo   Omega(a + s xi),  xi independent and normal: the equations of the jump are solved for each draw

The difference of the two results measures the error of the first order. If the equations have no solution near the
jump, or if the motion is unstable on both sides of it, the curve of the draw is traced: the jump may occur at a point
of another kind, such as a fold instead of a Neimark-Sacker point. Without such draws the sample would be one-sided. The
draw is lost if the curve has no jump there either.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.parameter_sensitivity.relocated_point import RelocatedPoint, is_near
from hbgear.analysis.parameter_sensitivity.sensitivity import sensitivity
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import counted
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import SEARCH_ERRORS
from hbgear.continuation.tracing.trace import trace
from hbgear.design.bounds import check_scatter
from hbgear.harmonic.models.frequency_units import MESH, PINION, speeds_at
from hbgear.mechanics.plausibility import ImplausibleInputWarning


@dataclass(frozen=True, eq=False, repr=False)
class JumpTolerance:
    """Scatter of the frequency of one jump.

    Attributes
    ----------
    label : str
        Label of the jump.
    direction : int
        Direction of the sweep: +1 for rising Omega, -1 for falling Omega.
    value : float
        Frequency of the jump.
    effects : dict of str to float
        First-order change of the frequency for one standard deviation of each parameter.
    first : float
        First-order standard deviation of the frequency.
    draws : ndarray, shape (D,)
        Frequencies of the jump in the draws.
    lost : int
        Number of draws in which the jump has vanished.
    unit : str
        Unit of the frequencies: "pinion r/min", "mesh Hz", or "Omega".

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
    unit: str = "Omega"

    def __repr__(self) -> str:
        sample_text = f"{self.sampled:.3g} of {len(self.draws)} draws, {self.lost} lost"
        location = f"{self.label} at {self.unit} = {self.value:.6g}"
        return f"<JumpTolerance of {location}: +- {self.first:.3g} to first order, {sample_text}>"

    @property
    def sampled(self) -> float:
        """Standard deviation of the draws; nan if there are fewer than two."""
        return float(np.std(self.draws, ddof=1)) if len(self.draws) > 1 else math.nan

    @property
    def error(self) -> float:
        """Relative error of the first-order standard deviation, estimated from the draws."""
        return self.first / self.sampled - 1.0 if self.sampled else math.nan


@checked_arguments(spread="standard deviations by name, such as {'zeta': 0.002}")
def jump_tolerance(
    branch: Branch,
    spread: Mapping[str, float],
    *,
    draws: int = 300,
    seed: int = 0,
    unit: str | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[JumpTolerance, ...]:
    """Compute the scatter of jump frequencies for independent, normally distributed parameters.

    Parameters
    ----------
    branch : Branch
        Response curve with its problem.
    spread : mapping of str to float
        Standard deviations of parameters, also entries of tuples such as ``e[0]``.
    draws : int, default 300
        Number of draws of the Monte Carlo sample.
    seed : int, default 0
        Seed of the Monte Carlo sample.
    unit : {"Omega", "mesh Hz", "pinion r/min"}, optional
        Unit of the frequencies; default "pinion r/min" if the model has scales, else the parameter of the branch. If a
        parameter changes the unit, this effect is included.
    progress : ProgressCallback or None, optional
        Function that is called with a `Progress`, such as ``print``.

    Returns
    -------
    tuple of JumpTolerance
        Scatter of each jump of the curve.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If a deviation is negative, the curve has no jumps or no problem, or the model does not know the unit.

    Warns
    -----
    UserWarning
        If draws are left out, because a parameter is outside its range.

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
    check_scatter("jump_tolerance", spread)
    if not branch.jumps():
        raise ValueError("the curve has no jumps; trace it with stability over a span with folds")
    names, s = tuple(spread), np.array([float(x) for x in spread.values()])
    xi = np.random.default_rng(seed).normal(size=(draws, len(names)))
    tolerances = []
    for number, jump in enumerate(branch.jumps()):

        def report(i: int, jump: Jump = jump, number: int = number) -> None:
            if progress is not None:
                fraction = (number + i / draws) / len(branch.jumps())
                progress(Progress(fraction, f"{jump.label}: {i} of {draws} draws"))

        tolerances.append(_tolerance_of(branch, jump, names, s, xi, unit, report))
    return tuple(tolerances)


def _tolerance_of(
    branch: Branch,
    jump: Jump,
    names: tuple[str, ...],
    s: Array,
    xi: Array,
    unit: str | None,
    report: Callable[[int], None],
) -> JumpTolerance:
    """Return the scatter of one jump for standard deviations s (A,) and standard normal draws xi (D, A)."""
    derivatives = sensitivity(jump.before, names)
    physical = branch.parameter == "Omega" and PINION in derivatives.quantities
    chosen = unit or (PINION if physical else branch.parameter)
    if chosen not in (branch.parameter, *([MESH, PINION] if physical else [])):
        raise ValueError(f"jump_tolerance: unit = {quoted(chosen)} is unknown for this curve; leave it out")
    slopes = derivatives.slopes[derivatives.quantities.index(chosen)]
    slope = derivatives.slopes[derivatives.quantities.index(branch.parameter)]
    solver = RelocatedPoint(jump.before, names)
    refused = [solver.refused(s * row) for row in xi]
    if any(refused):
        reasons = ", ".join(sorted({*refused} - {""}))
        text = f"{sum(map(bool, refused))} of {len(xi)} draws are left out, because {reasons}"
        warnings.warn(f"{text}; the others are a one-sided sample", stacklevel=4)
    frequencies: list[float] = []
    lost = 0
    for i in (i for i, reason in enumerate(refused) if not reason):
        report(i)
        with np.errstate(all="ignore"):  # in draws without such a point
            p, parameters = _jump_of(branch, jump, solver, dict(zip(names, s * xi[i], strict=True)), slope)
        if p is None:
            lost += 1
            continue
        speeds = {} if chosen == branch.parameter else speeds_at(branch.problem.model, {**parameters, "Omega": p})
        frequencies.append(speeds.get(chosen, p))
    return JumpTolerance(
        jump.label,
        jump.direction,
        derivatives.size(chosen),
        dict(zip(names, (slopes * s).tolist(), strict=True)),
        float(np.linalg.norm(slopes * s)),
        np.array(frequencies),
        lost,
        chosen,
    )


def _jump_of(
    branch: Branch, jump: Jump, solver: RelocatedPoint, changes: Mapping[str, float], slopes: Array
) -> tuple[float | None, dict[str, float]]:
    """Return the value of the parameter at a jump for changes of other parameters, None without it, and these."""
    values = np.array(list(changes.values()))
    parameters = solver.changed(values)
    with suppress(*SEARCH_ERRORS):
        U, parameters = solver.solved(values)
        if solver.bounds_stable_motions(U, parameters):
            return float(U[-1]), parameters
    change = float(slopes @ values)
    # values of a draw
    with suppress(*SEARCH_ERRORS), warnings.catch_warnings(action="ignore", category=ImplausibleInputWarning):
        span, at = (branch.values[0], branch.values[-1]), {name: parameters[name] for name in changes}
        curve = raise_if_interrupted(trace(branch.problem, branch.parameter, span, at=at, accuracy=None))
        others = [other.value for one in curve.curves for other in one.jumps() if other.direction == jump.direction]
        nearest = min(others, key=lambda value: abs(value - jump.value - change), default=math.inf)
        if is_near(nearest, jump.value, change):
            return nearest, parameters
    return None, parameters
