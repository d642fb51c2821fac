"""Lookup of model classes by the name that a user gives.

    FILE.py:NAME      a class of models, or a function decorated by `hbgear.mechanics.model`; its folder is searched
    too
    MODULE:NAME       the same in a module that can be imported, also from the current folder
    NAME              an entry point of the group "hbgear.models" of an installed package

The lookup runs the code of the file or module. It is done only for a name that the user gave, never for a name in a
saved file.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from hbgear.common.text.messages import did_you_mean
from hbgear.mechanics.models import Model

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "hbgear.models"
"""Group of the entry points of model classes."""


def installed() -> dict[str, EntryPoint]:
    """Return the entry points of installed packages by name, without loading them."""
    from importlib.metadata import entry_points  # here, because the import is slow

    return {point.name: point for point in entry_points(group=GROUP)}


def find_model_class(name: str) -> type[Model]:
    """Return the class of models of FILE.py:NAME, MODULE:NAME or the name of an entry point.

    The code of its file, module or package is run.

    Raises
    ------
    KeyError
        If there is no such entry point, or the file or module has no such name.
    ValueError
        If the file or module cannot be loaded, or the name is not a class of models.
    """
    source, colon, attribute = name.rpartition(":")
    if colon and source and attribute:
        target: Any = _module(source)
        for part in attribute.split("."):
            if not hasattr(target, part):
                names = [name for name, value in vars(target).items() if _is_model(value)]
                raise KeyError(f"'{source}' has no model '{part}'{did_you_mean(part, names)}")
            target = getattr(target, part)
    else:
        points = installed()
        if name not in points:
            raise KeyError(f"no installed package has a model '{name}'{did_you_mean(name, points)}")
        try:
            target = points[name].load()
        except Exception as error:
            raise ValueError(
                f"the model '{name}' of {points[name].value} cannot be loaded: {_error_text(error)}"
            ) from error
    if not _is_model(target):
        advice = (
            "decorate it by @hb.mechanics.model"
            if inspect.isfunction(target)
            else "name a class, or a function decorated by @hb.mechanics.model"
        )
        raise ValueError(f"'{name}' is {_kind(target)}, not a class of models; {advice}")
    return target


def reference_of(cls: type[Model]) -> str | type[Model]:
    """Return a reference by which another process finds a class: FILE.py:NAME, or the class itself.

    A module that can be imported is found by its name; a file that the user named is not.
    """
    return f"{cls.__module__}:{cls.__qualname__}" if cls.__module__.endswith(".py") else cls


def _is_model(target: Any) -> bool:
    return isinstance(target, type) and issubclass(target, Model) and not inspect.isabstract(target)


def _kind(target: Any) -> str:
    return "a function" if inspect.isfunction(target) else f"a {type(target).__name__}"


def _error_text(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


class _NoFileError(Exception):
    """The file does not exist."""


def _module(source: str) -> ModuleType:
    try:
        return _load_file(Path(source)) if source.endswith(".py") else _import_module(source)
    except _NoFileError as error:
        raise ValueError(f"'{source}' cannot be loaded: {error}") from None
    except (Exception, SystemExit) as error:  # any error of the user's code
        raise ValueError(f"'{source}' cannot be loaded: {_error_text(error)}") from error


def _import_module(name: str) -> ModuleType:
    _add_search_path(Path.cwd())
    return importlib.import_module(name)


def _load_file(path: Path) -> ModuleType:
    """Return the module of a file, loaded once under its whole path, so that the name is unique."""
    try:
        path = path.resolve()
    except FileNotFoundError:
        raise _NoFileError("the current folder does not exist any more; change to another one") from None
    name = str(path)
    if name in sys.modules:
        return sys.modules[name]
    if not os.path.isfile(path):
        raise _NoFileError(f"there is no file '{path}'; give the file of a model as FILE.py:NAME")
    _add_search_path(path.parent)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look up the types of their fields here
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _add_search_path(folder: Path) -> None:
    """Add a folder to the module search path after the installed packages; processes started from here inherit it."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
