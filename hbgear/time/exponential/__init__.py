"""The exponential integrator: kernels and tables."""
