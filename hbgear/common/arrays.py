"""Names of array types in annotations."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]  # real


ComplexArray = NDArray[Any]  # complex; the two names tell the reader, not the type checker
