"""A large structure by its lowest modes and residual flexibility.

    q = B p,   B = [phi_1 ... phi_r,  R],   R = (K + alpha M)^-1 [W, F_0, F_1, ...]

with the lowest modes of K phi = w^2 M phi (undamped, the elements' reference springs closed) and the static responses R
to the directions of the elements and the vectors of the loads, which carry the flexibility of all modes left out. The
matrices of the reduced system are B^T M B, B^T C B, B^T K B (Galerkin), its directions and loads B^T w, B^T F: it is a
`System` like any other, small and dense, with stability and all. Left out are motions of the structure above the last
mode that go beyond a static response; `Reduction.error` measures what that costs at the frequencies of interest.

Time and memory are those of one sparse factorisation; every product after that is linear in the number of coordinates.

References
----------
MacNeal (1971), Computers & Structures 1, 581-601 (residual flexibility); Rubin (1975), AIAA J. 13(8), 995-1006.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.mechanics.models import Load, Model, System
from hbgear.mechanics.reference_stiffness import references


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced system and the way back.

    Parameters
    ----------
    system : `System`, the reduced one: trace it like any other.
    full : the `System` it stands for.
    basis : (n, r) B, orthonormal in M.
    frequencies : (modes,) angular frequencies of the modes kept; those left out lie above the last.
    flexibility : (m, m) static flexibility between the elements of all modes left out, sum phi phi^T / w^2.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> n = 30
    >>> K = n * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    >>> stop = hb.Element(np.eye(n)[n // 2], hb.Unilateral(k=0.5, gap=1.0))
    >>> chain = hb.System(np.eye(n) / n, 0.001 * K, K, [stop], hb.Load(cosine={1: np.eye(n)[n // 2]}))
    >>> small = hb.mechanics.reduce(chain, modes=8)
    >>> small.basis.shape[0], bool(small.error([1.0]).max() < 1e-3)
    (30, True)
    """

    system: System
    full: System
    basis: Array
    frequencies: Array
    flexibility: Array

    def modulation(self, swing: Any = None) -> float:
        """Bound mu on the share of its own stiffness by which the elements can modulate a mode left out.

            mu = largest eigenvalue of s^1/2 Phi s^1/2,   Phi the flexibility of the modes left out, s the swings

        The multipliers of the reduced system tell the stability of the kept modes. A mode left out, with frequency w
        and damping ratio zeta, obeys x'' + 2 zeta w x' + (w^2 + kappa(t)) x = 0 with |kappa| <= mu w^2. The energy of
        exp(zeta w t) x grows at most with the rate mu w / sqrt(1 - zeta^2), so that its multipliers over a time T obey

            |multiplier| <= exp((mu / (2 sqrt(1 - zeta^2)) - zeta) w T)

        and it is stable by itself if zeta > mu / 2, nearly.

        Parameters
        ----------
        swing : (m,) largest |dp/dd - k| of each element over the motion, k its reference stiffness; by default k,
            that of a contact that opens and closes.

        Raises
        ------
        ValueError
            If there is not one swing for each element, or one is negative.
        """
        m = len(self.full.elements)
        reference = references(self.full)
        s = reference if swing is None else np.atleast_1d(np.asarray(swing, dtype=float))
        if s.shape != (m,) or not np.all(s >= 0):
            raise ValueError(f"swing = {swing!r}: need {m} stiffnesses, one for each element, none negative")
        return float(np.linalg.eigvalsh(np.sqrt(np.outer(s, s)) * self.flexibility)[-1])

    def motion(self, p: Array) -> Array:
        """Coordinates (n, ...) of the full system from those of the reduced one (r, ...): q = B p."""
        return self.basis @ p

    def error(self, frequencies: Any, Omega: float | None = None) -> Array:
        """Error of the receptance between the elements, relative, at angular frequencies w (K,).

            |G_reduced(w) - G(w)| / |G(w)|,   G(w) = W^T (K_r + i w C_r - w^2 M)^-1 W

        with reference springs and dampers of the elements closed (K_r, C_r), by a direct solution each. Of a structure
        that depends on speed C and K are those at Omega, which must then be given.
        """
        if self.full.speed is not None and Omega is None:
            raise ValueError("the structure depends on speed: give Omega=..., the frequency of the excitation")
        return self._error(np.atleast_1d(np.asarray(frequencies, dtype=float)), self.full.W, Omega)

    def _error(self, w: Array, F: Array, Omega: float | None = None) -> Array:
        """The same of the response to each of the forces F (n, c), relative to the largest at a frequency."""
        M, C, K = _closed(self.full, Omega)
        reduced = [self.basis.T @ (A @ self.basis) for A in (K, C, M)]
        out = []
        for wk in w:
            factors = 1.0, 1j * wk, -(wk**2)
            D = sum((a * A for a, A in zip(factors, (K, C, M), strict=True)), 0 * M)
            G = self.full.W.T @ _factored(D, 0.1).solve(F.astype(complex))
            near = sum((a * A for a, A in zip(factors, reduced, strict=True)), 0 * reduced[0])
            wrong = (self.basis.T @ self.full.W).T @ scipy.linalg.solve(near, self.basis.T @ F) - G
            out.append((np.abs(wrong).max(axis=0) / np.abs(G).max(axis=0)).max())
        return np.array(out)


