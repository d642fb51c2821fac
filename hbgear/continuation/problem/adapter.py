"""Adapter: any object with ``evaluate`` as a `ContinuationProblem`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import AnyProblem, Problem
from hbgear.continuation.results.layout import LayoutProtocol

_ABILITIES = tuple(
    name for name in vars(ContinuationProblem) if not name.startswith("_") and name not in ("original", "cornered")
)
"""Names that an object may define in place of the defaults of `ContinuationProblem`."""


class _Adapted(ContinuationProblem):
    """An object with ``evaluate``; what it does not define has the default of `ContinuationProblem`."""

    parameters: dict[str, float] = {}  # noqa: RUF012  no properties here: the object's own attributes replace them
    layout: LayoutProtocol | None = None
    refined_problem: ContinuationProblem | None = None
    comparisons: Sequence[tuple[ContinuationProblem, float]] = ()
    resolution: str = ""

    def __init__(self, problem: Problem) -> None:
        self._original = problem
        for name in _ABILITIES:
            value = getattr(problem, name, None)
            if value is not None:
                object.__setattr__(self, name, value)
        if self.refined_problem is not None:
            self.refined_problem = as_problem(self.refined_problem)
            self.comparisons = self.comparisons or ((self.refined_problem, 1.0),)
        self.resolution = self.resolution or f"n = {self.size}"

    @property
    def original(self) -> Any:
        return self._original


def as_problem(problem: AnyProblem) -> ContinuationProblem:
    """Return the problem with a default for every ability that it does not define.

    Parameters
    ----------
    problem : ContinuationProblem or object with ``evaluate``
        The problem.

    Raises
    ------
    TypeError
        If it has no ``evaluate``.
    """
    return problem if isinstance(problem, ContinuationProblem) else _adapted(problem)


@checked_arguments()
def _adapted(problem: AnyProblem) -> ContinuationProblem:
    return _Adapted(problem)
