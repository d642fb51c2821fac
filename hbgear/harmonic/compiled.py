"""A model at one set of parameters, with everything that its evaluations share."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.projection import ContactProjector
from hbgear.harmonic.receptance import LinearPart, Receptance, Structure
from hbgear.mechanics.fourier import Transform
from hbgear.mechanics.laws import Law
from hbgear.mechanics.model import System


class Compiled:
    """A model at one parameter set, ready to be evaluated.

    nu, N : subharmonic order and samples per basis period. system, structure, receptance, laws : of the model.
    exact, sampled : numbers of the elements whose laws are projected exactly, and of the others.
    corner, element : (K,) corners of all laws and the element each belongs to.
    """

    def __init__(self, system: System, structure: Structure, H: int, nu: int, sampled: bool, transform: Transform):
        self.system, self.structure = system, structure
        self.receptance = Receptance(structure, system, H, nu)
        self.laws: tuple[Law, ...] = tuple(e.law for e in system.elements)
        exact = np.array([not sampled and bool(law.piecewise) for law in self.laws])
        self.exact, self.sampled = np.flatnonzero(exact), np.flatnonzero(~exact)
        self.nu, self.N = nu, transform.N
        self._projectors: dict[int, ContactProjector] = {}
        # corners of all laws, and the element each belongs to
        self.corner = np.concatenate([law.breakpoints for law in self.laws])
        self.element = np.repeat(np.arange(len(self.laws)), [len(law.breakpoints) for law in self.laws])
        self.rated = any(self.laws[j].rated for j in self.sampled)
        self._tau = nu * 2 * np.pi * np.arange(transform.N) / transform.N
        self._bound: dict[int, list[Any]] = {}
        self._linear: tuple[bytes, LinearPart] | None = None

    @property
    def m(self) -> int:
        """Number of elements."""
        return len(self.laws)

    def projector_of(self, P: int) -> ContactProjector:
        """Projector of P motions at once, motion after motion."""
        if P not in self._projectors:
            self._projectors[P] = ContactProjector([self.laws[j] for j in self.exact] * P, self.nu)
        return self._projectors[P]

    def bound(self, P: int) -> list[Any]:
        """The sampled laws, each on the samples of P motions one after the other."""
        if P not in self._bound:
            tau = np.tile(self._tau, P)
            self._bound[P] = [self.laws[j].bind(tau) for j in self.sampled]
        return self._bound[P]

    def linear(self, Omega: Array) -> LinearPart:
        """Linear part at Omega (P,); the last one is kept, for Newton at fixed Omega asks for it again and again."""
        key, last = Omega.tobytes(), self._linear
        if last is None or last[0] != key:
            self._linear = last = (key, self.receptance.at_all(Omega))
        return last[1]  # not of self._linear, which another thread may have set meanwhile
