"""Figures: response curves, motions, jump maps, sweeps, basins, studies. Only here matplotlib is imported."""

from hbgear.plot.curves import *  # noqa: F403
