"""Excitation of a flow: prescribed displacements, stiffness of the linear segments and loads as functions of time.

e(t) = Re sum_k e_k exp(i k Omega t),   or polynomials of the phase between two breakpoints
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series, derive, to_complex
from hbgear.mechanics.series.periodic import Phased
from hbgear.time.exponential.segments import stiffness_of
from hbgear.time.exponential.steady_part import load_harmonics


@dataclass(frozen=True)
class Interval:
    """Interval of time between two breakpoints of the excitation.

    Attributes
    ----------
    begin, end : float
        Ends of the interval, in units of time.
    center : float
        Phase in the middle, in radians.
    rows : ndarray, shape (3 m, 4)
        Coefficients about this phase of e, e' and the stiffness of the linear segments, for piecewise polynomials; zero
        for Fourier series.
    """

    begin: float
    end: float
    center: float
    rows: Array


class Excitation:
    """Displacements e, their rates e', stiffness of the linear segments and loads of a system at one Omega.

    Parameters
    ----------
    system : System
        System of equations of a model.
    Omega : float
        Excitation frequency.
    rates : callable
        Function that returns the rates of the states by forces, accelerations if every coordinate has a mass.

    Attributes
    ----------
    breakpoints : ndarray
        Phases in [0, 2 pi) at which the excitation or a law has a breakpoint, ascending.
    series : ndarray, shape (3 m + R, L + 1)
        Complex harmonics of e, e', the stiffness and the R rates by loads; zero for piecewise polynomials.
    orders : ndarray, shape (L + 1,)
        Their orders.
    """

    def __init__(self, system: System, Omega: float, rates: Callable[[Array], Array]) -> None:
        self.Omega, self.m = Omega, len(system.elements)
        phases = [x for e in system.elements for x in (*e.law.phases, *e.displacement.corners)]
        self.breakpoints = np.unique(phases)
        self._no_breakpoints = Interval(-np.inf, np.inf, 0.0, np.zeros((3 * self.m, 4)))
        self.displacements = [e.displacement for e in system.elements]
        self._stiffness = [stiffness_of(e.law) for e in system.elements]
        self.series = self._harmonics(system, rates)
        self.orders = np.arange(self.series.shape[1])

    def _harmonics(self, system: System, rates: Callable[[Array], Array]) -> ComplexArray:
        """Return `series`."""
        m, loads = self.m, load_harmonics(system, self.Omega)
        rows, stiffness = (
            [f.row() if isinstance(f, Series) else np.zeros(1) for f in functions]
            for functions in (self.displacements, self._stiffness)
        )
        accelerations = rates(loads.real) + 1j * rates(loads.imag)
        L = max([len(r) // 2 for r in (*rows, *stiffness)] + [loads.shape[1] - 1])
        c = np.zeros((3 * m + len(accelerations), L + 1), dtype=complex)
        for j in range(m):
            for i, row in ((j, rows[j]), (2 * m + j, stiffness[j])):
                c[i, : len(row) // 2 + 1] = to_complex(row)
        c[m : 2 * m] = self.Omega * derive(c[:m])
        c[3 * m :, : loads.shape[1]] = accelerations
        return c

    def interval_at(self, t: float) -> Interval:
        """Return the interval between breakpoints of the excitation that contains t or begins at t."""
        if not self.breakpoints.size:
            return self._no_breakpoints
        tau = self.Omega * t
        turns = np.floor((tau - self.breakpoints[0]) / (2 * np.pi))
        candidates = np.append(self.breakpoints, self.breakpoints[0] + 2 * np.pi) + 2 * np.pi * (
            turns + np.array([[-1], [0], [1]])
        )
        breakpoints = np.unique(candidates) / self.Omega
        i = int(np.searchsorted(breakpoints, t + 1e-13 * (abs(t) + 1 / self.Omega), side="right"))
        begin, end = float(breakpoints[i - 1]), float(breakpoints[i])
        center, m = 0.5 * self.Omega * (begin + end), self.m
        rows = np.zeros((3 * m, 4))
        rows[:m] = _taylor_coefficients(self.displacements, center)
        rows[2 * m :] = _taylor_coefficients(self._stiffness, center)
        rows[m : 2 * m, :3] = self.Omega * rows[:m, 1:] * [1, 2, 3]
        return Interval(begin, end, center, rows)

    def at(self, t: float, interval: Interval) -> tuple[Array, Array, Array, Array]:
        """Return e, e', the stiffness of the linear segments and the loads at t."""
        s, m = (self.series @ np.exp(1j * self.Omega * t * self.orders)).real, self.m
        if interval is not self._no_breakpoints:
            s[: 3 * m] += interval.rows @ (self.Omega * t - interval.center) ** np.arange(4)
        return s[:m], s[m : 2 * m], s[2 * m : 3 * m], s[3 * m :]

    def over(self, t: Array) -> tuple[Array, Array]:
        """Return e and e' (m, T) at instants t."""
        m = self.m
        s = (self.series[: 2 * m] @ np.exp(1j * self.Omega * self.orders[:, None] * t)).real
        for j, e in enumerate(self.displacements):
            if e.corners:
                s[j] += e(self.Omega * t)
                s[m + j] += self.Omega * e(self.Omega * t, 1)
        return s[:m], s[m:]

    def phase(self, t: float, interval: Interval) -> float:
        """Return tau for the evaluation of laws; at the ends of the interval it is moved inside by rounding."""
        if interval is self._no_breakpoints:
            return self.Omega * t
        inside = 1e-14 * (abs(t) + 1 / self.Omega)
        return self.Omega * min(max(t, interval.begin + inside), interval.end - inside)

    def sizes(self) -> tuple[Array, float]:
        """Return the largest displacements (m,), of polynomials or harmonics, and the largest rate by a load."""
        bounds = np.array([e.bound if e.corners else 0.0 for e in self.displacements])
        harmonics = np.abs(self.series).max(axis=1)
        return np.maximum(bounds, harmonics[: self.m]), float(harmonics[3 * self.m :].max(initial=0.0))


def _taylor_coefficients(functions: list[Phased], tau: float) -> Array:
    """Return the coefficients (m, 4) about tau of functions that have breakpoints; zero for the others."""
    out = np.zeros((len(functions), 4))
    for row, function in zip(out, functions, strict=True):
        if function.corners:
            row[:] = [float(function(tau, q)) / factorial(q) for q in range(4)]
    return out
