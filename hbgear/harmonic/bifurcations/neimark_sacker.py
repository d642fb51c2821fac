"""Neimark-Sacker equations: a pair of multipliers on the unit circle.

`NeimarkSackerProblem` uses Hill's determinant, which needs the slopes of the laws, `PairModulusProblem` the monodromy
matrix, which exists for all laws.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import scipy

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.augmented.null_vectors import least_singular_vectors
from hbgear.continuation.augmented.sensitivity import along
from hbgear.continuation.numerics.linear import Factors, as_dense, bordered, norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.problem.finite_differences import directional_step, parameter_derivatives
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.multipliers.hill import CondensedHillMatrix, slopes
from hbgear.harmonic.multipliers.multiplier_error import is_complex
from hbgear.harmonic.multipliers.sampled_slopes import SampledSlopes
from hbgear.mechanics.series.fourier import to_real


@dataclass(frozen=True)
class PairBorders(Borders):
    """Borders of a Neimark-Sacker point: those of Hill's determinant, if it is used, and the exponent of the pair."""

    exponent: complex = 0j


REAL_MULTIPLIER_TOLERANCE = 1e-3
"""Phase of a multiplier, in half turns from a whole number of them, up to which it may be real."""


class _Pair(NamedTuple):
    """An exponent s of a motion, its disturbance v, y = G^H w with the left vector w, and w^H dD/ds v."""

    exponent: complex
    v: ComplexArray
    w: ComplexArray
    y: ComplexArray
    rate: complex


class _PairProblem(MinimallyAugmentedProblem):
    """Base class of the equations of a complex pair of multipliers, the one with an exponent nearest to ``near``."""

    problem: Any  # a HarmonicBalance
    near: complex | None
    argument_names = ("near",)

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", near: complex | None = None) -> None:
        super().__init__(problem, parameter)
        self._fixed(near=near)

    def for_problem(self, problem: ContinuationProblem) -> Self:
        """Return these equations for another problem, with the pair of the last borders.

        Along a curve its exponent goes far away from the one with which the curve began.
        """
        near = self.base.exponent if isinstance(self.base, PairBorders) else self.near
        return type(self)(problem, self.parameter, near)


