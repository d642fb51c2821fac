"""
Notebook: many designs
======================

Damping and transmission error scatter from one machine to the next. How do the jumps
scatter, and which parameter has the largest effect? The end of the page has a link to
download the notebook.
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
# First-order effects of the parameters on the jump of the run-down, from one curve:

curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), harmonics=16), "Omega", (1.2, 0.6))
hb.plot.tornado(hb.analysis.sensitivity(curve["LP1"], ["zeta", "F_m", "e_scale"]))
plt.show()

# %%
# All designs and the nominal curve in one report:

hb.report(curve, title="Scatter of a production", studies=[found])
