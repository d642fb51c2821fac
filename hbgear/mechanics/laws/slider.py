"""A friction slider, the part of a force law with memory.

    f = k (d - z),   |f| <= limit

`Law.sliders` lists the sliders of a law; `hbgear.mechanics.laws.friction` has the laws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked


@dataclass(frozen=True)
class Slider:  # numpydoc ignore=PR02
    """Spring in series with a Coulomb slider.

    Parameters
    ----------
    k : float
        Stiffness while the slider sticks, > 0 [force / length].
    limit : float
        Friction limit, > 0 [force].
    residual : float, optional
        Position z of the slider before the motion [length]. Default 0.

    Raises
    ------
    ValueError
        If k or the limit is not positive, or a number is not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.mechanics.Jenkins(k=2.0, limit=1.0).sliders[0].reach
    0.5
    """

    k: float
    limit: float
    residual: float = 0.0

    def __post_init__(self) -> None:
        checked("Slider", "k", self.k, POSITIVE)
        checked("Slider", "limit", self.limit, POSITIVE)
        checked("Slider", "residual", self.residual)

    @property
    def reach(self) -> float:
        """Largest distance |d - z|, limit / k [length]."""
        return self.limit / self.k

    def position(self, z: float, d: float) -> float:
        """Return the position of the slider after a monotonic motion to d from a position z.

        Parameters
        ----------
        z : float
            Position before [length].
        d : float
            Displacement of the element [length].

        Returns
        -------
        float
            Position after.
        """
        return min(max(z, d - self.reach), d + self.reach)


def first_loading(sliders: Sequence[Slider], d: Array) -> tuple[Array, Array]:
    """Return the force and stiffness of sliders at displacements d that are reached monotonically from rest.

    Parameters
    ----------
    sliders : sequence of Slider
        Sliders of a law.
    d : ndarray
        Displacements [length].

    Returns
    -------
    tuple of ndarray
        Sum of the forces, and of the stiffnesses of the sliders that do not slip.
    """
    p, k = np.zeros_like(d), np.zeros_like(d)
    for one in sliders:
        force = one.k * (d - one.residual)
        p += np.clip(force, -one.limit, one.limit)
        k += one.k * (np.abs(force) <= one.limit)
    return p, k
