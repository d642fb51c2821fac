"""
Your own gear
=============

From teeth, module, width and torque to the speeds in r/min at which the gear pair jumps.
"""

# %%
# The drawing
# -----------
# Quantities are text with a unit, or numbers in SI units. Gears that cannot be manufactured
# and pairs that cannot mesh are refused with the reason.

import hbgear as hb

pinion = hb.gears.Gear(teeth=25, module="3 mm", face_width="20 mm")
wheel = hb.gears.Gear(teeth=40, module="3 mm", face_width="20 mm")
pair = hb.GearPair(pinion, wheel, backlash="80 um")
print(f"centre distance {1e3 * pair.working_center_distance:.2f} mm")
print(f"contact ratio   {pair.contact_ratio:.2f}")

# %%
# The mesh under load
# -------------------
# `GearPair.mesh` computes the equilibrium of the teeth in contact at every position, with
# bending, shear and compression of the teeth, their foundation, and the contact. The result
# is the stiffness and the transmission error over one mesh cycle.

cycle = pair.mesh("200 N m")
hb.plot.mesh_cycles(cycle)

# %%
# The model
# ---------
# The default form of the model is torsional; ``form="bearings"`` adds bearings, and
# ``form="spatial"`` is a model in space. The model is dimensionless; ``model.scales``
# converts to r/min, um and N.

model = pair.model(torque="200 N m", damping=0.04)
curve = hb.trace(hb.HarmonicBalance(model, harmonics=24), "Omega", model.default_span)
hb.plot.response(curve)

# %%
# The first curve grows without bound towards a parametric resonance (dotted line); a second
# one covers the lower speeds. ``curve.curves`` has both. Their jumps, with the dynamic
# factor (largest tooth force divided by the static tooth force) before each jump:

jumps = [jump for part in curve.curves for jump in part.jumps()]
for jump in jumps:
    sweep = "up" if jump.direction > 0 else "down"
    speed, factor = (
        model.scales.pinion_speed(jump.value),
        hb.analysis.dynamic_factor(model, jump.before),
    )
    print(f"run-{sweep}: {speed:6.0f} r/min, dynamic factor {factor:.1f}")

# %%
# Tip relief
# ----------
# Tip relief removes material at the tooth tips, which would otherwise make contact too
# early. Pairs of teeth that the relief has opened make contact under dynamic load: in the
# model each pair of teeth has its own gap. The same pair with tip relief at both gears:

relieved = hb.GearPair(
    hb.gears.Gear(teeth=25, module="3 mm", face_width="20 mm", tip_relief="20 um"),
    hb.gears.Gear(teeth=40, module="3 mm", face_width="20 mm", tip_relief="20 um"),
    backlash="80 um",
)
smoother = relieved.model(torque="200 N m", damping=0.04)
relieved_curve = hb.trace(
    hb.HarmonicBalance(smoother, harmonics=24), "Omega", model.default_span
)
print(f"jumps without relief: {len(jumps)}, with relief: {len(relieved_curve.jumps())}")
hb.plot.responses(
    [*curve.curves, relieved_curve],
    names=["no relief", "no relief, second curve", "tip relief 20 um"],
)

# %%
# A :doc:`study </studies/index>` determines the reliefs without a jump for two loads: 17 to
# 23 um at 200 N m, 10 to 12 um at 100 N m. The commands
# ``hbgear gear`` and ``hbgear speed`` do the same computation in a shell.
