"""
A measured transmission error
=============================

A table of mesh stiffness or transmission error, measured or from another program, replaces
the computed one, including all breakpoints.
"""

# %%
# A table
# -------
# A file contains phases and values over one mesh cycle, with units in its first line. The
# example writes a saw-tooth error with noise.

import tempfile
from pathlib import Path

import numpy as np

import hbgear as hb

rng = np.random.default_rng(1)
phase = np.linspace(0, 1, 41)[:-1]
error = 1.5 * np.interp(phase, [0, 0.7, 1], [-1, 1, -1]) + 0.1 * rng.standard_normal(40)
folder = Path(tempfile.mkdtemp())
lines = [f"{p:.4f},{e:.4f}" for p, e in zip(phase, error, strict=True)]
(folder / "error.csv").write_text(
    "\n".join(["phase [cycle],error [um]", *lines, f"1.0,{error[0]:.4f}", ""])
)
measured = hb.io.read_mesh_table(folder / "error.csv", unit="m")

# %%
# The pair
# --------
# Mesh stiffness computed from the teeth, transmission error from the table:

pinion, wheel = (
    hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40)
)
pair = hb.GearPair(pinion, wheel, backlash="80 um")
cycle = hb.gears.MeshCycle(pair.mesh("200 N m").stiffness, measured)
hb.plot.mesh_cycles([pair.mesh("200 N m"), cycle], names=["computed", "measured error"])

# %%
# The response
# ------------

curves = [
    hb.trace(hb.HarmonicBalance(model, harmonics=20), "Omega", (1.4, 0.4))
    for model in (pair.model("200 N m", 0.06), pair.model("200 N m", 0.06, cycle=cycle))
]
hb.plot.responses(curves, names=["computed", "measured error"])

# %%
# Along orders
# ------------
# As in a run-up test: the first three mesh orders of the gap over the speed.

hb.plot.orders(hb.analysis.run_up(curves[1], "up"))
