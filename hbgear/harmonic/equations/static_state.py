"""Static states of the elements under the mean loads, and the stiffness of the elements in them.

    Z_0 d + g_0 + p(d) = 0,     k_ij = mean over tau of dp_i/dd_j (d, 0, tau)

Z_0 and g_0 are harmonic 0 of the linear part, see `hbgear.harmonic.structure.receptance`. At a breakpoint, where an
element touches without force, the smaller of the two slopes is used: such a contact counts as open.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.mechanics.laws.slider import first_loading, friction_limits, limit_at
from hbgear.mechanics.reference_stiffness import bend


class Static(NamedTuple):
    """A static state of the elements.

    Attributes
    ----------
    d : ndarray, shape (m,)
        Displacements of the elements.
    stiffness : ndarray, shape (m, m)
        Mean stiffness of the laws; diagonal but for laws of several displacements.
    balanced : bool
        Whether the forces are in equilibrium.
    stable : bool
        Whether the stiffness is positive definite.
    flat : bool
        Whether the smallest stiffness is zero, as in a clearance without load. False by default.
    """

    d: Array
    stiffness: Array
    balanced: bool
    stable: bool
    flat: bool = False


def static_states(compiled: Evaluator, Omega: float) -> Iterator[Static]:
    """Yield static states from Newton's method with harmonic 0 alone, each once and the stable ones first.

    It starts at rest and at displacements on both sides. Iterates that did not converge come last.
    """
    at_rest = _solve_static(compiled, Omega, -compiled.receptance.e[0].real)
    if at_rest.stable or at_rest.flat:
        yield at_rest
    signs = np.where(_load_displacements(compiled, Omega) < 0, -1.0, 1.0)
    lengths = _characteristic_lengths(compiled, Omega) * signs
    found, rejected = [at_rest.d], []
    # closed contacts on either side, near the breakpoints and far beyond them
    for side in (1.5, -1.5, 4.0, -4.0):
        state = _solve_static(compiled, Omega, side * lengths)
        # an iterate close to a position without stiffness did not converge; Newton's method leaves the position from it
        rounding = _SAME_STATE * np.abs(lengths) if state.balanced else 0.0
        if any(np.allclose(state.d, d, rtol=_SAME_STATE, atol=rounding) for d in found):
            continue
        found.append(state.d)
        if state.stable:
            yield state
        elif np.isfinite(state.d).all():
            rejected.append(state)
    rejected += [] if at_rest.stable or at_rest.flat else [at_rest]
    yield from sorted(rejected, key=lambda candidate: not candidate.balanced)


def _solve_static(compiled: Evaluator, Omega: float, d: Array) -> Static:
    """Return the static state from Newton's method that starts at displacements d (m,)."""
    linear, structure = compiled.linear(Omega), compiled.structure
    sums, compatibility = structure.force_sums, structure.compatibility
    e, Z, g = compiled.receptance.e[0].real, linear.Z[0].real, linear.g[0].real
    settled = False
    for _ in range(_MAX_STATIC_ITERATIONS):
        p, k = _mean_force_and_stiffness(compiled, d)
        r = sums @ (Z @ d + g + p) + compatibility @ (d + e)
        terms = np.abs(sums) @ (np.abs(Z) @ np.abs(d) + np.abs(g) + np.abs(p)) + np.abs(compatibility) @ np.abs(d + e)
        residual, rounding = np.linalg.norm(r), _RESIDUAL_ROUNDING * np.linalg.norm(terms)
        # the force of one law may be a sum of large terms that cancel, as in a double well; k d is their size
        cancellation = _CANCELLATION_ROUNDING * np.linalg.norm(np.abs(sums) @ (np.abs(k) @ np.abs(d)))
        if residual <= rounding or settled:
            break
        step = np.linalg.lstsq(sums @ (Z + k) + compatibility, r, rcond=1e-12)[0]
        d = d - step
        if not np.isfinite(d).all():
            break
        settled = bool((np.abs(step) <= _MIN_RELATIVE_STEP * np.abs(d)).all())
    limit = max(_EQUILIBRIUM_TOLERANCE * np.linalg.norm(terms), cancellation)
    balanced = bool(np.isfinite(d).all() and residual <= limit)
    reduced = sums[structure.independent]  # forces on dependent elements act through the constraints
    A = reduced @ (Z + k) @ reduced.T
    size = np.abs(Z).max(initial=0.0) + np.abs(k).max(initial=0.0)
    if not balanced:
        return Static(d, k, False, False)
    smallest = float(np.linalg.eigvalsh(0.5 * (A + A.T))[0])
    return Static(d, k, True, smallest > _ZERO_STIFFNESS_RATIO * size, abs(smallest) <= _ZERO_STIFFNESS_RATIO * size)


_SAME_STATE = 1e-6
"""Difference of displacements, relative to them or to the characteristic length, up to which states agree."""

_MAX_STATIC_ITERATIONS = 50
"""Maximum number of Newton iterations for a static state."""

_RESIDUAL_ROUNDING = 1e-13
"""Residual force, relative to its terms, at which Newton's method stops because of rounding."""

_CANCELLATION_ROUNDING = 1e-11
"""Residual force, relative to stiffness times displacement, that is rounding of the terms of a law."""

_MIN_RELATIVE_STEP = 1e-7
"""Relative Newton step after which a static state is accurate to rounding, because convergence is quadratic."""

_EQUILIBRIUM_TOLERANCE = 1e-6
"""Residual force, relative to its terms, up to which a state counts as balanced."""

