"""Files of text, read whole."""

from __future__ import annotations

import os
from pathlib import Path


def text_of_file(path: str | os.PathLike[str], what: str) -> str:
    """The text of a file in UTF-8, with or without the mark that some programs begin it with.

    Parameters
    ----------
    path : of the file.
    what : it is to be, for errors: "a study".

    Raises
    ------
    ValueError
        If it cannot be opened, or is no text.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = str(error.strerror) if isinstance(error, OSError) else "it is no text (UTF-8)"
        raise ValueError(f"'{path}' cannot be read as {what}: {reason}") from None
