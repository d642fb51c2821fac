"""
Planets in phase and in sequence
================================

Two planetary sets with backlash in all meshes. The numbers of teeth determine whether the
planets mesh in phase or sequentially, and which modes the meshes excite.
"""

import matplotlib.pyplot as plt

import hbgear as hb

sets = [
    hb.gears.PlanetarySet(28, 36, 100, planets=4),
    hb.gears.PlanetarySet(26, 34, 94, planets=3),
]
curves = [
    hb.trace(hb.HarmonicBalance(one, harmonics=6), "Omega", (1.25, 0.5)) for one in sets
]
hb.plot.responses(curves, "rms", names=[one.phasing for one in sets])
plt.show()

# %%
# Campbell diagram of the first set, with the orders of its meshes and members:

hb.plot.campbell(hb.analysis.campbell(sets[0], (0.1, 2.5)))
plt.show()
