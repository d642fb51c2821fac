"""Parameter sets of the paper's figures, and response curves of the double-helical pair for them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import hbgear as hb

SPAN = (1.6, 0.2)
"""Omega of every response curve, from high to low."""

W = (-0.6, -0.3, 0.0, 0.3, 0.6)
"""Figure 5."""
EPS = ((0.16, 0.07, 0.03), (0.13, 0.04, 0.01), ())
"""Figure 6; () is a constant stiffness."""
ZETA = (0.063, 0.07, 0.1)
"""Figure 7."""
E = ((0.1, 0.05, 0.03), (0.03, 0.01, 0.01), ())
"""Figure 8; () is no transmission error."""
TORQUE = (700.0, 1000.0, 1400.0, 2000.0, 2800.0)
"""Figure 9 [N m per pinion half]. The paper does not print its loads; these enclose the base case."""
B = (50.77e-6, 51.02e-6, 51.20e-6, 51.27e-6)
"""Figures 17 and 18: lengths of backlash 2 b_c measured on the test rig [m]."""
SPEEDS = (400.0, 600.0, 1200.0)
"""Figures 14 to 16: pinion speeds of the test rig [r/min], which the paper pairs with Omega = 1/3, 1/2, 1."""


@lru_cache(maxsize=64)
def curve(harmonics: int = 16, span: tuple[float, float] = SPAN, **changes: Any) -> hb.Branch:
    """Response curve of the pair with fields changed from the base case; computed once per process.

    Parameters
    ----------
    harmonics, span : of the balance, and of Omega.
    changes : fields of `DoubleHelicalPair`.
    """
    return hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(**changes), harmonics), "Omega", span)


def at(branch: hb.Branch, Omega: float) -> hb.Point:
    """The motion of a curve at exactly this Omega, the stable one if there are several.

    Raises
    ------
    ValueError
        If the curve does not reach Omega.
    """
    rows = [branch[i] for i in range(len(branch))]
    start = min(rows, key=lambda point: abs(point.parameters["Omega"] - Omega) + (0 if point.stable else 1e-2))
    if start.parameters["Omega"] == Omega:
        return start
    here = hb.trace(branch.problem, "Omega", (start.parameters["Omega"], Omega), start=start)
    if abs(here.values[-1] - Omega) > 1e-9:
        raise ValueError(f"Omega = {Omega} was not reached from {start.parameters['Omega']:.6g}: {here.message}")
    return here[len(here) - 1]
