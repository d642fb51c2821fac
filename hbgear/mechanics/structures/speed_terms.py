"""Terms of a structure that depend on the frequency of the excitation: gyroscopic terms, bearings.

    M q'' + [C + s Omega G + C_b(Omega)] q' + [K + K_b(Omega)] q + ... = F(tau),   tau = Omega t

with the gyroscopic matrix G, skew-symmetric, of a shaft that rotates at s Omega, and matrices C_b, K_b as functions or
tables of Omega. An excitation by the teeth of a gear with z teeth has Omega = z times the speed of its shaft: s = 1/z.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, Range, checked
from hbgear.common.text.messages import quoted
from hbgear.mechanics.series.fourier import real_numbers
from hbgear.mechanics.structures.matrices import Matrix, square

_MAX_EXTRAPOLATION = 0.02
"""Fraction of the width of a table by which Newton iterations may exceed its ends [-]."""

_SPEED_STEP = 1e-3
"""Step of finite differences over Omega [-]; their relative error is its fourth power."""

_ALLOWED_RATIOS = Range(-1e6, 1e6)  # far beyond any gear

_SYMMETRY_TOLERANCE = 1e-9
"""Relative symmetric part of a gyroscopic matrix [-] that counts as rounding."""


@dataclass(frozen=True, eq=False)
class MatrixTable:  # numpydoc ignore=PR02
    """Table of matrices over Omega, interpolated with a continuous derivative and without overshoot.

    Every entry is interpolated by monotone cubic polynomials (PCHIP).

    Parameters
    ----------
    Omega : array_like, shape (T,)
        Frequencies of the excitation, ascending, at least two.
    matrices : array_like, shape (T, n, n)
        Matrices at these frequencies.

    Raises
    ------
    ValueError
        If the frequencies do not ascend, or the matrices do not fit them, are not square or not finite.

    References
    ----------
    Fritsch and Butland (1984), SIAM J. Sci. Stat. Comput. 5(2), https://doi.org/10.1137/0905021.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> bearing = hb.mechanics.MatrixTable([0.5, 1.0, 2.0], [k * np.eye(2) for k in (1.0, 1.2, 1.3)])
    >>> bool(1.0 < bearing(0.8)[0, 0] < 1.2)
    True
    """

    Omega: Any
    matrices: Any

    def __post_init__(self) -> None:
        Omega = real_numbers("MatrixTable: Omega", self.Omega, "a list of numbers")
        if Omega.ndim != 1 or len(Omega) < 2 or not np.all(np.isfinite(Omega)) or np.any(np.diff(Omega) <= 0):
            raise ValueError(f"MatrixTable: Omega = {Omega} must be two or more frequencies that ascend")
        matrices = real_numbers("MatrixTable: matrices", self.matrices, "matrices of numbers, one for each Omega")
        if matrices.ndim != 3 or matrices.shape[1] != matrices.shape[2] or not matrices.shape[1]:
            raise ValueError(f"MatrixTable: matrices of shape {matrices.shape}; need square ones, (T, n, n)")
        if len(matrices) != len(Omega):
            raise ValueError(f"MatrixTable: {len(matrices)} matrices for {len(Omega)} values of Omega; need one each")
        if not np.all(np.isfinite(matrices)):
            raise ValueError("MatrixTable: matrices has entries that are not finite")
        object.__setattr__(self, "Omega", Omega)
        object.__setattr__(self, "matrices", matrices)
        curve = scipy.interpolate.PchipInterpolator(Omega, matrices, axis=0)
        object.__setattr__(self, "_curve", curve)
        object.__setattr__(self, "_slope", curve.derivative())

    def __call__(self, Omega: float) -> Array:
        """Return the matrix (n, n) at Omega.

        Raises
        ------
        ValueError
            If Omega is outside the table by more than 2 % of its width.
        """
        return self._curve(self._within(Omega))  # type: ignore[attr-defined]

    def slope(self, Omega: float) -> Array:
        """Return the derivative (n, n) in Omega."""
        return self._slope(self._within(Omega))  # type: ignore[attr-defined]

    @property
    def range(self) -> Range:
        """Frequencies of the table."""
        return Range(float(self.Omega[0]), float(self.Omega[-1]))

    def _within(self, Omega: float) -> float:
        """Return Omega, or raise ValueError if it is outside the table."""
        first, last = self.Omega[0], self.Omega[-1]
        margin = _MAX_EXTRAPOLATION * (last - first)
        if not first - margin <= Omega <= last + margin:
            raise ValueError(
                f"Omega = {Omega:g} is outside of a table over Omega from {first:g} to {last:g}: "
                "stay within it, or give a longer table"
            )
        return float(Omega)


OverSpeed: TypeAlias = MatrixTable | Callable[[float], Any]


@dataclass(frozen=True, eq=False)
class SpeedTerms:  # numpydoc ignore=PR02
    """Terms in addition to constant M, C and K:  C + s Omega G + C_b(Omega),  K + K_b(Omega).

    Parameters
    ----------
    gyroscopic : array_like or sparse matrix, shape (n, n), optional
        Matrix G, skew-symmetric. Default: none.
    ratio : float, optional
        Speed of the shaft over Omega, s: 1 for unbalance (default), 1/z for the meshing of z teeth. For a machine with
        several shafts G is the sum of s_i G_i, and the ratio is 1.
    damping, stiffness : MatrixTable or callable, optional
        C_b and K_b, as a table or a function of Omega that returns a matrix (n, n). Default: none.

    Raises
    ------
    ValueError
        If G is not square, not finite or not skew-symmetric, or no term is given.
    TypeError
        If damping or stiffness is not a table or a function.

    Examples
    --------
    A disc on an elastic shaft that turns with Omega: its tilts are coupled by the polar moment of inertia.

    >>> import hbgear as hb
    >>> import numpy as np
    >>> G = np.array([[0.0, 0.3], [-0.3, 0.0]])
    >>> seal = hb.Element([1.0, 0.0], hb.Unilateral(k=5.0, gap=2.0))
    >>> unbalance = hb.Load(cosine={1: [0.01, 0.0]}, sine={1: [0.0, 0.01]}, power=2)
    >>> disc = hb.System(np.eye(2), 0.01 * np.eye(2), np.eye(2), [seal], unbalance, speed=hb.mechanics.SpeedTerms(G))
    >>> curve = hb.trace(hb.HarmonicBalance(disc, 4), "Omega", (0.5, 1.5))
    >>> curve.status.complete
    True
    """

    gyroscopic: Any = None
    ratio: float = 1.0
    damping: OverSpeed | None = None
    stiffness: OverSpeed | None = None

    def __post_init__(self) -> None:
        checked("SpeedTerms", "ratio", self.ratio, _ALLOWED_RATIOS)
        object.__setattr__(self, "ratio", float(self.ratio))  # fractions are accepted
        if self.gyroscopic is not None:
            G = square("gyroscopic", self.gyroscopic)
            symmetric_part = abs(G + G.T).max()
            if symmetric_part > _SYMMETRY_TOLERANCE * abs(G).max():
                raise ValueError(
                    f"gyroscopic must be skew-symmetric, G^T = -G; G + G^T has an entry of {symmetric_part:.3g}: "
                    "give dissipative terms in C or damping"
                )
            object.__setattr__(self, "gyroscopic", G)
        for name in ("damping", "stiffness"):
            term = getattr(self, name)
            if term is not None and not callable(term):
                raise TypeError(f"SpeedTerms: {name} = {quoted(term)} must be a MatrixTable or a function of Omega")
        if self.gyroscopic is None and self.damping is None and self.stiffness is None:
            raise ValueError("SpeedTerms: give gyroscopic, damping or stiffness; a constant structure needs none")

    def check(self, n: int) -> None:
        """Raise ValueError for terms that are not of n coordinates, as far as they are known without a frequency.

        Parameters
        ----------
        n : int
            Number of coordinates.

        Raises
        ------
        ValueError
            If a matrix has another shape.
        """
        sizes = {"gyroscopic": self.gyroscopic}
        sizes |= {
            name: getattr(self, name).matrices[0]
            for name in ("damping", "stiffness")
            if isinstance(getattr(self, name), MatrixTable)
        }
        for name, A in sizes.items():
            if A is not None and A.shape != (n, n):
                raise ValueError(f"{name} has shape {A.shape}; need {(n, n)}, the shape of M")

    @property
    def range(self) -> Range:
        """Frequencies Omega at which all terms are defined."""
        ranges = [table.range for table in (self.damping, self.stiffness) if isinstance(table, MatrixTable)]
        low = max((table.low for table in ranges), default=0.0)
        if not ranges:
            return POSITIVE
        high = min(table.high for table in ranges)
        if high <= max(low, 0.0):
            raise ValueError(
                f"SpeedTerms: the tables have no Omega in common; one begins at {low:g}, one ends at {high:g}"
            )
        return Range(low, high) if low > 0 else Range(above=0, high=high)

    def projected(self, basis: Array) -> SpeedTerms:
        """Return the terms in the coordinates p of q = basis p: B^T A B of all matrices.

        Parameters
        ----------
        basis : ndarray, shape (n, r)
            Basis B.

        Returns
        -------
        SpeedTerms
            Projected terms.
        """

        def project(A: Any) -> Array:
            return basis.T @ (A @ basis)

        def term(table: OverSpeed | None) -> OverSpeed | None:
            if isinstance(table, MatrixTable):
                return MatrixTable(table.Omega, [project(A) for A in table.matrices])
            return None if table is None else lambda Omega: project(table(Omega))

        G = None if self.gyroscopic is None else project(self.gyroscopic)
        G = G if G is None else 0.5 * (G - G.T)  # exactly skew-symmetric in spite of rounding
        return SpeedTerms(G, self.ratio, term(self.damping), term(self.stiffness))

    def at(self, Omega: float, n: int) -> tuple[Matrix, Matrix]:
        """Return the matrices added to C and K at Omega, each (n, n) or 0."""
        C: Any = 0.0 if self.gyroscopic is None else (self.ratio * Omega) * self.gyroscopic
        return C + _value("damping", self.damping, Omega, n), _value("stiffness", self.stiffness, Omega, n)

    def slope(self, Omega: float, n: int) -> tuple[Matrix, Matrix]:
        """Return the derivatives of `at` in Omega."""
        C: Any = 0.0 if self.gyroscopic is None else self.ratio * self.gyroscopic
        return C + _slope("damping", self.damping, Omega, n), _slope("stiffness", self.stiffness, Omega, n)


def _value(name: str, term: OverSpeed | None, Omega: float, n: int) -> Any:
    """Return a term at Omega; 0 if the term is None."""
    if term is None:
        return 0.0
    if isinstance(term, MatrixTable):
        return term(Omega)
    return square(f"{name} at Omega = {Omega:g}", term(Omega), n)


def _slope(name: str, term: OverSpeed | None, Omega: float, n: int) -> Any:
    """Return dA/dOmega; of a function by central differences of fourth order."""
    if term is None:
        return 0.0
    if isinstance(term, MatrixTable):
        return term.slope(Omega)
    h = _SPEED_STEP * Omega
    fine, coarse = ((_value(name, term, Omega + d, n) - _value(name, term, Omega - d, n)) / (2 * d) for d in (h, 2 * h))
    return (4 * fine - coarse) / 3
