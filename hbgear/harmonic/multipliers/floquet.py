"""Floquet multipliers of periodic motions, of many at once.

A small disturbance of the motion obeys the linear structure plus m scalar modulations,

    z' = poles z - input u,   u_j = (dp_j/dd - kr_j) d_j + dp_j/dv d_j',   d = output z

which are smooth except where an element crosses a corner of its law. The period is cut at those instants and each
piece into equal steps; in a step the linear part is propagated exactly and u by collocation at s Gauss points,

    d(c_i h) = output e^{poles c_i h} z_0 - sum_j A_ij u_j
    A_ij = int_0^{c_i h} output e^{poles (c_i h - x)} input L_j(x) dx

with the integrals in closed form, so that neither stiff supports nor fast modes limit the step. The order is 2s.
No saltation matrix is needed: forces are continuous, so the state and its disturbance are continuous at a corner (a
law that switches its *damping* at a corner must not be given; see the contract in `laws`).

With the matrices A, R = (output e^{poles c_i h}), B of the integrals over the whole step, and the diagonal D of the
modulations at the nodes, u = D (R z_0 - A u), and

    z_1 = [e^{poles h} - B (1 + D A)^-1 D R] z_0

A, R, B belong to a piece, D to a step. The loops over pieces, steps and modes are those of `carrying`.

Modes that no element excites or feels keep their poles as exponents, whatever the motion. Where elements are alike and
move alike, modes in which they move together and against each other do not mix: each such part of the modes is carried
by itself, at a fraction of the cost.

Free motions (rigid rotation) carry the trivial multipliers +1 and are left out.

References
----------
Friedmann, Hammond & Woo (1977), Int. J. Numer. Meth. Eng. 11, https://doi.org/10.1002/nme.1620110708.
Hsu (1974), J. Math. Anal. Appl. 45, https://doi.org/10.1016/0022-247X(74)90112-X.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.multipliers.gauss_points import gauss_nodes
from hbgear.harmonic.structure.modes import ModalBlock, ModalBlocks
from hbgear.harmonic.structure.receptance import MODAL_LIMIT

_SHARE = 0.2  # longest step as a share of the excitation period, whatever the structure


_STEPS = 10_000  # of one period


_LONG = 12.0  # periods in which the springs turn the inertia by more radians are cut into fewer steps of more points


_WIDTH, _WIDER = 3.5, 4.5  # longest of these, in radians; where modes are left out, whose error is larger


_FEW = 60  # modes, both of each pair, that are all carried


_LEAST = 6.0  # least frequency up to which modes of larger structures are carried, over that of the excitation


_MOST = 3.0  # the greatest, over that of the highest harmonic


_BEYOND = 4  # orders by which it lies above the last harmonic that matters in the stiffness of the elements


_MATTERS = 3e-2  # amplitude of a harmonic of the stiffness, over the largest, from which it matters


_SOFT = 0.15  # flexibility of the modes above it, times stiffness, from which their inertia matters


_PHASES = 64  # of an excitation period at which the stiffness is looked at


_LEVELS = 4  # levels of that frequency in an octave: motions of one level share their modes


_LISTED = 32  # multipliers of larger structures that are told


_ROUNDING = 4e-16  # of a monodromy matrix, relative to its largest entry and times the number of its rows


_HUGE = 1e100  # entries of a monodromy matrix from which products of them may overflow


_ALIKE = 1e-12  # difference of the motions of two elements, relative, that is rounding


def floquet_multipliers(
    compiled: Evaluator,
    X: Array,
    Omega: Array,
    *,
    points: int | None = None,
    width: float | None = None,
) -> ComplexArray:
    """Floquet multipliers of P motions over their periods 2 pi nu / Omega, largest magnitude first.

    They share the parameters of the model. Of a structure with more than 60 modes only those are carried that harmonics
    of the stiffness of the elements reach, up to three times the highest harmonic of the motion, and little is kept of
    the others (see `modes`), whose multipliers are told as nothing acted on them; the 32 largest are listed. Not where
    the model is compiled without ``reduce``.

    Parameters
    ----------
    compiled : the model with its parameters.
    X : (P, n) unknowns of periodic motions, or (P, m (4H + 1)) of `processed` ones.
    Omega : (P,) excitation frequencies.
    points : s, Gauss points per step; the scheme has order 2s. By default 6, or 10 where the period is long beside the
        motions the springs of the elements would excite, for fewer steps are then worth more points.
    width : longest step, in units of the time in which the stiffest spring of the elements would turn the structure's
        inertia by one radian; by default s / 5, or with these 10 points 3.5 (4.5 where modes are left out). None is
        longer than a fifth of the excitation period.

    Returns
    -------
    (P, r) complex, r twice the number of coordinates that are not free motions.

    Raises
    ------
    ValueError
        If the structure is too large for its modes to be computed, or a period takes too many steps.
    """
    structure = compiled.structure
    if structure.spins:
        each = [floquet_multipliers(compiled.at(w), X[i : i + 1], Omega[i : i + 1], points=points, width=width)[0]
                for i, w in enumerate(np.asarray(Omega, dtype=float).tolist())]  # fmt: skip
        mu = np.zeros((len(each), max(map(len, each), default=0)), dtype=complex)  # a mode may come to rest at a speed
        for row, one in zip(mu, each, strict=True):
            row[: len(one)] = one
        return mu
    if structure.modes is None:
        structure.system.check_matrices()
        raise ValueError(
            f"stability needs the modes of the structure; those of {structure.n} coordinates are not computed: at most "
            f"{MODAL_LIMIT}, as the time grows with the cube, or a structure with at most 256 modes below the highest "
            "harmonic of Omega, which is reduced to 1e-9. Trace with stability=False, fewer harmonics, or reduce "
            "the model with hb.mechanics.reduce(model, modes)"
        )
    X, Omega = compiled.spread(X), np.asarray(Omega, dtype=float)
    if not is_reduced(compiled):
        return _all_of(compiled, compiled.parts(), X, Omega, points, width)
    return _reduced(compiled, X, Omega, 1.0, points, width)


def is_reduced(compiled: Evaluator) -> bool:
    """Whether not all modes of the structure are carried."""
    modes = compiled.structure.modes
    return compiled.reduce and modes is not None and len(modes.poles) > _FEW


def _reduced(
    compiled: Evaluator, X: Array, Omega: Array, times: float, points: int | None = None, width: float | None = None
) -> ComplexArray:
    """`floquet_multipliers` by the modes up to so many times the frequency that is usual."""
    reach, largest = _reach(compiled, X, Omega)
    levels = np.ceil(_LEVELS * np.log2(times * reach)).astype(int)
    soft = (largest * compiled.beside(2.0 ** (levels / _LEVELS))).sum(axis=1) > _SOFT
    mu = np.empty((len(X), _LISTED), dtype=complex)
    for level, lumped in {*zip(levels.tolist(), soft.tolist(), strict=True)}:
        rows = np.flatnonzero((levels == level) & (soft == lumped))
        parts = compiled.parts(2.0 ** (level / _LEVELS), lumped)
        mu[rows] = _all_of(compiled, parts, X[rows], Omega[rows], points, width, _LISTED)
    return mu


def _reach(compiled: Evaluator, X: Array, Omega: Array) -> tuple[Array, Array]:
    """Frequency (P,) up to which modes are carried at each motion, and the largest stiffness (P, m) of the elements.

    A harmonic of the stiffness joins modes whose frequencies it is the sum or difference of. Where the stiffness jumps
    it has harmonics without end: a single mode in the place of those above would ring, so that it is told as zero.
    """
    most: Array = _MOST * compiled.H * Omega / compiled.nu
    if compiled.asked:
        return most, np.zeros((len(X), compiled.m))
    from hbgear.harmonic.multipliers import monodromy_kernels

    stiffness = np.zeros((len(X), compiled.m, _PHASES * compiled.nu))
    monodromy_kernels.slopes(compiled.numbers_of(X), X, stiffness)
    largest = np.abs(stiffness).max(axis=2)
    size = np.abs(np.fft.rfft(stiffness)).max(axis=1)
    matters = size > _MATTERS * size.max(axis=1, keepdims=True)
    last = (size.shape[1] - 1 - np.argmax(matters[:, ::-1], axis=1)) / compiled.nu
    ends = last < _PHASES // 2 - 1
    needed = np.where(ends, np.maximum(_LEAST, last + _BEYOND) * Omega, np.inf)
    return np.minimum(needed, most), np.where(ends[:, None], largest, 0.0)


def reduction(compiled: Evaluator, X: Array, Omega: Array) -> dict[str, float]:
    """How many modes were carried at most, and how far the leading multipliers move with those of twice the reach."""
    modes = compiled.structure.modes
    assert modes is not None
    mu, more = (_reduced(compiled, X, Omega, times) for times in (1.0, 2.0))
    moved = np.abs(more - mu[:, :1]).min(axis=1).max()
    carried = int(np.count_nonzero(np.abs(modes.poles) <= _reach(compiled, X, Omega)[0].max())) // 2
    return {"modes": carried, "of": len(modes.poles) // 2, "error": float(moved)}


def _all_of(
    compiled: Evaluator,
    parts: ModalBlocks,
    X: Array,
    Omega: Array,
    points: int | None,
    width: float | None,
    listed: int | None = None,
) -> ComplexArray:
    """`floquet_multipliers`, by the modes of some parts; all of them, or so many of the largest."""
    alike = _alike(compiled, parts, X) if len(parts.split) > 1 else np.zeros(len(X), dtype=bool)
    idle = parts.idle[:listed]
    mu = np.empty((len(X), len(idle) + parts.whole.size), dtype=complex)
    mu[:, : len(idle)] = np.exp(idle * (2 * np.pi * compiled.nu / Omega)[:, None])
    for some, each in ((alike, parts.split), (~alike, (parts.whole,))):
        if some.any():
            at = len(idle)
            for part in each:
                matrices = monodromies(compiled, part, parts.mobility, X[some], Omega[some], points, width)
                mu[some, at : at + part.size] = _eigenvalues(matrices)
                at += part.size
    return mu[np.arange(len(mu))[:, None], np.argsort(-np.abs(mu), axis=-1, kind="stable")[:, :listed]]


def _eigenvalues(A: Array) -> ComplexArray:
    """Eigenvalues (P, r) of real matrices (P, r, r), without rounding that looks like a multiplier.

    Matrices of two rows use the quadratic formula, in a tenth of the time of LAPACK. A monodromy matrix is known to
    rounding relative to its largest entry only: smaller eigenvalues are set to zero, for their sign and phase are
    rounding, and a test function of them would change its sign without a reason. Matrices with entries near overflow
    are scaled before their eigenvalues are computed.
    """
    size = np.abs(A).max(axis=(1, 2), initial=0.0)
    if not np.isfinite(size).all():
        raise ValueError(
            "the monodromy matrix is not finite: a law or a coefficient of the model is not; check their values"
        )
    scale = np.where(size > _HUGE, size, 1.0)
    scaled = A / scale[:, None, None] if (scale > 1.0).any() else A
    mu = _of_two_rows(scaled) if A.shape[1] == 2 else np.linalg.eigvals(scaled)
    least = _ROUNDING * A.shape[1] * size / scale
    found: ComplexArray = np.where(np.abs(mu) > least[:, None], mu, 0.0) * scale[:, None]
    return found


def _of_two_rows(A: Array) -> ComplexArray:
    """Eigenvalues (P, 2) of real matrices (P, 2, 2) by the quadratic formula."""
    mean, half = 0.5 * (A[:, 0, 0] + A[:, 1, 1]), 0.5 * (A[:, 0, 0] - A[:, 1, 1])
    root = np.sqrt(half * half + A[:, 0, 1] * A[:, 1, 0] + 0j)
    both: ComplexArray = mean[:, None] + root[:, None] * [1.0, -1.0]
    return both


def _alike(compiled: Evaluator, parts: ModalBlocks, X: Array) -> np.ndarray:
    """Whether in each motion (P,) the elements that are alike move alike."""
    rows = X.reshape(len(X), compiled.m, -1)
    apart = np.abs(rows - rows[:, parts.groups]).max(axis=(1, 2))
    alike: np.ndarray = apart <= _ALIKE * np.abs(rows).max(axis=(1, 2))
    return alike


def monodromies(
    compiled: Evaluator,
    part: ModalBlock,
    mobility: Array,
    X: Array,
    Omega: Array,
    points: int | None,
    width: float | None,
) -> Array:
    """Real matrices (P, r, r) that carry a disturbance of the modes of a part over one period.

    mobility (m,) : inverse modal masses of the elements. Other parameters as of `floquet_multipliers`.
    """
    from hbgear.harmonic.multipliers import monodromy_kernels

    out = np.empty((len(X), part.size, part.size))
    short = points or 6
    long = _LONG if points is None else np.inf
    usual = _WIDER if is_reduced(compiled) else _WIDTH
    schemes = ((*gauss_nodes(short), width or short / 5.0), (*gauss_nodes(10), width or usual), long)
    if not compiled.asked:
        count = monodromy_kernels.monodromies(
            compiled.numbers_of(X), part.modes, X, Omega, mobility, schemes, _SHARE, float(_STEPS), out
        )
        _check_steps(count)
        return out
    for motion, frequency, matrix in zip(X, Omega.tolist(), out, strict=True):
        _carried(compiled, part, mobility, motion, frequency, schemes, matrix)
    return out


def _check_steps(count: float) -> None:
    if count:
        raise ValueError(
            f"stability would take {count:.2g} steps a period, for the springs are so fast beside Omega: give "
            "another Omega, or trace with stability=False"
        )


def _carried(
    compiled: Evaluator, part: ModalBlock, mobility: Array, X: Array, Omega: float, schemes: Any, out: Array
) -> None:
    """`carrying.monodromies` of one motion of a model with laws of its own, which are asked for their slopes here."""
    from hbgear.harmonic.forces.projection_kernels import projection_workspace
    from hbgear.harmonic.multipliers import monodromy_kernels

    numbers, nu, ports = compiled.numbers_of(X), compiled.nu, part.modes.ports
    rows, omega = X.reshape(compiled.m, -1), Omega / nu
    space, coarse = (
        projection_workspace(numbers, compiled.m, rows.shape[1] // 2, 0),
        monodromy_kernels.circle(monodromy_kernels.COARSE * nu),
    )
    largest = np.abs(_slopes(compiled, rows, omega, coarse[0])[0]).max(axis=1)
    room = np.empty((5, coarse.shape[1])), np.empty(coarse.shape[1])
    known = monodromy_kernels.steps_per_segment(numbers, rows, mobility, coarse, space.waves, *room)
    which, longest = monodromy_kernels.step_of(
        max(known, float(np.sqrt((mobility * largest).max()))), omega, nu, schemes, _SHARE
    )
    longest = monodromy_kernels.shortened(longest, omega, part.modes.poles)
    x, L, _ = schemes[which]
    _check_steps(2 * np.pi / longest if 2 * np.pi / longest > _STEPS else 0.0)
    theta, cut = monodromy_kernels.cuts_of(numbers, space)
    pieces, steps = monodromy_kernels.partition_period(numbers, rows, longest, space, theta, cut)
    carriage = monodromy_kernels.monodromy_workspace(part.modes, part.size, len(x), steps, 2)
    monodromy_kernels.fill_stiffness_modulation(numbers, rows, ports, cut, pieces, x, space.waves, carriage)
    points = carriage.phases[0, : steps * len(x)]
    dd, dv = _slopes(compiled, rows, omega, points)[:, ports].reshape(2, len(ports), steps, len(x))
    carriage.D[0] += dd.transpose(1, 2, 0)
    carriage.D[1] = dv.transpose(1, 2, 0)
    monodromy_kernels.monodromy(part.modes, cut, pieces, omega, x, L, carriage, out)


def _slopes(compiled: Evaluator, rows: Array, omega: float, theta: Array) -> Array:
    """dp/dd and dp/dv (2, m, T) of the laws that must be asked at phases theta of the basis; zero of all others."""
    out = np.zeros((2, compiled.m, len(theta)))
    for j, law in compiled.asked:
        d, v = compiled.gap(j, rows[j], theta), omega * compiled.gap(j, rows[j], theta, 1)
        out[:, j] = law.force(d, v, compiled.nu * theta)[1:]
    return out
