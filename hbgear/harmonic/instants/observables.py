"""Observed quantities of exact motions: coefficients, regime, residual and the progress of a curve."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Pattern
from hbgear.harmonic.instants.sampling import coefficients
from hbgear.harmonic.instants.shooting import Iterate, Linearisation, residual_scale


def observed_motion(ode: EquationsAt, iterate: Iterate, H: int, values: list[float]) -> tuple[Array, dict[str, Any]]:
    """Return the coefficients up to H and the parameters ``values`` in one array, and regime and error of a motion."""
    rows, rms = coefficients(ode, iterate, H)
    return np.append(rows.ravel(), values), {"regime": regime_of(iterate.pattern, ode.equations.m), "error": rms}


def relative_residual(linearised: Linearisation, iterate: Iterate, rows: Array) -> float:
    """Return the largest residual over the size of the states and of the coefficients of the motion.

    The states at the switches alone may be zero: where a contact begins, gap and velocity are.
    """
    size = max(residual_scale(iterate), float(np.abs(rows).max(initial=0.0)))
    return float(np.abs(linearised.R).max(initial=0.0)) / size


def regime_of(pattern: Pattern, m: int) -> Any:
    """Return the number of breakpoints (m,) that the gap of each element crosses, at most 2."""
    crossed = {switch[:2] for switch in pattern.switches if not switch.is_fixed}
    return np.array([min(2, sum(element == j for element, _ in crossed)) for j in range(m)], dtype=np.int8)


def reporter(progress: Any, name: str, span: tuple[float, float]) -> Callable[[float, int, float], None]:
    """Return a function that reports the progress of a curve: value of the parameter, number of points, step."""

    def report(value: float, points: int, step: float) -> None:
        if progress is not None:
            done = min(max((value - span[0]) / (span[1] - span[0]), 0.0), 1.0)
            text = f"{name} = {value:.5f}, {points} points, step {step:.1e}"
            progress(Progress(done, text, {"value": value, "points": points, "step": step}))

    return report
