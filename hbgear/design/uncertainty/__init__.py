"""Uncertainty: bands, scatter of jumps, Sobol indices."""
