"""Gears from their drawing: a jump cured by relief, a measured pair as far as its data go, planets and their phases.

Stiffness and transmission error come from the teeth in contact, `GearPair.mesh`, and models from `GearPair.model`. What
is assumed is told beside the numbers.
"""
