"""Derivatives of frequencies and amplitudes of points in the parameters of their models."""
