"""Your own machine as a model: a rotor with a casing; its fold is followed in the clearance.

    x'' + 2 zeta x' + x + p(x) = mu Omega^2 cos(Omega t),   p(x) = k max(|x| - gap, 0) sign x

    python examples/own_machine.py [--quick]

Prints:

    the rotor jumps if its clearance is below 1.487
"""

import sys
from dataclasses import dataclass

import hbgear as hb


@dataclass(frozen=True)
class Rub(hb.mechanics.Model):
    """An unbalanced rotor in a casing with clearance."""

    zeta: float = 0.05
    gap: float = 1.0
    k: float = 4.0
    mu: float = 0.15

    def system(self) -> hb.System:
        """Return the matrices, the casing as an element, and an unbalance that grows with Omega^2."""
        casing = hb.Element([1.0], hb.Backlash(b=self.gap, k=self.k), name="casing")
        unbalance = hb.Load(cosine={1: [self.mu]}, power=2)
        return hb.System([[1.0]], [[2 * self.zeta]], [[1.0]], [casing], unbalance)


problem = hb.HarmonicBalance(Rub(), 7 if "--quick" in sys.argv else 15)
curve = hb.trace(problem, "Omega", (0.6, 2.4))
folds = hb.trace(hb.continuation.FoldProblem(problem, "Omega"), "gap", (1.0, 3.0), start=curve["LP1"])
print(f"the rotor jumps if its clearance is below {folds['CP1'].parameters['gap']:.3f}")
