"""Branches as .npz files: a JSON header with all values except the arrays, which are stored under their path.

header.npy    {"format": "hbgear branch", "schema": 5, "branch": {"__class__": "Branch", "X": {"__array__": "X"}, ...}}
X.npy, ...    the arrays

The header also has "motions", one entry for each curve of the span: names and coefficients of all coordinates, or null
if the model can be rebuilt without its code, or has too many coordinates.
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.atomic_write import atomic_write, checked_suffix
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.branch_data import FullMotion, saved_fields
from hbgear.continuation.results.point import Jump, Point, SpecialPoint
from hbgear.harmonic.autonomous.tori.layout import TorusLayout
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models import model_registry
from hbgear.io.branches import forms
from hbgear.io.branches.archive import Archive, archive_of

SCHEMA = 5
"""Number of the file format that `Branch.save` writes; `load` reads this and all earlier ones.

1: special points without meaning and marker. 2: with them.
3: with the other curves of the span, and statuses of later versions.
4: with errors of special points, which may have more unknowns than their curve, and of multipliers.
5: with certificates of special points, and contacts that begin at all phases.
"""


_FORMAT = "hbgear branch"


@checked_arguments()
def save(branch: Branch, path: str | os.PathLike[str]) -> None:
    """Write a branch to an .npz with a JSON header, completely or not at all; `load` returns the same numbers.

    Parameters
    ----------
    branch : Branch
        Branch, with the other branches of its span.
    path : path_like
        File that ends in .npz.

    Raises
    ------
    ValueError
        If the path has another ending, or the branch consists of tori.

    Examples
    --------
    >>> import hbgear as hb
    >>> import os, tempfile
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     hb.save(curve, os.path.join(folder, "curve.npz"))
    ...     loaded = hb.load(os.path.join(folder, "curve.npz"))
    ...
    >>> bool((loaded.X == curve.X).all())
    True
    """
    checked_suffix(path, (".npz",), "use export for .csv and .mat")
    arrays = _encoded_arrays(branch)
    with atomic_write(path) as handle:
        np.savez(handle, **arrays)


def packed(branch: Branch) -> bytes:
    """Return the bytes that `save` writes."""
    handle = io.BytesIO()
    np.savez(handle, **_encoded_arrays(branch))
    return handle.getvalue()


def _encoded_arrays(branch: Branch) -> dict[str, Any]:
    if branch.layout is not None and not isinstance(branch.layout, Layout | TorusLayout):
        raise ValueError(
            f"a branch with unknowns of the kind {type(branch.layout).__name__} cannot be saved: only curves of "
            "periodic motions, of tori and of plain numbers can; compute it from the curve again"
        )
    arrays: dict[str, Any] = {}
    header: dict[str, Any] = {"format": _FORMAT, "schema": SCHEMA, "branch": encode(branch, "", arrays)}
    motions = [_recorded(curve) for curve in branch.curves]
    if any(motions):
        header["motions"] = [_entry(motion, f"motions.{i}", arrays) for i, motion in enumerate(motions)]
    return {"header": np.array(json.dumps(header)), **arrays}


MAX_RECORDED_NUMBERS = 4_000_000
"""Largest number of coefficients of all coordinates that is stored: 32 MB."""


def _recorded(branch: Branch) -> FullMotion | None:
    """Return all coordinates of a curve whose model cannot be rebuilt from its file; None if they are too many."""
    problem, layout = branch.problem, layout_of(branch)
    if problem is None and branch.full_motion is not None and len(branch.full_motion.rows) == len(branch):
        return branch.full_motion
    if not isinstance(problem, HarmonicBalance) or layout is None or _rebuilt(branch):
        return None
    if len(branch) * len(problem.dof_names) * (2 * layout.harmonics + 1) > MAX_RECORDED_NUMBERS:
        return None
    rows = np.array([problem.motion(X, **branch.parameters_at(i)) for i, X in enumerate(branch.X)])
    return FullMotion(tuple(problem.dof_names), rows)


def _rebuilt(branch: Branch) -> bool:
    """Return whether the model can be rebuilt from the header."""
    try:
        model_registry.rebuild_model(branch.meta.get("model"))
    except (KeyError, ValueError):
        return False
    return True


def _entry(motion: FullMotion | None, key: str, arrays: dict[str, Any]) -> dict[str, Any] | None:
    if motion is None:
        return None
    arrays[key] = motion.rows
    return {"names": list(motion.names), "rows": {"__array__": key}}


@checked_arguments()
def load(path: str | os.PathLike[str], problem: Any = None) -> Branch:
    """Read a branch written by `Branch.save`.

    Parameters
    ----------
    path : str or path-like
        Path of the .npz file.
    problem : HarmonicBalance or other problem, optional
        The problem of the curve. By default it is rebuilt from the file, unless its model is defined outside hbgear, or
        the branch is a curve of special points.

    Returns
    -------
    Branch
        The saved branch with the same numbers, and its problem, with which it can be followed, extended and validated.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file cannot be read, is not a branch, or was written by a newer hbgear.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> import os, tempfile
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     curve.save(os.path.join(folder, "curve.npz"))
    ...     again = hb.load(os.path.join(folder, "curve.npz"))
    ...
    >>> bool(np.array_equal(again.X, curve.X))
    True
    """
    branch = read(path)
    if problem is not None:
        return _with_problem(branch, lambda _: problem)
    with warnings.catch_warnings(action="ignore"):  # of the model, which were shown when the curve was traced
        return _with_problem(branch, lambda curve: None if "curve" in curve.meta else curve.rebuilt_problem())


def read(path: str | os.PathLike[str]) -> Branch:
    """Read a branch without its problem from an .npz file; FileNotFoundError or ValueError as of `load`."""
    if not os.path.exists(path):  # Path.exists raises if the name is too long
        raise FileNotFoundError(f"there is no file '{path}'; give the .npz of a saved branch")
    try:
        with archive_of(path) as archive:
            return _branch_in(archive)
    except _Newer as newer:
        raise ValueError(f"'{path}' {newer}") from None
    except (OSError, ValueError, MemoryError) as error:
        error = ValueError(error.strerror) if isinstance(error, OSError) and error.strerror else error
        raise ValueError(
            f"'{path}' cannot be read as a branch ({error}); need an .npz written by Branch.save or hbgear trace -o"
        ) from error


def unpacked(data: bytes, problem: Any = None) -> Branch:
    """Return the branch of the bytes that `packed` returned; ValueError if they are damaged."""
    return _with_problem(_branch_in(Archive(io.BytesIO(data))), lambda _: problem)


def _with_problem(branch: Branch, problem_of: Callable[[Branch], Any]) -> Branch:
    """Return a branch and the other curves of its span, each with its problem."""
    others = tuple(_with_problem(other, problem_of) for other in branch.others)
    return dataclasses.replace(branch, problem=problem_of(branch), others=others)


class _Newer(ValueError):
    """Error: the file has a later schema."""


def _branch_in(archive: Archive) -> Branch:
    """Return the branch of an archive; ValueError if its format or schema is another one."""
    header = archive.header()
    if header.get("format") != _FORMAT:
        raise ValueError(f"its format is {str(header.get('format'))[:40]!r}")
    schema = header.get("schema")
    if isinstance(schema, bool) or not isinstance(schema, int) or schema < 1:
        raise ValueError(f"its schema is {str(schema)[:40]!r}, not a number")
    if schema > SCHEMA:
        raise _Newer(f"has schema {schema}, this hbgear reads up to {SCHEMA}; upgrade hbgear")
    branch = forms.read(archive, header.get("branch"))
    motions = header.get("motions")
    if motions is None:
        return branch
    curves = [
        dataclasses.replace(curve, full_motion=forms.read_motions(archive, entry, curve))
        for curve, entry in zip(branch.curves, forms.listed(motions, 1 + len(branch.others)), strict=True)
    ]
    return dataclasses.replace(curves[0], others=tuple(curves[1:]))


def encode(value: Any, key: str, arrays: dict[str, Any]) -> Any:
    """Convert a value to JSON; arrays are stored in ``arrays`` under their path in the tree."""
    if type(value) in _CLASSES.values():
        value = {"__class__": type(value).__name__, **saved_fields(value)}
    if isinstance(value, np.ndarray):
        arrays[key] = value
        return {"__array__": key}
    if isinstance(value, dict):
        return {name: encode(x, f"{key}.{name}".lstrip("."), arrays) for name, x in value.items()}
    if isinstance(value, list | tuple):
        items = [encode(x, f"{key}.{i}", arrays) for i, x in enumerate(value)]
        return {"__tuple__": items} if isinstance(value, tuple) else items
    return value.item() if isinstance(value, np.generic) else value


_CLASSES: dict[str, Any] = {kind.__name__: kind for kind in (Layout, TorusLayout, Point, SpecialPoint, Jump, Branch)}
