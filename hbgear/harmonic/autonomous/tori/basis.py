"""Fourier basis of two phases: coefficients, samples on a grid, products.

    d(theta_1, theta_2) = Re sum_k c_k e^{i (k_1 theta_1 + k_2 theta_2)},   c_k = a_k - i b_k

The indices k lie in half a plane (k_2 > 0, or k_2 = 0 and k_1 >= 0), within the diamond |k_1| / H_1 + |k_2| / H_2 <= 1.
The unknowns of one element are (a_0, ..., a_(K-1), b_1, ..., b_(K-1)), b_0 = 0.
"""

from __future__ import annotations

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray

_OVERSAMPLING = 4
"""Samples per highest harmonic [-]. Products of three functions of the basis are exact with more than four."""

_INDEX_ROUNDING = 1e-12
"""Rounding of the distance of an index [-]."""

_OUTER_SHARE = 0.1
"""Share of the largest distance from the origin [-] within which an index is one of the outermost.

It is at least one step of the coarser phase: coefficients of symmetric laws are zero at every other step."""


class TorusBasis:
    """Indices, grid and products of functions of two phases.

    Parameters
    ----------
    H1, H2 : int
        Highest harmonics of the two phases.
    odd : bool, optional
        Whether only odd harmonics of the first phase are kept: motions with x(theta_1 + pi) = -x(theta_1).
    dense : int, optional
        Factor of the number of samples. Default: 1.
    band : float, optional
        Highest frequency over that of the first phase: instead of the diamond, all indices up to H1 and H2 with
        |k_1 + k_2 ratio| <= band are kept. By default the diamond.
    ratio : float, optional
        Second frequency over the first one, for ``band``. Default: 1.
    half : (int, int), optional
        With phases of half the excitation: indices equal to (0, 0) or to this pair modulo 2 are kept, which are the
        motions of one kind of doubled tori. By default all indices.

    Attributes
    ----------
    k : ndarray of int, shape (K, 2)
        Indices; the first one is (0, 0).
    shape : tuple of int
        Number of samples of the two phases.
    """

    def __init__(
        self,
        H1: int,
        H2: int,
        odd: bool = False,
        dense: int = 1,
        band: float | None = None,
        ratio: float = 1.0,
        half: tuple[int, int] | None = None,
    ) -> None:
        self.H1, self.H2, self.odd, self.dense, self.band, self.ratio, self.half = H1, H2, odd, dense, band, ratio, half
        k2, k1 = (grid.ravel() for grid in np.meshgrid(np.arange(H2 + 1), np.arange(-H1, H1 + 1), indexing="ij"))
        keep = ((k2 > 0) | (k1 >= 0)) & (self._distance(k1, k2) <= 1 + _INDEX_ROUNDING)
        if odd:
            keep &= (k1 % 2 == 1) | ((k1 == 0) & (k2 == 0))
        if half is not None:
            keep &= ((k1 % 2 == 0) & (k2 % 2 == 0)) | ((k1 % 2 == half[0]) & (k2 % 2 == half[1]))
        self.k = np.stack([k1[keep], k2[keep]], axis=1)
        self.positions = {tuple(k): i for i, k in enumerate(self.k.tolist())}
        highest = np.abs(self.k).max(axis=0).tolist()
        self.shape = tuple(int(scipy.fft.next_fast_len(dense * (_OVERSAMPLING * H + 2), real=True)) for H in highest)
        self._positions = self.k[:, 0] % self.shape[0], self.k[:, 1]
        self._mirrored = (-self.k[1:, 0]) % self.shape[0], self.k[1:, 1] == 0
        minus, plus = (self.k[:, None] + sign * self.k for sign in (-1, 1))
        self._minus, self._plus = ((n[..., 0] % self.shape[0], n[..., 1] % self.shape[1]) for n in (minus, plus))

    def _distance(self, k1: np.ndarray, k2: np.ndarray) -> np.ndarray:
        """Return the distance of indices from the origin, 1 on the boundary of the diamond or the band."""
        if self.band is None:
            return np.asarray(np.abs(k1) / self.H1 + k2 / self.H2)
        return np.asarray(
            np.maximum(np.maximum(np.abs(k1) / self.H1, k2 / self.H2), np.abs(k1 + k2 * self.ratio) / self.band)
        )

    def periodic(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of the indices (k_1, 0), k_1 < count, of the first phase alone, and their k_1."""
        positions = np.flatnonzero((self.k[:, 1] == 0) & (self.k[:, 0] < count))
        return positions, self.k[positions, 0]

    @property
    def outermost(self) -> np.ndarray:
        """Whether an index (K,) lies in the outermost tenth of the diamond or the band, or the last two steps."""
        distance = self._distance(self.k[:, 0], self.k[:, 1])
        share = max(_OUTER_SHARE, (1 if self.half is None else 2) / min(self.H1, self.H2))
        return np.asarray(distance >= (1 - share) * distance[self.k[:, 1] > 0].max() - _INDEX_ROUNDING)

    def rms(self, c: ComplexArray) -> float:
        """Return the root mean square of functions with coefficients (..., K), added over all of them."""
        weight = np.where(self.k.any(axis=1), 0.5, 1.0)
        return float(np.sqrt(np.sum(weight * np.abs(c) ** 2)))

    def finer(self) -> TorusBasis:
        """Return the basis with twice the harmonics, at least two more."""
        band = None if self.band is None else 2 * self.band
        H1, H2 = (max(2 * H, H + 2 * (1 if self.half is None else 2)) for H in (self.H1, self.H2))
        return TorusBasis(H1, H2, self.odd, self.dense, band, self.ratio, self.half)

    @property
    def width(self) -> int:
        """Number of real unknowns of an element."""
        return 2 * len(self.k) - 1

    def to_complex(self, X: Array) -> ComplexArray:
        """Return coefficients c (..., K) from unknowns (..., 2K - 1)."""
        K = len(self.k)
        out = X[..., :K].astype(complex)
        out[..., 1:] -= 1j * X[..., K:]
        return out

    def to_real(self, c: ComplexArray) -> Array:
        """Return unknowns (..., 2K - 1) from coefficients (..., K)."""
        return np.concatenate([c.real, -c.imag[..., 1:]], axis=-1)

    def samples(self, c: ComplexArray) -> Array:
        """Return samples (..., N1, N2) of functions with coefficients (..., K)."""
        N1, N2 = self.shape
        spectrum = np.zeros((*c.shape[:-1], N1, N2 // 2 + 1), dtype=complex)
        spectrum[..., self._positions[0], self._positions[1]] = 0.5 * N1 * N2 * c
        spectrum[..., 0, 0] *= 2.0
        rows, real_line = self._mirrored
        spectrum[..., rows[real_line], 0] = 0.5 * N1 * N2 * c[..., 1:][..., real_line].conj()
        return scipy.fft.irfft2(spectrum, s=self.shape)

    def coefficients(self, samples: Array) -> ComplexArray:
        """Return coefficients (..., K) of functions with samples (..., N1, N2)."""
        c = 2.0 * scipy.fft.rfft2(samples)[..., self._positions[0], self._positions[1]] / np.prod(self.shape)
        c[..., 0] = 0.5 * c[..., 0].real
        return c

    def product(self, samples: Array) -> Array:
        """Return the matrix (2K - 1, 2K - 1) of the product with a function with samples (N1, N2)."""
        S, K = scipy.fft.fft2(samples) / np.prod(self.shape), len(self.k)
        minus, plus = S[self._minus], S[self._plus]
        out = np.empty((self.width, self.width))
        out[:K, :K] = minus.real + plus.real
        out[:K, K:] = (minus - plus).imag[:, 1:]
        out[K:, :K] = -(minus + plus).imag[1:]
        out[K:, K:] = (minus - plus).real[1:, 1:]
        out[0] *= 0.5
        return out

    def evaluate(self, c: ComplexArray, theta: Array) -> Array:
        """Return the values (..., T) at phases theta (T, 2)."""
        return (c @ np.exp(1j * (self.k @ theta.T))).real

    def convert(self, X: Array, source: TorusBasis) -> Array:
        """Return unknowns (..., 2K - 1) of this basis from unknowns of another one, cut or padded with zeros."""
        c = source.to_complex(X)
        out = np.zeros((*X.shape[:-1], len(self.k)), dtype=complex)
        for k, i in source.positions.items():
            if k in self.positions:
                out[..., self.positions[k]] = c[..., i]
        return self.to_real(out)
