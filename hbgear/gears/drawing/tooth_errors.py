"""Errors of single teeth: pitch errors and run-out, which vary with the orders of the shafts.

    gap_p = (f_1[p mod z_1] - f_2[p mod z_2]) cos(alpha_t)                             on the driving flank of pair p
    gap(tau) = -e_1 sin(psi_1 + alpha_wt) + e_2 sin(psi_2 - alpha_wt),   e_i = F_ri / 2
    psi_i = (tau - 2 pi u_i) / z_i + phase_i,   u_1 = u_P + thickness_1 / 2,   u_2 = u_P - thickness_2 / 2

Pair p enters contact at tau = 2 pi p. A displaced tooth has the negative gap on its back flank. f is an arc of the
reference circle, positive for a tooth that lags behind: a tooth of the pinion moves off its mate, a tooth of the wheel
towards it. An eccentricity e at the angle psi from the direction to the other gear, in the direction of rotation, moves
all teeth at once: their gap changes along the line of action of the flank. ``phase_i`` is its angle from the middle of
tooth 0, which passes the direction to the other gear at u_i mesh periods: half a tooth after the pitch point u_P for
the pinion, before it for the wheel. The back flanks have the opposite line of action,

    gap_back(tau) = e_1 sin(psi_1 - alpha_wt) - e_2 sin(psi_2 + alpha_wt)

so that the displacement towards the other gear reduces the backlash. For a ring -alpha_wt replaces alpha_wt in both
terms of e_2. The change of the contact ratio with the centre distance is neglected.

References
----------
ISO 1328-1:2013 (single and cumulative pitch deviations) and ISO 1328-2:2020 (radial run-out).
"""

from __future__ import annotations

from math import cos, lcm, pi
from typing import NamedTuple

from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair

MAX_ERROR_PERIOD = 250
"""Largest number of meshes after which the errors of the teeth repeat [-]. A contact has up to 8 cubics in each mesh,
and a `Periodic` at most 2000 pieces."""


class GapWave(NamedTuple):
    """Gap A sin(2 pi t / M + phase) of all pairs at the time t in mesh periods.

    Attributes
    ----------
    amplitude : float
        Amplitude A [length].
    meshes : int
        Period M [mesh periods].
    phase : float
        Phase at t = 0 [rad].
    """

    amplitude: float
    meshes: int
    phase: float


def has_errors(gear: Gear) -> bool:
    """Return whether a gear has errors of single teeth or run-out."""
    return bool(gear.runout or gear.pitch_errors)


def error_period(pair: GearPair) -> int:
    """Return the number of meshes after which the errors of the teeth of a pair repeat; 1 without errors.

    Raises
    ------
    ValueError
        If it is larger than `MAX_ERROR_PERIOD`.
    """
    period = lcm(*(gear.teeth for gear in (pair.pinion, pair.wheel) if has_errors(gear)))
    if period > MAX_ERROR_PERIOD:
        raise ValueError(
            f"GearPair: the errors of {pair.pinion.teeth} and {pair.wheel.teeth} teeth repeat after {period} meshes, "
            f"and at most {MAX_ERROR_PERIOD} can be computed; give pitch_errors and runout of one gear only"
        )
    return period


def pair_gaps(pair: GearPair, side: int, meshes: int) -> dict[int, float]:
    """Return the gaps [m] of pairs of teeth that follow each other, on the driving (side +1) or back flanks, by number.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(z, "3 mm", "20 mm", pitch_errors=["9 um"] + (z - 1) * [0]) for z in (20, 30))
    >>> [*pair_gaps(hb.GearPair(pinion, wheel, "80 um"), 1, meshes=60)]
    [0, 20, 30, 40]
    """
    factor = side * cos(pair.pinion.transverse_pressure_angle)
    signed = (pair.pinion.pitch_errors, 1), (pair.wheel.pitch_errors, -1)
    gears = [(errors, sign) for errors, sign in signed if errors]
    sums = ((p, sum(sign * errors[p % len(errors)] for errors, sign in gears)) for p in range(meshes))
    return {p: factor * error for p, error in sums if error}


def gap_waves(pair: GearPair, side: int) -> tuple[GapWave, ...]:
    """Return the gap of the driving (side +1) or back flanks by the run-out of each gear."""
    alpha, waves = pair.working_pressure_angle, []
    gears = zip((pair.pinion, pair.wheel), (-1, 1), (1, -pair.wheel.sign), pair.thickness, strict=True)
    for gear, sign, turn, thickness in gears:
        if gear.runout:
            middle = pair.pitch_position - sign * thickness / 2
            phase = gear.runout_phase - 2 * pi * middle / gear.teeth + side * turn * alpha
            waves.append(GapWave(gear.runout / 2, gear.teeth, phase + (pi if sign * side < 0 else 0.0)))
    return tuple(waves)
