"""Names of array types in annotations."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[tuple[Any, ...], np.dtype[Any]]
"""Array of real numbers: NDArray[Any], which is not a class of arrays at run time from NumPy 2.5 on."""

ComplexArray = Array
"""Array of complex numbers; type checkers do not distinguish the two names."""
