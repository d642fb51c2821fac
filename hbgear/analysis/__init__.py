"""Analyses of machines and branches: jump maps, critical parameters, sensitivities, Campbell diagrams."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.analysis.branch_search.multistart import BranchSearch, trace_all
    from hbgear.analysis.campbell_diagram import Campbell, CriticalSpeed, campbell
    from hbgear.analysis.certificates.certificate import Certificate
    from hbgear.analysis.certificates.certify import certify
    from hbgear.analysis.certificates.conditions import NotCertifiedError
    from hbgear.analysis.critical_parameters import CriticalParameter, NoFoldError, critical_parameter
    from hbgear.analysis.jump_maps import JumpMap, jump_map
    from hbgear.analysis.loads.planet_loads import LoadSharing, load_sharing
    from hbgear.analysis.loads.tooth_loads import ToothLoads, tooth_loads
    from hbgear.analysis.parameter_sensitivity.sensitivity import sensitivity
    from hbgear.analysis.parameter_sensitivity.table import Sensitivity
    from hbgear.analysis.quantities.engineering_quantities import MachineQuantities, machine_quantities
    from hbgear.analysis.quantities.mesh_dynamic_factor import dynamic_factor
    from hbgear.analysis.quantities.order_cuts import order_amplitudes
    from hbgear.analysis.run_ups import RunUp, run_up
    from hbgear.harmonic.autonomous.backbone_curve import PredictedPeak, backbone, backbone_energy, predicted_peaks
    from hbgear.harmonic.autonomous.equilibrium import HopfPoint, hopf_points
    from hbgear.harmonic.autonomous.limit_cycle import limit_cycles
    from hbgear.harmonic.autonomous.mode_stability import BackboneStability, StabilityChange, backbone_stability
    from hbgear.harmonic.autonomous.tori.branch import torus
    from hbgear.harmonic.autonomous.tori.two_tones import two_tones
    from hbgear.harmonic.bifurcations.peaks import peaks

__all__ = [
    "BackboneStability",
    "BranchSearch",
    "Campbell",
    "Certificate",
    "CriticalParameter",
    "CriticalSpeed",
    "HopfPoint",
    "JumpMap",
    "LoadSharing",
    "MachineQuantities",
    "NoFoldError",
    "NotCertifiedError",
    "PredictedPeak",
    "RunUp",
    "Sensitivity",
    "StabilityChange",
    "ToothLoads",
    "backbone",
    "backbone_energy",
    "backbone_stability",
    "campbell",
    "certify",
    "critical_parameter",
    "dynamic_factor",
    "hopf_points",
    "jump_map",
    "limit_cycles",
    "load_sharing",
    "machine_quantities",
    "order_amplitudes",
    "peaks",
    "predicted_peaks",
    "run_up",
    "sensitivity",
    "tooth_loads",
    "torus",
    "trace_all",
    "two_tones",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
