"""Rattle of an idle gear pair behind an engine: largest mesh forces and travel of the teeth over speed, for four drags.

    python -m studies.gears.rattle [--quick] [-o DIR]

25 and 40 teeth, module 3 mm, 20 mm wide, backlash 80 um. The torque on the pinion is a light drag T_0 and engine
order 2 of amplitude 12 N m, of which 72 % act on the mesh, because the torque accelerates the pinion too. The orders of
the mesh are far above that of the engine and are left out: the stiffness is the mean one, and Omega is the frequency of
the torque over the natural frequency of the mesh. The damping ratio 0.06 is assumed.

    x'' + 2 zeta x' + p(x) = F_0 + F_2 cos(Omega t)

Far below the resonance the flanks separate if F_2 > F_0. The last loss of contact above the resonance, the point GR of
the curve, is compared with the closed form (1 - Omega^2)^2 + (2 zeta Omega)^2 = (F_2 / F_0)^2. Slow sweeps in time at
rising speed give the motions: filled symbols repeat after one period of the torque, open ones after several, and
crosses do not repeat within 3000 periods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from studies import study

DRAGS = (1.0, 4.0, 8.0, 16.0)
"""Mean torque on the pinion [N m]."""
FLUCTUATION, ENGINE_ORDER, DAMPING = 12.0, 2, 0.06
"""Amplitude [N m] and order of the torque, and damping ratio of the mesh."""
SPEEDS = (1000.0, 9000.0)
"""Range of the speed of the pinion [r/min]."""
TEETH = 25
"""Teeth of the pinion."""
HALF_BACKLASH = 37.6
"""Along the line of action [um]."""
COUNT = 65
"""Number of speeds of a sweep."""


@dataclass(frozen=True)
class Case:
    """A drag with the sweep in time at rising speed."""

    drag: float
    rpm: np.ndarray
    """Speed of the pinion [r/min]."""
    force: np.ndarray
    """Largest mesh force [N]."""
    travel: np.ndarray
    """Half peak-to-peak displacement along the line of action [um]."""
    period: np.ndarray
    """In periods of the torque; 0 where the motion does not repeat."""
    static: float
    """Mean mesh force [N]."""
    ratio: float
    """Alternating force over mean force."""
    contact: float
    """Omega of the last loss of contact by the curve."""
    closed_form: float
    """The same in closed form."""


def machine(drag: float) -> tuple[hb.SpurPair, Any]:
    """Return the model of a drag [N m] whose Omega is the frequency of the torque, and the units of its mesh."""
    gears = [hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (TEETH, 40)]
    scales = hb.GearPair(*gears, backlash="80 um").model(drag, DAMPING, mesh="tangent").scales
    unit = scales.force * gears[0].base_diameter / 2
    pinion, wheel = (one.inertia_used / one.base_diameter**2 for one in gears)
    torque = hb.mechanics.Series(cosine=(FLUCTUATION / unit * wheel / (pinion + wheel),))
    return hb.SpurPair(zeta=DAMPING, F_m=drag / unit, eps=(), e=(), fluctuation=torque), scales


def case(drag: float, count: int) -> Case:
    """Sweep one drag, and find where contact is lost for the last time at rising speed."""
    model, scales = machine(drag)
    rpm = np.linspace(*SPEEDS, count)
    found = hb.time.sweep(model, rpm * ENGINE_ORDER / TEETH / scales.pinion_speed(1.0), "up")
    ratio = float(model.fluctuation.row()[1]) / model.F_m
    squares = np.roots([1.0, 4 * model.zeta**2 - 2, 1 - ratio**2])
    last = float(np.sqrt(max(squares.real)))
    curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", (last + 0.3, last - 0.1), stability=False)
    grazing = [point.parameters["Omega"] for point in curve.special if point.kind == "GR"]
    return Case(
        drag,
        rpm,
        (found.max[:, 0] - 1.0) * scales.force,
        found.pp2[:, 0] * scales.length * 1e6,
        found.period,
        model.F_m * scales.force,
        ratio,
        max(grazing),
        last,
    )


def run(quick: bool = False) -> tuple[Case, ...]:
    """All drags; the quick form has two with few speeds."""
    return tuple(case(drag, 3) for drag in DRAGS[1::2]) if quick else tuple(case(drag, COUNT) for drag in DRAGS)


def plot(results: Sequence[Case]) -> Figure:
    """Largest forces above, travel of the teeth below."""
    figure, (top, low) = plt.subplots(2, 1, figsize=(6.6, 5.6), sharex=True, layout="constrained")
    for c, color in zip(results, (study.BLUE, study.ORANGE, study.PURPLE, study.GREEN), strict=False):
        looks: tuple[tuple[np.ndarray, dict[str, str]], ...] = (
            (c.period == 1, {"marker": "o"}),
            (c.period > 1, {"marker": "o", "mfc": "white"}),
            (c.period == 0, {"marker": "x"}),
        )
        for ax, y in ((top, c.force), (low, c.travel)):
            ax.plot(c.rpm, y, "-", color=color, lw=0.7)
            for which, look in looks:
                ax.plot(c.rpm[which], y[which], linestyle="none", ms=3.5, color=color, **look)
        top.plot([], [], "o-", color=color, ms=3.5, label=f"drag {c.drag:g} N m, mean force {c.static:.0f} N")
    low.axhline(HALF_BACKLASH, color=study.GREY, lw=0.8, ls="--")
    low.annotate(
        "half of the backlash", (SPEEDS[1], HALF_BACKLASH), (0, -11), textcoords="offset points", fontsize=8, ha="right"
    )
    top.set(ylabel="largest mesh force [N]")
    low.set(xlabel="speed of the pinion [r/min]", ylabel=r"half peak-to-peak of $x$ [$\mu$m]", yscale="log")
    top.legend(loc="best")
    return figure


def report(results: Sequence[Case]) -> str:
    """Return a table of the drags."""
    lines = [
        f"Idle pair 25/40, engine order {ENGINE_ORDER} of {FLUCTUATION:g} N m on the pinion, damping ratio "
        f"{DAMPING:g}, {SPEEDS[0]:g} to {SPEEDS[1]:g} r/min.",
        "",
        "| drag [N m] | F_2 / F_0 | mean force [N] | largest force [N] | at r/min | speeds without a periodic motion | "
        "last loss of contact, Omega of the curve | closed form |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for c in results:
        i, wild = int(np.argmax(c.force)), int(np.sum(c.period == 0))
        lines.append(
            f"| {c.drag:g} | {c.ratio:.2f} | {c.static:.0f} | {c.force[i]:.0f} | {c.rpm[i]:.0f} | {wild} of "
            f"{len(c.rpm)} | {c.contact:.6f} | {c.closed_form:.6f} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    study.main()
