"""Files with a checksum: a set of named parts in one file, SHA-256 of all of it first.

A file is written under another name and renamed, so that a process reads all of an old file or all of a new one.

References
----------
FIPS 180-4 (2015), Secure Hash Standard, https://doi.org/10.6028/NIST.FIPS.180-4.
"""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path


class DamagedFileError(ValueError):
    """Error: a file is refused because its content is damaged, or is more than such a file can hold."""


def read_parts(path: Path) -> dict[str, bytes]:
    """Return the content of each part of a file of `write_parts` by its name; empty if there is no such file.

    DamagedFileError is raised if the checksum is wrong, OSError if the file exists but cannot be read.
    """
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return {}
    size = hashlib.sha256().digest_size
    if hashlib.sha256(content[size:]).digest() != content[:size]:
        raise DamagedFileError(f"{path} is damaged: its checksum is wrong")
    with zipfile.ZipFile(io.BytesIO(content[size:])) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_parts(path: Path, parts: Mapping[str, bytes]) -> None:
    """Write the content of parts by name to a file, in place of one that exists; its folder exists.

    OSError is raised if the file cannot be written; an earlier file is then as it was.
    """
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    content = packed.getvalue()
    descriptor, temporary = tempfile.mkstemp(prefix=f"{path.name}.", suffix=".new", dir=path.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(hashlib.sha256(content).digest() + content)
        os.chmod(temporary, 0o644)  # other users may share the folder
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(temporary)
        raise
