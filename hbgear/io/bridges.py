"""Linear structures from other programs: ROSS and openTorsion, through their public attributes.

Neither program is imported, so neither is required. Springs that model gear teeth are removed from K and returned as
`Matrices.meshes`: an element with backlash replaces them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.argument_checks import given
from hbgear.common.arrays import Array
from hbgear.io.matrices import Matrices, skew

_RANK_ONE_TOLERANCE = 1e-9
"""Part of a coupling matrix of gears, relative to its largest eigenvalue, that counts as rounding."""

_SPEED_TOLERANCE = 1e-12
"""Relative difference of a bearing matrix between two speeds that counts as zero."""

_AXES = {4: ("x", "y", "alpha", "beta"), 6: ("x", "y", "z", "alpha", "beta", "theta")}
"""Coordinates of a node of ROSS, by their number."""


def from_ross(rotor: Any) -> Matrices:
    """Return the matrices of a rotor or multi-rotor of ROSS.

    M, G and the bearings K(speed), C(speed) are those of ROSS; the speed is that of the shaft, or of the driving shaft
    of a multi-rotor. Its gear mesh is in ``meshes["gears"]``, not in K. A multi-rotor made of multi-rotors has
    several meshes, named "gears_1_4" by the nodes of the gears.

    Parameters
    ----------
    rotor : ross.Rotor or ross.MultiRotor
        The rotor.

    Returns
    -------
    Matrices
        The structure; its coordinates are named x_0, y_0, z_0, alpha_0, beta_0, theta_0, x_1, ... by node.

    Raises
    ------
    TypeError
        If ``rotor`` is not a rotor.
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
    tables = [table for bearing in rotor.bearing_elements if (table := _bearing_speeds(bearing)) is not None]
    lowest_speed = tables[0][0] if tables else 0.0
    K, C = (np.asarray(matrix(lowest_speed), dtype=float) for matrix in (rotor.K, rotor.C))
    springs = list(_springs(rotor, lowest_speed, 0, len(K)))
    for spring in springs:
        K = K - spring.coupling

    def change_with_speed(matrix: Any, first: Array) -> Any:
        """Return the change of a matrix with speed, relative to its first value; None if it is constant."""
        if all(
            np.abs(np.asarray(matrix(w)) - first).max() <= _SPEED_TOLERANCE * np.abs(first).max()
            for table in tables
            for w in table
        ):
            return None

        def matrix_change(speed: float) -> Array:
            low, high = max(t.min() for t in tables), min(t.max() for t in tables)
            if not low <= speed <= high:
                raise ValueError(
                    f"the speed {speed:g} rad/s is outside of the bearings of the rotor, which have {low:g} to {high:g}"
                )
            return np.asarray(matrix(speed), dtype=float) - first

        return matrix_change

    axes = _AXES.get(int(rotor.number_dof), ())
    count = len(M) // len(axes) if axes and len(M) % len(axes) == 0 else 0
    names = [f"{axis}_{node}" for node in range(count) for axis in axes]
    meshes = _named(springs, int(rotor.number_dof))
    stiffness = change_with_speed(rotor.K, np.asarray(rotor.K(lowest_speed), dtype=float))
    return Matrices(M, K, C, skew(G) if G.any() else None, names, change_with_speed(rotor.C, C), stiffness, meshes)


def _bearing_speeds(bearing: Any) -> Array | None:
    """Return the speeds of the coefficients of a bearing, in the attribute ``frequency`` or, in newer ROSS, speed."""
    for name in ("frequency", "speed"):
        table = getattr(bearing, name, None)
        if table is not None and not callable(table):
            return np.atleast_1d(np.asarray(table, dtype=float))
    return None


@dataclass(frozen=True)
class _Spring:
    """The teeth of a gear pair: direction (n,) of the gap, stiffness, and the matrix (n, n) to remove from K."""

    direction: Array
    stiffness: float
    coupling: Array


def _springs(rotor: Any, speed: float, first: int, n: int) -> Iterator[_Spring]:
    """Yield the gear pairs of a multi-rotor, and of multi-rotors in it; its coordinates begin at number ``first``.

    The spring of a pair is the difference between K of both rotors coupled and K of each rotor alone. It is zero where
    ROSS computes the force of the backlash itself.
    """
    mesh, rotors = getattr(rotor, "mesh", None), getattr(rotor, "rotors", None)
    if mesh is None:
        return
    if not isinstance(rotors, dict) or set(rotors) != {"driving", "driven"}:
        raise ValueError("the gears of the rotor cannot be found: a MultiRotor has rotors['driving'] and ['driven']")
    driving, driven = rotors["driving"], rotors["driven"]
    ratio = float(mesh.gear_ratio)
    uncoupled = scipy.linalg.block_diag(driving.K(speed), driven.K(speed * ratio))
    coupling = np.asarray(rotor.K(speed), dtype=float) - uncoupled
    k = float(mesh.stiffness)
    in_stiffness = np.abs(coupling).max() > _RANK_ONE_TOLERANCE * k
    pair_direction = _direction(coupling / k if in_stiffness else _coupling(rotor, mesh, len(uncoupled)))
    direction, subtracted = np.zeros(n), np.zeros((n, n))
    rows = slice(first, first + len(uncoupled))
    direction[rows] = pair_direction
    if in_stiffness:
        subtracted[rows, rows] = coupling
    yield _Spring(direction, k, subtracted)
    yield from _springs(driving, speed, first, n)
    yield from _springs(driven, speed * ratio, first + len(driving.K(speed)), n)


