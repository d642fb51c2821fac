"""
PhD student: own equations
==========================

A driven pendulum, x'' + 2 zeta x' + sin(x) = F cos(Omega t). The law is a Python class with
its derivatives; the response has folds, stability and a check by time integration.
"""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

import hbgear as hb


@dataclass(frozen=True)
class Sine(hb.mechanics.Law):
    def force(self, d, v, tau):
        return np.sin(d), np.cos(d), np.zeros_like(d)


load = hb.Load(cosine={1: [0.08]})
pendulum = hb.System(
    [[1.0]], [[0.08]], [[0.0]], [hb.Element([1.0], Sine(), name="angle")], load
)
curve = hb.trace(hb.HarmonicBalance(pendulum, harmonics=7), "Omega", (1.3, 0.6))
hb.plot.response(curve, "max")
plt.show()

# %%

for jump in curve.jumps():
    print(f"jump at Omega = {jump.value:.4f}")
hb.validate(curve, 2, landing="nearest")
