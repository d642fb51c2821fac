"""
Clearance in mesh and bearings
==============================

The gear-rotor-bearing model of Kahraman and Singh (1991) with three degrees of freedom.
Lightly loaded bearings lose contact as well.
"""

import matplotlib.pyplot as plt

import hbgear as hb

model = hb.gears.GearRotorBearing(mu_2=0.15, F_1=0.02, F_2=0.02, b_1=0.1, b_2=0.1)
curve = hb.trace(hb.HarmonicBalance(model, harmonics=16), "Omega", (1.9, 0.4))
linear = hb.trace(
    hb.HarmonicBalance(model.replace(b_1=0.0, b_2=0.0), harmonics=16), "Omega", (1.9, 0.4)
)
hb.plot.responses(
    [linear, curve], "rms", names=["bearings without clearance", "with clearance"]
)

# %%
# The displacement of the pinion in its bearing with clearance. Blue: permanent contact;
# orange: loss of contact and contact again on the same side.

hb.plot.response(curve, "rms", element="bearing 1", legend=False)
plt.show()
