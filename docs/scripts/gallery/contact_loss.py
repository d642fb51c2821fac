"""
First loss of contact
=====================

A spur pair at three ratios of alternating to mean load (Kahraman and Singh 1990), and the
closed-form frequencies of the first loss of contact.
"""

# %%
# With permanent contact the pair is linear. The frequencies at which x reaches the half
# gap therefore have a closed form, with r = Omega:
#
# .. math:: (1 - r^2)^2 + (2 \zeta r)^2 = \left(\frac{F_{ah}}{F_m}\right)^2 r^4

import matplotlib.pyplot as plt
import numpy as np

import hbgear as hb

zeta, F_m = 0.05, 0.1
ratios = (0.5, 1.0, 2.0)
curves = [
    hb.trace(
        hb.HarmonicBalance(hb.SpurPair(zeta=zeta, F_m=F_m, e=(ratio * F_m,)), 16),
        "Omega",
        (2.4, 0.3),
    )
    for ratio in ratios
]
ax = hb.plot.responses(curves, "rms", names=[f"load ratio {ratio:g}" for ratio in ratios])
for ratio in ratios:
    u = np.roots([1 - ratio**2, 4 * zeta**2 - 2, 1.0])
    for r in np.sqrt(u[(abs(u.imag) < 1e-12) & (u.real > 0)].real):
        ax.axvline(r, color="0.6", lw=0.8, ls=":", zorder=0)
ax.set_xlim(0.3, 2.4)
plt.show()

# %%
# The dotted lines are the closed form; they agree with the points GR of the curves.

for ratio, curve in zip(ratios[:1], curves[:1], strict=True):
    grazing = sorted(p.parameters["Omega"] for p in curve.special if p.kind == "GR")
    print(ratio, [round(Omega, 5) for Omega in grazing])
