"""The order of contact instants in a period, and the contacts between them.

A motion passes *switches*, ascending in the phase: a gap crosses a breakpoint of its law, or a section of the period
ends (see `equations`). Segment i lies between switch i and the next one; the last reaches to the first of the next
period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hbgear.harmonic.instants.equations import Contacts, Equations
from hbgear.mechanics.series.periodic import TURN


class Switch(NamedTuple):
    """Gap of an element crosses its breakpoint number ``corner``, upwards (+1) or downwards (-1).

    element -1 : section number ``corner`` begins, at a fixed phase.
    """

    element: int
    corner: int
    sign: int

    @property
    def is_fixed(self) -> bool:
        """Whether its phase is prescribed."""
        return self.element < 0

    def opposite(self, other: Switch) -> bool:
        """Whether both cross the same breakpoint in opposite directions."""
        return not self.is_fixed and self[:2] == other[:2] and self.sign == -other.sign


class Inconsistent(ValueError):
    """The switches do not follow each other: a gap would cross a breakpoint that it is not next to."""


@dataclass(frozen=True)
class Pattern:
    """Switches in their order, and the contacts in the segment after each of them."""

    switches: tuple[Switch, ...]
    contacts: tuple[Contacts, ...]

    @staticmethod
    def of(switches: Sequence[Switch], levels: Sequence[int], section: int) -> Pattern:
        """From the contacts in the segment that ends with the first switch.

        Raises
        ------
        Inconsistent
            If a gap would cross a breakpoint that it is not next to, or does not return within the period.
        """
        now, contacts = list(levels), []
        for switch in switches:
            if switch.is_fixed:
                section = switch.corner
            else:
                before = switch.corner if switch.sign > 0 else switch.corner + 1
                if now[switch.element] != before:
                    raise Inconsistent(f"element {switch.element + 1} is not next to its breakpoint")
                now[switch.element] += switch.sign
            contacts.append(Contacts(section, tuple(now)))
        if contacts and now != list(levels):
            raise Inconsistent("the contacts do not return within the period")
        return Pattern(tuple(switches), tuple(contacts))

    @property
    def count(self) -> int:
        """Number of switches, and of segments."""
        return len(self.switches)

    def without(self, i: int) -> Pattern:
        """Without switch i and the one after it, which are opposite."""
        gone = {i, (i + 1) % self.count}
        return self._changed([s for j, s in enumerate(self.switches) if j not in gone], i in (self.count - 1,))

    def swapped(self, i: int) -> Pattern:
        """With switch i after the one that follows it."""
        some, j = list(self.switches), (i + 1) % self.count
        some[i], some[j] = some[j], some[i]
        return self._changed(some, False)

    def _changed(self, switches: list[Switch], around: bool) -> Pattern:
        start = self.contacts[0] if around else self.contacts[-1]
        return Pattern.of(switches, start.levels, start.section)


def fixed_switches(equations: Equations) -> list[tuple[float, Switch]]:
    """Phases at which sections begin in nu periods of the excitation; none where there is one section only."""
    corners = any(e.law.phases or e.displacement.corners for e in equations.system.elements)
    if not corners:
        return []
    return [
        (float(start) + TURN * turn, Switch(-1, section, 0))
        for turn in range(equations.nu)
        for section, start in enumerate(equations.starts)
    ]
