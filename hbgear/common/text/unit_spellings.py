"""Spellings of units, as written in data sheets and headers of tables.

U/min = 1/min = rpm = r/min,   N·m = N*m,   m/s² = m/s^2
"""

from __future__ import annotations

import re
import unicodedata

_SPELLINGS = {
    "hz": "Hz",
    "khz": "kHz",
    "cps": "Hz",
    "cycle/s": "Hz",
    "cycles/s": "Hz",
    "rpm": "r/min",
    "1/min": "r/min",
    "/min": "r/min",
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
    """Return a unit in the spelling of `hbgear.common.units` and Pint; "" for a dimensionless number.

    Examples
    --------
    >>> [plain_unit(text) for text in ("µm", "°", "U/min", "(m/s²)/N", "rad/(N·m)", "-")]
    ['um', 'deg', 'r/min', 'm/s^2/N', 'rad/N/m', '']
    """
    text = re.sub("[²³⁻¹]+", lambda match: "^" + unicodedata.normalize("NFKC", match[0]), text)
    text = unicodedata.normalize("NFKC", text).replace("\u2212", "-").replace("μ", "u").replace("°", "deg")
    text = " ".join(text.replace("·", "*").replace("⋅", "*").split())
    text = re.sub(r"\s*/\s*", "/", text)
    text = re.sub(r"^\(([^()]*)\)", r"\1", text)
    text = re.sub(r"/\s*\(([^()]*)\)", lambda match: "/" + re.sub(r"\s*[* ]\s*", "/", match[1].strip()), text)
    return text if text in _CASE_SENSITIVE else _SPELLINGS.get(text.casefold(), text)
