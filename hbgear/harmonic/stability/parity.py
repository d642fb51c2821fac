"""Parity checks: signs of determinants of the balance against the number of real multipliers beyond the unit circle.

    sign det(dR/dX)             = c (-1)^n,   n real multipliers above +1
    sign det(half-integer block) =   (-1)^n,   n real multipliers below -1

Both determinants are Hill's determinants at the multipliers +1 and -1, and change sign where a multiplier passes there.
The constant c does not depend on how the stiffness of the elements varies over the period. It is therefore computed
from the structure with the reference springs of the elements, whose Jacobian is its dynamic stiffness:

    c = sign det Z(0) (-1)^n_0,   n_0 real poles of the structure above 0

The harmonics k > 0 contribute |det Z(k)|^2. Agreement is not sufficient: two wrong multipliers leave both signs
unchanged. Next to a fold that truncation has displaced, dR/dX itself has the wrong sign.

References
----------
Lazarus & Thomas (2010), C. R. Mecanique 338(9), https://doi.org/10.1016/j.crme.2010.07.020, for Hill's determinant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
from hbgear.harmonic.multipliers.multiplier_error import count_beyond

MAX_MISMATCH_FRACTION = 0.6
"""Fraction of mismatches above which the constant of the problem is taken as unknown."""


MIN_POINTS_FOR_FRACTION = 16
"""Number of points from which this fraction is evaluated."""


@dataclass(frozen=True)
class Parity:
    """Parity checks of the motions of a problem.

    Attributes
    ----------
    constant : int
        The constant c at the head of this file; 0 if it is unknown, and nothing is checked.
    """

    constant: int

    @staticmethod
    def of(problem: Any, motions: CurveSolutions) -> Parity:
        """Return the checks of motions of a `HarmonicBalance`; both ends of their parameter must have one constant."""
        _, name, values, parameters = motions
        ends = {float(values.min()), float(values.max())} if name != "Omega" else {parameters.get(name, 1.0)}
        signs = {problem.compiled({**parameters, name: value}).reference_sign for value in ends}
        return Parity(signs.pop() if len(signs) == 1 else 0)

    def mismatch(self, multipliers: ComplexArray, signs: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Return whether signs (k,) of det(dR/dX) contradict multipliers (k, r).

        An unknown sign, 0, contradicts nothing. A multiplier within `STABILITY_TOLERANCE` of +1 may be on either side.
        """
        flagged: NDArray[np.bool_] = (signs != 0) & (self.constant != 0)
        for margin in (-STABILITY_TOLERANCE, STABILITY_TOLERANCE):
            flagged &= self.constant * signs != 1 - 2 * (count_beyond(multipliers, margin)[:, 0] % 2)
        if len(flagged) >= MIN_POINTS_FOR_FRACTION and np.count_nonzero(flagged) > MAX_MISMATCH_FRACTION * len(flagged):
            flagged[:] = False
        return flagged

    def agrees(
        self, problem: Any, X: Array, parameters: Mapping[str, float], multipliers: ComplexArray, expected: int = 0
    ) -> bool:
        """Return whether both determinants at a motion X (n,) agree with its multipliers (r,).

        expected : required parity of the multipliers, unless it is 0; see `expected`. A multiplier within
        `STABILITY_TOLERANCE` of +1 may be on either side.
        """
        outside = count_beyond(multipliers)
        margins = (-STABILITY_TOLERANCE, STABILITY_TOLERANCE)
        if expected and all(expected != 1 - 2 * (count_beyond(multipliers, margin)[0] % 2) for margin in margins):
            return False
        sign = int(np.linalg.slogdet(np.asarray(problem.linearise(X, "", **parameters).dR_dX))[0])
        if self.mismatch(multipliers[None], np.array([sign]))[0]:
            return False
        return not self.constant or half_integer_sign(problem, X, parameters) in (0, 1 - 2 * (outside[1] % 2))


def half_integer_sign(problem: Any, X: Array, parameters: Mapping[str, float]) -> int:
    """Return the sign of the determinant of the half-integer block at a motion X (n,); multipliers -1 make it zero."""
    block, _ = PeriodDoublingProblem(problem).matrix(X, dict(parameters))
    return int(np.linalg.slogdet(block)[0])
