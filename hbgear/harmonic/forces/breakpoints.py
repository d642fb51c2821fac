"""Stiffness and prescribed displacements with breakpoints in the phase, as arrays of piecewise polynomials.

    gap_j = d_j + (e_j up to harmonic H) - e_j        d_j: the unknowns; e_j: the prescribed displacement

If e_j has breakpoints, only the motion of the structure is truncated at H; e_j keeps all of its harmonics. With w =
-e_j the force of a spring is k (g0 + s0 (t + w) + sum_i D_i max(t + w - x_i, 0)), where t is a trigonometric
polynomial. The projection therefore requires integrals of k and k w over parts of the period only. A displacement
relative to a moving level has w = -e_j - level.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.packed_laws import Packing
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.mesh_contacts import contacts_of
from hbgear.mechanics.models import Element
from hbgear.mechanics.series.fourier import derive, evaluate, samples_of, stretch, to_complex, to_real
from hbgear.mechanics.series.periodic import Periodic, Phased, pieces_of
from hbgear.mechanics.series.piecewise_polynomial import ONE, TURN, Pieced


class PiecewiseExcitation(NamedTuple):
    """Piecewise polynomials over the basis period [0, 2 pi); all arrays are empty for a model without breakpoints.

    Attributes
    ----------
    phases : ndarray, shape (I,)
        Phases [rad] of the breakpoints of the excitation, ascending.
    moves : ndarray, shape (Q + 1,)
        Index of the first segment of w of each displacement j, and the number of all segments. There are no segments
        if e_j has no breakpoints and the level does not move.
    at, coefficients : ndarray, shapes (T,) and (T, 4)
        Beginning [rad] and coefficients of each segment of w.
    broken : ndarray, shape (T,)
        Whether w of a moving level jumps at the beginning of a segment.
    idle : ndarray, shape (T,)
        Whether all springs on a moving level have zero stiffness on a segment.
    bounds : ndarray, shape (Q, 2)
        Lower and upper bound of w of a moving level, infinite for other displacements.
    kept : ndarray, shape (H + 1, Q)
        One-sided harmonics of e_j at the orders of the unknowns; zero without breakpoints.
    beyond : ndarray, shape (L, m)
        One-sided harmonics of e_j at the truncated orders up to 2H; zero without breakpoints.
    parts : ndarray, shape (S + 1,)
        Index of the first segment of the stiffness k of each spring, as in ``moves``. It has segments if k or w has
        breakpoints. If the spring has a Fourier series as well, its stiffness is the product of both.
    begin, weight : ndarray, shapes (U,) and (U, 4)
        Beginning [rad] and coefficients of each segment of k.
    sums : ndarray, shape (U + S, 2, L)
        Integrals of k and k w times exp(-i n theta), from 0 to the beginning of each segment, and over the period.
    pulled : ndarray, shape (U, 7)
        Coefficients of each segment of k w.
    powers : ndarray, shape (m, 3, L)
        Two-sided coefficients of w, w^2 and w^3; empty unless an element with breakpoints has a cubic spring.
    grid : ndarray, shape (2, m, N)
        Samples of e_j up to harmonic H minus e_j, and of its derivative in theta; empty unless a law is sampled.
    """

    phases: Array
    moves: np.ndarray
    at: Array
    coefficients: Array
    broken: np.ndarray
    idle: np.ndarray
    bounds: Array
    kept: ComplexArray
    beyond: ComplexArray
    parts: np.ndarray
    begin: Array
    weight: Array
    sums: ComplexArray
    pulled: Array
    powers: ComplexArray
    grid: Array


def piecewise_excitation(
    elements: Sequence[Element], packing: Packing, H: int, nu: int, N: int, orders: np.ndarray, left: np.ndarray
) -> PiecewiseExcitation:
    """Return the piecewise polynomials of the elements of a model and of the springs of their laws.

    Parameters
    ----------
    elements : sequence of Element
        Elements of the model.
    packing : Packing
        Table of their laws.
    H : int
        Harmonic truncation order.
    nu : int
        Subharmonic order.
    N : int
        Number of samples of `PiecewiseExcitation.grid`; 0 if no law is sampled.
    orders : ndarray
        Basis harmonics up to H that are unknowns.
    left : ndarray
        Truncated basis harmonics up to 2H.

    Returns
    -------
    Corners
        Piecewise polynomials; empty for a model without breakpoints.
    """
    springs, levels, cubic = packing.springs, packing.levels, packing.table.cubic
    m, S = len(elements), len(springs)
    phases = [x for element in elements for x in (*_phases(element.law), *element.displacement.corners)]
    if not phases and not levels:
        return _without_breakpoints(m, S, H, len(left))
    e = [element.displacement for element in elements]
    moved = [_segments_of(one, nu).scaled(-1.0) if one.corners else None for one in e]
    with_breakpoints = [j for j in range(m) if e[j].corners]
    kept, beyond = np.zeros((H + 1, m), dtype=complex), np.zeros((len(left), m), dtype=complex)
    for j in with_breakpoints:
        c = np.zeros(2 * H + 1, dtype=complex)
        known = to_complex(stretch(e[j].row(2 * H // nu), nu))
        c[: len(known)] = known
        kept[orders, j], beyond[:, j] = c[orders], c[left]
    highest = max([0, *(one.spring.stiffness.order for one in springs)]) * nu
    length = 8 * H + highest + 1
    level_of = [None] * m + [one.level for one in levels]
    made = [
        _stiffness_segments(
            one.spring.stiffness, e[one.element], cast(Phased | None, level_of[one.displacement]), nu, length
        )
        if one.spring.stiffness.corners or e[one.element].corners or one.displacement >= m else None
        for one in springs
    ]  # fmt: skip
    count = [len(one[0].at) if one else 0 for one in made]
    sums = [one[2] for one in made if one]
    tables = [
        _level_table(
            e[one.element],
            one.level,
            nu,
            [spring.spring.stiffness for spring in springs if spring.displacement == m + i],
        )
        for i, one in enumerate(levels)
    ]
    pieces = [one.at for one in moved if one] + [one.at for one, *_ in tables]
    fixed = np.zeros(sum(len(one.at) for one in moved if one), dtype=bool)
    return PiecewiseExcitation(
        phases=np.unique((np.array(phases)[None, :] + TURN * np.arange(nu)[:, None]) / nu),
        moves=_first_indices([*(len(one.at) if one else 0 for one in moved), *(len(one.at) for one, *_ in tables)]),
        at=np.concatenate([np.empty(0), *pieces]),
        coefficients=_stack_padded([*(one.rows for one in moved if one), *(one.rows for one, *_ in tables)], 4),
        broken=np.concatenate([fixed, *(broken for _, broken, _ in tables)]),
        idle=np.concatenate([fixed, *(idle for *_, idle in tables)]),
        bounds=np.array([*([-np.inf, np.inf] for _ in range(m)), *(_range(w, idle) for w, _, idle in tables)]),
        kept=np.ascontiguousarray(kept[:, [*range(m), *(one.element for one in levels)]]),
        beyond=beyond,
        parts=_first_indices(count),
        begin=np.concatenate([np.empty(0), *(one[0].at for one in made if one)]),
        weight=_stack_padded([one[0].rows for one in made if one], 4),
        sums=_concatenate_integrals(sums, count, S, length),
        pulled=_stack_padded([one[1].rows for one in made if one], 7),
        powers=_powers(moved, cubic, length),
        grid=_grid(e, kept, nu, N),
    )


def _phases(law: Law) -> Iterable[float]:
    """Return the phases at which dp/dd of a law jumps although no breakpoint is crossed; levels cause no such jump."""
    contacts = contacts_of(law)
    return {x for contact in contacts for x in _abrupt_changes(contact.stiffness)} if contacts else law.phases


def _abrupt_changes(stiffness: Phased) -> list[float]:
    """Return the phases at which a contact stiffness jumps, or its slope by more than `_MAX_SLOPE_JUMP`."""
    if not isinstance(stiffness, Periodic):
        return []
    jumps = np.abs(stiffness.jumps) / stiffness.bound
    abrupt = jumps[:, 0] > _JUMP_ROUNDING
    if jumps.shape[1] > 1:
        abrupt |= jumps[:, 1] > _MAX_SLOPE_JUMP
    return [x % TURN for x, found in zip(stiffness.phases, abrupt.tolist(), strict=True) if found]


_MAX_SLOPE_JUMP = 1e-2
"""Jump of the slope of a contact stiffness, relative to its largest value [1/rad], up to which the integration of the
variational equation does not begin a new segment: the multipliers of tables with 160 values change by less than 1e-5.
"""


def _level_table(
    displacement: Phased, level: Phased | Pieced, nu: int, stiffness: Sequence[Phased]
) -> tuple[Pieced, np.ndarray, np.ndarray]:
    """Return w of a moving level, and `PiecewiseExcitation.broken` and `PiecewiseExcitation.idle` of its segments."""
    w = (level.repeated(nu) if isinstance(level, Pieced) else pieces_of(level, nu)).scaled(-1.0)
    if displacement.corners:
        w = w.plus(_segments_of(displacement, nu).scaled(-1.0))
    k = [_segments_of(one, nu) for one in stiffness]
    for one in k:
        acts = np.any(one.rows != 0.0, axis=1)
        w = w.on(one.at[acts != np.roll(acts, 1)])
    ends = np.array([np.polynomial.polynomial.polyval(x, row) for x, row in zip(w.widths, w.rows, strict=True)])
    jump = np.abs(w.rows[:, 0] - np.roll(ends, 1))
    broken: np.ndarray = jump > _JUMP_ROUNDING * max(1e-300, np.abs(w.rows[:, 0]).max())
    acting = [np.any(one.rows_at(w.at) != 0.0, axis=1) for one in k]
    return w, broken, ~np.any(acting, axis=0) if acting else np.zeros(len(w.at), dtype=bool)


def _range(w: Pieced, idle: np.ndarray) -> tuple[float, float]:
    """Return a lower and an upper bound of w on the segments that are not idle."""
    used = np.flatnonzero(~idle)
    rows, widths = w.rows[used], w.widths[used]
    higher = sum((np.abs(rows[:, q]) * widths**q for q in range(2, rows.shape[1])), np.zeros(len(used)))
    ends = rows[:, 0] + (rows[:, 1] * widths if rows.shape[1] > 1 else 0.0)
    return float((np.minimum(rows[:, 0], ends) - higher).min()), float((np.maximum(rows[:, 0], ends) + higher).max())


_JUMP_ROUNDING = 1e-10
"""Jump of a level or stiffness, relative to its largest value [-], that is attributed to rounding."""


@lru_cache(maxsize=64)
def _without_breakpoints(m: int, S: int, H: int, left: int) -> PiecewiseExcitation:
    """Return the empty arrays of m elements and S springs without breakpoints."""
    none, pairs = np.empty(0), np.zeros((0, 2, 0), dtype=complex)
    return PiecewiseExcitation(
        none, _first_indices([0] * m), none, np.empty((0, 4)), np.empty(0, dtype=bool), np.empty(0, dtype=bool),
        np.tile([-np.inf, np.inf], (m, 1)), np.zeros((H + 1, m), dtype=complex),
        np.zeros((left, m), dtype=complex), _first_indices([0] * S), none, np.empty((0, 4)), pairs, np.empty((0, 7)),
        np.zeros((m, 3, 0), dtype=complex), np.zeros((2, m, 0)),
    )  # fmt: skip


def beyond(displacement: Phased, kept: ComplexArray, nu: int, theta: Array, order: int = 0) -> Array:
    """Return the known part of the gap of an element, e up to harmonic H minus e, or a derivative in theta.

    Parameters
    ----------
    displacement : Phased
        Prescribed displacement e.
    kept : ndarray, shape (H + 1,)
        One-sided harmonics of e.
    nu : int
        Subharmonic order.
    theta : ndarray
        Phases of the basis period [rad].
    order : int, optional
        Order of the derivative. The default is 0.

    Returns
    -------
    ndarray
        Value at each phase.
    """
    kept_part = evaluate(to_real(kept), theta, order)
    out: Array = kept_part - nu**order * displacement(nu * theta, order)
    return out


def gap(displacement: Phased, kept: ComplexArray, nu: int, row: Array, theta: Array, order: int = 0) -> Array:
    """Return the gap of an element whose motion is a row, or a derivative in theta; ``kept`` as in `beyond`."""
    return evaluate(row, theta, order) + (beyond(displacement, kept, nu, theta, order) if displacement.corners else 0.0)


def gap_samples(displacement: Phased, kept: ComplexArray, nu: int, row: Array, N: int, order: int = 0) -> Array:
    """Return `gap` at N equal steps of the period, (N,)."""
    out = samples_of(derive(to_complex(row), order), N)
    if displacement.corners:
        theta = TURN * np.arange(N) / N
        out += samples_of(derive(kept, order), N) - nu**order * displacement(nu * theta, order)
    return out


def _grid(e: Sequence[Phased], kept: ComplexArray, nu: int, N: int) -> Array:
    """Return `PiecewiseExcitation.grid`."""
    some = [j for j, one in enumerate(e) if one.corners]
    out = np.zeros((2, len(e), N if some else 0))
    theta = TURN * np.arange(out.shape[2]) / max(N, 1)
    for j in some:
        out[0, j], out[1, j] = (beyond(e[j], kept[:, j], nu, theta, order) for order in (0, 1))
    return out


def _powers(moved: Sequence[Pieced | None], cubic: Array, length: int) -> ComplexArray:
    """Return `PiecewiseExcitation.powers`."""
    some = [j for j, one in enumerate(moved) if one and cubic[j].any()]
    out = np.zeros((len(moved), 3, length if some else 0), dtype=complex)
    for j in some:
        w = moved[j]
        assert w is not None
        square = w.times(w)
        for own, one in zip(out[j], (w, square, square.times(w)), strict=True):
            own[:] = one.integrals(length)[-1] / TURN
    return out


def _segments_of(function: Phased, nu: int) -> Pieced:
    """Return a function as a piecewise polynomial over the basis period; the constant 1 for a Fourier series."""
    return function.pieces(nu) if isinstance(function, Periodic) else ONE


@lru_cache(maxsize=128)
def _stiffness_segments(
    stiffness: Phased, displacement: Phased, level: Phased | None, nu: int, length: int
) -> tuple[Pieced, Pieced, ComplexArray]:
    """Return k and k w on common segments, and their integrals (T + 1, 2, length); w is 0 without breakpoints."""
    k = _segments_of(stiffness, nu)
    w = _segments_of(displacement, nu).scaled(-1.0 if displacement.corners else 0.0)
    if level is not None:
        w = w.plus(pieces_of(level, nu).scaled(-1.0))
    pulled = k.times(w)
    if level is None:
        k = k.on(pulled.at)
        return k, pulled, np.stack([k.integrals(length), pulled.integrals(length)], axis=1)
    from hbgear.harmonic.forces.piecewise_kernels import integrals

    k = Pieced(pulled.at, k.rows_at(pulled.at))
    sums = np.zeros((len(k.at) + 1, 2, length), dtype=complex)
    for i, one in enumerate((k, pulled)):
        integrals(one.at, one.rows, sums[:, i])
    return k, pulled, sums


def _first_indices(count: Sequence[int]) -> np.ndarray:
    """Return the index of the first segment of each function, and the number of all segments."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def _stack_padded(rows: Sequence[Array], width: int) -> Array:
    """Return the coefficients of all segments, padded by zeros to the same number."""
    each = [np.pad(one, ((0, 0), (0, width - one.shape[1]))) for one in rows]
    return np.concatenate([np.empty((0, width)), *each])


def _concatenate_integrals(sums: Sequence[ComplexArray], count: Sequence[int], S: int, length: int) -> ComplexArray:
    """Return the integrals of all springs in one array, with one row of zeros for each spring without segments."""
    out = np.zeros((sum(count) + S if sums else 0, 2, length if sums else 0), dtype=complex)
    rows, at = iter(sums), 0
    for n in count if sums else ():
        if n:
            out[at : at + n + 1] = next(rows)
        at += n + 1
    return out
