"""Machines of other programs as linear structures: ROSS and openTorsion, through their public attributes.

Neither is imported, so neither is needed to read what the other made. Springs that stand for the teeth of gears are
taken out of K and given back as `Matrices.meshes`: an element with backlash comes in their place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arguments import given
from hbgear.common.arrays import Array
from hbgear.io.matrices import Matrices, skew

_ONE = 1e-9  # part of a coupling of gears beside its largest eigenvalue that is rounding

_SAME = 1e-12  # difference of bearings at two speeds that is none

_AXES = {4: ("x", "y", "alpha", "beta"), 6: ("x", "y", "z", "alpha", "beta", "theta")}
"""Coordinates of a node of ROSS by their number."""


def from_ross(rotor: Any) -> Matrices:
    """A rotor or multi-rotor of ROSS.

    M, G and the bearings K(speed), C(speed) are ROSS's own; the speed is that of the shaft, of the driving rotor of a
    multi-rotor. Its gear mesh is in ``meshes["gears"]``, not in K.

    Parameters
    ----------
    rotor : `ross.Rotor` or `ross.MultiRotor`.

    Returns
    -------
    `Matrices`
        Coordinates are called x_0, y_0, z_0, alpha_0, beta_0, theta_0, x_1, ... by node.

    Raises
    ------
    TypeError
        If it is no rotor.
    ValueError
        If its gears are not coupled along one line.

    Examples
    --------
    >>> import hbgear as hb
    >>> import ross  # doctest: +SKIP
    >>> found = hb.from_ross(ross.rotor_example())  # doctest: +SKIP
    >>> unbalance = hb.Load({}, {1: found.along({"x_2": 1e-4})}, {1: found.along({"y_2": 1e-4})}, 2)  # doctest: +SKIP
    """
    for name in ("M", "K", "C", "G", "number_dof"):
        if not hasattr(rotor, name):
            raise TypeError(f"from_ross needs a ross.Rotor or ross.MultiRotor; got {given(rotor)}")
    M, G = np.asarray(rotor.M(), dtype=float), np.asarray(rotor.G(), dtype=float)
    mesh = getattr(rotor, "mesh", None)
    taken, meshes = np.zeros_like(M), {}
    if mesh is not None:
        dofs = [*mesh.driving_gear.dof_global_index.values(), *mesh.driven_gear.dof_global_index.values()]
        w = np.zeros(len(M))
        w[dofs] = _direction(np.asarray(rotor.coupling_matrix(), dtype=float))
        meshes["gears"] = w, float(mesh.stiffness)
        taken = mesh.stiffness * np.outer(w, w)
    tables = [np.asarray(bearing.frequency, dtype=float) for bearing in rotor.bearing_elements
              if getattr(bearing, "frequency", None) is not None]  # fmt: skip
    still = tables[0][0] if tables else 0.0
    K, C = (np.asarray(matrix(still), dtype=float) for matrix in (rotor.K, rotor.C))

    def over(matrix: Any, first: Array) -> Any:
        """What a matrix has more than at first at a speed; None if it never has."""
        if all(np.abs(np.asarray(matrix(w)) - first).max() <= _SAME * np.abs(first).max()
               for table in tables for w in table):  # fmt: skip
            return None

        def more(speed: float) -> Array:
            low, high = max(t.min() for t in tables), min(t.max() for t in tables)
            if not low <= speed <= high:
                raise ValueError(
                    f"the speed {speed:g} rad/s is outside of the bearings of the rotor, which have {low:g} to {high:g}"
                )
            return np.asarray(matrix(speed), dtype=float) - first

        return more

    axes = _AXES.get(int(rotor.number_dof), ())
    count = len(M) // len(axes) if axes and len(M) % len(axes) == 0 else 0
    names = [f"{axis}_{node}" for node in range(count) for axis in axes]
    return Matrices(M, K - taken, C, skew(G) if G.any() else None, names, over(rotor.C, C), over(rotor.K, K), meshes)


def from_opentorsion(assembly: Any) -> Matrices:
    """A drive train of openTorsion.

    Parameters
    ----------
    assembly : `opentorsion.Assembly`.

    Returns
    -------
    `Matrices`
        Coordinates are called theta_0, theta_1, ... by node; with rigid gears, which take some away, q1, q2, ...
        Elastic gears are in ``meshes``, called "1-2" by their nodes, and not in K.

    Raises
    ------
    TypeError
        If it is no assembly.

    Examples
    --------
    >>> import hbgear as hb
    >>> import opentorsion as ot  # doctest: +SKIP
    >>> shafts, discs = [ot.Shaft(0, 1, k=1e5)], [ot.Disk(0, I=0.1), ot.Disk(1, I=0.2)]  # doctest: +SKIP
    >>> hb.from_opentorsion(ot.Assembly(shafts, disk_elements=discs)).dof_names  # doctest: +SKIP
    ('theta_0', 'theta_1')
    """
    for name in ("M", "K", "C", "shaft_elements"):
        if not hasattr(assembly, name):
            raise TypeError(f"from_opentorsion needs an opentorsion.Assembly; got {given(assembly)}")
    M, K, C = (np.array(getattr(assembly, name), dtype=float) for name in ("M", "K", "C"))
    if getattr(assembly, "gear_elements", None):
        return Matrices(M, K, C)
    meshes = {}
    for gear in getattr(assembly, "elastic_gear_elements", None) or ():
        if gear.parent is None:
            continue
        w = np.zeros(len(M))
        own = np.asarray(gear.K(), dtype=float)
        w[[gear.parent.node, gear.node]] = _direction(own / gear.k)
        meshes[f"{gear.parent.node}-{gear.node}"] = w, float(gear.k)
        K -= gear.k * np.outer(w, w)
    return Matrices(M, K, C, None, [f"theta_{node}" for node in range(len(M))], meshes=meshes)


def _direction(coupling: Array) -> Array:
    """w of a matrix w w^T, its largest entry positive.

    Raises
    ------
    ValueError
        If it is none.
    """
    values, vectors = np.linalg.eigh(0.5 * (coupling + coupling.T))
    if np.abs(coupling - coupling.T).max() > _ONE * values[-1] or np.abs(values[:-1]).max() > _ONE * values[-1]:
        raise ValueError("the gears are not coupled along one line of action; their spring cannot become a gap")
    w: Array = np.sqrt(values[-1]) * vectors[:, -1]
    w *= np.sign(w[np.argmax(np.abs(w))])
    return w
