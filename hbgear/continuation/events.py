"""Special points of a solution curve: what they are, and how each is located.

LP  fold: dR/dX singular, the curve turns in the parameter (a jump); CP on a curve of folds.
    Newton on {R = 0, g = 0}, or a bracketed root of the tangent.
PD  a multiplier passes -1 (period doubling).
    Newton on {R = 0, g = 0} of the half-integer block, or a bracketed root of det(Phi + 1).
NS  a complex pair of multipliers passes the unit circle (Neimark-Sacker). Bracketed root of its modulus.
BP  two curves cross: det [J R_lambda; t^T] changes sign. Bracketed root of the determinant.
    Where a symmetric system has its multipliers in pairs, two pass +1 (BP) or -1 (PD) at once and no determinant
    changes sign: bracketed root of their modulus.
GR  an extremum of an element grazes a corner of its law: the impact regime changes.
    Newton on {R = 0, extremum = corner}, or a bracketed root.

The bracketed root runs along the arc between two rows, where every point is corrected onto the curve. Two points that
lie between the same two rows leave no change of sign there: where a test function seems to touch zero, the curve is
looked at more closely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.algebra import bordered
from hbgear.continuation.bordered import Augmented, Fold
from hbgear.continuation.branch import NEUTRAL
from hbgear.continuation.newton import NoConvergence, Settings, refine, solution_at, solve
from hbgear.continuation.problem import linearise
from hbgear.continuation.segment import Arc, Row, row_of
from hbgear.harmonic.special import Grazing, PeriodDoubling

MERGED = "merged"
"""Kind of the point at which a subharmonic branch ends; it is not a special point of its own."""


@dataclass(frozen=True)
class Found:
    """A special point found on an arc: kind, place s in [0, 1] on the chord, row, whether located, remark."""

    kind: str
    s: float
    row: Row
    located: bool
    note: str = ""


def find(arc: Arc, stability: bool) -> list[Found]:
    """All special points between the two rows of an arc, in the order in which the curve meets them."""
    a, b = arc.a, arc.b
    found: list[Found] = []
    turned = a.heading * b.heading < 0
    crossed = a.orientation != b.orientation
    if turned:
        found.append(_fold(arc))
    if crossed:
        found.append(_root(arc, "BP", _determinant(arc)))
    if stability:
        found += _stability_changes(arc, turned or crossed)
    found += _grazing(arc)
    return sorted(found, key=lambda f: f.s)


def suspects(rows: Sequence[Row], stability: bool) -> list[int]:
    """Numbers i of the pieces from rows[i] to rows[i + 1] on which `find` finds something."""
    heading, orientation = (np.array([getattr(row, name) for row in rows]) for name in ("heading", "orientation"))
    some = (heading[1:] * heading[:-1] < 0) | (orientation[1:] != orientation[:-1])
    unstable, f = _tests(rows, stability)
    some |= (unstable[1:] != unstable[:-1]) | (f[1:] * f[:-1] < 0).any(axis=1)
    return [int(i) for i in np.flatnonzero(some)]


def _tests(rows: Sequence[Row], stability: bool) -> tuple[np.ndarray, Array]:
    """Numbers of unstable multipliers, and functions that change sign at special points (rows, T), as far as known.

    The functions are det(Phi + 1) and the clearances.
    """
    unstable, columns = np.zeros(len(rows), dtype=int), [np.zeros((len(rows), 0))]
    mu, clearance = (_known([row.observed.get(name) for row in rows]) for name in ("multipliers", "clearance"))
    if stability and mu is not None:
        unstable, doubling = _verdicts(mu)
        columns.append(doubling[:, None])
    if clearance is not None:
        columns.append(clearance)
    return unstable, np.concatenate(columns, axis=1)


def _known(values: list[Any]) -> Any:
    """The values of all rows, nan of rows that could not be observed; None without any, or where numbers differ."""
    some = next((x for x in values if x is not None), None)
    if some is None or len({len(x) for x in values if x is not None}) > 1:  # a closed gap has no corners
        return None
    return np.array([np.full_like(some, np.nan) if x is None else x for x in values])


_SHALLOW = 0.25  # share of its least value among the rows below which a test function may cross zero between them


_TRIES = 3  # rows looked at there


def touching(rows: Sequence[Row], length: Array, stability: bool) -> dict[int, float]:
    """Pieces on which a test function of one sign at the rows may cross zero twice, with the place s on each.

    It does if the parabola through three rows, the pieces between them of the given lengths, comes close to zero.
    """
    _, f = _tests(rows, stability)
    before, here, after = f[:-2], f[1:-1], f[2:]
    h, k = length[:-1, None], length[1:, None]
    least = (before * here > 0) & (here * after > 0) & (np.abs(here) <= np.minimum(np.abs(before), np.abs(after)))
    rise, fall = (here - before) / h, (after - here) / k
    bend, slope = (fall - rise) / (h + k), (rise * k + fall * h) / (h + k)
    found: dict[int, float] = {}
    for i, j in np.argwhere(least & (bend * here > 0)):
        at = -0.5 * slope[i, j] / bend[i, j]
        if 1 + 0.5 * slope[i, j] * at / here[i, j] > _SHALLOW:
            continue
        piece, s = (int(i), 1 + at / h[i, 0]) if at < 0 else (int(i) + 1, at / k[i, 0])
        found.setdefault(piece, float(s))
    return found


def find_hidden(arc: Arc, s: float, stability: bool, observed: Callable[[Row], Row]) -> list[Found]:
    """Special points on a piece of the curve on which a test function seems to touch zero near s, if it does."""
    places, rows = [0.0, 1.0], [arc.a, arc.b]
    for _ in range(_TRIES):
        try:
            row = observed(arc.at(s))
        except (NoConvergence, np.linalg.LinAlgError):
            return []
        i = int(np.searchsorted(places, s))
        places.insert(i, s)
        rows.insert(i, row)
        pieces = suspects(rows, stability)
        if pieces:
            return [replace(point, s=places[i] + point.s * (places[i + 1] - places[i])) for i in pieces
                    for point in find(replace(arc, a=rows[i], b=rows[i + 1]), stability)]  # fmt: skip
        near = touching(rows, np.diff(places), stability)
        if not near:
            return []
        piece, share = next(iter(near.items()))
        s = places[piece] + share * (places[piece + 1] - places[piece])
    return []


def merge(arc: Arc) -> Found | None:
    """Where a subharmonic branch meets the one of shorter period: its subharmonic part passes zero and changes sign."""
    part = getattr(arc.problem, "subharmonic_part", None)
    if part is None:
        return None
    first, second = part(arc.a.solution.X), part(arc.b.solution.X)
    least = 1e-7 * float(np.linalg.norm(arc.a.solution.X))  # below it the part is rounding: a motion of shorter period
    if min(np.linalg.norm(first), np.linalg.norm(second)) <= least or float(first @ second) >= 0:
        return None
    rough = _root(arc, MERGED, lambda row: float(first @ part(row.solution.X)))
    try:
        return replace(rough, row=_at_doubling(arc, rough.row))
    except (NoConvergence, np.linalg.LinAlgError):
        return rough


def _at_doubling(arc: Arc, row: Row) -> Row:
    """The row moved to the period doubling of the shorter motion where the branch ends.

    With subharmonics of size a the equations hold the parameter to the tolerance over a, that is not at all.
    """
    problem = arc.problem
    if problem.nu % 2 or not problem.smooth:
        return row
    extended = PeriodDoubling(problem.with_order(problem.nu // 2), arc.name)
    shorter = extended.doubled.fitted(row.solution.X)[extended.even]
    here = {**arc.parameters, arc.name: row.value}
    solution = refine(extended, solve(extended, np.append(shorter, row.value), here), here)
    value = float(solution.X[-1])
    if abs(value - row.value) > 0.1 * abs(arc.b.value - arc.a.value):
        return row
    X = problem.fitted(extended.embed(solution.X[:-1]))
    return _singular(arc, np.append(X, value), row)


def _root(arc: Arc, kind: str, test: Callable[[Row], float], note: str = "") -> Found:
    """Bracketed root of a test function along the arc; where correction fails, the nearer end, not located."""
    rows: dict[float, Row] = {0.0: arc.a, 1.0: arc.b}
    values: dict[float, float] = {}

    def value(s: float) -> float:
        if s not in values:
            rows[s] = rows[s] if s in rows else arc.at(s)
            values[s] = test(rows[s])
        return values[s]

    def beside(s: float) -> float:
        """The value, or zero where the equations are singular with a change of sign beside: the point itself."""
        try:
            return value(s)
        except (NoConvergence, np.linalg.LinAlgError):
            low, high = max(s - _BESIDE, 0.0), min(s + _BESIDE, 1.0)
            if value(low) * value(high) >= 0:
                raise
            share = value(low) / (value(low) - value(high))
            rows[s], values[s] = _between(arc, rows[low], rows[high], share), 0.0
            return 0.0

    try:
        # at a turning point an error in s enters the parameter squared
        fine = 1e-9 if kind in ("LP", "CP") else 1e-13
        scipy.optimize.brentq(beside, 0.0, 1.0, xtol=fine, rtol=fine, maxiter=60)
        s = min(values, key=lambda x: abs(values[x]))  # near a singular point the last of them may be noise
        return Found(kind, s, rows[s], True, note)
    except (NoConvergence, np.linalg.LinAlgError, ValueError, RuntimeError):
        f0, f1 = abs(test(arc.a)), abs(test(arc.b))
        s = 0.0 if f0 < f1 else 1.0
        return Found(kind, s, rows[s], False, note)


_BESIDE = 1e-5  # distance along the arc at which the two sides of a singular point are looked at


def _between(arc: Arc, a: Row, b: Row, share: float) -> Row:
    """Row between two close ones, where the equations themselves cannot be solved."""
    tangent = (1 - share) * a.tangent + share * b.tangent
    return _singular(arc, (1 - share) * a.u + share * b.u, replace(a, tangent=tangent))


def _singular(arc: Arc, u: Array, near: Row) -> Row:
    """Row at u, where the equations are singular, with tangent and orientation of one nearby."""
    point = solution_at(arc.problem, u, arc.name, arc.parameters)
    return Row(point, u, near.tangent, near.orientation)


def _fold(arc: Arc) -> Found:
    """Newton on {R, g} from where the tangent's component vanishes; bracketed where forces are sampled."""
    a, b = arc.a, arc.b
    kind = getattr(arc.problem, "turning_kind", "LP")
    if a.tangent[-1] * b.tangent[-1] >= 0:  # the curve turned on a stretch on which the parameter stood still
        return Found(kind, 0.0, a, True)
    if getattr(arc.problem, "smooth", not isinstance(arc.problem, Augmented)):
        try:
            return _newton(arc, kind, Fold(arc.problem, arc.name), _turn(arc))
        except (NoConvergence, np.linalg.LinAlgError):
            pass
    return _root(arc, kind, lambda row: float(row.tangent[-1]))


