"""The order of contact instants in a period, and the contacts between them.

A motion passes *switches* in the order of their phases: a gap crosses a breakpoint of its law, or a section of the
period begins (see `equations`). Segment i lies between switch i and the next one; the last segment ends with the first
switch of the next period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import Contacts, Equations
from hbgear.mechanics.series.piecewise_polynomial import TURN

Visit = tuple[int, int]
"""Numbers of two switches of an element that follow each other, and the time between them."""


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

    @cached_property
    def visits(self) -> tuple[Visit, ...]:
        """First and last switch of each visit of a gap beyond a breakpoint.

        Switches of other elements may lie between them. If a gap alternates between both sides of a breakpoint, the
        visits of either side are included.
        """
        return tuple(
            (i, group[(n + 1) % len(group)])
            for i, group, n in self._switch_groups()
            if self.switches[i].opposite(self.switches[group[(n + 1) % len(group)]])
        )

    @cached_property
    def visit_ends(self) -> Array:
        """First and last switch (V, 2) of each visit."""
        return np.array(self.visits, dtype=np.int64).reshape(-1, 2)

    @cached_property
    def sections(self) -> list[int]:
        """Section (K,) of each segment."""
        return [contacts.section for contacts in self.contacts]

    @cached_property
    def free(self) -> Array:
        """Whether the phase of each switch (K,) is unknown."""
        return np.array([not switch.is_fixed for switch in self.switches], dtype=bool)

    @cached_property
    def free_count(self) -> int:
        """Number of unknown phases."""
        return int(self.free.sum())

    @cached_property
    def columns(self) -> Array:
        """Number (K,) of the phase of each switch among the unknown phases; -1 where it is prescribed."""
        return np.where(self.free, np.cumsum(self.free) - 1, -1)

    @cached_property
    def divisible_visits(self) -> Array:
        """Visits without a fixed switch, each with the intervals of its gap before and after it (V, 3, 2)."""
        positions = {i: (group, n) for i, group, n in self._switch_groups()}
        visits = []
        for i, j in self.visits:
            if not any(self.switches[k].is_fixed for k in self.segments_between(i, j)[1:]):
                group, n = positions[i]
                visits.append(((i, j), (group[n - 1], i), (j, group[(n + 2) % len(group)])))
        return np.array(visits, dtype=np.int64).reshape(-1, 3, 2)

    def _switch_groups(self) -> list[tuple[int, list[int], int]]:
        """Return each switch with the switches of its element and its place among them."""
        groups: dict[int, list[int]] = {}
        for i, switch in enumerate(self.switches):
            groups.setdefault(switch.element, []).append(i)
        return [(i, groups[s.element], groups[s.element].index(i)) for i, s in enumerate(self.switches)]

    def segments_between(self, i: int, j: int) -> list[int]:
        """Return the segments from switch i to switch j."""
        return [(i + step) % self.count for step in range((j - i) % self.count)]

    def without(self, visits: Sequence[Visit]) -> Pattern:
        """Return the pattern without the first and last switches of some visits."""
        levels = list(self.contacts[-1].levels)
        for i, j in visits:
            if i > j:  # the visit includes the begin of the period
                element = self.switches[j].element
                levels[element] = self.contacts[j].levels[element]
        removed = {switch for visit in visits for switch in visit}
        retained = [switch for k, switch in enumerate(self.switches) if k not in removed]
        return Pattern.of(retained, levels, self.contacts[-1].section)

    def swapped(self, i: int) -> Pattern:
        """Return the pattern with switch i after the one that follows it."""
        switches, j = list(self.switches), (i + 1) % self.count
        switches[i], switches[j] = switches[j], switches[i]
        return Pattern.of(switches, self.contacts[-1].levels, self.contacts[-1].section)


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
