"""Base class of continuation problems: every ability with its default.

    R(X, p) = 0        X (n,) unknowns, p named parameters, one of which is the continuation parameter

A *minimal problem* is any object with ``evaluate(X, **parameters) -> (R, dR_dX)``. `trace`, `follow` and `switch`
accept it directly: `as_problem` supplies the defaults of this class for everything that the object does not define.
Each further method or attribute that a problem defines adds an ability:

| method or attribute | gives | default |
|---|---|---|
| ``linearise`` | R, dR/dX, dR/dp, size of the terms of R | dR/dp by a central difference, 1 + norm(X) |
| ``curvature`` | second derivatives, for special points | central differences |
| ``start`` | an initial guess | ``start=`` must be given |
| ``parameters`` | parameters with their values | all values must be given |
| ``check_parameter``, ``range_of``, ``missing``, ``check_trace`` | checks of names, values, spans | all are valid |
| ``check_stability`` | whether stability can be computed | it can |
| ``solution_norm`` | the size of X, which scales arclength | the norm of X |
| ``smooth`` | whether dR/dX is continuous | True |
| ``difference_step`` | relative step of differences of dR/dX at X | 1e-5 |
| ``least_size`` | size of X below which this step does not become smaller | 1e-3 |
| ``layout`` | names and amplitude measures of X | X is an array of numbers |
| ``observe``, ``observe_many`` | multipliers, error estimate, monitored quantities | none |
| ``events`` | further special points | folds and branch points only |
| ``adapted``, ``resized``, ``from_point``, ``size`` | adaptation of the number of unknowns | constant number |
| ``refined_problem``, ``comparisons``, ``at_resolution_of`` | higher resolutions, for error estimates | none |
| ``check_errors`` | error estimates that are larger than the observed ones | errors as observed |
| ``verify_stability`` | verified stability of solutions | stability as observed |
| ``recession`` | the limit equations far from the origin | curves end by the number of points |
| ``residual_form`` | a problem with the same solutions and a residual that can be extended | the problem itself |
| ``resolved`` | the problem with a sufficient number of samples for a first solution | the problem itself |
| ``arbitrary`` | equations that choose one of a family of solutions | solutions are isolated |
| ``restricted_to`` | a cheaper problem for a span of the parameter | the problem itself |
| ``special_point_equations`` | a problem for curves of a special point | equations of the event |
| ``own_trace`` | a continuation of its own, where the equations change along a curve | the continuation of `trace` |
| ``compiled_continuation``, ``compiled_locator``, ``is_expensive`` | compiled loops, costs | one point at a time |
| ``unknown_parameters``, ``split``, ``join``, ``with_borders_at`` | parameters among the unknowns | none |
| ``postprocess``, ``remarks`` | additions to a finished branch, and to its message | none |
| ``describe`` | plain data for the header of a file | none |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import ANY, Range
from hbgear.continuation.numerics.linear import Matrix, norm
from hbgear.continuation.problem.curve_equations import CurveEquations, CurveSolutions
from hbgear.continuation.problem.evaluation import Evaluation, Locating, Pursuit
from hbgear.continuation.problem.finite_differences import LEAST_SIZE, STEP, directional_step, parameter_derivatives
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.layout import LayoutProtocol
from hbgear.continuation.results.point import Point

Parameters = Mapping[str, float]
Observed = Sequence[dict[str, Any]]


class ContinuationProblem:
    """Base class of problems R(X, p) = 0; `as_problem` adds its defaults to an object with ``evaluate``.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> class Circle(hb.continuation.ContinuationProblem):
    ...     def evaluate(self, X, p):
    ...         return X**2 + p**2 - 1, np.diag(2 * X)
    ...
    >>> curve = hb.trace(Circle(), "p", (0.0, 1.5), np.array([1.0]))
    >>> curve.special[0].label, bool(abs(curve["LP1"].parameters["p"] - 1.0) < 1e-9)
    ('LP1', True)
    """

    unknown_parameters: Sequence[str] = ()
    """Parameters that are unknowns: the last entries of X in reverse order."""
    smooth: bool = True
    """True if dR/dX is continuous, so that Newton's method locates special points."""
    changes: bool = False
    """True if `adapted` may return another problem."""
    size: int | None = None
    """Number of unknowns n."""
    turning_kind: str = "LP"
    """Label of a turning point of a curve: a fold, or a cusp on a curve of folds."""
    usual_parameter: str = ""
    """Default continuation parameter."""
    singular_hint: str = "an unknown that no equation holds"
    """Possible cause of a singular Jacobian at a start, for the error message."""
    restarts: bool = True
    """True if a trace whose solutions are under-resolved starts again with `refined_problem`."""
    least_size: float = LEAST_SIZE
    """Size of the unknowns below which differences of dR/dX do not become smaller."""
    batch_size: int = 128
    """Number of solutions per call of `observe_many`. Ctrl-C waits for one call."""

    @property
    def original(self) -> Any:
        """The problem as its author wrote it."""
        return self

    @property
    def is_nonsmooth(self) -> bool:
        """True if the tangent of curves may be discontinuous. False with parameters among the unknowns."""
        return not self.smooth and not self.unknown_parameters

    @property
    def equivalent_size(self) -> int:
        """Number of unknowns of a dense problem whose solution takes as long; it counts for the limit of the work."""
        return self.size or 0

    @property
    def resolution(self) -> str:
        """The resolution as text, such as ``"n = 21"``; different for each of the `comparisons`."""
        return f"n = {self.size}"

    @property
    def parameters(self) -> dict[str, float]:
        """Values by name of all parameters that have a default."""
        return {}

    @property
    def layout(self) -> LayoutProtocol | None:
        """Names and measures of the unknowns. None if X is an array of numbers."""
        return None

    # ---- equations

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Matrix]:
        """Return R (n,) and dR/dX (n, n). By default they are taken from `linearise`."""
        evaluation = self.linearise(X, "", **parameters)
        return evaluation.R, evaluation.dR_dX

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return R, dR/dX, dR/dname (zeros without a name) and the size of the terms of R, by default 1 + norm(X)."""
        R, J = self.evaluate(X, **parameters)
        dR = np.zeros(len(X))
        if name:
            (dR,) = parameter_derivatives(self, name, parameters, lambda p: (np.asarray(self.evaluate(X, **p)[0]),))
        return Evaluation(np.asarray(R), J, dR, 1.0 + float(np.linalg.norm(X)))

    def parameter_derivative(self, X: Array, name: str, parameters: Mapping[str, float]) -> Array:
        """Return dR/dname of shape (n,) alone, which may cost less than `linearise`."""
        return self.linearise(X, name, **parameters).dR_dp

    def curvature(self, X: Array, v: Array, name: str, **parameters: float) -> tuple[Matrix, Matrix]:
        """Return the derivatives (n, n) of dR/dX along v (n,) and in the parameter; by default central differences."""
        step, f = self.difference_step(X, parameters), self.evaluate
        h = directional_step(X, v, step, self.least_size)
        (dJ_dp,) = parameter_derivatives(self, name, parameters, lambda values: (f(X, **values)[1],), step)
        plus, minus = (f(X + s * h * v, **parameters)[1] for s in (1, -1))
        return (plus - minus) / (2 * h), dJ_dp

    def difference_step(self, X: Array, parameters: Mapping[str, float]) -> float:
        """Return the step of differences of dR/dX at X, relative to the unknowns and to the parameter."""
        return STEP

    def compiled_continuation(self, name: str, parameters: Mapping[str, float]) -> Pursuit | None:
        """Return a compiled continuation loop in a parameter, the others fixed; by default None."""
        return None

    def compiled_locator(self, name: str, parameters: Mapping[str, float], target: int) -> Locating | None:
        """Return a compiled Newton iteration for points of a curve (a number, `FOLD` or `HELD`); by default None."""
        return None

    def is_expensive(self, name: str) -> bool:
        """Return whether a new value of a parameter is more expensive than new unknowns; by default False."""
        return False

    def perturbed(self, parameters: Mapping[str, float], sets: int) -> ContinuationProblem:
        """Return the problem prepared for ``sets`` nearby parameter sets; by default the problem itself."""
        return self

    def recession(self, X: Array, parameters: Mapping[str, float]) -> ContinuationProblem | None:
        """Return the problem lim R(r X, p) / r for r -> inf if X is far from the origin, else None. By default None."""
        return None

    # ---- initial guess, checks and sizes

    def start(self, **parameters: float) -> Array:
        """Return X of shape (n,) that approximates a solution. By default ValueError is raised."""
        raise ValueError("this problem has no initial guess; give start=")

    def check_parameter(self, name: str) -> None:
        """Raise KeyError for a name that is not a parameter. By default any name is accepted."""

    def range_of(self, name: str) -> Range:
        """Return the admissible values of a parameter; by default any value."""
        return ANY

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """Warn about a span that is valid but implausible, the other parameters fixed. By default no warning."""

    def check_stability(self) -> None:
        """Raise ValueError if the stability of no solution can be computed, before a curve is traced."""

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Return the required parameters that are not among the known ones; by default none."""
        return ()

    def restricted_to(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> ContinuationProblem:
        """Return the problem with which a curve over a span is traced, itself if none is cheaper (default)."""
        return self

    def unit_of(self, name: str, value: float) -> float:
        """Return the size of a parameter: its value; near zero 1e-3 of its default, or 1e-2 if that is 0 or unknown."""
        return max(abs(value), 1e-3 * abs(self.parameters.get(name, 0.0)) or 1e-2)

    def smallest_scale(self, name: str) -> float:
        """Return the smallest scale of a parameter among the unknowns that may be zero along a curve; by default 0."""
        return 0.0

    def solution_norm(self, X: Array) -> float:
        """Return the size of X, which scales arclength; by default its norm."""
        return norm(X)

    def solution_norms(self, X: Array) -> Array:
        """Return `solution_norm` of each of the solutions X of shape (P, n)."""
        return np.array([self.solution_norm(x) for x in X])

    # ---- monitored quantities

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return the quantities stored with X; by default none.

        ``"multipliers"`` (r,) complex, stable within the unit circle, if requested; ``"regime"`` (m,) small integers;
        ``"error"``, an estimate; and the quantities that events of the problem use.
        """
        return {}

    def observe_many(
        self, X: Array, name: str, values: Array, stability: bool, **parameters: float
    ) -> list[dict[str, Any]]:
        """Return `observe` of solutions X (k, n) at values (k,) of the parameter."""
        sets = ({**parameters, name: value} for value in values.tolist())
        return [self.observe(x, stability, **p) for x, p in zip(X, sets, strict=True)]

    def check_errors(self, solutions: CurveSolutions, observed: Observed) -> None:
        """Replace ``"error"`` in the ``observed`` quantities by the larger result of a check; by default nothing."""

    def verify_stability(self, solutions: CurveSolutions, observed: Observed, work: Work | None = None) -> None:
        """Verify the stability of solutions.

        ``observed`` holds the results of `observe` with two more entries: ``"determinant"``, the sign of det(dR/dX), 0
        if it is unknown, and ``"contradicts"``, True if an adjacent special point contradicts the stability. More
        accurate ``"multipliers"`` replace uncertain ones, ``"modulus_error"`` is the error of the largest modulus.
        Solutions that ``work`` leaves unrefined keep their error. By default multipliers stay as observed.
        """

    def events(self, parameter: str) -> tuple[Any, ...]:
        """Return the `Event` objects detected along a curve in addition to folds and branch points; by default none."""
        return ()

    def codimension_two_events(self, curve: Any) -> tuple[Any, ...]:
        """Return the events along a curve of special points with `MinimallyAugmentedProblem` equations; none."""
        return ()

    def own_trace(
        self, span: tuple[float, float], start: Any, settings: Any, cover: bool, unresolved: bool = False
    ) -> Branch | str | None:
        """Return the curve over a span, for problems whose equations change along a curve; by default None.

        ``settings`` are the `TraceSettings`, ``cover`` is the argument of `trace`, ``unresolved`` states that the
        number of unknowns did not suffice. `Tracer` follows after None, or a text why the curve was not completed.
        """
        return None

    def special_point_equations(self, parameter: str, point: Any, branch: Any = None) -> ContinuationProblem | None:
        """Return a problem for a special point with `own_trace` in a second parameter; None for `Event.equations`."""
        return None

    # ---- resolution

    def adapted(self, observed: Mapping[str, Any]) -> Any:
        """Return the problem with the number of unknowns that a point requires; None to keep it (default)."""
        return None

    def resized(self, X: Array) -> Array:
        """Return unknowns of any number, cut or padded to this problem's number; by default X itself."""
        return X

    def from_point(self, point: Point) -> Array:
        """Return the unknowns of a point of a related problem in this problem's form; by default ``point.X``."""
        return point.X

    @property
    def refined_problem(self) -> ContinuationProblem | None:
        """The problem with about twice the unknowns; None (default) if it does not exist."""
        return None

    @property
    def comparisons(self) -> Sequence[tuple[ContinuationProblem, float]]:
        """Problems of other resolutions, each with the weight of a change of a result in the estimate of its error."""
        return () if self.refined_problem is None else ((self.refined_problem, 1.0),)

    def at_resolution_of(self, point: Point) -> ContinuationProblem:
        """Return the problem at the resolution of a point, or at a higher one; by default itself."""
        return self

    @property
    def residual_form(self) -> ContinuationProblem:
        """The problem whose residual is extended by the equations of special points; by default itself."""
        return self

    def in_residual_form(self, point: Point, form: Any) -> Array:
        """Return the unknowns of a point in a residual form of the problem."""
        return np.asarray(form.from_point(point))

    def resolved(self, X: Array, parameters: Mapping[str, float]) -> Any:
        """Return the problem with the number of samples that a first solution X requires; by default itself."""
        return self

    def arbitrary(self, X: Array, parameters: Mapping[str, float]) -> tuple[Any, str] | None:
        """Return equations that choose one of a family of solutions, and a message; by default None: X is isolated."""
        return None

    # ---- parameters among the unknowns

    def split(self, X: Array) -> tuple[Array, dict[str, float]]:
        """Separate the unknowns from the parameters among them; by default there are none."""
        return self.resized(X), {}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Append the parameters that are unknowns: the inverse of `split`."""
        return X

    def with_borders_at(self, X: Array, parameters: Mapping[str, float], renew: bool = False) -> Self:
        """Return the problem relative to a point, with ``renew`` again if it is to one already; by default itself."""
        return self

    def corners_met(self, X: Array, parameters: Mapping[str, float]) -> tuple[str, ...]:
        """Return the corners of the equations at which a solution lies, such as a first slip; by default none."""
        return ()

    def stall(self, X: Array, name: str, parameters: Mapping[str, float]) -> tuple[str, str]:
        """Return why a curve in the parameter ``name`` cannot go on from a solution, and advice; by default "", ""."""
        return "", ""

    def in_phase(self, X: Array, tangent: Array, reference: Array) -> tuple[Array, Array]:
        """Return X and its tangent, shifted in time to be nearest to a reference if the phase is arbitrary."""
        return X, tangent

    # ---- finished branches

    def postprocess(self, branch: Branch, observed: Sequence[Mapping[str, Any]]) -> Branch:
        """Return the branch with additions to the whole of it; ``observed`` is empty where it continues another one."""
        return branch

    def remarks(self, branch: Branch) -> Sequence[str]:
        """Return sentences about a finished branch for its message, of which some may be empty; by default none."""
        return ()

    def describe(self) -> dict[str, Any]:
        """Return plain data for the header of a file; by default none."""
        return {}


def observe_all(equations: CurveEquations, U: Array, stability: bool, errors: bool = True) -> list[dict[str, Any]]:
    """Return the monitored quantities of solutions U (k, n + 1), with checked error estimates unless ``errors=False``.

    Searches, whose intermediate solutions are not stored, omit the check.
    """
    problem, name, parameters = equations
    fixed = {key: value for key, value in parameters.items() if key != name}
    solutions = CurveSolutions(U[:, :-1], name, U[:, -1], fixed)
    observed = problem.observe_many(solutions.X, name, solutions.values, stability, **fixed)
    if errors:
        problem.check_errors(solutions, observed)
    return observed
