"""Time integration: simulation, shooting, sweeps, basins, and the check of a curve against them."""
