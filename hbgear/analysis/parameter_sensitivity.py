"""What a frequency and an amplitude depend on: derivatives in every parameter of the model.

    dOmega/da, dA/da          of a special point, a peak, a jump; of a motion at a held frequency dA/da alone
    n = s(a) Omega:           dn/da = s dOmega/da + Omega ds/da       in r/min and Hz, L(a) A in metres

from the equations of the point (`hbgear.continuation.augmented.sensitivity`); scales s and L depend on parameters too.
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
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.layout import LayoutProtocol
from hbgear.continuation.results.point import Jump, Point, SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence, refine, solve
from hbgear.harmonic.bifurcations.extremum import peak_of
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.frequency_units import MESH, PINION, scales
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model

LENGTH = "m"
"""Unit of amplitudes of models that know theirs."""


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity:
    """Derivatives of what a point is, in the parameters of its model.

    Parameters
    ----------
    label : of the point.
    parameters, values : (A,) names, entries of tuples as ``eps[0]``, and values in the model.
    quantities, sizes : (Q,) names and values: the parameter of the curve, "mesh Hz" and "pinion r/min" of models that
        know their units, the amplitude ("pp2", also "pp2 m"; of a jump "pp2 before" and "pp2 after").
    slopes : (Q, A) derivatives, in the units of quantity and parameter; nan where there is none.

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
        most = next(iter(self.percent()), "")
        return (
            f"<Sensitivity of {self.label}: {', '.join(self.quantities)} in {len(self.parameters)} parameters; {most}>"
        )

    @checked_arguments()
    def size(self, quantity: str = "") -> float:
        """The value of a quantity; the first by default."""
        return float(self.sizes[self._index(quantity)])

    @checked_arguments()
    def of(self, quantity: str = "") -> dict[str, float]:
        """Derivative of a quantity, the first by default, in each parameter.

        Raises
        ------
        KeyError
            If there is no such quantity.
        """
        return dict(zip(self.parameters, self.slopes[self._index(quantity)].tolist(), strict=True))

    @checked_arguments()
    def percent(self, quantity: str = "") -> dict[str, float]:
        """Change in percent for one percent of each parameter that is not zero, the largest first; nan comes last.

        Raises
        ------
        KeyError
            If there is no such quantity.
        """
        i = self._index(quantity)
        share = self.slopes[i] * self.values / (self.sizes[i] or math.nan)
        order = np.argsort(-np.abs(share), kind="stable")
        return {self.parameters[a]: float(share[a]) for a in order if self.values[a]}

    @checked_arguments(spread="standard deviations by name, such as {'zeta': 0.002}")
    def scatter(self, spread: Mapping[str, float], quantity: str = "") -> float:
        """Standard deviation of a quantity for independent small deviations of parameters, to first order.

            s^2 = sum_a (dquantity/da s_a)^2

        Parameters
        ----------
        spread : standard deviations of parameters by name, in their units.

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
        """Write a .csv: parameter, value, and the derivatives of each quantity; whole or not at all."""
        if not str(path).endswith(".csv"):
            raise ValueError(f"'{path}' must end in .csv")
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(["parameter", "value", *(f"d {quantity}" for quantity in self.quantities)])
            writer.writerow(["", "", *self.sizes.tolist()])
            for row in zip(self.parameters, self.values.tolist(), *self.slopes.tolist(), strict=True):
                writer.writerow(row)

    def _index(self, quantity: str) -> int:
        if quantity and quantity not in self.quantities:
            raise KeyError(f"no derivatives of '{quantity}'{did_you_mean(quantity, self.quantities)}")
        return self.quantities.index(quantity) if quantity else 0


@checked_arguments(
    point="a special point, peak, jump, critical value or row of a curve, such as curve['LP1']",
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
    """Derivatives of the frequency and amplitude of a point in the parameters of its model.

    A fold moves by dOmega/da = -(w . R_a) / (w . R_Omega), points of other kinds by the matrix of their own equations.
    The frequency of a row that is no special point is held, its amplitude moves.

    Parameters
    ----------
    point : of a curve that knows its problem: ``curve["LP1"]``, ``curve.jumps()[0]``, ``hb.analysis.peaks(curve)[0]``,
        ``curve[7]``; or a critical value, ``hb.analysis.critical_parameter(...)``, whose first quantity is the value
        itself.
    parameters : names, entries of tuples as ``eps[0]``; by default all of the model.
    measure, element : amplitude, as of `Branch.amplitude`; by default rms, of a peak its own.
    multipliers : derivatives of the largest modulus of the multipliers too.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If the point does not know its problem or was not located, or there are no derivatives of its kind.
    NoConvergence
        If its equations cannot be solved any more.

    Notes
    -----
    Derivatives in parameters are central differences of the equations, at the end of a range one-sided, and exact to
    some 1e-8. Where a parameter parts two curves that cross, the derivatives of their branch point are nan.

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
    problem, here, parameter = _asked(one)
    names = _names(problem, here, parameter, parameters)
    where = _At(_beside(problem, one, here, 2 * len(names) + _ASIDE), one, here, parameter, names)
    slopes = where.slopes()
    rows: list[_Row] = [(parameter, here[parameter], slopes.p)]
    rows += [(name, here[name], X_a) for name, X_a in where.unknown(slopes)]
    units = units_at(where.problem, here, names)
    rows += where.speeds(rows, units)
    note = one.note if isinstance(one, SpecialPoint) and one.kind == "PK" else ""
    wanted = measure or note.removeprefix("peak of ") or "rms"
    motions = [(wanted, where, slopes.X)]
    if isinstance(point, Jump) and point.after is not None:
        motions[0] = (f"{wanted} before", where, slopes.X)
        motions.append((f"{wanted} after", *where.landed(point.after, slopes.p)))
    for name, at, X_a in motions:
        rows += at.amplitudes(name, wanted, element, X_a, units)
    if multipliers:
        rows.append(where.largest_multiplier(slopes))
    label = point.label or "a point"
    values = np.array([here[name] for name in names])
    quantities, sizes, moved = zip(*rows, strict=True)
    return Sensitivity(label, names, values, quantities, np.array(sizes), np.array(moved))


