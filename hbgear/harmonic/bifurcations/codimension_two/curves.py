"""Points of codimension two of each kind of curve."""

from __future__ import annotations

from typing import Any

from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.events.event import Event
from hbgear.harmonic.bifurcations.codimension_two.generalised_doubling import GeneralisedDoublingEvent
from hbgear.harmonic.bifurcations.codimension_two.other_multipliers import (
    FlipOnPairEvent,
    FoldOnPairEvent,
    PairOnFlipEvent,
    PairOnFoldEvent,
    PairOnPairEvent,
    RealOnPairEvent,
    has_exponents,
)
from hbgear.harmonic.bifurcations.codimension_two.pair_resonances import (
    FourthResonanceEvent,
    PassedEndEvent,
    RealPairEvent,
    ThirdResonanceEvent,
)
from hbgear.harmonic.bifurcations.codimension_two.resonances import (
    FirstResonanceEvent,
    FlipOnFoldEvent,
    FoldOnFlipEvent,
    SecondResonanceEvent,
)
from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem, PairModulusProblem
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem


def events_of_codimension_two(curve: MinimallyAugmentedProblem) -> tuple[Event, ...]:
    """Return the events along a curve of special points of a harmonic balance, besides cusps and branch points.

    There are none for other curves, and structures without modes. Some kinds need laws whose slopes are known.
    """
    balance: Any = curve.problem
    structure, known_slopes = balance.compiled({}).structure, has_exponents(balance)
    if structure.modes is None and not structure.depends_on_speed:
        return ()
    several = 2 * structure.n if structure.modes is None else len(structure.modes.poles)
    if isinstance(curve, NeimarkSackerProblem | PairModulusProblem):
        return ThirdResonanceEvent(), FourthResonanceEvent(), *_others_on_pairs(curve, several), *_ends(curve)
    if isinstance(curve, PeriodDoublingProblem):
        on_flips = (SecondResonanceEvent(), FoldOnFlipEvent(), GeneralisedDoublingEvent()) if known_slopes else ()
        return *on_flips, *((PairOnFlipEvent(),) if several > 2 else ())
    if isinstance(curve, FoldProblem):
        on_folds = (FirstResonanceEvent(), FlipOnFoldEvent()) if known_slopes else ()
        return *on_folds, *((PairOnFoldEvent(),) if several > 2 else ())
    return ()


def _others_on_pairs(curve: MinimallyAugmentedProblem, several: int) -> tuple[Event, ...]:
    """Return the events of other multipliers on a curve of Neimark-Sacker points of a motion with many multipliers."""
    smooth: Any = curve.problem.smooth
    real: tuple[Event, ...] = (FoldOnPairEvent(), FlipOnPairEvent())
    if not smooth:
        real = RealOnPairEvent(FoldOnPairEvent, 1), RealOnPairEvent(FlipOnPairEvent, -1)
    return *(real if several > 2 else ()), *((PairOnPairEvent(),) if several > 3 else ())


def _ends(curve: MinimallyAugmentedProblem) -> tuple[Event, ...]:
    """Return the events at which a curve of Neimark-Sacker points ends."""
    end = RealPairEvent if isinstance(curve, NeimarkSackerProblem) else PassedEndEvent
    return end(FirstResonanceEvent, FoldProblem), end(SecondResonanceEvent, PeriodDoublingProblem)
