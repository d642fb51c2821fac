"""AFT (alternating frequency/time): force harmonics from N samples per period by fast Fourier transform.

    d_k -> d(theta_n) -> p(d, d', tau) -> f_k,   theta_n = 2 pi n / N

Laws of several displacements whose force jumps at known phases are integrated between these phases by Gauss points.

References
----------
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.law_checks import check_returned
from hbgear.mechanics.laws.laws import Forces, Law
from hbgear.mechanics.laws.vector_laws import VectorLaw
from hbgear.mechanics.series.fourier import Transform, derive, samples_of, to_complex, to_real
from hbgear.mechanics.series.real_basis import after_derivative, derivative, one_sided

GAUSS_POINTS = 4
"""Gauss points of a panel between jumps of a law."""


class SampledLaws:
    """Laws in Python, evaluated by AFT.

    Parameters
    ----------
    laws : sequence of Law
        Laws of all elements.
    elements : ndarray
        Numbers of the elements whose laws are evaluated by AFT.
    transform : Transform
        Fourier transform with N samples per basis period.
    nu : int
        Subharmonic order.
    grid : ndarray, shape (2, m, N)
        Samples of the part of the displacements that is not in the unknowns (prescribed displacements with
        breakpoints), and of its derivative in theta. N = 0 without such displacements.
    """

    def __init__(self, laws: Sequence[Law], elements: np.ndarray, transform: Transform, nu: int, grid: Array) -> None:
        self.elements, self.nu, self._transform = elements, nu, transform
        self.laws = [laws[j] for j in elements]
        self._grid = grid[:, elements] if grid.shape[2] else np.zeros((2, len(elements), 1))
        self.rated = any(law.rated for law in self.laws)
        self._bind = [_bind(law, 2 * np.pi * nu * np.arange(transform.N) / transform.N) for law in self.laws]

    def forces(self, coefficients: Array, Omega: float) -> tuple[Array, Array, Array | None, Array | float]:
        """Return force harmonics (s, 2H + 1) of the s laws and their derivatives (s, 2H + 1, 2H + 1) in d and d'.

        coefficients (m, 2H + 1) are those of all elements. The derivative in d' is None if no law depends on it. The
        fourth value is the harmonics (s, 2H + 1) of the damping times the velocity of prescribed displacements with
        breakpoints, 0 without any.
        """
        c = to_complex(coefficients[self.elements])
        waves = [c, Omega / self.nu * derive(c)] if self.rated else [c]
        samples = self._transform.samples(np.concatenate(waves)).reshape(len(waves), len(c), -1)
        samples[0] += self._grid[0]
        if self.rated:
            samples[1] += Omega / self.nu * self._grid[1]
        rest = np.zeros(self._transform.N)
        found = [law(d, samples[1, i] if self.rated else rest) for i, (law, d) in enumerate(
            zip(self._bind, samples[0], strict=True))]  # fmt: skip
        p, stiffness, damping = (np.array(parts) for parts in zip(*found, strict=True))
        damped = self.rated and bool(damping.any())
        spectra = self._transform.spectrum(np.concatenate([p, stiffness, damping] if damped else [p, stiffness]))
        force, *slopes = spectra.reshape(-1, len(self.laws), spectra.shape[-1])
        T = [product_matrices(one) for one in slopes]
        H = coefficients.shape[1] // 2
        imposed: Array | float = 0.0
        if damped and self._grid.any():
            imposed = to_real(one_sided(self._transform.spectrum(damping * self._grid[1])[:, : H + 1]))
        return to_real(one_sided(force[:, : H + 1])), T[0], T[1] if damped else None, imposed

    def add_to(self, coefficients: Array, Omega: float, R: Array, J: Array, dR: Array) -> float:
        """Add forces and slopes to R, J and dR of all elements; return the norm of the forces."""
        m, n = coefficients.shape
        f, stiffness, damping, imposed = self.forces(coefficients, Omega)
        R.reshape(m, n)[self.elements] += f
        dR.reshape(m, n)[self.elements] += imposed / self.nu
        blocks = J.reshape(m, n, m, n)
        for i, j in enumerate(self.elements):
            blocks[j, :, j] += stiffness[i]
            if damping is not None:
                blocks[j, :, j] += after_derivative(damping[i]) * (Omega / self.nu)
                dR.reshape(m, n)[j] += damping[i] @ derivative(coefficients[j]) / self.nu
        return float(np.linalg.norm(f))

    def add_truncated(self, X: Array, Omega: Array, left: np.ndarray, f: ComplexArray) -> None:
        """Fill f (P, m, L) with the truncated force harmonics ``left`` (L,) of motions X (P, n), up to N / 2."""
        P, m, _ = f.shape
        N = self._transform.N
        reached = left[left < N // 2]
        c = to_complex(X.reshape(P, m, -1))[:, self.elements]
        velocity = samples_of((Omega / self.nu)[:, None, None] * derive(c), N)
        velocity += (Omega / self.nu)[:, None, None] * self._grid[1]
        tau = np.tile(2 * np.pi * self.nu * np.arange(N) / N, P)
        for i, (j, d) in enumerate(zip(self.elements, (samples_of(c, N) + self._grid[0]).swapaxes(0, 1), strict=True)):
            p = self.laws[i].force(d.ravel(), velocity[:, i].ravel(), tau)[0].reshape(P, -1)
            f[:, j, : len(reached)] = 2 * np.fft.rfft(p)[:, reached] / N


class SampledVectorLaws:
    """Laws of several displacements, evaluated by AFT.

    Parameters
    ----------
    groups : sequence of (ndarray, VectorLaw)
        Numbers of the elements of each law, see `vector_groups`.
    transform : Transform
        Fourier transform with N samples per basis period.
    nu : int
        Subharmonic order.
    """

    def __init__(self, groups: Sequence[tuple[np.ndarray, VectorLaw]], transform: Transform, nu: int) -> None:
        self.groups, self.nu, self._transform = groups, nu, transform
        self._tau = 2 * np.pi * nu * np.arange(transform.N) / transform.N
        self._between = [_PhaseSegments(law.phases, nu, transform.N) if law.phases else None for _, law in groups]

    def add_to(self, coefficients: Array, Omega: float, R: Array, J: Array, dR: Array) -> float:
        """Add forces and slopes to R, J and dR of all elements; return the norm of the forces."""
        m, n = coefficients.shape
        blocks, size = J.reshape(m, n, m, n), 0.0
        for (elements, law), between in zip(self.groups, self._between, strict=True):
            if between is not None and not law.rated:
                size += between.add_to(law, elements, coefficients, R.reshape(m, n), blocks)
                continue
            c, p = to_complex(coefficients[elements]), len(elements)
            d = self._transform.samples(c)
            v = Omega / self.nu * self._transform.samples(derive(c)) if law.rated else np.zeros_like(d)
            force, kd, kv = law.force(d, v, self._tau)
            f = to_real(one_sided(self._transform.spectrum(force)[:, : n // 2 + 1]))
            R.reshape(m, n)[elements] += f
            size += float(np.linalg.norm(f))
            T = product_matrices(self._transform.spectrum(kd.reshape(p * p, -1))).reshape(p, p, n, n)
            blocks[np.ix_(elements, np.arange(n), elements)] += T.transpose(0, 2, 1, 3)
            if law.rated and kv.any():
                T = product_matrices(self._transform.spectrum(kv.reshape(p * p, -1))).reshape(p, p, n, n)
                blocks[np.ix_(elements, np.arange(n), elements)] += (
                    Omega / self.nu * after_derivative(T).transpose(0, 2, 1, 3)
                )
                rates = derivative(coefficients[elements])
                dR.reshape(m, n)[elements] += np.einsum("ijab,jb->ia", T, rates) / self.nu
        return size

    def add_truncated(self, X: Array, Omega: Array, left: np.ndarray, f: ComplexArray) -> None:
        """Add the truncated force harmonics ``left`` (L,) of motions X (P, n), up to N / 2, to f (P, m, L)."""
        N, m = self._transform.N, f.shape[1]
        reached = left[left < N // 2]
        c = to_complex(X.reshape(len(X), m, -1))
        for elements, law in self.groups:
            d = samples_of(c[:, elements], N).swapaxes(0, 1).reshape(len(elements), -1)
            rates = (Omega / self.nu)[:, None, None] * derive(c[:, elements])
            v = samples_of(rates, N).swapaxes(0, 1).reshape(len(elements), -1)
            p = law.force(d, v, np.tile(self._tau, len(X)))[0].reshape(len(elements), len(X), N).swapaxes(0, 1)
            f[:, elements, : len(reached)] += 2 * np.fft.rfft(p)[..., reached] / N


class _PhaseSegments:
    """Integration over the phase between jumps of a law, by panels of Gauss points.

    Parameters
    ----------
    phases : sequence of float
        Phases tau at which the force or a derivative jumps.
    nu : int
        Subharmonic order.
    N : int
        Smallest number of points per basis period.
    """

    def __init__(self, phases: Sequence[float], nu: int, N: int) -> None:
        turn = 2 * np.pi
        cuts = np.unique([0.0, turn, *((phase % turn + turn * i) / nu for phase in phases for i in range(nu))])
        cuts = cuts[np.diff(cuts, prepend=-1.0) > 1e-12]
        x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        theta, weights = [], []
        for a, b in pairwise(cuts.tolist()):
            count = math.ceil(N * (b - a) / (turn * GAUSS_POINTS))
            edges = np.linspace(a, b, count + 1)
            half = 0.5 * np.diff(edges)[:, None]
            theta.append((edges[:-1, None] + half * (1 + x)).ravel())
            weights.append((half * w / np.pi).ravel())
        self.theta, self.weights = np.concatenate(theta), np.concatenate(weights)
        self.tau, self._basis = nu * self.theta, np.zeros((0, 0))

    def basis(self, n: int) -> Array:
        """Return 1, cos and sin of the harmonics at the points, (n, Q)."""
        if len(self._basis) != n:
            k = np.arange(1, n // 2 + 1)[:, None]
            waves = np.stack([np.cos(k * self.theta), np.sin(k * self.theta)], axis=1).reshape(n - 1, -1)
            self._basis = np.concatenate([np.ones((1, len(self.theta))), waves])
        return self._basis

    def add_to(self, law: VectorLaw, elements: np.ndarray, coefficients: Array, R: Array, blocks: Array) -> float:
        """Add forces to R (m, n) and slopes to blocks (m, n, m, n); return the norm of the forces."""
        B = self.basis(coefficients.shape[1])
        d = coefficients[elements] @ B
        force, kd, _ = law.force(d, np.zeros_like(d), self.tau)
        weighted = self.weights * B
        weighted[0] *= 0.5
        f = force @ weighted.T
        R[elements] += f
        for i, j in np.argwhere(kd.any(axis=2)):
            blocks[elements[i], :, elements[j]] += weighted @ (kd[i, j] * B).T
        return float(np.linalg.norm(f))


def _bind(law: Law, tau: Array) -> Callable[[Array, Array], Forces]:
    """Return the law at fixed phases tau.

    Raises
    ------
    ValueError
        If the law does not return three arrays of the shape of the displacements.
    """
    bound, rest = law.bind(tau), np.zeros(len(tau))
    with np.errstate(all="ignore"):
        check_returned(law, bound(rest, rest), tau.shape)
    return bound


def product_matrices(kappa: ComplexArray) -> Array:
    """Return the real matrices (s, 2H + 1, 2H + 1) of products with functions of two-sided coefficients."""
    from hbgear.harmonic.forces.toeplitz_kernel import add_product

    out: Array = np.zeros((len(kappa), kappa.shape[1], kappa.shape[1]))
    for one, T in zip(np.ascontiguousarray(kappa), out, strict=True):
        add_product(one, np.arange(len(T) // 2 + 1), T)
    return out
