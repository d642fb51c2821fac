"""How unknowns are read: what a curve can say of its points without knowing what they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from hbgear.common.arrays import Array


@runtime_checkable
class LayoutProtocol(Protocol):
    """How unknowns are read: `Readable.layout`."""

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
        """The unknowns of an element, by number or name, out of X (..., n)."""

    def measure(self, name: str, X: Array, element: int | str = 0) -> Array:
        """Measure of amplitude of an element, for each row of X (..., n)."""

    def samples(self, X: Array, element: int | str, count: int, order: int) -> tuple[Array, Array]:
        """Phase and values of an element, or of its derivative of that order."""

    def in_time(self, rows: Array, parameters: Mapping[str, Array], order: int) -> Array:
        """Unknowns of the derivative in time of rows (P, ...), whose parameters are (P,) each."""

    def measure_rows(self, name: str, rows: Array) -> Array:
        """Measure of amplitude of rows that are already those of one element."""


@runtime_checkable
class HasDistance(Protocol):
    """Can tell how far apart solutions are; asked where a jump lands. Of others the norm of X - Y is taken."""

    def distance(self, X: Array, other: Any, Y: Array) -> float:
        """How far X is from Y, which is read as ``other``."""


@runtime_checkable
class RebuildsProblem(Protocol):
    """Can make the problem of a curve again from what its file says; asked if a curve has none."""

    def problem_of(self, meta: Mapping[str, Any]) -> Any:
        """The problem; None if the file does not tell it."""


@runtime_checkable
class ReconstructsMotion(Protocol):
    """Knows more coordinates than its unknowns; asked by `Branch.amplitude`."""

    @property
    def dof_names(self) -> Sequence[str]:
        """Names of the coordinates."""

    def motion(self, X: Array, **parameters: float) -> Array:
        """All coordinates, (dofs, ...), each in the form of the rows of an element."""
