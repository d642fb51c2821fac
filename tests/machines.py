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
