"""Facade: a convenience method calls a function of a higher package by its name.

``branch.save(path)`` and ``pair.model(torque, damping)`` are short forms of functions that live in packages above the
class. An ``import`` there would close a cycle, so the function is looked up by name when the method is called. Nothing
else imports upward: `call` is the only way, and its users are listed in ``pyproject.toml``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


def call(place: str, *arguments: Any, **options: Any) -> Any:
    """Call a function of this package by its name, such as ``call("hbgear.io.branches.npz.save", branch, path)``.

    Examples
    --------
    >>> call("hbgear.common.text.digits.rounded", 1.23456, 3)
    '1.23'
    """
    module, _, function = place.rpartition(".")
    return getattr(import_module(module), function)(*arguments, **options)
