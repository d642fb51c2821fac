"""
Notebook: from a drawing to a report
====================================

A gear pair from its drawing: contact ratio, mesh stiffness, the speeds at which it jumps,
and a report. The end of the page has a link to download the notebook.
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
# A model with one degree of freedom:

model = pair.model("200 N m", damping=0.04)
model

# %%

bar = hb.ProgressBar("response of the pair")
curve = hb.trace(
    hb.HarmonicBalance(model, harmonics=16), "Omega", model.default_span, progress=bar
)
bar

# %%

for jump in [jump for part in curve.curves for jump in part.jumps()]:
    sweep = "rising" if jump.direction > 0 else "falling"
    print(f"{model.scales.pinion_speed(jump.value):6.0f} r/min while {sweep}")

# %%
# The curve is compared with time integration, and a report shows all results: click a point
# to display its motion. ``report.save("pair.html")`` writes the report (extra:
# ``pip install '.[report]'``).

checks = hb.validate(curve, 2, landing="nearest")
report = hb.report(curve, title="25/40, module 3 mm", validation=checks)
report
