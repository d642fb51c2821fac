"""
Trusting a result
=================

A curve looks smooth whether it is right or not. Five questions to ask of one, and where the
answers are.
"""

# %%
# 1. Were the equations solved?
# -----------------------------
# Every row has its residual, relative to the size of the forces.

import hbgear as hb

curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), harmonics=16), "Omega", (1.5, 0.3))
print(curve.status, "-", curve.message)
print(f"largest residual {curve.residual.max():.0e}")

# %%
# 2. Are there enough harmonics?
# ------------------------------
# The estimate of the error made by what is left out, and the error that each special point
# states of itself:

print(f"largest relative error of a motion {curve.relative_error:.0e}")
for label in ("LP1", "LP2"):
    fold = curve[label]
    print(f"{label}: Omega = {fold.parameters['Omega']:.7f}, error {fold.error:.0e}")

# %%
# More harmonics are the test of that:

for H in (8, 16, 32):
    finer = hb.trace(
        hb.HarmonicBalance(hb.SpurPair(), H), "Omega", (0.95, 0.65), accuracy=None
    )
    print(f"H = {H:2d}: LP1 at {finer['LP1'].parameters['Omega']:.7f}")

# %%
# 3. Is the stability sure?
# -------------------------
# Points whose stability the error of a multiplier leaves open are *undecided*. ``warnings``
# lists the reasons why a curve is not reliable everywhere. Empty is good.

print(curve.warnings or "no warnings")
opinion = hb.time.compare_multipliers(curve, curve.peak("rms"))
for way, modulus in opinion.moduli.items():
    print(f"largest modulus, {way}: {modulus:.6f}")

# %%
# Three ways to the multipliers of one motion: those of the curve, of Hill's matrix, and of
# the same motion found by shooting.
#
# 4. Does time integration agree?
# -------------------------------
# `validate` takes points that matter and holds each against Runge-Kutta integration:
# whether the motion closes, its amplitudes, its multipliers, and whether a disturbance
# grows. It integrates past the jumps as well.

report = hb.validate(curve, 6)
print(report)
hb.plot.validation(report, curve)

# %%
# 5. Is that all there is?
# ------------------------
# A curve is one connected piece. Other motions may exist beside it; a sweep from many
# starts, or a survey, looks for them.

starts = hb.time.basins(hb.SpurPair(), 0.75, shape=(40, 40))
hb.plot.basins(starts)

# %%
# At Omega = 0.75 every start ends in one of the two motions that the curve has there.

for motion in starts.attractors:
    print(f"rms {motion.rms:.4f}")
