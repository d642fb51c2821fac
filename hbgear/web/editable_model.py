"""Models with editable parameters for the explorer: parameters with units, and export as Python or TOML.

parameter "zeta"      field of the model, or of the machine ("pair.backlash", "pinion.tip_relief")
parameter "eps[0]"    first entry of the tuple eps, as in Python
"""

from __future__ import annotations

import json
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import hbgear as hb
from hbgear.common.ranges import ANY, Range
from hbgear.common.text.symbols import in_html, unit_of
from hbgear.gears.pairs.drawn_pair import DrawnPair
from hbgear.io.branches.columns import bracketed
from hbgear.io.machines.machine_file import Machine, machine_text
from hbgear.mechanics.fields import defaults_of, kinds_of
from hbgear.mechanics.models import Model


@dataclass(frozen=True)
class Parameter:
    """An editable number of a model.

    Attributes
    ----------
    name : str
        Name of the parameter.
    label : str
        Label in HTML.
    unit : str
        Unit of the value.
    value : float
        Value.
    low : float
        Lower end of the slider.
    high : float
        Upper end of the slider.
    limits : tuple of float or None
        Smallest and largest value that the model accepts, None without a limit. The page sets the ends of a slider by
        these if a value outside of the slider is typed.
    """

    name: str
    label: str
    unit: str
    value: float
    low: float
    high: float
    limits: tuple[float | None, float | None] = (None, None)


class EditableModel(ABC):
    """A source of models with editable parameters."""

    @abstractmethod
    def parameters(self) -> list[Parameter]:
        """Return the editable parameters with their initial values."""

    @abstractmethod
    def model(self, values: Mapping[str, float]) -> Model:
        """Return the model with values by parameter; others keep their initial values.

        ValueError or KeyError is raised if a parameter is unknown or a value is out of range.
        """

    @abstractmethod
    def python(self, values: Mapping[str, float]) -> str:
        """Return lines of Python that create the model with values by parameter under the name ``model``."""

    @abstractmethod
    def toml(self, values: Mapping[str, float], span: tuple[float, float], harmonics: int) -> str:
        """Return the .toml text of a machine, or of a study of this design, which hbgear reads."""


class EditableInstance(EditableModel):
    """An instance of a model class, with its name on the command line."""

    def __init__(self, model: Model, name: str) -> None:
        self.start, self.name = model, name

    def parameters(self) -> list[Parameter]:
        parameters: list[Parameter] = []
        for name, kind in kinds_of(type(self.start)).items():
            value, label = getattr(self.start, name), str(self.start.labels.get(name, name))
            allowed = self.start.ranges.get(name, ANY)
            if kind is float and name in self.start.parameters:
                parameters.append(_parameter(name, label, float(value), allowed))
            elif isinstance(value, tuple):
                entries = [(i, f"{name}[{i}]") for i in range(len(value)) if f"{name}[{i}]" in self.start.entries]
                parameters += [_parameter(key, f"entry {i} of {label}", float(value[i]), ANY) for i, key in entries]
        return parameters

    def model(self, values: Mapping[str, float]) -> Model:
        initial = {parameter.name: parameter.value for parameter in self.parameters()}
        changes = {name: value for name, value in values.items() if value != initial.get(name)}
        return self.start.replace(**changes)

    def changed(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return the fields that differ from the defaults."""
        model = self.model(values)
        defaults = defaults_of(type(model))
        return {
            name: getattr(model, name)
            for name in kinds_of(type(model))
            if name not in defaults or getattr(model, name) != defaults[name]
        }

    def python(self, values: Mapping[str, float]) -> str:
        cls = type(self.start)
        is_user_class = cls.__module__.partition(".")[0] != "hbgear"
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.changed(values).items())
        module = cls.__module__
        importable = Path(module).stem if module.endswith(".py") else module
        source = f"from {importable} import {cls.__name__}\n" if is_user_class else ""
        return f"{source}model = {'' if is_user_class else _public_prefix(cls.__name__)}{cls.__name__}({arguments})"

    def toml(self, values: Mapping[str, float], span: tuple[float, float], harmonics: int) -> str:
        base = {name: value for name, value in self.changed(values).items() if _is_plain(value)}
        name, value = _first_of(self.model(values))
        base.pop(name, None)
        return _study_text(self.name, base, {name: value}, span, harmonics)


class EditableFile(EditableModel):
    """The model of a file (.toml), or of a saved curve (.npz); ``start`` has other initial values than the file."""

    def __init__(self, model: Model, source: str, start: Model | None = None) -> None:
        self.of_file, self.source, self.start = model, source, start or model

    def parameters(self) -> list[Parameter]:
        return _labelled_parameters(self.start)

    def changed(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values that differ from those of the file."""
        of_file = self.of_file.parameters
        return {
            name: value for name, value in {**self.start.parameters, **values}.items() if value != of_file.get(name)
        }

    def model(self, values: Mapping[str, float]) -> Model:
        return self.of_file.replace(**self.changed(values))

    def python(self, values: Mapping[str, float]) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.changed(values).items())
        is_curve = self.source.endswith(".npz")
        read = f"hb.load({self.source!r}).problem.model" if is_curve else f"hb.io.read_model({self.source!r})"
        return f"model = {read}" + (f".replace({arguments})" if arguments else "")

    def toml(self, values: Mapping[str, float], span: tuple[float, float], harmonics: int) -> str:
        if self.source.endswith(".npz"):
            raise ValueError(
                f"a study needs the file of the model, not its curve {self.source}: open the explorer "
                "with the .toml file"
            )
        return _study_text(self.source, {}, self.changed(values) or dict([_first_of(self.start)]), span, harmonics)


