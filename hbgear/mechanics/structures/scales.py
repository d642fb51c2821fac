"""Physical units of a dimensionless model: the units of length, time and force.

f_mesh [Hz] = order Omega frequency / (2 pi),   n [r/min] = 60 f_mesh / teeth
x [m] = length xbar,   F [N] = force Fbar,   acceleration [m/s^2] = length frequency^2 xbar''
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TypeVar

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked

Numbers = TypeVar("Numbers", float, Array)


@dataclass(frozen=True)
class Scales:  # numpydoc ignore=PR02
    """Units of a dimensionless gear model.

    Parameters
    ----------
    frequency : float
        Angular frequency omega_n of Omega = 1 [rad/s]; the unit of time is 1/omega_n.
    length : float
        Unit of element coordinates [m], the half backlash b_c.
    force : float
        Unit of element forces [N], k_mean b_c.
    teeth : float
        Number of teeth of the pinion, whose speed is reported.
    order : float, default 1.0
        Frequency of the mesh over Omega.

    Raises
    ------
    ValueError
        If one of them is not positive.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25))
    >>> round(pair.scales.pinion_speed(1.0)), round(pair.scales.mesh_frequency(1.0))
    (14515, 6048)
    """

    frequency: float
    length: float
    force: float
    teeth: float
    order: float = 1.0

    def __post_init__(self) -> None:
        for name in ("frequency", "length", "force", "teeth", "order"):
            checked("Scales", name, getattr(self, name), POSITIVE)

    @property
    def velocity(self) -> float:
        """Unit of the first derivative of a length [m/s]."""
        return self.length * self.frequency

    @property
    def acceleration(self) -> float:
        """Unit of the second derivative of a length [m/s^2]."""
        return self.length * self.frequency**2

    @checked_arguments()
    def mesh_frequency(self, Omega: Numbers) -> Numbers:
        """Return the mesh frequency order Omega omega_n / (2 pi) [Hz]."""
        return _times(Omega, self.order * self.frequency / (2 * pi))

    @checked_arguments()
    def from_mesh_frequency(self, frequency: Numbers) -> Numbers:
        """Return Omega at a mesh frequency [Hz]."""
        return _times(frequency, 2 * pi / (self.order * self.frequency))

    @checked_arguments()
    def pinion_speed(self, Omega: Numbers) -> Numbers:
        """Return the pinion speed 60 mesh_frequency / teeth [r/min]."""
        return _times(self.mesh_frequency(Omega), 60 / self.teeth)

    @checked_arguments()
    def from_pinion_speed(self, speed: Numbers) -> Numbers:
        """Return Omega at a pinion speed [r/min]."""
        return self.from_mesh_frequency(_times(speed, self.teeth / 60))


def _times(values: Numbers, factor: float) -> Numbers:
    """Return a number, array or list of numbers times a factor."""
    return np.multiply(values, factor)
