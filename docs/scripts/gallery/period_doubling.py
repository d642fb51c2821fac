"""
Period doubling
===============

Where a multiplier passes -1, motions of twice the period leave the curve; `switch` follows
them until they come back.
"""

import matplotlib.pyplot as plt

import hbgear as hb

curve = hb.trace(
    hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), harmonics=16), "Omega", (2.6, 0.4)
)
doubled = hb.switch(curve, "PD1")
print(doubled)
hb.plot.responses([curve, doubled], "rms", names=["one period", "two periods"])

# %%
# A motion of two periods, half way along:

middle = doubled[len(doubled) // 2]
hb.plot.phase_diagram(middle)
plt.show()
