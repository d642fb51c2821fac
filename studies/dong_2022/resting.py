"""Motions that time integration reaches from rest, q = q' = 0, as the paper's own computation may have started."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.harmonic.equations.layout import REGIMES


@dataclass(frozen=True)
class Reached:
    """What was reached at each of P frequencies.

    amplitude, least (P,): half the peak-to-peak, and the smallest value, of the first gap over a period of the
    excitation; nan where the motion is not (or not yet) of one period.
    """

    Omega: Array
    amplitude: Array
    least: Array

    def regime(self, b: float) -> list[str]:
        """Impact regime at each frequency for the half backlash b; "unsettled" where it is not of one period."""
        names = np.select([self.least > b, self.least > -b, self.least <= -b], REGIMES[:3], "unsettled")
        return [str(name) for name in names]


def reached(model: hb.mechanics.Model, frequencies: Array, periods: int, tolerance: float = 1e-3) -> Reached:
    """Motions after a number of periods from rest; two successive periods may differ by the tolerance.

    All frequencies are integrated at once.
    """
    Omega = np.asarray(frequencies, dtype=float)
    rest = np.zeros((len(Omega), 2 * model.system().n))
    settled = hb.time.integrate(model, rest, periods, Omega, method="exponential", samples=32).end
    last = hb.time.integrate(model, settled, 2, Omega, method="exponential", samples=512).d[:, 0]
    first, second = np.split(last, 2, axis=1)
    same = np.abs(second - first).max(axis=1) < tolerance
    amplitude, least = (np.where(same, x, np.nan) for x in (np.ptp(second, axis=1) / 2, second.min(axis=1)))
    return Reached(Omega, amplitude, least)
