"""Adapter: any object with ``evaluate`` as a `ContinuationProblem`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import AnyProblem, Problem
from hbgear.continuation.results.layout import LayoutProtocol

_REPLACEABLE_NAMES = tuple(
    name for name in vars(ContinuationProblem) if not name.startswith("_") and name != "original"
)
"""Names of `ContinuationProblem` that an object may define instead of their defaults."""


class _Adapted(ContinuationProblem):
    """An object with ``evaluate``, completed by the defaults of `ContinuationProblem`."""

    parameters: dict[str, float] = {}  # noqa: RUF012  no properties: attributes of the object replace them
    layout: LayoutProtocol | None = None
    refined_problem: ContinuationProblem | None = None
    comparisons: Sequence[tuple[ContinuationProblem, float]] = ()
    resolution: str = ""

    def __init__(self, problem: Problem) -> None:
        self._original = problem
        for name in _REPLACEABLE_NAMES:
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
    """Return a problem with the defaults for everything that it does not define.

    Parameters
    ----------
    problem : ContinuationProblem or object with ``evaluate``
        The problem.

    Returns
    -------
    ContinuationProblem
        The problem itself, or an adapter of it.

    Raises
    ------
    TypeError
        If it has no ``evaluate``.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> class Circle:
    ...     def evaluate(self, X, p):
    ...         return X**2 + p**2 - 1, np.diag(2 * X)
    ...
    >>> problem = hb.continuation.as_problem(Circle())
    >>> problem.smooth, problem.unknown_parameters
    (True, ())
    """
    return problem if isinstance(problem, ContinuationProblem) else _adapted(problem)


@checked_arguments()
def _adapted(problem: AnyProblem) -> ContinuationProblem:
    """Return the adapter of an object, which is checked."""
    return _Adapted(problem)
