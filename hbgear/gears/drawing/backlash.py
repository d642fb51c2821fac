"""Measures of backlash, conversion between them, and the half gap along the line of action.

    j_bn = j_wt cos(alpha_wt) cos(beta_b),   j_bt = j_wt cos(alpha_wt),   j_t = j_wt d / d_w,   b = j_bt / 2

j_wt is measured along the arc of the working pitch circle, j_t along the arc of the reference circle, j_bn normal to
the flanks (as with a feeler gauge) and j_bt along the line of action in the transverse plane. b is the half gap of the
models.

References
----------
ISO 21771:2007, 5.5; ISO/TR 10064-2:1996.
"""

from __future__ import annotations

from math import cos

from hbgear.common.text.messages import quoted

MEASURES = ("circumferential", "normal", "action")
"""Accepted measures of backlash: j_wt, j_bn and j_bt."""


def backlash_factors(working_angle: float, base_helix: float) -> dict[str, float]:
    """Return the ratio of each measure of backlash to j_wt, for alpha_wt and beta_b [rad]."""
    action = cos(working_angle)
    return {"circumferential": 1.0, "normal": action * cos(base_helix), "action": action}


def convert_backlash(value: float, source: str, target: str, working_angle: float, base_helix: float) -> float:
    """Convert a backlash [m] from one measure to another.

    Raises
    ------
    ValueError
        If a measure is not one of `MEASURES`.

    Examples
    --------
    >>> from math import radians
    >>> round(convert_backlash(80e-6, "circumferential", "action", radians(20), 0.0) * 1e6, 3)
    75.175
    """
    factors = backlash_factors(working_angle, base_helix)
    for name in (source, target):
        if not isinstance(name, str) or name not in factors:
            raise ValueError(f"backlash measure must be one of {', '.join(MEASURES)}; got {quoted(name)}")
    return value * factors[target] / factors[source]
