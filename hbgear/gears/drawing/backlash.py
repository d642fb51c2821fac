"""Backlash in all the ways it is measured, and what half of it is along the line of action: the one place for both.

    j_bn = j_wt cos(alpha_wt) cos(beta_b),   j_bt = j_wt cos(alpha_wt),   j_t = j_wt d / d_w,   b = j_bt / 2

j_wt along the arc of the working pitch circle, j_t along that of the reference circle, j_bn normal to the flanks (what
a feeler gauge measures), j_bt along the line of action in the transverse plane; b is the half gap of the models.

References
----------
ISO 21771:2007, 5.5; ISO/TR 10064-2:1996.
"""

from __future__ import annotations

from math import cos

from hbgear.common.text.messages import quoted

MEASURES = ("circumferential", "normal", "action")
"""How a backlash may be given: j_wt, j_bn or j_bt."""


def factors(working_angle: float, base_helix: float) -> dict[str, float]:
    """Each measure of backlash over j_wt.

    Parameters
    ----------
    working_angle : float
        Transverse working pressure angle alpha_wt [rad].
    base_helix : float
        Beta_b [rad].
    """
    action = cos(working_angle)
    return {"circumferential": 1.0, "normal": action * cos(base_helix), "action": action}


def converted(value: float, given: str, wanted: str, working_angle: float, base_helix: float) -> float:
    """A backlash [m] given in one measure, in another.

    Raises
    ------
    ValueError
        If there is no such measure.

    Examples
    --------
    >>> from math import radians
    >>> round(converted(80e-6, "circumferential", "action", radians(20), 0.0) * 1e6, 3)
    75.175
    """
    known = factors(working_angle, base_helix)
    for name in (given, wanted):
        if not isinstance(name, str) or name not in known:
            raise ValueError(f"backlash is measured as {', '.join(MEASURES)}; got {quoted(name)}")
    return value * known[wanted] / known[given]
