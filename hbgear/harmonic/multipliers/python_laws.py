"""Monodromy matrices of models with laws in Python, whose slopes are evaluated outside the kernels; see `floquet`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.forces.aft import edge_crossings
from hbgear.harmonic.multipliers.gauss_points import MAX_STEPS_PER_PERIOD
from hbgear.harmonic.multipliers.resolved_steps import resolved_steps
from hbgear.harmonic.multipliers.sampled_slopes import slope_pairs, slopes_at, vector_slopes_at
from hbgear.harmonic.structure.modes import ModalBlock, SymmetricPair
from hbgear.mechanics.series.fourier import evaluate

_SAME_PHASE = 1e-13
"""Distance of two phases [rad] that counts as none: the rounding of a switching time."""

EDGE_SAMPLES = 32
"""Samples of the highest harmonic of a motion between which the edges of vector laws are located."""


def check_steps(count: float) -> None:
    """Raise an error if a period takes too many steps."""
    if count:
        raise ValueError(
            f"stability would take {count:.2g} steps per period (at most {MAX_STEPS_PER_PERIOD}), because the springs "
            "are too stiff for this Omega: choose a higher Omega, or trace with stability=False"
        )


def monodromy_with_python_laws(
    compiled: Evaluator,
    block: ModalBlock,
    mobility: Array,
    X: Array,
    Omega: float,
    schemes: Any,
    resolve: bool,
    out: Array,
) -> None:
    """Compute the monodromy matrix of one motion of a model with Python laws, whose slopes are evaluated here."""
    from hbgear.harmonic.forces.projection_kernels import projection_workspace
    from hbgear.harmonic.multipliers import monodromy_kernels, stiffness_kernels

    block = _with_coupled_ports(block, compiled)
    packed, nu, ports = compiled.packed_of(X), compiled.nu, block.modes.ports
    rows, omega = X.reshape(compiled.m, -1), Omega / nu
    space = projection_workspace(packed, compiled.m, rows.shape[1] // 2, 0)
    coarse = stiffness_kernels.circle(stiffness_kernels.MODULATION_SAMPLES * nu)
    largest = np.abs(slopes_at(compiled, rows, omega, coarse[0])[0]).max(axis=1)
    for elements, slopes in vector_slopes_at(compiled, rows, omega, coarse[0]):
        largest[elements] += np.abs(slopes[0]).sum(axis=1).max(axis=1)
    buffers = np.empty((6, coarse.shape[1])), np.empty(coarse.shape[1])
    rate = stiffness_kernels.modulation_rate(packed, rows, mobility, coarse, space.waves, *buffers)
    rate = max(rate, float(np.sqrt((mobility * largest).max())))
    scheme, longest = monodromy_kernels.step_of(rate, omega, nu, schemes, block.modes, mobility)
    x, L, _, turn = schemes[scheme]
    if resolve:
        order = stiffness_kernels.modulation_order(packed, rows, space.waves, 1.0 / (2 * len(x) + 1))
        longest = monodromy_kernels.limit_step_by_order(longest, order, turn)
    longest = monodromy_kernels.limit_step_by_growth(longest, omega, block.modes.poles)
    check_steps(2 * np.pi / longest if 2 * np.pi / longest > MAX_STEPS_PER_PERIOD else 0.0)
    theta, segments = monodromy_kernels.segment_arrays(packed, space)
    count, steps = monodromy_kernels.partition_period(packed, rows, longest, space, theta, segments)
    segments, jumps = _with_contact_ends(compiled, rows, omega, longest, segments[:count])
    if resolve:
        segments, first_segments = resolved_steps(compiled, rows, omega, mobility, segments, len(x))
        jumps = {first_segments[i]: impulses for i, impulses in jumps.items()}
    count, steps = len(segments), int(segments[:, 2].sum())
    work = monodromy_kernels.monodromy_workspace(block.modes, len(out), len(x), steps, 2, compiled.sliders)
    monodromy_kernels.fill_stiffness_modulation(packed, rows, ports, segments, count, x, space, work)
    points = work.phases[0, : steps * len(x)]
    dd, dv = slopes_at(compiled, rows, omega, points)[:, ports].reshape(2, len(ports), steps, len(x))
    work.D[0] += dd.transpose(1, 2, 0)
    work.D[1] = dv.transpose(1, 2, 0)
    _fill_coupled_modulation(compiled, rows, omega, points, work.D)
    _add_slip_modulation(compiled, space.slides, points, work.D)

    def integrate(part: Array, D: Array, result: Array) -> None:
        """Compute the monodromy matrix over successive segments with the modulations D."""
        moving, exact, changed = (packed.sliders, space.slides, block.modes), np.bool_(False), work._replace(D=D)
        monodromy_kernels.monodromy(*moving, part, omega, (x, L), exact, changed, result)

    if jumps:
        out[:] = _product_with_jumps(integrate, block, segments, jumps, work.D, out)
    else:
        integrate(segments, work.D, out)


def _product_with_jumps(
    integrate: Callable[[Array, Array, Array], None],
    block: ModalBlock,
    segments: Array,
    jumps: Mapping[int, list[tuple[int, float]]],
    D: Array,
    flow: Array,
) -> Array:
    """Return the product of the flows of all segments with the impulses between them; ``flow`` is overwritten."""
    first, product = np.concatenate([[0], np.cumsum(segments[:, 2])]).astype(int), np.eye(len(flow))
    for i in range(len(segments)):
        for j, impulse in jumps.get(i, ()):
            product = _saltation(block, j, impulse, len(flow)) @ product
        integrate(segments[i : i + 1], np.ascontiguousarray(D[:, first[i] : first[i + 1]]), flow)
        product = flow @ product
    return product


def _with_coupled_ports(block: ModalBlock, compiled: Evaluator) -> ModalBlock:
    """Return a block with one more port for each pair of coupled elements: displacement of one, force of the other."""
    pairs, modes = slope_pairs(compiled), block.modes
    if len(pairs) == compiled.m:
        return block
    force, displacement = pairs.T
    extended = SymmetricPair.of(
        modes.poles,
        modes.output[displacement],
        modes.input[:, force],
        np.concatenate([modes.ports, np.full(len(pairs) - len(modes.ports), -1, dtype=np.int64)]),
        modes.flexibility[np.ix_(displacement, force)],
    )
    return ModalBlock(extended, block.size)


def _fill_coupled_modulation(compiled: Evaluator, rows: Array, omega: float, theta: Array, D: Array) -> None:
    """Add the slopes of vector laws to the modulations D (2, steps, s, g) of `_with_coupled_ports`."""
    D[..., compiled.m :] = 0.0
    ports = {pair: q for q, pair in enumerate(map(tuple, slope_pairs(compiled).tolist()))}
    for elements, slopes in vector_slopes_at(compiled, rows, omega, theta):
        for a, i in enumerate(elements.tolist()):
            for b, j in enumerate(elements.tolist()):
                D[..., ports[i, j]] += slopes[:, a, b].reshape(D.shape[:3])


def _add_slip_modulation(compiled: Evaluator, slides: Any, theta: Array, D: Array) -> None:
    """Add the derivatives of friction forces with respect to the displacement of the normal force, while they slip."""
    sliders, pairs = compiled.packed.sliders, slope_pairs(compiled).tolist()
    if sliders is None:
        return
    for i in np.flatnonzero(sliders.normal >= 0).tolist():
        begin = slides.begin[i, : slides.number[i]]
        interval = np.searchsorted(begin, begin[0] + np.mod(theta - begin[0], 2 * np.pi), side="right") - 1
        kind = slides.kind[i, interval]
        slope = np.where(np.abs(kind) == 1, kind * sliders.gain[i, slides.zone[i, interval]], 0.0)
        port = pairs.index([int(sliders.element[i]), int(sliders.normal[i])])
        D[0, ..., port] += slope.reshape(D.shape[1:3])


def _edge_phases(compiled: Evaluator, rows: Array) -> Array:
    """Return the phases at which derivatives of vector laws jump."""
    grid = np.linspace(0, 2 * np.pi, EDGE_SAMPLES * (rows.shape[1] // 2 + 1), endpoint=False)
    phases = [edge_crossings(law, rows[elements], evaluate(rows[elements], grid)) for elements, law in compiled.vectors]
    return np.concatenate([np.zeros(0), *phases])


def _with_contact_ends(
    compiled: Evaluator, rows: Array, omega: float, longest: float, segments: Array
) -> tuple[Array, dict[int, list[tuple[int, float]]]]:
    """Divide segments (S, 3) where damped contacts begin and end, and where derivatives of vector laws jump.

    Returns
    -------
    ndarray, shape (T, 3)
        Segments, as of `partition_period`.
    dict
        Jumps of forces at the begin of segments, by their number: element and impulse per unit of its displacement.
    """
    from hbgear.harmonic.forces.damped_contacts import intervals

    contacts = [(j, damper.c, intervals(damper, rows[j], omega)) for j, law in compiled.damped for damper in law.damped]
    phases = np.concatenate([_edge_phases(compiled, rows), *(closed.ends.ravel() for _, _, closed in contacts)])
    start = segments[0, 0]
    begins = start + np.mod(np.concatenate([segments[:, 0], phases]) - start, 2 * np.pi)
    begins = np.unique(np.append(begins, start))
    ends = np.append(begins, start + 2 * np.pi)
    keep = np.diff(ends) > _SAME_PHASE
    begins = ends[:-1][keep]
    width = np.diff(np.append(begins, start + 2 * np.pi))
    steps = np.maximum(1.0, np.ceil(width / longest - 1e-9))
    jumps: dict[int, list[tuple[int, float]]] = {}
    for j, c, closed in contacts:
        for phase, sign in zip(closed.jumps, closed.signs, strict=True):
            distance = np.abs(np.mod(begins - phase + np.pi, 2 * np.pi) - np.pi)
            jumps.setdefault(int(np.argmin(distance)), []).append((j, float(sign * c)))
    return np.column_stack([begins, width / steps, steps]), jumps


def _saltation(block: ModalBlock, j: int, impulse: float, size: int) -> Array:
    """Return the matrix (size, size) of an impulse at element j, proportional to its displacement."""
    modes, out = block.modes, np.eye(size)
    r = block.size
    for p in np.flatnonzero(modes.ports == j):
        excitation = np.concatenate([modes.input[:, p].real, modes.input[:, p].imag])[:r]
        observation = np.concatenate([modes.output[p].real, -modes.output[p].imag])[:r]
        out[:r, :r] -= impulse * np.outer(excitation, observation)
    return out
