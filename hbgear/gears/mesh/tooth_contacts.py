"""Contacts of a mesh from the stiffness and the gap of one pair of teeth over its path of contact.

    pair p exists for 0 < u < length,   u = tau / (2 pi) - p - begin,   k_p = stiffness(u),   gap_p = gap(u) + error_p

Every pair of teeth has the same functions, delayed by its number p. A periodic law holds a finite number of contacts:
the path is divided into the fewest equal sections shorter than a mesh period, and one contact follows the pairs on each
section in turn. Its stiffness is zero between two pairs. Its level is continued there by a line, so that it is
continuous; this value has no effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil
from typing import NamedTuple, Self

import numpy as np

from hbgear.common.arrays import Array
from hbgear.gears.drawing.tooth_errors import GapWave
from hbgear.gears.mesh.mesh_cycle import fit_cubics
from hbgear.mechanics.laws.mesh_contacts import MeshContacts, ToothContact
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Periodic, Phased
from hbgear.mechanics.series.piecewise_polynomial import TURN, shift_origin

ROUNDING = 1e-9
"""Length [mesh periods] that is attributed to rounding."""

WAVE_STEP = 0.02
"""Longest cubic of a sinusoidal gap, over its period [-]. The largest error is (2 pi h)^4 / 384 of the amplitude for
the step h: 6.5e-7."""


class PathFunction(NamedTuple):
    """Piecewise polynomials over the path of contact.

    Attributes
    ----------
    nodes : ndarray, shape (P + 1,)
        Beginnings of the segments and the end of the path [mesh periods].
    rows : ndarray, shape (P, D + 1)
        Coefficients of the polynomials in the distance from the beginning of the segment; D is at most 3.
    """

    nodes: Array
    rows: Array

    @classmethod
    def linear(cls, nodes: Array, values: Array) -> Self:
        """Return the function that is linear between values at nodes."""
        nodes, values = np.asarray(nodes, dtype=float), np.asarray(values, dtype=float)
        return cls(nodes, np.column_stack([values[:-1], np.diff(values) / np.diff(nodes)]))

    @classmethod
    def fitted(cls, nodes: Sequence[Array], values: Sequence[Array], tolerance: float) -> Self:
        """Return cubics through the values of each section with the fewest segments that keep the fit error."""
        segments: list[tuple[float, list[float]]] = []
        for x, y in zip(nodes, values, strict=True):
            fit_cubics(x, y, 0, len(x) - 1, tolerance, segments)
        rows = np.zeros((len(segments), max(len(row) for _, row in segments)))
        for row, (_, coefficients) in zip(rows, segments, strict=True):
            row[: len(coefficients)] = coefficients
        return cls(np.array([*(begin for begin, _ in segments), nodes[-1][-1]]), rows)

    @property
    def length(self) -> float:
        """Length of the path [mesh periods]."""
        return float(self.nodes[-1])

    def at(self, u: Array) -> Array:
        """Return the values at positions; beyond the ends of the path, the value at the end."""
        v = np.clip(u, self.nodes[0], self.nodes[-1])
        piece = np.clip(np.searchsorted(self.nodes, v, side="right") - 1, 0, len(self.rows) - 1)
        y, out = v - self.nodes[piece], np.zeros_like(v)
        for column in self.rows.T[::-1]:
            out = out * y + column[piece]
        return out

    def section(self, first: float, last: float) -> Self:
        """Return the function between two positions, whose distances are from the beginning of the path."""
        inner = self.nodes[(self.nodes > first + ROUNDING) & (self.nodes < last - ROUNDING)]
        nodes = np.concatenate([[first], inner, [last]])
        piece = np.searchsorted(self.nodes, 0.5 * (nodes[1:] + nodes[:-1]), side="right") - 1
        return type(self)(nodes, shift_origin(self.rows[piece], nodes[:-1] - self.nodes[piece]))

    def mirrored(self, centre: float) -> Self:
        """Return the function of 2 centre - u; its path begins at 2 centre - length."""
        widths = np.diff(self.nodes)
        rows = shift_origin(self.rows, widths) * (-1.0) ** np.arange(self.rows.shape[1])
        return type(self)((2 * centre - self.nodes)[::-1], rows[::-1])

    def plus(self, offset: float, factor: float = 1.0) -> Self:
        """Return the function times a factor, plus an offset."""
        rows = factor * self.rows
        rows[:, 0] += offset
        return type(self)(self.nodes, rows)

    def with_wave(self, wave: GapWave, time: float) -> Self:
        """Return the function plus cubics that interpolate a wave, whose time at u = 0 is given, with its slopes."""
        w, longest = TURN / wave.meshes, WAVE_STEP * wave.meshes
        cuts = [np.linspace(a, b, ceil((b - a) / longest) + 1)[:-1] for a, b in pairwise(self.nodes.tolist())]
        nodes = np.concatenate([*cuts, self.nodes[-1:]])
        base = self.section(float(nodes[0]), float(nodes[-1]))
        piece = np.searchsorted(base.nodes, 0.5 * (nodes[1:] + nodes[:-1]), side="right") - 1
        rows = np.zeros((len(piece), 4))
        rows[:, : base.rows.shape[1]] = shift_origin(base.rows[piece], nodes[:-1] - base.nodes[piece])
        angle, h = w * (nodes + time) + wave.phase, np.diff(nodes)
        y, slope = wave.amplitude * np.sin(angle), wave.amplitude * w * np.cos(angle)
        mean = np.diff(y) / h
        rows[:, 0] += y[:-1]
        rows[:, 1] += slope[:-1]
        rows[:, 2] += (3 * mean - 2 * slope[:-1] - slope[1:]) / h
        rows[:, 3] += (slope[:-1] + slope[1:] - 2 * mean) / h**2
        return type(self)(nodes, rows)


@dataclass(frozen=True, eq=False)
class Flank:
    """One flank of a pair of teeth, or of a slice of it.

    Attributes
    ----------
    side : {1, -1}
        +1 for the driving flank, -1 for the back flank.
    stiffness, gap : PathFunction
        Contact stiffness [force / length] and initial gap [length] over the path; both have the same path, which begins
        at the first node.
    half_backlash : float
        Displacement at which teeth without initial gap touch [length].
    lag : float
        Delay of the contact [mesh periods].
    errors : mapping of int to float
        Gaps [length] that are added for single pairs, by the number of the pair.
    waves : tuple of GapWave
        Gaps that are added for all pairs, sinusoids of the time in mesh periods.
    """

    side: int
    stiffness: PathFunction
    gap: PathFunction
    half_backlash: float = 0.0
    lag: float = 0.0
    errors: Mapping[int, float] = field(default_factory=dict)
    waves: tuple[GapWave, ...] = ()

    def scaled(self, stiffness: float, length: float) -> Flank:
        """Return the flank with its stiffness and its gaps times factors."""
        return Flank(
            self.side,
            self.stiffness.plus(0.0, stiffness),
            self.gap.plus(0.0, length),
            length * self.half_backlash,
            self.lag,
            {p: length * error for p, error in self.errors.items()},
            tuple(wave._replace(amplitude=length * wave.amplitude) for wave in self.waves),
        )

    def added_gap(self, pair: int, t: Array) -> Array:
        """Return the gap by errors of a pair and by waves at times in mesh periods."""
        waves = (wave.amplitude * np.sin(TURN * t / wave.meshes + wave.phase) for wave in self.waves)
        return sum(waves, np.full(np.shape(t), self.errors.get(pair, 0.0)))

    def contacts(self, meshes: int) -> list[ToothContact]:
        """Return the contacts that follow the pairs of teeth over a period of some meshes."""
        levels = [
            _periodic([self._level(p).section(a, b) for p in range(meshes)], self.lag, True) for a, b in self._sections
        ]
        stiffness = self.over_period(self.stiffness, meshes)
        return [ToothContact(k, level, self.side) for k, level in zip(stiffness, levels, strict=True)]

    def over_period(self, function: PathFunction, meshes: int = 1) -> list[Phased]:
        """Return a function over the path as one function of the phase for each contact, zero between pairs."""
        return [_periodic([function.section(a, b)] * meshes, self.lag, False) for a, b in self._sections]

    @property
    def _sections(self) -> list[tuple[float, float]]:
        """Ends of the sections of the path that one contact follows."""
        first, last = float(self.stiffness.nodes[0]), self.stiffness.length
        count = ceil(last - first - ROUNDING)
        count += (last - first) / count > 1.0 - ROUNDING
        ends = first + (last - first) * np.arange(count + 1) / count
        return list(pairwise(ends.tolist()))

    def _level(self, pair: int) -> PathFunction:
        """Return the displacement at which the gap of a pair closes."""
        gap = self.gap
        for wave in self.waves:
            gap = gap.with_wave(wave, pair + self.lag)
        return gap.plus(self.side * (self.half_backlash + self.errors.get(pair, 0.0)), self.side)


def mesh_contacts(flanks: Sequence[Flank], meshes: int = 1) -> MeshContacts:
    """Return the law of a mesh from both flanks of all slices, over a period of a number of meshes.

    The period is longer than one mesh for errors of single pairs of teeth.
    """
    return MeshContacts(tuple(contact for flank in flanks for contact in flank.contacts(meshes)), meshes=meshes)


def _periodic(sections: Sequence[PathFunction], lag: float, joined: bool) -> Phased:
    """Return a function of the phase that follows one section after the other, one in each mesh period.

    Between sections it is zero, or if ``joined`` the line from the end of one to the beginning of the next.
    """
    meshes, scale = len(sections), TURN / len(sections)
    phases, rows = [], []
    for p, (section, after) in enumerate(zip(sections, [*sections[1:], sections[0]], strict=True)):
        width = 1.0 - (section.nodes[-1] - section.nodes[0])
        end = float(np.polynomial.polynomial.polyval(section.nodes[-1] - section.nodes[-2], section.rows[-1]))
        slope = (float(after.rows[0, 0]) - end) / width
        phases += [*(section.nodes + p + lag)]
        rows += [*section.rows.tolist(), [end, slope] if joined else [0.0]]
    values = np.array([row[0] for row in rows])
    if joined and np.ptp(values) <= ROUNDING * np.abs(values).max() and all(not any(row[1:]) for row in rows):
        return Series(float(values[0]))
    begin = np.mod(phases, meshes)
    order = np.argsort(begin, kind="stable")
    return Periodic(
        tuple((scale * begin[order]).tolist()), tuple(tuple(x / scale**q for q, x in enumerate(rows[i])) for i in order)
    )
