"""Special points of periodic motions as problems of their own: period doubling, grazing contact, peak.

    R(X, p) = 0,   g(X, p) = 0           unknowns U = (X, p)

| class | g |
|---|---|
| PeriodDoubling | bordered determinant of the half-integer block: a multiplier is -1 |
| NeimarkSacker | real part of an exponent, a zero of Hill's determinant: a pair of multipliers is on the unit circle |
| Grazing | extremum of an element minus a corner of its law: the impact regime changes |
| Peak | derivative of an amplitude along the curve |

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.algebra import Factors, bordered, norm
from hbgear.continuation.bordered import Augmented, Base, Extra, Fold, least_singular_vectors, null_vectors, sides
from hbgear.continuation.differences import STEP, difference_along, in_parameter
from hbgear.continuation.newton import NoConvergence
from hbgear.continuation.problem import AnyProblem, Locating, linearise
from hbgear.harmonic.hill import Condensed, slopes
from hbgear.mechanics.fourier import extrema, to_real, waves


class PeriodDoubling(Fold):
    """Period doublings (PD): singular half-integer block of the doubled problem.

    Written in the basis of twice the period, a motion of the single period has even harmonics only, and the Jacobian
    falls into the block of the even ones, which is dR/dX, and that of the odd ones, whose null vector is the
    disturbance that doubles the period.

    Parameters
    ----------
    problem : a `HarmonicBalance`.
    parameter : the parameter of the curve.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 5)
    >>> curve = hb.trace(pair, "Omega", (2.1, 1.8))
    >>> few = hb.StepControl(max_points=4)
    >>> doublings = hb.trace(hb.PeriodDoubling(pair, "Omega"), "zeta", (0.05, 0.06), start=curve["PD1"], steps=few)
    >>> doublings.parameter, bool(doublings.tracked["Omega"][0] == curve["PD1"].parameters["Omega"])
    ('zeta', True)
    """

    turning_kind = "LP"
    doubled: Any
    odd: NDArray[np.int_]
    even: NDArray[np.int_]

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "") -> None:
        super().__init__(problem, parameter)
        doubled = problem.doubled
        harmonic = np.tile(np.concatenate([[0], np.repeat(doubled.orders[1:], 2)]), problem.m)
        self._fixed(doubled=doubled, odd=np.flatnonzero(harmonic % 2), even=np.flatnonzero(harmonic % 2 == 0))

    def compiled(self, parameters: Mapping[str, float]) -> None:
        """None: its matrix is another one than dR/dX."""
        return None

    def embed(self, X: Array) -> Array:
        """The motion in the basis of twice the period."""
        out = np.zeros(self.doubled.size)
        out[self.even] = X
        return out

    def null_vector(self, X: Array, **here: float) -> Array:
        """The doubling disturbance at or near a period doubling, in the basis of twice the period, unit norm."""
        A, _ = self.matrix(X, here)
        out = np.zeros(self.doubled.size)
        out[self.odd] = scipy.linalg.svd(A)[2][-1]
        return out

    def matrix(self, X: Array, here: dict[str, float]) -> tuple[Array, float]:
        """The half-integer block, and the size of the terms of R."""
        now = linearise(self.doubled, self.embed(X), "", here)
        return now.dR_dX[np.ix_(self.odd, self.odd)], now.size

    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Base) -> Extra:
        """See `Augmented.extra`."""
        assert base.b is not None and base.c is not None
        now = linearise(self.problem, X, self.parameter, here)
        wide, direction = self.embed(X), np.zeros(self.doubled.size)
        v, w, g = null_vectors(self.matrix(X, here)[0], base.b, base.c)
        k = base.weight
        direction[self.odd] = v
        odd, even = self.odd, self.even
        along, across = self.doubled.curvature(wide, direction, self.parameter, **here)
        changes = (sides(self.doubled, wide, here, name) for name in names)
        return Extra(
            now, k * g, -k * (w @ along[np.ix_(odd, even)]), -k * float(w @ across[np.ix_(odd, odd)] @ v),
            tuple((dR[even], -k * float(w @ dJ[np.ix_(odd, odd)] @ v)) for dR, dJ in changes),
        )  # fmt: skip


@dataclass(frozen=True)
class Rotation(Base):
    """The base of a Neimark-Sacker point: the borders of Hill's determinant, and the exponent near which it is zero."""

    exponent: complex = 0j


