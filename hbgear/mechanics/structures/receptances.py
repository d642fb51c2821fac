"""Measured receptances over frequency as a linear part of a system.

    q(w) = H(w) F(w)   of some coordinates,   D(w) = K + i w C - w^2 M + S H(w)^-1 S^T

with S (n, p) that selects these coordinates from the n of the system. A structure that is measured as a whole has no
M, C and K. Harmonic balance needs only D at the harmonics of a motion. Modes, and with them multipliers and time
integration, are not available.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.facade import call
from hbgear.common.ranges import ANY, checked
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.mechanics.series.fourier import is_listed, real_numbers

_MAX_EXTRAPOLATION = 0.02
"""Fraction of the first and last frequency by which Newton iterations may exceed the lines, by linear extrapolation."""

_FREQUENCY_TOLERANCE = 1e-9
"""Relative difference of frequencies that counts as rounding [-]."""

_MIN_SINGULAR_VALUE_RATIO = 1e-13
"""Ratio of the singular values of a receptance [-] at which it counts as singular."""


def vector_along(names: Sequence[str], coordinates: Mapping[str | int, float]) -> Array:
    """Return a vector (n,) with given values of coordinates, by name or number from 0, and zeros otherwise.

    Raises
    ------
    KeyError, IndexError
        If there is no such coordinate.
    ValueError
        If the mapping is empty, or a value is not a finite number.
    """
    if not isinstance(coordinates, Mapping) or not coordinates:
        raise ValueError(f"along: {quoted(coordinates)} must be values by coordinate, such as {{'{names[0]}': 1.0}}")
    out = np.zeros(len(names))
    for name, value in coordinates.items():
        checked("along", str(name), value, ANY)
        out[_index_of(names, name)] = value
    return out


def _index_of(names: Sequence[str], name: Any) -> int:
    """Return the number of a coordinate given by name or number."""
    if isinstance(name, int | np.integer) and not isinstance(name, bool):
        if not 0 <= name < len(names):
            raise IndexError(
                f"there is no coordinate {name}; the {len(names)} coordinates have the numbers 0 to {len(names) - 1}"
            )
        return int(name)
    if name not in names:
        raise KeyError(f"there is no coordinate '{name}'{did_you_mean(str(name), names)}")
    return list(names).index(name)


@dataclass(frozen=True, eq=False, repr=False)
class Receptances:  # numpydoc ignore=PR02
    """Displacements per force at p coordinates of a linear structure, at frequencies; a cubic spline between them.

    Parameters
    ----------
    omega : array_like, shape (F,)
        Angular frequencies in the unit of Omega, ascending, at lowest four.
    values : array_like, shape (F, p, p)
        Complex displacement of the row coordinate per force on the column coordinate.
    names : sequence of str, length p
        Names of the coordinates, as in ``dof_names`` of the `System`.
    static : array_like, shape (p, p), optional
        Receptance at rest, which the mean of every motion needs. Default: the value at the frequency 0, if that is
        given.

    Raises
    ------
    ValueError
        If frequencies do not ascend, numbers are missing or not finite, names do not fit, the static receptance is
        missing, or a receptance is singular.

    Examples
    --------
    A mass on a spring, as if measured up to 12 rad/s:

    >>> import hbgear as hb
    >>> import numpy as np
    >>> w = np.linspace(0.0, 12.0, 1201)
    >>> measured = hb.mechanics.Receptances(w, (1 / (1 - w**2 + 0.1j * w))[:, None, None], ["x"])
    >>> stop = hb.Element(measured.along({"x": 1.0}), hb.Unilateral(k=1.0, gap=1.0), name="stop")
    >>> machine = measured.system([stop], hb.Load(cosine={1: measured.along({"x": 0.2})}))
    >>> curve = hb.trace(hb.HarmonicBalance(machine, 8), "Omega", (0.6, 1.5))
    >>> curve.stable is None
    True
    """

    omega: Any
    values: Any
    names: Sequence[str]
    static: Any = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        w = real_numbers("Receptances: omega", self.omega, "a list of numbers")
        if w.ndim != 1 or len(w) < 4 or not np.all(np.isfinite(w)) or np.any(np.diff(w) <= 0) or w[0] < 0:
            raise ValueError(f"Receptances: omega = {w} must be four or more frequencies from 0 on that ascend")
        try:
            H = np.array(self.values, dtype=complex)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"Receptances: values = {quoted(self.values)} must be complex numbers (F, p, p)") from None
        if H.ndim != 3 or H.shape[1] != H.shape[2] or not H.shape[1] or len(H) != len(w):
            raise ValueError(f"Receptances: values of shape {H.shape} for {len(w)} frequencies; need (F, p, p)")
        if not np.all(np.isfinite(H)):
            raise ValueError("Receptances: values has entries that are not finite")
        names = tuple(self.names) if is_listed(self.names) else ()
        if len(names) != H.shape[1] or len(set(names)) < len(names) or not all(isinstance(x, str) for x in names):
            raise ValueError(
                f"Receptances: names = {quoted(self.names)} must be {H.shape[1]} different names, one for each "
                "coordinate"
            )
        static = H[0].real if self.static is None and w[0] == 0 else self.static
        if static is None:
            raise ValueError(
                f"Receptances: the lowest frequency is {w[0]:g}; the mean of a motion needs the receptance at rest: "
                "give static=, a matrix (p, p) of displacements by constant forces"
            )
        static = real_numbers("Receptances: static", static, "a matrix of displacements by constant forces")
        if static.shape != H.shape[1:] or not np.all(np.isfinite(static)):
            raise ValueError(f"Receptances: static has shape {static.shape}; need finite numbers {H.shape[1:]}")
        set_(self, "omega", w)
        set_(self, "values", H)
        set_(self, "names", names)
        set_(self, "static", static)
        moving = H[w > 0]
        s = np.linalg.svd(np.concatenate([static[None], moving]), compute_uv=False)
        weakest = int(np.argmin(s[:, -1] / np.where(s[:, 0] > 0, s[:, 0], 1.0)))
        if s[weakest, -1] <= _MIN_SINGULAR_VALUE_RATIO * s[weakest, 0]:
            state = "at rest" if weakest == 0 else f"at omega = {w[w > 0][weakest - 1]:g}"
            raise ValueError(
                f"Receptances: {state} different forces give the same displacements, so that the displacements do not "
                "determine the forces; leave out coordinates that move with others"
            )
        curve = scipy.interpolate.CubicSpline(w, H)
        set_(self, "_curve", curve)
        set_(self, "_slope", curve.derivative())

    @property
    def coarseness(self) -> float:
        """Error between the lines over the highest peak, estimated from a spline through every second line."""
        w, H = self.omega, self.values
        interpolated = scipy.interpolate.CubicSpline(w[::2], H[::2])(w[1::2][: len(w[::2]) - 1])
        error = np.abs(interpolated - H[1::2][: len(interpolated)]).max() / np.abs(H).max()
        return float(error) / 16  # the error of a spline is of fourth order

    def __repr__(self) -> str:
        return (
            f"Receptances({', '.join(self.names)}; {len(self.omega)} lines from {self.omega[0]:g} to {self.highest:g})"
        )

    @property
    def n(self) -> int:
        """Number of coordinates p."""
        return len(self.names)

    @property
    def lowest(self) -> float:
        """Lowest frequency above 0."""
        return float(self.omega[self.omega > 0][0])

    @property
    def highest(self) -> float:
        """Highest frequency."""
        return float(self.omega[-1])

    def check(self, low: float, high: float, harmonics: int, nu: int = 1) -> None:
        """Raise ValueError for a span of Omega with harmonics beyond the frequencies of the lines.

        Parameters
        ----------
        low, high : float
            Ends of the span.
        harmonics : int
            Number H of harmonics of Omega / nu.
        nu : int, optional
            Subharmonic order. Default 1.

        Raises
        ------
        ValueError
            If a harmonic is below the lowest or above the highest line.
        """
        lowest, highest = low / nu, high * harmonics / nu
        if lowest < self.lowest * (1 - _FREQUENCY_TOLERANCE) or highest > self.highest * (1 + _FREQUENCY_TOLERANCE):
            raise ValueError(
                f"Omega from {low:g} to {high:g} with {harmonics} harmonics{f' of Omega / {nu}' if nu > 1 else ''} "
                f"needs receptances from {lowest:g} to {highest:g}; the lines are from {self.lowest:g} to "
                f"{self.highest:g}: use fewer harmonics or another span, or measure more lines"
            )

    def stiffness(self, w: float) -> tuple[ComplexArray, ComplexArray]:
        """Return the dynamic stiffness H^-1 (p, p) and its derivative in w; at w = 0 the static stiffness, and 0.

        Parameters
        ----------
        w : float
            Angular frequency.

        Returns
        -------
        tuple of ndarray
            Stiffness and derivative.

        Raises
        ------
        ValueError
            If there is no receptance at this frequency.
        """
        if w == 0.0:
            return np.linalg.inv(self.static).astype(complex), np.zeros((self.n, self.n), dtype=complex)
        low, high = self.lowest, self.highest
        if not low * (1 - _MAX_EXTRAPOLATION) <= w <= high * (1 + _MAX_EXTRAPOLATION):
            raise ValueError(
                f"a motion has the frequency {w:g}, and the receptances go from {low:g} to {high:g}: use fewer "
                "harmonics or another Omega, or measure more lines"
            )
        nearest = min(max(w, low), high)
        slope = self._slope(nearest)  # type: ignore[attr-defined]
        Z = np.linalg.inv(self._curve(nearest) + (w - nearest) * slope)  # type: ignore[attr-defined]
        return Z, -Z @ slope @ Z

    def along(self, coordinates: Mapping[str | int, float]) -> Array:
        """Return a vector (p,) with given values of coordinates and zeros otherwise, see `vector_along`.

        Parameters
        ----------
        coordinates : mapping
            Values by name, or by number from 0.

        Returns
        -------
        ndarray, shape (p,)
            The vector.
        """
        return vector_along(self.names, coordinates)

    def system(self, elements: Sequence[Any], load: Any = ()) -> Any:
        """Return the `System` of these receptances with elements and loads.

        Parameters
        ----------
        elements : sequence of Element
            Elements.
        load : Load or sequence of Load, optional
            Loads. Default: none.

        Returns
        -------
        System
            The system, with M, C and K zero.
        """
        zero = np.zeros((self.n, self.n))
        return call("hbgear.mechanics.models.System", zero, zero, zero, elements, load, self.names, receptances=self)
