"""
Clearance in mesh and bearings
==============================

The gear-rotor-bearing model of Kahraman and Singh (1991), three degrees of freedom; lightly
loaded bearings lose contact, too.
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
# The pinion in its bearing, of the machine with clearance: blue while it stays in contact,
# orange where it lifts off and comes back on the same side.

hb.plot.response(curve, "rms", element="bearing 1", legend=False)
plt.show()
