"""Fourier series and piecewise-polynomial functions of the phase."""
