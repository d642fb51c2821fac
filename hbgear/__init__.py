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

_DEPRECATED = {
    "Answers": "analysis.MachineQuantities",
    "Beam": "gears.Beam",
    "Bearing": "gears.Bearing",
    "BranchPoint": "continuation.BranchPointProblem",
    "Campbell": "analysis.Campbell",
    "Cases": "design.Cases",
    "CompiledLaw": "mechanics.CompiledLaw",
    "Critical": "analysis.CriticalParameter",
    "CriticalSpeed": "analysis.CriticalSpeed",
    "DoubleHelicalPair": "gears.DoubleHelicalPair",
    "Evaluation": "continuation.Evaluation",
    "Fit": "design.Fit",
    "Fold": "continuation.FoldProblem",
    "Gear": "gears.Gear",
    "GearRotorBearing": "gears.GearRotorBearing",
    "Goal": "design.Goal",
    "Grazing": "harmonic.GrazingProblem",
    "HelicalPair": "gears.HelicalPair",
    "Housing": "gears.Housing",
    "JumpMap": "analysis.JumpMap",
    "JumpScatter": "design.JumpTolerance",
    "Law": "mechanics.Law",
    "Matrices": "io.Matrices",
    "MatrixTable": "mechanics.MatrixTable",
    "Measurements": "design.Measurements",
    "Mesh": "gears.Mesh",
    "MeshCycle": "gears.MeshCycle",
    "Model": "mechanics.Model",
    "NeimarkSacker": "harmonic.NeimarkSackerProblem",
    "NoFold": "analysis.NoFoldError",
    "Opinion": "time.StabilityComparison",
    "Parallel": "mechanics.Parallel",
    "Peak": "harmonic.AmplitudeExtremum",
    "PeriodDoubling": "harmonic.PeriodDoublingProblem",
    "Periodic": "mechanics.Periodic",
    "PiecewiseLinear": "mechanics.PiecewiseLinear",
    "PlanetMode": "gears.PlanetMode",
    "PlanetarySet": "gears.PlanetarySet",
    "Progress": "continuation.Progress",
    "ProgressCallback": "continuation.ProgressCallback",
    "Range": "mechanics.Range",
    "Reaction": "mechanics.Reaction",
    "Receptances": "mechanics.Receptances",
    "Redesign": "design.Redesign",
    "Reduction": "mechanics.Reduction",
    "ResponseBand": "design.ResponseBand",
    "Run": "analysis.RunUp",
    "Sensitivity": "analysis.Sensitivity",
    "Series": "mechanics.Series",
    "Settings": "NewtonSettings",
    "Shaft": "gears.Shaft",
    "Sharing": "analysis.LoadSharing",
    "SobolIndices": "design.SobolIndices",
    "SpeedTerms": "mechanics.SpeedTerms",
    "Support": "gears.Support",
    "Survey": "analysis.BranchSearch",
    "SweepStatistics": "design.SweepStatistics",
    "Table": "gears.MeshTable",
    "Train": "gears.Train",
    "Unlikely": "mechanics.ImplausibleInputWarning",
    "Wheel": "gears.Wheel",
    "answers": "analysis.machine_quantities",
    "basins": "time.basins",
    "campbell": "analysis.campbell",
    "cases": "design.cases",
    "critical": "analysis.critical_parameter",
    "dynamic_factor": "analysis.dynamic_factor",
    "fit": "design.fit",
    "from_matrices": "io.from_matrices",
    "from_opentorsion": "io.from_opentorsion",
    "from_receptances": "io.from_receptances",
    "from_ross": "io.from_ross",
    "grid": "design.grid",
    "integrate": "time.integrate",
    "iso_dynamic_factor": "gears.iso_dynamic_factor",
    "jump_scatter": "design.jump_tolerance",
    "latin_hypercube": "design.latin_hypercube",
    "load_sharing": "analysis.load_sharing",
    "model": "mechanics.model",
    "monte_carlo": "design.monte_carlo",
    "no_jumps": "design.no_jumps",
    "peak_below": "design.peak_below",
    "peaks": "analysis.peaks",
    "plot_cases": "plot",
    "plot_time": "plot",
    "read_measurements": "design.read_measurements",
    "read_table": "io.read_mesh_table",
    "redesign": "design.redesign",
    "reduce": "mechanics.reduce",
    "response_band": "design.response_band",
    "run": "analysis.run_up",
    "saltelli": "design.saltelli",
    "second_opinion": "time.compare_multipliers",
    "sensitivity": "analysis.sensitivity",
    "shoot": "time.shoot",
    "sobol_indices": "design.sobol_indices",
    "sweep": "time.sweep",
    "sweep_statistics": "design.sweep_statistics",
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
