"""Kernels: exact harmonic projection of piecewise-linear and cubic laws.

A continuous piecewise-linear law is a sum of ramps, g(d) = g0 + s0 d + sum_i D_i max(d - x_i, 0). Let theta_j be the
switching times, at which d crosses the breakpoint x, with sigma_j = +1 for an upward and -1 for a downward crossing.
The indicator function of d > x has the Fourier coefficients

    s_n = (1 / 2 pi) sum_j sigma_j exp(-i n theta_j) / (i n),     s_0 = fraction of the period with d > x

With kappa = s0 + sum_i D_i s(x_i) and chi = g0 - sum_i D_i x_i s(x_i), both multiplied by the Fourier series of the
stiffness, the force and its derivative are

    P_k = sum_m kappa_{k-m} d_m + chi_k,        dP/dd = Toeplitz(kappa)      (two-sided coefficients)

The kappa and chi of several springs with different stiffness series are summed. A cubic spring adds k1 + k3 d^2 to
kappa, and its derivative contains 2 k3 d^2 in addition to kappa.

If the stiffness k or the prescribed displacement e has breakpoints in the phase, let d = t + w, where t is a
trigonometric polynomial and w a piecewise polynomial. The coefficients of k s and k w s then replace those of s; see
`hbgear.harmonic.forces.breakpoints` and `spans`.

The derivative has no boundary terms, because g is continuous. No force is sampled. The only discrete decision is which
crossings exist; it is verified at the extrema between the samples of the motion.

References
----------
Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868, for contact projected exactly.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import inlined, kernel
from hbgear.harmonic.forces.piecewise_kernels import crossings_of, fill_gap, has_segments, sampled_gap, sizes_of, spans
from hbgear.harmonic.forces.slider_kernels import SliderWorkspace, add_sliders, slider_workspace
from hbgear.mechanics.series.fourier_kernels import coefficient

LEAST_STEP, STEP_OVER_SQUARE = 1e-10, 1e-3
"""Least relative step of central differences of dR/dX, and step over the square of the shortest interval of contact.

