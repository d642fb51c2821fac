"""Problems whose solutions are the special points of another problem: unknowns (X, p), a second parameter varies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import Range
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.results.layout import LayoutProtocol
from hbgear.continuation.results.point import Point


class SpecialPointProblem(ContinuationProblem):
    """Base class of problems for the special points of curves of another problem. Instances are immutable.

    Parameters
    ----------
    problem : ContinuationProblem or object with ``evaluate``
        Problem that has the special points.
    parameter : str, optional
        Parameter of the curve, which becomes the last unknown. The default is `ContinuationProblem.usual_parameter`.

    Raises
    ------
    ValueError
        If the parameter is not given and the problem has no usual one.
    """

    smooth = False
    batch_size = 1  # special points on curves of special points are expensive: Ctrl-C waits for one point at most
    are_solutions = False
    """Whether all points of a curve count as solutions, whose special points are followed, such as limit cycles."""
    problem: ContinuationProblem
    parameter: str

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "") -> None:
        problem = as_problem(problem)
        parameter = parameter or problem.usual_parameter
        if not parameter:
            raise ValueError(
                f"{type(self).__name__} needs the parameter of the curve that has the special points, such as 'p'"
            )
        problem.check_parameter(parameter)
        self._fixed(problem=problem, parameter=parameter)

    def _fixed(self, **values: Any) -> None:
        """Set attributes. This is used in constructors and for copies only."""
        vars(self).update(values)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__} cannot be changed; create another one with the new {name}")

    def resized(self, X: Array) -> Array:
        """Return unknowns (X, p) with the number of unknowns of this problem."""
        return np.append(self.problem.resized(X[:-1]), X[-1])

    @property
    def unknown_parameters(self) -> tuple[str, ...]:  # type: ignore[override]
        """The parameter of the curve, and the parameters among the unknowns of the problem; the last unknown first."""
        return self.parameter, *self.problem.unknown_parameters

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the problem."""
        return dict(self.problem.parameters)

    @property
    def size(self) -> int | None:  # type: ignore[override]
        """Number of unknowns; None if the problem does not state it."""
        return None if self.problem.size is None else self.problem.size + 1

    @property
    def layout(self) -> LayoutProtocol | None:
        """Layout of X, the unknowns of the solution."""
        return self.problem.layout

    @property
    def singular_hint(self) -> str:  # type: ignore[override]
        return self.problem.singular_hint

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file."""
        inner = self.problem.describe()
        on = {"on": inner["curve"]} if "curve" in inner else {}
        return {**inner, "curve": {"of": type(self).__name__, "in": self.parameter, **on}}

    def check_parameter(self, name: str) -> None:
        """Raise an error if the parameter is unknown to the problem or is an unknown already."""
        if name == self.parameter:
            raise ValueError(
                f"a {type(self).__name__} in {name} cannot be followed in {name} again; choose a second parameter"
            )
        self.problem.check_parameter(name)

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """Do nothing: there are no warnings for curves of special points."""

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Return the required parameters of the problem that are not known."""
        return self.problem.missing([*known, self.parameter])

    def range_of(self, name: str) -> Range:
        """Return the admissible values of a parameter."""
        return self.problem.range_of(name)

    def is_expensive(self, name: str) -> bool:
        """Return whether a new value of the parameter is expensive for the problem."""
        return self.problem.is_expensive(name)

    def smallest_scale(self, name: str) -> float:
        """Return the smallest scale of a parameter among the unknowns."""
        return self.problem.smallest_scale(name)

    def split(self, U: Array) -> tuple[Array, dict[str, float]]:
        """Return the coefficients of the solution, and the parameters among the unknowns by name."""
        X, unknown = self.problem.split(U[:-1])
        return X, {**unknown, self.parameter: float(U[-1])}

    def solution_of(self, U: Array) -> tuple[Array, dict[str, float]]:
        """Return X (n,), all unknowns of the problem, and the parameter of the curve by name."""
        return U[:-1], {self.parameter: float(U[-1])}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Return the unknowns (X, p) of this problem, from the coefficients of a solution and all parameters.

        ValueError is raised if the solution has another number of unknowns than the problem.
        """
        size, X = self.problem.size, self.problem.join(X, parameters)
        if size is not None and len(X) != size:
            raise ValueError(
                f"the start has {len(X)} coefficients, this problem {size}: use the problem of the curve that has "
                "the special points, such as FoldProblem(curve.problem, 'Omega')"
            )
        return np.append(X, parameters[self.parameter])

    def in_phase(self, X: Array, tangent: Array, reference: Array) -> tuple[Array, Array]:
        """Return unknowns (X, p) and their tangent in phase with a reference, see `ContinuationProblem.in_phase`."""
        inner, along = self.problem.in_phase(X[:-1], tangent[:-1], reference[:-1])
        return np.append(inner, X[-1]), np.append(along, tangent[-1])

    def from_point(self, point: Point) -> Array:
        """Return X of a point of a related problem."""
        return self.problem.from_point(point)

    def solution_norm(self, U: Array) -> float:
        """Return the norm of the solution, which scales the arclength."""
        return self.problem.solution_norm(U[:-1])

    def observe(self, X: Array, stability: bool = False, **parameters: float) -> dict[str, Any]:
        """Return regime and error of the solution; the argument X holds the unknowns (X, p)."""
        X, unknown = self.solution_of(X)
        values = {**parameters, **unknown}
        observed = self.problem.observe_many(
            X[None],
            self.parameter,
            np.array([values[self.parameter]]),
            False,
            **{k: v for k, v in values.items() if k != self.parameter},
        )[0]
        return {k: observed[k] for k in ("regime", "error") if k in observed}
