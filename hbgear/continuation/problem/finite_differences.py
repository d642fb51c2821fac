"""Derivatives in a parameter by differences.

    df/dp = (f(p + h) - f(p - h)) / 2h + O(h^2),   h = STEP * unit,   unit the size of p (`ContinuationProblem.unit_of`)

At the end of the parameter's range, where f exists on one side only, by the parabola through three points there:

    df/dp = (4 f(p + h) - f(p + 2h) - 3 f(p)) / 2h + O(h^2)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm

STEP = 1e-5
"""Relative step: rounding (1e-16 / STEP) and truncation (STEP^2) are both about 1e-11 of what is differentiated."""


class HasUnits(Protocol):
    """Knows the size of its parameters."""

    def unit_of(self, name: str, value: float) -> float:
        """Return the size relative to which a parameter change is small."""


def directional_step(X: Array, v: Array) -> float:
    """How far along v (n,) a central difference about X (n,) goes to either side."""
    return STEP * max(1e-3, norm(X)) / norm(v)


def parameter_derivatives(
    problem: HasUnits, name: str, here: Mapping[str, float], of: Callable[[dict[str, float]], tuple[Any, ...]]
) -> tuple[Any, ...]:
    """Derivatives of several quantities in a parameter.

    Parameters
    ----------
    problem : says how large a small step is.
    name, here : the parameter, and the values of all.
    of : the quantities at given values of all parameters, each a number, an array or a matrix; it refuses a value
        outside the range of the parameter with ValueError.

    Returns
    -------
    tuple
        The derivative of each.

    Raises
    ------
    ValueError
        If it refuses both sides.

    Examples
    --------
    >>> from hbgear.continuation.problem.base import ContinuationProblem
    >>> in_parameter(ContinuationProblem(), "p", {"p": 2.0}, lambda at: (round(at["p"] ** 2, 12),))
    (4.0,)
    """
    value = here[name]
    h = STEP * problem.unit_of(name, value)
    ends: list[tuple[float, tuple[Any, ...]]] = []
    refused: ValueError | None = None
    for there in (value + h, value - h):
        try:
            ends.append((there, of({**here, name: there})))
        except ValueError as error:
            if refused is not None:
                raise
            refused = error
    if len(ends) == 2:
        (a, above), (b, below) = ends
        return tuple((x - y) / (a - b) for x, y in zip(above, below, strict=True))
    ((near, first),) = ends
    far = value + 2 * (near - value)
    second, own = of({**here, name: far}), of({**here, name: value})
    return tuple((4 * y - z - 3 * x) / (far - value) for x, y, z in zip(own, first, second, strict=True))
