"""Files of structures from matrices or measured receptances (TOML), checked before any computation.

    [matrices]                        # Matrix Market or NumPy, each in its own file, or [[2, -1], [-1, 2]]; C and G too
    M = "mass.mtx"
    K = "stiffness.mtx"
    names = ["shaft", "case"]
    damping_ratio = 0.02              # of all modes, or a list for the lowest ones; instead of C

    [[element]]
    name = "stop"
    direction = { shaft = 1.0, case = -1.0 }     # or [1.0, -1.0], a number for each coordinate
    law = "unilateral"
    k = 2e5
    gap = 1e-4

    [[load]]
    cosine = { 1 = { shaft = 4.0 } }

Numbers are in the units of the matrices. ``file = "machine.mat"`` (or .npz) contains all matrices, and M, K, C, G are
then their names in it. ``[receptances]`` has ``file = "test.uff"``, or ``tables`` of response, force and file each, and
``static``, ``quantity``, ``names`` of `hb.io.from_receptances`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.signals import defer_signals
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.io.machines.toml_file import KeyPath, Problems, read_checked, strict_schema
from hbgear.io.matrices import NAMES, Matrices, from_matrices
from hbgear.io.receptance_files import from_receptances
from hbgear.mechanics.function_model import SystemOfLaws
from hbgear.mechanics.laws.registry import ELEMENT_KEYS, LAWS
from hbgear.mechanics.laws.vector_laws import VectorLaw
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.structures.elements import Element, Load, VectorElement
from hbgear.mechanics.structures.receptances import Receptances


def read_structure(path: str | os.PathLike[str]) -> System:
    """Read and check the file of a structure with its elements and loads.

    Parameters
    ----------
    path : str or path-like
        Path of the .toml file.

    Returns
    -------
    System
        The structure with its elements and loads.

    Raises
    ------
    TomlFileError
        If the file or a file that it names cannot be read, or a key, type or value is wrong.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     np.savez(Path(folder, "all.npz"), M=np.eye(2), K=np.array([[2.0, -1.0], [-1.0, 2.0]]))
    ...     path = Path(folder, "machine.toml")
    ...     size = path.write_text('''
    ... matrices = { file = "all.npz", names = ["shaft", "case"] }
    ... element = [{ direction = { shaft = 1.0 }, law = "unilateral", k = 2.0, gap = 0.1 }]''', encoding="utf-8")
    ...     system = hb.io.read_structure(path)
    >>> system.n, len(system.elements)
    (2, 1)
    """
    return read_checked(path, "a structure", _schema(), _system)


@defer_signals()  # pydantic panics on Ctrl-C while it creates a model
def _schema() -> Any:
    """Return the schema of the file, a pydantic model."""
    from pydantic import BeforeValidator

    matrix: Any = str | list[list[float]]
    matrices = strict_schema(
        "matrices",
        **dict.fromkeys(NAMES, (matrix, None)),
        file=(str, None),
        names=(list[str], ()),
        ratio=(float, 1.0),
        damping_ratio=(float | list[float], None),
    )
    table: Any = strict_schema("table", response=(str, ...), force=(str, ...), file=(str, ...))
    receptances = strict_schema(
        "receptances",
        file=(str, None),
        tables=(list[table], None),
        names=(dict[str, str], None),
        static=(matrix, None),
        quantity=(Literal["receptance", "mobility", "accelerance"], None),
    )
    keys: dict[str, Any] = {}
    for entry in LAWS.values():
        for key, kind in () if entry.no_toml else entry.kinds.items():
            keys[key] = kind if key not in keys else keys[key] | kind
    element: Any = strict_schema(
        "element",
        name=(str, ""),
        direction=(Annotated[Any, BeforeValidator(_direction)], ...),
        law=(str, ...),
        damping=(float, 0.0),
        error=(list[float], None),
        **{key: (kind, None) for key, kind in keys.items()},
    )
    vector: Any = Annotated[Any, BeforeValidator(_vector)]
    waves: Any = dict.fromkeys(("cosine", "sine"), (dict[str, vector], {}))
    load: Any = strict_schema("load", constant=(vector, None), **waves, power=(int, 0))
    return strict_schema(
        "structure",
        matrices=(matrices, None),
        receptances=(receptances, None),
        element=(list[element], ...),
        load=(list[load], []),
    )


def _system(data: Mapping[str, Any], folder: Path, problems: Problems) -> System | None:
    """Return the system; None if a value was refused."""
    tables = [name for name in ("matrices", "receptances") if data.get(name) is not None]
    if len(tables) != 1:
        problems.append(((tables[-1] if tables else "element",), "give either [matrices] or [receptances]"))
        return None
    table = data[tables[0]]
    structure = _result_or_problem(
        problems,
        (tables[0],),
        lambda: _matrices(table, folder) if "matrices" in tables else _receptances(table, folder),
    )
    if structure is None:
        return None
    elements, loads = (
        [
            _result_or_problem(problems, (name, i), partial(make, structure, entry))
            for i, entry in enumerate(data.get(name, []))
        ]
        for name, make in (("element", _element), ("load", _load))
    )
    if problems:
        return None
    elements = [entry for group in elements for entry in group]
    options = {"ratio": table.get("ratio", 1.0)} if isinstance(structure, Matrices) else {}
    system = _result_or_problem(problems, (tables[0],), lambda: structure.system(elements, loads, **options))
    if system is None:
        return None
    laws = [(entry["law"], _law_keys(entry)) for entry in data["element"]]
    if len(laws) != len(elements):  # the elements of a law of several displacements share its numbers
        return system
    return SystemOfLaws(**{field.name: getattr(system, field.name) for field in fields(System)}, laws=laws)


def _result_or_problem(problems: Problems, key_path: KeyPath, make: Callable[[], Any]) -> Any:
    """Return the result of ``make``; None if it is refused, with the reason added to the problems."""
    try:
        return make()
    except (ValueError, KeyError, IndexError, TypeError) as error:
        problems.append((key_path, str(error.args[0] if isinstance(error, KeyError) else error)))
        return None


def _matrices(table: Mapping[str, Any], folder: Path) -> Matrices:
    """Return the matrices of a table: rows of numbers, a file each, or one file with all of them."""
    sources = {name: table[name] for name in NAMES if table.get(name) is not None}
    names = tuple(table.get("names", ()))
    if table.get("file") is None:
        structure = from_matrices(
            {name: folder / x if isinstance(x, str) else x for name, x in sources.items()}, None, names
        )
    else:
        inline = next((name for name, x in sources.items() if not isinstance(x, str)), None)
        if inline is not None:
            raise ValueError(f"{inline} is a matrix and file names a file with all matrices: give either of them")
        structure = from_matrices(folder / table["file"], sources, names)
    ratio = table.get("damping_ratio")
    return structure if ratio is None else structure.with_modal_damping(ratio)


def _receptances(table: Mapping[str, Any], folder: Path) -> Receptances:
    options = {name: table.get(name) for name in ("static", "quantity", "names")}
    if (table.get("file") is None) == (table.get("tables") is None):
        raise ValueError("receptances are in a universal file or in tables: give either file or tables")
    if table.get("file") is not None:
        return from_receptances(folder / table["file"], **options)
    return from_receptances(
        {(entry["response"], entry["force"]): folder / entry["file"] for entry in table["tables"]}, **options
    )


def _element(structure: Matrices | Receptances, table: Mapping[str, Any]) -> tuple[Element, ...]:
    """Return the element of a table, or the elements of a law of several displacements with a list of directions."""
    law = _law_entry(table["law"]).from_toml(_law_keys(table))
    error = Series(0.0, tuple(table.get("error") or ()))
    damping, name = table.get("damping", 0.0), table.get("name", "")
    if isinstance(law, VectorLaw):
        if not _is_list_of_vectors(table["direction"]) or table.get("error"):
            raise ValueError(
                f"law = '{table['law']}' has {law.size} displacements and no error: give a list of directions, such as "
                "direction = [{ x = 1.0 }, { y = 1.0 }]"
            )
        return VectorElement([_along(structure, vector) for vector in table["direction"]], law, damping, name)
    if _is_list_of_vectors(table["direction"]):
        raise ValueError(f"law = '{table['law']}' has one displacement: give one direction, such as {{ x = 1.0 }}")
    return (Element(_along(structure, table["direction"]), law, error, damping, name),)


def _vector(value: Any) -> Any:
    """Return a vector of a file: numbers by the names of coordinates, or a number for each coordinate."""
    numbers = list(value.values()) if isinstance(value, dict) else value
    if not isinstance(numbers, list) or not numbers or not all(type(x) in (int, float) for x in numbers):
        raise ValueError("need numbers by coordinate, such as { x = 1.0 }, or one for each, such as [1.0, 0.0]")
    return value


def _direction(value: Any) -> Any:
    """Return a vector of a file, or a list of vectors."""
    return [_vector(vector) for vector in value] if _is_list_of_vectors(value) else _vector(value)


def _is_list_of_vectors(direction: Any) -> bool:
    """Return whether a direction is a list of vectors, which are tables or lists of numbers."""
    return isinstance(direction, list) and any(isinstance(entry, list | dict) for entry in direction)


def _along(structure: Matrices | Receptances, vector: dict[str | int, float] | list[float]) -> Array:
    """Return a vector (n,) that is given by the names of its coordinates, or by one number for each coordinate."""
    if isinstance(vector, dict):
        return structure.along(vector)
    names = list(structure.dof_names if isinstance(structure, Matrices) else structure.names)
    if len(vector) != len(names):
        raise ValueError(f"{vector} has {len(vector)} numbers; need one for each coordinate: {', '.join(names)}")
    return np.array(vector, dtype=float)


def _law_entry(name: str) -> Any:
    """Return the registered law of a name; ValueError for other names."""
    if name in LAWS:
        return LAWS[name]
    laws = [law for law, entry in LAWS.items() if not entry.no_toml]
    raise ValueError(f"there is no law {quoted(name)}{did_you_mean(name, laws, 'give one of')}")


def _law_keys(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of the law of an element."""
    return {key: value for key, value in table.items() if key not in ELEMENT_KEYS and value is not None}


def _load(structure: Matrices | Receptances, table: Mapping[str, Any]) -> Load:
    constant = None if table.get("constant") is None else _along(structure, table["constant"])
    waves: dict[str, Any] = {}
    for name in ("cosine", "sine"):
        invalid = next((order for order in table.get(name, {}) if not order.isdecimal()), None)
        if invalid is not None:
            raise ValueError(f"{name}: '{invalid}' is not a harmonic; give integers, such as {{ 1 = {{ x = 2.0 }} }}")
        waves[name] = {int(order): _along(structure, vector) for order, vector in table.get(name, {}).items()}
    return Load(constant, **waves, power=table.get("power", 0))
