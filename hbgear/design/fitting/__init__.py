"""Fits of parameters to measured sweeps."""
