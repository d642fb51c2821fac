"""Figures of trains: where the wheels are, how they turn and where they touch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.common.arguments import checked_arguments
from hbgear.gears.phasing import inner_first
from hbgear.gears.train import Train
from hbgear.plot.style import BRANCHES, COLOURS, GREY, axes_or_new, dress, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ARROW = 0.45  # radius of the arrow of a turning wheel, over that of the wheel


@checked_arguments()
def train(machine: Train, ax: Axes | None = None) -> Axes:
    """A train seen along its axes: wheels with their teeth and sense of turning, shafts, bearings, lines of action.

    Wheels in one place, as of a train that only turns, are drawn side by side in the order in which they mesh.

    Parameters
    ----------
    machine : `Train`.
    ax : axes to draw on; new ones by default.

    Examples
    --------
    >>> import hbgear as hb
    >>> wheels = [hb.Wheel("in", 1e-3, teeth=20, base_radius=0.028, torque=50.0),
    ...           hb.Wheel("out", 4e-3, teeth=40, base_radius=0.056)]
    >>> axes = hb.plot.train(hb.Train(wheels, [hb.Mesh("in", "out", 4e8, 4e-5, eps=(0.2,))], balance="out"))
    """
    found = machine._kinematics
    wheels = {wheel.name: wheel for wheel in machine.wheels}
    radius = {name: wheel.base_radius / np.cos(0.35) for name, wheel in wheels.items()}
    usual = max(radius.values())
    size = {name: r or 0.25 * usual for name, r in radius.items()}
    places = _places(machine, size)
    with styled():
        ax = axes_or_new(ax, (5.6, 4.2))
        for shaft in machine.shafts:
            ends = np.array([places[shaft.first], places[shaft.second]])
            ax.plot(*ends.T, "-", color=GREY, linewidth=2.2, zorder=1, label="shaft", gid="shaft")
        for beam in machine.beams:
            ends = np.array([places[beam.first], places[beam.second]])
            ax.plot(*ends.T, "-", color=GREY, linewidth=4.5, alpha=0.6, zorder=1, label="shaft with mass", gid="beam")
        for i, (mesh, angles) in enumerate(zip(machine.meshes, found.angles, strict=True)):
            _line_of_action(ax, machine, i, mesh, angles, places, size)
        for bearing in machine.bearings:
            _bearing(ax, machine, bearing, places[bearing.at] - [0.0, 0.12 * 1e3 * size[bearing.at]])
        for name, wheel in wheels.items():
            _wheel(ax, wheel, places[name], size[name], float(found.speeds[name]))
        ax.set_aspect("equal")
        ax.set_xlabel("x [mm]")
        ax.set_ylabel("y [mm]")
        ax.margins(0.08)
        dress(ax)
        handles: dict[str, Any] = {}
        for line in ax.lines:
            if not str(line.get_label()).startswith("_"):
                handles.setdefault(str(line.get_label()), line)
        ax.legend(handles.values(), handles.keys(), loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
    return ax


def _places(machine: Train, size: dict[str, float]) -> dict[str, np.ndarray]:
    """Centres [mm]; side by side, from mesh to mesh, where wheels that mesh are all in one place."""
    given = {w.name: 1e3 * np.array([w.x, w.y]) for w in machine.wheels}
    if np.ptp([*given.values()], axis=0).max() > 0:
        return given
    placed = {machine.meshes[0].first: np.zeros(2)}
    while True:
        pairs = [(m.first, m.second) for m in machine.meshes] + [(s.first, s.second) for s in machine.shafts]
        meshing = len(machine.meshes)
        for k, pair in enumerate(pairs):
            for a, b in (pair, pair[::-1]):
                if a in placed and b not in placed:
                    wheels = {w.name: w for w in machine.wheels}
                    rings = wheels[a].internal or wheels[b].internal
                    way = abs(size[a] - size[b]) if rings else size[a] + size[b]
                    step = np.array([way, 0.0]) if k < meshing else np.array([0.0, 1.2 * (size[a] + size[b])])
                    placed[b] = placed[a] + 1e3 * step
                    break
            else:
                continue
            break
        else:
            return {name: placed.get(name, np.zeros(2)) for name in given}


def _bearing(ax: Axes, machine: Train, bearing: Any, place: np.ndarray) -> None:
    """A triangle, open, or a ring of one with clearance; on a line if it sits on the housing."""
    shape, label = ("o", "bearing with clearance") if bearing.clearance else ("^", "bearing")
    ax.plot(*place[:, None], shape, color="black", markersize=5, fillstyle="none", label=label)
    if machine.housing and bearing.at in machine.housing.seats:
        ax.plot(*place[:, None], "_", color="black", markersize=11, markeredgewidth=2.0, label="on the housing")


def _wheel(ax: Axes, wheel: Any, place: np.ndarray, size: float, speed: float) -> None:
    """A circle with the name, the teeth and an arrow of the sense in which it turns."""
    from matplotlib.patches import Circle, FancyArrowPatch

    r = 1e3 * size
    colour = COLOURS["no_impact"]
    style: Any = {"linestyle": "-" if wheel.teeth else "--", "linewidth": 2.2 if wheel.internal else 1.2}
    ax.add_patch(Circle(tuple(place), r, fill=False, edgecolor=colour, zorder=2, **style))
    ax.plot(*place, "+", color="black", markersize=5)
    told = f"{wheel.name}\n{wheel.teeth} teeth" if wheel.teeth else wheel.name
    ring = wheel.internal
    ax.annotate(told, (place[0], place[1] + (0.78 * r if ring else 0.12 * r)), ha="center", va="bottom", fontsize=8)
    if wheel.unbalance:
        there = place + 0.7 * r * np.array([np.cos(wheel.unbalance_angle), np.sin(wheel.unbalance_angle)])
        ax.plot(*there[:, None], "o", color="black", markersize=4, label="unbalance")
    if speed:
        at = _ARROW * r if not ring else 0.94 * r
        turn = np.sign(speed)
        begin, end = (place + at * np.array([np.cos(a), np.sin(a)]) for a in (-1.9 - 0.5 * turn, -1.9 + 0.7 * turn))
        ax.add_patch(FancyArrowPatch(tuple(begin), tuple(end), connectionstyle=f"arc3,rad={0.3 * turn}",
                                     arrowstyle="-|>", mutation_scale=9, color=colour, linewidth=1.0))  # fmt: skip


def _line_of_action(
    ax: Axes, machine: Train, i: int, mesh: Any, angles: tuple[float, float], places: dict[str, np.ndarray],
    size: dict[str, float],
) -> None:  # fmt: skip
    """A line through the pitch point in the direction of the force, and the order and lag of the mesh beside it."""
    found = machine._kinematics
    outer, inner = inner_first(mesh, {wheel.name: wheel for wheel in machine.wheels})
    alpha, phi = angles
    if not np.ptp([(w.x, w.y) for w in machine.wheels], axis=0).max():
        away = places[inner.name] - places[outer.name]
        phi = float(np.arctan2(away[1], away[0])) + (np.pi if inner.internal else 0.0)
    r = 1e3 * size[outer.name]
    pitch = places[outer.name] + r * np.array([np.cos(phi), np.sin(phi)])
    n = np.array([np.sin(alpha), found.sides[i] * np.cos(alpha)])
    n = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]]) @ n
    ends = np.array([pitch - 0.55 * r * n, pitch + 0.55 * r * n])
    colour = BRANCHES[(i + 1) % len(BRANCHES)]
    cycles = found.lags[i] / (2 * np.pi)
    ax.plot(*ends.T, color=colour, linewidth=1.5, zorder=3, gid=f"mesh {mesh.name}",
            label=f"{mesh.name}: order {found.orders[i]}, lag {cycles:.3g} cycles")  # fmt: skip
