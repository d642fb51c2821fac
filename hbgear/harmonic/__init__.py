"""Periodic motions by harmonic balance: residual, exact contact, stability, special points, jumps."""
