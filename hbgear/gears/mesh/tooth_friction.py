"""Friction between the teeth of a spur pair: factors of the force along the line of action.

    along(tau) = sum over pairs [1 + mu sign(s - s_P) (lever + lever_slope (s - s_P))] / eps
    across(tau) = sum over pairs mu sign(s - s_P) / eps,       s = tau / (2 pi), tau / (2 pi) + 1, ...   with s < eps

s is the position of a pair of teeth on the path of contact, in base pitches from its begin, and s_P the pitch point,
where the sliding velocity changes its sign. Before it (approach) friction assists the pinion that drives; behind it
(recess) it brakes. All pairs have the same stiffness. With the inertias J, base radii r and base pitch p_b

    lever = m_c (r_1 rho_1 / J_1 + r_2 rho_2 / J_2) at the pitch point,   lever_slope = m_c p_b (r_1 / J_1 - r_2 / J_2)

where rho are the radii of curvature of the flanks and 1 / m_c = r_1^2 / J_1 + r_2^2 / J_2. The factor ``along``
multiplies the mesh stiffness in the equation of the relative rotation; the force ``across`` acts along the off-line of
action.

References
----------
Vaishya & Singh (2001), J. Sound Vib. 243(3), https://doi.org/10.1006/jsvi.2000.3247.
"""

from __future__ import annotations

import math

import numpy as np

from hbgear.common.ranges import ANY, NOT_NEGATIVE, Range, checked
from hbgear.mechanics.series.periodic import Periodic


def tooth_friction(
    contact_ratio: float, pitch_point: float, coefficient: float, lever: float = 1.0, lever_slope: float = 0.0
) -> tuple[Periodic, Periodic]:
    """Return the factors of the mesh force along and across the line of action, with jumps where sliding reverses.

    Parameters
    ----------
    contact_ratio : float
        Contact ratio eps, between 1 and 5.
    pitch_point : float
        Position of the pitch point on the path of contact, in base pitches from its begin, between 0 and eps.
    coefficient : float
        Coefficient of friction mu, >= 0.
    lever : float, optional
        Lever of the friction force at the pitch point over that of the mesh force. Default 1.
    lever_slope : float, optional
        Change of the lever in one base pitch. Default 0.

    Returns
    -------
    tuple of Periodic
        Factors ``along`` and ``across`` over the phase of the mesh, which begins where a pair comes into contact.

    Raises
    ------
    ValueError
        If a number is out of its range.

    Examples
    --------
    >>> import hbgear as hb
    >>> along, across = hb.gears.tooth_friction(1.6, 0.8, 0.1)
    >>> pair = hb.SpurPair(stiffness=along, e=())
    >>> round(float(along.mean), 12)
    1.0
    """
    checked("tooth_friction", "contact_ratio", contact_ratio, Range(low=1, high=5))
    checked("tooth_friction", "pitch_point", pitch_point, Range(low=0, high=contact_ratio))
    checked("tooth_friction", "coefficient", coefficient, NOT_NEGATIVE)
    checked("tooth_friction", "lever", lever, ANY)
    checked("tooth_friction", "lever_slope", lever_slope, ANY)
    ends = sorted({0.0, contact_ratio % 1.0, pitch_point % 1.0})
    along, across = [], []
    for begin, end in zip(ends, [*ends[1:], 1.0], strict=True):
        middle, value, slope, side = 0.5 * (begin + end), 0.0, 0.0, 0.0
        for pair in range(math.ceil(contact_ratio)):
            if middle + pair < contact_ratio:
                mu = math.copysign(coefficient, middle + pair - pitch_point)
                value += 1 + mu * (lever + lever_slope * (begin + pair - pitch_point))
                slope += mu * lever_slope / (2 * math.pi)
                side += mu
        along.append((value / contact_ratio, slope / contact_ratio))
        across.append((side / contact_ratio,))
    phases = tuple((2 * np.pi * np.array(ends)).tolist())
    return Periodic(phases, tuple(along)), Periodic(phases, tuple(across))
