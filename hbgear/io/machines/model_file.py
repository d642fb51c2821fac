"""Models in TOML files: gear pairs from drawings, trains, epicyclic sets, and structures of matrices or receptances."""

from __future__ import annotations

import os

from hbgear.io.machines.machine_file import read_machine
from hbgear.io.machines.structure_file import is_structure, read_structure
from hbgear.io.machines.train_file import is_train, read_train
from hbgear.mechanics.models import Model


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
    if is_train(path):
        return read_train(path)
    return read_structure(path) if is_structure(path) else read_machine(path).model()