_ZERO_STIFFNESS_RATIO = 1e-9
"""Stiffness, relative to the largest one, up to which a position counts as arbitrary."""


def linear_response(compiled: Evaluator, Omega: float, static: Static) -> Array:
    """Return the harmonics (m, K + 1) of the linear response about a static state."""
    linear, structure = compiled.linear(Omega), compiled.structure
    sums, compatibility = structure.force_sums, structure.compatibility
    with np.errstate(all="ignore"):
        try:
            A = sums @ (linear.Z + static.stiffness) + compatibility
            b = linear.g @ sums.T + compiled.receptance.e @ compatibility.T
            d = np.linalg.solve(A, -b[..., None])[..., 0].T
        except np.linalg.LinAlgError:
            d = np.zeros((compiled.m, len(linear.Z)), dtype=complex)
    d[:, 0] = static.d
    return np.where(np.isfinite(d), d, 0.0)


def _characteristic_lengths(compiled: Evaluator, Omega: float) -> Array:
    """Return lengths (m,) at which laws change: breakpoints, bends of smooth laws, or load displacements."""
    springs = compiled.structure.kr
    lengths = np.array(
        [max([*map(abs, law.breakpoints), *(s.reach for s in law.sliders)], default=0.0) for law in compiled.laws]
    )
    if lengths.all():
        return lengths
    law_stiffness = np.abs(
        np.diag(compiled.linear(Omega).Z[0].real + _mean_force_and_stiffness(compiled, np.zeros(compiled.m))[1])
    )
    is_stiff = law_stiffness > _ZERO_STIFFNESS_RATIO * springs  # change of a smooth law that is significant
    stiffness = np.where(is_stiff, law_stiffness, springs)
    for j in np.flatnonzero(lengths == 0):
        lengths[j] = 0.0 if compiled.laws[j].breakpoints else bend(compiled.laws[j], float(stiffness[j]))
    if not lengths.all():
        reference = Static(np.zeros(compiled.m), np.diag(springs), True, True)
        amplitudes = np.abs(linear_response(compiled, Omega, reference)).sum(axis=1) + np.abs(
            _load_displacements(compiled, Omega)
        )
        lengths = np.where(lengths == 0, amplitudes, lengths)
    return lengths


def _load_displacements(compiled: Evaluator, Omega: float) -> Array:
    """Return the displacements (m,) under the constant load with linear reference springs as laws."""
    linear, structure = compiled.linear(Omega), compiled.structure
    sums, compatibility = structure.force_sums, structure.compatibility
    b = sums @ linear.g[0].real + compatibility @ compiled.receptance.e[0].real
    closed = sums @ (linear.Z[0].real + np.diag(compiled.structure.kr)) + compatibility
    return np.linalg.lstsq(closed, -b, rcond=1e-12)[0]


def _mean_force_and_stiffness(compiled: Evaluator, d: Array) -> tuple[Array, Array]:
    """Return the mean force (m,) and stiffness (m, m) of the laws over the phase at constant d, reached from rest."""
    with np.errstate(all="ignore"):  # a law may be undefined at large displacements
        p, k, _ = forces_at(compiled, d, 2 * np.pi * np.arange(_AVERAGED_PHASES) / _AVERAGED_PHASES)
    for j, slider, limit in friction_limits(compiled.system.elements):
        d_n = d[limit.normal : limit.normal + 1] if limit.normal >= 0 else None
        bound = slider.limit if d_n is None else float(limit_at(limit, d_n, np.zeros(1))[0])
        friction, stiffness = first_loading(slider, d[j : j + 1], bound)
        p[j], k[j, j] = p[j] + friction[0], k[j, j] + stiffness[0]
    return p, k


_AVERAGED_PHASES = 64
"""Number of phases over which laws are averaged."""


def forces_at(compiled: Evaluator, d: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Return the mean force (m,), stiffness (m, m) and damping (m, m) of the laws at phases tau, at constant d (m,).

    Stiffness and damping of laws of one displacement are diagonal. Friction is not included.
    """
    m, count = len(d), len(tau)
    p, k, c = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
    coupled = {int(j) for rows, _ in compiled.vectors for j in rows}
    zeros = np.zeros(count)
    for j in (j for j in range(m) if j not in coupled):
        p[j], k[j, j], c[j, j] = (np.mean(x) for x in compiled.laws[j].force(np.full(count, d[j]), zeros, tau))
    for rows, law in compiled.vectors:
        displacements = np.repeat(d[rows, None], count, axis=1)
        block = np.ix_(rows, rows)
        p[rows], k[block], c[block] = (np.mean(x, axis=-1) for x in law.force(displacements, 0 * displacements, tau))
    return p, k, c


_BREAKPOINT_DISTANCE = 1e-9
"""Distance from a breakpoint, over the length of `_characteristic_lengths`, within which a contact has no force."""


def static_stiffness(compiled: Evaluator, Omega: float) -> Array | None:
    """Return the stiffness (m, m) of the elements in a static equilibrium at Omega; None if no equilibrium is found.

    Stable equilibria are preferred, first at rest, then on the side of the load.
    """
    for static in static_states(compiled, Omega):
        if static.balanced:
            distance = _BREAKPOINT_DISTANCE * _characteristic_lengths(compiled, Omega)
            below, above = (_mean_force_and_stiffness(compiled, static.d + side * distance)[1] for side in (-1.0, 1.0))
            is_below = np.abs(np.diag(below)) <= np.abs(np.diag(above))
            return np.where(is_below[:, None], below, above)
    return None
