"""
A run-up, as a test bench shows it
==================================

The stable motions that a slow run-up passes, as spectra over speed, and cuts along the mesh
orders.
"""

import matplotlib.pyplot as plt

import hbgear as hb

pinion, wheel = (
    hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40)
)
model = hb.GearPair(pinion, wheel, backlash="80 um").model(torque="200 N m", damping=0.04)
curve = hb.trace(hb.HarmonicBalance(model, harmonics=16), "Omega", model.default_span)
up = hb.analysis.run_up(curve, "up")
print(up.message)
hb.plot.waterfall(up)

# %%

hb.plot.orders(up)
plt.show()
