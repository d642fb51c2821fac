"""One piece of a solution curve: scaled unknowns, tangents, and points between two rows.

A row is u = (X, lambda). Lengths and angles are measured in scaled unknowns u / scale, so that a step, a turning angle
and a distance mean the same whatever the units of X and lambda.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.fourier import Array
from hbgear.newton import Evaluation, NoConvergence, Settings, Solution, bordered, correct, norm


@dataclass(frozen=True)
class Row:
    """A converged point of a curve with what the curve does there.

    u (n + 1,) unknowns and parameter; tangent (n + 1,), unit in the scaled unknowns but given unscaled; orientation:
    sign of the determinant of [J R_lambda; tangent], which changes at branch points and not at folds. heading: whether
    lambda rises (+1) or falls (-1) along the curve, or last did before a stretch on which it stands still.
    """

    solution: Solution
    u: Array
    tangent: Array
    orientation: int
    step: float = 0.0
    heading: int = 0
    observed: dict[str, Any] = field(default_factory=dict)

    @property
    def value(self) -> float:
        """Value of the traced parameter."""
        return float(self.u[-1])


@dataclass(frozen=True)
class Departure:
    """Where another branch begins: X, parameters, and the direction (n + 1,) in (X, lambda) in which it leaves."""

    X: Array
    parameters: dict[str, float]
    direction: Array


def tangent(now: Evaluation, normal: Array, scale: Array) -> tuple[Array, int]:
    """Tangent of R(u) = 0 with a positive component along normal, and the sign of the bordered determinant.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the bordered matrix is singular: a branch point, or a normal that is no direction of the curve.
    """
    A = bordered(now, normal)
    rhs = np.zeros(len(A))
    rhs[-1] = 1.0
    lu, pivots, t, info = scipy.linalg.lapack.dgesv(A, rhs)
    if info or not math.isfinite(t.sum()):
        raise np.linalg.LinAlgError("singular bordered matrix")
    negative = np.count_nonzero(lu.diagonal() < 0) + np.count_nonzero(pivots != np.arange(len(pivots)))
    return t / norm(t / scale), -1 if negative % 2 else 1


def normal_of(direction: Array, scale: Array) -> Array:
    """Normal, in unscaled unknowns, of the plane across a direction in scaled ones."""
    return direction / scale**2


_STRAIGHT = 0.3  # share of the step by which the first predicted bend may move the point; cosine of the last turn


def predict(rows: Sequence[Row], unit: Array, scale: Array, h: float) -> Array:
    """Unknowns at the distance h along the tangent ``unit`` from the last row: Hermite extrapolation.

    Parameters
    ----------
    rows : the last rows, the newest first. Through one of them with its tangent goes a line, through two a cubic,
        through k a polynomial of degree 2k - 1, in the distance x = unit . (u - u_0) (scaled). As many are used
        as bring smaller and smaller changes: beyond that the curve is not smooth on their scale.
    """
    along = normal_of(unit, scale)
    best, gained = rows[0].u + h * unit, _STRAIGHT * h
    x, value, slope = [0.0], [rows[0].u], [unit]
    for row in rows[1:]:
        cosine = float(along @ row.tangent)
        if cosine < _STRAIGHT * norm(row.tangent / scale):
            break
        x.append(float(along @ (row.u - rows[0].u)))
        value.append(row.u)
        slope.append(row.tangent / cosine)
        weights = np.array(_hermite(x, h)).T
        further = weights[0] @ np.array(value) + weights[1] @ np.array(slope)
        change = norm((further - best) / scale)
        if not change < gained:
            break
        best, gained = further, change
    return best


def _hermite(x: list[float], at: float) -> list[tuple[float, float]]:
    """Weights of the values and slopes at the nodes x in the Hermite polynomial at ``at``."""
    out = []
    for i, node in enumerate(x):
        others = x[:i] + x[i + 1 :]
        squared = math.prod((at - other) / (node - other) for other in others) ** 2
        steep = sum(1 / (node - other) for other in others)
        out.append(((1 - 2 * (at - node) * steep) * squared, (at - node) * squared))
    return out


@dataclass(frozen=True)
class Arc:
    """The curve between two neighbouring rows a and b: cubic Hermite guess, corrected across the chord.

    ``at(s)`` returns the row at the fraction s of the chord, 0 at a and 1 at b.
    """

    problem: Any
    name: str
    parameters: Mapping[str, float]
    a: Row
    b: Row
    scale: Array
    settings: Settings

    def guess(self, s: float) -> Array:
        """Hermite interpolation of u."""
        a, b = self.a, self.b
        length = norm((b.u - a.u) / self.scale)
        (value_a, slope_a), (value_b, slope_b) = _hermite([0.0, 1.0], s)
        return value_a * a.u + slope_a * length * a.tangent + value_b * b.u + slope_b * length * b.tangent

    def at(self, s: float) -> Row:
        """Corrected row at the fraction s of the chord.

        Raises
        ------
        NoConvergence
            If the corrector fails there.
        """
        normal = normal_of(self.b.u - self.a.u, self.scale)
        u = self.guess(s)
        # put the guess on the plane at exactly the fraction s of the chord
        along = (1 - s) * self.a.u + s * self.b.u
        chord = self.b.u - self.a.u
        u = u + chord * (normal @ (along - u)) / (normal @ chord)
        normal = normal / np.linalg.norm(normal)
        solution = correct(self.problem, u, normal, self.name, self.parameters, self.settings)
        return row_of(solution, normal, self.scale)

    def passes(self, known: Row) -> bool:
        """Whether the curve from a to b contains a row already known: the points nearest to it are compared."""
        chord = (self.b.u - self.a.u) / self.scale
        offset = (known.u - self.a.u) / self.scale
        length = norm(chord)
        s = float(offset @ chord) / length**2
        if not 0 <= s <= 1 or np.linalg.norm(offset - s * chord) > 0.1 * length:
            return False
        try:
            there = self.at(s)
        except (NoConvergence, np.linalg.LinAlgError):
            return False
        gap, along = (there.u - known.u) / self.scale, known.tangent / self.scale
        across = gap - along * (gap @ along) / (along @ along)
        return float(np.linalg.norm(across)) < 1e-3 * length


def cosine(a: Row, b: Row, scale: Array) -> float:
    """Cosine of the angle between the tangents of two rows, up to their lengths."""
    return float((a.tangent / scale) @ (b.tangent / scale))


_STILL = 1e-7  # component of the scaled tangent in lambda that is rounding


def row_of(solution: Solution, normal: Array, scale: Array, step: float = 0.0, before: Row | None = None) -> Row:
    """Row of a solution, its tangent pointing along normal; before is the row the curve comes from."""
    u = np.append(solution.X, solution.value)
    t, sign = tangent(solution.evaluation, normal, scale)
    moves = t[-1] / scale[-1]
    heading = int(np.sign(moves)) if abs(moves) > _STILL else before.heading if before else 0
    return Row(solution, u, t, sign, step, heading)
