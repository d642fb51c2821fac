"""
Check a result
==============

A wrong curve may look as smooth as a correct one. Five questions help to check a curve.
"""

# %%
# 1. Were the equations solved?
# -----------------------------
# Every point has its residual relative to the size of the forces.

import hbgear as hb

curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), harmonics=16), "Omega", (1.5, 0.3))
print(curve.status, "-", curve.message)
print(f"largest residual {curve.residual.max():.0e}")

# %%
# 2. Are there enough harmonics?
# ------------------------------
# The curve has an estimate of its truncation error, and each special point an estimate of
# the error of its frequency:

print(f"largest relative error of a motion {curve.relative_error:.0e}")
for label in ("LP1", "LP2"):
    fold = curve[label]
    print(f"{label}: Omega = {fold.parameters['Omega']:.7f}, error {fold.error:.0e}")

# %%
# A comparison with more harmonics confirms the estimates:

for H in (8, 16, 32):
    finer = hb.trace(
        hb.HarmonicBalance(hb.SpurPair(), H), "Omega", (0.95, 0.65), accuracy=None
    )
    print(f"H = {H:2d}: LP1 at {finer['LP1'].parameters['Omega']:.7f}")

# %%
# 3. Is the stability verified?
# -----------------------------
# Points with uncertain stability are *undecided*. ``warnings`` lists all reasons not to
# rely on the curve; it should be empty.

print(curve.warnings or "no warnings")
comparison = hb.time.compare_multipliers(curve, curve.peak("rms"))
for method, modulus in comparison.moduli.items():
    print(f"largest modulus, {method}: {modulus:.6f}")

# %%
# These are three methods for the multipliers of one motion: the method of the curve, Hill's
# matrix, and shooting.
#
# 4. Does time integration agree?
# -------------------------------
# `validate` selects points and compares each with Runge-Kutta integration: periodicity,
# amplitudes, multipliers, and growth of a disturbance. It also integrates the jumps.

report = hb.validate(curve, 6)
print(report)
hb.plot.validation(report, curve)

# %%
# 5. Are there other motions?
# ---------------------------
# A curve is connected, but other motions may exist. Basins of attraction, or a survey
# (`trace_all`), search for them.

starts = hb.time.basins(hb.SpurPair(), 0.75, shape=(40, 40))
hb.plot.basins(starts)

# %%
# At Omega = 0.75 every start ends in one of the two stable motions of the curve.

for motion in starts.attractors:
    print(f"rms {motion.rms:.4f}")
