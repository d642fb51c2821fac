"""hbgear: nonlinear frequency response of gear drives with backlash.

Harmonic balance with exact contact, pseudo-arclength continuation, Floquet stability, jump frequencies.
"""

TYPE_CHECKING = False  # nothing is imported here: Ctrl-C is handled by the command, which imports the rest

if TYPE_CHECKING:  # imported when they are first used
    from hbgear._version import __version__
    from hbgear.common.progress import Progress, ProgressCallback
    from hbgear.common.progress_bar import ProgressBar
    from hbgear.common.ranges import Range
    from hbgear.continuation.bordered import Fold
    from hbgear.continuation.branch import Branch, Jump, Point, SpecialPoint, Status
    from hbgear.continuation.crossing import BranchPoint
    from hbgear.continuation.events import Event
    from hbgear.continuation.extending import extend
    from hbgear.continuation.following import follow
    from hbgear.continuation.newton import NoConvergence, Settings
    from hbgear.continuation.problem import Evaluation
    from hbgear.continuation.stepsize import StepControl, Steps
    from hbgear.continuation.switching import switch
    from hbgear.continuation.tracer import trace
    from hbgear.design.band import ResponseBand, response_band
    from hbgear.design.fit import Fit, fit
    from hbgear.design.measured import Measurements
    from hbgear.design.measured_table import read_measurements
    from hbgear.design.redesign import Goal, Redesign, no_jumps, peak_below, redesign
    from hbgear.design.sampling import grid, latin_hypercube, monte_carlo, saltelli
    from hbgear.design.scatter import JumpScatter, jump_scatter
    from hbgear.design.sobol import SobolIndices, sobol_indices
    from hbgear.design.study import Cases, cases
    from hbgear.design.swept import SweepStatistics, sweep_statistics
    from hbgear.gears import (
        Beam,
        Bearing,
        DoubleHelicalPair,
        Gear,
        GearPair,
        GearRotorBearing,
        HelicalPair,
        Housing,
        Mesh,
        MeshCycle,
        PlanetarySet,
        PlanetMode,
        Shaft,
        SpurPair,
        Support,
        Table,
        Train,
        Wheel,
        iso_dynamic_factor,
    )
    from hbgear.harmonic.answers import Answers, answers
    from hbgear.harmonic.balance import HarmonicBalance
    from hbgear.harmonic.campbell import Campbell, CriticalSpeed, campbell
    from hbgear.harmonic.critical import Critical, NoFold, critical
    from hbgear.harmonic.dynamic_factor import dynamic_factor
    from hbgear.harmonic.jump_map import JumpMap, jump_map
    from hbgear.harmonic.peaks import peaks
    from hbgear.harmonic.runs import Run, run
    from hbgear.harmonic.sensitivity import Sensitivity, sensitivity
    from hbgear.harmonic.sharing import Sharing, load_sharing
    from hbgear.harmonic.special import Grazing, NeimarkSacker, Peak, PeriodDoubling
    from hbgear.harmonic.survey import Survey, trace_all
    from hbgear.io.bridges import from_opentorsion, from_ross
    from hbgear.io.matrices import Matrices, from_matrices
    from hbgear.io.mesh_table import read_table
    from hbgear.io.npz import load
    from hbgear.io.receptance_files import from_receptances
    from hbgear.mechanics.compiled_law import CompiledLaw
    from hbgear.mechanics.doubts import Unlikely
    from hbgear.mechanics.fourier import Series
    from hbgear.mechanics.functions import model
    from hbgear.mechanics.laws import Backlash, Cubic, Law, Parallel, PiecewiseLinear, Unilateral
    from hbgear.mechanics.model import Element, Load, Model, Reaction, System
    from hbgear.mechanics.oscillators import Duffing
    from hbgear.mechanics.periodic import Periodic
    from hbgear.mechanics.receptances import Receptances
    from hbgear.mechanics.reduction import Reduction, reduce
    from hbgear.mechanics.speed import MatrixTable, SpeedTerms
    from hbgear.timedomain.basins import basins
    from hbgear.timedomain.integrate import integrate
    from hbgear.timedomain.opinion import Opinion, second_opinion
    from hbgear.timedomain.shooting import shoot
    from hbgear.timedomain.sweep import sweep
    from hbgear.timedomain.validate import validate
    from hbgear.web import report

__all__ = [
    "Answers",
    "Backlash",
    "Beam",
    "Bearing",
    "Branch",
    "BranchPoint",
    "Campbell",
    "Cases",
    "CompiledLaw",
    "Critical",
    "CriticalSpeed",
    "Cubic",
    "DoubleHelicalPair",
    "Duffing",
    "Element",
    "Evaluation",
    "Event",
    "Fit",
    "Fold",
    "Gear",
    "GearPair",
    "GearRotorBearing",
    "Goal",
    "Grazing",
    "HarmonicBalance",
    "HelicalPair",
    "Housing",
    "Jump",
    "JumpMap",
    "JumpScatter",
    "Law",
    "Load",
    "Matrices",
    "MatrixTable",
    "Measurements",
    "Mesh",
    "MeshCycle",
    "Model",
    "NeimarkSacker",
    "NoConvergence",
    "NoFold",
    "Opinion",
    "Parallel",
    "Peak",
    "PeriodDoubling",
    "Periodic",
    "PiecewiseLinear",
    "PlanetMode",
    "PlanetarySet",
    "Point",
    "Progress",
    "ProgressBar",
    "ProgressCallback",
    "Range",
    "Reaction",
    "Receptances",
    "Redesign",
    "Reduction",
    "ResponseBand",
    "Run",
    "Sensitivity",
    "Series",
    "Settings",
    "Shaft",
    "Sharing",
    "SobolIndices",
    "SpecialPoint",
    "SpeedTerms",
    "SpurPair",
    "Status",
    "StepControl",
    "Steps",
    "Support",
    "Survey",
    "SweepStatistics",
    "System",
    "Table",
    "Train",
    "Unilateral",
    "Unlikely",
    "Wheel",
    "__version__",
    "answers",
    "basins",
    "campbell",
    "cases",
    "critical",
    "dynamic_factor",
    "extend",
    "fit",
    "follow",
    "from_matrices",
    "from_opentorsion",
    "from_receptances",
    "from_ross",
    "grid",
    "integrate",
    "iso_dynamic_factor",
    "jump_map",
    "jump_scatter",
    "latin_hypercube",
    "load",
    "load_sharing",
    "model",
    "monte_carlo",
    "no_jumps",
    "peak_below",
    "peaks",
    "plot",
    "read_measurements",
    "read_table",
    "redesign",
    "reduce",
    "report",
    "response_band",
    "run",
    "saltelli",
    "second_opinion",
    "sensitivity",
    "shoot",
    "sobol_indices",
    "sweep",
    "sweep_statistics",
    "switch",
    "trace",
    "trace_all",
    "validate",
]


_MOVED = {"plot_cases": "hbgear.plot.study", "plot_time": "hbgear.plot.simulation"}

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """What is asked for by its name, imported now."""
        if name in _MOVED:
            import importlib
            import warnings

            warnings.warn(f"hbgear.{name} is now part of hbgear.plot", DeprecationWarning, stacklevel=2)
            return importlib.import_module(_MOVED[name])
        from hbgear.common import late

        return late.attached(__name__)[0](name)

    def __dir__() -> list[str]:
        """All names, and the packages in it."""
        from hbgear.common import late

        return late.attached(__name__)[1]()
