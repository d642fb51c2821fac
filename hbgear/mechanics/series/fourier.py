"""Harmonics and samples of periodic functions: the only module that knows the order of the coefficients.

    x(theta) = a0 + sum_{k=1..H} a_k cos(k theta) + b_k sin(k theta)

A *row* of real coefficients is stored as ``(a0, a1, b1, ..., aH, bH)``, length ``2H + 1``. The complex one-sided
form is ``c_k = a_k - i b_k`` (``c_0 = a0``), so that ``x = Re sum_k c_k exp(i k theta)``. Two-sided coefficients
are ``c_k / 2`` for ``k >= 1`` and their conjugates for ``k <= -1``.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import counted
from hbgear.common.text.messages import quoted


def harmonics_of(X: Array) -> int:
    """Return the number of harmonics H of rows of length 2H + 1."""
    size = X.shape[-1]
    if size % 2 == 0:
        raise ValueError(f"a row of {size} coefficients has no order H; need an odd length 2H + 1")
    return size // 2


def to_complex(X: Array) -> ComplexArray:
    """Return one-sided complex coefficients ``(..., H + 1)`` of real rows ``(..., 2H + 1)``."""
    index, sign = _to_complex(X.shape[-1])
    components = X.take(index, axis=-1) * sign
    components[..., 1] = 0.0
    return components.view(complex)


def to_real(c: ComplexArray) -> Array:
    """Return real rows ``(..., 2H + 1)`` of one-sided complex coefficients ``(..., H + 1)``."""
    index, sign = _to_real(c.shape[-1])
    return np.ascontiguousarray(c).view(float).take(index, axis=-1) * sign


@lru_cache(maxsize=64)
def _to_complex(n: int) -> tuple[np.ndarray, Array]:
    """Return the indices in n real coefficients from which real and imaginary parts are taken, and their signs."""
    return np.concatenate([[0], np.arange(n)]), np.tile([1.0, -1.0], n // 2 + 1)


@lru_cache(maxsize=64)
def _to_real(K: int) -> tuple[np.ndarray, Array]:
    """Return the indices in the real and imaginary parts of K coefficients that give real rows, and their signs."""
    return np.concatenate([[0], np.arange(2, 2 * K)]), np.concatenate([[1.0], np.tile([1.0, -1.0], K - 1)])


def waves(theta: ArrayLike, H: int) -> ComplexArray:
    """Return exp(i k theta), (T, H + 1), as powers of one exponential."""
    out = np.empty((np.size(theta), H + 1), dtype=complex)
    out[:, 0] = 1.0
    out[:, 1:] = np.exp(1j * np.ravel(theta))[:, None]
    return np.multiply.accumulate(out, axis=1, out=out)


def evaluate(X: Array, theta: ArrayLike, order: int = 0) -> Array:
    """Return the values (..., T) of real rows X (..., 2H + 1) at phases theta (T,) [rad].

    They are derivatives of the given order in theta; 0 for the value.
    """
    c = to_complex(np.asarray(X, dtype=float))
    return ((derive(c, order)) @ waves(theta, c.shape[-1] - 1).T).real


def value_and_derivative(X: Array, theta: ArrayLike) -> tuple[Array, Array]:
    """Return the values (..., T) of real rows X (..., 2H + 1) at phases theta (T,) [rad], and their derivatives."""
    c = to_complex(np.asarray(X, dtype=float))
    w = waves(theta, c.shape[-1] - 1).T
    return (c @ w).real, (derive(c) @ w).real


def derive(c: ComplexArray, order: int = 1) -> ComplexArray:
    """Return the coefficients of the derivative of the given order in theta, (i k)^order c_k, of c (..., H + 1).

    Raises
    ------
    ValueError
        If the order is not a whole number from 0 to 10.
    """
    for _ in range(counted("order", order, 10, least=0)):
        c = 1j * np.arange(c.shape[-1]) * c
    return c


def resize(X: Array, H: int) -> Array:
    """Return rows truncated or padded with zeros to H harmonics."""
    out = np.zeros((*X.shape[:-1], 2 * H + 1))
    n = min(out.shape[-1], X.shape[-1])
    out[..., :n] = X[..., :n]
    return out


def places(orders: np.ndarray) -> np.ndarray:
    """Return the indices of the coefficients of some harmonics, ascending, in a row of all harmonics."""
    indices = np.stack([2 * orders - 1, 2 * orders], axis=-1).ravel()
    return indices[1:] if len(orders) and orders[0] == 0 else indices


def spread(X: Array, m: int, orders: np.ndarray, H: int) -> Array:
    """Return rows (..., m, 2H + 1) of all harmonics from X (..., m (2K + 1)) with K orders and 0."""
    rows = X.reshape(*X.shape[:-1], m, -1)
    if rows.shape[-1] == 2 * H + 1:
        return rows
    out = np.zeros((*rows.shape[:-1], 2 * H + 1), dtype=X.dtype)
    out[..., places(orders)] = rows
    return out


def stretch(X: Array, nu: int) -> Array:
    """Return rows of the same function over ``nu`` of its periods: harmonic k becomes harmonic ``nu k``."""
    if nu == 1:
        return X
    c = to_complex(X)
    out = np.zeros((*c.shape[:-1], nu * (c.shape[-1] - 1) + 1), dtype=complex)
    out[..., ::nu] = c
    return to_real(out)


def extrema(X: Array) -> tuple[Array, Array, Array, Array]:
    """Return lowest value, its phase, highest value and its phase of each row (..., 2H + 1) over a period.

    They are exact to rounding if H harmonics resolve the function. It is sampled with N >= 16 per shortest wave;
    Newton's method on the derivative starts from every sample that can be the nearest to the extremum. The value of
    this sample differs from the extremum by at most (pi/N)^2 / 2 sum_k k^2 |c_k|.
    """
    from hbgear.mechanics.series.fourier_kernels import extremes

    X = np.asarray(X, dtype=float)
    c = to_complex(X.reshape(-1, X.shape[-1]))
    low, at_low, high, at_high = np.empty((4, len(c)))
    extremes(c, samples_of(c, max(64, 16 * harmonics_of(X))), low, at_low, high, at_high)
    return tuple(part.reshape(X.shape[:-1])[()] for part in (low, at_low, high, at_high))  # type: ignore[return-value]


def real_numbers(name: str, value: Any, requirement: str) -> Array:
    """Return a copy of a value as an array of floats, or raise an error that states the required value.

    Texts, complex numbers and ragged lists are refused.

    Raises
    ------
    ValueError
        If the value is not an array of real numbers.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "iufb":
        raise ValueError(f"{name} = {quoted(value)} must be {requirement}")
    return np.array(array, dtype=float)


