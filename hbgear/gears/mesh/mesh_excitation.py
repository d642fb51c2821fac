"""What excites a mesh, the same in all gear models: stiffness and transmission error over a mesh cycle.

    k(tau) = 1 - eps_scale sum_l eps_l cos(l tau - eps_lag_l)          or  m + eps_scale (stiffness(tau) - m)
    e(tau) = e_scale sum_l e_l cos(l tau - e_lag_l), or sin            or  e_scale error(tau)

with m the mean of stiffness. By their amplitudes, or given as functions of the phase, corners and all.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from math import pi
from typing import Any, Literal

import numpy as np

from hbgear.common.ranges import counted
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.laws import checked_contact
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import MOST_HARMONICS, Series
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.scales import Scales


class MeshExcitation(Model):
    """A model whose mesh has these fields; one that has no use for a field other than eps and e leaves it out."""

    eps: tuple[float, ...] = ()
    e: tuple[float, ...] = ()
    phase: Literal["cos", "sin"] = "cos"
    eps_scale: float = 1.0
    e_scale: float = 1.0
    stiffness: Phased | None = None
    error: Phased | None = None
    eps_lag: tuple[float, ...] = ()
    e_lag: tuple[float, ...] = ()
    reference: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        owner = type(self).__name__
        if self.phase not in ("cos", "sin"):
            raise ValueError(f"{owner}: phase = {self.phase!r} must be 'cos' or 'sin'")
        fields = {field.name for field in dataclasses.fields(self)}  # type: ignore[arg-type]
        for name in ("eps", "e"):
            object.__setattr__(self, name, amplitudes(owner, name, getattr(self, name)))
            if f"{name}_lag" in fields:
                lag = checked_lags(owner, name, getattr(self, name), getattr(self, f"{name}_lag"))
                object.__setattr__(self, f"{name}_lag", lag)
        checked_given(owner, self.stiffness, self.eps)
        if "reference" in fields:
            object.__setattr__(self, "reference", amplitudes(owner, "reference", self.reference))
            scales_of(owner, self.reference)

    @property
    def scales(self) -> Scales | None:
        return scales_of(type(self).__name__, self.reference)

    @property
    def mesh_stiffness(self) -> Phased:
        """k(tau), over its mean unless it was given."""
        if self.stiffness is not None:
            return self.stiffness.varied(self.eps_scale)
        return mesh_stiffness(self.eps, self.eps_scale, self.eps_lag)

    @property
    def transmission_error(self) -> Phased:
        """e(tau), in half backlashes."""
        if self.error is not None:
            return self.error.scaled(self.e_scale)
        return transmission_error(self.e, self.phase, self.e_scale, self.e_lag)


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


def amplitudes(owner: str, name: str, values: Any) -> tuple[float, ...]:
    """Harmonic amplitudes as a tuple of floats, entry 0 for l = 1.

    Raises
    ------
    ValueError
        If ``values`` is not a sequence of finite numbers, or too long for a `Series`.
    """
    try:
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise TypeError
        out = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        raise ValueError(f"{owner}: {name} = {values!r} must be a sequence of numbers such as (0.1, 0.05)") from None
    if not np.all(np.isfinite(out)):
        raise ValueError(f"{owner}: {name} = {values!r} has entries that are not finite")
    counted(f"{owner}: number of entries of {name}", len(out), MOST_HARMONICS, least=0)
    return out


def lagging(values: tuple[float, ...], lag: tuple[float, ...], mean: float = 0.0) -> Series:
    """A sum of cosines, each with a lag of its own.

        mean + sum_l values[l-1] cos(l tau - lag[l-1])

    Parameters
    ----------
    values : (L,) amplitudes, entry 0 for l = 1.
    lag : (L,) phases [rad]; () for none.
    """
    if not lag:
        return Series(mean, values)
    c = np.asarray(values) * np.exp(1j * np.asarray(lag))
    return Series(mean, tuple(c.real), tuple(c.imag))


def checked_lags(owner: str, name: str, values: tuple[float, ...], lag: Any) -> tuple[float, ...]:
    """Lags as a tuple of floats, as many as amplitudes or none.

    Raises
    ------
    ValueError
        If they are others.
    """
    out = amplitudes(owner, f"{name}_lag", lag)
    if out and len(out) != len(values):
        raise ValueError(f"{owner}: {name}_lag has {len(out)} entries and {name} has {len(values)}: give one lag for "
                         "each amplitude, or () for none")  # fmt: skip
    return out


def transmission_error(e: tuple[float, ...], phase: str, scale: float = 1.0, lag: tuple[float, ...] = ()) -> Series:
    """Transmission error.

        e(tau) = scale sum_l e[l-1] cos(l tau - lag[l-1]), or sin

    Parameters
    ----------
    e : (L,) amplitudes, entry 0 for l = 1.
    phase : "cos" or "sin".
    scale : factor of all of them.
    lag : (L,) phases [rad]; () for none.
    """
    if phase == "cos" or not lag:
        return (lagging(e, lag) if phase == "cos" else Series(sine=e)).scaled(scale)
    return lagging(e, tuple(x + pi / 2 for x in lag)).scaled(scale)


def mesh_stiffness(eps: tuple[float, ...], scale: float = 1.0, lag: tuple[float, ...] = ()) -> Series:
    """Mesh stiffness over its mean.

        k(tau) = 1 - scale sum_l eps[l-1] cos(l tau - lag[l-1])

    Parameters
    ----------
    eps : (L,) amplitudes, entry 0 for l = 1.
    scale : factor of all of them.
    lag : (L,) phases [rad]; () for none.
    """
    return lagging(tuple(-scale * amplitude for amplitude in eps), lag, 1.0)


def scales_of(owner: str, reference: tuple[float, ...]) -> Scales | None:
    """`Scales` of a field ``reference``: (omega_n [rad/s], b_c [m], k_mean b_c [N], teeth of the pinion), or ().

    Raises
    ------
    ValueError
        If they are neither none nor four positive numbers.
    """
    if not reference:
        return None
    if len(reference) != 4 or not all(x > 0 for x in reference):
        raise ValueError(f"{owner}: reference = {reference!r} must be omega_n [rad/s], b_c [m], k_mean b_c [N] and the "
                         "number of teeth of the pinion, all positive; or ()")  # fmt: skip
    return Scales(*reference)
