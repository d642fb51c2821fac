"""Bounds of a parameter in a search, given ones or multiples of the value of the model, and checked scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hbgear.common.ranges import NOT_NEGATIVE, checked
from hbgear.common.text.messages import quoted
from hbgear.harmonic.harmonic_balance import HarmonicBalance


def bounds_of(
    problem: HarmonicBalance, name: str, bounds: Sequence[float] | None, factors: tuple[float, float], caller: str
) -> tuple[float, float]:
    """Return the lower and the upper bound of a parameter in a search; ``caller`` is the function named in messages.

    Without given bounds they are the value of the model times both factors, within the range of the parameter. KeyError
    is raised if the model has no such parameter, ValueError if the bounds do not ascend or exceed the range, or if none
    are given and the value of the model is zero.
    """
    problem.check_parameter(name)
    if name == "Omega":
        raise ValueError(f"{caller}: Omega is the frequency; give parameters of the model")
    nominal, allowed = (problem.model.parameters | problem.model.entries)[name], problem.range_of(name)
    if bounds is None:
        if not nominal:
            raise ValueError(
                f"{caller}: {name} is 0 in the model, so give its bounds: {{'{name}': (low, high)}}, in a command "
                f"--free {name}=LOW:HIGH"
            )
        bounds = sorted(allowed.clipped(nominal * factor, nominal) for factor in factors)
    low, high = (float(end) for end in bounds)
    if not low < high or low not in allowed or high not in allowed:
        raise ValueError(f"{caller}: bounds of {name} = {quoted(tuple(bounds))} must ascend, and {allowed}")
    return low, high


def check_scatter(caller: str, scatter: Mapping[str, float]) -> None:
    """Raise ValueError, which names the caller, without standard deviations or if one of them is negative."""
    if not scatter:
        raise ValueError(f"{caller}: name at least one parameter that scatters, such as {{'zeta': 0.002}}")
    for name, deviation in scatter.items():
        checked(caller, name, deviation, NOT_NEGATIVE)