def is_listed(value: Any) -> bool:
    """Return whether a value is a sequence; zero-dimensional and sparse arrays are iterable but not sequences."""
    return isinstance(value, Iterable) and getattr(value, "ndim", 1) > 0 and not hasattr(value, "tocsr")


MOST_HARMONICS = 10_000
"""Largest number of harmonics of a prescribed function: far above that of a mesh, small enough for all tables."""


@dataclass(frozen=True)
class Series:  # numpydoc ignore=PR02
    """Prescribed periodic function of the phase tau, given by its Fourier coefficients.

        s(tau) = mean + sum_l cosine[l-1] cos(l tau) + sine[l-1] sin(l tau)

    Parameters
    ----------
    mean : float, optional
        Mean value. Default 0.
    cosine, sine : tuple of float, optional
        Coefficients, of any and not necessarily equal length; entry 0 belongs to cos(tau), sin(tau). Default: none.

    Raises
    ------
    ValueError
        If a coefficient is not a finite number.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> stiffness = hb.mechanics.Series(mean=1.0, cosine=(0.2,))
    >>> stiffness(np.array([0.0, np.pi])).round(12).tolist()
    [1.2, 0.8]
    """

    mean: float = 0.0
    cosine: tuple[float, ...] = ()
    sine: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if type(self.mean) is not float and real_numbers("Series: mean", self.mean, "a number").ndim:
            raise ValueError(f"Series: mean = {quoted(self.mean)} must be a number")
        for name in ("cosine", "sine"):
            values = getattr(self, name)
            if type(values) is tuple and len(values) <= MOST_HARMONICS and all(type(x) is float for x in values):
                continue  # the usual case, which is fast
            row = real_numbers(f"Series: {name}", values, "a sequence of numbers such as (0.1, 0.05)")
            if row.ndim != 1:
                raise ValueError(f"Series: {name} = {quoted(values)} must be a sequence of numbers such as (0.1, 0.05)")
            counted(f"Series: number of entries of {name}", row.size, MOST_HARMONICS, least=0)
            object.__setattr__(self, name, tuple(row.tolist()))
        if not all(map(math.isfinite, (self.mean, *self.cosine, *self.sine))):
            raise ValueError(f"Series needs finite coefficients, got {self}")

    @property
    def order(self) -> int:
        """Highest harmonic with a coefficient."""
        return max(len(self.cosine), len(self.sine))

    @property
    def corners(self) -> tuple[float, ...]:
        """Breakpoints: empty, because a series is smooth."""
        return ()

    @property
    def varies(self) -> bool:
        """True if it depends on tau."""
        return any(self.cosine) or any(self.sine)

    @property
    def bound(self) -> float:
        """Upper bound of its absolute value."""
        return float(np.abs(self.row()).sum())

    def extremes(self) -> tuple[float, float]:
        """Return the smallest and the largest value."""
        low, _, high, _ = extrema(self.row())
        return float(low), float(high)

    @checked_arguments()
    def row(self, H: int | None = None) -> Array:
        """Return the real row ``(2H + 1,)``; harmonics above H are truncated, H = None keeps all."""
        if H is not None:
            counted("H", H, 1_000_000, least=0)
        out = np.zeros(2 * self.order + 1)
        out[0] = self.mean
        out[1 : 2 * len(self.cosine) : 2] = self.cosine
        out[2 : 2 * len(self.sine) + 1 : 2] = self.sine
        return out if H is None else resize(out, H)

    def __call__(self, tau: ArrayLike, derivative: int = 0) -> Array:
        """Return the value, or a derivative in tau, at any phases."""
        tau = real_numbers("Series: tau", tau, "a number or an array of numbers")
        if not np.isfinite(tau).all():
            raise ValueError(f"Series: tau = {quoted(tau)} must be finite")
        return evaluate(self.row(), tau.ravel(), derivative).reshape(tau.shape)

    @checked_arguments()
    def shifted(self, phase: float) -> Series:
        """Return the function delayed by a phase: ``s(tau - phase)``."""
        if not phase:
            return self
        c = to_complex(self.row()) * np.exp(-1j * phase * np.arange(self.order + 1))
        return Series(self.mean, tuple(c.real[1:]), tuple(-c.imag[1:]))

    @checked_arguments()
    def reversed(self) -> Series:
        """Return f(-tau)."""
        return Series(self.mean, self.cosine, tuple(-x for x in self.sine))

    def scaled(self, factor: float) -> Series:
        """Return the function times a factor."""
        return Series(factor * self.mean, tuple(factor * x for x in self.cosine), tuple(factor * x for x in self.sine))

    @checked_arguments()
    def varied(self, factor: float) -> Series:
        """Return the function with its alternating part times a factor: ``mean + factor (s - mean)``."""
        return Series(self.mean, tuple(factor * x for x in self.cosine), tuple(factor * x for x in self.sine))


