"""Schema of a saved branch: every value of a file is read by the reader of its field, or refused.

Values are stored as JSON in the tree of the header; arrays by their name in the archive, tuples and objects marked:

    {"__array__": name}    {"__tuple__": [...]}    {"__class__": "Point", "X": ..., "parameters": ..., ...}
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from hbgear.analysis.certificates.certificate import Certificate
from hbgear.common.arrays import Array
from hbgear.continuation.events.event import MARKERS, is_marker
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.branch_data import FullMotion
from hbgear.continuation.results.point import BIFURCATING, LANDINGS, Jump, Point, SpecialPoint
from hbgear.harmonic.autonomous.tori.layout import TorusLayout
from hbgear.harmonic.bifurcations.events import named
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.io.branches.archive import Archive

Form = Callable[[Archive, Any, str], Any]
"""Reader of a value of the tree: ``form(archive, value, path)``; raises ValueError with the path if it is invalid."""


def read(archive: Archive, tree: Any) -> Branch:
    """Return the branch in the tree of a header; ValueError reports the first invalid value in it."""
    branch: Branch = _object(Branch)(archive, tree, "branch")
    _check(branch)
    return branch


def listed(value: Any, count: int) -> list[Any]:
    """Return a list with ``count`` entries; ValueError if the value is not such a list."""
    if not isinstance(value, list) or len(value) != count:
        raise _wrong("motions", value, f"a list of {count}")
    return value


def read_motions(archive: Archive, value: Any, branch: Branch) -> FullMotion | None:
    """Return all coordinates at the points of a branch from its file; ValueError if they do not belong to it."""
    if value is None:
        return None
    if not isinstance(value, dict) or set(value) != {"names", "rows"} or not isinstance(value["names"], list):
        raise _wrong("motions", value, "names and rows")
    names = tuple(_TEXT(archive, name, "motions.names") for name in value["names"])
    rows = _array("f", 3, finite=True)(archive, value["rows"], "motions.rows")
    layout = layout_of(branch)
    if layout is None or rows.shape != (len(branch), len(names), 2 * layout.harmonics + 1):
        raise ValueError(f"motions of {len(names)} coordinates have rows {rows.shape}, which do not fit the branch")
    return FullMotion(names, rows)


# ---- single values


def _wrong(path: str, value: Any, need: str) -> ValueError:
    text = repr(value)
    return ValueError(f"{path} is {text if len(text) <= 40 else f'{text[:36]} ...'}; need {need}")


def _value(fits: Callable[[Any], bool], need: str) -> Form:
    """Return a reader of single values that fulfil a condition."""

    def form(archive: Archive, value: Any, path: str) -> Any:
        if not fits(value):
            raise _wrong(path, value, need)
        return value

    return form


MAX_INTEGER = 2**63
"""Largest whole number that is accepted: no computation stores larger ones."""


def _is_text(value: Any) -> bool:
    """Return whether a value is text that can be printed, without lone surrogates."""
    return isinstance(value, str) and not any("\ud800" <= letter <= "\udfff" for letter in value)


def _is_number(value: Any) -> bool:
    return isinstance(value, float) or (type(value) is int and abs(value) <= MAX_INTEGER)


def _is_finite(value: Any) -> bool:
    return _is_number(value) and math.isfinite(value)


_TEXT = _value(_is_text, "a text")
_MARKER = _value(lambda value: _is_text(value) and (not value or is_marker(value)), f"one of {' '.join(MARKERS)}")
_LANDING = _value(lambda value: value in (*LANDINGS, BIFURCATING), f"one of {', '.join((*LANDINGS, BIFURCATING))}")
_FLAG = _value(lambda value: isinstance(value, bool), "true or false")
_NUMBER = _value(_is_number, "a number")
_FINITE = _value(_is_finite, "a finite number")


def _int(low: int, high: int = MAX_INTEGER) -> Form:
    return _value(lambda value: type(value) is int and low <= value <= high, f"a whole number from {low} to {high}")


def _array(kinds: str, dimensions: int, finite: bool = False) -> Form:
    """Return a reader of arrays of NumPy's kinds "f", "c", "iu", ..."""

    def form(archive: Archive, value: Any, path: str) -> Array:
        if not isinstance(value, dict) or list(value) != ["__array__"] or not isinstance(value["__array__"], str):
            raise _wrong(path, value, "an array")
        array = archive.array(value["__array__"])
        if array.dtype.kind not in kinds or array.ndim != dimensions:
            need = f"{dimensions} dimension{'s' if dimensions > 1 else ''} of {_NAMES[kinds]}"
            raise ValueError(f"{path} is an array {array.shape} of {array.dtype}; need {need}")
        if finite and not np.isfinite(array).all():
            raise ValueError(f"{path} has entries that are not finite")
        return array

    return form


