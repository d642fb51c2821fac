"""Quantities with units: texts such as "80 um" or objects of `pint` are converted to numbers in SI units.

    to_si("Gear", "module", "3 mm", "m") = 0.003

Texts in the units of drawings are read by a table, because the import of Pint takes longer than to trace a curve. Pint
reads all other texts and quantities. A number without a unit is in the SI unit of the field. A number far outside the
range of real machines is refused, because it was probably given in another unit.
"""

from __future__ import annotations

import re
from functools import lru_cache
from math import pi
from typing import Any, overload

from hbgear.common.ranges import ANY, NOT_NEGATIVE, POSITIVE, Range, checked
from hbgear.common.text.messages import quoted
from hbgear.common.text.unit_spellings import plain_unit

EXAMPLES = {
    "m": "'3 mm'",
    "rad": "'20 deg'",
    "N m": "'200 N m'",
    "N/m": "'2e8 N/m'",
    "kg": "'0.7 kg'",
    "kg m^2": "'0.0005 kg m^2'",
    "N": "'50 N'",
    "rad/s": "'1500 r/min'",
    "Pa": "'206 GPa'",
    "kg/m^3": "'7850 kg/m^3'",
    "N m/rad": "'1e6 N m/rad'",
    "": "0.04",
}
"""Example of a quantity of each SI unit, for messages."""


def _example(unit: str) -> str:
    """Return an example of a quantity in a unit, for messages."""
    return EXAMPLES.get(unit, f"'10 {unit}'")


_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
"""A decimal number."""

