"""Measured amplitudes from a table: a column of the frequency or speed, and one of the amplitude."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.messages import quoted
from hbgear.harmonic.speeds import MESH, PINION

_UNITS = {"r/min": PINION, "rpm": PINION, "hz": MESH}


def rows_of(text: str) -> list[tuple[int, list[str]]]:
    r"""Number and cells of each line of a table: all but empty ones and those with #.

    Cells are parted by what the last line has of semicolons, tabs or commas, in this order, or else by spaces.

    Examples
    --------
    >>> rows_of("# of May\n600; 0.1\n\n1200; 0.3")
    [(2, ['600', ' 0.1']), (4, ['1200', ' 0.3'])]
    """
    every = enumerate(text.lstrip("\ufeff").splitlines(), 1)
    lines = [(i, line) for i, line in every if line.strip() and not line.lstrip().startswith("#")]
    mark = next((mark for mark in ";\t," if lines and mark in lines[-1][1]), None)
    return [(i, next(csv.reader([line], delimiter=mark)) if mark else line.split()) for i, line in lines]


def measured(text: str, name: str, scales: Mapping[str, float]) -> tuple[Array, Array]:
    r"""Values of the parameter, and amplitudes in the units of the model.

    Parameters
    ----------
    text : rows of two numbers, separated by commas, semicolons, tabs or spaces; lines with # are left out. A first line
        may name the columns: a first one in [Hz] or [r/min] is turned into Omega.
    name : of the file, for errors.
    scales : Hz and r/min at Omega = 1; see `hbgear.harmonic.speeds`.

    Raises
    ------
    ValueError
        If it is no such table, or its frequencies cannot be turned into Omega.

    Examples
    --------
    >>> measured("speed [r/min], x\n600, 0.1\n1200, 0.3", "run.csv", {PINION: 600.0})[0]
    array([1., 2.])
    """
    rows = [cells for _, cells in rows_of(text)]
    head = rows.pop(0)[0] if rows and not _numbers(rows[0]) else ""
    numbers = [_numbers(row) for row in rows]
    wrong = next((rows[i] for i, pair in enumerate(numbers) if pair is None), None)
    if wrong is not None or not numbers:
        what = "it has no rows" if wrong is None else f"a row is {quoted(','.join(wrong))}"
        raise ValueError(f"'{name}' cannot be read as measured points: {what}; need rows of two numbers")
    x, y = np.array(numbers, dtype=float).T
    unit = re.search(r"\[([^\]]*)\]", head)
    scale = _UNITS.get(unit[1].strip().lower()) if unit else None
    if scale is not None and scale not in scales:
        raise ValueError(f"'{name}' is in {unit[1] if unit else ''}, and the model does not know its units; give Omega")
    return (x / scales[scale] if scale else x), y


def _numbers(row: list[str]) -> tuple[float, float] | None:
    """The first two finite numbers of a row."""
    try:
        pair = float(row[0]), float(row[1])
    except (ValueError, IndexError):
        return None
    return pair if all(map(math.isfinite, pair)) else None
