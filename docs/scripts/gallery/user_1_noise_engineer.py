"""
Noise engineer: orders of a run-up
==================================

From the file of a gear pair,
:download:`gearbox.toml <../scripts/gallery/data/gearbox.toml>`, to the
amplitudes along the mesh orders of a slow run-up, with the speeds at which it jumps.
"""

import matplotlib.pyplot as plt

import hbgear as hb

model = hb.io.read_machine("data/gearbox.toml").model()
curve = hb.trace(hb.HarmonicBalance(model, harmonics=12), "Omega", (1.5, 0.5))
up = hb.analysis.run_up(curve, "up")
for jump in up.jumps:
    print(f"jump at {model.scales.pinion_speed(jump.value):.0f} r/min")
hb.plot.orders(up)

# %%
# Spectra over speed:

hb.plot.waterfall(up)
plt.show()
