"""Measured response curves: amplitudes over frequency of slow sweeps, and the frequencies at which they jump.

point i:  frequency_i, amplitude_i +- deviation_i, of a sweep with the frequency rising (+1) or falling (-1)
jump j:   frequency_j +- deviation_j, with the same directions
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hbgear.analysis.parameter_sensitivity import LENGTH
from hbgear.common.argument_checks import check_fields
from hbgear.common.arrays import Array
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.common.units import to_si
from hbgear.harmonic.equations.layout import check_displacement
from hbgear.harmonic.frequency_units import MESH, PINION

FREQUENCIES = ("Omega", MESH, PINION)
"""What frequencies are given in: dimensionless, of the mesh in Hz, or of the pinion in r/min."""

USUAL = 0.01
"""Deviation of an amplitude, relative, that is taken where none is given; of a frequency a tenth of it."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measured amplitudes of slow sweeps and measured jump frequencies.

    Parameters
    ----------
    frequency : array_like, shape (N,)
        In ``unit``.
    amplitude : array_like, shape (N,)
        Of an element, by ``measure``; in the model's unit of length, or in ``scaled_norm`` if that is.
    given.
    direction : array_like, shape (N,), default 1
        Or one number: +1 while the frequency rises, -1 while it falls.
    deviation : array_like, shape (N,), optional
        Or one number, standard deviations of the amplitudes; by default 1 % of each.
    jumps : sequence of Any, optional
        Frequencies at which the sweeps jumped, as ``(frequency, direction)`` or with its standard deviation, by default
        .1 %.
    unit : str, default "Omega"
        One of "Omega", "mesh Hz", "pinion r/min".
    length : str, default ""
        Unit of the amplitudes, such as "um"; "" for that of the model.
    measure, element : str, optional
        As of `Branch.amplitude`.
    assumed : bool, optional
        Whether no deviations were given.

    Raises
    ------
    ValueError
        If lengths differ, a number is not finite, a frequency or amplitude not positive, a measure or unit
        unknown, or there is nothing.

    Examples
    --------
    >>> import hbgear as hb
    >>> data = hb.design.Measurements([0.8, 0.9, 1.0], [0.2, 0.5, 0.3], direction=1, jumps=[(0.92, 1)])
    >>> len(data), data.directions.tolist()
    (3, [1, 1, 1])
    """

    frequency: Any
    amplitude: Any
    direction: Any = 1
    deviation: Any = None
    jumps: Sequence[Any] = ()
    unit: str = "Omega"
    length: str = ""
    measure: str = "pp2"
    element: int | str = 0
    assumed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        check_fields(self)
        if self.unit not in FREQUENCIES:
            raise ValueError(f"Measurements: unit = {quoted(self.unit)}{did_you_mean(str(self.unit), FREQUENCIES)}")
        check_displacement("Measurements", self.measure)
        frequency, amplitude = self._numbers("frequency"), self._numbers("amplitude")
        if len(frequency) != len(amplitude):
            raise ValueError(
                f"Measurements: {len(frequency)} frequencies and {len(amplitude)} amplitudes; give as many"
            )
        deviation = USUAL * amplitude if self.deviation is None else self._numbers("deviation", len(frequency))
        direction = np.asarray(self.direction)
        fits = direction.dtype.kind in "iuf" and direction.shape in ((), (len(frequency),))
        if not fits or not np.isin(direction, (-1, 1)).all():
            raise ValueError(
                "Measurements: direction must be +1 (the frequency rises) or -1, one or one for each point"
            )
        set_(self, "assumed", self.deviation is None)
        set_(self, "frequency", frequency)
        set_(self, "amplitude", amplitude)
        set_(self, "deviation", deviation)
        set_(self, "direction", np.broadcast_to(direction.astype(int), len(frequency)))
        set_(self, "jumps", tuple(_jump(jump) for jump in self.jumps))
        if not len(frequency) and not self.jumps:
            raise ValueError("Measurements: there is neither an amplitude nor a jump; give at least one")
        if self.length:
            set_(self, "amplitude", amplitude * self.metres)
            set_(self, "deviation", deviation * self.metres)

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def directions(self) -> Array:
        """(N,) +1 or -1."""
        return np.asarray(self.direction)

    @property
    def metres(self) -> float:
        """The unit of length of the amplitudes as they were given."""
        return to_si("Measurements", "length", f"1 {self.length}", "m") if self.length else 1.0

    def frequency_unit(self, known: Mapping[str, float]) -> float:
        """The unit of the frequencies at Omega = 1.

        Parameters
        ----------
        known : mapping of str to float
            Units of the model, as of `hbgear.analysis.parameter_sensitivity.units_of`.

        Raises
        ------
        ValueError
            If the model does not know it.
        """
        if self.unit != "Omega" and self.unit not in known:
            raise ValueError(f"the data are in {self.unit}, and the model does not know its units; give Omega")
        return known.get(self.unit, 1.0)

    def in_units(self, known: Mapping[str, float], amplitude: str = "") -> tuple[Array, Array, Array]:
        """Omega, amplitude and deviation (N,) as a model has them.

        Parameters
        ----------
        known : mapping of str to float
            Units of the model, as of `hbgear.analysis.parameter_sensitivity.units_of`.
        amplitude : str, default ""
            Unit of the amplitudes of its curves, such as "um"; "1" or "" if they are over its unit of length.

        Raises
        ------
        ValueError
            If the model does not know the units of the data.
        """
        length = 1.0
        if self.length and amplitude not in ("", "1"):
            length = to_si("Measurements", "the unit of amplitudes", f"1 {amplitude}", "m")
        elif self.length:
            if LENGTH not in known:
                raise ValueError(f"the data are in {self.length}, and the model does not know its unit of length")
            length = known[LENGTH]
        return self.frequency / self.frequency_unit(known), self.amplitude / length, self.deviation / length

    def _numbers(self, name: str, count: int | None = None) -> Array:
        try:
            values = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            values = values if count is None else np.broadcast_to(values, count)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"Measurements: {name} = {quoted(getattr(self, name))} must be numbers") from None
        if values.ndim != 1 or not np.all(np.isfinite(values)) or not np.all(values > 0):
            raise ValueError(f"Measurements: {name} must be positive, finite numbers in a list")
        return values


def _jump(given: Any) -> tuple[float, int, float]:
    """Frequency, direction and standard deviation of a measured jump."""
    try:
        frequency, direction, *rest = (float(x) for x in given)
        deviation = rest[0] if rest else 0.1 * USUAL * frequency
        good = len(rest) < 2 and direction in (-1, 1) and 0 < frequency < np.inf and 0 < deviation < np.inf
    except (TypeError, ValueError):
        good = False
    if not good:
        raise ValueError(
            f"Measurements: the jump {quoted(given)} must be (frequency, +1 or -1) or (frequency, +1 or -1, deviation)"
        )
    return frequency, int(direction), deviation
