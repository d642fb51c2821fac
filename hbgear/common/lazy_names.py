"""Names of a package that are imported when they are first used.

A package imports them ``if TYPE_CHECKING``, where editors and type checkers read what there is and where; the same
lines, read from its source, are the table of this module. A program waits for what it uses, and for nothing else.
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
    """``__getattr__`` and ``__dir__`` of a package, called in it: its names, and the packages in it."""
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
        setattr(module, name, value)  # is not asked for again
        return value

    return found, lambda: sorted({*vars(module), *places})


def _places(source: str) -> dict[str, str]:
    """Module of each name that a source imports if types are checked."""
    blocks = [node for node in ast.parse(source).body if isinstance(node, ast.If)]
    checked = [node for block in blocks if ast.unparse(block.test) == "TYPE_CHECKING" for node in block.body]
    imports = [node for node in checked if isinstance(node, ast.ImportFrom)]
    return {name.name: str(node.module) for node in imports for name in node.names}
