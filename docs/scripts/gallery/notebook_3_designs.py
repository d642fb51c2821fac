"""
Notebook: many designs
======================

Damping and errors scatter from one machine to the next. What becomes of the jumps, and
which of them decides? Download this page as a notebook at its end.
"""

from concurrent.futures import ThreadPoolExecutor

import matplotlib.pyplot as plt

import hbgear as hb

scatter = hb.design.latin_hypercube(
    16, zeta=("uniform", 0.04, 0.07), e_scale=("uniform", 0.8, 1.2)
)
bar = hb.ProgressBar("designs")
with ThreadPoolExecutor(1) as executor:
    found = hb.design.cases(
        hb.SpurPair(),
        scatter,
        ("peak", "jumps", "curve"),
        span=(1.2, 0.6),
        harmonics=8,
        executor=executor,
        progress=bar,
    )
bar

# %%

found

# %%

hb.plot.envelope(found)
plt.show()

# %%
# What decides where the run-down jumps, to first order, from one curve alone:

curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), harmonics=16), "Omega", (1.2, 0.6))
hb.plot.tornado(hb.analysis.sensitivity(curve["LP1"], ["zeta", "F_m", "e_scale"]))
plt.show()

# %%
# All designs beside the nominal curve, in one page:

hb.report(curve, title="Scatter of a production", studies=[found])
