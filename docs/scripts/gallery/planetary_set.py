"""
Planets in phase, and one after the other
=========================================

Two planetary sets with backlash in all meshes. Whether the planets mesh in phase follows
from the numbers of teeth, and decides which modes the meshes excite.
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
# The natural frequencies of the first, over the speed of its excitation, with the orders of
# its meshes and members:

hb.plot.campbell(hb.analysis.campbell(sets[0], (0.1, 2.5)))
plt.show()
