"""Load sharing of meshes: planets of a planetary set, branches of a train.

    share_j = mean p_j / sum_i mean p_i          factor_j = n max p_j / sum_i mean p_i        i = 1..n of the group

p_j(tau) is the force of the law of mesh j without its damper, with the sign that makes its mean positive. The sum of
the shares is one. The factor is 1 if the static load is shared evenly; it includes the dynamic factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.quantities.engineering_quantities import forces_along
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch

_MIN_LOAD_RATIO = 1e-6
"""Total mean load over the largest force, below which the load is zero; it is the relative accuracy of forces."""


@dataclass(frozen=True, eq=False)
class LoadSharing:
    """Shares of n meshes at the P points of a branch; see `load_sharing`.

    Attributes
    ----------
    meshes : tuple of str
        Names of the meshes.
    share : ndarray, shape (P, n)
        Share of each mesh in the mean load.
    factor : ndarray, shape (P, n)
        Largest force of each mesh over the average of the mean forces.
    curve : Branch
        Branch.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.gears.PlanetarySet(), 2), "Omega", (2.3, 2.28), stability=False)
    >>> sharing = hb.analysis.load_sharing(curve)
    >>> sharing.meshes, sharing.share[0].round(3).tolist()
    (('sun-p1', 'sun-p2', 'sun-p3', 'sun-p4'), [0.25, 0.25, 0.25, 0.25])
    """

    meshes: tuple[str, ...]
    share: Array
    factor: Array
    curve: Branch


@checked_arguments(meshes="a list of names of elements")
def load_sharing(curve: Branch, meshes: Sequence[str] | None = None) -> LoadSharing:
    """Compute the shares of the load along a branch; see the equations in the module header.

    Parameters
    ----------
    curve : Branch
        Branch of a harmonic balance, traced or loaded from a file that describes its model.
    meshes : sequence of str, optional
        Names of the elements that share a load. By default `Model.sharing` (the meshes of the sun of a planetary set,
        all meshes of a train), or all elements.

    Returns
    -------
    LoadSharing
        Shares and factors of the meshes.

    Raises
    ------
    ValueError, KeyError, TypeError
        If the branch has no problem, there is no such element, fewer than two are given, or their mean load is zero.

    Examples
    --------
    >>> import hbgear as hb
    >>> planets = hb.gears.PlanetarySet(planet_errors=(10e-6, 0.0, 0.0, 0.0))
    >>> curve = hb.trace(hb.HarmonicBalance(planets, 2), "Omega", (0.6, 0.58), stability=False)
    >>> sharing = hb.analysis.load_sharing(curve, ["sun-p1", "sun-p2", "sun-p3", "sun-p4"])
    >>> bool(sharing.share[0].max() > 0.26)
    True
    """
    names, forces = forces_along(curve, meshes)
    if len(names) < 2:
        raise ValueError(f"load_sharing: need two or more elements that share a load, got {', '.join(names) or 'none'}")
    means = np.array([[p.mean() for p in row] for row in forces])
    signs = np.where(means < 0, -1.0, 1.0)
    largest = np.array(
        [
            [(s * p).max() for p, s in zip(row, row_signs, strict=True)]
            for row, row_signs in zip(forces, signs, strict=True)
        ]
    )
    total = np.abs(means).sum(axis=1, keepdims=True)
    if np.any(total <= _MIN_LOAD_RATIO * np.abs(largest).max(initial=0.0)):
        raise ValueError(f"load_sharing: the mean load of {', '.join(names)} is zero; name elements with a mean load")
    return LoadSharing(tuple(names), np.abs(means) / total, len(names) * largest / total, curve)
