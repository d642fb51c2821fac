"""Rig of Kahraman & Blankenship: jumps of its unmodified pair at four torques, and what is known of them.

    python -m studies.gears.rig [--quick] [-o DIR]

A. Kahraman, G. W. Blankenship, "Experiments on nonlinear dynamic behavior of an oscillator with clearance and
periodically time-varying parameters", J. Appl. Mech. 64 (1997) 217-226: a four-square rig whose dynamic transmission
error was measured by encoders, with slow sweeps in both directions.

How far its data are public: the gears (50 and 50 teeth, module 3 mm, 20 degrees, 20 mm wide, 150 mm apart) and the
torques are, as later papers quote them (the paper itself was not at hand). The measured curves are figures, of which no
number is used here, nor is a digitised one. Inertia (solid gears), backlash (150 um) and damping ratio (0.05) are
assumed. So what is held against the experiment is what it showed and is told in words: softening jumps at the natural
frequency and at half of it, at the same frequencies for all loads, with motions that grow in proportion to the load as
long as teeth do not meet on their backs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.gears.drawing import response

TORQUES = (85.0, 170.0, 255.0, 340.0)
DAMPING, SPAN, HARMONICS = 0.05, (1.4, 0.35), 24


@dataclass(frozen=True)
class Case:
    """One torque [N m], its model and curve, and its natural frequency [Hz]."""

    torque: float
    model: hb.SpurPair
    curve: hb.Branch
    natural: float

    def jumps(self) -> list[tuple[float, int, float]]:
        """Mesh frequency [Hz], direction, and dynamic factor before, of each jump, ascending."""
        hertz = self.model.scales.mesh_frequency
        return sorted(
            (float(hertz(jump.value)), jump.direction, hb.dynamic_factor(self.model, jump.before))
            for one in (self.curve, *self.curve.others)
            for jump in one.jumps()
        )

    def largest(self) -> float:
        """Largest alternating rms of stable motions [um]."""
        stable = np.asarray(self.curve.stable)
        return float(self.curve.amplitude("rms")[stable].max() * self.model.scales.length * 1e6)


def case(torque: float) -> Case:
    """Trace one."""
    gears = (hb.Gear(teeth=50, module="3 mm", face_width="20 mm") for _ in range(2))
    model = hb.GearPair(*gears, backlash="150 um").model(torque, DAMPING)
    curve = hb.trace(hb.HarmonicBalance(model, HARMONICS), "Omega", SPAN)
    return Case(torque, model, curve, float(model.scales.mesh_frequency(1.0)))


def run(quick: bool = False) -> tuple[Case, ...]:
    """All torques; two in the quick form."""
    return tuple(case(torque) for torque in (TORQUES[1::2] if quick else TORQUES))


def plot(results: Sequence[Case]) -> Figure:
    """Alternating rms of the dynamic transmission error over the mesh frequency."""
    figure, ax = plt.subplots(figsize=(6.8, 4.4), layout="constrained")
    for c, color in zip(results, draw.BRANCHES, strict=False):
        scales, name = c.model.scales, f"{c.torque:g} N m"
        response(ax, c.curve, "rms", scales.mesh_frequency, scales.length * 1e6, color, name)
    ax.plot([], [], "--", color="#555555", label="unstable")
    ax.set(xlabel="mesh frequency [Hz]", ylabel=r"dynamic transmission error, alternating rms [$\mu$m]")
    ax.set_ylim(bottom=0)
    ax.legend(loc="upper right")
    return figure


def report(results: Sequence[Case]) -> str:
    """Jumps, and the claims with their verdicts, in Markdown."""
    lines = ["| torque [N m] | natural frequency [Hz] | jumps at [Hz], dynamic factor before | largest rms [um] |",
             "| --- | --- | --- | --- |"]  # fmt: skip
    for c in results:
        jumps = (
            ", ".join(f"{hz:.0f}{'+' if way > 0 else '-'} ({factor:.1f})" for hz, way, factor in c.jumps()) or "none"
        )
        lines.append(f"| {c.torque:g} | {c.natural:.0f} | {jumps} | {c.largest():.2f} |")
    lines += ["", "| what the experiment showed | here | |", "| --- | --- | --- |"]
    lines += [f"| {claim} | {found} | {'yes' if so else 'no'} |" for claim, found, so in claims(results)]
    return "\n".join([*lines, ""])


def claims(results: Sequence[Case]) -> list[tuple[str, str, bool]]:
    """What is told of the experiment, what comes out here, and whether they agree."""
    upper = [[j for j in c.jumps() if j[0] > 0.55 * c.natural] for c in results]
    lower = [[j for j in c.jumps() if j[0] < 0.55 * c.natural] for c in results]
    widths = [(min(j[0] for j in js if j[1] < 0), max(j[0] for j in js if j[1] > 0)) for js in upper if len(js) > 1]
    spread = max(abs(w[i] / widths[0][i] - 1) for w in widths for i in (0, 1))
    per_load = [c.largest() / c.torque for c in results]
    apart = max(per_load) / min(per_load) - 1
    return [
        ("the resonance softens: it jumps down in speed at a lower frequency than up",
         "; ".join(f"{a:.0f} and {b:.0f} Hz" for a, b in widths), all(a < b for a, b in widths)),
        ("jumps below the natural frequency, which contact loss lowers",
         f"upper jumps at {widths[0][1] / results[0].natural:.2f} of it",
         all(w[1] < c.natural for w, c in zip(widths, results, strict=True))),
        ("a second resonance near half the natural frequency",
         f"{sum(map(bool, lower))} of {len(results)} torques jump there", all(map(bool, lower))),
        ("jumps hardly move (5 %) when the load is four times as large",
         f"by up to {100 * spread:.1f} %, as the contact of the teeth stiffens", spread < 0.05),
        ("motion in proportion to the load", f"largest rms per load within {100 * apart:.0f} %", apart < 0.1),
    ]  # fmt: skip


if __name__ == "__main__":
    study.main()
