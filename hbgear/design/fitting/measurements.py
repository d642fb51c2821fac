"""Measured response curves: amplitudes over frequency of slow sweeps, and the frequencies at which they jump.

point i:  frequency_i, amplitude_i +- deviation_i, of a sweep with rising (+1) or falling (-1) frequency
jump j:   frequency_j +- deviation_j, with the same directions
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hbgear.analysis.parameter_sensitivity.units import LENGTH
from hbgear.common.argument_checks import check_fields
from hbgear.common.arrays import Array
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.common.units import to_si
from hbgear.harmonic.models.frequency_units import MESH, PINION
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.measures import check_displacement

FREQUENCIES = ("Omega", MESH, PINION)
"""Units of frequencies: Omega of the model, mesh frequency in Hz, and speed of the pinion in r/min."""

DEFAULT_DEVIATION = 0.01
"""Relative standard deviation of an amplitude if none is given; a tenth of it is used for a jump frequency."""


@dataclass(frozen=True, eq=False)
class Measurements:  # numpydoc ignore=PR02
    """Measured amplitudes of slow sweeps and measured jump frequencies.

    Parameters
    ----------
    frequency : array_like, shape (N,)
        Frequencies in ``unit``.
    amplitude : array_like, shape (N,)
        Amplitudes by ``measure`` of an element, in the unit ``length``. If ``length`` is given they are stored in
        metres.
    direction : array_like, shape (N,), or int, default 1
        Direction of the sweep: +1 for a rising frequency, -1 for a falling one.
    deviation : array_like, shape (N,), or float, optional
        Standard deviations of the amplitudes. Default: 1 % of each amplitude.
    jumps : sequence of tuple, optional
        Jump frequencies as ``(frequency, direction)`` or ``(frequency, direction, standard deviation)``. The default
        standard deviation is 0.1 % of the frequency.
    unit : {"Omega", "mesh Hz", "pinion r/min"}, optional
        Unit of the frequencies.
    length : str, default ""
        Unit of the amplitudes, such as "um"; "" for the unit of the model.
    measure, element : str and int or str, optional
        Measure ("pp2" by default) and element (0 by default) of `Branch.amplitude`.
    transmission_error : bool, default False
        Whether the amplitudes are those of the transmission error d + e instead of the displacement d of the element.
        They are equal if the element has no prescribed displacement e.

    Attributes
    ----------
    assumed : bool
        True if no deviations were given.

    Raises
    ------
    ValueError
        If lengths differ, a number is not finite, a frequency or amplitude is not positive, a measure or unit is
        unknown, or there are no data.

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
    transmission_error: bool = False
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
                f"Measurements: {len(frequency)} frequencies and {len(amplitude)} amplitudes; give one "
                "amplitude for each frequency"
            )
        deviation = (
            DEFAULT_DEVIATION * amplitude if self.deviation is None else self._numbers("deviation", len(frequency))
        )
        direction = np.asarray(self.direction)
        fits = direction.dtype.kind in "iuf" and direction.shape in ((), (len(frequency),))
        if not fits or not np.isin(direction, (-1, 1)).all():
            raise ValueError(
                "Measurements: direction must be +1 (the frequency rises) or -1, one number or one for each point"
            )
        set_(self, "assumed", self.deviation is None)
        set_(self, "frequency", frequency)
        set_(self, "amplitude", amplitude)
        set_(self, "deviation", deviation)
        set_(self, "direction", np.broadcast_to(direction.astype(int), len(frequency)))
        set_(self, "jumps", tuple(_jump(jump) for jump in self.jumps))
        if not len(frequency) and not self.jumps:
            raise ValueError("Measurements: no amplitudes and no jumps are given; give at least one of them")
        if self.length:
            set_(self, "amplitude", amplitude * self.metres)
            set_(self, "deviation", deviation * self.metres)

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def directions(self) -> Array:
        """Directions (N,) of the sweeps, +1 or -1."""
        return np.asarray(self.direction)

    @property
    def metres(self) -> float:
        """Unit of length of the given amplitudes [m]; 1 without a unit."""
        return to_si("Measurements", "length", f"1 {self.length}", "m") if self.length else 1.0

    def frequency_unit(self, known: Mapping[str, float]) -> float:
        """Return the frequency at Omega = 1 in the unit of the data.

        Parameters
        ----------
        known : mapping of str to float
            Units of the model from `hbgear.analysis.parameter_sensitivity.units.units_of`.

        Raises
        ------
        ValueError
            If the model does not know the unit of the data.
        """
        if self.unit != "Omega" and self.unit not in known:
            raise ValueError(f"the data are in {self.unit}, and the model does not know its units; give Omega")
        return known.get(self.unit, 1.0)

    def in_units(self, known: Mapping[str, float], amplitude: str = "") -> tuple[Array, Array, Array]:
        """Return Omega, amplitude and deviation (N,) in the units of a model.

        Parameters
        ----------
        known : mapping of str to float
            Units of the model from `hbgear.analysis.parameter_sensitivity.units.units_of`.
        amplitude : str, default ""
            Unit of the amplitudes of the curves of the model, such as "um"; "1" or "" for its unit of length.

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

    def check_displacement_of(self, model: Model) -> None:
        """Raise an error for transmission errors if a model has displacements of its element that differ from them.

        Parameters
        ----------
        model : Model
            Model whose displacements are compared with the data.

        Raises
        ------
        ValueError
            If the element has a prescribed displacement that varies.
        """
        for number, element in enumerate(model.system().elements):
            error = getattr(element, "displacement", None)
            if (
                self.transmission_error
                and self.element in (number, element.name)
                and error is not None
                and error.varies
            ):
                raise ValueError(
                    f"the data are transmission errors d + e, and element {quoted(element.name)} has a prescribed "
                    "displacement e, so that its displacement d has other amplitudes; give those of d, in a column "
                    "named gap, or a model without e, such as the pairs of teeth of a drawing"
                )

    def _numbers(self, name: str, count: int | None = None) -> Array:
        try:
            values = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            values = values if count is None else np.broadcast_to(values, count)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"Measurements: {name} = {quoted(getattr(self, name))} must be numbers") from None
        if values.ndim != 1 or not np.all(np.isfinite(values)) or not np.all(values > 0):
            raise ValueError(f"Measurements: {name} must be a list of positive, finite numbers")
        return values


def _jump(jump: Any) -> tuple[float, int, float]:
    """Return frequency, direction and standard deviation of a measured jump."""
    try:
        frequency, direction, *deviations = (float(x) for x in jump)
        deviation = deviations[0] if deviations else 0.1 * DEFAULT_DEVIATION * frequency
        is_valid = len(deviations) < 2 and direction in (-1, 1) and 0 < frequency < np.inf and 0 < deviation < np.inf
    except (TypeError, ValueError, OverflowError):
        is_valid = False
    if not is_valid:
        raise ValueError(
            f"Measurements: the jump {quoted(jump)} must be (frequency, +1 or -1) or (frequency, +1 or -1, deviation)"
        )
    return frequency, int(direction), deviation
