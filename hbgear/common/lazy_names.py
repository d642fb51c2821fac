"""Names of a package that are imported at their first use.

A package imports them in a block ``if TYPE_CHECKING``, which editors and type checkers read. This module reads the same
lines from the source. A program imports only the modules that it uses.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


@cache
def attached(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package, for its names and sub-packages."""
    module = sys.modules[package]
    file = Path(str(module.__file__))
    places = {name: place for name, place in _places(file.read_text(encoding="utf-8")).items() if place != package}

    def found(name: str) -> Any:
        if name in places:
            value = getattr(import_module(places[name]), name)
        elif not name.startswith("_") and (file.parent / name / "__init__.py").is_file():
            value = import_module(f"{package}.{name}")
        else:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        setattr(module, name, value)  # later uses find it there
        return value

    def names() -> list[str]:
        """Return the public names, which editors and notebooks complete."""
        return sorted({*(name for name in vars(module) if name.startswith("__")), *getattr(module, "__all__", places)})

    return found, names


def _places(source: str) -> dict[str, str]:
    """Return the module of each name in the block ``if TYPE_CHECKING`` of a source."""
    blocks = [node for node in ast.parse(source).body if isinstance(node, ast.If)]
    checked = [node for block in blocks if ast.unparse(block.test) == "TYPE_CHECKING" for node in block.body]
    imports = [node for node in checked if isinstance(node, ast.ImportFrom)]
    return {name.name: str(node.module) for node in imports for name in node.names}
