"""What can be computed and is hardly meant: told as warnings, never refused.

Quantities in other units than the model's (r/min for Omega, micrometres for metres, percent for a ratio), matrices that
feed energy, models that nothing excites, contacts with too few harmonics to open and close.
"""

from __future__ import annotations

import sys
import warnings
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.common.ranges import Range
from hbgear.mechanics.models import Model, System

_FAR_ABOVE = 30.0  # Omega over the highest natural frequency that is hardly meant


_COARSE = 1  # harmonics of the excitation with which a contact cannot be told from a smooth spring


_LOOKED_AT = 400  # coordinates up to which the definiteness of matrices is looked at


_LARGE = 500  # coordinates from which the decomposition of a structure is waited for


_ROUNDING = 1e-9


class ImplausibleInputWarning(UserWarning):
    """Input that can be computed and is hardly meant.

    Examples
    --------
    >>> import hbgear as hb
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as said:
    ...     warnings.simplefilter("always")
    ...     curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (9000.0, 9000.1))
    ...
    >>> said[0].category is hb.mechanics.ImplausibleInputWarning
    True
    """


_FAR_APART = 1e-3  # error between the lines of measured receptances, over their highest peak


def warn(text: str) -> None:
    """Warn of it, at the line outside this package that led here."""
    level = 2
    while sys._getframe(level - 1).f_globals.get("__name__", "").startswith("hbgear."):
        level += 1
    warnings.warn(text, ImplausibleInputWarning, stacklevel=level)


def of_problem(model: Model, system: System, harmonics: int) -> None:
    """Warn of a model and a number of harmonics of the excitation, once when a problem is set up."""
    of_model(model, system)
    cornered = [e.name for e in system.elements if e.law.breakpoints]
    if harmonics <= _COARSE and cornered:
        warn(
            f"{harmonics} harmonic of the excitation cannot describe a contact that opens and closes "
            f"({', '.join(cornered)}): use 8 or more, or 'auto'"
        )


def of_size(system: System) -> None:
    """Warn of a structure so large that setting up its equations takes long, before that is done."""
    if system.n >= _LARGE:
        dense = " (give M, C and K as scipy.sparse matrices)" if isinstance(system.K, np.ndarray) else ""
        warn(
            f"{system.n} coordinates: setting up such a structure whole takes seconds to minutes, growing with their "
            f"cube; hb.mechanics.reduce(model).system{dense} is a small one with the same lowest modes"
        )


def of_model(model: Model, system: System) -> None:
    """Warn of fields far from usual values, of matrices and laws that feed energy, and where nothing is excited."""
    for name, usual in model.usual.items():
        _of_values(model, name, np.atleast_1d(np.asarray(getattr(model, name), dtype=float)), usual)
    _of_matrices(system)
    if system.receptances is not None and system.receptances.coarseness > _FAR_APART:
        warn(
            f"the lines of the receptances are far apart: between them they are known to some "
            f"{100 * system.receptances.coarseness:.2g} % of the highest peak; measure lines closer than a quarter of "
            "the width of the peaks"
        )
    for element in system.elements:
        springs = (spring for part in element.law.parts for spring in part.piecewise or ())
        if any(k.bound > 2 * k.mean and k.extremes()[0] < 0 for k in (spring.stiffness for spring in springs)):
            warn(f"the stiffness of {element.name} is negative over part of the period: see its amplitudes")
    if not _excited(system):
        warn(
            f"nothing excites this {type(model).__name__}: no load, prescribed displacement or stiffness varies with "
            "time, so it stays at rest"
        )


def _of_values(model: Model, name: str, values: Array, usual: Range) -> None:
    if any(float(value) not in usual for value in values):
        given = getattr(model, name)
        unit = model.labels.get(name, "").partition("[")[2].partition("]")[0].replace("$", "")
        warn(
            f"{type(model).__name__}: {name} = {given} is far from usual values ({usual.low:g} to {usual.high:g}); "
            f"is it in the right unit{f' ({unit})' if unit else ''}?"
        )


