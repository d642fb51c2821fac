"""
Basins of attraction of two motions
===================================

The final motion for each initial gap and velocity, at a frequency between the two folds.
"""

import matplotlib.pyplot as plt

import hbgear as hb

starts = hb.time.basins(hb.SpurPair(e=(0.1,)), 0.65, shape=(60, 60))
hb.plot.basins(starts)
plt.show()

# %%

for motion in starts.attractors:
    print(f"rms {motion.rms:.4f}, period {motion.period}")
