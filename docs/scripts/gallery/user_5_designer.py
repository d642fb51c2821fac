"""
Designer: tolerances
====================

From the file of a gear pair,
:download:`gearbox.toml <../scripts/gallery/data/gearbox.toml>`, to the scatter of
its response and its jumps in production: damping and load vary from one
machine to the next.
"""

from concurrent.futures import ThreadPoolExecutor

import hbgear as hb

model = hb.io.read_machine("data/gearbox.toml").model()
load = ("uniform", 0.9 * model.F_m, 1.1 * model.F_m)
scatter = hb.design.latin_hypercube(8, zeta=("uniform", 0.05, 0.08), F_m=load)
with ThreadPoolExecutor(1) as executor:
    found = hb.design.cases(
        model,
        scatter,
        ("peak", "jumps", "curve"),
        span=(1.0, 0.6),
        harmonics=10,
        executor=executor,
    )
hb.plot.envelope(found)

# %%

found
