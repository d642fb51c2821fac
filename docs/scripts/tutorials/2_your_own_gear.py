"""
Your own gear
=============

Teeth, module, width, torque: from the words of a drawing to the speeds at which the pair
jumps, in r/min.
"""

# %%
# The drawing
# -----------
# Quantities are text with a unit, or numbers in SI units. What cannot be made or cannot
# mesh is refused with the reason.

import hbgear as hb

pinion = hb.gears.Gear(teeth=25, module="3 mm", face_width="20 mm")
wheel = hb.gears.Gear(teeth=40, module="3 mm", face_width="20 mm")
pair = hb.GearPair(pinion, wheel, backlash="80 um")
print(f"centre distance {1e3 * pair.working_center_distance:.2f} mm")
print(f"contact ratio   {pair.contact_ratio:.2f}")

# %%
# The mesh under load
# -------------------
# `GearPair.mesh` balances the teeth in contact at every position: bending, shear and
# compression of the teeth, the body they stand on, and the contact. The result is the
# stiffness and the transmission error over one mesh cycle.

cycle = pair.mesh("200 N m")
hb.plot.mesh_cycles(cycle)

# %%
# The model
# ---------
# Torsion alone is the default form; with bearings it is ``form="bearings"`` and in space
# ``form="spatial"``. The model is dimensionless, and knows its way back to r/min, um and N.

model = pair.model(torque="200 N m", damping=0.04)
curve = hb.trace(hb.HarmonicBalance(model, harmonics=24), "Omega", model.default_span)
hb.plot.response(curve)

# %%
# The second axis is the speed of the pinion. The jumps, with the dynamic factor (largest
# force of the teeth over the force they transmit) before each:

for jump in curve.jumps():
    way = "up" if jump.direction > 0 else "down"
    speed, factor = (
        model.scales.pinion_speed(jump.value),
        hb.analysis.dynamic_factor(model, jump.before),
    )
    print(f"run-{way}: {speed:6.0f} r/min, dynamic factor {factor:.1f}")

# %%
# What cures it
# -------------
# Tip relief shortens the teeth where they would meet too early. The same pair, with relief
# at both gears:

relieved = hb.GearPair(
    hb.gears.Gear(teeth=25, module="3 mm", face_width="20 mm", tip_relief="15 um"),
    hb.gears.Gear(teeth=40, module="3 mm", face_width="20 mm", tip_relief="15 um"),
    backlash="80 um",
)
smoother = relieved.model(torque="200 N m", damping=0.04)
relieved_curve = hb.trace(
    hb.HarmonicBalance(smoother, harmonics=24), "Omega", model.default_span
)
print(len(curve.jumps()), "jumps without relief,", len(relieved_curve.jumps()), "with it")
hb.plot.responses([curve, relieved_curve], names=["no relief", "tip relief 15 um"])

# %%
# How much relief is best at which load is the subject of a :doc:`study </studies/index>`.
# On the command line the same is ``hbgear gear`` and ``hbgear speed``.
