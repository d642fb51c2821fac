"""Values on the command line with their units: parameters in the unit of their label, frequencies in r/min or Hz.

--set backlash=90um    the label of backlash ends in [um]: 90
--peak 20um            an amplitude, in the unit of lengths of the model
--from 9000r/min       Omega = 9000 / pinion_speed(1);    2500Hz is a mesh frequency
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from typing import Any

import hbgear as hb
from hbgear.analysis.quantities.length_units import dimension_of
from hbgear.common.text.digits import short
from hbgear.common.text.messages import did_you_mean
from hbgear.common.text.symbols import shown_unit
from hbgear.common.units import decimal_mark, known_unit, to_si
from hbgear.harmonic.models.frequency_units import Omega_of, length_scale

SPEED = "speed"
"""Other name of Omega on the command line, for values in r/min or Hz."""

_NOT_PARAMETERS = ("Omega", "amplitude")
"""Labels of a model that belong to no parameter."""


def number_of(option: str, text: str) -> float:
    """Convert a text to a finite number; ``option`` names it in errors."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{option}={text}: need a finite number{decimal_mark(text)}")
    return value


def is_number(text: str) -> bool:
    """Return whether a text is a number without a unit."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def parameter_value(labels: Mapping[str, str], option: str, name: str, text: str) -> float:
    """Return the value of a parameter: a number in the unit of its label, or a quantity with another unit.

    ``labels`` by name end in their units, ``option`` is named in messages. ValueError is raised if the text is no
    number and no quantity of this unit.

    Examples
    --------
    >>> parameter_value({"backlash": "backlash [um]"}, "--set", "backlash", "0.09 mm")
    90.0
    >>> parameter_value({}, "--set", "damping", "4%")
    0.04
    """
    unit = shown_unit(str(labels.get(name, name)))
    if not unit and text.rstrip().endswith("%"):
        return to_si(option, name, text, "")
    if is_number(text) or not re.search(r"[^\W\d_]", text) or not known_unit(unit):
        return number_of(f"{option} {name}", text)
    if not unit:
        reason = f": {name} has no unit" if re.search(r"\d\s*[A-Za-z]", text) else ""
        raise ValueError(f"{option} {name}={text}: need a finite number{reason}")
    return to_si(option, name, text, unit)


def deviation_of(labels: Mapping[str, str], option: str, name: str, text: str) -> float:
    """Return the standard deviation of a parameter, see `parameter_value`; a percentage raises ValueError."""
    if text.rstrip().endswith("%"):
        unit = shown_unit(str(labels.get(name, name)))
        raise ValueError(
            f"{option} {name}={text}: a deviation is no percentage; give it in the unit of {name}"
            f"{f', {unit}' if unit else ', as a number'}"
        )
    return parameter_value(labels, option, name, text)


def value_in_model(model: hb.mechanics.Model, option: str, name: str, text: str) -> float:
    """Return the value of a parameter of a model, or of Omega, see `parameter_value` and `Omega_of`.

    KeyError is raised if the value has a unit and the model has no such parameter.
    """
    if name in ("Omega", SPEED):
        return Omega_of(model, f"{option} {name}", text)
    if name not in model.labels and not is_number(text):
        check_parameter(model, name)
    return parameter_value(model.labels, option, name, text)


def amplitude_in_model(
    model: hb.mechanics.Model, option: str, measure: str, text: str, changed: Collection[str] = ()
) -> float:
    """Return an amplitude in the unit of a model, from a quantity such as "20um" if the model has a unit of length.

    ``option`` is named in messages. The unit of length must not depend on the parameters that will be ``changed``.
    ValueError is raised if the text has no unit although the model has one, or the other way round, or if the unit will
    change.

    Examples
    --------
    >>> import hbgear as hb
    >>> round(amplitude_in_model(hb.gears.DoubleHelicalPair(b_c=4e-5), "--peak", "pp2", "20um"), 12)
    0.5
    """
    length, dimension = length_scale(model, {}), dimension_of(measure)
    if length is None or not dimension:
        return number_of(option, text)
    example = "20um" if dimension == 1 else f"20um^{dimension}"
    if is_number(text):
        raise ValueError(
            f"{option} {text}: need a quantity with its unit, such as {option} {example}; the unit of "
            f"lengths of the model is {short(1e6 * length, 6)} um"
        )
    values = model.parameters | model.entries
    for name in changed:
        if length_scale(model, {name: 1.01 * values[name]}) != length:
            raise ValueError(
                f"{option} {text}: the unit of lengths of the model changes with {name}, so that a limit "
                f"in it is not fixed; keep {name}"
            )
    unit = "m" if dimension == 1 else f"m^{dimension}"
    return to_si(option, measure, text, unit) / length**dimension


def named(name: str) -> str:
    """Return the name of a parameter: "Omega" for "speed"."""
    return "Omega" if name == SPEED else name


def check_parameter(model: hb.mechanics.Model, name: str) -> None:
    """Raise KeyError for a name that is no parameter of a model."""
    allowed = model.parameters | model.entries
    if name != "Omega" and name not in allowed:
        kind = type(model).__name__
        raise KeyError(f"{kind} has no parameter '{name}'{did_you_mean(name, allowed)}")


def changes_of(model: hb.mechanics.Model, pairs: list[tuple[str, str]]) -> dict[str, Any] | None:
    """Return changed parameters of a model whose parameters are no fields; None if a name is another field."""
    allowed = {*model.parameters, *model.entries, *(name for name in model.labels if name not in _NOT_PARAMETERS)}
    if any(name not in allowed for name, _ in pairs):
        return None
    return {name: parameter_value(model.labels, "--set", name, text) for name, text in pairs}
