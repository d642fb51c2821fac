"""Layout of the unknowns: names, regimes and measures that a branch needs without knowing its problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from hbgear.common.arrays import Array


@runtime_checkable
class LayoutProtocol(Protocol):
    """Description of the unknowns of a problem: `ContinuationProblem.layout`."""

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of the elements."""

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the regime codes."""

    @property
    def width(self) -> int:
        """Number of unknowns n."""

    def rows(self, X: Array, element: int | str) -> Array:
        """Return the unknowns of an element, by index or name, out of X of shape (..., n)."""

    def measure(self, name: str, X: Array, element: int | str = 0) -> Array:
        """Return a measure of amplitude of an element, for X of shape (..., n)."""

    def samples(self, X: Array, element: int | str, count: int, order: int) -> tuple[Array, Array]:
        """Return phases and values of an element, or of its derivative of the given order."""

    def in_time(self, rows: Array, parameters: Mapping[str, Array], order: int) -> Array:
        """Return the unknowns of a derivative in time, for rows of shape (P, ...) and parameters of shape (P,)."""

    def measure_rows(self, name: str, rows: Array) -> Array:
        """Return a measure of amplitude for the unknowns of one element."""


@runtime_checkable
class HasNeutralRegime(Protocol):
    """Layout with a regime in which stable solutions belong to a family. Without it no solution is neutral."""

    @property
    def neutral_regime(self) -> int:
        """Code of the most severe regime of such solutions."""


def neutral_regime_of(layout: Any) -> int:
    """Return the code of the most severe regime of neutral solutions of a layout; -1 if there are none."""
    return layout.neutral_regime if isinstance(layout, HasNeutralRegime) else -1


@runtime_checkable
class HasDistance(Protocol):
    """Layout that measures the distance of solutions. Without it the distance is the norm of X - Y."""

    def distance(self, X: Array, other: Any, Y: Array) -> float:
        """Return the distance of X from Y, whose layout is ``other``."""


@runtime_checkable
class RebuildsProblem(Protocol):
    """Layout that rebuilds the problem of a branch from the header of its file."""

    def problem_of(self, meta: Mapping[str, Any]) -> Any:
        """Return the problem, or None if the header does not describe it."""


@runtime_checkable
class ReconstructsMotion(Protocol):
    """Problem with more coordinates than its unknowns, which `Branch.amplitude` can measure."""

    @property
    def dof_names(self) -> Sequence[str]:
        """Names of the coordinates."""

    def motion(self, X: Array, **parameters: float) -> Array:
        """Return all coordinates, shape (dofs, ...), each in the form of the unknowns of an element."""
