"""Gears from their drawing: a jump removed by tip relief, a measured pair, planets and their phases.

Stiffness and transmission error come from the teeth in contact, `GearPair.mesh`, and models from `GearPair.model`. The
tables list the assumed values.
"""
