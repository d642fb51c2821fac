"""Files of gear pairs with their operation (TOML), checked before any computation.

    torque = "200 N m"
    torque_orders = { 2 = "60 N m", "1/2" = ["10 N m", "30 deg"] }   # of the pinion, with phases; optional
    damping = 0.04
    friction = 0.05         # of the teeth; or { viscosity = "0.01 Pa s", speed = "3000 r/min" }; optional

    [pinion]
    teeth = 25
    module = "3 mm"
    face_width = "20 mm"

    [wheel]                 # module, face width and angles default to those of the pinion
    teeth = 40

    [pair]
    backlash = "80 um"

Keys are the fields of `Gear`, `GearPair` and `Support`; quantities are text with a unit, or numbers in SI.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, Literal

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.atomic_write import atomic_write, checked_suffix
from hbgear.common.process.signals import defer_signals
from hbgear.common.units import QuantityField
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.mesh.mesh_cycle import MeshCycle, MeshTable
from hbgear.gears.mesh.tooth_friction import COEFFICIENT, BenedictKelley, Friction, checked_friction
from hbgear.gears.pairs.drawn_pair import DrawnPair
from hbgear.gears.pairs.pair_models import DAMPING
from hbgear.gears.pairs.support import Support
from hbgear.gears.torque_orders import TorqueOrders, effective_torque, torque_orders
from hbgear.io.machines.toml_file import (
    MESH_MODEL,
    QUANTITY,
    TORQUE_ORDERS,
    KeyPath,
    Problems,
    bare,
    constructed,
    form,
    read_checked,
    recorded,
    strict_schema,
)
from hbgear.io.tables.mesh_table import read_mesh_table

_SHARED = ("module", "face_width", "pressure_angle", "addendum", "dedendum", "fillet_radius", "E", "poisson", "density")
_TORQUE = QuantityField("N m")
_TORQUE.__set_name__(object, "torque")


@dataclass(frozen=True)
class Machine:
    """A gear pair and its operation.

    Attributes
    ----------
    pair : GearPair
        Gear pair.
    torque : float
        Torque on the pinion [N m].
    damping : float
        Damping ratio of the mesh.
    form : {"torsion", "bearings", "spatial"}, optional
        Form of the model; default "torsion".
    supports : (Support, Support), optional
        Supports of pinion and wheel; default None, for the form "torsion".
    cycle : MeshCycle, optional
        Mesh stiffness and error from tables; default None, which computes them.
    mesh_model : {"teeth", "secant", "tangent"}, optional
        Model of the computed mesh, see `GearPair.model`; default None, its default.
    torque_orders : mapping, optional
        Harmonics of the torque by order of the pinion, see `GearPair.model`; default none.
    friction : float or BenedictKelley, optional
        Coefficient of friction between the teeth; default 0.
    """

    pair: GearPair
    torque: float
    damping: float
    form: Literal["torsion", "bearings", "spatial"] = "torsion"
    supports: tuple[Support, Support] | None = None
    cycle: MeshCycle | None = None
    mesh_model: Literal["teeth", "secant", "tangent"] | None = None
    torque_orders: Any = ()
    friction: Any = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "friction", checked_friction("the machine", self.friction))
        object.__setattr__(self, "torque_orders", torque_orders("the machine", self.torque_orders))

    @property
    def mesh_torque(self) -> float:
        """Torque at which the mesh is computed [N m]: the root mean square."""
        return effective_torque(self.torque, self.torque_orders)

    @property
    def mesh(self) -> MeshCycle:
        """Mesh stiffness and error, from tables or computed."""
        linearized = "tangent" if self.mesh_model == "tangent" else "secant"
        return self.cycle or self.pair.mesh(self.mesh_torque, linearized=linearized)

    def model(self) -> DrawnPair:
        """Return the model, whose parameters are the quantities of the drawing."""
        return DrawnPair(
            self.pair,
            self.torque,
            self.damping,
            self.form,
            self.supports or (),
            self.mesh_model,
            self.cycle,
            self.torque_orders,
            friction=self.friction,
        )


@checked_arguments()
def read_machine(path: str | os.PathLike[str]) -> Machine:
    """Read and check the file of a machine.

    Parameters
    ----------
    path : str or path-like
        Path of the .toml file.

    Returns
    -------
    Machine
        The machine.

    Raises
    ------
    TomlFileError
        If the file cannot be read, a key, type, unit or value is wrong, or the gears cannot be made or do not mesh.

    Examples
    --------
    >>> import hbgear as hb
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "pair.toml")
    ...     size = path.write_text('''
    ... torque = "200 N m"
    ... damping = 0.04
    ... pinion = { teeth = 25, module = "3 mm", face_width = "20 mm" }
    ... wheel = { teeth = 40 }
    ... pair = { backlash = "80 um" }''', encoding="utf-8")
    ...     machine = hb.io.read_machine(path)
    >>> machine.torque, machine.pair.wheel.teeth
    (200.0, 40)
    """
    return read_checked(path, "a machine", _schema(), _machine)


@defer_signals()  # pydantic panics on Ctrl-C while it creates a model
def _schema() -> Any:
    """Return the schema of the file, a pydantic model."""
    support = form("support", Support, ("stiffness",))
    mesh = strict_schema("mesh", stiffness=(str, ...), error=(str, None), static_error=(str, None))
    return strict_schema(
        "machine",
        torque=(QUANTITY, ...),
        damping=(QUANTITY, ...),
        form=(Literal["torsion", "bearings", "spatial"], None),
        mesh_model=(MESH_MODEL, None),
        torque_orders=(TORQUE_ORDERS, ()),
        friction=(float | form("friction", BenedictKelley, ("viscosity", "speed")), 0.0),
        pinion=(form("pinion", Gear, ("teeth", "module", "face_width")), ...),
        wheel=(form("wheel", Gear, ("teeth",)), ...),
        pair=(form("pair", GearPair, (), ("pinion", "wheel")), None),
        support=(strict_schema("supports", pinion=(support, ...), wheel=(support, ...)), None),
        mesh=(mesh, None),
    )


def _machine(data: Mapping[str, Any], folder: Path, problems: Problems) -> Machine | None:
    """Return the machine; None if a value was refused, which is recorded."""
    torque, damping = (_read(field, data[field.name], problems) for field in (_TORQUE, DAMPING))
    pinion = constructed(problems, ("pinion",), Gear, data["pinion"])
    wheel = None if pinion is None else constructed(problems, ("wheel",), Gear, _completed(pinion, data["wheel"]))
    supports = [
        constructed(problems, ("support", name), Support, table) for name, table in data.get("support", {}).items()
    ]
    orders: TorqueOrders = ()
    with recorded(problems, ("torque_orders",)):
        orders = torque_orders("the machine", data.get("torque_orders", ()))
    friction = _friction(data.get("friction", 0.0), problems)
    if pinion is None or wheel is None:
        return None
    pair = constructed(problems, ("pair",), GearPair, {"pinion": pinion, "wheel": wheel, **data.get("pair", {})})
    cycle = None
    if pair is not None and "mesh" in data:
        force = pair.transverse_force(effective_torque(torque, orders))
        cycle = _cycle(data["mesh"], folder, force, problems)
    if problems or pair is None:
        return None
    support_pair: Any = tuple(supports) or None
    machine_form = data.get("form", "torsion")
    machine = Machine(
        pair, torque, damping, machine_form, support_pair, cycle, data.get("mesh_model"), orders, friction
    )
    try:
        machine.model()
    except ValueError as error:
        problems.append((_key_path_of_error(str(error), data), bare(error)))
    return None if problems else machine


def _friction(value: Any, problems: Problems) -> Friction:
    if isinstance(value, Mapping):
        film: Friction | None = constructed(problems, ("friction",), BenedictKelley, value)
        return film or 0.0
    return _read(COEFFICIENT, value, problems)


def _read(field: QuantityField, value: Any, problems: Problems) -> float:
    with recorded(problems, (field.name,)):
        return field.read("the machine", value)
    return 0.0


def _cycle(table: Mapping[str, str], folder: Path, force: float, problems: Problems) -> MeshCycle | None:
    """Return the mesh cycle of the tables that a file names."""
    try:
        stiffness = read_mesh_table(folder / table["stiffness"])
        if "static_error" in table:
            if "error" in table:
                raise ValueError("error and static_error are both given; keep the error without or under load")
            return MeshCycle.loaded(stiffness, read_mesh_table(folder / table["static_error"], unit="m"), force)
        error = MeshTable([0.0, 1.0], [0.0, 0.0])
        if "error" in table:
            error = read_mesh_table(folder / table["error"], unit="m")
        return MeshCycle(stiffness, error)
    except (ValueError, OSError) as refusal:
        problems.append((("mesh",), str(refusal)))
        return None


def _completed(pinion: Gear, wheel: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the wheel, with missing ones from the pinion."""
    shared = {name: getattr(pinion, name) for name in _SHARED}
    if pinion.helix_angle:
        shared["helix_angle"] = pinion.helix_angle * (1 if wheel.get("internal") else -1)
    return {**shared, **wheel}


