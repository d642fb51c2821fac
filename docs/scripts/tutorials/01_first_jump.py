"""
A first jump
============

The speed of a spur gear pair with backlash is increased slowly, and then decreased. The
amplitude jumps at two different speeds. This tutorial computes both jumps from the response
curve.
"""

# %%
# The machine
# -----------
# `SpurPair` is the classic model of Kahraman and Singh: one gap x along the line of action,
# a mean load, and a transmission error that excites it.
#
# .. math:: \ddot x + 2\zeta \dot x + k(\tau) f(x)
#           = F_m + \sum_l (l\Omega)^2 e_l \cos l\tau,
#           \qquad \tau = \Omega t
#
# Lengths are in half backlashes: the teeth lose contact at x = 1.

import hbgear as hb

pair = hb.SpurPair()
pair

# %%
# The curve
# ---------
# `HarmonicBalance` forms the equations for the Fourier coefficients of periodic motions,
# and `trace` follows their solutions. Here the mesh frequency Omega decreases from above
# the resonance to below it.

problem = hb.HarmonicBalance(pair, harmonics=16)
curve = hb.trace(problem, "Omega", (1.5, 0.3))
curve

# %%
# The result is a `Branch`. Each point has amplitudes, multipliers, impact regime and
# residual.

hb.plot.response(curve, "rms")

# %%
# Solid lines are stable, dashed lines unstable. Between the two folds, LP1 and LP2, three
# motions exist at one frequency. In the motion with the smallest amplitude the teeth stay
# in contact; in the one with the largest amplitude they lose contact once per period. The
# third motion is unstable and cannot be observed on a test rig. GR marks grazing contact,
# at which the loss of contact begins.
#
# The jumps
# ---------
# A slow run-down jumps from the large amplitude at LP1, a slow run-up from the small
# amplitude at LP2.

for jump in curve.jumps():
    sweep = "up" if jump.direction > 0 else "down"
    before, after = jump.before.amplitude("rms"), jump.after.amplitude("rms")
    print(f"run-{sweep} jumps at Omega = {jump.value:.4f}, rms {before:.4f} to {after:.4f}")

# %%
# `plot.runs` draws both directions.

hb.plot.runs(curve, "rms")

# %%
# One motion
# ----------
# Every point of the curve, and every special point, is a `Point`. At the fold LP1:

hb.plot.portrait(curve["LP1"])

# %%
# The gap is below 1 for a part of the period, in which the mesh force is zero. The
# harmonics of the force decay slowly, because the law has a breakpoint.
#
# Save the curve
# --------------
# ``curve.save("pair.npz")`` stores all results; `load` reads them without the model.
