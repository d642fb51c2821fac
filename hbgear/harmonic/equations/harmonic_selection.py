"""Harmonic selection: all orders up to H, or a selection for meshes with several tooth frequencies.

    k = |k_1 p_1 + k_2 p_2 + ...|,      (1 + |k_1|) (1 + |k_2|) ... <= 1 + B

Each mesh excites multiples of its tooth order p_i. A motion contains the multiples of each p_i up to the B-th and their
combinations. The amplitudes decrease with the number of combined orders, so a hyperbolic cross selects them. Half
orders count double, because only motions of twice a tooth period contain them. A single p = 1 selects all orders 1..B.

References
----------
Dung, Temlyakov & Ullrich, Hyperbolic Cross Approximation (2018), https://doi.org/10.1007/978-3-319-92240-9.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import gcd, log2
from typing import Any

import numpy as np

from hbgear.common.ranges import counted
from hbgear.mechanics.laws.mesh_contacts import contacts_of, moving_springs_of
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import real_numbers
from hbgear.mechanics.series.periodic import Periodic, Phased
from hbgear.mechanics.series.piecewise_polynomial import TURN

_SEPARATE_ORDER_RATIO = 8
"""Multiple of an excited order from which another order counts as separate, e.g. 40 teeth and their shaft."""

_ZERO_AMPLITUDE_RATIO = 1e-13
"""Amplitude of a harmonic, relative to the largest coefficient, up to which it counts as zero (rounding)."""

_SERIES_ORDERS = 600
"""Number of orders of a function with breakpoints that are evaluated if the first ones leave its base order open."""

_FIRST_ORDERS = 12
"""Number of orders that are evaluated first: usually order 1 is excited, and all orders are multiples of it."""

_MOST_FULL_ORDERS = 60
"""Base order of an excitation up to which all orders are unknowns by default: some harmonics of it are affordable."""

HIGHEST = 10_000
"""Highest order of the excitation that may be given."""


@dataclass(frozen=True)
class HarmonicSelection:
    """Rule that selects the orders that are unknowns; their number grows with the highest order H.

    Attributes
    ----------
    tones : tuple of int, optional
        Excited orders whose combinations are selected.
    given : tuple of int, optional
        Orders that are selected instead, for H up to the highest of them.
    more : tuple of int, optional
        Orders that are selected for H up to twice the highest of ``given``. For each further doubling of H, and
        without ``more``, sums and differences of pairs are added.
    """

    tones: tuple[int, ...] = ()
    given: tuple[int, ...] = ()
    more: tuple[int, ...] = ()

    @property
    def unit(self) -> int:
        """Order of the fastest mesh, in multiples of the excitation frequency."""
        return max(self.tones, default=1)

    def min_count(self, H: int) -> int:
        """Return a lower bound of the number of orders selected up to H."""
        return 0 if self.given else H // self.unit

    @property
    def described(self) -> dict[str, list[int]]:
        """Plain data for the header of a saved branch."""
        return {name: list(orders) for name, orders in vars(self).items() if orders}

    def selected(self, H: int, nu: int) -> np.ndarray:
        """Return the selected basis harmonics (K + 1,) of Omega / nu up to H, ascending from 0."""
        return _orders_up_to(self, int(H), int(nu))

    def of_length(self, n: int, nu: int) -> np.ndarray | None:
        """Return the basis harmonics that give n coefficients per element; None if no H gives this number."""
        low, high = 0, 1
        while 2 * len(self.selected(high, nu)) - 1 < n and high < HIGHEST * nu:
            low, high = high, 2 * high
        # the number of orders grows with H, so that H is bracketed and bisected
        while low < high:
            middle = (low + high) // 2
            low, high = (middle + 1, high) if 2 * len(self.selected(middle, nu)) - 1 < n else (low, middle)
        orders = self.selected(low, nu)
        return orders if 2 * len(orders) - 1 == n else None


@lru_cache(maxsize=256)
def _orders_up_to(selection: HarmonicSelection, H: int, nu: int) -> np.ndarray:
    """Return the selected basis harmonics up to H, see `HarmonicSelection.selected`."""
    multiples = _given_orders(selection, H // nu) if selection.given else _hyperbolic_cross(selection.tones, H // nu)
    out = {nu * k for k in multiples}
    if nu > 1 and selection.given:
        out |= {k for k in range(1, H + 1) if k % nu}
    elif nu > 1:
        bound = (1 + H / (nu * selection.unit)) / 2
        out |= {k for k in _combinations(selection.tones, nu, bound) if k <= H and k % nu}
    orders = np.array(sorted(out), dtype=np.int64)
    orders.flags.writeable = False
    return orders


def _given_orders(selection: HarmonicSelection, H: int) -> set[int]:
    """Return the given orders, and the orders that each doubling of the highest one adds."""
    doublings = max(0, int(np.ceil(log2(max(H, 1) / max(selection.given)) - 1e-12)))
    listed = doublings > 0 and bool(selection.more)
    out = {0, *(selection.more if listed else selection.given)}
    for _ in range(doublings - listed):
        out = {abs(a + sign * b) for a, b in product(out, repeat=2) for sign in (1, -1)}
    return {k for k in out if k <= H}


def _hyperbolic_cross(tones: tuple[int, ...], H: int) -> set[int]:
    """Return the combinations of the tones up to order H; those of half orders with half the bound."""
    bound = 1 + H / max(tones)
    halves = {k // 2 for k in _combinations(tones, 2, bound / 2) if k % 2 == 0}
    return {k for k in halves | _combinations(tones, 1, bound) if k <= H}


def _combinations(tones: tuple[int, ...], divisor: int, bound: float) -> set[int]:
    """Return the orders |sum_i a_i p_i|, in units of 1 / parts, with prod_i (1 + |a_i| / parts) <= bound."""
    terms = {(0, 1.0)}
    for tone in tones:
        steps = range(-int(divisor * max(bound - 1.0, 0.0)), int(divisor * max(bound - 1.0, 0.0)) + 1)
        terms = {
            (k + a * tone, size * (1 + abs(a) / divisor))
            for k, size in terms
            for a in steps
            if size * (1 + abs(a) / divisor) <= bound * (1 + 1e-12)
        }
    return {abs(k) for k, _ in terms}


def select_harmonics(orders: Any, system: System, H: int | None = None) -> HarmonicSelection | None:
    """Return the selection for the argument ``orders`` of a balance; None for all orders.

    Without an argument, all orders are selected if no base order of the excitation exceeds 60 or H, otherwise "meshes".
    "all" selects all of them.

    Raises
    ------
    ValueError
        If ``orders`` is not None, "all", "meshes" or whole numbers from 1.
    """
    if isinstance(orders, HarmonicSelection):
        return orders
    if orders is None:
        tones = tooth_orders(system)
        highest = _MOST_FULL_ORDERS if H is None else min(H, _MOST_FULL_ORDERS)
        return HarmonicSelection(tones) if max(tones) > max(highest, 1) else None
    if isinstance(orders, str):
        if orders == "all":
            return None
        if orders != "meshes":
            raise ValueError(
                f"orders = {orders!r}: need 'meshes', 'all', or a list of whole numbers such as (3, 5, 6, 8)"
            )
        tones = tooth_orders(system)
        return None if tones == (1,) else HarmonicSelection(tones)
    given = real_numbers("orders", orders, "'meshes', or a list of whole numbers such as (3, 5, 6, 8)").ravel()
    for k in given.tolist():
        counted("each of the orders", int(k) if k == int(k) else k, HIGHEST)
    if not given.size:
        raise ValueError("orders = (): give at least one order, or None for all")
    return HarmonicSelection(given=tuple(sorted({int(k) for k in given})))


def tooth_orders(system: System) -> tuple[int, ...]:
    """Return the base orders of the excitation: one for each mesh, and one for shaft unbalance.

    All orders that a function excites are multiples of its base order. An order below 8 times another one that divides
    it is left out. (1,), which selects all orders, if the dependence of a law on the phase is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> tooth_orders(hb.SpurPair().system())
    (1,)
    """
    bases = sorted({gcd(*orders) for orders in excited_orders(system) if orders})
    if not bases or any(moving_springs_of(e.law) is None for e in system.elements):
        return (1,)
    return tuple(
        k for k in bases if not any(k % other == 0 and other < k < _SEPARATE_ORDER_RATIO * other for other in bases)
    )


def excited_orders(system: System, corners: bool = True) -> list[list[int]]:
    """Return the orders of each excitation: stiffness, prescribed displacements and loads of known laws.

    corners : whether to include functions with breakpoints, which have infinitely many orders.
    """
    functions = [f for e in system.elements for f in (*_stiffness(e.law), e.displacement)]
    orders = [_orders(f) for f in functions if corners or not f.corners]
    return orders + [[k for k in load.complex(system.n) if k] for load in system.loads]


def _stiffness(law: Any) -> list[Phased]:
    """Return the periodic stiffness functions of a law; none if they are unknown."""
    split_law = moving_springs_of(law)
    levels = [contact.level for contact in contacts_of(law)]
    return [*(spring.spring.stiffness for spring in split_law[0]), *levels] if split_law else []


def _orders(function: Phased) -> list[int]:
    """Return the orders of a periodic function whose amplitudes are not zero.

    Of a function with breakpoints the first orders are returned if their greatest common divisor is 1.
    """
    if not isinstance(function, Periodic):
        return _nonzero_orders(function.row())
    count = _repetitions(function)
    if count > 1:
        return [count * k for k in _orders(_first_repetition(function, count))]
    first = _nonzero_orders(function.row(_FIRST_ORDERS))
    return first if gcd(*first) == 1 else _nonzero_orders(function.row(_SERIES_ORDERS))


def _nonzero_orders(row: np.ndarray) -> list[int]:
    """Return the orders of a real row whose amplitudes are not zero."""
    size = np.hypot(row[1::2], row[2::2])
    return (1 + np.flatnonzero(size > _ZERO_AMPLITUDE_RATIO * np.abs(row).max(initial=0.0))).tolist()


def _repetitions(function: Periodic) -> int:
    """Return the number of equal parts of a period, 1 if the function does not repeat itself within it."""
    phases, segments = np.array(function.phases), len(function.phases)
    rows = np.zeros((segments, max(len(row) for row in function.coefficients)))
    for row, coefficients in zip(rows, function.coefficients, strict=True):
        row[: len(coefficients)] = coefficients
    size = np.abs(rows).max(axis=0)
    for count in range(segments, 1, -1):
        if segments % count:
            continue
        n = segments // count
        shifted = np.append(phases[n:], phases[:n] + TURN)
        is_equal = np.abs(np.roll(rows, -n, axis=0) - rows) <= _ZERO_AMPLITUDE_RATIO * segments * size
        if is_equal.all() and np.abs(shifted - phases - TURN / count).max() <= 1e-12 * TURN:
            return count
    return 1


def _first_repetition(function: Periodic, count: int) -> Periodic:
    """Return the first of the equal parts of a period, as a function of its own phase."""
    n = len(function.phases) // count
    rows = tuple(tuple(x / float(count) ** q for q, x in enumerate(row)) for row in function.coefficients[:n])
    return Periodic(tuple(count * phase for phase in function.phases[:n]), rows)
