"""Quantities with units at the boundary, as text such as "80 um" or from `pint`; inside there are numbers in SI.

    si("Gear", "module", "3 mm", "m") = 0.003

Texts in the units that drawings have are read by a table, since to import Pint takes longer than to trace a curve; Pint
reads all others, and quantities. A number without a unit is in the SI unit that the field names; what is far from every
machine is refused, since it is a number of another unit.
"""

from __future__ import annotations

import re
from functools import lru_cache
from math import pi
from typing import Any, overload

from hbgear.common.ranges import ANY, Range, checked
from hbgear.common.text.messages import quoted

EXAMPLES = {"m": "'3 mm'", "rad": "'20 deg'", "N m": "'200 N m'", "N/m": "'2e8 N/m'", "kg": "'0.7 kg'",
            "kg m^2": "'0.0005 kg m^2'", "N": "'50 N'", "Pa": "'206 GPa'", "kg/m^3": "'7850 kg/m^3'",
            "N m/rad": "'1e6 N m/rad'", "": "0.04"}  # fmt: skip
"""How a quantity of each SI unit may be written, for errors."""


_QUANTITY = r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*[^\W\d_]?[\w\s/*.%°-]*(\^-?\d[\w\s/*-]*)*"
"""A number and what may be a unit: letters, products, quotients and whole powers."""


_LAST_DIGIT = 2.5e-16  # relative, what the product with a unit's factor is off by


USUAL = {
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "rad": {"rad": 1.0, "deg": pi / 180},
    "N m": {"N m": 1.0, "Nm": 1.0, "N*m": 1.0},
    "N/m": {"N/m": 1.0},
    "kg": {"kg": 1.0},
    "kg m^2": {"kg m^2": 1.0},
    "rad/s": {"rad/s": 1.0, "r/min": pi / 30, "rpm": pi / 30},
}
"""Factors of the usual units of what is held in an SI unit, those of Pint."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("Nm = newton * meter")
    return registry


def to_si(owner: str, name: str, value: Any, unit: str) -> float:
    """The number of a quantity in an SI unit.

    Parameters
    ----------
    owner, name : whose and which quantity, for errors.
    value : a number in that unit, a text such as "3 mm", or a `pint` quantity.
    unit : the SI unit as pint reads it, such as "m", "rad", "N m"; "" for a number without one.

    Raises
    ------
    ValueError
        If the text is no quantity, the unit does not fit, or the number is not finite.

    Examples
    --------
    >>> si("Gear", "module", "3 mm", "m"), si("Gear", "module", 0.003, "m")
    (0.003, 0.003)
    """
    if isinstance(value, str) or hasattr(value, "magnitude"):
        value = _converted(owner, name, value, unit)
    checked(owner, name, value)
    return float(value)


def known_unit(unit: str) -> bool:
    """Whether a text is a unit that quantities can be converted to; "" is that of a number.

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
    if isinstance(value, str) and (usual := _usual(value.strip(), unit)) is not None:
        return _short(usual)
    need = f"a quantity in {unit} with its unit, such as {EXAMPLES.get(unit, unit)}" if unit else "a number"
    refusal = ValueError(f"{owner}: {name} = {quoted(value)} must be {need}")
    import pint

    if isinstance(value, str):
        text = value.strip()
        if unit and re.fullmatch(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?", text):
            raise ValueError(f"{owner}: {name} = {quoted(value)} has no unit; give one, such as {EXAMPLES.get(unit)}")
        if len(text) > 60 or not re.fullmatch(_QUANTITY, text):
            raise refusal  # a unit alone, or an expression, which takes as long as it likes
        try:
            value = _registry()(text.replace("r/min", "rpm")) if "**" not in text else None
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
    except (TypeError, ValueError):
        raise refusal from None
    return _short(exact)


def _usual(text: str, unit: str) -> float | None:
    """The number of a quantity in a usual unit; None if it is none."""
    match = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D.*)", text, re.ASCII)
    factor = USUAL.get(unit, {}).get(match[2]) if match and len(text) <= 60 else None
    return None if match is None or factor is None else float(match[1]) * factor


def _short(exact: float) -> float:
    """80e-6, not 7.999999999999999e-05."""
    short = float(f"{exact:.15g}")
    return short if abs(short - exact) <= _LAST_DIGIT * abs(exact) else exact


class QuantityField:
    """A field of a frozen dataclass that takes quantities and holds a number in SI.

        module: Measured = Measured("m", POSITIVE, Range(1e-5, 0.1))

    Parameters
    ----------
    unit : SI unit of the number, "" for none.
    allowed : values it may have.
    plausible : values any machine has: others are refused as numbers of another unit.
    default : its default, a number; none if it is left out.
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
        if instance is None:  # where a dataclass looks for the default
            if self.default is None:
                raise AttributeError(self.name)
            return self.default
        number: float = vars(instance)[self.name]
        return number

    def __set__(self, instance: object, value: Any) -> None:
        vars(instance)[self.name] = self.read(type(instance).__name__, value)

    def read(self, owner: str, value: Any) -> float:
        """The number a value stands for.

        Raises
        ------
        ValueError
            If it is no such quantity, or out of range.
        """
        number = to_si(owner, self.name, value, self.unit)
        checked(owner, self.name, number, self.allowed)
        if number not in self.plausible:
            unit = f" {self.unit}" if self.unit else ""
            example = EXAMPLES.get(self.unit, self.unit)
            way = f"numbers are in {self.unit}, other units are given as text such as {example}"
            raise ValueError(
                f"{owner}: {self.name} = {number:g}{unit} is beyond any machine (it must {self.plausible}); "
                f"{way if unit else 'percent are given as text such as 4 %'}"
            )
        return number


class OptionalQuantityField(QuantityField):
    """As `QuantityField`, with None for what is to be computed, the default."""

    def __get__(self, instance: object | None, owner: type) -> float | None:  # type: ignore[override]
        return None if instance is None else vars(instance)[self.name]

    def __set__(self, instance: object, value: Any) -> None:
        if value is None:
            vars(instance)[self.name] = None
        else:
            super().__set__(instance, value)
