"""Floquet multipliers: monodromy matrices, their errors and collisions."""
