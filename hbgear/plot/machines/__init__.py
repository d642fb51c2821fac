"""Figures of machines: trains, meshes, rotors."""
