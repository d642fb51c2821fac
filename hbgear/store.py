"""A folder that holds the finished cases of a study, each under a key of its inputs.

    study.json              schema, version of hbgear, and the settings all cases share
    cases/ab/abcdef....npz  one case: a JSON header (inputs, numbers, reason of a failure), arrays, bytes of a branch

Each file appears whole or not at all, so a study that is killed loses only what was being computed.
"""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hbgear._version import __version__
from hbgear.fourier import Array
from hbgear.replacing import replacing

SCHEMA = 1
"""Number of the form of the files."""


@dataclass(frozen=True)
class Result:
    """What a case gave: numbers and arrays by name, its branch packed, or the reason why not; seconds it took."""

    numbers: dict[str, float] = field(default_factory=dict)
    arrays: dict[str, Array] = field(default_factory=dict)
    branch: bytes = b""
    reason: str = ""
    seconds: float = 0.0


def key_of(inputs: Mapping[str, Any]) -> str:
    """Name of a case: a hash of its inputs and of the schema; floats count to the last digit."""
    text = json.dumps({"schema": SCHEMA, **inputs}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


class Store:
    """The folder of one study.

    Parameters
    ----------
    folder : made if it is not there; its parent must be.
    study : what all cases share, fit for JSON.

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
        if file.exists():
            _check_same(file, head)
            return
        if self.folder.exists() and not self.folder.is_dir():
            raise ValueError(f"'{folder}' is a file; give a folder for the cases")
        if not self.folder.parent.is_dir():
            raise ValueError(f"cannot make '{folder}': there is no folder '{self.folder.parent}'; create it first")
        if self.folder.is_dir() and any(self.folder.iterdir()):
            raise ValueError(f"the folder '{folder}' is not empty and holds no study; give another one")
        self.folder.mkdir(exist_ok=True)
        with replacing(file, "x", encoding="utf-8") as handle:
            json.dump(head, handle, indent=1)

    def path(self, key: str) -> Path:
        return self.folder / "cases" / key[:2] / f"{key}.npz"

    def read(self, key: str) -> Result | None:
        """A case that was stored, without its branch; None if it is not there or cannot be read."""
        try:
            with np.load(self.path(key), allow_pickle=False) as archive:
                head = json.loads(str(archive["header"]))
                arrays = {name: archive[name] for name in head["arrays"]}
                return Result(head["numbers"], arrays, reason=head["reason"], seconds=head["seconds"])
        except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
            return None

    def branch(self, key: str) -> bytes:
        """The packed branch of a case that was stored with one."""
        with np.load(self.path(key), allow_pickle=False) as archive:
            return bytes(archive["branch"])

    def write(self, key: str, inputs: Mapping[str, Any], result: Result) -> None:
        """Store a case, whole or not at all."""
        head = {"inputs": dict(inputs), "numbers": result.numbers, "arrays": list(result.arrays),
                "reason": result.reason, "seconds": result.seconds}  # fmt: skip
        path = self.path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        arrays = dict(result.arrays)
        if result.branch:
            arrays["branch"] = np.frombuffer(result.branch, dtype=np.uint8)
        with replacing(path) as handle:
            np.savez(handle, header=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]


def _check_same(file: Path, head: dict[str, Any]) -> None:
    try:
        there = json.loads(file.read_text(encoding="utf-8"))
        versions = there["schema"], there["hbgear"]
        before = there["study"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"'{file}' cannot be read as a study ({error}); give another folder") from error
    if versions != (head["schema"], head["hbgear"]):
        raise ValueError(
            f"'{file}' was written by hbgear {versions[1]}, schema {versions[0]}; this is {head['hbgear']}, schema "
            f"{head['schema']}, and may give other numbers: finish it with that version, or give another folder"
        )
    names = [name for name in head["study"] if before.get(name) != head["study"][name]]
    if names:
        changed = ", ".join(f"{name} = {before.get(name)} there, {head['study'][name]} now" for name in names)
        raise ValueError(f"the folder of '{file}' holds another study ({changed}); give another folder")
