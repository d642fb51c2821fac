"""
Following a jump in a design parameter
======================================

A jump is a fold of the response curve. `follow` traces the fold in a second parameter: How
does the frequency of the jump depend on the damping, the load or the transmission error,
and when does the jump disappear?
"""

# %%
# The fold with increasing damping
# --------------------------------

import hbgear as hb

problem = hb.HarmonicBalance(hb.SpurPair(), harmonics=16)
curve = hb.trace(problem, "Omega", (1.5, 0.3))
folds = hb.follow(curve, "LP1", "zeta", (0.05, 0.2))
folds

# %%
# The curve of folds turns back at the cusp CP1, at which both folds meet. With more damping
# there is no jump.

cusp = folds["CP1"]
print(f"zeta = {cusp.parameters['zeta']:.5f}, Omega = {cusp.parameters['Omega']:.5f}")

# %%
# The same in one call, for a jump map over a range of designs:

jumps = hb.jump_map(hb.SpurPair(), "zeta", (0.05, 0.13))
hb.plot.jump_map(jumps)

# %%
# Between the lines two stable motions exist: the response has hysteresis. The same map over
# the mean load:

hb.plot.jump_map(hb.jump_map(hb.SpurPair(), "F_m", (0.08, 0.2)))

# %%
# Response curves
# ---------------
# Below, at and above the critical damping:

values = (0.05, round(cusp.parameters["zeta"], 5), 0.2)
curves = [
    hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=zeta), 16), "Omega", (1.2, 0.5))
    for zeta in values
]
hb.plot.responses(curves, names=[f"zeta = {zeta:g}" for zeta in values])

# %%
# Your own event
# --------------
# The zeros of any function of a point can be located and followed as well. At which
# frequency does the largest deflection reach 1.3 half backlashes, and how does it depend on
# the damping?

limit = hb.Event(
    "limit",
    lambda point: point.amplitude("max") - 1.3,
    "largest deflection 1.3",
    marker="v",
)
marked = hb.trace(problem, "Omega", (1.2, 0.6), events=[limit])
held = hb.follow(marked, "limit1", "zeta", (0.05, 0.055))
for zeta, Omega in zip(held.values[[0, -1]], held.tracked["Omega"][[0, -1]], strict=True):
    print(f"zeta = {zeta:.3f}: Omega = {Omega:.4f}")
