"""Scalar force laws p(d, v, tau) of an element, with both derivatives.

``d`` is the element coordinate, ``v`` its time derivative (per unit of time, not of phase), ``tau`` the phase of the
excitation. A law must be continuous in ``d`` and ``v``; its derivatives may jump. Contacts with dampers are the
exception, see rule 9.

Notes
-----
Contract for a new law:

1. A frozen dataclass derived from `Law`, registered by `hbgear.mechanics.register_law` so that files can hold it.
2. ``force(d, v, tau)`` accepts arrays of one shape and returns ``(p, dp/dd, dp/dv)`` of that shape.
3. ``reference`` is a typical positive stiffness [force / length]. It conditions the linear algebra and never changes a
   result. The default 0 means that it is computed from the structure and its loads.
4. ``breakpoints`` lists the values of ``d`` at which a derivative jumps: the period is divided there for stability.
5. ``rated`` may be False if ``p`` does not depend on ``v``: then no velocity is computed, and v is zero.
6. ``piecewise`` may return the law as a sum of piecewise-linear springs, p = sum_i k_i(tau) g_i(d), equal to ``force``.
   Then harmonic balance projects it exactly instead of sampling it, folds are located by Newton's method, and time
   integration of a single spring uses its linear segments. Rules 4 and 5 then follow from the springs.
7. ``phases`` lists the phases tau at which ``p`` or one of its derivatives jumps: the period is divided there, too.
8. ``sliders`` lists the friction sliders of a law with memory. Their forces, which depend on the history of d, are
   added to ``force``, and they are projected exactly.
9. ``damped`` lists the contacts with a damper whose force jumps. Their sum must be the whole of ``force``; they are
   projected exactly, and stability accounts for the jumps. All other laws must be continuous in ``v`` and ``d``.
10. ``parts`` lists the laws of a sum; ``steady`` is True if ``p`` does not depend on ``tau``. They serve warnings and
    the choice of a time step, and change no result.

Examples
--------
A law of the user that is projected exactly:

>>> import hbgear as hb
>>> from dataclasses import dataclass
>>> @hb.mechanics.register_law
... @dataclass(frozen=True)
... class TwoStage(hb.mechanics.Law):
...     "A spring of stiffness k, with a stiffer spring in parallel beyond a gap."
...     k: float
...     gap: float
...
...     @property
...     def piecewise(self):
...         return (hb.mechanics.PiecewiseLinear((self.gap,), (self.k, 10 * self.k)),)
...
...     def force(self, d, v, tau):
...         return self.piecewise[0].force(d, v, tau)
>>> TwoStage(1.0, 0.5).breakpoints
(0.5,)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbgear.common.argument_checks import NamedFields
from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, checked
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.damped_contact import DampedContact
from hbgear.mechanics.laws.slider import Slider
from hbgear.mechanics.series.fourier import Series, is_listed, real_numbers
from hbgear.mechanics.series.periodic import Periodic, Phased

Forces = tuple[Array, Array, Array]


_CONSTANT_STIFFNESS = Series(mean=1.0)


def _check_stiffness(owner: str, stiffness: Phased) -> None:
    """Raise ValueError for a stiffness that is not a periodic function."""
    if not isinstance(stiffness, Phased):
        raise ValueError(
            f"{owner}: stiffness = {quoted(stiffness)} must be a Series such as Series(mean=1.0, cosine=(0.1,)), or a "
            "Periodic such as Periodic.rectangular(high=1.2, low=0.8, share=0.6)"
        )


def checked_contact(owner: str, stiffness: Phased) -> None:
    """Raise ValueError for a contact stiffness that is not a periodic function, or a table that is not positive."""
    _check_stiffness(owner, stiffness)
    if isinstance(stiffness, Periodic) and stiffness.extremes()[0] <= 0:
        raise ValueError(
            f"{owner}: the stiffness has the minimum {stiffness.extremes()[0]:.4g}; teeth in contact push, so it must "
            "be positive throughout: correct the values of the table (a spline may overshoot: use kind='linear')"
        )


class Law(NamedFields, ABC):
    """Scalar force law p(d, v, tau); see the contract in the header of the module.

    Examples
    --------
    >>> import hbgear as hb
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Quintic(hb.mechanics.Law):
    ...     k5: float = 1.0
    ...
    ...     def force(self, d, v, tau):
    ...         return self.k5 * d**5, 5 * self.k5 * d**4, 0 * d
    ...
    >>> bar = hb.System([[1.0]], [[0.1]], [[1.0]], [hb.Element([1.0], Quintic())], hb.Load(cosine={1: [0.2]}))
    >>> curve = hb.trace(hb.HarmonicBalance(bar, 5), "Omega", (0.5, 0.7))
    >>> curve.message
    'Omega = 0.7 reached'
    """

    @abstractmethod
    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """Return the force and its derivatives.

        Parameters
        ----------
        d : ndarray
            Element coordinate [length].
        v : ndarray
            Time derivative of the coordinate, of the shape of ``d``.
        tau : ndarray
            Phase of the excitation [rad], of the shape of ``d``.

        Returns
        -------
        tuple of ndarray
            Force p, dp/dd and dp/dv, each of the shape of ``d``.
        """

    @property
    def reference(self) -> float:
        """Typical stiffness [force / length]; 0 if it is to be computed from the structure and its loads."""
        springs = max((spring.reference for spring in self.piecewise or ()), default=0.0)
        return springs + sum(slider.k for slider in self.sliders)

    @property
    def piecewise(self) -> tuple[PiecewiseLinear, ...] | None:
        """Piecewise-linear springs whose sum is the law, p = sum_i k_i(tau) g_i(d); None if there are none."""
        return None

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Friction sliders, whose forces are added to ``force``; empty for a law without memory."""
        return ()

    @property
    def damped(self) -> tuple[DampedContact, ...]:
        """Contacts with dampers, whose force jumps and whose sum is the law; empty for a continuous law."""
        return ()

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Values of d, ascending, at which dp/dd or dp/dv jumps."""
        return tuple(sorted({x for spring in self.piecewise or () for x in spring.corners}))

    @property
    def phases(self) -> tuple[float, ...]:
        """Phases tau in [0, 2 pi), ascending, at which p or one of its derivatives jumps."""
        return tuple(sorted({x for spring in self.piecewise or () for x in spring.stiffness.corners}))

    @property
    def rated(self) -> bool:
        """True if p may depend on v."""
        return self.piecewise is None

    @property
    def parts(self) -> tuple[Law, ...]:
        """Laws whose sum is the law; the law itself if it is not a sum."""
        return (self,)

    @property
    def steady(self) -> bool:
        """True if p is known not to depend on tau."""
        return self.piecewise is not None and not any(spring.stiffness.varies for spring in self.piecewise)

    def bind(self, tau: Array) -> Callable[[Array, Array], Forces]:
        """Return the law as a function of d and v on a fixed grid of phases tau, so that k(tau) is evaluated once."""
        return lambda d, v: self.force(d, v, tau)


@dataclass(frozen=True)
class Cubic(Law):  # numpydoc ignore=PR02
    """Cubic spring.

        p(d) = k1 d + k3 d^3

    Parameters
    ----------
    k3 : float
        Cubic coefficient [force / length^3], of either sign.
    k1 : float, optional
        Linear coefficient [force / length]. Default 0.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> force, slope, _ = hb.Cubic(k3=2.0, k1=1.0).force(np.array([0.5]), np.zeros(1), 0.0)
    >>> float(force[0]), float(slope[0])
    (0.75, 2.5)
    """

    k3: float
    k1: float = 0.0

    def __post_init__(self) -> None:
        for name in ("k3", "k1"):
            checked("Cubic", name, getattr(self, name))

    @property
    def reference(self) -> float:
        return abs(self.k1)

    rated = False
    steady = True

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        d2 = d * d
        return (self.k1 + self.k3 * d2) * d, self.k1 + 3 * self.k3 * d2, np.zeros_like(d)


@dataclass(frozen=True)
class PiecewiseLinear(Law):  # numpydoc ignore=PR02
    """Continuous piecewise-linear spring times a periodic stiffness.

        p(d, tau) = stiffness(tau) g(d),   dg/dd = slopes[i] between corners[i-1] and corners[i],   g(0) = force_at_zero

    The exact contact projection uses the form with one ramp per breakpoint,
    g(d) = g0 + slopes[0] d + sum_i (slopes[i+1] - slopes[i]) max(d - corners[i], 0).

    Parameters
    ----------
    corners : tuple of float, length p
        Breakpoints: ascending values of d where the slope changes.
    slopes : tuple of float, length p + 1
        Stiffness left of, between and right of the breakpoints.
    force_at_zero : float, optional
        Value g(0). Default 0.
    stiffness : Series or Periodic, optional
        Periodic factor over tau. Default: the constant 1.

    Raises
    ------
    ValueError
        If the breakpoints do not ascend, their number does not fit the slopes, or a number is not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> law = hb.mechanics.PiecewiseLinear(corners=(0.0, 1.0), slopes=(0.0, 1.0, 3.0))
    >>> law.force(np.array([-1.0, 0.5, 2.0]), 0.0, 0.0)[0].tolist()
    [0.0, 0.5, 4.0]
    """

    corners: tuple[float, ...]
    slopes: tuple[float, ...]
    force_at_zero: float = 0.0
    stiffness: Phased = _CONSTANT_STIFFNESS

    def __post_init__(self) -> None:
        for name in ("corners", "slopes"):
            row = real_numbers(f"PiecewiseLinear: {name}", getattr(self, name), "a sequence of numbers")
            if row.ndim != 1:
                raise ValueError(
                    f"PiecewiseLinear: {name} = {quoted(getattr(self, name))} must be a sequence of numbers"
                )
            object.__setattr__(self, name, tuple(row.tolist()))
        checked("PiecewiseLinear", "force_at_zero", self.force_at_zero)
        _check_stiffness("PiecewiseLinear", self.stiffness)
        if len(self.slopes) != len(self.corners) + 1:
            raise ValueError(
                f"{len(self.corners)} corners separate {len(self.corners) + 1} slopes, got {len(self.slopes)} slopes"
            )
        if not np.all(np.isfinite([*self.corners, *self.slopes])):
            raise ValueError(f"PiecewiseLinear needs finite corners and slopes, got {self}")
        if any(b < a for a, b in zip(self.corners, self.corners[1:], strict=False)):
            raise ValueError(f"corners must ascend, got {self.corners}")

    @property
    def reference(self) -> float:
        return max((abs(s) for s in self.slopes), default=0.0) * (abs(self.stiffness.mean) or 1.0)

    @property
    def piecewise(self) -> tuple[PiecewiseLinear, ...]:
        return (self,)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return self.corners

    @property
    def ramps(self) -> tuple[float, Array, Array]:
        """Coefficients ``(g0, changes, corners)`` of the ramp form: changes (p,) of slope, corners (p,)."""
        changes = np.diff(self.slopes)
        corners = np.array(self.corners)
        return self.force_at_zero - float(changes @ np.maximum(-corners, 0.0)), changes, corners

    def _shape(self, d: Array) -> tuple[Array, Array]:
        """Return g(d) and its slope."""
        g0, changes, corners = self.ramps
        g, slope = g0 + self.slopes[0] * d, np.full_like(d, self.slopes[0])
        for change, level in zip(changes, corners, strict=True):
            above = d > level
            g += change * np.where(above, d - level, 0.0)
            slope += change * above
        return g, slope

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        return self.bind(tau)(d, v)

    def bind(self, tau: Array) -> Callable[[Array, Array], Forces]:
        k: Array | float = self.stiffness(tau) if self.stiffness.varies else self.stiffness.mean

        def forces(d: Array, v: Array) -> Forces:
            g, slope = self._shape(d)
            return k * g, k * slope, np.zeros_like(d)

        return forces


def Backlash(b: float = 1.0, k: float = 1.0, stiffness: Phased = _CONSTANT_STIFFNESS) -> PiecewiseLinear:
    """Return a backlash spring with half backlash b.

        p(d, tau) = k stiffness(tau) f(d),   f(d) = d - b (d > b),  0 (|d| <= b),  d + b (d < -b)

    Parameters
    ----------
    b : float, optional
        Half backlash, >= 0 [unit of d]. Default 1; 0 is the linear spring.
    k : float, optional
        Contact stiffness, > 0 [force / length]. Default 1.
    stiffness : Series or Periodic, optional
        Periodic factor with a mean of about 1. Default: the constant 1.

    Returns
    -------
    PiecewiseLinear
        The law.

    Raises
    ------
    ValueError
        If b is negative, k is not positive, one of them is not finite, or a `Periodic` stiffness is not positive.

    References
    ----------
    Kahraman & Singh (1990), J. Sound Vib. 142(1), eq. (4).

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> law = hb.Backlash(b=1.0, k=2.0)
    >>> law.force(np.array([-1.5, 0.5, 1.5]), 0.0, 0.0)[0].tolist()
    [-1.0, 0.0, 1.0]
    """
    checked("Backlash", "k", k, POSITIVE)
    checked("Backlash", "half backlash b", b, NOT_NEGATIVE)
    checked_contact("Backlash", stiffness)
    if b == 0:
        return PiecewiseLinear((), (k,), stiffness=stiffness)
    return PiecewiseLinear((-b, b), (k, 0.0, k), stiffness=stiffness)


def Unilateral(k: float = 1.0, gap: float = 0.0, stiffness: Phased = _CONSTANT_STIFFNESS) -> PiecewiseLinear:
    """Return a one-sided spring (a stop) that is in contact for d > gap.

        p(d, tau) = k stiffness(tau) max(d - gap, 0)

    Parameters
    ----------
    k : float, optional
        Contact stiffness, > 0 [force / length]. Default 1.
    gap : float, optional
        Clearance [unit of d]; negative for a preloaded stop. Default 0.
    stiffness : Series or Periodic, optional
        Periodic factor with a mean of about 1. Default: the constant 1.

    Returns
    -------
    PiecewiseLinear
        The law.

    Raises
    ------
    ValueError
        If k is not positive, gap is not finite, or a `Periodic` stiffness is not positive.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> stop = hb.Unilateral(k=2.0, gap=1.0)
    >>> stop.force(np.array([0.5, 1.5]), 0.0, 0.0)[0].tolist()
    [0.0, 1.0]
    """
    checked("Unilateral", "k", k, POSITIVE)
    checked("Unilateral", "gap", gap)
    checked_contact("Unilateral", stiffness)
    return PiecewiseLinear((gap,), (0.0, k), force_at_zero=k * max(-gap, 0.0), stiffness=stiffness)


@dataclass(frozen=True)
class Parallel(Law):  # numpydoc ignore=PR02
    """Sum of several laws that act on one element.

        p(d, v, tau) = sum_i laws[i](d, v, tau)

    If each law is piecewise linear, so is the sum, and it is projected exactly; springs with proportional stiffness
    variations are merged into one. With any other law in the sum all of it is sampled, except friction sliders.

    Parameters
    ----------
    laws : sequence of Law
        One or more laws.

    Raises
    ------
    ValueError
        If the sequence is empty, or an entry is not a law or has a force that jumps (`KelvinVoigt`).

    Examples
    --------
    >>> import hbgear as hb
    >>> teeth_and_stop = hb.mechanics.Parallel((hb.Backlash(b=1.0), hb.Unilateral(k=3.0, gap=2.0)))
    >>> teeth_and_stop.piecewise[0].corners, teeth_and_stop.piecewise[0].slopes
    ((-1.0, 1.0, 2.0), (1.0, 0.0, 1.0, 4.0))
    """

    laws: tuple[Law, ...]

    def __post_init__(self) -> None:
        if not is_listed(self.laws):
            raise ValueError(
                f"Parallel: laws = {quoted(self.laws)} must be several laws, such as (Backlash(), Cubic(1.0))"
            )
        object.__setattr__(self, "laws", tuple(self.laws))
        if not all(isinstance(law, Law) for law in self.laws):
            raise ValueError(
                f"Parallel: laws = {quoted(self.laws)} must all be laws, such as Backlash() and Cubic(1.0)"
            )
        if not self.laws:
            raise ValueError("Parallel needs at least one law")
        for law in self.laws:
            if law.damped:
                raise ValueError(
                    f"Parallel: the force of {type(law).__name__} jumps at contact; give it an element of its own with "
                    "the same direction"
                )

    @property
    def reference(self) -> float:
        return sum(law.reference for law in self.laws)

    @cached_property
    def piecewise(self) -> tuple[PiecewiseLinear, ...] | None:
        springs: list[PiecewiseLinear] = []
        for law in self.laws:
            if law.piecewise is None:
                return None
            springs += law.piecewise
        return _merged(springs)

    @property
    def sliders(self) -> tuple[Slider, ...]:
        return tuple(slider for law in self.laws for slider in law.sliders)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return tuple(sorted({x for law in self.laws for x in law.breakpoints}))

    @property
    def phases(self) -> tuple[float, ...]:
        return tuple(sorted({x for law in self.laws for x in law.phases}))

    @property
    def rated(self) -> bool:
        return any(law.rated for law in self.laws)

    @property
    def parts(self) -> tuple[Law, ...]:
        return tuple(part for law in self.laws for part in law.parts)

    @property
    def steady(self) -> bool:
        return all(law.steady for law in self.laws)

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        return self.bind(tau)(d, v)

    def bind(self, tau: Array) -> Callable[[Array, Array], Forces]:
        bound = [law.bind(tau) for law in self.laws]

        def forces(d: Array, v: Array) -> Forces:
            forces = [law(d, v) for law in bound]
            return sum(p[0] for p in forces), sum(p[1] for p in forces), sum(p[2] for p in forces)  # type: ignore[return-value]

        return forces


def springs_of(law: Law) -> tuple[tuple[PiecewiseLinear, ...], float, float] | None:
    """Split a law into piecewise-linear springs and a cubic spring k1, k3; None if it is not a sum of such springs."""
    if type(law) is Cubic:
        return (), law.k1, law.k3
    if law.piecewise is not None:
        return law.piecewise, 0.0, 0.0
    if type(law) is not Parallel:
        return None
    springs: tuple[PiecewiseLinear, ...] = ()
    k1 = k3 = 0.0
    for part in law.laws:
        part_springs = springs_of(part)
        if part_springs is None:
            return None
        springs, k1, k3 = springs + part_springs[0], k1 + part_springs[1], k3 + part_springs[2]
    return springs, k1, k3


def _merged(springs: Iterable[PiecewiseLinear]) -> tuple[PiecewiseLinear, ...]:
    """Return the same sum, with springs of proportional stiffness variations merged into one spring."""
    merged: list[PiecewiseLinear] = []
    for spring in springs:
        for i, sum_ in enumerate(merged):
            ratio = _ratio(spring.stiffness, sum_.stiffness)
            if ratio is not None:
                merged[i] = _sum_of_springs(sum_, spring, ratio)
                break
        else:
            merged.append(spring)
    return tuple(merged)


def _ratio(a: Phased, b: Phased) -> float | None:
    """Return the number r with a = r b to rounding, or None if the functions are not proportional."""
    if isinstance(a, Periodic) and isinstance(b, Periodic):
        if a.phases != b.phases or [*map(len, a.coefficients)] != [*map(len, b.coefficients)]:
            return None
        x, y = (np.concatenate(f.coefficients) for f in (a, b))
    elif isinstance(a, Series) and isinstance(b, Series):
        L = max(a.order, b.order)
        x, y = (np.pad(series.row(), (0, 2 * (L - series.order))) for series in (a, b))
    else:
        return None
    largest = int(np.argmax(np.abs(y)))
    ratio = float(x[largest] / y[largest]) if y[largest] else 0.0
    return ratio if np.allclose(x, ratio * y, rtol=0, atol=4 * np.finfo(float).eps * np.abs(x).max()) else None


def _sum_of_springs(a: PiecewiseLinear, b: PiecewiseLinear, ratio: float) -> PiecewiseLinear:
    """Return stiffness_a (g_a + ratio g_b) as one spring."""
    corners = tuple(sorted({*a.corners, *b.corners}))
    slopes = [a.slopes[0] + ratio * b.slopes[0]]
    for x in corners:
        i, j = (bisect_right(spring.corners, x) for spring in (a, b))  # the segments to the right of x
        slopes.append(a.slopes[i] + ratio * b.slopes[j])
    return PiecewiseLinear(corners, tuple(slopes), a.force_at_zero + ratio * b.force_at_zero, a.stiffness)
