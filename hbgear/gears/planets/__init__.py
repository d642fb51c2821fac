"""Planetary and other epicyclic gear sets: kinematics, phases, equations of motion."""
