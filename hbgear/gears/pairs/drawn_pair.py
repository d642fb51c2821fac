"""Gear pair whose parameters are the quantities of its drawing, in the units of drawings.

    model("backlash" = 90 um) = model of the pair with this backlash, in the units omega_0, b_0 of the first design

Omega and the amplitudes keep the units of the first design, so that a speed in r/min is the same Omega for all values
of the parameters, and curves in a parameter are at a constant speed. `PARAMETERS` has the names, units and ranges; the
command line, files, figures, fits and the explorer use them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Self

from hbgear.common.ranges import ANY, NOT_NEGATIVE, POSITIVE, Range
from hbgear.common.text.messages import did_you_mean
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.mesh.mesh_cycle import MeshCycle
from hbgear.gears.mesh.tooth_friction import checked_friction
from hbgear.gears.pairs.pair_models import build_model
from hbgear.gears.pairs.support import Support
from hbgear.gears.torque_orders import torque_orders as checked_orders
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.structures.elements import Reaction
from hbgear.mechanics.structures.scales import Scales

GEARS = ("pinion", "wheel")
"""Names of the gears in the order of supports."""


class DrawingParameter(NamedTuple):
    """Quantity of a drawing that is a parameter of `DrawnPair`.

    Attributes
    ----------
    label : str
        Meaning.
    unit : str
        Unit of the values; empty for a number.
    scale : float
        Value over the field of the drawing in SI units.
    allowed : Range
        Allowed values.
    places : tuple of tuple of str
        Fields with this value: "" (the operation), "pair", "pinion", "wheel" or a support, and its name.
    """

    label: str
    unit: str
    scale: float
    allowed: Range
    places: tuple[tuple[str, str], ...]

    @property
    def full_label(self) -> str:
        """Meaning with the unit."""
        return f"{self.label} [{self.unit or '-'}]"


def _of_both_gears(name: str) -> tuple[tuple[str, str], ...]:
    return tuple((gear, name) for gear in GEARS)


PARAMETERS: Mapping[str, DrawingParameter] = {
    "torque": DrawingParameter("torque on the pinion", "N m", 1.0, ANY, (("", "torque"),)),
    "damping": DrawingParameter("damping ratio of the mesh", "", 1.0, NOT_NEGATIVE, (("", "damping"),)),
    "friction": DrawingParameter("coefficient of friction of the teeth", "", 1.0, NOT_NEGATIVE, (("", "friction"),)),
    "backlash": DrawingParameter("backlash", "um", 1e6, POSITIVE, (("pair", "backlash"),)),
    "pitch_error": DrawingParameter("pitch error", "um", 1e6, ANY, (("pair", "pitch_error"),)),
    "misalignment": DrawingParameter("misalignment", "um", 1e6, ANY, (("pair", "misalignment"),)),
    "tip_relief": DrawingParameter("tip relief of both gears", "um", 1e6, NOT_NEGATIVE, _of_both_gears("tip_relief")),
    "tip_relief_pinion": DrawingParameter(
        "tip relief of the pinion", "um", 1e6, NOT_NEGATIVE, (("pinion", "tip_relief"),)
    ),
    "tip_relief_wheel": DrawingParameter(
        "tip relief of the wheel", "um", 1e6, NOT_NEGATIVE, (("wheel", "tip_relief"),)
    ),
    "runout_pinion": DrawingParameter("run-out of the pinion", "um", 1e6, NOT_NEGATIVE, (("pinion", "runout"),)),
    "runout_wheel": DrawingParameter("run-out of the wheel", "um", 1e6, NOT_NEGATIVE, (("wheel", "runout"),)),
    "module": DrawingParameter("normal module", "mm", 1e3, POSITIVE, _of_both_gears("module")),
    "width": DrawingParameter("face width of both gears", "mm", 1e3, POSITIVE, _of_both_gears("face_width")),
    "shift_pinion": DrawingParameter("profile shift of the pinion", "", 1.0, ANY, (("pinion", "profile_shift"),)),
    "shift_wheel": DrawingParameter("profile shift of the wheel", "", 1.0, ANY, (("wheel", "profile_shift"),)),
    "bearing_pinion": DrawingParameter(
        "stiffness of the bearings of the pinion", "N/m", 1.0, POSITIVE, (("support 0", "stiffness"),)
    ),
    "bearing_wheel": DrawingParameter(
        "stiffness of the bearings of the wheel", "N/m", 1.0, POSITIVE, (("support 1", "stiffness"),)
    ),
}
"""Parameters of a gear pair by the names of the drawing."""

_MESH = ("pitch_error", "misalignment", "tip_relief", "tip_relief_pinion", "tip_relief_wheel")
"""Parameters that have no effect if the mesh is given by tables."""


@dataclass(frozen=True)
class DrawnPair(Model):  # numpydoc ignore=PR02
    """Model of a gear pair with the quantities of its drawing as parameters.

    The equations are those of `GearPair.model`. The parameters are torque [N m], damping, backlash [um], pitch_error
    [um], misalignment [um], tip_relief [um], module [mm], width [mm], shift_pinion, shift_wheel, with friction
    friction, with run-out runout_pinion and runout_wheel [um], and with supports bearing_pinion and bearing_wheel
    [N/m].

    Parameters
    ----------
    pair : GearPair
        Gear pair with backlash.
    torque : float
        Torque on the pinion [N m].
    damping : float
        Damping ratio of the mesh.
    form : {"torsion", "bearings", "spatial"}, optional
        Form of the model; default "torsion".
    supports : tuple of Support, optional
        Supports of pinion and wheel; default none.
    mesh : {"teeth", "secant", "tangent"}, optional
        Model of the mesh, see `GearPair.model`; default None, its default.
    cycle : MeshCycle, optional
        Mesh stiffness and error from tables; default None.
    torque_orders : mapping, optional
        Harmonics of the torque by order of the pinion; default none.
    units : tuple of float, optional
        Angular frequency [rad/s] of Omega = 1 and unit of amplitudes [m]. Default: those of this design.
    friction : float or BenedictKelley, optional
        Coefficient of friction between the teeth; default 0. A positive number is a parameter.

    Raises
    ------
    ValueError
        If `GearPair.model` refuses a value.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> model = hb.gears.DrawnPair(hb.GearPair(pinion, wheel, backlash="80 um"), 200.0, 0.04)
    >>> model.title
    'Gear pair 25/40, m = 3 mm, 200 N m'
    >>> wider = model.replace(backlash=100.0)
    >>> wider.parameters["backlash"], wider.scales.frequency == model.scales.frequency
    (100.0, True)
    """

    pair: GearPair
    torque: float
    damping: float
    form: Literal["torsion", "bearings", "spatial"] = "torsion"
    supports: tuple[Support, ...] = ()
    mesh: str | None = None
    cycle: MeshCycle | None = None
    torque_orders: Any = ()
    units: tuple[float, ...] = ()
    friction: Any = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {name: parameter.allowed for name, parameter in PARAMETERS.items()}

    def __post_init__(self) -> None:
        orders = checked_orders(
            "DrawnPair",
            [tuple(row) for row in self.torque_orders]
            if isinstance(self.torque_orders, list | tuple)
            else self.torque_orders,
        )
        object.__setattr__(self, "torque_orders", orders)
        object.__setattr__(self, "friction", checked_friction("DrawnPair", self.friction))
        super().__post_init__()
        if not self.units:
            equations = self._built(None)
            assert equations.scales is not None
            object.__setattr__(self, "units", (equations.scales.frequency, equations.scales.length))
            vars(self)["equations"] = equations

    def _built(self, units: tuple[float, float] | None) -> Model:
        supports: Any = self.supports or None
        return build_model(
            self.pair,
            self.torque,
            self.damping,
            self.form,
            supports=supports,
            mesh=self.mesh,
            cycle=self.cycle,
            torque_orders=self.torque_orders,
            units=units,
            friction=self.friction,
        )

    @cached_property
    def equations(self) -> Model:
        """Model with dimensionless parameters that has the equations of motion."""
        return self._built((self.units[0], self.units[1]))

    def system(self) -> System:
        return self.equations.system()

    @property
    def title(self) -> str:
        pinion = self.pair.pinion
        kind = " (ring)" if self.pair.wheel.internal else " (rack)" if self.pair.wheel.rack else ""
        torque = f"{self.torque:g} N m" if self.torque or not self.torque_orders else "torque without mean"
        return f"Gear pair {pinion.teeth}/{self.pair.wheel.teeth}{kind}, m = {pinion.module * 1e3:g} mm, {torque}"

    @property
    def labels(self) -> Mapping[str, str]:  # type: ignore[override]
        """Labels of Omega and the amplitude, and of the parameters with their units."""
        labels = {name: self.equations.labels[name] for name in ("Omega", "amplitude") if name in self.equations.labels}
        return labels | {name: PARAMETERS[name].full_label for name in self.parameters}

    @property
    def default_span(self) -> tuple[float, float]:  # type: ignore[override]
        """Range of Omega over which a response curve is traced by default."""
        return self.equations.default_span

    @property
    def scales(self) -> Scales | None:
        return self.equations.scales

    @property
    def reactions(self) -> Mapping[str, Reaction]:
        return self.equations.reactions

    @property
    def sharing(self) -> Sequence[str]:
        return self.equations.sharing

    @property
    def mesh_names(self) -> Sequence[str]:
        return self.equations.mesh_names

    @property
    def orders(self) -> Mapping[str, float]:
        return self.equations.orders

    @property
    def mesh_order(self) -> int:
        """Frequency of the mesh over Omega."""
        return int(getattr(self.equations, "mesh_order", 1))

    @property
    def parameters(self) -> dict[str, float]:
        """Quantities of the drawing by name, in the units of `PARAMETERS`."""
        return dict(self._parameters)  # a copy: callers change it

    @cached_property
    def _parameters(self) -> dict[str, float]:
        return {name: _rounded(value * PARAMETERS[name].scale) for name, value in self._parameter_values()}

    def _parameter_values(self) -> list[tuple[str, float]]:
        """Return the parameters that this pair has, in SI units."""
        named_values = []
        for name, x in PARAMETERS.items():
            values = [getattr(owner, field) for owner, field in map(self._owner_of, x.places) if owner is not None]
            is_one = len(values) == len(x.places) and None not in values and len(set(values)) == 1
            if name == "friction" and not (isinstance(self.friction, float) and self.friction > 0):
                continue
            if name.startswith("runout") and not values[0]:  # the period changes with the first run-out
                continue
            if is_one and (self.cycle is None or name not in _MESH):
                named_values.append((name, float(values[0])))
        equal_reliefs = any(name == "tip_relief" for name, _ in named_values)
        return [(name, x) for name, x in named_values if not (equal_reliefs and name.startswith("tip_relief_"))]

    def _owner_of(self, location: tuple[str, str]) -> tuple[Any, str]:
        """Return the object that has a field, and the name of the field; None if there is no such object."""
        owner, field = location
        if owner.startswith("support"):
            return (self.supports[int(owner[-1])] if self.supports else None), field
        return {"": self, "pair": self.pair, "pinion": self.pair.pinion, "wheel": self.pair.wheel}[owner], field

    @property
    def entries(self) -> dict[str, float]:
        """Empty: tuples of this model are no parameters."""
        return {}

    def replace(self, /, **changes: Any) -> Self:
        """Return a copy with other values of parameters or fields.

        Parameters
        ----------
        **changes
            Values by name: parameters in the units of `PARAMETERS`, or fields.

        Returns
        -------
        DrawnPair
            The copy, in the same units of Omega and amplitudes.

        Raises
        ------
        KeyError
            If there is no such parameter.
        """
        names = (
            {*self._parameters, "tip_relief_pinion", "tip_relief_wheel"} if self.cycle is None else {*self._parameters}
        )
        present = self._parameters
        changed = {name: changes.pop(name) for name in [*changes] if name in names}
        changed = {name: value for name, value in changed.items() if value != present.get(name)}
        if not changed and not changes:
            return self
        fields = {field.name for field in dataclasses.fields(self)}
        for name in changes:
            if name not in fields:
                raise KeyError(f"the gear pair has no parameter '{name}'{did_you_mean(name, self.parameters)}")
        by_owner: dict[str, dict[str, Any]] = {"pair": {}, "pinion": {}, "wheel": {}, "support 0": {}, "support 1": {}}
        for name, value in changed.items():
            parameter = PARAMETERS[name]
            for owner, field in parameter.places:
                (by_owner[owner] if owner else changes)[field] = _rounded(float(value) / parameter.scale)
        pair = changes.pop("pair", self.pair)
        gears = {gear: dataclasses.replace(getattr(pair, gear), **by_owner[gear]) for gear in GEARS if by_owner[gear]}
        pair = dataclasses.replace(pair, **gears, **by_owner["pair"]) if gears or by_owner["pair"] else pair
        supports = tuple(
            dataclasses.replace(support, **by_owner[f"support {i}"])
            for i, support in enumerate(changes.pop("supports", self.supports))
        )
        return dataclasses.replace(self, pair=pair, supports=supports, **changes)


def _rounded(value: float) -> float:
    """Return a number without the rounding error of a change of units."""
    return float(f"{value:.15g}")
