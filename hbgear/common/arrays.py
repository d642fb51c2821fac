"""Names of array types in annotations."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]  # of real numbers


ComplexArray = NDArray[Any]  # of complex numbers; type checkers do not distinguish the two names
