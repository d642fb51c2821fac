"""
Notebook: a model, its curve, its motions
=========================================

In a notebook the last line of a cell is shown: a model as a table of its parameters, a
curve with its jumps and its figure. Download this page as a notebook at its end.
"""

import matplotlib.pyplot as plt

import hbgear as hb

pair = hb.SpurPair(zeta=0.04, reference=(38000.0, 37.6e-6, 15000.0, 25))
pair

# %%
# Whatever takes long tells how far it is to ``progress``. `ProgressBar` is a bar in
# notebooks, and a line in terminals.

bar = hb.ProgressBar("a spur pair")
curve = hb.trace(hb.HarmonicBalance(pair, harmonics=16), "Omega", (1.5, 0.3), progress=bar)
bar

# %%

curve

# %%
# Its points are found by label. The motion from which a run-down jumps:

fig, (left, right) = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained")
hb.plot.time_history(curve["LP1"], ax=left)
hb.plot.phase_diagram(curve["LP1"], ax=right)
plt.show()

# %%
# Rows of the curve as a table, with its units (extra: ``pip install '.[data]'``):

curve.to_dataframe()[["Omega", "pinion_rpm", "stable", "regime_gap", "pp2_gap"]].head()
