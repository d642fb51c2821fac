"""Linear structures from matrices of other programs: Matrix Market, MATLAB (.mat), NumPy (.npy, .npz), text (.csv).

M q'' + [C + s Omega G + C_b(Omega)] q' + [K + K_b(Omega)] q
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.optional import needed
from hbgear.common.process.checksums import DamagedFileError
from hbgear.common.ranges import ANY, checked
from hbgear.common.text.messages import quoted
from hbgear.io.branches.archive import archive_of
from hbgear.io.matrix_files.matlab import read_matlab
from hbgear.io.matrix_files.matlab_hdf5 import is_hdf5, read_hdf5
from hbgear.io.matrix_files.matrix_market import read_matrix_market
from hbgear.io.matrix_files.text_matrix import TEXT_SUFFIXES, read_text_matrix
from hbgear.io.matrix_files.unpacked_size import SPARE, TIMES, check_mtx
from hbgear.mechanics.models import System
from hbgear.mechanics.structures.elements import Element, Load
from hbgear.mechanics.structures.matrices import coordinate_names, square
from hbgear.mechanics.structures.modal_damping import modal_damping
from hbgear.mechanics.structures.receptances import vector_along
from hbgear.mechanics.structures.speed_terms import OverSpeed, SpeedTerms

NAMES = ("M", "K", "C", "G")
"""Matrices of a structure; M and K are required."""

SYMMETRIC_PART_TOLERANCE = 1e-6
"""Symmetric part of a gyroscopic matrix, relative to its largest entry, that counts as rounding of the file."""


@dataclass(frozen=True, eq=False)
class Matrices:
    """A linear structure from another program; with elements and loads it becomes a `System`.

    Attributes
    ----------
    M, K : array_like or sparse array, shape (n, n)
        Mass and stiffness matrix.
    C, G : array_like or sparse array, shape (n, n), optional
        Damping matrix, and gyroscopic matrix per shaft speed in rad/s; default None, no such forces.
    dof_names : sequence of str, shape (n,), optional
        Names of the coordinates; default ``q1, q2, ...``.
    damping, stiffness : callable or MatrixTable, optional
        Matrices to add to C and K, functions of the shaft speed; default None.
    meshes : dict of str to (array, float), optional
        Meshes of gears that the program couples by a spring k w w^T, which K excludes: the direction w (n,) of the gap
        and the stiffness k, by name.

    Raises
    ------
    ValueError
        If a matrix is not square, has another size than M or is not finite, or if names are missing or repeated.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> found = hb.io.Matrices(np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], dof_names=["rotor", "stator"])
    >>> rub = hb.Element(found.along({"rotor": 1.0, "stator": -1.0}), hb.Unilateral(k=10.0, gap=0.1), name="rub")
    >>> found.system([rub], hb.Load(cosine={1: found.along({"rotor": 0.05})})).n
    2
    """

    M: Any
    K: Any
    C: Any = None
    G: Any = None
    dof_names: Sequence[str] = ()
    damping: OverSpeed | None = None
    stiffness: OverSpeed | None = None
    meshes: Mapping[str, tuple[Array, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in NAMES:
            value = getattr(self, name)
            if value is None and name not in NAMES[:2]:
                continue
            object.__setattr__(self, name, square(name, value, None if name == "M" else self.n))
        names = coordinate_names("Matrices: dof_names", self.dof_names, self.n)
        repeated = next((name for i, name in enumerate(names) if name in names[:i]), None)
        if repeated is not None:
            raise ValueError(f"Matrices: two coordinates are called {quoted(repeated)}; give each another name")
        object.__setattr__(self, "dof_names", names)
        for name in ("damping", "stiffness"):
            value = getattr(self, name)
            if value is not None and not callable(value):
                raise ValueError(f"Matrices: {name} = {quoted(value)} must be a MatrixTable or a function of the speed")
        if not isinstance(self.meshes, Mapping):
            raise ValueError(f"Matrices: meshes = {quoted(self.meshes)} must be a dict of directions and stiffnesses")

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    def along(self, coordinates: Mapping[str | int, float]) -> Array:
        """Return a vector (n,) with the given entries, by name or number from 0, and zeros; see `vector_along`."""
        return vector_along(tuple(self.dof_names), coordinates)

    def with_modal_damping(self, ratios: float | Sequence[float]) -> Matrices:
        """Return the structure with the damping matrix of `hbgear.mechanics.modal_damping`.

        Parameters
        ----------
        ratios : float or sequence of float
            Damping ratio of all modes, or of the lowest ones; the last one applies to all higher modes.

        Raises
        ------
        ValueError
            If the structure has a damping matrix, or for the reasons of `modal_damping`.
        """
        if self.C is not None:
            raise ValueError("with_modal_damping: the structure has a damping matrix C; give either of them")
        return replace(self, C=modal_damping(self.M, self.K, ratios))

    def system(self, elements: Sequence[Element], load: Load | Sequence[Load] = (), ratio: float = 1.0) -> System:
        """Return the `System` with these elements and loads.

        Parameters
        ----------
        elements, load : sequence
            Elements and loads as for `System`; `along` makes their vectors.
        ratio : float, optional
            Shaft speed over Omega: 1 for unbalance (default), 1/z for meshing of z teeth. It has an effect only on
            speed-dependent terms.

        Returns
        -------
        System
            The system.
        """
        checked("system", "ratio", ratio, ANY)

        def at_frequency(term: OverSpeed | None) -> OverSpeed | None:
            return None if term is None else lambda Omega: term(ratio * Omega)

        speed = None
        if self.G is not None or self.damping is not None or self.stiffness is not None:
            speed = SpeedTerms(self.G, ratio, at_frequency(self.damping), at_frequency(self.stiffness))
        return System(self.M, self.C, self.K, elements, load, self.dof_names, speed)


@checked_arguments(
    source="a .mat or .npz file, or files or matrices by name, such as {'M': 'mass.mtx', 'K': 'stiff.mtx'}"
)
def from_matrices(
    source: str | os.PathLike[str] | Mapping[str, Any],
    names: Mapping[str, str] | None = None,
    dof_names: Sequence[str] = (),
) -> Matrices:
    """Return a linear structure from matrices of another program.

    Parameters
    ----------
    source : path-like or dict
        A file with all matrices, .mat (version 7.3 needs ``hbgear[matlab]``) or .npz; or, for each of M, K and
        optionally C and G, its own file (.mtx, .mat, .npy, or .csv, .txt, .dat with a row in each line) or the matrix
        itself.
    names : dict of str to str, optional
        Names of the matrices in a .mat or .npz file, such as ``{"K": "stiffness"}``; default M, K, C, G.
    dof_names : sequence of str, optional
        Names of the coordinates.

    Returns
    -------
    Matrices
        The structure.

    Raises
    ------
    ValueError
        If a file cannot be read or lacks a matrix, or if matrices have different sizes.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np, os, scipy, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name, A in (("mass", np.eye(3)), ("stiff", 2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))):
    ...         scipy.io.mmwrite(os.path.join(folder, name + ".mtx"), A)
    ...     found = hb.io.from_matrices({"M": os.path.join(folder, "mass.mtx"), "K": os.path.join(folder, "stiff.mtx")})
    ...
    >>> found.n
    3
    """
    names_in_file = {name: name for name in NAMES} | dict(names or {})
    unknown = next((name for name in names_in_file if name not in NAMES), None)
    if unknown is not None:
        raise ValueError(f"from_matrices: names has '{unknown}'; the matrices are {', '.join(NAMES)}")
    if isinstance(source, Mapping):
        unknown = next((name for name in source if name not in NAMES), None)
        if unknown is not None:
            raise ValueError(
                f"from_matrices: there is no matrix '{unknown}'; give {', '.join(NAMES)}, M and K at least"
            )
        matrices = {name: _matrix(value, names_in_file[name]) for name, value in source.items()}
    else:
        variables = _variables(source)
        matrices = {name: variables[names_in_file[name]] for name in NAMES if names_in_file[name] in variables}
        missing = [names_in_file[name] for name in NAMES[:2] if name not in matrices]
        if missing:
            available = ", ".join(sorted(variables)) or "nothing"
            raise ValueError(
                f"'{source}' has no matrix '{missing[0]}', but {available}: give the names of M and K in the file, "
                "as names={'M': 'mass'} of from_matrices, or M = \"mass\" in a .toml file"
            )
    missing = [name for name in NAMES[:2] if name not in matrices]
    if missing:
        raise ValueError(f"from_matrices: {missing[0]} is missing; give M and K at least")
    G = matrices.get("G")
    if G is not None:
        matrices["G"] = skew(G)
    return Matrices(**matrices, dof_names=dof_names)


def skew(G: Any) -> Any:
    """Return a gyroscopic matrix without its symmetric part, which must be rounding; ValueError if it is larger."""
    G = square("G", G)
    if abs(G + G.T).max() > SYMMETRIC_PART_TOLERANCE * abs(G).max():
        raise ValueError("G must be skew-symmetric, G^T = -G, the gyroscopic matrix; dissipative terms belong in C")
    return 0.5 * (G - G.T)


def _matrix(value: Any, name: str) -> Any:
    """Return a matrix, given directly or in its own file."""
    if not isinstance(value, str | os.PathLike):
        return value
    suffix = Path(value).suffix.lower()
    if suffix in TEXT_SUFFIXES and Path(value).is_file():
        return read_text_matrix(value)
    if suffix not in (".mtx", ".npy"):
        variables = _variables(value)
        if name in variables or len(variables) == 1:
            return variables.get(name, next(iter(variables.values())))
        raise ValueError(
            f"'{value}' has no matrix '{name}', but {', '.join(sorted(variables)) or 'nothing'}: give its name "
            "in the file by names"
        )
    if suffix == ".npy":
        return _read(value, lambda: np.array(np.load(value, mmap_mode="r", allow_pickle=False)))  # size checked first
    return _read(value, lambda: _market(value))


def _market(path: Any) -> Any:
    check_mtx(path)
    return read_matrix_market(path)


def _arrays(path: str | os.PathLike[str]) -> dict[str, Array]:
    """Return all arrays of an .npz file by name."""
    with archive_of(path, SPARE, TIMES) as archive:
        return {name: archive.array(name) for name in archive.names}


def _variables(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return all matrices of a .mat or .npz file by name."""
    suffix = Path(path).suffix.lower()
    if suffix == ".npz":
        return _read(path, lambda: _arrays(path))
    if suffix == ".mat":
        if Path(path).is_file() and is_hdf5(path):
            needed("h5py", "matlab", "a MATLAB file of version 7.3")
        variables = _read(path, lambda: read_hdf5(path) if is_hdf5(path) else read_matlab(path))
        return {name: value for name, value in variables.items() if not name.startswith("__")}
    if not Path(path).is_file():
        raise ValueError(f"there is no file '{path}'")
    raise ValueError(
        f"'{path}' must be a .mat or .npz file; files of single matrices (.mtx, .npy, .csv) are given by "
        "name, such as M = 'mass.mtx', K = 'stiffness.mtx'"
    )


def _read(path: Any, reader: Any) -> Any:
    """Return what a reader of files of matrices returns; its errors name the file."""
    if not Path(path).is_file():
        raise ValueError(f"there is no file '{path}'")
    try:
        return reader()
    except OSError as error:
        raise ValueError(f"'{path}' cannot be read as matrices: {error.strerror or 'it is damaged'}") from None
    except DamagedFileError as error:
        raise ValueError(f"'{path}' cannot be read as matrices: {error}") from None
    except Exception:  # damaged files raise errors of every class
        reason = f"it is damaged, or not a {Path(path).suffix.lower()} file"
        raise ValueError(f"'{path}' cannot be read as matrices: {reason}") from None