class NeimarkSackerProblem(_PairProblem):  # numpydoc ignore=PR02
    """Neimark-Sacker points (NS): a disturbance e^{st} v(theta) of another frequency has constant amplitude.

        D(s) v = 0,   g = Re s;     ds = -(w^H dD v) / (w^H D_s v)

    D is Hill's determinant condensed to the gaps (`hill.CondensedHillMatrix`). The exponent s is computed again for
    every motion. Like the half-integer block of a period doubling, which is D at s = i omega / 2, the determinant is
    superconvergent: its zeros are far more accurate than the multipliers of the truncated motion.

    Parameters
    ----------
    problem : HarmonicBalance
        A problem whose laws have slopes: no friction, contacts with dampers or compiled laws of the user.
    parameter : str, optional
        The parameter of the curve, such as "Omega".
    near : complex, optional
        The exponent from which the exponent of the pair is computed. By default it is taken from the pair of
        multipliers nearest to the unit circle, which may be the wrong one where two pairs pass close to each other.

    Raises
    ------
    ValueError
        If there is no complex pair of multipliers near the point, the slopes of a law are unknown, or the structure is
        too large for its modes.

    References
    ----------
    Detroux, Renson, Masset & Kerschen (2015), Comput. Methods Appl. Mech. Eng. 296,
    https://doi.org/10.1016/j.cma.2015.07.017, for special points followed by harmonic balance.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 5)
    >>> curve = hb.trace(problem, "Omega", (1.0, 0.8), accuracy=None)
    >>> few = hb.StepControl(max_points=4)
    >>> held = hb.trace(hb.harmonic.NeimarkSackerProblem(problem, "Omega"), "zeta", (0.05, 0.06), start=curve["NS1"],
    ...     steps=few)
    >>> bool(held.tracked["Omega"][0] == curve["NS1"].parameters["Omega"])
    True
    """

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        hill, size = self._hill(X, parameters), self.problem.linearise(X, "", **parameters).size
        s = self._guess(X, parameters) if self.near is None else self.near
        b, c = least_singular_vectors(hill.matrix(hill.receptances(s)[0], s), BORDER_ITERATIONS)
        pair = _exponent(hill, s, b, c, X, parameters)
        return PairBorders(size / hill.omega, _unit(pair.w), _unit(pair.v), pair.exponent)

    def update_borders(self, base: Borders, X: Array, parameters: dict[str, float]) -> Borders:
        """Return the borders and the exponent updated at X; the same ones where the pair becomes real."""
        assert isinstance(base, PairBorders)
        try:
            pair = self._pair(self._hill(X, parameters), base, X, parameters)
        except NoConvergence:
            return base
        return PairBorders(base.weight, _unit(pair.w), _unit(pair.v), pair.exponent)

    def exponent(self, X: Array, **parameters: float) -> complex:
        """Return the exponent s at or near a Neimark-Sacker point; its second frequency is Im s."""
        base = self.base or self.base_at(X, parameters)
        return self._pair(self._hill(X, parameters), base, X, parameters).exponent

    def _hill(self, X: Array, parameters: dict[str, float]) -> CondensedHillMatrix:
        return CondensedHillMatrix.of(self.problem.compiled(parameters), X, parameters["Omega"])

    def _guess(self, X: Array, parameters: dict[str, float]) -> complex:
        """Return the exponent of the complex pair of multipliers nearest to the unit circle."""
        return _require_pair(
            exponent_of_pair(self.problem.multipliers(X, **parameters), self.problem.nu, parameters["Omega"])
        )

    def _pair(self, hill: CondensedHillMatrix, base: Borders, X: Array, parameters: dict[str, float]) -> _Pair:
        assert isinstance(base, PairBorders) and base.b is not None and base.c is not None
        pair = _exponent(hill, base.exponent, base.b, base.c, X, parameters)
        turns = 2 * pair.exponent.imag * self.problem.nu / parameters["Omega"]
        # det D = 0 also at period doublings and branch points
        if abs(turns - round(turns)) < REAL_MULTIPLIER_TOLERANCE:
            raise NoConvergence("the pair of multipliers became real", X, parameters, [])
        return pair

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the residual g and its derivatives; see `MinimallyAugmentedProblem.extra`."""
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        pair = self._pair(self._hill(X, parameters), base, X, parameters)
        derivatives = tuple(
            (self.problem.linearise(X, name, **parameters).dR_dp, self._derivative(X, parameters, name, pair))
            for name in names
        )
        g_p = self._derivative(X, parameters, self.parameter, pair)
        return AugmentedResidual(evaluation, pair.exponent.real, self._slope(X, parameters, pair), g_p, derivatives)

    def _slope(self, X: Array, parameters: dict[str, float], pair: _Pair) -> Array:
        """Return the gradient (n,) of Re s in X, on which the slopes K of the laws depend.

            w^H dD v = sum_n q_n dK_n,   q_n = sum_l conj(y_l+n) v_l
            d Re s = mean of dK phi,     phi = -Re sum_n q_n e^{-i n theta} / (w^H D_s v)

        summed over the gaps. It is the second derivative of the mean force along phi and along X.
        """
        m, H = self.problem.m, self.problem.H
        v, y = (z.reshape(2 * H + 1, m).T for z in (pair.v, pair.y))
        q = np.array([np.convolve(y_j.conj(), v_j[::-1]) for v_j, y_j in zip(v, y, strict=True)])
        phi = -q / pair.rate  # of e^{-in theta}, n = -2H..2H
        rows = to_real(phi[:, 2 * H :].conj() + phi[:, 2 * H :: -1])
        rows[:, 0] /= 2.0
        compiled, padded = self.problem.compiled(parameters), np.zeros((m, 4 * H + 1))
        padded[:, : 2 * H + 1] = self.problem.rows(X)
        step, least = self.problem.difference_step(X, parameters), self.problem.least_size
        h = directional_step(padded.ravel(), rows.ravel(), step, least)
        above, below = (
            slopes(compiled, (padded + side * h * rows).ravel())[:, self.problem.orders] for side in (1, -1)
        )
        out = to_real((above - below) / (2 * h))
        if compiled.aft_laws:
            self._add_sampled(out, X, parameters, pair)
        return out.ravel()

    def _add_sampled(self, out: Array, X: Array, parameters: dict[str, float], pair: _Pair) -> None:
        """Add the gradient of laws evaluated by AFT to rows (m, orders).

        phi = -Re[y* v / (w^H D_s v)],   chi = -Re[y* v' / (w^H D_s v)],   v' = sum (s + i k omega) v_k e^{ik theta}
        """
        compiled, m, H = self.problem.compiled(parameters), self.problem.m, self.problem.H
        sampled = SampledSlopes(compiled, X, parameters["Omega"])
        k = np.arange(-H, H + 1)
        v, y = (z.reshape(2 * H + 1, m).T[sampled.elements] for z in (pair.v, pair.y))
        rates = (pair.exponent + 1j * parameters["Omega"] / self.problem.nu * k) * v
        adjoint = sampled.samples(y).conj() / pair.rate
        phi, chi = (-(adjoint * sampled.samples(z)).real for z in (v, rates))
        gradient = sampled.gradient(phi, chi)
        columns = np.concatenate([[0], *[(2 * n - 1, 2 * n) for n in self.problem.orders[1:]]]).astype(int)
        out[sampled.elements] += gradient[:, columns]

    def _derivative(self, X: Array, parameters: dict[str, float], name: str, pair: _Pair) -> float:
        """Return the derivative of Re s in a parameter."""

        def real_part_change(changed: dict[str, float]) -> tuple[float]:
            hill = self._hill(X, changed)
            D = hill.matrix(hill.receptances(pair.exponent)[0], pair.exponent)
            form = complex(pair.w.conj() @ D @ pair.v)
            return ((-form / pair.rate).real,)

        (derivative,) = parameter_derivatives(self.problem, name, parameters, real_part_change)
        return float(derivative)


class PairModulusProblem(_PairProblem):  # numpydoc ignore=PR02
    """Neimark-Sacker points (NS) from multipliers, for laws whose slopes Hill's determinant does not know.

        R(X, p) = 0,   g = log |mu_1 mu_2| / 2 = 0

    mu_1, mu_2 are the multipliers nearest to the pair of the point before. At a resonance 1:1 or 1:2 they become real,
    and g stays smooth, so that curves pass it with regular equations. These laws are friction, contacts with dampers,
    laws of several displacements and compiled laws of the user. The gradient of g is computed in the directions that
    Newton's method and tangents need: along the tangent t of the motions X(p), along the correction of R in the plane
    across t, and along the motions X(a), p(a) in this plane.
    Multipliers of truncated motions converge more slowly with the number of harmonics than zeros of Hill's determinant.

    Parameters
    ----------
    problem : HarmonicBalance
        The problem of the curve.
    parameter : str, optional
        The parameter of the curve, such as "Omega".
    near : complex, optional
        The exponent s of the multiplier exp(2 pi nu s / Omega). By default it is that of the complex pair nearest to
        the unit circle, which may be the wrong one where two pairs pass close to each other.

    Raises
    ------
    ValueError
        If there is no complex pair of multipliers near the point, or the structure is too large for its modes.

    Examples
    --------
    >>> import numpy as np
    >>> import hbgear as hb
    >>> @hb.mechanics.model
    ... def rubbing(friction: float = 0.2) -> hb.System:
    ...     seal = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(2.0, 0.3, friction))
    ...     unbalance = hb.Load(cosine={1: [0.2, 0.0]}, sine={1: [0.0, 0.2]}, power=2)
    ...     return hb.System(np.eye(2), 0.1 * np.eye(2), np.diag([1.0, 1.1]), list(seal), unbalance)
    >>> curve = hb.trace(hb.HarmonicBalance(rubbing(), 5), "Omega", (1.9, 1.7), accuracy=None)
    >>> whirl = hb.follow(curve, "NS1", "friction", (0.2, 0.3), accuracy=None)
    >>> whirl.status.name, bool(np.all(np.diff(whirl.tracked["Omega"]) > 0))
    ('REACHED_END', True)
    """

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        s = self.near
        if s is None:
            mu = self._multipliers(X, parameters)
            s = _require_pair(exponent_of_pair(mu, self.problem.nu, parameters["Omega"]))
        return PairBorders(self.problem.linearise(X, "", **parameters).size, exponent=s)

    def update_borders(self, base: Borders, X: Array, parameters: dict[str, float]) -> Borders:
        """Return the borders with the exponent at X."""
        mu = self._pair(X, parameters, base)[0]
        return PairBorders(base.weight, exponent=self._exponent(mu, parameters["Omega"]))

    def exponent(self, X: Array, **parameters: float) -> complex:
        """Return the exponent s at or near a Neimark-Sacker point; its second frequency is Im s."""
        mu = self._pair(X, parameters, self.base or self.base_at(X, parameters))[0]
        return self._exponent(mu, parameters["Omega"])

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the residual g and its derivatives; see `MinimallyAugmentedProblem.extra`."""

        def value(X: Array, changed: dict[str, float]) -> float:
            return _mean_growth(self._pair(X, changed, base))

        mu = self._pair(X, parameters, base)
        if abs(mu.sum().real) / 2 > MAX_MEAN_OF_PAIR:
            raise NoConvergence("the pair of multipliers became real", X, parameters, [])
        evaluation, p = self.problem.linearise(X, self.parameter, **parameters), self.parameter
        scale = np.append(np.full(len(X), norm(X) or 1.0), self.problem.unit_of(p, parameters[p]))
        A = np.column_stack([as_dense(evaluation.dR_dX), evaluation.dR_dp]) * scale
        tangent = scipy.linalg.svd(A)[2][-1]  # of the motions, also at a fold
        factors = Factors(np.vstack([A, tangent]))

        def derivative(name: str, direction: Array) -> float:
            """Return the derivative along (dX, dp) per unit change of a parameter; dp is 1 for p itself."""

            def moved(X: Array, changed: dict[str, float]) -> float:
                dp = (changed[name] - parameters[name]) * float(direction[-1])
                return value(X, {**changed, p: parameters[p] + dp})

            return along(self.problem, X, parameters, moved, direction[:-1], name)

        def change(direction: Array) -> float:
            """Return the derivative along a scaled direction."""
            dU = direction * scale
            if abs(direction[-1]) > MIN_RATE_OF_PARAMETER * norm(direction):
                return derivative(p, dU / dU[-1]) * float(dU[-1])
            h = self.problem.difference_step(X, parameters) / norm(direction)
            above, below = (
                value(X + step * dU[:-1], {**parameters, p: parameters[p] + step * float(dU[-1])}) for step in (h, -h)
            )
            return (above - below) / (2 * h)

        correction = factors.solve(np.append(evaluation.R, 0.0))
        gradient = change(tangent) * tangent
        if norm(correction) > MIN_CORRECTION:
            gradient += change(correction) / norm(correction) ** 2 * correction
        gradient /= scale
        derivatives = []
        for name in names:
            dR = self.problem.parameter_derivative(X, name, parameters)
            dU = -factors.solve(np.append(dR, 0.0)) * scale
            derivatives.append((dR, derivative(name, dU) - float(gradient @ dU)))
        return AugmentedResidual(evaluation, _mean_growth(mu), gradient[:-1], float(gradient[-1]), tuple(derivatives))

    def _pair(self, X: Array, parameters: dict[str, float], base: Borders) -> ComplexArray:
        """Return the multiplier nearest to that of the exponent of the borders, and the one nearest to its inverse."""
        assert isinstance(base, PairBorders)
        near = np.exp(2 * np.pi * self.problem.nu * base.exponent / parameters["Omega"])
        mu = self._multipliers(X, parameters)
        first = np.argmin(np.abs(mu - near))
        others = np.delete(mu, first)
        return np.array([mu[first], others[np.argmin(np.abs(others - 1 / near))]])

    def _exponent(self, mu: Any, Omega: float) -> complex:
        """Return the exponent of a multiplier, its logarithm over the period."""
        return complex(np.log(mu) * Omega / (2 * np.pi * self.problem.nu))

    def _multipliers(self, X: Array, parameters: dict[str, float]) -> ComplexArray:
        return self.problem.multipliers(X, points=8, **parameters)


