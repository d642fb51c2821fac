"""Text files: regular files of a limited size, read completely."""

from __future__ import annotations

import os
import stat

MOST_BYTES = 32 << 20
"""Size [bytes] above which a text file is refused: input files that a person writes are smaller."""


def bytes_of_file(path: str | os.PathLike[str], kind: str) -> bytes:
    """Return the bytes of a regular file; pipes and devices, which may never end, are not opened.

    ``kind`` is the content that is expected, for messages, such as "a study". ValueError is raised if the file cannot
    be opened, is a pipe, a device, a socket or a folder, or is too large.
    """
    refused = f"'{path}' cannot be read as {kind}"
    try:
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise ValueError(f"{refused}: it is a pipe, a device or a socket; need a regular file")
        with open(path, "rb") as handle:
            content = handle.read(MOST_BYTES + 1)  # files of /proc have no size
    except OSError as error:
        raise ValueError(f"{refused}: {error.strerror}") from None
    except ValueError as error:
        if "null byte" in str(error):
            raise ValueError(f"{str(path)!r} is no name of a file: it has a null character") from None
        raise
    if len(content) > MOST_BYTES:
        raise ValueError(f"{refused}: it has more than {MOST_BYTES / 2**20:g} MiB; need a smaller file")
    return content


def text_of_file(path: str | os.PathLike[str], kind: str) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark, with line ends LF.

    ValueError is raised as by `bytes_of_file`, or if the file contains no text.
    """
    try:
        text = bytes_of_file(path, kind).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"'{path}' cannot be read as {kind}: {_not_text(error)}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _not_text(error: UnicodeDecodeError) -> str:
    """Return the reason for which bytes are not text, for messages."""
    line = error.object[: error.start].count(b"\n") + 1
    return f"it is no text (UTF-8), line {line} has the byte 0x{error.object[error.start]:02x}; save it as UTF-8"
