"""Layout of the unknowns of periodic motions: names of the elements, harmonics, regimes.

x(theta) = a0 + sum_{k=1..H} a_k cos(k theta) + b_k sin(k theta),   theta = tau / nu
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.facade import call
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.mechanics.series.fourier import evaluate, spread, stretch, to_complex
from hbgear.mechanics.series.measures import derivative, function_of, measure

REGIMES = ("no_impact", "single_sided", "double_sided", "stick", "partial_slip", "gross_slip")
"""Names of the regime codes. 0, 1, 2: number of sides of an element that the motion meets and leaves. 3, 4, 5: none,
some, or all of the friction sliders of an element slip. -1 is unknown."""

STICK_REGIME = REGIMES.index("stick")
"""Regime code of an element whose sliders stick; larger codes are those of slip."""


def element_index(elements: Sequence[str], element: int | str) -> int:
    """Return the index of an element given by index or name; the KeyError lists the elements."""
    if isinstance(element, str):
        if element in elements:
            return elements.index(element)
    elif 0 <= element < len(elements):
        return int(element)
    raise KeyError(f"no element {element!r}; choose one of {', '.join(map(repr, elements))}, or its index from 0")


class ElementLayout:
    """Base class of the layouts of motions of elements."""

    elements: tuple[str, ...]

    @abstractmethod
    def rows(self, X: Array, element: int | str) -> Array:
        """Return the unknowns of an element."""

    @abstractmethod
    def measure_rows(self, name: str, rows: Array) -> Array:
        """Return a measure of the unknowns of one element."""

    def index(self, element: int | str) -> int:
        """Return the index of an element given by index or name; the KeyError lists the elements."""
        return element_index(self.elements, element)

    def measure(self, name: str, X: Array, element: int | str = 0) -> Array:
        """Return a measure of an element, for X of shape (..., n)."""
        return self.measure_rows(name, self.rows(X, element))

    def problem_of(self, meta: Mapping[str, Any]) -> Any:
        """Return the problem that the header of a file describes; None for a model outside hbgear."""
        try:
            return call("hbgear.harmonic.models.model_registry.rebuild_traced_problem", meta)
        except (KeyError, TypeError, ValueError):
            return None


@dataclass(frozen=True)
class Layout(ElementLayout):
    """Meaning of the unknowns X of a harmonic balance.

    Attributes
    ----------
    harmonics : int
        Harmonic truncation order H.
    nu : int
        Subharmonic order; the basis phase is theta = tau / nu.
    elements : tuple of str
        Names of the m elements.
    breakpoints : tuple of tuple of float
        Breakpoints of the law of each element, in its coordinate.
    labels : dict, optional
        Axis labels by name, such as ``{"Omega": "Ω = ω_mesh / ω_n", "amplitude": "d / b_c"}``.
    orders : tuple of int, optional
        Basis harmonics from 1 that X contains, ascending. Default: all up to H.
    edged : tuple of int, optional
        Numbers of the elements of laws of several displacements that have regimes. Default: none.
    """

    harmonics: int
    nu: int
    elements: tuple[str, ...]
    breakpoints: tuple[tuple[float, ...], ...]
    labels: dict[str, str] = field(default_factory=dict, hash=False)
    orders: tuple[int, ...] | None = None
    edged: tuple[int, ...] = ()

    @property
    def width(self) -> int:
        """Number of unknowns m (2H + 1), with the number of orders instead of H if X does not contain all."""
        count = self.harmonics if self.orders is None else len(self.orders)
        return len(self.elements) * (2 * count + 1)

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the regime codes."""
        return REGIMES

    @property
    def neutral_regime(self) -> int:
        """Regime code of motions that depend on residual slider positions: no slider slips."""
        return STICK_REGIME

    def has_regime(self, j: int, code: int) -> bool:
        """Return whether a regime code of element j has a meaning: its law has contacts or friction."""
        return code >= STICK_REGIME or (code >= 0 and bool(self.breakpoints[j] or j in self.edged))

    def rows(self, X: Array, element: int | str) -> Array:
        """Return the coefficients ``(..., 2H + 1)`` of an element; zero for harmonics that X does not contain."""
        return self.spread(X)[..., self.index(element), :]

    def spread(self, X: Array) -> Array:
        """Return the coefficients ``(..., m, 2H + 1)`` of all elements; zero for harmonics that X does not contain."""
        if self.orders is None:
            return X.reshape(*X.shape[:-1], len(self.elements), -1)
        return spread(X, len(self.elements), np.array([0, *self.orders]), self.harmonics)

    def check_measure(self, name: str, element: int | str = 0) -> None:
        """Raise an error for the name of an unknown measure or element, as `measure` does."""
        self.index(element)
        function_of(name, self.harmonics, self.nu)

    def measure_rows(self, name: str, rows: Array) -> Array:
        """Return a measure for coefficients (..., 2H + 1) of one element."""
        return measure(name, rows, self.nu)

    def distance(self, X: Array, other: Layout, Y: Array) -> float:
        """Return the distance of two motions, independent of their phases: rms of the differences of amplitudes.

            sqrt(sum_j [(a0 - a0')^2 + sum_k (|c_k| - |c_k'|)^2 / 2])      c_k = a_k - i b_k of element j

        Motions of different periods are compared over a common multiple.
        """
        nu = math.lcm(self.nu, other.nu)
        shorter, difference = sorted((self._amplitudes(X, nu), other._amplitudes(Y, nu)), key=np.size)
        difference[:, : shorter.shape[1]] -= shorter
        return norm(difference)

    def _amplitudes(self, X: Array, nu: int) -> Array:
        """Return means and rms values (m, H nu / self.nu + 1) of the harmonics of Omega / nu."""
        c = to_complex(stretch(self.spread(X), nu // self.nu))
        return np.concatenate([c[:, :1].real, np.abs(c[:, 1:]) / math.sqrt(2)], axis=1)

    def samples(self, X: Array, element: int | str, count: int, order: int) -> tuple[Array, Array]:
        """Return ``(theta, values)`` of an element over one period, 0 <= theta < 2 pi; order of d/dtheta."""
        theta = 2 * np.pi * np.arange(count) / count
        return theta, evaluate(self.rows(X, element), theta, order)

    def in_time(self, rows: Array, parameters: Mapping[str, Array], order: int) -> Array:
        """Return coefficients (P, 2H + 1) of the derivative in time at frequencies ``parameters["Omega"]`` (P,)."""
        if "Omega" not in parameters:
            raise ValueError(f"derivative={order} needs Omega; this branch has no parameter of that name")
        return derivative(rows, parameters["Omega"] / self.nu, order)


def layout_of(source: Branch | Point) -> Layout | None:
    """Return the layout of a curve or a point; None if the unknowns are not coefficients of periodic motions."""
    return source.layout if isinstance(source.layout, Layout) else None
