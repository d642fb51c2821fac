"""hbgear: nonlinear frequency response of gear drives with backlash.

Harmonic balance with exact contact, pseudo-arclength continuation, Floquet stability, jump frequencies.
"""

import importlib
from types import ModuleType

from hbgear._version import __version__
from hbgear.augmented import Fold, Grazing, Peak, PeriodDoubling
from hbgear.balance import HarmonicBalance
from hbgear.branch import Branch, Jump, Point, SpecialPoint, Status
from hbgear.cases import Cases, cases
from hbgear.doubts import Unlikely
from hbgear.extend import extend
from hbgear.fourier import Series
from hbgear.gears import DoubleHelicalPair, GearRotorBearing, SpurPair
from hbgear.isolated import Survey, trace_all
from hbgear.laws import Backlash, Cubic, Law, Parallel, PiecewiseLinear, Unilateral
from hbgear.maps import Critical, JumpMap, NoFold, critical, jump_map
from hbgear.model import Element, Load, Model, System
from hbgear.newton import NoConvergence, Settings
from hbgear.npz import load
from hbgear.oscillators import Duffing
from hbgear.peaks import peaks
from hbgear.ranges import Range
from hbgear.reduction import Reduction, reduce
from hbgear.sampling import grid, latin_hypercube, monte_carlo
from hbgear.shooting import shoot
from hbgear.stride import Steps
from hbgear.sweep import basins, sweep
from hbgear.switch import switch
from hbgear.timedomain import integrate
from hbgear.trace import trace
from hbgear.validate import validate

__all__ = [
    "Backlash",
    "Branch",
    "Cases",
    "Critical",
    "Cubic",
    "DoubleHelicalPair",
    "Duffing",
    "Element",
    "Fold",
    "GearRotorBearing",
    "Grazing",
    "HarmonicBalance",
    "Jump",
    "JumpMap",
    "Law",
    "Load",
    "Model",
    "NoConvergence",
    "NoFold",
    "Parallel",
    "Peak",
    "PeriodDoubling",
    "PiecewiseLinear",
    "Point",
    "Range",
    "Reduction",
    "Series",
    "Settings",
    "SpecialPoint",
    "SpurPair",
    "Status",
    "Steps",
    "Survey",
    "System",
    "Unilateral",
    "Unlikely",
    "__version__",
    "basins",
    "cases",
    "critical",
    "extend",
    "grid",
    "integrate",
    "jump_map",
    "latin_hypercube",
    "load",
    "monte_carlo",
    "peaks",
    "plot",
    "reduce",
    "shoot",
    "sweep",
    "switch",
    "trace",
    "trace_all",
    "validate",
]


def __getattr__(name: str) -> ModuleType:
    """``hbgear.plot`` is loaded when it is first used: matplotlib takes longer than all the rest."""
    if name == "plot":
        return importlib.import_module("hbgear.plot")
    raise AttributeError(f"module 'hbgear' has no attribute '{name}'")
