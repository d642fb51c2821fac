"""Gear drives: geometry, mesh excitation and ready-made models."""

from hbgear.gears.double_helical import DoubleHelicalPair
from hbgear.gears.rotor_bearing import GearRotorBearing
from hbgear.gears.spur import SpurPair

__all__ = ["DoubleHelicalPair", "GearRotorBearing", "SpurPair"]
