"""A friction slider, the part of a force law with memory.

    f = k (d - z),   |f| <= limit

The limit is constant, prescribed over the phase, or proportional to the normal force N(d_n) of another element:

    limit(tau) = limit + sum_l cosine[l-1] cos(l tau) + sine[l-1] sin(l tau)
    limit(tau) = friction |N(d_n(tau))|

`Law.sliders` lists the sliders of a law; `hbgear.mechanics.laws.friction` has the laws. `friction_limits` returns the
limits of the sliders of a system in one form, piecewise linear in d_n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked
from hbgear.common.text.messages import did_you_mean
from hbgear.mechanics.series.fourier import Series


@dataclass(frozen=True)
class Slider:  # numpydoc ignore=PR02
    """Spring in series with a Coulomb slider.

    Parameters
    ----------
    k : float
        Stiffness while the slider sticks, > 0 [force / length].
    limit : float
        Friction limit, > 0, its mean if it varies [force]. With ``normal`` the coefficient of friction, > 0 [-].
    residual : float, optional
        Position z of the slider before the motion [length]. Default 0.
    cosine, sine : tuple of float, optional
        Harmonics of a limit that varies with the phase tau [force]. Default: none.
    normal : str, optional
        Name of the element whose force is the normal force. Default: none, the limit does not depend on the motion.

    Raises
    ------
    ValueError
        If k or the limit is not positive, a limit becomes negative in the period, a limit is prescribed and
        proportional to a normal force, or a number is not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.mechanics.Jenkins(k=2.0, limit=1.0).sliders[0].reach
    0.5
    """

    k: float
    limit: float
    residual: float = 0.0
    cosine: tuple[float, ...] = ()
    sine: tuple[float, ...] = ()
    normal: str = ""

    def __post_init__(self) -> None:
        checked("Slider", "k", self.k, POSITIVE)
        checked("Slider", "limit", self.limit, POSITIVE)
        checked("Slider", "residual", self.residual)
        series = self.series
        if series.varies and self.normal:
            raise ValueError(
                f"Slider: the limit is prescribed over the period and proportional to the force of '{self.normal}'; "
                "give cosine and sine, or normal"
            )
        low = series.extremes()[0]
        if low < -_LIMIT_ROUNDING * self.limit:
            tau = np.linspace(0.0, 2 * np.pi, 721)
            x = float(tau[np.argmin(series(tau))])
            raise ValueError(
                f"the friction limit becomes negative in the period: {low:.4g} near tau = {x:.3g} rad; it must be at "
                "least 0 throughout: give a larger mean limit, or smaller harmonics cosine and sine"
            )

    @property
    def series(self) -> Series:
        """Limit over the phase [force]."""
        return Series(self.limit, tuple(self.cosine), tuple(self.sine))

    @property
    def reach(self) -> float:
        """Mean of the largest distance |d - z|, limit / k [length]; 0 if it depends on a normal force."""
        return 0.0 if self.normal else self.limit / self.k


_LIMIT_ROUNDING = 1e-12
"""Negative limit, over the mean one, that counts as zero [-]: rounding of its harmonics."""


@dataclass(frozen=True)
class FrictionLimit:
    """Limit of a slider, piecewise linear in the displacement of an element: gain[i] d_n + base[i] + wave(tau).

    Attributes
    ----------
    normal : int
        Number of the element of d_n; -1 without one.
    level : tuple of float
        Values of d_n between the zones, ascending; zone i is below level[i].
    gain, base : tuple of float
        Slope and constant of each zone; a limit of both 0 belongs to an open contact.
    wave : Series
        Limit over the phase without its mean.
    """

    normal: int
    level: tuple[float, ...]
    gain: tuple[float, ...]
    base: tuple[float, ...]
    wave: Series


def friction_limits(elements: Sequence[Any]) -> list[tuple[int, Slider, FrictionLimit]]:
    """Return all sliders of elements: the number of the element, the slider and its limit.

    Raises
    ------
    ValueError
        If a normal force belongs to an element that does not exist, or to one whose force is not one piecewise-linear
        spring of constant stiffness.
    """
    return [(j, x, _limit_of(x, j, elements)) for j, element in enumerate(elements) for x in element.law.sliders]


def _limit_of(slider: Slider, j: int, elements: Sequence[Any]) -> FrictionLimit:
    """Return the limit of a slider of element j."""
    if not slider.normal:
        wave = Series(0.0, tuple(slider.cosine), tuple(slider.sine))
        return FrictionLimit(-1, (), (0.0,), (slider.limit,), wave)
    names = [element.name for element in elements]
    text = f"element '{names[j]}' has friction with the normal force of element '{slider.normal}'"
    if names.count(slider.normal) != 1:
        hint = did_you_mean(slider.normal, names) if slider.normal not in names else "; several elements have this name"
        raise ValueError(f"{text}, which must be one element of the system{hint}")
    normal = names.index(slider.normal)
    law, displacement = elements[normal].law, elements[normal].displacement
    springs: Sequence[Any] = law.piecewise or ()
    if len(springs) != 1 or springs[0].stiffness.varies or law.sliders or displacement.corners:
        raise ValueError(
            f"{text}, whose force must be one piecewise-linear spring of constant stiffness without friction, with a "
            "displacement without breakpoints: use Unilateral, Backlash or PiecewiseLinear there"
        )
    g0, changes, corners = springs[0].ramps
    slopes = np.array(springs[0].slopes, dtype=float)
    offsets = g0 - np.concatenate([[0.0], np.cumsum(changes * corners)])
    edges = [-np.inf, *corners.tolist(), np.inf]
    zeros = [-b / a if a else np.nan for a, b in zip(slopes.tolist(), offsets.tolist(), strict=True)]
    inside = {x for x, low, high in zip(zeros, edges[:-1], edges[1:], strict=True) if low < x < high}
    level = tuple(sorted({*corners.tolist(), *inside}))
    middle = _middles(level)
    zone = np.searchsorted(corners, middle)
    sign = np.sign(slopes[zone] * middle + offsets[zone])
    factor = slider.limit * springs[0].stiffness.mean * sign
    return FrictionLimit(
        normal, level, tuple((factor * slopes[zone]).tolist()), tuple((factor * offsets[zone]).tolist()), Series()
    )


def _middles(level: Sequence[float]) -> Array:
    """Return a value in each zone between levels."""
    if not level:
        return np.zeros(1)
    x = np.array(level)
    return np.concatenate([[x[0] - 1.0], 0.5 * (x[1:] + x[:-1]), [x[-1] + 1.0]])


def limit_at(limit: FrictionLimit, d: Array | None, tau: Array) -> Array:
    """Return a friction limit at displacements d of the element of its normal force, None without one, and phases."""
    if d is None or limit.normal < 0:
        return limit.base[0] + limit.wave(tau)
    zone = np.searchsorted(np.array(limit.level), d)
    return np.array(limit.gain)[zone] * d + np.array(limit.base)[zone]


def first_loading(slider: Slider, d: Array, limit: float) -> tuple[Array, Array]:
    """Return the force and stiffness of a slider at displacements d that are reached monotonically from rest.

    ``limit`` is the friction limit in the state. The stiffness is zero where the slider slips.
    """
    force = slider.k * (d - slider.residual)
    return np.clip(force, -limit, limit), slider.k * (np.abs(force) <= limit)


def steady_force(slider: Slider, d: Array, limit: Array) -> Array:
    """Return the force (N,) of a slider over a period of its displacement, after the position has become periodic.

    The displacement d [length] and the friction ``limit`` [force] are given at N equidistant phases. The position of a
    step is z -> min(max(z, lower), upper). Steps one after the other have the same form, so that the bounds of 1, 2, 4,
    ... steps follow from each other.
    """
    lower, upper = (np.tile(d + side * limit / slider.k, 2) for side in (-1, 1))
    steps = 1
    while steps < len(lower):
        before = lower[:-steps], upper[:-steps]
        lower[steps:], upper[steps:] = (np.clip(x, lower[steps:], upper[steps:]) for x in before)
        steps *= 2
    z = np.clip(slider.residual, lower, upper)[len(d) :]
    return slider.k * (d - z)
