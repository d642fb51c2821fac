"""Newton's method and Krawczyk's operator in ball arithmetic.

    K(Z) = z - Y F(z) + (1 - Y F'(Z)) (Z - z),   Y ~ F'(z)^-1

If K(Z) lies in the interior of the box Z, then F has exactly one zero in Z, it lies in K(Z), and F' is regular there.

References
----------
Krawczyk, R. (1969). Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken. Computing 4, 187-201.
https://doi.org/10.1007/BF02234767.

Rump, S. M. (2010). Verification methods: rigorous results using floating-point arithmetic. Acta Numerica 19, 287-449.
https://doi.org/10.1017/S096249291000005X.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hbgear.analysis.certificates.ball_system import Balls, array, balls, matrix

Equations = Callable[[Balls], tuple[Balls, Balls]]
"""Residual (n,) and derivatives (n, n) at unknowns (n,)."""

MAX_NEWTON_STEPS = 14
"""Largest number of Newton steps; from twelve digits, three are needed."""

MAX_NEWTON_CHANGE = 0.5
"""Largest scaled step of Newton's method: beyond it another solution would be found."""

RADII = [10.0**-k for k in range(44, 3, -1)]
"""Half widths of boxes that are tried, relative to the scales of the unknowns."""


def midpoints(z: Balls) -> Balls:
    """Return the midpoints of balls, as exact balls."""
    out = np.empty(len(z), dtype=object)
    out[:] = [x.mid() for x in z]
    return out


def box(z: Balls, radii: Balls) -> Balls:
    """Return balls with midpoints and radii."""
    from flint import arb

    out = np.empty(len(z), dtype=object)
    out[:] = [arb(x, radius) for x, radius in zip(z, radii, strict=True)]
    return out


def newton(equations: Equations, z: Balls, scales: Balls) -> Balls | None:
    """Return a zero to working precision, or None if the method does not converge or leaves its start."""
    size = np.inf
    for _ in range(MAX_NEWTON_STEPS):
        F, J = equations(z)
        try:
            step = array(matrix(J).mid().solve(matrix(midpoints(F)[:, None])).mid())[:, 0]
        except ZeroDivisionError:
            return None
        before, size = size, max(abs(float(s / scale)) for s, scale in zip(step, scales, strict=True))
        if not size < MAX_NEWTON_CHANGE:
            return None
        z = midpoints(z - step)
        if size < 1e-40 or (size < 1e-30 and size > 0.1 * before):
            return z
    return z if size < 1e-25 else None


class Krawczyk:
    """Krawczyk's operator, with the midpoints of z (n,) as center, of equations with their derivatives."""

    def __init__(self, equations: Equations, z: Balls) -> None:
        self.equations, self.z = equations, midpoints(z)
        F, J = equations(self.z)
        try:
            self.Y: Any = matrix(J).mid().inv().mid()
        except ZeroDivisionError:
            self.Y = None
            return
        self.step = array(self.Y * matrix(F[:, None]))[:, 0]

    def image(self, radii: Balls) -> Balls | None:
        """Return K(Z) if it lies in the interior of the box Z with these half widths, else None."""
        if self.Y is None or not all(x.is_finite() for x in self.step):
            return None
        Z = box(self.z, radii)
        slope = matrix(self.equations(Z)[1])
        if not all(x.is_finite() for x in slope.entries()):
            return None
        contraction = array(matrix(balls(np.eye(len(Z)))) - self.Y * slope)
        K: Balls = self.z - self.step + contraction @ (Z - self.z)
        return K if all(outer.contains_interior(inner) for outer, inner in zip(Z, K, strict=True)) else None

    def smallest_radius(self, scales: Balls) -> float | None:
        """Return the smallest of `RADII` whose box is mapped into its interior; None without one."""
        if self.Y is None or not all(x.is_finite() for x in self.step):
            return None
        ratio = max(float((x / scale).abs_upper()) for x, scale in zip(self.step, scales, strict=True))
        return next((R for R in RADII if ratio < R and self.image(scales * R) is not None), None)

    def largest_radius(self, scales: Balls, smallest: float) -> float:
        """Return the largest of every second of `RADII` with an image in the interior of its box."""
        larger = [R for R in RADII[::-1][::2] if smallest < R]
        return next((R for R in larger if self.image(scales * R) is not None), smallest)
