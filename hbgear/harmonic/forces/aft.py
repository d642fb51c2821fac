"""AFT (alternating frequency/time): force harmonics from N samples per period by fast Fourier transform.

    d_k -> d(theta_n) -> p(d, d', tau) -> f_k,   theta_n = 2 pi n / N

Laws with breakpoints, and laws of several displacements, are integrated by Gauss points between the phases at which a
derivative of the force jumps: known phases, or those at which the motion crosses a breakpoint, or an edge of the law,
such as the wall of a round hole. There are no samples that enter the contact one by one, so that the Jacobian matrix
is continuous, and has derivatives.

References
----------
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import pairwise

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.law_checks import check_returned
from hbgear.mechanics.laws.laws import Forces, Law
from hbgear.mechanics.laws.vector_laws import VectorLaw
from hbgear.mechanics.series.fourier import Transform, derive, evaluate, samples_of, to_complex, to_real, waves
from hbgear.mechanics.series.real_basis import after_derivative, derivative, one_sided

GAUSS_POINTS = 4
"""Gauss points of a panel between known jumps of a law."""

EDGE_GAUSS_POINTS, EDGE_DENSITY, EDGE_POINTS = 8, 40, 1024
"""Gauss points of a panel between crossings of an edge, and least number of points of a period, over H and in total.
The error for products of two harmonics H and a function of the motion up to 2H is 1e-12. A motion that passes close to
a small clearance has a force that varies fast with any H."""

BREAKPOINT_DENSITY, BREAKPOINT_POINTS = 28, 256
"""Least number of Gauss points of a period, over H and in total, between crossings of breakpoints of a law of one
displacement: the error of the Jacobian matrix of a Hunt-Crossley contact is 1e-11 of the stiffness, 1e-9 with 20."""

ZOOM_POINTS, ZOOMS = 17, 4
"""Points of a subdivision that brackets a crossing of an edge, and number of subdivisions: a crossing is interpolated
in 1e-5 of a sample interval."""

SAMPLES_PER_HARMONIC = 8
"""Samples of the highest harmonic of a motion in which its crossings of a level are bracketed; at least 4, see
`switching_times`."""


class SampledLaws:
    """Laws in Python, evaluated by AFT.

    Parameters
    ----------
    laws : sequence of Law
        Laws of all elements.
    elements : ndarray
        Numbers of the elements whose laws are evaluated by AFT.
    transform : Transform
        Fourier transform with N samples per basis period.
    nu : int
        Subharmonic order.
    grid : ndarray, shape (2, m, N)
        Samples of the part of the displacements that is not in the unknowns (prescribed displacements with
        breakpoints), and of its derivative in theta. N = 0 without such displacements.
    plain : bool
        True for equal samples without regard to breakpoints, the usual AFT.

    Attributes
    ----------
    indices : list of int
        Indices of the laws that are integrated between crossings of their breakpoints.
    divided : frozenset of int
        Numbers of the elements of these laws.
    """

    def __init__(
        self, laws: Sequence[Law], elements: np.ndarray, transform: Transform, nu: int, grid: Array, plain: bool
    ) -> None:
        self.elements, self.nu, self._transform = elements, nu, transform
        self.laws = [laws[j] for j in elements]
        self._grid = grid[:, elements] if grid.shape[2] else np.zeros((2, len(elements), 1))
        self.rated = any(law.rated for law in self.laws)
        self._bind = [_bind(law, 2 * np.pi * nu * np.arange(transform.N) / transform.N) for law in self.laws]
        divided = [
            bool(law.breakpoints) and not plain and not self._grid[:, i].any() for i, law in enumerate(self.laws)
        ]
        self.indices = np.flatnonzero(divided).tolist()
        self.divided = frozenset(elements[self.indices].tolist())

    def forces(self, coefficients: Array, Omega: float) -> tuple[Array, Array, Array | None, Array | float]:
        """Return force harmonics (s, 2H + 1) of the s laws and their derivatives (s, 2H + 1, 2H + 1) in d and d'.

        coefficients (m, 2H + 1) are those of all elements. The derivative in d' is None if no law depends on it. The
        fourth value is the harmonics (s, 2H + 1) of the damping times the velocity of prescribed displacements with
        breakpoints, 0 without any.
        """
        c = to_complex(coefficients[self.elements])
        rate = Omega / self.nu * derive(c)
        series = [c, rate] if self.rated else [c]
        samples = self._transform.samples(np.concatenate(series)).reshape(len(series), len(c), -1)
        samples[0] += self._grid[0]
        if self.rated:
            samples[1] += Omega / self.nu * self._grid[1]
        zeros = np.zeros(self._transform.N)
        results = [
            law(d, samples[1, i] if self.rated else zeros)
            for i, (law, d) in enumerate(zip(self._bind, samples[0], strict=True))
        ]
        p, stiffness, damping = (np.array(arrays) for arrays in zip(*results, strict=True))
        spectra = self._transform.spectrum(np.concatenate([p, stiffness, damping] if self.rated else [p, stiffness]))
        spectra = spectra.reshape(-1, len(self.laws), spectra.shape[-1])
        for i in self.indices:
            between = self.between_breakpoints(i, c[i], rate[i])
            if between is not None:
                spectra[:, i] = between.spectra(self.laws[i], c[i], rate[i], spectra.shape[-1] - 1)[: len(spectra)]
        damped = self.rated and bool(spectra[2].any())  # contacts may be shorter than a sample step
        force, *slopes = spectra[: 3 if damped else 2]
        T = [product_matrices(spectrum) for spectrum in slopes]
        H = coefficients.shape[1] // 2
        prescribed: Array | float = 0.0
        if damped and self._grid.any():
            prescribed = to_real(one_sided(self._transform.spectrum(damping * self._grid[1])[:, : H + 1]))
        return to_real(one_sided(force[:, : H + 1])), T[0], T[1] if damped else None, prescribed

    def between_breakpoints(self, i: int, c: ComplexArray, rate: ComplexArray) -> Panels | None:
        """Return panels between the crossings of breakpoints and the phases of law i; None without crossings.

        c and rate (H + 1,) are one-sided coefficients of the displacement and of the velocity. Intervals in which
        there is no force are left out.
        """
        law, period = self.laws[i], 2 * np.pi
        crossings = np.concatenate([roots_of(c, level) for level in law.breakpoints])
        if not crossings.size:
            return None
        phases = [(phase % period + period * k) / self.nu for phase in law.phases for k in range(self.nu)]
        boundaries = np.unique(np.concatenate([phases, crossings % period]))
        intervals = list(pairwise([*boundaries.tolist(), boundaries[0] + period]))
        # intervals in which the law exerts no force need no panels
        probe = Panels([np.array(interval) for interval in intervals], self.nu, EDGE_GAUSS_POINTS)
        acts = np.any(probe.forces(law, c, rate), axis=0).reshape(len(intervals), -1).any(axis=1)
        point_count = max(self._transform.N, BREAKPOINT_POINTS, BREAKPOINT_DENSITY * (len(c) - 1))
        acting = [interval for interval, is_acting in zip(intervals, acts, strict=True) if is_acting]
        panels = [_divided(*interval, point_count, EDGE_GAUSS_POINTS) for interval in acting]
        return Panels(panels, self.nu, EDGE_GAUSS_POINTS, clustered=True)

    def add_to(self, coefficients: Array, Omega: float, R: Array, J: Array, dR: Array) -> float:
        """Add forces and slopes to R, J and dR of all elements; return the norm of the forces."""
        m, n = coefficients.shape
        f, stiffness, damping, prescribed = self.forces(coefficients, Omega)
        R.reshape(m, n)[self.elements] += f
        dR.reshape(m, n)[self.elements] += prescribed / self.nu
        blocks = J.reshape(m, n, m, n)
        for i, j in enumerate(self.elements):
            blocks[j, :, j] += stiffness[i]
            if damping is not None:
                blocks[j, :, j] += after_derivative(damping[i]) * (Omega / self.nu)
                dR.reshape(m, n)[j] += damping[i] @ derivative(coefficients[j]) / self.nu
        return float(np.linalg.norm(f))

    def add_truncated(self, X: Array, Omega: Array, orders: np.ndarray, f: ComplexArray) -> None:
        """Fill f (P, m, L) with the truncated force harmonics ``orders`` (L,) of motions X (P, n), up to N / 2."""
        P, m, _ = f.shape
        N = self._transform.N
        resolved = orders[orders < N // 2]
        c = to_complex(X.reshape(P, m, -1))[:, self.elements]
        velocity = samples_of((Omega / self.nu)[:, None, None] * derive(c), N)
        velocity += (Omega / self.nu)[:, None, None] * self._grid[1]
        tau = np.tile(2 * np.pi * self.nu * np.arange(N) / N, P)
        for i, (j, d) in enumerate(zip(self.elements, (samples_of(c, N) + self._grid[0]).swapaxes(0, 1), strict=True)):
            p = self.laws[i].force(d.ravel(), velocity[:, i].ravel(), tau)[0].reshape(P, -1)
            f[:, j, : len(resolved)] = 2 * np.fft.rfft(p)[:, resolved] / N
            for n, motion in enumerate(c[:, i] if i in self.indices else ()):
                rate = Omega[n] / self.nu * derive(motion)
                panels = self.between_breakpoints(i, motion, rate)
                if panels is not None:
                    f[n, j] = 2 * panels.spectra(self.laws[i], motion, rate, int(orders.max()))[0, orders]


class SampledVectorLaws:
    """Laws of several displacements, evaluated by AFT.

    Parameters
    ----------
    groups : sequence of (ndarray, VectorLaw)
        Numbers of the elements of each law, see `vector_groups`.
    transform : Transform
        Fourier transform with N samples per basis period.
    nu : int
        Subharmonic order.
    """

    def __init__(self, groups: Sequence[tuple[np.ndarray, VectorLaw]], transform: Transform, nu: int) -> None:
        self.groups, self.nu, self._transform = groups, nu, transform
        self._tau = 2 * np.pi * nu * np.arange(transform.N) / transform.N
        self._between = [_between_phases(law.phases, nu, transform.N) if law.phases else None for _, law in groups]

    def add_to(self, coefficients: Array, Omega: float, R: Array, J: Array, dR: Array) -> float:
        """Add forces and slopes to R, J and dR of all elements; return the norm of the forces."""
        m, n = coefficients.shape
        blocks, size = J.reshape(m, n, m, n), 0.0
        for (elements, law), panels in zip(self.groups, self._between, strict=True):
            if panels is not None and not law.rated:
                size += panels.add_to(law, elements, coefficients, R.reshape(m, n), blocks)
                continue
            c, p = to_complex(coefficients[elements]), len(elements)
            d = self._transform.samples(c)
            if _has_continuous_slopes(law) and len(boundaries := edge_crossings(law, coefficients[elements], d)):
                panels = _between_edges(law, coefficients[elements], boundaries, self.nu)
                size += panels.add_to(law, elements, coefficients, R.reshape(m, n), blocks)
                continue
            v = Omega / self.nu * self._transform.samples(derive(c)) if law.rated else np.zeros_like(d)
            force, kd, kv = law.force(d, v, self._tau)
            f = to_real(one_sided(self._transform.spectrum(force)[:, : n // 2 + 1]))
            R.reshape(m, n)[elements] += f
            size += float(np.linalg.norm(f))
            T = product_matrices(self._transform.spectrum(kd.reshape(p * p, -1))).reshape(p, p, n, n)
            blocks[np.ix_(elements, np.arange(n), elements)] += T.transpose(0, 2, 1, 3)
            if law.rated and kv.any():
                T = product_matrices(self._transform.spectrum(kv.reshape(p * p, -1))).reshape(p, p, n, n)
                blocks[np.ix_(elements, np.arange(n), elements)] += (
                    Omega / self.nu * after_derivative(T).transpose(0, 2, 1, 3)
                )
                rates = derivative(coefficients[elements])
                dR.reshape(m, n)[elements] += np.einsum("ijab,jb->ia", T, rates) / self.nu
        return size

    def add_truncated(self, X: Array, Omega: Array, orders: np.ndarray, f: ComplexArray) -> None:
        """Add the truncated force harmonics ``orders`` (L,) of motions X (P, n), up to N / 2, to f (P, m, L)."""
        N, m = self._transform.N, f.shape[1]
        resolved = orders[orders < N // 2]
        c = to_complex(X.reshape(len(X), m, -1))
        for elements, law in self.groups:
            d = samples_of(c[:, elements], N).swapaxes(0, 1).reshape(len(elements), -1)
            rates = (Omega / self.nu)[:, None, None] * derive(c[:, elements])
            v = samples_of(rates, N).swapaxes(0, 1).reshape(len(elements), -1)
            p = law.force(d, v, np.tile(self._tau, len(X)))[0].reshape(len(elements), len(X), N).swapaxes(0, 1)
            f[:, elements, : len(resolved)] += 2 * np.fft.rfft(p)[..., resolved] / N


def roots_of(c: ComplexArray, level: float = 0.0) -> Array:
    """Return the phases in [0, 2 pi], ascending, at which a motion with coefficients c (H + 1,) crosses a level."""
    from hbgear.harmonic.forces.switching_times import crossings

    H = len(c) - 1
    samples = samples_of(c[None], SAMPLES_PER_HARMONIC * max(H, 4))[0]
    theta, sign = np.empty(2 * H + 4), np.empty(2 * H + 4)
    count = crossings(np.ascontiguousarray(c), float(level), np.ascontiguousarray(samples), theta, sign)
    return theta[:count]


def _has_continuous_slopes(law: VectorLaw) -> bool:
    """Return whether a law is integrated between the crossings of its edges, which depend on the displacements only."""
    return law.grazes and law.has_edges and not law.rated and not law.phases


def edge_crossings(law: VectorLaw, rows: Array, samples: Array) -> Array:
    """Return the angles theta in [0, 2 pi), ascending, at which a motion crosses an edge of a law.

    The motion has rows (p, 2H + 1) and samples (p, N). An edge may be crossed twice between two samples.
    """
    step, roots = 2 * np.pi / samples.shape[1], []
    for index, e in enumerate(law.edges(samples)):
        edge = partial(_edge_at, law, rows, index)
        before, after = np.roll(e, 1), np.roll(e, -1)
        low = np.flatnonzero((e < 0) != (after < 0)) * step
        high = low + step
        d2 = before - 2 * e + after
        extremal = ((e < 0) == (before < 0)) & ((e < 0) == (after < 0)) & (np.abs(e) <= np.abs(d2)) & (d2 * e > 0)
        extremal &= (np.abs(e) <= np.abs(before)) & (np.abs(e) <= np.abs(after))
        for i in np.flatnonzero(extremal).tolist():
            inside = _turning_point(edge, (i - 1) * step, (i + 1) * step, float(np.sign(e[i])))
            if inside is not None:
                low, high = np.append(low, [(i - 1) * step, inside]), np.append(high, [inside, (i + 1) * step])
        roots.append(_roots(edge, low, high))
    return np.sort(np.concatenate([np.zeros(0), *roots]) % (2 * np.pi))


def _edge_at(law: VectorLaw, rows: Array, index: int, theta: Array) -> Array:
    """Return an edge of a law at angles of any shape."""
    return law.edges(evaluate(rows, theta))[index].reshape(theta.shape)


def _turning_point(edge: Callable[[Array], Array], low: float, high: float, sign: float) -> float | None:
    """Return an angle of an interval at which the edge does not have the sign; None if it has it everywhere."""
    for _ in range(ZOOMS):
        theta = np.linspace(low, high, ZOOM_POINTS)
        values = sign * edge(theta)
        best = int(values.argmin())
        if values[best] < 0:
            return float(theta[best])
        low, high = theta[max(best - 1, 0)], theta[min(best + 1, ZOOM_POINTS - 1)]
    return None


def _roots(edge: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Return the roots of an edge in the intervals (low, high) by subdivision and linear interpolation."""
    index, fractions = np.arange(len(low)), np.linspace(0.0, 1.0, ZOOM_POINTS)
    if not len(low):
        return low
    for _ in range(ZOOMS):
        theta = low[:, None] + (high - low)[:, None] * fractions
        values = edge(theta)
        first = np.argmax((values[:, 1:] < 0) != (values[:, :1] < 0), axis=1)
        low, high = theta[index, first], theta[index, first + 1]
    a, b = values[index, first], values[index, first + 1]
    return low + (high - low) * np.divide(a, a - b, out=np.zeros_like(a), where=a != b)


