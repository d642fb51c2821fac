"""The marine pair of the test rig from its drawing: comparison with the published data.

    python -m studies.gears.rig [--quick] [-o DIR]

Dong et al. (2022) publish the teeth of a double-helical pair (25 and 75, module 6 mm, 24.43 degrees, two halves of 55
mm), its masses and supports, a load, the backlash of their rig (51 um) and the frequencies of the lines they measured
at 400, 600 and 1200 r/min. They do not publish amplitudes of lines, the accuracy of the teeth, or the resonance
speeds of the rig. Three comparisons are possible: the mesh stiffness of the drawing with the assumed one, the responses
of the machine for both, and the measured lines with the mesh orders and their amplitudes computed from the drawing. The
teeth are those of the drawing without errors, so what excites is their deflection alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.gears.mesh.iso_stiffness import iso_stiffness
from studies import study
from studies.dong_2022.spectra import RIG

TORQUE = 1400.0
"""Of one half of the pinion [N m], as read from the paper."""
BACKLASH = 51e-6
"""Along the line of action [m], as measured on the rig."""


@dataclass(frozen=True)
class Results:
    """The mesh of the drawing, and curves by what excites them."""

    pair: hb.GearPair
    cycle: hb.gears.MeshCycle
    curves: dict[str, hb.Branch]


def pair() -> hb.GearPair:
    """One half of the pair."""
    own = hb.gears.DoubleHelicalPair()
    gears = (
        hb.gears.Gear(teeth=z, module=own.module, face_width=own.face_width, helix_angle=f"{sign * own.beta_deg} deg")
        for z, sign in ((own.teeth_p, 1), (own.teeth_g, -1))
    )
    return hb.GearPair(*gears, backlash=BACKLASH, backlash_measure="action")


def run(quick: bool = False) -> Results:
    """Both curves; the quick form has fewer harmonics and begins later."""
    half = pair()
    cycle = half.mesh(TORQUE)
    k_mean, stiffness, _ = cycle.functions(half.transverse_force(TORQUE))
    models = {
        "as published": hb.gears.DoubleHelicalPair(torque=TORQUE),
        "from the drawing": hb.gears.DoubleHelicalPair(torque=TORQUE, k_mean=k_mean, eps=(), stiffness=stiffness, e=()),
    }
    H, span = (6, (1.6, 0.6)) if quick else (16, (1.6, 0.03))
    return Results(
        half, cycle, {name: hb.trace(hb.HarmonicBalance(one, H), "Omega", span) for name, one in models.items()}
    )


def line(curve: hb.Branch, speed: float, order: int) -> float:
    """Amplitude of a mesh order of the left gap at a speed [nm]; nan if the curve does not go there."""
    model: Any = curve.problem.model
    places = crossings_at(curve, float(model.from_pinion_speed(speed)))
    if not places:
        return float("nan")
    return float(places[0].interpolate(curve.amplitude(f"H{order}")) * model.b_c * 1e9)


def plot(results: Results) -> Figure:
    """Mesh stiffness over two cycles; the response over the speed, with the speeds of the tests."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained", width_ratios=(2, 3))
    tau = np.linspace(0, 4 * np.pi, 400)
    for (name, curve), color in zip(results.curves.items(), (study.ORANGE, study.BLUE), strict=True):
        model: Any = curve.problem.model
        left.plot(tau / (2 * np.pi), model.k_mean * model.mesh_stiffness(tau) / 1e9, color=color, label=name)
        right.plot(model.pinion_speed(curve.values), curve.amplitude("pp2") * model.b_c * 1e6, color=color, label=name)
    left.axhline(
        iso_stiffness(results.pair).mesh * results.pair.face_width / 1e9,
        ls=":",
        color=draw.GREY,
        label="ISO 6336-1, mean",
    )
    left.set(xlabel="mesh cycles [-]", ylabel=r"$k$ of one half [$10^9$ N/m]", ylim=(0, None))
    left.legend(loc="lower right")
    for test in RIG:
        right.axvline(
            test.speed, color=draw.GREY, lw=0.8, ls="--", label="speeds of the tests" if test is RIG[0] else None
        )
    right.set(
        xlabel="speed of the pinion [r/min]",
        ylabel=r"half peak-to-peak of $d_L$ [$\mu$m]",
        yscale="log",
        xlim=(0, None),
    )
    right.legend(loc="lower right")
    return figure


def report(results: Results) -> str:
    """What can be compared, and what cannot."""
    drawing, published = (results.curves[name] for name in ("from the drawing", "as published"))
    k, half = results.cycle.stiffness, results.pair
    row = k.function().row(3) / k.mean
    eps = np.hypot(row[1::2], row[2::2])
    peaks = {
        name: float(curve.problem.model.pinion_speed(curve.values[np.argmax(curve.amplitude("pp2"))]))
        for name, curve in results.curves.items()
    }
    iso = iso_stiffness(half).mesh * half.face_width
    assumed: Any = published.problem.model
    lines = [
        f"Contact ratio {half.contact_ratio:.3f} across and {half.overlap_ratio:.3f} along the face: the teeth of the "
        f"drawing give one half {k.mean:.4g} N/m (ISO 6336-1: {iso:.4g}), the paper {assumed.k_mean:.4g}, which is "
        "near what both halves have together. Of this the first three orders are "
        f"{', '.join(f'{x:.4f}' for x in eps)}, and "
        f"{', '.join(f'{x:g}' for x in assumed.eps)} in the paper: helical teeth take over from each other gradually.",
        "",
        f"With the machine of the paper the largest motion is at {peaks['from the drawing']:.0f} r/min of the pinion "
        f"with the teeth of the drawing, at {peaks['as published']:.0f} as published, and the fastest test is at "
        f"{max(test.speed for test in RIG):.0f}. So no test can have reached the main resonance of this machine, or a "
        "jump of it; the paper pairs 1200 r/min with Omega = 1.",
        "",
        "| speed [r/min] | measured line [Hz] | mesh order | off that order by [Hz] | drawing [nm] "
        "| as published [nm] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for test in RIG:
        for found in test.lines:
            order = round(found / test.mesh)
            heights = " | ".join(
                "-" if np.isnan(x) else f"{x:.3g}"
                for x in (line(one, test.speed, order) for one in (drawing, published))
            )
            lines.append(f"| {test.speed:g} | {found:g} | {order} | {found - order * test.mesh:+.1f} | {heights} |")
    lines += [
        "",
        "All lines but two are orders of the mesh to the last digit printed; 506.7 Hz and 480 Hz are not. Their "
        "heights are not published: amplitudes cannot be compared, and no damping ratio can be identified.",
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    study.main()
