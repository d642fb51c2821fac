"""Equations of motion in ball arithmetic, linear between the contact instants.

    dy/dtau = A(tau, Omega) y,   y = (q, q', c),   c = (1, cos l tau, sin l tau, ...)
    A = sum_p Omega^p P_p + sum_s kappa_s(tau) B_s / Omega

A number is a ball [m - r, m + r] of the library Arb. The result of an operation contains the results for all numbers of
the balls. Arrays of balls are NumPy arrays of objects.

References
----------
Johansson, F. (2017). Arb: efficient arbitrary-precision midpoint-radius interval arithmetic. IEEE Transactions on
Computers 66(8), 1281-1292. https://doi.org/10.1109/TC.2017.2690633.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

Balls: TypeAlias = Any
"""Array of balls: a NumPy array of objects of type ``flint.arb``."""

CORNER_DISTANCE = 1e-9
"""Distance by which the middle of a segment lies inside of its section, for the choice of a piece [rad]."""


def balls(numbers: Any) -> Balls:
    """Return decimals (strings) or numbers as an array of balls."""
    from flint import arb

    values: Any = np.asarray(numbers, dtype=object)
    out = np.empty(values.shape, dtype=object)
    for index in np.ndindex(*values.shape):
        out[index] = arb(values[index])
    return out


def zeros(*shape: int) -> Balls:
    """Return an array of exact zeros."""
    return balls(np.zeros(shape))


def matrix(A: Balls) -> Any:
    """Return a two-dimensional array as ``flint.arb_mat``."""
    from flint import arb_mat

    return arb_mat(A.shape[0], A.shape[1], A.ravel().tolist())


def array(A: Any) -> Balls:
    """Return an ``flint.arb_mat`` as an array."""
    out = np.empty(A.nrows() * A.ncols(), dtype=object)
    out[:] = A.entries()
    return out.reshape(A.nrows(), A.ncols())


@dataclass(frozen=True)
class BallFlow:
    """Linear flow of one contact state on one section at one Omega.

    n : number of coordinates; A, A1 (N, N) : constant part and its derivative in Omega; varying : (stiffness, force,
    force1, row) of the parts kappa force row^T that vary with the phase, force1 the derivative in Omega.
    """

    n: int
    A: Balls
    A1: Balls
    varying: tuple[tuple[Stiffness, Balls, Balls, Balls], ...]

    def at(self, tau: Any) -> tuple[Balls, Balls, Balls]:
        """Return the matrix at a phase, its derivatives in Omega and in the phase."""
        A, A1, slope = self.A, self.A1, zeros(*self.A.shape)
        for stiffness, force, force1, row in self.varying:
            k, B = stiffness.taylor(tau, 1), np.outer(force, row)
            A, A1, slope = A + B * k[0], A1 + np.outer(force1, row) * k[0], slope + B * k[1]
        return A, A1, slope


class Stiffness:
    """Stiffness as a function of the phase: a Fourier series, or the polynomial of one piece."""

    def __init__(self, data: Mapping[str, Any], mid_phase: float) -> None:
        self.origin: Any = None
        if "mean" in data:
            self.mean = balls(data["mean"]).item()
            size = max(len(data["cosine"]), len(data["sine"]))
            self.cosine, self.sine = (
                balls(list(data[name]) + ["0"] * (size - len(data[name]))) for name in ("cosine", "sine")
            )
            return
        from flint import arb

        phases = [float(x) for x in data["phases"]]
        turn = math.floor((mid_phase - phases[0]) / (2 * math.pi))
        inside = mid_phase - 2 * math.pi * turn
        piece = max(i for i, phase in enumerate(phases) if phase <= inside + CORNER_DISTANCE)
        self.origin = arb(data["phases"][piece]) + 2 * turn * arb.pi()
        self.polynomial = balls(data["coefficients"][piece])

    @property
    def constant(self) -> Any:
        """The value if it does not vary, else None."""
        if self.origin is None:
            varies = any(not x.is_zero() for x in (*self.cosine, *self.sine))
            return None if varies else self.mean
        return None if any(not x.is_zero() for x in self.polynomial[1:]) else self.polynomial[0]

    def taylor(self, tau: Any, order: int) -> list[Any]:
        """Return the Taylor coefficients 0 ... order at a phase, which may be a wide ball."""
        from flint import arb

        if self.origin is not None:
            s, c = tau - self.origin, self.polynomial
            return [
                sum((c[q] * math.comb(q, k) * s ** (q - k) for q in range(k, len(c))), arb(0)) for k in range(order + 1)
            ]
        out = [arb(0)] * (order + 1)
        out[0] = self.mean
        for number, (a, b) in enumerate(zip(self.cosine, self.sine, strict=True), start=1):
            sine, cosine = (tau * number).sin(), (tau * number).cos()
            value, slope, factor = a * cosine + b * sine, b * cosine - a * sine, arb(1)
            for k in range(order + 1):
                out[k] = out[k] + value * factor
                value, slope, factor = slope, -value, factor * number / (k + 1)
        return out


class BallSystem:
    """Equations with coefficients from `coefficients_of`, in balls of the current precision."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.data, self.elements = data, data["elements"]
        self.n, self.nu = len(data["M"]), int(data["nu"])
        self.r = 2 * self.n
        orders = {int(order) for load in data["loads"] for name in ("cosine", "sine") for order in load[name]}
        for element in self.elements:
            e = element["displacement"]
            orders |= set(range(1, max(len(e["cosine"]), len(e["sine"])) + 1))
        self.orders = sorted(orders)
        self.N = self.r + 1 + 2 * len(self.orders)
        self.inverse_mass = array(matrix(balls(data["M"])).inv())
        self.breakpoints = [balls(e["breakpoints"]) for e in self.elements]
        self.generator = self._generator()
        self.rows = [self._gap_row(e) for e in self.elements]
        self._flows: dict[Any, BallFlow] = {}
        self._constant = self._constant_terms()

    @property
    def period(self) -> Any:
        """Phase after which a motion repeats."""
        from flint import arb

        return arb.pi() * (2 * self.nu)

    def functions(self, tau: Any) -> Balls:
        """Return c at a phase."""
        pairs = [f for order in self.orders for f in ((tau * order).cos(), (tau * order).sin())]
        return balls([1, *pairs])

    def extended(self, x: Balls, tau: Any) -> Balls:
        """Return y = (x, c)."""
        return np.concatenate([x, self.functions(tau)])

    def flow(self, levels: Sequence[int], mid_phase: float, Omega: Any) -> BallFlow:
        """Return the flow with given numbers of breakpoints below the gaps; middle : a phase of the segment."""
        terms, varying = {p: P for p, P in self._constant.items()}, []
        for j, element in enumerate(self.elements):
            for spring in element["springs"]:
                slope, offset = _segment(spring, element["breakpoints"][: levels[j]])
                row = self.rows[j] * slope
                row[self.r] = row[self.r] + offset
                force = zeros(self.N)
                force[self.n : self.r] = -(self.inverse_mass @ balls(element["direction"]))
                stiffness = Stiffness(spring["stiffness"], mid_phase)
                if stiffness.constant is not None:
                    terms[-1] = terms[-1] + np.outer(force, row) * stiffness.constant
                elif not (slope == 0 and offset == 0):
                    varying.append((stiffness, force * (1 / Omega), force * (-1 / Omega**2), row))
        A, A1 = zeros(self.N, self.N), zeros(self.N, self.N)
        for power, P in terms.items():
            A = A + P * Omega**power
            if power:
                A1 = A1 + P * (power * Omega ** (power - 1))
        return BallFlow(self.n, A, A1, tuple(varying))

    def _generator(self) -> Balls:
        """Return S with dc/dtau = S c."""
        S = zeros(self.N - self.r, self.N - self.r)
        for i, order in enumerate(self.orders):
            k = 1 + 2 * i
            S[k, k + 1], S[k + 1, k] = S[k, k + 1] - order, S[k + 1, k] + order
        return S

    def _gap_row(self, element: Mapping[str, Any]) -> Balls:
        """Return the row that maps y to the gap d = w^T q - e."""
        row, e = zeros(self.N), element["displacement"]
        row[: self.n] = balls(element["direction"])
        row[self.r] = -balls(e["mean"]).item()
        for name, shift in (("cosine", 1), ("sine", 2)):
            for order, value in enumerate(e[name], start=1):
                row[self.r + shift + 2 * self.orders.index(order)] = -balls(value).item()
        return row

    def _constant_terms(self) -> dict[int, Balls]:
        """Return the terms P_p of the structure, its dampers and loads, by the power of Omega."""
        n, r, data = self.n, self.r, self.data
        terms: dict[int, Any] = {-1: zeros(self.N, self.N), 0: zeros(self.N, self.N)}
        terms[-1][:n, n:r] = balls(np.eye(n))
        terms[0][r:, r:] = self.generator
        C = balls(data["C"])
        for element, row in zip(self.elements, self.rows, strict=True):
            w, c = balls(element["direction"]), balls(element["damping"]).item()
            C = C + np.outer(w, w) * c
            rate = row[r:] @ self.generator  # of -e, over the phase
            terms[0][n:r, r:] = terms[0][n:r, r:] - np.outer(self.inverse_mass @ w, rate) * c
        terms[-1][n:r, :n] = -(self.inverse_mass @ balls(data["K"]))
        terms[-1][n:r, n:r] = -(self.inverse_mass @ C)
        for load in data["loads"]:
            power = int(load["power"]) - 1
            if power not in terms:
                terms[power] = zeros(self.N, self.N)
            P = terms[power]
            if load["constant"]:
                P[n:r, r] = P[n:r, r] + self.inverse_mass @ balls(load["constant"])
            for name, shift in (("cosine", 1), ("sine", 2)):
                for order, vector in load[name].items():
                    column = r + shift + 2 * self.orders.index(int(order))
                    P[n:r, column] = P[n:r, column] + self.inverse_mass @ balls(vector)
        return terms


def _segment(spring: Mapping[str, Any], below: Sequence[str]) -> tuple[Any, Any]:
    """Return slope and offset of a spring above the breakpoints ``below`` and below all others."""
    from flint import arb

    corners, slopes = balls(spring["corners"]), balls(spring["slopes"])
    offset, slope = arb(spring["force_at_zero"]), slopes[0]
    inside = {float(x) for x in below}
    for corner, number, change in zip(corners, spring["corners"], slopes[1:] - slopes[:-1], strict=True):
        if float(number) < 0:
            offset = offset + change * corner
        if float(number) in inside:
            slope, offset = slope + change, offset - change * corner
    return slope, offset
