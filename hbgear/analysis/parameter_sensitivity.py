"""Sensitivities: derivatives of a frequency and an amplitude in each parameter of the model.

    dOmega/da, dA/da          of a special point, a peak or a jump; of a motion at a fixed frequency dA/da alone
    n = s(a) Omega:           dn/da = s dOmega/da + Omega ds/da       in r/min and Hz, L(a) A in metres

They follow from the equations of the point (`hbgear.continuation.augmented.sensitivity`). The scales s and L depend on
parameters as well.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hbgear.analysis.critical_parameters import CriticalParameter
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.augmented.sensitivity import (
    Slopes,
    along,
    of_branch_point,
    of_crossing,
    of_solution,
    of_special,
    tangent,
)
from hbgear.continuation.events.detector import event_at
from hbgear.continuation.events.fold import TURNING_KINDS
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.layout import LayoutProtocol
from hbgear.continuation.results.point import Jump, Point, SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence, refine, solve
from hbgear.harmonic.bifurcations.extremum import peak_of
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import MESH, PINION, scales
from hbgear.mechanics.models import Model

LENGTH = "m"
"""Unit of amplitudes of models with `Scales`."""


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity:
    """Derivatives of the quantities of a point in the parameters of its model.

    Attributes
    ----------
    label : str
        Label of the point.
    parameters : tuple of str
        A names of parameters; entries of tuples as ``eps[0]``.
    values : ndarray, shape (A,)
        Values of the parameters.
    quantities : tuple of str
        Q names: the parameter of the branch, "mesh Hz" and "pinion r/min" if the model has `Scales`, and the amplitude
        ("pp2", with `Scales` also "pp2 m"; of a jump "pp2 before" and "pp2 after").
    sizes : ndarray, shape (Q,)
        Values of the quantities.
    slopes : ndarray, shape (Q, A)
        Derivatives in the units of quantity and parameter; nan where the derivative does not exist.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> found = hb.analysis.sensitivity(curve["LP1"])
    >>> found.quantities
    ('Omega', 'rms')
    >>> max(found.percent("Omega"), key=found.percent("Omega").get)
    'F'
    """

    label: str
    parameters: tuple[str, ...]
    values: Array
    quantities: tuple[str, ...]
    sizes: Array
    slopes: Array

    def __repr__(self) -> str:
        largest = next(iter(self.percent()), "")
        quantities = ", ".join(self.quantities)
        return f"<Sensitivity of {self.label}: {quantities} in {len(self.parameters)} parameters; {largest}>"

    @checked_arguments()
    def size(self, quantity: str = "") -> float:
        """Return the value of a quantity.

        Parameters
        ----------
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        float
            Value.
        """
        return float(self.sizes[self._index(quantity)])

    @checked_arguments()
    def of(self, quantity: str = "") -> dict[str, float]:
        """Return the derivatives of a quantity in each parameter.

        Parameters
        ----------
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        dict of str to float
            Derivative by name of the parameter.

        Raises
        ------
        KeyError
            If there is no such quantity.
        """
        return dict(zip(self.parameters, self.slopes[self._index(quantity)].tolist(), strict=True))

    @checked_arguments()
    def percent(self, quantity: str = "") -> dict[str, float]:
        """Return the change of a quantity in percent for one percent of each parameter that is not zero.

        Parameters
        ----------
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        dict of str to float
            Change [%] by name of the parameter, the largest first, nan last.

        Raises
        ------
        KeyError
            If there is no such quantity.
        """
        i = self._index(quantity)
        change = self.slopes[i] * self.values / (self.sizes[i] or math.nan)
        order = np.argsort(-np.abs(change), kind="stable")
        return {self.parameters[a]: float(change[a]) for a in order if self.values[a]}

    @checked_arguments(spread="a dictionary of standard deviations by name, such as {'zeta': 0.002}")
    def scatter(self, spread: Mapping[str, float], quantity: str = "") -> float:
        """Return the standard deviation of a quantity for independent small deviations of parameters, to first order.

            s^2 = sum_a (dquantity/da s_a)^2

        Parameters
        ----------
        spread : dict of str to float
            Standard deviations of parameters by name, in their units.
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        float
            Standard deviation in the unit of the quantity.

        Raises
        ------
        KeyError, ValueError
            If there is no such quantity or parameter, or a deviation is negative.
        """
        slopes = self.of(quantity)
        for name, deviation in spread.items():
            if name not in slopes:
                raise KeyError(f"no derivative in '{name}'{did_you_mean(name, slopes)}")
            if not deviation >= 0:
                raise ValueError(f"spread: {name} = {quoted(deviation)} must be a standard deviation of at least 0")
        return math.sqrt(sum((slopes[name] * deviation) ** 2 for name, deviation in spread.items()))

    @checked_arguments()
    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a .csv file with parameter, value and derivatives of each quantity; no file is left after an error.

        Parameters
        ----------
        path : str or path-like
            File. Its name ends in .csv.

        Raises
        ------
        ValueError
            If the name of the file has another ending.
        """
        if not str(path).endswith(".csv"):
            raise ValueError(f"'{path}' must end in .csv")
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(["parameter", "value", *(f"d {quantity}" for quantity in self.quantities)])
            writer.writerow(["", "", *self.sizes.tolist()])
            for row in zip(self.parameters, self.values.tolist(), *self.slopes.tolist(), strict=True):
                writer.writerow(row)

    def _index(self, quantity: str) -> int:
        """Return the number of a quantity."""
        if quantity and quantity not in self.quantities:
            raise KeyError(f"no derivatives of '{quantity}'{did_you_mean(quantity, self.quantities)}")
        return self.quantities.index(quantity) if quantity else 0


