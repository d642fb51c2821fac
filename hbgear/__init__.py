"""hbgear: nonlinear frequency response of gear drives with backlash.

Harmonic balance with exact contact, pseudo-arclength continuation, Floquet stability, jump frequencies.
"""

from hbgear._version import __version__
from hbgear.augmented import Fold, Grazing, Peak, PeriodDoubling
from hbgear.balance import HarmonicBalance
from hbgear.branch import Branch, Jump, Point, SpecialPoint, Status, load
from hbgear.fourier import Series
from hbgear.gears import DoubleHelicalPair, SpurPair
from hbgear.laws import Backlash, Cubic, Law, Parallel, PiecewiseLinear, Unilateral
from hbgear.model import Element, Load, Model, System
from hbgear.newton import NoConvergence, Settings
from hbgear.oscillators import Duffing
from hbgear.trace import Steps, trace

__all__ = [
    "Backlash",
    "Branch",
    "Cubic",
    "DoubleHelicalPair",
    "Duffing",
    "Element",
    "Fold",
    "Grazing",
    "HarmonicBalance",
    "Jump",
    "Law",
    "Load",
    "Model",
    "NoConvergence",
    "Parallel",
    "Peak",
    "PeriodDoubling",
    "PiecewiseLinear",
    "Point",
    "Series",
    "Settings",
    "SpecialPoint",
    "SpurPair",
    "Status",
    "Steps",
    "System",
    "Unilateral",
    "__version__",
    "load",
    "trace",
]
