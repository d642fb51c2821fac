"""Linear structure of a system in the coordinates of the model: modes, receptances, free motions and constraints.

    D(w) = K + W kr W^T + i w (C + W c W^T) - w^2 M,      G(w) = W^T D(w)^-1 W = sum_r a_r b_r^T / (i w - lambda_r)

with the reference stiffness kr and the damping c of the elements. One eigendecomposition of the state matrix gives all
harmonics and their derivatives in omega without further solutions. Free motions (rigid-body motions r with W^T r = 0)
are removed first. A constant load that acts on a free motion raises an error, because no periodic motion exists.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.harmonic.structure.eigenmodes import (
    FREE_MOTION_TOLERANCE,
    MAX_EIGENVECTOR_CONDITION,
    Modes,
    modal_pairs,
    modes_of_states,
    null_space,
    real_shapes,
)
from hbgear.harmonic.structure.fixed_interface import FixedInterface, fixed_interface
from hbgear.harmonic.structure.massless import massless_modes
from hbgear.mechanics.models import System
from hbgear.mechanics.reference_stiffness import references
from hbgear.mechanics.structures.modal_damping import modal_squares

MODAL_LIMIT = 1500
"""Number of coordinates above which receptances are computed by direct solutions, not by eigendecomposition."""


_MAX_STACKED_COORDINATES = 100
"""Coordinates up to which the equations of all harmonics are solved in one call; larger ones need too much memory."""

_BALANCED_WORK_RATIO = 1e-8
"""Work of a constant load on a free motion, relative to the sum of its absolute terms, that counts as rounding."""

_BALANCED_WORK_BOUND = 1e-13
"""The same, relative to the largest work that a load of this size can do."""

_BACKWARD_ERROR = 32 * float(np.finfo(float).eps)
"""Backward error of a decomposition, relative to the norm of its matrix."""

_REAL_MODES_FROM = 30
"""Number of coordinates above which real modes are tried first, because they cost less."""

_DEPENDENT_DIRECTION_TOLERANCE = 1e-9
"""Relative residual of a direction up to which it counts as a combination of others."""

_REFERENCE_TRIALS = (
    (1.0, 0.0, 1e-10),
    (1.37, 0.0, 1e-10),
    (0.61, 0.0, 1e-10),
    (1.0, 0.0, FREE_MOTION_TOLERANCE),
    (1.37, 0.0, FREE_MOTION_TOLERANCE),
    (0.61, 0.0, FREE_MOTION_TOLERANCE),
    (1.0, 1e-10, FREE_MOTION_TOLERANCE),
)
"""Trials of `LinearStructure._add_reference_springs`: factor of the springs, disturbance, and zero singular value."""


_CANCELLATION_RATIO = 1e-5
"""Displacement of an element, relative to the sum of its absolute terms, above which the terms do not cancel."""

_DRIFT_WORK = 1e-9
"""Work of dampers on a free motion, relative to the largest possible, that counts as rounding."""

_MIN_DISPLACEMENT_RATIO = 1e-9
"""Displacement of an element in a unit motion, relative to the largest possible, that counts as rounding."""


class UnbalancedLoadError(ValueError):
    """A constant load acts on a free motion, so that no periodic motion exists."""


def dense(A: Any) -> Array:
    """Return a matrix, sparse or not, as an array."""
    return A if isinstance(A, np.ndarray) else A.toarray() if scipy.sparse.issparse(A) else np.asarray(A)


def _constraints(W: Array, kr: Array) -> tuple[np.ndarray, Array, Array]:
    """Return ``independent``, ``force_sums`` and ``compatibility`` of `LinearStructure` for directions W (n, m)."""
    m = W.shape[1]
    independent: list[int] = []
    force_sums, compatibility = np.eye(m), np.zeros((m, m))
    stiffness = float(kr.max(initial=0.0)) or 1.0  # scales the constraints to the size of forces
    for j in range(m):
        B = np.linalg.lstsq(W[:, independent], W[:, j], rcond=None)[0] if independent else np.empty(0)
        if not independent or norm(W[:, j] - W[:, independent] @ B) > _DEPENDENT_DIRECTION_TOLERANCE * norm(W[:, j]):
            independent.append(j)
            continue
        force_sums[independent, j], force_sums[j, j] = B, 0.0
        compatibility[j, independent], compatibility[j, j] = -stiffness * B, stiffness
    return np.array(independent), force_sums, compatibility


class LinearStructure:
    """M, C, K of a system with the reference springs and the dampers of its elements.

    Parameters
    ----------
    system : System
        System of coordinates, elements and loads.
    springs : array_like, shape (m,), optional
        Reference stiffness of the elements, by default from `references`.

    Attributes
    ----------
    independent : ndarray
        Numbers of the elements with linearly independent directions.
    force_sums, compatibility : ndarray, shape (m, m)
        Matrices of the constrained balance ``force_sums @ (Z d + g + f) + compatibility @ (d + e)``: sums of forces and
        conditions of compatible displacements; identity and zero if all directions are independent.

    Raises
    ------
    ValueError
        If coordinates without mass cannot be eliminated.
    UnbalancedLoadError
        If a constant load acts on a free motion.
    """

    depends_on_speed = False
    """Whether C and K depend on Omega, see `SpeedDependentStructure`."""

    highest: float = np.inf
    """The highest frequency at which receptances are known."""

    def __init__(self, system: System, springs: Array | None = None) -> None:
        if not np.isfinite(self.highest):
            system.check_matrices()
        self.system = system
        self.n, self.m = system.n, len(system.elements)
        self.W = system.W
        self.kr = references(system) if springs is None else springs
        self.c = np.array([e.damping for e in system.elements])
        self.independent, self.force_sums, self.compatibility = _constraints(self.W, self.kr)
        self.free = self.free_left = np.zeros((self.n, 0))
        self.large = self.n > MODAL_LIMIT
        if self.large:
            Ws, M, C, K = (scipy.sparse.csr_array(A) for A in (self.W, system.M, system.C, system.K))
            self.M, self.K = M, K + Ws @ scipy.sparse.diags_array(self.kr) @ Ws.T
            self.C = C + Ws @ scipy.sparse.diags_array(self.c) @ Ws.T
            self.modes: Modes | None = None
            self.disturbed = False
            return
        self.M = dense(system.M)
        self.C = dense(system.C) + (self.W * self.c) @ self.W.T
        # scaled by the masses, the test for free motions compares frequencies in any units of the coordinates
        diagonal = np.abs(np.diag(self.M))
        self._scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, diagonal.max(initial=1.0) or 1.0))
        self._add_reference_springs(system)

    def _add_reference_springs(self, system: System) -> None:
        """Add the reference springs to K and compute the modes.

        With some reference springs two poles coincide and the eigenvectors become dependent, or a negative K becomes
        singular. Other springs give other poles and the same receptance, so several factors are tried. If no factor
        helps, the state matrix is disturbed by 1e-10 to separate the poles.
        """
        references = self.kr
        modes = self._real_modes(system) if self.n > _REAL_MODES_FROM and not system.massless else None
        if modes is not None:
            self.modes, self.disturbed = modes, False
            return
        for factor, disturbance, tolerance in _REFERENCE_TRIALS:
            self.kr = factor * references
            self.K = dense(system.K) + (self.W * self.kr) @ self.W.T
            if self._has_supported_free_motion(system, tolerance):
                continue
            self.free = self._null(self.K)
            self.free_left = self.free if np.array_equal(self.K, self.K.T) else self._null(self.K.T)
            self.check_balance(system)
            modes = self._decompose(disturbance)
            if modes.condition < MAX_EIGENVECTOR_CONDITION:
                break
        if modes is None:  # laws without stiffness leave a free motion
            raise ValueError(_describe_unsupported(self))
        self.modes, self.disturbed = modes, disturbance > 0

    def _has_supported_free_motion(self, system: System, tolerance: float) -> bool:
        """Return whether K has a free motion r with displacements of elements, K r = 0 and W^T r != 0.

        tolerance : singular value of K, relative to the sum of its absolute terms, that counts as zero.
        """
        s, W = self._scale, np.abs(self.W)
        rounding = _MIN_DISPLACEMENT_RATIO * norms(W.T * s)[:, None]
        terms = (np.abs(dense(system.K)) + (W * self.kr) @ W.T) * np.outer(s, s)
        threshold = tolerance * float(terms.sum(axis=1).max())
        for K in (self.K,) if np.array_equal(self.K, self.K.T) else (self.K, self.K.T):
            self.free = s[:, None] * null_space(K * np.outer(s, s), threshold)
            measured = np.abs(self.W.T @ self.free)
            if ((measured > _CANCELLATION_RATIO * (W.T @ np.abs(self.free))) & (measured > rounding)).any():
                return True
        return False

    def _real_modes(self, system: System) -> Modes | None:
        """Return the modes of a symmetric structure with modal damping, from its real modes at a lower cost.

            K phi = w^2 M phi,   phi^T C phi = 2 delta,   poles = -delta +- sqrt(delta^2 - w^2)

        The reference springs are left out if the damping is modal only without them. None if the damping is not modal,
        or if there is a free motion.
        """
        references, s = self.kr, self._scale
        M, C = (A * np.outer(s, s) for A in (self.M, self.C))
        # damping in proportion to K is modal only without the reference springs
        for factor in (1.0, 0.0):
            kr = factor * references
            K = dense(system.K) + (self.W * kr) @ self.W.T
            A = K * np.outer(s, s)
            if not all(np.array_equal(x, x.T) for x in (M, C, A)):
                return None
            squares, V = real_shapes(M, A)
            pairs = modal_pairs(V.T @ C @ V, squares, s[:, None] * V) if squares.all() else None
            if pairs is None:
                continue
            self.kr, self.K = kr, K
            poles, right, left, condition = pairs
            return Modes(poles, right, left, self.W.T @ right, left @ self.W, condition)
        return None

    @property
    def constrained(self) -> bool:
        """Whether directions of elements are linearly dependent."""
        return len(self.independent) < self.m

    @property
    def dependent(self) -> np.ndarray:
        """Numbers of the elements whose directions are combinations of those of independent elements."""
        return np.setdiff1d(np.arange(self.m), self.independent)

    @property
    def accurate_modes(self) -> bool:
        """Whether receptances are computed from the modes, in kernels."""
        return self.modes is not None and self.modes.condition < MAX_EIGENVECTOR_CONDITION and not self.disturbed

    @cached_property
    def fixed_interface(self) -> FixedInterface | None:
        """Dynamic stiffness from the modes with fixed elements; None if these modes are not accurate."""
        W, free = self.W[:, self.independent], max(self.free.shape[1], self.free_left.shape[1])
        return fixed_interface(self.system, (self.M, self.C, self.K), W, self.bases(), free)

    def _null(self, A: Array) -> Array:
        """Return the null space of a matrix of the coordinates, scaled by the masses."""
        return self._scale[:, None] * null_space(A * np.outer(self._scale, self._scale))

    def check_balance(self, system: System) -> None:
        """Raise an error if a constant load of a system with these matrices acts on a free motion."""
        for load in system.loads if self.free_left.shape[1] else ():
            if load.constant is None:
                continue
            for r in self.free_left.T:
                work = r * np.asarray(load.constant)
                largest = np.linalg.norm(r / self._scale) * np.linalg.norm(self._scale * np.asarray(load.constant))
                rounding = max(_BALANCED_WORK_RATIO * np.abs(work).sum(), _BALANCED_WORK_BOUND * largest)
                if abs(work.sum()) > rounding and abs(work.sum()) > self._rounding(r, np.asarray(load.constant)):
                    raise UnbalancedLoadError(self._describe_unbalance(r, float(work.sum())))

    def _rounding(self, r: Array, F: Array) -> float:
        """Return the work of a balanced load F on a computed free motion r that rounding explains.

        K r = 0 holds to eps |K| |r|. An error E of K changes r by -K^+ E r, and the work by (K^+ F)^T E r.
        """
        s = self._scale
        A = self.K * np.outer(s, s)
        static = scipy.linalg.pinv(A.T, rtol=FREE_MOTION_TOLERANCE) @ (s * F)
        return _BACKWARD_ERROR * float(np.linalg.norm(A) * np.linalg.norm(static) * np.linalg.norm(r / s))

    def _describe_unbalance(self, r: Array, work: float) -> str:
        """Return the error message for a load that does work on a free motion r."""
        return (
            f"the constant load does work {work:.3g} on a motion that nothing holds ({_motion_text(self, r)}); "
            "a periodic motion needs it balanced: correct the load or support that motion"
        )

    def _decompose(self, disturbance: float) -> Modes:
        """Return the eigendecomposition of the state matrix without the undamped free motions.

        disturbance : relative disturbance that separates coincident poles.
        """
        M, K, C = self.M, self.K, self.C
        B, T = self.bases()
        has_free = B.shape[1] < self.n
        if self.system.massless:
            poles, q, forces, condition = massless_modes(self.system, M, C, K, B, T)
            return Modes(poles, q, forces, self.W.T @ q, forces @ self.W, condition)
        if not has_free and self.n > _REAL_MODES_FROM and np.array_equal(M, M.T) and np.array_equal(K, K.T):
            squares, shapes = real_shapes(
                M * np.outer(self._scale, self._scale), K * np.outer(self._scale, self._scale)
            )
            if squares.all():  # with states of equal size the lowest modes of a fine mesh are accurate
                T, w = self._scale[:, None] * shapes, np.sqrt(squares)
                return modes_of_states(T.T @ C @ T, np.diag(w), np.diag(w), T / w, T.T, self.W, disturbance)
        Mi = np.linalg.inv(T.T @ M @ B)
        K, C = Mi @ T.T @ K @ B, Mi @ T.T @ C @ B
        frequency_scale = np.sqrt(np.abs(K).max()) or 1.0  # makes the states independent of the unit of time
        Z = None if has_free else _without_drift(self, frequency_scale)
        drifts = max(self.free.shape[1], self.free_left.shape[1]) - (self.n - B.shape[1])
        return modes_of_states(
            C,
            frequency_scale * np.eye(B.shape[1]),
            K / frequency_scale,
            B,
            Mi @ T.T / frequency_scale,
            self.W,
            disturbance,
            Z,
            drifts,
        )

    def bases(self) -> tuple[Array, Array]:
        """Return bases (n, p) of the coordinates and of their equations, scaled, without undamped free motions."""
        free, free_left = self._undamped(self.free, self.C), self._undamped(self.free_left, self.C.T)
        if not free.shape[1]:
            return np.diag(self._scale), np.diag(self._scale)
        B = self._scale[:, None] * null_space((free_left.T @ self.M) * self._scale)
        return B, self._scale[:, None] * null_space((free.T @ self.M.T) * self._scale)

    def _undamped(self, free: Array, C: Array) -> Array:
        """Return the free motions that no damper acts on."""
        if not free.shape[1] or not np.any(C):
            return free
        measured = (C @ free) * self._scale[:, None] / (np.abs(C) * np.outer(self._scale, self._scale)).max()
        _, s, vt = scipy.linalg.svd(measured / np.linalg.norm(free / self._scale[:, None], axis=0))
        is_damped = np.concatenate([s, np.zeros(vt.shape[0] - s.size)]) > 1e-9
        return free @ vt[~is_damped].T

    def solve(self, w: float, rhs: ComplexArray) -> ComplexArray:
        """Return D(w)^-1 rhs; at w = 0 the solution without free motion."""
        if self.large:
            x = scipy.sparse.linalg.splu((self.K + 1j * w * self.C - w**2 * self.M).tocsc()).solve(rhs.astype(complex))
        elif w == 0.0:
            x = flexibility(self.K, self._scale) @ rhs
        else:
            x = scipy.linalg.solve(self.K + 1j * w * self.C - w**2 * self.M, rhs)
        return x

    def solve_all(self, w: Array, F: ComplexArray) -> ComplexArray:
        """Return D(w)^-1 F for F (K, n, c) at frequencies w (K,); see `solve`."""
        if self.large or self.n > _MAX_STACKED_COORDINATES:
            return np.array([self.solve(wk, Fk) for wk, Fk in zip(w, F, strict=True)])
        moving = w != 0.0
        Q, w_moving = np.zeros(F.shape, dtype=complex), w[moving][:, None, None]
        if not moving.all():
            Q[~moving] = flexibility(self.K, self._scale) @ F[~moving]
        Q[moving] = np.linalg.solve(self.K + 1j * w_moving * self.C - w_moving**2 * self.M, F[moving])
        return Q

    def at(self, Omega: float) -> LinearStructure:
        """Return the structure at a frequency of the excitation, with its modes: itself without speed terms."""
        return self

    def receptances(self, Omega: float, ratio: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return G and dG/dOmega, (P, m, m) each, at frequencies Omega ratio (P,)."""
        return self.response(Omega, ratio, self.W)

    def transfer(self, s: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return G and dG/ds (P, m, m) at exponents s (P,).

        Raises
        ------
        ValueError
            If an exponent is a pole, or the structure has no modes.
        """
        if self.modes is None:
            raise ValueError("Hill's determinant needs the modes of the structure, which is too large for them")
        distance = s[:, None] - self.modes.poles
        if not distance.all():
            raise ValueError("the exponent is that of a mode that no gap changes: the motion is linear there")
        inverse = 1.0 / distance
        out, in_ = self.modes.output, self.modes.input
        return (
            np.einsum("ir,kr,rj->kij", out, inverse, in_, optimize=True),
            np.einsum("ir,kr,rj->kij", out, -np.square(inverse), in_, optimize=True),
        )

    def response(self, Omega: float, ratio: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return W^T D^-1 F and its derivative in Omega, (P, m, c), of F (n, c) at frequencies Omega ratio (P,)."""
        Q, dQ = self._direct(Omega * ratio, np.broadcast_to(F, (len(ratio), *F.shape)))
        return self.W.T @ Q, (self.W.T @ dQ) * ratio[:, None, None]

    def _direct(self, w: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return D(w)^-1 F and its derivative in w for F (K, n, c), by direct solutions."""
        Q, moving = self.solve_all(w, F), w != 0.0
        if self.large or self.n > _MAX_STACKED_COORDINATES:
            dQ = np.array(
                [
                    -self.solve(wk, 1j * (self.C @ Qk) - 2 * wk * (self.M @ Qk)) if wk else 0 * Qk
                    for wk, Qk in zip(w, Q, strict=True)
                ]
            )
            return Q, dQ
        dQ, v, x = np.zeros(F.shape, dtype=complex), w[moving], Q[moving]
        dQ[moving] = -self.solve_all(v, 1j * (self.C @ x) - 2 * v[:, None, None] * (self.M @ x))
        return Q, dQ


def flexibility(K: Array, scale: Array) -> Array:
    """Return the pseudoinverse of K; rounding of coordinates is compared in units of ``scale`` (n,)."""
    inverse = scipy.linalg.pinv(K * np.outer(scale, scale), rtol=FREE_MOTION_TOLERANCE)
    return scale[:, None] * inverse * scale


def _without_drift(structure: LinearStructure, frequency_scale: float) -> Array | None:
    """Return a basis of the states without free motions and their momentum.

    The states are (q, q'/frequency_scale), scaled by the masses. The basis is None if there are no free motions, or if
    dampers act on them.

    Gyroscopic forces may act on a free motion r, K r = 0, without doing work, l^T C r = 0 with l^T K = 0. Then
    l^T (M q' + C q) is constant, and r is a drift that no element measures: the pole zero is double.
    """
    s, C, free, left = structure._scale, structure.C, structure.free, structure.free_left
    if not free.shape[1] or free.shape != left.shape:
        return None
    r = free / s[:, None]
    work = left.T @ C @ free
    largest = np.abs(s[:, None] * C * s).max() * np.linalg.norm(r) * np.linalg.norm(left / s[:, None])
    if np.abs(work).max() > _DRIFT_WORK * largest:
        return None
    momentum = np.hstack([left.T @ C * s, frequency_scale * (left.T @ structure.M * s)])
    momentum /= np.linalg.norm(momentum, axis=1, keepdims=True)
    return null_space(np.vstack([momentum, np.hstack([r.T, 0 * r.T])]))


def _describe_unsupported(structure: LinearStructure) -> str:
    """Return the error message for an element that no stiffness holds, or one below the rounding of a fine mesh."""
    measured = np.abs(structure.W.T @ structure.free)
    element, motion = np.unravel_index(int(np.argmax(measured)), measured.shape)
    name, r = structure.system.elements[int(element)].name, structure.free[:, motion]
    if modal_squares(structure.K, r[:, None], np.abs(structure.K))[0] > 0:
        return (
            f"element '{name}' measures a motion whose stiffness over mass is below {FREE_MOTION_TOLERANCE} of the "
            f"largest, too small to be computed with all {structure.n} coordinates; reduce the model first: "
            "hb.mechanics.reduce(system, modes).system"
        )
    return (
        f"element '{name}' measures a motion that no stiffness holds ({_motion_text(structure, r)}): its mean is "
        "arbitrary; give the law a stiffness, or support that motion in K"
    )


def _motion_text(structure: LinearStructure, r: Array) -> str:
    """Return the largest coordinates of a motion (n,) as text."""
    r = r / r[np.argmax(np.abs(r))]
    order = np.argsort(-np.abs(r))[:6]
    return ", ".join(f"{structure.system.dof_names[i]} = {r[i]:.3g}" for i in order if abs(r[i]) > 1e-6)