_REAL = 1e-3  # half turns of a multiplier, from a whole number of them, within which it may be a real one


class _Pair(NamedTuple):
    """An exponent s of a motion, its disturbance v, y = G^H w with the left vector w, and w^H dD/ds v."""

    exponent: complex
    v: ComplexArray
    w: ComplexArray
    y: ComplexArray
    rate: complex


class NeimarkSacker(Augmented):
    """Neimark-Sacker points (NS): a disturbance e^{st} v(theta) of another frequency neither decays nor grows.

        D(s) v = 0,   g = Re s;     ds = -(w^H dD v) / (w^H D_s v)

    D is Hill's determinant seen from the gaps (`hill.Condensed`), s is found anew for every motion. Like the
    half-integer block of a period doubling, which is D at s = i omega / 2, it is superconvergent: its zeros are far
    more accurate than the multipliers of the truncated motion.

    Parameters
    ----------
    problem : a `HarmonicBalance` of laws that are known to hbgear.
    parameter : the parameter of the curve.
    near : the exponent near which that of the pair is looked for; by default that of the pair of multipliers next to
        the unit circle, which may be another one where two pairs pass close to each other.

    Raises
    ------
    ValueError
        If there is no complex pair of multipliers near the point, a law must be asked for its slopes, or the structure
        is too large for its modes.

    References
    ----------
    Detroux, Renson, Masset & Kerschen (2015), Comput. Methods Appl. Mech. Eng. 296,
    https://doi.org/10.1016/j.cma.2015.07.017, for special points followed by harmonic balance.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.DoubleHelicalPair(zeta=0.05), 5)
    >>> curve = hb.trace(problem, "Omega", (1.0, 0.8), accuracy=None)
    >>> few = hb.StepControl(max_points=4)
    >>> held = hb.trace(hb.NeimarkSacker(problem, "Omega"), "zeta", (0.05, 0.06), start=curve["NS1"], steps=few)
    >>> bool(held.tracked["Omega"][0] == curve["NS1"].parameters["Omega"])
    True
    """

    problem: Any  # a HarmonicBalance
    near: complex | None

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", near: complex | None = None) -> None:
        super().__init__(problem, parameter)
        self._fixed(near=near)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return (self.near,)

    def base_at(self, X: Array, here: dict[str, float]) -> Base:
        hill, size = self._hill(X, here), linearise(self.problem, X, "", here).size
        s = self._guess(X, here) if self.near is None else self.near
        b, c = least_singular_vectors(hill.matrix(hill.receptances(s)[0]), _BORDERS)
        pair = _exponent(hill, s, b, c, X, here)
        return Rotation(size / hill.omega, _unit(pair.w), _unit(pair.v), pair.exponent)

    def renewed(self, base: Base, X: Array, here: dict[str, float]) -> Base:
        """Borders and exponent renewed at X."""
        assert isinstance(base, Rotation)
        pair = self._pair(self._hill(X, here), base, X, here)
        return Rotation(base.weight, _unit(pair.w), _unit(pair.v), pair.exponent)

    def exponent(self, X: Array, **here: float) -> complex:
        """The exponent s at or near a Neimark-Sacker point; its second frequency is Im s."""
        base = self.base or self.base_at(X, here)
        return self._pair(self._hill(X, here), base, X, here).exponent

    def _hill(self, X: Array, here: dict[str, float]) -> Condensed:
        return Condensed.of(self.problem.compiled(here), X, here["Omega"])

    def _guess(self, X: Array, here: dict[str, float]) -> complex:
        """The exponent of the complex pair of multipliers next to the unit circle."""
        s = exponent_of_pair(self.problem.multipliers(X, **here), self.problem.nu, here["Omega"])
        if s is None:
            raise ValueError("no pair of multipliers of the motion is complex: it is at no Neimark-Sacker point")
        return s

    def _pair(self, hill: Condensed, base: Base, X: Array, here: dict[str, float]) -> _Pair:
        assert isinstance(base, Rotation) and base.b is not None and base.c is not None
        pair = _exponent(hill, base.exponent, base.b, base.c, X, here)
        turns = 2 * pair.exponent.imag * self.problem.nu / here["Omega"]
        if abs(turns - round(turns)) < _REAL:  # det D = 0 at period doublings and branch points too
            raise NoConvergence("the pair of multipliers became real", X, here, [])
        return pair

    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Base) -> Extra:
        """See `Augmented.extra`."""
        now = linearise(self.problem, X, self.parameter, here)
        pair = self._pair(self._hill(X, here), base, X, here)
        k = base.weight
        g_X = k * self._slope(X, here, pair)
        moved = tuple(
            (linearise(self.problem, X, name, here).dR_dp, k * self._moved(X, here, name, pair)) for name in names
        )
        return Extra(now, k * pair.exponent.real, g_X, k * self._moved(X, here, self.parameter, pair), moved)

    def _slope(self, X: Array, here: dict[str, float], pair: _Pair) -> Array:
        """Gradient (n,) of Re s in X, on which slopes K of the laws depend.

            w^H dD v = sum_n q_n dK_n,   q_n = sum_l conj(y_l+n) v_l
            d Re s = mean of dK phi,     phi = -Re sum_n q_n e^{-i n theta} / (w^H D_s v)

        summed over the gaps: what the mean force does when the motion moves along phi, and then along X.
        """
        m, H = self.problem.m, self.problem.H
        v, y = (z.reshape(2 * H + 1, m).T for z in (pair.v, pair.y))
        q = np.array([np.convolve(y_j.conj(), v_j[::-1]) for v_j, y_j in zip(v, y, strict=True)])
        phi = -q / pair.rate  # of e^{-in theta}, n = -2H..2H
        rows = to_real(phi[:, 2 * H :].conj() + phi[:, 2 * H :: -1])
        rows[:, 0] /= 2.0
        compiled, at = self.problem.compiled(here), np.zeros((m, 4 * H + 1))
        at[:, : 2 * H + 1] = self.problem.rows(X)
        h = difference_along(at.ravel(), rows.ravel())
        up, down = (slopes(compiled, (at + side * h * rows).ravel())[:, self.problem.orders] for side in (1, -1))
        bent = (up - down) / (2 * h)  # what the mean force does when the motion moves along an order: its coefficient
        out: Array = to_real(bent).ravel()
        return out

    def _moved(self, X: Array, here: dict[str, float], name: str, pair: _Pair) -> float:
        """Derivative of Re s in a parameter."""

        def drift(at: dict[str, float]) -> tuple[float]:
            hill = self._hill(X, at)
            form = complex(pair.w.conj() @ hill.times(hill.receptances(pair.exponent)[0], pair.v))
            return ((-form / pair.rate).real,)

        (moved,) = in_parameter(self.problem, name, here, drift)
        return float(moved)


