"""Libraries that only some things need: imported when they are, with an error that says how to install them."""

from __future__ import annotations

import importlib
from typing import Any

from hbgear.common.process.signals import defer_signals


def needed(library: str, extra: str, what: str) -> Any:
    """The library, imported.

    Parameters
    ----------
    library : its name in Python.
    extra : of hbgear that installs it.
    what : needs it, in words.

    Raises
    ------
    ValueError
        If it is not installed.
    """
    try:
        with defer_signals():  # some extension modules say ImportError when Ctrl-C comes
            return importlib.import_module(library)
    except ImportError as error:
        raise ValueError(
            f"{what} needs {library.partition('.')[0]}, which is not installed; pip install 'hbgear[{extra}]'"
        ) from error
