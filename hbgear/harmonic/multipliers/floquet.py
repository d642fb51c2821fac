"""Floquet multipliers of periodic motions from monodromy matrices, computed for many motions at once.

The variational equation of a motion is the linear structure with m scalar modulations,

    z' = poles z - input u,   u_j = (dp_j/dd - kr_j) d_j + dp_j/dv d_j',   d = output z

The modulations are smooth except where an element crosses a breakpoint of its law. The period is divided at those
instants into segments, and each segment into equal steps. Within a step the linear part is propagated exactly, and u by
collocation at s Gauss points,

    d(c_i h) = output e^{poles c_i h} z_0 - sum_j A_ij u_j
    A_ij = int_0^{c_i h} output e^{poles (c_i h - x)} input L_j(x) dx

The integrals are known in closed form. The order is 2s. The steps resolve the vibration of the springs, and that of the
modes that are coupled to the elements: the free vibration of a mode is no polynomial in a step of several of its
periods. No saltation matrix is needed: forces are continuous, so the state and its disturbance are continuous at a
breakpoint. The exception are contacts with dampers (`Law.damped`), whose force jumps by c d'. A disturbance moves the
instant by -d / d', so that z jumps by -+ input c d at the begin and at the end of a contact.

With the matrices A, R = (output e^{poles c_i h}), B of the integrals over the whole step, and the diagonal D of the
modulations at the Gauss points, u = D (R z_0 - A u), and

    z_1 = [e^{poles h} - B (1 + D A)^-1 D R] z_0

A, R and B belong to a segment, D to a step. The loops over segments, steps and modes are in `monodromy_kernels`. If the
stiffness of all elements is constant between breakpoints, as of stops, backlash and dry friction, the flow over a
segment is a matrix exponential (`constant_flow`), which replaces the collocation unless that takes less time.

A law of several displacements has a full matrix of slopes. Each entry off the diagonal is one more modulation, of the
displacement of one element and the force of another.

A friction slider adds one state to the variational equation, see `monodromy_kernels`.

A mode that no element excites or observes has a multiplier that does not depend on the motion: the exponential of its
pole. Where identical elements move identically, modes in which they move in phase and in antiphase do not couple. Each
such block of modes is then integrated separately, at a fraction of the cost.

Free motions (rigid rotation) have the trivial multipliers +1 and are left out.

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
from hbgear.harmonic.multipliers.python_laws import check_steps, monodromy_with_python_laws
from hbgear.harmonic.structure.linear_structure import MODAL_LIMIT, LinearStructure
from hbgear.harmonic.structure.modes import ModalBlock, ModalBlocks

LONG_PERIOD_RADIANS = 12.0
"""Angle [rad] by which the springs turn the inertia in one period. Longer periods use fewer steps of ten Gauss points.
"""


TEN_POINT_STEP, REDUCED_TEN_POINT_STEP = 3.5, 4.5
"""Longest step [rad] with ten Gauss points: with all modes, and with truncated modes, whose error is larger."""


MODE_TURN_PER_SQUARED_POINTS = 0.085
"""Angle [rad] by which the fastest coupled mode turns in a step, over the square of the number of Gauss points.

