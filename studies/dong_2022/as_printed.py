"""Equations (21) to (31) of the paper with each of its errors as a switch, for symmetric halves.

The paper's states are the translations and the gaps. With D = Delta + e and the mesh force F = k(tau) f(Delta) +
2 zeta Delta', all scaled as in `DoubleHelicalPair`, one half obeys

    m_y y'' + c_y y' + k_y y = -u_y F                                    y: x, y, z, tilts of pinion and wheel
    D'' = sum_y n_y y'' - c_b^2 F + F_0      (masses over m_c)           tilts: n y'' = -n (u F + s (c y' + k y)) / m

n_y are the factors of (16). Correct is u = n, s = 1. Without errors these are the symmetric motions of the 24
coordinates. The errors (`ERRORS`) and how each is read:

* z_sign: (21), (22) drive z with +F s_b on the pinion, -F s_b on the wheel: u_z = -n_z. Work is not conserved.
* same_hand: (23), (24), (26) repeat the signs of the left half, so that z_L = z_R: the shaft does not hold the thrust
  of the pinion, which runs away axially; its z is eliminated by z'' = -u F / m, the gap may still be periodic.
* no_tilts: (31) has no tilts, which (25) needs: their supports are left out of the gap equation, s = 0.
* theta_unscaled: (25) divides all but the tilts by b_c: s = b_c in metres. As good as no_tilts.
* leading_one: (29) begins with 1, a constant acceleration of the error; here as the load F_0 + 1, for (29) read as the
  forcing, as in the default reading. leading_minus_one: with the minus of (25) before it, F_0 - 1.
* eps_in_error: (29) multiplies e_l by eps_l.

Errors of the relative rotations gamma, which symmetric motions do not have (`antisymmetric`):

* shaft_r2: (25), (26) have r^2 before the torsion of the shafts, though gamma already contains r.
* mesh_r1: (27) has r instead of r^2 before the mesh force.
* undefined: (27) has -k_t r (Delta_pL - Delta_pR), both never defined, where 2 k_t gamma is right. With r in metres
  kept they are read as gamma and -gamma; undefined_half: as the rotations r theta / b_c, so that their difference is
  gamma; undefined_zero: as one and the same, so that they cancel and nothing holds gamma but the mesh.

The torque terms of (27), which lack a factor r, cancel for equal halves. (21) to (24) print k Delta without f: read
as f. (25) divides k by m_c omega_n^2 although (28) is scaled already: read as scaled once, see `printed_errors`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import cos

import numpy as np
from scipy.linalg import eigvals

import hbgear as hb
from hbgear.common.arrays import Array

ERRORS = ("z_sign", "same_hand", "no_tilts", "theta_unscaled", "leading_one", "leading_minus_one", "eps_in_error")
"""Errors that symmetric motions feel."""
TWISTS = ("shaft_r2", "mesh_r1", "undefined", "undefined_half", "undefined_zero")
"""Errors that only antisymmetric motions feel; the last three are readings of one of them."""

_PINION, _WHEEL = slice(0, 5), slice(6, 11)
_OWN = np.r_[_PINION, _WHEEL]
_Z, _TILTS = np.array([2, 7]), np.array([3, 4, 8, 9])


@dataclass(frozen=True)
class Half:
    """One half: (10,) inertia, damper, stiffness, factors n in the gap and u of the force; all dimensionless.

    Order: x, y, z, theta_x, theta_y of the pinion, then of the wheel.
    """

    m: Array
    c: Array
    k: Array
    n: Array
    u: Array


def half(pair: hb.gears.DoubleHelicalPair, errors: Collection[str], parity: int = 1) -> Half:
    """The supports and factors of the left half, the right one moving alike (+1) or opposite (-1).

    Raises
    ------
    ValueError
        If an error is not known.
    """
    unknown = set(errors) - set(ERRORS) - set(TWISTS)
    if unknown:
        raise ValueError(f"no such error: {', '.join(sorted(unknown))}; there are {', '.join(ERRORS + TWISTS)}")
    system = pair.system()
    # opposite hands: alike means mirrored, so that z and the tilts have the other sign on the right
    hand = np.ones(10)
    if "same_hand" not in errors:
        hand[[2, 3, 4, 7, 8, 9]] = -1
    m, c, k = (
        np.diag(A[:12, :12])[_OWN] + parity * hand * np.diag(A[:12, 12:])[_OWN] for A in (system.M, system.C, system.K)
    )
    n = np.asarray(system.elements[0].direction)[_OWN]
    u = n.copy()
    if "z_sign" in errors:
        u[_Z] *= -1
    small = 1e-12 * np.diag(system.K).max()
    return Half(m, np.where(np.abs(k) < small, 0.0, c), np.where(np.abs(k) < small, 0.0, k), n, u)


def _tilt_support(pair: hb.gears.DoubleHelicalPair, errors: Collection[str]) -> float:
    """The factor s of the tilt supports in the gap equation."""
    return 0.0 if "no_tilts" in errors else pair.b_c if "theta_unscaled" in errors else 1.0


def _shaft_factor(r: float, errors: Collection[str]) -> float:
    """Factor of the torsion of a shaft in the equation of its gamma, 2 if it is right."""
    factors = {"undefined": 2 * r, "undefined_half": r, "undefined_zero": 0.0}
    return next((factor for name, factor in factors.items() if name in errors), 2.0)


def _matrices(h: Half, s: float, c_b: float) -> tuple[Array, Array, Array, Array]:
    """M, C, K and force vector v of M q'' + C q' + K q + v F = load, q = (held coordinates, D)."""
    tilt = np.isin(np.arange(10), _TILTS)
    held = np.flatnonzero((h.k > 0) & ~(tilt & (s == 0)))
    N, gap = len(held) + 1, len(held)
    M, C, K, v = np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros(N)
    for A, values in ((M, h.m), (C, h.c), (K, h.k)):
        A[range(gap), range(gap)] = values[held]
    v[:gap] = h.u[held]
    M[gap, gap], v[gap] = 1.0, c_b**2
    for i in range(10):
        at = np.flatnonzero(held == i)
        if tilt[i] or not at.size:  # (25) has tilts substituted; what nothing holds is eliminated
            v[gap] += h.n[i] * h.u[i] / h.m[i]
            C[gap, at], K[gap, at] = s * h.n[i] * h.c[i] / h.m[i], s * h.n[i] * h.k[i] / h.m[i]
        else:
            M[gap, at] = -h.n[i]
    return M, C, K, v