_NAMES = {"f": "real numbers", "c": "complex numbers", "iu": "whole numbers"}


# ---- several values


def _optional(form: Form) -> Form:
    return lambda archive, value, path: None if value is None else form(archive, value, path)


def _tuple(form: Form, count: int | None = None) -> Form:
    def several(archive: Archive, value: Any, path: str) -> tuple[Any, ...]:
        items = value.get("__tuple__") if isinstance(value, dict) and len(value) == 1 else None
        if not isinstance(items, list) or count not in (None, len(items)):
            raise _wrong(path, value, f"a tuple{'' if count is None else f' of {count}'}")
        return tuple(form(archive, x, f"{path}.{i}") for i, x in enumerate(items))

    return several


def _table(form: Form) -> Form:
    def table(archive: Archive, value: Any, path: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise _wrong(path, value, "values by name")
        return {_TEXT(archive, name, path): form(archive, x, f"{path}.{name}") for name, x in value.items()}

    return table


def _object(*classes: type) -> Form:
    """Return a reader of objects of one of these classes; every field is read by its form in `_FORMS`."""

    def form(archive: Archive, value: Any, path: str) -> Any:
        names = {cls.__name__: cls for cls in classes}
        kind = value.get("__class__") if isinstance(value, dict) else None
        if not isinstance(kind, str) or kind not in names:
            raise _wrong(path, value, f"a {' or '.join(names)}")
        fields, forms = {name: x for name, x in value.items() if name != "__class__"}, _FORMS[names[kind]]
        for field in dataclasses.fields(names[kind]):
            optional = field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
            if field.name not in fields and not optional:
                raise ValueError(f"{path} has no {field.name}")
        for name in fields:
            if name not in forms:
                raise ValueError(f"{path} has a field '{name}' that a {kind} does not have")
        obj = names[kind](**{name: forms[name](archive, x, f"{path}.{name}") for name, x in fields.items()})
        if isinstance(obj, SpecialPoint) and "truncation" not in fields:  # files before schema 4 have no location error
            obj = dataclasses.replace(obj, error=math.nan, truncation=obj.error)
        return named(obj) if isinstance(obj, SpecialPoint) and "meaning" not in fields else obj

    return form


def _plain(archive: Archive, value: Any, path: str) -> Any:
    """Return any value that `Branch.meta` may hold."""
    if isinstance(value, list):
        return [_plain(archive, x, f"{path}.{i}") for i, x in enumerate(value)]
    if not isinstance(value, dict):
        return _TEXT(archive, value, path) if isinstance(value, str) else value
    if "__array__" in value:
        if not isinstance(value["__array__"], str):
            raise _wrong(path, value, "an array")
        return archive.array(value["__array__"])
    if "__tuple__" in value:
        return _tuple(_plain)(archive, value, path)
    return _object(*_FORMS)(archive, value, path) if "__class__" in value else _table(_plain)(archive, value, path)


def _certificate(archive: Archive, value: Any, path: str) -> dict[str, Any]:
    """Return the certificate of a special point; its proof is not repeated."""
    try:
        return Certificate.from_dict(_table(_plain)(archive, value, path)).to_dict()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


_FLOATS = _tuple(_FINITE)


_POINT: dict[str, Form] = {
    "X": _array("f", 1, finite=True),
    "parameters": _table(_FINITE),
    "residual": _NUMBER,
    "iterations": _int(0),
    "multipliers": _optional(_array("c", 1)),
    "regime": _array("iu", 1),
    "error": _NUMBER,
    "layout": _optional(lambda *given: _object(Layout, TorusLayout)(*given)),
    "label": _TEXT,
    "modulus_error": _NUMBER,
}


_FORMS: dict[type, dict[str, Form]] = {
    Layout: {
        "harmonics": _int(0),
        "nu": _int(1, 10_000),
        "elements": _tuple(_TEXT),
        "breakpoints": _tuple(_FLOATS),
        "labels": _table(_TEXT),
        "orders": _optional(_tuple(_int(1))),
        "edged": _tuple(_int(0)),
    },
    TorusLayout: {
        "harmonics": _tuple(_int(1, 200), 2),
        "elements": _tuple(_TEXT),
        "nu": _int(1, 10_000),
        "labels": _table(_TEXT),
        "odd": _FLAG,
        "dense": _int(1, 100),
        "band": _optional(_FINITE),
        "ratio": _FINITE,
        "half": _optional(_tuple(_int(0, 1), 2)),
    },
    Point: _POINT,
    SpecialPoint: {
        **_POINT,
        "kind": _TEXT,
        "index": _int(-1),
        "located": _FLAG,
        "interval": _tuple(_NUMBER, 2),
        "note": _TEXT,
        "meaning": _TEXT,
        "marker": _MARKER,
        "truncation": _NUMBER,
        "certificate": _optional(_certificate),
        "at_all_phases": _FLAG,
    },
    Jump: {
        "label": _TEXT,
        "parameter": _TEXT,
        "value": _FINITE,
        "direction": _int(-1, 1),
        "before": _object(Point, SpecialPoint),
        "after": _optional(_object(Point, SpecialPoint)),
        "landing": _LANDING,
        "note": _TEXT,
        "candidates": _tuple(_object(Point, SpecialPoint)),
    },
    Branch: {
        "parameter": _TEXT,
        "values": _array("f", 1, finite=True),
        "X": _array("f", 2, finite=True),
        "fixed": _table(_FINITE),
        "tracked": _table(_array("f", 1, finite=True)),
        "multipliers": _optional(_array("c", 2)),
        "iterations": _array("iu", 1),
        "residual": _array("f", 1),
        "regime": _array("iu", 2),
        "error": _array("f", 1),
        "step": _array("f", 1),
        "special": _tuple(_object(SpecialPoint)),
        "jump_records": _tuple(_object(Jump)),
        "status": _TEXT,
        "message": _TEXT,
        "layout": _optional(_object(Layout, TorusLayout)),
        "meta": _table(_plain),
        "others": _tuple(lambda *given: _object(Branch)(*given)),
        "modulus_error": _array("f", 1),
    },
}


# ---- consistency


def _check(branch: Branch) -> None:
    """Check that the parts of a branch belong together; ValueError if not."""
    if not len(branch):
        raise ValueError("it has no points")
    if np.isinf(branch.residual).any():
        raise ValueError("its residual has entries that are infinite")
    for other in branch.others:
        _check(other)
    _check_motion(layout_of(branch), branch.X, branch.regime, "branch")
    _check_torus(branch)
    _check_trace(branch)
    _check_balance(branch)
    _check_asymptotes(branch)
    for point in branch.special:
        location = f"special point '{point.label}'"
        if not 0 <= point.index < len(branch):
            raise ValueError(f"{location} is at point {point.index} of {len(branch)}")
        for name in (branch.parameter, *branch.tracked):
            if name not in point.parameters:
                raise ValueError(f"{location} has no {name}")
        if point.layout and branch.layout and point.layout.elements != branch.layout.elements:
            raise ValueError(f"{location} has other elements than the branch")
        _check_motion(layout_of(point), point.X, point.regime, location)
    for jump in branch.jump_records:
        if not jump.direction:
            raise ValueError(f"the jump at {jump.label} has no direction")
        for end in (jump.before, jump.after, *jump.candidates):
            if end is not None:
                _check_motion(layout_of(end), end.X, end.regime, f"the jump at {jump.label}")


def _check_torus(branch: Branch) -> None:
    """Check that the unknowns of tori match their basis, and that their second frequency is known."""
    for layout, X in ((branch.layout, branch.X), *((point.layout, point.X) for point in branch.special)):
        if isinstance(layout, TorusLayout):
            if "Omega_2" not in branch.tracked:
                raise ValueError("its tori have no Omega_2")
            if X.shape[-1] != layout.width:
                raise ValueError(f"{X.shape[-1]} unknowns do not fit H = {layout.harmonics} of a torus")


def _check_trace(branch: Branch) -> None:
    """Check the settings of the trace: a table with its span, two numbers, and its accuracy; each is optional."""
    settings = branch.meta.get("trace", {})
    if not isinstance(settings, dict):
        raise _wrong("trace of its header", settings, "a table")
    span, accuracy = settings.get("span"), settings.get("accuracy")
    if span is not None and not (isinstance(span, list | tuple) and len(span) == 2 and all(map(_is_finite, span))):
        raise _wrong("trace.span of its header", span, "two finite numbers")
    if accuracy is not None and not _is_finite(accuracy):
        raise _wrong("trace.accuracy of its header", accuracy, "a finite number")


def _check_balance(branch: Branch) -> None:
    """Check that the settings from which a problem is rebuilt match the points."""
    balance, layout = branch.meta.get("balance"), layout_of(branch)
    if not isinstance(balance, dict) or layout is None:
        return
    for name, value in (("harmonics", layout.harmonics), ("nu", layout.nu)):
        if balance.get(name, value) != value:
            raise ValueError(f"its header states {name} = {str(balance[name])[:40]}, its points have {value}")


def _check_asymptotes(branch: Branch) -> None:
    """Check the asymptotes: values of the parameter at the first and the last point."""
    asymptotes = branch.meta.get("asymptotes", {})
    if not isinstance(asymptotes, dict) or not set(asymptotes) <= {"first", "last"}:
        raise ValueError("its header has asymptotes other than those of the first and the last point")
    if not all(_is_finite(value) for value in asymptotes.values()):
        raise ValueError("its header has asymptotes that are not finite numbers")


def _check_motion(layout: Layout | None, X: Array, regime: Array, location: str) -> None:
    """Check that unknowns (..., m (2H + 1)) and regimes (..., m), or none, match a layout."""
    largest = float(np.abs(X.astype(float)).max(initial=0.0))
    if largest > 1e100:
        raise ValueError(f"{location} has unknowns of {largest:.0e}")
    if layout is None:
        return
    m = len(layout.elements)
    if not m or len(layout.breakpoints) != m:
        raise ValueError(f"{location} has {m} elements and the breakpoints of {len(layout.breakpoints)}")
    orders = layout.orders
    if orders is not None and (list(orders) != sorted(set(orders)) or max(orders, default=1) > layout.harmonics):
        raise ValueError(
            f"{location} has orders {str(orders)[:40]}; they ascend from 1 to at most H = {layout.harmonics}"
        )
    if X.shape[-1] != layout.width or regime.shape[-1] not in (0, m):
        sizes = f"{X.shape[-1]} unknowns and {regime.shape[-1]} regimes"
        raise ValueError(f"{location} has {sizes}, which do not fit H = {layout.harmonics} and {m} elements")
