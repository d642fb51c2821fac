"""What continuation asks of a problem, and who answers.

    R(X, p) = 0        X (n,) unknowns, p named parameters, one of which is followed

A *problem* is anything with ``evaluate(X, **parameters) -> (R, dR_dX)``. That is enough. It may offer more: each
ability below is a protocol of its own, and `as_problem` asks once which of them a problem has. The rest of this room
speaks to `FullProblem` only, which answers for what is not offered.

| ability | offers | without it |
|---|---|---|
| `Problem` | ``evaluate`` | |
| `Linearised` | R, dR/dX, dR/dp in one go, the size of the terms of R | dR/dp by a difference, size 1 + norm(X) |
| `Pursued` | a loop of its own along the curve in some parameters | point after point |
| `Costly` | which parameters cost much to change, and are kept while a row is solved for | none |
| `Curved` | second derivatives, for special points | central differences |
| `Started` | a first solution | ``start=`` must be given |
| `Parametrised` | its parameters with their values | all must be given |
| `Checked` | checks of names and ranges of parameters | any name, any value |
| `Confined` | a smaller problem for a span of a parameter | the problem itself |
| `Sized` | the size of X that scales lengths along the curve | the norm of X |
| `Rough` | whether dR/dX is continuous | it is |
| `Readable` | how X is read: names, measures of amplitude | X as it is |
| `Observed` | what is stored beside X: stability, error, ... | nothing |
| `Eventful` | special points of its own | folds and branch points only |
| `Remeshed` | another number of unknowns where a point asks for it | the same everywhere |
| `Refinable` | the same with more unknowns, which tells how accurate special points are | nothing is said of that |
| `Deciding` | whether its verdicts on stability are sure, and better ones | they are sure |
| `Receding` | what its equations become far out | curves are followed however far they go |
| `Resolving` | equations as accurate as a first solution requires, in the same unknowns | they are accurate enough |
| `Undetermined` | equations that choose one of several solutions where something is arbitrary | nothing is |
| `Extended` | parameters among the unknowns; equations that refer to a point nearby | none |
| `Finished` | what it says of a whole curve | nothing |
| `Described` | model and settings, for files | nothing |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Protocol, Self, TypeAlias, runtime_checkable

import numpy as np

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import ANY, Range
from hbgear.continuation.algebra import Matrix, norm
from hbgear.continuation.branch import Branch, Point
from hbgear.continuation.differences import difference_along, in_parameter
from hbgear.continuation.reading import Reader
from hbgear.continuation.work import Work

if TYPE_CHECKING:
    from hbgear.continuation.events import Event


class Evaluation(NamedTuple):
    """R (n,), dR_dX (n, n), dense or sparse, dR_dp (n,) and the size of the terms of R, against which R is judged.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> class Circle:
    ...     def evaluate(self, X, p):
    ...         now = self.linearise(X, "p", p)
    ...         return now.R, now.dR_dX
    ...
    ...     def linearise(self, X, name, p):
    ...         return hb.Evaluation(np.array([X[0] ** 2 + p**2 - 1]), np.array([[2 * X[0]]]), np.array([2 * p]), 1.0)
    ...
    >>> hb.trace(Circle(), "p", (0.0, 2.0), np.array([1.0])).special[0].parameters["p"] == 1.0
    True
    """

    R: Array
    dR_dX: Matrix
    dR_dp: Array
    size: float


# ---- abilities


@runtime_checkable
class Problem(Protocol):
    """The least a problem can be."""

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Matrix]:
        """R (n,) and dR/dX (n, n), a dense array or a scipy.sparse matrix."""


AnyProblem = Annotated[Any, Problem]
"""A `Problem`, whose ``evaluate`` may name its parameters."""


@runtime_checkable
class Linearised(Protocol):
    """Offers the derivative in a parameter."""

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """R, dR/dX, dR/dname (zeros if name is empty) and the size of the terms of R."""


Pursuit: TypeAlias = Callable[
    [Array, Array, int, Array, float, Array, Array, Array, Array], tuple[int, float, int, float]
]
"""Follows a curve row after row by the rules of `hbgear.continuation.stepping`; arguments as of
`hbgear.harmonic.pursuit.pursue` without the first."""


Locating: TypeAlias = Callable[[Array, int, float, int, Array, Array], tuple[int, float]]
"""Finds a point of a curve; arguments as of `hbgear.harmonic.locating.located` without the first two."""

FOLD, HELD = -1, -2
"""What is located if it is no special point with a number: a fold, or the solution at the value that is given."""


@runtime_checkable
class Pursued(Protocol):
    """Follows stretches of its curves itself, by a compiled loop."""

    def pursuit(self, name: str, parameters: Mapping[str, float]) -> Pursuit | None:
        """The loop in a parameter, the others fixed; None where there is none."""


@runtime_checkable
class Costly(Protocol):
    """Says which parameters are better kept while other unknowns change."""

    def costly(self, name: str) -> bool:
        """Whether the equations at another value of this parameter cost much more than with other unknowns."""


@runtime_checkable
class Curved(Protocol):
    """Gives second derivatives, which special points need."""

    def curvature(self, X: Array, v: Array, name: str, **parameters: float) -> tuple[Matrix, Matrix]:
        """Derivatives (n, n) of dR/dX along v (n,) and in the parameter name."""


@runtime_checkable
class Started(Protocol):
    """Finds a first solution."""

    def start(self, **parameters: float) -> Array:
        """X (n,) that solves the equations, or comes near."""


@runtime_checkable
class Parametrised(Protocol):
    """Knows its parameters."""

    @property
    def parameters(self) -> dict[str, float]:
        """Values by name, of all that need not be given."""


@runtime_checkable
class Checked(Protocol):
    """Refuses what it cannot be asked."""

    def check_parameter(self, name: str) -> None:
        """Raise KeyError for a name that is no parameter."""

    def range_of(self, name: str) -> Range:
        """Values the parameter may have."""

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """Warn of a curve over that span, the other parameters fixed, that can be traced and is hardly meant."""

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Parameters that must be given and are not among the known ones."""


