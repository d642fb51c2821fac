"""Floquet multipliers from Hill's matrix.

    z' = [A - B (k(theta) - kr) C] z,   z = e^{s t} sum_k z_k e^{i k theta},   |k| <= H,  theta = omega t

    [A - i k omega - s] z_k - B sum_l K_{k-l} C z_l = 0        K two-sided coefficients of k(theta) - kr

This is an eigenproblem of r (2H + 1) equations for the exponents s, whose multipliers are e^{s T}. Each exponent occurs
2H + 1 times, shifted by i omega. The copy whose vector is closest to the middle of the harmonics is the most accurate.

In terms of the m gaps d = C z, with the receptance G(s) = C (s - A)^-1 B, the same exponents are the zeros of a
determinant of m (2H + 1) equations (`CondensedHillMatrix`),

    D(s) v = 0,   [D v]_k = v_k + G(s + i k omega) sum_l [K_{k-l} - kr + C_{k-l} (s + i l omega)] v_l

C are the slopes in the velocity of laws that are evaluated by AFT.

References
----------
Lazarus & Thomas (2010), C. R. Mecanique 338(9), https://doi.org/10.1016/j.crme.2010.07.020.
Guillot, Lazarus, Thomas, Vergez & Cochelin (2020), J. Comput. Phys. 416, https://doi.org/10.1016/j.jcp.2020.109477.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.multipliers.sampled_slopes import SampledSlopes, has_sampled_slopes
from hbgear.harmonic.structure.linear_structure import LinearStructure

MAX_HILL_EQUATIONS = 3000
"""Largest number of equations of Hill's eigenproblem; at this size it takes about ten seconds."""


def hill_multipliers(compiled: Evaluator, X: Array, Omega: float) -> ComplexArray:
    """Return the multipliers (r,) of one motion X (n,), largest first.

    Raises
    ------
    ValueError
        If the model has Python laws, or the matrix would be too large.
    """
    compiled = compiled.at(Omega)
    modes, H = compiled.structure.modes, compiled.H
    _require_compiled_laws(compiled)
    r = 0 if modes is None else len(modes.poles)
    if modes is None or r * (2 * H + 1) > MAX_HILL_EQUATIONS:
        size = f"{r} x (2H + 1) = {r * (2 * H + 1):,}" if r else "too many"
        raise ValueError(
            f"Hill's matrix would have {size} equations; at most {MAX_HILL_EQUATIONS:,} are solved: use fewer harmonics"
        )
    k, K = np.arange(-H, H + 1), _two_sided(slopes(compiled, X))
    matrix = -np.einsum("rj,jkl,js->krls", modes.input, K, modes.output)
    # harmonic k of a mode turns with its pole minus i k omega
    diagonal = np.arange(r)
    matrix[np.arange(2 * H + 1)[:, None], diagonal, np.arange(2 * H + 1)[:, None], diagonal] += (
        modes.poles - 1j * (Omega / compiled.nu) * k[:, None]
    )
    s, V = np.linalg.eig(matrix.reshape(r * (2 * H + 1), -1))
    central = _central_copies(s, V.reshape(2 * H + 1, r, -1), Omega / compiled.nu)
    mu = np.exp(s[central] * (2 * np.pi * compiled.nu / Omega))
    return mu[np.argsort(-np.abs(mu), kind="stable")]


COPY_TOLERANCE = 0.05
"""Difference of two exponents from a multiple of i omega, relative to omega, up to which they may be copies of one."""

COPY_OVERLAP = 0.7
"""Cosine of the angle between shifted vectors above which they are copies; other modes may have the same multiplier."""


def _central_copies(s: ComplexArray, V: ComplexArray, omega: float) -> list[int]:
    """Return the numbers of r exponents with their vectors V (2H + 1, r, r (2H + 1)), one of each set of copies.

    They have the smallest second moments over the harmonics. Vectors of states that decay within a part of the period
    fill all harmonics and are found last.
    """
    k, weight = np.arange(len(V)) - len(V) // 2, np.square(np.abs(V)).sum(axis=1)
    chosen = list[int]()
    for i in np.argsort(k**2 @ weight / weight.sum(axis=0), kind="stable").tolist():
        turns = ((s[i] - s[chosen]) / (1j * omega)).round().real.astype(int)
        shifted = np.abs(s[i] - s[chosen] - 1j * omega * turns) < COPY_TOLERANCE * omega
        if not any(
            _are_copies(V[..., i], V[..., chosen[j]], int(turns[j])) for j in np.flatnonzero(shifted & (turns != 0))
        ):
            chosen.append(i)
        if len(chosen) == V.shape[1]:
            break
    return chosen


def _are_copies(a: ComplexArray, b: ComplexArray, n: int) -> bool:
    """Return whether vectors (2H + 1, r) are equal except for a factor and a shift, a_k = b_k+n."""
    size = len(a) - abs(n)
    if size <= 0:
        return False
    a, b = a[max(-n, 0) :][:size], b[max(n, 0) :][:size]
    return bool(abs(np.vdot(a, b)) > COPY_OVERLAP * np.linalg.norm(a) * np.linalg.norm(b))


