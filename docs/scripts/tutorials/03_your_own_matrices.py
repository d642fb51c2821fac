"""
Your own matrices
=================

A linear structure M, C, K with a small number of nonlinear elements: a chain of masses with
a stop at the last mass.
"""

# %%
# A system
# --------
# An `Element` has one direction in the structure and one force law. `Unilateral` is a stop:
# a spring beyond a gap.

import numpy as np

import hbgear as hb

n = 4
M = np.eye(n)
K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
C = 0.03 * K + 0.02 * M
last = np.eye(n)[-1]
stop = hb.Element(direction=last, law=hb.Unilateral(k=2.0, gap=1.0), name="stop")
chain = hb.System(M, C, K, elements=[stop], load=hb.Load(cosine={1: 0.3 * last}))

# %%
# The unknowns are the 2 H + 1 harmonic coefficients of the gap, independent of the number
# of masses.

problem = hb.HarmonicBalance(chain, harmonics=20)
curve = hb.trace(problem, "Omega", (0.3, 2.2))
print(curve.X.shape[1], "unknowns,", n, "masses")
hb.plot.response(curve)

# %%
# Motion of all coordinates
# -------------------------
# `HarmonicBalance.motion` returns the coefficients of every coordinate at a point.
# Amplitudes of all masses at the highest peak:

top = curve.peak("pp2")
q = problem.motion(top.X, Omega=top.parameters["Omega"])
first = np.hypot(q[:, 1], q[:, 2])
print(f"Omega = {top.parameters['Omega']:.4f}, first harmonics", first.round(3))

# %%
# A model
# -------
# A `System` has no parameters. A decorated function that returns a `System` is a model; its
# arguments are parameters that can be varied and followed.


@hb.mechanics.model(ranges={"zeta": hb.mechanics.Range(low=0)}, default_span=(0.3, 0.9))
def chain_with_stop(zeta: float = 0.03, gap: float = 1.0) -> hb.System:
    """A chain of four masses with a stop at the last one."""
    stop = hb.Element(direction=last, law=hb.Unilateral(k=2.0, gap=gap), name="stop")
    return hb.System(
        M, zeta * K + 0.02 * M, K, elements=[stop], load=hb.Load(cosine={1: 0.3 * last})
    )


curves = [
    hb.trace(
        hb.HarmonicBalance(chain_with_stop(gap=gap), 16),
        "Omega",
        chain_with_stop.default_span,
    )
    for gap in (0.5, 1.0, 1.5)
]
hb.plot.responses(curves, names=["gap 0.5", "gap 1", "gap 1.5"])

# %%
# Laws
# ----
# `Backlash`, `Unilateral`, `PiecewiseLinear` and `Cubic` are projected exactly;
# a `CompiledLaw` of your compiled function, and any class derived from `Law`, are evaluated
# by AFT (alternating frequency/time). :doc:`/extending` has an example of each.
