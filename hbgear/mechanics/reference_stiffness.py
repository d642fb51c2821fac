"""Reference stiffness of elements: springs that close a structure and cancel in every result.

    k_j = reference of the law;   or, if the law states none,   |1 / (w_j^T K^-1 w_j)|,   p_j(L) / L

They only condition the linear algebra. A law such as k3 d^3 has no stiffness: a coefficient in N/m^3 is not one. The
stiffness of the structure in the direction of the element has the right order of magnitude in any units. Where no
spring holds the element, the secant stiffness of the law is used, at the length L at which the law balances the load,
or at the length of its prescribed displacement.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.models import System

_MAX_STATIC_RESIDUAL = 1e-6
"""Residual of a static solution, relative to the load [-], above which K counts as singular."""

_NEGATIVE_STIFFNESS_FACTOR = 2.0
"""Reference stiffness over the modulus of a negative structural stiffness [-]; with 1 the sum K + k is singular."""

_MIN_STATIC_LOAD = 1e-11
"""Load over the sum of the moduli of the terms of K x [-], below which K counts as singular."""


def references(system: System, fraction: float = 1.0) -> Array:
    """Return the reference stiffness (m,) of the elements of a system [force / length], which is not negative.

    It is a fraction of the stiffness of the structure for laws that state none.

    Examples
    --------
    >>> import hbgear as hb
    >>> beam = hb.System([[1e-11]], [[0.0]], [[2.0]], [hb.Element([1.0], hb.Cubic(k3=1e12))])
    >>> references(beam).tolist()
    [2.0]
    """
    stiffness = np.array([abs(element.law.reference) for element in system.elements])
    unknown = np.flatnonzero(stiffness == 0)
    if unknown.size:
        stiffness[unknown] = _structural(system, stiffness, unknown, fraction)
        for j in np.flatnonzero(stiffness == 0):
            stiffness[j] = _secant_stiffness(system, int(j))
    return stiffness


def _structural(system: System, springs: Array, unknown: np.ndarray, fraction: float) -> Array:
    """Return ``fraction`` of the static stiffness of the structure with known springs; 0 for an unsupported element."""
    if isinstance(system.K, np.ndarray):
        K: Any = system.K + (system.W * springs) @ system.W.T
    else:
        W = scipy.sparse.csc_array(system.W)
        K = scipy.sparse.csc_array(system.K) + W @ scipy.sparse.diags_array(springs) @ W.T
    stiffness = np.zeros(len(unknown))
    for i, w in enumerate(system.W[:, unknown].T):
        x = _solved(K, w)
        compliance = 0.0 if x is None else float(w @ x)
        if compliance:
            stiffness[i] = fraction / compliance if compliance > 0 else -_NEGATIVE_STIFFNESS_FACTOR / compliance
    return stiffness


def _solved(K: Any, w: Array) -> Array | None:
    """Return K^-1 w, or None if K is singular."""
    with np.errstate(all="ignore"):
        try:
            x = np.linalg.solve(K, w) if isinstance(K, np.ndarray) else scipy.sparse.linalg.splu(K).solve(w)
        except (RuntimeError, np.linalg.LinAlgError):  # exactly singular
            return None
        size = abs(K) @ np.abs(x)
    is_solution = np.isfinite(x).all() and np.linalg.norm(K @ x - w) <= _MAX_STATIC_RESIDUAL * np.linalg.norm(w)
    return x if is_solution and np.linalg.norm(size) <= np.linalg.norm(w) / _MIN_STATIC_LOAD else None


def _secant_stiffness(system: System, j: int) -> float:
    """Return the secant stiffness of a law where it balances the loads, or at its prescribed displacement."""
    element = system.elements[j]
    w = np.asarray(element.direction)
    force = max((abs(float(w @ F)) / float(w @ w) for load in system.loads for F in load.vectors()), default=0.0)
    return secant(element.law, force, element.displacement.bound)


def secant(law: Law, force: float, length: float) -> float:
    """Return the secant stiffness |p(d)| / d of a law where |p| reaches a force, or else at a length; 0 without any.

    Examples
    --------
    >>> import hbgear as hb
    >>> round(secant(hb.Cubic(k3=1e12), 1e-6, 0.0))  # 1e-6 N at 1e-6 m
    1
    """
    d = np.logspace(-60.0, 60.0, 2401)
    p = np.abs(at_rest(law, d)[0])
    reached = np.flatnonzero((p >= force) & np.isfinite(p)) if force > 0 else np.empty(0, dtype=int)
    index = int(reached[0]) if reached.size else int(np.searchsorted(d, length)) if length > 0 else -1
    return float(p[index] / d[index]) if 0 <= index < len(d) and np.isfinite(p[index]) else 0.0


def bend(law: Law, stiffness: float) -> float:
    """Return the smallest |d| at which dp/dd has changed by a stiffness; 0 if it changes nowhere, or jumps at d = 0.

    Examples
    --------
    >>> import hbgear as hb
    >>> round(bend(hb.Cubic(k3=1e12), 3.0) * 1e6, 2)  # 3 k3 d^2 = 3
    1.0
    """
    d = np.logspace(-60.0, 60.0, 2401)
    slope = at_rest(law, np.concatenate([[0.0], d, -d]))[1]
    with np.errstate(all="ignore"):
        changed = np.abs(slope[1:] - slope[0]).reshape(2, -1).max(axis=0) >= stiffness
    return float(d[int(np.argmax(changed))]) if stiffness > 0 and changed.any() and not changed[0] else 0.0


def at_rest(law: Law, d: Array) -> tuple[Array, Array]:
    """Return p and dp/dd (k,) of a law at rest at any displacements d (k,); nan where the law raises an error."""
    try:
        with np.errstate(all="ignore"):
            p, slope = law.force(d, np.zeros_like(d), np.zeros_like(d))[:2]
            return np.asarray(p, dtype=float), np.asarray(slope, dtype=float)
    except Exception:  # any error of a law at large displacements
        if len(d) == 1:
            return np.full(1, np.nan), np.full(1, np.nan)
    order = np.argsort(np.abs(d), kind="stable")
    inner, outer = order[: len(d) // 2], order[len(d) // 2 :]
    out = np.full((2, len(d)), np.nan)
    out[:, inner] = at_rest(law, d[inner])
    if np.isfinite(out[:, inner]).any():
        out[:, outer] = at_rest(law, d[outer])
    return out[0], out[1]
