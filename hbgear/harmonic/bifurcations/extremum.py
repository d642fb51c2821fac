"""Augmented equations of amplitude peaks.

    R(X, p) = 0,   g(X, p) = 0           unknowns U = (X, p)

| class | g |
|---|---|
| AmplitudeExtremum | derivative of a quadratic amplitude along the curve |
| ExtremumPeak | derivative of an amplitude made of extrema of the motion, or of its mean |
| RegisteredMeasurePeak | derivative of a measure of the user, by difference quotients |

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.numerics.linear import Factors, bordered, norm
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.problem.finite_differences import STEP, directional_step, parameter_derivatives
from hbgear.mechanics.series.fourier import extrema, to_real
from hbgear.mechanics.series.measures import BUILT_IN_MEASURES, MEASURES, check_peaks


class AmplitudeExtremum(MinimallyAugmentedProblem):
    """Peaks (PK) of an amplitude: the derivative of A^2 / 2 along the curve vanishes.

        A^2 / 2 = X^T S X / 2,   g = X^T S t,   t the direction of the curve, [J R_p; b^T] t = e

    Parameters
    ----------
    problem : HarmonicBalance
        The problem of the curve.
    parameter : str, optional
        The parameter of the curve, such as "Omega".
    measure : str, optional
        "rms" (alternating part; the default) or a harmonic, "H1", "H2", ...; with nu = 2 also "H1/2".
    element : int, optional
        Number of the element. The default is 0.

    Raises
    ------
    ValueError
        If the measure has another name, or the problem does not keep the harmonic.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> top = hb.analysis.peaks(curve, "rms")[0]
    >>> few = hb.StepControl(max_points=4)
    >>> ridge = hb.trace(hb.harmonic.AmplitudeExtremum(problem, "Omega"), "zeta", (0.05, 0.06), start=top, steps=few)
    >>> bool(ridge.amplitude("rms")[-1] < ridge.amplitude("rms")[0])
    True
    """

    problem: Any  # a HarmonicBalance
    measure: str
    element: int
    S: Array
    argument_names = ("measure", "element")

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "", measure: str = "rms", element: int = 0) -> None:
        super().__init__(problem, parameter)
        self._fixed(measure=measure, element=element, S=self._weights(measure, element).ravel())

    def _weights(self, measure: str, element: int) -> Array:
        """Return S, in the shape of the Fourier coefficients of all elements."""
        S = np.zeros((self.problem.m, 2 * len(self.problem.orders) - 1))
        if measure == "rms":
            S[element, 1:] = 1.0
        else:
            position = int(np.searchsorted(self.problem.orders, _harmonic(measure, self.problem)))
            S[element, 2 * position - 1 : 2 * position + 1] = 1.0
        return S

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        return Borders(self.problem.linearise(X, "", **parameters).size / (1.0 + abs(float(self.S @ (X * X)))))

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the residual g and its derivatives; see `MinimallyAugmentedProblem.extra`."""
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        n = len(X)
        e = np.zeros(n + 1)
        e[-1] = 1.0  # normalises the direction by its component in the parameter
        factors = Factors(bordered(evaluation.dR_dX, evaluation.dR_dp, e))
        t = factors.solve(e)
        slope, curvature = self.slopes(X, t[:n], parameters)
        g = float(slope @ t[:n])
        e[:n], e[n] = slope, 0.0
        z = factors.solve(e, transposed=True)[:n]
        h = directional_step(X, t, self.problem.difference_step(X, parameters))
        u = np.append(X, parameters[self.parameter])
        plus, minus = (
            self.problem.linearise(v[:-1], self.parameter, **{**parameters, self.parameter: float(v[-1])})
            for v in (u + h * t, u - h * t)
        )
        g_X = curvature - z @ (plus.dR_dX - minus.dR_dX) / (2 * h)
        g_p = -float(z @ (plus.dR_dp - minus.dR_dp)) / (2 * h)
        changes = (self._parameter_derivatives(X, parameters, name, z, t) for name in names)
        return AugmentedResidual(evaluation, g, g_X, g_p, tuple((dR, -change) for dR, change in changes))

    def slopes(self, X: Array, t: Array, parameters: dict[str, float]) -> tuple[Array, Array]:
        """Return the gradient (n,) of A^2 / 2, or of A itself, and its derivative along t (n,)."""
        return self.S * X, self.S * t

    def _parameter_derivatives(
        self, X: Array, parameters: dict[str, float], name: str, z: Array, t: Array
    ) -> tuple[Array, float]:
        """Return dR/dname, and z^T d[J R_p]/dname t."""

        def residual_and_product(changed: dict[str, float]) -> tuple[Array, float]:
            evaluation = self.problem.linearise(X, self.parameter, **changed)
            return evaluation.R, float(z @ (evaluation.dR_dX @ t[:-1] + evaluation.dR_dp * t[-1]))

        dR, change = parameter_derivatives(self.problem, name, parameters, residual_and_product)
        return dR, float(change)


