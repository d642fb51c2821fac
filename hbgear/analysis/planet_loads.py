"""How meshes share a load: planets among each other, branches of a train.

    share_j = mean p_j / sum_i mean p_i          factor_j = n max p_j / sum_i mean p_i        i = 1..n of the group

p_j(tau) is the force of mesh j, its law without the damper, positive as its mean. Shares add up to one; a factor is 1
where the load is shared evenly and nothing moves: the dynamic factor is within it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.engineering_quantities import forces_along
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch

_ACCURACY = 1e-6  # relative accuracy of forces: a smaller load is zero, and there is nothing to share


@dataclass(frozen=True, eq=False)
class LoadSharing:
    """Shares of n meshes along the P rows of a curve; see `load_sharing`.

    Parameters
    ----------
    meshes : their names.
    share : (P, n) of the mean load.
    factor : (P, n) largest force over the mean one of all.
    curve : the curve.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.gears.PlanetarySet(), 2), "Omega", (2.3, 2.28), stability=False)
    >>> found = hb.analysis.load_sharing(curve)
    >>> found.meshes, found.share[0].round(3).tolist()
    (('sun-p1', 'sun-p2', 'sun-p3', 'sun-p4'), [0.25, 0.25, 0.25, 0.25])
    """

    meshes: tuple[str, ...]
    share: Array
    factor: Array
    curve: Branch


@checked_arguments(meshes="a list of names of elements")
def load_sharing(curve: Branch, meshes: Sequence[str] | None = None) -> LoadSharing:
    """Shares of the load along a curve; equations at the head of this file.

    Parameters
    ----------
    curve : of a harmonic balance; one out of a file too if that tells its model.
    meshes : names of the elements that share a load; by default those the model names (`Model.sharing`: the meshes of
        the sun of a planetary set, all of a train), or all elements.

    Raises
    ------
    ValueError, KeyError, TypeError
        If the curve has no problem, there is no such element, fewer than two are given, or they carry no load.

    Examples
    --------
    >>> import hbgear as hb
    >>> planets = hb.gears.PlanetarySet(planet_errors=(10e-6, 0.0, 0.0, 0.0))
    >>> curve = hb.trace(hb.HarmonicBalance(planets, 2), "Omega", (0.6, 0.58), stability=False)
    >>> found = hb.analysis.load_sharing(curve, ["sun-p1", "sun-p2", "sun-p3", "sun-p4"])
    >>> bool(found.share[0].max() > 0.26)
    True
    """
    names, forces = forces_along(curve, meshes)
    if len(names) < 2:
        raise ValueError(f"load_sharing: {', '.join(names) or 'nothing'} shares a load with nothing; name two or more")
    means = np.array([[p.mean() for p in row] for row in forces])
    sense = np.where(means < 0, -1.0, 1.0)
    largest = np.array([[(s * p).max() for p, s in zip(row, way, strict=True)]
                        for row, way in zip(forces, sense, strict=True)])  # fmt: skip
    total = np.abs(means).sum(axis=1, keepdims=True)
    if np.any(total <= _ACCURACY * np.abs(largest).max(initial=0.0)):
        raise ValueError(f"load_sharing: {', '.join(names)} carry no load to share")
    return LoadSharing(tuple(names), np.abs(means) / total, len(names) * largest / total, curve)
