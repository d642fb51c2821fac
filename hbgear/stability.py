"""Floquet multipliers of a periodic motion.

A small disturbance of the motion obeys the linear structure plus m scalar modulations,

    z' = poles z - input u,   u_j = (dp_j/dd - kr_j) d_j + dp_j/dv d_j',   d = output z

which are smooth except where an element crosses a corner of its law. The period is cut at those instants and each
piece into steps; in a step the linear part is propagated exactly and u by collocation at s Gauss points,

    d(c_i h) = output e^{poles c_i h} z_0 - sum_j A_ij u_j
    A_ij = int_0^{c_i h} output e^{poles (c_i h - x)} input L_j(x) dx

with the integrals in closed form, so that neither stiff supports nor fast modes limit the step. The order is 2s.
No saltation matrix is needed: forces are continuous, so the state and its disturbance are continuous at a corner (a
law that switches its *damping* at a corner must not be given; see the contract in `laws`).

Free motions (rigid rotation) carry the trivial multipliers +1 and are left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.collocation import gauss, moments
from hbgear.fourier import Array, ComplexArray, derive, to_complex, waves

if TYPE_CHECKING:
    from hbgear.balance import HarmonicBalance

_SHARE = 0.2  # longest step as a share of the excitation period, whatever the structure


def _steps(instants: Array, omega: float, width: float) -> tuple[Array, Array, Array]:
    """Steps of a period cut at the instants theta: start phase, distinct durations, and each step's duration index."""
    cuts = np.unique(np.concatenate([[0.0], np.mod(instants, 2 * np.pi)])) if instants.size else np.array([0.0])
    if instants.size:  # begin at a switching instant: the multipliers do not depend on where the period starts
        cuts = np.unique(np.mod(instants, 2 * np.pi))
    lengths = np.diff(np.append(cuts, cuts[0] + 2 * np.pi))
    real = lengths > 1e-13
    cuts, lengths = cuts[real], lengths[real]
    counts = np.maximum(1, np.ceil(lengths / omega / width - 1e-9)).astype(int)
    h = lengths / counts
    start = np.concatenate([a + np.arange(n) * dh for a, n, dh in zip(cuts, counts, h, strict=True)])
    return start, h / omega, np.repeat(np.arange(len(h)), counts)


def multipliers(
    problem: HarmonicBalance, X: Array, *, points: int = 6, width: float | None = None, **parameters: float
) -> ComplexArray:
    """Floquet multipliers of the motion X over its period 2 pi nu / Omega, largest magnitude first.

    Parameters
    ----------
    problem : `HarmonicBalance` whose unknowns X are.
    X : (m (2H + 1),) coefficients of a periodic motion.
    points : s, Gauss points per step; the scheme has order 2s.
    width : longest step, in units of the time in which the stiffest spring of the elements would turn the structure's
        inertia by one radian; by default s / 5. No step is longer than a fifth of the excitation period.
    parameters : ``Omega`` and any model parameters that differ.

    Returns
    -------
    (r,) complex, r twice the number of coordinates that are not free motions.

    Raises
    ------
    ValueError
        If the structure is too large for its modes to be computed.
    """
    return np.array(sorted(np.linalg.eigvals(monodromy(problem, X, points=points, width=width, **parameters)),
                           key=lambda mu: -abs(mu)))  # fmt: skip


def monodromy(
    problem: HarmonicBalance, X: Array, *, points: int = 6, width: float | None = None, **parameters: float
) -> Array:
    """Real matrix (r, r) that carries a disturbance over one period, in real modal coordinates; see `multipliers`."""
    compiled = problem.compiled(parameters)
    modes = compiled.structure.modes
    if modes is None:
        raise ValueError(
            f"stability needs the modes of the structure; {compiled.structure.n} coordinates are too many: "
            "trace with stability=False or reduce the model"
        )
    omega = parameters["Omega"] / problem.nu
    kr = compiled.structure.kr
    coarse = _slopes(problem, X, omega, compiled.laws, 2 * np.pi * np.arange(32 * problem.nu) / (32 * problem.nu))
    # inverse modal masses of the elements times their largest stiffness: how fast the modulations can turn the state
    mobility = np.abs(np.einsum("jr,r,rj->j", modes.output, modes.poles, modes.input))
    pace = np.sqrt((mobility * np.maximum(kr, np.abs(coarse[:, 0]).max(axis=-1))).max())
    width = min((points / 5.0 if width is None else width) / (pace or 1.0), _SHARE * 2 * np.pi / parameters["Omega"])
    start, h, which = _steps(problem.switching(X, **parameters).theta, omega, width)
    x, L = gauss(points)
    theta = (start[:, None] + (omega * h[which])[:, None] * x).ravel()
    slopes = _slopes(problem, X, omega, compiled.laws, theta)
    stiffness = (slopes[:, 0] - kr[:, None]).reshape(problem.m, -1, points)
    damping = slopes[:, 1].reshape(problem.m, -1, points)
    return _propagate(_half(modes), h, which, stiffness, damping, x, L)


