"""Derivatives of a point: its equations, its problem with all parameters, and the quantities that depend on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hbgear.analysis.parameter_sensitivity.exact_point import is_exact, slopes_of, slopes_of_motion
from hbgear.analysis.parameter_sensitivity.units import LENGTH, Units, base_problem, measured_along
from hbgear.common.arrays import Array
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.augmented.sensitivity import Slopes, along, of_branch_point, of_solution, of_special, tangent
from hbgear.continuation.events.detector import event_at
from hbgear.continuation.events.fold import TURNING_KINDS
from hbgear.continuation.events.residual_form import in_residual_form
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence, refine, solve
from hbgear.harmonic.bifurcations.extremum import peak_of
from hbgear.harmonic.contact_instants.problem import ContactInstants
from hbgear.harmonic.contact_instants.special_states import MAX_HARD_COORDINATES
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import MESH, PINION
from hbgear.mechanics.models import Model

Row = tuple[str, float, Array]
"""Name, value and derivatives of a quantity."""


def differentiable(point: Point, exact: bool = False) -> Point:
    """Return a point in a problem whose residual can be differentiated; see `in_residual_form`.

    With ``exact``, a special point in contact instants is returned as it is. For structures with many coordinates this
    takes minutes, and the residual form is used if it is accurate enough.
    """
    exact = exact and is_exact(point.problem, point)
    if point.problem is None or (exact and point.problem.compiled({}).system.n <= MAX_HARD_COORDINATES):
        return point
    problem, parameter = as_problem(point.problem), list(point.parameters)[-1]
    event = event_at(problem, parameter, point) if isinstance(point, SpecialPoint) else None
    try:
        return in_residual_form(problem, point, parameter, event)[1]
    except NoConvergence:
        if exact:
            return point
        raise


def problem_and_parameters(point: Point) -> tuple[ContinuationProblem, dict[str, float], str]:
    """Return the problem and all parameters of a point, and the name of the parameter of its branch."""
    if point.problem is None:
        raise ValueError(
            f"{point.label or 'the point'} does not know its problem; take it from the curve, as curve['LP1'], and "
            "load curves with load(path, problem=HarmonicBalance(...))"
        )
    if isinstance(point, SpecialPoint) and not point.located:
        low, high = point.interval
        raise ValueError(f"{point.label} was not located, only known to lie within {low:.8g} and {high:.8g}")
    problem = as_problem(point.problem)
    inner = base_problem(problem)
    entries = inner.model.entries if isinstance(inner, HarmonicBalance) else {}
    return problem, {**entries, **problem.parameters, **point.parameters}, list(point.parameters)[-1]


def parameter_names(
    problem: ContinuationProblem, parameters: Mapping[str, float], parameter: str, requested: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the wanted parameters after a check, or all parameters that are not unknowns of the point."""
    unknowns = {parameter, *problem.unknown_parameters}
    if requested is None:
        names = tuple(name for name in parameters if name not in unknowns)
        if not names:
            raise ValueError(
                "the model has no parameters; write it as a function of its parameters that returns a System, with the "
                "decorator hb.mechanics.model"
            )
        return names
    for name in requested:
        problem.check_parameter(name)
        if name in unknowns:
            raise ValueError(f"{name} is an unknown of the point; choose other parameters")
        if name not in parameters:
            raise KeyError(f"the point has no parameter '{name}'{did_you_mean(name, parameters)}")
    return tuple(dict.fromkeys(requested))


def with_cache_size(problem: ContinuationProblem, point: Point, sets: int) -> ContinuationProblem:
    """Return the problem with the unknowns of the point and a cache for this number of sets of parameters."""
    return _with_balance(problem, point, lambda balance: balance.with_cache_size(sets))


def expanded_at(
    problem: ContinuationProblem, point: Point, parameters: Mapping[str, float], sets: int
) -> ContinuationProblem:
    """Return `with_cache_size` with receptances expanded about the parameters of the point.

    Points in contact instants have their problem without a change.
    """
    if isinstance(problem, ContactInstants):
        return problem
    return _with_balance(problem, point, lambda balance: balance.perturbed(parameters, sets))


