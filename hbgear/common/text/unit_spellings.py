"""Spellings of units, as written in data sheets and headers of tables.

U/min = 1/min = rpm = r/min,   N·m = N*m,   m/s² = m/s^2
"""

from __future__ import annotations

import re
import unicodedata

_SPELLINGS: dict[str, tuple[str, ...]] = {
    "Hz": ("cps", "cycle/s", "cycles/s"),
    "kHz": (),
    "r/min": ("rpm", "1/min", "/min", "min^-1", "min-1", "u/min", "rev/min", "tr/min", "cpm"),
    "r/s": ("rps", "rev/s", "u/s"),
    "rad/s": ("rad/sec", "rad s^-1", "rad*s^-1"),
    "krad/s": (),
    "deg/s": (),
    "deg": ("degree", "degrees"),
    "grad": (),
    "rad": ("radian", "radians"),
    "mrad": (),
    "cycle": ("cycles",),
    "": ("-", "1", "none"),
}
"""Other spellings of each unit, in lower case."""

_UNITS = {spelling.casefold(): unit for unit, others in _SPELLINGS.items() for spelling in (unit, *others)}

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
    return text if text in _CASE_SENSITIVE else _UNITS.get(text.casefold(), text)
