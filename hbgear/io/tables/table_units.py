"""Units of columns of tables, as written in headers, and their factors to the units of the computation.

n [r/min] -> 1/60 Hz,   omega [rad/s] -> 1/(2 pi) Hz,   x [mm/N] -> 1e-3 m/N,   L [dB re 1 mm/N] -> 1e-3 10^(L/20) m/N
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

from hbgear.common.units import to_si

FREQUENCY = {
    "Hz": 1.0,
    "mHz": 1e-3,
    "kHz": 1e3,
    "MHz": 1e6,
    "r/min": 1 / 60,
    "rad/s": 1 / (2 * pi),
    "krad/s": 1e3 / (2 * pi),
    "r/s": 1.0,
    "deg/s": 1 / 360,
}
"""Cycles per second of each unit of frequency and speed."""

ANGLE = {"deg": pi / 180, "rad": 1.0, "mrad": 1e-3, "cycle": 2 * pi}
"""Radians of each unit of angle."""


def factor_of(unit: str, units: Sequence[str]) -> tuple[float, str] | None:
    """Return the factor from a unit to the first compatible one of some SI units, and that unit; None without one.

    Examples
    --------
    >>> factor_of("mm/N", ["m/N"]), factor_of("1/kg", ["m/N", "m/s^2/N"]), factor_of("Hz", ["m/N"])
    ((0.001, 'm/N'), (1.0, 'm/s^2/N'), None)
    """
    for target in units:
        if unit == target:
            return 1.0, target
    text = f"{unit} " if unit[:1].isdigit() else f"1 {unit}"
    for target in units:
        try:
            return to_si("table", "unit", text, target), target
        except ValueError:
            continue
    return None
