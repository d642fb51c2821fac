"""
Curves that nothing connects
============================

Duffing's oscillator near three times its natural frequency: motions of three times the
period lie on a curve of their own, which `trace_all` finds by looking at a chosen
frequency.
"""

import matplotlib.pyplot as plt

import hbgear as hb

problem = hb.HarmonicBalance(hb.Duffing(zeta=0.01, k3=1, F=3), harmonics=9, nu=3)
found = hb.trace_all(problem, (6, 2), frequencies=[4])
for branch in found.branches:
    print(branch)
hb.plot.responses(found.branches, "rms")
plt.show()