def _key_path_of_error(message: str, data: Mapping[str, Any]) -> KeyPath:
    """Return the key of the file that an error of the whole machine refers to."""
    if "BenedictKelley" in message or "friction" in message:
        return ("friction",)
    for name in ("torque", "damping"):
        if f"{name} =" in message:
            return (name,)
    if "mesh =" in message and "mesh_model" in data:
        return ("mesh_model",)
    word = "support" if "support" in message and "support" in data else "form" if "form" in message else "pair"
    return (word,)


def write_machine(machine: Machine, path: str | os.PathLike[str], remarks: tuple[str, ...] = ()) -> None:
    """Write the file of a machine (.toml), completely or not at all, with numbers in full precision.

    ``remarks`` are comment lines at its start. ValueError is raised if the machine has tables of the mesh, which are
    separate files, or the path does not end in .toml.
    """
    checked_suffix(path, (".toml",), "the file of a machine is .toml")
    text = machine_text(machine, remarks)
    with atomic_write(path, "x", encoding="utf-8") as handle:
        handle.write(text)


def machine_text(machine: Machine, remarks: tuple[str, ...] = ()) -> str:
    """Return the text that `write_machine` writes."""
    if machine.cycle is not None:
        raise ValueError("a machine with tables of the mesh is written by naming their files in [mesh]")
    lines = [f"# {remark}" for remark in remarks]
    lines += [f"torque = {_quantity(machine.torque, 'N m')}", f"damping = {machine.damping!r}"]
    if machine.torque_orders:
        entries = (
            f'"{order!r}" = [{_quantity(size, "N m")}, {_quantity(phase, "rad")}]'
            for order, size, phase in machine.torque_orders
        )
        lines.append(f"torque_orders = {{ {', '.join(entries)} }}")
    if isinstance(machine.friction, BenedictKelley):
        lines.append(f"friction = {{ {', '.join(_entries(machine.friction))} }}")
    elif machine.friction:
        lines.append(f"friction = {machine.friction!r}")
    lines += [f'form = "{machine.form}"'] if machine.form != "torsion" else []
    lines += [f'mesh_model = "{machine.mesh_model}"'] if machine.mesh_model else []
    tables: list[tuple[str, Any]] = [
        ("pinion", machine.pair.pinion),
        ("wheel", machine.pair.wheel),
        ("pair", machine.pair),
    ]
    tables += zip(("support.pinion", "support.wheel"), machine.supports or (), strict=False)
    for name, component in tables:
        lines += ["", f"[{name}]", *_entries(component)]
    return "\n".join(lines) + "\n"


