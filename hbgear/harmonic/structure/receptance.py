"""The linear part of a system, seen from its element coordinates.

With reference stiffness kr and the dampers c of the elements put into the structure,

    D(w) = K + W kr W^T + i w (C + W c W^T) - w^2 M,      G(w) = W^T D(w)^-1 W   (m x m)

the balance of harmonic k of the element coordinates reads, with w = k omega and f_k the force harmonics of the laws,

    Z_k d_k + g_k + f_k = 0,   Z_k = G^-1 - kr,   g_k = G^-1 (e_k - y_k) - (kr + i w c) e_k,   y_k = W^T D^-1 F_k

where neither kr nor the number of coordinates appears in the result. One eigen-decomposition of the state matrix,

    G(w) = sum_r a_r b_r^T / (i w - lambda_r),

gives every harmonic and the derivative in omega without a solve. Free motions (rigid motions r with
W^T r = 0) are split off first; a constant load on one of them is refused, for no periodic motion exists.

Directions of elements may depend on each other, W_b = W_a B. Then G is singular, and the balance is that of the others
under all forces, with the ties between the coordinates,

    Z_a,k d_a,k + g_a,k + f_a,k + B (f_b,k - kr_b d_b,k - (kr_b + i w c_b) e_b,k) = 0,   d_b + e_b = B^T (d_a + e_a)

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.harmonic.forces.packed_model import PackedLinearPart, in_two
from hbgear.mechanics.models import System
from hbgear.mechanics.reference_stiffness import references
from hbgear.mechanics.series.fourier import stretch, to_complex

MODAL_LIMIT = 1500
"""Above this many coordinates the receptance is solved for directly instead of by eigen-decomposition."""


_FREE = 1e-12  # squared frequency, relative to the highest, below which a motion counts as free


_BALANCED = 1e-8  # relative work of the constant load on a free motion that is still rounding


_ROUNDING = 1e-13  # the same, relative to the work the load could do at most


_DIGITS = 32 * float(np.finfo(float).eps)  # backward error of a decomposition, relative to the size of its matrix


_SOME = 30  # coordinates from which it is worth looking for real modes


_MIXED = 1e-13  # share of the damping that couples modes that is rounding


_DEPENDENT = 1e-9  # part of a direction that others leave over and that is rounding


_CLOSURES = (
    (1.0, 0.0, 1e-10), (1.37, 0.0, 1e-10), (0.61, 0.0, 1e-10),
    (1.0, 0.0, _FREE), (1.37, 0.0, _FREE), (0.61, 0.0, _FREE), (1.0, 1e-10, _FREE),
)  # fmt: skip
"""Factors of the reference springs, disturbances, and singular values that count as zero, in the order of trial."""


_FELT = 1e-5  # sum of the terms of an element's displacement over their sizes, above which they do not cancel


_MEASURED = 1e-9  # displacement in a unit motion over its largest possible, below which it is rounding of the motion


_ILL = 1e8  # condition of the eigenvectors above which receptances are solved for directly


class UnbalancedLoadError(ValueError):
    """A constant load acts on a motion that nothing holds: no periodic motion exists."""


@dataclass(frozen=True)
class Modes:
    """Diagonal form z' = poles z + left (F - W u), q = right z of the structure closed by the reference springs.

    poles (r,); right (n, r); left (r, n); output = W^T right (m, r); input = left W (r, m).
    """

    poles: ComplexArray
    right: ComplexArray
    left: ComplexArray
    output: ComplexArray
    input: ComplexArray
    condition: float


class LinearPart(NamedTuple):
    """Linear part Z_k d_k + g_k of the balance at one frequency.

    matrices (2, K+1, m, m): Z, the dynamic stiffness seen from the elements without their reference springs, and
    dZ/dOmega; constants (2, K+1, m): g, from loads and prescribed displacements, and dg/dOmega; of K+1 harmonics.
    """

    matrices: ComplexArray
    constants: ComplexArray

    @staticmethod
    def zero(count: int, m: int) -> LinearPart:
        """Of nothing, at so many harmonics."""
        return LinearPart(np.zeros((2, count, m, m), dtype=complex), np.zeros((2, count, m), dtype=complex))

    @property
    def Z(self) -> ComplexArray:
        """Dynamic stiffness (K+1, m, m)."""
        M: Array = self.matrices[0]
        return M

    @property
    def g(self) -> ComplexArray:
        """Constant terms (K+1, m)."""
        C: Array = self.constants[0]
        return C


def dense(A: Any) -> Array:
    """A matrix, sparse or not, as an array."""
    return A if isinstance(A, np.ndarray) else A.toarray() if scipy.sparse.issparse(A) else np.asarray(A)


def _is_diagonal(A: Array) -> bool:
    return bool(np.count_nonzero(A) == np.count_nonzero(np.diag(A)))


def _ties_of(W: Array, kr: Array) -> tuple[np.ndarray, Array, Array]:
    """`Structure.own`, `joint` and `ties` of directions W (n, m)."""
    m = W.shape[1]
    own: list[int] = []
    joint, ties = np.eye(m), np.zeros((m, m))
    stiffness = float(kr.max(initial=0.0)) or 1.0  # so that ties are of the size of forces
    for j in range(m):
        B = np.linalg.lstsq(W[:, own], W[:, j], rcond=None)[0] if own else np.empty(0)
        if not own or norm(W[:, j] - W[:, own] @ B) > _DEPENDENT * norm(W[:, j]):
            own.append(j)
            continue
        joint[own, j], joint[j, j] = B, 0.0
        ties[j, own], ties[j, j] = -stiffness * B, stiffness
    return np.array(own), joint, ties


def _null_space(A: Array, least: float | None = None) -> Array:
    """Orthonormal basis of the null space of a matrix whose rows and columns are already scaled.

    least : the largest singular value that counts as zero; by default that of a free motion.
    """
    _, s, vt = np.linalg.svd(A)
    largest = s.max(initial=0.0)
    rank = int(np.sum(s > (_FREE * largest if least is None else least))) if largest > 0 else 0
    null: Array = vt[rank:].T
    return null


class LinearStructure:
    """M, C, K of a system with the reference springs and the dampers of its elements closed.

    Parameters
    ----------
    system : `System`.
    springs : reference stiffness (m,) of the elements, by default that of `references`.

    Attributes
    ----------
    own : numbers of the elements a whose directions do not depend on those before. joint, ties (m, m) : with the
        balance Z d + g + f of each element by itself, that of all is ``joint @ (Z d + g + f) + ties @ (d + e)``.

    Raises
    ------
    ValueError
        If M is singular.
    UnbalancedLoad
        If a constant load acts on a free motion.
    """

    spins = False
    """Whether C and K depend on Omega, see `spinning`."""

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
        self.own, self.joint, self.ties = _ties_of(self.W, self.kr)
        self.free = self.free_left = np.zeros((self.n, 0))
        self.large = self.n > MODAL_LIMIT
        if self.large:
            Ws, M, C, K = (scipy.sparse.csr_array(A) for A in (self.W, system.M, system.C, system.K))
            self.M, self.K = M, K + Ws @ scipy.sparse.diags_array(self.kr) @ Ws.T
            self.C = C + Ws @ scipy.sparse.diags_array(self.c) @ Ws.T
            self.modes: Modes | None = None
            self.parted = False
            return
        self.M = dense(system.M)
        self.C = dense(system.C) + (self.W * self.c) @ self.W.T
        # scaling by the masses makes "free" a statement about frequencies, whatever units the coordinates have
        diagonal = np.abs(np.diag(self.M))
        self._scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, diagonal.max(initial=1.0) or 1.0))
        self._check_mass()
        self._close(system)

    def _close(self, system: System) -> None:
        """Close the structure by the reference springs and decompose it.

        With some springs two poles meet and their modes become one, or K is negative and a spring makes it zero; other
        springs give other poles and the same receptance in the end, so they are tried. What no spring changes is parted
        by a disturbance of 1e-10.
        """
        references = self.kr
        modes = self._unmixed(system) if self.n > _SOME else None
        if modes is not None:
            self.modes, self.parted = modes, False
            return
        for factor, part, near in _CLOSURES:
            self.kr = factor * references
            self.K = dense(system.K) + (self.W * self.kr) @ self.W.T
            if self._frees(system, near):
                continue
            self.free = self._null(self.K)
            self.free_left = self.free if np.array_equal(self.K, self.K.T) else self._null(self.K.T)
            self.check_balance(system)
            modes = self._decompose(part)
            if modes.condition < _ILL:
                break
        if modes is None:  # no reference spring holds it: the laws have no stiffness
            raise ValueError(self._describe_loose())
        self.modes, self.parted = modes, part > 0

    def _frees(self, system: System, near: float) -> bool:
        """Whether the reference springs free a motion that elements measure, K r = -W kr W^T r, as no rigid body can.

        near : singular value of K, over the size of the terms that it is the sum of, that counts as zero.
        """
        s, W = self._scale, np.abs(self.W)
        rounding = _MEASURED * norms(W.T * s)[:, None]
        terms = (np.abs(dense(system.K)) + (W * self.kr) @ W.T) * np.outer(s, s)
        least = near * float(terms.sum(axis=1).max())
        for K in (self.K,) if np.array_equal(self.K, self.K.T) else (self.K, self.K.T):
            self.free = s[:, None] * _null_space(K * np.outer(s, s), least)
            felt = np.abs(self.W.T @ self.free)
            if ((felt > _FELT * (W.T @ np.abs(self.free))) & (felt > rounding)).any():
                return True
        return False

    def _describe_loose(self) -> str:
        felt = np.abs(self.W.T @ self.free)
        element, motion = np.unravel_index(int(np.argmax(felt)), felt.shape)
        return (
            f"element '{self.system.elements[int(element)].name}' measures a motion that no stiffness holds "
            f"({self._motion_of(self.free[:, motion])}): its mean is arbitrary; give the law a stiffness, or support "
            "that motion in K"
        )

    def _unmixed(self, system: System) -> Modes | None:
        """Modes of a symmetric structure whose damping does not mix its real modes, at a small part of the cost.

            K phi = w^2 M phi,   phi^T C phi = 2 delta,   poles = -delta +- sqrt(delta^2 - w^2)

        Where the springs of the elements spoil it, it is tried without them; None if that does not help either, or
        something moves freely.
        """
        references, s = self.kr, self._scale
        M, C = (A * np.outer(s, s) for A in (self.M, self.C))
        for factor in (1.0, 0.0):
            kr = factor * references
            K = dense(system.K) + (self.W * kr) @ self.W.T
            A = K * np.outer(s, s)
            if not all(np.array_equal(x, x.T) for x in (M, C, A)):
                return None
            squares, V = scipy.linalg.eigh(A, None if _is_diagonal(M) else M)
            D = V.T @ C @ V
            delta = 0.5 * np.diag(D)
            mixed = np.abs(D - np.diag(np.diag(D))).max() > _MIXED * np.abs(D).max()
            gap = 2 * np.sqrt((delta**2 - squares).astype(complex))
            near = np.abs(gap) * _ILL < np.abs(delta) + np.sqrt(np.abs(squares))
            if squares[0] <= _FREE * squares[-1] or mixed or near.any():
                continue
            self.kr, self.K = kr, K
            poles = np.concatenate([-delta + 0.5 * gap, -delta - 0.5 * gap])
            right = np.tile(s[:, None] * V, 2).astype(complex)
            left = right.T / np.concatenate([gap, -gap])[:, None]
            return Modes(
                poles,
                right,
                left,
                self.W.T @ right,
                left @ self.W,
                float(np.max(np.abs(poles[: self.n]) / np.abs(gap))),
            )
        return None

    @property
    def tied(self) -> bool:
        """Whether directions of elements depend on each other."""
        return len(self.own) < self.m

    @property
    def modal(self) -> bool:
        """Whether receptances come from the eigen-decomposition."""
        return self.modes is not None and self.modes.condition < _ILL and not self.parted and not self.tied

    def _check_mass(self) -> None:
        scaled = self.M * np.outer(self._scale, self._scale)
        if _is_diagonal(scaled) and np.diag(scaled).all():
            return
        s, v = scipy.linalg.svd(scaled)[1:]
        if s[-1] <= 1e-13 * s[0]:
            worst = self.system.dof_names[int(np.argmax(np.abs(v[-1])))]
            raise ValueError(
                f"M is singular (coordinate '{worst}' carries no mass of its own); "
                "give it a mass or eliminate it from M, C and K"
            )

    def _null(self, A: Array) -> Array:
        return self._scale[:, None] * _null_space(A * np.outer(self._scale, self._scale))

    def check_balance(self, system: System) -> None:
        """Refuse constant loads, of a system with these matrices, that act on a free motion."""
        for load in system.loads if self.free_left.shape[1] else ():
            if load.constant is None:
                continue
            for r in self.free_left.T:
                work = r * np.asarray(load.constant)
                largest = np.linalg.norm(r / self._scale) * np.linalg.norm(self._scale * np.asarray(load.constant))
                rounding = max(_BALANCED * np.abs(work).sum(), _ROUNDING * largest)
                if abs(work.sum()) > rounding and abs(work.sum()) > self._rounding(r, np.asarray(load.constant)):
                    raise UnbalancedLoadError(self._describe_unbalance(r, float(work.sum())))

    def _rounding(self, r: Array, F: Array) -> float:
        """Work on a computed free motion r that a balanced load F may do: K r = 0 holds to eps |K| |r|.

        An error E of K moves r by -K^+ E r, and so the work by (K^+ F)^T E r.
        """
        s = self._scale
        A = self.K * np.outer(s, s)
        static = scipy.linalg.pinv(A.T, rtol=_FREE) @ (s * F)
        return _DIGITS * float(np.linalg.norm(A) * np.linalg.norm(static) * np.linalg.norm(r / s))

    def _describe_unbalance(self, r: Array, work: float) -> str:
        return (
            f"the constant load does work {work:.3g} on a motion that nothing holds ({self._motion_of(r)}); "
            "a periodic motion needs it balanced: correct the load or support that motion"
        )

    def _motion_of(self, r: Array) -> str:
        """The largest coordinates of a motion (n,), in words."""
        r = r / r[np.argmax(np.abs(r))]
        order = np.argsort(-np.abs(r))[:6]
        return ", ".join(f"{self.system.dof_names[i]} = {r[i]:.3g}" for i in order if abs(r[i]) > 1e-6)

    def _decompose(self, part: float) -> Modes:
        """Eigen-decomposition of the state matrix without the free motions that neither springs nor dampers hold."""
        M, K, C = self.M, self.K, self.C
        free, free_left = self._undamped(self.free, C), self._undamped(self.free_left, C.T)
        if free.shape[1]:
            B = self._scale[:, None] * _null_space((free_left.T @ M) * self._scale)
            T = self._scale[:, None] * _null_space((free.T @ M.T) * self._scale)
        else:
            B = T = np.diag(self._scale)
        Mi = np.linalg.inv(T.T @ M @ B)
        K, C = Mi @ T.T @ K @ B, Mi @ T.T @ C @ B
        size = B.shape[1]
        clock = np.sqrt(np.abs(K).max()) or 1.0  # states (q, q'/clock): no bias from the unit of time
        A = np.zeros((2 * size, 2 * size))
        A[:size, size:], A[size:, :size], A[size:, size:] = clock * np.eye(size), -K / clock, -C
        if part:
            A += part * clock * np.diag(np.linspace(-1.0, 1.0, 2 * size) ** 3)
        poles, V = np.linalg.eig(A)
        poles, V = poles.astype(complex), V.astype(complex)
        try:
            U = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            U = np.full_like(V, np.inf)  # the condition is judged by the caller
        right = B @ V[:size]
        left_vectors = U[:, size:] @ (Mi @ T.T) / clock
        output, input_ = self.W.T @ right, left_vectors @ self.W
        # a pole at zero that is left belongs to a drift that no element feels; it carries no receptance
        keep = np.abs(poles) > 1e-9 * np.abs(poles).max(initial=0.0)
        condition = float(np.linalg.norm(V, 1) * np.linalg.norm(U, 1)) if np.all(np.isfinite(U)) else np.inf
        return Modes(poles[keep], right[:, keep], left_vectors[keep], output[:, keep], input_[keep], condition)

    def _undamped(self, free: Array, C: Array) -> Array:
        """The free motions that no damper feels either."""
        if not free.shape[1] or not np.any(C):
            return free
        felt = (C @ free) * self._scale[:, None] / (np.abs(C) * np.outer(self._scale, self._scale)).max()
        _, s, vt = scipy.linalg.svd(felt / np.linalg.norm(free / self._scale[:, None], axis=0))
        held = np.concatenate([s, np.zeros(vt.shape[0] - s.size)]) > 1e-9
        undamped: Array = free @ vt[~held].T
        return undamped

    def solve(self, w: float, rhs: ComplexArray) -> ComplexArray:
        """D(w)^-1 rhs; at w = 0 the solution without free motion."""
        x: ComplexArray
        if self.large:
            D = self.K + 1j * w * self.C - w**2 * self.M
            x = scipy.sparse.linalg.splu(D.tocsc()).solve(rhs.astype(complex))
        elif w == 0.0:
            s = self._scale
            scaled = self.K * np.outer(s, s)
            x = s[:, None] * (scipy.linalg.pinv(scaled, rtol=_FREE) @ (s[:, None] * rhs))
        else:
            x = scipy.linalg.solve(self.K + 1j * w * self.C - w**2 * self.M, rhs)
        return x

    def at(self, Omega: float) -> LinearStructure:
        """The structure at a frequency of the excitation, with its modes: itself."""
        return self

    def receptances(self, Omega: float, ratio: Array) -> tuple[ComplexArray, ComplexArray]:
        """G and dG/dOmega, (P, m, m) each, at frequencies Omega ratio (P,)."""
        return self.response(Omega, ratio, self.W)

    def transfer(self, s: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """G and dG/ds (P, m, m) at exponents s (P,).

        Raises
        ------
        ValueError
            If one of these is a pole, or there are no modes.
        """
        if self.modes is None:
            raise ValueError("Hill's determinant needs the modes of the structure, which is too large for them")
        distance = s[:, None] - self.modes.poles
        if not distance.all():
            raise ValueError("the exponent is that of a mode that no gap changes: the motion is linear there")
        away = 1.0 / distance
        out, in_ = self.modes.output, self.modes.input
        return (
            np.einsum("ir,kr,rj->kij", out, away, in_, optimize=True),
            np.einsum("ir,kr,rj->kij", out, -np.square(away), in_, optimize=True),
        )

    def response(self, Omega: float, ratio: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """W^T D^-1 F and its derivative in Omega, (P, m, c) each, at frequencies Omega ratio (P,), of F (n, c)."""
        Q, dQ = self._direct(Omega * ratio, np.broadcast_to(F, (len(ratio), *F.shape)))
        return self.W.T @ Q, (self.W.T @ dQ) * ratio[:, None, None]

    def _direct(self, w: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """D(w)^-1 F and its derivative in w for F (K, n, c), by one factorisation each."""
        Q = np.array([self.solve(wk, Fk) for wk, Fk in zip(w, F, strict=True)])
        dQ = np.array([
            -self.solve(wk, 1j * (self.C @ Qk) - 2 * wk * (self.M @ Qk)) if wk else 0 * Qk
            for wk, Qk in zip(w, Q, strict=True)
        ])  # fmt: skip
        return Q, dQ


class _LoadPart(NamedTuple):
    """One harmonic Omega^power Re(amplitudes exp(i k theta)) of a load, amplitudes (n,); k is order number ``at``."""

    power: int
    at: int
    amplitudes: ComplexArray


class Receptance:
    """The linear part of the balance for harmonics 0..H of the basis frequency Omega / nu, or some of them.

    Parameters
    ----------
    structure : `LinearStructure`.
    system : the system, for its loads and prescribed displacements.
    H, nu : harmonics of the basis and its subharmonic order.
    orders : (K+1,) those of the basis harmonics 0..H that are unknowns; all by default.

    Attributes
    ----------
    numbers : the same for kernels; without poles where receptances are solved for directly.
    """

    def __init__(
        self, structure: LinearStructure, system: System, H: int, nu: int, orders: np.ndarray | None = None
    ) -> None:
        self.structure, self.H, self.nu = structure, H, nu
        self.k = np.arange(H + 1) if orders is None else orders
        e = np.zeros((H + 1, structure.m), dtype=complex)
        for j, element in enumerate(system.elements):
            c = to_complex(stretch(element.displacement.row(H // nu), nu))
            e[: len(c), j] = c
        self.e = np.ascontiguousarray(e[self.k])
        place = {k: i for i, k in enumerate(self.k.tolist())}
        self._loads: list[_LoadPart] = []
        for load in system.loads:
            for order, amplitudes in load.complex(system.n).items():
                if order * nu in place:
                    self._loads.append(_LoadPart(load.power, place[order * nu], amplitudes))
        self.numbers = self._numbers()

    def _numbers(self) -> PackedLinearPart:
        structure, m = self.structure, self.structure.m
        poles, residues = np.empty(0, dtype=complex), np.empty((m * (m + len(self._loads)), 0), dtype=complex)
        if structure.modal and structure.modes is not None:
            modes = structure.modes
            poles = modes.poles
            residues = (modes.output[:, None, :] * modes.input.T).reshape(m * m, len(poles))
            driven = [modes.output * (modes.left @ load.amplitudes) for load in self._loads]
            residues = np.concatenate([residues, *driven])
        loads = np.array([(load.power, load.at) for load in self._loads], dtype=np.int64).reshape(-1, 2)
        unknown = np.zeros(2 * self.H + 1, dtype=bool)
        unknown[self.k] = True
        return PackedLinearPart(
            in_two(poles), in_two(residues), np.array([structure.kr, structure.c]), self.k.astype(np.int64),
            np.flatnonzero(~unknown), self.e, loads, int(self.nu),
        )  # fmt: skip

    def loads(self, Omega: float) -> ComplexArray:
        """Load harmonics (K+1, n) at Omega."""
        F = np.zeros((len(self.k), self.structure.n), dtype=complex)
        for part in self._loads:
            F[part.at] += Omega**part.power * part.amplitudes
        return F

    def at(self, Omega: float) -> LinearPart:
        """Z_k, g_k and their derivatives in Omega."""
        out = LinearPart.zero(len(self.k), self.structure.m)
        if self.structure.modal:
            from hbgear.harmonic.structure.receptance_kernels import linear_part

            linear_part(self.numbers, float(Omega), *out)
            if not np.isfinite(out.matrices).all():
                raise ValueError(
                    f"at Omega = {Omega:g} the structure does not give way to its elements at all, or without end: "
                    "numbers of the model lie too far apart; check their units"
                )
        else:
            self._directly(Omega, out)
        return out

    def _directly(self, Omega: float, out: LinearPart) -> None:
        """The same by solving for the receptances."""
        s, ratio = self.structure, self.k / self.nu
        w, m = Omega * ratio, s.m
        amplitudes = np.array([part.amplitudes for part in self._loads]).reshape(-1, s.n)
        x, dx = s.response(Omega, ratio, np.column_stack([s.W, amplitudes.T]))
        G, dG = x[..., :m], dx[..., :m]
        Y, dY = out.matrices
        own = np.ix_(np.arange(len(w)), s.own, s.own) if s.tied else ...
        Y[own] = np.linalg.inv(G[own])
        dY[own] = -(Y[own] @ dG[own] @ Y[own])
        constants = out.constants
        constants[:] = (out.matrices @ self.e[..., None])[..., 0]
        constants[0] -= (s.kr + 1j * w[:, None] * s.c) * self.e
        constants[1] -= 1j * ratio[:, None] * s.c * self.e
        for n, part in enumerate(self._loads):
            k, power = part.at, part.power
            y, dy = x[k, :, m + n], dx[k, :, m + n]
            growth = Omega**power
            change = growth * dy + (power * Omega ** (power - 1) * y if power else 0.0)
            constants[0, k] -= Y[k] @ (growth * y)
            constants[1, k] -= dY[k] @ (growth * y) + Y[k] @ change
        Y -= np.diag(s.kr)

    def motion(self, Omega: float, d: ComplexArray, f: ComplexArray) -> ComplexArray:
        """Harmonics q_k (K+1, n) of all coordinates from those of the gaps d and of the law forces f, (K+1, m) each.

        q_k = D_k^-1 (F_k - W (f_k - kr d_k - (kr + i w c) e_k))
        """
        s = self.structure.at(Omega)
        w = self.k * Omega / self.nu
        u = f - s.kr * d - (s.kr + 1j * w[:, None] * s.c) * self.e
        rhs = self.loads(Omega) - u @ s.W.T
        return np.array([s.solve(wk, rhs[k][:, None])[:, 0] for k, wk in enumerate(w)])
