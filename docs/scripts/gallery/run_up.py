"""
Run-up as on a test rig
=======================

Spectra over speed of the stable motions of a slow run-up, and amplitudes along the mesh
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