@runtime_checkable
class Confined(Protocol):
    """Is simpler where only a part of its solutions is asked for."""

    def within(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> FullProblem:
        """What a curve over that span, the other parameters fixed, is traced with; itself if nothing is simpler."""


@runtime_checkable
class Sized(Protocol):
    """Measures its unknowns."""

    def motion_size(self, X: Array) -> float:
        """Size of X, which scales lengths along the curve."""


@runtime_checkable
class Rough(Protocol):
    """Says whether its equations have corners."""

    @property
    def smooth(self) -> bool:
        """Whether dR/dX is continuous, so that special points can be found by Newton."""


@runtime_checkable
class Readable(Protocol):
    """Knows how its unknowns are read."""

    @property
    def layout(self) -> Reader | None:
        """Names and measures of the unknowns."""


@runtime_checkable
class Observed(Protocol):
    """Says more of a solution than its unknowns."""

    def observe(self, X: Array, stability: bool, **parameters: float) -> dict[str, Any]:
        """What is stored beside X.

        ``"multipliers"`` (r,) complex, stable within the unit circle, if asked for; ``"regime"`` (m,) small integers;
        ``"error"``, an estimate; and whatever the events of the problem look at.
        """


@runtime_checkable
class Eventful(Protocol):
    """Has special points of its own."""

    def events(self, parameter: str) -> tuple[Event, ...]:
        """What is looked for along a curve in that parameter besides folds and branch points."""


@runtime_checkable
class Remeshed(Protocol):
    """Can change its number of unknowns."""

    size: int
    """Number of unknowns n."""

    def remeshed(self, observed: Mapping[str, Any]) -> Any:
        """The problem with the unknowns that a point with these observations asks for; None to stay."""

    def fitted(self, X: Array) -> Array:
        """Unknowns of any number, cut or padded to this problem's."""

    def converted(self, point: Point) -> Array:
        """Unknowns of a point of another problem of the kind in this one's."""


@runtime_checkable
class Refinable(Protocol):
    """Approximates an equation the better, the more unknowns it has."""

    @property
    def finer(self) -> Any:
        """The problem with about twice the unknowns; None if there are no more."""

    def fitted(self, X: Array) -> Array:
        """Unknowns of any number, cut or padded to this problem's."""

    def fitting(self, point: Point) -> Any:
        """The problem with the unknowns of a point, or one of more."""


@runtime_checkable
class Deciding(Protocol):
    """Knows how sure it is of the stability of its solutions."""

    def decided(
        self, X: Array, name: str, values: Array, seen: Sequence[dict[str, Any]], parameters: Mapping[str, float],
        work: Work | None = None,
    ) -> None:  # fmt: skip
        """Make sure of the stability of solutions X (k, n) at values (k,) of the parameter name.

        ``seen`` is what `Observed.observe` said of them, with two entries more: ``"determinant"`` is the sign of
        det(dR/dX), 0 if it is not known, and ``"contradicts"`` says whether a special point next to the solution
        contradicts its verdict. ``"multipliers"`` that are in doubt are replaced by better ones, and the error of the
        largest modulus goes into ``"modulus_error"``. Solutions that ``work`` leaves unrefined keep their error.
        """


@runtime_checkable
class Receding(Protocol):
    """Knows what becomes of its equations for unknowns without bound."""

    def recession(self, X: Array, parameters: Mapping[str, float]) -> Any:
        """The problem lim R(r X, p) / r, r -> inf, if X is far out; None if it is not, or there is no such limit."""


@runtime_checkable
class Resolving(Protocol):
    """Approximates its equations in ways that do not change the unknowns, such as by samples."""

    def resolved(self, X: Array, parameters: Mapping[str, float]) -> Any:
        """The problem as accurate as a first solution X asks for; itself if it is."""


@runtime_checkable
class Undetermined(Protocol):
    """Knows solutions of which something is arbitrary."""

    def arbitrary(self, X: Array, parameters: Mapping[str, float]) -> tuple[Any, str] | None:
        """Equations that choose one of the solutions around X, and what to say of them; None if X is the only one."""


@runtime_checkable
class Extended(Protocol):
    """Has parameters among its unknowns, and equations that are stated relative to a point nearby."""

    @property
    def unknown_parameters(self) -> Sequence[str]:
        """Parameters that are unknowns here, the last entries of X in reverse order."""

    def split(self, X: Array) -> tuple[Array, dict[str, float]]:
        """The unknowns without these parameters, and the parameters."""

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """The inverse."""

    def based(self, X: Array, parameters: Mapping[str, float], renew: bool = False) -> Self:
        """The same problem, its equations stated relative to a point close to those to come.

        As it is if they are already stated so, unless that is to be renewed.
        """


@runtime_checkable
class Finished(Protocol):
    """Adds to a finished curve."""

    def finished(self, branch: Branch, observed: Sequence[Mapping[str, Any]]) -> Branch:
        """The branch with what the problem has to say of the whole of it.

        ``observed`` is what it said on the way; empty of a curve that goes on from a point of another one.
        """


@runtime_checkable
class Described(Protocol):
    """Tells what it is."""

    def describe(self) -> dict[str, Any]:
        """Plain data for the header of a file."""


ABILITIES = (
    Problem, Linearised, Pursued, Costly, Curved, Started, Parametrised, Checked, Confined, Sized, Rough, Readable,
    Observed, Eventful, Remeshed, Refinable, Deciding, Receding, Resolving, Undetermined,
    Extended, Finished, Described,
)  # fmt: skip


# ---- the problem this room speaks to


class FullProblem:
    """A problem with an answer to everything; derive from it, or let `as_problem` fill in what is missing."""

    unknown_parameters: Sequence[str] = ()
    smooth: bool = True
    changes: bool = False
    """Whether `Remeshed.remeshed` may give another problem."""
    size: int | None = None
    turning_kind: str = "LP"
    """Label of a turning point of a curve: a fold, or on a curve of folds a cusp."""
    usual_parameter: str = ""
    """What curves are traced in if nothing else is said."""
    undetermined: str = "an unknown that no equation holds"
    """What it may mean that the Jacobian is singular at a start, for the error that says so."""
    at_once: int = 128
    """Solutions that `observe_many` is asked for in one call, which Ctrl-C waits for."""

    @property
    def original(self) -> Any:
        """The problem as its author wrote it."""
        return self

    @property
    def cornered(self) -> bool:
        """Whether its curves have corners; of equations with parameters among the unknowns that is not said."""
        return not self.smooth and not self.unknown_parameters

    @property
    def fineness(self) -> str:
        """How many unknowns it has, in words."""
        return f"n = {self.size}"

    @property
    def parameters(self) -> dict[str, float]:
        """`Parametrised.parameters`: none."""
        return {}

    @property
    def layout(self) -> Reader | None:
        """`Readable.layout`: X is read as it is."""
        return None

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Matrix]:
        """`Problem.evaluate`, from `linearise`."""
        now = self.linearise(X, "", **parameters)
        return now.R, now.dR_dX

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """`Linearised.linearise`, with dR/dp by a central difference."""
        R, J = self.evaluate(X, **parameters)
        dR = np.zeros(len(X))
        if name:
            (dR,) = in_parameter(self, name, parameters, lambda at: (np.asarray(self.evaluate(X, **at)[0]),))
        return Evaluation(np.asarray(R), J, dR, 1.0 + float(np.linalg.norm(X)))

    def moved(self, X: Array, name: str, parameters: Mapping[str, float]) -> Array:
        """dR/dname alone (n,), where that costs less than all of `linearise`."""
        return self.linearise(X, name, **parameters).dR_dp

    def pursuit(self, name: str, parameters: Mapping[str, float]) -> Pursuit | None:
        """`Pursued.pursuit`: none."""
        return None

    def costly(self, name: str) -> bool:
        """`Costly.costly`: no parameter is."""
        return False

    def beside(self, parameters: Mapping[str, float], sets: int) -> FullProblem:
        """The same for so many sets of values next to these, for derivatives: itself."""
        return self

    def locating(self, name: str, parameters: Mapping[str, float], which: int) -> Locating | None:
        """Compiled Newton on points of its curves in a parameter, by their number, or `FOLD`, `HELD`: none."""
        return None

    def curvature(self, X: Array, v: Array, name: str, **parameters: float) -> tuple[Matrix, Matrix]:
        """`Curved.curvature`, by central differences."""
        h = difference_along(X, v)
        plus, minus = (self.evaluate(X + s * h * v, **parameters)[1] for s in (1, -1))
        (across,) = in_parameter(self, name, parameters, lambda at: (self.evaluate(X, **at)[1],))
        return (plus - minus) / (2 * h), across

    def start(self, **parameters: float) -> Array:
        """`Started.start`: none, ValueError."""
        raise ValueError("this problem finds no start of its own; give start=")

    def check_parameter(self, name: str) -> None:
        """`Checked.check_parameter`: any name."""
        pass

    def range_of(self, name: str) -> Range:
        """`Checked.range_of`: any value."""
        return ANY

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """`Checked.check_trace`: no warning."""
        pass

    def within(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> FullProblem:
        """`Confined.within`: itself."""
        return self

    def unit_of(self, name: str, value: float) -> float:
        """Size against which a change of a parameter is small.

        Its value; near zero a thousandth of the usual one, or a hundredth where that is zero or not known.
        """
        usual = abs(self.parameters.get(name, 0.0))
        return max(abs(value), 1e-3 * usual if usual else 1e-2)

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """`Checked.missing`: nothing."""
        return ()

    def motion_size(self, X: Array) -> float:
        """`Sized.motion_size`: the norm of X."""
        return norm(X)

    def motion_sizes(self, X: Array) -> Array:
        """`motion_size` (P,) of solutions X (P, n)."""
        return np.array([self.motion_size(x) for x in X])

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """`Observed.observe`: nothing."""
        return {}

    def observe_many(
        self, X: Array, name: str, values: Array, stability: bool, **parameters: float
    ) -> list[dict[str, Any]]:
        """`Observed.observe` of solutions X (k, n) at values (k,) of the parameter name."""
        return [
            self.observe(x, stability, **{**parameters, name: float(value)}) for x, value in zip(X, values, strict=True)
        ]

    def events(self, parameter: str) -> tuple[Event, ...]:
        """`Eventful.events`: folds and branch points."""
        return ()

    def remeshed(self, observed: Mapping[str, Any]) -> Any:
        """`Remeshed.remeshed`: never."""
        return None

    def fitted(self, X: Array) -> Array:
        """`Remeshed.fitted`: X as it is."""
        return X

    def converted(self, point: Point) -> Array:
        """`Remeshed.converted`: X as it is."""
        return point.X

    @property
    def finer(self) -> FullProblem | None:
        """`Refinable.finer`: there are no more unknowns."""
        return None

    @property
    def comparisons(self) -> Sequence[tuple[FullProblem, float]]:
        """Problems with other numbers of unknowns, each with its weight w.

        w times the change of a result from this problem to that one estimates the error of the result; the largest of
        these is the estimate. By default what the finer problem changes.
        """
        return () if self.finer is None else ((as_problem(self.finer), 1.0),)

    def fitting(self, point: Point) -> FullProblem:
        """`Refinable.fitting`: the problem as it is."""
        return self

    def decided(
        self, X: Array, name: str, values: Array, seen: Sequence[dict[str, Any]], parameters: Mapping[str, float],
        work: Work | None = None,
    ) -> None:  # fmt: skip
        """`Deciding.decided`: as sure as they are."""

    def recession(self, X: Array, parameters: Mapping[str, float]) -> FullProblem | None:
        """`Receding.recession`: not known."""
        return None

    def resolved(self, X: Array, parameters: Mapping[str, float]) -> Any:
        """`Resolving.resolved`: itself."""
        return self

    def arbitrary(self, X: Array, parameters: Mapping[str, float]) -> tuple[Any, str] | None:
        """`Undetermined.arbitrary`: nothing is."""
        return None

    def split(self, X: Array) -> tuple[Array, dict[str, float]]:
        """`Extended.split`: no parameter is among the unknowns."""
        return self.fitted(X), {}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """`Extended.join`: X as it is."""
        return X

    def based(self, X: Array, parameters: Mapping[str, float], renew: bool = False) -> Self:
        """`Extended.based`: the equations refer to no point."""
        return self

    def finished(self, branch: Branch, observed: Sequence[Mapping[str, Any]]) -> Branch:
        """`Finished.finished`: its jumps are sought."""
        return branch

    def describe(self) -> dict[str, Any]:
        """`Described.describe`: nothing."""
        return {}


class _Asked(FullProblem):
    """A problem of a user, asked once which abilities it has; the rest is answered by `FullProblem`."""

    parameters: dict[str, float] = {}  # noqa: RUF012  not properties here, so that those of the user take their place
    layout: Reader | None = None
    finer: FullProblem | None = None

    def __init__(self, problem: Problem) -> None:
        self._original = problem
        for ability in ABILITIES:
            if isinstance(problem, ability):
                for name in _members(ability):
                    object.__setattr__(self, name, getattr(problem, name))

    @property
    def original(self) -> Any:
        return self._original


def _members(ability: type) -> list[str]:
    return [name for name in {**vars(ability), **ability.__annotations__} if not name.startswith("_")]


def as_problem(problem: AnyProblem) -> FullProblem:
    """The problem with an answer to everything.

    Raises
    ------
    TypeError
        If it has no ``evaluate``.
    """
    return problem if isinstance(problem, FullProblem) else _asked(problem)


@checked_arguments()
def _asked(problem: AnyProblem) -> FullProblem:
    return _Asked(problem)


# ---- short ways to ask


def linearise(problem: FullProblem, X: Array, name: str, parameters: Mapping[str, float]) -> Evaluation:
    """R, dR/dX, dR/dname (zeros without a name) and the size of the terms of R."""
    return problem.linearise(X, name, **parameters)


def observe_all(
    problem: FullProblem, U: Array, name: str, parameters: Mapping[str, float], stability: bool
) -> list[dict[str, Any]]:
    """What a problem says of its solutions U (k, n + 1)."""
    rest = {key: value for key, value in parameters.items() if key != name}
    return problem.observe_many(U[:, :-1], name, U[:, -1], stability, **rest)