def symmetric(errors: Collection[str] = (), pair: hb.gears.DoubleHelicalPair | None = None) -> hb.System:
    """The half pair with these errors as a system of one gap; Omega and d as in `DoubleHelicalPair`.

    Its element needs the force to act along the direction that measures the gap, here D alone. Rows are combined for
    it, T M q'' + ... with T v = (0, ..., 0, 1), which changes no solution.

    Raises
    ------
    ValueError
        If an error is not known.
    """
    pair = pair or hb.gears.DoubleHelicalPair()
    M, C, K, v = _matrices(half(pair, errors), _tilt_support(pair, errors), cos(pair.beta_mesh))
    N = len(v)
    T = np.eye(N)
    T[:, -1] -= v / v[-1]
    T[-1, -1] = 1 / v[-1]
    full = pair.system()
    original = full.elements[0]
    direction = np.zeros(N)
    direction[-1] = 1.0
    # torque on both gears, in the gap equation: c_b T / r_p over m_c in units of b_c omega_n^2
    (load,) = full.loads
    torque = float(np.asarray(load.constant)[5]) * cos(pair.beta_mesh)
    extra = ("leading_one" in errors) * 1.0 - ("leading_minus_one" in errors) * 1.0
    row = np.zeros(N)
    row[-1] = torque + extra
    if "eps_in_error" in errors:
        pair = pair.replace(e=tuple(a * b for a, b in zip(pair.e, pair.eps, strict=False)))
    element = hb.Element(direction, original.law, pair.transmission_error, original.damping, "gap")
    return hb.System(T @ M, T @ C, T @ K, [element], hb.Load(T @ row))


def antisymmetric(errors: Collection[str] = (), pair: hb.gears.DoubleHelicalPair | None = None) -> np.ndarray:
    """Eigenvalues (over omega_n) of opposite motions of the halves, linear with the mean mesh closed.

    States: translations and tilts, the gap Delta, and gamma of pinion and wheel. What is one too many with them is made
    up for by the axial motion of the pinion, which no spring holds and which is eliminated; where the shaft does hold
    it (same_hand) two eigenvalues at zero are left over.
    """
    pair = pair or hb.gears.DoubleHelicalPair()
    c_b = cos(pair.beta_mesh)
    M, C, K, v = _matrices(half(pair, errors, parity=-1), _tilt_support(pair, errors), c_b)
    g, N = len(v) - 1, len(v) + 2
    Ma, Ca, Ka = np.eye(N), np.zeros((N, N)), np.zeros((N, N))
    Ma[: g + 1, : g + 1], Ca[: g + 1, : g + 1], Ka[: g + 1, : g + 1] = M, C, K
    Ka[: g + 1, g] += v
    Ca[: g + 1, g] += 2 * pair.zeta * v
    full = pair.system()
    for i, (theta, sign, r) in enumerate(((5, 1.0, pair.r_p), (11, -1.0, pair.r_g)), g + 1):
        m, c, k = full.M[theta, theta], -full.C[theta, theta + 12], -full.K[theta, theta + 12]
        gap = r**2 if "shaft_r2" in errors else 1.0
        Ca[g, i], Ka[g, i] = sign * gap * c_b * c / m, sign * gap * c_b * k / m
        own = _shaft_factor(r, errors)
        Ca[i, i], Ka[i, i] = own * c / m, own * k / m
        mesh = sign * 2 * c_b / m / (r if "mesh_r1" in errors else 1.0)
        Ca[i, g], Ka[i, g] = 2 * pair.zeta * mesh, mesh
    A = np.linalg.solve(Ma, np.hstack([-Ka, -Ca]))
    return eigvals(np.vstack([np.hstack([np.zeros((N, N)), np.eye(N)]), A]))
