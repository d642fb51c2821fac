"""Special points of periodic motions as problems of their own: period doubling, grazing contact, peak.

    R(X, p) = 0,   g(X, p) = 0           unknowns U = (X, p)

| class | g |
|---|---|
| PeriodDoubling | bordered determinant of the half-integer block: a multiplier is -1 |
| Grazing | extremum of an element minus a corner of its law: the impact regime changes |
| Peak | derivative of an amplitude along the curve |
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import scipy

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.algebra import bordered, norm
from hbgear.continuation.bordered import STEP, Augmented, Base, Extra, Fold, bends, null_vectors, sides
from hbgear.continuation.problem import AnyProblem, linearise, linearise_all
from hbgear.mechanics.fourier import waves


class PeriodDoubling(Fold):
    """Period doublings (PD): singular half-integer block of the doubled problem.

    Written in the basis of twice the period, a motion of the single period has even harmonics only, and the Jacobian
    falls into the block of the even ones, which is dR/dX, and that of the odd ones, whose null vector is the
    disturbance that doubles the period.

    Parameters
    ----------
    problem : a `HarmonicBalance`.
    parameter : the parameter of the curve.
    """

    turning_kind = "LP"

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "") -> None:
        super().__init__(problem, parameter)
        self.doubled = problem.with_order(2 * problem.nu, 2 * problem.H + 1)
        k = np.arange(self.doubled.H + 1)
        harmonic = np.tile(np.concatenate([[0], np.repeat(k[1:], 2)]), problem.m)
        self.odd = np.flatnonzero(harmonic % 2)
        self.even = np.flatnonzero(harmonic % 2 == 0)

    def embed(self, X: Array) -> Array:
        """The motion in the basis of twice the period."""
        out = np.zeros(self.doubled.size)
        out[self.even] = X
        return out

    def null_vector(self, X: Array, **here: float) -> Array:
        """The doubling disturbance at or near a period doubling, in the basis of twice the period, unit norm."""
        A, _ = self.matrix(X, here)
        out = np.zeros(self.doubled.size)
        out[self.odd] = scipy.linalg.svd(A)[2][-1]
        return out

    def matrix(self, X: Array, here: dict[str, float]) -> tuple[Array, float]:
        """The half-integer block, and the size of the terms of R."""
        now = linearise(self.doubled, self.embed(X), "", here)
        return now.dR_dX[np.ix_(self.odd, self.odd)], now.size

    def extra(self, X: Array, here: dict[str, float], name: str, base: Base) -> Extra:
        """See `Augmented.extra`."""
        assert base.b is not None and base.c is not None
        now = linearise(self.problem, X, self.parameter, here)
        wide, direction = self.embed(X), np.zeros(self.doubled.size)
        v, w, g = null_vectors(self.matrix(X, here)[0], base.b, base.c)
        k = base.weight
        direction[self.odd] = v
        odd, even = self.odd, self.even
        along, across = bends(self.doubled, wide, direction, here, self.parameter)
        there = sides(self.doubled, wide, here, name) if name else None
        return Extra(
            now, None if there is None else there.dR[even], k * g, -k * (w @ along[np.ix_(odd, even)]),
            -k * float(w @ across[np.ix_(odd, odd)] @ v),
            -k * float(w @ there.dJ[np.ix_(odd, odd)] @ v) if there else 0.0,
        )  # fmt: skip


class Grazing(Augmented):
    """Grazing contacts (GR): an extremum of an element touches a corner of its law.

        g = d(theta*) - corner,   d'(theta*) = 0;   dg/dX is the row of cosines and sines at theta*

    Parameters
    ----------
    problem, parameter : as for `Augmented`.
    which : index into ``problem.clearance``: which extremum of which element at which corner.
    """

    problem: Any  # a HarmonicBalance

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", which: int = 0) -> None:
        super().__init__(problem, parameter)
        self.which = which

    def base_at(self, X: Array, here: dict[str, float]) -> Base:
        return Base(linearise(self.problem, X, "", here).size / (1.0 + norm(X)))

    def extra(self, X: Array, here: dict[str, float], name: str, base: Base) -> Extra:
        """See `Augmented.extra`."""
        now = linearise(self.problem, X, self.parameter, here)
        g, at = self.problem.graze(X, self.which, **here)
        element = self.problem.clearance_elements[self.which]
        w = waves(at, self.problem.H)[0]
        slope = np.zeros((self.problem.m, 2 * self.problem.H + 1))
        slope[element, 0], slope[element, 1::2], slope[element, 2::2] = 1.0, w.real[1:], w.imag[1:]
        weight = base.weight
        R_name = linearise(self.problem, X, name, here).dR_dp if name else None
        return Extra(now, R_name, weight * g, weight * slope.ravel(), weight * self._moved(X, here, self.parameter),
                     weight * self._moved(X, here, name) if name else 0.0)  # fmt: skip

    def _moved(self, X: Array, here: dict[str, float], name: str) -> float:
        """Derivative of the clearance in a parameter that moves the corner."""
        if name == "Omega":
            return 0.0
        h = STEP * self.problem.unit_of(name, here[name])
        ends: list[tuple[float, float]] = []
        for value in (here[name] + h, here[name] - h):
            try:
                ends.append((value, self.problem.graze(X, self.which, **{**here, name: value})[0]))
            except ValueError:
                ends.append((here[name], self.problem.graze(X, self.which, **here)[0]))
        return (ends[0][1] - ends[1][1]) / (ends[0][0] - ends[1][0])


class Peak(Augmented):
    """Peaks (PK) of an amplitude: the derivative of A^2 / 2 along the curve vanishes.

        A^2 / 2 = X^T S X / 2,   g = X^T S t,   t the direction of the curve, [J R_p; b^T] t = e

    Parameters
    ----------
    problem, parameter : as for `Augmented`.
    measure : "rms" (alternating part) or a harmonic, "H1", "H2", ..., with nu = 2 also "H1/2".
    element : number of the element.

    Raises
    ------
    ValueError
        For another measure, or a harmonic the problem does not keep.
    """

    problem: Any  # a HarmonicBalance

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", measure: str = "rms", element: int = 0) -> None:
        super().__init__(problem, parameter)
        self.measure, self.element = measure, element
        S = np.zeros((problem.m, 2 * problem.H + 1))
        if measure == "rms":
            S[element, 1:] = 1.0
        else:
            k = self._harmonic(measure)
            S[element, 2 * k - 1 : 2 * k + 1] = 1.0
        self.S = S.ravel()

    def _harmonic(self, measure: str) -> int:
        """Basis harmonic of "H2" or, for nu = 2, "H1/2"."""
        nu, H = self.problem.nu, self.problem.H
        found = re.fullmatch(r"H(\d+)(?:/(\d+))?", measure)
        k = int(found[1]) * nu / int(found[2] or 1) if found and found[2] != "0" else 0
        if k != int(k) or not 1 <= k <= H:
            fractions = f", also H1/{nu}, ..." if nu > 1 else ""
            raise ValueError(f"peak of {measure!r}: need 'rms' or 'H1' to 'H{H // nu}'{fractions}")
        return int(k)

    def base_at(self, X: Array, here: dict[str, float]) -> Base:
        return Base(linearise(self.problem, X, "", here).size / (1.0 + abs(float(self.S @ (X * X)))))

    def extra(self, X: Array, here: dict[str, float], name: str, base: Base) -> Extra:
        """See `Augmented.extra`."""
        now = linearise(self.problem, X, self.parameter, here)
        n = len(X)
        e = np.zeros(n + 1)
        e[-1] = 1.0  # the direction is normed by its component in the parameter
        lu = scipy.linalg.lu_factor(bordered(now.dR_dX, now.dR_dp, e))
        t = scipy.linalg.lu_solve(lu, e)
        slope = self.S * X
        g = float(slope @ t[:n])
        z = scipy.linalg.lu_solve(lu, np.append(slope, 0.0), trans=1)[:n]
        h = STEP * max(1e-3, norm(X)) / max(norm(t), 1e-12)
        u = np.append(X, here[self.parameter])
        side = linearise_all(self.problem, np.array([u + h * t, u - h * t]), self.parameter, here)
        bend = z @ np.column_stack([side.dR_dX[0] - side.dR_dX[1], side.dR_dp[0] - side.dR_dp[1]]) / (2 * h)
        weight = base.weight
        g_X, g_p = weight * (self.S * t[:n] - bend[:n]), -weight * float(bend[n])
        if not name:
            return Extra(now, None, weight * g, g_X, g_p, 0.0)
        R_name, moved = self._along(X, here, name, z, t)
        return Extra(now, R_name, weight * g, g_X, g_p, -weight * moved)

    def _along(self, X: Array, here: dict[str, float], name: str, z: Array, t: Array) -> tuple[Array, float]:
        """dR/dname, and z^T d[J R_p]/dname t by central difference."""
        h = STEP * self.problem.unit_of(name, here[name])
        values = []
        for value in (here[name] + h, here[name] - h):
            side = linearise(self.problem, X, self.parameter, {**here, name: value})
            values.append((side.R, float(z @ (side.dR_dX @ t[:-1] + side.dR_dp * t[-1]))))
        return (values[0][0] - values[1][0]) / (2 * h), (values[0][1] - values[1][1]) / (2 * h)
