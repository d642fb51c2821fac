"""Periodic motions by harmonic balance: residual, exact contact, stability, special points."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.harmonic.autonomous.backbone import BackboneProblem
    from hbgear.harmonic.autonomous.equilibrium import EquilibriumProblem
    from hbgear.harmonic.autonomous.limit_cycle import LimitCycleProblem
    from hbgear.harmonic.autonomous.tori.problem import TorusProblem
    from hbgear.harmonic.autonomous.tori.two_tones import TwoToneProblem
    from hbgear.harmonic.bifurcations.extremum import AmplitudeExtremum
    from hbgear.harmonic.bifurcations.grazing import GrazingProblem
    from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem
    from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
    from hbgear.harmonic.contact_instants.problem import ContactInstants
    from hbgear.harmonic.harmonic_balance import HarmonicBalance
    from hbgear.mechanics.series.measures import register_measure

__all__ = [
    "AmplitudeExtremum",
    "BackboneProblem",
    "ContactInstants",
    "EquilibriumProblem",
    "GrazingProblem",
    "HarmonicBalance",
    "LimitCycleProblem",
    "NeimarkSackerProblem",
    "PeriodDoublingProblem",
    "TorusProblem",
    "TwoToneProblem",
    "register_measure",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
