"""Forces as compiled functions, for `hbgear.mechanics.CompiledLaw`; Numba is imported with this module."""

import numba

from hbgear.common.arrays import Array


@numba.njit
def quintic(d: float, v: float, tau: float, k: Array) -> tuple[float, float, float]:
    """p = k0 d^5 + k1 v^3 with its derivatives in d and v."""
    return k[0] * d**5 + k[1] * v**3, 5 * k[0] * d**4, 3 * k[1] * v**2