def samples_of(c: ComplexArray, N: int) -> Array:
    """Return samples (..., N) at theta_n = 2 pi n / N of rows of one-sided coefficients (..., H + 1)."""
    spectrum = (0.5 * N) * c
    spectrum[..., 0] *= 2.0
    return np.fft.irfft(spectrum, n=N, axis=-1)


def coefficients_of(samples: Array, H: int) -> ComplexArray:
    """Return one-sided coefficients (..., H + 1) of rows of samples over a period; zero above half their number.

    Examples
    --------
    >>> coefficients_of(samples_of(np.array([[1.0, 2.0 - 3.0j]]), 8), 2).round(12)
    array([[1.+0.j, 2.-3.j, 0.+0.j]])
    """
    N = samples.shape[-1]
    c = np.zeros((*samples.shape[:-1], H + 1), dtype=complex)
    spectrum = np.fft.rfft(samples)[..., : H + 1] / N
    c[..., : spectrum.shape[-1]] = spectrum
    c[..., 1:] *= 2.0
    return c


def fast_length(minimum: int) -> int:
    """Return the smallest number >= ``minimum`` without a prime factor above 5, for fast Fourier transforms."""
    n = minimum
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 1


class Transform:
    """Fast Fourier transforms between rows of H harmonics and N samples over one period.

    Plans are created once for every power of two of the number of rows, when first needed. Each thread has its own
    plans, because a plan holds the arrays it works on.

    Parameters
    ----------
    H, N : int
        Numbers of harmonics and samples.

    Raises
    ------
    ValueError
        If N < 2H + 1: the samples cannot resolve the harmonics.
    """

    def __init__(self, H: int, N: int) -> None:
        if N < 2 * H + 1:
            raise ValueError(f"N = {N} samples cannot resolve H = {H} harmonics; need N >= {2 * H + 1}")
        self.H, self.N = H, N
        self._own = threading.local()

    def __reduce__(self) -> tuple[type[Transform], tuple[int, int]]:
        return Transform, (self.H, self.N)

    @cached_property
    def basis(self) -> Array:
        """Basis functions 1, cos theta, sin theta, ..., sin H theta (2H + 1, N) at the samples."""
        n, out = np.arange(self.N), np.empty((2 * self.H + 1, self.N))
        cosine, sine = np.cos(2 * np.pi * n / self.N), np.sin(2 * np.pi * n / self.N)
        out[0] = 1.0
        for k in range(1, self.H + 1):  # by rows, because a table of all indices is larger than the basis
            out[2 * k - 1], out[2 * k] = cosine[k * n % self.N], sine[k * n % self.N]
        return out

    @cached_property
    def wider(self) -> Transform:
        """Transform of twice as many harmonics, with at least four samples per harmonic."""
        return Transform(2 * self.H, max(self.N, 8 * self.H))

    def _planned(self, rows: int) -> _Plans:
        """Return the plans for at least this number of rows."""
        capacity = 1 << (rows - 1).bit_length()
        plans: dict[Any, _Plans] = self._own.__dict__  # of this thread
        if capacity not in plans:
            with _PLANNING_LOCK:
                plans[capacity] = _Plans(capacity, self.N)
        return plans[capacity]

    def samples(self, c: ComplexArray) -> Array:
        """Return samples ``(rows, N)`` of one-sided coefficients ``(rows, H + 1)``, at ``theta_n = 2 pi n / N``."""
        rows, plans = len(c), self._planned(len(c))
        # FFTW overwrites the input of a multi-dimensional inverse, so it is filled again every time
        s = plans.coefficients
        s[:] = 0.0
        np.multiply(c, 0.5, out=s[:rows, : self.H + 1])
        s[:rows, 0] = c[:, 0]
        plans.inverse.execute()
        return plans.values[:rows].copy()

    def spectrum(self, samples: Array) -> ComplexArray:
        """Return two-sided coefficients ``x_k, k = 0..2H`` of samples ``(rows, N)`` (``x_-k`` is the conjugate).

        Coefficients that N samples cannot hold are zero.
        """
        rows, count, plans = len(samples), min(2 * self.H, self.N // 2) + 1, self._planned(len(samples))
        plans.samples[:rows] = samples
        plans.forward.execute()
        out = np.zeros((rows, 2 * self.H + 1), dtype=complex)
        np.multiply(plans.spectrum[:rows, :count], 1.0 / self.N, out=out[:, :count])
        return out


_PLANNING_LOCK = threading.Lock()  # the planner of FFTW is not thread-safe


class _Plans:
    """Plans of both directions for a number of rows of N samples, with the arrays they work on."""

    def __init__(self, rows: int, N: int) -> None:
        import pyfftw  # here, because the import is slow

        self.coefficients = pyfftw.zeros_aligned((rows, N // 2 + 1), dtype="complex128")
        self.values = pyfftw.empty_aligned((rows, N), dtype="float64")
        self.inverse = pyfftw.FFTW(self.coefficients, self.values, direction="FFTW_BACKWARD", flags=("FFTW_ESTIMATE",))
        self.samples = pyfftw.zeros_aligned((rows, N), dtype="float64")
        self.spectrum = pyfftw.empty_aligned((rows, N // 2 + 1), dtype="complex128")
        self.forward = pyfftw.FFTW(self.samples, self.spectrum, flags=("FFTW_ESTIMATE",))
