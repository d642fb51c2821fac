"""Harmonic balance in the element coordinates.

    R_k(d) = Z_k(Omega) d_k + g_k(Omega) + f_k(d) = 0,   k = 0..H, or some of these orders

The unknowns are the m (2H + 1) real coefficients of the element coordinates, element after element; the number of
coordinates of the structure does not appear. Z and g come from `receptance`, the force harmonics f_k from `projection`
(piecewise-linear and cubic laws, exact) or from N samples per period by fast Fourier transform (any law).

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036, for sampled laws.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.lru_cache import LRUCache
from hbgear.common.ranges import ANY, POSITIVE, Range, checked, counted
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.events.event import Event
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import FOLD, Evaluation, Locating, Pursuit
from hbgear.continuation.problem.finite_differences import STEP, directional_step, parameter_derivatives
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch, Point
from hbgear.continuation.solvers.homotopy import newton_homotopy
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.harmonic.bifurcations.events import motion_events
from hbgear.harmonic.bifurcations.no_contact import ARBITRARY, FirstContact, Pins, pins_of
from hbgear.harmonic.equations.evaluator import Crossings, Evaluator
from hbgear.harmonic.equations.harmonic_selection import HarmonicSelection, excited_orders, select_harmonics
from hbgear.harmonic.equations.initial_guess import continue_from_nearby_frequency, from_damped, initial_guesses
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.equations.sampling_error import add_sampling_error, newton_step
from hbgear.harmonic.forces.law_checks import check_laws
from hbgear.harmonic.forces.packed_model import PackedModel
from hbgear.harmonic.forces.real_basis import derivative
from hbgear.harmonic.multipliers.floquet import floquet_multipliers, is_reduced
from hbgear.harmonic.multipliers.floquet import reduction as stability_reduction
from hbgear.harmonic.stability.verification import verify_multipliers
from hbgear.harmonic.structure.measured import STABILITY_NOT_AVAILABLE, MeasuredStructure
from hbgear.harmonic.structure.perturbed import FirstOrderExpansion
from hbgear.harmonic.structure.receptance import MODAL_LIMIT, LinearStructure
from hbgear.harmonic.structure.recession import Receded, longest, receded
from hbgear.harmonic.structure.speed_dependent import SpeedDependentStructure
from hbgear.mechanics.models import Model, System, describe
from hbgear.mechanics.plausibility import check_frequency, check_gaps, check_problem, check_size, check_truncation, warn
from hbgear.mechanics.reduction import Reduction, reduced_within
from hbgear.mechanics.reference_stiffness import references
from hbgear.mechanics.series.fourier import Transform, fast_length, places, resize, spread, stretch, to_complex, to_real

_UNKNOWNS = 4_000  # of the dense Jacobians, several of which are held at once


_SAMPLES = 1_000_000  # of all elements together


_MOST_SAMPLES = 32_768  # that are chosen for a period


_ALIASED = 1e-5  # change of a motion by twice the samples, relative to its size, for which they are chosen


_WORK = 2e8  # squares of products of one call of `observe_many`, so that Ctrl-C is heard within a second


_COUNTABLE = 10**15  # larger numbers are refused before anything is computed with them


_FREQUENCIES = Range(above=0, high=1e60)  # so that powers of Omega are numbers


_FELT, _SEEN = 1e-11, 1e-8  # changes of the balance, relative, that are no rounding, and that can be measured


_VAST = 1e40  # beyond which no parameter is of any effect


_FAR = 10.0  # size of a motion, over the largest length of the model, from which that may lose its meaning


_MANY = 700  # unknowns up to which special points and verdicts in doubt are solved for with more of them


_LOOPED = 160  # unknowns up to which the compiled loop along a curve is faster than LAPACK


_MARGIN = 0.03  # of the tolerance of orders, down to which those are kept that tell the error of special points


_FEWEST, _MOST = 4, 400  # harmonics of the excitation that "auto" stays between


class HarmonicBalance(ContinuationProblem):
    """Periodic motions of a model by harmonic balance: a problem for `trace`.

    Parameters
    ----------
    model : `Model` (any gear pair, oscillator or `System`).
    harmonics : H, number of harmonics of the basis frequency Omega / nu; or "auto": a trace then raises and lowers H
        from row to row so that the estimated truncation error stays below ``tolerance``.
    samples : N per basis period, for laws that are sampled and as the grid that brackets contact instants; by
        default the next fast length above 8H (at least 64), or 64H (at least 1024) with ``sampled``.
    nu : subharmonic order; 2 for period-doubled motions.
    sampled : sample piecewise-linear laws too instead of projecting them exactly (a cross-check).
    tolerance : largest estimated truncation error (rms of the gap motion) with ``harmonics="auto"``.
    reduce : compute the stability of a structure with more than 60 modes (30 coordinates) from those that harmonics of
        the stiffness of its elements reach, three times the highest harmonic of the motion at most, and one mode for
        each element in the place of the others; False for all modes. The error of the multipliers is estimated from
        twice as many modes and told in ``branch.meta["stability"]``. Curves do not depend on it, but of a structure of
        more than 1500 coordinates: see `within`.
    orders : the orders of Omega that are unknowns, beside the mean; None for all up to H. "meshes" chooses them for
        meshes of several tooth frequencies: ``harmonics`` then counts those of every mesh, and combinations
        |k_1 p_1 + k_2 p_2| of their orders p_1, p_2 are kept while (1 + |k_1|) (1 + |k_2|) <= 1 + harmonics. Or a list
        of them, of which H is the highest, whatever ``harmonics``. What is left out counts in the truncation error.

    Raises
    ------
    ValueError
        If H < nu, N < 2H + 1, nu < 1, there are too many unknowns or samples, the model cannot move periodically
        (singular M, unbalanced load), or orders are no whole numbers, or given ones shall vary ("auto").

    Notes
    -----
    Its parameters are ``Omega`` and the float fields of the model; ``evaluate(X, Omega=..., zeta=...)`` takes those
    that differ from the model's.

    What an evaluation gives depends on nothing that was asked before, and threads may share a problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(), harmonics=8)
    >>> X = pair.start(Omega=0.9)
    >>> R, J = pair.evaluate(X, Omega=0.9)
    >>> R.shape, J.shape
    ((17,), (17, 17))

    Two meshes whose tooth frequencies are as 7 to 4:

    >>> import numpy as np
    >>> two = [
    ...     hb.Element(w, hb.Backlash(stiffness=hb.mechanics.Series(1.0, (0,) * (p - 1) + (0.2,))), damping=0.1,
    ...         name=f"mesh {p}")
    ...     for w, p in (([1, -1, 0], 7), ([0, 1, -1], 4))
    ... ]
    >>> load = hb.Load(constant=[0.2, 0, -0.2])
    >>> train = hb.System(M=np.eye(3), C=np.zeros((3, 3)), K=np.zeros((3, 3)), elements=two, load=load)
    >>> sparse = hb.HarmonicBalance(train, harmonics=8, orders="meshes")
    >>> sparse.H, len(sparse.orders), sparse.orders[:7].tolist()
    (56, 30, [0, 1, 2, 3, 4, 5, 6])
    """

    @checked_arguments()
    def __init__(
        self, model: Model, harmonics: int | str = 16, samples: int | None = None, nu: int = 1,
        sampled: bool = False, tolerance: float = 1e-6, reduce: bool = True,
        orders: str | Sequence[int] | HarmonicSelection | None = None,
    ) -> None:  # fmt: skip
        counted("nu", nu, _COUNTABLE)
        if harmonics != "auto":
            counted("harmonics", harmonics, _COUNTABLE)
        checked("HarmonicBalance", "tolerance", tolerance, POSITIVE)
        self.auto = harmonics == "auto"
        self.tolerance = float(tolerance)
        self.model, self.nu, self.is_sampled, self.reduce = model, int(nu), bool(sampled), bool(reduce)
        self._systems: LRUCache[System] = LRUCache(6)
        system = self._systems.get((), model.system)
        self.m = len(system.elements)
        self.selection = select_harmonics(orders, system)
        self.H = self._highest(_FEWEST if self.auto else int(harmonics), isinstance(orders, HarmonicSelection))
        if samples is not None:
            counted("samples", samples, _COUNTABLE)
        self._kept = 8
        self._around: FirstOrderExpansion | None = None
        self._structures: LRUCache[LinearStructure] = LRUCache(6)
        self._models: LRUCache[Model] = LRUCache(6)
        self._own = model.parameters | model.entries
        self.pins: Pins | None = None  # of motions whose position in the gap is arbitrary
        self._served: float | None = None  # Omega up to which a reduced structure stands for a large one
        # samples over the usual number for H, which other numbers of harmonics have too
        self._density = 1.0 if samples is None else max(1.0, samples / self._usual_samples(self.H))
        self._sampling_given = samples is not None
        self._prepare(samples)
        self._warn_truncated(system)
        if not self.reduce or system.n <= MODAL_LIMIT:
            check_size(system)
        check_laws(system)
        self.compiled({})
        check_problem(model, system, _MOST if self.auto else self.H // self.nu)

    def _highest(self, harmonics: int, known: bool) -> int:
        """H, of harmonics of every mesh if the orders are those of the meshes; known: the number is H."""
        if self.selection is None:
            return _FEWEST * self.nu if self.auto else harmonics
        if self.selection.given and self.auto:
            raise ValueError("harmonics = 'auto' chooses the orders itself: give orders='meshes', or no 'auto'")
        if known and not self.auto:
            return harmonics
        return self.nu * (max(self.selection.given) if self.selection.given else harmonics * self.selection.unit)

    def _usual_samples(self, H: int) -> int:
        return max(1024, 64 * H) if self.is_sampled else max(64, 8 * H)

    def _prepare(self, samples: int | None) -> None:
        """What depends on H and N alone."""
        H = self.H
        self.N = int(samples or fast_length(math.ceil(self._density * self._usual_samples(H))))
        self._check_size()
        self.orders = np.arange(H + 1) if self.selection is None else self.selection.kept(H, self.nu)
        self._check_unknowns(len(self.orders) - 1)
        self._transform = Transform(H, self.N)
        self._compiled: LRUCache[Evaluator] = LRUCache(self._kept)
        self._reduced: LRUCache[tuple[Reduction, float] | None] = LRUCache(self._kept)
        self._confined: LRUCache[HarmonicBalance] = LRUCache(4)
        self._receded: LRUCache[HarmonicBalance] = LRUCache(1)
        self._denser: LRUCache[HarmonicBalance] = LRUCache(2)
        self._finer: LRUCache[HarmonicBalance] = LRUCache(1)
        self._comparisons: LRUCache[Sequence[tuple[ContinuationProblem, float]]] = LRUCache(1)
        self._doubled: LRUCache[HarmonicBalance] = LRUCache(1)
        self._fitting: LRUCache[HarmonicBalance] = LRUCache(4)
        self._remembering: LRUCache[HarmonicBalance] = LRUCache(1)
        self._beside: LRUCache[HarmonicBalance] = LRUCache(1)
        self._units: LRUCache[float] = LRUCache(32)
        self._layout: LRUCache[Layout] = LRUCache(1)

    def __repr__(self) -> str:
        kind = ", sampled" if self.is_sampled else ""
        kind += "" if self.selection is None else f", {len(self.orders) - 1} orders"
        return f"HarmonicBalance({self.model!r}, harmonics={self.H}, nu={self.nu}{kind})"

    # ---- description

    usual_parameter = "Omega"
    singular_hint = "a gap that stays open without load: load the system"

    @property
    def changes(self) -> bool:  # type: ignore[override]
        """Whether the number of harmonics may change along a curve."""
        return self.auto

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of unknowns m (2H + 1), or that of the orders for H."""
        return self.m * (2 * len(self.orders) - 1)

    @property
    def means(self) -> np.ndarray:
        """Numbers (m,) of the unknowns that are the means of the elements."""
        return np.arange(self.m) * (self.size // self.m)

    def rows(self, X: Array) -> Array:
        """Rows (..., m, 2H + 1) of all harmonics of unknowns (..., n)."""
        return spread(X, self.m, self.orders, self.H)

    @property
    def resolution(self) -> str:
        """Number of harmonics, in words."""
        return f"H = {self.H}" if self.selection is None else f"{len(self.orders) - 1} orders up to {self.H}"

    @property
    def parameters(self) -> dict[str, float]:
        """The model's parameters; Omega is given with every evaluation."""
        return self.model.parameters

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        """Whether dR/dX is differentiable, so that folds can be found by Newton: no sampled corner in any law."""
        return not any(law.breakpoints for _, law in self.compiled({}).asked)

    @property
    def layout(self) -> Layout:
        """How a row of unknowns is to be read."""
        return self._layout.get((), self._read)

    def _read(self) -> Layout:
        system = self.compiled({}).system
        return Layout(
            harmonics=self.H,
            nu=self.nu,
            elements=tuple(e.name for e in system.elements),
            breakpoints=tuple(e.law.breakpoints for e in system.elements),
            labels=dict(self.model.labels),
            orders=None if self.selection is None else tuple(self.orders[1:].tolist()),
        )

    @property
    def dof_names(self) -> tuple[str, ...]:
        """Names of the coordinates of the structure."""
        reduction = self._reduction(())
        return tuple((self.compiled({}).system if reduction is None else reduction[0].full).dof_names)

    def describe(self) -> dict[str, Any]:
        """Model and settings as plain data, for the header of a saved branch."""
        return {
            "model": describe(self.model),
            "balance": {
                "harmonics": self.H,
                "samples": self.N,
                "nu": self.nu,
                "sampled": self.is_sampled,
                "auto": self.tolerance if self.auto else None,
                **({} if self.selection is None else {"orders": self.selection.described}),
            },
        }

    @checked_arguments()
    def check_parameter(self, name: str) -> None:
        """Refuse a parameter that neither is Omega nor a float field of the model."""
        known = ("Omega", *self._own)
        if name not in known:
            raise KeyError(f"{type(self.model).__name__} has no parameter '{name}'{did_you_mean(name, known)}")

    def value_of(self, name: str) -> float:
        """The value that the model has of a parameter or of an entry of a tuple, such as ``eps[0]``.

        Raises
        ------
        KeyError
            If there is none of that name.
        """
        self.check_parameter(name)
        if name == "Omega":
            raise KeyError("Omega is no value of the model; it is given with every evaluation")
        return float(self._own[name])

    def range_of(self, name: str) -> Range:
        """Values a parameter may have; Omega is positive, and within the tables of a structure that has some."""
        if name != "Omega":
            return self.model.ranges.get(name, ANY)
        speed = self.compiled({}).system.speed
        return POSITIVE if speed is None else speed.range

    def unit_of(self, name: str, value: float) -> float:
        """As of every problem; of a parameter that is zero in the model, by what it does to the balance, if it is vast.

        Omega is never zero, so its unit is its value. A support without stiffness in N/m is not small next to a
        hundredth of 1 N/m: the unit is what changes the balance by a thousandth of its size.
        """
        if name == "Omega" and value:
            return abs(value)
        unit = super().unit_of(name, value)
        if value or self._own.get(name, 1.0):
            return unit
        return self._units.get(name, lambda: self._unit_at_zero(name, unit))

    def _unit_at_zero(self, name: str, usual: float) -> float:
        own = self.compiled({})
        length, Omega = longest(own.system) or 1.0, abs(float(np.mean(self.model.default_span)))
        X = np.zeros((self.m, 2 * self.H + 1))
        X[:, :3] = length * np.array([0.5, 1.5, 0.5])
        R, *_, size = own.linearise(X.ravel(), Omega)
        h = STEP * usual
        while h < _VAST:
            try:
                change = float(np.linalg.norm(self.compiled({name: h}).linearise(X.ravel(), Omega)[0] - R)) / size
            except ValueError:  # out of its range
                return usual
            if change > (_FELT if h == STEP * usual else _SEEN):
                return usual if h == STEP * usual else 1e-3 * h / change
            h *= 1e6
        return usual

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """Warn of an Omega far above every natural frequency of the model; refuse one without its receptances."""
        Omega = high if name == "Omega" else fixed["Omega"]
        measured = self.compiled({}).system.receptances
        if measured is not None:
            measured.check(low if name == "Omega" else Omega, Omega, self.H, self.nu)
        check_frequency(self.compiled({}).structure.at(Omega), Omega)

    def restricted_to(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> HarmonicBalance:
        """The same with a structure too large for all its modes reduced to those that matter in such a curve.

        Its receptances are exact to 1e-9 up to the highest harmonic of the highest Omega; the error is told in
        ``branch.meta["structure"]``. Itself if the structure is smaller, more modes than 256 would be needed, or with
        ``reduce=False``.
        """
        if not self.reduce or not (self._served or self.compiled({}).structure.large):
            return self
        level = 2.0 ** math.ceil(math.log2(high if name == "Omega" else fixed["Omega"]))
        if self._served is not None and level <= self._served:
            return self
        return self._confined.get(level, lambda: self._serving(level) or self._serving(None) or self)

    def _serving(self, Omega: float | None) -> HarmonicBalance | None:
        """The same with a structure reduced for frequencies up to Omega, or the whole one; None if it cannot be."""
        out = copy.copy(self)
        out._served, out._structures, out._systems = Omega, LRUCache(6), LRUCache(6)
        out._prepare(self.N)
        return None if Omega is not None and out._reduction(()) is None else out

    def _reduction(self, changed: tuple[tuple[str, float], ...]) -> tuple[Reduction, float] | None:
        """The reduced structure at parameters that are not those of the model, and its error; None for the whole."""
        if self._served is None:
            return None
        highest = self._served * self.H / self.nu
        return self._reduced.get(changed, lambda: reduced_within(self._model_of(changed).system(), highest))

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Omega is given with every evaluation."""
        return () if "Omega" in known else ("Omega",)

    def postprocess(self, branch: Branch, observed: Sequence[Mapping[str, Any]]) -> Branch:
        """The branch as it is; warns where nothing ever comes near a corner of a law, or harmonics did not suffice."""
        beyond = np.flatnonzero(branch.error > self.tolerance) if self.auto else np.empty(0, dtype=int)
        if beyond.size:
            check_truncation(self.tolerance, self.H, branch.parameter, branch.values[beyond], branch.error[beyond])
        reduction = self._reduction(self._changed(branch.fixed))
        if reduction is not None:
            told = {"modes": reduction[0].system.n, "of": reduction[0].full.n, "error": reduction[1]}
            branch = replace(branch, meta={**branch.meta, "structure": told})
        if not observed:
            return branch
        clearances = [seen["clearance"] for seen in observed if "clearance" in seen]
        if branch.parameter == "Omega" and branch.status.complete and self.pins is None:
            check_gaps(self.clearance_names, np.array(clearances))
        return self._with_reduction(branch)

    def _with_reduction(self, branch: Branch) -> Branch:
        """The branch, whose header tells what leaving out modes does to the multipliers of its largest motion."""
        compiled = self.compiled({k: v for k, v in branch.fixed.items() if k != "Omega"})
        if isinstance(compiled.structure, MeasuredStructure):
            return replace(branch, meta={**branch.meta, "stability": STABILITY_NOT_AVAILABLE})
        if branch.parameter != "Omega" or branch.multipliers is None or not is_reduced(compiled):
            return branch
        some = np.argsort(-np.linalg.norm(branch.X, axis=1))[:1]
        told = stability_reduction(compiled, np.ascontiguousarray(branch.X[some]), branch.values[some])
        return replace(branch, meta={**branch.meta, "stability": told})

    def events(self, parameter: str) -> tuple[Event, ...]:
        """Period doublings, Neimark-Sacker points, grazing contacts, ends of subharmonic branches."""
        return motion_events(self.nu) if self.pins is None else (FirstContact(),)

    def resolved(self, X: Array, parameters: Mapping[str, float]) -> HarmonicBalance:
        """The same with as many samples as the sampled forces of a motion need; itself if these were given.

        They are doubled until aliasing moves the motion by no more than 1e-5 of its size; see `sampling_error`.
        """
        if self._sampling_given or not self.compiled(dict(parameters)).asked:
            return self
        best, known = self, X
        most = min(_SAMPLES // max(self.m, 1), _MOST_SAMPLES)
        while most >= 2 * best.N:
            denser = best.denser(2)
            if norm(newton_step(denser, known, parameters)) <= _ALIASED * norm(known):
                break
            best = denser
            with suppress(NoConvergence):
                known = solve(best, known, parameters).X
        return best

    def denser(self, times: int, harmonics: int = 1) -> HarmonicBalance:
        """The same with that many times the samples over harmonics, and that many times the harmonics."""
        return self._denser.get((times, harmonics), lambda: self._with_density(times, harmonics))

    def _with_density(self, times: int, harmonics: int) -> HarmonicBalance:
        out = copy.copy(self)
        out._density, out.H = times * self._density, harmonics * self.H
        out._prepare(None)
        return out

    def arbitrary(self, X: Array, parameters: Mapping[str, float]) -> tuple[HarmonicBalance, str] | None:
        """The balance with springs that pin a motion without contact, and what to say of it; None if it is determined.

        See `hbgear.harmonic.bifurcations.no_contact`.
        """
        pins = pins_of(self, X, parameters) if self.pins is None else None
        if pins is None:
            return None
        out = copy.copy(self)
        out.pins = pins
        out._prepare(self.N)
        return out, ARBITRARY

    @checked_arguments()
    def with_order(self, nu: int, harmonics: int | None = None) -> HarmonicBalance:
        """The same model with another subharmonic order; by default harmonics reach the same frequency."""
        H = harmonics or self.H * nu // self.nu
        counted("nu", nu, _COUNTABLE)
        counted("harmonics", H, _COUNTABLE)
        out = copy.copy(self)
        out.nu, out.H = int(nu), int(H)
        out._prepare(None)
        out.compiled({})
        return out

    def from_point(self, point: Point) -> Array:
        """Unknowns of a point in this problem's basis; as they are if the point does not say what they are."""
        return self.from_layout(point.X, point.layout) if isinstance(point.layout, Layout) else point.X

    def from_layout(self, X: Array, layout: Layout) -> Array:
        """Unknowns of another basis in this one: more or fewer harmonics, or a multiple of the period.

        Raises
        ------
        ValueError
            If the elements differ, or the motion is not periodic with this nu.
        """
        if len(layout.elements) != self.m:
            raise ValueError(f"the motion has {len(layout.elements)} elements; this model has {self.m}")
        if self.nu % layout.nu:
            raise ValueError(
                f"a motion of order nu = {layout.nu} is not periodic with nu = {self.nu}; need a multiple of it"
            )
        times, known = self.nu // layout.nu, np.arange(layout.harmonics + 1)
        known = known if layout.orders is None else np.array([0, *layout.orders])
        return self._resized(stretch(layout.spread(X), times), times * known)

    @checked_arguments()
    def with_tolerance(self, tolerance: float) -> HarmonicBalance:
        """The same problem, harmonics included, with ``harmonics="auto"`` from here on."""
        out = copy.copy(self)
        out.auto, out.tolerance = True, float(tolerance)
        return out

    @checked_arguments()
    def with_harmonics_of(self, curve: Branch, tolerance: float = 1e-6) -> HarmonicBalance:
        """The same with those orders as unknowns that the motions of a curve have, and with no others.

        An order is kept if its amplitude in any gap exceeds the tolerance at any row. Of orders that are no unknowns of
        this problem, up to 2H, it is that of the motion which the forces left out drive. So a curve with few orders
        tells which a second one needs, and this whether it needs more. Subharmonics are all kept.

        Raises
        ------
        ValueError
            If the curve is of other elements, or no order exceeds the tolerance.
        """
        checked("with_orders_of", "tolerance", tolerance, POSITIVE)
        if not isinstance(curve.layout, Layout):
            raise ValueError("with_orders_of needs a curve of periodic motions")
        X = np.array([self.from_layout(x, curve.layout) for x in curve.X])
        here = [curve.parameters_at(i) for i in range(len(curve))]
        each = [
            self.compiled(at).with_driven_harmonics(x[None], np.array([at["Omega"]]))[0]
            for x, at in zip(X, here, strict=True)
        ]
        rows = np.array(each).reshape(len(each), self.m, -1)
        cosine, sine = (rows[..., 2 * self.nu - which :: 2 * self.nu] for which in (1, 0))
        size = np.hypot(cosine, sine).max(axis=(0, 1))
        given, more = ((1 + np.flatnonzero(size > level)).tolist() for level in (tolerance, _MARGIN * tolerance))
        if not given:
            raise ValueError(f"no order of these motions exceeds {tolerance:g}: give a smaller tolerance")
        out = copy.copy(self)
        out.auto, out.selection = False, HarmonicSelection(given=tuple(given), more=tuple(more))
        out.H = self.nu * given[-1]
        out._prepare(None)
        out._warn_truncated(out.compiled({}).system)
        return out

    def adapted(self, observed: Mapping[str, Any]) -> HarmonicBalance | None:
        """The problem with the harmonics that a motion with this truncation error asks for; None to keep them."""
        H = self.target_harmonics(observed.get("error", 0.0))
        return None if H is None else self.with_order(self.nu, H)

    def target_harmonics(self, error: float) -> int | None:
        """Another number of harmonics for a motion with this truncation error; None to keep H, and unless "auto"."""
        if not self.auto:
            return None
        unit = self.nu * (1 if self.selection is None else self.selection.unit)
        least, most = _FEWEST * unit, _MOST * unit
        if error > self.tolerance and most > self.H and self._has_room(more := self.H + max(2, int(0.4 * self.H))):
            return min(most, more)
        if error < 1e-2 * self.tolerance and least < self.H:
            return max(least, int(0.8 * self.H))
        return None

    @property
    def doubled(self) -> HarmonicBalance:
        """The same in the basis of twice the period, with all harmonics of what doubles the period of its motions."""
        return self._doubled.get((), lambda: self.with_order(2 * self.nu, 2 * self.H + 1))

    @property
    def refined_problem(self) -> HarmonicBalance | None:
        """The same with twice the harmonics; None beyond 400 of the excitation, too many unknowns, or receptances."""
        if isinstance(self.compiled({}).structure, MeasuredStructure):
            return None
        if self.selection is None:
            enough = _MOST * self.nu < 2 * self.H or self.m * (4 * self.H + 1) > _MANY
        else:
            enough = not self._has_room(2 * self.H, _MANY)
        if enough:
            return None
        finer = self._finer.get((), lambda: self.with_order(self.nu, 2 * self.H))
        return None if finer._served is not None and finer._reduction(()) is None else finer

    @property
    def comparisons(self) -> Sequence[tuple[ContinuationProblem, float]]:
        """3/2 H and 2H harmonics with the weight 1; without a finer problem H/2 and 3/4 H, for errors of order H^-2.

        With backlash the errors of special points fall like H^-3 or faster, but oscillate: two numbers of harmonics at
        a time do not hide that. From a problem with r H harmonics, e(r H) - e(H) = (r^-2 - 1) e(H).
        """
        return self._comparisons.get((), self._compared)

    def _compared(self) -> Sequence[tuple[ContinuationProblem, float]]:
        finer = self.refined_problem
        if finer is not None:
            between = 3 * self.H // 2
            more = self.selection is None and between > self.H
            return (*([(self.with_order(self.nu, between), 1.0)] if more else []), (finer, 1.0))
        fewer = [(3 * self.H // 4, 3 / 4), (self.H // 2, 1 / 2)]
        return tuple((self.with_order(self.nu, H), 1 / (r**-2 - 1)) for H, r in fewer if self.nu <= H < self.H)

    def at_resolution_of(self, point: Point) -> HarmonicBalance:
        """The same with the harmonics of a point, if it has more."""
        layout = point.layout
        if not isinstance(layout, Layout) or layout.nu != self.nu or layout.harmonics <= self.H:
            return self
        return self._fitting.get(layout.harmonics, lambda: self.with_order(self.nu, layout.harmonics))

    def with_cache_size(self, sets: int) -> HarmonicBalance:
        """The same, which keeps what it computes for that many sets of parameters, to be asked of many motions."""
        return self if sets <= self._kept else self._remembering.get(sets, lambda: self._with_memory(sets))

    def _with_memory(self, sets: int) -> HarmonicBalance:
        out = copy.copy(self)
        out._kept, out._structures, out._systems, out._models = sets, LRUCache(sets), LRUCache(sets), LRUCache(sets)
        out._prepare(self.N)
        out._transform = self._transform
        return out

    def beside(self, parameters: Mapping[str, float], sets: int) -> HarmonicBalance:
        """The same for values next to these, for derivatives: structures are of first order (`nearby`).

        It keeps what it computes for that many sets of parameters.
        """
        if self._around is not None:
            return self
        changed = self._changed(parameters)
        return self._beside.get((changed, sets), lambda: self._next_to(changed, sets))

    def _next_to(self, changed: tuple[tuple[str, float], ...], sets: int) -> HarmonicBalance:
        out, structure = self._with_memory(sets), self.compiled(dict(changed)).structure
        out._around = FirstOrderExpansion(structure) if FirstOrderExpansion.reaches(structure) else None
        return out

    def decided(
        self, X: Array, name: str, values: Array, seen: Sequence[dict[str, Any]], parameters: Mapping[str, float],
        work: Work | None = None,
    ) -> None:  # fmt: skip
        """Verify the stability of motions: estimate the error of their multipliers, check signs, refine where in doubt.

        The error is that of the set of complex multipliers, from a second set of the motion without the harmonics left
        out. Where it reaches the unit circle, or a sign of a determinant contradicts the number of real multipliers
        beyond +1, the motion is refined: exactly in its contact instants where laws are piecewise linear, else with up
        to eight times the harmonics, as far as ``work`` allows. See `deciding`.
        """
        if not isinstance(self.compiled({}).structure, MeasuredStructure):
            verify_multipliers(self, X, name, values, seen, parameters, work)

    def recession(self, X: Array, parameters: Mapping[str, float]) -> HarmonicBalance | None:
        """The balance without gaps, loads and prescribed displacements, for motions far larger than all of these.

        With backlash it is linear: all teeth are in mesh all the time. None for smaller motions, and where the force of
        a law does not grow in proportion to the motion.
        """
        system = self.compiled(dict(parameters)).system
        if self.solution_norm(X) < _FAR * longest(system) or receded(system) is None:
            return None
        return self._receded.get((), self._far)

    def _far(self) -> HarmonicBalance:
        out = copy.copy(self)
        out.model, out._structures, out._systems, out._models = (
            Receded(self.model),
            LRUCache(6),
            LRUCache(6),
            LRUCache(6),
        )
        out._prepare(self.N)
        return out

    def require_fixed_resolution(self, what: str) -> None:
        """Refuse a number of harmonics that varies.

        Raises
        ------
        ValueError
            With ``harmonics="auto"``.
        """
        if self.auto:
            raise ValueError(f"{what} needs one number of harmonics throughout, not 'auto'; give harmonics=16, say")

    def resized(self, X: Array) -> Array:
        """Unknowns of any number of harmonics, cut or padded to this problem's."""
        if len(X) == self.size:
            return X
        n = len(X) // self.m
        known = np.arange(n // 2 + 1) if self.selection is None else self.selection.of_length(n, self.nu)
        if known is None or len(X) % self.m:
            raise ValueError(
                f"{len(X)} coefficients are not those of {self.m} elements and the orders of any number of H"
            )
        return self._resized(spread(X, self.m, known, int(known[-1])), known)

    def _resized(self, rows: Array, known: np.ndarray) -> Array:
        """Unknowns of this problem from rows (m, 2h + 1) of any number of harmonics, of which some are known.

        Displacements with corners are in the gaps with all of their harmonics, in the unknowns with their orders.
        """
        out = resize(rows, self.H)
        kept = self.compiled({}).corners.kept
        if kept.any():
            new = places(np.setdiff1d(self.orders, known))
            out[:, new] -= to_real(kept.T)[:, new]
        whole: Array = out if self.selection is None else out[:, places(self.orders)]
        return whole.ravel()

    def _has_room(self, H: int, most: int = _UNKNOWNS) -> bool:
        """Whether the unknowns of so many harmonics are few enough."""
        kept = H + 1 if self.selection is None else len(self.selection.kept(H, self.nu))
        return self.m * (2 * kept - 1) <= most

    def _check_size(self) -> None:
        """Refuse what would fill the memory before any work."""
        if self.nu > self.H:
            raise ValueError(
                f"harmonics = {self.H} of Omega / {self.nu} do not reach Omega itself; need at least {self.nu}"
            )
        self._check_unknowns(self.H if self.selection is None else self.selection.least(self.H))
        if self.N * self.m > _SAMPLES:
            raise ValueError(f"samples = {self.N:,} for {self.m} elements; at most {_SAMPLES // self.m:,} are possible")

    def _check_unknowns(self, count: int) -> None:
        """Refuse more harmonics, or orders, than can be solved for."""
        size = self.m * (2 * count + 1)
        if size <= _UNKNOWNS:
            return
        if self.selection is None:
            raise ValueError(
                f"harmonics = {self.H} for {self.m} elements make {size:,} unknowns; at most {_UNKNOWNS:,} can be "
                f"solved for: H <= {(_UNKNOWNS // self.m - 1) // 2}"
            )
        raise ValueError(
            f"{count} orders up to {self.H} for {self.m} elements make {size:,} unknowns; at most {_UNKNOWNS:,} can be "
            "solved for: give fewer harmonics, or tooth counts with a simpler ratio"
        )

    def _warn_truncated(self, system: System) -> None:
        highest = max([e.displacement.order for e in system.elements] + [load.order for load in system.loads])
        begins = zip((e.name for e in system.elements), excited_orders(system), strict=False)
        missed = next(((name, min(some)) for name, some in begins if some and min(some) * self.nu > self.H), None)
        if missed is not None:
            warn(
                f"what excites {missed[0]} begins at order {missed[1]} of Omega, and {self.resolution} leaves it out: "
                "give as many harmonics and more, or orders"
            )
        elif highest * self.nu > self.H:
            warn(
                f"the excitation has {highest} harmonics but H = {self.H} with nu = {self.nu} keeps only "
                f"{self.H // self.nu}; what is above is left out"
            )
        elif self.selection is not None:
            kept = {k // self.nu for k in self.orders.tolist() if k % self.nu == 0}
            out = sorted(
                {k for some in excited_orders(system, corners=False) for k in some if k * self.nu <= self.H} - kept
            )
            if out:
                warn(
                    f"the excitation has order {out[0]}, which is no unknown, and is left out there: give more "
                    "harmonics, or this order too"
                )

    # ---- evaluation

    def compiled(self, parameters: dict[str, float]) -> Evaluator:
        """The model at the given parameters (Omega among them or not), from a small cache."""
        key = self._changed(parameters)
        return self._compiled.get(key, lambda: self._compile(key))

    def model_at(self, parameters: Mapping[str, float]) -> Model:
        """The model with the given parameters (Omega among them or not), from a small cache."""
        return self._model_of(self._changed(parameters))

    def _changed(self, parameters: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
        """The parameters that are not those of the model, by name."""
        changed = {k: v for k, v in parameters.items() if k != "Omega" and v != self._own.get(k)}
        if not changed:  # the usual case, of which every call asks
            return ()
        for name in changed.keys() - self._own.keys():
            self.check_parameter(name)
        return tuple(sorted(changed.items()))

    def _model_of(self, changed: tuple[tuple[str, float], ...]) -> Model:
        return self._models.get(changed, lambda: self.model.replace(**dict(changed)) if changed else self.model)

    def _compile(self, changed: tuple[tuple[str, float], ...]) -> Evaluator:
        system = self._systems.get(changed, lambda: self._system_of(changed))
        return Evaluator(
            system, self._structure(system), self.H, self.nu, self.is_sampled, self._transform, self.reduce, self.orders
        )

    def _system_of(self, changed: tuple[tuple[str, float], ...]) -> System:
        reduction = self._reduction(changed)
        return self._model_of(changed).system() if reduction is None else reduction[0].system

    def _structure(self, system: System) -> LinearStructure:
        """Eigen-decompositions are shared between parameter sets that differ in laws and loads only."""
        if system.speed is not None:
            return SpeedDependentStructure(system)
        if system.receptances is not None:
            return MeasuredStructure(system)
        fresh = references(system).tobytes(), np.array([e.damping for e in system.elements]).tobytes()
        dense = [A for A in (system.M, system.C, system.K) if isinstance(A, np.ndarray)]
        make = LinearStructure if self._around is None else self._around.of
        if len(dense) < 3:
            return make(system)
        key = (*(A.tobytes() for A in dense), system.W.tobytes(), *fresh)
        structure = self._structures.get(key, lambda: make(system))
        structure.check_balance(system)
        return structure

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Array]:
        """Residual (n,) and Jacobian (n, n) at X (n,), n = m (2H + 1); ``Omega`` must be among the parameters."""
        R, J, *_ = self.linearise(X, "", **parameters)
        return R, J

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """R, dR/dX, dR/dname and the size of the forces that R is the sum of.

        dR/dOmega is analytic; the derivative in a model parameter is a difference of the residual
        (`hbgear.continuation.problem.finite_differences`).
        """
        R, J, dR, size = self.compiled(parameters).linearise(X, float(parameters["Omega"]))
        if self.pins is not None:
            R[self.means] += self.pins.matrix @ (X[self.means] - self.pins.centre)
            J[np.ix_(self.means, self.means)] += self.pins.matrix
        if name != "Omega":
            dR = self.moved(X, name, parameters) if name else np.zeros(len(R))
        return Evaluation(R, J, dR, size)

    def moved(self, X: Array, name: str, parameters: Mapping[str, float]) -> Array:
        """dR/dname alone (n,)."""
        if name == "Omega":
            return super().moved(X, name, parameters)
        dR: Array = self.parameter_derivatives(X[None], np.array([parameters["Omega"]]), name, parameters)[0]
        return dR

    def parameter_derivatives(self, X: Array, Omega: Array, name: str, parameters: Mapping[str, float]) -> Array:
        """`moved` (P, n) of many motions X (P, n) at Omega (P,); the name is that of a parameter of the model."""
        near = self.beside(parameters, 2)

        def residuals(at: dict[str, float]) -> tuple[Array]:
            compiled = near.compiled(at)
            return (np.array([compiled.linearise(x, w)[0] for x, w in zip(X, Omega.tolist(), strict=True)]),)

        (dR,) = parameter_derivatives(self, name, {name: self._own.get(name, 0.0), **parameters}, residuals)
        return dR  # type: ignore[no-any-return]

    def curvature(self, X: Array, v: Array, name: str, **parameters: float) -> tuple[Array, Array]:
        """Derivatives (n, n) of dR/dX along v (n,) and in a parameter; exact in Omega."""
        compiled = self.compiled(parameters)
        if name != "Omega" or compiled.asked:
            return super().curvature(X, v, name, **parameters)
        return compiled.curvature(X, v, directional_step(X, v), float(parameters["Omega"]))

    def is_expensive(self, name: str) -> bool:
        """Whether another value needs another model: of all parameters but Omega."""
        return name != "Omega"

    def compiled_continuation(self, name: str, parameters: Mapping[str, float]) -> Pursuit | None:
        """A compiled loop along curves in Omega, if every law is known to it and no pair of poles is too close.

        Not where there are so many unknowns that LAPACK, which it does without, makes up for what it saves.
        """
        numbers = self._looped(name, parameters)
        if numbers is None:
            return None
        from hbgear.harmonic.equations.continuation_kernel import trace_compiled

        return partial(trace_compiled, numbers)

    def compiled_locator(self, name: str, parameters: Mapping[str, float], which: int) -> Locating | None:
        """Compiled Newton on motions at a given Omega, folds and zeros of a `clearance`, under the same conditions.

        Not on folds if laws must be asked for their slopes, whose second derivatives are not known.
        """
        numbers = self._looped(name, parameters)
        if numbers is None or (which == FOLD and numbers.own is not None):
            return None
        from hbgear.harmonic.equations.newton_kernels import locate

        return partial(locate, numbers, which)

    def _looped(self, name: str, parameters: Mapping[str, float]) -> PackedModel | None:
        """What compiled loops along curves in a parameter need of the model; None where they cannot be used."""
        compiled = self.compiled(dict(parameters))
        known = name == "Omega" and compiled.whole and self.pins is None
        return compiled.numbers if known and self.size <= _LOOPED else None

    @checked_arguments()
    def residual(self, X: Array, **parameters: float) -> Array:
        """R alone (n,)."""
        X = self._given(X, parameters)
        return self.linearise(X, "", **parameters).R

    # ---- starting points

    @checked_arguments()
    def start(self, Omega: float, **parameters: float) -> Array:  # type: ignore[override]
        """A periodic motion at Omega, found from the state of rest and the linear response about it.

        Where that fails, from other static states, along a path on which dampers that hold the elements are taken away,
        and from a motion at another frequency that is followed to this one.

        Raises
        ------
        NoConvergence
            If Newton finds no periodic motion from any of the guesses.
        """
        checked("start", "Omega", Omega, _FREQUENCIES)
        here = {name: float(value) for name, value in (parameters | {"Omega": Omega}).items()}
        failure: NoConvergence | None = None
        for guess in initial_guesses(self.compiled(here), here["Omega"]):
            try:
                return solve(self, guess, here).X
            except NoConvergence as error:
                failure = failure or error
        assert failure is not None
        with suppress(NoConvergence):
            return from_damped(self, here).X
        for guess in initial_guesses(self.compiled(here), here["Omega"]):
            with suppress(NoConvergence):
                return newton_homotopy(self, guess, here).X
        X = continue_from_nearby_frequency(self, here)
        if X is None:
            raise failure
        return X

    # ---- results

    def switching(self, X: Array, **parameters: float) -> Crossings:
        """Instants theta in [0, 2 pi] of the basis period at which any element crosses a corner of its law.

        ``row`` of the result counts the corners of all elements in order.
        """
        return self.compiled(parameters).crossings(X)

    @checked_arguments()
    def regime(self, X: Array, **parameters: float) -> np.ndarray:
        """Impact regime of each element (m,): 0 no impact, 1 single-sided, 2 double-sided.

        It is the number of corners of the law that the motion crosses, at most 2.
        """
        regime: np.ndarray = self.compiled(parameters).reach(X[None])[1][0]
        return regime

    @checked_arguments()
    def clearance(self, X: Array, **parameters: float) -> Array:
        """Signed distances of the extrema of each element from each corner of its law: zero where contact grazes.

        Order: for each element and each of its corners, lowest value minus corner, highest value minus corner.
        """
        clearance: Array = self.compiled(parameters).reach(X[None])[0][0]
        return clearance

    def grazing_distance(self, X: Array, which: int, **parameters: float) -> tuple[float, float]:
        """One entry of `clearance`, and the phase at which its extremum lies."""
        compiled, corner, sign = self.compiled(parameters), which // 2, 1 if which % 2 else -1
        element = int(compiled.element[corner])
        value, theta = compiled.highest(element, self.rows(X)[element], float(sign))
        return float(sign * value - compiled.corner[corner]), theta

    def force_rows(self, X: Array, **parameters: float) -> Array:
        """Law forces of each element (without its damper) as real rows (m, 2H + 1)."""
        return self.compiled(parameters).forces(X, parameters["Omega"])

    @checked_arguments()
    def mesh_forces(self, X: Array, **parameters: float) -> Array:
        """Whole force of each element, law and damper, as real rows (m, 2H + 1): f_k + i k omega c d_k."""
        X = self._given(X, parameters)
        compiled = self.compiled(parameters)
        omega = parameters["Omega"] / self.nu
        rows = self.rows(X)
        return self.force_rows(X, **parameters) + omega * compiled.structure.c[:, None] * derivative(rows)

    @checked_arguments()
    def motion(self, X: Array, **parameters: float) -> Array:
        """Motion of every coordinate of the structure as real rows (n, 2H + 1)."""
        X = self._given(X, parameters)
        compiled = self.compiled(parameters)
        f = to_complex(self.force_rows(X, **parameters)).T[self.orders]
        q = np.zeros((self.H + 1, compiled.system.n), dtype=complex)
        d = to_complex(X.reshape(self.m, -1)).T
        q[self.orders] = compiled.receptance.motion(parameters["Omega"], d, f)
        reduction = self._reduction(self._changed(parameters))
        return to_real(q.T if reduction is None else reduction[0].motion(q.T))

    @checked_arguments()
    def multipliers(
        self, X: Array, points: int | None = None, width: float | None = None, **parameters: float
    ) -> ComplexArray:
        """Floquet multipliers of the motion over its period, largest first; see `floquet.multipliers_of`."""
        X = self._given(X, parameters)
        if points is not None:
            counted("points", points, 50)
        if width is not None:
            checked("multipliers", "width", width, POSITIVE)
        confined = self.restricted_to("Omega", parameters["Omega"], parameters["Omega"], {})
        Omega = np.array([parameters.pop("Omega")])
        compiled = confined.compiled(parameters)
        more = compiled.with_driven_harmonics(X[None], Omega)
        mu: ComplexArray = floquet_multipliers(compiled, more, Omega, points=points, width=width)[0]
        return mu

    def _given(self, X: Array, parameters: dict[str, float]) -> Array:
        """Unknowns of one motion; ``parameters`` hold a frequency that can be meant."""
        X = np.asarray(X, dtype=float)
        if X.shape != (self.size,):
            each = "(2H + 1)" if self.selection is None else f"(1 + 2 x {len(self.orders) - 1} orders)"
            raise ValueError(
                f"X of shape {X.shape}: need the unknowns of one motion, {self.m} x {each} = {self.size} numbers"
            )
        if "Omega" not in parameters:
            raise ValueError("a motion needs its frequency: give Omega=...")
        checked(type(self).__name__, "Omega", parameters["Omega"], _FREQUENCIES)
        parameters["Omega"] = float(parameters["Omega"])
        return X

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """What a trace stores beside the unknowns: multipliers (if asked for), regime, clearance, error."""
        return self.observe_many(X[None], "Omega", np.array([parameters.pop("Omega")]), stability, **parameters)[0]

    def observe_many(
        self, X: Array, name: str, values: Array, stability: bool = True, **parameters: float
    ) -> list[dict[str, Any]]:
        """`observe` of motions X (P, n) at values (P,) of a parameter."""
        if name != "Omega":
            return super().observe_many(X, name, values, stability, **parameters)
        compiled = self.compiled(parameters)
        clearance, regime = compiled.reach(X)
        more = compiled.with_driven_harmonics(X, values)
        columns = zip(clearance, regime, compiled.left_out(more).tolist(), strict=True)
        seen: list[dict[str, Any]] = [{"clearance": c, "regime": r, "error": e} for c, r, e in columns]
        if compiled.asked:
            add_sampling_error(self, X, values, seen, parameters)
        if stability and not isinstance(compiled.structure, MeasuredStructure):
            for one, mu in zip(seen, floquet_multipliers(compiled, more, values), strict=True):
                one["multipliers"] = mu
        return seen

    @property
    def batch_size(self) -> int:  # type: ignore[override]
        """Motions observed in one call: fewer of a structure all of whose modes are carried through the period."""
        structure = self.compiled({}).structure
        return 128 if self.reduce else min(max(int(_WORK / (2 * structure.n) ** 3), 2), 128)

    @property
    def clearance_names(self) -> tuple[str, ...]:
        """What each entry of `clearance` stands for."""
        elements = self.compiled({}).system.elements
        return tuple(
            f"{end} of {e.name} at {x:g}" for e in elements for x in e.law.breakpoints for end in ("lowest", "highest")
        )

    @property
    def clearance_elements(self) -> tuple[int, ...]:
        """Number of the element each entry of `clearance` belongs to."""
        laws = self.compiled({}).laws
        return tuple(j for j, law in enumerate(laws) for _ in law.breakpoints for _ in range(2))

    def solution_norm(self, X: Array) -> float:
        """Norm of the alternating part, which scales the arclength."""
        return norm(X.reshape(self.m, -1)[:, 1:])

    def solution_norms(self, X: Array) -> Array:
        """`motion_size` (P,) of motions X (P, n)."""
        return norms(X.reshape(len(X), self.m, -1)[:, :, 1:])

    def subharmonic_part(self, X: Array) -> Array:
        """The coefficients that a basis of smaller order could not hold; empty for nu = 1."""
        if self.nu == 1:
            return np.empty(0)
        factor = next(p for p in range(2, self.nu + 1) if self.nu % p == 0)
        k = np.concatenate([[0], np.repeat(self.orders[1:], 2)])
        return X.reshape(self.m, -1)[:, k % factor != 0].ravel()

    def truncation(self, X: Array, **parameters: float) -> float:
        """Estimated error of the gap motion (rms) from the force harmonics that the balance leaves out.

        The neglected force harmonics H < k <= 2H, and orders below that are no unknowns, drive the closed structure:
        delta d_k = -G_k f_k.
        """
        compiled = self.compiled(parameters)
        return float(compiled.left_out(compiled.with_driven_harmonics(X[None], np.array([parameters["Omega"]])))[0])
