"""Plausibility checks: inputs that are valid but probably mistaken raise a warning; nothing is rejected.

Checked are quantities in other units than those of the model (r/min for Omega, micrometres for metres, percent for a
ratio), matrices that add energy, models without excitation, and contacts with too few harmonics to open and close.
"""

from __future__ import annotations

import sys
import warnings
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.common.ranges import Range
from hbgear.common.text.symbols import shown_unit
from hbgear.mechanics.models import Model, System

_MAX_FREQUENCY_RATIO = 30.0
"""Ratio of Omega to the highest natural frequency [-] above which Omega is probably in another unit."""

_TOO_FEW_HARMONICS = 1
"""Number of harmonics of the excitation with which the balance cannot distinguish a contact from a smooth spring."""

_MAX_EIGENVALUE_SIZE = 400
"""Number of coordinates up to which the definiteness of matrices is checked by their eigenvalues; above it only the
diagonal is checked, because eigenvalues would take longer than the set-up of the problem."""

_LARGE_SYSTEM_SIZE = 500
"""Number of coordinates from which the modal decomposition of a structure takes noticeably long."""

_MATRIX_TOLERANCE = 1e-9
"""Relative size of matrix entries and eigenvalues [-] that counts as rounding."""

_MAX_LINE_ERROR = 1e-3
"""Interpolation error between the lines of measured receptances, relative to their highest peak [-]."""


class ImplausibleInputWarning(UserWarning):
    """Warning about an input that is valid but probably mistaken.

    Examples
    --------
    >>> import hbgear as hb
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (9000.0, 9000.1))
    ...
    >>> caught[0].category is hb.mechanics.ImplausibleInputWarning
    True
    """


def warn(text: str) -> None:
    """Issue an `ImplausibleInputWarning` at the line outside this package that led here."""
    level = 2
    while sys._getframe(level - 1).f_globals.get("__name__", "").startswith("hbgear."):
        level += 1
    warnings.warn(text, ImplausibleInputWarning, stacklevel=level)


def check_problem(model: Model, system: System, harmonics: int) -> None:
    """Warn of a model, and of too few harmonics of the excitation, once when a problem is set up."""
    check_model(model, system)
    nonsmooth = [e.name for e in system.elements if e.law.breakpoints]
    if harmonics <= _TOO_FEW_HARMONICS and nonsmooth:
        warn(
            f"{harmonics} harmonic of the excitation cannot represent a contact that opens and closes "
            f"({', '.join(nonsmooth)}): use 8 or more, or 'auto'"
        )


def check_size(system: System) -> None:
    """Warn of a structure whose equations take long to set up, before that is done."""
    if system.n >= _LARGE_SYSTEM_SIZE:
        dense = " (give M, C and K as scipy.sparse matrices)" if isinstance(system.K, np.ndarray) else ""
        warn(
            f"{system.n} coordinates: setting up the full structure takes seconds to minutes, growing with their "
            f"cube; hb.mechanics.reduce(model).system{dense} is a small system with the same lowest modes"
        )


def check_model(model: Model, system: System) -> None:
    """Warn of unusual field values, of matrices and laws that add energy, and of a model without excitation."""
    for name, usual in model.usual.items():
        _check_values(model, name, np.atleast_1d(np.asarray(getattr(model, name), dtype=float)), usual)
    _check_matrices(system)
    if system.receptances is not None and system.receptances.coarseness > _MAX_LINE_ERROR:
        warn(
            f"the lines of the receptances are far apart: the interpolation error between them is about "
            f"{100 * system.receptances.coarseness:.2g} % of the highest peak; measure lines closer than a quarter of "
            "the width of the peaks"
        )
    for element in system.elements:
        springs = (spring for part in element.law.parts for spring in part.piecewise or ())
        if any(k.bound > 2 * k.mean and k.extremes()[0] < 0 for k in (spring.stiffness for spring in springs)):
            warn(f"the stiffness of {element.name} is negative over part of the period: see its amplitudes")
    if not _is_excited(system):
        warn(
            f"nothing excites this {type(model).__name__}: no load, prescribed displacement or stiffness varies with "
            "time, so it stays at rest"
        )


def _check_values(model: Model, name: str, values: Array, usual: Range) -> None:
    """Warn of values of a field outside their usual range."""
    if any(float(value) not in usual for value in values):
        field = getattr(model, name)
        unit = shown_unit(model.labels.get(name, ""))
        warn(
            f"{type(model).__name__}: {name} = {field} is far from usual values ({usual.low:g} to {usual.high:g}); "
            f"is it in the right unit{f' ({unit})' if unit else ''}?"
        )