def _coupling(rotor: Any, mesh: Any, n: int) -> Array:
    """Return the matrix w w^T (n, n) of a gear pair, for all versions of ROSS."""
    for name in ("compute_coupling_matrix", "coupling_matrix", "K_coupling"):
        attribute = getattr(rotor, name, None)
        if attribute is not None:
            small = np.asarray(attribute() if callable(attribute) else attribute, dtype=float)
            dofs = [*mesh.driving_gear.dof_global_index.values(), *mesh.driven_gear.dof_global_index.values()]
            coupling = np.zeros((n, n))
            coupling[np.ix_(dofs, dofs)] = small
            return coupling
    raise ValueError("no spring couples the gears of the rotor, and it has no coupling matrix; need one of them")


def _named(springs: list[_Spring], number: int) -> dict[str, tuple[Array, float]]:
    """Return direction and stiffness by name: "gears" for one pair, "gears_1_4" by the nodes for several."""
    names = ["gears"] if len(springs) == 1 else []
    for spring in springs if not names else []:
        nodes = dict.fromkeys(int(i) // number for i in np.flatnonzero(np.abs(spring.direction) > _RANK_ONE_TOLERANCE))
        names.append("_".join(["gears", *map(str, nodes)]))
    return {name: (spring.direction, spring.stiffness) for name, spring in zip(names, springs, strict=True)}


def from_opentorsion(assembly: Any) -> Matrices:
    """Return the matrices of a drive train of openTorsion.

    Parameters
    ----------
    assembly : opentorsion.Assembly
        The drive train.

    Returns
    -------
    Matrices
        The structure; its coordinates are named theta_0, theta_1, ... by node; rigid gears remove some of them.
        Elastic gears are in ``meshes``, named "1-2" by their nodes, and not in K; their dampers stay in C.

    Raises
    ------
    TypeError
        If ``assembly`` is not an assembly.
    ValueError
        If the matrices do not match its elements.

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
    transform = np.eye(len(M))  # angles of the nodes in terms of the coordinates that rigid gears leave
    if getattr(assembly, "gear_elements", None):
        transform = np.asarray(assembly.T(assembly.E()), dtype=float)
    if transform.shape[1:] != M.shape[:1]:
        raise ValueError(
            f"the gears leave {transform.shape[1:]} coordinates, and the matrices of the assembly have {len(M)}"
        )
    meshes = {}
    for gear in getattr(assembly, "elastic_gear_elements", None) or ():
        if gear.parent is None:
            continue
        w = np.zeros(len(transform))
        w[[gear.parent.node, gear.node]] = _direction(np.asarray(gear.K(), dtype=float) / gear.k)
        w = transform.T @ w
        meshes[f"{gear.parent.node}-{gear.node}"] = w, float(gear.k)
        K -= gear.k * np.outer(w, w)
    return Matrices(M, K, C, None, [f"theta_{node}" for node in _nodes(transform)], meshes=meshes)


def _nodes(transform: Array) -> list[int]:
    """Return, for each coordinate, the node whose angle it is."""
    rows = [np.flatnonzero((transform == unit).all(axis=1)) for unit in np.eye(transform.shape[1])]
    if not all(len(row) for row in rows):
        raise ValueError("a coordinate of the assembly is not the angle of a node; need the T(E()) of openTorsion")
    return [int(row[0]) for row in rows]


def _direction(coupling: Array) -> Array:
    """Return w of a matrix w w^T, with a positive largest entry; ValueError for any other matrix."""
    values, vectors = np.linalg.eigh(0.5 * (coupling + coupling.T))
    rounding = _RANK_ONE_TOLERANCE * values[-1]
    if np.abs(coupling - coupling.T).max() > rounding or np.abs(values[:-1]).max() > rounding:
        raise ValueError("the gears are not coupled along one line of action; their spring cannot become a gap")
    w = np.sqrt(values[-1]) * vectors[:, -1]
    w[np.abs(w) < _RANK_ONE_TOLERANCE * np.abs(w).max()] = 0.0
    largest = np.flatnonzero(np.abs(w) > 0.999 * np.abs(w).max())[0]  # the first of equal entries
    w *= np.sign(w[largest])
    return w