_MODES = (32, 64, 128, 256)  # kept modes that are tried


_CORRECTIONS = 4  # responses to each force that are kept beside them


_EXACT = 1e-9  # error of receptances that leaves a curve what it is


def reduced_within(system: System, highest: float) -> tuple[Reduction, float] | None:
    """A reduction whose receptances are exact to 1e-9 up to an angular frequency, and how exact; None if there is none.

    It is exact if few modes lie below that frequency, and tried with up to 256.
    """
    F = _forces(system)
    w = highest * np.array([1.0, 0.75, 0.5, 0.25])
    for modes in _MODES:
        if 2 * modes > system.n:
            break
        found = reduce(system, modes, corrections=_CORRECTIONS)
        if found.frequencies[-1] > highest:
            error = float(found._error(w, F).max())
            if error <= _EXACT:
                return found, error
    return None


def _forces(system: System) -> Array:
    """Directions of the elements and vectors of the loads, (n, c)."""
    return np.column_stack([system.W, *(v for load in system.loads for v in load.vectors())])


@checked_arguments()
def reduce(model: Model, modes: int = 40, Omega: float | None = None, corrections: int = 1) -> Reduction:
    """Reduce a model with many coordinates.

    Of a structure that depends on speed all terms are projected; it still does.

    Parameters
    ----------
    model : any `Model`; M, C and K should be sparse if they are large. M must be symmetric and positive definite. Modes
        are those of the symmetric part of K; C and K themselves may be unsymmetric.
    modes : how many of the lowest modes are kept, 1 <= modes < n. Three times the highest frequency that matters is a
        good reach for them; `Reduction.error` says how good.
    Omega : frequency whose stiffness the modes are of, if it depends on speed; by default the middle of its table.
    corrections : s, 1 to 20: responses (K^-1 M)^j K^-1 F, j = 0..s-1, that are kept of each force F beside the modes:
        the static one, and those of the inertia of the one before. The error of a receptance goes with the power 4 s of
        the ratio of its frequency to that of the last mode.

    Returns
    -------
    `Reduction`

    Raises
    ------
    ValueError
        If ``modes`` or ``corrections`` are out of range, M is not positive definite, or Omega is needed and not given.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> n = 30
    >>> K = n * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    >>> stop = hb.Element(np.eye(n)[n // 2], hb.Unilateral(k=0.5, gap=1.0))
    >>> chain = hb.System(np.eye(n) / n, 0.001 * K, K, [stop], hb.Load(cosine={1: np.eye(n)[n // 2]}))
    >>> small = hb.mechanics.reduce(chain, modes=8)
    >>> len(small.system.M) < n
    True
    """
    full = model.system()
    if isinstance(modes, bool) or not isinstance(modes, int | np.integer) or not 1 <= modes < full.n:
        raise ValueError(f"modes = {modes!r} must be a whole number from 1 to n - 1 = {full.n - 1}")
    counted("corrections", corrections, 20)
    M, _, K = _closed(full, _reference(full, Omega))
    if np.any(M.diagonal() <= 0):
        worst = full.dof_names[int(np.argmin(M.diagonal()))]
        raise ValueError(f"M must be positive definite; coordinate '{worst}' has no positive mass: eliminate it first")
    K = scipy.sparse.csc_array(0.5 * (K + K.T))
    # a shift far below the stiffness of the structure keeps K regular where it moves freely
    shift = 1e-10 * float(scipy.sparse.linalg.norm(K)) / float(scipy.sparse.linalg.norm(M))
    solve = _factored(K + shift * M, 0.0).solve
    inverse = scipy.sparse.linalg.LinearOperator(K.shape, matvec=solve, dtype=float)
    rng = np.random.default_rng(0)  # the same start in every run
    start = rng.standard_normal(full.n)
    squares, shapes = scipy.sparse.linalg.eigsh(K, modes, M, sigma=-shift, OPinv=inverse, v0=start)
    basis = _orthonormal(shapes[:, np.argsort(squares)], solve(_forces(full)), M)
    last = modes
    for _ in range(corrections - 1):
        last, before = basis.shape[1], last
        basis = _orthonormal(basis, solve(M @ basis[:, before:]), M)
    kept = basis[:, :modes]
    beyond = full.W - M @ (kept @ (kept.T @ full.W))  # what of the directions moves no mode that is kept
    flexibility = beyond.T @ solve(beyond)
    squares = np.sort(squares)
    size = _highest(K, M)
    free = basis[:, :modes][:, squares <= _DIGITS * size]

    def balanced(vector: Array) -> Array:
        """B^T v, made exactly zero on the free modes where a vector that does no work on them gives no less."""
        static = solve(np.asarray(vector, dtype=float))
        static = static - free @ (free.T @ (M @ static))
        rounding = _DIGITS * size * np.sqrt(static @ (M @ static))
        out = basis.T @ vector
        out[: free.shape[1]][np.abs(out[: free.shape[1]]) <= rounding] = 0.0
        return out

    system = _galerkin(full, basis, modes, balanced, free.shape[1], _DIGITS * size)
    frequencies = np.sqrt(np.maximum(squares, 0.0))
    frequencies[: free.shape[1]] = 0.0
    return Reduction(system, full, basis, frequencies, 0.5 * (flexibility + flexibility.T))