def _with_balance(
    problem: ContinuationProblem, point: Point, replaced: Callable[[HarmonicBalance], HarmonicBalance]
) -> ContinuationProblem:
    """Return the problem with the unknowns of the point and its harmonic balance replaced by a function of it."""
    if isinstance(problem, MinimallyAugmentedProblem):
        return problem.for_problem(_with_balance(problem.problem, point, replaced))
    return _at_resolution(replaced(problem) if isinstance(problem, HarmonicBalance) else problem, point)


def _at_resolution(problem: ContinuationProblem, point: Point) -> ContinuationProblem:
    """Return the problem with the period and the number of harmonics of a point."""
    layout = point.layout
    if not isinstance(problem, HarmonicBalance) or not isinstance(layout, Layout):
        return problem.at_resolution_of(point)
    if (layout.nu, layout.harmonics) == (problem.nu, problem.H):
        return problem
    if layout.nu == problem.nu and layout.harmonics > problem.H:
        return problem.at_resolution_of(point)
    return problem.with_order(layout.nu, layout.harmonics)


@dataclass(frozen=True)
class PointSensitivity:
    """Point with its problem and all parameters, the parameter of its branch, and the parameters of derivatives."""

    problem: ContinuationProblem
    point: Point
    parameters: dict[str, float]
    parameter: str
    names: tuple[str, ...]

    @property
    def X(self) -> Array:
        """Unknowns of the problem."""
        return self.problem.join(self.point.X, self.parameters)

    def slopes(self) -> Slopes:
        """Return the derivatives of the unknowns and of the parameter of the branch."""
        if isinstance(self.problem, ContactInstants) and isinstance(self.point, SpecialPoint):
            return slopes_of(self.problem, self.point, self.parameters, self.parameter, self.names)
        if not isinstance(self.point, SpecialPoint):
            return of_solution(self.problem, self.X, self.parameters, self.names)
        if self.point.kind == "BP":
            equations = CurveEquations(self.problem, self.parameter, self.parameters)
            return of_branch_point(equations, np.append(self.X, self.parameters[self.parameter]), self.names)
        return of_special(*self.refined, self.parameters, self.names)

    @cached_property
    def refined(self) -> tuple[MinimallyAugmentedProblem, Array]:
        """Equations of a special point with borders computed there, and (X, p) refined to rounding."""
        U = np.append(self.X, self.parameters[self.parameter])
        equations = self.equations().with_borders_at(U, self.parameters)
        with suppress(NoConvergence):  # then the located point is used
            U = refine(equations, solve(equations, U, self.parameters), self.parameters).X
        return equations, U

    @property
    def parameter_value(self) -> float:
        """Value of the parameter of the branch, refined if `refined` was computed."""
        return float(self.refined[1][-1]) if "refined" in vars(self) else self.parameters[self.parameter]

    def equations(self) -> MinimallyAugmentedProblem:
        """Return the equations of a special point; raise a ValueError if its kind has no equations."""
        equations, point = self.known_equations(), self.point
        assert isinstance(point, SpecialPoint)
        if equations is None:
            raise ValueError(
                f"{point.label} ({point.meaning.partition(': ')[0]}) has no equations that can be differentiated; "
                "choose LP, PD, NS, BP, GR, SL, CP, a peak, a jump, or a point of the branch"
            )
        return equations

    def known_equations(self) -> MinimallyAugmentedProblem | None:
        """Return the equations of a special point. None if its kind has no equations."""
        point = self.point
        assert isinstance(point, SpecialPoint)
        if point.kind == "PK":
            measure = point.note.removeprefix("peak of ")
            return peak_of(self.problem, self.parameter, measure, getattr(point.event, "element", 0))
        if point.kind in TURNING_KINDS:
            return FoldProblem(self.problem, self.parameter)
        event = event_at(self.problem, self.parameter, point)
        return event.equations(self.problem.original, self.parameter, point) if event else None

    @cached_property
    def model_parameters(self) -> dict[str, float]:
        """Parameters of the model."""
        model = getattr(base_problem(self.problem), "model", None)
        return model.parameters | model.entries if isinstance(model, Model) else {}

    def _modulus_nearest_to(self, mu: complex) -> Callable[[Array, dict[str, float]], float]:
        """Return the logarithm of the modulus, as a function, of the multiplier nearest to `mu`."""
        problem: Any = self.problem

        def value(X: Array, changed: dict[str, float]) -> float:
            multipliers = problem.multipliers(X, points=8, **self._changed_parameters(changed))
            return math.log(abs(multipliers[np.argmin(np.abs(multipliers - mu))]))

        return value

    def _changed_parameters(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters whose values differ from the model."""
        model_parameters = self.model_parameters
        return {name: float(value) for name, value in parameters.items() if model_parameters.get(name) != value}

    def unknown_parameters(self, slopes: Slopes) -> list[tuple[str, Array]]:
        """Return the derivatives of parameters that are unknowns, such as the frequency on a fold curve."""
        names = self.problem.unknown_parameters
        return [(name, slopes.X[:, -1 - i]) for i, name in enumerate(names)]

    def speeds(self, rows: Sequence[Row], units: Units) -> list[Row]:
        """Return mesh frequency and speed with their derivatives; empty if the model has no `Scales`."""
        sizes, changes = units
        if "Omega" not in self.parameters:
            return []
        Omega, slopes_by_name = self.parameters["Omega"], {name: slopes for name, _, slopes in rows}
        dOmega = slopes_by_name.get("Omega", np.array([float(name == "Omega") for name in self.names]))
        return [
            (unit, Omega * sizes[unit], sizes[unit] * dOmega + Omega * changes[unit])
            for unit in (MESH, PINION)
            if unit in sizes
        ]

    def amplitudes(self, name: str, measure: str, element: int | str, X_a: Array, units: Units) -> list[Row]:
        """Return the amplitude with its derivatives, with `Scales` also in metres."""
        layout = self.point.layout
        if layout is None:
            return []
        X, width = self.point.X, len(self.point.X)
        size = float(layout.measure(measure, X, element))
        slopes = measured_along(layout, measure, element, X[None], X_a[None, :, :width])[0]
        rows: list[Row] = [(name, size, slopes)]
        sizes, changes = units
        if LENGTH in sizes:
            rows.append((f"{name} {LENGTH}", sizes[LENGTH] * size, sizes[LENGTH] * slopes + size * changes[LENGTH]))
        return rows

    def at_landing(self, after: Point, p_a: Array) -> tuple[PointSensitivity, Array]:
        """Return the motion on which a jump lands, at the frequency of the jump, and its derivatives."""
        problem = _at_resolution(self.problem, after)
        parameters = {**self.parameters, self.parameter: self.parameter_value}
        landing = PointSensitivity(problem, after, parameters, self.parameter, self.names)
        if isinstance(problem, ContactInstants):
            X_a, X_p = slopes_of_motion(problem, after, parameters, self.parameter, self.names)
            return landing, X_a + p_a[:, None] * X_p
        t = tangent(problem, landing.X, parameters, self.parameter)
        return landing, of_solution(problem, landing.X, parameters, self.names).X + p_a[:, None] * t

    def largest_multiplier(self, slopes: Slopes) -> Row:
        """Return the largest modulus of the multipliers with its derivatives along the derivatives of the point."""
        problem = self.problem
        if not isinstance(problem, HarmonicBalance) or isinstance(problem, ContactInstants):
            raise ValueError("multipliers=True needs a point of a HarmonicBalance, without further unknowns")
        mu = problem.multipliers(self.X, points=8, **self._changed_parameters(self.parameters))[0]
        value = self._modulus_nearest_to(mu)
        p = self.parameter

        def derivative(name: str, dX: Array, dp: float) -> float:
            def along_point(X: Array, changed: dict[str, float]) -> float:
                return value(X, {**changed, p: self.parameters[p] + dp * (changed[name] - self.parameters[name])})

            return along(problem, self.X, self.parameters, along_point, dX, name)

        directions = zip(self.names, slopes.X, slopes.p, strict=True)
        return "|mu|", abs(mu), abs(mu) * np.array([derivative(name, dX, dp) for name, dX, dp in directions])
