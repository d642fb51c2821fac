"""Step control: limits of the step size and of the predictor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hbgear.common.argument_checks import NamedFields
from hbgear.common.deprecation import renamed_fields
from hbgear.common.ranges import checked, counted

DEFAULT_FIRST_STEP = 0.01
"""First step size of `StepControl`, a quarter of the default `StepControl.max_step`, in scaled arclength."""


@renamed_fields(
    first="first_step",
    longest="max_step",
    shortest="min_step",
    newton="target_newton_iterations",
    history="predictor_points",
)
@dataclass(frozen=True)
class StepControl(NamedFields):
    """Limits of the step size and of the predictor.

    Step sizes are lengths of arc in scaled unknowns, in which the span of the parameter has the length 1.

    Attributes
    ----------
    first_step : float, optional
        First step size. The default is 0.01, or the nearest value between `min_step` and `max_step`.
    max_step : float, optional
        Largest step size. The default is 0.04.
    min_step : float, optional
        Smallest step size. The trace stops if the corrector fails with it. The default is 1e-7.
    max_turn_deg : float, optional
        Largest angle between successive tangents [deg], above 0 and at most 60. Steps aim at half of it. The default
        is 20.
    target_newton_iterations : int, optional
        The step size is adapted so that the corrector converges in about this number of iterations. The default is 3.
    max_prediction_error : float, optional
        Largest distance between a point and its prediction, relative to the step size, above 0 and at most 1. A small
        loop, which the previous points do not show, is resolved with smaller steps in this way. Problems that sample
        nonsmooth laws do not use it. The default is 0.02.
    predictor_points : int, optional
        Largest number of previous points that the Hermite predictor extrapolates from. 1 gives the tangent predictor.
        The default is 4.
    max_points : int, optional
        Number of points after which the trace stops. The default is 5000.

    Raises
    ------
    ValueError
        If the step sizes are not positive and in order, or a limit is out of its range.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> fine = hb.trace(problem, "Omega", (0.8, 0.9), steps=hb.StepControl(max_step=0.01))
    >>> default = hb.trace(problem, "Omega", (0.8, 0.9))
    >>> len(fine) > len(default)
    True
    """

    first_step: float = None  # type: ignore[assignment]  # a number after __post_init__
    max_step: float = 0.04
    min_step: float = 1e-7
    max_turn_deg: float = 20.0
    target_newton_iterations: int = 3
    max_prediction_error: float = 0.02
    predictor_points: int = 4
    max_points: int = 5000

    def __post_init__(self) -> None:
        for name in ("max_step", "min_step"):
            checked("StepControl", name, getattr(self, name))
        if self.first_step is None:
            object.__setattr__(self, "first_step", min(max(DEFAULT_FIRST_STEP, self.min_step), self.max_step))
        for name in ("first_step", "max_step", "min_step", "max_turn_deg", "max_prediction_error"):
            checked("StepControl", name, getattr(self, name))
        for name, minimum in (("target_newton_iterations", 1), ("predictor_points", 1), ("max_points", 2)):
            counted(f"StepControl: {name}", getattr(self, name), least=minimum)
        if not 0 < self.min_step <= self.first_step <= self.max_step < math.inf:
            raise ValueError(
                f"step sizes must satisfy 0 < min_step <= first_step <= max_step, got min_step = {self.min_step}, "
                f"first_step = {self.first_step}, max_step = {self.max_step}"
            )
        if not 0 < self.max_turn_deg <= 60:
            raise ValueError(f"max_turn_deg = {self.max_turn_deg} degrees must be above 0 and at most 60")
        if not 0 < self.max_prediction_error <= 1:
            raise ValueError(f"max_prediction_error = {self.max_prediction_error} must be above 0 and at most 1")
