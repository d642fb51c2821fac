"""Laws that are sampled: force harmonics from N samples per period by fast Fourier transform.

References
----------
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.law_checks import check_returned
from hbgear.harmonic.forces.real_basis import after_derivative, derivative, one_sided
from hbgear.mechanics.laws.laws import Forces, Law
from hbgear.mechanics.series.fourier import Transform, derive, samples_of, to_complex, to_real


class SampledLaws:
    """Some laws of a model, by samples.

    Parameters
    ----------
    laws : of all elements; elements : numbers of those that are sampled. nu : subharmonic order.
    grid : (2, m, N) what gaps have beside the unknowns, and its derivative in theta; N = 0 for nothing.
    """

    def __init__(self, laws: Sequence[Law], elements: np.ndarray, transform: Transform, nu: int, grid: Array) -> None:
        self.elements, self.nu, self._transform = elements, nu, transform
        self.laws = [laws[j] for j in elements]
        self._grid = grid[:, elements] if grid.shape[2] else np.zeros((2, len(elements), 1))
        self.rated = any(law.rated for law in self.laws)
        self._bound = [_bound(law, 2 * np.pi * nu * np.arange(transform.N) / transform.N) for law in self.laws]

    def forces(self, rows: Array, Omega: float) -> tuple[Array, Array, Array | None, Array | float]:
        """Force harmonics (s, 2H + 1) of the s laws, and their derivatives (s, 2H + 1, 2H + 1) in d and d'.

        rows (m, 2H + 1) are the motions of all elements; the second derivative is None if no law depends on d'. Last
        come the harmonics (s, 2H + 1) of the damping times what gaps have beside the unknowns, 0 if nothing.
        """
        c = to_complex(rows[self.elements])
        waves = [c, Omega / self.nu * derive(c)] if self.rated else [c]
        samples = self._transform.samples(np.concatenate(waves)).reshape(len(waves), len(c), -1)
        samples[0] += self._grid[0]
        if self.rated:
            samples[1] += Omega / self.nu * self._grid[1]
        rest = np.zeros(self._transform.N)
        found = [law(d, samples[1, i] if self.rated else rest) for i, (law, d) in enumerate(
            zip(self._bound, samples[0], strict=True))]  # fmt: skip
        p, stiffness, damping = (np.array(parts) for parts in zip(*found, strict=True))
        damped = self.rated and bool(damping.any())
        spectra = self._transform.spectrum(np.concatenate([p, stiffness, damping] if damped else [p, stiffness]))
        force, *slopes = spectra.reshape(-1, len(self.laws), spectra.shape[-1])
        T = [products(one) for one in slopes]
        H = rows.shape[1] // 2
        moved: Array | float = 0.0
        if damped and self._grid.any():
            moved = to_real(one_sided(self._transform.spectrum(damping * self._grid[1])[:, : H + 1]))
        return to_real(one_sided(force[:, : H + 1])), T[0], T[1] if damped else None, moved

    def add_to(self, rows: Array, Omega: float, R: Array, J: Array, dR: Array) -> float:
        """Add the forces to the balance of all elements, R, J and dR; the norm of the forces."""
        m, n = rows.shape
        f, stiffness, damping, moved = self.forces(rows, Omega)
        R.reshape(m, n)[self.elements] += f
        dR.reshape(m, n)[self.elements] += moved / self.nu
        blocks = J.reshape(m, n, m, n)
        for i, j in enumerate(self.elements):
            blocks[j, :, j] += stiffness[i]
            if damping is not None:
                blocks[j, :, j] += after_derivative(damping[i]) * (Omega / self.nu)
                dR.reshape(m, n)[j] += damping[i] @ derivative(rows[j]) / self.nu
        return float(np.linalg.norm(f))

    def add_neglected(self, X: Array, Omega: Array, left: np.ndarray, f: ComplexArray) -> None:
        """Put the force harmonics ``left`` (L,) of motions X (P, n) into f (P, m, L), as far as N samples reach."""
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


def _bound(law: Law, tau: Array) -> Callable[[Array, Array], Forces]:
    """The law at phases tau.

    Raises
    ------
    ValueError
        If it does not give three arrays of the shape of the displacements.
    """
    bound, rest = law.bind(tau), np.zeros(len(tau))
    with np.errstate(all="ignore"):
        check_returned(law, bound(rest, rest), tau.shape)
    return bound


def products(kappa: ComplexArray) -> Array:
    """Real matrices (s, 2H + 1, 2H + 1) of products with functions of two-sided coefficients 0..2H, (s, 2H + 1)."""
    from hbgear.harmonic.forces.toeplitz_kernel import add_product

    out: Array = np.zeros((len(kappa), kappa.shape[1], kappa.shape[1]))
    for one, T in zip(np.ascontiguousarray(kappa), out, strict=True):
        add_product(one, np.arange(len(T) // 2 + 1), T)
    return out