def exponent_of_pair(mu: ComplexArray, nu: int, Omega: float) -> complex | None:
    """The exponent s of the complex pair of multipliers exp(2 pi nu s / Omega) next to the unit circle, if any."""
    pairs = mu[mu.imag > 1e-8 * np.abs(mu)]
    if not len(pairs):
        return None
    nearest = complex(pairs[np.argmin(np.abs(np.log(np.abs(pairs))))])
    return complex(np.log(nearest)) * Omega / (2 * np.pi * nu)


_BORDERS = 4  # inverse iterations for borders, which need not be singular vectors to all digits


_CLOSE = 1e-3  # step of an exponent, over the frequency, behind which the factors of D still serve


_FALLING = 0.1  # share of the step before it that a step with them takes at most


def _exponent(hill: Condensed, s: complex, b: ComplexArray, c: ComplexArray, X: Array, here: dict[str, float]) -> _Pair:
    """Newton on the bordered determinant g(s) of D(s), dg/ds = -w^H D_s v.

    Near the exponent D is not factorised anew, but v, w and g are mended by the factors that there are.

    Raises
    ------
    NoConvergence
        If it does not converge.
    ValueError
        If it is the exponent of a mode that no gap changes.
    """
    corner = np.zeros(len(b) + 1)
    corner[-1] = 1.0
    steps: list[float] = [math.inf]
    factors = None
    for _ in range(40):
        G, dG = hill.receptances(s)
        if factors is None:
            factors = Factors(bordered(hill.matrix(G), b, c.conj()))
            right, left = factors.solve(corner), factors.adjoint_solve(corner)
        else:
            v, w = right[:-1], left[:-1]
            missing = corner - np.append(hill.times(G, v) + right[-1] * b, c.conj() @ v)
            beside = corner - np.append(hill.adjoint_times(G, w) + left[-1] * c, b.conj() @ w)
            right, left = right + factors.solve(missing), left + factors.adjoint_solve(beside)
        v, w, g = right[:-1], left[:-1], right[-1]
        rate = complex(w.conj() @ hill.driven(dG, v))
        if not abs(g) < hill.omega * abs(rate):  # exponents repeat at this distance: none is nearby
            break
        step, last = g / rate, steps[-1] / hill.omega
        s, size = s + step, abs(step) / hill.omega
        steps.append(abs(step))
        if size <= 1e-14 or last <= 1e-11 or (last <= 1e-7 and size > _FALLING * last):
            return _Pair(s, v, w, hill.felt(hill.receptances(s)[0], w), rate)
        if size > _CLOSE or size > _FALLING * last:
            factors = None
    raise NoConvergence("Newton found no exponent of Hill's determinant", X, here, steps[1:])