def _check_matrices(system: System) -> None:
    """Warn of indefinite mass and damping matrices, and of couplings on one side of the diagonal only."""
    for name, matrix in (("M", system.M), ("C", system.C), ("K", system.K)):
        A = matrix if isinstance(matrix, np.ndarray) else scipy.sparse.csr_array(matrix)
        nonzero = abs(A) > _MATRIX_TOLERANCE * abs(A).max()
        rows, columns = (nonzero != nonzero.T).nonzero()
        if len(rows):
            i, j = int(rows[0]), int(columns[0])
            warn(
                f"{name} couples {system.dof_names[i]} and {system.dof_names[j]} on one side of its diagonal only: "
                f"{name}[{i}, {j}] = {A[i, j]:g}, {name}[{j}, {i}] = {A[j, i]:g}"
            )
        if name == "K":
            continue
        diagonal = A.diagonal()
        smallest = float(diagonal.min())
        if system.n <= _MAX_EIGENVALUE_SIZE:
            scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, np.abs(diagonal).max() or 1.0))
            doubled = A + A.T
            dense = (doubled if isinstance(doubled, np.ndarray) else doubled.toarray()) / 2 * np.outer(scale, scale)
            smallest = float(np.linalg.eigvalsh(dense)[0])
        if smallest < -_MATRIX_TOLERANCE and name == "M":
            warn("M has a negative eigenvalue: a mass is negative; is a sign wrong?")
        elif (
            smallest < -_MATRIX_TOLERANCE
            and diagonal.max() <= 0
            and not any(e.damping or e.law.rated for e in system.elements)
        ):
            warn(
                f"C has a negative eigenvalue ({float(diagonal.min()):.3g} on its diagonal) and nothing else damps: "
                "every disturbance grows; a stable motion needs dampers that dissipate energy: change the sign of C"
            )
        elif smallest < -_MATRIX_TOLERANCE:
            warn("C has a negative eigenvalue: a damper feeds energy to the motion; is a sign wrong?")


def _is_excited(system: System) -> bool:
    """Return whether anything varies with tau, as far as the laws state it."""
    for element in system.elements:
        if element.displacement.varies or not element.law.steady:
            return True
    return any(np.any(v) for load in system.loads for v in [*load.cosine.values(), *load.sine.values()])


def check_frequency(structure: Any, Omega: float) -> None:
    """Warn of an Omega far above every natural frequency of a structure, which is probably in another unit."""
    if structure.modes is None or not structure.modes.poles.size:
        return
    highest = float(np.abs(structure.modes.poles).max())
    if Omega > _MAX_FREQUENCY_RATIO * highest:
        warn(
            f"Omega = {Omega:g} is {Omega / highest:.4g} times the highest natural frequency ({highest:.4g}) of the "
            "model; Omega is an angular frequency in the model's unit of time: convert r/min or Hz to it"
        )


def check_gaps(names: tuple[str, ...], clearances: Array) -> None:
    """Warn of a branch on which no element comes near a breakpoint of its law.

    The signed distances (P, c) of extrema from breakpoints have names (c,) for the message.
    """
    if clearances.size and clearances.shape[1] == len(names):
        nearest = int(np.argmin(np.abs(clearances).min(axis=0)))
        distance = float(np.abs(clearances[:, nearest]).min())
        low = nearest - nearest % 2
        if distance > 0.5 * float((clearances[:, low + 1] - clearances[:, low]).max()):
            warn(
                f"no element comes near a breakpoint of its law on this curve (nearest: {names[nearest]}, distance "
                f"{distance:.3g}): its law acts as a linear spring; check the size of the gap and its unit"
            )


def check_sliders(names: tuple[str, ...], margins: Array) -> None:
    """Warn of a branch on which no friction slider slips.

    The margins (P, Q) are ranges of displacements minus those in which sliders stick.
    """
    if margins.size and not (margins > 0).any():
        nearest = int(np.argmax(margins.max(axis=0)))
        warn(
            f"no friction slider slips on this curve (nearest: {names[nearest]}, whose displacement lacks a range of "
            f"{-float(margins[:, nearest].max()):.3g}): friction acts as a spring; check the limits and their units"
        )


def check_truncation(tolerance: float, H: int, parameter: str, values: Array, errors: Array) -> None:
    """Warn of points whose estimated errors (P,) exceed the tolerance of automatic harmonics."""
    worst = int(np.argmax(errors))
    count = f"{len(values)} points" if len(values) > 1 else "a point"
    warn(
        f"automatic harmonics, up to H = {H}, leave {count} of the curve with an estimated error above "
        f"tolerance = {tolerance:g}: up to {errors[worst]:.1e}, at {parameter} = {values[worst]:.6g}; give a larger "
        "tolerance"
    )
