"""Your own event: frequencies at which the largest deflection reaches a limit.

    python examples/own_event.py [--quick]

Prints:

    limit1 at Omega = 0.8924: the largest deflection is 1.3
    limit2 at Omega = 0.7662: the largest deflection is 1.3
"""

import sys

import hbgear as hb

limit = hb.Event("limit", lambda point: point.amplitude("max") - 1.3, "the largest deflection is 1.3")
problem = hb.HarmonicBalance(hb.SpurPair(), 8 if "--quick" in sys.argv else 16)
curve = hb.trace(problem, "Omega", (1.2, 0.6), events=[limit])
for point in curve.special:
    if point.kind == "limit":
        print(f"{point.label} at Omega = {point.parameters['Omega']:.4f}: {point.meaning}")
