"""Harmonic balance in the coordinates of the elements.

    R_k(d) = Z_k(Omega) d_k + g_k(Omega) + f_k(d) = 0,   k = 0..H, or a selection of these orders

The unknowns X are the real Fourier coefficients of the m element coordinates, element after element, n = m (2H + 1) in
all. Their number does not depend on the number of coordinates of the structure. Z and g come from
`hbgear.harmonic.structure.receptance`. The force harmonics f_k of piecewise-linear and cubic laws are exact
(`hbgear.harmonic.forces.projection_kernels`). Any other law is evaluated by the alternating frequency/time method
(AFT, `hbgear.harmonic.forces.aft`): N samples per period and a fast Fourier transform.

`HarmonicBalance` composes three parts: `Discretization` (harmonics, samples), `ModelCache` (the model at each parameter
set) and the functions of `hbgear.harmonic.equations.motion` (quantities of one motion). Its base classes hold the
equations (`HarmonicEquations`) and the quantities of their solutions (`PeriodicMotions`).

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036, for AFT.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.facade import call
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.harmonic.balance.equations import FREQUENCIES
from hbgear.harmonic.balance.initial_guess import find_motion
from hbgear.harmonic.balance.motions import PeriodicMotions
from hbgear.harmonic.balance.resolution import largest_amplitudes, with_enough_samples
from hbgear.harmonic.bifurcations.no_contact import ARBITRARY, pins_of
from hbgear.harmonic.equations.discretization import (
    MAX_AUTOMATIC_HARMONICS,
    MAX_COUNT,
    discretize,
    warn_of_truncated_excitation,
)
from hbgear.harmonic.equations.harmonic_selection import HarmonicSelection, select_harmonics
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.equations.model_cache import ModelCache
from hbgear.harmonic.forces.law_checks import check_laws
from hbgear.harmonic.structure.linear_structure import MODAL_LIMIT
from hbgear.harmonic.structure.measured import MeasuredStructure
from hbgear.harmonic.structure.recession import Receded, longest, recession
from hbgear.mechanics.models import Model, describe
from hbgear.mechanics.plausibility import check_problem, check_size

_MIN_RECESSION_RATIO = 10.0
"""Size of a motion, over the largest length of the model, from which the recession is examined."""

_MARGINAL_ORDERS = 0.03
"""Part of the tolerance of orders down to which they are unknowns of refined problems, for error estimates."""


class HarmonicBalance(PeriodicMotions):
    """Periodic motions of a model by harmonic balance: a problem for `trace`.

    Parameters
    ----------
    model : Model
        Any gear pair, oscillator, train or `System`.
    harmonics : int or "auto", optional
        H, number of harmonics of the basis frequency Omega / nu, 16 by default. With "auto" a trace adapts H from
        point to point so that the estimated truncation error stays below ``tolerance``.
    samples : int, optional
        N per basis period, for laws evaluated by AFT and to bracket switching times. By default the next fast length
        above 8H (at least 64), or 64H (at least 1024) with ``sampled``.
    nu : int, optional
        Subharmonic order, 1 by default; 2 for period-doubled motions.
    sampled : bool, optional
        Evaluate piecewise-linear laws by AFT too instead of the exact projection, as a cross-check. False by default.
    tolerance : float, optional
        Largest estimated truncation error (rms of the elements) with ``harmonics="auto"``. 1e-6 by default.
    reduce : bool, optional
        Reduce large structures. The stability of a structure with more than 60 modes (30 coordinates) is then computed
        from the modes that the stiffness harmonics of the elements reach, at most up to three times the highest
        harmonic of the motion, and one mode per element that represents the others. ``branch.meta["stability"]`` holds
        the estimated error of the multipliers. Curves change only for more than 1500 coordinates; see `restricted_to`.
        True by default.
    orders : "meshes", "all" or sequence of int, optional
        Orders of Omega that are unknowns in addition to the mean; by default all up to H, or "meshes" if the excitation
        of an element or load begins above the order H or 60. "meshes" selects them for meshes of several tooth
        frequencies and shaft orders: ``harmonics`` then counts the harmonics of the fastest, and combinations
        |k_1 p_1 + k_2 p_2| of their orders p_1, p_2 are kept while (1 + |k_1|) (1 + |k_2|) <= 1 + harmonics. "all"
        selects all up to H. The highest number of a list is H, and ``harmonics`` is ignored. The truncation error
        covers the other orders.

    Raises
    ------
    ValueError
        If H < nu, N < 2H + 1, nu < 1, there are too many unknowns or samples, the model has no periodic motion
        (singular M, unbalanced load), orders are not whole numbers, or they are listed with ``harmonics="auto"``.

    Notes
    -----
    The parameters are ``Omega`` and the float fields of the model; ``evaluate(X, Omega=..., zeta=...)`` takes the
    values that differ from the model. Evaluations do not depend on earlier ones, and threads may share a problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(), harmonics=8)
    >>> X = pair.start(Omega=0.9)
    >>> R, J = pair.evaluate(X, Omega=0.9)
    >>> R.shape, J.shape
    ((17,), (17, 17))
    """

    @checked_arguments()
    def __init__(
        self,
        model: Model,
        harmonics: int | str = 16,
        samples: int | None = None,
        nu: int = 1,
        sampled: bool = False,
        tolerance: float = 1e-6,
        reduce: bool = True,
        orders: str | Sequence[int] | HarmonicSelection | None = None,
    ) -> None:
        counted("nu", nu, MAX_COUNT)
        if harmonics != "auto":
            counted("harmonics", harmonics, MAX_COUNT)
        checked("HarmonicBalance", "tolerance", tolerance, POSITIVE)
        self.auto, self.tolerance = harmonics == "auto", float(tolerance)
        system = model.system()
        H = None if self.auto else int(harmonics)
        selection = select_harmonics(orders, system, None if H is None else H // int(nu))
        highest = isinstance(orders, HarmonicSelection)
        grid = discretize(len(system.elements), H, samples, int(nu), bool(sampled), selection, highest)
        super().__init__(ModelCache(model, system, grid, bool(reduce)))
        warn_of_truncated_excitation(grid, system)
        if not reduce or system.n <= MODAL_LIMIT:
            check_size(system)
        check_laws(system)
        self.compiled({})
        check_problem(model, system, MAX_AUTOMATIC_HARMONICS if self.auto else self.H // self.nu)

    def __repr__(self) -> str:
        kind = ", sampled" if self.is_sampled else ""
        kind += "" if self.selection is None else f", {len(self.orders) - 1} orders"
        return f"HarmonicBalance({self.model!r}, harmonics={self.H}, nu={self.nu}{kind})"

    @property
    def changes(self) -> bool:  # type: ignore[override]
        """Whether the number of harmonics may change along a curve."""
        return self.auto

    @property
    def restarts(self) -> bool:  # type: ignore[override]
        """Whether an under-resolved curve is traced again; not with selected orders, which are a choice of the cost."""
        return self.selection is None

    @property
    def equivalent_size(self) -> int:
        """Number of coefficients up to the highest order: the forces of selected orders have tables of all of them."""
        return self.m * (2 * self.H + 1)

    def describe(self) -> dict[str, Any]:
        """Return model and settings as plain data, for the header of a saved branch."""
        balance = self.discretization.describe(self.tolerance if self.auto else None)
        return {"model": describe(self.model), "balance": balance}

    def require_fixed_resolution(self, caller: str) -> None:
        """Raise ValueError if the number of harmonics is "auto"; the message names the caller."""
        if self.auto:
            raise ValueError(f"{caller} needs one number of harmonics throughout, not 'auto'; give harmonics=16, say")

    @checked_arguments()
    def start(self, Omega: float, **parameters: float) -> Array:  # type: ignore[override]
        """Return a periodic motion at Omega.

        Newton starts from the state of rest and the linear response about it. If that fails, from other static states,
        with dampers parallel to the elements that are removed along a path, and from a motion at another frequency. If
        the motion found is unstable and there are several stable static states, a stable one across them is searched.

        Raises
        ------
        NoConvergence
            If Newton converges from none of these guesses.
        """
        checked("start", "Omega", Omega, FREQUENCIES)
        return find_motion(self, {name: float(value) for name, value in (parameters | {"Omega": Omega}).items()})

    def own_trace(
        self, span: tuple[float, float], start: Any, settings: Any, cover: bool, unresolved: bool = False
    ) -> Branch | str | None:
        """Return a curve of hard stops, which H harmonics do not resolve; see `trace_hard_stops`."""
        function = "hbgear.harmonic.contact_instants.hard_stops.trace_hard_stops"
        return call(function, self, span, start, settings, cover, unresolved)

    # ---- other harmonics

    @checked_arguments()
    def with_order(self, nu: int, harmonics: int | None = None) -> HarmonicBalance:
        """Return the balance with another subharmonic order; by default harmonics reach the same frequency."""
        out = self._derived(self.discretization.with_order(nu, harmonics))
        out.compiled({})
        return out

    @checked_arguments()
    def with_tolerance(self, tolerance: float) -> HarmonicBalance:
        """Return the balance with ``harmonics="auto"`` from the present number of harmonics on."""
        out = self._derived()
        out.auto, out.tolerance = True, float(tolerance)
        return out

    @checked_arguments()
    def with_harmonics_of(self, curve: Branch, tolerance: float = 1e-6) -> HarmonicBalance:
        """Return the balance with exactly the orders that the motions of a curve contain.

        An order is kept if its amplitude in any element exceeds the tolerance at any point. Amplitudes of orders up to
        2H that are not unknowns of this problem are the response to the truncated force harmonics, so a curve with few
        orders shows which ones a second curve needs. Subharmonics are all kept.

        Raises
        ------
        ValueError
            If the curve has other elements, or no order exceeds the tolerance.
        """
        checked("with_harmonics_of", "tolerance", tolerance, POSITIVE)
        if not isinstance(curve.layout, Layout):
            raise ValueError("with_harmonics_of needs a curve of periodic motions")
        sizes = largest_amplitudes(self, curve)
        given, more = (
            tuple((1 + np.flatnonzero(sizes > level)).tolist()) for level in (tolerance, _MARGINAL_ORDERS * tolerance)
        )
        if not given:
            raise ValueError(f"no order of these motions exceeds {tolerance:g}: give a smaller tolerance")
        selection = HarmonicSelection(given=given, more=more)
        out = self._derived(self.discretization.with_selection(selection, self.nu * given[-1]))
        out.auto = False
        warn_of_truncated_excitation(out.discretization, out.compiled({}).system)
        return out

    def adapted(self, observed: Mapping[str, Any]) -> HarmonicBalance | None:
        """Return the balance with the harmonics that a motion with this truncation error needs; None to keep them."""
        H = self.target_harmonics(observed.get("error", 0.0))
        return None if H is None else self.with_order(self.nu, H)

    def target_harmonics(self, error: float) -> int | None:
        """Return another H for a motion with this truncation error; None to keep it, and unless "auto"."""
        return self.discretization.adapted_harmonics(error, self.tolerance) if self.auto else None

    @property
    def doubled(self) -> HarmonicBalance:
        """Balance in the basis of twice the period, with 2H + 1 harmonics, for period doublings."""
        return self._cached("doubled", (), lambda: self.with_order(2 * self.nu, 2 * self.H + 1))

    @property
    def refined_problem(self) -> HarmonicBalance | None:
        """Balance with 2H harmonics; None if these are too many, or receptances are measured."""
        if isinstance(self.compiled({}).structure, MeasuredStructure) or not self.discretization.refinable:
            return None
        finer = self._cached("refined", (), lambda: self.with_order(self.nu, 2 * self.H))
        return None if finer.models.reduced_for is not None and finer.models.reduction({}) is None else finer

    @property
    def comparisons(self) -> Sequence[tuple[ContinuationProblem, float]]:
        """Balances with 3/2 H and 2H harmonics, each with the weight 1 in error estimates.

        Errors of special points decrease as H^-3 or faster with backlash, but oscillate, and two numbers of harmonics
        detect that. Without a refined problem H/2 and 3/4 H serve, with weights for errors of order H^-2:
        e(r H) - e(H) = (r^-2 - 1) e(H).
        """
        return self._cached("comparisons", (), self._compared)

    def _compared(self) -> Sequence[tuple[ContinuationProblem, float]]:
        finer = self.refined_problem
        if finer is not None:
            intermediate = 3 * self.H // 2
            is_larger = self.selection is None and intermediate > self.H
            return (*([(self.with_order(self.nu, intermediate), 1.0)] if is_larger else []), (finer, 1.0))
        fewer = [(3 * self.H // 4, 3 / 4), (self.H // 2, 1 / 2)]
        return tuple((self.with_order(self.nu, H), 1 / (r**-2 - 1)) for H, r in fewer if self.nu <= H < self.H)

    def at_resolution_of(self, point: Point) -> HarmonicBalance:
        """Return the balance with the harmonics of a point if these are more, or if its period is another one."""
        layout = point.layout
        if not isinstance(layout, Layout) or (layout.nu == self.nu and layout.harmonics <= self.H):
            return self
        resolution = layout.nu, layout.harmonics
        return self._cached("resized", resolution, lambda: self.with_order(*resolution))

    # ---- other samples, springs and loads

    def denser(self, times: int, harmonics: int = 1) -> HarmonicBalance:
        """Return the balance with a multiple of the samples per harmonic and of the harmonics."""
        return self._cached(
            "denser", (times, harmonics), lambda: self._derived(self.discretization.denser(times, harmonics))
        )

    def resolved(self, X: Array, parameters: Mapping[str, float]) -> HarmonicBalance:
        """Return the balance with as many samples as the AFT of a motion requires; itself if they were given."""
        if self.discretization.samples_given or not self.compiled(parameters).aft_laws:
            return self
        return with_enough_samples(self, X, parameters)

    def arbitrary(self, X: Array, parameters: Mapping[str, float]) -> tuple[HarmonicBalance, str] | None:
        """Return the balance with springs that fix a motion without contact, and a message; None if it is determined.

        See `hbgear.harmonic.bifurcations.no_contact`.
        """
        pins = pins_of(self, X, parameters) if self.pins is None else None
        if pins is None:
            return None
        out = self._derived()
        out.pins = pins
        return out, ARBITRARY

    def recession(self, X: Array, parameters: Mapping[str, float]) -> HarmonicBalance | None:
        """Return the balance without gaps, loads and prescribed displacements, for motions far larger than these.

        With backlash it is linear: all teeth stay in mesh. None for smaller motions, and if the force of a law does not
        grow in proportion to the motion.
        """
        system = self.compiled(parameters).system
        if self.solution_norm(X) < _MIN_RECESSION_RATIO * longest(system):
            return None
        if any(recession(element.law) is None for element in system.elements):
            return None
        return self._cached("recession", (), lambda: self._derived(models=self.models.of_model(Receded(self.model))))