def _unit(v: ComplexArray) -> ComplexArray:
    out: ComplexArray = v / norm(v)
    return out


class Grazing(Augmented):
    """Grazing contacts (GR): an extremum of an element touches a corner of its law.

        g = d(theta*) - corner,   d'(theta*) = 0;   dg/dX is the row of cosines and sines at theta*

    Parameters
    ----------
    problem, parameter : as for `Augmented`.
    which : index into ``problem.clearance``: which extremum of which element at which corner.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(), 8)
    >>> curve = hb.trace(pair, "Omega", (1.0, 0.6))
    >>> first = curve["GR1"]
    >>> few = hb.StepControl(max_points=4)
    >>> grazing = hb.trace(hb.Grazing(pair, "Omega", which=2), "zeta", (0.05, 0.06), start=first, steps=few)
    >>> first.kind, bool(grazing.tracked["Omega"][0] == first.parameters["Omega"])
    ('GR', True)
    """

    problem: Any  # a HarmonicBalance
    which: int

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", which: int = 0) -> None:
        super().__init__(problem, parameter)
        self._fixed(which=which)

    @property
    def arguments(self) -> tuple[Any, ...]:
        return (self.which,)

    def compiled(self, parameters: Mapping[str, float]) -> Locating | None:
        """See `Augmented.compiled`."""
        out: Locating | None = self.problem.locating(self.parameter, parameters, self.which)
        return out

    def base_at(self, X: Array, here: dict[str, float]) -> Base:
        return Base(linearise(self.problem, X, "", here).size / (1.0 + norm(X)))

    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Base) -> Extra:
        """See `Augmented.extra`."""
        now = linearise(self.problem, X, self.parameter, here)
        g, at = self.problem.graze(X, self.which, **here)
        element = self.problem.clearance_elements[self.which]
        w = waves(at, self.problem.H)[0, self.problem.orders]
        slope = np.zeros((self.problem.m, 2 * len(w) - 1))
        slope[element, 0], slope[element, 1::2], slope[element, 2::2] = 1.0, w.real[1:], w.imag[1:]
        k = base.weight
        changes = (self._changed(X, here, name, now.dR_dX) for name in names)
        moved = tuple((dR, k * dg) for dR, dg in changes)
        return Extra(now, k * g, k * slope.ravel(), k * self._moved(X, here, self.parameter, self.which), moved)

    def _changed(self, X: Array, here: dict[str, float], name: str, J: Array) -> tuple[Array, float]:
        """Derivatives of R and of the clearance in a parameter.

        Where a corner moves away from a motion that grazes it, contact of the duration sqrt(h) begins or ends, and
        differences are exact to O(sqrt(h)) only. The motion is therefore moved along, R_a = dR/da - J X_a, in every
        element that grazes.
        """
        dg = self._moved(X, here, name, self.which)
        if not dg:
            return linearise(self.problem, X, name, here).dR_dp, dg
        along, elements = np.zeros((self.problem.m, len(X) // self.problem.m)), self.problem.clearance_elements
        for which in np.flatnonzero(np.abs(self.problem.clearance(X, **here)) < _TOUCHING * (1.0 + norm(X))):
            along[elements[which], 0] = -self._moved(X, here, name, int(which))
        X_a, value = along.ravel(), here[name]
        (dR,) = in_parameter(
            self.problem, name, here, lambda at: (self.problem.evaluate(X + (at[name] - value) * X_a, **at)[0],)
        )
        return dR - J @ X_a, dg

    def _moved(self, X: Array, here: dict[str, float], name: str, which: int) -> float:
        """Derivative of a clearance in a parameter that moves the corner."""
        if name == "Omega":
            return 0.0
        (moved,) = in_parameter(self.problem, name, here, lambda at: self.problem.graze(X, which, **at)[:1])
        return float(moved)


_TOUCHING = 1e-7  # clearance, relative to the motion, of an element that grazes like another one


class Peak(Augmented):
    """Peaks (PK) of an amplitude: the derivative of A^2 / 2 along the curve vanishes.

        A^2 / 2 = X^T S X / 2,   g = X^T S t,   t the direction of the curve, [J R_p; b^T] t = e

    Parameters
    ----------
    problem, parameter : as for `Augmented`.
    measure : "rms" (alternating part) or a harmonic, "H1", "H2", ..., with nu = 2 also "H1/2".
    element : number of the element.

    Raises
    ------
    ValueError
        For another measure, or a harmonic the problem does not keep.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> top = hb.peaks(curve, "rms")[0]
    >>> few = hb.StepControl(max_points=4)
    >>> ridge = hb.trace(hb.Peak(problem, "Omega"), "zeta", (0.05, 0.06), start=top, steps=few)
    >>> bool(ridge.amplitude("rms")[-1] < ridge.amplitude("rms")[0])
    True
    """

    problem: Any  # a HarmonicBalance
    measure: str
    element: int
    S: Array

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", measure: str = "rms", element: int = 0) -> None:
        super().__init__(problem, parameter)
        self._fixed(measure=measure, element=element, S=self._weights(measure, element).ravel())

    def _weights(self, measure: str, element: int) -> Array:
        """S, as X."""
        S = np.zeros((self.problem.m, 2 * len(self.problem.orders) - 1))
        if measure == "rms":
            S[element, 1:] = 1.0
        else:
            at = int(np.searchsorted(self.problem.orders, _harmonic(measure, self.problem)))
            S[element, 2 * at - 1 : 2 * at + 1] = 1.0
        return S

    @property
    def arguments(self) -> tuple[Any, ...]:
        return self.measure, self.element

    def base_at(self, X: Array, here: dict[str, float]) -> Base:
        return Base(linearise(self.problem, X, "", here).size / (1.0 + abs(float(self.S @ (X * X)))))

    def extra(self, X: Array, here: dict[str, float], names: Sequence[str], base: Base) -> Extra:
        """See `Augmented.extra`."""
        now = linearise(self.problem, X, self.parameter, here)
        n = len(X)
        e = np.zeros(n + 1)
        e[-1] = 1.0  # the direction is normed by its component in the parameter
        factors = Factors(bordered(now.dR_dX, now.dR_dp, e))
        t = factors.solve(e)
        slope, bent = self.slopes(X, t[:n], here)
        g = float(slope @ t[:n])
        e[:n], e[n] = slope, 0.0
        z = factors.solve(e, transposed=True)[:n]
        h = STEP * max(1e-3, norm(X)) / max(norm(t), 1e-12)
        u = np.append(X, here[self.parameter])
        plus, minus = (
            linearise(self.problem, v[:-1], self.parameter, {**here, self.parameter: float(v[-1])})
            for v in (u + h * t, u - h * t)
        )
        weight = base.weight
        g_X = weight * (bent - z @ (plus.dR_dX - minus.dR_dX) / (2 * h))
        g_p = -weight * float(z @ (plus.dR_dp - minus.dR_dp)) / (2 * h)
        changes = (self._along(X, here, name, z, t) for name in names)
        return Extra(now, weight * g, g_X, g_p, tuple((dR, -weight * moved) for dR, moved in changes))

    def slopes(self, X: Array, t: Array, here: dict[str, float]) -> tuple[Array, Array]:
        """Gradient (n,) of A^2 / 2, or of A itself, and its derivative along t (n,)."""
        return self.S * X, self.S * t

    def _along(self, X: Array, here: dict[str, float], name: str, z: Array, t: Array) -> tuple[Array, float]:
        """dR/dname, and z^T d[J R_p]/dname t."""

        def parts(at: dict[str, float]) -> tuple[Array, float]:
            side = linearise(self.problem, X, self.parameter, at)
            return side.R, float(z @ (side.dR_dX @ t[:-1] + side.dR_dp * t[-1]))

        dR, moved = in_parameter(self.problem, name, here, parts)
        return dR, float(moved)


class ExtremumPeak(Peak):
    """Peaks of an amplitude made of extrema of the motion, or of its mean: dA/ds = 0 along the curve.

        A = sum_i s_i d(theta_i),   d'(theta_i) = 0;   dA/dX is made of the rows of cosines and sines at theta_i

    Parameters
    ----------
    problem, parameter, element : as for `Peak`.
    measure : "pp2", "max" or "mean".

    Raises
    ------
    ValueError
        For another measure.
    """

    def _weights(self, measure: str, element: int) -> Array:
        if measure not in EXTREMA:
            raise ValueError(f"extremum of {measure!r}: need {', '.join(EXTREMA)}")
        return np.zeros((self.problem.m, 2 * len(self.problem.orders) - 1))

    def slopes(self, X: Array, t: Array, here: dict[str, float]) -> tuple[Array, Array]:
        """Gradient (n,) of A, and its derivative along t (n,): theta_i moves by -w'(theta_i).t / d''(theta_i)."""
        k, m = self.problem.orders, self.problem.m
        slope, bent = np.zeros((2, m, 2 * len(k) - 1))
        if self.measure == "mean":
            slope[self.element, 0] = 1.0
            return slope.ravel(), bent.ravel()
        low, at_low, high, at_high = extrema(self.problem.rows(X)[self.element])
        parts = [(-0.5, at_low), (0.5, at_high)] if self.measure == "pp2" else [
            (1.0, at_high) if abs(high) >= abs(low) else (-1.0, at_low)
        ]  # fmt: skip
        share, at = np.array(parts).T
        row, along = (x.reshape(m, -1)[self.element] for x in (X, t))
        c = np.exp(-1j * k * at[:, None])
        w, w1, w2 = to_real(np.array([c, -1j * k * c, -(k**2) * c]))
        slope[self.element] = share @ w
        bent[self.element] = -(share * (w1 @ along) / (w2 @ row)) @ w1
        return slope.ravel(), bent.ravel()


EXTREMA = ("pp2", "max", "mean")
"""Measures of `ExtremumPeak`."""


def peak_of(problem: Any, parameter: str, measure: str, element: int) -> Peak:
    """The equations of the peaks of a measure."""
    return (ExtremumPeak if measure in EXTREMA else Peak)(problem, parameter, measure, element)


def _harmonic(measure: str, problem: Any) -> int:
    """Basis harmonic of "H2" or, for nu = 2, "H1/2"."""
    nu, H = problem.nu, problem.H
    found = re.fullmatch(r"H(\d+)(?:/(\d+))?", measure)
    k = int(found[1]) * nu / int(found[2] or 1) if found and found[2] != "0" else 0
    if k == int(k) and 1 <= k <= H and k not in problem.orders:
        raise ValueError(f"peak of {measure!r}: the balance leaves out that order; give more of them")
    if k != int(k) or not 1 <= k <= H:
        fractions = f", also H1/{nu}, ..." if nu > 1 else ""
        raise ValueError(f"peak of {measure!r}: need 'rms' or 'H1' to 'H{H // nu}'{fractions}")
    return int(k)