_AT_THE_END = 1e-6  # how far beyond the ends of its arc a point may come to lie: farther, it belongs to another arc


def _turn(arc: Arc) -> float:
    """Where on the arc the parameter turns, by the Hermite polynomial through its ends."""
    rise = float(arc.b.u[-1] - arc.a.u[-1])
    begin, end = (float(row.tangent[-1]) * arc.length for row in (arc.a, arc.b))
    roots = np.roots([3 * (begin + end) - 6 * rise, 6 * rise - 4 * begin - 2 * end, begin])
    inside = [float(s.real) for s in roots if abs(s.imag) < 1e-12 and 0 <= s.real <= 1]
    return inside[0] if inside else begin / (begin - end)


def _newton(arc: Arc, kind: str, extended: Augmented, s: float, note: str = "") -> Found:
    """Newton on a special point as a problem of its own, from the fraction s of the arc.

    Raises
    ------
    NoConvergence
        If Newton fails or leaves the arc.
    """
    u = arc.guess(s)
    settings = Settings(arc.settings.tolerance, arc.settings.step_tolerance, 5)
    here = {**arc.parameters, arc.name: float(u[-1])}
    solution = refine(extended, solve(extended, u, here, settings=settings), here)
    U = solution.X
    chord = (arc.b.u - arc.a.u) / arc.scale
    place = float(chord @ ((U - arc.a.u) / arc.scale) / (chord @ chord))
    inside = -_AT_THE_END <= place <= 1 + _AT_THE_END
    if not inside or np.linalg.norm((U - u) / arc.scale) > 0.5 * np.linalg.norm(chord):
        raise NoConvergence("Newton left the arc", U, arc.parameters, [])
    point = solution_at(arc.problem, U, arc.name, arc.parameters, solution.iterations)
    return Found(kind, min(max(place, 0.0), 1.0), row_of(point, chord / arc.scale, arc.scale), True, note)


