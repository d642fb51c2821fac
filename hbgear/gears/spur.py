"""One spur gear pair as an oscillator of one degree of freedom, and the mesh series all gear models share.

References
----------
Kahraman & Singh (1990), J. Sound Vib. 142(1), 49-75, https://doi.org/10.1016/0022-460X(90)90582-K.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar, Literal

import numpy as np

from hbgear.common.ranges import NOT_NEGATIVE, Range, counted
from hbgear.gears.given import checked_given, stiffness_of
from hbgear.mechanics.fourier import MOST_HARMONICS, Series
from hbgear.mechanics.laws import Backlash
from hbgear.mechanics.model import Element, Load, Model, System
from hbgear.mechanics.periodic import Phased
from hbgear.mechanics.scales import Scales


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


def checked_phase(owner: str, phase: str) -> None:
    """Refuse a phase of the transmission error that is neither "cos" nor "sin"."""
    if phase not in ("cos", "sin"):
        raise ValueError(f"{owner}: phase = {phase!r} must be 'cos' or 'sin'")


def lagging(values: tuple[float, ...], lag: tuple[float, ...]) -> Series:
    """A sum of cosines, each with a lag of its own.

        sum_l values[l-1] cos(l tau - lag[l-1])

    Parameters
    ----------
    values : (L,) amplitudes, entry 0 for l = 1.
    lag : (L,) phases [rad]; () for none.
    """
    if not lag:
        return Series(cosine=values)
    c = np.asarray(values) * np.exp(1j * np.asarray(lag))
    return Series(cosine=tuple(c.real), sine=tuple(c.imag))


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
    return dataclasses.replace(lagging(tuple(-scale * amplitude for amplitude in eps), lag), mean=1.0)


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


@dataclass(frozen=True)
class SpurPair(Model):
    """Spur gear pair reduced to its gap x along the line of action, all quantities dimensionless.

        x'' + 2 zeta x' + k(tau) f(x) = F_m + sum_l (l Omega)^2 e_l cos(l tau)      (or sin, by `phase`)
        k(tau) = 1 - sum_l eps_l cos(l tau),   f = backlash function with half-gap b,   tau = Omega t

    Built with the coordinate q = x + e(tau), e(tau) = sum_l e_l cos(l tau), the motion of the teeth without their
    error: q'' = F_m - 2 zeta x' - k f(x) and q'' = x'' + e'' with -e'' = sum_l (l Omega)^2 e_l cos(l tau). The element
    coordinate is d = q - e = x.

    Units, for a pair of mass m_c, mean mesh stiffness k_mean and half backlash b_c:

        x, e_l, b          lengths over b_c: b = 1, and the teeth part at x = 1 and meet on their backs at x = -1
        Omega              mesh frequency over omega_n = sqrt(k_mean/m_c); time is in 1/omega_n
        F_m                force over k_mean b_c: the static deflection of the mesh in half backlashes
        zeta               mesh damper over 2 m_c omega_n
        eps_l              stiffness over k_mean

    With J the moment of inertia and r the base radius of each gear, m_c = 1/(r_1^2/J_1 + r_2^2/J_2). Another b keeps
    b_c as the unit of length, to change the backlash alone.

    The defaults are one of the cases of Kahraman & Singh: e_1 Omega^2 is their F_ah omega_eh^2 with F_ah = 0.05.

    Parameters
    ----------
    zeta : damping ratio of the mesh, >= 0.
    F_m : mean load, over k_mean b_c.
    eps : (L,) amplitudes of the mesh stiffness, of any length; () for a constant one.
    e : (L,) amplitudes of the transmission error over b_c, of any length.
    phase : "cos" or "sin", of the transmission error.
    b : half backlash over b_c, >= 0.
    eps_scale, e_scale : factors of every eps_l and every e_l, to continue in.
    stiffness : k(tau) over k_mean in place of eps: a `Series` or a `Periodic`, as `Periodic.rectangular`.
    error : e(tau) over b_c in place of e: a `Series` or a `Periodic` without jumps, as `Periodic.table`.
    eps_lag, e_lag : (L,) phases by which each harmonic lags, cos(l tau - lag_l) [rad]; () for none.
    reference : (omega_n [rad/s], b_c [m], k_mean b_c [N], teeth of the pinion), by which the pair knows Hz, r/min, um
        and N (`scales`); () if they are unknown. `GearPair.model` fills it in.

    Raises
    ------
    ValueError
        If a value is out of its range or not finite.

    References
    ----------
    Kahraman & Singh (1990), J. Sound Vib. 142(1), 49-75.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.SpurPair(e=(0.1, 0.02))
    >>> pair.e_scale, pair.replace(zeta=0.1).zeta
    (1.0, 0.1)
    >>> teeth = hb.SpurPair(stiffness=hb.Periodic.rectangular(high=1.16, low=0.76, share=0.6))
    >>> len(hb.HarmonicBalance(teeth, 8).start(Omega=1.2))
    17
    """

    zeta: float = 0.05
    F_m: float = 0.1
    eps: tuple[float, ...] = ()
    e: tuple[float, ...] = (0.05,)
    phase: Literal["cos", "sin"] = "cos"
    b: float = 1.0
    eps_scale: float = 1.0
    e_scale: float = 1.0
    stiffness: Phased | None = None
    error: Phased | None = None
    eps_lag: tuple[float, ...] = ()
    e_lag: tuple[float, ...] = ()
    reference: tuple[float, ...] = ()

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]",
        "amplitude": r"$x$ [-]",
        "zeta": r"damping ratio $\zeta$",
        "F_m": r"mean load $F_m$ [-]",
        "b": r"half backlash $b$ [-]",
        "eps_scale": r"factor of the stiffness amplitudes $\varepsilon_l$",
        "e_scale": r"factor of the error amplitudes $e_l$",
    }
    default_span: ClassVar[tuple[float, float]] = (1.5, 0.3)
    ranges: ClassVar[Mapping[str, Range]] = {"zeta": NOT_NEGATIVE, "b": NOT_NEGATIVE}
    usual: ClassVar[Mapping[str, Range]] = {
        "zeta": Range(0, 1), "F_m": Range(-20, 20), "b": Range(0, 100), "eps": Range(-1, 1), "e": Range(-20, 20),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_phase("SpurPair", self.phase)
        for name in ("eps", "e"):
            object.__setattr__(self, name, amplitudes("SpurPair", name, getattr(self, name)))
            lag = checked_lags("SpurPair", name, getattr(self, name), getattr(self, f"{name}_lag"))
            object.__setattr__(self, f"{name}_lag", lag)
        checked_given("SpurPair", self.stiffness, self.eps)
        object.__setattr__(self, "reference", amplitudes("SpurPair", "reference", self.reference))
        scales_of("SpurPair", self.reference)

    @property
    def scales(self) -> Scales | None:
        return scales_of("SpurPair", self.reference)

    @property
    def mesh_stiffness(self) -> Phased:
        """k(tau)."""
        return stiffness_of(self.stiffness, self.eps_scale, mesh_stiffness(self.eps, self.eps_scale, self.eps_lag))

    @property
    def transmission_error(self) -> Phased:
        """e(tau)."""
        if self.error is not None:
            return self.error.scaled(self.e_scale)
        return transmission_error(self.e, self.phase, self.e_scale, self.e_lag)

    def system(self) -> System:
        """One coordinate q = x + e(tau) on no other spring than the mesh."""
        gap = Element(
            direction=[1.0],
            law=Backlash(b=self.b, stiffness=self.mesh_stiffness),
            displacement=self.transmission_error,
            damping=2 * self.zeta,
            name="gap",
        )
        return System(M=[[1.0]], C=None, K=[[0.0]], elements=[gap], load=Load(constant=[self.F_m]), dof_names=["q"])
