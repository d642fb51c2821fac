"""Arguments of another kind than needed: what was given, what is needed, what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real
from typing import Any

import numpy as np

_NEEDED = {
    "Branch": "a Branch, as trace and load give it",
    "Model": "a model, such as SpurPair() or a System",
    "HarmonicBalance": "a HarmonicBalance, such as HarmonicBalance(SpurPair(), 16)",
    "problem": "a HarmonicBalance, such as HarmonicBalance(SpurPair(), 16), or another problem with evaluate",
    "System": "a System or another model",
}


# (what was given, what is needed): how to get there
_WAYS = {
    ("Model", "problem"): "give HarmonicBalance(model)",
    ("Model", "HarmonicBalance"): "give HarmonicBalance(model)",
    ("Model", "Branch"): "trace it first: trace(HarmonicBalance(model), 'Omega', span)",
    ("HarmonicBalance", "Branch"): "trace it first: trace(problem, 'Omega', span)",
    ("HarmonicBalance", "Model"): "give its model: problem.model",
    ("Branch", "Model"): "give the model it was traced with: branch.problem.model",
    ("Branch", "problem"): "give the problem it was traced with: branch.problem",
    ("Branch", "HarmonicBalance"): "give the problem it was traced with: branch.problem",
    ("str", "Branch"): "load a file first: load(path)",
    ("Path", "Branch"): "load a file first: load(path)",
    ("Point", "Branch"): "give the whole curve",
}


def article(word: str) -> str:
    """The word or abbreviation with a or an, as it is spoken: an LP, a PD, an element."""
    spelt = word[:2].isupper()
    return f"{'an' if word[:1] in ('AEFHILMNORSX' if spelt else 'AEIOaeio') else 'a'} {word}"


def given(value: Any) -> str:
    """A value in a few words."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, str | int | float) or value is None:
        return repr(value)
    return article(type(value).__name__)


def need(call: str, value: Any, kind: str) -> None:
    """Refuse an argument that is no object of the kind, a class by its name, or no problem with ``evaluate``.

    Raises
    ------
    TypeError
        With what was given, what is needed and how to get there.
    """
    kinds = [cls.__name__ for cls in type(value).__mro__]
    solvable = hasattr(value, "evaluate") and not isinstance(value, type) if kind == "problem" else kind in kinds
    if solvable:
        return
    if isinstance(value, type):
        way = f"call it: {value.__name__}()"
    else:
        way = next((_WAYS[name, kind] for name in kinds if (name, kind) in _WAYS), "")
    raise TypeError(f"{call} needs {_NEEDED[kind]}; got {given(value)}{way and f': {way}'}")


def number(name: str, value: Any) -> float:
    """A finite number; texts are none.

    Raises
    ------
    ValueError
        If it is not.
    """
    if not (_is_number(value) and math.isfinite(value)):
        raise ValueError(f"{name} = {value!r} must be a finite number")
    return float(value)


def two_numbers(name: str, value: Any) -> tuple[float, float]:
    """Two numbers, the ends of a span; texts are none.

    Raises
    ------
    ValueError
        If they are not.
    """
    if not (isinstance(value, Sequence | np.ndarray) and len(value) == 2 and all(map(_is_number, value))):
        raise ValueError(f"{name} = {value!r} must be two numbers (from, to)")
    return float(value[0]), float(value[1])


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) or (isinstance(value, np.ndarray) and not value.shape and value.dtype.kind in "fiu")