def slopes(compiled: Evaluator, X: Array) -> ComplexArray:
    """Return the coefficients 0..2H (m, 2H + 1) of the slopes of the laws along a motion without the reference springs.

    X are the unknowns, or the coefficients of a motion with all harmonics up to 2H, (m (4H + 1),).
    """
    from hbgear.harmonic.forces.projection_kernels import projected

    X = compiled.spread(X)
    kappa, _, cubic = projected(compiled.packed_of(X), X.reshape(compiled.m, -1), 2 * compiled.H)
    out = kappa + cubic
    out[:, 0] -= compiled.packed.linear.springs[0]
    return out


def _two_sided(slopes: ComplexArray) -> ComplexArray:
    """K_{k-l} (m, 2H + 1, 2H + 1) for |k|, |l| <= H."""
    k = np.arange(slopes.shape[1])
    shift = k[:, None] - k
    return np.where(shift >= 0, slopes[:, np.abs(shift)], slopes[:, np.abs(shift)].conj())


def _require_compiled_laws(compiled: Evaluator) -> None:
    """Raise an error if the model has Python laws or laws with memory."""
    if compiled.aft_laws or compiled.damped:
        raise ValueError(
            "Hill's matrix needs laws of hbgear; it cannot be computed for laws written in Python or "
            "contacts with dampers; use floquet_multipliers"
        )
    if compiled.sliders:
        raise ValueError("Hill's matrix needs laws without memory; use floquet_multipliers for laws with friction")


@dataclass(frozen=True)
class CondensedHillMatrix:
    """Hill's determinant of one motion condensed to the gaps; equations at the head of this file.

    The unknowns are ordered by harmonic.

    Attributes
    ----------
    structure : LinearStructure
        Structure whose receptances are used.
    K : ndarray of complex, shape (m, 2H + 1, 2H + 1)
        Slopes of the laws in the displacement, without the reference springs.
    C : ndarray of complex, shape (m, 2H + 1, 2H + 1), or None
        Slopes in the velocity; None if no law depends on it.
    omega : float
        Frequency of the basis.
    """

    structure: LinearStructure
    K: ComplexArray
    C: ComplexArray | None
    omega: float

    @staticmethod
    def of(compiled: Evaluator, X: Array, Omega: float) -> CondensedHillMatrix:
        """Return the condensed matrix of a motion X (n,).

        Raises
        ------
        ValueError
            If slopes of a law are unknown, see `has_sampled_slopes`.
        """
        compiled = compiled.at(Omega)
        if not has_sampled_slopes(compiled):
            raise ValueError(
                "Hill's determinant needs the slopes of the laws; they are unknown for friction, contacts with "
                "dampers, laws of several displacements and compiled laws; use floquet_multipliers"
            )
        stiffness, damping = slopes(compiled, X), None
        if compiled.aft_laws:
            sampled = SampledSlopes(compiled, X, Omega)
            K, C = sampled.coefficients(stiffness.shape[1])
            stiffness[sampled.elements] += K
            if C.any():
                damping = np.zeros_like(stiffness)
                damping[sampled.elements] = C
        two_sided = None if damping is None else _two_sided(damping)
        return CondensedHillMatrix(compiled.structure, _two_sided(stiffness), two_sided, Omega / compiled.nu)

    @property
    def m(self) -> int:
        """Number of gaps."""
        return len(self.K)

    @property
    def k(self) -> Array:
        """Harmonics -H..H."""
        H = self.K.shape[1] // 2
        return np.arange(-H, H + 1)

    def receptances(self, s: complex) -> tuple[ComplexArray, ComplexArray]:
        """Return G and dG/ds (2H + 1, m, m) at s + i k omega; see `LinearStructure.transfer`."""
        return self.structure.transfer(s + 1j * self.omega * self.k)

    def slopes(self, s: complex) -> ComplexArray:
        """Return K + C (s + i l omega), (m, 2H + 1, 2H + 1)."""
        return self.K if self.C is None else self.K + self.C * (s + 1j * self.omega * self.k)

    def matrix(self, G: ComplexArray, s: complex) -> ComplexArray:
        """Return D (m (2H + 1), m (2H + 1)) for the receptances G at the exponent s."""
        size = len(self.k) * self.m
        D = np.einsum("kij,jkl->kilj", G, self.slopes(s)).reshape(size, size)
        D[np.diag_indices(size)] += 1.0
        return D

    def rate(self, G: ComplexArray, dG: ComplexArray, s: complex) -> ComplexArray:
        """Return dD/ds (m (2H + 1), m (2H + 1)) for the receptances G and dG/ds at the exponent s."""
        size = len(self.k) * self.m
        out = np.einsum("kij,jkl->kilj", dG, self.slopes(s))
        if self.C is not None:
            out += np.einsum("kij,jkl->kilj", G, self.C)
        return out.reshape(size, size)
