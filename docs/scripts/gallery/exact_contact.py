"""
Exact contact and AFT
=====================

The error of a fold if the contact force is computed by AFT (alternating frequency/time)
with N samples per period, compared with the exact projection.
"""

import matplotlib.pyplot as plt

import hbgear as hb


def fold(**settings):
    """Return the frequency of the lower fold of the spur pair with ten harmonics."""
    problem = hb.HarmonicBalance(hb.SpurPair(), 10, **settings)
    curve = hb.trace(problem, "Omega", (1.2, 0.65), stability=False, accuracy=None)
    return min(point.parameters["Omega"] for point in curve.special if point.kind == "LP")


exact = fold()
counts = [128, 256, 512, 1024, 2048, 4096, 8192]
errors = [abs(fold(samples=N, sampled=True) - exact) for N in counts]
plt.rcParams.update(hb.plot.STYLE)
figure, ax = plt.subplots(figsize=(5.2, 3.6), layout="constrained")
ax.loglog(counts, errors, "o-", label="AFT")
ax.loglog(
    counts, [errors[0] * (counts[0] / N) ** 2 for N in counts], "k:", label="$N^{-2}$"
)
ax.set(xlabel="samples per period $N$ [-]", ylabel=r"error of the fold's $\Omega$ [-]")
ax.legend()
plt.show()

# %%
# The positions of the samples relative to the breakpoints are arbitrary, so a part of the
# error is random. The exact projection has no sampling error.
