"""Events of periodic motions: their registry and the built-in kinds of special points.

PD, NS, EP  changes of stability and ends of subharmonic branches, see `multiplier_events`
GR          an extremum of an element grazes a breakpoint of its law, see `grazing`
SL          a friction slider begins to slip, see `slip`
PK          a peak of an amplitude, see `peaks`
"""

from __future__ import annotations

from dataclasses import replace

from hbgear.continuation.events.event import Event
from hbgear.continuation.events.fold import CuspEvent, FoldEvent, IsolaCentreEvent
from hbgear.continuation.events.registry import EVENTS, RegisteredEvent
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.point import SpecialPoint
from hbgear.harmonic.bifurcations.codimension_two.generalised_doubling import GeneralisedDoublingEvent
from hbgear.harmonic.bifurcations.codimension_two.other_multipliers import (
    PairOnFlipEvent,
    PairOnFoldEvent,
    PairOnPairEvent,
)
from hbgear.harmonic.bifurcations.codimension_two.pair_resonances import FourthResonanceEvent, ThirdResonanceEvent
from hbgear.harmonic.bifurcations.codimension_two.resonances import (
    FirstResonanceEvent,
    FlipOnFoldEvent,
    SecondResonanceEvent,
)
from hbgear.harmonic.bifurcations.grazing import GrazingEvent
from hbgear.harmonic.bifurcations.multiplier_events import (
    MotionBranchPointEvent,
    NeimarkSackerEvent,
    PeriodDoublingEvent,
    PeriodDoublingMergeEvent,
)
from hbgear.harmonic.bifurcations.peaks import TracedPeakEvent
from hbgear.harmonic.bifurcations.slip import SlipEvent
from hbgear.harmonic.equations.layout import Layout


def motion_events(nu: int, sliders: bool) -> tuple[Event, ...]:
    """Return the events of periodic motions of subharmonic order nu, in addition to folds."""
    ends = (PeriodDoublingMergeEvent(),) if nu > 1 else ()
    slips = (SlipEvent(),) if sliders else ()
    return MotionBranchPointEvent(), PeriodDoublingEvent(), NeimarkSackerEvent(), GrazingEvent(), *slips, *ends


def _has_peaks(problem: ContinuationProblem, parameter: str) -> bool:
    """Return whether amplitude peaks can be located on curves of a problem: response curves of periodic motions."""
    return isinstance(problem.layout, Layout) and not problem.unknown_parameters


EVENTS.update(
    (event.kind, RegisteredEvent(event.kind, event, event.meaning, True, __name__))
    for event in (
        FoldEvent,
        PeriodDoublingEvent,
        NeimarkSackerEvent,
        MotionBranchPointEvent,
        GrazingEvent,
        SlipEvent,
        CuspEvent,
        IsolaCentreEvent,
        FirstResonanceEvent,
        SecondResonanceEvent,
        ThirdResonanceEvent,
        FourthResonanceEvent,
        FlipOnFoldEvent,
        PairOnFoldEvent,
        PairOnFlipEvent,
        PairOnPairEvent,
        GeneralisedDoublingEvent,
        PeriodDoublingMergeEvent,
    )
)
EVENTS["PK"] = RegisteredEvent("PK", TracedPeakEvent, TracedPeakEvent.meaning, False, __name__, _has_peaks)

KINDS: dict[str, Event] = {name: entry.create() for name, entry in EVENTS.items() if entry.origin == __name__}
"""All built-in kinds of special points, in the order of legends."""


def named(point: SpecialPoint) -> SpecialPoint:
    """Return the point with its meaning and marker, which old files do not contain."""
    if point.meaning and point.marker:
        return point
    event = KINDS.get(point.kind)
    meaning, marker = (event.meaning, event.marker) if event else (point.kind, Event.marker)
    return replace(point, meaning=point.meaning or meaning, marker=point.marker or marker)
