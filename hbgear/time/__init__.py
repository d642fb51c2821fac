"""Time integration: the independent check of periodic motions."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.time.attractors.bifurcation_diagram import BifurcationDiagram, Window, bifurcation_diagram
    from hbgear.time.attractors.steady_states import SteadyMotion, SteadyStates, steady_states
    from hbgear.time.attractors.torus_check import TorusCheck, verify_torus
    from hbgear.time.attractors.verdicts import Verdict
    from hbgear.time.basins_of_attraction import basins
    from hbgear.time.frequency_sweep import sweep
    from hbgear.time.integration import integrate
    from hbgear.time.jump_integration import integrate_jumps
    from hbgear.time.shooting import shoot
    from hbgear.time.validation.stability_check import StabilityComparison, compare_multipliers
    from hbgear.time.validation.validate import validate

__all__ = [
    "BifurcationDiagram",
    "StabilityComparison",
    "SteadyMotion",
    "SteadyStates",
    "TorusCheck",
    "Verdict",
    "Window",
    "basins",
    "bifurcation_diagram",
    "compare_multipliers",
    "integrate",
    "integrate_jumps",
    "shoot",
    "steady_states",
    "sweep",
    "validate",
    "verify_torus",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
