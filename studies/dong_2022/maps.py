"""Jump frequencies of the base case against damping, load, stiffness and error amplitudes, and backlash.

    python -m studies.dong_2022.maps [--quick] [-o DIR]

In each panel one parameter is changed from the base case (grey line: it is close to the cusp, without a jump). Between
the lines a slow sweep finds two motions, depending on where it came from; at the cusp (star) the jump vanishes. The
inset holds a second, smaller jump near Omega = 0.453. In the panel of W the damping is 0.05, as the base case has no
jump for any W: as no tooth makes contact at its back, the backlash cannot matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.plot import jump_map
from studies import study

SPANS = {
    "zeta": (0.019, 0.07),
    "torque": (600.0, 1600.0),
    "eps_scale": (0.8, 1.5),
    "e_scale": (0.7, 2.0),
    "b_c": (18e-6, 45e-6),
    "W": (-0.6, 0.6),
}
"""Parameters and their ranges."""
LOW = 0.05
"""Damping ratio of the map in W."""
CRITICAL = ("zeta", "torque", "eps_scale", "e_scale", "b_c")
Results = dict[str, Any]


@dataclass(frozen=True)
class Boundary:
    """Value and Omega at which the jump appears or vanishes, the base case's value, whether the jump is below."""

    value: float
    Omega: float
    own: float
    jump_below: bool

    @property
    def distance(self) -> float:
        """Change from the base case to the boundary, in percent."""
        return 100 * (self.value / self.own - 1)


def run(quick: bool = False) -> Results:
    """``maps`` and ``boundaries`` by parameter; the quick form has the load only, with few harmonics."""
    pair = hb.gears.DoubleHelicalPair()
    maps = {}
    for name in ("torque",) if quick else tuple(SPANS):
        model = pair.replace(zeta=LOW) if name == "W" else pair
        near = (1.0, 0.75) if quick else None
        few = (
            {"seeds": 2, "steps": hb.StepControl(first_step=0.05, max_step=0.2, max_turn_deg=45)}
            if quick
            else {"seeds": 3}
        )
        maps[name] = hb.jump_map(model, name, SPANS[name], frequencies=near, harmonics=6 if quick else 16, **few)
    boundaries = {name: boundary(name, 8 if quick else 16) for name in (("torque",) if quick else CRITICAL)}
    return {"maps": maps, "boundaries": boundaries}


def boundary(name: str, harmonics: int = 16) -> Boundary:
    """Where the jump near Omega = 0.88 vanishes."""
    pair = hb.gears.DoubleHelicalPair()
    found = hb.analysis.critical_parameter(pair, name, frequencies=(1.0, 0.75), harmonics=harmonics)
    return Boundary(found.value, found.Omega, pair.parameters[name], found.jump_below)


def plot(results: Results) -> Figure:
    """One panel for each parameter."""
    maps = results["maps"]
    columns = 3 if len(maps) > 3 else len(maps)
    rows = -(-len(maps) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(3.2 * columns, 2.9 * rows), layout="constrained", squeeze=False)
    for letter, ax, (name, found) in zip("abcdef", axes.flat, maps.items(), strict=False):
        jump_map(found, ax, legend=False, dimensionless=True)
        ax.set_title(f"({letter})", loc="left")
        ax.margins(y=0.2)
        if name == "W":
            ax.text(0.5, 0.5, rf"$\zeta$ = {LOW}", transform=ax.transAxes, ha="center", va="center")
        else:
            ax.axvline(
                hb.gears.DoubleHelicalPair().parameters[name], color=study.GREY, lw=0.9, zorder=0, label="base case"
            )
        if name == "zeta":
            _second_jump(ax, found)
    drawn = [*axes.flat[0].lines, *axes.flat[0].collections]
    handles = {str(artist.get_label()): artist for artist in drawn}
    shown = {label: artist for label, artist in handles.items() if not label.startswith("_")}
    figure.legend(list(shown.values()), list(shown), loc="outside upper center", ncols=len(shown))
    return figure


def _second_jump(ax: Axes, found: hb.analysis.JumpMap) -> None:
    """The neighbourhood of the second cusp, enlarged."""
    inset = ax.inset_axes((0.5, 0.14, 0.3, 0.4))
    jump_map(found, inset, legend=False, dimensionless=True)
    inset.set(xlim=(0.019, 0.0212), ylim=(0.4510, 0.4560), xlabel="", ylabel="")
    inset.set_title("second jump", fontsize=8, pad=3)
    inset.tick_params(labelsize=7)


def report(results: Results) -> str:
    """Critical values with the distance of the base case, and what W does."""
    lines = [
        "| parameter | base case | critical value | Omega there | a jump exists | change from the base case [%] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, b in results["boundaries"].items():
        side = "below" if b.jump_below else "above"
        lines.append(f"| {name} | {b.own:g} | {b.value:.6g} | {b.Omega:.4f} | {side} | {b.distance:+.2f} |")
    return "\n".join([*lines, "", *_remarks(results), ""])


def _remarks(results: Results) -> list[str]:
    boundaries, maps = results["boundaries"], results["maps"]
    out = [
        "Load, error and b_c have one boundary between them: as long as no tooth makes contact at its back, the "
        "motion about "
        "the middle of the contact side, d - b, scales with load and error together, so only e b_c k_mean / T counts. "
        f"Base load over critical load {boundaries['torque'].own / boundaries['torque'].value:.5f}"
    ]
    out[0] += f", critical factor of the error {boundaries['e_scale'].value:.5f}." if "e_scale" in boundaries else "."
    if "zeta" in maps:
        small = [p for p in maps["zeta"].cusps if p.parameters["Omega"] < 0.6]
        out += [
            "",
            "A second jump: "
            + "; ".join(
                f"below zeta = {p.parameters['zeta']:.5f} at Omega = {p.parameters['Omega']:.4f}" for p in small
            )
            + ". Below zeta = 0.019 further folds follow in its neighbourhood, which are left out.",
        ]
    if "W" in maps:
        moved = [float(arm.Omega.max() - arm.Omega.min()) for arm in maps["W"].arms]
        out += [
            "",
            f"With zeta = {LOW} the jumps at Omega = "
            + " and ".join(f"{arm.Omega[0]:.5f}" for arm in maps["W"].arms)
            + f" move by at most {max(moved):.0e} over W from {SPANS['W'][0]} to {SPANS['W'][1]}: the gap only shifts "
            "the mean, so W has no critical value.",
        ]
    return out


if __name__ == "__main__":
    study.main()