dR/dX has the slope of a square root in the penetration. Relative to the motion this is the square of the interval [rad]
over 8, and the step changes it by at most a hundredth: the error is 1e-4. At the least step the rounding error is 1e-6.
"""


class ProjectionWorkspace(NamedTuple):
    """Preallocated arrays for the projection of motions with H harmonics, overwritten by each projection.

    Attributes
    ----------
    theta, sign : ndarray, shape (K, C)
        Phases [rad] and directions of the crossings of each breakpoint, see `cross`.
    number : ndarray, shape (K,)
        Number of crossings of each breakpoint.
    above : ndarray, shape (K,)
        Whether the motion is above each breakpoint at phase 0.
    kappa, chi, extra : ndarray, shape (m, order + 1)
        Coefficients of each element, see `project`.
    motion : ndarray, shape (2, N)
        Values and slopes of a displacement, see `sampled_gap`.
    waves : ndarray, shape (H + 1,)
        One-sided coefficients of a displacement.
    square : ndarray, shape (2H + 1,)
        Two-sided coefficients of a displacement.
    indicator, gap_part : ndarray, shape (L,)
        Two-sided coefficients of s or k s, and of k w s.
    spring_terms : ndarray, shape (2, S, L)
        kappa and chi of each spring without its stiffness series.
    ends : ndarray, shape (2, Q)
        Working memory for derivatives of polynomials.
    slides : SliderWorkspace
        Arrays of the friction sliders.
    """

    theta: Array
    sign: Array
    number: np.ndarray
    above: np.ndarray
    kappa: ComplexArray
    chi: ComplexArray
    extra: ComplexArray
    motion: Array
    waves: ComplexArray
    square: ComplexArray
    indicator: ComplexArray
    gap_part: ComplexArray
    spring_terms: ComplexArray
    ends: Array
    slides: SliderWorkspace


@kernel
def projection_workspace(packed: Any, m: int, H: int, order: Any) -> Any:
    """Return a `ProjectionWorkspace` for motions of m elements with H harmonics, and kappa up to ``order``."""
    laws, (_, breakpoints, degrees) = packed.laws, sizes_of(packed.piecewise)
    K, C, S = laws.level.shape[0], 2 * H + 4 + 2 * breakpoints, laws.spring_element.shape[0]
    length, coefficients = order + laws.shifts[laws.shifts.shape[0] - 1] + 1, np.empty((3, m, order + 1), np.complex128)
    part, waves = np.empty((2, length), np.complex128), np.empty(H + 1, np.complex128)
    square, both = np.empty(2 * H + 1, np.complex128), np.empty((2, S, length), np.complex128)
    return ProjectionWorkspace(
        np.empty((K, C)),
        np.empty((K, C)),
        np.empty(K, np.int64),
        np.empty(K, np.bool_),
        coefficients[0],
        coefficients[1],
        coefficients[2],
        np.empty((2, packed.basis.shape[1])),
        waves,
        square,
        part[0],
        part[1],
        both,
        np.empty((2, degrees)),
        slider_workspace(packed.sliders, H, packed.basis.shape[1], order + 1),
    )


@kernel
def instants(packed: Any, coefficients: Any, ramped: Any) -> Any:
    """Call `cross` from Python; return theta, sign, number and above of the workspace."""
    space = projection_workspace(packed, coefficients.shape[0], coefficients.shape[1] // 2, np.int64(0))
    cross(packed, coefficients, ramped, space)
    return space.theta, space.sign, space.number, space.above


@kernel
def shortest_interval(theta: Any, number: Any) -> float:
    """Return the shortest interval between two successive crossings of one breakpoint [rad]; 2 pi without crossings."""
    shortest = 2 * math.pi
    for i in range(number.shape[0]):
        for j in range(number[i]):
            after = theta[i, j + 1] if j + 1 < number[i] else theta[i, 0] + 2 * math.pi
            shortest = min(shortest, after - theta[i, j])
    return shortest


@kernel
def projected(packed: Any, coefficients: Any, order: int) -> Any:
    """Call `project` from Python; return kappa, chi and extra of the workspace."""
    space = projection_workspace(packed, coefficients.shape[0], coefficients.shape[1] // 2, order)
    project(packed, coefficients, space)
    return space.kappa, space.chi, space.extra


@kernel
def cross(packed: Any, coefficients: Any, ramped: Any, space: Any) -> None:
    """Compute the crossings of all breakpoints by a motion.

    Parameters
    ----------
    packed : PackedModel
        Arrays of the model.
    coefficients : ndarray, shape (m, 2H + 1)
        Real Fourier coefficients of each element.
    ramped : bool
        Whether only breakpoints with a change of slope are evaluated, see `PackedLaws.ramped`.
    space : ProjectionWorkspace
        Workspace; theta, sign, number and above are filled.
    """
    laws, c, previous, bound = packed.laws, space.waves, -1, 0.0
    for i in range(laws.level.shape[0]):
        space.number[i], space.above[i] = 0, False
        j = laws.owner[i]
        moving = j >= coefficients.shape[0]
        if not laws.ramped[i] and (ramped or moving):  # a moving level of this kind is used for clearances only
            continue
        if j != previous and not (previous >= coefficients.shape[0] and laws.element[j] == laws.element[previous]):
            bound = sampled_gap(packed.piecewise, packed.basis, coefficients[laws.element[j]], j, c, space.motion)
        previous = j
        space.number[i], space.above[i] = crossings_of(
            packed.piecewise, j, laws.level[i], c, bound, space.motion, space.theta[i], space.sign[i]
        )


@kernel
def project(packed: Any, coefficients: Any, space: Any) -> None:
    """Fill the workspace with two-sided coefficients kappa, chi and extra; dP/dd = Toeplitz(kappa + extra).

    coefficients (m, 2H + 1) : real Fourier coefficients of each element.
    """
    laws, piecewise, c = packed.laws, packed.piecewise, space.waves
    kappa, chi, extra = space.kappa, space.chi, space.extra
    kappa[:, :] = 0j
    chi[:, :] = 0j
    extra[:, :] = 0j
    if laws.spring_element.shape[0]:
        cross(packed, coefficients, np.bool_(True), space)  # a literal would compile `cross` a second time
        _add_springs(laws, piecewise, space)
    add_sliders(packed.sliders, packed.basis, coefficients, space.slides, kappa, chi)
    for j in range(coefficients.shape[0]):
        if laws.cubic[j, 0] != 0.0 or laws.cubic[j, 1] != 0.0:
            fill_gap(piecewise, coefficients[j], j, c)
            _add_cubic(c, laws.cubic[j, 0], laws.cubic[j, 1], kappa[j], extra[j], space.square)
            _add_piecewise_cubic(piecewise, j, c, laws.cubic[j, 0], laws.cubic[j, 1], kappa[j], chi[j], extra[j])
        _add_retained(piecewise, j, kappa[j], chi[j])


@inlined
def _add_springs(laws: Any, piecewise: Any, space: Any) -> None:
    """Add the springs of the table to kappa and chi, computed from the crossings of their breakpoints."""
    theta, sign, count, above = space.theta, space.sign, space.number, space.above
    s, gap_part, terms, previous = space.indicator, space.gap_part, space.spring_terms, -1
    terms[:, :, :] = 0j
    for p in range(laws.spring_element.shape[0]):
        if not spans(piecewise, p, theta[0], sign[0], np.int64(0), np.bool_(True), s, gap_part, space.ends):
            terms[0, p, 0], terms[1, p, 0] = laws.base[p, 0], laws.base[p, 1]
            continue
        for n in range(s.shape[0]):
            terms[0, p, n] = laws.base[p, 0] * s[n]
            terms[1, p, n] = laws.base[p, 1] * s[n] + laws.base[p, 0] * gap_part[n]
    for r in range(laws.ramp_breakpoint.shape[0]):
        i, p, D = laws.ramp_breakpoint[r], laws.ramp_spring[r], laws.slope_change[r]
        if spans(piecewise, p, theta[i], sign[i], count[i], above[i], s, gap_part, space.ends):
            previous = -1
            for n in range(s.shape[0]):
                terms[0, p, n] += D * s[n]
                terms[1, p, n] += D * (gap_part[n] - laws.level[i] * s[n])
            continue
        if i != previous:
            _indicator(theta[i], sign[i], count[i], above[i], s)
            previous = i
        for n in range(s.shape[0]):
            terms[0, p, n] += D * s[n]
            terms[1, p, n] -= D * laws.level[i] * s[n]
    for p in range(laws.spring_element.shape[0]):
        _modulate(laws.shifts, laws.series[p], terms[0, p], space.kappa[laws.spring_element[p]])
        _modulate(laws.shifts, laws.series[p], terms[1, p], space.chi[laws.spring_element[p]])


@kernel
def _add_retained(piecewise: Any, j: int, kappa: Any, chi: Any) -> None:
    """Add the product of kappa and the harmonics `PiecewiseExcitation.retained` of a displacement to chi.

    The product is added up to the highest order for which all of its terms are known.
    """
    if piecewise is None:
        return
    if not has_segments(piecewise, j):
        return
    retained = piecewise.retained[:, j]
    H = retained.shape[0] - 1
    for k in range(chi.shape[0] - H):
        chi[k] += coefficient(kappa, retained, k)


@kernel
def _add_piecewise_cubic(
    piecewise: Any, j: int, c: Any, k1: float, k3: float, kappa: Any, chi: Any, extra: Any
) -> None:
    """Add the terms of a cubic spring that depend on w, if w has breakpoints.

    The terms of kappa are 3 k3 (t w + w^2), those of chi k1 w + k3 w^3, and those of ``extra`` 3 k3 t w.
    """
    if piecewise is None:
        return
    if not has_segments(piecewise, j):
        return
    w = piecewise.gap_powers[j]  # (3, L) coefficients of w, w^2, w^3
    H = c.shape[0] - 1
    for k in range(min(kappa.shape[0], w.shape[1] - H)):
        tw = coefficient(w[0], c, k)
        kappa[k] += 3.0 * k3 * (tw + w[1, k])
        chi[k] += k1 * w[0, k] + k3 * w[2, k]
        extra[k] += 3.0 * k3 * tw


@kernel
def _indicator(theta: Any, sign: Any, count: int, above: bool, s: Any) -> None:
    """Store the coefficients s_n of the indicator function of d > x from its switching times."""
    fraction = 1.0 if above else 0.0
    for n in range(s.shape[0]):
        s[n] = 0.0
    for j in range(count):
        fraction -= sign[j] * theta[j] / (2 * math.pi)
        z, w = complex(math.cos(theta[j]), -math.sin(theta[j])), complex(sign[j], 0.0)
        for n in range(1, s.shape[0]):
            w = w * z
            s[n] += w
    s[0] = fraction
    for n in range(1, s.shape[0]):
        s[n] = s[n] * complex(0.0, -1.0 / (2 * math.pi * n))


@kernel
def _modulate(shifts: Any, series: Any, s: Any, out: Any) -> None:
    """Add the product of two real functions to ``out``; all coefficients are two-sided.

    s has the coefficients 0, 1, 2, ..., series those at the orders ``shifts``, of which the first is 0.
    """
    for k in range(out.shape[0]):
        out[k] += series[0].real * s[k]
    for i in range(1, shifts.shape[0]):
        shift, a = shifts[i], series[i]
        if a == 0.0:
            continue
        for k in range(out.shape[0]):
            n = k - shift
            lower = s[n] if n >= 0 else s[-n].conjugate()
            out[k] += a * lower + a.conjugate() * s[k + shift]


@kernel
def _add_cubic(c: Any, k1: float, k3: float, kappa: Any, extra: Any, two_sided: Any) -> None:
    """Add k1 + k3 d^2 to kappa and 2 k3 d^2 to ``extra``; two_sided (2H + 1,) is overwritten."""
    H, order = c.shape[0] - 1, kappa.shape[0] - 1
    two_sided[H] = c[0]
    for k in range(1, H + 1):
        two_sided[H + k], two_sided[H - k] = 0.5 * c[k], 0.5 * c[k].conjugate()
    kappa[0] += k1
    for k in range(min(2 * H, order) + 1):
        square = 0j
        for n in range(k - H, H + 1):
            square += two_sided[H + n] * two_sided[H + k - n]
        kappa[k] += k3 * square
        extra[k] += 2.0 * k3 * square
