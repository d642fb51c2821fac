"""Search over the unstated line of centres and torque of a half for readings with all statements of Figures 3 and 4.

    python -m studies.dong_2022.search [--quick] [-o DIR]

The paper does not state the angle phi of the line of centres, the division of the torque, and the circle of the helix
angle. All three are varied together; each cell of the figure is one response curve, and its number counts the
statements of `readings` that hold. A reading that is found in this way has been selected by its agreement with these
six statements. It is no evidence that the authors used it: the claims of other figures have to decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from studies import study
from studies.dong_2022 import readings
from studies.dong_2022.claims import Case

ANGLES = tuple(float(x) for x in range(-90, 90, 10))
"""phi [degrees]; phi and phi + 180 degrees are the same pair turned over."""
TORQUES = (500.0, 600.0, 700.0, 800.0, 900.0, 1000.0, 1200.0, 1400.0)
"""On each half of the pinion [N m]; 700 N m is the torque of the paper divided over both halves."""
HELICES: tuple[Literal["pitch", "base"], ...] = ("pitch", "base")
"""Circle of the helix angle."""
SPAN, HARMONICS = (1.05, 0.3), 12
"""Range of Omega that the six statements need, and harmonics: the folds change by 3e-7 with 16."""


@dataclass(frozen=True)
class Cell:
    """One reading: its choices, its numbers and the statements that hold."""

    helix: str
    phi: float
    torque: float
    case: Case
    held: tuple[bool, ...]


def run(quick: bool = False) -> list[Cell]:
    """All cells; the quick form has the reading that was found and three neighbours."""
    if quick:
        return [cell("base", phi, torque) for phi, torque in product((-10.0, 0.0), (700.0, 900.0))]
    return [cell(helix, phi, torque) for helix, phi, torque in product(HELICES, ANGLES, TORQUES)]


def cell(helix: Literal["pitch", "base"], phi: float, torque: float) -> Cell:
    """Trace one reading."""
    machine = hb.gears.DoubleHelicalPair(torque=torque, phi_deg=phi, mesh_helix=helix)
    found = readings.assessed(machine, SPAN, HARMONICS)
    return Cell(helix, phi, torque, found["case"], found["held"])


def complete(cells: Sequence[Cell]) -> list[Cell]:
    """Those for which all statements hold."""
    return [one for one in cells if all(one.held)]


def plot(cells: Sequence[Cell]) -> Figure:
    """Statements that hold over the torque and the angle, one panel for each circle of the helix angle."""
    figure, axes = plt.subplots(1, len(HELICES), figsize=(7.6, 4.6), layout="constrained", sharey=True)
    angles, torques = (sorted({getattr(one, name) for one in cells}) for name in ("phi", "torque"))
    total = len(readings.CLAIMS)
    for ax, helix in zip(axes, HELICES, strict=True):
        count = np.full((len(angles), len(torques)), np.nan)
        for one in cells:
            if one.helix == helix:
                count[angles.index(one.phi), torques.index(one.torque)] = sum(one.held)
        image = ax.imshow(count, origin="lower", aspect="auto", cmap="Blues", vmin=0, vmax=total)
        for i, j in np.argwhere(np.isfinite(count)).tolist():
            value = count[i, j]
            ax.text(
                j,
                i,
                f"{value:.0f}",
                ha="center",
                va="center",
                fontsize=7,
                color="white" if value > total / 2 else "black",
                weight="bold" if value == total else "normal",
            )
        ax.set_xticks(range(len(torques)), [f"{torque:g}" for torque in torques], rotation=90)
        ax.set_yticks(range(len(angles)), [f"{phi:g}".replace("-", "\N{MINUS SIGN}") for phi in angles])
        ax.set(xlabel="torque of a half [N m]", title=f"helix angle at the {helix} circle")
    axes[0].set_ylabel(r"line of centres $\varphi$ [deg]")
    figure.colorbar(image, ax=axes, label=f"statements of Figures 3 and 4 that hold, of {total}", shrink=0.8)
    return figure


def report(cells: Sequence[Cell]) -> str:
    """Counts, and the readings for which all statements hold."""
    total = len(readings.CLAIMS)
    counts = [sum(sum(one.held) == n for one in cells) for n in range(total + 1)]
    some = ", ".join(f"{count} hold {n}" for n, count in enumerate(counts) if count)
    lines = [f"{len(cells)} readings, of {total} statements: {some}.", ""]
    lines += ["| helix angle at | phi [deg] | torque of a half [N m] | jumps | peak | regimes |", "|" + " --- |" * 6]
    for one in complete(cells):
        jumps = ", ".join(f"{x:.5f}" for x in one.case.jumps)
        lines.append(
            f"| {one.helix} circle | {one.phi:g} | {one.torque:g} | {jumps} | {one.case.peak:.4f} at "
            f"{one.case.peak_at:.4f} | {', '.join(one.case.regimes)} |"
        )
    return "\n".join([*lines, "", NOTE, ""])


NOTE = (
    "These readings were selected by their agreement with the six statements out of all cells of the figure. That some "
    "choice of three unstated values agrees with six statements is weak evidence for the choice; the table of claims "
    "compares it with the other figures."
)
"""Below the table."""


if __name__ == "__main__":
    study.main()
