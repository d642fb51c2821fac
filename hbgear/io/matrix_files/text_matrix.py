"""Matrices in text files, a row of numbers in each line, as spreadsheets and ``writematrix`` of MATLAB write them."""

from __future__ import annotations

import os

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.text.decoding import bytes_of_file
from hbgear.io.tables.table_text import decoded, number_of_cell, table_text, why_no_number

TEXT_SUFFIXES = (".csv", ".txt", ".dat")
"""Suffixes of files with the rows of a matrix as text."""


def read_text_matrix(path: str | os.PathLike[str]) -> Array:
    """Return the matrix (n, m) in a text file; separators, decimal commas and comments as in `table_text`.

    Raises
    ------
    ValueError
        If the file cannot be read, its rows have different lengths, or a cell is no number; the error states the line.
    """
    table = table_text(decoded(bytes_of_file(path, "a matrix"), str(path)), str(path))
    matrix = np.empty((len(table.rows), len(table.rows[0].cells)))
    for i, row in enumerate(table.rows):
        for j, cell in enumerate(row.cells):
            number = number_of_cell(cell)
            if number is None:
                raise ValueError(f"'{path}', line {row.line}: '{cell}' in column {j + 1} {why_no_number(cell)}")
            matrix[i, j] = number
    return matrix
