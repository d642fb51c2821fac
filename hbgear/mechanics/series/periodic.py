"""Periodic functions of the phase with breakpoints: piecewise polynomials.

    f(tau) = sum_q coefficients[i][q] (tau - phases[i])^q,     phases[i] <= tau < phases[i + 1],     period 2 pi

Their harmonics are sums of moments of the polynomials, see `hbgear.mechanics.series.piecewise_polynomial`. Nothing is
truncated: any number of harmonics can be computed.
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
from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, Range, checked, counted
from hbgear.common.text.messages import quoted
from hbgear.mechanics.series.fourier import Series, real_numbers, to_real
from hbgear.mechanics.series.piecewise_polynomial import (
    ONE,
    TURN,
    PiecewisePolynomial,
    derivatives,
    extremes,
    integral,
    moments,
    shift_origin,
)

MOST_PIECES = 2_000
"""Largest number of segments of a function: a measured mesh cycle has a few hundred samples."""

_MAX_DEGREE = 3
"""Largest degree of the polynomials: products of three of them are integrated exactly by the rule of moments."""

_EQUAL_VALUES_TOLERANCE = 1e-9
"""Difference of values that count as equal, relative to the size of the function or the period [-]."""

_MIN_DERIVATIVE_JUMP = 1e-13
"""Jump of a derivative, relative to its size [-], below which there is no breakpoint."""


@dataclass(frozen=True, repr=False)
class Periodic:  # numpydoc ignore=PR02
    """Prescribed periodic function of the phase tau with breakpoints: a polynomial on each segment between them.

        f(tau) = sum_q coefficients[i][q] (tau - phases[i])^q     from phases[i] to phases[i + 1]

    It is accepted in place of a `Series`, as stiffness and as prescribed displacement, and is not approximated:
    harmonic balance, stability and time integration treat breakpoints exactly. `rectangular`, `trapezoidal` and `table`
    create the usual functions. At a jump it has the value that follows.

    Parameters
    ----------
    phases : sequence of float, length P
        Beginnings of the segments, ascending, within one period of 2 pi [rad]; the last segment ends at the first
        phase.
    coefficients : sequence of tuple of float, length P
        At most 4 coefficients for each segment, q = 0 to 3.

    Raises
    ------
    ValueError
        If phases do not ascend within one period, numbers are not finite or do not fit, or there is no breakpoint.

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
        is_sequence = isinstance(rows, tuple | list) or (isinstance(rows, np.ndarray) and rows.ndim > 0)
        if not is_sequence or phases.ndim != 1 or len(rows) != len(phases):
            raise ValueError(f"Periodic: coefficients = {quoted(rows)} must be a row of numbers for each of the phases")
        counted("Periodic: number of pieces", len(phases), MOST_PIECES)
        table = tuple(_checked_coefficients(row) for row in rows)
        _check_phases("Periodic", phases, TURN)
        object.__setattr__(self, "phases", tuple(phases.tolist()))
        object.__setattr__(self, "coefficients", table)
        if not self.corners:
            raise ValueError(
                "Periodic: this function is constant, without a breakpoint; give a number, or Series(mean=...)"
            )

    def __repr__(self) -> str:
        return f"<Periodic: {len(self.phases)} segments, mean {self.mean:.6g}>"

    @staticmethod
    @checked_arguments()
    def rectangular(high: float, low: float, share: float, start: float = 0.0) -> Periodic:
        """Return a function that jumps between two values, such as the stiffness of one and of two pairs of teeth.

            f = high for 0 <= tau - start < 2 pi share,   low for the rest of the period

        Parameters
        ----------
        high, low : float
            Values.
        share : float
            Fraction of the period with the value ``high``, between 0 and 1. In a spur pair with a contact ratio eps
            between 1 and 2, two pairs of teeth are in contact for the fraction eps - 1.
        start : float, optional
            Phase at which it begins [rad]. Default 0.

        Returns
        -------
        Periodic
            The function.

        Raises
        ------
        ValueError
            If the fraction is not between 0 and 1, or the values are equal.

        Examples
        --------
        >>> import hbgear as hb
        >>> k = hb.mechanics.Periodic.rectangular(high=1.2, low=0.8, share=0.6)
        >>> k(0.0), k(6.0), round(k.mean, 12)
        (1.2, 0.8, 1.04)
        """
        checked("rectangular", "share", share, Range(above=0, below=1))
        if high == low:
            raise ValueError(f"rectangular: high = low = {high:g} is constant; give a number, or Series(mean=...)")
        return _from_start(start, np.array([0.0, TURN * share]), [(high,), (low,)])

    @staticmethod
    @checked_arguments()
    def trapezoidal(high: float, low: float, share: float, ramp: float, start: float = 0.0) -> Periodic:
        """Return a function with two values and linear ramps between them.

            rises from low to high along 2 pi ramp,  stays high for 2 pi share,  falls along 2 pi ramp,  stays low

        Parameters
        ----------
        high, low : float
            Values.
        share : float
            Fraction of the period with the value ``high``, >= 0.
        ramp : float
            Fraction of the period of each ramp, > 0; share + 2 ramp is at most 1.
        start : float, optional
            Phase at which it begins to rise [rad]. Default 0.

        Returns
        -------
        Periodic
            The function.

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
        if share + 2 * ramp > 1 + _EQUAL_VALUES_TOLERANCE:
            raise ValueError(
                f"trapezoidal: share + 2 ramp = {share + 2 * ramp:g} is more than the period; give at most 1"
            )
        if high == low:
            raise ValueError(f"trapezoidal: high = low = {high:g} is constant; give a number, or Series(mean=...)")
        slope = (high - low) / (TURN * ramp)
        starts, rows = [0.0, ramp, ramp + share, 2 * ramp + share], [(low, slope), (high,), (high, -slope), (low,)]
        ends = [*starts[1:], 1.0]
        nonempty = [i for i in range(4) if ends[i] - starts[i] > _EQUAL_VALUES_TOLERANCE]
        return _from_start(start, TURN * np.array([starts[i] for i in nonempty]), [rows[i] for i in nonempty])

    @staticmethod
    @checked_arguments()
    def table(phase: Any, values: Any, period: float = TURN, kind: str = "linear") -> Periodic:
        """Return a function through the values of a table, measured or from another program.

        Parameters
        ----------
        phase : array_like, shape (P,)
            Ascending phases within one period; the last may be one period after the first.
        values : array_like, shape (P,)
            Values at these phases. If the last phase closes the period, its value must equal the first.
        period : float, optional
            Period in the unit of the phases: 2 pi for radians (default), 360 for degrees, 1 for fractions of a mesh
            cycle.
        kind : {"linear", "cubic"}, optional
            Interpolation: linear (default), or by the periodic cubic spline, with continuous curvature.

        Returns
        -------
        Periodic
            The function.

        Raises
        ------
        ValueError
            If phases do not ascend or exceed a period, the table is not periodic, has fewer than 2 values (3 for a
            spline) or more than 2000, or all values are equal.

        Examples
        --------
        >>> import hbgear as hb
        >>> e = hb.mechanics.Periodic.table([0, 90, 180, 270, 360], [0.0, 3.0, 0.0, -1.0, 0.0], period=360)
        >>> round(float(e(3.141592653589793 / 4)), 12), round(e.mean, 12)
        (1.5, 0.5)
        """
        return _from_start(0.0, *_interpolated(phase, values, period, kind))

    # ---- properties and values

    @property
    def order(self) -> int:
        """Highest harmonic of a finite series: 0, because the function is piecewise.

        `row` computes any number of harmonics.
        """
        return 0

    @cached_property
    def corners(self) -> tuple[float, ...]:
        """Breakpoints: phases in [0, 2 pi), ascending, at which it or one of its derivatives jumps."""
        jumps, rows = np.abs(self.jumps), np.abs(derivatives(self._rows, self._widths))
        size = np.maximum(rows.max(axis=0), np.abs(derivatives(self._rows, 0 * self._widths)).max(axis=0))
        is_breakpoint = (jumps > _MIN_DERIVATIVE_JUMP * size).any(axis=1)
        return tuple(sorted(x % TURN for x, jump in zip(self.phases, is_breakpoint.tolist(), strict=True) if jump))

    @cached_property
    def jumps(self) -> Array:
        """Jumps (P, D + 1) of the derivatives at the phases."""
        ends = np.roll(derivatives(self._rows, self._widths), 1, axis=0)
        return derivatives(self._rows, 0 * self._widths) - ends

    @property
    def continuous(self) -> bool:
        """True if its value has no jump."""
        return bool(np.abs(self.jumps[:, 0]).max() <= _EQUAL_VALUES_TOLERANCE * self.bound)

    @cached_property
    def mean(self) -> float:
        """Mean value over the period."""
        return integral(self._rows, self._widths) / TURN

    @property
    def varies(self) -> bool:
        """True, because it has breakpoints."""
        return True

    @cached_property
    def bound(self) -> float:
        """Largest absolute value."""
        return max(abs(end) for end in self.extremes())

    def extremes(self) -> tuple[float, float]:
        """Return the smallest and the largest value."""
        return extremes(self._rows, self._widths)

    def __call__(self, tau: ArrayLike, derivative: int = 0) -> Array:
        """Return the value, or a derivative in tau, at any phases; at a breakpoint that of the following segment."""
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
        out = derivatives(rows, (x - np.array(self.phases)[piece]).ravel())[:, derivative].reshape(tau.shape)
        return out if tau.ndim else out[()]

    @checked_arguments()
    def row(self, H: int) -> Array:
        """Return the real row ``(2H + 1,)`` of its harmonics 0 to H, exact to rounding."""
        counted("H", H, 1_000_000, least=0)
        integrals = moments(self._rows, self._widths, H + 1)
        factors = np.exp(-1j * np.outer(self.phases, np.arange(H + 1)))
        c = (integrals * factors).sum(axis=0) / math.pi
        c[0] *= 0.5
        return to_real(c)

    # ---- transformations

    @checked_arguments()
    def shifted(self, phase: float) -> Periodic:
        """Return the function delayed by a phase: ``f(tau - phase)``."""
        return _from_start(phase, np.array(self.phases), self.coefficients)

    def reversed(self) -> Periodic:
        """Return the function of the negative phase: ``f(-tau)``."""
        ends = np.array(self.phases) + self._widths
        rows = shift_origin(self._rows, self._widths) * (-1.0) ** np.arange(self._rows.shape[1])
        return _from_start(0.0, -ends, rows.tolist())

    @checked_arguments()
    def scaled(self, factor: float) -> Periodic | Series:
        """Return the function times a factor; with the factor zero it is a `Series`."""
        if factor == 0:
            return Series()
        return Periodic(self.phases, tuple(tuple(factor * x for x in row) for row in self.coefficients))

    @checked_arguments()
    def varied(self, factor: float) -> Periodic | Series:
        """Return the function with its alternating part times a factor: ``mean + factor (f - mean)``."""
        if factor == 0:
            return Series(self.mean)
        rest = (1 - factor) * self.mean
        rows = tuple((factor * row[0] + rest, *(factor * x for x in row[1:])) for row in self.coefficients)
        return Periodic(self.phases, rows)

    def pieces(self, nu: int = 1) -> PiecewisePolynomial:
        """Return the function over nu of its periods as piecewise polynomials of the phase theta = tau / nu."""
        return PiecewisePolynomial.over_periods(np.array(self.phases), self._rows, nu)

    @cached_property
    def _rows(self) -> Array:
        """Coefficients (P, D + 1), padded with zeros."""
        out = np.zeros((len(self.coefficients), max(map(len, self.coefficients))))
        for padded, row in zip(out, self.coefficients, strict=True):
            padded[: len(row)] = row
        return out

    @cached_property
    def _widths(self) -> Array:
        """Widths (P,) of the segments."""
        return np.diff([*self.phases, self.phases[0] + TURN])


Phased: TypeAlias = Series | Periodic
"""Prescribed periodic function of the phase, with or without breakpoints."""


def pieces_of(function: Phased, nu: int = 1) -> PiecewisePolynomial:
    """Return a function without harmonics as piecewise polynomials over nu of its periods, see `Periodic.pieces`."""
    return function.pieces(nu) if isinstance(function, Periodic) else ONE.scaled(function.mean)


def described(function: Phased) -> dict[str, Any]:
    """Return a function as plain data for JSON."""
    return {"function": type(function).__name__, **dataclasses.asdict(function)}


def undescribed(data: Any) -> Any:
    """Rebuild a function from the data that `described` returned; other data are returned unchanged.

    Raises
    ------
    ValueError
        If the data have the form of a function, but do not describe one.
    """
    if not isinstance(data, Mapping) or "function" not in data:
        return data
    kinds: dict[str, type[Phased]] = {"Series": Series, "Periodic": Periodic}
    fields = {name: value for name, value in data.items() if name != "function"}
    cls = kinds.get(str(data["function"]))
    if cls is None or {field.name for field in dataclasses.fields(cls)} != set(fields):
        raise ValueError(f"a function is described as a {' or a '.join(kinds)} with its fields, got {str(data)[:80]}")
    return cls(**fields)


def _from_start(start: float, offsets: Array, rows: Sequence[Sequence[float]]) -> Periodic:
    """Return the function with segments that begin at ``start + at``, ordered from the first in [0, 2 pi)."""
    starts = (start + offsets) % TURN
    starts[starts >= TURN] = 0.0
    order = np.argsort(starts, kind="stable")
    return Periodic(tuple(starts[order].tolist()), tuple(tuple(rows[i]) for i in order))


def _interpolated(phase: Any, values: Any, period: float, kind: str) -> tuple[Array, list[list[float]]]:
    """Return beginnings [rad] and coefficients of the segments through the values of a table, see `Periodic.table`."""
    checked("table", "period", period, POSITIVE)
    if kind not in ("linear", "cubic"):
        raise ValueError(f"table: kind = {quoted(kind)} must be 'linear' or 'cubic'")
    x = real_numbers("table: phase", phase, "a sequence of numbers")
    y = real_numbers("table: values", values, "a sequence of numbers")
    if x.ndim != 1 or x.shape != y.shape or not np.isfinite(y).all():
        raise ValueError(f"table: {x.size} phases and {y.size} values; need as many finite values as phases")
    closed = x.size > 1 and bool(abs(x[-1] - x[0] - period) <= _EQUAL_VALUES_TOLERANCE * period)
    if closed:
        size = np.abs(y).max() or 1.0
        if abs(y[-1] - y[0]) > _EQUAL_VALUES_TOLERANCE * size:
            raise ValueError(
                f"table: it is not periodic: the value one period after the first, {y[0]:g}, is {y[-1]:g}; give "
                "equal values, or leave the last one out"
            )
        x, y = x[:-1], y[:-1]
    _check_phases("table", x, float(period))
    minimum = 2 if kind == "linear" else 3
    if x.size < minimum:
        raise ValueError(f"table: {x.size} values in a period; {kind} interpolation needs at least {minimum}")
    counted("table: number of values", x.size, MOST_PIECES)
    if not np.ptp(y):
        raise ValueError(f"table: all values are {y[0]:g}, a constant; give a number, or Series(mean=...)")
    x, x_end, y_end = x * (TURN / period), (x[0] + period) * (TURN / period), y[0]
    ends, values_ = np.append(x, x_end), np.append(y, y_end)
    if kind == "cubic":
        c = scipy.interpolate.CubicSpline(ends, values_, bc_type="periodic").c[::-1].T
    else:
        c = np.column_stack([y, np.diff(values_) / np.diff(ends)])
    return x, c.tolist()


def _checked_coefficients(row: Sequence[float]) -> tuple[float, ...]:
    """Return the coefficients of one segment; raise ValueError for another number, or one that is not finite."""
    numbers = real_numbers("Periodic: coefficients", row, "rows of numbers")
    if numbers.ndim != 1 or not 1 <= numbers.size <= _MAX_DEGREE + 1 or not np.isfinite(numbers).all():
        raise ValueError(
            f"Periodic: coefficients {quoted(row)} of a piece must be 1 to {_MAX_DEGREE + 1} finite numbers"
        )
    return tuple(numbers.tolist())


def _check_phases(owner: str, phases: Array, period: float) -> None:
    """Raise ValueError for phases that do not ascend within one period."""
    if phases.ndim != 1 or not phases.size or not np.isfinite(phases).all():
        raise ValueError(f"{owner}: phases {quoted(phases.tolist())} must be one or more finite numbers")
    descending = np.flatnonzero(np.diff(phases) <= 1e-12 * period)
    if descending.size:
        i = int(descending[0])
        raise ValueError(
            f"{owner}: phases must ascend, but after {phases[i]:g} comes {phases[i + 1]:g}; sort the table and keep "
            "one value for each phase"
        )
    if phases[-1] - phases[0] >= period * (1 - 1e-12):
        raise ValueError(
            f"{owner}: phases from {phases[0]:g} to {phases[-1]:g} are more than the period {period:.6g}; give one "
            "period, in the unit that the period is given in"
        )
