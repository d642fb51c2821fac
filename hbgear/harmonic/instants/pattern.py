"""The order of contact instants in a period, and the contacts between them.

A motion passes *switches* in the order of their phases: a gap crosses a breakpoint of its law, or a section of the
period begins (see `equations`). Segment i lies between switch i and the next one; the last segment ends with the first
switch of the next period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hbgear.harmonic.instants.equations import Contacts, Equations
from hbgear.mechanics.series.piecewise_polynomial import TURN


class Switch(NamedTuple):
    """Gap of an element that crosses its breakpoint number ``breakpoint``, upwards (+1) or downwards (-1).

    Element -1 : section number ``breakpoint`` begins, at a fixed phase.
    """

    element: int
    breakpoint: int
    sign: int

    @property
    def is_fixed(self) -> bool:
        """Whether the phase is prescribed."""
        return self.element < 0

    def opposite(self, other: Switch) -> bool:
        """Return whether both switches cross the same breakpoint in opposite directions."""
        return not self.is_fixed and self[:2] == other[:2] and self.sign == -other.sign


class InconsistentPatternError(ValueError):
    """Switches that cannot follow each other: a gap would cross a breakpoint that is not adjacent to it."""


@dataclass(frozen=True)
class Pattern:
    """Switches in their order, and the contacts in the segment after each of them."""

    switches: tuple[Switch, ...]
    contacts: tuple[Contacts, ...]

    @staticmethod
    def of(switches: Sequence[Switch], levels: Sequence[int], section: int) -> Pattern:
        """Return a pattern from the contacts in the segment that ends with the first switch.

        Raises
        ------
        InconsistentPatternError
            If a gap would cross a breakpoint that is not adjacent to it, or does not return within the period.
        """
        current, contacts = list(levels), []
        for switch in switches:
            if switch.is_fixed:
                section = switch.breakpoint
            else:
                required = switch.breakpoint if switch.sign > 0 else switch.breakpoint + 1
                if current[switch.element] != required:
                    raise InconsistentPatternError(
                        f"element {switch.element + 1} would cross a breakpoint that is not adjacent to its gap"
                    )
                current[switch.element] += switch.sign
            contacts.append(Contacts(section, tuple(current)))
        if contacts and current != list(levels):
            raise InconsistentPatternError("the contacts do not return within the period")
        return Pattern(tuple(switches), tuple(contacts))

    @property
    def count(self) -> int:
        """Number of switches, and of segments."""
        return len(self.switches)

    def without(self, i: int) -> Pattern:
        """Return the pattern without switch i and the one after it, which are opposite."""
        removed = {i, (i + 1) % self.count}
        return self._with_switches([s for j, s in enumerate(self.switches) if j not in removed], i in (self.count - 1,))

    def swapped(self, i: int) -> Pattern:
        """Return the pattern with switch i after the one that follows it."""
        switches, j = list(self.switches), (i + 1) % self.count
        switches[i], switches[j] = switches[j], switches[i]
        return self._with_switches(switches, False)

    def _with_switches(self, switches: list[Switch], around: bool) -> Pattern:
        """Return the pattern of other switches; around : whether the last switch is among the removed ones."""
        start = self.contacts[0] if around else self.contacts[-1]
        return Pattern.of(switches, start.levels, start.section)


def fixed_switches(equations: Equations) -> list[tuple[float, Switch]]:
    """Return the phases at which sections begin in nu periods of the excitation; none if there is one section only."""
    breakpoints = any(e.law.phases or e.displacement.corners for e in equations.system.elements)
    if not breakpoints:
        return []
    return [
        (float(start) + TURN * turn, Switch(-1, section, 0))
        for turn in range(equations.nu)
        for section, start in enumerate(equations.starts)
    ]
