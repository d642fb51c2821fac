"""Recession of a system: the limit of its laws for motions much larger than all lengths of the model.

    p_far(d, v, tau) = lim p(r d, r v, tau) / r,   r -> inf

Gaps, loads and prescribed displacements are negligible for such motions. The limit p_far is homogeneous of degree one.
It is linear if a law has equal stiffness on both sides, as with backlash (all teeth always in mesh).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.structure.derived_model import DerivedModel
from hbgear.mechanics.laws.friction import ContactFriction
from hbgear.mechanics.laws.laws import Cubic, Forces, Law, Parallel, PiecewiseLinear
from hbgear.mechanics.laws.mesh_contacts import contacts_of
from hbgear.mechanics.laws.vector_laws import Component, Directed, Polynomial, RadialClearance, VectorLaw
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.structures.elements import Load

_RECESSION_LENGTH = 1e12
"""Displacement, in the unit of the model, at which a law is evaluated as its limit: any gap is negligible."""

_RECESSION_TOLERANCE = 1e-6
"""Largest relative change of p / r between r = 1e10 and 1e12 for which a law has a recession."""


def recession(law: Law) -> Law | None:
    """Return the limit of a law for large motions; None if the force is not proportional to them, as of a cubic law."""
    if law.piecewise is not None:
        springs = tuple(_spring(spring) for spring in law.piecewise)
        if any(slider.normal for slider in law.sliders):  # friction proportional to the motion
            return dataclasses.replace(law, residual=0.0) if isinstance(law, ContactFriction) else None
        if not springs:  # friction alone: a bounded force
            return Cubic(0.0)
        return springs[0] if len(springs) == 1 else Parallel(springs)
    contacts = contacts_of(law)
    if contacts:
        return Parallel(
            tuple(
                PiecewiseLinear((0.0,), (0.0, 1.0) if contact.side > 0 else (1.0, 0.0), stiffness=contact.stiffness)
                for contact in contacts
            )
        )
    if type(law) is Cubic:
        return None if law.k3 else PiecewiseLinear((), (law.k1,))
    if isinstance(law, Component):
        coupled = _vector_recession(law.law)
        return None if coupled is None else Component(coupled, law.index)
    limit = _ScaledLaw(law)
    return limit if limit.is_proportional else None


def _vector_recession(law: VectorLaw) -> VectorLaw | None:
    """Return the limit of a law of several displacements, which couples them; None if it is not known."""
    if isinstance(law, RadialClearance):
        return dataclasses.replace(law, clearance=0.0)
    if isinstance(law, Directed):
        limit = recession(law.law)
        return None if limit is None else Directed(limit)
    return law if isinstance(law, Polynomial) and {sum(powers) for powers in law.exponents} == {1} else None


def receded(system: System) -> System | None:
    """Return the system without gaps, loads and prescribed displacements; None if a law has no recession."""
    elements = []
    for element in system.elements:
        law = recession(element.law)
        if law is None:
            return None
        elements.append(dataclasses.replace(element, law=law, displacement=Series()))
    return dataclasses.replace(system, elements=elements, load=Load())


def longest(system: System) -> float:
    """Return the largest breakpoint, clearance, reach of a slider or prescribed displacement; 0 without any."""
    breakpoints = [abs(x) for element in system.elements for x in _gaps(element.law)]
    reaches = [slider.reach for element in system.elements for slider in element.law.sliders]
    return max([*breakpoints, *reaches, *(e.displacement.bound for e in system.elements)], default=0.0)


def _gaps(law: Law) -> tuple[float, ...]:
    """Return the breakpoints or the radial clearance of a law, also of one within a law of several displacements."""
    if isinstance(law, Component | Directed):
        return _gaps(law.law)
    return (law.clearance,) if isinstance(law, RadialClearance) else law.breakpoints


class Receded(DerivedModel):
    """Recession of a model whose laws all have one, at any of its parameters."""

    def system(self) -> System:
        """Return the recession of the system of the model.

        Raises
        ------
        ValueError
            If a law has no recession.
        """
        system = receded(self.model.system())
        if system is None:
            raise ValueError(f"a law of {self.model!r} has no recession: its force does not grow in proportion")
        return system


def _spring(spring: PiecewiseLinear) -> PiecewiseLinear:
    """Return the recession of a piecewise-linear spring: its outermost slopes, with breakpoint 0 if they differ."""
    left, right = spring.slopes[0], spring.slopes[-1]
    if left == right:
        return PiecewiseLinear((), (left,), stiffness=spring.stiffness)
    return PiecewiseLinear((0.0,), (left, right), stiffness=spring.stiffness)


@dataclass(frozen=True)
class _ScaledLaw(Law):
    """Recession of any law, p(r d, r v, tau) / r at r = 1e12."""

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
    def is_proportional(self) -> bool:
        """Whether p / r agrees at r = 1e10 and r = 1e12."""
        d, v, tau = (x.ravel() for x in np.meshgrid([-1.0, 1.0], [-1.0, 0.0, 1.0], np.arange(8.0)))
        with np.errstate(all="ignore"):
            low, high = (np.asarray(self._at(r, d, v, tau)[0]) for r in (1e-2 * _RECESSION_LENGTH, _RECESSION_LENGTH))
        return bool(np.all(np.abs(low - high) <= _RECESSION_TOLERANCE * self.reference))  # False if not finite

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        return self._at(_RECESSION_LENGTH, d, v, tau)

    def _at(self, r: float, d: Array, v: Array, tau: Array) -> Forces:
        """Return p(r d, r v, tau) / r and the slopes there."""
        p, dd, dv = self.law.force(r * d, r * v, tau)
        return p / r, dd, dv
