"""Classes of models by what a user calls them: where their code is.

    FILE.py:NAME      a class of models, or a function made one by `hbgear.model`, in a file; its folder is searched too
    MODULE:NAME       the same in a module that can be imported, from the current folder too
    NAME              an entry point of the group "hbgear.models" of an installed package

Loading one runs the code that is there. It is only ever done for a name that the user gave; nothing that is read from
a saved curve is loaded.
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
"""Entry points that name classes of models."""


def installed() -> dict[str, EntryPoint]:
    """Entry points of installed packages by name; none of them is loaded."""
    from importlib.metadata import entry_points  # takes longer than all the rest of this file

    return {point.name: point for point in entry_points(group=GROUP)}


def find_model_class(name: str) -> type[Model]:
    """The class of models that a name stands for; runs the code of its file, module or package.

    Raises
    ------
    KeyError
        If there is no such entry point, or nothing of that name in the file or module.
    ValueError
        If the file or module cannot be loaded, or what has the name is no class of models.
    """
    place, colon, attribute = name.rpartition(":")
    if colon and place and attribute:
        found: Any = _module(place)
        for part in attribute.split("."):
            if not hasattr(found, part):
                known = [other for other, value in vars(found).items() if _is_model(value)]
                raise KeyError(f"'{place}' has no model '{part}'{did_you_mean(part, known)}")
            found = getattr(found, part)
    else:
        points = installed()
        if name not in points:
            raise KeyError(f"no installed package has a model '{name}'{did_you_mean(name, points)}")
        try:
            found = points[name].load()
        except Exception as error:
            raise ValueError(f"the model '{name}' of {points[name].value} cannot be loaded: {_said(error)}") from error
    if not _is_model(found):
        what = (
            "put @hb.mechanics.model before it"
            if inspect.isfunction(found)
            else "name a class, or a function with @hb.mechanics.model"
        )
        raise ValueError(f"'{name}' is {_kind(found)} and no class of models; {what}")
    return found  # type: ignore[no-any-return]


def reference_of(cls: type[Model]) -> str | type[Model]:
    """What another process needs to have the class: the class itself, or FILE.py:NAME if it is out of a file.

    A module that can be imported is found again by name; a file that was named is none.
    """
    return f"{cls.__module__}:{cls.__qualname__}" if cls.__module__.endswith(".py") else cls


def _is_model(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Model) and not inspect.isabstract(found)


def _kind(found: Any) -> str:
    return "a function" if inspect.isfunction(found) else f"a {type(found).__name__}"


def _said(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


class _NoFile(Exception):
    """There is no such file to load."""


def _module(place: str) -> ModuleType:
    try:
        return _of_file(Path(place)) if place.endswith(".py") else _imported(place)
    except _NoFile as error:
        raise ValueError(f"'{place}' cannot be loaded: {error}") from None
    except (Exception, SystemExit) as error:  # whatever the user's code raises while it runs
        raise ValueError(f"'{place}' cannot be loaded: {_said(error)}") from error


def _imported(name: str) -> ModuleType:
    _search(Path.cwd())
    return importlib.import_module(name)


def _of_file(path: Path) -> ModuleType:
    """The module of a file, once; it is called by its whole path, so that no other module can be meant."""
    try:
        path = path.resolve()
    except FileNotFoundError:
        raise _NoFile("the current folder does not exist any more; change to another one") from None
    name = str(path)
    if name in sys.modules:
        return sys.modules[name]
    if not os.path.isfile(path):
        raise _NoFile(f"there is no file '{path}'; give the file of a model as FILE.py:NAME")
    _search(path.parent)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look for the types of their fields
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _search(folder: Path) -> None:
    """Let modules be found in a folder, after those that are installed; processes started from here do so too."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
