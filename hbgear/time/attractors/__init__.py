"""Attractors of a model: bifurcation diagrams with verdicts, and all steady motions at one frequency."""
