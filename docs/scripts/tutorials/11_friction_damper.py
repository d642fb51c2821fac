"""
Friction damper on a blade
==========================

A turbine blade with a damper under its platform: the friction that gives the smallest
vibration lies between a damper that always slips and one that always sticks.
"""

# %%
# The blade
# ---------
# Two masses: the platform and the tip. The damper is a `Jenkins` element, a spring in
# series with a slider that slips at its limit, between the platform and the disc.

import numpy as np

import hbgear as hb

M = np.diag([1.0, 0.5])
K = np.array([[3.0, -1.0], [-1.0, 1.0]])


@hb.mechanics.model(default_span=(0.6, 1.4))
def blade(limit: float = 0.05, excitation: float = 0.02) -> hb.System:
    """A blade that is excited at its tip, with a damper at its platform."""
    damper = hb.Element([1, 0], hb.mechanics.Jenkins(k=1.0, limit=limit), name="damper")
    load = hb.Load(cosine={1: [0.0, excitation]})
    return hb.System(M, 0.004 * K, K, elements=[damper], load=load)


# %%
# Stick and slip
# --------------
# The colours are regimes: the damper sticks, or it slips in a part of the period. SL marks
# the first slip. Where the damper only sticks, its force at rest is not determined, and the
# stability is called neutral.

curve = hb.trace(hb.HarmonicBalance(blade(), harmonics=9), "Omega", (0.6, 1.4))
print(sorted(set(curve.regimes)), [point.label for point in curve.special])
hb.plot.response(curve)

# %%
# The best limit
# --------------
# A small limit dissipates little, and a large one makes the damper stick: then it is a
# spring that moves the resonance. The largest vibration has a minimum in between.

limits = [0.03, 0.05, 0.08, 0.12, 0.3]
curves = [
    hb.trace(hb.HarmonicBalance(blade(limit=x), 9), "Omega", (0.8, 1.3), special=False)
    for x in limits
]
peaks = [float(np.max(one.amplitude("max"))) for one in curves]
for limit, peak in zip(limits, peaks, strict=True):
    print(f"limit {limit:.2f}: largest displacement of the platform {peak:.3f}")
hb.plot.responses(curves, names=[f"limit {x:g}" for x in limits])

# %%
# Limit over excitation
# ---------------------
# With all forces twice as large the motion is twice as large: only the ratio of the limit
# to the excitation matters. A curve over the excitation shows where the damper begins to
# slip.

problem = hb.HarmonicBalance(blade(), 9)
level = hb.trace(problem, "excitation", (0.002, 0.06), at={"Omega": 1.05})
print(level.message, [point.label for point in level.special])
hb.plot.response(level)