def _determinant(arc: Arc) -> Callable[[Row], float]:
    """Signed bordered determinant, relative to its size at the first row."""

    def logdet(row: Row) -> tuple[float, float]:
        now = row.solution.evaluation
        if not now.R.size:  # dropped, see `without_evaluation`
            now = linearise(arc.problem, row.solution.X, arc.name, {**arc.parameters, arc.name: row.value})
        sign, log = np.linalg.slogdet(bordered(now, row.tangent / arc.scale**2))
        return float(sign), float(log)

    reference = logdet(arc.a)[1]

    def value(row: Row) -> float:
        sign, log = logdet(row)
        return sign * float(np.exp(min(log - reference, 50.0)))

    return value


def _verdict(mu: ComplexArray) -> tuple[int, float]:
    """Number of unstable multipliers, and det(Phi + 1), whose sign changes at period doublings."""
    unstable, doubling = _verdicts(mu[None])
    return int(unstable[0]), float(doubling[0])


def _verdicts(mu: ComplexArray) -> tuple[np.ndarray, Array]:
    """The same of many sets of multipliers (P, r)."""
    return np.count_nonzero(np.abs(mu) > 1 + NEUTRAL, axis=1), (mu + 1).prod(axis=1).real


def _stability_changes(arc: Arc, explained: bool) -> list[Found]:
    """Period doublings and Neimark-Sacker points from the multipliers of both rows."""
    ma, mb = arc.a.observed.get("multipliers"), arc.b.observed.get("multipliers")
    if ma is None or mb is None:
        return []
    (ua, da), (ub, db) = _verdict(ma), _verdict(mb)
    if (ua == ub and da * db >= 0) or not math.isfinite(da * db):
        return []
    multipliers = arc.problem.multipliers

    def at(row: Row) -> ComplexArray:
        known = row.observed.get("multipliers")
        if known is not None:
            return known
        here = {**arc.parameters, arc.name: row.value}
        return multipliers(row.solution.X, points=8, width=1.0, **here)

    out: list[Found] = []
    doubling = da * db < 0
    if doubling:
        out.append(_doubling(arc, lambda row: _verdict(at(row))[1]))
    if abs(ua - ub) - int(doubling) - int(explained) >= 2:
        out += _two_at_once(arc, at, (ma, mb))
    return out


