"""Models in TOML files: gear pairs from drawings, trains, epicyclic sets, and structures of matrices or receptances."""

from __future__ import annotations

import os
from typing import Literal

from hbgear.io.machines.machine_file import read_machine
from hbgear.io.machines.structure_file import read_structure
from hbgear.io.machines.toml_file import TomlFileError, parsed
from hbgear.io.machines.train_file import read_train
from hbgear.io.matrices import NAMES
from hbgear.mechanics.models import Model


def kind_of_file(path: str | os.PathLike[str]) -> Literal["study", "train", "structure", "machine"]:
    """Return the content of a TOML file by its keys.

    A study names a model, a train has wheels or meshes in a list, a structure has matrices, receptances or elements.
    Everything else is a machine, whose reader explains what is wrong.
    """
    try:
        data = parsed(path, "a model")[1]
    except TomlFileError:
        return "machine"
    if isinstance(data.get("model"), str):
        return "study"
    if isinstance(data.get("mesh"), list) or isinstance(data.get("wheel"), list):
        return "train"
    return "structure" if data.keys() & {"matrices", "receptances", "element", *NAMES} else "machine"


def read_model(path: str | os.PathLike[str]) -> Model:
    """Read the model of a TOML file of any kind: a gear pair, a train, an epicyclic set or a structure.

    Parameters
    ----------
    path : str or path-like
        Path of the .toml file.

    Returns
    -------
    Model
        The model.

    Raises
    ------
    TomlFileError
        If the file cannot be read or a value is not valid; the message has the line.

    Examples
    --------
    >>> import hbgear as hb
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "mass.toml")
    ...     size = path.write_text('''
    ... matrices = { M = [[1.0]], K = [[1.0]] }
    ... element = [{ direction = [1.0], law = "unilateral", k = 2.0, gap = 0.1 }]''', encoding="utf-8")
    ...     model = hb.io.read_model(path)
    >>> sorted(model.parameters)
    ['gap', 'k']
    """
    kind = kind_of_file(path)
    if kind == "train":
        return read_train(path)
    return read_structure(path) if kind == "structure" else read_machine(path).model()
