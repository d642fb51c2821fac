"""Nonlinear frequency response of gear drives with backlash.

Harmonic balance with exact contact (AFT for other laws), pseudo-arclength continuation, Floquet stability, jump
frequencies. ``hbgear`` holds the names that a first script needs; the others are in its sub-modules:

| sub-module | contents |
|---|---|
| `hbgear.mechanics` | structures, elements, force laws, loads, series, reduction |
| `hbgear.gears` | gears, pairs, trains, planetary sets, mesh stiffness |
| `hbgear.continuation`, `hbgear.harmonic` | problems, and the equations of special points |
| `hbgear.analysis` | jump maps, critical parameters, sensitivities, Campbell diagrams, run-ups |
| `hbgear.design` | many designs, fits, redesign, tolerances |
| `hbgear.time` | time integration: validation, sweeps, basins |
| `hbgear.io`, `hbgear.plot` | files and figures |
"""

TYPE_CHECKING = False  # nothing is imported here: Ctrl-C is handled by the command, which imports the rest

if TYPE_CHECKING:  # imported when they are first used
    from hbgear import analysis, continuation, design, gears, harmonic, io, mechanics, plot, time
    from hbgear._version import __version__
    from hbgear.analysis.branch_search.multistart import trace_all
    from hbgear.analysis.jump_maps import jump_map
    from hbgear.common.process.progress_bar import ProgressBar
    from hbgear.continuation.events.event import Event
    from hbgear.continuation.extend import extend
    from hbgear.continuation.follow import follow
    from hbgear.continuation.results.branch import Branch
    from hbgear.continuation.results.point import Jump, Point, SpecialPoint
    from hbgear.continuation.results.status import Status
    from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence
    from hbgear.continuation.stepping.control import StepControl
    from hbgear.continuation.switch import switch
    from hbgear.continuation.tracing.trace import trace
    from hbgear.gears.drawing.pair import GearPair
    from hbgear.gears.pairs.spur import SpurPair
    from hbgear.harmonic.contact_instants.problem import ContactInstants
    from hbgear.harmonic.harmonic_balance import HarmonicBalance
    from hbgear.io.branches.npz import load, save
    from hbgear.mechanics.laws.laws import Backlash, Cubic, Unilateral
    from hbgear.mechanics.models import System
    from hbgear.mechanics.oscillators import Duffing
    from hbgear.mechanics.structures.elements import Element, Load
    from hbgear.time.validation.validate import validate
    from hbgear.web import report

__all__ = [
    "Backlash",
    "Branch",
    "ContactInstants",
    "Cubic",
    "Duffing",
    "Element",
    "Event",
    "GearPair",
    "HarmonicBalance",
    "Jump",
    "Load",
    "NewtonSettings",
    "NoConvergence",
    "Point",
    "ProgressBar",
    "SpecialPoint",
    "SpurPair",
    "Status",
    "StepControl",
    "System",
    "Unilateral",
    "__version__",
    "analysis",
    "continuation",
    "design",
    "extend",
    "follow",
    "gears",
    "harmonic",
    "io",
    "jump_map",
    "load",
    "mechanics",
    "plot",
    "report",
    "save",
    "switch",
    "time",
    "trace",
    "trace_all",
    "validate",
]

_MOVED = {
    "analysis": "Campbell CriticalSpeed JumpMap Sensitivity campbell dynamic_factor load_sharing peaks sensitivity",
    "continuation": "Evaluation Progress ProgressCallback",
    "design": "Cases Fit Goal Measurements Redesign ResponseBand SobolIndices SweepStatistics cases fit grid "
    "latin_hypercube monte_carlo no_jumps peak_below read_measurements redesign response_band saltelli "
    "sobol_indices sweep_statistics",
    "gears": "Beam Bearing DoubleHelicalPair Gear GearRotorBearing HelicalPair Housing Mesh MeshCycle PlanetMode "
    "PlanetarySet Shaft Support Train Wheel iso_dynamic_factor",
    "io": "Matrices from_matrices from_opentorsion from_receptances from_ross",
    "mechanics": "CompiledLaw Law MatrixTable Model Parallel Periodic PiecewiseLinear Range Reaction Receptances "
    "Reduction Series SpeedTerms model reduce",
    "time": "basins integrate shoot sweep",
}
"""Names of version 0.2 and earlier that moved to a package."""

_DEPRECATED = {name: f"{space}.{name}" for space, names in _MOVED.items() for name in names.split()} | {
    "Answers": "analysis.MachineQuantities",
    "BranchPoint": "continuation.BranchPointProblem",
    "Critical": "analysis.CriticalParameter",
    "Fold": "continuation.FoldProblem",
    "Grazing": "harmonic.GrazingProblem",
    "JumpScatter": "design.JumpTolerance",
    "NeimarkSacker": "harmonic.NeimarkSackerProblem",
    "NoFold": "analysis.NoFoldError",
    "Opinion": "time.StabilityComparison",
    "Peak": "harmonic.AmplitudeExtremum",
    "PeriodDoubling": "harmonic.PeriodDoublingProblem",
    "Run": "analysis.RunUp",
    "Settings": "NewtonSettings",
    "Sharing": "analysis.LoadSharing",
    "Survey": "analysis.BranchSearch",
    "Table": "gears.MeshTable",
    "Unlikely": "mechanics.ImplausibleInputWarning",
    "answers": "analysis.machine_quantities",
    "critical": "analysis.critical_parameter",
    "jump_scatter": "design.jump_tolerance",
    "plot_cases": "plot",
    "plot_time": "plot",
    "read_table": "io.read_mesh_table",
    "run": "analysis.run_up",
    "second_opinion": "time.compare_multipliers",
}
"""Names of version 0.2 and earlier, and the names that replace them."""

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Return a public name, which is imported at its first use."""
        from hbgear.common import lazy_names

        found = lazy_names.attached(__name__)[0]
        if name not in _DEPRECATED:
            return found(name)
        import warnings

        space, _, new = _DEPRECATED[name].rpartition(".")
        warnings.warn(f"hbgear.{name} is deprecated: use hbgear.{_DEPRECATED[name]}", DeprecationWarning, stacklevel=2)
        return getattr(found(space), new) if space else found(new)

    def __dir__() -> list[str]:
        """Return all names, and the packages in it."""
        from hbgear.common import lazy_names

        return lazy_names.attached(__name__)[1]()
