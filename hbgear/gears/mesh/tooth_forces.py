"""Forces on single pairs of teeth over their path of contact, and the static state of a tooth-resolved mesh.

    F_p(u) = sum_l k_l(u - lag_l) max(x(p + u) - b - g_l(u - lag_l) - e_lp, 0),   share_p = F_p / sum_q F_q
    sum_p F_p(delta, tau) = F   (static)

Pair p enters contact at time p, in mesh periods; u is its position on the path of contact and l a slice of the face
width. x is the displacement along the line of action, b the half backlash and e the error of the pair. The force on
the back flank follows from -x and the gap of the back flank.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from hbgear.common.arrays import Array
from hbgear.gears.mesh.loaded_mesh import spring_displacement
from hbgear.gears.mesh.tooth_contacts import Flank
from hbgear.gears.mesh.tooth_mesh import ONE_SIDED

STEPS_PER_MESH = 1024
"""Positions per mesh period at which forces are evaluated. The largest force of a smooth maximum has a relative error
of 1e-5; where a pair enters or leaves contact, the error is one step of its path."""


@dataclass(frozen=True, eq=False)
class PairForces:
    """Forces on M pairs of teeth at P positions.

    Attributes
    ----------
    position : ndarray, shape (P,)
        Position of the pair [mesh periods]; 0 is the beginning of the path of contact of the first slice.
    drive, back : ndarray, shape (S, M, P)
        Force of each slice on its driving flank and on its back flank.
    displacement : ndarray, shape (M, P)
        Displacement along the line of action.
    """

    position: Array
    drive: Array
    back: Array
    displacement: Array

    @property
    def force(self) -> Array:
        """Force on the driving flanks of each pair, shape (M, P)."""
        return self.drive.sum(axis=0)

    @property
    def total(self) -> Array:
        """Sum of the forces on the driving flanks of all pairs at the same times, shape (M, P)."""
        return _total(self.force, round(1 / float(self.position[1] - self.position[0])))

    @property
    def share(self) -> Array:
        """Part of each pair in the total, shape (M, P); zero without contact."""
        total = self.total
        return np.divide(self.force, total, out=np.zeros_like(total), where=total > 0)


def _total(force: Array, steps: int) -> Array:
    """Return the sum over all pairs at the same times; a step of M periods is the same time."""
    pairs, count = force.shape
    turns = -(-count // steps)
    padded = np.zeros((pairs, turns * steps))
    padded[:, :count] = force
    by_turn = padded.reshape(pairs, turns, steps)
    at_time = np.zeros((pairs, steps))
    for p in range(pairs):
        for turn in range(turns):
            at_time[(p + turn) % pairs] += by_turn[p, turn]
    out = np.stack([np.concatenate([at_time[(p + turn) % pairs] for turn in range(turns)]) for p in range(pairs)])
    return out[:, :count]


def pair_forces(
    flanks: Sequence[Flank],
    displacement: Callable[[Array], Array],
    pairs: int,
    half_backlash: float = 0.0,
    steps: int = STEPS_PER_MESH,
) -> PairForces:
    """Compute the forces on successive pairs of teeth; see the equations in the module header.

    The displacement along the line of action is a function of time [mesh periods], with a period of ``pairs``, the
    number of pairs that enter contact within a period of the motion. Half the backlash is added to the gaps of both
    flanks, in the unit of the displacement. Forces have the unit of stiffness times displacement; ``steps`` is the
    number of positions per mesh period.
    """
    first = min(floor(flank.stiffness.nodes[0] + flank.lag) for flank in flanks)
    last = max(ceil(flank.stiffness.length + flank.lag) for flank in flanks)
    u = first + np.arange((last - first) * steps) / steps
    x = np.array([displacement(p + u) for p in range(pairs)])
    drive, back = (
        np.array([_force(flank, u, x, half_backlash) for flank in flanks if flank.side == side]) for side in (1, -1)
    )
    return PairForces(u, drive, back.reshape(-1, *x.shape), x)


def _force(flank: Flank, u: Array, x: Array, half_backlash: float) -> Array:
    """Return the force on a flank of each pair (M, P)."""
    k, g = _on_path(flank, u)
    errors = np.array([flank.added_gap(p, p + u) for p in range(len(x))])
    closed = half_backlash + flank.half_backlash + g + errors
    return k * np.maximum(flank.side * x - closed, 0.0)


def _on_path(flank: Flank, u: Array) -> tuple[Array, Array]:
    """Return the stiffness of a flank at positions, zero outside of its path, and its gap."""
    v = u - flank.lag
    inside = (v >= flank.stiffness.nodes[0]) & (v < flank.stiffness.length)
    return np.where(inside, flank.stiffness.at(v), 0.0), flank.gap.at(v)


def static_displacement(flanks: Sequence[Flank], force: float, half_backlash: float = 0.0) -> tuple[Array, Array]:
    """Return phases (P,) of a mesh period and static displacements (P,) under a positive force.

    The mesh has no errors of single pairs. Flanks of the back have no effect; half the backlash is added to the gaps.
    """
    driving = [flank for flank in flanks if flank.side > 0]
    ends = np.array([(node + flank.lag) % 1.0 for flank in driving for node in flank.stiffness.nodes[[0, -1]]])
    grid = np.arange(STEPS_PER_MESH) / STEPS_PER_MESH
    phase = np.unique(np.concatenate([grid, ends - ONE_SIDED, ends + ONE_SIDED]) % 1.0)
    k, g = [], []
    for flank in driving:
        begin, end = flank.stiffness.nodes[0] + flank.lag, flank.stiffness.length + flank.lag
        for p in range(floor(begin), ceil(end)):
            stiffness, gap = _on_path(flank, phase + p)
            k.append(stiffness)
            g.append(np.where(stiffness > 0, half_backlash + flank.half_backlash + gap, np.inf))
    return phase, spring_displacement(np.array(k).T, np.array(g).T, force)
