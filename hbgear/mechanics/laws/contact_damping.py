"""Contact with damping: forces that dissipate during contact.

    Hunt-Crossley          p = k delta^n max(1 + contact_damping delta', 0),   delta = d - gap > 0
    Kelvin-Voigt           p = k delta + c delta'
    clipped Kelvin-Voigt   p = max(k delta + c delta', 0)

The force of Hunt and Crossley is zero at the begin and at the end of a contact, because its damping grows with the
penetration delta. It is therefore continuous. The force of a spring and damper in parallel (Kelvin-Voigt) jumps by
c delta' at the begin of a contact, and pulls at its end unless it is clipped. It is linear between the switching times
and is projected exactly, see `hbgear.harmonic.forces.damped_contacts`.

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
from hbgear.mechanics.laws.damped_contact import DampedContact
from hbgear.mechanics.laws.laws import Forces, Law


class _ContactWithGap(Law):
    """Base class of contacts with a gap at one side or at two."""

    k: float
    gap: float
    sides: Literal[1, 2]

    def _check(self) -> None:
        name = type(self).__name__
        checked(name, "k", self.k, POSITIVE)
        if self.sides not in (1, 2):
            raise ValueError(f"{name}: sides = {quoted(self.sides)} must be 1 (a stop) or 2 (a clearance)")
        checked(name, "gap", self.gap, NOT_NEGATIVE if self.sides == 2 else ANY)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (self.gap,) if self.sides == 1 or self.gap == 0 else (-self.gap, self.gap)

    steady = True


@dataclass(frozen=True)
class HuntCrossley(_ContactWithGap):  # numpydoc ignore=PR02
    """Contact with a damping that grows with the penetration, one-sided like `Unilateral` or two-sided like `Backlash`.

        p = k delta^n max(1 + contact_damping delta', 0),   delta = d - gap > 0;   on two sides p(-d, -d') = -p(d, d')

    Parameters
    ----------
    k : float
        Contact stiffness, > 0 [force / length^n].
    contact_damping : float
        Damping coefficient, >= 0 [time / length]. For small impact velocities v the coefficient of restitution is about
        1 - 2/3 contact_damping v.
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
    The force is integrated by Gauss points between the instants at which contact begins and ends, to rounding unless
    the contact ends before that. It never pulls: where 1 + contact_damping delta' < 0, the force is zero.

    References
    ----------
    Hunt & Crossley (1975), J. Appl. Mech. 42(2), https://doi.org/10.1115/1.3423596.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> stop = hb.mechanics.HuntCrossley(k=2.0, contact_damping=0.5, gap=1.0)
    >>> d, v = np.array([0.5, 1.5, 1.5, 1.5]), np.array([1.0, 0.0, 1.0, -4.0])
    >>> stop.force(d, v, 0.0)[0].tolist()
    [0.0, 1.0, 1.5, 0.0]
    """

    k: float
    contact_damping: float
    gap: float = 0.0
    exponent: float = 1.0
    sides: Literal[1, 2] = 1

    def __post_init__(self) -> None:
        self._check()
        checked("HuntCrossley", "contact_damping", self.contact_damping, NOT_NEGATIVE)
        checked("HuntCrossley", "exponent", self.exponent, Range(low=1, high=10))

    @property
    def reference(self) -> float:
        return self.k if self.exponent == 1.0 else 0.0

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        side = np.where(d < 0, -1.0, 1.0) if self.sides == 2 else np.ones_like(d)
        depth = np.maximum(side * d - self.gap, 0.0)
        factor = np.maximum(1 + self.contact_damping * side * v, 0.0)
        closed = (depth > 0) & (factor > 0)
        elastic = np.where(closed, self.k * depth**self.exponent, 0.0)
        slope = np.where(closed, self.k * self.exponent * depth ** (self.exponent - 1.0), 0.0)
        return side * elastic * factor, slope * factor, elastic * self.contact_damping


@dataclass(frozen=True)
class _SpringAndDamper(_ContactWithGap):
    """Contact with a spring and a damper in parallel, one-sided or two-sided."""

    k: float
    c: float
    gap: float = 0.0
    sides: Literal[1, 2] = 1

    def __post_init__(self) -> None:
        self._check()
        checked(type(self).__name__, "c", self.c, NOT_NEGATIVE)

    @property
    def reference(self) -> float:
        return self.k

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        p, stiffness, damping = np.zeros_like(d), np.zeros_like(d), np.zeros_like(d)
        for contact in self.damped:
            active = contact.pushes(d, v)
            p += np.where(active, contact.side * contact.state(d, v)[1], 0.0)
            stiffness += self.k * active
            damping += self.c * active
        return p, stiffness, damping


@dataclass(frozen=True)
class KelvinVoigt(_SpringAndDamper):  # numpydoc ignore=PR02
    """Contact with a spring and a damper in parallel, one-sided like `Unilateral` or two-sided like `Backlash`.

        p = k delta + c delta',   delta = d - gap > 0;   on two sides p(-d, -d') = -p(d, d')

    Parameters
    ----------
    k : float
        Contact stiffness, > 0 [force / length].
    c : float
        Damping in contact, >= 0 [force time / length].
    gap : float, optional
        Clearance [unit of d]; with two sides half of it, >= 0. Default 0.
    sides : {1, 2}, optional
        One stop at d = gap, or two at d = +-gap. Default 1.

    Raises
    ------
    ValueError
        If a number is outside its range.

    Notes
    -----
    The force jumps at both ends of a contact and pulls before it ends, where k delta < -c delta'. `ClippedKelvinVoigt`
    does not pull. It is projected exactly, and the multipliers include the jumps. It cannot be a part of `Parallel`;
    two elements may have the same direction.

    References
    ----------
    Goldsmith, Impact (1960); Lankarani & Nikravesh (1990), J. Mech. Des. 112(3), https://doi.org/10.1115/1.2912617.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> stop = hb.mechanics.KelvinVoigt(k=2.0, c=0.5, gap=1.0)
    >>> stop.force(np.array([0.5, 1.5, 1.5]), np.array([1.0, 1.0, -4.0]), 0.0)[0].tolist()
    [0.0, 1.5, -1.0]
    """

    @property
    def damped(self) -> tuple[DampedContact, ...]:
        return _contacts(self, clipped=False)


@dataclass(frozen=True)
class ClippedKelvinVoigt(_SpringAndDamper):  # numpydoc ignore=PR02
    """Contact with a spring and a damper in parallel that never pulls.

        p = max(k delta + c delta', 0),   delta = d - gap > 0;   on two sides p(-d, -d') = -p(d, d')

    Parameters
    ----------
    k : float
        Contact stiffness, > 0 [force / length].
    c : float
        Damping in contact, >= 0 [force time / length].
    gap : float, optional
        Clearance [unit of d]; with two sides half of it, >= 0. Default 0.
    sides : {1, 2}, optional
        One stop at d = gap, or two at d = +-gap. Default 1.

    Raises
    ------
    ValueError
        If a number is outside its range.

    Notes
    -----
    The force jumps at the begin of a contact and ends where it would become tensile, before the surfaces separate at
    delta = 0. Both instants are computed exactly. The derivative of the harmonics jumps at grazing contact. The law
    cannot be a part of `Parallel`; two elements may have the same direction.

    References
    ----------
    Goldsmith, Impact (1960); Lankarani & Nikravesh (1990), J. Mech. Des. 112(3), https://doi.org/10.1115/1.2912617.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> stop = hb.mechanics.ClippedKelvinVoigt(k=2.0, c=0.5, gap=1.0)
    >>> stop.force(np.array([0.5, 1.5, 1.5]), np.array([1.0, 1.0, -4.0]), 0.0)[0].tolist()
    [0.0, 1.5, 0.0]
    """

    @property
    def damped(self) -> tuple[DampedContact, ...]:
        return _contacts(self, clipped=True)


def _contacts(law: _SpringAndDamper, clipped: bool) -> tuple[DampedContact, ...]:
    """Return the contacts of a law."""
    first = DampedContact(1, law.gap, law.k, law.c, clipped)
    return (first, DampedContact(-1, law.gap, law.k, law.c, clipped)) if law.sides == 2 else (first,)
