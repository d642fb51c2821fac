"""Machines of other programs as linear structures: ROSS and openTorsion, through their public attributes.

Neither is imported, so neither is needed to read what the other made. Springs that stand for the teeth of gears are
taken out of K and returned as `Matrices.meshes`: an element with backlash comes in their place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from hbgear.common.argument_checks import given
from hbgear.common.arrays import Array
from hbgear.io.matrices import Matrices, skew

_ONE = 1e-9  # part of a coupling of gears beside its largest eigenvalue that is rounding

_SAME = 1e-12  # difference of bearings at two speeds that is none

_AXES = {4: ("x", "y", "alpha", "beta"), 6: ("x", "y", "z", "alpha", "beta", "theta")}
"""Coordinates of a node of ROSS by their number."""


def from_ross(rotor: Any) -> Matrices:
    """A rotor or multi-rotor of ROSS.

    M, G and the bearings K(speed), C(speed) are ROSS's own; the speed is that of the shaft, of the driving rotor of a
    multi-rotor. Its gear mesh is in ``meshes["gears"]``, not in K. A multi-rotor that is made of multi-rotors has
    several, called "gears_1_4" by the nodes of the gears.

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
        If its gears are not coupled along one line, or by a spring that cannot be found.

    Examples
    --------
    >>> import hbgear as hb
    >>> import ross  # doctest: +SKIP
    >>> found = hb.io.from_ross(ross.rotor_example())  # doctest: +SKIP
    >>> unbalance = hb.Load({}, {1: found.along({"x_2": 1e-4})}, {1: found.along({"y_2": 1e-4})}, 2)  # doctest: +SKIP
    """
    for name in ("M", "K", "C", "G", "number_dof"):
        if not hasattr(rotor, name):
            raise TypeError(f"from_ross needs a ross.Rotor or ross.MultiRotor; got {given(rotor)}")
    M, G = np.asarray(rotor.M(), dtype=float), np.asarray(rotor.G(), dtype=float)
    tables = [table for bearing in rotor.bearing_elements if (table := _speeds_of(bearing)) is not None]
    still = tables[0][0] if tables else 0.0
    K, C = (np.asarray(matrix(still), dtype=float) for matrix in (rotor.K, rotor.C))
    springs = list(_springs(rotor, still, 0, len(K)))
    for spring in springs:
        K = K - spring.taken

    def over(matrix: Any, first: Array) -> Any:
        """The part of a matrix above its first value at a speed; None if there is none at any speed."""
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
    meshes = _named(springs, int(rotor.number_dof))
    more = over(rotor.K, np.asarray(rotor.K(still), dtype=float))
    return Matrices(M, K, C, skew(G) if G.any() else None, names, over(rotor.C, C), more, meshes)


def _speeds_of(bearing: Any) -> Array | None:
    """Speeds at which the coefficients of a bearing are given; its newer name is speed."""
    for name in ("frequency", "speed"):
        table = getattr(bearing, name, None)
        if table is not None and not callable(table):
            return np.atleast_1d(np.asarray(table, dtype=float))
    return None


@dataclass(frozen=True)
class _Spring:
    """The teeth of a pair of gears: direction (n,) of the gap, stiffness, and the matrix (n, n) to take out of K."""

    direction: Array
    stiffness: float
    taken: Array


def _springs(rotor: Any, speed: float, first: int, n: int) -> Iterator[_Spring]:
    """Pairs of gears of a multi-rotor and of the multi-rotors in it, whose coordinates begin with number ``first``.

    The spring of a pair is the difference between K of both rotors coupled and K of each alone. It is zero where ROSS
    computes the force of the backlash itself.
    """
    mesh, parts = getattr(rotor, "mesh", None), getattr(rotor, "rotors", None)
    if mesh is None:
        return
    if not isinstance(parts, dict) or set(parts) != {"driving", "driven"}:
        raise ValueError("the gears of the rotor cannot be found: a MultiRotor has rotors['driving'] and ['driven']")
    driving, driven = parts["driving"], parts["driven"]
    ratio = float(mesh.gear_ratio)
    alone = block_diag(driving.K(speed), driven.K(speed * ratio))
    coupling = np.asarray(rotor.K(speed), dtype=float) - alone
    k = float(mesh.stiffness)
    inside = np.abs(coupling).max() > _ONE * k
    own = _direction(coupling / k if inside else _coupling(rotor, mesh, len(alone)))
    direction, taken = np.zeros(n), np.zeros((n, n))
    here = slice(first, first + len(alone))
    direction[here] = own
    if inside:
        taken[here, here] = coupling
    yield _Spring(direction, k, taken)
    yield from _springs(driving, speed, first, n)
    yield from _springs(driven, speed * ratio, first + len(driving.K(speed)), n)


def _coupling(rotor: Any, mesh: Any, n: int) -> Array:
    """The matrix w w^T (n, n) of a pair of gears, of any version of ROSS."""
    for name in ("compute_coupling_matrix", "coupling_matrix", "K_coupling"):
        found = getattr(rotor, name, None)
        if found is not None:
            small = np.asarray(found() if callable(found) else found, dtype=float)
            dofs = [*mesh.driving_gear.dof_global_index.values(), *mesh.driven_gear.dof_global_index.values()]
            out = np.zeros((n, n))
            out[np.ix_(dofs, dofs)] = small
            return out
    raise ValueError("the gears of the rotor are coupled by no spring, and it has no coupling matrix; need one of them")


def _named(springs: list[_Spring], number: int) -> dict[str, tuple[Array, float]]:
    """Direction and stiffness by name: "gears" of one pair, "gears_1_4" by the nodes of several."""
    names = ["gears"] if len(springs) == 1 else []
    for spring in springs if not names else []:
        nodes = dict.fromkeys(int(i) // number for i in np.flatnonzero(np.abs(spring.direction) > _ONE))
        names.append("_".join(["gears", *map(str, nodes)]))
    return {name: (spring.direction, spring.stiffness) for name, spring in zip(names, springs, strict=True)}


def from_opentorsion(assembly: Any) -> Matrices:
    """A drive train of openTorsion.

    Parameters
    ----------
    assembly : `opentorsion.Assembly`.

    Returns
    -------
    `Matrices`
        Coordinates are called theta_0, theta_1, ... by node; rigid gears take some of them away. Elastic gears are in
        ``meshes``, called "1-2" by their nodes, and not in K; their dampers stay in C.

    Raises
    ------
    TypeError
        If it is no assembly.
    ValueError
        If the matrices are not those of its elements.

    Examples
    --------
    >>> import hbgear as hb
    >>> import opentorsion as ot  # doctest: +SKIP
    >>> shafts, discs = [ot.Shaft(0, 1, k=1e5)], [ot.Disk(0, I=0.1), ot.Disk(1, I=0.2)]  # doctest: +SKIP
    >>> hb.io.from_opentorsion(ot.Assembly(shafts, disk_elements=discs)).dof_names  # doctest: +SKIP
    ('theta_0', 'theta_1')
    """
    for name in ("M", "K", "C", "shaft_elements"):
        if not hasattr(assembly, name):
            raise TypeError(f"from_opentorsion needs an opentorsion.Assembly; got {given(assembly)}")
    M, K, C = (np.array(getattr(assembly, name), dtype=float) for name in ("M", "K", "C"))
    kept = np.eye(len(M))  # angles of the nodes by the coordinates that rigid gears leave
    if getattr(assembly, "gear_elements", None):
        kept = np.asarray(assembly.T(assembly.E()), dtype=float)
    if kept.shape[1:] != M.shape[:1]:
        raise ValueError(
            f"the gears leave {kept.shape[1:]} coordinates, and the matrices of the assembly have {len(M)}"
        )
    meshes = {}
    for gear in getattr(assembly, "elastic_gear_elements", None) or ():
        if gear.parent is None:
            continue
        w = np.zeros(len(kept))
        w[[gear.parent.node, gear.node]] = _direction(np.asarray(gear.K(), dtype=float) / gear.k)
        w = kept.T @ w
        meshes[f"{gear.parent.node}-{gear.node}"] = w, float(gear.k)
        K -= gear.k * np.outer(w, w)
    return Matrices(M, K, C, None, [f"theta_{node}" for node in _nodes(kept)], meshes=meshes)


def _nodes(kept: Array) -> list[int]:
    """For each coordinate the node whose angle it is."""
    rows = [np.flatnonzero((kept == unit).all(axis=1)) for unit in np.eye(kept.shape[1])]
    if not all(len(row) for row in rows):
        raise ValueError("a coordinate of the assembly is the angle of no node; need the T(E()) of openTorsion")
    return [int(row[0]) for row in rows]


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
    w[np.abs(w) < _ONE * np.abs(w).max()] = 0.0
    largest = np.flatnonzero(np.abs(w) > 0.999 * np.abs(w).max())[0]  # of those that are alike but for rounding
    w *= np.sign(w[largest])
    return w
