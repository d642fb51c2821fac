"""Slopes of laws evaluated by AFT, along a motion: at any phases, samples, and their coefficients.

dp/dd (theta) = sum_n K_n e^{i n theta},   dp/dv (theta) = sum_n C_n e^{i n theta}
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.equations.evaluator import Evaluator, sampled_laws
from hbgear.harmonic.forces.breakpoints import gap_and_derivative
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.series.fourier import value_and_derivative
from hbgear.mechanics.series.real_basis import derivative, one_sided


def has_sampled_slopes(compiled: Evaluator) -> bool:
    """Return whether slopes of all laws are known: of laws of hbgear in closed form, of other scalar laws by AFT.

    They are unknown for contacts with dampers, friction, laws of several displacements and compiled laws of the user.
    """
    return not (compiled.damped or compiled.sliders or compiled.vectors or compiled.user_laws)


class SampledSlopes:
    """Slopes of the laws evaluated by AFT.

    Parameters
    ----------
    compiled : Evaluator
        Model at one parameter set, see `has_sampled_slopes`.
    X : ndarray, shape (n,)
        Motion.
    Omega : float
        Frequency of the excitation.

    Attributes
    ----------
    elements : list of int
        Numbers of the elements, L of them.
    """

    def __init__(self, compiled: Evaluator, X: Array, Omega: float) -> None:
        self.elements = [j for j, _ in compiled.aft_laws]
        self._laws = [law for _, law in compiled.aft_laws]
        self._basis, self._omega = compiled.packed.basis, Omega / compiled.nu
        self._rates = derivative(np.eye(len(self._basis))) @ self._basis
        rows = compiled.spread(X).reshape(compiled.m, -1)[self.elements]
        self._d, self._v = rows @ self._basis, self._omega * rows @ self._rates
        grid = compiled.piecewise.grid
        if grid.shape[2]:
            self._d += grid[0][self.elements]
            self._v += self._omega * grid[1][self.elements]
        self._sampled = sampled_laws(compiled)
        N = self._d.shape[1]
        self._tau = 2 * np.pi * compiled.nu * np.arange(N) / N

    def slopes(self, d: Array, v: Array) -> tuple[Array, Array]:
        """Return the slopes in d and v, (L, N) each, at displacements and velocities (L, N) of the samples."""
        slopes = [law.force(*motion, self._tau)[1:] for law, *motion in zip(self._laws, d, v, strict=True)]
        stiffness, damping = (np.array([np.broadcast_to(pair[i], len(self._tau)) for pair in slopes]) for i in (0, 1))
        return stiffness, damping

    def coefficients(self, count: int) -> tuple[ComplexArray, ComplexArray]:
        """Return the coefficients 0..count - 1 of the slopes in d and v, (L, count) each."""
        size = min(count, len(self._tau) // 2 + 1)
        out = np.zeros((2, len(self.elements), count), dtype=complex)
        for slopes, c in zip(self.slopes(self._d, self._v), out, strict=True):
            c[:, :size] = np.fft.rfft(slopes)[:, :size] / len(self._tau)
        for i in self._sampled.indices if self._sampled else ():
            exact = self._between_breakpoints(i, self._d[i], self._v[i], len(self._basis) // 2, count - 1)
            if exact is not None:
                out[:, i] = exact
        return out[0], out[1]

    def _between_breakpoints(self, i: int, d: Array, v: Array, highest: int, order: int) -> ComplexArray | None:
        """Return coefficients 0..order of the slopes (2, order + 1) of a law from samples of its displacement and rate.

        The slopes jump at breakpoints, and are integrated between their crossings; None without crossings. ``highest``
        is the largest order of the displacement.
        """
        assert self._sampled is not None
        c, rate = (one_sided(np.fft.rfft(samples)[: highest + 1] / len(self._tau)) for samples in (d, v))
        between = self._sampled.between_breakpoints(i, c, rate)
        return None if between is None else between.spectra(self._laws[i], c, rate, order)[1:]

    def gradient(self, phi: Array, chi: Array) -> Array:
        """Return the gradient (L, 2H + 1), in the rows of the motion, of mean(K phi + C chi).

            dp = f_dd phi + f_dv chi,   dq = f_vd phi + f_vv chi,   mean(dp delta d + dq delta v)

        phi and chi (L, N) are samples of the weights of the slopes in d and v, which are kept fixed.
        """
        size = max(float(np.abs(phi).max(initial=0.0)), float(np.abs(chi).max(initial=0.0))) or 1.0
        h = _STEP * max(float(np.abs(self._d).max(initial=0.0)), 1e-3) / size
        above, below = (self.slopes(self._d + side * h * phi, self._v + side * h * chi) for side in (1, -1))
        dp, dq = ((a - b) / (2 * h) for a, b in zip(above, below, strict=True))
        out = (dp @ self._basis.T + self._omega * dq @ self._rates.T) / len(self._tau)
        H = len(self._basis) // 2
        for i in self._sampled.indices if self._sampled else ():
            shifted = ((self._d[i] + side * h * phi[i], self._v[i] + side * h * chi[i]) for side in (1, -1))
            ends = [self._between_breakpoints(i, *motion, 2 * H, H) for motion in shifted]
            if ends[0] is not None and ends[1] is not None:
                dK, dC = (ends[0] - ends[1]) / (2 * h)
                out[i] = _means(dK) + self._omega * _means(-1j * np.arange(H + 1) * dC)
        return out

    def samples(self, c: ComplexArray) -> ComplexArray:
        """Return samples (L, N) of functions with the coefficients c (L, 2H + 1) of e^{i k theta}, k = -H..H."""
        k, N = np.arange(c.shape[1]) - c.shape[1] // 2, len(self._tau)
        return c @ np.exp(2j * np.pi / N * (k[:, None] * np.arange(N) % N))


_STEP = 1e-5
"""Step of the central differences of slopes, relative to the largest displacement."""


def _means(x: ComplexArray) -> Array:
    """Return the means (2H + 1,) of a function with two-sided coefficients 0..H times 1, cos theta, sin theta, ..."""
    out = np.empty(2 * len(x) - 1)
    out[0], out[1::2], out[2::2] = x[0].real, x[1:].real, -x[1:].imag
    return out


def slopes_at(compiled: Evaluator, rows: Array, omega: float, theta: Array) -> Array:
    """Return dp/dd and dp/dv (2, m, T) of the laws in Python at phases theta of the basis; zero for all other laws."""
    out = np.zeros((2, compiled.m, len(theta)))
    for j, law in (*compiled.aft_laws, *compiled.damped):
        if isinstance(law, Component):
            continue
        displacement, retained = compiled.system.elements[j].displacement, compiled.piecewise.retained[:, j]
        d, rate = gap_and_derivative(displacement, retained, compiled.nu, rows[j], theta)
        out[:, j] = law.force(d, omega * rate, compiled.nu * theta)[1:]
    return out


def vector_slopes_at(compiled: Evaluator, rows: Array, omega: float, theta: Array) -> list[tuple[np.ndarray, Array]]:
    """Return the elements (p,) and the slopes dp/dd, dp/dv (2, p, p, T) of each vector law at phases theta."""
    slopes = []
    for elements, law in compiled.vectors:
        d, rate = value_and_derivative(rows[elements], theta)
        slopes.append((elements, np.array(law.force(d, omega * rate, compiled.nu * theta)[1:])))
    return slopes


def slope_pairs(compiled: Evaluator) -> np.ndarray:
    """Return the pairs (S, 2) of elements, of the force and of the displacement in which its slope is counted.

    These are all elements in the order of their numbers, followed by pairs of different elements: those of vector laws,
    and an element with friction with the element of its normal force.
    """
    coupled = [(i, j) for elements, _ in compiled.vectors for i in elements for j in elements if i != j]
    coupled += [pair for pair in compiled.normal_pairs if pair not in coupled]
    return np.array([(j, j) for j in range(compiled.m)] + coupled, dtype=int)
