"""States of the points of a curve, from which Newton's method starts: harmonics do not show short contacts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.corrector import CurveState
from hbgear.harmonic.instants.special_points.grazing import Grazing


class KnownStates(NamedTuple):
    """Points of a branch in a parameter, the others fixed: values (P,), coefficients (P, n), states.

    contacts : contacts that graze, by the number of the point.
    """

    name: str
    fixed: dict[str, float]
    values: Array
    X: Array
    states: list[CurveState]
    contacts: dict[int, tuple[Grazing, ...]]

    def joined(self, other: KnownStates | None) -> KnownStates:
        """Return the points of both parts of a curve; of this one alone if the other one has other parameters."""
        if other is None or (self.name, self.fixed, self.X.shape[1:]) != (other.name, other.fixed, other.X.shape[1:]):
            return self
        values, X = np.concatenate([self.values, other.values]), np.concatenate([self.X, other.X])
        shifted = {len(self.states) + i: contacts for i, contacts in other.contacts.items()}
        return self._replace(values=values, X=X, states=self.states + other.states, contacts=self.contacts | shifted)
