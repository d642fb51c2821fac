"""Quantities of a periodic motion: forces, coordinates, contact regime, clearances, truncation and sampling errors.

    force of element j     f_k + i k (Omega / nu) c_j d_k          (law and damper)
    truncation error       delta d_k = -G_k f_k                    for the harmonics of forces and of the excitation
                                                                   that the balance leaves out
    error of resolution    delta X = -J_fine^-1 R_fine(X)

Every function takes an `Evaluator`, the model at one parameter set, and unknowns X of its discretization.

The error of resolution is a Newton step of the balance with twice the harmonics, and more samples of laws evaluated by
the alternating frequency/time method (AFT). It contains two effects that the truncation error does not. Truncated
harmonics change the contact and so act back on the kept ones, which multiplies the error of a motion with stops by up
to 8. With N samples per period, AFT adds the force harmonics k + N, k + 2N, ... to harmonic k; this aliasing is not
small where a law is steep, as the friction force tanh(v / v0).

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036, for AFT.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.refinement import shortest_step
from hbgear.continuation.numerics.linear import Factors, norm, solve_linear
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.harmonic.equations.discretization import MAX_SAMPLES
from hbgear.harmonic.equations.evaluator import Evaluator, elements_between_breakpoints, writable
from hbgear.harmonic.equations.layout import STICK_REGIME
from hbgear.harmonic.equations.thresholds import edge_extremes, edged_laws, slip_margins
from hbgear.mechanics.laws.slider import friction_limits, limit_at
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.reduction import Reduction
from hbgear.mechanics.series.fourier import places, to_complex, to_real
from hbgear.mechanics.series.real_basis import derivative

# ---- forces and coordinates


def mesh_forces(evaluator: Evaluator, X: Array, Omega: float) -> Array:
    """Return the whole force of each element, law and damper, as real rows (m, 2H + 1)."""
    velocity = Omega / evaluator.nu * evaluator.structure.c[:, None] * derivative(_rows(evaluator, X))
    return evaluator.forces(X, Omega) + velocity


def coordinates(evaluator: Evaluator, X: Array, Omega: float, reduction: Reduction | None = None) -> Array:
    """Return the motion of every coordinate of the structure, of the whole one after a reduction: rows (n, 2H + 1)."""
    orders = evaluator.orders
    f = to_complex(evaluator.forces(X, Omega)).T[orders]
    d = to_complex(X.reshape(evaluator.m, -1)).T
    q = np.zeros((evaluator.H + 1, evaluator.system.n), dtype=complex)
    q[orders] = evaluator.receptance.motion(Omega, d, f)
    return to_real(q.T if reduction is None else reduction.motion(q.T))


def _rows(evaluator: Evaluator, X: Array) -> Array:
    return evaluator.spread(X).reshape(evaluator.m, -1)


# ---- contact


def regime(evaluator: Evaluator, X: Array) -> np.ndarray:
    """Return the regime codes (m,) of each law, see `REGIMES`."""
    regimes = evaluator.extrema_and_regime(X[None])[1]
    _fill_friction_regimes(evaluator, slip_margins(evaluator, X[None]), regimes)
    _fill_vector_regimes(evaluator, edge_extremes(evaluator, X[None]), regimes)
    codes: np.ndarray = regimes[0]
    return codes


def _fill_friction_regimes(evaluator: Evaluator, margins: Array, regimes: np.ndarray) -> None:
    """Replace the regime codes (P, m) of elements with friction by those of their slider margins (P, Q)."""
    sliders = evaluator.packed.sliders
    if sliders is None:
        return
    for j in sorted(set(sliders.element.tolist())):
        slips = margins[:, sliders.element == j] > 0
        regimes[:, j] = STICK_REGIME + slips.any(axis=1) + slips.all(axis=1)


def _fill_vector_regimes(evaluator: Evaluator, extremes: Array, regimes: np.ndarray) -> None:
    """Replace the regime codes (P, m) of elements of vector laws by the number of edges that the motion crosses."""
    first = 0
    for rows, _, count in edged_laws(evaluator):
        values = extremes[:, first : first + 2 * count].reshape(len(extremes), count, 2)
        regimes[:, rows] = np.minimum(((values[..., 0] < 0) & (values[..., 1] > 0)).sum(axis=1), 2)[:, None]
        first += 2 * count


def slider_positions(evaluator: Evaluator, X: Array, theta: float) -> Array:
    """Return the positions (Q,) of the friction sliders of a motion X (n,) at a basis phase."""
    out, sliders = np.empty(evaluator.sliders), friction_limits(evaluator.system.elements)
    if not sliders:
        return out
    from hbgear.harmonic.forces.slider_kernels import OPEN, STICK, slider_motion

    rows = _rows(evaluator, X)
    motion = slider_motion(evaluator.packed, rows)
    for i, (j, slider, limit) in enumerate(sliders):
        begin = motion.begin[i, : motion.number[i]]
        p = int(np.searchsorted(begin, begin[0] + (theta - begin[0]) % (2 * np.pi), side="right")) - 1
        phase, kind = np.array([theta]), int(motion.kind[i, p])
        if kind == STICK:
            out[i] = motion.position[i, p]
            continue
        d_n = evaluator.gap(limit.normal, rows[limit.normal], phase) if limit.normal >= 0 else None
        slip, reach = 0 if kind == OPEN else kind, limit_at(limit, d_n, evaluator.nu * phase)[0] / slider.k
        out[i] = float(evaluator.gap(j, rows[j], phase)[0] - slip * reach)
    return out


def shortest_intervals(evaluator: Evaluator, X: Array) -> Array:
    """Return the shortest intervals (P,) of the basis phase between two switching times of motions X (P, n).

    They are the durations of the shortest contact or separation; 2 pi without switching times.
    """
    from hbgear.harmonic.equations import diagnostic_kernels

    out, X = np.empty(len(X)), evaluator.spread(X)
    diagnostic_kernels.shortest_intervals(evaluator.packed_of(X), evaluator.m, X, out)
    return out


# ---- truncation


def with_driven_harmonics(evaluator: Evaluator, X: Array, Omega: Array) -> Array:
    """Return motions X (P, n) with the truncated harmonics up to 2H that forces and excitation drive, (P, m (4H + 1)).

    Prescribed displacements with breakpoints are complete in X.
    """
    from hbgear.harmonic.equations.diagnostic_kernels import driven_response, truncated_force_harmonics

    evaluator.length(X)
    X, Omega = evaluator.spread(X), writable(Omega)
    truncated_orders = evaluator.packed.linear.truncated_orders
    f = np.zeros((len(X), evaluator.m, len(truncated_orders)), dtype=complex)
    truncated_force_harmonics(evaluator.packed, X, Omega, f)
    for forces in evaluator.python_forces:
        forces.add_truncated(X, Omega, truncated_orders, f)
    unreferenced = np.flatnonzero([law.reference == 0 for law in evaluator.laws])  # laws without a reference stiffness
    excitation = evaluator.receptance.truncated
    if not unreferenced.size and evaluator.structure.modal and excitation is None:
        out = _with_zeros(evaluator, X)
        driven_response(evaluator.packed.linear, Omega, f, out)
        return out
    direct = None if excitation is None else excitation.response(evaluator.structure, Omega, f)
    extra_stiffness = _stiffness_beyond_reference(evaluator, X, unreferenced) if unreferenced.size else None
    return _with_harmonics(evaluator, X, _response_to_forces(evaluator, Omega, f, extra_stiffness, direct))


def with_excited_harmonics(evaluator: Evaluator, X: Array, Omega: Array) -> Array:
    """Return motions X (P, n) with the response of the linear structure to the truncated orders of the excitation.

    Without such orders they are X, else all harmonics up to 2H, (P, m (4H + 1)).
    """
    excitation = evaluator.receptance.truncated
    if excitation is None:
        return X
    X, Omega = evaluator.spread(X), writable(Omega)
    f = np.zeros((len(X), evaluator.m, len(evaluator.packed.linear.truncated_orders)), dtype=complex)
    direct = excitation.response(evaluator.structure, Omega, f)
    return _with_harmonics(evaluator, X, _response_to_forces(evaluator, Omega, f, None, direct))


def _with_zeros(evaluator: Evaluator, X: Array) -> Array:
    """Return motions with all harmonics up to 2H, of which the truncated ones are zero."""
    rows = np.zeros((len(X), evaluator.m, 4 * evaluator.H + 1))
    rows[..., : 2 * evaluator.H + 1] = X.reshape(len(X), evaluator.m, -1)
    return rows.reshape(len(X), -1)


def _with_harmonics(evaluator: Evaluator, X: Array, truncated: Array) -> Array:
    """Return motions with given truncated harmonics (P, m, 2L)."""
    out = _with_zeros(evaluator, X)
    out.reshape(len(X), evaluator.m, -1)[..., places(evaluator.packed.linear.truncated_orders)] = truncated
    return out


def truncation_errors(evaluator: Evaluator, extended: Array) -> Array:
    """Return the rms (P,) of the truncated harmonics of motions, as of `with_driven_harmonics`."""
    truncated = extended.reshape(len(extended), evaluator.m, -1)[..., places(evaluator.packed.linear.truncated_orders)]
    rms: Array = np.sqrt(0.5 * np.sum(truncated**2, axis=(1, 2)))
    return rms


def truncation_error(evaluator: Evaluator, X: Array, Omega: float) -> float:
    """Return the estimated error (rms of the elements) that truncated force harmonics cause.

    These are the harmonics H < k <= 2H, and lower orders that are not unknowns.
    """
    return float(truncation_errors(evaluator, with_driven_harmonics(evaluator, X[None], np.array([Omega])))[0])


def largest_amplitudes(problem: Any, curve: Branch) -> Array:
    """Return the largest amplitude of each order 1, 2, ... of Omega in any element and at any point of a curve.

    Amplitudes of orders that are not unknowns of the problem, a `HarmonicBalance`, are the response to the truncated
    force harmonics up to 2H.
    """
    motions = []
    for i, x in enumerate(curve.X):
        parameters = curve.parameters_at(i)
        X = problem.from_layout(x, curve.layout)
        motions.append(with_driven_harmonics(problem.compiled(parameters), X[None], np.array([parameters["Omega"]]))[0])
    rows = np.array(motions).reshape(len(motions), problem.m, -1)
    cosine, sine = (rows[..., 2 * problem.nu - offset :: 2 * problem.nu] for offset in (1, 0))
    amplitudes: Array = np.hypot(cosine, sine).max(axis=(0, 1))
    return amplitudes


def _stiffness_beyond_reference(evaluator: Evaluator, X: Array, elements: np.ndarray) -> Array:
    """Return the mean stiffness (P, m) of some elements along motions X (P, n) minus the reference springs."""
    basis, out = evaluator.packed.basis, np.zeros((len(X), evaluator.m))
    N = basis.shape[1]
    tau = np.tile(2 * np.pi * (evaluator.nu * np.arange(N) % N) / N, len(X))
    zeros = np.zeros(len(tau))
    d = X.reshape(len(X), evaluator.m, -1) @ basis
    grid = evaluator.piecewise.grid
    d[..., : grid.shape[2]] += grid[0]
    for j in elements.tolist():
        slope = evaluator.laws[j].force(d[:, j].ravel(), zeros, tau)[1]
        out[:, j] = np.mean(np.reshape(slope, (-1, N)), axis=1) - evaluator.structure.kr[j]
    return out


def _response_to_forces(
    evaluator: Evaluator, Omega: Array, f: ComplexArray, extra_stiffness: Array | None, direct: ComplexArray | None
) -> Array:
    """Return the response (P, m, 2L) to truncated forces, as `driven_response` for any structure.

    extra_stiffness (P, m) : stiffness of the elements minus their reference springs, zero by default.
    direct (P, m, L) : displacements of the elements without forces, zero by default.
    """
    ratio = evaluator.packed.linear.truncated_orders / evaluator.nu
    G = np.zeros((len(Omega), len(ratio), evaluator.m, evaluator.m), dtype=complex)
    modes = evaluator.structure.modes if evaluator.structure.accurate_modes else None
    for i, w in enumerate(Omega.tolist()):
        if modes is not None:
            G[i] = (modes.output / (1j * w * ratio[:, None, None] - modes.poles)) @ modes.input
            continue
        is_known = w * ratio <= evaluator.structure.highest
        G[i, is_known] = evaluator.structure.receptances(w, ratio[is_known])[0] if is_known.any() else 0.0
    delta = G @ f.transpose(0, 2, 1)[..., None]
    if direct is not None:
        delta -= direct.transpose(0, 2, 1)[..., None]
    if extra_stiffness is not None:
        delta = np.linalg.solve(np.eye(evaluator.m) + G * extra_stiffness[:, None, None, :], delta)
    delta = delta[..., 0].transpose(0, 2, 1)
    return np.stack([-delta.real, delta.imag], axis=-1).reshape(*f.shape[:2], -1)


# ---- monitored quantities


def monitored_quantities(evaluator: Evaluator, X: Array, Omega: Array) -> tuple[list[dict[str, Any]], Array]:
    """Return clearance, slip margins, regime and truncation error of motions X (P, n), and the motions to order 2H.

    The second result (P, m (4H + 1)) holds the harmonics up to 2H that the truncated force harmonics drive.
    """
    clearances, regimes = evaluator.extrema_and_regime(X)
    extended = with_driven_harmonics(evaluator, X, Omega)
    results = zip(clearances, regimes, truncation_errors(evaluator, extended).tolist(), strict=True)
    observed = [{"clearance": c, "regime": r, "error": e} for c, r, e in results]
    if evaluator.sliders:
        margins = slip_margins(evaluator, X)
        _fill_friction_regimes(evaluator, margins, regimes)  # the codes of ``observed`` are views
        for quantities, margin in zip(observed, margins, strict=True):
            quantities["slip"] = margin
    if edged_laws(evaluator):
        extremes = edge_extremes(evaluator, X)
        _fill_vector_regimes(evaluator, extremes, regimes)
        for quantities, edges in zip(observed, extremes, strict=True):
            quantities["edge"] = edges
    return observed, extended


# ---- sampling

CHECK_INTERVAL = 4
"""Points per check of the error of resolution, which costs as much as several evaluations of the balance."""

PROJECTED_CHECK_INTERVAL = 8
"""Points per check of laws that are projected exactly, whose evaluations cost less than the check."""

MIN_CHECKED_ERROR = 1e-9
"""Truncation error, relative to the motion, up to which it is not checked."""

MAX_CHECKED_UNKNOWNS = 1200
"""Unknowns up to which the error of resolution is computed with twice the harmonics."""

MAX_CHOSEN_SAMPLES = 32_768
"""Samples per period up to which their number is raised automatically."""

CORNER_SAMPLES = 2048
"""Least number of samples per period of laws with breakpoints that lie between samples. A curve has a corner where a
sample passes a breakpoint, and multipliers depend on the samples of slopes that jump there: period doublings of a
rubbing rotor are known to 1e-8, and to 1e-5 with 128 samples."""

MAX_ALIASING = 1e-5
"""Change of a motion by twice the samples, relative to its size, for which a number of samples is accepted."""


def with_enough_samples(problem: Any, X: Array, parameters: Mapping[str, float]) -> Any:
    """Return a balance with as many samples as the AFT of a motion requires.

    They are doubled until aliasing changes the motion by less than 1e-5 of its size. A law with breakpoints has
    `CORNER_SAMPLES` or more, because the motion may reach its breakpoints later on the curve.
    """
    limit = min(MAX_SAMPLES // max(problem.m, 1), MAX_CHOSEN_SAMPLES)
    best, motion = problem, X
    min_samples = min(limit, CORNER_SAMPLES) if _samples_have_corners(problem.compiled(parameters)) else 0
    if min_samples > best.N:
        best = best.denser(math.ceil(min_samples / best.N))
    while limit >= 2 * best.N:
        denser = best.denser(2)
        if norm(newton_step(denser, motion, parameters)) <= MAX_ALIASING * norm(motion):
            break
        best = denser
        with suppress(NoConvergence):
            motion = solve(best, motion, parameters).X
    return best


def _samples_have_corners(evaluator: Evaluator) -> bool:
    """Return whether the slope of a law that is evaluated by AFT jumps between samples."""
    divided = elements_between_breakpoints(evaluator)
    scalar = (law for j, law in evaluator.aft_laws if not isinstance(law, Component) and j not in divided)
    return any(law.breakpoints for law in scalar) or bool(edged_laws(evaluator))


def newton_step(problem: Any, X: Array, parameters: Mapping[str, float]) -> Array:
    """Return the Newton step (n,) of a problem at a motion; nan where its Jacobian is singular."""
    R, J = problem.evaluate(X, **parameters)
    try:
        return solve_linear(J, -R)
    except np.linalg.LinAlgError:
        return np.full(len(X), np.nan)


def add_resolution_error(
    problem: Any, X: Array, name: str, values: Array, observed: Sequence[dict[str, Any]],
    parameters: Mapping[str, float],
) -> None:  # fmt: skip
    """Replace ``"error"`` by the error of resolution where this is larger, for motions X (P, n) at values (P,).

    Some of successive motions are checked. Between them, the error of laws evaluated by AFT and of damped contacts is
    interpolated. For laws that are projected exactly, the ratio to the truncation error, which is zero without contact,
    is interpolated instead.
    """
    if not len(X):
        return
    parameter_sets = [{**parameters, name: value} for value in values.tolist()]
    evaluator, truncation = problem.compiled(parameter_sets[0]), np.array([entry["error"] for entry in observed])
    if evaluator.aft_laws or evaluator.damped:
        checked, interval, unit = np.arange(len(X)), CHECK_INTERVAL, np.ones(len(X))
    elif len(evaluator.breakpoints) or evaluator.sliders:
        checked = np.flatnonzero(truncation > MIN_CHECKED_ERROR * np.linalg.norm(X, axis=1))
        interval, unit = PROJECTED_CHECK_INTERVAL, truncation
    else:
        return
    subset = checked[min(interval // 2, max(len(checked) - 1, 0)) :: interval]
    ratios = [max(_resolution_error(problem, X[i], parameter_sets[i]), truncation[i]) / unit[i] for i in subset]
    for i in checked.tolist() if ratios else ():
        observed[i]["error"] = float(np.fmax(truncation[i], unit[i] * np.interp(i, subset, ratios)))


def _finer(problem: Any, parameters: Mapping[str, float]) -> Any:
    """Return the balance with twice the harmonics, and more samples per harmonic of laws evaluated by AFT.

    There are four times as many, or twice as many of a law with breakpoints, whose number is large. The harmonics are
    the same if twice as many are too many, or a reduced or measured structure is not known at their frequencies. None
    is returned if the samples are too many as well, or are not used.
    """
    evaluator, refined = problem.compiled(parameters), problem.refined_problem
    is_unreduced = problem.models.reduced_for is None and math.isinf(evaluator.structure.highest)
    can_double = 2 * problem.size <= MAX_CHECKED_UNKNOWNS and (is_unreduced or refined is not None)
    if not evaluator.aft_laws:
        return (refined or problem.denser(1, 2)) if can_double else None
    factor = 2 if _samples_have_corners(evaluator) else 4
    for harmonics in (2, 1) if can_double else (1,):
        with suppress(ValueError):
            return problem.denser(factor, harmonics)
    return None


def _resolution_error(problem: Any, X: Array, parameters: Mapping[str, float]) -> float:
    """Return the rms distance of a motion from the one with more samples and harmonics; nan if it is unknown.

    It is the Newton step at the same Omega if a second step with the same Jacobian is shorter (Deuflhard's natural
    monotonicity test). Next to a fold it is not, because the other motion is far away or does not exist. Then Omega is
    free, and the distance from the curve is returned; a change of Omega, relative to Omega, weighs as much as that of
    the motion relative to its size.
    """
    refined = _finer(problem, parameters)
    if refined is None:
        return math.nan
    start = refined.resized(X)
    evaluation = refined.linearise(start, "Omega", **parameters)
    weight = np.sqrt(np.where(np.arange(len(start)) % (len(start) // problem.m) == 0, 1.0, 0.5))
    scale = np.append(1 / weight, parameters["Omega"] / (norm(weight * start) or 1.0))
    try:
        factors = Factors(evaluation.dR_dX)
        step = factors.solve(-evaluation.R)
        if np.isfinite(step).all():
            second = factors.solve(-refined.linearise(start + step, "", **parameters).R)
            if norm(weight * second) < norm(weight * step):
                return norm(weight * step)
        return norm(weight * shortest_step(evaluation, evaluation.R, scale)[:-1])
    except np.linalg.LinAlgError:
        return math.nan
