"""Reduction of a large structure to its lowest modes and residual flexibility.

    q = B p,   B = [phi_1 ... phi_r,  R],   R = (K + alpha M)^-1 [W, F_0, F_1, ...]

with the lowest modes of K phi = w^2 M phi (undamped, with the reference springs of the elements) and the static
responses R to the directions of the elements and the vectors of the loads, which represent the flexibility of all
truncated modes. The reduced matrices are B^T M B, B^T C B, B^T K B (Galerkin), the reduced directions and loads are
B^T w, B^T F. The result is a `System` like any other, small and dense, with stability. Motions of the structure above
the last mode beyond a static response are neglected; `Reduction.error` measures the error at the frequencies of
interest.

Time and memory are dominated by one sparse factorisation; all further products are linear in the number of
coordinates.

References
----------
MacNeal (1971), Computers & Structures 1, 581-601 (residual flexibility); Rubin (1975), AIAA J. 13(8), 995-1006.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.reference_stiffness import references
from hbgear.mechanics.structures.elements import Load
from hbgear.mechanics.structures.modal_damping import modal_squares


@dataclass(frozen=True, eq=False)
class Reduction:  # numpydoc ignore=PR02
    """Reduced system, and the transformation to the full coordinates.

    Parameters
    ----------
    system : System
        Reduced system, which is traced like any other.
    full : System
        Full system.
    basis : ndarray, shape (n, r)
        Matrix B, orthonormal in M.
    frequencies : ndarray, shape (modes,)
        Angular frequencies of the retained modes; the truncated modes lie above the last.
    flexibility : ndarray, shape (m, m)
        Static flexibility between the elements of all truncated modes, sum phi phi^T / w^2.

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
        """Return a bound mu of the relative stiffness modulation of a truncated mode by the elements.

            mu = largest eigenvalue of s^1/2 Phi s^1/2,   Phi the flexibility of the truncated modes, s the swings

        The multipliers of the reduced system determine the stability of the retained modes. A truncated mode with
        frequency w and damping ratio zeta obeys x'' + 2 zeta w x' + (w^2 + kappa(t)) x = 0 with |kappa| <= mu w^2. The
        energy of exp(zeta w t) x grows at most with the rate mu w / sqrt(1 - zeta^2), so that its multipliers over a
        time T obey

            |multiplier| <= exp((mu / (2 sqrt(1 - zeta^2)) - zeta) w T)

        and the mode is stable by itself if zeta > mu / 2, approximately.

        Parameters
        ----------
        swing : array_like, shape (m,), optional
            Largest |dp/dd - k| of each element over the motion, with its reference stiffness k. Default: k, the value
            of a contact that opens and closes.

        Returns
        -------
        float
            The bound mu.

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
        """Return the coordinates (n, ...) of the full system, q = B p.

        Parameters
        ----------
        p : ndarray, shape (r, ...)
            Coordinates of the reduced system.

        Returns
        -------
        ndarray, shape (n, ...)
            Coordinates of the full system.
        """
        return self.basis @ p

    def error(self, frequencies: Any, Omega: float | None = None) -> Array:
        """Return the relative error of the receptance between the elements at angular frequencies w (K,).

            |G_reduced(w) - G(w)| / |G(w)|,   G(w) = W^T (K_r + i w C_r - w^2 M)^-1 W

        with the reference springs and dampers of the elements in K_r and C_r, by a direct solution for each frequency.

        Parameters
        ----------
        frequencies : array_like, shape (K,)
            Angular frequencies.
        Omega : float, optional
            Excitation frequency whose C and K are used; required if the structure depends on speed.

        Returns
        -------
        ndarray, shape (K,)
            Relative errors.

        Raises
        ------
        ValueError
            If the structure depends on speed and Omega is missing.
        """
        if self.full.speed is not None and Omega is None:
            raise ValueError("the structure depends on speed: give Omega=..., the frequency of the excitation")
        return self._error(np.atleast_1d(np.asarray(frequencies, dtype=float)), self.full.W, Omega)

    def _error(self, w: Array, F: Array, Omega: float | None = None) -> Array:
        """Return the relative error of the responses to the forces F (n, c), relative to the largest at a frequency."""
        M, C, K = _closed(self.full, Omega)
        k, c, m = (self.basis.T @ (A @ self.basis) for A in (K, C, M))
        out = []
        for wk in w:
            G = self.full.W.T @ _factored(_dynamic_stiffness(K, C, M, wk), 0.1).solve(F.astype(complex))
            small = scipy.linalg.solve(_dynamic_stiffness(k, c, m, wk), self.basis.T @ F)
            out.append(_relative_difference((self.basis.T @ self.full.W).T @ small, G))
        return np.array(out)


_MODE_COUNTS = (32, 64, 128, 256)
"""Numbers of retained modes that `reduced_within` tries in turn."""

_CORRECTIONS = 4
"""Number of responses to each force that `reduced_within` retains in addition to the modes."""

_MAX_RECEPTANCE_ERROR = 1e-9
"""Relative error of receptances [-] that does not change a response curve."""

_ROUNDING_FACTOR, _MAX_ROUNDING = 100.0, 1e-3
"""Error over the rounding of the full structure, and largest error [-], that are attributed to rounding."""


def reduced_within(system: System, highest: float) -> tuple[Reduction, float] | None:
    """Return a reduction that is exact to 1e-9 up to an angular frequency, and its error; None if none is.

    Few modes below that frequency make a reduction exact; up to 256 modes are tried. Where the responses of the full
    structure are not known to 1e-9, because its stiffness is ill-conditioned, a reduction within a hundred times their
    rounding is accepted: the projection K B has the rounding of K as well.
    """
    F = _forces(system)
    w = highest * np.array([1.0, 0.75, 0.5, 0.25])
    limit = functools.cache(lambda: min(_ROUNDING_FACTOR * _rounding(system, w, F), _MAX_ROUNDING))
    for modes in _MODE_COUNTS:
        if 2 * modes > system.n:
            break
        reduction = reduce(system, modes, corrections=_CORRECTIONS)
        if reduction.frequencies[-1] > highest:
            error = float(reduction._error(w, F).max())
            if error <= _MAX_RECEPTANCE_ERROR or error <= limit():
                return reduction, error
    return None


def _rounding(system: System, w: Array, F: Array) -> float:
    """Return the largest relative change of responses to the forces F (n, c) by the rounding of the entries of K.

    The responses of a structure whose stiffness is ill-conditioned, such as a beam of a thousand elements, are not
    known better, whether it is reduced or not.
    """
    M, C, K = _closed(system)
    rounded = K.copy()
    rounded.data = K.data * (1 + np.finfo(float).eps * np.random.default_rng(0).choice([-1.0, 1.0], K.nnz))
    out = 0.0
    for wk in w:
        G, perturbed = (
            system.W.T @ _factored(_dynamic_stiffness(A, C, M, wk), 0.1).solve(F.astype(complex)) for A in (K, rounded)
        )
        out = max(out, _relative_difference(perturbed, G))
    return out


def _dynamic_stiffness(K: Any, C: Any, M: Any, w: float) -> Any:
    """Return K + i w C - w^2 M."""
    return K + 1j * w * C - w**2 * M


def _relative_difference(responses: Array, reference: Array) -> float:
    """Return the largest difference of responses (m, c), relative to the largest of the reference to each force."""
    return float((np.abs(responses - reference).max(axis=0) / np.abs(reference).max(axis=0)).max())


def _forces(system: System) -> Array:
    """Return directions of the elements and vectors of the loads, (n, c)."""
    return np.column_stack([system.W, *(v for load in system.loads for v in load.vectors())])


@checked_arguments()
def reduce(model: Model, modes: int = 40, Omega: float | None = None, corrections: int = 1) -> Reduction:
    """Reduce a model with many coordinates.

    All terms of a structure that depends on speed are projected; the reduced one depends on speed as well.

    Parameters
    ----------
    model : Model
        Any model; large M, C and K should be sparse. M must be symmetric and positive definite. The modes are those
        of the symmetric part of K; C and K themselves may be unsymmetric.
    modes : int, optional
        Number of lowest modes that are retained, 1 <= modes < n. They should reach three times the highest frequency
        of interest; `Reduction.error` measures the error. Default 40.
    Omega : float, optional
        Frequency whose stiffness determines the modes, if it depends on speed. Default: the middle of its table.
    corrections : int, optional
        Number s, 1 to 20, of responses (K^-1 M)^j K^-1 F, j = 0..s-1, that are retained for each force F: the static
        response, and the responses to the inertia of the previous one. The error of a receptance is proportional to
        the power 4 s of the ratio of its frequency to that of the last mode. Default 1.

    Returns
    -------
    Reduction
        Reduced system and basis.

    Raises
    ------
    ValueError
        If ``modes`` or ``corrections`` are out of range, M is not positive definite, or Omega is required and missing.

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
        name = full.dof_names[int(np.argmin(M.diagonal()))]
        raise ValueError(f"M must be positive definite; coordinate '{name}' has no positive mass: eliminate it first")
    K = scipy.sparse.csc_array(0.5 * (K + K.T))
    # a shift far below the stiffness of the structure keeps K regular where it moves freely
    shift = 1e-10 * float(scipy.sparse.linalg.norm(K)) / float(scipy.sparse.linalg.norm(M))
    solve = _factored(K + shift * M, 0.0).solve
    inverse = scipy.sparse.linalg.LinearOperator(K.shape, matvec=solve, dtype=float)
    rng = np.random.default_rng(0)  # the same start in every run
    start = rng.standard_normal(full.n)
    shapes = scipy.sparse.linalg.eigsh(K, modes, M, sigma=-shift, OPinv=inverse, v0=start)[1]
    shapes = shapes / np.sqrt(np.einsum("ij,ij->j", shapes, M @ shapes))
    squares = modal_squares(K, shapes, abs(K))
    order = np.argsort(squares, kind="stable")
    squares = squares[order]
    basis = _orthonormal(shapes[:, order], solve(_forces(full)), M)
    last = modes
    for _ in range(corrections - 1):
        last, before = basis.shape[1], last
        basis = _orthonormal(basis, solve(M @ basis[:, before:]), M)
    retained = basis[:, :modes]
    complement = full.W - M @ (retained @ (retained.T @ full.W))  # part of the directions that moves no retained mode
    flexibility = complement.T @ solve(complement)
    size = _square_frequency_bound(K, M)
    free = retained[:, squares == 0.0]

    def balanced(vector: Array) -> Array:
        """Return B^T v, exactly zero on the free modes if it is zero to rounding."""
        static = solve(np.asarray(vector, dtype=float))
        static = static - free @ (free.T @ (M @ static))
        rounding = _MODE_ROUNDING * size * np.sqrt(static @ (M @ static))
        out = basis.T @ vector
        out[: free.shape[1]][np.abs(out[: free.shape[1]]) <= rounding] = 0.0
        return out

    system = _galerkin(full, basis, modes, balanced, free.shape[1], _MODE_ROUNDING * size)
    return Reduction(system, full, basis, np.sqrt(squares), 0.5 * (flexibility + flexibility.T))


