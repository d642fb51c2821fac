"""Deprecated names: names of an earlier version that keep working with a `DeprecationWarning`."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

_Class = TypeVar("_Class", bound=type)


def warn_renamed(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that a name is deprecated; `stacklevel` is that of `warnings.warn`, by default the caller of the caller."""
    warnings.warn(f"{old} is deprecated: use {new}", DeprecationWarning, stacklevel=stacklevel)


def renamed_attributes(**new_names: str) -> Callable[[_Class], _Class]:
    """Return a class decorator that adds a read-only property for each old name, such as ``doubts="warnings"``."""

    def decorate(cls: _Class) -> _Class:
        for old, new in new_names.items():
            setattr(cls, old, _renamed_attribute(cls.__name__, old, new))
        return cls

    return decorate


def renamed_fields(**new_names: str) -> Callable[[_Class], _Class]:
    """Return a decorator of data classes that accept old names as keyword arguments, such as ``longest="max_step"``.

    Each old name is also a read-only property.
    """

    def decorate(cls: _Class) -> _Class:
        init: Callable[..., None] = vars(cls)["__init__"]

        @functools.wraps(init)
        def accept_old_names(self: Any, *arguments: Any, **options: Any) -> None:
            for old in options.keys() & new_names.keys():
                new = new_names[old]
                if new in options:
                    raise TypeError(f"{cls.__name__}: {old} is the deprecated name of {new}; give only {new}")
                warn_renamed(f"{cls.__name__}({old}=...)", f"{new}=")
                options[new] = options.pop(old)
            init(self, *arguments, **options)

        accept_old_names.old_names = tuple(new_names)  # type: ignore[attr-defined]
        cls.__init__ = accept_old_names  # type: ignore[misc]
        return renamed_attributes(**new_names)(cls)

    return decorate


def _renamed_attribute(owner: str, old: str, new: str) -> property:
    """Return a property with the value of the attribute of the new name."""

    def value(self: Any) -> Any:
        warn_renamed(f"{owner}.{old}", new)
        return getattr(self, new)

    value.__doc__ = f"Deprecated name of `{new}`."
    return property(value)