_ASIDE = 32  # sets of parameters that are asked for beside two for each derivative


_Row = tuple[str, float, Array]  # quantity, value, derivatives


_Units = tuple[dict[str, float], dict[str, Array]]  # values by name, and their derivatives


def _asked(point: Point) -> tuple[ContinuationProblem, dict[str, float], str]:
    """Problem and parameters of a point, and in which of them its curve was traced."""
    if point.problem is None:
        raise ValueError(
            f"{point.label or 'the point'} does not know its problem; take it from the curve, as curve['LP1'], and "
            "load curves with load(path, problem=HarmonicBalance(...))"
        )
    if isinstance(point, SpecialPoint) and not point.located:
        low, high = point.interval
        raise ValueError(f"{point.label} was not located, only known to lie within {low:.8g} and {high:.8g}")
    problem = as_problem(point.problem)
    inner = _innermost(problem)
    entries = inner.model.entries if isinstance(inner, HarmonicBalance) else {}
    return problem, {**entries, **problem.parameters, **point.parameters}, list(point.parameters)[-1]


def _names(
    problem: ContinuationProblem, here: Mapping[str, float], parameter: str, wanted: Sequence[str] | None
) -> tuple[str, ...]:
    """Parameters in which there are derivatives: those asked for, or all but those that move themselves."""
    own = {parameter, *problem.unknown_parameters}
    if wanted is None:
        return tuple(name for name in here if name not in own)
    for name in wanted:
        problem.check_parameter(name)
        if name in own:
            raise ValueError(f"{name} is what the point is sought in; ask for derivatives in other parameters")
        if name not in here:
            raise KeyError(f"the point has no parameter '{name}'{did_you_mean(name, here)}")
    return tuple(dict.fromkeys(wanted))


def _remembering(problem: ContinuationProblem, point: Point, sets: int) -> ContinuationProblem:
    """The problem with the unknowns of the point, which keeps what it computes for many sets of parameters."""
    return _keeping(problem, point, lambda balance: balance.with_cache_size(sets))


def _beside(problem: ContinuationProblem, point: Point, here: Mapping[str, float], sets: int) -> ContinuationProblem:
    """The same for values of parameters next to those of the point."""
    return _keeping(problem, point, lambda balance: balance.beside(here, sets))


def _keeping(
    problem: ContinuationProblem, point: Point, keep: Callable[[HarmonicBalance], HarmonicBalance]
) -> ContinuationProblem:
    """The problem with the unknowns of the point, its balance replaced by one that keeps more."""
    if isinstance(problem, MinimallyAugmentedProblem):
        inner = _keeping(problem.problem, point, keep)
        return type(problem)(inner, problem.parameter, *problem.arguments)
    return _like(keep(problem) if isinstance(problem, HarmonicBalance) else problem, point)


def _like(problem: ContinuationProblem, point: Point) -> ContinuationProblem:
    """The problem with the unknowns of a point."""
    layout = point.layout
    if not isinstance(problem, HarmonicBalance) or not isinstance(layout, Layout):
        return problem.at_resolution_of(point)
    if (layout.nu, layout.harmonics) == (problem.nu, problem.H):
        return problem
    if layout.nu == problem.nu and layout.harmonics > problem.H:
        return problem.at_resolution_of(point)
    return problem.with_order(layout.nu, layout.harmonics)


