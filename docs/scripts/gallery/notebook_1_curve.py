"""
Notebook: a model, its curve, its motions
=========================================

A notebook displays the last line of a cell: a model as a table of its parameters, a curve
with its jumps and its figure. The end of the page has a link to download the notebook.
"""

import matplotlib.pyplot as plt

import hbgear as hb

pair = hb.SpurPair(zeta=0.04, reference=(38000.0, 37.6e-6, 15000.0, 25))
pair

# %%
# Long computations report their progress to ``progress``. `ProgressBar` is a bar in
# notebooks and a line in terminals.

bar = hb.ProgressBar("a spur pair")
curve = hb.trace(hb.HarmonicBalance(pair, harmonics=16), "Omega", (1.5, 0.3), progress=bar)
bar

# %%

curve

# %%
# Special points are selected by label. The motion from which a run-down jumps:

fig, (left, right) = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained")
hb.plot.time_history(curve["LP1"], ax=left)
hb.plot.phase_diagram(curve["LP1"], ax=right)
plt.show()

# %%
# Points of the curve as a table with units (extra: ``pip install '.[data]'``):

curve.to_dataframe()[["Omega", "pinion_rpm", "stable", "regime_gap", "pp2_gap"]].head()
