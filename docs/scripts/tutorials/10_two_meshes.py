"""
Two meshes without a common frequency
=====================================

Two gear stages on shafts that are coupled by a belt, or a mesh and an engine order,
excite a machine with two frequencies. If their ratio is not one of small integers, the
motion is not periodic. It lies on a torus, and is computed by harmonic balance with two
frequencies.
"""

# %%
# The model
# ---------
# Two masses, two meshes with varying stiffness and transmission error, and a mean torque.
# The names of the elements of the second mesh select what follows the second frequency.

import math

import hbgear as hb


@hb.mechanics.model
def two_meshes(error: float = 0.02) -> hb.System:
    Series = hb.mechanics.Series
    teeth = hb.Backlash(1.0, stiffness=Series(mean=1.0, cosine=(0.1,)))
    springs = [
        hb.Element([1.0, 0.0], teeth, Series(cosine=(0.03,)), name="first mesh"),
        hb.Element([1.0, -1.0], teeth, Series(cosine=(error,)), name="second mesh"),
    ]
    load = hb.Load(constant=[0.0, 0.3])
    return hb.System(
        [[1.0, 0.0], [0.0, 1.0]],
        [[0.2, 0.0], [0.0, 0.2]],
        [[0.0, 0.0], [0.0, 0.0]],
        springs,
        load,
    )


# %%
# The curve of tori
# -----------------

ratio = math.sqrt(2)  # tooth frequency of the second mesh over that of the first one
curve = hb.analysis.two_tones(
    two_meshes(), ratio, (1.9, 0.4), elements=["second mesh"], harmonics=(7, 7)
)
print(curve.message)
axes = hb.plot.torus(curve, "pp2", "first mesh", label="first mesh")
hb.plot.torus(curve, "pp2", "second mesh", ax=axes, label="second mesh", color="black")
_ = axes.set_ylabel("half peak-to-peak of each mesh")

# %%
# One motion
# ----------
# The section at the phase zero of the first mesh is a closed curve; the spectrum has
# lines at all sums of multiples of both frequencies.

hb.plot.torus_section(curve, 10, "second mesh")

# %%

hb.plot.torus_spectrum(curve, 10, "second mesh")

# %%
# A common base
# -------------
# If the frequencies have a common base, the motion is periodic, and the message states
# the base and the orders:

try:
    hb.analysis.two_tones(two_meshes(), 1.5, (1.9, 0.4), elements=["second mesh"])
except ValueError as error:
    print(error)
