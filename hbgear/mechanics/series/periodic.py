"""Periodic functions of the phase with corners: polynomials between them.

    f(tau) = sum_q coefficients[i][q] (tau - phases[i])^q,     phases[i] <= tau < phases[i + 1],     period 2 pi

Their harmonics are sums of moments, integrals of polynomials times exponentials,

    int_0^w p(x) exp(-i n x) dx = sum_q [p^(q)(0) - exp(-i n w) p^(q)(w)] / (i n)^(q + 1)

by parts where n w is large; where it is small, and parts would cancel, by a Gauss rule that is exact to rounding.
Nothing is cut off: any number of harmonics can be asked for.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, Range, checked, counted
from hbgear.common.text.messages import quoted
from hbgear.mechanics.series.fourier import Series, real_numbers, to_real

TURN = 2 * math.pi

MOST_PIECES = 2_000
"""Of a function: a measured mesh cycle has a few hundred samples, and tables are made of each."""

_DEGREE = 3  # of the polynomials: products of three of them are still integrated without loss

_SAME = 1e-9  # difference, relative to the size of the function, of values that are meant to be equal

_ROUNDING = 1e-10  # jump of a derivative, relative to its size, that is none

PARTS = 6.0
"""n w from which moments are computed by parts: no term is then larger than a few times the sum."""


def rule() -> tuple[Array, Array]:
    """Nodes and weights (16,) on (0, 1) for moments with n w below `PARTS`."""
    x, w = np.polynomial.legendre.leggauss(16)
    return 0.5 + 0.5 * x, 0.5 * w


@dataclass(frozen=True)
class Periodic:
    """A prescribed periodic function of the phase tau with corners: a polynomial on each piece between them.

        f(tau) = sum_q coefficients[i][q] (tau - phases[i])^q     from phases[i] to phases[i + 1]

    It is accepted where a `Series` is, as stiffness and as prescribed displacement, and taken as it is: corners are met
    exactly in balance, stability and time integration. `rectangular`, `trapezoidal` and `table` make the usual ones. At
    a jump it has the value that follows.

    Parameters
    ----------
    phases : (P,) where pieces begin, ascending, within one period of 2 pi; the last reaches to the first [rad].
    coefficients : P rows of at most 4 numbers, q = 0 to 3.

    Raises
    ------
    ValueError
        If phases do not ascend within one period, numbers are not finite or do not fit, or there is no corner.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> saw = hb.mechanics.Periodic(phases=(0.0,), coefficients=((-1.0, 1 / np.pi),))
    >>> saw(np.array([0.0, np.pi / 2, 2 * np.pi])).round(12).tolist()
    [-1.0, -0.5, -1.0]
    >>> saw.row(2)[2::2].round(6).tolist()  # of sin(tau), sin(2 tau)
    [-0.63662, -0.31831]
    """

    phases: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        phases = real_numbers("Periodic: phases", self.phases, "a sequence of numbers")
        rows = self.coefficients
        listed = isinstance(rows, tuple | list) or (isinstance(rows, np.ndarray) and rows.ndim > 0)
        if not listed or phases.ndim != 1 or len(rows) != len(phases):
            raise ValueError(f"Periodic: coefficients = {quoted(rows)} must be a row of numbers for each of the phases")
        counted("Periodic: number of pieces", len(phases), MOST_PIECES)
        table = []
        for row in rows:
            numbers = real_numbers("Periodic: coefficients", row, "rows of numbers")
            if numbers.ndim != 1 or not 1 <= numbers.size <= _DEGREE + 1 or not np.isfinite(numbers).all():
                raise ValueError(
                    f"Periodic: coefficients {quoted(row)} of a piece must be 1 to {_DEGREE + 1} finite numbers"
                )
            table.append(tuple(numbers.tolist()))
        _check_phases("Periodic", phases, TURN)
        object.__setattr__(self, "phases", tuple(phases.tolist()))
        object.__setattr__(self, "coefficients", tuple(table))
        if not self.corners:
            raise ValueError(
                "Periodic: this function has no corner, it is a constant; give a number, or Series(mean=...)"
            )

    # ---- the usual ones

    @staticmethod
    @checked_arguments()
    def rectangular(high: float, low: float, share: float, start: float = 0.0) -> Periodic:
        """A function that jumps between two values, such as the stiffness of one and of two pairs of teeth.

            f = high for 0 <= tau - start < 2 pi share,   low for the rest of the period

        Parameters
        ----------
        high, low : the values.
        share : part of the period with the value ``high``, between 0 and 1; of a spur pair with contact ratio eps
            between 1 and 2 two pairs are in contact for eps - 1.
        start : phase at which it begins [rad].

        Raises
        ------
        ValueError
            If the share is not between 0 and 1, or the values are equal.

        Examples
        --------
        >>> import hbgear as hb
        >>> k = hb.mechanics.Periodic.rectangular(high=1.2, low=0.8, share=0.6)
        >>> k(0.0), k(6.0), round(k.mean, 12)
        (1.2, 0.8, 1.04)
        """
        checked("rectangular", "share", share, Range(above=0, below=1))
        if high == low:
            raise ValueError(f"rectangular: high = low = {high:g} has no corner; give a number, or Series(mean=...)")
        return _laid_out(start, np.array([0.0, TURN * share]), [(high,), (low,)])

    @staticmethod
    @checked_arguments()
    def trapezoidal(high: float, low: float, share: float, ramp: float, start: float = 0.0) -> Periodic:
        """A function that goes from one value to another and back along straight ramps.

            rises from low to high along 2 pi ramp,  stays high for 2 pi share,  falls along 2 pi ramp,  stays low

        Parameters
        ----------
        high, low : the values.
        share : part of the period with the value ``high``, not negative.
        ramp : part of the period each ramp takes, above 0; share + 2 ramp is at most 1.
        start : phase at which it begins to rise [rad].

        Raises
        ------
        ValueError
            If the parts do not fit into a period, or the values are equal.

        Examples
        --------
        >>> import hbgear as hb
        >>> k = hb.mechanics.Periodic.trapezoidal(high=1.2, low=0.8, share=0.5, ramp=0.1)
        >>> k(0.0), round(float(k(0.1 * 3.141592653589793)), 12), round(k.mean, 12)
        (0.8, 1.0, 1.04)
        """
        checked("trapezoidal", "share", share, Range(low=0, below=1))
        checked("trapezoidal", "ramp", ramp, Range(above=0, high=0.5))
        if share + 2 * ramp > 1 + _SAME:
            raise ValueError(
                f"trapezoidal: share + 2 ramp = {share + 2 * ramp:g} is more than the period; give at most 1"
            )
        if high == low:
            raise ValueError(f"trapezoidal: high = low = {high:g} has no corner; give a number, or Series(mean=...)")
        slope = (high - low) / (TURN * ramp)
        begin, rows = [0.0, ramp, ramp + share, 2 * ramp + share], [(low, slope), (high,), (high, -slope), (low,)]
        ends = [*begin[1:], 1.0]
        kept = [i for i in range(4) if ends[i] - begin[i] > _SAME]
        return _laid_out(start, TURN * np.array([begin[i] for i in kept]), [rows[i] for i in kept])

    @staticmethod
    @checked_arguments()
    def table(phase: Any, values: Any, period: float = TURN, kind: str = "linear") -> Periodic:
        """A function through the values of a table, measured or from another program.

        Parameters
        ----------
        phase : (P,) ascending, within one period; the last may be a whole period after the first.
        values : (P,) at these phases; where the last phase closes the period its value must be that of the first.
        period : of the phases in their own unit: 2 pi for radians, 360 for degrees, 1 for shares of a mesh cycle.
        kind : "linear", straight from value to value; "cubic", by the periodic spline, with continuous curvature.

        Raises
        ------
        ValueError
            If phases do not ascend, reach beyond a period, the table is not periodic, has fewer than 2 values (3 of a
            spline) or more than 2000, or all of them are equal.

        Examples
        --------
        >>> import hbgear as hb
        >>> e = hb.mechanics.Periodic.table([0, 90, 180, 270, 360], [0.0, 3.0, 0.0, -1.0, 0.0], period=360)
        >>> round(float(e(3.141592653589793 / 4)), 12), round(e.mean, 12)
        (1.5, 0.5)
        """
        checked("table", "period", period, POSITIVE)
        if kind not in ("linear", "cubic"):
            raise ValueError(f"table: kind = {quoted(kind)} must be 'linear' or 'cubic'")
        x = real_numbers("table: phase", phase, "a sequence of numbers")
        y = real_numbers("table: values", values, "a sequence of numbers")
        if x.ndim != 1 or x.shape != y.shape or not np.isfinite(y).all():
            raise ValueError(f"table: {x.size} phases and {y.size} values; need as many finite values as phases")
        closed = x.size > 1 and bool(abs(x[-1] - x[0] - period) <= _SAME * period)
        if closed:
            size = np.abs(y).max() or 1.0
            if abs(y[-1] - y[0]) > _SAME * size:
                raise ValueError(
                    f"table: it is not periodic: a period after its first value {y[0]:g} it has {y[-1]:g}; give equal "
                    "values, or leave the last one out"
                )
            x, y = x[:-1], y[:-1]
        _check_phases("table", x, float(period))
        least = 2 if kind == "linear" else 3
        if x.size < least:
            raise ValueError(f"table: {x.size} values in a period; {kind} interpolation needs at least {least}")
        counted("table: number of values", x.size, MOST_PIECES)
        if not np.ptp(y):
            raise ValueError(f"table: all values are {y[0]:g}, it has no corner; give a number, or Series(mean=...)")
        x, x_end, y_end = x * (TURN / period), (x[0] + period) * (TURN / period), y[0]
        ends, values_ = np.append(x, x_end), np.append(y, y_end)
        if kind == "cubic":
            c = scipy.interpolate.CubicSpline(ends, values_, bc_type="periodic").c[::-1].T
        else:
            c = np.column_stack([y, np.diff(values_) / np.diff(ends)])
        return _laid_out(0.0, x, c.tolist())

    # ---- what it is

    @property
    def order(self) -> int:
        """0: it is made of pieces, not of harmonics; `row` gives as many harmonics as it is asked for."""
        return 0

    @cached_property
    def corners(self) -> tuple[float, ...]:
        """Phases in [0, 2 pi), ascending, at which it or one of its derivatives jumps."""
        jumps, rows = np.abs(self.jumps), np.abs(_derivatives(self._rows, self._widths))
        size = np.maximum(rows.max(axis=0), np.abs(_derivatives(self._rows, 0 * self._widths)).max(axis=0))
        there = (jumps > _ROUNDING * size).any(axis=1)
        return tuple(sorted(x % TURN for x, corner in zip(self.phases, there.tolist(), strict=True) if corner))

    @cached_property
    def jumps(self) -> Array:
        """(P, D + 1): by how much each derivative jumps at each of the phases."""
        ends = np.roll(_derivatives(self._rows, self._widths), 1, axis=0)
        out: Array = _derivatives(self._rows, 0 * self._widths) - ends
        return out

    @property
    def continuous(self) -> bool:
        """Whether its value jumps nowhere."""
        return bool(np.abs(self.jumps[:, 0]).max() <= _SAME * self.bound)

    @cached_property
    def mean(self) -> float:
        """Over the period."""
        return float(moments(self._rows, self._widths, 1).real.sum() / TURN)

    @property
    def varies(self) -> bool:
        """True: it has corners."""
        return True

    @cached_property
    def bound(self) -> float:
        """The largest absolute value."""
        return max(abs(end) for end in self.extremes())

    def extremes(self) -> tuple[float, float]:
        """The smallest and the largest value."""
        rows, w = np.pad(self._rows, ((0, 0), (0, _DEGREE + 1 - self._rows.shape[1]))), self._widths
        places = [0 * w, w]
        with np.errstate(all="ignore"):
            a, b, c = 3 * rows[:, 3], rows[:, 2], rows[:, 1]  # a x^2 + 2 b x + c = 0
            q = -(b + np.where(b < 0, -1.0, 1.0) * np.sqrt(b * b - a * c))
            for x in (q / a, c / q):
                places.append(np.where((x > 0) & (x < w), x, 0.0))
        values = np.array([_derivatives(rows, x)[:, 0] for x in places])
        return float(values.min()), float(values.max())

    def __call__(self, tau: ArrayLike, derivative: int = 0) -> Array:
        """Value, or a derivative in tau, at any phases; at a corner that of the piece which follows."""
        counted("derivative", derivative, 10, least=0)
        tau = real_numbers("Periodic: tau", tau, "a number or an array of numbers")
        if not np.isfinite(tau).all():
            raise ValueError(f"Periodic: tau = {quoted(tau)} must be finite")
        first = self.phases[0]
        x = first + (tau - first) % TURN
        piece = np.searchsorted(self.phases, x, side="right") - 1
        if derivative >= self._rows.shape[1]:
            return np.zeros(tau.shape)
        rows = self._rows[piece.ravel()]
        out: Array = _derivatives(rows, (x - np.array(self.phases)[piece]).ravel())[:, derivative].reshape(tau.shape)
        return out if tau.ndim else out[()]

    @checked_arguments()
    def row(self, H: int) -> Array:
        """Real row ``(2H + 1,)`` of its harmonics 0 to H, exact."""
        counted("H", H, 1_000_000, least=0)
        each = moments(self._rows, self._widths, H + 1)
        turned = np.exp(-1j * np.outer(self.phases, np.arange(H + 1)))
        c = (each * turned).sum(axis=0) / math.pi
        c[0] *= 0.5
        return to_real(c)

    # ---- others made of it

    @checked_arguments()
    def shifted(self, phase: float) -> Periodic:
        """The function delayed by a phase: ``f(tau - phase)``."""
        return _laid_out(phase, np.array(self.phases), self.coefficients)

    @checked_arguments()
    def scaled(self, factor: float) -> Periodic | Series:
        """The function times a factor; zero times it is a `Series`."""
        if factor == 0:
            return Series()
        return Periodic(self.phases, tuple(tuple(factor * x for x in row) for row in self.coefficients))

    @checked_arguments()
    def varied(self, factor: float) -> Periodic | Series:
        """The function with its alternating part times a factor: ``mean + factor (f - mean)``."""
        if factor == 0:
            return Series(self.mean)
        rest = (1 - factor) * self.mean
        rows = tuple((factor * row[0] + rest, *(factor * x for x in row[1:])) for row in self.coefficients)
        return Periodic(self.phases, rows)

    def pieces(self, nu: int = 1) -> Pieced:
        """The function over nu of its periods, as one of the phase theta = tau / nu."""
        n, first = len(self.phases), self.phases[0]
        at, rows = np.array(self.phases), self._rows
        whole = math.floor(first / TURN)
        at = np.concatenate([at - (whole + 1) * TURN, at - whole * TURN])  # from at or below 0 on
        start = int(np.searchsorted(at, 0.0, side="right")) - 1
        at, rows = at[start : start + n + 1], np.concatenate([rows, rows])[start : start + n + 1]
        at[0], rows[0] = 0.0, _shifted(rows[:1], -at[:1])[0]
        inside = at < TURN
        at, rows = at[inside], rows[inside]
        theta = (at[None, :] + TURN * np.arange(nu)[:, None]) / nu
        return Pieced(theta.ravel(), np.tile(rows * float(nu) ** np.arange(rows.shape[1]), (nu, 1)))

    @cached_property
    def _rows(self) -> Array:
        """Coefficients (P, D + 1), padded."""
        out = np.zeros((len(self.coefficients), max(map(len, self.coefficients))))
        for mine, row in zip(out, self.coefficients, strict=True):
            mine[: len(row)] = row
        return out

    @cached_property
    def _widths(self) -> Array:
        return np.diff([*self.phases, self.phases[0] + TURN])


Phased: TypeAlias = Series | Periodic
"""A prescribed periodic function of the phase, with corners or without."""


def described(function: Phased) -> dict[str, Any]:
    """A function as plain data, fit for JSON."""
    return {"function": type(function).__name__, **dataclasses.asdict(function)}


def undescribed(data: Any) -> Any:
    """The function that `described` was given; other data as they are.

    Raises
    ------
    ValueError
        If they are of its form, but of no such function.
    """
    if not isinstance(data, Mapping) or "function" not in data:
        return data
    kinds: dict[str, type[Phased]] = {"Series": Series, "Periodic": Periodic}
    given = {name: value for name, value in data.items() if name != "function"}
    cls = kinds.get(str(data["function"]))
    if cls is None or {field.name for field in dataclasses.fields(cls)} != set(given):
        raise ValueError(f"a function is described as a {' or a '.join(kinds)} with its fields, got {str(data)[:80]}")
    return cls(**given)


_ROUNDING = 1e-13  # of a phase


@dataclass(frozen=True)
class Pieced:
    """Polynomials over one period [0, 2 pi) of a phase: at (T,), the first 0, where they begin; rows (T, D + 1)."""

    at: Array
    rows: Array

    @property
    def widths(self) -> Array:
        """(T,) of the pieces."""
        return np.diff(np.append(self.at, TURN))

    def times(self, other: Pieced) -> Pieced:
        """The product, on the pieces of both."""
        both = np.unique(np.concatenate([self.at, other.at]))
        at = both[np.diff(both, prepend=-np.inf) > _ROUNDING]
        a, b = self._rows_at(at), other._rows_at(at)
        rows = np.zeros((len(at), a.shape[1] + b.shape[1] - 1))
        for q in range(a.shape[1]):
            rows[:, q : q + b.shape[1]] += a[:, q : q + 1] * b
        return Pieced(at, rows)

    def _rows_at(self, at: Array) -> Array:
        """Polynomials from phases on, each that in the middle up to the next: beginnings are known to rounding."""
        middle = at + 0.5 * np.diff(np.append(at, TURN))
        piece = np.searchsorted(self.at, middle, side="right") - 1
        rows: Array = _shifted(self.rows[piece], at - self.at[piece])
        return rows

    def scaled(self, factor: float) -> Pieced:
        """Times a factor."""
        return Pieced(self.at, factor * self.rows)

    def on(self, at: Array) -> Pieced:
        """The same with further beginnings of pieces; those within rounding of others are these."""
        new = at[np.abs(at[:, None] - self.at).min(axis=1) > _ROUNDING]
        both = np.sort(np.concatenate([self.at, new]))
        piece = np.searchsorted(self.at, both, side="right") - 1
        return Pieced(both, _shifted(self.rows[piece], both - self.at[piece]))

    def integrals(self, count: int) -> ComplexArray:
        """int_0^theta f exp(-i n x) dx (T + 1, count) at the beginnings and at 2 pi, n = 0 .. count - 1."""
        turned = np.exp(-1j * np.outer(self.at, np.arange(count)))
        out = np.zeros((len(self.at) + 1, count), dtype=complex)
        np.cumsum(moments(self.rows, self.widths, count) * turned, axis=0, out=out[1:])
        return out


ONE = Pieced(np.zeros(1), np.ones((1, 1)))


def moments(rows: Array, widths: Array, count: int) -> ComplexArray:
    """int_0^w p(x) exp(-i n x) dx (P, count), n = 0 .. count - 1, of polynomials (P, D + 1) on intervals w (P,)."""
    n, (x, weight) = np.arange(count), rule()
    out = np.empty((len(rows), count), dtype=complex)
    for row, w, own in zip(rows, widths, out, strict=True):
        few = min(count, int(PARTS / w) + 1) if w * (count - 1) > PARTS else count
        p = np.polynomial.polynomial.polyval(w * x, row) * (w * weight)
        own[:few] = np.exp(-1j * np.outer(n[:few], w * x)) @ p
        if few < count:
            start, end = _derivatives(np.array([row, row]), np.array([0.0, w]))
            total, power, many = np.zeros(count - few, dtype=complex), 1.0 / (1j * n[few:]), n[few:]
            factor = power.copy()
            turned = np.exp(-1j * w * many)
            for q in range(len(row)):
                total += factor * (start[q] - turned * end[q])
                factor = factor * power
            own[few:] = total
    return out


def _derivatives(rows: Array, x: Array) -> Array:
    """Values and all derivatives (P, D + 1) of polynomials (P, D + 1) at x (P,)."""
    return _shifted(rows, x) * [math.factorial(q) for q in range(rows.shape[1])]


def _shifted(rows: Array, x: Array) -> Array:
    """Coefficients (P, D + 1) of the polynomials p(x + y) in y."""
    out = rows.copy()
    for first in range(rows.shape[1] - 1):
        for q in range(rows.shape[1] - 2, first - 1, -1):
            out[:, q] += x * out[:, q + 1]
    return out


def _laid_out(start: float, at: Array, rows: Sequence[Sequence[float]]) -> Periodic:
    """Pieces that begin at ``start + at``, put in order from the first in [0, 2 pi)."""
    begin = (start + at) % TURN
    begin[begin >= TURN] = 0.0
    order = np.argsort(begin, kind="stable")
    return Periodic(tuple(begin[order].tolist()), tuple(tuple(rows[i]) for i in order))


def _check_phases(owner: str, phases: Array, period: float) -> None:
    if phases.ndim != 1 or not phases.size or not np.isfinite(phases).all():
        raise ValueError(f"{owner}: phases {quoted(phases.tolist())} must be one or more finite numbers")
    late = np.flatnonzero(np.diff(phases) <= 1e-12 * period)
    if late.size:
        i = int(late[0])
        raise ValueError(
            f"{owner}: phases must ascend, but after {phases[i]:g} comes {phases[i + 1]:g}; sort the table and keep "
            "one value for each phase"
        )
    if phases[-1] - phases[0] >= period * (1 - 1e-12):
        raise ValueError(
            f"{owner}: phases from {phases[0]:g} to {phases[-1]:g} are more than the period {period:.6g}; give one "
            "period, in the unit that the period is given in"
        )
