"""Slopes of laws evaluated by AFT, along a motion: samples, their coefficients, and the steps that resolve them.

dp/dd (theta) = sum_n K_n e^{i n theta},   dp/dv (theta) = sum_n C_n e^{i n theta}
"""

from __future__ import annotations

import math

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.series.fourier import evaluate
from hbgear.mechanics.series.real_basis import derivative


def has_sampled_slopes(compiled: Evaluator) -> bool:
    """Return whether slopes of all laws are known: those of hbgear in closed form, others of one displacement by AFT.

    Not so with contacts with dampers, friction, laws of several displacements and compiled laws of the user.
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
        N = self._d.shape[1]
        self._tau = 2 * np.pi * compiled.nu * np.arange(N) / N

    def at(self, d: Array, v: Array) -> tuple[Array, Array]:
        """Return the slopes in d and v, (L, N) each, at displacements and velocities (L, N) of the samples."""
        found = [law.force(*one, self._tau)[1:] for law, *one in zip(self._laws, d, v, strict=True)]
        stiffness, damping = (np.array([np.broadcast_to(one[i], len(self._tau)) for one in found]) for i in (0, 1))
        return stiffness, damping

    def coefficients(self, count: int) -> tuple[ComplexArray, ComplexArray]:
        """Return the coefficients 0..count - 1 of the slopes in d and v, (L, count) each."""
        kept = min(count, len(self._tau) // 2 + 1)
        out = np.zeros((2, len(self.elements), count), dtype=complex)
        for slopes, c in zip(self.at(self._d, self._v), out, strict=True):
            c[:, :kept] = np.fft.rfft(slopes)[:, :kept] / len(self._tau)
        return out[0], out[1]

    def gradient(self, phi: Array, chi: Array) -> Array:
        """Return the gradient (L, 2H + 1), in the rows of the motion, of mean(K phi + C chi).

            dp = f_dd phi + f_dv chi,   dq = f_vd phi + f_vv chi,   mean(dp delta d + dq delta v)

        Parameters
        ----------
        phi, chi : ndarray, shape (L, N)
            Samples of the weights of the slopes in d and v, which are kept fixed.
        """
        size = max(float(np.abs(phi).max(initial=0.0)), float(np.abs(chi).max(initial=0.0))) or 1.0
        h = _STEP * max(float(np.abs(self._d).max(initial=0.0)), 1e-3) / size
        up, down = (self.at(self._d + side * h * phi, self._v + side * h * chi) for side in (1, -1))
        dp, dq = ((a - b) / (2 * h) for a, b in zip(up, down, strict=True))
        out: Array = (dp @ self._basis.T + self._omega * dq @ self._rates.T) / len(self._tau)
        return out

    def samples(self, c: ComplexArray) -> ComplexArray:
        """Return samples (L, N) of functions with the coefficients c (L, 2H + 1) of e^{i k theta}, k = -H..H."""
        k, N = np.arange(c.shape[1]) - c.shape[1] // 2, len(self._tau)
        out: ComplexArray = c @ np.exp(2j * np.pi / N * (k[:, None] * np.arange(N) % N))
        return out


_STEP = 1e-5
"""Step of the central differences of slopes, relative to the largest displacement."""


def slopes_at(compiled: Evaluator, rows: Array, omega: float, theta: Array) -> Array:
    """Return dp/dd and dp/dv (2, m, T) of the laws in Python at phases theta of the basis; zero for all other laws."""
    out = np.zeros((2, compiled.m, len(theta)))
    for j, law in (*compiled.aft_laws, *compiled.damped):
        if isinstance(law, Component):
            continue
        d, v = compiled.gap(j, rows[j], theta), omega * compiled.gap(j, rows[j], theta, 1)
        out[:, j] = law.force(d, v, compiled.nu * theta)[1:]
    return out


def vector_slopes_at(compiled: Evaluator, rows: Array, omega: float, theta: Array) -> list[tuple[np.ndarray, Array]]:
    """Return the elements (p,) and the slopes dp/dd, dp/dv (2, p, p, T) of each vector law at phases theta."""
    found = []
    for elements, law in compiled.vectors:
        d, v = evaluate(rows[elements], theta), omega * evaluate(rows[elements], theta, 1)
        found.append((elements, np.array(law.force(d, v, compiled.nu * theta)[1:])))
    return found


MAX_INTEGRAL_CHANGE = 1e-10
"""Change of the integral of a slope over a step that is divided, relative to the inertia of its element, up to which
the step resolves the slope [-]."""

MAX_SAMPLES = 1024
"""Number of Gauss points per excitation period that detect steep places of a law; kinks are known in advance."""

MAX_DIVISIONS = 30
"""Number of successive divisions of a step."""

MAX_DIVIDED_STEPS = 2000
"""Number of steps of a period from which none is divided: slopes that jump everywhere, such as noise."""

MAX_DECAY_PER_POINT = 0.2
"""Exponent by which a damper slows its element down in a step, per Gauss point."""


def resolved_steps(
    compiled: Evaluator, rows: Array, omega: float, mobility: Array, segments: Array, points: int
) -> tuple[Array, list[int]]:
    """Divide the steps of segments in which Gauss points do not resolve the slopes of laws evaluated by AFT.

    A step is divided where the integrals of slopes over it and over its parts differ, or a damper is too strong for
    it. Steps thus become short at steep places of a law, such as friction tanh(v / v0) where the velocity reverses. The
    Gauss points of the parts are as dense as the samples of the balance (at most 1024 per excitation period), and the
    parts at most half of the step.

    Parameters
    ----------
    compiled : Evaluator
        Model at one parameter set.
    rows : ndarray, shape (m, 2H + 1)
        Motion.
    omega : float
        Frequency of the basis.
    mobility : ndarray, shape (m,)
        Inverse modal masses of the elements.
    segments : ndarray, shape (S, 3)
        First phase, length of the steps in radians, and number of steps of each segment.
    points : int
        Number of Gauss points of a step.

    Returns
    -------
    segments : ndarray, shape (T, 3)
        Segments with resolved steps.
    first : list of int, length S
        Number of the first new segment of each old one.
    """
    x, weights = np.polynomial.legendre.leggauss(points)
    rule = 0.5 * (x + 1), 0.5 * weights
    begin = np.concatenate([a + h * np.arange(n) for a, h, n in segments])
    width = np.repeat(segments[:, 1], segments[:, 2].astype(int))
    source = np.repeat(np.arange(len(segments)), segments[:, 2].astype(int))
    steps, done = (begin, width, source), []
    density = min(compiled.N, MAX_SAMPLES * compiled.nu) / (2 * np.pi * points)
    level = math.ceil(math.log2(max(width.max() * density, 2.0)))
    for _ in range(MAX_DIVISIONS):
        own, decay = _integrals(compiled, rows, omega, mobility, *steps[:2], rule)
        parts = _divided(*steps, 2**level)
        finer = _integrals(compiled, rows, omega, mobility, *parts[:2], rule)[0].reshape(len(own), -1, *own.shape[1:])
        stiffness, damping = np.abs(own - finer.sum(axis=1)).max(axis=2, initial=0.0).T
        change = np.maximum(stiffness * steps[1] / omega, damping)
        coarse = (change > MAX_INTEGRAL_CHANGE) | (decay > MAX_DECAY_PER_POINT * points)
        done.append(tuple(each[~coarse] for each in steps))
        begin, width, source = (each[coarse] for each in steps)
        steps = _divided(begin, width, source, 2)
        level = max(level - 1, 1)
        if not coarse.any() or sum(len(each[0]) for each in done) + len(steps[0]) > MAX_DIVIDED_STEPS:
            break
    begin, width, source = (np.concatenate(each) for each in zip(*done, steps, strict=True))
    return _joined(begin, width, source, len(segments))


def _divided(begin: Array, width: Array, source: np.ndarray, parts: int) -> tuple[Array, Array, np.ndarray]:
    """Return the equal parts (T parts,) of steps."""
    width = width / parts
    start = begin[:, None] + width[:, None] * np.arange(parts)
    return start.ravel(), np.repeat(width, parts), np.repeat(source, parts)


def _integrals(
    compiled: Evaluator,
    rows: Array,
    omega: float,
    mobility: Array,
    begin: Array,
    width: Array,
    rule: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Return the integrals (T, 2, channels) of dp/dd and dp/dv over steps, and the largest exponents (T,) of dampers.

    They are divided by the inertia of the elements.
    """
    x, weights = rule
    theta = (begin[:, None] + width[:, None] * x).ravel()
    found = [slopes_at(compiled, rows, omega, theta) * mobility[:, None]]
    for elements, slopes in vector_slopes_at(compiled, rows, omega, theta):
        found.append(slopes.reshape(2, -1, len(theta)) * mobility[elements].max())
    slopes = np.concatenate(found, axis=1).reshape(2, -1, len(begin), len(x))
    time = width / omega
    return np.moveaxis(slopes @ weights * time, 2, 0), np.abs(slopes[1]).max(axis=(0, 2), initial=0.0) * time


def _joined(begin: Array, width: Array, source: np.ndarray, count: int) -> tuple[Array, list[int]]:
    """Return segments (T, 3) of successive steps of one length, and the first one of each of ``count`` old segments."""
    order = np.argsort(begin, kind="stable")
    begin, width, source = begin[order], width[order], source[order]
    new = np.flatnonzero(np.append(True, (np.abs(np.diff(width)) > 1e-9 * width[1:]) | (np.diff(source) != 0)))
    number = np.diff(np.append(new, len(begin)))
    segments = np.column_stack([begin[new], width[new], number.astype(float)])
    return segments, [int(np.argmax(source[new] == i)) for i in range(count)]
