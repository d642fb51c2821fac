"""A folder that holds the finished cases of a study, each under a key of its inputs.

    study.json              schema, version of hbgear, and the settings all cases share
    cases/ab/abcdef....npz  one case: a JSON header (version, inputs, numbers, reason of a failure), arrays, bytes of a
                            branch

Each file appears whole or not at all, so a study that is killed loses only what was being computed. What was damaged
later is as if it were not there: a case is computed anew, study.json is written anew.
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
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from hbgear._version import __version__
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.text.messages import quoted
from hbgear.io.branches.archive import archive_of

SCHEMA = 1
"""Number of the form of the files."""


@dataclass(frozen=True)
class Result:
    """What a case gave: numbers and arrays by name, its branch packed, or the reason why not; seconds it took.

    A result read from a store tells by ``has_branch`` whether its file holds the branch, and leaves it there.
    """

    numbers: dict[str, float] = field(default_factory=dict)
    arrays: dict[str, Array] = field(default_factory=dict)
    branch: bytes = b""
    reason: str = ""
    seconds: float = 0.0
    has_branch: bool = False


def key_of(inputs: Mapping[str, Any]) -> str:
    """Name of a case: a hash of its inputs and of the schema; floats count to the last digit."""
    text = json.dumps({"schema": SCHEMA, **inputs}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


class Store:
    """The folder of one study.

    Parameters
    ----------
    folder : path-like
        Made if it is not there; its parent must be.
    study : mapping of str to Any
        What all cases share, fit for JSON.

    Raises
    ------
    ValueError
        If the folder holds another study, one of another version of hbgear, or files that are no study; if it is a
        file itself, or its parent is not there.
    OSError
        If it cannot be written.
    """

    def __init__(self, folder: str | os.PathLike[str], study: Mapping[str, Any]) -> None:
        self.folder = Path(folder)
        file = self.folder / "study.json"
        head = {"schema": SCHEMA, "hbgear": __version__, "study": json.loads(json.dumps(study))}
        self._versions_known = True
        if os.path.exists(file) and not os.path.isfile(
            file
        ):  # those of os take a name too long for one that is missing
            raise ValueError(f"'{file}' is no regular file; move it away, it is where the study is described")
        if os.path.exists(file):
            there = _read_study(file)
            if there is not None:
                _check_same(file, there, head)
                return
            self._write_again(file, head)
            return
        if os.path.exists(folder) and not os.path.isdir(folder):
            raise ValueError(f"'{folder}' is a file; give a folder for the cases")
        if not os.path.isdir(self.folder.parent):
            raise ValueError(f"cannot make '{folder}': there is no folder '{self.folder.parent}'; create it first")
        if os.path.isdir(folder) and any(not path.name.startswith(".") for path in self.folder.iterdir()):
            raise ValueError(f"the folder '{folder}' is not empty and holds no study; give another one")
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OSError(f"cannot make '{folder}' ({error.strerror}); give another folder for the cases") from error
        _write(file, head)

    def _write_again(self, file: Path, head: dict[str, Any]) -> None:
        """Write the damaged study.json of a folder with cases; those of which it told the version count no more."""
        if not (self.folder / "cases").is_dir():
            raise ValueError(f"'{file}' cannot be read as a study; give another folder")
        _write(file, head)
        self._versions_known = False
        text = (
            f"'{file}' could not be read and was written anew; cases that do not tell their version are computed anew"
        )
        warnings.warn(text, stacklevel=4)

    def check_writable(self) -> None:
        """Raise OSError, before anything is computed, if cases could not be stored."""
        folder = self.folder / "cases"
        folder.mkdir(exist_ok=True)
        with TemporaryFile(dir=folder):
            pass

    def path(self, key: str) -> Path:
        """File of the case of this key."""
        return self.folder / "cases" / key[:2] / f"{key}.npz"

    def read(self, key: str) -> Result | None:
        """A case that was stored, without its branch, whose bytes are checked all the same; None if it is not there.

        Raises
        ------
        OSError, ValueError
            If it cannot be read, or is another case.
        """
        path = self.path(key)
        if not path.exists():
            return None
        with archive_of(path) as archive:
            head = archive.header()
            numbers, names, reason, seconds = (head.get(name) for name in ("numbers", "arrays", "reason", "seconds"))
            if not (isinstance(numbers, dict) and all(map(_is_number, [*numbers.values(), seconds]))):
                raise ValueError("its numbers are none")
            taken = float(seconds or 0)
            if not 0 <= taken < math.inf:
                raise ValueError(f"it took {taken} seconds")
            if not (isinstance(names, list) and all(isinstance(name, str) for name in [*names, reason])):
                raise ValueError("its names of arrays or its reason are no texts")
            self._check_origin(key, head)
            arrays = {name: archive.array(name) for name in names}
            if any(array.dtype.kind != "f" for array in arrays.values()):
                raise ValueError("its arrays are no real numbers")
            has_branch = "branch" in archive and archive.array("branch").dtype == np.uint8
            return Result(numbers, arrays, reason=str(reason), seconds=taken, has_branch=has_branch)

    def _check_origin(self, key: str, head: Mapping[str, Any]) -> None:
        """Refuse a case of other inputs, and one of another version of hbgear."""
        if not isinstance(head.get("inputs"), dict) or key_of(head["inputs"]) != key:
            raise ValueError("its inputs are those of another case")
        if not self._versions_known and head.get("hbgear") != __version__:
            raise ValueError("it does not tell the version it was computed with")

    def branch(self, key: str) -> bytes:
        """The packed branch of a case that was stored with one; errors as of `read`."""
        with archive_of(self.path(key)) as archive:
            return archive.array("branch").tobytes()

    def write(self, key: str, inputs: Mapping[str, Any], result: Result) -> None:
        """Store a case, whole or not at all."""
        head = {"hbgear": __version__, "inputs": dict(inputs), "numbers": result.numbers, "arrays": list(result.arrays),
                "reason": result.reason, "seconds": result.seconds}  # fmt: skip
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


def _read_study(file: Path) -> dict[str, Any] | None:
    """What study.json says; None if it cannot be understood."""
    try:
        there = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return None
    kinds = {"schema": int, "hbgear": str, "study": dict}
    whole = isinstance(there, dict) and all(type(there.get(name)) is kind for name, kind in kinds.items())
    return there if whole else None


def _check_same(file: Path, there: dict[str, Any], head: dict[str, Any]) -> None:
    versions, before = (there["schema"], there["hbgear"]), there["study"]
    if versions != (head["schema"], head["hbgear"]):
        raise ValueError(
            f"'{file}' was written by hbgear {versions[1]}, schema {versions[0]}; this is {head['hbgear']}, schema "
            f"{head['schema']}, and may give other numbers: finish it with that version, or give another folder"
        )
    names = [name for name in head["study"] if before.get(name) != head["study"][name]]
    if names:
        changed = ", ".join(
            f"{name} = {quoted(before.get(name))} there, {quoted(head['study'][name])} now" for name in names
        )
        raise ValueError(f"the folder of '{file}' holds another study ({changed}); give another folder")
