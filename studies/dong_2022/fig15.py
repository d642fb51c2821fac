"""Figure 15: spectrum of the gap motion at Omega = 1/2, with the lines measured at 600 r/min.

    python -m studies.dong_2022.fig15 [--quick] [-o DIR]

The second mesh order is the largest: at Omega = 1/2 it lies at omega_n, near the mode that also makes the peak of the
response curve. This is a superharmonic resonance (the paper says sub-harmonic).
"""

from __future__ import annotations

from matplotlib.figure import Figure

import hbgear as hb
from studies import study
from studies.dong_2022 import spectra

OMEGA = 1 / 2
Results = dict[str, hb.Point]


def run(quick: bool = False) -> Results:
    """The motion; the quick form is the same."""
    return {"motion": spectra.base_motion(OMEGA)}


def plot(results: Results) -> Figure:
    """The spectrum above the measured lines."""
    point = results["motion"]
    return spectra.plot([(rf"$\Omega = 1/2$: {spectra.heading(point)}", point)], spectra.RIG[1])


def report(results: Results) -> str:
    """Amplitudes of the lines, and what the measured ones say."""
    point, rig = results["motion"], spectra.RIG[1]
    ratio = point.amplitude("H2") / point.amplitude("H1")
    ratio_3 = point.amplitude("H3") / point.amplitude("H2")
    text = [
        f"The second order is {ratio:.2f} times the first: superharmonic resonance. The measured lines are exactly "
        "orders " + ", ".join(f"{order:g}" for order in rig.orders) + ", which every motion of the mesh period has. "
        f"The calculated spectrum of the paper shows the first two; here the third is {ratio_3:.3f} of the second."
    ]
    return spectra.page(results, text, OMEGA, rig)


if __name__ == "__main__":
    study.main()
