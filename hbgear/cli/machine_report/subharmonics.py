"""Motions of twice the mesh period, which begin at period doublings of a curve."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from threading import Event
from typing import NamedTuple

import numpy as np

import hbgear as hb
from hbgear.cli.machine_report.assumptions import LONG_STEPS, largest_of, until
from hbgear.cli.machine_report.speed_ranges import Ranges, merged, numbers_text, scales_of
from hbgear.cli.machine_report.speeds import number_or_dash
from hbgear.cli.output import print_table

SAME_SPEED = 1e-4
"""Difference of Omega [-] below which a curve of twice the period ends at a period doubling."""


PARAMETRIC_SPAN = 2.4
"""Omega up to which period doublings are searched: those of the parametric resonance lie near 2."""


class Subharmonic(NamedTuple):
    """Motions of twice the mesh period on one curve.

    Attributes
    ----------
    begin : float
        Speed of the pinion at which they begin [r/min].
    ranges : list of tuple of int
        Ranges of the speed in which they are stable, rounded [r/min].
    factor : float
        Largest dynamic factor of the stable ones.
    """

    begin: float
    ranges: Ranges
    factor: float


def subharmonics(model: hb.mechanics.Model, curve: hb.Branch, count: int, stop: Event) -> list[Subharmonic]:
    """Return the subharmonic motions that begin on a curve, the others of its span, and the curve above the span."""
    span, top = (float(curve.values.min()), PARAMETRIC_SPAN), float(curve.values.max())
    curves = curve.curves if top >= PARAMETRIC_SPAN else (_parametric_curve(model, count, top), *curve.curves)
    return [found for branch in curves for found in _from_curve(model, branch, span, stop)]


def show_subharmonics(motions: Sequence[Subharmonic]) -> None:
    """Print the table of subharmonic motions, if there are any."""
    if motions:
        headers = ["begins at", "stable at pinion r/min", "largest dynamic factor"]
        rows = [[f"{x.begin:.0f} r/min", numbers_text(x.ranges), number_or_dash(x.factor)] for x in motions]
        print_table(headers, rows, "other motions of twice the mesh period, which may be reached instead")


def _parametric_curve(model: hb.mechanics.Model, count: int, top: float) -> hb.Branch:
    """Return the curve above the traced span, in which the period doublings of the parametric resonance lie."""
    # no loss of contact there is usual
    with warnings.catch_warnings(action="ignore", category=hb.mechanics.ImplausibleInputWarning):
        span = (PARAMETRIC_SPAN, top)
        return hb.trace(hb.HarmonicBalance(model, count), "Omega", span, steps=LONG_STEPS, accuracy=None)


def _from_curve(
    model: hb.mechanics.Model, curve: hb.Branch, span: tuple[float, float], stop: Event
) -> Iterator[Subharmonic]:
    """Yield the subharmonic motions that begin on a curve and are stable somewhere.

    A curve of them that ends at another period doubling is traced once.
    """
    scales, ends = scales_of(model), list[float]()
    for point in curve.special:
        if point.kind != "PD" or any(abs(end - point.parameters["Omega"]) < SAME_SPEED for end in ends):
            continue
        doubled = hb.switch(
            curve, point.label, span, steps=LONG_STEPS, special=False, accuracy=None, progress=until(stop)
        )
        ends.append(float(doubled.values[-1]))
        stable = np.zeros(len(doubled), dtype=bool) if doubled.stable is None else doubled.stable.astype(bool)
        rpm = scales.pinion_speed(doubled.values)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], stable, [False]]).astype(int)))
        ranges = merged(
            (min(rpm[a], rpm[b - 1]), max(rpm[a], rpm[b - 1]))
            for a, b in zip(edges[::2], edges[1::2], strict=True)
            if b - a > 1
        )
        if not ranges:
            continue
        factor = largest_of(model, [(doubled, int(i)) for i in np.flatnonzero(stable)])
        begin = float(scales.pinion_speed(point.parameters["Omega"]))
        yield Subharmonic(begin, [(round(low), round(high)) for low, high in ranges], factor)
