"""Exact motions in two parameters: the surface F(u, p, q) = 0, points on it, and test functions of special points.

    [F_u F_p F_q] T = 0,   T^T T = 1        T (n + 2, 2) spans the tangent plane, in scaled unknowns w = (u, p, q)

A point of the surface is computed in the plane through a guess across T. Test functions are zero at special points of
the curve in p at constant q:

    LP   bordered determinant of F_u, regular where such curves cross        PD   det(P + 1)      NS   see `critical`
    GR   largest distance of the gap of the contact beyond its breakpoint
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.lru_cache import LRUCache
from hbgear.continuation.results.stability import scaled_determinant
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.instants.corrector import CurveState, Family, jacobian, parameter_column, solve_in_plane
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.shooting import Linearisation, monodromy_matrix, multipliers_of
from hbgear.harmonic.instants.special_points.critical import pair_test
from hbgear.harmonic.instants.special_points.grazing import Grazing, highest_point

STORED_FAMILIES = 8
"""Values of the second parameter whose equations are stored: a corrector and its differences use three in turn."""


class SurfacePoint(NamedTuple):
    """Motion in two parameters: state with the first parameter, second parameter, linearised equations."""

    state: CurveState
    second: float
    linearised: Linearisation

    @property
    def w(self) -> Array:
        """Unknowns (u, p, q)."""
        return np.append(self.state.z, self.second)


TestFunction = Callable[[SurfacePoint], float]
"""Function of a motion that changes its sign at a special point."""


class Surface:
    """Exact motions of a machine in two parameters.

    Parameters
    ----------
    families : callable
        Equations as a function of the first parameter, at a value of the second one.
    """

    def __init__(self, families: Callable[[float], Family]) -> None:
        self._families = families
        self._stored_families = LRUCache[Family](STORED_FAMILIES)

    def family(self, second: float) -> Family:
        """Return the equations as a function of the first parameter; a refused value ends an iteration."""
        try:
            return self._stored_families.get(second, lambda: self._families(second))
        except ValueError as error:
            raise NoConvergence(str(error), np.empty(0), {}, []) from error

    def at(self, point: SurfacePoint) -> EquationsAt:
        """Return the equations of a motion."""
        return self.family(point.second)(point.state.value)

    def scale(self, state: CurveState, width: float) -> Array:
        """Return the scales of w; ``width`` is that of the second parameter."""
        return np.append(state.scale(abs(state.value) or 1.0), width)

    def linearised(self, state: CurveState, second: float) -> tuple[Linearisation, Array]:
        """Return the linearised equations, and [F_u F_p F_q] with central differences in both parameters."""
        linearised, J = jacobian(self.family(second), state)
        return linearised, np.column_stack([J, parameter_column(lambda q: self.family(q)(state.value), state, second)])

    def basis(self, J: Array, scale: Array) -> Array:
        """Return T (n + 2, 2)."""
        return np.linalg.qr((J * scale).T, mode="complete")[0][:, -2:]

    def point(self, guess: CurveState, second: float, T: Array, scale: Array) -> SurfacePoint:
        """Return the motion in the plane across T through a guess.

        Raises
        ------
        NoConvergence
            If Newton's method does not converge.
        """
        w, linearised, _, _ = solve_in_plane(
            lambda p: self.family(float(p[1]))(float(p[0])), guess, np.append(guess.z, second), T.T, scale
        )
        return SurfacePoint(guess.with_z(w[:-1]), float(w[-1]), linearised)

    # ---- special points

    def test(self, kind: str, motion: SurfacePoint, scale: Array, grazing: Grazing | None) -> TestFunction:
        """Return the test function of a kind of special points, LP, PD, NS or GR, near a motion.

        The singular vectors of the motion are the borders of F_u at a fold.
        """
        if grazing is not None:
            return lambda point: highest_point(self.family(point.second), point.state, grazing)[1]
        if kind == "LP":
            return self._fold_test(motion, scale)

        def multiplier_test(point: SurfacePoint) -> float:
            mu = multipliers_of(monodromy_matrix(point.linearised))
            return float(scaled_determinant(mu[None], -1.0)[0]) if kind == "PD" else pair_test(mu)

        return multiplier_test

    def _fold_test(self, motion: SurfacePoint, scale: Array) -> TestFunction:
        """Return the determinant of F_u, bordered twice, over the duration of the shortest contact.

            [F_u  B] [V]   [0]
            [C^T  0] [S] = [I]        det S = det F_u / det [F_u B; C^T 0]

        F_u is singular at a contact of no duration as well, which the quotient leaves out. B and C are the singular
        vectors of the two smallest singular values at the point.
        """
        left, _, right = np.linalg.svd(motion.linearised.J * scale[:-2])
        n, count = len(left), min(2, len(left))
        bordered = np.zeros((n + count, n + count))
        bordered[:n, n:], bordered[n:, :n] = left[:, -count:], right[-count:]
        unit = np.eye(n + count)[:, n:]
        visits, period = motion.state.pattern.visits, self.at(motion).period
        shortest = [visits[int(np.argmin(motion.state.iterate.visit_durations(visits, period)))]] if visits else []

        def test(point: SurfacePoint) -> float:
            bordered[:n, :n] = point.linearised.J * scale[:-2]
            duration = float(point.state.iterate.visit_durations(shortest, period)[0]) if shortest else 1.0
            return float(np.linalg.det(np.linalg.solve(bordered, unit)[n:])) / duration

        return test
