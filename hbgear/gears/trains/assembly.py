"""Assembly of wheels that mesh in a loop, such as two idlers between a pinion and a ring.

The phases of all meshes follow from one of them. In the mesh that closes a loop, the phases by its two wheels differ by
a whole number of pitches, or the teeth do not match.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import atan2, cos, degrees, hypot, pi, sin

from hbgear.gears.trains.train_components import Mesh, Wheel
from hbgear.gears.trains.train_kinematics import Kinematics, mesh_angles, mesh_lags, phase_mismatch

ASSEMBLY_TOLERANCE = 0.02
"""Accepted difference of the phases of a mesh [pitches]: of positions that are rounded to a hundredth of the module."""


def check_assembly(wheels: Mapping[str, Wheel], meshes: Sequence[Mesh], motion: Kinematics) -> None:
    """Raise ValueError if the teeth of wheels that mesh in a loop do not match.

    Loops over shafts, on which gears are turned until they match, are not checked, and loops in which a mesh has a
    given lag or direction, or wheels have no positions.
    """
    pending = list(range(len(meshes)))
    while pending:
        loop = _connected(pending[0], meshes)
        pending = [j for j in pending if j not in loop]
        if all(_is_placed(meshes[j], wheels) for j in loop):
            _check_loop(wheels, [meshes[j] for j in loop], replace(motion, sides=tuple(motion.sides[j] for j in loop)))


def _connected(first: int, meshes: Sequence[Mesh]) -> list[int]:
    """Return the indices of the meshes whose wheels are connected to those of a mesh by meshes."""
    found, names = {first}, {meshes[first].first, meshes[first].second}
    while more := {j for j, m in enumerate(meshes) if j not in found and names & {m.first, m.second}}:
        found |= more
        names |= {name for j in more for name in (meshes[j].first, meshes[j].second)}
    return sorted(found)


def _is_placed(mesh: Mesh, wheels: Mapping[str, Wheel]) -> bool:
    """Return whether the phase of a mesh follows from the positions of its wheels."""
    a, b = wheels[mesh.first], wheels[mesh.second]
    return mesh.lag is None and mesh.direction is None and (a.x, a.y) != (b.x, b.y)


def _check_loop(wheels: Mapping[str, Wheel], meshes: Sequence[Mesh], motion: Kinematics) -> None:
    """Raise ValueError if the teeth of connected meshes do not match; the motion has their ``sides``."""
    for j, mismatch in enumerate(_mismatches(wheels, meshes, motion)):
        if abs(mismatch) > ASSEMBLY_TOLERANCE:
            raise ValueError(
                f"Train: the mesh {meshes[j].name} closes a loop of wheels, and its teeth are {abs(mismatch):.3g} "
                f"pitches apart, at most {ASSEMBLY_TOLERANCE:g}: they cannot be assembled; "
                f"{_matching_place(j, mismatch, wheels, meshes, motion)}, or give this mesh its lag to omit the check"
            )


def _mismatches(wheels: Mapping[str, Wheel], meshes: Sequence[Mesh], motion: Kinematics) -> list[float]:
    """Return the differences of the phases of connected meshes [pitches], by meshes alone."""
    angles, single = tuple(mesh_angles(mesh, wheels) for mesh in meshes), {name: i for i, name in enumerate(wheels)}
    _, start_angles = mesh_lags(wheels, single, meshes, motion.speeds, motion.sides, angles)
    return phase_mismatch(wheels, meshes, replace(motion, angles=angles, start_angles=start_angles))


def _matching_place(
    j: int, mismatch: float, wheels: Mapping[str, Wheel], meshes: Sequence[Mesh], motion: Kinematics
) -> str:
    """Return what to change: the angle of a wheel of mesh j about the common axis of both gears that it meshes with."""
    for name in (meshes[j].first, meshes[j].second):
        a, *others = (wheels[m.second if m.first == name else m.first] for m in meshes if name in (m.first, m.second))
        if len(others) != 1 or (others[0].x, others[0].y) != (a.x, a.y):
            continue
        teeth = a.teeth + others[0].teeth if a.internal != others[0].internal else abs(a.teeth - others[0].teeth)
        dx, dy = wheels[name].x - a.x, wheels[name].y - a.y
        for turn in (2 * pi * mismatch / max(teeth, 1), -2 * pi * mismatch / max(teeth, 1)):
            angle = atan2(dy, dx) + turn
            x, y = a.x + hypot(dx, dy) * cos(angle), a.y + hypot(dx, dy) * sin(angle)
            moved = {**wheels, name: replace(wheels[name], x=x, y=y)}
            if abs(_mismatches(moved, meshes, motion)[j]) < ASSEMBLY_TOLERANCE:
                return (
                    f"place '{name}' at {degrees(angle):.6g} degrees about '{a.name}', x = {x:.7g} and y = {y:.7g} m, "
                    f"instead of {degrees(atan2(dy, dx)):.6g}"
                )
    return "change positions or numbers of teeth"
