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
# Peaks without response curves
# -----------------------------
# At a peak the excitation supplies the power that the modal damping dissipates. This
# condition gives its frequency and amplitude from the backbone alone.

for e, curve in zip(errors, curves, strict=True):
    free = hb.analysis.backbone(hb.SpurPair(zeta=0.02, e=(e,)), span=(0.01, 0.5))
    (predicted,) = hb.analysis.predicted_peaks(free)
    peak = max(hb.analysis.peaks(curve, "rms"), key=lambda point: point.amplitude("rms"))
    found, rms = peak.parameters["Omega"], peak.amplitude("rms")
    print(f"e = {e:g}: peak at Omega = {found:.4f}, rms {rms:.4f}")
    print(f"  predicted {predicted.Omega:.4f}, rms {predicted.amplitude:.4f}")
