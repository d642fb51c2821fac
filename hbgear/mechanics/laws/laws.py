"""Scalar force laws p(d, v, tau) of an element, with both derivatives.

``d`` is the element coordinate, ``v`` its time derivative (per unit of time, not of phase), ``tau`` the phase of
the excitation. A law must be continuous in ``d`` and ``v``; its derivatives may jump.

Contract for a new law
----------------------
1. A frozen dataclass that derives from `Law`.
2. ``force(d, v, tau)`` accepts arrays of one shape and returns ``(p, dp/dd, dp/dv)`` of that shape.
3. ``reference`` is a typical positive stiffness [force / length]; it only conditions the linear algebra and never
   changes a result. 0, the default, if the law states none: then it is computed from the structure and its loads.
4. ``breakpoints`` lists the values of ``d`` at which a derivative jumps: the period is cut there for stability.
5. ``rated`` may be False if ``p`` does not depend on ``v``: then no velocity is computed for it, and v is all zeros.
6. ``piecewise`` may give the law as a sum of piecewise-linear springs, p = sum_i k_i(tau) g_i(d), whose forces add up
   to ``force``. Then harmonic balance projects it exactly instead of sampling it, folds are found by Newton, and where
   the sum is a single spring, time integration takes its straight pieces. Rules 4 and 5 then need not be stated.
7. ``phases`` lists the phases tau at which ``p`` or one of its derivatives jumps: the period is cut there, too.
8. ``parts`` lists the laws it is the sum of, if it is one; ``steady`` is whether ``p`` is known not to depend on
   ``tau``. They serve warnings and the choice of a time step, and change no result.

A law of your own that is projected exactly:

>>> import hbgear as hb
>>> from dataclasses import dataclass
>>> @dataclass(frozen=True)
... class TwoStage(hb.mechanics.Law):
...     "A spring of stiffness k that a stiffer one joins beyond a gap."
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

from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, checked
from hbgear.common.text.messages import quoted
from hbgear.mechanics.series.fourier import Series, is_listed, real_numbers
from hbgear.mechanics.series.periodic import Periodic, Phased

Forces = tuple[Array, Array, Array]


_ONE = Series(mean=1.0)


def _phased(owner: str, stiffness: Phased) -> None:
    if not isinstance(stiffness, Phased):
        raise ValueError(
            f"{owner}: stiffness = {quoted(stiffness)} must be a Series such as Series(mean=1.0, cosine=(0.1,)), or a "
            "Periodic such as Periodic.rectangular(high=1.2, low=0.8, share=0.6)"
        )


def checked_contact(owner: str, stiffness: Phased) -> None:
    """Refuse a contact stiffness that is no periodic function, or a table of one that is not positive.

    Raises
    ------
    ValueError
    """
    _phased(owner, stiffness)
    if isinstance(stiffness, Periodic) and stiffness.extremes()[0] <= 0:
        raise ValueError(
            f"{owner}: the stiffness goes down to {stiffness.extremes()[0]:.4g}; teeth in contact push, so it must be "
            "positive throughout: see the values of the table (a spline may overshoot between them: kind='linear')"
        )


class Law(ABC):
    """Scalar law p(d, v, tau); see the module's contract.

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
        """Force and its derivatives ``(p, dp/dd, dp/dv)``, each of the shape of ``d``."""

    @property
    def reference(self) -> float:
        """Typical stiffness [force / length]; 0 if the law states none."""
        return max((spring.reference for spring in self.piecewise or ()), default=0.0)

    @property
    def piecewise(self) -> tuple[PiecewiseLinear, ...] | None:
        """Piecewise-linear springs whose sum the law is, p = sum_i k_i(tau) g_i(d); None if it is not such a sum."""
        return None

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
        """Whether p may depend on v."""
        return self.piecewise is None

    @property
    def parts(self) -> tuple[Law, ...]:
        """The laws it is the sum of; itself if it is none."""
        return (self,)

    @property
    def steady(self) -> bool:
        """Whether p is known not to depend on tau."""
        return self.piecewise is not None and not any(spring.stiffness.varies for spring in self.piecewise)

    def bind(self, tau: Array) -> Callable[[Array, Array], Forces]:
        """The law on a fixed grid of phases, so that what depends on tau alone is evaluated once."""
        return lambda d, v: self.force(d, v, tau)


