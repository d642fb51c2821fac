"""
Many designs
============

Damping, load and transmission error scatter from one machine to the next. How do the jumps
of a production scatter?
"""

# %%
# A sample
# --------

from concurrent.futures import ThreadPoolExecutor

import hbgear as hb

scatter = hb.design.latin_hypercube(
    40,
    zeta=("uniform", 0.04, 0.07),
    F_m=("normal", 0.1, 0.005),
    e_scale=("uniform", 0.8, 1.2),
)

# %%
# `design.cases` traces the response curve of each design and stores the selected results.
# In your own script omit ``executor``: the cases then run in processes on all cores. The
# code that starts them must be below ``if __name__ == "__main__":``.

with ThreadPoolExecutor(1) as executor:
    found = hb.design.cases(
        hb.SpurPair(),
        scatter,
        ("peak", "jumps", "curve"),
        span=(1.2, 0.6),
        harmonics=10,
        executor=executor,
    )
print(len(found), "cases,", len(found.failed), "failed")

# %%
# Results
# -------
# The envelope of all response curves, for a slow run-up and a slow run-down:

hb.plot.envelope(found)

# %%
# The distribution of the jump frequencies:

hb.plot.jump_distribution(found)

# %%
# The dependence on the parameters:

hb.plot.against_parameters(found)

# %%
# The results are a table, which can be exported: ``found.export("designs.csv")``.

for name, column in list(found.table.items())[:6]:
    print(f"{name:12s}", [round(float(value), 4) for value in column[:4]], "...")

# %%
# On the command line a study is a file: ``hbgear study designs.toml``. It can be resumed
# after an interruption and can run on a Dask cluster: :doc:`/howto/designs`.