def units_at(problem: ContinuationProblem, here: Mapping[str, float], names: Sequence[str]) -> _Units:
    """Units of a model and their derivatives (A,) in parameters; nothing if the model does not know them.

    "mesh Hz" and "pinion r/min" at Omega = 1, and "m", its unit of length; ``here`` are all parameters.
    """
    inner = _innermost(problem)
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
    """Hz and r/min at Omega = 1 and the unit of length in metres; nothing if the model does not know them."""
    known, own = scales(model, {}), model.scales
    return known | {LENGTH: own.length} if known and own else known


@dataclass(frozen=True)
class _At:
    """A point, its problem and all parameters, the one its curve was traced in, and those that are changed."""

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
        """Derivatives of the unknowns and of the parameter of the curve."""
        if not isinstance(self.point, SpecialPoint):
            return of_solution(self.problem, self.X, self.here, self.names)
        if self.point.kind == "BP":
            return of_branch_point(self.problem, self.X, self.here, self.parameter, self.names)
        if self.point.kind == "NS" and self.known_equations() is None:
            return of_crossing(self.problem, self.X, self.here, self.parameter, self.names, self._modulus())
        return of_special(*self.refined, self.here, self.names)

    @cached_property
    def refined(self) -> tuple[MinimallyAugmentedProblem, Array]:
        """The equations of a special point, based there, and (X, p) as near as rounding allows."""
        U = np.append(self.X, self.here[self.parameter])
        equations = self.equations().with_borders_at(U, self.here)
        with suppress(NoConvergence):  # else as near as it was located
            U = refine(equations, solve(equations, U, self.here), self.here).X
        return equations, U

    @property
    def place(self) -> float:
        """The parameter of the curve at the point, refined if it was."""
        return float(self.refined[1][-1]) if "refined" in vars(self) else self.here[self.parameter]

    def equations(self) -> MinimallyAugmentedProblem:
        """The equations of a special point.

        Raises
        ------
        ValueError
            If it has none.
        """
        known, point = self.known_equations(), self.point
        assert isinstance(point, SpecialPoint)
        if known is None:
            raise ValueError(
                f"{point.label} ({point.meaning.partition(':')[0]}) has no equations of its own to be differentiated; "
                "choose LP, PD, NS, BP, GR, CP, a peak, a jump, or a row of the curve"
            )
        return known

    def known_equations(self) -> MinimallyAugmentedProblem | None:
        """The equations of a special point, if it has some."""
        point = self.point
        assert isinstance(point, SpecialPoint)
        if point.kind == "PK":
            measure = point.note.removeprefix("peak of ")
            return peak_of(self.problem, self.parameter, measure, getattr(point.event, "element", 0))
        if point.kind == "CP":
            return FoldProblem(self.problem, self.parameter)
        event = event_at(self.problem, self.parameter, point)
        return event.equations(self.problem.original, self.parameter, point) if event else None

    @cached_property
    def own(self) -> dict[str, float]:
        """The parameters of the model."""
        model = getattr(_innermost(self.problem), "model", None)
        return model.parameters | model.entries if isinstance(model, Model) else {}

    def _modulus(self) -> Callable[[Array, dict[str, float]], float]:
        """Logarithm of the modulus of the multiplier that is on the unit circle at the point."""
        problem = self.problem
        assert isinstance(problem, HarmonicBalance)
        all_of_them = problem.multipliers(self.X, points=8, width=1.0, **self._balanced(self.here))
        paired = all_of_them[np.abs(all_of_them.imag) > 1e-8 * np.abs(all_of_them)]
        of = paired if paired.size else all_of_them
        mu = of[np.argmin(np.abs(np.abs(of) - 1.0))]
        return self._tracked(mu)

    def _tracked(self, mu: complex) -> Callable[[Array, dict[str, float]], float]:
        """Logarithm of the modulus of the multiplier nearest to one."""
        problem: Any = self.problem

        def value(X: Array, at: dict[str, float]) -> float:
            near = problem.multipliers(X, points=8, width=1.0, **self._balanced(at))
            return math.log(abs(near[np.argmin(np.abs(near - mu))]))

        return value

    def _balanced(self, here: Mapping[str, float]) -> dict[str, float]:
        """The parameters that are not those of the model."""
        own = self.own
        return {name: float(value) for name, value in here.items() if own.get(name) != value}

    def unknown(self, slopes: Slopes) -> list[tuple[str, Array]]:
        """Derivatives of parameters among the unknowns, as the frequency of a fold is on a curve of folds."""
        own = self.problem.unknown_parameters
        return [(name, slopes.X[:, -1 - i]) for i, name in enumerate(own)]

    def speeds(self, rows: Sequence[_Row], units: _Units) -> list[_Row]:
        """Mesh frequency and speed of models that know their units."""
        own, changes = units
        if "Omega" not in self.here:
            return []
        Omega, found = self.here["Omega"], {name: slopes for name, _, slopes in rows}
        moved = found.get("Omega", np.array([float(name == "Omega") for name in self.names]))
        return [(unit, Omega * own[unit], own[unit] * moved + Omega * changes[unit]) for unit in (MESH, PINION)
                if unit in own]  # fmt: skip

    def amplitudes(self, name: str, measure: str, element: int | str, X_a: Array, units: _Units) -> list[_Row]:
        """The amplitude, and that in metres of models that know their unit of length."""
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

    def landed(self, after: Point, p_a: Array) -> tuple[_At, Array]:
        """The motion on which a jump lands, which is held at the frequency of the jump, and its derivatives."""
        problem = _like(self.problem, after)
        here = {**self.here, self.parameter: self.place}
        at = _At(problem, after, here, self.parameter, self.names)
        t = tangent(problem, at.X, here, self.parameter)
        return at, of_solution(problem, at.X, here, self.names).X + p_a[:, None] * t

    def largest_multiplier(self, slopes: Slopes) -> _Row:
        """The largest modulus of the multipliers, the point moving as it does."""
        problem = self.problem
        if not isinstance(problem, HarmonicBalance):
            raise ValueError("multipliers are those of periodic motions: ask for a point of a HarmonicBalance")
        mu = problem.multipliers(self.X, points=8, width=1.0, **self._balanced(self.here))[0]
        value = self._tracked(mu)
        p = self.parameter

        def moved(name: str, dX: Array, dp: float) -> float:
            def following(X: Array, at: dict[str, float]) -> float:
                return value(X, {**at, p: self.here[p] + dp * (at[name] - self.here[name])})

            return along(problem, self.X, self.here, following, dX, name)

        each = zip(self.names, slopes.X, slopes.p, strict=True)
        return "|mu|", abs(mu), abs(mu) * np.array([moved(name, dX, dp) for name, dX, dp in each])


