"""Figures of time integration: sweeps, basins, bifurcation diagrams and validation."""
