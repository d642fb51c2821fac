"""
Many designs
============

Damping, load and errors scatter from one machine to the next. Which jumps does a production
have?
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
# `cases` traces the response curve of each and keeps what is asked for. In a script of your
# own leave ``executor`` away: then the cases run in processes on all cores, and the part of
# the script that starts them stands below ``if __name__ == "__main__":``.

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
# What they have in common
# ------------------------
# The envelope of all response curves, as a slow run-up and a slow run-down see them:

hb.plot.envelope(found)

# %%
# Where the jumps are:

hb.plot.jump_distribution(found)

# %%
# And which parameter decides:

hb.plot.against_parameters(found)

# %%
# The numbers are a table, for other programs too: ``found.export("designs.csv")``.

for name, column in list(found.table.items())[:6]:
    print(f"{name:12s}", [round(float(value), 4) for value in column[:4]], "...")

# %%
# On the command line the same study is a file, ``hbgear study designs.toml``, which goes on
# where it was stopped and can run on a Dask cluster: :doc:`/howto/designs`.
