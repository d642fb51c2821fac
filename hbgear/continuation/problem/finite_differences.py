"""Derivatives in a parameter by finite differences.

    df/dp = (f(p + h) - f(p - h)) / 2h + O(h^2),   h = STEP * unit,   unit the size of p (`ContinuationProblem.unit_of`)

At an end of the range of the parameter f exists on one side only. There the derivative of the parabola through
three points is used:

    df/dp = (4 f(p + h) - f(p + 2h) - 3 f(p)) / 2h + O(h^2)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm

STEP = 1e-5
"""Relative step. Rounding error (1e-16 / STEP) and truncation error (STEP^2) are both about 1e-11 of the derivative."""


class HasUnits(Protocol):
    """Problem that knows the size of its parameters."""

    def unit_of(self, name: str, value: float) -> float:
        """Return the size relative to which a parameter change is small."""


LEAST_SIZE = 1e-3
"""Size of unknowns below which differences do not become smaller, relative to their unit: they may be zero."""


def directional_step(X: Array, v: Array, relative: float = STEP, least: float = LEAST_SIZE) -> float:
    """Return the step h of a central difference (f(X + h v) - f(X - h v)) / 2h at unknowns X along v, (n,) each.

    The change h v has the size ``relative`` relative to X, or to a size ``least`` of smaller unknowns.
    """
    return relative * max(least, norm(X)) / norm(v)


def parameter_derivatives(
    problem: HasUnits,
    name: str,
    parameters: Mapping[str, float],
    f: Callable[[dict[str, float]], tuple[Any, ...]],
    step: float = STEP,
) -> tuple[Any, ...]:
    """Return the derivatives of several quantities in a parameter.

    ``f`` returns a tuple of quantities at a dict of all parameters, each a number, an array or a matrix. It raises
    ValueError outside the range of the parameter, and so does this function if that happens on both sides. ``step`` is
    relative to the size of the parameter. ValueError is raised if it is below rounding.

    Examples
    --------
    >>> from hbgear.continuation.problem.base import ContinuationProblem
    >>> (slope,) = parameter_derivatives(ContinuationProblem(), "p", {"p": 2.0}, lambda at: (at["p"] ** 2,))
    >>> round(slope, 6)
    4.0
    """
    value = parameters[name]
    h = step * problem.unit_of(name, value)
    ends: list[tuple[float, tuple[Any, ...]]] = []
    refused: ValueError | None = None
    for p in (value + h, value - h):
        try:
            ends.append((p, f({**parameters, name: p})))
        except ValueError as error:
            if refused is not None:
                raise
            refused = error
    if value + h == value - h:
        raise ValueError(f"the step {h:.1e} of the derivative in {name} is below the rounding of {name} = {value:g}")
    if len(ends) == 2:
        (a, above), (b, below) = ends
        return tuple((x - y) / (a - b) for x, y in zip(above, below, strict=True))
    ((inner, first),) = ends
    outer = value + 2 * (inner - value)
    second, centre = f({**parameters, name: outer}), f({**parameters, name: value})
    return tuple((4 * y - z - 3 * x) / (outer - value) for x, y, z in zip(centre, first, second, strict=True))
