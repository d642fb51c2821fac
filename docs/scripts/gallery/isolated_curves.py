"""
Disconnected curves
===================

The Duffing oscillator near three times its natural frequency. Motions with three times the
period of the excitation form a disconnected curve, which `trace_all` finds by a search at a
given frequency.
"""

import matplotlib.pyplot as plt

import hbgear as hb

problem = hb.HarmonicBalance(hb.Duffing(zeta=0.01, k3=1, F=3), harmonics=9, nu=3)
found = hb.trace_all(problem, (6, 2), frequencies=[4])
for branch in found.branches:
    print(branch)
hb.plot.responses(found.branches, "rms")
plt.show()
