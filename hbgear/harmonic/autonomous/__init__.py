"""Motions without periodic excitation: backbones, equilibria with Hopf points, limit cycles."""
