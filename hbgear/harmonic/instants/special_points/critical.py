"""Special points of curves of exact motions: test functions and their zeros.

    LP   component of the tangent in the parameter              PD   det(P + 1)
    NS   prod_{i<j} (mu_i mu_j - 1), complex multipliers        BP   det [F_u F_p; t^T]

P is the monodromy matrix, the product of the flows, with eigenvalues mu. Each function is computed from a corrected
point without truncation, and its zero is bracketed between two points of a curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.results.stability import pair_factors, sign_of_pairs
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.instants.corrector import CurveState, Family, correct, jacobian, tangent_of
from hbgear.harmonic.instants.shooting import Linearisation, monodromy_matrix, multipliers_of

REAL_PAIR_TOLERANCE = 1e-6
"""Imaginary part up to which two multipliers of product one are a real pair and no Neimark-Sacker point."""

UNIT_CIRCLE_DISTANCE = 1e-6
"""Distance of the modulus of a located Neimark-Sacker pair from 1; rounding leaves 1e-10."""

BRANCH_POINT_DISTANCE, MIN_DISTANCE = 2e-3, 1e-4
"""Distance of points from a branch point that is interpolated between them, over the step, and its smallest value in
scaled unknowns. The error of the cubic is 9 (2e-3)^4 = 1e-10; points at less than 1e-5 do not converge."""

LARGEST_PART_OF_STEP = 0.1
"""Largest distance of these points over the step: steps next to a grazing are shorter than `MIN_DISTANCE`."""

DISTANCE_FACTORS, UNIT_MULTIPLIER = (1 / 16, 1 / 4, 1.0, 4.0, 16.0), 1e-10
"""Factors of this distance that are tried one after the other, until a multiplier differs from 1 by at most this value;
with the last one, the error of the cubic is 1e-5, and rounding at the first one can be 1e-9."""

LEADING_MULTIPLIERS = 4
"""Number of multipliers, largest modulus first, whose change limits a step."""


@dataclass(frozen=True, eq=False)
class ExactPoint:
    """Point of a curve: state, linearised equations, [F_u F_p], scales and unit tangent in scaled unknowns."""

    state: CurveState
    linearised: Linearisation
    J: Array
    scale: Array
    tangent: Array
    iterations: int = 0

    @cached_property
    def monodromy(self) -> Array:
        """Monodromy matrix (r, r) of the state."""
        return monodromy_matrix(self.linearised)

    @cached_property
    def multipliers(self) -> ComplexArray:
        """Multipliers (r,), largest modulus first."""
        return multipliers_of(self.monodromy)

    @cached_property
    def _values(self) -> dict[str, float]:
        """Values of the test functions that were needed so far."""
        return {}

    def test(self, kind: str) -> float:
        """Return the value of a test function."""
        if kind not in self._values:
            self._values[kind] = _TESTS[kind](self)
        return self._values[kind]

    @cached_property
    def polynomial(self) -> Array:
        """Characteristic polynomial of the leading multipliers, highest power first."""
        polynomial = [1.0 + 0.0j]
        for mu in self.multipliers[:LEADING_MULTIPLIERS].tolist():
            polynomial = [a - mu * b for a, b in zip([*polynomial, 0.0], [0.0, *polynomial], strict=True)]
        return np.array(polynomial).real


SpecialExactPoint = tuple[str, float, ExactPoint]
"""Kind of a special point, its fraction of the step, and the point."""


def doubling_test(mu: ComplexArray) -> float:
    """Return the distance of the nearest multiplier from -1 with the sign of prod (mu + 1)."""
    beyond = int(((mu.imag == 0) & (mu.real < -1)).sum())
    return float((-1) ** beyond * np.abs(mu + 1).min())


def pair_test(mu: ComplexArray) -> float:
    """Return the smallest |mu_i mu_j - 1| with the sign of their product; 1 if there are two multipliers only."""
    return sign_of_pairs(mu) if len(mu) > 2 else 1.0


def _singularity(J: Array, row: Array) -> float:
    """Return the smallest singular value of [F_u F_p; row^T] with the sign of its determinant."""
    bordered = np.vstack([J, row])
    return float(np.linalg.slogdet(bordered)[0] * np.linalg.svd(bordered, compute_uv=False)[-1])


_TESTS: dict[str, Callable[[ExactPoint], float]] = {
    "LP": lambda point: float(point.tangent[-1]),
    "PD": lambda point: doubling_test(point.multipliers),
    "NS": lambda point: pair_test(point.multipliers),
    "BP": lambda point: _singularity(point.J * point.scale, point.tangent),
}
"""Test function of each kind of special point."""


def exact_point(family: Family, state: CurveState, row: Array, scale: Array, direction: Array) -> ExactPoint:
    """Return the corrected point in the plane across ``row``, whose tangent has the orientation of ``direction``."""
    state, linearised, J, iterations = correct(family, state, row, scale)
    return ExactPoint(state, linearised, J, scale, tangent_of(J, scale, direction), iterations)


def point_on_curve(family: Family, state: CurveState, scale: Array) -> ExactPoint:
    """Return the point of a state on a curve, with its tangent in one of both directions."""
    linearised, J = jacobian(family, state)
    return ExactPoint(state, linearised, J, scale, tangent_of(J, scale, np.linalg.svd(J * scale)[2][-1]))


def special_points(family: Family, a: ExactPoint, b: ExactPoint) -> list[SpecialExactPoint]:
    """Return the special points between two points of one pattern: kind, fraction of the segment, point."""
    changed = {kind for kind in _TESTS if a.test(kind) * b.test(kind) < 0}
    located = [("BP", *_locate_branch_point(family, a, b))] if "BP" in changed else []
    crossing = located[0] if located else None
    for kind in sorted(changed - {"BP"}):
        try:
            s = _root(family, a, b, kind, (0.0, 1.0))
        except NoConvergence:
            if crossing is None:
                raise
            s = _root_near_branch_point(family, a, b, kind, crossing[1])
        if not math.isfinite(s):
            continue
        point = point_between(family, a, b, s)
        is_crossing = kind == "LP" and crossing is not None and _coincide(point, crossing[2], _distance(a, b))
        if (kind != "NS" or is_complex_pair(point.multipliers)) and not is_crossing:
            located.append((kind, s, point))
    return sorted(located, key=lambda special: special[1])


RELOCATION_STEP = 1e-7
"""First distance along a curve at which a change of sign of a test function is searched, in scaled unknowns."""


def relocated(family: Family, point: ExactPoint, kind: str, reach: float = 1e-3) -> ExactPoint:
    """Return the special point LP, PD or NS of neighbouring equations near a point of a curve.

    reach : distance along the curve, in scaled unknowns, within which it is searched.

    Raises
    ------
    NoConvergence
        If there is no such point nearby.
    """
    scale, tangent = point.scale, point.tangent
    start = exact_point(family, point.state, tangent, scale, tangent)

    def point_at(s: float) -> ExactPoint:
        return exact_point(family, start.state.with_z(start.state.z + s * tangent * scale), tangent, scale, tangent)

    def test(s: float) -> float:
        return (point_at(s) if s else start).test(kind)

    step, start_value = RELOCATION_STEP, start.test(kind)
    while step < reach:
        for end in (step, -step):
            if test(end) * start_value <= 0:
                return point_at(_zero(test, 0.0, end, 1e-16, kind, point))
        step *= 2
    raise NoConvergence(f"{kind} is not near its place on the curve", point.state.z, {}, [])


def _coincide(fold: ExactPoint, branch_point: ExactPoint, length: float) -> bool:
    """Return whether a fold in a step is the branch point, at which the parameter of a branch turns, too."""
    return _distance(branch_point, fold) < min(MIN_DISTANCE, LARGEST_PART_OF_STEP * length)


def _distance(a: ExactPoint, b: ExactPoint) -> float:
    """Return the distance of two points in scaled unknowns."""
    return float(np.linalg.norm((b.state.z - a.state.z) / a.scale))


def _root(family: Family, a: ExactPoint, b: ExactPoint, kind: str, bracket: tuple[float, float]) -> float:
    """Return the fraction at which a test function is zero."""

    def test(s: float) -> float:
        return (b if s else a).test(kind) if s in (0.0, 1.0) else point_between(family, a, b, s).test(kind)

    return _zero(test, *bracket, 1e-13, kind, a)


def _zero(test: Callable[[float], float], low: float, high: float, xtol: float, kind: str, point: ExactPoint) -> float:
    """Return the zero of the test function of a kind between two fractions or distances."""
    s, result = scipy.optimize.brentq(test, low, high, xtol=xtol, rtol=1e-14, maxiter=60, full_output=True, disp=False)
    if not result.converged:
        raise NoConvergence(f"the zero of the test function of {kind} was not located", point.state.z, {}, [])
    return float(s)


def _root_near_branch_point(family: Family, a: ExactPoint, b: ExactPoint, kind: str, singular: float) -> float:
    """Return the fraction at which a test function is zero on either side of a branch point.

    The result is nan if it changes its sign at the branch point, as the direction of the parameter where a branch
    leaves a symmetric motion.
    """
    distance = _distance_of_points(a, b)
    low, high = singular - distance, singular + distance
    before, after = (point_between(family, a, b, s).test(kind) for s in (low, high))
    if low > 0 and a.test(kind) * before < 0:
        return _root(family, a, b, kind, (0.0, low))
    if high < 1 and after * b.test(kind) < 0:
        return _root(family, a, b, kind, (high, 1.0))
    return math.nan


def _locate_branch_point(family: Family, a: ExactPoint, b: ExactPoint) -> tuple[float, ExactPoint]:
    """Return the fraction and the point of a branch point between two points."""
    fractions, chord = [0.5], (b.state.z - a.state.z) / a.scale
    row = chord / np.linalg.norm(chord)

    def test(s: float) -> float:
        fractions.append(s)
        point = (b if s else a) if s in (0.0, 1.0) else point_between(family, a, b, s)
        return _singularity(point.J * a.scale, row)

    with suppress(NoConvergence):  # at the branch point itself the corrector does not converge
        fractions.append(float(scipy.optimize.brentq(test, 0.0, 1.0, xtol=BRANCH_POINT_DISTANCE)))
    return branch_point_near(family, a, b, fractions[-1])


def _distance_of_points(a: ExactPoint, b: ExactPoint) -> float:
    """Return the distance of points from a branch point that is interpolated between them, over the step."""
    return max(BRANCH_POINT_DISTANCE, min(MIN_DISTANCE / _distance(a, b), LARGEST_PART_OF_STEP))


def branch_point_near(family: Family, a: ExactPoint, b: ExactPoint, fraction: float) -> tuple[float, ExactPoint]:
    """Return a branch point from points around it, because the equations of a point are singular there.

    Where the parameter changes little along the branch, the corrector converges at larger distances only; next to a
    grazing the cubic is accurate at smaller ones only. Without a multiplier of 1, the nearest result is returned.
    """
    distance, found = _distance_of_points(a, b), []
    for factor in DISTANCE_FACTORS:
        with suppress(NoConvergence):
            s, point = _interpolated_branch_point(family, a, b, fraction, factor * distance)
            found.append((float(np.abs(point.multipliers - 1).min()), s, point))
            if found[-1][0] <= UNIT_MULTIPLIER:
                break
    if not found:
        raise NoConvergence("the branch point does not converge", a.state.z, {}, [])
    return min(found, key=lambda result: result[0])[1:]


def _interpolated_branch_point(
    family: Family, a: ExactPoint, b: ExactPoint, fraction: float, distance: float
) -> tuple[float, ExactPoint]:
    """Return a branch point from four points at a distance, and three times the distance, on both sides of it.

    Test function and state are interpolated. The border of the test function is the direction of the points, because
    the tangents of single points are inaccurate next to the branch point.
    """
    fractions = fraction + distance * np.array([-3.0, -1.0, 1.0, 3.0])
    points = [point_between(family, a, b, float(s)) for s in fractions]
    direction = (points[3].state.z - points[0].state.z) / a.scale
    row = direction / np.linalg.norm(direction)
    values = [_singularity(jacobian(family, point.state)[1] * a.scale, row) for point in points]
    x = (fractions - fraction) / distance
    roots = np.roots(np.polyfit(x, values, 3))
    root = float(roots[np.argmin(np.abs(roots))].real)
    weights = [np.prod([(root - q) / (p - q) for q in x if q != p]) for p in x]
    z = sum(weight * point.state.z for weight, point in zip(weights, points, strict=True))
    state = points[1].state.with_z(np.asarray(z))
    linearised, J = jacobian(family, state)
    return fraction + distance * root, ExactPoint(state, linearised, J, a.scale, row)


def point_between(family: Family, a: ExactPoint, b: ExactPoint, s: float) -> ExactPoint:
    """Return the point of the curve at a fraction of the chord between two points of one pattern."""
    scale = a.scale
    chord = (b.state.z - a.state.z) / scale
    length = float(np.linalg.norm(chord))
    row = chord / length
    ta, tb = (t * length / float(t @ row) for t in (a.tangent, b.tangent * b.scale / scale))
    bend = (ta - chord) * (1 - s) - (tb - chord) * s
    guess = a.state.with_z(a.state.z + scale * (s * chord + s * (1 - s) * bend))
    return exact_point(family, guess, row, scale, row)


def is_complex_pair(mu: ComplexArray) -> bool:
    """Return whether the multipliers nearest to the unit circle are a complex pair."""
    nearest = mu[np.argmin(np.abs(np.abs(mu) - 1))]
    return bool(abs(nearest.imag) > REAL_PAIR_TOLERANCE and abs(abs(nearest) - 1) < UNIT_CIRCLE_DISTANCE)


# ---- two special points in a step

LONG_STEP, NEAR_UNIT = 0.02, 0.6
"""Step, and distance of a multiplier from -1 or +1, from which a step is tested for two special points of one kind."""

NEAR_CIRCLE = 0.2
"""Distance of the modulus of a complex pair from 1 from which such a step is tested for two Neimark-Sacker points."""

BEND_FACTOR = 30.0
"""Factor of the second derivative of these functions, a difference over two steps, that a step may have."""

INTERIOR_FRACTIONS = (0.15, 0.5, 0.85)
"""Fractions of such a step at which test functions are evaluated; next to the ends because a multiplier that passes
-1 or +1 there can return along another curve, with a corner where two multipliers meet."""

SAME_FRACTION = 1e-3
"""Smallest difference of two fractions of a step at which a test function is evaluated."""

MAX_HALVINGS = 12
"""Number of halvings of a step in which the number of multipliers beyond -1 or +1 changes by two."""

MAX_PARABOLAS, PROMISING_MINIMUM = 4, 0.3
"""Largest number of parabolas in the search of a zero of a test function, and their minimum, over the smallest known
value, up to which the search goes on."""


def hides_two_points(
    family: Family, before: ExactPoint | None, last: ExactPoint, point: ExactPoint, step: float, length: float
) -> bool:
    """Return whether multipliers pass -1, +1 or the unit circle and return between two points of one pattern.

    A step is searched if it is long, a multiplier is near -1, +1 or, as one of a pair, the unit circle, and det(P -+ 1)
    or prod (mu_i mu_j - 1) may bend to zero, if the number of multipliers beyond -1 or +1 differs at its ends, or if a
    test function that is extrapolated from the step before changes its sign in it. A long step with a special point is
    searched for two more of its kind. The point ``before`` the last one is at the distance ``step``, the next point at
    ``length``.
    """
    if last.state.pattern != point.state.pattern:
        return False
    kinds = {kind for kind in _SEARCHED_KINDS if last.test(kind) * point.test(kind) > 0}
    promising = {kind for kind in kinds if length > LONG_STEP and _comes_near(kind, last, point)}
    if before is not None and step > 0 and before.state.pattern == last.state.pattern:
        promising = {kind for kind in promising if _may_bend(kind, (before, last, point), step, length)}
        for kind in kinds - promising:
            value, rate = last.test(kind), (last.test(kind) - before.test(kind)) / step
            if (value + rate * length) * value < 0:
                promising.add(kind)
    interior = {s: point_between(family, last, point, s) for s in INTERIOR_FRACTIONS} if promising else {}
    samples = {0.0: last, **interior, 1.0: point}
    if any(_passes_zero(samples, kind, lambda s: point_between(family, last, point, s)) for kind in promising):
        return True
    others = set(_SEARCHED_KINDS) - kinds if length > LONG_STEP else set()
    if any(_passes_three_times(family, last, point, kind) for kind in others):
        return True
    return any(_pass_one_by_one(family, last, point, _UNIT[kind]) for kind in kinds & set(_UNIT))


_SEARCHED_KINDS, _UNIT = ("PD", "BP", "NS"), {"PD": -1.0, "BP": 1.0}
"""Kinds that can lie twice in a step, and the multiplier at them."""


def _comes_near(kind: str, *points: ExactPoint) -> bool:
    """Return whether a multiplier of a point is near -1 or +1, or a complex pair near the unit circle."""
    if kind in _UNIT:
        return any(bool(np.abs(point.multipliers - _UNIT[kind]).min() < NEAR_UNIT) for point in points)
    pairs = (mu[mu.imag > 0] for point in points if len(mu := point.multipliers) > 2)
    return any(bool(np.abs(np.abs(mu) - 1).min(initial=math.inf) < NEAR_CIRCLE) for mu in pairs)


def _count_beyond(unit: float, point: ExactPoint) -> int:
    """Return the number of real multipliers of a point below -1 or above +1."""
    mu = point.multipliers
    return int(((mu.imag == 0) & (mu.real * unit > 1)).sum())


def _pass_one_by_one(family: Family, a: ExactPoint, b: ExactPoint, unit: float) -> bool:
    """Return whether two multipliers, as of disturbances of different symmetry, pass a unit one after the other.

    Their number beyond it changes by two also where a complex pair becomes real there; no point has one of them.
    """
    begin, end, low, high = _count_beyond(unit, a), _count_beyond(unit, b), 0.0, 1.0
    for _ in range(MAX_HALVINGS if abs(end - begin) == 2 else 0):
        s = 0.5 * (low + high)
        count = _count_beyond(unit, point_between(family, a, b, s))
        if (count - begin) % 2:
            return True
        low, high = (s, high) if count == begin else (low, s)
    return False


def _may_bend(kind: str, points: tuple[ExactPoint, ExactPoint, ExactPoint], step: float, length: float) -> bool:
    """Return whether det(P -+ 1) or prod (mu_i mu_j - 1) may reach zero and return between the last two points.

    They are smooth, also where multipliers meet. Between two points such a function differs from its chord by at most
    |d2/ds2| h^2 / 8.
    """
    a, b, c = (_smooth_test(kind, point.multipliers) for point in points)
    bend = abs((c - b) / length - (b - a) / step) / (step + length) * length**2 / 4
    return min(abs(b), abs(c)) < BEND_FACTOR * bend


def _smooth_test(kind: str, mu: ComplexArray) -> float:
    """Return det(P -+ 1), or for "NS" prod_{i<j} (mu_i mu_j - 1), of the multipliers."""
    if kind in _UNIT:
        return float(np.prod(mu - _UNIT[kind]).real)
    return float(np.prod(pair_factors(mu)).real)


def _passes_three_times(family: Family, a: ExactPoint, b: ExactPoint, kind: str) -> bool:
    """Return whether a test function that changes its sign between two points passes zero three times there.

    The factor of the zero that is located first is divided out.
    """
    root = _locate_branch_point(family, a, b)[0] if kind == "BP" else _root(family, a, b, kind, (0.0, 1.0))
    interior = {s: point_between(family, a, b, s) for s in INTERIOR_FRACTIONS if abs(s - root) > SAME_FRACTION}
    return _passes_zero({0.0: a, **interior, 1.0: b}, kind, lambda s: point_between(family, a, b, s), root)


def _passes_zero(
    samples: dict[float, ExactPoint], kind: str, point_at: Callable[[float], ExactPoint], root: float | None = None
) -> bool:
    """Return whether a test function, over its factor of a known ``root``, passes zero and returns between two points.

    Its smallest size is approached by parabolas through three points next to the smallest; where two multipliers meet,
    it has a corner, which is approached by secants.
    """
    known = [] if root is None else [root]

    def value(s: float, point: ExactPoint) -> float:
        return point.test(kind) / (1.0 if root is None else s - root)

    sign = math.copysign(1.0, value(0.0, samples[0.0]))
    values = [(s, sign * value(s, point)) for s, point in samples.items()]
    for _ in range(MAX_PARABOLAS):
        i = min(range(len(values)), key=lambda i: values[i][1])
        if values[i][1] < 0:
            return True
        first = min(max(i - 1, 0), len(values) - 3)
        s, lowest = _minimum(*zip(*values[first : first + 3], strict=True))
        if not lowest < PROMISING_MINIMUM * values[i][1]:
            s = _zero_of_secant(values, i)
        if not math.isfinite(s) or any(abs(s - position) < SAME_FRACTION for position in [*known, *dict(values)]):
            return False
        values = sorted([*values, (s, sign * value(s, point_at(s)))])
    return min(value for _, value in values) < 0


def _zero_of_secant(points: list[tuple[float, float]], i: int) -> float:
    """Return the zero nearest to point i of the secants through it and its neighbours, beyond it; inf without one."""
    if not 0 < i < len(points) - 1:
        return math.inf
    (low, before), (s, value), (high, after) = points[i - 1 : i + 2]
    rising = s + (s - low) * value / (before - value) if before > value else math.inf
    falling = s - (high - s) * value / (after - value) if after > value else -math.inf
    zeros = [zero for zero in (rising, falling) if low < zero < high]
    return min(zeros, key=lambda zero: abs(zero - s), default=math.inf)


def _minimum(s: tuple[float, ...], values: tuple[float, ...]) -> tuple[float, float]:
    """Return position and value of the minimum of the parabola through three points; infinite if it is outside."""
    curvature, slope, _ = np.polyfit(np.array(s) - s[1], values, 2)
    offset = -slope / (2 * curvature) if curvature > 0 else math.inf
    if not s[0] < s[1] + offset < s[2]:
        return math.inf, math.inf
    return s[1] + offset, float(values[1] + 0.5 * slope * offset)
