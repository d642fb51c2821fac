"""Discretization of a periodic motion: order H, subharmonic order nu, harmonics kept, samples N.

    d(theta) = a_0 + sum_k a_k cos(k theta) + b_k sin(k theta),   theta = tau / nu,   k among the orders kept, k <= H

All m elements have the same orders. The unknowns X (n,) are the coefficients of element after element, with
n = m (2H + 1) if all orders are kept. The N samples of a basis period serve the alternating frequency/time method
(AFT) and bracket the switching times.

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import counted
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.harmonic.equations.harmonic_selection import HarmonicSelection, excited_orders
from hbgear.harmonic.equations.layout import Layout
from hbgear.mechanics.models import System
from hbgear.mechanics.plausibility import warn
from hbgear.mechanics.series.fourier import Transform, fast_length, places, resize, spread, stretch, to_real

MAX_UNKNOWNS = 4_000
"""Unknowns n of a balance. Its dense Jacobians take 8 n^2 bytes, and several are in memory at once."""

MAX_SAMPLES = 1_000_000
"""Samples N m of all elements together; a limit of memory."""

MAX_TABLE = 125_000_000
"""Entries (2H + 1) N of the table of basis functions, 1 GB. Error estimates use a table of twice this size."""

MAX_COUNT = 10**15
"""Largest count that is accepted as an argument. Larger ones are refused before they enter a computation."""

MIN_AUTOMATIC_HARMONICS, MAX_AUTOMATIC_HARMONICS = 4, 400
"""Range of harmonics of the excitation with ``harmonics="auto"``."""

MAX_REFINED_UNKNOWNS = 700
"""Unknowns up to which special points and undecided stability are computed again with twice the harmonics."""


@dataclass(frozen=True)
class Discretization:
    """Harmonics and samples of the motions of m elements.

    Attributes
    ----------
    m : int
        Number of elements.
    H : int
        Highest harmonic of the basis frequency Omega / nu.
    nu : int
        Subharmonic order.
    N : int
        Samples per basis period.
    selection : HarmonicSelection, optional
        Rule for the orders that are unknowns; by default all up to H.
    sampled : bool, optional
        Whether every law is evaluated by AFT. False by default.
    density : float, optional
        N over the usual number of samples for H. Other numbers of harmonics use the same ratio. 1 by default.
    samples_given : bool, optional
        Whether the user set N. False by default.

    Raises
    ------
    ValueError
        If H < nu, or there are too many unknowns or samples.
    """

    m: int
    H: int
    nu: int
    N: int
    selection: HarmonicSelection | None = None
    sampled: bool = False
    density: float = 1.0
    samples_given: bool = False

    def __post_init__(self) -> None:
        if self.nu > self.H:
            raise ValueError(
                f"harmonics = {self.H} of Omega / {self.nu} do not reach Omega itself; need at least {self.nu}"
            )
        self._check_unknowns(self.H if self.selection is None else self.selection.min_count(self.H))
        if self.N * self.m > MAX_SAMPLES:
            raise ValueError(
                f"samples = {self.N:,} for {self.m} elements; at most {MAX_SAMPLES // self.m:,} are possible"
            )
        if (2 * self.H + 1) * self.N > MAX_TABLE:
            raise ValueError(
                f"harmonics up to {self.H:,} with {self.N:,} samples need {(2 * self.H + 1) * self.N * 8e-9:.2g} GB "
                f"for a table of basis functions; at most {MAX_TABLE * 8e-9:.2g} GB are used: give fewer harmonics, or "
                "a machine whose frequencies have a larger common base, such as fewer unbalanced wheels"
            )
        self._check_unknowns(len(self.orders) - 1)

    def _check_unknowns(self, count: int) -> None:
        """Raise ValueError if this number of orders, without the mean, gives too many unknowns."""
        size = self.m * (2 * count + 1)
        if size <= MAX_UNKNOWNS:
            return
        if self.selection is None:
            raise ValueError(
                f"harmonics = {self.H} for {self.m} elements make {size:,} unknowns; at most {MAX_UNKNOWNS:,} can be "
                f"solved for: H <= {(MAX_UNKNOWNS // self.m - 1) // 2}"
            )
        raise ValueError(
            f"{count} orders up to {self.H} for {self.m} elements make {size:,} unknowns; at most {MAX_UNKNOWNS:,} "
            "can be solved for: give fewer harmonics, or tooth counts with a simpler ratio"
        )

    # ---- sizes

    @cached_property
    def orders(self) -> np.ndarray:
        """Basis harmonics (K + 1,) that are unknowns, ascending from 0."""
        return np.arange(self.H + 1) if self.selection is None else self.selection.selected(self.H, self.nu)

    @cached_property
    def transform(self) -> Transform:
        """Tables that take H harmonics to N samples and back."""
        return Transform(self.H, self.N)

    @property
    def size(self) -> int:
        """Number of unknowns n = m (2K + 1) of K orders."""
        return self.m * (2 * len(self.orders) - 1)

    @property
    def means(self) -> np.ndarray:
        """Positions (m,) of the means of the elements among the unknowns."""
        return np.arange(self.m) * (self.size // self.m)

    @property
    def resolution(self) -> str:
        """Number of harmonics in words."""
        return f"H = {self.H}" if self.selection is None else f"{len(self.orders) - 1} orders up to {self.H}"

    def fits(self, H: int, limit: int = MAX_UNKNOWNS) -> bool:
        """Return whether the unknowns of H harmonics are no more than a limit, and their tables are not too large."""
        count = H + 1 if self.selection is None else len(self.selection.selected(H, self.nu))
        N = _samples_for(H, self.sampled, self.density)
        return self.m * (2 * count - 1) <= limit and N * self.m <= MAX_SAMPLES and (2 * H + 1) * N <= MAX_TABLE

    def describe(self, auto: float | None) -> dict[str, Any]:
        """Return the settings as plain data, for the header of a file; ``auto`` is the tolerance of an adapted H."""
        orders = {} if self.selection is None else {"orders": self.selection.described}
        settings = {"harmonics": self.H, "samples": self.N, "nu": self.nu, "sampled": self.sampled}
        return {**settings, "auto": auto, **orders}

    # ---- other resolutions

    def with_order(self, nu: int, harmonics: int | None = None) -> Discretization:
        """Return another subharmonic order; by default H is scaled with nu."""
        H = harmonics or self.H * nu // self.nu
        counted("nu", nu, MAX_COUNT)
        counted("harmonics", H, MAX_COUNT)
        return self._changed(nu=int(nu), H=int(H))

    def denser(self, times: int, harmonics: int = 1) -> Discretization:
        """Return a multiple of the samples per harmonic and of the harmonics."""
        return self._changed(density=times * self.density, H=harmonics * self.H)

    def with_selection(self, selection: HarmonicSelection, H: int) -> Discretization:
        """Return other orders, up to basis harmonic H."""
        return self._changed(selection=selection, H=H)

    def _changed(self, **changes: Any) -> Discretization:
        """Return a copy with changed fields and the number of samples that belongs to them."""
        H, density = changes.get("H", self.H), changes.get("density", self.density)
        return replace(self, **changes, N=_samples_for(H, self.sampled, density))

    def adapted_harmonics(self, error: float, tolerance: float) -> int | None:
        """Return another H for a motion with this truncation error; None to keep it.

        H grows by 40 % if the error exceeds the tolerance, and shrinks by 20 % if it is below a hundredth of it.
        """
        unit = self.nu * (1 if self.selection is None else self.selection.unit)
        lowest, highest = MIN_AUTOMATIC_HARMONICS * unit, MAX_AUTOMATIC_HARMONICS * unit
        if error > tolerance and highest > self.H and self.fits(more := self.H + max(2, int(0.4 * self.H))):
            return min(highest, more)
        if error < 1e-2 * tolerance and lowest < self.H:
            return max(lowest, int(0.8 * self.H))
        return None

    @property
    def refinable(self) -> bool:
        """Whether 2H harmonics are within the limits of a refined problem."""
        is_in_range = self.selection is not None or MAX_AUTOMATIC_HARMONICS * self.nu >= 2 * self.H
        return is_in_range and self.fits(2 * self.H, MAX_REFINED_UNKNOWNS)

    # ---- unknowns

    def spread(self, X: Array) -> Array:
        """Return coefficients (..., m, 2H + 1) of all harmonics from unknowns (..., n)."""
        return spread(X, self.m, self.orders, self.H)

    def subharmonic_part(self, X: Array) -> Array:
        """Return the coefficients that a basis of a smaller nu does not contain; empty for nu = 1."""
        if self.nu == 1:
            return np.empty(0)
        factor = next(p for p in range(2, self.nu + 1) if self.nu % p == 0)
        k = np.concatenate([[0], np.repeat(self.orders[1:], 2)])
        return X.reshape(self.m, -1)[:, k % factor != 0].ravel()

    def solution_norm(self, X: Array) -> float:
        """Return the norm of the alternating part of X (n,)."""
        return norm(X.reshape(self.m, -1)[:, 1:])

    def solution_norms(self, X: Array) -> Array:
        """Return the norms (P,) of the alternating parts of X (P, n)."""
        return norms(X.reshape(len(X), self.m, -1)[:, :, 1:])

    def resized(self, X: Array, exact: ComplexArray) -> Array:
        """Return unknowns of any number of harmonics, cut or padded to these orders; for ``exact`` see `restrict`.

        Raises
        ------
        ValueError
            If the length of X belongs to no number of harmonics.
        """
        if len(X) == self.size:
            return X
        n = len(X) // self.m
        orders = np.arange(n // 2 + 1) if self.selection is None else self.selection.of_length(n, self.nu)
        if orders is None or len(X) % self.m or n % 2 == 0:
            raise ValueError(
                f"{len(X)} coefficients do not belong to {self.m} elements with the orders of any number of H"
            )
        return self.restrict(spread(X, self.m, orders, int(orders[-1])), orders, exact)

    def from_layout(self, X: Array, layout: Layout, exact: ComplexArray) -> Array:
        """Return the unknowns of a motion that is given in another layout; for ``exact`` see `restrict`.

        Raises
        ------
        ValueError
            If the number of elements differs, or the motion is not periodic with this nu.
        """
        if len(layout.elements) != self.m:
            raise ValueError(f"the motion has {len(layout.elements)} elements; this model has {self.m}")
        if self.nu % layout.nu:
            raise ValueError(
                f"a motion of order nu = {layout.nu} is not periodic with nu = {self.nu}; need a multiple of it"
            )
        ratio, orders = self.nu // layout.nu, np.arange(layout.harmonics + 1)
        orders = orders if layout.orders is None else np.array([0, *layout.orders])
        return self.restrict(stretch(layout.spread(X), ratio), ratio * orders, exact)

    def restrict(self, rows: Array, known_orders: np.ndarray, exact: ComplexArray) -> Array:
        """Return the unknowns (n,) from rows (m, 2h + 1), whose orders ``known_orders`` were unknowns.

        ``exact`` (H + 1, m) holds the harmonics of prescribed displacements with breakpoints. All of their harmonics
        enter the elements, but the unknowns contain their kept orders only.
        """
        out = resize(rows, self.H)
        if exact.any():
            added = places(np.setdiff1d(self.orders, known_orders))
            out[:, added] -= to_real(exact.T)[:, added]
        selected = out if self.selection is None else out[:, places(self.orders)]
        return selected.ravel()


def discretize(
    m: int,
    harmonics: int | None,
    samples: int | None,
    nu: int,
    sampled: bool,
    selection: HarmonicSelection | None,
    highest: bool,
) -> Discretization:
    """Return the discretization that arguments of `HarmonicBalance` describe.

    ``harmonics`` is None for "auto". With a selection of tones it counts the harmonics of every mesh, or is H itself
    if ``highest`` is True.

    Raises
    ------
    ValueError
        If the orders are listed but the number of harmonics is automatic, or as of `Discretization`.
    """
    H = _highest_harmonic(harmonics, nu, selection, highest)
    if samples is not None:
        counted("samples", samples, MAX_COUNT)
    density = 1.0 if samples is None else max(1.0, samples / _usual_samples(H, sampled))
    N = int(samples or _samples_for(H, sampled, density))
    return Discretization(m, H, nu, N, selection, sampled, density, samples is not None)


def _highest_harmonic(harmonics: int | None, nu: int, selection: HarmonicSelection | None, highest: bool) -> int:
    """Return H of the arguments of `discretize`."""
    count = MIN_AUTOMATIC_HARMONICS if harmonics is None else harmonics
    if selection is None:
        return count * nu if harmonics is None else count
    if selection.given and harmonics is None:
        raise ValueError("harmonics = 'auto' chooses the orders itself: give orders='meshes', or no 'auto'")
    if highest and harmonics is not None:
        return count
    return nu * (max(selection.given) if selection.given else count * selection.unit)


def _usual_samples(H: int, sampled: bool) -> int:
    """Return the usual number of samples per basis period."""
    return max(1024, 64 * H) if sampled else max(64, 8 * H)


def _samples_for(H: int, sampled: bool, density: float) -> int:
    """Return N for H harmonics: a length for which the fast Fourier transform is fast."""
    return int(fast_length(math.ceil(density * _usual_samples(H, sampled))))


def warn_of_truncated_excitation(discretization: Discretization, system: System) -> None:
    """Warn if orders of the excitation are not among the unknowns."""
    H, nu = discretization.H, discretization.nu
    highest = max(
        [e.displacement.order for e in system.elements]
        + [load.order for load in system.loads]
        + [slider.series.order for e in system.elements for slider in e.law.sliders]
    )
    by_element = zip((e.name for e in system.elements), excited_orders(system), strict=False)
    missed = next(((name, min(orders)) for name, orders in by_element if orders and min(orders) * nu > H), None)
    if missed is not None:
        warn(
            f"the excitation of {missed[0]} begins at order {missed[1]} of Omega, and {discretization.resolution} "
            "leaves it out: give at least as many harmonics, or orders"
        )
    elif highest * nu > H:
        warn(
            f"the excitation has {highest} harmonics but H = {H} with nu = {nu} keeps only {H // nu}; the response "
            "to those up to 2H is a part of the stated errors, and the others are left out: give more harmonics"
        )
    elif discretization.selection is not None:
        selected = {k // nu for k in discretization.orders.tolist() if k % nu == 0}
        excited = {k for orders in excited_orders(system, corners=False) for k in orders if k * nu <= H}
        missing = sorted(excited - selected)
        if missing:
            warn(
                f"the excitation has order {missing[0]}, which is not an unknown; the response to it is a part of "
                "the stated errors: give more harmonics, or this order too"
            )