def _of_matrices(system: System) -> None:
    """Warn of masses and dampers that are not positive, and of couplings given on one side of the diagonal only."""
    for name, matrix in (("M", system.M), ("C", system.C), ("K", system.K)):
        A = matrix if isinstance(matrix, np.ndarray) else scipy.sparse.csr_array(matrix)
        there = abs(A) > _ROUNDING * abs(A).max()
        rows, columns = (there != there.T).nonzero()
        if len(rows):
            i, j = int(rows[0]), int(columns[0])
            warn(
                f"{name} couples {system.dof_names[i]} and {system.dof_names[j]} on one side of its diagonal only: "
                f"{name}[{i}, {j}] = {A[i, j]:g}, {name}[{j}, {i}] = {A[j, i]:g}"
            )
        if name == "K":
            continue
        diagonal = A.diagonal()
        least = float(diagonal.min())
        if system.n <= _LOOKED_AT:
            scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.abs(diagonal).max() or 1.0))
            twice = A + A.T
            dense = (twice if isinstance(twice, np.ndarray) else twice.toarray()) / 2 * np.outer(scale, scale)
            least = float(np.linalg.eigvalsh(dense)[0])
        if least < -_ROUNDING and name == "M":
            warn("M has a negative eigenvalue: a mass is negative; is a sign wrong?")
        elif least < -_ROUNDING and diagonal.max() <= 0 and not any(e.damping or e.law.rated for e in system.elements):
            warn(
                f"C has a negative eigenvalue ({float(diagonal.min()):.3g} on its diagonal) and nothing else damps: "
                "every disturbance grows; a stable motion needs dampers that take energy: change the sign of C"
            )
        elif least < -_ROUNDING:
            warn("C has a negative eigenvalue: a damper feeds energy to the motion; is a sign wrong?")


def _excited(system: System) -> bool:
    """Whether anything varies with tau, as far as can be told of the laws."""
    for element in system.elements:
        if element.displacement.varies or not element.law.steady:
            return True
    return any(np.any(v) for load in system.loads for v in [*load.cosine.values(), *load.sine.values()])


def of_frequency(structure: Any, Omega: float) -> None:
    """Warn of an Omega far above every natural frequency of a structure: it is a number of another unit."""
    if structure.modes is None or not structure.modes.poles.size:
        return
    highest = float(np.abs(structure.modes.poles).max())
    if Omega > _FAR_ABOVE * highest:
        warn(
            f"Omega = {Omega:g} is {Omega / highest:.0f} times the highest natural frequency ({highest:.4g}) of the "
            "model; Omega is an angular frequency in the model's unit of time: convert r/min or Hz to it"
        )


def of_gaps(names: tuple[str, ...], clearances: Array) -> None:
    """Warn of a curve on which no element comes near a corner of its law.

    clearances (P, c): signed distances of the lowest and the highest value of an element from each corner.
    """
    if clearances.size and clearances.shape[1] == len(names):
        nearest = int(np.argmin(np.abs(clearances).min(axis=0)))
        distance = float(np.abs(clearances[:, nearest]).min())
        low = nearest - nearest % 2
        if distance > 0.5 * float((clearances[:, low + 1] - clearances[:, low]).max()):
            warn(
                f"nothing ever comes near a corner of a law on this curve (nearest: {names[nearest]}, missed by "
                f"{distance:.3g}): all of it is linear; is the gap meant to be so far away?"
            )


def of_truncation(tolerance: float, H: int, parameter: str, values: Array, errors: Array) -> None:
    """Warn of points (P,) of a curve whose estimated errors are above the tolerance of automatic harmonics."""
    worst = int(np.argmax(errors))
    warn(
        f"automatic harmonics, up to H = {H}, leave {len(values)} points of the curve with an estimated error above "
        f"tolerance = {tolerance:g}: up to {errors[worst]:.1e}, at {parameter} = {values[worst]:.6g}; give a larger "
        "tolerance"
    )