_MODE_ROUNDING = 64 * float(np.finfo(float).eps)
"""Stiffness of a free motion by rounding, relative to the highest squared frequency [-]."""


def _square_frequency_bound(K: Any, M: Any) -> float:
    """Return an upper bound of the largest squared frequency."""
    s = scipy.sparse.diags_array(1 / np.sqrt(M.diagonal()))
    return float(abs(s @ K @ s).sum(axis=1).max())


def _factored(A: Any, pivoting: float) -> Any:
    """Return the factors of a matrix with a symmetric pattern, in the order with the least fill-in."""
    settings = {"permc_spec": "MMD_AT_PLUS_A", "options": {"SymmetricMode": True}}
    return scipy.sparse.linalg.splu(scipy.sparse.csc_array(A), diag_pivot_thresh=pivoting, **settings)


def _reference(system: System, Omega: float | None) -> float | None:
    """Return the Omega whose stiffness determines the modes; None if the stiffness is constant."""
    if system.speed is None or system.speed.stiffness is None:
        return None
    if Omega is None and not math.isfinite(system.speed.range.high):
        raise ValueError("the stiffness is a function of speed: give Omega=..., the speed of its modes")
    return 0.5 * (system.speed.range.low + system.speed.range.high) if Omega is None else Omega


def _closed(system: System, Omega: float | None = None) -> tuple[Any, Any, Any]:
    """Return sparse M, C and K with dampers and reference springs of the elements, at a speed if one is given."""
    system.check_matrices()
    system = system if Omega is None else system.at_speed(Omega)
    W = scipy.sparse.csr_array(system.W)
    springs = scipy.sparse.diags_array(references(system))
    dampers = scipy.sparse.diags_array([e.damping for e in system.elements])
    M, C, K = (scipy.sparse.csr_array(A) for A in (system.M, system.C, system.K))
    return M, scipy.sparse.csr_array(C + W @ dampers @ W.T), scipy.sparse.csr_array(K + W @ springs @ W.T)


