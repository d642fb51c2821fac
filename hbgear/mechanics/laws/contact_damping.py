"""Contact with damping: forces that dissipate during contact and never pull.

    p = k delta^n max(1 + damping delta', 0),   delta = d - gap > 0

The force of Hunt and Crossley is zero at the begin and at the end of a contact, because its damping grows with the
penetration delta. It is therefore continuous, unlike that of a spring and damper in parallel.

References
----------
Hunt & Crossley (1975), J. Appl. Mech. 42(2), https://doi.org/10.1115/1.3423596.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import ANY, NOT_NEGATIVE, POSITIVE, Range, checked
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.laws import Forces, Law


@dataclass(frozen=True)
class HuntCrossley(Law):  # numpydoc ignore=PR02
    """Contact with a damping that grows with the penetration, one-sided like `Unilateral` or two-sided like `Backlash`.

        p = k delta^n max(1 + damping delta', 0),   delta = d - gap > 0;   two sides: also p(-d, -d') = -p(d, d')

    Parameters
    ----------
    k : float
        Contact stiffness, > 0 [force / length^n].
    damping : float
        Damping coefficient, >= 0 [time / length]. For small impact velocities v the coefficient of restitution is about
        1 - 2/3 damping v.
    gap : float, optional
        Clearance [unit of d]; with two sides half of it, >= 0. Default 0.
    exponent : float, optional
        Exponent n >= 1; 3/2 for spheres (Hertz). Default 1.
    sides : {1, 2}, optional
        One stop at d = gap, or two at d = +-gap. Default 1.

    Raises
    ------
    ValueError
        If a number is outside its range.

    Notes
    -----
    The law is evaluated by AFT (alternating frequency/time); the estimated sampling error is part of the error of a
    curve. It never pulls: where 1 + damping delta' < 0, the force is zero.

    References
    ----------
    Hunt & Crossley (1975), J. Appl. Mech. 42(2), https://doi.org/10.1115/1.3423596.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> stop = hb.mechanics.HuntCrossley(k=2.0, damping=0.5, gap=1.0)
    >>> d, v = np.array([0.5, 1.5, 1.5, 1.5]), np.array([1.0, 0.0, 1.0, -4.0])
    >>> stop.force(d, v, 0.0)[0].tolist()
    [0.0, 1.0, 1.5, 0.0]
    """

    k: float
    damping: float
    gap: float = 0.0
    exponent: float = 1.0
    sides: Literal[1, 2] = 1

    def __post_init__(self) -> None:
        checked("HuntCrossley", "k", self.k, POSITIVE)
        checked("HuntCrossley", "damping", self.damping, NOT_NEGATIVE)
        if self.sides not in (1, 2):
            raise ValueError(f"HuntCrossley: sides = {quoted(self.sides)} must be 1 (a stop) or 2 (a clearance)")
        checked("HuntCrossley", "gap", self.gap, NOT_NEGATIVE if self.sides == 2 else ANY)
        checked("HuntCrossley", "exponent", self.exponent, Range(low=1, high=10))

    @property
    def reference(self) -> float:
        return self.k if self.exponent == 1.0 else 0.0

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (self.gap,) if self.sides == 1 or self.gap == 0 else (-self.gap, self.gap)

    @property
    def steady(self) -> bool:
        return True

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        side = np.where(d < 0, -1.0, 1.0) if self.sides == 2 else np.ones_like(d)
        depth = np.maximum(side * d - self.gap, 0.0)
        push = 1 + self.damping * side * v
        acts = (depth > 0) & (push > 0)
        whole = np.where(acts, self.k * depth**self.exponent, 0.0)
        slope = np.where(acts, self.k * self.exponent * depth ** (self.exponent - 1.0), 0.0)
        return side * whole * push, slope * push, whole * self.damping
