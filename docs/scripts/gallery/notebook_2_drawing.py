"""
Notebook: from a drawing to a report
====================================

A pair of gears in the words of its drawing, and what becomes of it: contact ratio, mesh
stiffness, speeds at which it jumps, and a page to give away. Download this page as a
notebook at its end.
"""

import matplotlib.pyplot as plt

import hbgear as hb

pinion = hb.gears.Gear(25, "3 mm", "20 mm")
wheel = hb.gears.Gear(40, "3 mm", "20 mm")
pair = hb.GearPair(pinion, wheel, backlash="80 um")
mesh = pair.mesh("200 N m")
print(f"contact ratio {pair.contact_ratio:.3f}")
print(f"mesh stiffness {mesh.stiffness.mean / 1e6:.0f} N/um")

# %%

hb.plot.mesh_cycles(mesh)
plt.show()

# %%
# As a model of one degree of freedom:

model = pair.model("200 N m", damping=0.04)
model

# %%

bar = hb.ProgressBar("response of the pair")
curve = hb.trace(
    hb.HarmonicBalance(model, harmonics=16), "Omega", model.default_span, progress=bar
)
bar

# %%

for jump in curve.jumps():
    way = "rising" if jump.direction > 0 else "falling"
    print(f"{model.scales.pinion_speed(jump.value):6.0f} r/min while {way}")

# %%
# Held against time integration, and all of it as one page that stands by itself: click a
# point to see its motion. ``report.save("pair.html")`` writes it (extra:
# ``pip install '.[report]'``).

checks = hb.validate(curve, 2, landing="nearest")
report = hb.report(curve, title="25/40, module 3 mm", validation=checks)
report
