"""Linear modes of a model about its static state under mean loads.

    (K + i omega C + W k W^T) phi = omega^2 (1 + 2 i D) M phi,    k_j the stiffness of the laws at the static state

omega is the modal frequency and D the modal damping ratio. Damping need not be proportional.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.equations.static_state import static_states
from hbgear.harmonic.structure.linear_structure import dense
from hbgear.mechanics.laws.vector_laws import RadialClearance
from hbgear.mechanics.structures.modal_damping import modal_squares

STATIC_FREQUENCY = 0.7390851332151607
"""Frequency at which the static terms are evaluated, which do not depend on it. It is not a round number, so that it is
not a natural frequency of an undamped model."""

_UNMEASURED_RATIO = 1e-9
"""Displacement of the elements, relative to the largest of all modes, below which they do not measure a mode."""


class LinearMode(NamedTuple):
    """A linear mode about a static state.

    Attributes
    ----------
    omega : float
        Natural frequency.
    damping : float
        Modal damping ratio.
    shape : ndarray of complex, shape (m,)
        Displacements of the elements.
    rest : ndarray, shape (m,)
        Static displacements of the elements.
    partner : ndarray of complex, shape (m,), optional
        Of forward whirl of an isotropic rotor, backward whirl; of backward whirl, forward whirl.
    """

    omega: float
    damping: float
    shape: ComplexArray
    rest: Array
    partner: ComplexArray | None = None


def linear_mode(evaluator: Evaluator, number: int) -> LinearMode:
    """Return the mode of a number, counted from 1 in ascending frequency, about the static state under mean loads.

    Without a load that closes a gap the static state has no stiffness. The elements then have their reference
    stiffness, which is the limit of large motions with backlash.

    Raises
    ------
    ValueError
        If the structure has fewer modes that the elements measure.
    """
    supported = [state for state in static_states(evaluator, STATIC_FREQUENCY) if state.balanced and not state.flat]
    reference = np.zeros(evaluator.m), np.diag(evaluator.structure.kr)
    rest, stiffness = (supported[0].d, supported[0].stiffness) if supported else reference
    modes = _modes(evaluator, rest, stiffness)
    if number > len(modes):
        raise ValueError(
            f"mode = {number}: the elements measure {len(modes)} mode(s); give a number up to {len(modes)}"
        )
    mode = modes[number - 1]
    equal = [other for other in modes if _have_one_frequency(mode, other)]
    holes = [pair for pair, law in evaluator.vectors if isinstance(law, RadialClearance)]
    return _whirl(equal, mode is equal[0], holes) if len(equal) == 2 and holes else mode


def _have_one_frequency(a: LinearMode, b: LinearMode) -> bool:
    """Return whether two modes have the same frequency and damping."""
    return abs(a.omega - b.omega) + abs(a.damping - b.damping) <= _EQUAL_MODES * a.omega


def _modes(evaluator: Evaluator, rest: Array, stiffness: Array) -> list[LinearMode]:
    """Return the modes that the elements measure, in ascending frequency, without rigid-body and overdamped ones."""
    structure = evaluator.structure
    M, C, W = (np.asarray(dense(A)) for A in (structure.M, structure.C, structure.W))
    K, opened = np.asarray(dense(structure.K)), stiffness - np.diag(structure.kr)
    terms = np.abs(K) + np.abs(W) @ np.abs(opened) @ np.abs(W.T)
    K = K + W @ opened @ W.T
    vectors = _undamped_modes(0.5 * (M + M.T), 0.5 * (K + K.T))
    squares = modal_squares(0.5 * (K + K.T), vectors, 0.5 * (terms + terms.T))
    sizes = np.linalg.norm(W.T @ vectors, axis=0)
    modes: list[LinearMode] = []
    for r in np.flatnonzero(squares):
        if sizes[r] <= _UNMEASURED_RATIO * sizes.max():
            continue
        eigenvalue, v = _damped_mode(M, C, K, float(squares[r]), vectors[:, r])
        if eigenvalue.real <= 0 or abs(eigenvalue.imag) >= 2 * eigenvalue.real:
            continue
        omega, damping = float(np.sqrt(eigenvalue.real)), float(eigenvalue.imag / (2 * eigenvalue.real))
        shape = W.T @ v
        found = LinearMode(omega, damping, shape / np.linalg.norm(shape), rest)
        for mode in modes:
            if _have_one_frequency(found, mode):
                found = found._replace(shape=found.shape - mode.shape * (mode.shape.conj() @ found.shape))
        if (size := float(np.linalg.norm(found.shape))) > _SAME_SHAPE:
            modes.append(found._replace(shape=found.shape / size))
    return sorted(modes, key=lambda mode: mode.omega)


def _whirl(equal: list[LinearMode], forward: bool, holes: Sequence[Array]) -> LinearMode:
    """Return forward or backward whirl of shafts in round holes, from two modes of equal frequency.

    Planar motions of such a shaft have any direction, so they are not isolated, and friction turns them into whirl.
    """
    a, b = (mode.shape for mode in equal)
    turn = sum(float((np.conj(a[i]) * b[j] - np.conj(a[j]) * b[i]).real) for i, j in holes)
    sign = math.copysign(1.0, turn) * (1 if forward else -1)
    shapes = (a - 1j * sign * b) / math.sqrt(2), (a + 1j * sign * b) / math.sqrt(2)
    return equal[0]._replace(shape=shapes[0], partner=shapes[1])


_MASSLESS_RATIO = 1e-13
"""Eigenvalue of M with scaled coordinates, relative to the largest, that is zero."""


def _undamped_modes(M: Array, K: Array) -> Array:
    """Return the modes of K v = omega^2 M v by ascending frequency; motions without mass follow statically.

    With v = R a + N b, N the null space of M, the equations without mass give b = -(N^T K N)^-1 N^T K R a. A motion b
    without stiffness, as of a damper alone, is left at rest here and follows when the damping is added.
    """
    scale = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
    masses, motions = scipy.linalg.eigh(M / np.outer(scale, scale))
    zero = masses <= _MASSLESS_RATIO * masses[-1]
    R, N = motions[:, ~zero] / scale[:, None], motions[:, zero] / scale[:, None]
    # motions without mass follow the others statically
    T = R - N @ (np.linalg.pinv(N.T @ K @ N, hermitian=True) @ (N.T @ K @ R))
    return T @ scipy.linalg.eigh(R.T @ K @ T, np.diag(masses[~zero]))[1]


_DAMPING_STEPS = 10
"""Steps in which damping is added to an undamped mode, so that modes do not change places."""

_MODE_ITERATIONS = 6
"""Inverse iterations for each of these steps at most; the error falls at least tenfold with each."""

_SETTLED_CHANGE = 1e-13
"""Relative change of an eigenvalue below which the inverse iteration has converged."""

_EQUAL_MODES = 1e-6
"""Relative difference of frequency and damping below which two modes of one shape are the same."""

_SAME_SHAPE = 1e-3
"""Part of a shape that other modes of the frequency do not have, below which it is rounding."""


def _damped_mode(M: Array, C: Array, K: Array, square: float, v: Array) -> tuple[complex, ComplexArray]:
    """Return omega^2 (1 + 2 i D) and the shape of a mode of (K + i omega C) v = omega^2 (1 + 2 i D) M v.

    An undamped mode is corrected by inverse iteration while the damping grows from zero.
    """
    eigenvalue, u = complex(square), v.astype(complex)
    if not np.any(C):
        return eigenvalue, u
    for fraction in np.linspace(0.0, 1.0, _DAMPING_STEPS + 1)[1:]:
        for _ in range(_MODE_ITERATIONS):
            A = K + 1j * fraction * np.sqrt(max(eigenvalue.real, 0.0)) * C
            try:
                u = np.linalg.solve(A - eigenvalue * M, M @ u)
            except np.linalg.LinAlgError:
                break  # the eigenvalue is exact
            u, last = u / np.linalg.norm(u), eigenvalue
            eigenvalue = complex((u @ (A @ u)) / (u @ (M @ u)))
            if abs(eigenvalue - last) <= _SETTLED_CHANGE * abs(eigenvalue):
                break
    return eigenvalue, u * np.exp(-1j * np.angle(u[np.argmax(np.abs(u))]))
