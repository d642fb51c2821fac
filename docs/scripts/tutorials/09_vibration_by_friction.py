"""
Vibration by friction: limit cycles
===================================

A drive may vibrate at constant torque and speed, without an excitation. Friction whose
force falls with the sliding speed is the usual reason. The vibration begins at a Hopf point
of the equilibrium, and its frequency is an unknown.
"""

# %%
# The model
# ---------
# A belt drags a mass on a spring: the friction force falls with the sliding speed and rises
# again at high speed (Stribeck curve, smooth while the mass slides).

from dataclasses import dataclass

import hbgear as hb


@dataclass(frozen=True)
class Stribeck(hb.mechanics.Law):
    """Force of a belt with speed V on a mass with speed v, for sliding speeds s = V - v."""

    V: float

    def force(self, d, v, tau):
        s = self.V - v
        friction = 1.0 - 0.6 * s + 0.2 * s**3
        return -friction, 0.0 * d, -0.6 + 0.6 * s**2


@hb.mechanics.model
def mass_on_belt(V: float = 1.2, damping: float = 0.1) -> hb.System:
    spring = hb.Element([1.0], Stribeck(V), name="mass")
    return hb.System([[1.0]], [[damping]], [[1.0]], [spring])


# %%
# Onset of the vibration
# ----------------------
# At high speed the equilibrium is stable. It loses its stability where the falling
# friction exceeds the damping, 0.6 - 0.6 V^2 = 0.1:

(hopf,) = hb.analysis.hopf_points(mass_on_belt(), "V", (1.2, 0.6))
exact = (0.5 / 0.6) ** 0.5
print(f"belt speed {hopf.value:.6f}, exact {exact:.6f}, frequency {hopf.Omega:.6f}")

# %%
# The limit cycles
# ----------------
# Below this speed the mass vibrates; the amplitude grows as the speed falls.

cycles = hb.analysis.limit_cycles(mass_on_belt(), hopf, (0.85, 1.2), harmonics=9)
print(cycles.message, "- stable" if cycles.stable.all() else "- partly unstable")
hb.plot.response(cycles, "pp2")

# %%
# The motion in one period. The speed of the mass stays below that of the belt: it slides
# all the time, as the law assumes.

last = cycles[-1]
print(f"frequency {last.parameters['Omega']:.5f}")
rate = last.parameters["Omega"] * last.samples("mass", order=1)[1]
print(f"largest speed {rate.max():.3f}, belt {last.parameters['V']:.3f}")
hb.plot.phase_diagram(last, "mass")
