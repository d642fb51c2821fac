"""Gears from their drawing: a jump cured by tip relief, and planets in phase or one after the other.

Stiffness and transmission error come from the teeth in contact, `GearPair.mesh`, and models from `GearPair.model`. What
is assumed is told beside the numbers.
"""
