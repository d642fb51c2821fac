"""Many designs, fits to measurements, redesign and uncertainty."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.design.fitting.fit import Fit, fit
    from hbgear.design.fitting.measurement_table import read_measurements
    from hbgear.design.fitting.measurements import Measurements
    from hbgear.design.goal_search import Goal, no_jumps, peak_below
    from hbgear.design.least_change import Redesign, redesign
    from hbgear.design.studies.case_results import Cases
    from hbgear.design.studies.samples import grid, latin_hypercube, monte_carlo, saltelli
    from hbgear.design.studies.study import cases
    from hbgear.design.studies.sweep_statistics import SweepStatistics, sweep_statistics
    from hbgear.design.uncertainty.sobol import SobolIndices, sobol_indices
    from hbgear.design.uncertainty.tolerance import JumpTolerance, jump_tolerance
    from hbgear.design.uncertainty.uncertainty_band import ResponseBand, response_band

__all__ = [
    "Cases",
    "Fit",
    "Goal",
    "JumpTolerance",
    "Measurements",
    "Redesign",
    "ResponseBand",
    "SobolIndices",
    "SweepStatistics",
    "cases",
    "fit",
    "grid",
    "jump_tolerance",
    "latin_hypercube",
    "monte_carlo",
    "no_jumps",
    "peak_below",
    "read_measurements",
    "redesign",
    "response_band",
    "saltelli",
    "sobol_indices",
    "sweep_statistics",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
