"""
A nonlinear mode and its resonance peaks
========================================

The frequency of a resonance changes with its amplitude. A backbone is the frequency of a
mode over its amplitude, computed once without excitation. The resonance peaks of all
loads lie close to it.
"""

# %%
# The backbone
# ------------
# A pair of spur gears with light damping. As long as the teeth stay in contact, the
# frequency is that of the linear mode. When they separate, the mean stiffness falls, and
# the frequency with it.

import hbgear as hb

backbone = hb.analysis.backbone(hb.SpurPair(zeta=0.02), mode=1, span=(0.01, 0.5))
Omega, damping = backbone.tracked["Omega"], backbone.tracked["modal_damping"]
print(f"linear mode: Omega = {Omega[0]:.4f}, damping ratio {damping[0]:.4f}")
print(f"rms amplitude 0.5: Omega = {Omega[-1]:.4f}, damping ratio {damping[-1]:.4f}")

# %%
# Its response curves
# -------------------
# Curves for three amplitudes of the transmission error: each peak lies on the backbone.

errors = (0.02, 0.03, 0.05)
curves = [
    hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=0.02, e=(e,)), 16), "Omega", (1.3, 0.5))
    for e in errors
]
axes = hb.plot.responses(curves, "pp2", names=[f"e = {e:g}" for e in errors])
hb.plot.backbone(backbone, "pp2", ax=axes, color="black")

# %%
# The peaks of the curves, and the frequency of the backbone at their amplitudes:

import numpy as np

for e, curve in zip(errors, curves, strict=True):
    peak = max(hb.analysis.peaks(curve, "rms"), key=lambda point: point.amplitude("rms"))
    predicted = np.interp(peak.amplitude("rms"), backbone.values, Omega)
    found = peak.parameters["Omega"]
    print(f"e = {e:g}: peak at Omega = {found:.4f}, backbone {predicted:.4f}")