class ExtremumPeak(AmplitudeExtremum):
    """Peaks of an amplitude made of extrema of the motion, or of its mean: dA/ds = 0 along the curve.

        A = sum_i s_i d(theta_i),   d'(theta_i) = 0;   dA/dX consists of the rows of cosines and sines at theta_i

    The parameters are the same as for `AmplitudeExtremum`, with a measure of `EXTREMA`: "pp2" (half the peak-to-peak
    value), "max" (largest absolute value) or "mean".

    Raises
    ------
    ValueError
        If the measure has another name.
    """

    def _weights(self, measure: str, element: int) -> Array:
        if measure not in EXTREMA:
            raise ValueError(f"measure = {measure!r} is not made of extrema; use one of {', '.join(EXTREMA)}")
        return np.zeros((self.problem.m, 2 * len(self.problem.orders) - 1))

    def slopes(self, X: Array, t: Array, parameters: dict[str, float]) -> tuple[Array, Array]:
        """Return the gradient (n,) of A, and its derivative along t (n,).

        The position theta_i moves by -w'(theta_i).t / d''(theta_i).
        """
        k, m = self.problem.orders, self.problem.m
        slope, curvature = np.zeros((2, m, 2 * len(k) - 1))
        if self.measure == "mean":
            slope[self.element, 0] = 1.0
            return slope.ravel(), curvature.ravel()
        low, at_low, high, at_high = extrema(self.problem.rows(X)[self.element])
        signed = (
            [(-0.5, at_low), (0.5, at_high)]
            if self.measure == "pp2"
            else [(1.0, at_high) if abs(high) >= abs(low) else (-1.0, at_low)]
        )
        sign, positions = np.array(signed).T
        row, direction = (x.reshape(m, -1)[self.element] for x in (X, t))
        c = np.exp(-1j * k * positions[:, None])
        w, w1, w2 = to_real(np.array([c, -1j * k * c, -(k**2) * c]))
        slope[self.element] = sign @ w
        # the extremum moves by -(w1 direction) / (w2 row) in phase
        curvature[self.element] = -(sign * (w1 @ direction) / (w2 @ row)) @ w1
        return slope.ravel(), curvature.ravel()


EXTREMA = ("pp2", "max", "mean")
"""Measures of `ExtremumPeak`."""


class RegisteredMeasurePeak(AmplitudeExtremum):
    """Peaks of a measure that a user registered: dA/ds = 0 along the curve, gradients by central differences.

    The parameters are the same as for `AmplitudeExtremum`, with a measure registered by `register_measure`.
    """

    def _weights(self, measure: str, element: int) -> Array:
        check_peaks(measure)
        return np.zeros((self.problem.m, 2 * len(self.problem.orders) - 1))

    def slopes(self, X: Array, t: Array, parameters: dict[str, float]) -> tuple[Array, Array]:
        """Return the gradient (n,) of A, and its derivative along t (n,).

        The step of the second difference is larger, because its error from rounding grows with 1 / h^2. It affects only
        the rate of convergence of Newton's method.
        """
        h = SECOND_DIFFERENCE_STEP * (norm(X) or 1.0) / (norm(t) or 1.0)
        curvature = (self._gradient(X + h * t) - self._gradient(X - h * t)) / (2 * h)
        return self._gradient(X), curvature

    def _gradient(self, X: Array) -> Array:
        """Return the gradient (n,) of the measure by central differences in the unknowns of the element."""
        h, m = STEP * (norm(X) or 1.0), self.problem.m
        unknowns = np.arange(len(X)).reshape(m, -1)[self.element]
        changes = np.zeros((len(unknowns), len(X)))
        changes[np.arange(len(unknowns)), unknowns] = h
        layout = self.problem.layout
        above, below = (layout.measure(self.measure, X + sign * changes, self.element) for sign in (1, -1))
        gradient = np.zeros(len(X))
        gradient[unknowns] = (above - below) / (2 * h)
        return gradient


SECOND_DIFFERENCE_STEP = 1e-4
"""Step of the difference quotient of a gradient, relative to the unknowns: near the fourth root of rounding."""


def peak_of(problem: Any, parameter: str, measure: str, element: int) -> AmplitudeExtremum:
    """Return the equations of the peaks of a measure."""
    registered = measure in MEASURES and measure not in BUILT_IN_MEASURES
    kind = ExtremumPeak if measure in EXTREMA else RegisteredMeasurePeak if registered else AmplitudeExtremum
    return kind(problem, parameter, measure, element)


def _harmonic(measure: str, problem: Any) -> int:
    """Return the basis harmonic of "H2" or, for nu = 2, "H1/2"."""
    nu, H = problem.nu, problem.H
    match = re.fullmatch(r"H(\d+)(?:/(\d+))?", measure)
    k = int(match[1]) * nu / int(match[2] or 1) if match and match[2] != "0" else 0
    if k == int(k) and 1 <= k <= H and k not in problem.orders:
        raise ValueError(f"peak of {measure!r}: the balance leaves out this harmonic; add it to its harmonics")
    if k != int(k) or not 1 <= k <= H:
        fractions = f", also H1/{nu}, ..." if nu > 1 else ""
        raise ValueError(f"peak of {measure!r}: need 'rms' or 'H1' to 'H{H // nu}'{fractions}")
    return int(k)
