"""Layout of the unknowns, and amplitude measures of the periodic functions that they represent.

    x(theta) = a0 + sum_{k=1..H} a_k cos(k theta) + b_k sin(k theta),   theta = tau / nu

    rms   sqrt(sum_k (a_k^2 + b_k^2) / 2), the without mean      pp2   (max x - min x) / 2
    max   max |x|                                                mean  a0
    Hk    sqrt(a^2 + b^2) of harmonic k of the excitation, which is basis harmonic nu k; H1/2 for half of it

Functions take coefficients (..., 2H + 1) and return one value for each function.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.arrays import Array
from hbgear.common.facade import call
from hbgear.common.ranges import counted
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.mechanics.series.fourier import evaluate, extrema, harmonics_of, spread, stretch, to_complex, to_real


def rms(X: Array) -> Array:
    """Return the root mean square of the alternating part."""
    rms: Array = np.sqrt(0.5 * np.sum(X[..., 1:] ** 2, axis=-1))
    return rms


def half_peak_to_peak(X: Array) -> Array:
    """Return half the difference between the largest and the smallest value."""
    low, _, high, _ = extrema(X)
    return (high - low) / 2


def largest(X: Array) -> Array:
    """Return the largest absolute value."""
    low, _, high, _ = extrema(X)
    return np.maximum(np.abs(low), np.abs(high))


def mean(X: Array) -> Array:
    """Return the mean over a period."""
    return X[..., 0].copy()


def harmonic(X: Array, k: int) -> Array:
    """Return the amplitude of basis harmonic k >= 1."""
    return np.hypot(X[..., 2 * k - 1], X[..., 2 * k])


REGIMES = ("no_impact", "single_sided", "double_sided")
"""Names of the impact regimes 0, 1, 2: number of sides of an element with intermittent contact. -1 is unknown."""

MEASURES: dict[str, Callable[[Array], Array]] = {"rms": rms, "pp2": half_peak_to_peak, "max": largest, "mean": mean}


def measure(name: str, X: Array, nu: int = 1) -> Array:
    """Return an amplitude measure of periodic functions.

    Parameters
    ----------
    name : str
        "rms", "pp2", "max", "mean", "H1", "H2", ...; with nu = 2 also "H1/2", "H3/2", ...
    X : array_like, shape (..., 2H + 1)
        Real Fourier coefficients over nu periods of the excitation.
    nu : int, optional
        Subharmonic order, 1 by default.

    Returns
    -------
    ndarray
        The measure of each function, in the unit of X.

    Raises
    ------
    ValueError
        If there is no measure of this name, or the harmonic exceeds H.
    """
    X = np.asarray(X, dtype=float)
    return _measured_by(name, harmonics_of(X), nu)(X)


def _measured_by(name: str, H: int, nu: int) -> Callable[[Array], Array]:
    """Return the function of coefficients of H harmonics that computes a measure, see `measure`."""
    if name in MEASURES:
        return MEASURES[name]
    found = _HARMONIC.fullmatch(name)
    if found is None:
        raise ValueError(f"no measure '{name}'; there are {_names(H, nu)}")
    above, below = int(found[1]) * nu, int(found[2] or 1)
    if above % below or not 1 <= above // below <= H:
        raise ValueError(f"no harmonic '{name}' among H = {H} harmonics of order nu = {nu}; there are {_names(H, nu)}")
    return partial(harmonic, k=above // below)


_HARMONIC = re.compile(r"H(\d+)(?:/([1-9]\d*))?")


def check_measure(where: str, name: str) -> None:
    """Raise an error for a name that is not a measure for any number of harmonics.

    Raises
    ------
    ValueError
        If there is no measure of this name.
    """
    if name not in MEASURES and _HARMONIC.fullmatch(name) is None:
        raise ValueError(f"{where}: no measure '{name}'; there are {', '.join(MEASURES)}, H1, H2, ...")


def derivative(X: Array, rate: ArrayLike, order: int) -> Array:
    """Return the coefficients of a time derivative, c_k (i k rate)^order, with rate = dtheta/dt = Omega / nu."""
    counted("derivative", order, least=0)
    c = to_complex(np.asarray(X, dtype=float))
    return to_real(c * (1j * np.arange(c.shape[-1]) * np.asarray(rate, dtype=float)[..., None]) ** order)


def _names(H: int, nu: int) -> str:
    """Return the names of the measures of H harmonics, for messages."""
    orders = [f"H{k // nu}" if k % nu == 0 else f"H{k}/{nu}" for k in range(1, H + 1)]
    return ", ".join([*MEASURES, *(orders if H <= 4 else [*orders[:2], "...", orders[-1]])])


@dataclass(frozen=True)
class Layout:
    """Layout of the unknowns X of a point: elements, harmonics and labels.

    Attributes
    ----------
    harmonics : int
        Number of harmonics H.
    nu : int
        Subharmonic order; the basis phase is theta = tau / nu.
    elements : tuple of str
        Names of the m elements.
    breakpoints : tuple of tuple of float
        Breakpoints of the law of each element, in its displacement.
    labels : dict, optional
        Axis labels by name, e.g. ``{"Omega": "Ω = ω_mesh / ω_n", "amplitude": "d / b_c"}``.
    orders : tuple of int, optional
        Basis harmonics from 1 that are unknowns, ascending; None for all up to H.
    """

    harmonics: int
    nu: int
    elements: tuple[str, ...]
    breakpoints: tuple[tuple[float, ...], ...]
    labels: dict[str, str] = field(default_factory=dict, hash=False)
    orders: tuple[int, ...] | None = None

    @property
    def width(self) -> int:
        """Number of unknowns m (2K + 1) of K selected harmonics."""
        kept = self.harmonics if self.orders is None else len(self.orders)
        return len(self.elements) * (2 * kept + 1)

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the impact regimes."""
        return REGIMES

    def index(self, element: int | str) -> int:
        """Return the number of an element given by number or name; raise a KeyError for an unknown one."""
        if isinstance(element, str):
            if element in self.elements:
                return self.elements.index(element)
        elif 0 <= element < len(self.elements):
            return int(element)
        raise KeyError(f"no element {element!r}; there are {', '.join(map(repr, self.elements))} (or by number from 0)")

    def rows(self, X: Array, element: int | str) -> Array:
        """Return the coefficients ``(..., 2H + 1)`` of an element; zero for other harmonics than the unknowns."""
        return self.spread(X)[..., self.index(element), :]

    def spread(self, X: Array) -> Array:
        """Return the coefficients ``(..., m, 2H + 1)`` of all elements; zero for other harmonics than the unknowns."""
        if self.orders is None:
            return X.reshape(*X.shape[:-1], len(self.elements), -1)
        return spread(X, len(self.elements), np.array([0, *self.orders]), self.harmonics)

    def measure(self, name: str, X: Array, element: int | str = 0) -> Array:
        """Return an amplitude measure of an element for each motion; see `measure`."""
        return self.measure_rows(name, self.rows(X, element))

    def check_measure(self, name: str, element: int | str = 0) -> None:
        """Raise the error of `measure` for a wrong name of a measure or an element."""
        self.index(element)
        _measured_by(name, self.harmonics, self.nu)

    def measure_rows(self, name: str, rows: Array) -> Array:
        """Return an amplitude measure of coefficients (..., 2H + 1) of one element."""
        return measure(name, rows, self.nu)

    def problem_of(self, meta: Mapping[str, Any]) -> Any:
        """Return the harmonic balance from the header of a file; None if the model is not part of hbgear."""
        try:
            return call("hbgear.harmonic.model_registry.rebuild_problem", meta)
        except (KeyError, TypeError, ValueError):
            return None

    def distance(self, X: Array, other: Layout, Y: Array) -> float:
        """Return the distance of two motions independent of their phases: rms of the differences of amplitudes.

            sqrt(sum_j [(a0 - a0')^2 + sum_k (|c_k| - |c_k'|)^2 / 2])      c_k = a_k - i b_k of element j

        Motions of different periods are compared over a common multiple.
        """
        nu = math.lcm(self.nu, other.nu)
        shorter, difference = sorted((self._amplitudes(X, nu), other._amplitudes(Y, nu)), key=np.size)
        difference[:, : shorter.shape[1]] -= shorter
        return norm(difference)

    def _amplitudes(self, X: Array, nu: int) -> Array:
        """Return mean and rms (m, H nu / own nu + 1) of the harmonics of Omega / nu."""
        c = to_complex(stretch(self.spread(X), nu // self.nu))
        return np.concatenate([c[:, :1].real, np.abs(c[:, 1:]) / math.sqrt(2)], axis=1)

    def samples(self, X: Array, element: int | str, count: int, order: int) -> tuple[Array, Array]:
        """Return ``(theta, values)`` of an element, or of its derivative d^order/dtheta^order, over one period."""
        theta = 2 * np.pi * np.arange(count) / count
        return theta, evaluate(self.rows(X, element), theta, order)

    def in_time(self, rows: Array, parameters: Mapping[str, Array], order: int) -> Array:
        """Return the coefficients (P, 2H + 1) of a time derivative at frequencies ``parameters["Omega"]`` (P,)."""
        if "Omega" not in parameters:
            raise ValueError(f"derivative={order} needs Omega; this branch has no parameter of that name")
        return derivative(rows, parameters["Omega"] / self.nu, order)


def layout_of(found: Branch | Point) -> Layout | None:
    """Return the layout of a branch or point; None if its unknowns are not coefficients of periodic motions."""
    return found.layout if isinstance(found.layout, Layout) else None
