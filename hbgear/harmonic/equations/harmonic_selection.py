"""Which orders are unknowns: all up to the highest, or those that matter where meshes have several tooth frequencies.

    k = |k_1 p_1 + k_2 p_2 + ...|,      (1 + |k_1|) (1 + |k_2|) ... <= 1 + B

Every element is excited at multiples of an order p_i of its own. A motion has the multiples of each, up to the B-th,
and combinations, which are the smaller the more of them are combined. Combinations of halves count double: only motions
of twice a tooth period have them. With a single p = 1 these are all orders 1..B.

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
from hbgear.mechanics.laws.laws import springs_of
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import real_numbers
from hbgear.mechanics.series.periodic import Periodic, Phased

_FAR = 8  # multiple of an order from which another one is a tone of its own, as that of 40 teeth beside their shaft


_ROUNDING = 1e-13  # amplitude of a harmonic, relative to the largest, that is none

HIGHEST = 10_000
"""Order of the excitation that may be given."""


@dataclass(frozen=True)
class HarmonicSelection:
    """A rule for the orders that are unknowns; what it keeps up to a highest one grows with that.

    tones : orders whose combinations are kept. given : orders that are kept instead, up to the highest of them. more :
    these and others, kept where H is up to twice as high; with each further doubling, and without them, sums and
    differences of pairs.
    """

    tones: tuple[int, ...] = ()
    given: tuple[int, ...] = ()
    more: tuple[int, ...] = ()

    @property
    def unit(self) -> int:
        """Harmonics of the excitation's frequency that are one of the fastest mesh."""
        return max(self.tones, default=1)

    def least(self, H: int) -> int:
        """A number of orders up to H that are kept at least, without counting them."""
        return 0 if self.given else H // self.unit

    @property
    def described(self) -> dict[str, list[int]]:
        """As plain data, for the header of a saved branch."""
        return {name: list(some) for name, some in vars(self).items() if some}

    def kept(self, H: int, nu: int) -> np.ndarray:
        """Basis harmonics (K + 1,) of Omega / nu up to H, ascending from 0."""
        return _kept(self, int(H), int(nu))

    def of_length(self, n: int, nu: int) -> np.ndarray | None:
        """The basis harmonics of rows of n coefficients; None if there are never so many."""
        low, high = 0, 1
        while 2 * len(self.kept(high, nu)) - 1 < n and high < HIGHEST * nu:
            low, high = high, 2 * high
        while low < high:
            middle = (low + high) // 2
            low, high = (middle + 1, high) if 2 * len(self.kept(middle, nu)) - 1 < n else (low, middle)
        found = self.kept(low, nu)
        return found if 2 * len(found) - 1 == n else None


@lru_cache(maxsize=256)
def _kept(selection: HarmonicSelection, H: int, nu: int) -> np.ndarray:
    whole = _given(selection, H // nu) if selection.given else _crossed(selection.tones, H // nu)
    out = {nu * k for k in whole}
    if nu > 1 and selection.given:
        out |= {k for k in range(1, H + 1) if k % nu}
    elif nu > 1:
        bound = (1 + H / (nu * selection.unit)) / 2
        out |= {k for k in _combined(selection.tones, nu, bound) if k <= H and k % nu}
    found = np.array(sorted(out), dtype=np.int64)
    found.flags.writeable = False
    return found


def _given(selection: HarmonicSelection, H: int) -> set[int]:
    """Given orders, and what each doubling of the highest adds."""
    doublings = max(0, int(np.ceil(log2(max(H, 1) / max(selection.given)) - 1e-12)))
    listed = doublings > 0 and bool(selection.more)
    out = {0, *(selection.more if listed else selection.given)}
    for _ in range(doublings - listed):
        out = {abs(a + sign * b) for a, b in product(out, repeat=2) for sign in (1, -1)}
    return {k for k in out if k <= H}


def _crossed(tones: tuple[int, ...], H: int) -> set[int]:
    """Combinations of the tones up to order H, those of halves with half the reach."""
    bound = 1 + H / max(tones)
    halves = {k // 2 for k in _combined(tones, 2, bound / 2) if k % 2 == 0}
    return {k for k in halves | _combined(tones, 1, bound) if k <= H}


def _combined(tones: tuple[int, ...], parts: int, bound: float) -> set[int]:
    """Orders |sum_i a_i p_i|, in units of 1 / parts, with prod_i (1 + |a_i| / parts) <= bound."""
    found = {(0, 1.0)}
    for tone in tones:
        steps = range(-int(parts * max(bound - 1.0, 0.0)), int(parts * max(bound - 1.0, 0.0)) + 1)
        found = {
            (k + a * tone, size * (1 + abs(a) / parts))
            for k, size in found for a in steps if size * (1 + abs(a) / parts) <= bound * (1 + 1e-12)
        }  # fmt: skip
    return {abs(k) for k, _ in found}


def select_harmonics(orders: Any, system: System) -> HarmonicSelection | None:
    """What ``orders`` of a balance ask for; None for all.

    Raises
    ------
    ValueError
        If they are neither None, "meshes" nor whole numbers from 1.
    """
    if orders is None or isinstance(orders, HarmonicSelection):
        return orders
    if isinstance(orders, str):
        if orders != "meshes":
            raise ValueError(f"orders = {orders!r}: need 'meshes', or a list of whole numbers such as (3, 5, 6, 8)")
        tones = tooth_orders(system)
        return None if tones == (1,) else HarmonicSelection(tones)
    given = real_numbers("orders", orders, "'meshes', or a list of whole numbers such as (3, 5, 6, 8)").ravel()
    for k in given.tolist():
        counted("each of the orders", int(k) if k == int(k) else k, HIGHEST)
    if not given.size:
        raise ValueError("orders = (): give at least one order, or None for all")
    return HarmonicSelection(given=tuple(sorted({int(k) for k in given})))


def tooth_orders(system: System) -> tuple[int, ...]:
    """The orders of which each function that excites has multiples only: of every mesh, and of a shaft out of balance.

    An order that is a low multiple of another is no tone of its own. (1,), which is all orders, if a law does not tell
    whether it depends on the phase.

    Examples
    --------
    >>> import hbgear as hb
    >>> tones_of(hb.SpurPair().system())
    (1,)
    """
    found = sorted({gcd(*some) for some in excited_orders(system) if some})
    if not found or any(springs_of(e.law) is None for e in system.elements):
        return (1,)
    return tuple(k for k in found if not any(k % other == 0 and other < k < _FAR * other for other in found))


def excited_orders(system: System, corners: bool = True) -> list[list[int]]:
    """Orders of each function that excites, but of laws that do not tell.

    corners : whether functions with corners count, which have endless orders, all of which the forces know.
    """
    functions = [f for e in system.elements for f in (*_stiffness(e.law), e.displacement)]
    each = [_orders(f) for f in functions if corners or not f.corners]
    return each + [[k for k in load.complex(system.n) if k] for load in system.loads]


def _stiffness(law: Any) -> list[Phased]:
    known = springs_of(law)
    return [spring.stiffness for spring in known[0]] if known else []


def _orders(function: Phased) -> list[int]:
    row = function.row(_SEEN) if isinstance(function, Periodic) else function.row()
    size = np.hypot(row[1::2], row[2::2])
    found: list[int] = (1 + np.flatnonzero(size > _ROUNDING * np.abs(row).max(initial=0.0))).tolist()
    return found


_SEEN = 600  # orders of a function with corners that are looked at