@checked_arguments(
    point="a special point, peak, jump, critical parameter or point of a branch, such as curve['LP1']",
    parameters="names of parameters, such as ('zeta', 'e[0]')",
)
def sensitivity(
    point: Point | Jump | CriticalParameter,
    parameters: Sequence[str] | None = None,
    *,
    measure: str | None = None,
    element: int | str = 0,
    multipliers: bool = False,
) -> Sensitivity:
    """Compute derivatives of the frequency and amplitude of a point in the parameters of its model.

    The derivative of a fold is dOmega/da = -(w . R_a) / (w . R_Omega). The derivatives of other special points follow
    from their augmented equations. Of any other point the frequency is fixed and the amplitude has derivatives.

    Parameters
    ----------
    point : Point, Jump or CriticalParameter
        Point of a branch that knows its problem, such as ``curve["LP1"]``, ``curve.jumps()[0]``,
        ``hb.analysis.peaks(curve)[0]`` or ``curve[7]``, or a critical parameter, whose first quantity is its value.
    parameters : sequence of str, optional
        Names of parameters; entries of tuples as ``eps[0]``. By default all parameters of the model.
    measure : str, optional
        Measure of amplitude, see `Branch.amplitude`. By default "rms", for a peak its own measure.
    element : int or str, optional
        Element by number or name. The default is the first element.
    multipliers : bool, optional
        If True, the largest modulus of the multipliers is a further quantity. The default is False.

    Returns
    -------
    Sensitivity
        Quantities and their derivatives.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If the point does not know its problem or was not located, or its kind has no equations.
    NoConvergence
        If the equations of the point cannot be solved.

    Notes
    -----
    Derivatives in parameters are central differences of the equations, one-sided at the end of a range, with a relative
    error of about 1e-8. If a change of a parameter separates two branches that intersect, the derivatives of their
    branch point are nan.

    References
    ----------
    Govaerts (2000), Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM,
    https://doi.org/10.1137/1.9780898719543.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.0, 0.6))
    >>> found = hb.analysis.sensitivity(curve["LP1"], ["zeta", "e[0]"])
    >>> round(found.of("Omega")["zeta"], 2) > 0
    True
    """
    if parameters is not None and not len(parameters):
        raise ValueError("sensitivity: name at least one parameter, such as ['zeta'], or give None for all")
    if isinstance(point, CriticalParameter):
        point = point.point
    one = point.before if isinstance(point, Jump) else point
    problem, here, parameter = _problem_and_parameters(one)
    names = _parameter_names(problem, here, parameter, parameters)
    cached = _expanded_at(problem, one, here, 2 * len(names) + _EXTRA_PARAMETER_SETS)
    sensitive = _PointSensitivity(cached, one, here, parameter, names)
    slopes = sensitive.slopes()
    rows: list[_Row] = [(parameter, here[parameter], slopes.p)]
    rows += [(name, here[name], X_a) for name, X_a in sensitive.unknown_parameters(slopes)]
    units = units_at(sensitive.problem, here, names)
    rows += sensitive.speeds(rows, units)
    note = one.note if isinstance(one, SpecialPoint) and one.kind == "PK" else ""
    wanted = measure or note.removeprefix("peak of ") or "rms"
    motions = [(wanted, sensitive, slopes.X)]
    if isinstance(point, Jump) and point.after is not None:
        motions[0] = (f"{wanted} before", sensitive, slopes.X)
        motions.append((f"{wanted} after", *sensitive.landed(point.after, slopes.p)))
    for name, at, X_a in motions:
        rows += at.amplitudes(name, wanted, element, X_a, units)
    if multipliers:
        rows.append(sensitive.largest_multiplier(slopes))
    label = point.label or "a point"
    values = np.array([here[name] for name in names])
    quantities, sizes, moved = zip(*rows, strict=True)
    return Sensitivity(label, names, values, quantities, np.array(sizes), np.array(moved))