class EditableMachine(EditableModel):
    """The machine of a file; the editable parameters are data of its drawing."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine

    def parameters(self) -> list[Parameter]:
        return _labelled_parameters(self.machine.model())

    def changed(self, values: Mapping[str, float]) -> Machine:
        """Return the machine with these values."""
        model = self.machine.model()
        for name in values:
            if name not in model.parameters:
                raise KeyError(f"the machine has no parameter '{name}'")
        new = model.replace(**values)
        supports: Any = new.supports or None
        return replace(
            self.machine,
            pair=new.pair,
            torque=new.torque,
            damping=new.damping,
            friction=new.friction,
            supports=supports,
        )

    def model(self, values: Mapping[str, float]) -> DrawnPair:
        return self.machine.model().replace(**values)

    def python(self, values: Mapping[str, float]) -> str:
        machine = self.changed(values)
        pair = machine.pair
        wheels = [_call("hb.gears.Gear", gear) for gear in (pair.pinion, pair.wheel)]
        lines = [f"pinion = {wheels[0]}", f"wheel = {wheels[1]}"]
        lines.append(f"pair = {_call('hb.GearPair', pair, pinion='pinion', wheel='wheel')}")
        options = f", form={machine.form!r}" if machine.form != "torsion" else ""
        options += f", mesh={machine.mesh_model!r}" if machine.mesh_model else ""
        options += f", torque_orders={machine.torque_orders!r}" if machine.torque_orders else ""
        if machine.friction:
            friction = machine.friction
            options += (
                f", friction={friction if isinstance(friction, float) else _call('hb.gears.BenedictKelley', friction)}"
            )
        if machine.supports:
            supports = ", ".join(_call("hb.gears.Support", support) for support in machine.supports)
            options += f", supports=({supports})"
        if machine.cycle is not None:
            options += ", cycle=hb.gears.MeshCycle(...)  # of the tables that the file names"
        units = self.model(values).units
        if units != machine.model().units:
            options += f", units={units!r}"
        lines.append(f"model = hb.gears.DrawnPair(pair, {machine.torque!r}, {machine.damping!r}{options})")
        return "\n".join(lines)

    def toml(self, values: Mapping[str, float], span: tuple[float, float], harmonics: int) -> str:
        return machine_text(self.changed(values))


_USUAL_SIZES = {"um": 50.0, "mm": 1.0}
"""Ends of the sliders of parameters that are zero, by unit."""


def _first_of(model: Model) -> tuple[str, float]:
    """Return the first parameter of a model and its value."""
    return next(iter(model.parameters.items()))


def _public_prefix(name: str) -> str:
    """Return the module of a model class of hbgear for the user: hb. or hb.gears."""
    return "hb.gears." if name not in hb.__all__ and name in hb.gears.__all__ else "hb."


def _study_text(
    model: str, base: Mapping[str, Any], grid: Mapping[str, float], span: tuple[float, float], harmonics: int
) -> str:
    """Return the text of a study of one design: fields of its base, and its values of the grid."""
    lines = ["# A study of one design; vary more of it:  hbgear study FILE", f"model = {json.dumps(model)}"]
    lines += ["", "[base]", *(f"{key} = {_toml(x)}" for key, x in base.items())] if base else []
    lines += ["", "[grid]", *(f"{key} = [{_toml(float(x))}]" for key, x in grid.items())]
    lines += ["", "[compute]", 'what = ["peak", "jumps", "curve"]', f"harmonics = {harmonics}"]
    return "\n".join([*lines, f"span = [{_toml(span[0])}, {_toml(span[1])}]"]) + "\n"


def _labelled_parameters(model: Model) -> list[Parameter]:
    """Return the parameters of a model with the units of their labels."""
    return [
        _parameter(
            name,
            str(model.labels.get(name, name)),
            value,
            model.ranges.get(name, ANY),
            usual_size=_USUAL_SIZES.get(unit_of(str(model.labels.get(name, name)))),
        )
        for name, value in model.parameters.items()
    ]


def _parameter(name: str, label: str, value: float, allowed: Range, usual_size: float | None = None) -> Parameter:
    size = abs(value) or usual_size or 1.0
    low, high = (0.2 * value, 2.5 * value) if value > 0 else (2.5 * value, 0.2 * value) if value < 0 else (-size, size)
    if not value and allowed is not ANY:
        low = max(low, allowed.low)
    low, high = max(low, allowed.low), min(high, allowed.high)
    text = re.sub(r"\s*\[[^\[\]]*\]\s*$", "", in_html(label)) if unit_of(label) else in_html(label)
    limits = tuple(end if math.isfinite(end) else None for end in (allowed.low, allowed.high))
    return Parameter(name, text, bracketed(unit_of(label)).strip(" []"), value, low, high, (limits[0], limits[1]))


def _call(name: str, obj: Any, **expressions: str) -> str:
    """Return an expression that creates an object, without arguments equal to their defaults."""
    arguments = []
    for field in fields(obj):
        if not field.init:
            continue
        value, default = getattr(obj, field.name), defaults_of(type(obj)).get(field.name)
        default = getattr(default, "default", default)
        if field.name in expressions:
            arguments.append(f"{field.name}={expressions[field.name]}")
        elif value != default:
            arguments.append(f"{field.name}={value!r}")
    return f"{name}({', '.join(arguments)})"


def _is_plain(value: Any) -> bool:
    entries = value if isinstance(value, tuple) else (value,)
    return all(isinstance(x, str | bool | int | float) for x in entries)


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float) and math.isfinite(value):
        return repr(value)
    return json.dumps(value)