@dataclass(frozen=True)
class Cubic(Law):
    """Cubic spring.

        p(d) = k1 d + k3 d^3

    Parameters
    ----------
    k3 : cubic coefficient [force / length^3], of either sign.
    k1 : linear coefficient [force / length].

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

    @property
    def rated(self) -> bool:
        return False

    @property
    def steady(self) -> bool:
        return True

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        d2 = d * d
        return (self.k1 + self.k3 * d2) * d, self.k1 + 3 * self.k3 * d2, np.zeros_like(d)


@dataclass(frozen=True)
class PiecewiseLinear(Law):
    """Continuous piecewise-linear spring times a periodic stiffness.

        p(d, tau) = stiffness(tau) g(d),   dg/dd = slopes[i] between corners[i-1] and corners[i],   g(0) = force_at_zero

    Written with one ramp per corner, g(d) = g0 + slopes[0] d + sum_i (slopes[i+1] - slopes[i]) max(d - corners[i], 0),
    which is what the exact contact projection uses.

    Parameters
    ----------
    corners : (p,) ascending values of d where the slope changes.
    slopes : (p + 1,) stiffness left of, between and right of the corners.
    force_at_zero : g(0).
    stiffness : `Series` or `Periodic` in tau (default 1).

    Raises
    ------
    ValueError
        If the corners do not ascend, the numbers do not fit or are not finite.

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
    stiffness: Phased = _ONE

    def __post_init__(self) -> None:
        for name in ("corners", "slopes"):
            row = real_numbers(f"PiecewiseLinear: {name}", getattr(self, name), "a sequence of numbers")
            if row.ndim != 1:
                raise ValueError(
                    f"PiecewiseLinear: {name} = {quoted(getattr(self, name))} must be a sequence of numbers"
                )
            object.__setattr__(self, name, tuple(row.tolist()))
        checked("PiecewiseLinear", "force_at_zero", self.force_at_zero)
        _phased("PiecewiseLinear", self.stiffness)
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
        """``(g0, changes, corners)`` of the ramp form: g0 as above, changes (p,) of slope, corners (p,)."""
        changes = np.diff(self.slopes)
        corners = np.array(self.corners)
        return self.force_at_zero - float(changes @ np.maximum(-corners, 0.0)), changes, corners

    def _shape(self, d: Array) -> tuple[Array, Array]:
        g0, changes, corners = self.ramps
        g, slope = g0 + self.slopes[0] * d, np.full_like(d, self.slopes[0])
        for change, corner in zip(changes, corners, strict=True):
            over = d > corner
            g += change * np.where(over, d - corner, 0.0)
            slope += change * over
        return g, slope

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        return self.bind(tau)(d, v)

    def bind(self, tau: Array) -> Callable[[Array, Array], Forces]:
        k: Array | float = self.stiffness(tau) if self.stiffness.varies else self.stiffness.mean

        def forces(d: Array, v: Array) -> Forces:
            g, slope = self._shape(d)
            return k * g, k * slope, np.zeros_like(d)

        return forces


