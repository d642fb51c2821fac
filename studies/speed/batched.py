"""The balance of many designs of one model in one set of arrays: what a trace in lock step would evaluate.

For B designs, each with its own parameters, motion X_b and frequency Omega_b,

    R_b(X_b, Omega_b),   dR_b/dX,   dR_b/dOmega

are those of `HarmonicBalance.linearise`, stacked. Receptances come from stacked poles and residues; piecewise-linear
laws are projected exactly, their contact instants found by Newton on all of them at once; cubic springs are sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hbgear.balance import HarmonicBalance
from hbgear.basis import Toeplitz, one_sided
from hbgear.contact import ContactProjector, Crossings, crossings, modulate
from hbgear.fourier import Array, ComplexArray, Transform, to_complex, to_real, waves
from hbgear.laws import Cubic, PiecewiseLinear

_ROUNDING = 4e-16  # relative size of a value that is zero
_LAST_STEP = 1e-8  # Newton step after which the next one is rounding


class Evaluations(NamedTuple):
    """R (B, n), dR_dX (B, n, n), dR_dp (B, n) and sizes (B,): `newton.Evaluation` of each design."""

    R: Array
    dR_dX: Array
    dR_dp: Array
    size: Array


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
        self._transform = Transform(self.H, first.N, 2 * len(laws))
        self._toeplitz = Toeplitz(self.H)
        if all(isinstance(law, PiecewiseLinear) for law in laws):
            self._projector = _Projector(laws, self.nu)
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
        J = _real_blocks(matrices[0])
        own = own.reshape(B, m, n, n)
        for j in range(m):
            J[:, j, :, j, :] += own[:, j]
        size = _norms(f) + _norms(moved[0]) + _norms(constants[0])
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


def bordered(now: Evaluations, normal: Array) -> Array:
    """[dR_dX dR_dp; normal^T] of each design, (B, n + 1, n + 1)."""
    B, n = now.R.shape
    A = np.empty((B, n + 1, n + 1))
    A[:, :n, :n], A[:, :n, n], A[:, n] = now.dR_dX, now.dR_dp, normal
    return A


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
                row[:, : part.drive.shape[1]] = part.drive
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


class _Projector(ContactProjector):
    """`ContactProjector` whose sums over instants and corners are taken element by element, for many elements."""

    def project(self, c: ComplexArray, samples: Array, order: int) -> tuple[ComplexArray, ComplexArray]:
        """kappa and chi, two-sided coefficients 0..order of each element, (E, order + 1) each."""
        found, E, reach = instants(c, self.level, self.rows, samples), len(c), order + self.reach
        own = self.weights[:, self.rows, np.arange(len(self.level))]  # of each corner in kappa and chi, (2, L)
        share = found.above - np.bincount(found.row, found.sign * found.theta, len(self.level)) / (2 * np.pi)
        both = np.empty((2, E, reach + 1), dtype=complex)
        both[:, :, 0] = self.base + [np.bincount(self.rows, w * share, E) for w in own]
        element = self.rows[found.row]  # ascends
        count = np.bincount(element, minlength=E)
        place = np.arange(len(element)) - (np.cumsum(count) - count)[element]
        theta, weight = np.zeros((E, max(1, count.max()))), np.zeros((E, 2, max(1, count.max())))
        theta[element, place] = found.theta
        weight[element, :, place] = (own[:, found.row] * found.sign).T
        turned = np.conj(waves(theta, reach)).reshape(*theta.shape, -1)[:, :, 1:]
        both[:, :, 1:] = (weight @ turned).transpose(1, 0, 2) / (2j * np.pi * np.arange(1, reach + 1))
        kappa, chi = modulate(self.series, both, order, self.shifts)
        return kappa, chi


def instants(c: ComplexArray, level: Array, rows: np.ndarray, samples: Array) -> Crossings:
    """`contact.crossings` by Newton on all instants at once; levels with a doubtful cell are left to `crossings`."""
    step = 2 * np.pi / samples.shape[-1]
    x = samples[rows] - level[:, None]
    above, following = x > 0, np.roll(x, -1, axis=1)
    bend = (np.abs(c) @ np.arange(c.shape[-1]) ** 2)[rows]
    doubtful = np.zeros(len(level), dtype=bool)
    line, cell = np.nonzero(np.abs(x) <= (step**2 * bend)[:, None])
    here, left, right = x[line, cell], x[line, cell - 1], following[line, cell]
    toward = ((left - here) * here >= 0) & ((right - here) * here >= 0)
    doubtful[line[toward & (np.abs(here) <= np.abs(left - 2 * here + right))]] = True
    line, cell = np.nonzero(above != (following > 0))
    ends = x[line, cell], following[line, cell]
    theta, single = _roots(c[rows[line]], level[line], step * cell, step * (cell + 1), *ends)
    doubtful[line[~single]] = True
    sign = np.where(above[line, cell], -1, 1)
    if doubtful.any():
        some, keep = np.flatnonzero(doubtful), ~doubtful[line]
        more = crossings(c, level[some], rows[some], samples)
        line, theta = np.append(line[keep], some[more.row]), np.append(theta[keep], more.theta)
        sign = np.append(sign[keep], more.sign)
        order = np.lexsort((theta, line))
        line, theta, sign = line[order], theta[order], sign[order]
    return Crossings(line, theta, sign, above[:, 0])


def _roots(c: ComplexArray, level: Array, low: Array, high: Array, first: Array, last: Array) -> tuple[Array, Array]:
    """Roots between low and high, where the values first and last differ in sign; whether each is the only one."""

    def wave(theta: Array) -> tuple[Array, Array]:
        parts = c * waves(theta, c.shape[-1] - 1)
        return parts.real.sum(-1) - level, -(parts.imag @ np.arange(c.shape[-1]))

    begin, end, mean = wave(low)[1], wave(high)[1], (last - first) / (high - low)
    single = (1.5 * mean - 0.25 * (begin + end)) * mean >= 0
    u, rising = first / (first - last), last > first
    with np.errstate(divide="ignore", invalid="ignore"):  # root of theta as a cubic of the value, where it is one
        s = u * (u * (3 - 2 * u) + (1 - u) * ((1 - u) * mean / begin - u * mean / end))
    at = low + (high - low) * np.where((mean * begin > 0) & (mean * end > 0) & (s > 0) & (s < 1), s, u)
    rounding, done = _ROUNDING * (1 + np.abs(level)), np.zeros(len(level), dtype=bool)
    for _ in range(60):
        value, slope = wave(at)
        beyond = (value < 0) != rising
        low, high = np.where(beyond, low, at), np.where(beyond, at, high)
        change = value / np.where(slope == 0, np.inf, slope)
        done |= np.abs(value) <= rounding
        new = np.where((at - change > low) & (at - change < high), at - change, 0.5 * (low + high))
        last = np.abs(change) <= _LAST_STEP * (slope != 0)  # of Newton, not of a bisection
        at = np.where(done, at, np.where(last, at - change, new))
        done |= last
        if done.all():
            break
    return at, single


def _real_blocks(Z: ComplexArray) -> Array:
    """`basis.real_blocks` of many: (B, H + 1, m, m) -> (B, m, n, m, n), n = 2H + 1."""
    B, m, n = len(Z), Z.shape[-1], 2 * Z.shape[1] - 1
    J = np.zeros((B, m, n, m, n))
    J[:, :, 0, :, 0] = Z[:, 0].real
    re, im = Z.real[:, 1:].transpose(0, 2, 3, 1), Z.imag[:, 1:].transpose(0, 2, 3, 1)
    for i, j, part in ((1, 1, re), (2, 2, re), (1, 2, im), (2, 1, -im)):
        np.einsum("biaja->bija", J[:, :, i::2, :, j::2])[:] = part
    return J


def _norms(x: Array) -> Array:
    """Norms (B,) of the rows of x (B, ...)."""
    flat = np.ascontiguousarray(x).reshape(len(x), -1).view(float)
    return np.sqrt(np.einsum("ij,ij->i", flat, flat))