_EXTRA_PARAMETER_SETS = 32
"""Number of cached sets of parameters in addition to two for each derivative."""

_Row = tuple[str, float, Array]
"""Name, value and derivatives of a quantity."""

_Units = tuple[dict[str, float], dict[str, Array]]
"""Units by name, and their derivatives in the parameters."""


def _problem_and_parameters(point: Point) -> tuple[ContinuationProblem, dict[str, float], str]:
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
    inner = _base_problem(problem)
    entries = inner.model.entries if isinstance(inner, HarmonicBalance) else {}
    return problem, {**entries, **problem.parameters, **point.parameters}, list(point.parameters)[-1]


def _parameter_names(
    problem: ContinuationProblem, here: Mapping[str, float], parameter: str, wanted: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the wanted parameters after a check, or all parameters that are not unknowns of the point."""
    own = {parameter, *problem.unknown_parameters}
    if wanted is None:
        return tuple(name for name in here if name not in own)
    for name in wanted:
        problem.check_parameter(name)
        if name in own:
            raise ValueError(f"{name} is an unknown of the point; choose other parameters")
        if name not in here:
            raise KeyError(f"the point has no parameter '{name}'{did_you_mean(name, here)}")
    return tuple(dict.fromkeys(wanted))


def _with_cache_size(problem: ContinuationProblem, point: Point, sets: int) -> ContinuationProblem:
    """Return the problem with the unknowns of the point and a cache for this number of sets of parameters."""
    return _with_balance(problem, point, lambda balance: balance.with_cache_size(sets))


def _expanded_at(
    problem: ContinuationProblem, point: Point, here: Mapping[str, float], sets: int
) -> ContinuationProblem:
    """Return `_with_cache_size` with receptances expanded about the parameters of the point."""
    return _with_balance(problem, point, lambda balance: balance.perturbed(here, sets))


def _with_balance(
    problem: ContinuationProblem, point: Point, replaced: Callable[[HarmonicBalance], HarmonicBalance]
) -> ContinuationProblem:
    """Return the problem with the unknowns of the point and its harmonic balance replaced by a function of it."""
    if isinstance(problem, MinimallyAugmentedProblem):
        inner = _with_balance(problem.problem, point, replaced)
        return type(problem)(inner, problem.parameter, *problem.arguments)
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


def units_at(problem: ContinuationProblem, here: Mapping[str, float], names: Sequence[str]) -> _Units:
    """Return the units of a model and their derivatives in parameters.

    Parameters
    ----------
    problem : ContinuationProblem
        Equations of the point.
    here : dict of str to float
        All parameters.
    names : sequence of str
        A names of parameters.

    Returns
    -------
    values : dict of str to float
        "mesh Hz" and "pinion r/min" at Omega = 1, and "m", the unit of length; empty if the model has no `Scales`.
    derivatives : dict of str to ndarray, shape (A,)
        Their derivatives.
    """
    inner = _base_problem(problem)
    if not isinstance(inner, HarmonicBalance) or not (own := units_of(inner.model_at(here))):
        return {}, {}
    keys, known = list(own), inner.model.parameters | inner.model.entries
    changes = np.zeros((len(names), len(keys)))
    for row, name in zip(changes, names, strict=True):

        def values(at: dict[str, float], name: str = name) -> tuple[float, ...]:
            return tuple(units_of(inner.model_at({**here, name: at[name]})).values())

        if name in known:
            row[:] = parameter_derivatives(problem, name, here, values)
    return own, dict(zip(keys, changes.T, strict=True))


def units_of(model: Model) -> dict[str, float]:
    """Return Hz and r/min at Omega = 1 and the unit of length in metres; empty if the model has no `Scales`."""
    known, own = scales(model, {}), model.scales
    return known | {LENGTH: own.length} if known and own else known


@dataclass(frozen=True)
class _PointSensitivity:
    """Point with its problem and all parameters, the parameter of its branch, and the parameters of derivatives."""

    problem: ContinuationProblem
    point: Point
    here: dict[str, float]
    parameter: str
    names: tuple[str, ...]

    @property
    def X(self) -> Array:
        """Unknowns of the problem."""
        return self.problem.join(self.point.X, self.here)

    def slopes(self) -> Slopes:
        """Return the derivatives of the unknowns and of the parameter of the branch."""
        if not isinstance(self.point, SpecialPoint):
            return of_solution(self.problem, self.X, self.here, self.names)
        if self.point.kind == "BP":
            return of_branch_point(self.problem, self.X, self.here, self.parameter, self.names)
        if self.point.kind == "NS" and self.known_equations() is None:
            return of_crossing(self.problem, self.X, self.here, self.parameter, self.names, self._modulus())
        return of_special(*self.refined, self.here, self.names)

    @cached_property
    def refined(self) -> tuple[MinimallyAugmentedProblem, Array]:
        """Equations of a special point with borders computed there, and (X, p) refined to rounding."""
        U = np.append(self.X, self.here[self.parameter])
        equations = self.equations().with_borders_at(U, self.here)
        with suppress(NoConvergence):  # then the located point is used
            U = refine(equations, solve(equations, U, self.here), self.here).X
        return equations, U

    @property
    def parameter_value(self) -> float:
        """Value of the parameter of the branch, refined if `refined` was computed."""
        return float(self.refined[1][-1]) if "refined" in vars(self) else self.here[self.parameter]

    def equations(self) -> MinimallyAugmentedProblem:
        """Return the equations of a special point; raise a ValueError if its kind has no equations."""
        known, point = self.known_equations(), self.point
        assert isinstance(point, SpecialPoint)
        if known is None:
            raise ValueError(
                f"{point.label} ({point.meaning.partition(': ')[0]}) has no equations that can be differentiated; "
                "choose LP, PD, NS, BP, GR, CP, a peak, a jump, or a point of the branch"
            )
        return known

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
    def own(self) -> dict[str, float]:
        """Parameters of the model."""
        model = getattr(_base_problem(self.problem), "model", None)
        return model.parameters | model.entries if isinstance(model, Model) else {}

    def _modulus(self) -> Callable[[Array, dict[str, float]], float]:
        """Return the logarithm of the modulus, as a function, of the multiplier on the unit circle at the point."""
        problem = self.problem
        assert isinstance(problem, HarmonicBalance)
        every = problem.multipliers(self.X, points=8, width=1.0, **self._changed_parameters(self.here))
        complex_pairs = every[np.abs(every.imag) > 1e-8 * np.abs(every)]
        candidates = complex_pairs if complex_pairs.size else every
        mu = candidates[np.argmin(np.abs(np.abs(candidates) - 1.0))]
        return self._modulus_nearest_to(mu)

    def _modulus_nearest_to(self, mu: complex) -> Callable[[Array, dict[str, float]], float]:
        """Return the logarithm of the modulus, as a function, of the multiplier nearest to `mu`."""
        problem: Any = self.problem

        def value(X: Array, at: dict[str, float]) -> float:
            every = problem.multipliers(X, points=8, width=1.0, **self._changed_parameters(at))
            return math.log(abs(every[np.argmin(np.abs(every - mu))]))

        return value

    def _changed_parameters(self, here: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters whose values differ from the model."""
        own = self.own
        return {name: float(value) for name, value in here.items() if own.get(name) != value}

    def unknown_parameters(self, slopes: Slopes) -> list[tuple[str, Array]]:
        """Return the derivatives of parameters that are unknowns, such as the frequency on a fold curve."""
        own = self.problem.unknown_parameters
        return [(name, slopes.X[:, -1 - i]) for i, name in enumerate(own)]

    def speeds(self, rows: Sequence[_Row], units: _Units) -> list[_Row]:
        """Return mesh frequency and speed with their derivatives; empty if the model has no `Scales`."""
        own, changes = units
        if "Omega" not in self.here:
            return []
        Omega, found = self.here["Omega"], {name: slopes for name, _, slopes in rows}
        moved = found.get("Omega", np.array([float(name == "Omega") for name in self.names]))
        return [(unit, Omega * own[unit], own[unit] * moved + Omega * changes[unit]) for unit in (MESH, PINION)
                if unit in own]  # fmt: skip

    def amplitudes(self, name: str, measure: str, element: int | str, X_a: Array, units: _Units) -> list[_Row]:
        """Return the amplitude with its derivatives, with `Scales` also in metres."""
        layout = self.point.layout
        if layout is None:
            return []
        X, width = self.point.X, len(self.point.X)
        size = float(layout.measure(measure, X, element))
        moved = measured_along(layout, measure, element, X[None], X_a[None, :, :width])[0]
        rows: list[_Row] = [(name, size, moved)]
        own, changes = units
        if LENGTH in own:
            rows.append((f"{name} {LENGTH}", own[LENGTH] * size, own[LENGTH] * moved + size * changes[LENGTH]))
        return rows

    def landed(self, after: Point, p_a: Array) -> tuple[_PointSensitivity, Array]:
        """Return the motion on which a jump lands, at the frequency of the jump, and its derivatives."""
        problem = _at_resolution(self.problem, after)
        here = {**self.here, self.parameter: self.parameter_value}
        at = _PointSensitivity(problem, after, here, self.parameter, self.names)
        t = tangent(problem, at.X, here, self.parameter)
        return at, of_solution(problem, at.X, here, self.names).X + p_a[:, None] * t

    def largest_multiplier(self, slopes: Slopes) -> _Row:
        """Return the largest modulus of the multipliers with its derivatives along the derivatives of the point."""
        problem = self.problem
        if not isinstance(problem, HarmonicBalance):
            raise ValueError("multipliers=True needs a point of a HarmonicBalance, without further unknowns")
        mu = problem.multipliers(self.X, points=8, width=1.0, **self._changed_parameters(self.here))[0]
        value = self._modulus_nearest_to(mu)
        p = self.parameter

        def derivative(name: str, dX: Array, dp: float) -> float:
            def along_point(X: Array, at: dict[str, float]) -> float:
                return value(X, {**at, p: self.here[p] + dp * (at[name] - self.here[name])})

            return along(problem, self.X, self.here, along_point, dX, name)

        each = zip(self.names, slopes.X, slopes.p, strict=True)
        return "|mu|", abs(mu), abs(mu) * np.array([derivative(name, dX, dp) for name, dX, dp in each])


class RelocatedPoint:
    """Special point as a function of some parameters.

    Parameters
    ----------
    point : Point
        Special point as for `sensitivity`, of a kind with equations.
    names : sequence of str
        Names of the parameters that change.

    Raises
    ------
    ValueError
        If the point has no equations, or does not know its problem.
    """

    def __init__(self, point: Point, names: Sequence[str]) -> None:
        problem, here, parameter = _problem_and_parameters(point)
        self._names = _parameter_names(problem, here, parameter, names)
        at = _PointSensitivity(_with_cache_size(problem, point, 4), point, here, parameter, self._names)
        self._equations, self._here = at.equations(), here
        slopes = at.slopes()
        self._U = np.append(at.X, here[parameter])
        self._slopes = np.column_stack([slopes.X, slopes.p])

    def at(self, changes: Array) -> float:
        """Return the value of the parameter of the branch at the point, for changes of the parameters; see `solved`."""
        return float(self.solved(changes)[0][-1])

    def slopes(self, U: Array, here: Mapping[str, float]) -> Slopes:
        """Return the derivatives of the unknowns and of the parameter of the branch at a point of `solved`."""
        return of_special(self._equations, U, here, self._names)

    def solved(self, changes: Array) -> tuple[Array, dict[str, float]]:
        """Solve for the point with changed parameters.

        Parameters
        ----------
        changes : ndarray, shape (A,)
            Changes of the parameters.

        Returns
        -------
        U : ndarray
            Unknowns and parameter of the branch, (X, p).
        parameters : dict of str to float
            All parameters.

        Raises
        ------
        NoConvergence, ValueError, numpy.linalg.LinAlgError
            If there is no point near the prediction of first order.
        """
        here = {**self._here, **{a: self._here[a] + float(x) for a, x in zip(self._names, changes, strict=True)}}
        U = self._U + changes @ self._slopes
        found = solve(self._equations.with_borders_at(U, here), U, here).X
        moved, expected = abs(found[-1] - self._U[-1]), abs(U[-1] - self._U[-1])
        if moved > _MAX_CHANGE_RATIO * (expected + 1e-3 * abs(self._U[-1])):
            raise NoConvergence("Newton ended at another point", found, here, [])
        return found, here


_MAX_CHANGE_RATIO = 5.0
"""Largest change of a point over its prediction of first order; a larger one belongs to another point."""


def _base_problem(problem: ContinuationProblem) -> ContinuationProblem:
    """Return the problem of periodic motions inside augmented equations."""
    return _base_problem(problem.problem) if isinstance(problem, MinimallyAugmentedProblem) else problem


def measured_along(layout: LayoutProtocol, measure: str, element: int | str, X: Array, along: Array) -> Array:
    """Return the derivatives (P, A) of an amplitude of motions X (P, n) along directions (P, A, n).

    They are central differences, and nan for directions that are not finite.
    """
    sizes = np.linalg.norm(along, axis=-1)
    known = np.isfinite(sizes)
    h = 1e-5 * np.maximum(np.linalg.norm(X, axis=-1), 1e-3)[:, None] / np.where(known & (sizes > 0), sizes, 1.0)
    moved = h[..., None] * np.where(known[..., None], along, 0.0)
    up, down = (layout.measure(measure, X[:, None] + side * moved, element) for side in (1, -1))
    rates: Array = np.where(known, up - down, math.nan) / (2 * h)
    return rates
