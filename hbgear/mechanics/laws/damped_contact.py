"""A contact with a damper that acts in contact only, the part of a force law whose force jumps.

    p = side (k delta + c delta')  where delta > 0,   else 0,     delta = side d - gap
    clipped: where delta > 0 and k delta + c delta' > 0

`Law.damped` lists these contacts; `hbgear.mechanics.laws.contact_damping` has the laws.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hbgear.common.arrays import Array


@dataclass(frozen=True)
class DampedContact:  # numpydoc ignore=PR02
    """One-sided contact with a spring and a damper in parallel.

    Parameters
    ----------
    side : {1, -1}
        Side of the stop: contact where side d > gap.
    gap : float
        Clearance [length].
    k : float
        Stiffness [force / length].
    c : float
        Damping in contact [force time / length].
    clipped : bool
        Whether tensile forces are zero.

    Examples
    --------
    >>> import hbgear as hb
    >>> [contact.side for contact in hb.mechanics.KelvinVoigt(k=1.0, c=0.1, gap=0.5, sides=2).damped]
    [1, -1]
    """

    side: Literal[1, -1]
    gap: float
    k: float
    c: float
    clipped: bool

    def state(self, d: Array, v: Array) -> tuple[Array, Array]:
        """Return the penetration and the force without its limits.

        Parameters
        ----------
        d, v : ndarray
            Displacement and velocity of the element.

        Returns
        -------
        tuple of ndarray
            Penetration delta, and the force k delta + c delta'.
        """
        depth = self.side * d - self.gap
        return depth, self.k * depth + self.c * self.side * v

    def pushes(self, d: Array, v: Array) -> np.ndarray:
        """Return where the contact has a force.

        Parameters
        ----------
        d, v : ndarray
            Displacement and velocity of the element.

        Returns
        -------
        ndarray of bool
            Whether delta > 0 and, if the force is clipped, k delta + c delta' > 0.
        """
        depth, force = self.state(d, v)
        return (depth > 0) & ((force > 0) | (not self.clipped))
