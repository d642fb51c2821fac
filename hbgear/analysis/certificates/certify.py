"""Certify a point of a curve: start values from contact instants, Newton's method in high precision, proof.

The proof does not depend on how the start values were found: it uses the claim only, see `proof`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from hbgear.analysis.certificates.ball_system import BallSystem, balls
from hbgear.analysis.certificates.certificate import MAX_FREQUENCY_CHANGE, NAMES, Certificate
from hbgear.analysis.certificates.coefficients import coefficients_of, decimal
from hbgear.analysis.certificates.conditions import NotCertifiedError
from hbgear.analysis.certificates.krawczyk import Krawczyk, newton
from hbgear.analysis.certificates.point_equations import SIGNS, ContactOrder, PointEquations
from hbgear.analysis.certificates.proof import PRECISION
from hbgear.common.argument_checks import check
from hbgear.common.arrays import Array
from hbgear.common.optional import needed
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.contact_instants.problem import ContactInstants
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.instants.corrector import CurveState
from hbgear.harmonic.instants.equations import EquationsAt, NotPiecewiseLinear
from hbgear.harmonic.instants.pattern import InconsistentPatternError, Switch
from hbgear.harmonic.instants.refine import state_at
from hbgear.harmonic.instants.sampling import sample_gaps
from hbgear.harmonic.instants.shooting import Iterate
from hbgear.harmonic.instants.special_points.grazing import Grazing, highest_point, without_contacts
from hbgear.harmonic.stability.exact_motion import exact_iterate

DIGITS = 48
"""Digits of the center of a box."""

NEAR, SAME_DISTANCE, SAME_INSTANT = 0.02, 1e-9, 1e-6
"""Distance of samples from a breakpoint beyond the least one, over the gap, within which the extrema are located; then,
difference of the distances of two extrema, over the size of the gaps, of contacts that graze at once; and difference of
the phases of one extremum."""

VANISHING_DURATION = 1e-3
"""Duration of a contact, over the period, that is removed for a grazing point."""


class Start(NamedTuple):
    """Start values: order of the contacts, unknowns as floats, scales of the unknowns, Omega."""

    order: ContactOrder
    z: Array
    scales: Array
    Omega: float


def certify(point: Point) -> Certificate:
    """Prove that a motion or a special point exists, is unique, and is stable or not.

    The equations of the contact instants are solved with 50 digits. Krawczyk's operator in ball arithmetic proves
    existence and uniqueness in a box; the order of the contacts, transversality and the sign of every gap over the
    whole period are proved, and the multipliers are enclosed. All rounding and truncation errors are bounded.

    Parameters
    ----------
    point : Point
        Point of a curve in contact instants or of a harmonic balance with piecewise-linear laws: a motion, a fold
        ("LP"), a period doubling ("PD") or a grazing point ("GR"). A motion is certified at the decimal of its Omega; a
        special point at the decimals of all other parameters.

    Returns
    -------
    Certificate
        What was proved and what was assumed, with the exact decimals from which the proof is repeated.

    Raises
    ------
    NotCertifiedError
        If a condition of the proof fails; the message and the attribute ``condition`` state which one.
    ValueError
        If python-flint is not installed, or the point does not know its problem.

    References
    ----------
    Rump, S. M. (2010). Verification methods: rigorous results using floating-point arithmetic. Acta Numerica 19,
    287-449. https://doi.org/10.1017/S096249291000005X.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.ContactInstants(hb.SpurPair()), "Omega", (0.9, 0.6))
    >>> proof = hb.analysis.certify(curve["LP1"])
    >>> float(proof.Omega[1]) - float(proof.Omega[0]) < 1e-20, proof.stable
    (True, True)
    """
    check("certify", "point", point, Point)
    flint = needed("flint", "certify", "a certificate")
    kind = getattr(point, "kind", "") or "motion"
    if kind not in NAMES:
        raise NotCertifiedError("model", f"there is no proof for points of kind {kind}; need a motion, LP, PD or GR")
    problem = point.problem
    if not isinstance(problem, HarmonicBalance):
        raise ValueError(
            f"{point.label or 'the point'} does not know its problem; take it from the curve, as curve['LP1'], and "
            "load curves with load(path, problem=HarmonicBalance(...))"
        )
    problem = problem.at_resolution_of(point)
    with flint.ctx.workprec(PRECISION):
        try:
            equations = problem.compiled(point.parameters).contact_equations
        except NotPiecewiseLinear as error:
            raise NotCertifiedError("model", str(error)) from error
        data = coefficients_of(equations)
        system, reason = BallSystem(data), "no motion in contact instants was found near the point"
        for start in _starts(problem, point, kind):
            claim = _claim(system, start, kind, point.parameters["Omega"])
            if isinstance(claim, dict):
                return Certificate.of(claim, point.label)
            reason = claim
    raise NotCertifiedError("start", reason)


def _claim(system: BallSystem, start: Start, kind: str, point_Omega: float) -> dict[str, Any] | str:
    """Return the claim for start values, or the reason why it cannot be made."""
    prescribed = decimal(point_Omega)
    equations = PointEquations(system, start.order, kind, balls(prescribed).item())
    z, scales = balls(start.z), balls(start.scales)
    functional: list[str] = []
    if kind in SIGNS:
        v = _null_vector(equations, start)
        scaled = v / start.scales[: equations.n]
        functional = [decimal(x) for x in scaled / float(scaled @ scaled) / start.scales[: equations.n]]
        equations = PointEquations(system, start.order, kind, None, balls(functional))
        z, scales = np.concatenate([z, balls(v)]), np.concatenate([scales, scales[: equations.n]])
    solution = newton(equations.evaluate, z, scales)
    if solution is None:
        return "Newton's method does not converge with this order of contacts"
    Omega = float(equations.frequency(solution).mid())
    if abs(Omega - point_Omega) > MAX_FREQUENCY_CHANGE * abs(point_Omega):
        return f"the nearest solution has Omega = {Omega:.8g}, not {point_Omega:.8g}"
    operator = Krawczyk(equations.evaluate, solution)
    smallest = operator.smallest_radius(scales)
    if smallest is None:
        raise NotCertifiedError("existence", "no box is mapped into itself: the solution may be degenerate")
    largest = operator.largest_radius(scales, smallest)
    center = [x.str(DIGITS, radius=False) for x in solution]
    radius = [decimal(float(s) * smallest) for s in scales]
    return {
        "kind": kind,
        "equations": system.data,
        "order": start.order.describe(),
        "Omega": prescribed,
        "functional": functional,
        "center": center,
        "radius": radius,
        "relative": decimal(smallest),
        "factor": decimal(largest / smallest),
    }


def _null_vector(equations: PointEquations, start: Start) -> Array:
    """Return the null vector of B_u of a fold or period doubling, at start values."""
    n = equations.n
    zero = np.concatenate([balls(start.z), balls(np.zeros(n))])
    pending = PointEquations(equations.system, equations.order, equations.kind, None, balls(np.zeros(n)))
    rows = pending.evaluate(zero)[1][n : 2 * n, n + 1 :]
    J = np.array([[float(x.mid()) for x in row] for row in rows]) * start.scales[:n]
    return np.asarray(np.linalg.svd(J)[2][-1] * start.scales[:n])


def _starts(problem: HarmonicBalance, point: Point, kind: str) -> Iterator[Start]:
    """Yield start values: the states of the curve in contact instants, then the switching times of the harmonics."""
    equations = problem.compiled(point.parameters).contact_equations
    if isinstance(problem, ContactInstants):
        for state in problem.nearest_states(point.X, point.parameters):
            Omega = state.value if problem.known_parameter == "Omega" else point.parameters["Omega"]
            yield _start(equations.at(Omega), state.iterate, kind)
    for free in (kind in ("LP", "GR"), kind not in ("LP", "GR")):
        with suppress(NoConvergence, InconsistentPatternError):
            yield _start(*exact_iterate(problem, point.X, point.parameters, free), kind)


def _start(local: EquationsAt, iterate: Iterate, kind: str) -> Start:
    """Return start values from a motion in contact instants."""
    reduce = local.structure.reduce
    if reduce.shape[0] != reduce.shape[1]:
        raise NotCertifiedError(
            "model", "a motion that no spring resists (rigid rotation) has no unique position: eliminate it"
        )
    contact: tuple[int, int, int, int] | tuple[()] = ()
    grazing_phases: list[float] = []
    if kind == "GR":
        iterate, contact, t = _grazing(local, iterate)
        grazing_phases = [t]
    iterate = _at_whole_turn(local, iterate)
    x = np.linalg.solve(reduce, iterate.x.T).T
    pattern, n = iterate.pattern, x.shape[1] // 2
    free = [i for i, switch in enumerate(pattern.switches) if not switch.is_fixed]
    starts = local.equations.starts
    turns = [
        0 if not s.is_fixed else round((tau - float(starts[s.breakpoint])) / (2 * np.pi))
        for s, tau in zip(pattern.switches, iterate.tau, strict=True)
    ]
    z = np.concatenate([x.ravel(), iterate.tau[free], [] if kind == "motion" else [local.Omega], grazing_phases])
    size = np.array([max(np.abs(x[:, part]).max(), 1e-300) for part in (slice(None, n), slice(n, None))])
    scales = np.concatenate(
        [
            np.tile(np.repeat(size, n), len(x)),
            np.ones(len(free)),
            [] if kind == "motion" else [local.Omega],
            np.ones(len(grazing_phases)),
        ]
    )
    return Start(ContactOrder(pattern, tuple(turns), contact), z, scales, local.Omega)


def _at_whole_turn(local: EquationsAt, iterate: Iterate) -> Iterate:
    """Return a motion without contact instants with its state at a multiple of 2 pi, which is exact in a claim."""
    artificial = iterate.pattern.count == 1 and iterate.pattern.switches[0].is_fixed
    if not artificial or any(e.law.phases for e in local.equations.system.elements):
        return iterate
    tau = 2 * np.pi * np.ceil(iterate.tau[0] / (2 * np.pi))
    return Iterate(iterate.pattern, np.array([tau]), state_at(local, iterate, float(tau))[None])


def _grazing(local: EquationsAt, iterate: Iterate) -> tuple[Iterate, tuple[int, int, int, int], float]:
    """Return the motion without the contact that grazes, the contact, and its phase."""
    visits = iterate.pattern.visits
    durations = iterate.visit_durations(visits, local.period)
    if durations.min(initial=np.inf) < VANISHING_DURATION * local.period:
        shortest = visits[int(np.argmin(durations))]
        state, contacts = without_contacts(lambda _: local, CurveState.of(iterate, local.Omega), [shortest])
        iterate, t, switch = state.iterate, contacts[0].t, contacts[0].switch
        element, breakpoint, side = switch
    else:
        t, element, breakpoint, side = _nearest_extremum(local, iterate)
    iterate = _at_whole_turn(local, iterate)
    first = float(iterate.tau[0])
    t = first + (t - first) % local.period
    segment = int(np.searchsorted(iterate.tau, t, side="right")) - 1
    return iterate, (segment, element, breakpoint, side), t


def _nearest_extremum(local: EquationsAt, iterate: Iterate) -> tuple[float, int, int, int]:
    """Return phase, element, breakpoint and side of the extremum of a gap that is nearest to a breakpoint."""
    samples, _ = sample_gaps(local, iterate)
    d, candidates = samples.gaps, []
    peaks = {1: (d >= np.roll(d, 1, axis=0)) & (d >= np.roll(d, -1, axis=0))}
    peaks[-1] = (d <= np.roll(d, 1, axis=0)) & (d <= np.roll(d, -1, axis=0))
    for side, at_peak in peaks.items():
        for s, j in zip(*np.nonzero(at_peak), strict=True):
            for k, level in enumerate(local.equations.breakpoints[j]):
                distance = abs(d[s, j] - level) / max(float(np.ptp(d[:, j])), 1e-300)
                candidates.append((distance, Grazing(float(samples.tau[s]), Switch(int(j), k, side))))
    if not candidates:
        raise NotCertifiedError("grazing", "no gap has an extremum")
    state, least = CurveState.of(iterate, local.Omega), min(distance for distance, _ in candidates)
    extrema = [highest_point(lambda _: local, state, near) for distance, near in candidates if distance <= least + NEAR]
    distances, size = np.abs([distance for _, distance in extrema]), float(np.ptp(d))
    touching = [extrema[i][0] for i in np.argsort(distances) if distances[i] <= distances.min() + SAME_DISTANCE * size]
    (t, switch), *others = touching
    several = [
        other
        for other in others
        if other.switch != switch or abs(math.remainder(other.t - t, local.period)) > SAME_INSTANT
    ]
    if several:
        names = ", ".join(sorted({local.equations.system.elements[one.switch.element].name for one in touching}))
        raise NotCertifiedError("grazing", f"contacts of {names} graze at once, as in a symmetric machine; need one")
    return t, *switch
