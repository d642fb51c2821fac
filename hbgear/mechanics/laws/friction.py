"""Dry friction: elastic friction, whose force laws are sums of sliders, and rigid friction.

    f = k (d - z),   |f| <= limit      the position z of a slider rests while it sticks, and follows d while it slips

A slider is a spring of stiffness k in series with a rigid Coulomb slider (Jenkins element). It slips while
|k (d - z)| = limit, and sticks again where the velocity d' changes its sign. The force does not depend on the size of
the velocity. Sums of sliders are Iwan models.

The limit is constant, prescribed over the period (`Jenkins`), or proportional to the force of another element
(`ContactFriction`). Any law may have sliders: its property `Law.sliders` lists them, and their forces are added to
``force(d, v, tau)``, which is the part without memory. Harmonic balance projects sliders exactly, see
`hbgear.harmonic.forces.slider_kernels`; stability has one more state per slider.

`RigidFriction` has no stiffness, and a static limit that may exceed the kinetic one. Its force jumps; time integration
computes it exactly.

References
----------
Jenkins (1962), ASME paper 62-MECH; Iwan (1966), J. Appl. Mech. 33(4), https://doi.org/10.1115/1.3625199.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.laws import Forces, Law
from hbgear.mechanics.laws.slider import Slider
from hbgear.mechanics.series.fourier import Series, real_numbers


class _Sliders(Law):
    """Law that consists of sliders only."""

    piecewise = ()

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """Return the part of the force without memory, zero."""
        rest = np.zeros_like(d)
        return rest, rest, rest


@dataclass(frozen=True)
class Jenkins(_Sliders):  # numpydoc ignore=PR02
    """Elastic dry friction: a spring in series with a Coulomb slider.

        f = k (d - z),   |f| <= limit(tau)
        limit(tau) = limit + sum_l cosine[l-1] cos(l tau) + sine[l-1] sin(l tau)

    The position z of the slider rests while it sticks. While it slips, z follows d with |f| = limit.

    Parameters
    ----------
    k : float
        Stiffness while the slider sticks, > 0 [force / length].
    limit : float
        Friction limit (coefficient of friction times normal force), > 0, its mean if it varies [force].
    residual : float, optional
        Position of the slider before the motion [length]. A motion in which the slider never slips depends on it.
        Default 0: the motion is reached from rest without a residual force.
    cosine, sine : tuple of float, optional
        Harmonics of a limit that is prescribed over the phase tau of the excitation [force]. Default: none.

    Raises
    ------
    ValueError
        If k or the limit is not positive, the limit becomes negative in the period, or a number is not finite.

    Notes
    -----
    Where a slider slips, the periodic motion does not depend on the residual position. Where it never slips, each
    residual position has its own motion: they are a family, and the stability of the motion is "neutral".

    References
    ----------
    Jenkins (1962), ASME paper 62-MECH.
    Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.

    Examples
    --------
    >>> import hbgear as hb
    >>> damper = hb.Element([1.0], hb.mechanics.Jenkins(k=1.0, limit=0.04), name="damper")
    >>> blade = hb.System([[1.0]], [[0.02]], [[1.0]], [damper], hb.Load(cosine={1: [0.05]}))
    >>> curve = hb.trace(hb.HarmonicBalance(blade, 3), "Omega", (0.8, 1.6))
    >>> sorted(set(curve.regimes))
    ['gross_slip', 'stick']
    """

    k: float
    limit: float
    residual: float = 0.0
    cosine: tuple[float, ...] = ()
    sine: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        checked("Jenkins", "k", self.k, POSITIVE)
        checked("Jenkins", "limit", self.limit, POSITIVE)
        checked("Jenkins", "residual", self.residual)
        series = Series(self.limit, self.cosine, self.sine)
        object.__setattr__(self, "cosine", series.cosine)
        object.__setattr__(self, "sine", series.sine)
        if series.varies:
            Slider(self.k, self.limit, self.residual, self.cosine, self.sine)

    @cached_property
    def sliders(self) -> tuple[Slider, ...]:
        return (Slider(self.k, self.limit, self.residual, self.cosine, self.sine),)


@dataclass(frozen=True)
class ContactFriction(_Sliders):  # numpydoc ignore=PR02
    """Elastic dry friction of a contact, whose limit is proportional to the force of another element.

        f = k (d - z),   |f| <= friction |N|

    N is the force of the element ``normal`` without its damper, a piecewise-linear spring of constant stiffness such as
    `Unilateral`. Where the contact is open, the limit and the force are zero, and z = d.

    Parameters
    ----------
    k : float
        Stiffness while the slider sticks, > 0 [force / length].
    friction : float
        Coefficient of friction, > 0.
    normal : str
        Name of the element whose force is the normal force.
    residual : float, optional
        Position of the slider before the motion [length], see `Jenkins`. Default 0.

    Raises
    ------
    ValueError
        If k or the coefficient of friction is not positive, a number is not finite, or the name is empty. A `System`
        raises an error for an element that does not exist, or whose force has another form.

    References
    ----------
    Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868.

    Examples
    --------
    >>> import hbgear as hb
    >>> stop = hb.Element([0.0, 1.0], hb.Unilateral(k=2.0, gap=-0.1), name="stop")
    >>> rub = hb.Element([1.0, 0.0], hb.mechanics.ContactFriction(k=5.0, friction=0.3, normal="stop"), name="rub")
    >>> M, C, load = [[1.0, 0.0], [0.0, 1.0]], [[0.1, 0.0], [0.0, 0.1]], hb.Load(cosine={1: [0.3, 0.2]})
    >>> foot = hb.System(M, C, M, [stop, rub], load)
    >>> curve = hb.trace(hb.HarmonicBalance(foot, 5), "Omega", (0.6, 0.65))
    >>> sorted(set(curve.regimes))
    ['gross_slip']
    """

    k: float
    friction: float
    normal: str
    residual: float = 0.0

    def __post_init__(self) -> None:
        checked("ContactFriction", "k", self.k, POSITIVE)
        checked("ContactFriction", "friction", self.friction, POSITIVE)
        checked("ContactFriction", "residual", self.residual)
        if not isinstance(self.normal, str) or not self.normal:
            raise ValueError(
                f"ContactFriction: normal = {quoted(self.normal)} must be the name of the element whose force is the "
                "normal force, such as normal='stop' for Element(..., name='stop')"
            )

    @cached_property
    def sliders(self) -> tuple[Slider, ...]:
        return (Slider(self.k, self.friction, self.residual, normal=self.normal),)


def Coulomb(limit: float, k: float, residual: float = 0.0) -> Jenkins:
    """Return dry friction with a stiff contact: Coulomb's law with a stated stiffness.

        f = limit sign(d')   for   limit / k << amplitude

    Parameters
    ----------
    limit : float
        Friction limit, > 0 [force].
    k : float
        Stiffness of the contact while it sticks, > 0 [force / length]. The force changes its sign over a displacement
        of 2 limit / k, which takes a time of 2 (limit / (k a))^1/2 at a turning point with the acceleration a. The
        motion differs from that of a rigid contact in proportion to this time: at limit / k = 1e-3 of the amplitude by
        up to 10 %, and half as much with four times the stiffness.
    residual : float, optional
        Position of the slider before the motion [length], see `Jenkins`. Default 0.

    Returns
    -------
    Jenkins
        The law.

    Raises
    ------
    ValueError
        If the limit or k is not positive, or a number is not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.mechanics.Coulomb(limit=0.1, k=1e3)
    Jenkins(k=1000.0, limit=0.1, residual=0.0, cosine=(), sine=())
    """
    checked("Coulomb", "k", k, POSITIVE)
    checked("Coulomb", "limit", limit, POSITIVE)
    return Jenkins(k, limit, residual)


@dataclass(frozen=True)
class RigidFriction(Law):  # numpydoc ignore=PR02
    """Rigid dry friction with a static and a kinetic limit on a surface that moves at a constant speed.

        slip:   f = kinetic sign(d' - speed)
        stick:  d' = speed,   |f| <= static

    Parameters
    ----------
    static : float
        Largest friction force while the element sticks, at least ``kinetic`` [force].
    kinetic : float
        Friction force while it slips, > 0 [force].
    speed : float, optional
        Speed of the surface, such as a belt or a disc [length / time]. Default 0.

    Raises
    ------
    ValueError
        If the kinetic limit is not positive or exceeds the static one, or a number is not finite.

    Notes
    -----
    `hbgear.time.integrate` and `hbgear.time.shoot` compute the instants of slip and stick exactly: a sticking element
    is a constraint. A harmonic balance refuses the law, because its force jumps between an unknown value and the
    kinetic limit; `Coulomb` and `Jenkins` have one limit and a stiffness, and can be balanced.

    References
    ----------
    Den Hartog (1931), Trans. ASME 53, 107-115. Leine, van Campen, de Kraker & van den Steen (1998), Nonlinear Dyn.
    16, 41-54, https://doi.org/10.1023/A:1008289604683.

    Examples
    --------
    A mass on a belt. It sticks for a time of 2 in each cycle of 2 + 3 pi / 2.

    >>> import hbgear as hb
    >>> import numpy as np
    >>> belt = hb.Element([1.0], hb.mechanics.RigidFriction(static=1.0, kinetic=0.7, speed=0.3), name="belt")
    >>> mass = hb.System([[1.0]], [[0.0]], [[1.0]], [belt])
    >>> motion = hb.time.integrate(mass, [0.0, 0.0], 5, 1.0)
    >>> np.diff(motion.switches[-3:]).round(6).tolist()
    [4.712389, 2.0]
    """

    static: float
    kinetic: float
    speed: float = 0.0

    def __post_init__(self) -> None:
        checked("RigidFriction", "kinetic", self.kinetic, POSITIVE)
        checked("RigidFriction", "static", self.static)
        checked("RigidFriction", "speed", self.speed)
        if self.static < self.kinetic:
            raise ValueError(
                f"RigidFriction: static = {self.static:g} must be at least kinetic = {self.kinetic:g}, because a force "
                "that rises when slip begins would stop it"
            )

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """Return the friction force while the element slips; zero at the speed of the surface, where it sticks."""
        rest = np.zeros_like(d)
        return self.kinetic * np.sign(v - self.speed), rest, rest


@dataclass(frozen=True)
class Iwan(_Sliders):  # numpydoc ignore=PR02
    """Distributed dry friction: several Jenkins elements in parallel, which begin to slip one after the other.

        f = sum_i k_i (d - z_i),   |k_i (d - z_i)| <= limit_i

    Parameters
    ----------
    k : tuple of float
        Stiffness of each slider, > 0 [force / length].
    limit : tuple of float
        Friction limit of each slider, > 0 [force].

    Raises
    ------
    ValueError
        If the tuples have different lengths or are empty, or a number is not positive and finite.

    References
    ----------
    Iwan (1966), J. Appl. Mech. 33(4), https://doi.org/10.1115/1.3625199.
    Segalman (2005), J. Appl. Mech. 72(5), https://doi.org/10.1115/1.1989355, for joints.

    Examples
    --------
    >>> import hbgear as hb
    >>> joint = hb.mechanics.Iwan.uniform(k=2.0, limit=0.3, number=4)
    >>> [round(slider.limit / slider.k, 4) for slider in joint.sliders]
    [0.0375, 0.1125, 0.1875, 0.2625]
    >>> round(sum(slider.limit for slider in joint.sliders), 12)
    0.3
    """

    k: tuple[float, ...]
    limit: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("k", "limit"):
            row = real_numbers(f"Iwan: {name}", getattr(self, name), "a sequence of numbers")
            if row.ndim != 1 or not row.size or not (np.isfinite(row) & (row > 0)).all():
                raise ValueError(f"Iwan: {name} = {quoted(getattr(self, name))} must be a sequence of positive numbers")
            object.__setattr__(self, name, tuple(row.tolist()))
        if len(self.k) != len(self.limit):
            raise ValueError(f"Iwan: {len(self.k)} stiffnesses k and {len(self.limit)} limits; give one of each slider")

    @staticmethod
    def uniform(k: float, limit: float, number: int = 10) -> Iwan:
        """Return sliders of equal stiffness whose slip displacements are spread evenly from zero.

        Parameters
        ----------
        k : float
            Stiffness of all sliders together, > 0 [force / length].
        limit : float
            Friction limit of all sliders together, > 0 [force].
        number : int, optional
            Number of sliders, at least 1. Default 10.

        Returns
        -------
        Iwan
            The law; the sliders slip at (i - 1/2) 2 limit / (number k), i = 1 .. number.

        Raises
        ------
        ValueError
            If k or the limit is not positive, or the number is below 1.
        """
        checked("Iwan.uniform", "k", k, POSITIVE)
        checked("Iwan.uniform", "limit", limit, POSITIVE)
        if number < 1:
            raise ValueError(f"Iwan.uniform: number = {number} sliders; give at least 1")
        fractions = (2 * np.arange(number) + 1) / number**2
        return Iwan((k / number,) * number, tuple((limit * fractions).tolist()))

    @cached_property
    def sliders(self) -> tuple[Slider, ...]:
        return tuple(Slider(k, limit) for k, limit in zip(self.k, self.limit, strict=True))
