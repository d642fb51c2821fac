"""
Test engineer: damping from a measured sweep
============================================

From a table of a test rig, :download:`sweep.csv <../scripts/gallery/data/sweep.csv>`, with
speeds in r/min and displacements in um while the speed falls and rises, to the damping of
the mesh with its standard error.
"""

import matplotlib.pyplot as plt

import hbgear as hb

data = hb.design.read_measurements("data/sweep.csv", measure="rms")
pair = hb.SpurPair(reference=(38000.0, 40e-6, 15000.0, 25))  # omega_n, b_c, k b_c, teeth
found = hb.design.fit(pair, data, {"zeta": (0.02, 0.2)}, harmonics=10)
print(f"zeta = {found.values['zeta']:.4f} +- {found.errors['zeta']:.4f}")
hb.plot.fitted(found)
plt.show()
