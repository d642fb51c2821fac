"""Thresholds of periodic motions: grazing contacts, first slips of friction, and edges of vector laws.

    clearance    min d - breakpoint, max d - breakpoint         of different signs if the motion crosses the breakpoint
    inner        d - breakpoint at the nearest other extremum   with the sign of the product over all other extrema
    slip         max (d - limit / k) - min (d + limit / k)      positive if the slider slips
    edge         min edge(d), max edge(d)                       of different signs if the motion crosses the edge

`THRESHOLDS` lists these kinds. The distance from the nearest threshold limits the steps of differences of dR/dX.

At its extremum a function of the phase has no slope, so the derivative of an extremum in the coefficients of the motion
is that of the function at a fixed phase. Where the normal force of a slider opens or closes, the extremum may lie at
this instant, which moves with the motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.forces.aft import roots_of
from hbgear.harmonic.forces.breakpoints import gap_samples
from hbgear.harmonic.forces.damped_contacts import depth_and_force
from hbgear.mechanics.laws.mesh_contacts import ToothContact, contacts_of
from hbgear.mechanics.laws.vector_laws import VectorLaw
from hbgear.mechanics.series.fourier import derive, evaluate, to_real, waves

EDGE_SAMPLES = 32
"""Samples for each harmonic [-] among which the extremum of an edge is searched, and of each refinement."""

EDGE_REFINEMENTS = 4
"""Refinements of an extremum [-]: each divides the distance of the samples by 16; the error is 1e-13."""

EDGE_SLOPE_STEP = 1e-6
"""Step of the central difference for the derivative of an edge, relative to the largest displacement [-]."""

LEVEL_TOLERANCE = 1e-9
"""Distance from a level, relative to the largest coefficient, at which an extremum lies at the instant it is passed."""


PHASE_STEP = 1e-9
"""Distance from a breakpoint [rad] at which the stiffness on both of its sides is evaluated."""


# ---- breakpoints


def clearances(evaluator: Evaluator, X: Array) -> Array:
    """Return the distances (P, 2 K) of the extrema of the elements from the K breakpoints in motions X (P, n)."""
    return evaluator.extrema_and_regime(X)[0]


def grazing_distance(evaluator: Evaluator, X: Array, index: int) -> tuple[float, float]:
    """Return entry ``index`` of `clearances` of a motion X (n,), and the basis phase of its extremum."""
    breakpoint_, sign = index // 2, 1 if index % 2 else -1
    row = evaluator.spread(X).reshape(evaluator.m, -1)[evaluator.element[breakpoint_]]
    value, theta = evaluator.highest(int(evaluator.displacement[breakpoint_]), row, float(sign))
    return float(sign * value - evaluator.breakpoints[breakpoint_]), theta


def grazing_threshold(evaluator: Evaluator, X: Array, index: int) -> tuple[float, Array]:
    """Return entry ``index`` of `clearances` of a motion X (n,) and its derivative, rows (m, 2K - 1)."""
    g, theta = grazing_distance(evaluator, X, index)
    derivative = np.zeros((evaluator.m, 2 * len(evaluator.orders) - 1))
    derivative[evaluator.element[index // 2]] = basis_values(theta, evaluator.orders)
    return g, derivative


def clearance_names(evaluator: Evaluator) -> tuple[str, ...]:
    """Return the meaning of each entry of `clearances` in words."""
    return tuple(
        f"{end} of {e.name} at {x:g}"
        for e in evaluator.system.elements
        for x in e.law.breakpoints
        for end in ("lowest", "highest")
    )


# ---- breakpoints and inner extrema


def inner_samples(evaluator: Evaluator, X: Array, clearance: Array) -> Array | None:
    """Return `inner_distances` of motions X (P, n) from parabolas through samples, for their signs; None without any.

    A breakpoint beyond the outer extrema, whose distances are ``clearance`` (P, 2 K), needs no samples: the number of
    other extrema is even.
    """
    numbers = evaluator.smooth_breakpoints
    if not numbers:
        return None
    low, high = clearance[:, ::2][:, numbers], clearance[:, 1::2][:, numbers]
    rows, out = evaluator.spread(X).reshape(len(X), evaluator.m, -1), high - low
    for i, number in enumerate(numbers):
        crossed = np.flatnonzero(low[:, i] * high[:, i] < 0)
        if not crossed.size:
            continue
        d = rows[crossed, evaluator.element[number]] @ evaluator.packed.basis
        before, after = np.roll(d, 1, axis=1), np.roll(d, -1, axis=1)
        turns = (d - before) * (after - d) < 0
        for outer in (d.argmax(axis=1), d.argmin(axis=1)):
            turns[np.arange(len(d)), outer] = False
        motion, sample = np.nonzero(turns)
        first, middle, last = (values[motion, sample] for values in (before, d, after))
        extrema = middle - (last - first) ** 2 / (8 * (first - 2 * middle + last))
        distance = np.full(d.shape, np.inf)
        distance[motion, sample] = extrema - evaluator.breakpoints[number]
        nearest = np.minimum(np.abs(distance).min(axis=1), out[crossed, i])
        out[crossed, i] = nearest * np.sign(distance).prod(axis=1)
    return out


def inner_distances(evaluator: Evaluator, X: Array) -> Array:
    """Return the distances (P, K) of local extrema from breakpoints in motions X (P, n).

    The highest and the lowest extremum, whose distances are `clearances`, are left out. Of the others the one nearest
    to a breakpoint is taken, with the sign of the product of all distances. It changes where one of them passes the
    breakpoint, not where two of them appear or exchange their order. Without others it is the range of the motion.
    """
    count = len(evaluator.smooth_breakpoints)
    return np.array([[_inner_extremum(evaluator, x, i)[0] for i in range(count)] for x in X]).reshape(len(X), count)


def inner_threshold(evaluator: Evaluator, X: Array, index: int) -> tuple[float, Array]:
    """Return the distance of the extremum of entry ``index`` of `inner_distances`, and its derivative."""
    _, g, theta = _inner_extremum(evaluator, X, index)
    derivative = np.zeros((evaluator.m, 2 * len(evaluator.orders) - 1))
    derivative[evaluator.element[evaluator.smooth_breakpoints[index]]] = basis_values(theta, evaluator.orders)
    return g, derivative


def inner_names(evaluator: Evaluator) -> tuple[str, ...]:
    """Return the meaning of each entry of `inner_distances` in words."""
    names = [name.removeprefix("lowest") for name in clearance_names(evaluator)[::2]]
    return tuple(f"inner extremum{names[number]}" for number in evaluator.smooth_breakpoints)


def _inner_extremum(evaluator: Evaluator, X: Array, index: int) -> tuple[float, float, float]:
    """Return entry ``index`` of `inner_distances` of a motion X (n,), distance and phase of its extremum."""
    number = evaluator.smooth_breakpoints[index]
    j = int(evaluator.element[number])
    row = evaluator.spread(X).reshape(evaluator.m, -1)[j]
    theta = _extrema(_slope_samples(evaluator, j, row), partial(evaluator.gap, j, row))
    d = evaluator.gap(j, row, theta)
    inner = np.delete(np.arange(len(d)), [np.argmax(d), np.argmin(d)] if len(d) else [])
    if not inner.size:
        size = float(np.ptp(d)) if len(d) else 0.0
        return size, size, 0.0
    distances = d[inner] - evaluator.breakpoints[number]
    nearest = int(np.argmin(np.abs(distances)))
    g = float(distances[nearest])
    return abs(g) * float(np.sign(distances).prod()), g, float(theta[inner[nearest]])


# ---- friction sliders


def slip_margins(evaluator: Evaluator, X: Array) -> Array:
    """Return the ranges (P, Q) of the displacements of motions X (P, n) minus those in which sliders stick."""
    out = np.empty((len(X), evaluator.sliders))
    if evaluator.sliders:
        from hbgear.harmonic.forces.slider_kernels import slider_states

        slider_states(evaluator.packed, evaluator.spread(X), evaluator.m, out)
    return out


def slip_threshold(evaluator: Evaluator, X: Array, index: int) -> tuple[float, Array]:
    """Return entry ``index`` of `slip_margins` of a motion X (n,) and its derivative, rows (m, 2K - 1)."""
    from hbgear.harmonic.forces.slider_kernels import slider_motion

    rows = evaluator.spread(X).reshape(evaluator.m, -1)
    motion = slider_motion(evaluator.packed, rows)
    derivative = np.zeros((evaluator.m, 2 * len(evaluator.orders) - 1))
    for side, theta in zip((1.0, -1.0), motion.extreme[index], strict=True):
        if np.isfinite(theta):  # otherwise nothing moves
            _add_bound(derivative, evaluator, rows, index, side, float(theta))
    return float(motion.span[index]), derivative


def _add_bound(derivative: Array, evaluator: Evaluator, rows: Array, index: int, side: float, theta: float) -> None:
    """Add the derivative of side d - limit / k at a phase, the highest lower or the lowest upper bound of a slider."""
    sliders, basis = evaluator.packed.sliders, basis_values(theta, evaluator.orders)
    assert sliders is not None
    j, n = int(sliders.element[index]), int(sliders.normal[index])
    derivative[j] += side * basis
    if n < 0:
        return
    slope, slope_n = (float(evaluate(rows[i], theta, 1)[0]) for i in (j, n))
    d_n, level = float(evaluate(rows[n], theta)[0]), sliders.level[index]
    gain = sliders.gain[index, int(np.searchsorted(level, d_n))] / sliders.k[index]
    derivative[n] -= gain * basis
    if np.abs(level - d_n).min() <= LEVEL_TOLERANCE * float(np.abs(rows[n]).max()):
        derivative[n] -= (side * slope - gain * slope_n) / slope_n * basis


def slider_names(evaluator: Evaluator) -> tuple[str, ...]:
    """Return the names of the friction sliders: those of their elements, numbered if an element has several."""
    elements = [(e.name, len(e.law.sliders)) for e in evaluator.system.elements]
    return tuple(f"{name}[{i}]" if count > 1 else name for name, count in elements for i in range(count))


def basis_values(theta: float, orders: np.ndarray) -> Array:
    """Return the values (2K - 1,) of the real basis at a phase."""
    wave = waves(theta, int(orders[-1]))[0, orders]
    out = np.ones(2 * len(orders) - 1)
    out[1::2], out[2::2] = wave.real[1:], wave.imag[1:]
    return out


# ---- edges of vector laws


def edged_laws(evaluator: Evaluator) -> list[tuple[np.ndarray, VectorLaw, int]]:
    """Return the elements of each vector law whose edges are events of a curve, the law and the number of edges."""
    laws = [(rows, law, len(law.edges(np.zeros((law.size, 1))))) for rows, law in evaluator.vectors if law.grazes]
    return [entry for entry in laws if entry[2]]


def _extremes(evaluator: Evaluator) -> list[tuple[np.ndarray, VectorLaw, int, float]]:
    """Return elements, law, edge and sign (-1 lowest, +1 highest) of each entry of `edge_extremes`."""
    laws = edged_laws(evaluator)
    return [(rows, law, edge, sign) for rows, law, count in laws for edge in range(count) for sign in (-1.0, 1.0)]


def edge_extremes(evaluator: Evaluator, X: Array) -> Array:
    """Return the lowest and highest values (P, 2 E) of the edges of vector laws (`VectorLaw.edges`) in each motion."""
    entries = _extremes(evaluator)
    out = np.empty((len(X), len(entries)))
    for values, x in zip(out, evaluator.spread(X) if entries else X, strict=True):
        rows = x.reshape(evaluator.m, -1)
        values[:] = [sign * _highest_edge(law, rows[elements], edge, sign)[0] for elements, law, edge, sign in entries]
    return out


def edge_threshold(evaluator: Evaluator, X: Array, index: int) -> tuple[float, Array]:
    """Return entry ``index`` of `edge_extremes` of a motion X (n,) and its derivative, rows (m, 2K - 1)."""
    elements, law, edge, sign = _extremes(evaluator)[index]
    rows = evaluator.spread(X).reshape(evaluator.m, -1)
    value, theta = _highest_edge(law, rows[elements], edge, sign)
    d = evaluate(rows[elements], theta)[:, :1]
    step = EDGE_SLOPE_STEP * max(float(np.abs(d).max()), np.finfo(float).tiny)
    steps = step * np.eye(law.size)
    slope = (law.edges(d + steps)[edge] - law.edges(d - steps)[edge]) / (2 * step)
    derivative = np.zeros((evaluator.m, 2 * len(evaluator.orders) - 1))
    derivative[elements] = np.outer(slope, basis_values(theta, evaluator.orders))
    return sign * value, derivative


def _highest_edge(law: VectorLaw, rows: Array, edge: int, sign: float) -> tuple[float, float]:
    """Return the largest value of an edge times a sign in a motion with rows (p, 2H + 1), and its phase."""
    theta = np.linspace(0.0, 2 * np.pi, EDGE_SAMPLES * (rows.shape[1] // 2 + 1), endpoint=False)
    step, phase = theta[1], 0.0
    for _ in range(EDGE_REFINEMENTS + 1):
        value = sign * law.edges(evaluate(rows, theta))[edge]
        peak = int(np.argmax(value))
        phase = float(theta[peak])
        theta = phase + np.linspace(-step, step, EDGE_SAMPLES + 1)
        step *= 2 / EDGE_SAMPLES
    return float(value[peak]), phase


def edge_names(evaluator: Evaluator) -> tuple[str, ...]:
    """Return the meaning of each entry of `edge_extremes` in words."""
    elements = evaluator.system.elements
    return tuple(
        f"{end} of {elements[rows[0]].name.removesuffix(' 1')}" + (f" at edge {edge + 1}" if count > 1 else "")
        for rows, _, count in edged_laws(evaluator)
        for edge in range(count)
        for end in ("lowest", "highest")
    )


# ---- all kinds


class ThresholdKind(NamedTuple):
    """Kind of threshold.

    Attributes
    ----------
    names : callable
        Meaning of each threshold of an evaluator in words.
    distances : callable
        Distances (P, T) of motions X (P, n) from the T thresholds.
    at : callable
        Distance of a motion X (n,) from the threshold of a number, and its derivative, rows (m, 2K - 1).
    """

    names: Callable[[Evaluator], tuple[str, ...]]
    distances: Callable[[Evaluator, Array], Array]
    at: Callable[[Evaluator, Array, int], tuple[float, Array]]


THRESHOLDS = {
    "clearance": ThresholdKind(clearance_names, clearances, grazing_threshold),
    "inner": ThresholdKind(inner_names, inner_distances, inner_threshold),
    "slip": ThresholdKind(slider_names, slip_margins, slip_threshold),
    "edge": ThresholdKind(edge_names, edge_extremes, edge_threshold),
}
"""Kinds of thresholds by the name of their distances among the quantities observed at points."""


# ---- distance from all thresholds


def nearest_threshold(evaluator: Evaluator, X: Array, Omega: float) -> float:
    """Return the least distance of a motion X (n,) from a threshold of its laws; inf without any.

    Thresholds are contact at a local extremum of a displacement, contact between teeth where their stiffness or gap has
    a breakpoint, zero force at a local extremum of the force of a clipped contact, an edge of a vector law, and the
    first slip.
    """
    distances = [_nearest_breakpoint(evaluator, X), _nearest_level(evaluator, X)]
    distances.append(_nearest_clip(evaluator, X, Omega / evaluator.nu))
    margins = *edge_extremes(evaluator, X[None])[0], *slip_margins(evaluator, X[None])[0]
    return float(np.abs([*distances, *margins]).min())


def _nearest_clip(evaluator: Evaluator, X: Array, omega: float) -> float:
    """Return the least local extremum of the force of a clipped contact, over k + c omega; inf without any."""
    smallest, rows = math.inf, evaluator.spread(X).reshape(evaluator.m, -1)
    for j, law in evaluator.damped:
        for contact in law.damped:
            if contact.clipped:
                _, force = depth_and_force(contact, rows[j], omega)
                extrema = evaluate(to_real(force), roots_of(derive(force))) / (contact.k + contact.c * omega)
                smallest = min(smallest, float(np.abs(extrema).min(initial=math.inf)))
    return smallest


def _nearest_breakpoint(evaluator: Evaluator, X: Array) -> float:
    """Return the least distance of a local extremum of a displacement from a breakpoint of its law; inf without any."""
    smallest, rows = math.inf, evaluator.spread(X).reshape(evaluator.m, -1)
    for j in np.unique(evaluator.element):
        if not contacts_of(evaluator.system.elements[j].law):
            theta = _extrema(_slope_samples(evaluator, j, rows[j]), partial(evaluator.gap, j, rows[j]))
            distances = evaluator.gap(j, rows[j], theta)[:, None] - evaluator.breakpoints[evaluator.element == j]
            smallest = min(smallest, float(np.abs(distances).min(initial=math.inf)))
    return smallest


def _nearest_level(evaluator: Evaluator, X: Array) -> float:
    """Return the least distance of an extremum of a displacement from the level of a contact; inf without contacts.

    The distance is also that at breakpoints of stiffness and level, at which the contact may begin or end.
    """
    smallest, rows, nu = math.inf, evaluator.spread(X).reshape(evaluator.m, -1), evaluator.nu
    grid = 2 * np.pi / evaluator.N * np.arange(evaluator.N)
    for j, element in enumerate(evaluator.system.elements):
        contacts = contacts_of(element.law)
        if not contacts:
            continue
        slope = _slope_samples(evaluator, j, rows[j])
        for contact in contacts:
            above = partial(_above, evaluator, j, rows[j], contact)
            extrema = _extrema(slope - nu * contact.level(nu * grid, 1), above)
            theta = np.concatenate([extrema, _corners(contact, nu)])
            exists = np.maximum(*(contact.stiffness(nu * theta + x) for x in (-PHASE_STEP, PHASE_STEP))) > 0
            smallest = min(smallest, float(np.abs(above(theta[exists])).min(initial=math.inf)))
    return smallest


def _above(evaluator: Evaluator, j: int, row: Array, contact: ToothContact, theta: Array, order: int = 0) -> Array:
    """Return the displacement of element j above the level of a contact, or a derivative, at basis phases theta."""
    nu = evaluator.nu
    return evaluator.gap(j, row, theta, order) - nu**order * contact.level(nu * theta, order)


def _slope_samples(evaluator: Evaluator, j: int, row: Array) -> Array:
    """Return the derivative of displacement j in theta at N equal steps of the period, (N,)."""
    displacement, retained = evaluator.system.elements[j].displacement, evaluator.piecewise.retained[:, j]
    return gap_samples(displacement, retained, evaluator.nu, row, evaluator.N, 1)


def _extrema(slope: Array, gap: Callable[..., Array]) -> Array:
    """Return the phases of the extrema of a gap, by one Newton step from the changes of sign of its sampled slope (N,).

    ``gap(theta, order)`` returns derivatives at phases theta.
    """
    after = np.roll(slope, -1)
    changes = np.flatnonzero((slope < 0) != (after < 0))
    theta = 2 * np.pi / len(slope) * (changes + slope[changes] / (slope[changes] - after[changes]))
    first, second = (gap(theta, order) for order in (1, 2))
    return theta - first / np.where(second == 0, math.inf, second)


def _corners(contact: ToothContact, nu: int) -> Array:
    """Return the basis phases of the breakpoints of a contact."""
    return (np.array(contact.phases) + 2 * np.pi * np.arange(nu)[:, None]).ravel() / nu
