"""Which values a parameter may have.

low <= value <= high,   above < value < below
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from hbgear.common.text.messages import quoted

_INSIDE = 1e-3  # how far from an end that does not belong to the range searches stop, as a share of the way to it


@dataclass(frozen=True)
class Range:
    """An interval of numbers: ``Range(low=0)`` not negative, ``Range(above=0)`` positive, ``Range()`` any number.

    Parameters
    ----------
    low, high : ends that belong to it.
    above, below : ends that do not.

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
        """What a value must be or do, to follow "must"."""
        if self == Range(low=0):
            return "not be negative"
        if self == Range(above=0):
            return "be positive"
        if math.isfinite(self.above) and math.isfinite(self.below):
            return f"lie between {self.above:g} and {self.below:g}"
        ends = {"at least": self.low, "above": self.above, "at most": self.high, "below": self.below}
        return "be " + " and ".join(f"{word} {end:g}" for word, end in ends.items() if math.isfinite(end))

    def clipped(self, value: float, inside: float) -> float:
        """The value, or where it lies outside the last one of the range on the way to it from a value inside.

        An end that does not belong to the range is approached to a thousandth of the way.
        """
        value = min(max(value, self.low), self.high)
        if value <= self.above:
            return self.above + _INSIDE * (inside - self.above)
        if value >= self.below:
            return self.below - _INSIDE * (self.below - inside)
        return value


def counted(name: str, number: Any, most: int | None = None, least: int = 1) -> int:
    """A whole number from ``least`` to ``most``.

    Raises
    ------
    ValueError
    """
    if isinstance(number, bool) or not isinstance(number, Integral) or int(number) < least:
        raise ValueError(f"{name} = {quoted(number)} must be a whole number of at least {least}")
    if most is not None and int(number) > most:
        told = f"{int(number):,}" if number < 10**15 else quoted(int(number))
        raise ValueError(f"{name} = {told} is more than {most:,}, which is the most there can be")
    return int(number)


ANY = Range()


NOT_NEGATIVE = Range(low=0)


POSITIVE = Range(above=0)


def checked(owner: str, name: str, value: Any, allowed: Range = ANY) -> None:
    """Refuse what is no finite number, or a number outside a range.

    Raises
    ------
    ValueError
    """
    if type(value) is float and -math.inf < value < math.inf and value in allowed:  # the usual case, and the quickest
        return
    if isinstance(value, bool) or not isinstance(value, Real) or not _is_finite(value):
        raise ValueError(f"{owner}: {name} = {quoted(value)} must be a finite number")
    if float(value) not in allowed:
        raise ValueError(f"{owner}: {name} = {value} must {allowed}")


def _is_finite(value: Real) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond every float
        return False
