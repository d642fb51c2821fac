"""
Sensitivity of a jump
=====================

Derivatives of the frequency at which a run-down jumps with respect to every parameter of
the model.
"""

import matplotlib.pyplot as plt

import hbgear as hb

curve = hb.trace(
    hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 12), "Omega", (1.2, 0.7)
)
found = hb.analysis.sensitivity(curve["LP1"])
hb.plot.tornado(found, most=8)
plt.show()

# %%
# The same in percent per percent of the parameter:

percent = found.percent("pinion r/min")
for name in sorted(percent, key=lambda name: -abs(percent[name]))[:4]:
    print(f"{name:10s} {percent[name]:+.3f}")
