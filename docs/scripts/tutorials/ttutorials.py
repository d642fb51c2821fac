"""
T
=
x
"""

import matplotlib.pyplot as plt

import hbgear as hb

hb.plot.response(hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6)))
plt.show()