The error constant of s Gauss points, s!^4 / ((2 s + 1) (2 s)!^3), times the power 2 s + 1 of the angle is below 1e-9.
"""


MAX_UNREDUCED_POLES = 60
"""Largest number of poles (two per mode) of a structure whose modes are all retained."""


MIN_RETAINED_FREQUENCY_RATIO = 6.0
"""Lowest frequency up to which modes of larger structures are retained, over the excitation frequency."""


MAX_RETAINED_FREQUENCY_RATIO = 3.0
"""Highest frequency up to which modes are retained, over that of the highest harmonic."""


RETAINED_ORDER_MARGIN = 4
"""Orders between the last significant harmonic of the element stiffness and the highest retained frequency."""


SIGNIFICANT_STIFFNESS_RATIO = 3e-2
"""Amplitude of a harmonic of the stiffness, over the largest one, from which it is significant."""


LUMPING_FLEXIBILITY = 0.15
"""Flexibility of the truncated modes times the stiffness of the elements, from which their inertia is kept as well."""


STIFFNESS_SAMPLES = 64
"""Samples of the stiffness in one excitation period."""


RETAINED_LEVELS_PER_OCTAVE = 4
"""Levels of the retained frequency in one octave. Motions of one level share their modes."""


LISTED_MULTIPLIERS = 32
"""Number of multipliers returned for larger structures."""


POLE_ROUNDING = 1e-12
"""Rounding of the real part of a pole, relative to the pole."""


EIGENVALUE_ROUNDING = 4e-16
"""Rounding of an eigenvalue, relative to the largest entry of its monodromy matrix and per row."""


SCALING_THRESHOLD = 1e100
"""Largest entry of a monodromy matrix above which it is scaled, because products of entries may overflow."""


IDENTICAL_MOTION_TOLERANCE = 1e-12
"""Relative difference of the motions of two elements that is attributed to rounding."""


def floquet_multipliers(
    compiled: Evaluator, X: Array, Omega: Array, *, points: int | None = None, max_step: float | None = None
) -> ComplexArray:
    """Return the Floquet multipliers of P motions over their periods 2 pi nu / Omega, largest modulus first.

    All motions share the parameters of the model. Structures with more than 60 poles are reduced unless the model is
    compiled with ``reduce=False``: only modes up to the frequency that the harmonics of the element stiffness reach are
    retained, at most up to three times the highest harmonic of the motion. The others keep little of their dynamics
    (see `modes`); they are those of the free structure, and listed only if they grow. The 32 largest multipliers are
    returned, with zeros if there are fewer.

    Parameters
    ----------
    compiled : Evaluator
        The model with its parameters.
    X : array_like, shape (P, n)
        Unknowns of periodic motions; with driven harmonics (P, m (4H + 1)).
    Omega : array_like, shape (P,)
        Excitation frequencies.
    points : int, optional
        Number s of Gauss points per step; the scheme has order 2s. The default is 6, or 10 where the period is long
        compared with the vibration that the springs of the elements would excite. Without ``max_step``, segments of
        constant stiffness are propagated exactly where this takes less time.
    max_step : float, optional
        Longest step, in units of the time in which the stiffest spring of the elements would turn the inertia of the
        structure by one radian. The default is s / 5, or with ten points 3.5 (4.5 with truncated modes). No step is
        longer than a fifth of the excitation period, and the modes that the elements excite turn by at most .085 s^2
        radians in a step. Without ``max_step``, steps also resolve the stiffness harmonics and the slopes of sampled
        laws.

    Returns
    -------
    ndarray, shape (P, r)
        Complex multipliers; r is twice the number of coordinates without free motions, plus the number of friction
        sliders. Sliders that slip forget their position: their multipliers are 0. So are those of sliders that never
        slip, whose positions are prescribed; see `Jenkins`.

    Raises
    ------
    ValueError
        If the structure is too large for its modes to be computed, or a period takes too many steps.
    """
    structure = compiled.structure
    if structure.depends_on_speed:
        sets = [
            floquet_multipliers(compiled.at(w), X[i : i + 1], Omega[i : i + 1], points=points, max_step=max_step)[0]
            for i, w in enumerate(np.asarray(Omega, dtype=float).tolist())
        ]
        mu = np.zeros((len(sets), max(map(len, sets), default=0)), dtype=complex)  # a mode may come to rest at a speed
        for target, values in zip(mu, sets, strict=True):
            target[: len(values)] = values
        return mu
    check_modes(structure)
    X, Omega = compiled.spread(X), np.asarray(Omega, dtype=float)
    if not is_reduced(compiled):
        return _multipliers_of_blocks(compiled, compiled.stability_modes(), X, Omega, points, max_step)
    return _reduced_multipliers(compiled, X, Omega, 1.0, points, max_step)


def check_modes(structure: LinearStructure) -> None:
    """Raise ValueError if the modes of a structure, which stability needs, are not computed."""
    if structure.modes is None:
        structure.system.check_matrices()
        raise ValueError(
            f"stability needs the modes of the structure, which are not computed for {structure.n} coordinates, because"
            f" the time for all of them grows with the cube of their number. The limit is {MODAL_LIMIT} coordinates, or"
            " 256 modes below the highest harmonic of Omega (such a structure is reduced to 1e-9). Trace with "
            "stability=False or fewer harmonics, or reduce the model with hb.mechanics.reduce(model, modes)"
        )


def is_reduced(compiled: Evaluator) -> bool:
    """Return whether modes of the structure are truncated."""
    modes = compiled.structure.modes
    return compiled.reduce and modes is not None and len(modes.poles) > MAX_UNREDUCED_POLES


def _reduced_multipliers(
    compiled: Evaluator, X: Array, Omega: Array, factor: float, points: int | None = None, max_step: float | None = None
) -> ComplexArray:
    """Return `floquet_multipliers` with modes retained up to ``factor`` the usual frequency."""
    reach, largest = _retained_frequency(compiled, X, Omega)
    levels = np.ceil(RETAINED_LEVELS_PER_OCTAVE * np.log2(factor * reach)).astype(int)
    flexible = (largest * compiled.flexibility_above(2.0 ** (levels / RETAINED_LEVELS_PER_OCTAVE))).sum(
        axis=1
    ) > LUMPING_FLEXIBILITY
    mu = np.zeros((len(X), LISTED_MULTIPLIERS), dtype=complex)
    for level, lumped in {*zip(levels.tolist(), flexible.tolist(), strict=True)}:
        rows = np.flatnonzero((levels == level) & (flexible == lumped))
        modes = compiled.stability_modes(2.0 ** (level / RETAINED_LEVELS_PER_OCTAVE), lumped)
        listed = _multipliers_of_blocks(compiled, modes, X[rows], Omega[rows], points, max_step, LISTED_MULTIPLIERS)
        mu[rows, : listed.shape[1]] = listed
    return mu


def _retained_frequency(compiled: Evaluator, X: Array, Omega: Array) -> tuple[Array, Array]:
    """Return the frequency (P,) up to which modes are retained, and the largest stiffness (P, m) of the elements.

    A harmonic of the stiffness couples modes whose frequencies have it as sum or difference. A stiffness that jumps has
    harmonics of all orders. A single mode in the place of the truncated ones would then respond at its own frequency,
    so the stiffness is returned as zero and no such mode is used.
    """
    limit = MAX_RETAINED_FREQUENCY_RATIO * compiled.H * Omega / compiled.nu
    if compiled.aft_laws or compiled.damped or compiled.sliders:
        return limit, np.zeros((len(X), compiled.m))
    from hbgear.harmonic.multipliers.stiffness_kernels import slopes

    stiffness = np.zeros((len(X), compiled.m, STIFFNESS_SAMPLES * compiled.nu))
    slopes(compiled.packed_of(X), X, stiffness)
    largest = np.abs(stiffness).max(axis=2)
    size = np.abs(np.fft.rfft(stiffness)).max(axis=1)
    significant = size > SIGNIFICANT_STIFFNESS_RATIO * size.max(axis=1, keepdims=True)
    last = (size.shape[1] - 1 - np.argmax(significant[:, ::-1], axis=1)) / compiled.nu
    ends = last < STIFFNESS_SAMPLES // 2 - 1
    needed = np.where(ends, np.maximum(MIN_RETAINED_FREQUENCY_RATIO, last + RETAINED_ORDER_MARGIN) * Omega, np.inf)
    return np.minimum(needed, limit), np.where(ends[:, None], largest, 0.0)


def reduction(compiled: Evaluator, X: Array, Omega: Array) -> dict[str, float]:
    """Return the largest number of retained modes, and the change of leading multipliers with twice their frequency."""
    modes = compiled.structure.modes
    assert modes is not None
    mu, finer = (_reduced_multipliers(compiled, X, Omega, factor) for factor in (1.0, 2.0))
    change = np.abs(finer - mu[:, :1]).min(axis=1).max()
    count = int(np.count_nonzero(np.abs(modes.poles) <= _retained_frequency(compiled, X, Omega)[0].max())) // 2
    return {"modes": count, "of": len(modes.poles) // 2, "error": float(change)}


def _multipliers_of_blocks(
    compiled: Evaluator,
    modes: ModalBlocks,
    X: Array,
    Omega: Array,
    points: int | None,
    max_step: float | None,
    listed: int | None = None,
) -> ComplexArray:
    """Return `floquet_multipliers` from the modes of some blocks: all of them, or the ``listed`` largest.

    The phase of a mode far above the frequencies of the motion changes by many turns from point to point. A list that
    contains such modes seems to pass +1 and -1 anywhere, and the nearly undamped ones would leave no place for others.
    """
    coupled = compiled.sliders or compiled.vectors  # their elements may belong to different blocks
    divisible = len(modes.blocks) > 1 and not coupled
    identical = _move_identically(compiled, modes, X) if divisible else np.zeros(len(X), dtype=bool)
    idle = modes.omitted_poles
    if listed is not None:
        idle = idle[idle.real > POLE_ROUNDING * np.abs(idle)][:listed]
    mu = np.empty((len(X), len(idle) + modes.coupled.size + compiled.sliders), dtype=complex)
    mu[:, : len(idle)] = np.exp(idle * (2 * np.pi * compiled.nu / Omega)[:, None])
    for motions, chosen in ((identical, modes.blocks), (~identical, (modes.coupled,))):
        if motions.any():
            column = len(idle)
            for block in chosen:
                matrices = monodromies(compiled, block, modes.mobility, X[motions], Omega[motions], points, max_step)
                mu[motions, column : column + matrices.shape[1]] = _eigenvalues(matrices)
                column += block.size
    return mu[np.arange(len(mu))[:, None], np.argsort(-np.abs(mu), axis=-1, kind="stable")[:, :listed]]


def _eigenvalues(A: Array) -> ComplexArray:
    """Return the eigenvalues (P, r) of real matrices (P, r, r), without multipliers that are rounding.

    The quadratic formula is used for 2 x 2 matrices, in a tenth of the time of LAPACK. A monodromy matrix is known to
    rounding relative to its largest entry only. Smaller eigenvalues are set to zero: their sign and phase are rounding,
    and a test function computed from them would change its sign at random. Matrices with entries near overflow are
    scaled before their eigenvalues are computed.
    """
    size = np.abs(A).max(axis=(1, 2), initial=0.0)
    if not np.isfinite(size).all():
        raise ValueError(
            "the monodromy matrix is not finite, because a law or a coefficient of the model is not: check their values"
        )
    scale = np.where(size > SCALING_THRESHOLD, size, 1.0)
    scaled = A / scale[:, None, None] if (scale > 1.0).any() else A
    mu = _eigenvalues_2x2(scaled) if A.shape[1] == 2 else np.linalg.eigvals(scaled)
    smallest = EIGENVALUE_ROUNDING * A.shape[1] * size / scale
    return np.where(np.abs(mu) > smallest[:, None], mu, 0.0) * scale[:, None]


def _eigenvalues_2x2(A: Array) -> ComplexArray:
    """Return the eigenvalues (P, 2) of real matrices (P, 2, 2) by the quadratic formula."""
    mean, half_difference = 0.5 * (A[:, 0, 0] + A[:, 1, 1]), 0.5 * (A[:, 0, 0] - A[:, 1, 1])
    root = np.sqrt(half_difference * half_difference + A[:, 0, 1] * A[:, 1, 0] + 0j)
    return mean[:, None] + root[:, None] * [1.0, -1.0]


def _move_identically(compiled: Evaluator, modes: ModalBlocks, X: Array) -> np.ndarray:
    """Return whether identical elements move identically in each motion (P,)."""
    rows = X.reshape(len(X), compiled.m, -1)
    difference = np.abs(rows - rows[:, modes.groups]).max(axis=(1, 2))
    return difference <= IDENTICAL_MOTION_TOLERANCE * np.abs(rows).max(axis=(1, 2))


def monodromies(
    compiled: Evaluator,
    block: ModalBlock,
    mobility: Array,
    X: Array,
    Omega: Array,
    points: int | None,
    max_step: float | None,
) -> Array:
    """Return the real monodromy matrices (P, r + Q, r + Q) of the modes of a block and the Q friction sliders.

    mobility (m,) : inverse modal masses of the elements. Other parameters as in `floquet_multipliers`.
    """
    from hbgear.harmonic.multipliers import monodromy_kernels

    out = np.empty((len(X), block.size + compiled.sliders, block.size + compiled.sliders))
    short = points or 6
    long = LONG_PERIOD_RADIANS if points is None else np.inf
    ten_point_step = REDUCED_TEN_POINT_STEP if is_reduced(compiled) else TEN_POINT_STEP
    schemes = (_scheme(short, max_step or short / 5.0), _scheme(10, max_step or ten_point_step), long, _MIDPOINT)
    resolve = max_step is None
    if not (compiled.aft_laws or compiled.damped or compiled.normal_pairs):
        packed = compiled.packed_of(X)
        constant = np.bool_(resolve and _has_constant_segments(packed))
        settings = schemes, np.bool_(resolve), constant
        check_steps(monodromy_kernels.monodromies(packed, block.modes, X, Omega, mobility, *settings, out))
        return out
    for motion, frequency, matrix in zip(X, Omega.tolist(), out, strict=True):
        monodromy_with_python_laws(compiled, block, mobility, motion, frequency, schemes, resolve, matrix)
    return out


def _has_constant_segments(packed: Any) -> bool:
    """Return whether the stiffness of all elements is constant between breakpoints."""
    laws, piecewise = packed.laws, packed.piecewise
    constant = not laws.cubic[:, 1].any() and len(laws.shifts) == 1
    return constant and (piecewise is None or not piecewise.stiffness[:, 1:].any())


def _scheme(points: int, max_step: float) -> tuple[Array, Array, float, float]:
    """Return a scheme of `monodromy_kernels.monodromies` with Gauss points."""
    return *gauss_nodes(points), max_step, MODE_TURN_PER_SQUARED_POINTS * points**2


_MIDPOINT = np.array([0.5]), np.ones((1, 1))
"""Scheme with one point, at which the constant stiffness of a segment is evaluated."""
