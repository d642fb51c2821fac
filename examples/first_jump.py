"""A spur pair with backlash: response curve, jumps of a slow sweep, and the motion at a fold.

    python examples/first_jump.py [--quick]

Prints:

    LP1 sweep down jumps at Omega = 0.7080, amplitude 0.2308 to 0.0352
    LP2 sweep up jumps at Omega = 0.8285, amplitude 0.0832 to 0.1900
"""

import sys

import hbgear as hb

harmonics = 8 if "--quick" in sys.argv else 16
pair = hb.HarmonicBalance(hb.SpurPair(), harmonics)
curve = hb.trace(pair, "Omega", (1.5, 0.3))
for jump in curve.jumps():
    direction = "up" if jump.direction > 0 else "down"
    before, after = (motion.amplitude("rms") for motion in (jump.before, jump.after))
    print(f"{jump.label} sweep {direction} jumps at Omega = {jump.value:.4f}, amplitude {before:.4f} to {after:.4f}")

if "--quick" not in sys.argv:
    hb.plot.save(hb.plot.response(curve), "first_jump.png")
    hb.plot.save(hb.plot.portrait(curve["LP1"]), "motion.png")
