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
from hbgear.harmonic.forces.packed_laws import MovingLevel, PackedSpring, Packing
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.mesh_contacts import contacts_of
from hbgear.mechanics.series.fourier import (
    derive,
    evaluate,
    samples_of,
    stretch,
    to_complex,
    to_real,
    value_and_derivative,
)
from hbgear.mechanics.series.periodic import Periodic, Phased, pieces_of
from hbgear.mechanics.series.piecewise_polynomial import ONE, TURN, PiecewisePolynomial, equal_parts
from hbgear.mechanics.structures.elements import Element


class PiecewiseExcitation(NamedTuple):
    """Piecewise polynomials over the basis period [0, 2 pi); all arrays are empty for a model without breakpoints.

    Attributes
    ----------
    phases : ndarray, shape (I,)
        Phases [rad] of the breakpoints of the excitation, ascending.
    gap_offsets : ndarray, shape (Q + 1,)
        Index of the first segment of w of each displacement j, and the number of all segments. There are no segments
        if e_j has no breakpoints and the level does not move.
    gap_starts, coefficients : ndarray, shapes (T,) and (T, 4)
        Beginning [rad] and coefficients of each segment of w.
    has_jump : ndarray, shape (T,)
        Whether w of a moving level jumps at the beginning of a segment.
    inactive : ndarray, shape (T,)
        Whether all springs on a moving level have zero stiffness on a segment.
    bounds : ndarray, shape (Q, 2)
        Lower and upper bound of w of a moving level, infinite for other displacements.
    retained : ndarray, shape (H + 1, Q)
        One-sided harmonics of e_j at the orders of the unknowns; zero without breakpoints.
    truncated : ndarray, shape (L, m)
        One-sided harmonics of e_j at the truncated orders up to 2H; zero without breakpoints.
    spring_offsets : ndarray, shape (S + 1,)
        Index of the first segment of the stiffness k of each spring, as in ``gap_offsets``. It has segments if k or w
        has breakpoints. If the spring has a Fourier series as well, its stiffness is the product of both.
    spring_starts, stiffness : ndarray, shapes (U,) and (U, 4)
        Beginning [rad] and coefficients of each segment of k.
    repeats : ndarray, shape (S,)
        Number of equal parts of the period on which k and k w of each spring are the same: the tooth number of a mesh
        whose wheel turns once in the period.
    integral_offsets : ndarray, shape (S + 1,)
        Index of the first row of ``integrals`` of each spring, as in ``gap_offsets``.
    integrals : ndarray, shape (V, 2, L)
        Integrals of k and k w times exp(-i n theta) over the first of the equal parts: from 0 to the beginning of each
        of its segments, and to its end.
    gap_force : ndarray, shape (U, 7)
        Coefficients of each segment of k w.
    gap_powers : ndarray, shape (m, 3, L)
        Two-sided coefficients of w, w^2 and w^3; empty unless an element with breakpoints has a cubic spring.
    grid : ndarray, shape (2, m, N)
        Samples of e_j up to harmonic H minus e_j, and of its derivative in theta; empty unless a law is sampled.
    """

    phases: Array
    gap_offsets: np.ndarray
    gap_starts: Array
    coefficients: Array
    has_jump: np.ndarray
    inactive: np.ndarray
    bounds: Array
    retained: ComplexArray
    truncated: ComplexArray
    spring_offsets: np.ndarray
    spring_starts: Array
    stiffness: Array
    repeats: np.ndarray
    integral_offsets: np.ndarray
    integrals: ComplexArray
    gap_force: Array
    gap_powers: ComplexArray
    grid: Array


class Resolution(NamedTuple):
    """Harmonics and samples of a balance.

    H, nu : harmonics and subharmonic order. samples : number N of samples of `PiecewiseExcitation.grid`, 0 if no law is
    sampled. orders, truncated : basis harmonics up to H that are unknowns, and the others up to 2H.
    """

    H: int
    nu: int
    samples: int
    orders: tuple[int, ...]
    truncated: tuple[int, ...]


def piecewise_excitation(elements: Sequence[Element], packing: Packing, resolution: Resolution) -> PiecewiseExcitation:
    """Return the piecewise polynomials of the elements of a model and of the springs of their laws."""
    phases = [x for element in elements for x in (*_phases(element.law), *element.displacement.corners)]
    if not phases and not packing.levels:
        return _without_breakpoints(len(elements), len(packing.springs), resolution.H, len(resolution.truncated))
    displacements = tuple(element.displacement for element in elements)
    laws = tuple(packing.springs), tuple(packing.levels), tuple(map(tuple, packing.table.cubic.tolist()))
    return _with_breakpoints(tuple(phases), displacements, *laws, resolution)


