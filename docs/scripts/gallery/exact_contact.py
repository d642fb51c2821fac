"""
Exact contact and sampled contact
=================================

The same fold with the force of the teeth projected exactly, and from N samples per period.
"""

import matplotlib.pyplot as plt

import hbgear as hb


def fold(**settings):
    """Frequency of the lower fold of the spur pair with ten harmonics."""
    problem = hb.HarmonicBalance(hb.SpurPair(), 10, **settings)
    curve = hb.trace(problem, "Omega", (1.2, 0.65), stability=False, accuracy=None)
    return min(point.parameters["Omega"] for point in curve.special if point.kind == "LP")


exact = fold()
counts = [128, 256, 512, 1024, 2048, 4096, 8192]
errors = [abs(fold(samples=N, sampled=True) - exact) for N in counts]
plt.rcParams.update(hb.plot.STYLE)
figure, ax = plt.subplots(figsize=(5.2, 3.6), layout="constrained")
ax.loglog(counts, errors, "o-", label="sampled contact")
ax.loglog(
    counts, [errors[0] * (counts[0] / N) ** 2 for N in counts], "k:", label="$N^{-2}$"
)
ax.set(xlabel="samples per period $N$ [-]", ylabel=r"error of the fold's $\Omega$ [-]")
ax.legend()
plt.show()

# %%
# Where the samples fall beside the corners is a matter of chance, and so is a part of the
# error. The exact projection has none of it.