def _slopes(problem: HarmonicBalance, X: Array, omega: float, laws: Any, theta: Array) -> Array:
    """dp/dd and dp/dv of each element at phases theta, (m, 2, T)."""
    c, w = to_complex(X.reshape(problem.m, -1)), waves(theta, problem.H).T
    d, v = (c @ w).real, omega * (derive(c) @ w).real
    return np.array([law.force(d[j], v[j], problem.nu * theta)[1:] for j, law in enumerate(laws)])


def _half(modes: Any) -> tuple[ComplexArray, ComplexArray, ComplexArray, Array]:
    """One mode of each conjugate pair: poles (q,), output (m, q) doubled for pairs, input (q, m), which are pairs."""
    scale = np.abs(modes.poles).max(initial=0.0)
    real = np.abs(modes.poles.imag) <= 1e-13 * scale
    keep = real | (modes.poles.imag > 0)
    pair = ~real[keep]
    return modes.poles[keep], modes.output[:, keep] * np.where(pair, 2.0, 1.0), modes.input[keep], pair


def _propagate(
    half: tuple[ComplexArray, ComplexArray, ComplexArray, Array],
    h: Array, which: np.ndarray, stiffness: Array, damping: Array, x: Array, L: Array,
) -> Array:  # fmt: skip
    """All disturbances through all steps: a turn of the modes and a change of rank s m in each. stiffness, damping
    (m, S, s) are the modulations."""
    poles, output, input_, pair = half
    m, S, s = stiffness.shape
    if np.any(damping):
        output = np.vstack([output, output * poles])
    mo = output.shape[0]
    # integrals of the Lagrange polynomials up to each node and to the end of the step
    powers = moments(poles, h, np.append(x, 1.0), s)
    integrals = np.einsum("jp,phcr->hcjr", L, powers)
    kernel = np.einsum("or,hijr,rm->hiojm", output, integrals[:, :-1], input_, optimize=True).real
    kernel = kernel.reshape(len(h), s * mo, s * m)
    push = np.einsum("hjr,rm->hrjm", integrals[:, -1], input_).reshape(len(h), len(poles), s * m)
    waves = np.exp(h[:, None, None] * x[:, None] * poles)
    observe = (waves[:, :, None, :] * output).reshape(len(h), s * mo, len(poles))
    real_observe = _columns(observe, pair)
    real_push = np.concatenate([push.real, push.imag[:, pair]], axis=1)
    # modulation matrix u = D y at the nodes: node i, element j reads displacement j (and velocity j)
    D = np.zeros((S, s, m, s, mo))
    i, j = np.arange(s)[:, None], np.arange(m)[None, :]
    D[:, i, j, i, j] = stiffness.transpose(1, 2, 0)
    if mo > m:
        D[:, i, j, i, j + m] = damping.transpose(1, 2, 0)
    modulation = D.reshape(S, s * m, s * mo)
    response = modulation @ np.linalg.inv(np.eye(s * mo) + kernel[which] @ modulation)
    kick = real_push[which] @ response
    E = np.exp(h[:, None] * poles)
    total = np.eye(len(poles) + int(pair.sum()))
    for step, duration in enumerate(which):
        total = _turned(E[duration], pair, total) - kick[step] @ (real_observe[duration] @ total)
    return total


def _columns(C: ComplexArray, pair: np.ndarray) -> Array:
    """Real output matrix on (real modes and real parts, imaginary parts): Re(C z) = Re C x - Im C y."""
    return np.concatenate([C.real, -C.imag[..., pair]], axis=-1)


def _turned(E: ComplexArray, pair: np.ndarray, R: Array) -> Array:
    """E z for real rows R of z: real modes and real parts first, then the imaginary parts of the pairs."""
    q = len(E)
    out = np.concatenate([E.real, E.real[pair]])[:, None] * R
    out[:q][pair] -= E.imag[pair, None] * R[q:]
    out[q:] += E.imag[pair, None] * R[:q][pair]
    return out