def _between_phases(phases: Sequence[float], nu: int, N: int) -> Panels:
    """Return panels between known phases, with N points per basis period or more."""
    period = 2 * np.pi
    boundaries = np.unique([0.0, period, *((phase % period + period * i) / nu for phase in phases for i in range(nu))])
    boundaries = boundaries[np.diff(boundaries, prepend=-1.0) > 1e-12]
    return Panels([_divided(a, b, N, GAUSS_POINTS) for a, b in pairwise(boundaries.tolist())], nu, GAUSS_POINTS)


def _between_edges(law: VectorLaw, rows: Array, boundaries: Array, nu: int) -> Panels:
    """Return panels between crossings of edges, without the intervals in which there is no force."""
    low, high = boundaries, np.append(boundaries[1:], boundaries[0] + 2 * np.pi)
    theta = low[:, None] + (high - low)[:, None] * np.array([0.25, 0.5, 0.75])
    d = evaluate(rows, theta)
    force, kd, _ = law.force(d, np.zeros_like(d), nu * theta.ravel())
    acts = (force.any(axis=0) | kd.any(axis=(0, 1))).reshape(theta.shape).any(axis=1)
    point_count = max(EDGE_POINTS, EDGE_DENSITY * (rows.shape[1] // 2))
    intervals = list(zip(low[acts].tolist(), high[acts].tolist(), strict=True))
    return Panels([_divided(a, b, point_count, EDGE_GAUSS_POINTS) for a, b in intervals], nu, EDGE_GAUSS_POINTS)


def _divided(a: float, b: float, point_count: int, points: int) -> Array:
    """Return the ends of panels of an interval, for a number of Gauss points in a period."""
    return np.linspace(a, b, 1 + max(1, math.ceil(point_count * (b - a) / (2 * np.pi * points))))


@cache
def _gauss_rule(points: int) -> tuple[Array, Array]:
    """Return the Gauss points and weights of [-1, 1], which every motion in contact needs."""
    return np.polynomial.legendre.leggauss(points)


class Panels:
    """Integration over intervals of the basis period by panels of Gauss points.

    Parameters
    ----------
    panels : sequence of ndarray
        Angles theta, ascending, that divide each interval in which the force is smooth.
    nu : int
        Subharmonic order.
    points : int
        Gauss points of a panel.
    clustered : bool, optional
        If True, the points of each interval are moved towards its ends by theta = a + (b - a) s^2 (3 - 2 s), s from 0
        to 1. A force that grows there as a root of the distance, such as a Hertzian contact, is smooth in s.
    """

    def __init__(self, panels: Sequence[Array], nu: int, points: int, clustered: bool = False) -> None:
        x, w = _gauss_rule(points)
        theta, weights = [np.zeros(0)], [np.zeros(0)]
        for ends in panels:
            half = 0.5 * np.diff(ends)[:, None]
            nodes, weight = (ends[:-1, None] + half * (1 + x)).ravel(), (half * w / np.pi).ravel()
            if clustered:
                length = ends[-1] - ends[0]
                s = (nodes - ends[0]) / length
                nodes, weight = ends[0] + length * s * s * (3 - 2 * s), weight * 6 * s * (1 - s)
            theta.append(nodes)
            weights.append(weight)
        self.theta, self.weights = np.concatenate(theta), np.concatenate(weights)
        self.tau, self._waves = nu * self.theta, np.zeros((0, 0), dtype=complex)

    def waves(self, H: int) -> ComplexArray:
        """Return exp(i k theta) at the points, (Q, H + 1)."""
        if self._waves.shape[1] != H + 1:
            self._waves = waves(self.theta, H)
        return self._waves

    def spectra(self, law: Law, c: ComplexArray, rate: ComplexArray, order: int) -> ComplexArray:
        """Return two-sided coefficients 0..order of p, dp/dd and dp/dv of a law (3, order + 1).

        c, rate (H + 1,) are one-sided coefficients of the displacement and of the velocity.
        """
        if not self.theta.size:  # the force is zero everywhere
            return np.zeros((3, order + 1), dtype=complex)
        w = self.waves(max(order, len(c) - 1))[:, : order + 1]
        return ((0.5 * self.weights * self.forces(law, c, rate)) @ w).conj()

    def forces(self, law: Law, c: ComplexArray, rate: ComplexArray) -> Array:
        """Return p, dp/dd and dp/dv of a law (3, Q) at the points; see `spectra`."""
        w = self._waves[:, : len(c)] if self._waves.shape[1] >= len(c) else waves(self.theta, len(c) - 1)
        d, v = ((w @ z).real for z in (c, rate))
        return np.array([np.broadcast_to(values, len(d)) for values in law.force(d, v, self.tau)])

    def add_to(self, law: VectorLaw, elements: np.ndarray, coefficients: Array, R: Array, blocks: Array) -> float:
        """Add forces to R (m, n) and slopes to blocks (m, n, m, n); return the norm of the forces."""
        n = coefficients.shape[1]
        w = self.waves(n - 1)  # of the slopes, whose products with the motion have orders up to 2H
        motion_waves, mean = w[:, : n // 2 + 1], 0.5 * self.weights
        d = (to_complex(coefficients[elements]) @ motion_waves.T).real
        force, kd, _ = law.force(d, np.zeros_like(d), self.tau)
        f = to_real(one_sided(((mean * force) @ motion_waves).conj()))
        R[elements] += f
        pairs = np.argwhere(kd.any(axis=2))
        kappa = ((mean * kd[tuple(pairs.T)]) @ w).conj()
        for (i, j), T in zip(pairs, product_matrices(kappa), strict=True):
            blocks[elements[i], :, elements[j]] += T
        return float(np.linalg.norm(f))


def _bind(law: Law, tau: Array) -> Callable[[Array, Array], Forces]:
    """Return the law at fixed phases tau.

    Raises
    ------
    ValueError
        If the law does not return three arrays of the shape of the displacements.
    """
    bound, zeros = law.bind(tau), np.zeros(len(tau))
    with np.errstate(all="ignore"):
        check_returned(law, bound(zeros, zeros), tau.shape)
    return bound


def product_matrices(kappa: ComplexArray) -> Array:
    """Return the real matrices (s, 2H + 1, 2H + 1) of products with functions of two-sided coefficients."""
    from hbgear.harmonic.forces.toeplitz_kernel import add_product

    out = np.zeros((len(kappa), kappa.shape[1], kappa.shape[1]))
    for coefficients, T in zip(np.ascontiguousarray(kappa), out, strict=True):
        add_product(coefficients, np.arange(len(T) // 2 + 1), T)
    return out
