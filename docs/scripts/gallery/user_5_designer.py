"""
Designer: tolerances
====================

From the file of a gear pair,
:download:`gearbox.toml <../scripts/gallery/data/gearbox.toml>`, to the scatter of
its response and its jumps in production: damping and torque vary from one
machine to the next.
"""

from concurrent.futures import ThreadPoolExecutor

import hbgear as hb

model = hb.io.read_machine("data/gearbox.toml").model()
scatter = hb.design.latin_hypercube(
    8, damping=("uniform", 0.05, 0.08), torque=("uniform", 180, 220)
)  # [N m]
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