_DIGITS = 64 * float(np.finfo(float).eps)  # error of a computed mode or its square, relative to the highest one's


def _highest(K: Any, M: Any) -> float:
    """Bound of the largest squared frequency."""
    s = scipy.sparse.diags_array(1 / np.sqrt(M.diagonal()))
    return float(abs(s @ K @ s).sum(axis=1).max())


def _factored(A: Any, pivoting: float) -> Any:
    """Factors of a matrix with a symmetric pattern; ordered so, they fill in least."""
    settings = {"permc_spec": "MMD_AT_PLUS_A", "options": {"SymmetricMode": True}}
    return scipy.sparse.linalg.splu(scipy.sparse.csc_array(A), diag_pivot_thresh=pivoting, **settings)


def _reference(system: System, Omega: float | None) -> float | None:
    """Omega whose stiffness is that of the modes; None if it is the same at all."""
    if system.speed is None or system.speed.stiffness is None:
        return None
    if Omega is None and not math.isfinite(system.speed.range.high):
        raise ValueError("the stiffness is a function of speed: give Omega=..., at which its modes are to be taken")
    return 0.5 * (system.speed.range.low + system.speed.range.high) if Omega is None else Omega


def _closed(system: System, Omega: float | None = None) -> tuple[Any, Any, Any]:
    """Sparse M, C and K with dampers and reference springs of the elements, at a speed if one is given."""
    system.check_matrices()
    system = system if Omega is None else system.at_speed(Omega)
    W = scipy.sparse.csr_array(system.W)
    springs = scipy.sparse.diags_array(references(system))
    dampers = scipy.sparse.diags_array([e.damping for e in system.elements])
    M, C, K = (scipy.sparse.csr_array(A) for A in (system.M, system.C, system.K))
    return M, scipy.sparse.csr_array(C + W @ dampers @ W.T), scipy.sparse.csr_array(K + W @ springs @ W.T)


def _orthonormal(shapes: Array, extra: Array, M: Any) -> Array:
    """Modes and what else there is in the extra vectors, orthonormal in M; what adds nothing is dropped."""
    basis: Array = shapes / np.sqrt(np.einsum("ij,ij->j", shapes, M @ shapes))
    for vector in (extra / np.sqrt(np.einsum("ij,ij->j", extra, M @ extra))).T:
        for _ in range(2):  # once more for what rounding left
            vector = vector - basis @ (basis.T @ (M @ vector))
        size = np.sqrt(vector @ (M @ vector))
        if size > 1e-9:
            basis = np.column_stack([basis, vector / size])
    return basis


def _galerkin(
    full: System, basis: Array, modes: int, onto: Callable[[Array], Array], free: int, rounding: float
) -> System:
    """The system in the coordinates of the basis; ``onto`` are directions and constant loads in them.

    The first ``free`` modes are free motions, on which entries of K up to ``rounding`` are made zero.
    """
    M, C, K = (basis.T @ (A @ basis) for A in (full.M, full.C, full.K))
    for A in (K[:free], K[:, :free]):
        A[np.abs(A) <= rounding] = 0.0
    elements = [dataclasses.replace(e, direction=onto(np.asarray(e.direction))) for e in full.elements]
    names = [f"mode {i + 1}" for i in range(modes)]
    names += [f"residual {i + 1}" for i in range(basis.shape[1] - modes)]
    speed = None if full.speed is None else full.speed.projected(basis)
    return System(M, C, K, elements, [_projected(load, basis, onto) for load in full.loads], names, speed)


def _projected(load: Load, basis: Array, onto: Callable[[Array], Array]) -> Load:
    """The load on the coordinates of the basis; what a constant one does on free motions by rounding is made zero."""
    constant = None if load.constant is None else onto(np.asarray(load.constant))
    cosine, sine = ({k: basis.T @ np.asarray(v) for k, v in table.items()} for table in (load.cosine, load.sine))
    return Load(constant, cosine, sine, load.power)
