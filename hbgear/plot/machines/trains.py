"""Figures of gear trains and planetary sets: layout, senses of rotation, meshes, and load sharing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.analysis.loads.planet_loads import LoadSharing
from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.results.branch import Branch
from hbgear.gears.planets.planetary import PlanetarySet
from hbgear.gears.trains.train import Train
from hbgear.gears.trains.train_kinematics import inner_first
from hbgear.harmonic.equations.layout import layout_of
from hbgear.plot.branch_sections import sections
from hbgear.plot.style import BRANCHES, COLOURS, GREY, LINES, axes_or_new, dress, legend_handles, line_of, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BEHIND = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85}
"""Style of the box behind text on lines."""

_ARROW_RADIUS_RATIO = 0.45
"""Ratio of the radius of the rotation arrow to that of its wheel."""


@checked_arguments()
def train(machine: Train, ax: Axes | None = None) -> Axes:
    """Draw the axial view of a train: wheels with teeth and sense of rotation, shafts, bearings, lines of action.

    Wheels at the same position, as in a purely torsional train, are drawn side by side in the order of their meshes.

    Parameters
    ----------
    machine : Train
        Gear train.
    ax : Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> wheels = [hb.gears.Wheel("in", 1e-3, teeth=20, base_radius=0.028, torque=50.0),
    ...           hb.gears.Wheel("out", 4e-3, teeth=40, base_radius=0.056)]
    >>> axes = hb.plot.train(hb.gears.Train(wheels, [hb.gears.Mesh("in", "out", 4e8, 4e-5, eps=(0.2,))], balance="out"))
    """
    motion = machine._kinematics
    wheels = {wheel.name: wheel for wheel in machine.wheels}
    radius = {name: wheel.base_radius / np.cos(0.35) for name, wheel in wheels.items()}
    usual = max(radius.values())
    size = {name: r or 0.25 * usual for name, r in radius.items()}
    centres = _centres(machine, size)
    with styled():
        ax = axes_or_new(ax, (5.6, 4.2))
        for shaft in machine.shafts:
            ends = np.array([centres[shaft.first], centres[shaft.second]])
            ax.plot(*ends.T, "-", color=GREY, linewidth=2.2, zorder=1, label="shaft", gid="shaft")
        for beam in machine.beams:
            ends = np.array([centres[beam.first], centres[beam.second]])
            ax.plot(*ends.T, "-", color=GREY, linewidth=4.5, alpha=0.6, zorder=1, label="shaft with mass", gid="beam")
        for i, (mesh, angles) in enumerate(zip(machine.meshes, motion.angles, strict=True)):
            _line_of_action(ax, machine, i, mesh, angles, centres, size)
        for bearing in machine.bearings:
            _bearing(ax, machine, bearing, centres[bearing.at] - [0.0, 0.12 * 1e3 * size[bearing.at]])
        for name, wheel in wheels.items():
            _wheel(ax, wheel, centres[name], size[name], float(motion.speeds[name]))
        _names(ax, wheels, centres, size)
        _finish(ax, -0.15)
    return ax


@checked_arguments()
def planetary(machine: PlanetarySet, ax: Axes | None = None) -> Axes:
    """Draw the axial view of a planetary set: sun, planets, ring and carrier, with their senses of rotation.

    The label of each planet contains the lags of its meshes with the sun and with the ring, in mesh cycles.

    Parameters
    ----------
    machine : PlanetarySet
        Planetary set.
    ax : Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> axes = hb.plot.planetary(hb.gears.PlanetarySet(26, 34, 94, planets=3))
    """
    from matplotlib.patches import Circle

    per_tooth = 1e3 * machine.r_s / np.cos(np.radians(machine.alpha_s_deg)) / machine.teeth_s  # pitch radius of a tooth
    sun, planet, ring = (per_tooth * z for z in (machine.teeth_s, machine.teeth_p, machine.teeth_r))
    distance = sun + planet
    lags = np.asarray(machine.kinematics.lags).reshape(2, -1)
    cycles = np.round(lags / (2 * np.pi), 6) % 1  # without rounding errors
    speeds = {name: float(speed) for name, speed in machine.speeds.items()}
    with styled():
        ax = axes_or_new(ax, (5.4, 4.6))
        for name, r, teeth in (("sun", sun, machine.teeth_s), ("ring", ring, machine.teeth_r)):
            _circle(ax, np.zeros(2), r, f"{name} ({teeth} teeth), {_role(machine, name)}", heavy=name == "ring")
        ax.plot([], [], "-", color=BRANCHES[1], linewidth=1.2, label=f"planets ({machine.teeth_p} teeth)")
        ax.plot(0, 0, "+", color="black", markersize=5)
        for n, psi in enumerate(machine.angles):
            centre = distance * np.array([np.cos(psi), np.sin(psi)])
            arm: Any = {"color": GREY, "linewidth": 2.2, "zorder": 1, "label": f"carrier, {_role(machine, 'carrier')}"}
            ax.plot(*np.array([[0, 0], centre]).T, "-", **arm, gid=f"carrier {n + 1}")
            ax.add_patch(Circle(tuple(centre), planet, fill=False, edgecolor=BRANCHES[1], linewidth=1.2, zorder=2))
            text = f"p{n + 1}\n{cycles[0, n]:.3g} | {cycles[1, n]:.3g}"
            ax.annotate(text, tuple(centre), ha="center", va="center", fontsize=8, zorder=5, bbox=_BEHIND)
            spin = -(speeds["sun"] - speeds["carrier"]) * machine.teeth_s / machine.teeth_p  # in the carrier's frame
            _arrow(ax, centre, 0.62 * planet, spin)
        # angle between planets [rad]
        free = max(2 * np.pi / len(machine.angles) - 2 * np.arcsin(planet / distance), 0.3)
        between = 0.5 * (machine.angles[-1] + machine.angles[0]) + np.pi  # the arrow of the carrier avoids the planets
        for name, r, angle in (
            ("sun", 0.62 * sun, between),
            ("ring", 0.96 * ring, -1.8),
            ("carrier", distance, between),
        ):
            _arrow(ax, np.zeros(2), r, speeds[name], angle, free if name == "carrier" else 1.2)
        ax.set_title(f"{machine.phasing}; lag of the meshes with sun | ring [cycles]", fontsize=9)
        _finish(ax, -0.13)
    return ax


def _finish(ax: Axes, y: float) -> None:
    """Set equal scales, axis labels, and a legend at the height y below the axes."""
    ax.set_aspect("equal")
    ax.set(xlabel="x [mm]", ylabel="y [mm]")
    ax.margins(0.08)
    dress(ax)
    handles = legend_handles(ax.lines)
    ax.legend(handles.values(), handles.keys(), loc="upper center", bbox_to_anchor=(0.5, y), ncols=2)


def _role(machine: PlanetarySet, name: str) -> str:
    """Return whether a member is fixed, drives or is driven."""
    return "fixed" if name == machine.fixed else "drives" if name == machine.driver else "driven"


def _circle(ax: Axes, centre: np.ndarray, r: float, label: str, heavy: bool) -> None:
    theta, colour = np.linspace(0, 2 * np.pi, 200), COLOURS["no_impact"] if heavy else BRANCHES[2]
    x, y = centre[0] + r * np.cos(theta), centre[1] + r * np.sin(theta)
    ax.plot(x, y, "-", label=label, zorder=2, color=colour, linewidth=2.2 if heavy else 1.2)


@checked_arguments()
def load_sharing(found: LoadSharing, ax: Axes | None = None) -> Axes:
    """Draw load sharing along a branch: largest force of each mesh relative to the mean force of all meshes.

    Stable sections are solid, unstable ones dashed. Thin lines are the mean forces, relative to the same mean.

    Parameters
    ----------
    found : LoadSharing
        Result of `hbgear.analysis.load_sharing`.
    ax : Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    Axes
        The axes.

    Examples
    --------
    >>> import hbgear as hb
    >>> planets = hb.gears.PlanetarySet(planet_errors=(10e-6, 0.0, 0.0, 0.0))
    >>> curve = hb.trace(hb.HarmonicBalance(planets, 2), "Omega", (2.3, 2.28), stability=False)
    >>> axes = hb.plot.load_sharing(hb.analysis.load_sharing(curve))
    """
    curve, n = found.curve, len(found.meshes)
    with styled():
        ax = axes_or_new(ax, (5.6, 3.4))
        ax.axhline(1.0, color=GREY, linewidth=0.8, label="even, at rest")
        for j, name in enumerate(found.meshes):
            colour = BRANCHES[j % len(BRANCHES)]
            for i, ((_, stable), first, last) in enumerate(sections(curve, 0)):
                x, y = curve.values[first : last + 1], found.factor[first : last + 1, j]
                label = "_" if i else f"{name}: largest"
                ax.plot(x, y, **line_of(stable), color=colour, label=label, gid=f"mesh {name}")
            mean, label = n * found.share[:, j], f"{name}: mean" if n <= 4 else "_"
            ax.plot(curve.values, mean, color=colour, linewidth=0.7, alpha=0.7, label=label, gid=f"mean {name}")
        ax.set_xlabel(_label(curve))
        ax.set_ylabel("force over the mean of all meshes [-]")
        if "unstable" in curve.stability:
            ax.plot([], [], linestyle=LINES[False][0], color=GREY, label="unstable")
        ax.set_ylim(bottom=min(0.0, float(found.factor.min())))
        dress(ax)
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.2)
    return ax


def _label(curve: Branch) -> str:
    layout = layout_of(curve)
    return (layout.labels if layout else {}).get(curve.parameter, curve.parameter)


def _centres(machine: Train, size: dict[str, float]) -> dict[str, np.ndarray]:
    """Return the centres [mm]; wheels that all have the same position are set side by side, from mesh to mesh."""
    positions = {w.name: 1e3 * np.array([w.x, w.y]) for w in machine.wheels}
    if np.ptp([*positions.values()], axis=0).max() > 0:
        return positions
    placed = {machine.meshes[0].first: np.zeros(2)}
    internal = {w.name: w.internal for w in machine.wheels}
    pairs = [(pair, True) for pair in machine.meshes] + [(pair, False) for pair in machine.shafts]
    ways = [(*way, mesh) for pair, mesh in pairs for way in ((pair.first, pair.second), (pair.second, pair.first))]
    while (way := next((way for way in ways if way[0] in placed and way[1] not in placed), None)) is not None:
        a, b, mesh = way
        distance = abs(size[a] - size[b]) if internal[a] or internal[b] else size[a] + size[b]
        step = np.array([distance, 0.0]) if mesh else np.array([0.0, 1.2 * (size[a] + size[b])])
        placed[b] = placed[a] + 1e3 * step
    return {name: placed.get(name, np.zeros(2)) for name in positions}


def _bearing(ax: Axes, machine: Train, bearing: Any, centre: np.ndarray) -> None:
    """Draw a triangle, or a ring for a bearing with clearance; with a line below it if it is on the housing."""
    shape, label = ("o", "bearing with clearance") if bearing.clearance else ("^", "bearing")
    ax.plot(*centre[:, None], shape, color="black", markersize=5, fillstyle="none", label=label)
    if machine.housing and bearing.at in machine.housing.seats:
        ax.plot(*centre[:, None], "_", color="black", markersize=11, markeredgewidth=2.0, label="on the housing")


def _wheel(ax: Axes, wheel: Any, centre: np.ndarray, size: float, speed: float) -> None:
    """Draw a circle with an arrow of the sense of rotation."""
    from matplotlib.patches import Circle

    r = 1e3 * size
    colour = COLOURS["no_impact"]
    style: Any = {"linestyle": "-" if wheel.teeth else "--", "linewidth": 2.2 if wheel.internal else 1.2}
    ax.add_patch(Circle(tuple(centre), r, fill=False, edgecolor=colour, zorder=2, **style))
    ax.plot(*centre, "+", color="black", markersize=5)
    if wheel.unbalance:
        position = centre + 0.7 * r * np.array([np.cos(wheel.unbalance_angle), np.sin(wheel.unbalance_angle)])
        ax.plot(*position[:, None], "o", color="black", markersize=4, label="unbalance")
    _arrow(ax, centre, _ARROW_RADIUS_RATIO * r if not wheel.internal else 0.94 * r, speed)


def _names(ax: Axes, wheels: dict[str, Any], centres: dict[str, np.ndarray], size: dict[str, float]) -> None:
    """Write names and numbers of teeth: of a ring above it, of wheels on a common axis one below the other."""
    coaxial: dict[tuple[bool, float, float], list[str]] = {}
    for name, wheel in wheels.items():
        x, y = np.round(centres[name], 6).tolist()
        coaxial.setdefault((wheel.internal, x, y), []).append(name)
    for (internal, x, y), names in coaxial.items():
        joint = ", " if internal or len(names) > 1 else "\n"
        texts = [f"{name}{joint}{wheels[name].teeth} teeth" if wheels[name].teeth else name for name in names]
        radii = [1e3 * size[name] for name in names]
        height = 1.02 * max(radii) if internal else 0.12 * min(radii)
        ax.annotate("\n".join(texts), (x, y + height), ha="center", va="bottom", fontsize=8)


def _arrow(ax: Axes, centre: np.ndarray, r: float, speed: float, angle: float = -1.8, extent: float = 1.2) -> None:
    """Draw an arc around an angle [rad] in the sense of rotation, with its extent [rad]; nothing at zero speed."""
    from matplotlib.patches import FancyArrowPatch

    if speed:
        turn = np.sign(speed)
        ends = angle - 0.5 * extent * turn, angle + 0.5 * extent * turn
        begin, end = (tuple(centre + r * np.array([np.cos(a), np.sin(a)])) for a in ends)
        look: Any = {"arrowstyle": "-|>", "mutation_scale": 9, "color": COLOURS["no_impact"], "linewidth": 1.0}
        arc = f"arc3,rad={0.3 * turn}"
        ax.add_patch(FancyArrowPatch(begin, end, connectionstyle=arc, zorder=3, **look))


def _line_of_action(
    ax: Axes,
    machine: Train,
    i: int,
    mesh: Any,
    angles: tuple[float, float],
    centres: dict[str, np.ndarray],
    size: dict[str, float],
) -> None:
    """Draw the line of action through the pitch point; its legend entry has the order and lag of the mesh."""
    motion = machine._kinematics
    outer, inner = inner_first(mesh, {wheel.name: wheel for wheel in machine.wheels})
    alpha, phi = angles
    if not np.ptp([(w.x, w.y) for w in machine.wheels], axis=0).max():
        offset = centres[inner.name] - centres[outer.name]
        phi = float(np.arctan2(offset[1], offset[0])) + (np.pi if inner.internal else 0.0)
    r = 1e3 * size[outer.name]
    pitch = centres[outer.name] + r * np.array([np.cos(phi), np.sin(phi)])
    n = np.array([np.sin(alpha), motion.sides[i] * np.cos(alpha)])
    n = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]]) @ n
    ends = np.array([pitch - 0.55 * r * n, pitch + 0.55 * r * n])
    colour = BRANCHES[(i + 1) % len(BRANCHES)]
    label = f"{mesh.name}: order {motion.orders[i]}, lag {motion.lags[i] / (2 * np.pi):.3g} cycles"
    ax.plot(*ends.T, color=colour, linewidth=1.5, zorder=3, gid=f"mesh {mesh.name}", label=label)
