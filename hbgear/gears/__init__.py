"""Gear drives: geometry, mesh excitation and ready-made models."""

from hbgear.gears.double_helical import DoubleHelicalPair
from hbgear.gears.spur import SpurPair

__all__ = ["DoubleHelicalPair", "SpurPair"]
