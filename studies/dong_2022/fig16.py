"""Figure 16: spectrum of the gap motion at Omega = 1, with the line measured at 1200 r/min.

    python -m studies.dong_2022.fig16 [--quick] [-o DIR]

Nearly all of the motion is in the first mesh order, as the paper says of its Figure 16.
"""

from __future__ import annotations

from matplotlib.figure import Figure

import hbgear as hb
from studies import study
from studies.dong_2022 import spectra

OMEGA = 1.0
Results = dict[str, hb.Point]


def run(quick: bool = False) -> Results:
    """The motion; the quick form is the same."""
    return {"motion": spectra.base_motion(OMEGA)}


def plot(results: Results) -> Figure:
    """The spectrum above the measured line."""
    point = results["motion"]
    return spectra.plot([(rf"$\Omega = 1$: {spectra.heading(point)}", point)], spectra.RIG[2])


def report(results: Results) -> str:
    """Amplitudes of the lines, and what the measured one says."""
    point, rig = results["motion"], spectra.RIG[2]
    ratio = point.amplitude("H1") / point.amplitude("H2")
    text = [
        f"The first order is {ratio:.0f} times the second. With 25 teeth the mesh frequency at {rig.speed:g} r/min is "
        f"{rig.mesh:g} Hz, not the {rig.lines[0]:g} Hz of the paper (order {rig.orders[0]:.2f}): {rig.lines[0]:g} Hz "
        f"would be {60 * rig.lines[0] / 25:g} r/min, or 24 teeth. Sidebands need a modulation by the rotation of a "
        "shaft (eccentricity, pitch errors), which the model does not have: its spectrum has mesh orders only, "
        "so that the sidebands of the rig are outside of the model."
    ]
    return spectra.page(results, text, OMEGA, rig)


if __name__ == "__main__":
    study.main()
