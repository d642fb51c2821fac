"""Measured receptances: universal files (UFF, data set 58; pyuff reads them) and tables (.csv).

H_ij(f) = x_i / F_j, v_i / F_j or a_i / F_j   becomes   x_i / F_j = H_ij, H_ij / (i w), -H_ij / w^2,   w = 2 pi f
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.optional import needed
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.io.tables.receptance_table import read_response
from hbgear.mechanics.structures.receptances import Receptances

_POWERS = {"receptance": 0, "mobility": 1, "accelerance": 2}
"""Power of i w by which each quantity is divided."""

_ORDINATES = {8: "receptance", 11: "mobility", 12: "accelerance"}
"""Quantities of data set 58 by the type of the ordinate."""

_AXES = {1: "x", 2: "y", 3: "z", 4: "theta_x", 5: "theta_y", 6: "theta_z"}
_FRF = 4
"""Type of a frequency response function in data set 58."""

LINE_TOLERANCE = 1e-6
"""Difference between the frequencies of two functions, relative to the largest one, that counts as rounding."""

Function = tuple[Array, ComplexArray]
"""Frequencies [Hz] and receptances [m/N]."""


@checked_arguments()
def from_receptances(
    source: str | os.PathLike[str] | Mapping[Any, Any],
    static: Any = None,
    quantity: Literal["receptance", "mobility", "accelerance"] | None = None,
    names: Mapping[str, str] | None = None,
) -> Receptances:
    """Return measured receptances of a structure: displacements per force, with angular frequencies in rad/s.

    Parameters
    ----------
    source : path-like or dict
        A universal file (.uff, .unv) with functions of data set 58; or tables by response and force, such as
        ``{("pinion", "pinion"): "pp.csv", ("case", "pinion"): "cp.csv", ...}``. A table has the columns frequency, real
        and imaginary part, or frequency, magnitude and phase, in the units of its header:
        ``frequency [kHz]; |H| [dB re 1 mm/N]; phase [rad]``. Defaults are Hz, SI units and degrees, and without a
        header the columns frequency [Hz], real and imaginary part. A missing H_ij is replaced by H_ji.
    static : array_like or "lowest", optional
        Matrix at 0 Hz; "lowest" is the real part at the lowest frequency; default None, if the lines begin at 0 Hz.
    quantity : {"receptance", "mobility", "accelerance"}, optional
        Measured quantity per force; by default from the universal file or the units of the table, else "receptance".
    names : dict of str to str, optional
        Names for coordinates of a universal file, which are named by node and direction: ``{"12x": "pinion"}``. Other
        coordinates are then omitted.

    Returns
    -------
    Receptances
        The receptances.

    Raises
    ------
    ValueError
        If a file cannot be read, functions are missing or have different lines, or the static matrix is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> import os, tempfile
    >>> f = np.linspace(0.0, 50.0, 501)
    >>> H = 1 / (1e4 - (2 * np.pi * f) ** 2 + 20j * 2 * np.pi * f)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = os.path.join(folder, "point.csv")
    ...     np.savetxt(file, np.column_stack([f, H.real, H.imag]), delimiter=",")
    ...     found = hb.io.from_receptances({("case", "case"): file})
    ...
    >>> found
    Receptances(case; 501 lines from 0 to 314.159)
    """
    if isinstance(source, Mapping):
        if names is not None:
            raise ValueError("from_receptances: tables have the names they are given with; leave names out")
        functions = {}
        for key, path in _pairs(source):
            f, H, measured = read_response(path, quantity)
            functions[key] = _as_receptance(f, H, measured, f"'{path}'")
    else:
        functions = _universal(source, quantity)
        if names is not None:
            functions = _renamed(functions, names, source)
    return _combined(functions, static)


def _pairs(source: Mapping[Any, Any]) -> list[tuple[tuple[str, str], Any]]:
    for key in source:
        if not isinstance(key, tuple) or len(key) != 2 or not all(isinstance(name, str) for name in key):
            raise ValueError(
                f"from_receptances: {quoted(key)} must be the names of response and force, such as ('case', 'pinion')"
            )
    if not source:
        raise ValueError("from_receptances: there are no tables; give {('case', 'pinion'): 'cp.csv', ...}")
    return list(source.items())


def _combined(functions: Mapping[tuple[str, str], Function], static: Any) -> Receptances:
    """Combine the functions to one matrix for each line."""
    names = list(dict.fromkeys(name for pair in functions for name in pair))
    first, (f, _) = next(iter(functions.items()))
    values = np.empty((len(f), len(names), len(names)), dtype=complex)
    for i, a in enumerate(names):
        for j, b in enumerate(names):
            pair = (a, b) if (a, b) in functions else (b, a)
            if pair not in functions:
                available = ", ".join(f"{response} by {force}" for response, force in functions)
                raise ValueError(
                    f"from_receptances: there is no function of '{a}' by a force on '{b}', or of '{b}' by a force on "
                    f"'{a}'; need one for each pair of {', '.join(names)}; there are {available}"
                )
            lines, values[:, i, j] = functions[pair][0], 0.0
            if len(lines) != len(f) or np.abs(lines - f).max() > LINE_TOLERANCE * f[-1]:
                raise ValueError(
                    f"from_receptances: {pair[0]} by {pair[1]} has {len(lines)} lines from {lines[0]:g} to "
                    f"{lines[-1]:g} Hz, {first[0]} by {first[1]} has {len(f)} from {f[0]:g} to {f[-1]:g}; need the "
                    "same lines"
                )
            values[:, i, j] = functions[pair][1]
    if isinstance(static, str):
        if static != "lowest":
            raise ValueError(f"from_receptances: static = {quoted(static)} must be a matrix, 'lowest' or None")
        static = values[0].real
    return Receptances(2 * np.pi * f, values, names, static)


def _as_receptance(f: Array, H: ComplexArray, quantity: str, source: str) -> Function:
    """Divide by (i w)^0, 1 or 2; a line at 0 Hz, where velocities and accelerations are zero, is omitted."""
    power = _POWERS[quantity]
    if len(f) < 4 or np.any(np.diff(f) <= 0) or f[0] < 0 or not np.all(np.isfinite(f)):
        raise ValueError(f"{source}: need four or more frequencies that ascend from 0 Hz or above")
    if power and f[0] == 0:
        f, H = f[1:], H[1:]
    return f, H / (2j * np.pi * f) ** power if power else H


def _universal(path: str | os.PathLike[str], quantity: str | None) -> dict[tuple[str, str], Function]:
    """Return the functions of a universal file by the names of response and force."""
    if not Path(path).is_file():
        raise ValueError(f"there is no file '{path}'")
    pyuff = needed("pyuff", "measured", "reading a universal file")
    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # pyuff raises errors of many classes for damaged files
        message = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"'{path}' cannot be read as a universal file: {message[:200]}") from None
    functions: dict[tuple[str, str], Function] = {}
    for data_set in sets if isinstance(sets, list) else [sets]:
        if data_set.get("type") != 58 or data_set.get("func_type") != _FRF:
            continue
        measured = quantity or _ORDINATES.get(int(data_set.get("ordinate_spec_data_type", 0)))
        pair, sign = _coordinate_names(data_set)
        if measured is None:
            raise ValueError(
                f"'{path}': {pair[0]} by {pair[1]} does not state displacement, velocity or acceleration: "
                "give quantity='receptance', 'mobility' or 'accelerance'"
            )
        f, H = np.asarray(data_set["x"], dtype=float), sign * np.asarray(data_set["data"], dtype=complex)
        functions[pair] = _as_receptance(f, H, measured, f"'{path}': {pair[0]} by {pair[1]}")
    if not functions:
        raise ValueError(f"'{path}' has no frequency responses: functions of type 4 in data sets 58")
    return functions


def _coordinate_names(data_set: Mapping[str, Any]) -> tuple[tuple[str, str], int]:
    """Return the names of response and force of a data set 58, and the product of the signs of their directions."""
    names, sign = [], 1
    for end in ("rsp", "ref"):
        node, direction = int(data_set[f"{end}_node"]), int(data_set[f"{end}_dir"])
        names.append(f"{node}{_AXES.get(abs(direction), '')}")
        sign *= -1 if direction < 0 else 1
    return (names[0], names[1]), sign


def _renamed(
    functions: Mapping[tuple[str, str], Function], names: Mapping[str, str], path: Any
) -> dict[tuple[str, str], Function]:
    """Return the functions of the named coordinates, with the new names."""
    coordinates = {name for pair in functions for name in pair}
    for name in names:
        if name not in coordinates:
            raise ValueError(f"'{path}' has no coordinate '{name}'{did_you_mean(name, sorted(coordinates))}")
    return {
        (names[pair[0]], names[pair[1]]): function
        for pair, function in functions.items()
        if pair[0] in names and pair[1] in names
    }
