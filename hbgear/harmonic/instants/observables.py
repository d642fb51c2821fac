"""Observed quantities of exact motions: coefficients, regime, residual and the progress of a curve."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hbgear.common.process.progress import curve_progress
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Pattern
from hbgear.harmonic.instants.sampling import coefficients
from hbgear.harmonic.instants.shooting import Iterate, Linearisation, residual_scale


def observed_point(
    ode: EquationsAt, iterate: Iterate, linearised: Linearisation, H: int, values: list[float], change: float
) -> CurvePoint:
    """Return a point of a branch: coefficients up to H and the parameters ``values``, with regime and error.

    ``change`` is that of the last parameter along the tangent. The residual is relative to the states and coefficients,
    because the states at the switches alone may be zero: where a contact begins, gap and velocity are.
    """
    rows, rms = coefficients(ode, iterate, H)
    u, tangent = np.append(rows.ravel(), values), np.append(np.zeros(rows.size + len(values) - 1), 1.0)
    size = max(residual_scale(iterate), float(np.abs(rows).max(initial=0.0)))
    residual = float(np.abs(linearised.R).max(initial=0.0)) / size
    direction = int(np.sign(change)) if abs(change) > 1e-12 else 0
    observed = {"regime": regime_of(iterate.pattern, ode.equations.first), "error": rms}
    return CurvePoint(u, tangent, 1, residual, 0, parameter_direction=direction, observed=observed)


def regime_of(pattern: Pattern, first: Sequence[int]) -> Any:
    """Return the number of breakpoints (m,) that the gap of each element crosses, at most 2; see `Equations.first`."""
    crossed = {switch[:2] for switch in pattern.switches if not switch.is_fixed}
    return np.array([min(2, sum(element == j for element, _ in crossed)) for j in first], dtype=np.int8)


def reporter(progress: Any, name: str, span: tuple[float, float]) -> Callable[[float, int, float], None]:
    """Return a function that reports the progress of a curve: value of the parameter, number of points, step."""

    def report(value: float, points: int, step: float) -> None:
        if progress is not None:
            progress(curve_progress(name, value, span, points, step))

    return report
