"""
A first jump
============

A pair of spur gears with backlash is run up slowly, and then down again. At two different
speeds its amplitude jumps. This tutorial finds both, and the curve behind them.
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
# Lengths are in half backlashes: the teeth part at x = 1.

import hbgear as hb

pair = hb.SpurPair()
pair

# %%
# The curve
# ---------
# `HarmonicBalance` writes the periodic motions of a model as equations for Fourier
# coefficients, and `trace` follows their solutions. Here the mesh frequency Omega goes from
# above the resonance to below it.

problem = hb.HarmonicBalance(pair, harmonics=16)
curve = hb.trace(problem, "Omega", (1.5, 0.3))
curve

# %%
# What came back is a `Branch`: one row for each point, with amplitudes, multipliers, impact
# regime and residual.

hb.plot.response(curve, "rms")

# %%
# Solid is stable, dashed unstable. Between the two folds, LP1 and LP2, there are three
# motions at one frequency: the teeth stay in mesh on the low one and part once a period on
# the high one; the one between is unstable and is seen by no test rig. GR marks where the
# teeth begin to part.
#
# The jumps
# ---------
# A slow run-down leaves the high motion at LP1, a slow run-up the low one at LP2.

for jump in curve.jumps():
    way = "up" if jump.direction > 0 else "down"
    before, after = jump.before.amplitude("rms"), jump.after.amplitude("rms")
    print(f"run-{way} jumps at Omega = {jump.value:.4f}, rms {before:.4f} to {after:.4f}")

# %%
# `plot.runs` draws both ways.

hb.plot.runs(curve, "rms")

# %%
# One motion
# ----------
# Every row, and every special point, is a `Point`. At the fold LP1:

hb.plot.portrait(curve["LP1"])

# %%
# The gap passes below 1 for a part of the period: there the force of the mesh is zero. Its
# harmonics decay slowly, because the force has a corner.
#
# Keep it
# -------
# ``curve.save("pair.npz")`` keeps all of it; `load` needs no model to draw it again.
