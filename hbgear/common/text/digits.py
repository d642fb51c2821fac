"""Numbers as text with their significant digits."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal


def rounded(value: float, digits: int) -> str:
    """Return a number with a given count of significant digits, zeros at the end included."""
    return _without_exponent(f"{value:#.{digits}g}".rstrip("."))


def short(value: float, digits: int) -> str:
    """Return a number with at most a given count of significant digits, without zeros at the end.

    Examples
    --------
    >>> short(0.85, 4), short(11794.2, 4), short(1.5e9, 4)
    ('0.85', '11790', '1.5e+09')
    """
    return _without_exponent(f"{value:.{digits}g}")


def _without_exponent(text: str) -> str:
    """Return a number below `MAX_PLAIN` that was written with a positive exponent without it."""
    return f"{float(text):.0f}" if "e+" in text and abs(float(text)) < MAX_PLAIN else text


MAX_PLAIN = 1e7
"""Value from which numbers are written with an exponent."""


def concise(value: float, error: float, most: int = 8) -> str:
    """Return a number with its error in units of the last digit, such as 0.84537(2).

    The error is left out if it is smaller than the last of ``most`` significant digits. An infinite error is shown as a
    question mark; with an unknown error (nan) the number has six digits.

    Examples
    --------
    >>> concise(0.8453691, 1.6e-5), concise(0.5, 1e-12), concise(1234.5, 30.0), concise(0.61597, math.inf)
    ('0.84537(2)', '0.50000000', '1230(30)', '0.616(?)')
    """
    if math.isnan(error):
        return rounded(value, 6)
    if math.isinf(error):
        return f"{rounded(value, 3)}(?)"
    least = math.floor(math.log10(abs(value))) + 1 - most if value else -most
    place = math.floor(math.log10(error)) if error > 0 else least - 1
    units = math.ceil(error / 10.0**place - 1e-9) if error > 0 else 0
    if units == 10:
        units, place = 1, place + 1
    if place < least:
        return rounded(value, most)
    if place < 0:
        return f"{value:.{-place}f}({units})"
    return f"{round(value, -place):.0f}({units * 10**place})"


def outward(low: Decimal, high: Decimal, digits: int = 17) -> tuple[str, str]:
    """Return two decimals with a given count of significant digits that enclose an interval.

    Examples
    --------
    >>> outward(Decimal("0.70803161"), Decimal("0.70803162"), 4)
    ('0.7080', '0.7081')
    """
    down, up = Context(prec=digits, rounding=ROUND_FLOOR), Context(prec=digits, rounding=ROUND_CEILING)
    return f"{down.plus(low):f}", f"{up.plus(high):f}"
