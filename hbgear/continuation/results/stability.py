"""Stability of solutions, from their multipliers and the errors of these.

    stable:    max |mu_j| <= 1        unstable:  max |mu_j| > 1        undecided:  | max |mu_j| - 1 | <= error

The multipliers mu_j are the growth factors of small disturbances of a solution (Floquet multipliers of periodic ones).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray

STABILITY_TOLERANCE = 1e-6
"""Distance from the unit circle up to which a multiplier counts as on it. Free rotations have mu = 1 up to rounding."""


STABILITY_STATES = ("unstable", "stable", "undecided", "unknown", "neutral")
"""States of the stability of a solution. The positions of the first four are the codes of `stability_codes`. A stable
solution is neutral if it belongs to a family of solutions at the same parameters, as motions in which no friction
slider slips."""


UNSTABLE, STABLE, UNDECIDED, UNKNOWN = range(4)
"""Codes of the `STABILITY_STATES`."""


STABILITY_CHANGING_KINDS = ("LP", "PD", "NS", "BP")
"""Kinds of special points at which solutions can become stable or unstable."""


MAX_MULTIPLIER_DEVIATION = 1e-3
"""Distance of a multiplier from +1 (BP), -1 (PD) or the unit circle (NS) above which a point is not located.

Correct points were observed with 1e-4 and less, ends of segments that were mistaken for special points with 1e-2 and
more.
"""


def is_stable(multipliers: ComplexArray) -> NDArray[np.bool_]:
    """Return for each solution whether no multiplier (..., r) lies outside the unit circle; errors are ignored."""
    return np.asarray(np.abs(multipliers).max(axis=-1, initial=0.0) <= 1 + STABILITY_TOLERANCE)


def scaled_determinant(multipliers: ComplexArray, critical: float) -> Array:
    """Return det(Phi - critical I) for multipliers (P, r), nan where they are unknown; its sign and zeros are exact.

    Moduli are limited to `MAX_DETERMINANT_MODULUS`. ``critical`` is +1 at folds and branch points, -1 at period
    doublings.
    """
    # a factor, because the division of a complex nan warns
    scale = 1.0 / np.maximum(np.abs(multipliers) / MAX_DETERMINANT_MODULUS, 1.0)
    return ((multipliers - critical) * scale).prod(axis=1).real


MAX_DETERMINANT_MODULUS = 1e6
"""Modulus to which multipliers are limited in the determinant, so that products do not overflow."""


def pair_factors(multipliers: ComplexArray) -> ComplexArray:
    """Return mu_i mu_j - 1 of all pairs i < j of the multipliers (r,), (r (r - 1) / 2,)."""
    first, second = np.triu_indices(len(multipliers), 1)
    return multipliers[first] * multipliers[second] - 1


def sign_of_pairs(multipliers: ComplexArray) -> float:
    """Return the smallest |mu_i mu_j - 1| over all pairs i < j of the multipliers (r,), with the sign of their product.

    It is zero where a complex pair is on the unit circle, and at neutral saddles, where the pair is real. The product
    of all factors would underflow with many multipliers.
    """
    factors = pair_factors(multipliers)
    sizes = np.abs(factors)
    smallest = float(sizes.min(initial=1.0))
    return math.copysign(smallest, float((factors / sizes).prod().real)) if smallest > 0 else 0.0


def stability_codes(multipliers: ComplexArray, modulus_error: Array) -> NDArray[np.int_]:
    """Return the code of the stability of each solution, its position in `STABILITY_STATES`.

    Multipliers (..., r) and the error of the largest modulus are nan where they are unknown.
    """
    modulus = np.abs(multipliers).max(axis=-1, initial=0.0)
    undecided = (np.abs(modulus - 1.0) <= modulus_error) & (modulus_error > STABILITY_TOLERANCE)
    codes: NDArray[np.int_] = np.where(undecided, UNDECIDED, modulus <= 1 + STABILITY_TOLERANCE)
    return np.where(np.isnan(modulus), UNKNOWN, codes)


def stability_names(codes: NDArray[np.int_], regime: NDArray[np.int8], neutral_regime: int) -> list[str]:
    """Return the name of the stability of P solutions, from their codes (P,) and the regimes (P, m) of the elements.

    Stable solutions are neutral if their largest regime is ``neutral_regime``; -1 if there are none.
    """
    worst = np.max(regime, axis=1, initial=-1) if regime.ndim == 2 else np.full(len(codes), -1)
    neutral = (codes == STABLE) & (worst == neutral_regime) & (neutral_regime >= 0)
    pairs = zip(codes.tolist(), neutral.tolist(), strict=True)
    return ["neutral" if is_neutral else STABILITY_STATES[code] for code, is_neutral in pairs]