def _mean_growth(pair: ComplexArray) -> float:
    """Return half the logarithm of the product of two multipliers: log |mu| of a complex pair."""
    return math.log(abs(pair[0] * pair[1])) / 2


MAX_MEAN_OF_PAIR = 1.05
"""Mean of two multipliers, in absolute value, above which they are real and are not near a resonance, where it is 1."""

MIN_CORRECTION = 1e-13
"""Step of Newton's method, relative to the motion, that is rounding: multipliers are not differentiated along it."""

MIN_RATE_OF_PARAMETER = 0.01
"""Scaled rate of the parameter along a direction below which the step of a difference is that of the motion."""


def exponent_of_pair(mu: ComplexArray, nu: int, Omega: float) -> complex | None:
    """Return the exponent s of the pair exp(2 pi nu s / Omega) nearest to the unit circle; None without pairs."""
    pairs = mu[is_complex(mu) & (mu.imag > 0)]
    if not len(pairs):
        return None
    nearest = complex(pairs[np.argmin(np.abs(np.log(np.abs(pairs))))])
    return complex(np.log(nearest)) * Omega / (2 * np.pi * nu)


def _require_pair(s: complex | None) -> complex:
    """Return the exponent of a pair; raise ValueError without one."""
    if s is None:
        raise ValueError(
            "the motion has no complex pair of multipliers, so it is not near a Neimark-Sacker point: start from an NS "
            "point of a curve"
        )
    return s