def _orthonormal(shapes: Array, vectors: Array, M: Any) -> Array:
    """Return modes and the extra vectors, orthonormal in M; linearly dependent vectors are dropped."""
    basis = shapes / np.sqrt(np.einsum("ij,ij->j", shapes, M @ shapes))
    for vector in (vectors / np.sqrt(np.einsum("ij,ij->j", vectors, M @ vectors))).T:
        for _ in range(2):  # twice, because of rounding
            vector = vector - basis @ (basis.T @ (M @ vector))
        size = np.sqrt(vector @ (M @ vector))
        if size > 1e-9:
            basis = np.column_stack([basis, vector / size])
    return basis


def _galerkin(
    full: System, basis: Array, modes: int, project: Callable[[Array], Array], free: int, rounding: float
) -> System:
    """Return the system in the coordinates of the basis; ``project`` projects directions and constant loads.

    The first ``free`` modes are free motions, on which entries of K up to ``rounding`` are set to zero.
    """
    M, C, K = (basis.T @ (A @ basis) for A in (full.M, full.C, full.K))
    for A in (K[:free], K[:, :free]):
        A[np.abs(A) <= rounding] = 0.0
    elements = [dataclasses.replace(e, direction=project(np.asarray(e.direction))) for e in full.elements]
    names = [f"mode {i + 1}" for i in range(modes)]
    names += [f"residual {i + 1}" for i in range(basis.shape[1] - modes)]
    speed = None if full.speed is None else full.speed.projected(basis)
    return System(M, C, K, elements, [_projected(load, basis, project) for load in full.loads], names, speed)


def _projected(load: Load, basis: Array, project: Callable[[Array], Array]) -> Load:
    """Return the load in the coordinates of the basis; constant loads on free motions by rounding are set to zero."""
    constant = None if load.constant is None else project(np.asarray(load.constant))
    cosine, sine = ({k: basis.T @ np.asarray(v) for k, v in table.items()} for table in (load.cosine, load.sine))
    return Load(constant, cosine, sine, load.power)
