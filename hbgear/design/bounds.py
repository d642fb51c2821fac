"""Bounds within which a value of a parameter is sought: given ones, or multiples of the model's own value."""

from __future__ import annotations

from collections.abc import Sequence

from hbgear.common.text.messages import quoted
from hbgear.harmonic.harmonic_balance import HarmonicBalance


def bounds_of(
    problem: HarmonicBalance, name: str, given: Sequence[float] | None, factors: tuple[float, float], what: str
) -> tuple[float, float]:
    """Lower and upper bound of a parameter.

    Parameters
    ----------
    given : sequence of float or None
        The bounds; None for the model's own value times both factors, within the range of the parameter.
    what : str
        Asks for them, for errors.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If they do not rise or are beyond the range, or none are given and the model's value is zero.
    """
    problem.check_parameter(name)
    if name == "Omega":
        raise ValueError(f"{what}: Omega is the frequency; parameters that can be sought are those of the model")
    own, allowed = (problem.model.parameters | problem.model.entries)[name], problem.range_of(name)
    if given is None:
        if not own:
            raise ValueError(f"{what}: {name} is 0 in the model, so give its bounds: {{'{name}': (low, high)}}")
        given = sorted(allowed.clipped(own * factor, own) for factor in factors)
    low, high = (float(end) for end in given)
    if not low < high or low not in allowed or high not in allowed:
        raise ValueError(f"{what}: bounds of {name} = {quoted(tuple(given))} must rise, and {allowed}")
    return low, high
