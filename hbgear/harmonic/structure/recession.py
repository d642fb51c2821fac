"""What a machine becomes for motions far larger than every length of it: its recession.

    p_far(d, v, tau) = lim p(r d, r v, tau) / r,   r -> inf

Gaps shrink to nothing beside such motions, and loads and prescribed displacements vanish beside the forces: what is
left is homogeneous, and linear where a law is equally stiff on both sides, as backlash is (all teeth always in mesh).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import Range
from hbgear.mechanics.laws.laws import Cubic, Forces, Law, Parallel, PiecewiseLinear
from hbgear.mechanics.models import Load, Model, System
from hbgear.mechanics.series.fourier import Series

_FAR = 1e12  # lengths, in whatever unit, beside which any gap is nothing


_SAME = 1e-6  # difference of the stiffness at two such lengths, relative, of a law that has a recession


def recession(law: Law) -> Law | None:
    """The law that holds for motions without bound; None if its force does not grow in proportion there (a cubic)."""
    if law.piecewise is not None:
        springs = tuple(_spring(spring) for spring in law.piecewise)
        return springs[0] if len(springs) == 1 else Parallel(springs)
    if type(law) is Cubic:
        return None if law.k3 else PiecewiseLinear((), (law.k1,))
    far = _Far(law)
    return far if far.settled else None


def receded(system: System) -> System | None:
    """The system far out: no gaps, no loads, no prescribed displacements; None if a law has no recession."""
    elements = []
    for element in system.elements:
        law = recession(element.law)
        if law is None:
            return None
        elements.append(dataclasses.replace(element, law=law, displacement=Series()))
    return dataclasses.replace(system, elements=elements, load=Load())


def longest(system: System) -> float:
    """The largest length that laws and prescribed displacements of a system know; 0 if they know none."""
    corners = [abs(x) for element in system.elements for x in element.law.breakpoints]
    return max([*corners, *(e.displacement.bound for e in system.elements)], default=0.0)


class Receded(Model):
    """A model as it is far out, at any of its parameters; every law of it must have a recession."""

    def __init__(self, model: Model) -> None:
        self.model = model

    @property
    def parameters(self) -> dict[str, float]:
        return self.model.parameters

    @property
    def ranges(self) -> Mapping[str, Range]:  # type: ignore[override]
        """Those of the model."""
        return self.model.ranges

    def replace(self, /, **changes: float) -> Self:
        return type(self)(self.model.replace(**changes))

    def system(self) -> System:
        """The system far out.

        Raises
        ------
        ValueError
            If a law has no recession.
        """
        system = receded(self.model.system())
        if system is None:
            raise ValueError(f"a law of {self.model!r} does not grow in proportion to the motion")
        return system


def _spring(spring: PiecewiseLinear) -> PiecewiseLinear:
    left, right = spring.slopes[0], spring.slopes[-1]
    if left == right:
        return PiecewiseLinear((), (left,), stiffness=spring.stiffness)
    return PiecewiseLinear((0.0,), (left, right), stiffness=spring.stiffness)


@dataclass(frozen=True)
class _Far(Law):
    """Any law, asked at lengths beside which its own are nothing."""

    law: Law

    @property
    def reference(self) -> float:
        return self.law.reference

    @property
    def rated(self) -> bool:
        return self.law.rated

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (0.0,)

    @property
    def settled(self) -> bool:
        """Whether the force is proportional to the motion at such lengths."""
        d, v, tau = (x.ravel() for x in np.meshgrid([-1.0, 1.0], [-1.0, 0.0, 1.0], np.arange(8.0)))
        with np.errstate(all="ignore"):
            near, far = (np.asarray(self._at(r, d, v, tau)[0]) for r in (1e-2 * _FAR, _FAR))
        return bool(np.all(np.abs(near - far) <= _SAME * self.reference))  # not of what is not finite

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        return self._at(_FAR, d, v, tau)

    def _at(self, r: float, d: Array, v: Array, tau: Array) -> Forces:
        p, dd, dv = self.law.force(r * d, r * v, tau)
        return p / r, dd, dv
