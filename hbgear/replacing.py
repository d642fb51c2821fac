"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any


@contextmanager
def replacing(path: str | os.PathLike[str], mode: str = "xb", **options: Any) -> Iterator[IO[Any]]:
    """A file to write that takes its name only once it is complete; a failure leaves what was there before."""
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot write '{path}': there is no folder '{path.parent}'; create it first")
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with open(temporary, mode, **options) as handle:
            yield handle
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def checked_suffix(path: str | os.PathLike[str], allowed: tuple[str, ...], advice: str) -> str:
    """The ending of a name, in small letters; any other than those allowed is refused with the advice."""
    suffix = Path(path).suffix.lower()
    if suffix not in allowed:
        raise ValueError(f"'{path}' must end in {' or '.join(allowed)}; {advice}")
    return suffix