def Backlash(b: float = 1.0, k: float = 1.0, stiffness: Phased = _ONE) -> PiecewiseLinear:
    """Backlash spring with half-gap b.

        p(d, tau) = k stiffness(tau) f(d),   f(d) = d - b (d > b),  0 (|d| <= b),  d + b (d < -b)

    Parameters
    ----------
    b : half backlash, >= 0 [unit of d]; 0 gives the linear spring.
    k : contact stiffness, > 0 [force / length].
    stiffness : periodic factor of mean about 1, a `Series` or a `Periodic`.

    Raises
    ------
    ValueError
        If b is negative, k not positive, or either not finite, or a `Periodic` stiffness is not positive throughout.

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


def Unilateral(k: float = 1.0, gap: float = 0.0, stiffness: Phased = _ONE) -> PiecewiseLinear:
    """One-sided spring (a stop) that is met at d = gap.

        p(d, tau) = k stiffness(tau) max(d - gap, 0)

    Parameters
    ----------
    k : contact stiffness, > 0.
    gap : clearance; negative for a preloaded stop.
    stiffness : periodic factor of mean about 1, a `Series` or a `Periodic`.

    Raises
    ------
    ValueError
        If k is not positive or gap not finite, or a `Periodic` stiffness is not positive throughout.

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
class Parallel(Law):
    """Several laws acting side by side on one element.

        p(d, v, tau) = sum_i laws[i](d, v, tau)

    If each of them is piecewise linear, so is the sum, and it is projected exactly; springs whose stiffness varies in
    the same way are one spring. With any other law among them all of it is sampled.

    Parameters
    ----------
    laws : one or more.

    Raises
    ------
    ValueError
        If there are none, or one is no law.

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
            parts = [law(d, v) for law in bound]
            return sum(p[0] for p in parts), sum(p[1] for p in parts), sum(p[2] for p in parts)  # type: ignore[return-value]

        return forces


def springs_of(law: Law) -> tuple[tuple[PiecewiseLinear, ...], float, float] | None:
    """Piecewise-linear springs, and k1 and k3 of a cubic one, that the law is the sum of; None if it is no such sum."""
    if type(law) is Cubic:
        return (), law.k1, law.k3
    if law.piecewise is not None:
        return law.piecewise, 0.0, 0.0
    if type(law) is not Parallel:
        return None
    springs: tuple[PiecewiseLinear, ...] = ()
    k1 = k3 = 0.0
    for part in law.laws:
        found = springs_of(part)
        if found is None:
            return None
        springs, k1, k3 = springs + found[0], k1 + found[1], k3 + found[2]
    return springs, k1, k3


def _merged(springs: Iterable[PiecewiseLinear]) -> tuple[PiecewiseLinear, ...]:
    """The same sum with the springs of one stiffness variation as one spring each."""
    found: list[PiecewiseLinear] = []
    for spring in springs:
        for i, other in enumerate(found):
            ratio = _ratio(spring.stiffness, other.stiffness)
            if ratio is not None:
                found[i] = _added(other, spring, ratio)
                break
        else:
            found.append(spring)
    return tuple(found)


def _ratio(a: Phased, b: Phased) -> float | None:
    """The number r with a = r b to rounding; None if there is none."""
    if isinstance(a, Periodic) and isinstance(b, Periodic):
        if a.phases != b.phases or [*map(len, a.coefficients)] != [*map(len, b.coefficients)]:
            return None
        x, y = (np.concatenate(each.coefficients) for each in (a, b))
    elif isinstance(a, Series) and isinstance(b, Series):
        L = max(a.order, b.order)
        x, y = (np.pad(series.row(), (0, 2 * (L - series.order))) for series in (a, b))
    else:
        return None
    largest = int(np.argmax(np.abs(y)))
    ratio = float(x[largest] / y[largest]) if y[largest] else 0.0
    return ratio if np.allclose(x, ratio * y, rtol=0, atol=4 * np.finfo(float).eps * np.abs(x).max()) else None


def _added(a: PiecewiseLinear, b: PiecewiseLinear, ratio: float) -> PiecewiseLinear:
    """stiffness_a (g_a + ratio g_b) as one spring."""
    corners = tuple(sorted({*a.corners, *b.corners}))
    slopes = [a.slopes[0] + ratio * b.slopes[0]]
    for x in corners:
        i, j = (bisect_right(spring.corners, x) for spring in (a, b))  # the pieces to the right of x
        slopes.append(a.slopes[i] + ratio * b.slopes[j])
    return PiecewiseLinear(corners, tuple(slopes), a.force_at_zero + ratio * b.force_at_zero, a.stiffness)
