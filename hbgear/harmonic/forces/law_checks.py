"""Checks of laws when a problem is created: the arrays that ``force`` returns, and its derivatives dp/dd and dp/dv.

    dp/dd ~ (p(d + h) - p(d - h)) / 2h,   with h and h/2; no check if both differ, because p has a breakpoint

No check at d = 0 either, where the differences agree at the breakpoint of a contact without a gap.

A wrong derivative slows Newton's method down or makes it fail after many points, and the stability is wrong without a
warning.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.friction import RigidFriction
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.mesh_contacts import moving_springs_of
from hbgear.mechanics.laws.vector_laws import VectorLaw, vector_groups
from hbgear.mechanics.models import System
from hbgear.mechanics.reference_stiffness import at_rest, bend, references

_DISPLACEMENTS = np.array([-2.3, -1.1, -0.37, -0.05, 0.0, 0.11, 0.41, 0.9, 1.7])
"""Displacements, over the length of a law, at which it is evaluated."""

_FINITE_RANGE = 0.5
"""Displacement, over the length of a law, up to which force and slopes must be finite."""

_LAW_STEP = 1e-5
"""Step of the differences, over the length of a law."""

_SMOOTHNESS_TOLERANCE = 1e-4
"""Relative difference of the slopes with steps h and h/2 above which p counts as not differentiable."""

_SLOPE_TOLERANCE = 1e-3
"""Relative error of a derivative above which it is rejected."""


def check_laws(system: System) -> None:
    """Raise an error for laws with wrong derivatives or forces that are not finite, and for unsupported motions.

    Raises
    ------
    ValueError
        If a law does not return three finite arrays, a derivative differs from differences of the force, friction is
        rigid, friction or a damped contact acts on a displacement with breakpoints, or an element whose law has no
        stiffness measures a free motion of the structure, so that the mean of it is arbitrary.
    """
    for element in system.elements:
        if any(isinstance(part, RigidFriction) for part in element.law.parts):
            raise ValueError(
                f"element '{element.name}' has rigid friction, whose force jumps to an unknown value where it sticks: "
                "a series does not represent it. Use hb.mechanics.Coulomb(limit, k) or Jenkins, or integrate the model "
                "with hb.time.integrate or hb.time.shoot"
            )
        if element.law.sliders and element.displacement.corners:
            raise ValueError(
                f"element '{element.name}' has friction and a prescribed displacement with breakpoints, a Periodic; "
                "give the displacement as a Series"
            )
        if any(slider.normal for slider in element.law.sliders) and any(other.law.damped for other in system.elements):
            raise ValueError(
                f"element '{element.name}' has friction proportional to a normal force, and another element a contact "
                "with a damper whose force jumps: stability of both together is not available; use Unilateral or "
                "HuntCrossley instead of KelvinVoigt"
            )
        if element.law.damped and element.displacement.corners:
            raise ValueError(
                f"element '{element.name}' has a contact with a damper and a prescribed displacement with breakpoints, "
                "a Periodic; give the displacement as a Series"
            )
    for rows, vector_law in vector_groups([element.law for element in system.elements]):
        check_vector_law(vector_law, max(float(system.elements[j].displacement.bound) for j in rows) or 1.0)
    user_laws = [[law for law in element.law.parts if moving_springs_of(law) is None] for element in system.elements]
    for laws in user_laws:
        for law in laws:
            evaluate_force(law, np.zeros(3), np.zeros(3), np.array([0.0, 1.0, 2.0]))
    if not any(user_laws) and all(_is_stiff(element.law) for element in system.elements):
        return
    springs = references(system)
    for element, laws, stiffness in zip(system.elements, user_laws, springs.tolist(), strict=True):
        w, mass = np.asarray(element.direction), np.abs(system.M.diagonal())
        mobility = float(np.sum(np.divide(w**2, mass, out=np.zeros(len(w)), where=mass > 0)))
        for law in laws:
            length = float(max(np.abs(law.breakpoints), default=0.0) or bend(law, stiffness))
            check_law(law, length or element.displacement.bound or 1.0, float(np.sqrt(stiffness * mobility)) or 1.0)
    _check_supported(system, springs)


def check_vector_law(law: VectorLaw, length: float) -> None:
    """Raise ValueError for a vector law with wrong shapes or numbers, or derivatives that differ from differences.

    It is evaluated at displacements of the size ``length``.

    Examples
    --------
    >>> import hbgear as hb
    >>> check_vector_law(hb.mechanics.RadialClearance(k=2.0, clearance=0.1), length=1.0)
    """
    p, name, N = law.size, type(law).__name__, 16
    random = np.random.default_rng(0)
    state, tau = length * random.uniform(-1.5, 1.5, (2, p, N)), random.uniform(0, 2 * np.pi, N)
    returned = law.force(state[0], state[1], tau)
    shapes = [np.shape(part) for part in returned] if isinstance(returned, tuple | list) else [np.shape(returned)]
    if shapes != [(p, N), (p, p, N), (p, p, N)]:
        raise ValueError(
            f"{name}.force must return (p, dp/dd, dp/dv) of shapes {(p, N)}, {(p, p, N)}, {(p, p, N)} for {p} "
            f"displacements at {N} instants; it returned {', '.join(map(str, shapes))}"
        )
    if not all(np.isfinite(part).all() for part in returned):
        raise ValueError(f"{name}.force gives a number that is not finite: check roots and divisions in it")
    for axis, label in enumerate(("dp/dd", "dp/dv")):
        stated = np.asarray(returned[1 + axis])
        coarse, fine = (_vector_differences(law, state, tau, axis, h * length) for h in (_LAW_STEP, 0.5 * _LAW_STEP))
        size = np.abs(stated).max() + np.abs(returned[0]).max() / length
        smooth = np.abs(coarse - fine) <= _SMOOTHNESS_TOLERANCE * size
        wrong = np.argwhere(smooth & (np.abs(fine - stated) > _SLOPE_TOLERANCE * size))
        if len(wrong):
            i, j, n = wrong[0].tolist()
            raise ValueError(
                f"{name}.force gives {label}[{i}, {j}] = {stated[i, j, n]:.6g} at d = {state[0, :, n]}, where "
                f"differences of p give {fine[i, j, n]:.6g}: correct the array; its first axis is the force"
            )


def _vector_differences(law: VectorLaw, state: Array, tau: Array, axis: int, h: float) -> Array:
    """Return central differences (p, p, N) of a vector law in d (axis = 0) or v (axis = 1)."""
    columns = []
    for j in range(law.size):
        above, below = state.copy(), state.copy()
        above[axis, j] += h
        below[axis, j] -= h
        columns.append((law.force(above[0], above[1], tau)[0] - law.force(below[0], below[1], tau)[0]) / (2 * h))
    return np.stack(columns, axis=1)


_MAX_COORDINATES_CHECKED = 300
"""Number of coordinates up to which unsupported motions are searched, because the null space costs O(n^3)."""


def _check_supported(system: System, springs: Array) -> None:
    """Raise an error if an element without stiffness measures a free motion of the structure."""
    soft = np.array([not _is_stiff(element.law) for element in system.elements])
    if (
        not soft.any()
        or system.n > _MAX_COORDINATES_CHECKED
        or system.speed is not None
        or system.receptances is not None
    ):
        return
    W, K = system.W, system.K if isinstance(system.K, np.ndarray) else system.K.toarray()
    mass = np.abs(system.M.diagonal())
    s = 1.0 / np.sqrt(np.where(mass > 0, mass, mass.max() or 1.0))
    supported = K + (W * np.where(soft, 0.0, springs)) @ W.T
    free = s[:, None] * scipy.linalg.null_space(supported * np.outer(s, s), rcond=_FREE_MOTION_TOLERANCE)
    displacement = np.abs(W.T @ free)
    rounding = _MIN_DISPLACEMENT_RATIO * np.linalg.norm(W.T * s, axis=1)[:, None]
    measured = (
        (displacement > _CANCELLATION_RATIO * (np.abs(W).T @ np.abs(free))) & (displacement > rounding) & soft[:, None]
    )
    if measured.any():
        j, r = np.unravel_index(int(np.argmax(measured)), measured.shape)
        motion = free[:, r] / free[np.argmax(np.abs(free[:, r])), r]
        words = ", ".join(f"{system.dof_names[i]} = {motion[i]:.3g}" for i in np.argsort(-np.abs(motion))[:6])
        name = system.elements[int(j)].name
        raise ValueError(
            f"element '{name}' measures a motion that no stiffness holds ({words}), and its law "
            "has none (dp/dd = 0): the mean of that motion is arbitrary; support it in K, or give the law a stiffness"
        )


_FREE_MOTION_TOLERANCE = 1e-12
"""Stiffness over mass, relative to the largest, up to which a motion counts as free."""

_CANCELLATION_RATIO = 1e-5
"""Displacement of an element, relative to the sum of its absolute terms, above which the terms do not cancel."""

_MIN_DISPLACEMENT_RATIO = 1e-9
"""Displacement of an element in a unit motion, relative to the largest possible, that counts as rounding."""


def _is_stiff(law: Law) -> bool:
    """Return whether dp/dd is not zero everywhere."""
    split_law = moving_springs_of(law)
    if split_law is not None:
        springs, k1, k3 = split_law
        return bool(k1 or k3 or any(any(spring.spring.slopes) for spring in springs))
    d = np.logspace(-12.0, 12.0, 97)
    displacements = np.concatenate([d, -d])
    if np.any(np.nan_to_num(at_rest(law, displacements)[1])):
        return True
    zeros, phases = np.zeros(3), np.array([0.0, 1.1, 4.0])  # a stiffness that varies may be zero at phase 0
    return bool(np.any(evaluate_force(law, zeros, zeros, phases)[1]))


_NEGLIGIBLE_SLOPE_RATIO = 1e-10
"""Slope, over the typical one, that is not checked [-]: in tails of smooth laws it is rounding, as in 1 + tanh(-20)."""


def check_law(law: Law, length: float, rate: float) -> None:
    """Raise ValueError for a law without three finite arrays, or with derivatives that differ from differences.

    It is evaluated at displacements of the size ``length`` and velocities of ``rate`` times this size.

    Examples
    --------
    >>> import hbgear as hb
    >>> check_law(hb.Cubic(k3=2.0), length=1.0, rate=1.0)
    """
    name = type(law).__name__
    x, y, tau = (
        part.ravel() for part in np.meshgrid(_DISPLACEMENTS, _DISPLACEMENTS[::2], [0.0, 1.1, 4.0], indexing="ij")
    )
    is_near = np.abs(x) <= _FINITE_RANGE
    for size in (1.0, 0.03):  # some laws bend much closer to the origin in one direction than in the other
        d, v = size * length * x, size * length * rate * y
        p, *slopes = evaluate_force(law, d, v, tau)
        for part, label in zip((p, *slopes), ("p", "dp/dd", "dp/dv"), strict=True):
            if not np.isfinite(part[is_near]).all():
                i = int(np.flatnonzero(is_near & ~np.isfinite(part))[0])
                raise ValueError(
                    f"{name}.force gives {label} = {part[i]} at {_state_text(d[i], v[i], tau[i])}; it must be "
                    "finite for every motion: check roots and divisions in it"
                )
        _check_slope(law, (d, v, tau), 0, slopes[0], _LAW_STEP * length)
        if law.rated:
            _check_slope(law, (d, v, tau), 1, slopes[1], _LAW_STEP * length * rate)


def _check_slope(law: Law, state: Sequence[Array], axis: int, stated: Array, step: float) -> None:
    """Compare dp/dd (axis = 0) or dp/dv (axis = 1) with differences of p at states (d, v, tau)."""
    coarse, fine = (_difference(law, state, axis, h) for h in (step, 0.5 * step))
    p = np.abs(evaluate_force(law, *state)[0])
    rounding = 1e3 * np.finfo(float).eps * (p + np.abs(np.asarray(state[axis]) * stated)) / step
    typical = abs(law.reference) if axis == 0 else 0.0
    rounding += _NEGLIGIBLE_SLOPE_RATIO * max(typical, float(np.abs(stated).max()))
    size = np.maximum(np.abs(stated), np.abs(fine))
    smooth = np.abs(coarse - fine) <= _SMOOTHNESS_TOLERANCE * np.abs(fine) + rounding
    smooth &= np.asarray(state[axis]) != 0
    wrong = np.flatnonzero(smooth & (np.abs(fine - stated) > _SLOPE_TOLERANCE * size + rounding))
    if wrong.size:
        i = int(wrong[np.argmax(np.abs(fine - stated)[wrong])])
        label, number = (("dp/dd", "second"), ("dp/dv", "third"))[axis]
        raise ValueError(
            f"{type(law).__name__}.force gives {label} = {stated[i]:.6g} at {_state_text(*(x[i] for x in state))}, "
            f"where differences of p give {fine[i]:.6g}: correct the {number} array that it returns"
        )


def _difference(law: Law, state: Sequence[Array], axis: int, h: float) -> Array:
    """Return the central difference of p in d (axis = 0) or v (axis = 1) with step h."""
    shift = [h if i == axis else 0.0 for i in range(2)]
    d, v, tau = state
    above, below = (evaluate_force(law, d + side * shift[0], v + side * shift[1], tau)[0] for side in (1, -1))
    return (above - below) / (2 * h)


def _state_text(d: float, v: float, tau: float) -> str:
    """Return a state as text for messages."""
    return f"d = {d:.4g}, v = {v:.4g}, tau = {tau:.4g}"


def evaluate_force(law: Law, d: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Return ``law.force`` at arrays of one shape.

    Raises
    ------
    ValueError
        If the law does not return three arrays of this shape.
    """
    with np.errstate(all="ignore"):
        returned = law.force(d, v, tau)
    check_returned(law, returned, np.shape(d))
    p, stiffness, damping = (np.asarray(part, dtype=float) for part in returned)
    return p, stiffness, damping


def check_returned(law: Law, returned: Any, shape: tuple[int, ...]) -> None:
    """Raise an error unless a law returned three arrays of the required shape."""
    required = (
        f"{type(law).__name__}.force must return three arrays, (p, dp/dd, dp/dv), each of the shape of d, {shape}"
    )
    if not isinstance(returned, tuple | list):
        kind = (
            f"one array of shape {np.shape(returned)}"
            if isinstance(returned, np.ndarray)
            else f"{type(returned).__name__}"
        )
        raise ValueError(f"{required}; it returned {kind}: add the derivatives, zeros where there are none")
    if len(returned) != 3:
        raise ValueError(f"{required}; it returned {len(returned)}: add the derivatives, zeros where there are none")
    if [np.shape(part) for part in returned] != 3 * [shape]:
        shapes = ", ".join(str(np.shape(part)) for part in returned)
        raise ValueError(f"{required}; got {shapes}: for a constant c give np.full_like(d, c)")