BORDER_ITERATIONS = 4
"""Number of inverse iterations for borders, which need not be accurate singular vectors."""


MAX_ROUNDING_RATIO = 0.1
"""Ratio of successive small steps above which they are rounding; before, they decrease quadratically."""


def _exponent(
    hill: CondensedHillMatrix, s: complex, b: ComplexArray, c: ComplexArray, X: Array, parameters: dict[str, float]
) -> _Pair:
    """Compute an exponent by Newton's method on the bordered determinant g(s) of D(s), dg/ds = -w^H D_s v.

    Raises
    ------
    NoConvergence
        If it does not converge.
    ValueError
        If it is the exponent of a mode that no gap changes.
    """
    unit_vector = np.zeros(len(b) + 1)
    unit_vector[-1] = 1.0
    steps: list[float] = []
    last_size = math.inf
    for _ in range(40):
        G, dG = hill.receptances(s)
        factors = Factors(bordered(hill.matrix(G, s), b, c.conj()))
        right, w = factors.solve(unit_vector), factors.adjoint_solve(unit_vector)[:-1]
        v, g = right[:-1], right[-1]
        rate = complex(w.conj() @ hill.rate(G, dG, s) @ v)
        if not abs(g) < hill.omega * abs(rate):  # exponents repeat at this distance, so none is near
            break
        step = g / rate
        s, size = s + step, abs(step) / hill.omega
        steps.append(abs(step))
        if size <= 1e-14 or last_size <= 1e-11 or (last_size <= 1e-7 and size > MAX_ROUNDING_RATIO * last_size):
            y = np.einsum("kij,ki->kj", hill.receptances(s)[0].conj(), w.reshape(-1, hill.m)).ravel()
            return _Pair(s, v, w, y, rate)
        last_size = size
    raise NoConvergence("Newton's method did not converge to an exponent of Hill's determinant", X, parameters, steps)


def _unit(v: ComplexArray) -> ComplexArray:
    """Return a vector of unit norm."""
    return v / norm(v)
