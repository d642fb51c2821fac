"""Optional libraries: imported when a function needs them, with an error that states how to install them."""

from __future__ import annotations

import importlib
from typing import Any

from hbgear.common.process.signals import defer_signals


def needed(library: str, extra: str, what: str) -> Any:
    """Return an optional library, imported; ValueError names the extra of hbgear that installs it.

    ``what`` is the function that needs it, in words.
    """
    try:
        with defer_signals():  # some extension modules turn Ctrl-C into an ImportError
            return importlib.import_module(library)
    except ImportError as error:
        raise ValueError(
            f"{what} needs {library.partition('.')[0]}, which is not installed; pip install 'hbgear[{extra}]'"
        ) from error
