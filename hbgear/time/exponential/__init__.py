"""Exponential integrator: kernels and tables."""
