"""Files: branches, tables, data frames, machines, matrices and objects of other programs."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.io.branches.frames import to_dataframe, to_xarray
    from hbgear.io.branches.npz import load, save
    from hbgear.io.branches.tables import export
    from hbgear.io.bridges import from_opentorsion, from_ross
    from hbgear.io.machines.machine_file import read_machine
    from hbgear.io.machines.model_file import read_model
    from hbgear.io.machines.structure_file import read_structure
    from hbgear.io.matrices import Matrices, from_matrices
    from hbgear.io.receptance_files import from_receptances
    from hbgear.io.tables.mesh_table import read_mesh_table

__all__ = [
    "Matrices",
    "export",
    "from_matrices",
    "from_opentorsion",
    "from_receptances",
    "from_ross",
    "load",
    "read_machine",
    "read_mesh_table",
    "read_model",
    "read_structure",
    "save",
    "to_dataframe",
    "to_xarray",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
