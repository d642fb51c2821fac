"""The balance of many designs of one model in one set of arrays: what a trace in lock step would evaluate.

For B designs, each with its own parameters, motion X_b and frequency Omega_b,

    R_b(X_b, Omega_b),   dR_b/dX,   dR_b/dOmega

are those of `HarmonicBalance.linearise_all`, which does the same for many motions of one design. Receptances come from
stacked poles and residues; piecewise-linear laws are projected exactly, cubic springs are sampled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.algebra import norms
from hbgear.continuation.problem import Evaluations
from hbgear.harmonic.balance import HarmonicBalance
from hbgear.harmonic.projection import ContactProjector
from hbgear.harmonic.realbasis import Toeplitz, one_sided, real_blocks
from hbgear.mechanics.fourier import Transform, to_complex, to_real
from hbgear.mechanics.laws import Cubic, PiecewiseLinear


class Batch:
    """Problems of one model class with the same H, nu and element count, evaluated together.

    Parameters
    ----------
    problems : B balances; laws all piecewise linear, or all `Cubic`.

    Raises
    ------
    ValueError
        If they differ in shape, or a structure has no modes, or a law is of another kind.
    """

    def __init__(self, problems: Sequence[HarmonicBalance]) -> None:
        first = problems[0]
        self.B, self.m, self.H, self.nu = len(problems), first.m, first.H, first.nu
        if any((p.m, p.H, p.nu) != (self.m, self.H, self.nu) for p in problems):
            raise ValueError("the designs differ in harmonics, nu or elements; batch only problems of one shape")
        compiled = [p.compiled({}) for p in problems]
        self._linear = _Linear([c.receptance for c in compiled])
        laws = [law for c in compiled for law in c.laws]
        self._transform = Transform(self.H, first.N)
        self._toeplitz = Toeplitz(self.H)
        if all(isinstance(law, PiecewiseLinear) for law in laws):
            self._projector = ContactProjector(laws, self.nu)
            self._forces = self._projected
        elif all(isinstance(law, Cubic) for law in laws):
            self._cubic = np.array([[[law.k1], [law.k3]] for law in laws]).transpose(1, 0, 2)
            self._forces = self._sampled
        else:
            raise ValueError("the laws of a batch must be all piecewise linear or all cubic")

    def linearise(self, X: Array, Omega: Array) -> Evaluations:
        """R, dR/dX, dR/dOmega and sizes at X (B, n) and Omega (B,)."""
        B, m, n = self.B, self.m, 2 * self.H + 1
        matrices, constants = self._linear.at(Omega)
        rows = X.reshape(B * m, n)
        c = to_complex(rows)
        f, own = self._forces(rows, c)
        d = c.reshape(B, m, n // 2 + 1).transpose(0, 2, 1)
        moved = (matrices @ d[..., None])[..., 0]  # Z d and dZ/dOmega d, (2, B, H + 1, m)
        R, dR = to_real((moved + constants).transpose(0, 1, 3, 2)).reshape(2, B, m * n)
        f = f.reshape(B, m * n)
        R += f
        J = real_blocks(matrices[0])
        own = own.reshape(B, m, n, n)
        for j in range(m):
            J[:, j, :, j, :] += own[:, j]
        size = norms(f) + norms(moved[0]) + norms(constants[0])
        return Evaluations(R, J.reshape(B, m * n, m * n), dR, np.where(size > 0, size, 1.0))

    def _projected(self, rows: Array, c: ComplexArray) -> tuple[Array, Array]:
        kappa, chi = self._projector.project(c, self._transform.samples(c), 2 * self.H)
        stiffness = self._toeplitz(kappa)
        return (stiffness @ rows[..., None])[..., 0] + to_real(one_sided(chi[:, : self.H + 1])), stiffness

    def _sampled(self, rows: Array, c: ComplexArray) -> tuple[Array, Array]:
        d, (k1, k3) = self._transform.samples(c), self._cubic
        square = k3 * d * d
        spectra = self._transform.spectrum(np.concatenate([(k1 + square) * d, k1 + 3 * square]))
        return to_real(one_sided(spectra[: len(d), : self.H + 1])), self._toeplitz(spectra[len(d) :])


class _Linear:
    """Z_k, g_k and their derivatives of many designs; see `Receptance.at`."""

    def __init__(self, receptances: Sequence) -> None:
        structures = [r.structure for r in receptances]
        if not all(s.modal for s in structures):
            raise ValueError("a structure has no modes; batch only structures that are decomposed")
        m, r = structures[0].m, max(s.modes.poles.size for s in structures)
        self.ratio, self.nu = receptances[0].ratio, receptances[0].nu
        self.poles = np.array([np.pad(s.modes.poles, (0, r - s.modes.poles.size), constant_values=-1.0)
                               for s in structures])  # fmt: skip
        self.residues = np.zeros((len(structures), r, m * m), dtype=complex)
        for row, s in zip(self.residues, structures, strict=True):
            row[: s.modes.poles.size] = s._residues
        self.springs = np.array([np.diag(s.kr) for s in structures])[:, None]
        self.e = np.array([x.e for x in receptances])
        self.sprung = np.array([s.kr for s in structures])[:, None] * self.e
        self.damped = 1j * np.array([s.c for s in structures])[:, None] * self.e
        self.loads = []
        for parts in zip(*(x._loads for x in receptances), strict=True):
            drive = np.zeros((len(parts), m, r), dtype=complex)
            for row, part in zip(drive, parts, strict=True):
                row[:, : len(part.drive)] = part.drive.T
            self.loads.append((parts[0].power, parts[0].order, drive))

    def at(self, Omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Matrices (2, B, H+1, m, m) and constants (2, B, H+1, m) at Omega (B,)."""
        B, m, ratio = len(Omega), self.springs.shape[-1], self.ratio[:, None]
        resolvent = 1.0 / (1j * Omega[:, None, None] * ratio - self.poles[:, None])
        G = (resolvent @ self.residues).reshape(B, -1, m, m)
        slope = (1j * ratio * ((resolvent * resolvent) @ self.residues)).reshape(B, -1, m, m)
        Y = 1.0 / G if m == 1 else np.linalg.inv(G)
        dY = slope * Y * Y if m == 1 else Y @ slope @ Y
        constants = np.array([
            (Y @ self.e[..., None])[..., 0] - self.sprung - Omega[:, None, None] * ratio * self.damped,
            (dY @ self.e[..., None])[..., 0] - ratio * self.damped,
        ])  # fmt: skip
        for power, order, drive in self.loads:
            k, growth = order * self.nu, (Omega**power)[:, None, None]
            one = (1.0 / (1j * order * Omega[:, None] - self.poles))[..., None]
            y, dy = drive @ one, -1j * (drive @ (one * one))
            change = order * growth * dy + power * Omega[:, None, None] ** (power - 1) * y
            constants[0, :, k] -= (growth * (Y[:, k] @ y))[..., 0]
            constants[1, :, k] -= (growth * (dY[:, k] @ y) + Y[:, k] @ change)[..., 0]
        return np.array([Y - self.springs, dY]), constants