class Relocation:
    """A special point solved for again with other values of some parameters.

    Parameters
    ----------
    point : as for `sensitivity`, of a kind that has equations of its own.
    names : of the parameters that change.

    Raises
    ------
    ValueError
        If it has none, or does not know its problem.
    """

    def __init__(self, point: Point, names: Sequence[str]) -> None:
        problem, here, parameter = _asked(point)
        self._names = _names(problem, here, parameter, names)
        at = _At(_remembering(problem, point, 4), point, here, parameter, self._names)
        self._equations, self._here = at.equations(), here
        slopes = at.slopes()
        self._U = np.append(at.X, here[parameter])
        self._slopes = np.column_stack([slopes.X, slopes.p])

    def at(self, changes: Array) -> float:
        """The value of the curve's parameter at the point, for changes (A,) of the parameters; see `solved`."""
        return float(self.solved(changes)[0][-1])

    def slopes(self, U: Array, here: Mapping[str, float]) -> Slopes:
        """Derivatives of the unknowns and of the curve's parameter at a point that was `solved` for."""
        return of_special(self._equations, U, here, self._names)

    def solved(self, changes: Array) -> tuple[Array, dict[str, float]]:
        """The point (X, p) for changes (A,) of the parameters, and all parameters.

        Raises
        ------
        NoConvergence, ValueError, numpy.linalg.LinAlgError
            If there is no such point near where the first order puts it.
        """
        here = {**self._here, **{a: self._here[a] + float(x) for a, x in zip(self._names, changes, strict=True)}}
        U = self._U + changes @ self._slopes
        found = solve(self._equations.with_borders_at(U, here), U, here).X
        moved, expected = abs(found[-1] - self._U[-1]), abs(U[-1] - self._U[-1])
        if moved > _FAR * (expected + 1e-3 * abs(self._U[-1])):
            raise NoConvergence("Newton ended at another point", found, here, [])
        return found, here


_FAR = 5.0  # times the change to first order by which a point moves at most


def _innermost(problem: ContinuationProblem) -> ContinuationProblem:
    """The problem that curves of special points are of."""
    return _innermost(problem.problem) if isinstance(problem, MinimallyAugmentedProblem) else problem


def measured_along(layout: LayoutProtocol, measure: str, element: int | str, X: Array, along: Array) -> Array:
    """Derivatives (P, A) of an amplitude of motions X (P, n) along directions (P, A, n); nan of those not finite."""
    sizes = np.linalg.norm(along, axis=-1)
    known = np.isfinite(sizes)
    h = 1e-5 * np.maximum(np.linalg.norm(X, axis=-1), 1e-3)[:, None] / np.where(known & (sizes > 0), sizes, 1.0)
    moved = h[..., None] * np.where(known[..., None], along, 0.0)
    up, down = (layout.measure(measure, X[:, None] + side * moved, element) for side in (1, -1))
    rates: Array = np.where(known, up - down, math.nan) / (2 * h)
    return rates
