"""Stability of solutions, from their multipliers and the errors of these.

    stable:    max |mu_j| <= 1        unstable:  max |mu_j| > 1        undecided:  | max |mu_j| - 1 | <= error

The multipliers mu_j are those of small disturbances of a solution (Floquet multipliers of periodic solutions).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray

STABILITY_TOLERANCE = 1e-6
"""Distance from the unit circle up to which a multiplier counts as on it. Free rotations have mu = 1 up to rounding."""


STABILITY_STATES = ("unstable", "stable", "undecided", "unknown")
"""States of the stability of a solution. Their positions are the codes of `stability_codes`."""


UNSTABLE, STABLE, UNDECIDED, UNKNOWN = range(4)
"""Codes of the `STABILITY_STATES`."""


STABILITY_CHANGING_KINDS = ("LP", "PD", "NS", "BP")
"""Kinds of special points at which solutions can become stable or unstable."""


def is_stable(multipliers: ComplexArray) -> NDArray[np.bool_]:
    """Return whether no multiplier lies outside the unit circle.

    Parameters
    ----------
    multipliers : ndarray of complex, shape (..., r)
        Multipliers of each solution.

    Returns
    -------
    ndarray of bool, shape (...)
        The errors of the multipliers are ignored.
    """
    return np.asarray(np.abs(multipliers).max(axis=-1, initial=0.0) <= 1 + STABILITY_TOLERANCE)


def stability_codes(multipliers: ComplexArray, modulus_error: Array) -> NDArray[np.int_]:
    """Return the code of the stability of each solution.

    Parameters
    ----------
    multipliers : ndarray of complex, shape (..., r)
        Multipliers of each solution, nan where they are unknown.
    modulus_error : ndarray, shape (...)
        Estimated error of the largest modulus, nan where it is unknown.

    Returns
    -------
    ndarray of int, shape (...)
        Positions in `STABILITY_STATES`.
    """
    modulus = np.abs(multipliers).max(axis=-1, initial=0.0)
    undecided = (np.abs(modulus - 1.0) <= modulus_error) & (modulus_error > STABILITY_TOLERANCE)
    codes: NDArray[np.int_] = np.where(undecided, UNDECIDED, modulus <= 1 + STABILITY_TOLERANCE)
    return np.where(np.isnan(modulus), UNKNOWN, codes)
