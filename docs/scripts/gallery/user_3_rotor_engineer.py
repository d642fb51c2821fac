"""
Rotor engineer: matrices with bearing clearance
===============================================

From matrices with gyroscopic terms, named by
:download:`rotor.toml <../scripts/gallery/data/rotor.toml>`, to critical speeds and to the
response to unbalance with clearance in the bearings.
"""

import matplotlib.pyplot as plt

import hbgear as hb

rotor = hb.io.read_structure("data/rotor.toml")
found = hb.analysis.campbell(rotor, (0.2, 2.0))
print("critical speeds", [round(critical.Omega, 3) for critical in found.critical])
hb.plot.campbell(found)

# %%
# A run-up and a run-down differ between the folds:

curve = hb.trace(hb.HarmonicBalance(rotor, harmonics=5), "Omega", (1.6, 0.9))
hb.plot.response(curve, "pp2")
plt.show()
