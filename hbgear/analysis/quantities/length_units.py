"""Units of lengths and velocities of motions, in labels of tables and figures.

    x [um] = 1e6 length xbar,   a measure of dimension p has the factor (1e6 length)^p

Labels of tables have the unit um; `in_figure` converts them for figures, which have the sign of micro.
"""

from __future__ import annotations

import re

from hbgear.common.text.symbols import without_unit
from hbgear.mechanics.series.measures import MEASURES
from hbgear.mechanics.structures.scales import Numbers

MICROMETRE = "um"
"""Unit of lengths in tables; figures have the sign of micro."""


def in_figure(text: str) -> str:
    """Return a label of a table with its unit in the notation of figures.

    Examples
    --------
    >>> in_figure("gap [um]"), in_figure("$x^2$ [m^2]")
    ('gap [\N{MICRO SIGN}m]', '$x^2$ [m\N{SUPERSCRIPT TWO}]')
    """
    return re.sub(r"\[[^\[\]$]*\]", lambda unit: in_figure_unit(unit[0]), text)


def in_figure_unit(unit: str) -> str:
    """Return a unit in the notation of figures, with the sign of micro and raised exponents.

    Examples
    --------
    >>> in_figure_unit("um")
    '\N{MICRO SIGN}m'
    """
    unit = re.sub(r"\bum\b", "\N{MICRO SIGN}m", unit)
    return unit.replace("^2", "\N{SUPERSCRIPT TWO}").replace("^3", "\N{SUPERSCRIPT THREE}")


def dimension_of(measure: str) -> int:
    """Return the power of the length in a measure: 0 for ratios and for measures with their own unit."""
    entry = MEASURES.get(measure)
    return 1 if entry is None else 0 if entry.unit else entry.dimension


def factor_of(measure: str, length: Numbers | None) -> Numbers | float:
    """Return the unit of a measure of amplitude [um] for a unit of length [m]; 1 without a unit of length.

    Examples
    --------
    >>> factor_of("rms", 5e-5), factor_of("rms", None)
    (50.0, 1.0)
    """
    return 1.0 if length is None else (1e6 * length) ** dimension_of(measure)


def in_micrometres(symbol: str, name: str = "") -> str:
    """Return the label of a motion in units of the model, and a name that follows it, with the unit of lengths.

    Examples
    --------
    >>> in_micrometres("$x$ [-]")
    '$x$ [um]'
    """
    text = without_unit(symbol).partition(" / ")[0]
    return f"${text}${name} [{MICROMETRE}]" if len(text) <= 2 else f"{text}{name} [{MICROMETRE}]"


def in_metres_per_second(symbol: str) -> str:
    """Return the label of a motion in units of the model as that of its rate, without "rate of", with the SI unit.

    Examples
    --------
    >>> in_metres_per_second("gap / b")
    'gap [m/s]'
    """
    return in_micrometres(symbol).replace(f"[{MICROMETRE}]", "[m/s]")
