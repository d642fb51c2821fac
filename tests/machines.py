"""Models as users write them; processes import them from here."""

import typing
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

import hbgear as hb

Ratio = Annotated[float, "over the critical one"]


def system(zeta, F):
    """The Duffing oscillator of hbgear, as a user would write it."""
    spring = hb.Element([1.0], hb.Cubic(0.1), name="x")
    return hb.System([[1.0]], [[2 * zeta]], [[1.0]], [spring], hb.Load(cosine={1: [F]}))


@hb.mechanics.model(ranges={"zeta": hb.mechanics.Range(low=0)}, default_span=(0.5, 1.6), labels={"zeta": "damping"})
def two(zeta: Ratio = 0.05, F: float | np.floating = 0.18, n: int = 1, kind: Literal["a", "b"] = "a") -> hb.System:
    """An oscillator of somebody."""
    return system(zeta, F)


@dataclass(frozen=True)
class Needs(hb.mechanics.Model):
    """A machine with a field that has no default."""

    F: "float"
    zeta: Annotated[float, "damping ratio"] = 0.05
    teeth: int | np.integer = 30
    W: np.float64 = 0.0  # type: ignore[assignment]
    other: typing.Optional[float] = None  # noqa: UP045

    def system(self):
        return system(self.zeta, self.F)


def cantilever(n):
    """Mass and stiffness matrices of a clamped beam of unit length, mass and bending stiffness, of n elements."""
    h, (M, K) = 1 / n, np.zeros((2, 2 * n + 2, 2 * n + 2))
    stiffness = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                 [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]  # fmt: skip
    mass = [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]  # fmt: skip
    for e in range(n):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += np.divide(stiffness, h**3)
        M[at, at] += np.multiply(mass, h / 420)
    return M[2:, 2:], K[2:, 2:]
