"""Equations of the harmonic balance at one discretization, for any parameters of the model.

    R_k(d) = Z_k(Omega) d_k + g_k(Omega) + f_k(d) = 0,   k = 0..H, or a selection of these orders

See `hbgear.harmonic.harmonic_balance`. This base class holds the equations, their derivatives and the parameters.
`PeriodicMotions` adds quantities of the solutions, `HarmonicBalance` other harmonics.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from typing import Any, Self, TypeVar

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.lru_cache import LRUCache
from hbgear.common.ranges import ANY, POSITIVE, Range, checked
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import FOLD, Evaluation, Locating, Pursuit
from hbgear.continuation.problem.finite_differences import LEAST_SIZE, STEP, directional_step, parameter_derivatives
from hbgear.harmonic.bifurcations.no_contact import Pins
from hbgear.harmonic.equations.discretization import Discretization
from hbgear.harmonic.equations.evaluator import Evaluator, elements_between_breakpoints
from hbgear.harmonic.equations.harmonic_selection import HarmonicSelection
from hbgear.harmonic.equations.model_cache import ModelCache
from hbgear.harmonic.equations.motion import shortest_intervals
from hbgear.harmonic.equations.thresholds import nearest_threshold
from hbgear.harmonic.forces.packed_model import PackedModel
from hbgear.harmonic.forces.projection_kernels import LEAST_STEP, STEP_OVER_SQUARE
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import check_frequency

Value = TypeVar("Value")

FREQUENCIES = Range(above=0, high=1e60)
"""Values of Omega whose powers are finite."""

STICK_STEP = 1e-6
"""Relative step of differences of dR/dX with friction, because a step of 1e-5 of the motion ends short intervals of
stick. Smaller steps have rounding errors that cusps, which need third derivatives, do not tolerate."""

STEP_OVER_DISTANCE = 1e-2
"""Relative step of differences of dR/dX over the relative distance of a motion from the next threshold of its laws."""

_MAX_COMPILED_UNKNOWNS = 160
"""Unknowns up to which the compiled continuation loop is faster than Python with LAPACK."""

_CACHE_SIZES = {
    "units": 32,
    "layout": 1,
    "restricted": 4,
    "denser": 2,
    "refined": 1,
    "comparisons": 1,
    "doubled": 1,
    "resized": 4,
    "with_cache_size": 1,
    "perturbed": 1,
    "recession": 1,
}
"""Number of results of each kind that a balance keeps; most of them are balances with caches of their own."""


class HarmonicEquations(ContinuationProblem):
    """The equations R(X, p) = 0 of a harmonic balance: a model and a discretization.

    Parameters
    ----------
    models : ModelCache
        The model at each parameter set, with its discretization.
    """

    usual_parameter = "Omega"
    singular_hint = "a gap that stays open without load: load the system"

    models: ModelCache
    """The model at each parameter set."""
    discretization: Discretization
    """Harmonics and samples."""
    pins: Pins | None = None
    """Springs for motions without contact, whose position in the gap is arbitrary."""
    model: Model
    """The model with its default parameters."""
    reduce: bool
    """Whether large structures are reduced."""
    m: int
    """Number of elements."""
    H: int
    """Highest harmonic of the basis frequency."""
    nu: int
    """Subharmonic order."""
    N: int
    """Samples per basis period."""
    orders: np.ndarray
    """Basis harmonics that are unknowns, ascending from 0."""
    selection: HarmonicSelection | None
    """Rule for the orders; None if all up to H are unknowns."""
    is_sampled: bool
    """Whether every law is evaluated by AFT."""
    size: int
    """Number of unknowns, m (2H + 1) if all orders up to H are kept."""
    means: np.ndarray
    """Positions (m,) of the means of the elements among the unknowns."""

    def __init__(self, models: ModelCache) -> None:
        self._set_models(models)

    def _set_models(self, models: ModelCache) -> None:
        """Take over a model and a discretization; nothing computed with earlier ones is kept."""
        grid = models.discretization
        self.models, self.discretization, self.model, self.reduce = models, grid, models.model, models.reduce
        self.m, self.H, self.nu, self.N, self.is_sampled = grid.m, grid.H, grid.nu, grid.N, grid.sampled
        self.orders, self.selection, self.size, self.means = grid.orders, grid.selection, grid.size, grid.means
        self._caches: dict[str, LRUCache[Any]] = {kind: LRUCache(count) for kind, count in _CACHE_SIZES.items()}

    def _derived(self, discretization: Discretization | None = None, models: ModelCache | None = None) -> Self:
        """Return the balance with other harmonics or another cache of models; it computes everything again."""
        out = copy.copy(self)
        out._set_models((models or self.models).at(discretization or self.discretization))
        return out

    def _cached(self, kind: str, key: Hashable, build: Callable[[], Value]) -> Value:
        return self._caches[kind].get(key, build)

    @property
    def resolution(self) -> str:
        """Number of harmonics in words."""
        return self.discretization.resolution

    # ---- parameters

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the model by name; Omega is given with every evaluation."""
        return self.model.parameters

    @checked_arguments()
    def check_parameter(self, name: str) -> None:
        """Raise KeyError for a name other than Omega and the parameters of the model."""
        self.models.check_parameter(name)

    def value_of(self, name: str) -> float:
        """Return the default value of a parameter, or of an entry of a tuple such as ``eps[0]``.

        Raises
        ------
        KeyError
            If the model has no such parameter.
        """
        self.check_parameter(name)
        if name == "Omega":
            raise KeyError("Omega is not a parameter of the model; give its value with every evaluation")
        return float(self.models.defaults[name])

    def range_of(self, name: str) -> Range:
        """Return the valid values of a parameter; Omega is positive, and within the tables of the structure."""
        if name != "Omega":
            return self.model.ranges.get(name, ANY)
        speed = self.compiled({}).system.speed
        return POSITIVE if speed is None else speed.range

    def unit_of(self, name: str, value: float) -> float:
        """Return the size relative to which a parameter change is small; for Omega its value.

        Zero has no size: the stiffness of a missing support in N/m is not small relative to 0.01 N/m. The unit of such
        a parameter is the step that changes the balance by a thousandth.
        """
        if name == "Omega" and value:
            return abs(value)
        unit = super().unit_of(name, value)
        if value or self.models.defaults.get(name, 1.0):
            return unit
        return self._cached("units", name, lambda: self.models.unit_at_zero(name, unit))

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Return Omega if it is not given."""
        return () if "Omega" in known else ("Omega",)

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """Warn of an Omega far above the natural frequencies; raise ValueError for one without measured receptances."""
        Omega = high if name == "Omega" else fixed["Omega"]
        measured = self.compiled({}).system.receptances
        if measured is not None:
            measured.check(low if name == "Omega" else Omega, Omega, self.H, self.nu)
        check_frequency(self.compiled({}).structure.at(Omega), Omega)

    # ---- equations

    def compiled(self, parameters: Mapping[str, float]) -> Evaluator:
        """Return the model at the given parameters, with or without Omega, ready to be evaluated."""
        return self.models.evaluator(parameters)

    def model_at(self, parameters: Mapping[str, float]) -> Model:
        """Return the model with the given parameters, with or without Omega."""
        return self.models.model_at(parameters)

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Array]:
        """Return the residual (n,) and the Jacobian (n, n) at X (n,); ``Omega`` must be among the parameters."""
        R, J, *_ = self.linearise(X, "", **parameters)
        return R, J

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return R, dR/dX, dR/dname and the size of the terms of R.

        dR/dOmega is analytic. The derivative in a model parameter is a difference of residuals, see
        `hbgear.continuation.problem.finite_differences`.
        """
        R, J, dR, size = self.compiled(parameters).linearise(X, float(parameters["Omega"]))
        if self.pins is not None:
            R[self.means] += self.pins.matrix @ (X[self.means] - self.pins.centre)
            J[np.ix_(self.means, self.means)] += self.pins.matrix
        if name != "Omega":
            dR = self.parameter_derivative(X, name, parameters) if name else np.zeros(len(R))
        return Evaluation(R, J, dR, size)

    def parameter_derivative(self, X: Array, name: str, parameters: Mapping[str, float]) -> Array:
        """Return dR/dname alone (n,)."""
        if name == "Omega":
            return super().parameter_derivative(X, name, parameters)
        return self.parameter_derivatives(X[None], np.array([parameters["Omega"]]), name, parameters)[0]

    def parameter_derivatives(self, X: Array, Omega: Array, name: str, parameters: Mapping[str, float]) -> Array:
        """Return dR/dname (P, n) of motions X (P, n) at Omega (P,); the name is a parameter of the model."""
        perturbed = self.perturbed(parameters, 2)

        def residuals(values: dict[str, float]) -> tuple[Array]:
            evaluator = perturbed.compiled(values)
            return (np.array([evaluator.linearise(x, w)[0] for x, w in zip(X, Omega.tolist(), strict=True)]),)

        (dR,) = parameter_derivatives(self, name, {name: self.models.defaults.get(name, 0.0), **parameters}, residuals)
        return dR

    def curvature(self, X: Array, v: Array, name: str, **parameters: float) -> tuple[Array, Array]:
        """Return the derivatives (n, n) of dR/dX along v (n,) and in a parameter; the latter is exact in Omega."""
        evaluator = self.compiled(parameters)
        if name != "Omega" or evaluator.aft_laws or evaluator.damped or evaluator.sliders:
            return super().curvature(X, v, name, **parameters)
        step = directional_step(X, v, self.difference_step(X, parameters), self.least_size)
        return evaluator.curvature(X, v, step, float(parameters["Omega"]))

    @checked_arguments()
    def residual(self, X: Array, **parameters: float) -> Array:
        """Return R alone (n,)."""
        X = self._checked_unknowns(X, parameters)
        return self.linearise(X, "", **parameters).R

    def _checked_unknowns(self, X: Array, parameters: dict[str, float]) -> Array:
        """Return the unknowns of one motion as an array; raise ValueError for another shape or an invalid Omega."""
        X = np.asarray(X, dtype=float)
        if X.shape != (self.size,):
            width = "(2H + 1)" if self.selection is None else f"(1 + 2 x {len(self.orders) - 1} orders)"
            raise ValueError(
                f"X of shape {X.shape}: need the unknowns of one motion, {self.m} x {width} = {self.size} numbers"
            )
        if "Omega" not in parameters:
            raise ValueError("a motion needs its frequency: give Omega=...")
        checked(type(self).__name__, "Omega", parameters["Omega"], FREQUENCIES)
        parameters["Omega"] = float(parameters["Omega"])
        return X

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        """Whether dR/dX is continuous: samples do not pass breakpoints, no friction, no clipped contact."""
        compiled = self.compiled({})
        clipped = any(contact.clipped for _, law in compiled.damped for contact in law.damped)
        if compiled.sliders or clipped or any(law.has_edges for _, law in compiled.vectors):
            return False
        divided = elements_between_breakpoints(compiled)
        return not any(law.breakpoints for j, law in compiled.aft_laws if j not in divided)

    def difference_step(self, X: Array, parameters: Mapping[str, float]) -> float:
        """Return the relative step of differences of dR/dX, within which no contact or interval of stick ends."""
        compiled = self.compiled(parameters)
        usual, (interval,) = STICK_STEP if compiled.sliders else STEP, shortest_intervals(compiled, X[None])
        size = max(self.least_size, norm(X))
        nearest = STEP_OVER_DISTANCE * nearest_threshold(compiled, X, parameters["Omega"]) / size
        return min(usual, max(LEAST_STEP, min(STEP_OVER_SQUARE * float(interval) ** 2, nearest)))

    @property
    def least_size(self) -> float:  # type: ignore[override]
        """Size of a motion below which differences do not become smaller; a thousandth of a gap that is below one."""
        return LEAST_SIZE * min(1.0, self.models.length)

    def solution_norm(self, X: Array) -> float:
        """Return the norm of the alternating part, which scales the arclength."""
        return self.discretization.solution_norm(X)

    def solution_norms(self, X: Array) -> Array:
        """Return `solution_norm` (P,) of motions X (P, n)."""
        return self.discretization.solution_norms(X)

    # ---- compiled loops

    def is_expensive(self, name: str) -> bool:
        """Return whether another value needs another model: for all parameters except Omega."""
        return name != "Omega"

    def compiled_continuation(self, name: str, parameters: Mapping[str, float]) -> Pursuit | None:
        """Return a compiled loop along curves in Omega; None if a law is unknown to it or LAPACK is faster."""
        packed = self._packed_model(name, parameters)
        if packed is None:
            return None
        from hbgear.harmonic.equations.continuation_kernel import trace_compiled

        return partial(trace_compiled, packed)

    def compiled_locator(self, name: str, parameters: Mapping[str, float], which: int) -> Locating | None:
        """Return compiled Newton iterations for motions at fixed Omega, folds, or zeros of a `clearance`.

        None as of `compiled_continuation`, and for folds with compiled laws of the user or friction, whose second
        derivatives are computed in Python.
        """
        packed = self._packed_model(name, parameters)
        compiled = self.compiled(parameters)
        if packed is None or (which == FOLD and (compiled.user_laws or compiled.sliders)):
            return None
        from hbgear.harmonic.equations.newton_kernels import locate

        return partial(locate, packed, which)

    def _packed_model(self, name: str, parameters: Mapping[str, float]) -> PackedModel | None:
        """Return the model as arrays for compiled loops along curves in a parameter; None if they cannot be used."""
        evaluator = self.compiled(parameters)
        usable = name == "Omega" and evaluator.is_fully_compiled and self.pins is None
        return evaluator.packed if usable and self.size <= _MAX_COMPILED_UNKNOWNS else None

    # ---- other structures

    def restricted_to(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> Self:
        """Return the balance of a reduced structure if all modes of the structure are too many for a curve.

        The receptances are then exact to 1e-9, or to the rounding of the full structure if that is larger, up to the
        highest harmonic of the highest Omega, and ``branch.meta["structure"]`` holds their error. Smaller structures,
        those that need more than 256 modes, and balances with ``reduce=False`` are not reduced.
        """
        reduced_for = self.models.reduced_for
        if not self.reduce or not (reduced_for or self.compiled({}).structure.large):
            return self
        level = 2.0 ** math.ceil(math.log2(high if name == "Omega" else fixed["Omega"]))
        if reduced_for is not None and level <= reduced_for:
            return self
        return self._cached("restricted", level, lambda: self._reduced(level) or self._reduced(None) or self)

    def _reduced(self, Omega: float | None) -> Self | None:
        """Return the balance of a structure reduced for frequencies up to Omega; None if that is not possible."""
        out = self._derived(models=self.models.reduced_up_to(Omega))
        return None if Omega is not None and out.models.reduction({}) is None else out

    def with_cache_size(self, sets: int) -> Self:
        """Return the balance with a cache for at least this number of parameter sets."""
        if sets <= self.models.sets:
            return self
        return self._cached("with_cache_size", sets, lambda: self._derived(models=self.models.with_size(sets)))

    def perturbed(self, parameters: Mapping[str, float], sets: int) -> Self:
        """Return the balance near these parameters, for derivatives: structures are first-order expansions.

        It keeps its evaluators for this number of parameter sets.
        """
        if self.models.is_expanded:
            return self
        key = self.models.changes(parameters), sets
        return self._cached("perturbed", key, lambda: self._derived(models=self.models.expanded(parameters, sets)))
