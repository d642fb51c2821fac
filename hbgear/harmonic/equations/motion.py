"""Quantities of a periodic motion: forces, coordinates, contact regime, truncation error.

    force of element j     f_k + i k (Omega / nu) c_j d_k          (law and damper)
    truncation error       delta d_k = W^T D^-1 F_k - e_k - G_k [f_k - (kr + i w c) e_k]
                           for the harmonics of forces and of the excitation that the balance leaves out

Every function takes an `Evaluator`, the model at one parameter set, and unknowns X of its discretization.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.equations.evaluator import Evaluator, writable
from hbgear.harmonic.equations.layout import STICK_REGIME
from hbgear.harmonic.equations.thresholds import edge_extremes, edged_laws, inner_samples, slip_margins
from hbgear.mechanics.laws.slider import friction_limits, limit_at
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


def regimes(evaluator: Evaluator, X: Array) -> np.ndarray:
    """Return the regime codes (P, m) of each law in motions X (P, n), see `REGIMES`."""
    codes = evaluator.extrema_and_regime(X)[1]
    _fill_friction_regimes(evaluator, slip_margins(evaluator, X), codes)
    _fill_vector_regimes(evaluator, edge_extremes(evaluator, X), codes)
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
    if not unreferenced.size and evaluator.structure.accurate_modes and excitation is None:
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
    return np.sqrt(0.5 * np.sum(truncated**2, axis=(1, 2)))


def truncation_error(evaluator: Evaluator, X: Array, Omega: float) -> float:
    """Return the estimated error (rms of the elements) that truncated force harmonics cause.

    These are the harmonics H < k <= 2H, and lower orders that are not unknowns.
    """
    return float(truncation_errors(evaluator, with_driven_harmonics(evaluator, X[None], np.array([Omega])))[0])


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
    """Return distances from thresholds, regime and truncation error of motions X (P, n), and the motions to order 2H.

    The second result (P, m (4H + 1)) holds the harmonics up to 2H that the truncated force harmonics drive.
    """
    clearances, codes = evaluator.extrema_and_regime(X)
    extended = with_driven_harmonics(evaluator, X, Omega)
    results = zip(clearances, codes, truncation_errors(evaluator, extended).tolist(), strict=True)
    observed = [{"clearance": c, "regime": r, "error": e} for c, r, e in results]
    inner = inner_samples(evaluator, X, clearances)
    if inner is not None:
        for quantities, distances in zip(observed, inner, strict=True):
            quantities["inner"] = distances
    if evaluator.sliders:
        margins = slip_margins(evaluator, X)
        _fill_friction_regimes(evaluator, margins, codes)  # the codes of ``observed`` are views
        for quantities, margin in zip(observed, margins, strict=True):
            quantities["slip"] = margin
    if edged_laws(evaluator):
        extremes = edge_extremes(evaluator, X)
        _fill_vector_regimes(evaluator, extremes, codes)
        for quantities, edges in zip(observed, extremes, strict=True):
            quantities["edge"] = edges
    return observed, extended
