"""Gear drives: geometry, mesh excitation and ready-made models."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.gears.drawing.gear import Gear
    from hbgear.gears.drawing.pair import GearPair
    from hbgear.gears.drawing.root_stress import RootFactors, root_factors
    from hbgear.gears.mesh.harris_map import HarrisMap, harris_map
    from hbgear.gears.mesh.iso_dynamics import iso_dynamic_factor
    from hbgear.gears.mesh.mesh_cycle import MeshCycle, MeshTable
    from hbgear.gears.mesh.tooth_friction import BenedictKelley, tooth_friction
    from hbgear.gears.mesh.tooth_mesh import ToothMesh, tooth_mesh
    from hbgear.gears.pairs.double_helical import DoubleHelicalPair
    from hbgear.gears.pairs.drawn_pair import DrawnPair
    from hbgear.gears.pairs.helical import HelicalPair
    from hbgear.gears.pairs.rotor_bearing import GearRotorBearing
    from hbgear.gears.pairs.spur import SpurPair
    from hbgear.gears.pairs.support import Support
    from hbgear.gears.planets.epicyclic import EpicyclicSet
    from hbgear.gears.planets.planetary import PlanetarySet
    from hbgear.gears.planets.planetary_modes import PlanetMode
    from hbgear.gears.trains.beam import Beam
    from hbgear.gears.trains.housing import Housing
    from hbgear.gears.trains.train import Train
    from hbgear.gears.trains.train_components import Bearing, Mesh, Shaft, Wheel

__all__ = [
    "Beam",
    "Bearing",
    "BenedictKelley",
    "DoubleHelicalPair",
    "DrawnPair",
    "EpicyclicSet",
    "Gear",
    "GearPair",
    "GearRotorBearing",
    "HarrisMap",
    "HelicalPair",
    "Housing",
    "Mesh",
    "MeshCycle",
    "MeshTable",
    "PlanetMode",
    "PlanetarySet",
    "RootFactors",
    "Shaft",
    "SpurPair",
    "Support",
    "ToothMesh",
    "Train",
    "Wheel",
    "harris_map",
    "iso_dynamic_factor",
    "root_factors",
    "tooth_friction",
    "tooth_mesh",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