def _two_at_once(arc: Arc, at: Callable[[Row], ComplexArray], ends: tuple[ComplexArray, ComplexArray]) -> list[Found]:
    """Where two multipliers pass the unit circle together: a complex pair, or a double real one of a symmetric system.

    NS, or with real multipliers BP at +1 and PD at -1: their determinants do not change sign there. Nothing where two
    different real ones pass +1 one after the other: they belong to folds or branch points from which they differ by
    the truncation error.
    """
    outside = min(_verdict(_pairs(mu))[0] for mu in ends)  # complex ones that are unstable at both ends
    found = _root(arc, "NS", lambda row: _modulus(_pairs(at(row)), outside) - 1.0)
    if found.located:
        return [found]
    few = min(_verdict(mu)[0] for mu in ends)
    sizes = sorted(_modulus(mu, few) for mu in ends)
    level = 1.0 if sizes[0] < 1.0 < sizes[1] else 1.0 + NEUTRAL
    real = _root(arc, "BP", lambda row: _modulus(at(row), few) - level, "two multipliers at once")
    mu = at(real.row)
    first, second = mu[np.argsort(np.abs(np.abs(mu) - level))[:2]]
    if not real.located or (abs(first.imag) > _DOUBLE and abs(first - second.conj()) < _DOUBLE):
        return [replace(real, kind="NS", note="")]
    return [replace(real, kind="BP" if first.real > 0 else "PD")] if abs(first - second) < _DOUBLE else []


_DOUBLE = 1e-6  # distance at which two multipliers on the unit circle are one


def _pairs(mu: ComplexArray) -> ComplexArray:
    """The multipliers that are not real."""
    return mu[np.abs(mu.imag) > 1e-8 * np.abs(mu)]


def _modulus(mu: ComplexArray, k: int) -> float:
    """The modulus number k, from the largest; nan if there are not so many."""
    sizes = np.sort(np.abs(mu))[::-1]
    return float(sizes[k]) if k < len(sizes) else math.nan


def _doubling(arc: Arc, test: Callable[[Row], float]) -> Found:
    """Newton on the half-integer block; bracketed root of det(Phi + 1) where forces are sampled."""
    ends = test(arc.a), test(arc.b)
    if getattr(arc.problem, "smooth", False):
        try:
            return _newton(arc, "PD", PeriodDoubling(arc.problem, arc.name), ends[0] / (ends[0] - ends[1]))
        except (NoConvergence, np.linalg.LinAlgError):
            pass
    return _root(arc, "PD", test)


def _graze(arc: Arc, which: int) -> Found:
    """Newton on {R, extremum at the corner}; else a bracketed root of the clearance."""
    note = arc.problem.clearance_names[which]

    def test(row: Row) -> float:
        known = row.observed.get("clearance")
        if known is None:
            known = arc.problem.clearance(row.solution.X, **{**arc.parameters, arc.name: row.value})
        return float(known[which])

    ends = test(arc.a), test(arc.b)
    try:
        return _newton(arc, "GR", Grazing(arc.problem, arc.name, which), ends[0] / (ends[0] - ends[1]), note)
    except (NoConvergence, np.linalg.LinAlgError):
        return _root(arc, "GR", test, note)


def _grazing(arc: Arc) -> list[Found]:
    """Extrema that pass a corner of a law; elements that graze together are one point."""
    ca, cb = arc.a.observed.get("clearance"), arc.b.observed.get("clearance")
    if ca is None or cb is None or len(ca) != len(cb):
        return []
    out: list[Found] = []
    for i in np.flatnonzero(ca * cb < 0):
        point = _graze(arc, int(i))
        twin = next((j for j, other in enumerate(out) if abs(other.s - point.s) < 1e-6), None)
        if twin is None:
            out.append(point)
        else:
            old = out[twin]
            out[twin] = Found("GR", old.s, old.row, old.located, f"{old.note}, {point.note}")
    return out
