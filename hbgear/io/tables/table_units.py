"""Units of columns of tables, as written in headers, and their factors to the units of the computation.

n [r/min] -> 1/60 Hz,   omega [rad/s] -> 1/(2 pi) Hz,   x [mm/N] -> 1e-3 m/N,   L [dB re 1 mm/N] -> 1e-3 10^(L/20) m/N
"""

from __future__ import annotations

import re
import unicodedata
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

_SPELLINGS = {
    "hz": "Hz",
    "khz": "kHz",
    "cps": "Hz",
    "cycle/s": "Hz",
    "cycles/s": "Hz",
    "rpm": "r/min",
    "1/min": "r/min",
    "min^-1": "r/min",
    "min-1": "r/min",
    "u/min": "r/min",
    "rev/min": "r/min",
    "tr/min": "r/min",
    "cpm": "r/min",
    "r/min": "r/min",
    "rps": "r/s",
    "rev/s": "r/s",
    "u/s": "r/s",
    "r/s": "r/s",
    "rad/s": "rad/s",
    "rad/sec": "rad/s",
    "rad s^-1": "rad/s",
    "rad*s^-1": "rad/s",
    "krad/s": "krad/s",
    "deg/s": "deg/s",
    "degree": "deg",
    "degrees": "deg",
    "grad": "grad",
    "deg": "deg",
    "rad": "rad",
    "radian": "rad",
    "radians": "rad",
    "mrad": "mrad",
    "cycle": "cycle",
    "cycles": "cycle",
    "-": "",
    "1": "",
    "none": "",
    "": "",
}
"""Other spellings of a unit, in lower case."""

_CASE_SENSITIVE = {"mHz", "MHz"}
"""Units that differ in case only."""


def plain_unit(text: str) -> str:
    """Return a unit in the spelling of this module and Pint; "" for a dimensionless number.

    Examples
    --------
    >>> [plain_unit(text) for text in ("µm", "°", "U/min", "(m/s²)/N", "rad/(N·m)", "-")]
    ['um', 'deg', 'r/min', 'm/s^2/N', 'rad/N/m', '']
    """
    text = re.sub("[²³⁻¹]+", lambda match: "^" + unicodedata.normalize("NFKC", match[0]), text)
    text = unicodedata.normalize("NFKC", text).replace("\u2212", "-").replace("μ", "u").replace("°", "deg")
    text = " ".join(text.replace("·", "*").replace("⋅", "*").split())
    text = re.sub(r"^\(([^()]*)\)", r"\1", text)
    text = re.sub(r"/\s*\(([^()]*)\)", lambda match: "/" + re.sub(r"\s*[* ]\s*", "/", match[1].strip()), text)
    return text if text in _CASE_SENSITIVE else _SPELLINGS.get(text.casefold(), text)


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
