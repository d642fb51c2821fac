"""Mesh stiffness and transmission error given as functions of the phase, in place of their amplitudes.

k(tau) = m + eps_scale (stiffness(tau) - m),   m the mean of stiffness;      e(tau) = e_scale error(tau)
"""

from __future__ import annotations

from hbgear.common.messages import quoted
from hbgear.mechanics.laws import checked_contact
from hbgear.mechanics.periodic import Phased


def checked_given(owner: str, stiffness: Phased | None, eps: tuple[float, ...]) -> None:
    """Refuse a stiffness that cannot be meant; None is none.

    Raises
    ------
    ValueError
        If it is not positive, or there are amplitudes eps beside it.
    """
    if stiffness is not None:
        checked_contact(owner, stiffness)
        if eps:
            raise ValueError(f"{owner}: eps = {quoted(eps)} and a stiffness are both given; keep one, eps=() the other")


def stiffness_of(given: Phased | None, factor: float, otherwise: Phased) -> Phased:
    """A stiffness that was given with its alternating part times a factor; another one if none was."""
    return otherwise if given is None else given.varied(factor)
