"""
The double-helical pair: damping
================================

The marine pair of Dong et al. (2022), 24 degrees of freedom, with three values of the mesh
damping.
"""

# %%
# As published (zeta = 0.063) the curve is steep near 0.89 but has no fold. With less
# damping it has two folds and a jump.

import matplotlib.pyplot as plt

import hbgear as hb

values = (0.05, 0.063, 0.08)
curves = [
    hb.trace(
        hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=zeta), 12), "Omega", (1.4, 0.7)
    )
    for zeta in values
]
hb.plot.responses(curves, names=[f"zeta = {zeta:g}" for zeta in values])
plt.show()

# %%

for zeta, curve in zip(values, curves, strict=True):
    print(zeta, [round(jump.value, 4) for jump in curve.jumps()] or "no jump")
