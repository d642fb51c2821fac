"""Layout of the unknowns of tori: names of the elements and measures of amplitude.

The measures refer to the whole torus, which a quasi-periodic motion fills densely: rms is the root mean square of the
alternating part, max the largest modulus, pp2 half the distance between largest and smallest value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.autonomous.tori.basis import TorusBasis
from hbgear.harmonic.equations.layout import ElementLayout

SECOND = "Omega_2"
"""Name of the second frequency."""


@dataclass(frozen=True)
class TorusLayout(ElementLayout):
    """Meaning of the unknowns of a torus.

    Attributes
    ----------
    harmonics : tuple of int
        Highest harmonics H_1 and H_2 of both phases.
    elements : tuple of str
        Names of the m elements.
    nu : int
        Subharmonic order of the first phase, theta_1 = tau / nu.
    labels : dict
        Axis labels of the parameters.
    odd : bool
        Whether only odd harmonics of the first phase are unknowns.
    dense : int
        Factor of the number of samples.
    band : float or None
        Highest frequency over that of the first phase, if the indices fill a band instead of a diamond.
    ratio : float
        Second frequency over the first one, for ``band``.
    half : tuple of int or None
        Kind of doubled tori, whose phases are half the phases of the excitation; see `TorusBasis`.
    """

    harmonics: tuple[int, int]
    elements: tuple[str, ...]
    nu: int
    labels: dict[str, str] = field(default_factory=dict)
    odd: bool = False
    dense: int = 1
    band: float | None = None
    ratio: float = 1.0
    half: tuple[int, int] | None = None

    @property
    def basis(self) -> TorusBasis:
        """Fourier basis."""
        return _basis(*self.harmonics, self.odd, self.dense, self.band, self.ratio, self.half)

    @property
    def width(self) -> int:
        """Number of unknowns."""
        return len(self.elements) * self.basis.width

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the regime codes."""
        return ("quasi-periodic",)

    def rows(self, X: Array, element: int | str) -> Array:
        """Return the unknowns (..., 2K - 1) of an element."""
        return X.reshape(*X.shape[:-1], len(self.elements), -1)[..., self.index(element), :]

    def check_measure(self, name: str, element: int | str = 0) -> None:
        """Raise an error for the name of an unknown measure or element."""
        self.index(element)
        if name not in _MEASURES:
            raise ValueError(f"a torus has no measure '{name}'; choose one of {', '.join(_MEASURES)}")

    def measure_rows(self, name: str, rows: Array) -> Array:
        """Return a measure of unknowns (..., 2K - 1) of one element."""
        self.check_measure(name)
        c = self.basis.to_complex(rows)
        flat = [_MEASURES[name](self.basis, row) for row in c.reshape(-1, c.shape[-1])]
        return np.array(flat).reshape(c.shape[:-1])

    def samples(self, X: Array, element: int | str, count: int, order: int) -> tuple[Array, Array]:
        """Return phases theta_2 and values of an element on the section theta_1 = 0, or derivatives in theta_2."""
        theta = 2 * np.pi * np.arange(count) / count
        c = self.basis.to_complex(self.rows(X, element)) * (1j * self.basis.k[:, 1]) ** order
        return theta, self.basis.evaluate(c, np.column_stack([np.zeros(count), theta]))

    def in_time(self, rows: Array, parameters: Mapping[str, Array], order: int) -> Array:
        """Return the unknowns of a derivative in time, for rows (P, 2K - 1) and frequencies (P,)."""
        omega = np.stack([parameters["Omega"] / self.nu, parameters["Omega_2"]], axis=-1)
        return self.basis.to_real(self.basis.to_complex(rows) * (1j * (omega @ self.basis.k.T)) ** order)

    def spectrum_end(self, X: Array) -> float:
        """Return the norm of the outermost coefficients of both phases over the norm of the modulation.

        Those of one phase are not counted, because they may be harmonics of an excitation.
        """
        moving, c = self.basis.k[:, 1] > 0, self.basis.to_complex(X.reshape(len(self.elements), -1))
        mixed = moving & (self.basis.k[:, 0] != 0)
        total = float(np.linalg.norm(c[:, moving]))
        return float(np.linalg.norm(c[:, mixed & self.basis.outermost])) / max(total, 1e-300)

    def outermost_rms(self, X: Array) -> float:
        """Return the rms of the outermost coefficients of all elements, a coarse estimate of the error of a motion."""
        c = self.basis.to_complex(X.reshape(len(self.elements), -1))
        return self.basis.rms(np.where(self.basis.outermost, c, 0.0))


_basis = lru_cache(maxsize=8)(TorusBasis)
"""Bases by their arguments."""


def _rms(basis: TorusBasis, c: ComplexArray) -> float:
    return float(np.linalg.norm(c[1:]) / np.sqrt(2.0))


def _extremum(basis: TorusBasis, c: ComplexArray, sign: int) -> float:
    """Return the maximum (sign = 1) or minimum (-1): the extreme sample, corrected by a Newton step."""
    values = basis.samples(c)
    index = np.unravel_index(np.argmax(sign * values), values.shape)
    theta = 2 * np.pi * np.array(index) / basis.shape
    wave = c * np.exp(1j * (basis.k @ theta))
    slope = basis.k.T @ (1j * wave).real
    curvature = -(basis.k.T * wave.real) @ basis.k
    step = np.linalg.lstsq(curvature, -slope, rcond=1e-9)[0]
    refined = basis.evaluate(c, (theta + step)[None])[0] if np.abs(step).max() < 0.5 else values[index]
    return float(max(sign * refined, sign * values[index]) * sign)


def _pp2(basis: TorusBasis, c: ComplexArray) -> float:
    return 0.5 * (_extremum(basis, c, 1) - _extremum(basis, c, -1))


def _max(basis: TorusBasis, c: ComplexArray) -> float:
    return max(abs(_extremum(basis, c, 1)), abs(_extremum(basis, c, -1)))


def _mean(basis: TorusBasis, c: ComplexArray) -> float:
    return float(c[0].real)


_MEASURES: dict[str, Callable[[TorusBasis, ComplexArray], float]] = {
    "rms": _rms,
    "pp2": _pp2,
    "max": _max,
    "mean": _mean,
}
"""Measures of amplitude by name."""
