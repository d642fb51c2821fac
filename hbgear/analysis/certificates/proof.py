"""Proof of a claim in ball arithmetic: existence and uniqueness, then all conditions that make it a motion.

1. Krawczyk's operator maps the box of the claim into its interior, and a larger box for uniqueness.
2. The instants follow each other in the stated order within one period.
3. Each gap passes its breakpoint with nonzero speed in the stated direction.
4. Each gap stays between its breakpoints from one instant to the next.
5. At a grazing the second derivative of the gap has the sign that keeps the contact open.

The eigenvalues of the product of the flows are enclosed as well.

References
----------
Rump, S. M. (2010). Verification methods: rigorous results using floating-point arithmetic. Acta Numerica 19, 287-449.
https://doi.org/10.1017/S096249291000005X.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from hbgear.analysis.certificates.ball_system import Balls, BallSystem, array, balls, matrix
from hbgear.analysis.certificates.conditions import NotCertifiedError
from hbgear.analysis.certificates.flows import transition
from hbgear.analysis.certificates.gap_signs import DOUBLE, SINGLE, failing_gap
from hbgear.analysis.certificates.krawczyk import Krawczyk
from hbgear.analysis.certificates.point_equations import SIGNS, ContactOrder, PointEquations
from hbgear.common.optional import needed
from hbgear.harmonic.instants.pattern import InconsistentPatternError, Switch

PRECISION = 170
"""Precision of ball arithmetic [bit]: 51 decimals."""

DECIMALS = 30
"""Decimal places of enclosures; rounded outward."""


class Proof(NamedTuple):
    """Results of a proof, see `Certificate`."""

    Omega: tuple[str, str]
    instants: tuple[tuple[str, str], ...]
    multipliers: tuple[tuple[str, str, str], ...]
    stable: bool | None
    uniqueness: float


def prove(claim: Mapping[str, Any]) -> Proof:
    """Prove a claim: return enclosures and stability, or raise NotCertifiedError for the condition that fails.

    The claim has kind, equations (`coefficients_of`), order (`ContactOrder.describe`), Omega of a motion, functional,
    center and radius of the box, and the factor of the box in which the point is unique.
    """
    flint = needed("flint", "certify", "a certificate")
    with flint.ctx.workprec(PRECISION):
        equations = equations_of(claim)
        operator, radius = Krawczyk(equations.evaluate, balls(claim["center"])), balls(claim["radius"])
        Z = operator.image(radius)
        if Z is None or operator.image(radius * flint.arb(claim["factor"])) is None:
            raise NotCertifiedError("existence", "Krawczyk's operator does not map the box of the unknowns into itself")
        flows = equations.flows(Z)
        _check_instants(equations, Z)
        _check_crossings(equations, Z, flows)
        _check_grazing(equations, Z, flows)
        _check_gaps(equations, Z, flows)
        multipliers, stable = _multipliers(equations, Z, flows)
        free = [equations.phases(Z)[i] for i in equations.free]
        return Proof(
            Omega=outward(equations.frequency(Z)) if claim["kind"] != "motion" else (claim["Omega"],) * 2,
            instants=tuple(outward(tau) for tau in free),
            multipliers=multipliers,
            stable=stable,
            uniqueness=float(claim["relative"]) * float(claim["factor"]),
        )


def equations_of(claim: Mapping[str, Any]) -> PointEquations:
    """Return the equations of a claim."""
    from flint import arb

    try:
        order = ContactOrder.of(claim["order"])
    except InconsistentPatternError as error:
        raise NotCertifiedError("contact order", str(error)) from error
    system = BallSystem(claim["equations"])
    if len(order.turns) != order.pattern.count:
        raise NotCertifiedError("contact order", f"{len(order.turns)} turns for {order.pattern.count} switches")
    _check_sections(system, order)
    Omega = arb(claim["Omega"]) if claim["kind"] == "motion" else None
    equations = PointEquations(system, order, claim["kind"], Omega, balls(claim["functional"]))
    if not len(claim["center"]) == len(claim["radius"]) == equations.size:
        raise NotCertifiedError("existence", f"the box has {len(claim['center'])} unknowns; need {equations.size}")
    return equations


def _check_sections(system: BallSystem, order: ContactOrder) -> None:
    """Require all corners of springs among the breakpoints, and all breakpoints of the stiffness among the switches."""
    for element in system.elements:
        if not {x for spring in element["springs"] for x in spring["corners"]} <= set(element["breakpoints"]):
            raise NotCertifiedError("contact order", f"corners of {element['name']} are missing among its breakpoints")
    count = len(system.data["sections"])
    springs = [spring for element in system.elements for spring in element["springs"]]
    if not {phase for spring in springs for phase in spring["stiffness"].get("phases", ())} <= set(
        system.data["sections"]
    ):
        raise NotCertifiedError("contact order", "breakpoints of the stiffness are missing among the sections")
    fixed = [(t * count + s.breakpoint) for s, t in zip(order.pattern.switches, order.turns, strict=True) if s.is_fixed]
    expected = count * system.nu
    if count and (len(fixed) != expected or fixed != list(range(fixed[0], fixed[0] + expected))):
        raise NotCertifiedError("contact order", "breakpoints of the stiffness are missing among the switches")


def _check_instants(equations: PointEquations, Z: Balls) -> None:
    """Require positive durations of all segments."""
    switches, period = equations.order.pattern.switches, float(equations.system.period.mid())
    for i, (a, b) in enumerate(equations.ends(Z)):
        if not b > a:
            first, second = switches[i], switches[(i + 1) % len(switches)]
            names = (_name(equations, switch) for switch in (first, second))
            raise NotCertifiedError(
                "order of instants",
                f"the instants of {' and of '.join(names)} may coincide at phase {float(a.mid()) % period:.6g}, but "
                f"the proof needs a strict order: {_remedy(equations.system, first, second)}",
            )


def _remedy(system: BallSystem, first: Switch, second: Switch) -> str:
    """Return what gives instants that coincide a strict order."""
    if first.is_fixed or second.is_fixed:
        return "certify a point at another Omega"
    if first.element == second.element:
        return "the contact ends as it begins, so certify the grazing point or a point farther from it"
    directions = [[float(x) for x in system.elements[switch.element]["direction"]] for switch in (first, second)]
    if np.linalg.matrix_rank(directions) == 1:
        return "elements in one direction are one contact only if direction, displacement and gap are equal"
    return "in a symmetric machine, model one half, which has the symmetric motions and their multipliers"


def _name(equations: PointEquations, switch: Any) -> str:
    """Return the name of the element of a switch."""
    if switch.is_fixed:
        return "a breakpoint of the stiffness"
    return str(equations.system.elements[switch.element]["name"])


def _check_crossings(equations: PointEquations, Z: Balls, flows: list[Any]) -> None:
    """Require nonzero speeds in the stated direction at all contact instants."""
    system, x, tau = equations.system, equations.states(Z), equations.phases(Z)
    for i in equations.free:
        element, _, sign = equations.order.pattern.switches[i]
        y = system.extended(x[i], tau[i])
        speed = (system.rows[element] @ (flows[i].at(tau[i])[0] @ y)) * sign
        if not speed > 0:
            raise NotCertifiedError(
                "transversality", f"{system.elements[element]['name']} may graze at phase {float(tau[i].mid()):.6g}"
            )


def _check_grazing(equations: PointEquations, Z: Balls, flows: list[Any]) -> None:
    """Require that the gap of a grazing contact touches from its own side, within its segment."""
    if equations.kind != "GR":
        return
    i, element, _, side = equations.order.grazing  # type: ignore[misc]
    t, (a, b) = Z[equations.n + 1], equations.ends(Z)[i]
    if not (t > a and t < b):
        raise NotCertifiedError("grazing", "the grazing does not lie in its segment")
    system = equations.system
    y = _state(equations, Z, flows[i], i, t)
    A, _, slope = flows[i].at(t)
    curvature = system.rows[element] @ (A @ (A @ y)) + system.rows[element] @ (slope @ y)
    if not curvature * side < 0:
        raise NotCertifiedError("grazing", "the gap has no strict extremum at the grazing")


def _state(equations: PointEquations, Z: Balls, flow: Any, i: int, t: Any) -> Balls:
    """Return y at a phase of segment i."""
    a = equations.phases(Z)[i]
    y = equations.system.extended(equations.states(Z)[i], a)
    r = equations.system.r
    return np.concatenate([transition(flow, a, t)[0][:r] @ y, equations.system.functions(t)])


def _check_gaps(equations: PointEquations, Z: Balls, flows: list[Any]) -> None:
    """Require that all gaps lie strictly between their breakpoints in the interior of all segments."""
    system, pattern = equations.system, equations.order.pattern
    x, ends = equations.states(Z), equations.ends(Z)
    for i, contacts in enumerate(pattern.contacts):
        switch, next_switch = pattern.switches[i], pattern.switches[(i + 1) % pattern.count]
        gap_signs = [
            (j, k, sign, SINGLE * (switch[:2] == (j, k)), SINGLE * (next_switch[:2] == (j, k)))
            for j, level in enumerate(contacts.levels)
            for k, sign in ((level - 1, 1), (level, -1))
            if 0 <= k < len(system.breakpoints[j])
        ]
        subsegments = [(x[i], ends[i], gap_signs)]
        if equations.order.grazing and equations.order.grazing[0] == i:
            subsegments = _split_at_grazing(equations, Z, flows[i], i, gap_signs)
        for start, interval, signs in subsegments:
            failed = failing_gap(system, flows[i], start, interval, signs)
            if failed is not None:
                name = system.elements[failed[0]]["name"]
                several = ": several contacts may graze at once, as in a symmetric machine"
                raise NotCertifiedError(
                    "gaps",
                    f"{name} may pass a breakpoint without a switch near phase {failed[1]:.6g}"
                    + (several if equations.kind == "GR" else ""),
                )


def _split_at_grazing(equations: PointEquations, Z: Balls, flow: Any, i: int, gap_signs: list[Any]) -> list[Any]:
    """Return the two parts of the segment with a grazing contact: state, ends and signs of the gaps."""
    _, element, breakpoint, _ = equations.order.grazing  # type: ignore[misc]
    t, (a, b) = Z[equations.n + 1], equations.ends(Z)[i]

    def touching(side: Any) -> bool:
        return bool(side[:2] == (element, breakpoint))

    before = [(*s[:4], DOUBLE if touching(s) else 0) for s in gap_signs]
    after = [(*s[:3], DOUBLE if touching(s) else 0, s[4]) for s in gap_signs]
    grazing_state = _state(equations, Z, flow, i, t)[: equations.system.r]
    return [(equations.states(Z)[i], (a, t), before), (grazing_state, (t, b), after)]


def _multipliers(
    equations: PointEquations, Z: Balls, flows: list[Any]
) -> tuple[tuple[tuple[str, str, str], ...], bool | None]:
    """Return discs of the multipliers, largest modulus first, and whether they lie inside the unit circle."""
    from flint import acb_mat

    r = equations.r
    P = array(matrix(balls(np.eye(r))))
    for flow, (a, b) in zip(flows, equations.ends(Z), strict=True):
        P = transition(flow, a, b)[0][:r, :r] @ P
    try:
        mu = acb_mat(matrix(P)).eig(multiple=True)
    except (ValueError, ZeroDivisionError):
        return (), None
    mu = sorted(mu, key=lambda x: -float(abs(x).mid()))
    special = SIGNS.get(equations.kind)
    tested = list(mu)
    if special is not None:
        nearest = min(tested, key=lambda x: float(abs(x - special).mid()))
        tested.remove(nearest)
    moduli = [abs(x) for x in tested]
    stable = True if all(m < 1 for m in moduli) else False if any(m > 1 for m in moduli) else None
    return tuple(_disc(x) for x in mu), stable


def _disc(x: Any) -> tuple[str, str, str]:
    """Return real part, imaginary part and radius of a disc that contains a ball of complex numbers."""
    real, imaginary = (part.mid().str(DECIMALS, radius=False) for part in (x.real, x.imag))
    radius = float(x.real.rad()) + float(x.imag.rad())
    return real, imaginary, f"{radius * (1 + 1e-6) + 10.0 ** (3 - DECIMALS):.2e}"


def outward(x: Any, decimals: int = DECIMALS) -> tuple[str, str]:
    """Return decimals below and above all numbers of a ball, rounded outward."""
    scale = 10**decimals
    low, high = (_fraction(end) * scale for end in (x.lower(), x.upper()))
    return _text(low.numerator // low.denominator, decimals), _text(-(-high.numerator // high.denominator), decimals)


def _fraction(x: Any) -> Fraction:
    """Return an exact ball as a fraction."""
    mantissa, exponent = x.man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def _text(number: int, decimals: int) -> str:
    """Return number / 10^decimals as a decimal."""
    sign, digits = "-" if number < 0 else "", str(abs(number)).rjust(decimals + 1, "0")
    return f"{sign}{digits[:-decimals]}.{digits[-decimals:]}"