@lru_cache(maxsize=8)  # differences in a parameter such as the damping do not change the laws
def _with_breakpoints(
    phases: tuple[float, ...],
    e: tuple[Phased, ...],
    springs: tuple[PackedSpring, ...],
    levels: tuple[MovingLevel, ...],
    cubic: tuple[tuple[float, ...], ...],
    resolution: Resolution,
) -> PiecewiseExcitation:
    """Return `piecewise_excitation` of prescribed displacements, springs, levels and cubic coefficients (m, 2)."""
    m, (H, nu, N, *_) = len(e), resolution
    gaps = [_segments_of(function, nu).scaled(-1.0) if function.corners else None for function in e]
    retained, truncated = _harmonics_with_breakpoints(e, resolution)
    highest = max([0, *(spring.law.stiffness.order for spring in springs)]) * nu
    spring_tables = _spring_tables(springs, levels, e, nu, 3 * H + highest + 1)  # force harmonics up to 3H
    tables = [table for table in spring_tables if table]
    moments = [table.integrals for table in tables]
    level_tables = [
        _level_table(
            e[moving.element],
            moving.level,
            nu,
            [spring.law.stiffness for spring in springs if spring.displacement == m + i],
        )
        for i, moving in enumerate(levels)
    ]
    starts = [w.at for w in gaps if w] + [w.at for w, *_ in level_tables]
    fixed = np.zeros(sum(len(w.at) for w in gaps if w), dtype=bool)
    return PiecewiseExcitation(
        phases=np.unique((np.array(phases)[None, :] + TURN * np.arange(nu)[:, None]) / nu),
        gap_offsets=_first_indices([*(len(w.at) if w else 0 for w in gaps), *(len(w.at) for w, *_ in level_tables)]),
        gap_starts=np.concatenate([np.empty(0), *starts]),
        coefficients=_stack_padded([*(w.rows for w in gaps if w), *(w.rows for w, *_ in level_tables)], 4),
        has_jump=np.concatenate([fixed, *(has_jump for _, has_jump, _ in level_tables)]),
        inactive=np.concatenate([fixed, *(inactive for *_, inactive in level_tables)]),
        bounds=np.array(
            [*([-np.inf, np.inf] for _ in range(m)), *(_range(w, inactive) for w, _, inactive in level_tables)]
        ),
        retained=np.ascontiguousarray(retained[:, [*range(m), *(moving.element for moving in levels)]]),
        truncated=truncated,
        spring_offsets=_first_indices([len(table.k.at) if table else 0 for table in spring_tables]),
        spring_starts=np.concatenate([np.empty(0), *(table.k.at for table in tables)]),
        stiffness=_stack_padded([table.k.rows for table in tables], 4),
        repeats=np.array([table.repeats if table else 1 for table in spring_tables], dtype=np.int64),
        integral_offsets=_first_indices([len(table.integrals) if table else 0 for table in spring_tables]),
        integrals=np.concatenate(moments) if moments else np.zeros((0, 2, 0), dtype=complex),
        gap_force=_stack_padded([table.kw.rows for table in tables], 7),
        gap_powers=_powers(gaps, np.array(cubic), 4 * H + 1),
        grid=_grid(e, retained, nu, N),
    )