_QUANTITY = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*[^\W\d_]?[\w\s/*.%°-]*(\^-?\d[\w\s/*-]*)*"
"""A number and a possible unit: letters, products, quotients and whole powers."""


_HAS_ANGLE = r"rad|deg|°|\br/|rpm|rps|rev|turn|cycle"
"""Units of which a unit of rotational speed has one; 1/s and Hz may be revolutions or radians."""

_REVOLUTIONS = re.compile(r"(?<![^\W\d_])r/(?=(min|s)\b)")
"""Revolutions in r/min and r/s, which Pint calls turns."""

_PRODUCT_ROUNDING = 2.5e-16
"""Relative rounding error of the product of a number and the factor of a unit."""


USUAL = {
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "rad": {"rad": 1.0, "deg": pi / 180},
    "N m": {"N m": 1.0, "Nm": 1.0, "N*m": 1.0},
    "N/m": {"N/m": 1.0},
    "kg": {"kg": 1.0},
    "kg m^2": {"kg m^2": 1.0},
    "rad/s": {"rad/s": 1.0, "r/min": pi / 30},
}
"""Factors of the usual units of each SI unit, equal to those of Pint."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    """Return the registry of units of Pint."""
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("Nm = newton * meter")
    return registry


def to_si(owner: str, name: str, value: Any, unit: str) -> float:
    """Return the number of a quantity in an SI unit in the notation of Pint, such as "m", "rad", "N m"; "" without one.

    The value is a number in this unit, or a quantity with its unit such as "3 mm"; ``owner`` and ``name`` are its class
    and name for messages. ValueError is raised if the text is no quantity, the unit does not fit, or the number is not
    finite.

    Examples
    --------
    >>> to_si("Gear", "module", "3 mm", "m"), to_si("Gear", "module", 0.003, "m")
    (0.003, 0.003)
    """
    if isinstance(value, str) or hasattr(value, "magnitude"):
        value = _converted(owner, name, value, unit)
    checked(owner, name, value)
    return float(value)


def decimal_mark(value: Any) -> str:
    """Return the remedy of a message about a number: that the decimal mark is a point if the text has a comma.

    Examples
    --------
    >>> decimal_mark("0,5 mm"), decimal_mark("half")
    ('; the decimal mark is a point', '')
    """
    comma = isinstance(value, str) and re.match(r"\s*[-+]?\d*,\d", value)
    return "; the decimal mark is a point" if comma else ""


def known_unit(unit: str) -> bool:
    """Return whether a text is a unit to which quantities can be converted; the empty text is dimensionless.

    Examples
    --------
    >>> known_unit("N/um"), known_unit("é")
    (True, False)
    """
    if unit in USUAL or not unit:
        return True
    import pint

    if len(unit) > 60 or "**" in unit or not re.fullmatch(_QUANTITY, f"1 {unit}"):
        return False
    try:
        _registry().Unit(unit)
    except (pint.PintError, ValueError, TypeError, AttributeError, ArithmeticError, SyntaxError, AssertionError):
        return False
    return True


def _converted(owner: str, name: str, value: Any, unit: str) -> float:
    """Return the number of a text or a quantity in a unit."""
    text = _in_plain_units(value.strip(), unit) if isinstance(value, str) else str(getattr(value, "units", value))
    if isinstance(value, str):
        for given in (value.strip(), text):
            if (usual := _usual(given, unit)) is not None:
                return _short(usual)
    need = f"a quantity in {unit} with its unit, such as {_example(unit)}" if unit else "a number"
    refusal = ValueError(f"{owner}: {name} = {quoted(value)} must be {need}{decimal_mark(value)}")
    import pint

    if unit == "rad/s" and not re.search(_HAS_ANGLE, text.lower()):
        raise refusal  # Pint reads 50 Hz as radians per time
    if isinstance(value, str):
        if unit and re.fullmatch(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?", text):
            raise ValueError(f"{owner}: {name} = {quoted(value)} has no unit; give one, such as {_example(unit)}")
        if len(text) > 60 or not re.fullmatch(_QUANTITY, text):
            raise refusal  # a unit alone, or an expression, whose evaluation may take very long
        try:
            value = _registry()(_REVOLUTIONS.sub("turn/", text)) if "**" not in text else None
        except (pint.PintError, ValueError, TypeError, AttributeError, ArithmeticError, SyntaxError, AssertionError):
            raise refusal from None
    try:
        number = value.m_as(unit or "dimensionless") if hasattr(value, "m_as") else value
    except pint.DimensionalityError:
        raise refusal from None
    if hasattr(value, "m_as") and not unit and not value.dimensionless:
        raise refusal
    try:
        exact = float(number)
    except (TypeError, ValueError, OverflowError):
        raise refusal from None
    return _short(exact)


def _usual(text: str, unit: str) -> float | None:
    """Return the number of a quantity in a usual unit; None for other units."""
    match = re.fullmatch(rf"({_NUMBER})\s*(\D.*)", text, re.ASCII)
    factor = USUAL.get(unit, {}).get(match[2]) if match and len(text) <= 60 else None
    return None if match is None or factor is None else float(match[1]) * factor


def _in_plain_units(text: str, target: str) -> str:
    """Return a quantity with its unit in the spelling of Pint: "3000 r/min" for "3000 U/min" or "3000 1/min"."""
    if target == "rad/s":  # of other quantities they are Hz
        text = re.sub(r"\bcycles?\s*/\s*s\b", "r/s", text)
    match = re.fullmatch(rf"((?>{_NUMBER}))(?:\s*([^\W\d].*|[/°].*)|\s+(1\s*/.*))", text)
    return f"{match[1]} {plain_unit(match[2] or match[3])}" if match and len(text) <= 60 else text


def _short(exact: float) -> float:
    """Return a number without the rounding error of a conversion: 80e-6, not 7.999999999999999e-05."""
    short = float(f"{exact:.15g}")
    return short if abs(short - exact) <= _PRODUCT_ROUNDING * abs(exact) else exact


class QuantityField:
    """Field of a frozen dataclass that accepts quantities and contains a number in an SI unit.

        module: QuantityField = QuantityField("m", POSITIVE, Range(1e-5, 0.1))

    Parameters
    ----------
    unit : str
        SI unit of the number; empty for a dimensionless number.
    allowed : Range, optional
        Values that are allowed. Default: all.
    plausible : Range, optional
        Values of real machines; others are refused, because they were probably given in another unit. Default: all.
    default : float, optional
        Default of the field. Without it the field is required.
    """

    def __init__(self, unit: str, allowed: Range = ANY, plausible: Range = ANY, default: float | None = None) -> None:
        self.unit, self.allowed, self.plausible, self.default = unit, allowed, plausible, default

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> float: ...

    @overload
    def __get__(self, instance: object, owner: type) -> float: ...

    def __get__(self, instance: object | None, owner: type) -> float:
        if instance is None:  # dataclasses read the default of a field here
            if self.default is None:
                raise AttributeError(self.name)
            return self.default
        return vars(instance)[self.name]

    def __set__(self, instance: object, value: Any) -> None:
        vars(instance)[self.name] = self.read(type(instance).__name__, value)

    def read(self, owner: str, value: Any) -> float:
        """Return the number of a value in the SI unit; ``owner`` is the class of the field, for messages.

        ValueError is raised if it is no quantity of the unit, or out of range.
        """
        number = to_si(owner, self.name, value, self.unit)
        unit = f" {self.unit}" if self.unit else ""
        if number not in self.allowed:
            shown = quoted(value) if isinstance(value, str) else f"{number:.6g}{unit}"
            limit_unit = "" if self.allowed in (POSITIVE, NOT_NEGATIVE) else unit  # the others state numbers
            raise ValueError(f"{owner}: {self.name} = {shown} must {self.allowed}{limit_unit}")
        if number not in self.plausible:
            example = _example(self.unit)
            way = f"numbers are in {self.unit}, other units are given as text such as {example}"
            raise ValueError(
                f"{owner}: {self.name} = {number:g}{unit} is beyond any machine (it must {self.plausible}); "
                f"{way if unit else 'percent are given as text such as 4 %'}"
            )
        return number


class OptionalQuantityField(QuantityField):
    """A `QuantityField` that may be None, its default: the value is then computed."""

    def __get__(self, instance: object | None, owner: type) -> float | None:  # type: ignore[override]
        return None if instance is None else vars(instance)[self.name]

    def __set__(self, instance: object, value: Any) -> None:
        if value is None:
            vars(instance)[self.name] = None
        else:
            super().__set__(instance, value)