def _entries(component: Any) -> list[str]:
    """Return the lines of the fields whose values are not the default."""
    lines = []
    for field in fields(component):
        value, quantity = getattr(component, field.name), vars(type(component)).get(field.name)
        default = quantity.default if isinstance(quantity, QuantityField) else field.default
        if not field.init or isinstance(value, Gear) or value is None or (default is not MISSING and value == default):
            continue
        if isinstance(quantity, QuantityField) and quantity.unit:
            lines.append(f"{field.name} = {_quantity(value, quantity.unit)}")
        else:
            lines.append(f"{field.name} = {json.dumps(value)}")
    return lines


_WRITTEN = {"m": [("mm", 1e3), ("um", 1e6)], "rad": [("deg", 57.29577951308232)], "Pa": [("GPa", 1e-9)]}


def _quantity(value: float, unit: str) -> str:
    """Return a quantity as text, in the unit that gives the shortest text and the same number when it is read."""
    for name, factor in _WRITTEN.get(unit, []):
        text = f"{value * factor:.12g} {name}"
        if abs(value) * factor >= 0.1 and abs(float(text.split()[0]) / factor - value) <= 4e-15 * abs(value):
            return json.dumps(text)
    short = f"{value:.12g}"
    return json.dumps(f"{short if float(short) == value else repr(value)} {unit}")