def _harmonics_with_breakpoints(e: Sequence[Phased], resolution: Resolution) -> tuple[ComplexArray, ComplexArray]:
    """Return `PiecewiseExcitation.retained` and `truncated` of the prescribed displacements."""
    H, nu = resolution.H, resolution.nu
    orders, truncated_orders = (np.array(k, dtype=int) for k in (resolution.orders, resolution.truncated))
    retained = np.zeros((H + 1, len(e)), dtype=complex)
    truncated = np.zeros((len(truncated_orders), len(e)), dtype=complex)
    for j in (j for j, function in enumerate(e) if function.corners):
        c = np.zeros(2 * H + 1, dtype=complex)
        harmonics = to_complex(stretch(e[j].row(2 * H // nu), nu))
        c[: len(harmonics)] = harmonics
        retained[orders, j], truncated[:, j] = c[orders], c[truncated_orders]
    return retained, truncated


def _spring_tables(
    springs: Sequence[PackedSpring], levels: Sequence[MovingLevel], e: Sequence[Phased], nu: int, length: int
) -> list[_SpringTable | None]:
    """Return `_spring_table` of each spring; None for a spring without breakpoints in the phase."""
    m = len(e)
    level_of = [None] * m + [moving.level for moving in levels]
    return [
        _spring_table(
            spring.law.stiffness, e[spring.element], cast(Phased | None, level_of[spring.displacement]), nu, length
        )
        if spring.law.stiffness.corners or e[spring.element].corners or spring.displacement >= m
        else None
        for spring in springs
    ]


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
    return [x % TURN for x, is_abrupt in zip(stiffness.phases, abrupt.tolist(), strict=True) if is_abrupt]


_MAX_SLOPE_JUMP = 1e-2
"""Jump of the slope of a contact stiffness, relative to its largest value [1/rad], up to which the integration of the
variational equation does not begin a new segment: the multipliers of tables with 160 values change by less than 1e-5.
"""


def _level_table(
    displacement: Phased, level: Phased | PiecewisePolynomial, nu: int, stiffness: Sequence[Phased]
) -> tuple[PiecewisePolynomial, np.ndarray, np.ndarray]:
    """Return w of a moving level, with `PiecewiseExcitation.has_jump` and `inactive` of its segments."""
    w = (level.repeated(nu) if isinstance(level, PiecewisePolynomial) else pieces_of(level, nu)).scaled(-1.0)
    if displacement.corners:
        w = w.plus(_segments_of(displacement, nu).scaled(-1.0))
    k = [_segments_of(function, nu) for function in stiffness]
    for segments in k:
        acts = np.any(segments.rows != 0.0, axis=1)
        w = w.on(segments.at[acts != np.roll(acts, 1)])
    ends = np.array([np.polynomial.polynomial.polyval(x, row) for x, row in zip(w.widths, w.rows, strict=True)])
    jumps = np.abs(w.rows[:, 0] - np.roll(ends, 1))
    has_jump: np.ndarray = jumps > _JUMP_ROUNDING * max(1e-300, np.abs(w.rows[:, 0]).max())
    acts_on_segment = [np.any(segments.rows_at(w.at) != 0.0, axis=1) for segments in k]
    return w, has_jump, ~np.any(acts_on_segment, axis=0) if acts_on_segment else np.zeros(len(w.at), dtype=bool)


def _range(w: PiecewisePolynomial, inactive: np.ndarray) -> tuple[float, float]:
    """Return a lower and an upper bound of w on the segments that are not idle."""
    used = np.flatnonzero(~inactive)
    rows, widths = w.rows[used], w.widths[used]
    higher = sum((np.abs(rows[:, q]) * widths**q for q in range(2, rows.shape[1])), np.zeros(len(used)))
    ends = rows[:, 0] + (rows[:, 1] * widths if rows.shape[1] > 1 else 0.0)
    return float((np.minimum(rows[:, 0], ends) - higher).min()), float((np.maximum(rows[:, 0], ends) + higher).max())


_JUMP_ROUNDING = 1e-10
"""Jump of a level or stiffness, relative to its largest value [-], that is attributed to rounding."""


@lru_cache(maxsize=64)
def _without_breakpoints(m: int, S: int, H: int, truncated_count: int) -> PiecewiseExcitation:
    """Return the empty arrays of m elements and S springs without breakpoints."""
    empty, integrals = np.empty(0), np.zeros((0, 2, 0), dtype=complex)
    return PiecewiseExcitation(
        empty,
        _first_indices([0] * m),
        empty,
        np.empty((0, 4)),
        np.empty(0, dtype=bool),
        np.empty(0, dtype=bool),
        np.tile([-np.inf, np.inf], (m, 1)),
        np.zeros((H + 1, m), dtype=complex),
        np.zeros((truncated_count, m), dtype=complex),
        _first_indices([0] * S),
        empty,
        np.empty((0, 4)),
        np.ones(S, dtype=np.int64),
        _first_indices([0] * S),
        integrals,
        np.empty((0, 7)),
        np.zeros((m, 3, 0), dtype=complex),
        np.zeros((2, m, 0)),
    )


def known_gap(displacement: Phased, retained: ComplexArray, nu: int, theta: Array, order: int = 0) -> Array:
    """Return the known part of the gap of an element at basis phases, or a derivative in theta.

    It is the prescribed displacement e up to harmonic H, with one-sided harmonics ``retained`` (H + 1,), minus e.
    """
    low_part = evaluate(to_real(retained), theta, order)
    return low_part - nu**order * displacement(nu * theta, order)


def gap(displacement: Phased, retained: ComplexArray, nu: int, row: Array, theta: Array, order: int = 0) -> Array:
    """Return the gap of an element whose motion is a row, or a derivative in theta; ``retained`` as in `known_gap`."""
    return evaluate(row, theta, order) + (
        known_gap(displacement, retained, nu, theta, order) if displacement.corners else 0.0
    )


def gap_and_derivative(
    displacement: Phased, retained: ComplexArray, nu: int, row: Array, theta: Array
) -> tuple[Array, Array]:
    """Return `gap` and its derivative in theta."""
    d, rate = value_and_derivative(row, theta)
    if displacement.corners:
        d, rate = (x + known_gap(displacement, retained, nu, theta, order) for order, x in enumerate((d, rate)))
    return d, rate


def gap_samples(displacement: Phased, retained: ComplexArray, nu: int, row: Array, N: int, order: int = 0) -> Array:
    """Return `gap` at N equal steps of the period, (N,)."""
    out = samples_of(derive(to_complex(row), order), N)
    if displacement.corners:
        theta = TURN * np.arange(N) / N
        out += samples_of(derive(retained, order), N) - nu**order * displacement(nu * theta, order)
    return out


def _grid(e: Sequence[Phased], retained: ComplexArray, nu: int, N: int) -> Array:
    """Return `PiecewiseExcitation.grid`."""
    with_breakpoints = [j for j, function in enumerate(e) if function.corners]
    out = np.zeros((2, len(e), N if with_breakpoints else 0))
    theta = TURN * np.arange(out.shape[2]) / max(N, 1)
    for j in with_breakpoints:
        out[0, j], out[1, j] = (known_gap(e[j], retained[:, j], nu, theta, order) for order in (0, 1))
    return out


def _powers(gaps: Sequence[PiecewisePolynomial | None], cubic: Array, length: int) -> ComplexArray:
    """Return `PiecewiseExcitation.gap_powers`."""
    with_cubic = [j for j, w in enumerate(gaps) if w and cubic[j].any()]
    out = np.zeros((len(gaps), 3, length if with_cubic else 0), dtype=complex)
    for j in with_cubic:
        w = gaps[j]
        assert w is not None
        square = w.times(w)
        for row, power in zip(out[j], (w, square, square.times(w)), strict=True):
            row[:] = power.integrals(length)[-1] / TURN
    return out


def _segments_of(function: Phased, nu: int) -> PiecewisePolynomial:
    """Return a function as a piecewise polynomial over the basis period; the constant 1 for a Fourier series."""
    return function.pieces(nu) if isinstance(function, Periodic) else ONE


class _SpringTable(NamedTuple):
    """Stiffness k and product k w of a spring on common segments, see `PiecewiseExcitation`."""

    k: PiecewisePolynomial
    kw: PiecewisePolynomial
    repeats: int
    integrals: ComplexArray


@lru_cache(maxsize=128)
def _spring_table(stiffness: Phased, displacement: Phased, level: Phased | None, nu: int, length: int) -> _SpringTable:
    """Return the table of a spring with integrals up to order ``length`` - 1; w is 0 without breakpoints."""
    k = _segments_of(stiffness, nu)
    w = _segments_of(displacement, nu).scaled(-1.0 if displacement.corners else 0.0)
    if level is not None:
        w = w.plus(pieces_of(level, nu).scaled(-1.0))
    kw = k.times(w)
    (k, kw), repeats = equal_parts([PiecewisePolynomial(kw.at, k.rows_at(kw.at)), kw])
    if level is None:
        return _SpringTable(k, kw, repeats, np.stack([f.integrals(length, repeats) for f in (k, kw)], axis=1))
    from hbgear.harmonic.forces.piecewise_kernels import integrals

    segments = len(k.at) // repeats
    moments = np.zeros((segments + 1, 2, length), dtype=complex)
    for i, function in enumerate((k, kw)):
        integrals(function.at[:segments], function.rows[:segments], TURN / repeats, moments[:, i])
    return _SpringTable(k, kw, repeats, moments)


def _first_indices(count: Sequence[int]) -> np.ndarray:
    """Return the index of the first segment of each function, and the number of all segments."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def _stack_padded(rows: Sequence[Array], width: int) -> Array:
    """Return the coefficients of all segments, padded by zeros to the same number."""
    padded = [np.pad(coefficients, ((0, 0), (0, width - coefficients.shape[1]))) for coefficients in rows]
    return np.concatenate([np.empty((0, width)), *padded])
