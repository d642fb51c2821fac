"""A model at many parameter sets: systems, structures, reductions and evaluators, the latest of each kept in memory.

Continuation evaluates one parameter set many times, derivatives and sensitivities a few sets in turn. Models, systems
and structures do not depend on the discretization, so balances with other harmonics share them. Eigen-decompositions
are shared between parameter sets that differ in laws and loads only.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from hbgear.common.lru_cache import LRUCache
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.problem.finite_differences import STEP
from hbgear.harmonic.equations.discretization import Discretization
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.harmonic.structure.measured import MeasuredStructure
from hbgear.harmonic.structure.perturbed import FirstOrderExpansion
from hbgear.harmonic.structure.recession import longest
from hbgear.harmonic.structure.speed_dependent import SpeedDependentStructure
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.reduction import Reduction, reduced_within
from hbgear.mechanics.reference_stiffness import references

Changes = tuple[tuple[str, float], ...]
"""Parameters that differ from those of the model, sorted by name: the key of every cache."""

MODEL_SETS, EVALUATOR_SETS = 6, 8
"""Parameter sets in memory: of models, systems and structures, and of evaluators, which both sides of a central
difference and a few points of a curve need."""

MIN_CHANGE, MEASURABLE_CHANGE = 1e-11, 1e-8
"""Changes of the balance, relative to its terms: the smallest that is not rounding, and one with enough digits."""

MAX_PARAMETER_STEP = 1e40
"""Step of a parameter up to which an effect on the balance is searched for."""


class ModelCache:
    """A model whose evaluators are built once per parameter set. Threads may share it.

    Parameters
    ----------
    model : Model
        The model with its default parameters.
    system : System
        The system of these defaults.
    discretization : Discretization
        Harmonics and samples of the evaluators.
    reduce : bool
        Whether stability may leave out modes far above those of the motion.

    Attributes
    ----------
    defaults : dict of str to float
        Default values of the parameters and of the entries of tuples, by name.
    sets : int
        Number of parameter sets whose evaluators are kept.
    reduced_for : float or None
        Omega up to which a reduced structure represents a large one; None for the whole structure.
    """

    def __init__(self, model: Model, system: System, discretization: Discretization, reduce: bool) -> None:
        self.model, self.discretization, self.reduce = model, discretization, reduce
        self.defaults = model.parameters | model.entries
        self.sets = EVALUATOR_SETS
        self.reduced_for: float | None = None
        self._expansion: FirstOrderExpansion | None = None
        self._models: LRUCache[Model] = LRUCache(MODEL_SETS)
        self._forget_systems(MODEL_SETS)
        self._forget_evaluators()
        self._systems.get((), lambda: system)

    def _forget_systems(self, sets: int) -> None:
        self._systems: LRUCache[System] = LRUCache(sets)
        self._structures: LRUCache[LinearStructure] = LRUCache(sets)

    def _forget_evaluators(self) -> None:
        self._evaluators: LRUCache[Evaluator] = LRUCache(self.sets)
        self._reductions: LRUCache[tuple[Reduction, float] | None] = LRUCache(self.sets)

    # ---- related caches

    def _changed(self, systems: int = MODEL_SETS, **changes: Any) -> ModelCache:
        """Return a cache with changed attributes, for a number of systems, which computes them again."""
        out = copy.copy(self)
        vars(out).update(changes)
        vars(out).pop("length", None)
        out._forget_systems(systems)
        out._forget_evaluators()
        return out

    def at(self, discretization: Discretization) -> ModelCache:
        """Return a cache of evaluators with another discretization, which shares models, systems and structures."""
        out = copy.copy(self)
        out.discretization = discretization
        out._forget_evaluators()
        return out

    def with_size(self, sets: int) -> ModelCache:
        """Return a cache that keeps this number of parameter sets."""
        return self._changed(sets, sets=sets, _models=LRUCache(sets))

    def expanded(self, parameters: Mapping[str, float], sets: int) -> ModelCache:
        """Return a cache whose structures are expanded to first order about the one at these parameters."""
        structure, out = self.evaluator(parameters).structure, self.with_size(sets)
        out._expansion = FirstOrderExpansion(structure) if FirstOrderExpansion.is_possible(structure) else None
        return out

    def reduced_up_to(self, Omega: float | None) -> ModelCache:
        """Return a cache of reduced structures for frequencies up to Omega, or of the whole ones for None."""
        return self._changed(reduced_for=Omega)

    def of_model(self, model: Model) -> ModelCache:
        """Return a cache of another model with the same parameters."""
        return self._changed(model=model, _models=LRUCache(MODEL_SETS))

    @property
    def is_expanded(self) -> bool:
        """Whether structures may be first-order expansions."""
        return self._expansion is not None

    # ---- parameters

    def check_parameter(self, name: str) -> None:
        """Raise KeyError for a name other than Omega and the parameters of the model."""
        names = ("Omega", *self.defaults)
        if name not in names:
            raise KeyError(f"{type(self.model).__name__} has no parameter '{name}'{did_you_mean(name, names)}")

    def changes(self, parameters: Mapping[str, float]) -> Changes:
        """Return the parameters, Omega apart, that differ from those of the model."""
        changed = {k: v for k, v in parameters.items() if k != "Omega" and v != self.defaults.get(k)}
        if not changed:  # the usual case of every evaluation along a curve in Omega
            return ()
        for name in changed.keys() - self.defaults.keys():
            self.check_parameter(name)
        return tuple(sorted(changed.items()))

    @cached_property
    def length(self) -> float:
        """Largest length of the model (`longest`); 1 without any."""
        return longest(self.evaluator({}).system) or 1.0

    def unit_at_zero(self, name: str, usual: float) -> float:
        """Return the unit of a parameter that is zero in the model: the step that changes the balance by a thousandth.

        It is the ``usual`` unit if a step of that unit has an effect beyond rounding, or no larger step has one.
        """
        default = self.evaluator({})
        Omega = abs(float(np.mean(self.model.default_span)))
        X = np.zeros((self.discretization.m, self.discretization.size // self.discretization.m))
        X[:, :3] = self.length * np.array([0.5, 1.5, 0.5])
        R, *_, size = default.linearise(X.ravel(), Omega)
        first = h = STEP * usual
        while h < MAX_PARAMETER_STEP:
            try:
                change = float(np.linalg.norm(self.evaluator({name: h}).linearise(X.ravel(), Omega)[0] - R)) / size
            except ValueError:  # outside the range of the parameter
                return usual
            if change > (MIN_CHANGE if h == first else MEASURABLE_CHANGE):
                return usual if h == first else 1e-3 * h / change
            h *= 1e6
        return usual

    # ---- the model at a parameter set

    def evaluator(self, parameters: Mapping[str, float]) -> Evaluator:
        """Return the model at the given parameters, ready to be evaluated."""
        changes = self.changes(parameters)
        return self._evaluators.get(changes, lambda: self._build_evaluator(changes))

    def system(self, parameters: Mapping[str, float]) -> System:
        """Return the system at the given parameters, reduced if the structure is; no kernel is loaded."""
        changes = self.changes(parameters)
        return self._systems.get(changes, lambda: self._system(changes))

    def model_at(self, parameters: Mapping[str, float]) -> Model:
        """Return the model with the given parameters."""
        return self._model(self.changes(parameters))

    def reduction(self, parameters: Mapping[str, float]) -> tuple[Reduction, float] | None:
        """Return the reduced structure at these parameters and its error; None for the whole structure."""
        return self._reduction(self.changes(parameters))

    def _model(self, changes: Changes) -> Model:
        return self._models.get(changes, lambda: self.model.replace(**dict(changes)) if changes else self.model)

    def _reduction(self, changes: Changes) -> tuple[Reduction, float] | None:
        if self.reduced_for is None:
            return None
        highest = self.reduced_for * self.discretization.H / self.discretization.nu
        return self._reductions.get(changes, lambda: reduced_within(self._model(changes).system(), highest))

    def _system(self, changes: Changes) -> System:
        reduction = self._reduction(changes)
        return self._model(changes).system() if reduction is None else reduction[0].system

    def _build_evaluator(self, changes: Changes) -> Evaluator:
        system, grid = self.system(dict(changes)), self.discretization
        structure = self._structure(system)
        return Evaluator(system, structure, grid.H, grid.nu, grid.sampled, grid.transform, self.reduce, grid.orders)

    def _structure(self, system: System) -> LinearStructure:
        """Return the linear part of a system; dense matrices that were decomposed before are not decomposed again."""
        if system.speed is not None:
            return SpeedDependentStructure(system)
        if system.receptances is not None:
            return MeasuredStructure(system)
        build = LinearStructure if self._expansion is None else self._expansion.of
        dense = [A for A in (system.M, system.C, system.K) if isinstance(A, np.ndarray)]
        if len(dense) < 3:
            return build(system)
        damping = np.array([e.damping for e in system.elements])
        key = (*(A.tobytes() for A in (*dense, system.W, references(system), damping)),)
        structure = self._structures.get(key, lambda: build(system))
        structure.check_balance(system)
        return structure
