"""Models in TOML files: gear pairs from drawings, trains, epicyclic sets, and structures of matrices or receptances."""

from __future__ import annotations

import os

from hbgear.io.machines.machine_file import read_machine
from hbgear.io.machines.structure_file import is_structure, read_structure
from hbgear.io.machines.train_file import is_train, read_train
from hbgear.mechanics.models import Model


def read_model(path: str | os.PathLike[str]) -> Model:
    """Read the model of a file of any kind; TomlFileError if the file cannot be read or a value is not valid."""
    if is_train(path):
        return read_train(path)
    return read_structure(path) if is_structure(path) else read_machine(path).model()
