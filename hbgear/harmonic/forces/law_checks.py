"""Checks of laws, once when a problem is made: what ``force`` returns, and whether its derivatives are those of p.

    dp/dd ~ (p(d + h) - p(d - h)) / 2h,   with h and h/2: where the two differ, p has a corner, and nothing is said

A wrong derivative makes Newton's method slow, or fail after thousands of points, and the stability wrong, unnoticed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import Law, springs_of
from hbgear.mechanics.models import System
from hbgear.mechanics.reference_stiffness import at_rest, bend, references

_PLACES = np.array([-2.3, -1.1, -0.37, -0.05, 0.0, 0.11, 0.41, 0.9, 1.7])
"""Displacements, over the length of a law, at which it is asked."""


_NEAR = 0.5  # times the length of a law, within which it must be finite


_STEP = 1e-5  # of differences, over the place


_SETTLED = 1e-4  # difference of two differences, relative, above which p is not smooth there


_WRONG = 1e-3  # error of a derivative, relative, that is no rounding


def check_laws(system: System) -> None:
    """Refuse laws of the user with wrong derivatives, or a force that is not finite, and motions that nothing holds.

    Raises
    ------
    ValueError
        If a law does not return three finite arrays, a derivative is not that of its force, or an element whose law has
        no stiffness measures a motion that K does not hold either: the mean of that motion is arbitrary.
    """
    own = [[law for law in element.law.parts if springs_of(law) is None] for element in system.elements]
    for laws in own:
        for law in laws:
            asked(law, np.zeros(3), np.zeros(3), np.array([0.0, 1.0, 2.0]))
    if not any(own) and all(_is_stiff(element.law) for element in system.elements):
        return
    springs = references(system)
    for element, laws, stiffness in zip(system.elements, own, springs.tolist(), strict=True):
        w, mass = np.asarray(element.direction), np.abs(system.M.diagonal())
        mobility = float(np.sum(np.divide(w**2, mass, out=np.zeros(len(w)), where=mass > 0)))
        for law in laws:
            length = float(max(np.abs(law.breakpoints), default=0.0) or bend(law, stiffness))
            check_law(law, length or element.displacement.bound or 1.0, float(np.sqrt(stiffness * mobility)) or 1.0)
    _check_held(system, springs)


_LARGEST = 300  # coordinates up to which motions that nothing holds are looked for


def _check_held(system: System, springs: Array) -> None:
    """Refuse an element without stiffness that measures a free motion of the structure."""
    soft = np.array([not _is_stiff(element.law) for element in system.elements])
    if not soft.any() or system.n > _LARGEST or system.speed is not None or system.receptances is not None:
        return
    W, K = system.W, system.K if isinstance(system.K, np.ndarray) else system.K.toarray()
    s = 1.0 / np.sqrt(np.abs(system.M.diagonal()))
    held = K + (W * np.where(soft, 0.0, springs)) @ W.T
    free = s[:, None] * scipy.linalg.null_space(held * np.outer(s, s), rcond=_FREE)
    felt = np.abs(W.T @ free)
    rounding = _MEASURED * np.linalg.norm(W.T * s, axis=1)[:, None]
    measured = (felt > _FELT * (np.abs(W).T @ np.abs(free))) & (felt > rounding) & soft[:, None]
    if measured.any():
        j, r = np.unravel_index(int(np.argmax(measured)), measured.shape)
        motion = free[:, r] / free[np.argmax(np.abs(free[:, r])), r]
        words = ", ".join(f"{system.dof_names[i]} = {motion[i]:.3g}" for i in np.argsort(-np.abs(motion))[:6])
        name = system.elements[int(j)].name
        raise ValueError(
            f"element '{name}' measures a motion that no stiffness holds ({words}), and its law "
            "has none (dp/dd = 0): the mean of that motion is arbitrary; support it in K, or give the law a stiffness"
        )


_FREE = 1e-12  # stiffness over mass, relative to the largest, that is none


_FELT = 1e-5  # share of a free motion that an element measures and that is no rounding of it


_MEASURED = 1e-9  # displacement in a unit motion over its largest possible, below which it is rounding of the motion


def _is_stiff(law: Law) -> bool:
    """Whether dp/dd is not zero everywhere."""
    known = springs_of(law)
    if known is not None:
        springs, k1, k3 = known
        return bool(k1 or k3 or any(any(spring.slopes) for spring in springs))
    d = np.logspace(-12.0, 12.0, 97)
    at = np.concatenate([d, -d])
    if np.any(np.nan_to_num(at_rest(law, at)[1])):
        return True
    still, phases = np.zeros(3), np.array([0.0, 1.1, 4.0])  # a stiffness that varies may be zero at phase 0
    return bool(np.any(asked(law, still, still, phases)[1]))


def check_law(law: Law, length: float, rate: float) -> None:
    """Refuse a law whose derivatives are not those of its force.

    Parameters
    ----------
    law : to be asked.
    length : of the motions at which it is asked.
    rate : velocity over displacement of these motions [1 / time].

    Raises
    ------
    ValueError
        If it does not return three finite arrays, or a derivative is wrong.

    Examples
    --------
    >>> import hbgear as hb
    >>> check_law(hb.Cubic(k3=2.0), length=1.0, rate=1.0)
    """
    name = type(law).__name__
    x, y, tau = (part.ravel() for part in np.meshgrid(_PLACES, _PLACES[::2], [0.0, 1.1, 4.0], indexing="ij"))
    near = np.abs(x) <= _NEAR
    for size in (1.0, 0.03):  # some laws bend much closer to the origin in one direction than in the other
        d, v = size * length * x, size * length * rate * y
        p, *slopes = asked(law, d, v, tau)
        for part, words in zip((p, *slopes), ("p", "dp/dd", "dp/dv"), strict=True):
            if not np.isfinite(part[near]).all():
                i = int(np.flatnonzero(near & ~np.isfinite(part))[0])
                raise ValueError(
                    f"{name}.force gives {words} = {part[i]} at {_place(d[i], v[i], tau[i])}; it must be finite for "
                    "every motion: see roots and divisions in it"
                )
        _check_slope(law, (d, v, tau), 0, slopes[0], _STEP * length)
        if law.rated:
            _check_slope(law, (d, v, tau), 1, slopes[1], _STEP * length * rate)


def _check_slope(law: Law, at: Sequence[Array], which: int, stated: Array, step: float) -> None:
    """Compare dp/dd (which = 0) or dp/dv (1) with differences of p at places (d, v, tau)."""
    coarse, fine = (_difference(law, at, which, h) for h in (step, 0.5 * step))
    p = np.abs(asked(law, *at)[0])
    rounding = 1e3 * np.finfo(float).eps * (p + np.abs(np.asarray(at[which]) * stated)) / step
    size = np.maximum(np.abs(stated), np.abs(fine))
    smooth = np.abs(coarse - fine) <= _SETTLED * np.abs(fine) + rounding
    wrong = np.flatnonzero(smooth & (np.abs(fine - stated) > _WRONG * size + rounding))
    if wrong.size:
        i = int(wrong[np.argmax(np.abs(fine - stated)[wrong])])
        words, number = (("dp/dd", "second"), ("dp/dv", "third"))[which]
        raise ValueError(
            f"{type(law).__name__}.force gives {words} = {stated[i]:.6g} at {_place(*(x[i] for x in at))}, where "
            f"differences of p give {fine[i]:.6g}: correct the {number} array that it returns"
        )


def _difference(law: Law, at: Sequence[Array], which: int, h: float) -> Array:
    shift = [h if i == which else 0.0 for i in range(2)]
    d, v, tau = at
    ahead, behind = (asked(law, d + side * shift[0], v + side * shift[1], tau)[0] for side in (1, -1))
    slope: Array = (ahead - behind) / (2 * h)
    return slope


def _place(d: float, v: float, tau: float) -> str:
    return f"d = {d:.4g}, v = {v:.4g}, tau = {tau:.4g}"


def asked(law: Law, d: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
    """``law.force`` at arrays of one shape.

    Raises
    ------
    ValueError
        If it does not return three arrays of that shape.
    """
    with np.errstate(all="ignore"):
        found = law.force(d, v, tau)
    check_returned(law, found, np.shape(d))
    p, stiffness, damping = (np.asarray(part, dtype=float) for part in found)
    return p, stiffness, damping


def check_returned(law: Law, found: Any, shape: tuple[int, ...]) -> None:
    """Raise an error unless a law returned three arrays of a shape."""
    required = (
        f"{type(law).__name__}.force must return three arrays, (p, dp/dd, dp/dv), each of the shape of d, {shape}"
    )
    if not isinstance(found, tuple | list):
        what = f"one array of shape {np.shape(found)}" if isinstance(found, np.ndarray) else f"{type(found).__name__}"
        raise ValueError(f"{required}; it returned {what}: add the derivatives, zeros where there are none")
    if len(found) != 3:
        raise ValueError(f"{required}; it returned {len(found)}: add the derivatives, zeros where there are none")
    if [np.shape(part) for part in found] != 3 * [shape]:
        got = ", ".join(str(np.shape(part)) for part in found)
        raise ValueError(f"{required}; got {got}: for a constant c give np.full_like(d, c)")
