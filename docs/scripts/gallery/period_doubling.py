"""
Period doubling
===============

When a multiplier passes -1, a branch of motions with twice the period starts. `switch`
follows this branch until it joins the original curve again.
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
# A motion with twice the period, in the middle of the branch:

middle = doubled[len(doubled) // 2]
hb.plot.phase_diagram(middle)
plt.show()
