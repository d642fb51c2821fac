"""How rows of unknowns are read, and amplitude measures of the periodic functions they stand for.

    x(theta) = a0 + sum_{k=1..H} a_k cos(k theta) + b_k sin(k theta),   theta = tau / nu

    rms   sqrt(sum_k (a_k^2 + b_k^2) / 2), the mean left out     pp2   (max x - min x) / 2
    max   max |x|                                                mean  a0
    Hk    sqrt(a^2 + b^2) of harmonic k of the excitation, which is basis harmonic nu k; H1/2 for one between them

Functions take rows (..., 2H + 1) and give one number for each.
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
    """Root mean square of the alternating part."""
    rms: Array = np.sqrt(0.5 * np.sum(X[..., 1:] ** 2, axis=-1))
    return rms


def half_peak_to_peak(X: Array) -> Array:
    """Half the distance between the largest and the smallest value."""
    low, _, high, _ = extrema(X)
    return (high - low) / 2


def largest(X: Array) -> Array:
    """Largest absolute value."""
    low, _, high, _ = extrema(X)
    return np.maximum(np.abs(low), np.abs(high))


def mean(X: Array) -> Array:
    """Mean over a period."""
    return X[..., 0].copy()


def harmonic(X: Array, k: int) -> Array:
    """Amplitude of basis harmonic k >= 1."""
    return np.hypot(X[..., 2 * k - 1], X[..., 2 * k])


REGIMES = ("no_impact", "single_sided", "double_sided")
"""Names of the regime codes 0, 1, 2 of an element: how many of its sides it meets and leaves. -1 is unknown."""

MEASURES: dict[str, Callable[[Array], Array]] = {"rms": rms, "pp2": half_peak_to_peak, "max": largest, "mean": mean}


def measure(name: str, X: Array, nu: int = 1) -> Array:
    """The measure of that name of each row.

    Parameters
    ----------
    name : "rms", "pp2", "max", "mean", "H1", "H2", ...; with nu = 2 also "H1/2", "H3/2", ...
    X : (..., 2H + 1) real rows over nu periods of the excitation.
    nu : subharmonic order.

    Raises
    ------
    ValueError
        If there is no measure of that name, or no such harmonic among the H of the rows.
    """
    X = np.asarray(X, dtype=float)
    return _measured_by(name, harmonics_of(X), nu)(X)


def _measured_by(name: str, H: int, nu: int) -> Callable[[Array], Array]:
    """The function of rows of H harmonics that a measure is; see `measure`."""
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
    """Refuse what is the measure of no motion.

    Raises
    ------
    ValueError
        If it is the name of none.
    """
    if name not in MEASURES and _HARMONIC.fullmatch(name) is None:
        raise ValueError(f"{where}: no measure '{name}'; there are {', '.join(MEASURES)}, H1, H2, ...")


def derivative(X: Array, rate: ArrayLike, order: int) -> Array:
    """Rows of the derivative in time, c_k (i k rate)^order, with rate = dtheta/dt = Omega / nu."""
    counted("derivative", order, least=0)
    c = to_complex(np.asarray(X, dtype=float))
    return to_real(c * (1j * np.arange(c.shape[-1]) * np.asarray(rate, dtype=float)[..., None]) ** order)


def _names(H: int, nu: int) -> str:
    orders = [f"H{k // nu}" if k % nu == 0 else f"H{k}/{nu}" for k in range(1, H + 1)]
    return ", ".join([*MEASURES, *(orders if H <= 4 else [*orders[:2], "...", orders[-1]])])


@dataclass(frozen=True)
class Layout:
    """How a row X of unknowns is to be read.

    Parameters
    ----------
    harmonics : H.
    nu : subharmonic order; the basis phase is theta = tau / nu.
    elements : m names.
    breakpoints : per element, the values of its coordinate at which its law has a corner.
    labels : axis labels by name, e.g. ``{"Omega": "Ω = ω_mesh / ω_n", "amplitude": "d / b_c"}``.
    orders : the basis harmonics from 1 that X has, ascending; None for all up to H.
    """

    harmonics: int
    nu: int
    elements: tuple[str, ...]
    breakpoints: tuple[tuple[float, ...], ...]
    labels: dict[str, str] = field(default_factory=dict, hash=False)
    orders: tuple[int, ...] | None = None

    @property
    def width(self) -> int:
        """Number of unknowns m (2H + 1), or that of the orders for H."""
        kept = self.harmonics if self.orders is None else len(self.orders)
        return len(self.elements) * (2 * kept + 1)

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the regime codes."""
        return REGIMES

    def index(self, element: int | str) -> int:
        """Position of an element given by position or name; KeyError lists those that exist."""
        if isinstance(element, str):
            if element in self.elements:
                return self.elements.index(element)
        elif 0 <= element < len(self.elements):
            return int(element)
        raise KeyError(f"no element {element!r}; there are {', '.join(map(repr, self.elements))} (or by number from 0)")

    def rows(self, X: Array, element: int | str) -> Array:
        """Coefficients ``(..., 2H + 1)`` of an element, out of ``X``; zero where its orders leave out harmonics."""
        return self.spread(X)[..., self.index(element), :]

    def spread(self, X: Array) -> Array:
        """Coefficients ``(..., m, 2H + 1)`` of all elements; zero where the orders leave out harmonics."""
        if self.orders is None:
            return X.reshape(*X.shape[:-1], len(self.elements), -1)
        return spread(X, len(self.elements), np.array([0, *self.orders]), self.harmonics)

    def measure(self, name: str, X: Array, element: int | str = 0) -> Array:
        """The measure of that name of an element, for each row."""
        return self.measure_rows(name, self.rows(X, element))

    def check_measure(self, name: str, element: int | str = 0) -> None:
        """Raise what `measure` would for a wrong name of a measure or an element."""
        self.index(element)
        _measured_by(name, self.harmonics, self.nu)

    def measure_rows(self, name: str, rows: Array) -> Array:
        """The measure of that name of rows (..., 2H + 1) of one element."""
        return measure(name, rows, self.nu)

    def problem_of(self, meta: Mapping[str, Any]) -> Any:
        """The harmonic balance as a file tells it; None if its model is none of hbgear, for no code is loaded."""
        try:
            return call("hbgear.harmonic.model_registry.rebuild_problem", meta)
        except (KeyError, TypeError, ValueError):
            return None

    def distance(self, X: Array, other: Layout, Y: Array) -> float:
        """How far two motions are apart, whatever their phases: root mean square of differences of amplitudes.

            sqrt(sum_j [(a0 - a0')^2 + sum_k (|c_k| - |c_k'|)^2 / 2])      c_k = a_k - i b_k of element j

        Motions of different periods are compared over a common multiple.
        """
        nu = math.lcm(self.nu, other.nu)
        few, apart = sorted((self._amplitudes(X, nu), other._amplitudes(Y, nu)), key=np.size)
        apart[:, : few.shape[1]] -= few
        return norm(apart)

    def _amplitudes(self, X: Array, nu: int) -> Array:
        """Mean and root mean squares (m, H nu / own nu + 1) of the harmonics of Omega / nu."""
        c = to_complex(stretch(self.spread(X), nu // self.nu))
        return np.concatenate([c[:, :1].real, np.abs(c[:, 1:]) / math.sqrt(2)], axis=1)

    def samples(self, X: Array, element: int | str, count: int, order: int) -> tuple[Array, Array]:
        """``(theta, values)`` of an element over one period, 0 <= theta < 2 pi; order is that of d/dtheta."""
        theta = 2 * np.pi * np.arange(count) / count
        return theta, evaluate(self.rows(X, element), theta, order)

    def in_time(self, rows: Array, parameters: Mapping[str, Array], order: int) -> Array:
        """Rows (P, 2H + 1) of the derivative in time at frequencies ``parameters["Omega"]`` (P,)."""
        if "Omega" not in parameters:
            raise ValueError(f"derivative={order} needs Omega; this branch has no parameter of that name")
        return derivative(rows, parameters["Omega"] / self.nu, order)


def layout_of(found: Branch | Point) -> Layout | None:
    """How the unknowns of a curve or a point are read; None if they are not coefficients of periodic motions."""
    return found.layout if isinstance(found.layout, Layout) else None
