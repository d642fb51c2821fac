"""Ranges of parameters.

low <= value <= high,   above < value < below
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from hbgear.common.text.messages import quoted

_OPEN_END_DISTANCE = 1e-3
"""Distance of searches from an end outside the range, relative to the distance of the inner value."""


@dataclass(frozen=True)
class Range:
    """An interval of numbers: ``Range(low=0)`` not negative, ``Range(above=0)`` positive, ``Range()`` any number.

    Attributes
    ----------
    low, high : float
        Ends that belong to the range. Default: none.
    above, below : float
        Ends that do not belong to the range. Default: none.

    Examples
    --------
    >>> import hbgear as hb
    >>> share = hb.mechanics.Range(low=0.0, high=1.0)
    >>> 0.5 in share, 1.5 in share
    (True, False)
    >>> f"it must {share}"
    'it must be at least 0 and at most 1'
    """

    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf
    below: float = math.inf

    def __post_init__(self) -> None:
        for name in ("low", "high", "above", "below"):
            end = getattr(self, name)
            if isinstance(end, bool) or not isinstance(end, Real) or end != end:
                raise ValueError(f"Range: {name} = {quoted(end)} must be a number, math.inf for no end")
        first, last = max(self.low, self.above), min(self.high, self.below)
        if not first < last and not (first == last and first in self):
            raise ValueError(
                f"Range: no number lies from {quoted(first)} to {quoted(last)}; give the lower end as low or above"
            )

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high and self.above < value < self.below

    def __str__(self) -> str:
        """Return the condition in words, to follow "must"."""
        if self == Range(low=0):
            return "not be negative"
        if self == Range(above=0):
            return "be positive"
        if math.isfinite(self.above) and math.isfinite(self.below):
            return f"lie between {self.above:g} and {self.below:g}"
        ends = {"at least": self.low, "above": self.above, "at most": self.high, "below": self.below}
        return "be " + " and ".join(f"{word} {end:g}" for word, end in ends.items() if math.isfinite(end))

    def clipped(self, value: float, inside: float) -> float:
        """Return a value, moved to the end of the range if it is outside.

        If the end does not belong to the range, a thousandth of the distance to the value ``inside`` remains.
        """
        value = min(max(value, self.low), self.high)
        if value <= self.above:
            return self.above + _OPEN_END_DISTANCE * (inside - self.above)
        if value >= self.below:
            return self.below - _OPEN_END_DISTANCE * (self.below - inside)
        return value


def counted(name: str, number: Any, most: int | None = None, least: int = 1) -> int:
    """Return a whole number from ``least`` to ``most``.

    Raises
    ------
    ValueError
        If the number is not whole or outside the limits.
    """
    if isinstance(number, bool) or not isinstance(number, Integral) or int(number) < least:
        raise ValueError(f"{name} = {quoted(number)} must be a whole number of at least {least}")
    if most is not None and int(number) > most:
        text = f"{int(number):,}" if number < 10**15 else quoted(int(number))
        raise ValueError(f"{name} = {text} is more than {most:,}, which is the most there can be")
    return int(number)


ANY = Range()


NOT_NEGATIVE = Range(low=0)


POSITIVE = Range(above=0)


def checked(owner: str, name: str, value: Any, allowed: Range = ANY) -> None:
    """Raise an error for a value that is no finite number or is outside a range.

    Raises
    ------
    ValueError
        If it is not finite or not allowed.
    """
    if type(value) is float and -math.inf < value < math.inf and value in allowed:  # the usual case
        return
    if isinstance(value, bool) or not isinstance(value, Real) or not _is_finite(value):
        raise ValueError(f"{owner}: {name} = {quoted(value)} must be a finite number")
    if float(value) not in allowed:
        raise ValueError(f"{owner}: {name} = {value} must {allowed}")


def _is_finite(value: Real) -> bool:
    """Return whether a number is finite as a float."""
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number above the largest float
        return False
