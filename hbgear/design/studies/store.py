"""Folder with the finished cases of a study, each named by a hash of its inputs.

    study.json              schema, version of hbgear, and the common settings of the cases
    cases/ab/abcdef....npz  one case: a JSON header (version, inputs, numbers, reason of a failure), arrays, bytes of a
                            branch

Files are written atomically. A study that is killed loses only the cases in progress. A damaged file counts as missing:
its case is computed again, and study.json is written again.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hbgear._version import __version__
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write, check_writable
from hbgear.common.text.messages import quoted
from hbgear.io.branches.archive import archive_of

STORE_SCHEMA = 1
"""Version of the file format."""


@dataclass(frozen=True)
class Result:
    """Result of a case: numbers and arrays by name, packed branch, reason of a failure, and computing time [s].

    A result from a store does not contain the bytes of its branch; ``has_branch`` states whether the file has them.
    """

    numbers: dict[str, float] = field(default_factory=dict)
    arrays: dict[str, Array] = field(default_factory=dict)
    branch: bytes = b""
    reason: str = ""
    seconds: float = 0.0
    has_branch: bool = False


def key_of(inputs: Mapping[str, Any]) -> str:
    """Return the key of a case: a hash of its inputs, with all digits, and of the schema."""
    text = json.dumps({"schema": STORE_SCHEMA, **inputs}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


class Store:
    """Folder of one study.

    Parameters
    ----------
    folder : path-like
        Folder, which is created if its parent exists.
    study : mapping of str to Any
        Common settings of the cases, in types of JSON.

    Raises
    ------
    ValueError
        If the folder contains another study, a study of another version of hbgear, or other files; if it is a file, or
        its parent does not exist.
    OSError
        If the folder cannot be written.
    """

    def __init__(self, folder: str | os.PathLike[str], study: Mapping[str, Any]) -> None:
        self.folder = Path(folder)
        file = self.folder / "study.json"
        head = {"schema": STORE_SCHEMA, "hbgear": __version__, "study": json.loads(json.dumps(study))}
        self._versions_known = True
        # functions of os.path return False for a name that is too long
        if os.path.exists(file) and not os.path.isfile(file):
            raise ValueError(
                f"'{file}' is not a regular file; move it away, because the study is described in this file"
            )
        if os.path.exists(file):
            stored = _stored_study(file)
            if stored is not None:
                _check_same_study(file, stored, head)
                return
            self._replace_damaged(file, head)
            return
        if os.path.exists(folder) and not os.path.isdir(folder):
            raise ValueError(f"'{folder}' is a file; give a folder for the cases")
        if not os.path.isdir(self.folder.parent):
            raise ValueError(f"cannot make '{folder}': there is no folder '{self.folder.parent}'; create it first")
        if os.path.isdir(folder) and any(not path.name.startswith(".") for path in self.folder.iterdir()):
            raise ValueError(f"the folder '{folder}' is not empty and contains no study; give another folder")
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OSError(f"cannot make '{folder}' ({error.strerror}); give another folder for the cases") from error
        _write(file, head)

    def _replace_damaged(self, file: Path, head: dict[str, Any]) -> None:
        """Write the damaged study.json of a folder with cases; cases that do not state their version become invalid."""
        if not (self.folder / "cases").is_dir():
            raise ValueError(f"'{file}' cannot be read as a study; give another folder")
        _write(file, head)
        self._versions_known = False
        warnings.warn(
            f"'{file}' could not be read and was written again; cases that do not state their version "
            "are computed again",
            stacklevel=4,
        )

    def check_writable(self) -> None:
        """Raise OSError if cases cannot be stored, as on a full disk; called before the computation."""
        folder = self.folder / "cases"
        folder.mkdir(exist_ok=True)
        check_writable(folder / "case.npz")

    def path(self, key: str) -> Path:
        """Return the path of the file of a case."""
        return self.folder / "cases" / key[:2] / f"{key}.npz"

    def read(self, key: str) -> Result | None:
        """Return a stored case without its branch, or None if it is not stored. The bytes of the branch are checked.

        OSError or ValueError is raised if the file cannot be read or contains another case.
        """
        path = self.path(key)
        if not path.exists():
            return None
        with archive_of(path) as archive:
            head = archive.header()
            numbers, names, reason, seconds = (head.get(name) for name in ("numbers", "arrays", "reason", "seconds"))
            if not (isinstance(numbers, dict) and all(map(_is_number, [*numbers.values(), seconds]))):
                raise ValueError("its numbers are not numbers")
            computing_time = float(seconds or 0)
            if not 0 <= computing_time < math.inf:
                raise ValueError(f"its computing time is {computing_time} seconds")
            if not (isinstance(names, list) and all(isinstance(name, str) for name in [*names, reason])):
                raise ValueError("its names of arrays or its reason are not texts")
            self._check_origin(key, head)
            arrays = {name: archive.array(name) for name in names}
            if any(array.dtype.kind != "f" for array in arrays.values()):
                raise ValueError("its arrays are not real numbers")
            has_branch = "branch" in archive and archive.array("branch").dtype == np.uint8
            return Result(numbers, arrays, reason=str(reason), seconds=computing_time, has_branch=has_branch)

    def _check_origin(self, key: str, head: Mapping[str, Any]) -> None:
        """Raise an error for a case of other inputs or of another version of hbgear."""
        if not isinstance(head.get("inputs"), dict) or key_of(head["inputs"]) != key:
            raise ValueError("its inputs belong to another case")
        if not self._versions_known and head.get("hbgear") != __version__:
            raise ValueError("it does not state the version of hbgear that computed it")

    def branch(self, key: str) -> bytes:
        """Return the packed branch of a case that was stored with it; the errors are the ones of `read`."""
        with archive_of(self.path(key)) as archive:
            return archive.array("branch").tobytes()

    def write(self, key: str, inputs: Mapping[str, Any], result: Result) -> None:
        """Store a case atomically."""
        head = {
            "hbgear": __version__,
            "inputs": dict(inputs),
            "numbers": result.numbers,
            "arrays": list(result.arrays),
            "reason": result.reason,
            "seconds": result.seconds,
        }
        path = self.path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        arrays = dict(result.arrays)
        if result.branch:
            arrays["branch"] = np.frombuffer(result.branch, dtype=np.uint8)
        with atomic_write(path) as handle:
            np.savez(handle, header=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]


def _is_number(x: Any) -> bool:
    return type(x) is float or (type(x) is int and abs(x) < 2**63)


def _write(file: Path, head: dict[str, Any]) -> None:
    with atomic_write(file, "x", encoding="utf-8") as handle:
        json.dump(head, handle, indent=1)


def _stored_study(file: Path) -> dict[str, Any] | None:
    """Return the content of study.json, or None if it is damaged."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return None
    kinds = {"schema": int, "hbgear": str, "study": dict}
    is_valid = isinstance(content, dict) and all(type(content.get(name)) is kind for name, kind in kinds.items())
    return content if is_valid else None


def _check_same_study(file: Path, stored: dict[str, Any], head: dict[str, Any]) -> None:
    """Raise ValueError if a folder holds the cases of another study or version."""
    versions, stored_settings = (stored["schema"], stored["hbgear"]), stored["study"]
    if versions != (head["schema"], head["hbgear"]):
        raise ValueError(
            f"'{file}' was written by hbgear {versions[1]}, schema {versions[0]}; this is {head['hbgear']}, schema "
            f"{head['schema']}, and may give other numbers: finish it with the other version, or give another folder"
        )
    names = [name for name in head["study"] if stored_settings.get(name) != head["study"][name]]
    if names:
        changed = ", ".join(
            f"{name} = {quoted(stored_settings.get(name))} in the folder, {quoted(head['study'][name])} now"
            for name in names
        )
        raise ValueError(f"the folder of '{file}' contains another study ({changed}); give another folder")
