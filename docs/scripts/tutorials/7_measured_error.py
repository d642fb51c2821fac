"""
A measured transmission error
=============================

Stiffness and transmission error need not be computed: a table, measured or of another
program, takes their place, with all of its corners.
"""

# %%
# A table
# -------
# A file of phases and values over one mesh cycle, with units in its first line. Here one is
# made up, with a saw-tooth, as eccentric teeth might leave, and some noise.

import tempfile
from pathlib import Path

import numpy as np

import hbgear as hb

rng = np.random.default_rng(1)
phase = np.linspace(0, 1, 41)[:-1]
error = 1.5 * np.interp(phase, [0, 0.7, 1], [-1, 1, -1]) + 0.1 * rng.standard_normal(40)
folder = Path(tempfile.mkdtemp())
rows = [f"{p:.4f},{e:.4f}" for p, e in zip(phase, error, strict=True)]
(folder / "error.csv").write_text(
    "\n".join(["phase [cycle],error [um]", *rows, f"1.0,{error[0]:.4f}", ""])
)
measured = hb.io.read_mesh_table(folder / "error.csv", unit="m")

# %%
# The pair
# --------
# Stiffness of the mesh from the teeth, transmission error from the table:

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
# What a run-up test shows: the first three mesh orders of the gap over the speed.

hb.plot.orders(hb.analysis.run_up(curves[1], "up"))
