"""Static states of the elements under the mean loads, and the stiffness of the elements in them.

    Z_0 d + g_0 + p(d) = 0,     k_j = mean over tau of dp_j/dd (d_j, 0, tau)

with Z_0, g_0 as harmonic 0 of `receptance`. At a corner of a law, where an element touches without force, the smaller
of the slopes on both sides counts: such a contact is open.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.mechanics.reference_stiffness import bend


class Static(NamedTuple):
    """A static state of the elements: d (m,), the stiffness (m,) of laws there, whether it is balanced, and stable.

    flat : balanced, and neither stable nor unstable, as in a gap without load.
    """

    d: Array
    stiffness: Array
    balanced: bool
    stable: bool
    flat: bool = False


def statics(compiled: Evaluator, Omega: float) -> Iterator[Static]:
    """Static states that Newton finds with harmonic 0 alone: of rest, and from several sides; the stable ones first.

    Where Newton finds no balance, its last iterate comes in the end.
    """
    rest = _balanced(compiled, Omega, -compiled.receptance.e[0].real)
    if rest.stable or rest.flat:
        yield rest
    reach = _reach(compiled, Omega) * _pushed(compiled, Omega)
    others = []
    for side in (1.5, -1.5, 4.0, -4.0):
        found = _balanced(compiled, Omega, side * reach)
        if found.stable:
            yield found
        elif np.isfinite(found.d).all():
            others.append(found)
    others += [] if rest.stable or rest.flat else [rest]
    yield from sorted(others, key=lambda one: not one.balanced)


def _balanced(compiled: Evaluator, Omega: float, d: Array) -> Static:
    """The static state that Newton finds from displacements d (m,) of the elements."""
    linear, joint, ties = compiled.linear(Omega), compiled.structure.joint, compiled.structure.ties
    e, Z, g = compiled.receptance.e[0].real, linear.Z[0].real, linear.g[0].real
    for _ in range(_STEPS):
        p, k = _static(compiled.laws, d)
        r = joint @ (Z @ d + g + p) + ties @ (d + e)
        terms = np.abs(joint) @ (np.abs(Z) @ np.abs(d) + np.abs(g) + np.abs(p)) + np.abs(ties) @ np.abs(d + e)
        if np.linalg.norm(r) <= _ROUNDING * np.linalg.norm(terms):
            break
        step = np.linalg.lstsq(joint @ (Z + np.diag(k)) + ties, r, rcond=1e-12)[0]
        d = d - step
        if not np.isfinite(d).all() or (np.abs(step) <= _STATIC * np.abs(d)).all():
            break
    balanced = bool(np.isfinite(d).all() and np.linalg.norm(r) <= _BALANCED * np.linalg.norm(terms))
    own = joint[compiled.structure.own]  # forces on the others act through their ties
    A = Z[np.ix_(compiled.structure.own, compiled.structure.own)] + (own * k) @ own.T
    size = np.abs(Z).max(initial=0.0) + np.abs(k).max(initial=0.0)
    if not balanced:
        return Static(d, k, False, False)
    least = float(np.linalg.eigvalsh(0.5 * (A + A.T))[0])
    return Static(d, k, True, least > _FLAT * size, abs(least) <= _FLAT * size)


_STEPS = 50  # of Newton to a static state


_ROUNDING = 1e-13  # force left over, relative to the terms, that no step makes smaller


_STATIC = 1e-7  # step of Newton, relative, behind which a static state is one to all digits


_BALANCED = 1e-6  # force left over, relative to the terms it is the sum of, of a static state


_FLAT = 1e-9  # stiffness, relative, of a position that is arbitrary


def linear_response(compiled: Evaluator, Omega: float, static: Static) -> Array:
    """Harmonics (m, K + 1) of the linear response about a static state."""
    linear, joint, ties = compiled.linear(Omega), compiled.structure.joint, compiled.structure.ties
    with np.errstate(all="ignore"):
        try:
            A = joint @ (linear.Z + np.diag(static.stiffness)) + ties
            b = linear.g @ joint.T + compiled.receptance.e @ ties.T
            d = np.linalg.solve(A, -b[..., None])[..., 0].T
        except np.linalg.LinAlgError:
            d = np.zeros((compiled.m, len(linear.Z)), dtype=complex)
    d[:, 0] = static.d
    return np.where(np.isfinite(d), d, 0.0)


def _reach(compiled: Evaluator, Omega: float) -> Array:
    """Lengths (m,) at which laws change: corners, where a smooth law bends, or as far as the loads move the element."""
    springs = compiled.structure.kr
    reach = np.array([max(np.abs(law.breakpoints), default=0.0) for law in compiled.laws])
    if reach.all():
        return reach
    own = np.abs(np.diag(compiled.linear(Omega).Z[0].real) + _static(compiled.laws, np.zeros(compiled.m))[1])
    stiffness = np.where(own > _FLAT * springs, own, springs)  # what a smooth law must change by to matter
    for j in np.flatnonzero(reach == 0):
        reach[j] = 0.0 if compiled.laws[j].breakpoints else bend(compiled.laws[j], float(stiffness[j]))
    if not reach.all():
        whole = Static(np.zeros(compiled.m), springs, True, True)
        moved = np.abs(linear_response(compiled, Omega, whole)).sum(axis=1) + np.abs(_against(compiled, Omega))
        reach = np.where(reach == 0, moved, reach)
    return reach


def _against(compiled: Evaluator, Omega: float) -> Array:
    """Where the constant load puts the elements (m,), as if their laws were linear springs."""
    linear, joint, ties = compiled.linear(Omega), compiled.structure.joint, compiled.structure.ties
    b = joint @ linear.g[0].real + ties @ compiled.receptance.e[0].real
    closed = joint @ (linear.Z[0].real + np.diag(compiled.structure.kr)) + ties
    d: Array = np.linalg.lstsq(closed, -b, rcond=1e-12)[0]
    return d


def _pushed(compiled: Evaluator, Omega: float) -> Array:
    """Side, +1 or -1, to which the constant load pushes each element (m,)."""
    return np.where(_against(compiled, Omega) < 0, -1.0, 1.0)


def _static(laws: Any, d: Array) -> tuple[Array, Array]:
    """Mean over the phase of each law's force and stiffness at constant d (m,)."""
    tau, still = 2 * np.pi * np.arange(64) / 64, np.zeros(64)
    with np.errstate(all="ignore"):  # a law may have no value so far out
        out = [law.force(np.full(64, x), still, tau)[:2] for law, x in zip(laws, d, strict=True)]
    p, k = np.array(out).sum(axis=2).T / 64
    return p, k


_CORNER = 1e-9  # distance from a corner, over the reach of an element, within which a contact carries no force


def static_stiffness(compiled: Evaluator, Omega: float) -> Array | None:
    """Stiffness of each element in the static equilibrium at Omega (m,); None if none is found.

    Of several equilibria a stable one is taken, first that of rest, then on the side of the load.
    """
    for static in statics(compiled, Omega):
        if static.balanced:
            near = _CORNER * _reach(compiled, Omega)
            below, above = (_static(compiled.laws, static.d + side * near)[1] for side in (-1.0, 1.0))
            smaller: Array = np.where(np.abs(below) <= np.abs(above), below, above)
            return smaller
    return None
