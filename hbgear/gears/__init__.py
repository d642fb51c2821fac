"""Gear drives: geometry, mesh excitation and ready-made models."""

from typing import TYPE_CHECKING

from hbgear.common import late as _late

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.gears.beam import Beam
    from hbgear.gears.double_helical import DoubleHelicalPair
    from hbgear.gears.gear import Gear
    from hbgear.gears.helical import HelicalPair
    from hbgear.gears.housing import Housing
    from hbgear.gears.iso_dynamics import iso_dynamic_factor
    from hbgear.gears.mesh_cycle import MeshCycle, Table
    from hbgear.gears.pair import GearPair
    from hbgear.gears.planetary import PlanetarySet, PlanetMode
    from hbgear.gears.rotor_bearing import GearRotorBearing
    from hbgear.gears.spur import SpurPair
    from hbgear.gears.support import Support
    from hbgear.gears.train import Train
    from hbgear.gears.train_parts import Bearing, Mesh, Shaft, Wheel

__all__ = [
    "Beam",
    "Bearing",
    "DoubleHelicalPair",
    "Gear",
    "GearPair",
    "GearRotorBearing",
    "HelicalPair",
    "Housing",
    "Mesh",
    "MeshCycle",
    "PlanetMode",
    "PlanetarySet",
    "Shaft",
    "SpurPair",
    "Support",
    "Table",
    "Train",
    "Wheel",
    "iso_dynamic_factor",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _late.attached(__name__)
