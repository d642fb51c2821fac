"""Exact periodic motions of piecewise-linear systems: Newton's method in contact instants and states."""
