"""Special points, verdicts and landings of a traced machine compared with shooting and integration in time.

    python -m studies.random.truth --count 20            # of each kind; the worst pairs of true and stated error
    python -m studies.random.truth spur:7 two:3          # these machines, point by point

Reference points are computed by shooting: Newton's method for the state after a period (DOP853 with the variational
equation, events at the breakpoints of the laws) in the plane across the curve, and a secant along it to

    LP  t_Omega = 0      PD  det(Phi + 1) = 0      NS  |mu| = 1 of a pair      GR  extremum of an element = breakpoint

Candidates are the special points of the curve and of a trace with four times the harmonics. A point of the finer trace
that shooting confirms and that is not on the curve is missing; a point of the curve that shooting does not confirm is
false. Branch points are compared with the finer trace only.
"""

from __future__ import annotations

import argparse
import contextlib
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import scipy

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Jump, Point, SpecialPoint
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NoConvergence, solve
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.time.exponential.modal_states import modal_state, physical_state
from hbgear.time.integration import state_of
from hbgear.time.runge_kutta import Flow
from hbgear.time.shooting import variation
from studies.random.machines import KINDS, Machine, machine

FINER = 4
"""Factor of the harmonics of the finer trace, whose special points are candidates."""

NEAR = 0.1
"""Distance, in Omega over the span and in the motion over its size, within which shooting searches for a point."""

SAME = 0.01
"""The same distance, within which points of two traces are the same."""

KNOWN = 1e-5
"""Distance in Omega over the span within which a point of shooting is a point of the curve."""

POINTS_PER_CURVE = 4
"""Points of each curve whose stability is compared: half of them have multipliers nearest to the unit circle."""

SAME_MOTION = 1e-4
"""Distance of displacements, over their size, within which shooting stays at the motion of a point."""

MAX_COMPARED_POINTS = 8
"""Largest number of special points that are compared; points without a partner in the finer trace first."""

KINDS_SHOT = ("LP", "PD", "NS", "GR")


class NotFound(Exception):
    """Shooting does not find the motion or the point."""


# ---- shooting


class Orbits:
    """Periodic motions of a model by shooting, in planes across their curve: u = (state, Omega).

    P removes the drift of free motions from a state; scale (2n + 1,) are the scales of states and Omega.
    """

    def __init__(self, model: hb.mechanics.Model, nu: int, y: Array, Omega: float, span: float) -> None:
        self.model, self.nu, self.system = model, nu, model.system()
        self.structure = LinearStructure(self.system.at_speed(Omega))
        size = len(y)
        self.P = np.array([physical_state(self.structure, modal_state(self.structure, e)) for e in np.eye(size)]).T
        self.scale = np.append(np.full(size, float(np.linalg.norm(y)) or 1.0), span)

    def _end(self, u: Array) -> Array:
        flow = Flow(self.system, float(u[-1]))
        return flow.integrate(0.0, u[:-1], self.nu * 2 * np.pi / flow.Omega, "DOP853", 1e-12)[0]

    def slope(self, u: Array) -> Array:
        """Return the derivative of the final state in Omega, by a central difference, without the drift."""
        h = np.append(np.zeros(len(u) - 1), 1e-5 * u[-1])
        out: Array = self.P @ (self._end(u + h) - self._end(u - h)) / (2 * h[-1])
        return out

    def at(self, u: Array, normal: Array, slope: Array) -> Orbit:
        """Return the motion in the plane across ``normal`` (scaled) through u.

        The slope of a motion nearby is sufficient: it rotates the tangent slightly, but does not change the point where
        its last component vanishes.

        Raises
        ------
        NotFound
            If Newton does not converge.
        """
        start, size = u, len(u) - 1
        for _ in range(12):
            flow = Flow(self.system, float(u[-1]), variational=True)
            end, Phi, reduced = variation(flow, self.structure, u[:-1], self.nu, 1e-12)
            gap = self.P @ (end - u[:-1])
            A = np.vstack([np.column_stack([self.P @ Phi @ self.P - self.P, slope]) * self.scale, normal])
            solver = np.linalg.pinv(A, rcond=1e-12)
            du = self.scale * (solver @ -np.append(gap, normal @ ((u - start) / self.scale)))
            if not np.isfinite(du).all() or np.linalg.norm(du / self.scale) > 0.5:
                break
            u = u + du
            if np.linalg.norm(du / self.scale) < 1e-9:
                mu = np.linalg.eigvals(reduced)
                tangent = solver @ np.eye(size + 1)[-1]
                return Orbit(self, u, tangent / np.linalg.norm(tangent), mu, reduced)
        raise NotFound(f"no motion at Omega = {start[-1]:.6g}")


@dataclass(frozen=True, eq=False)
class Orbit:
    """A motion found by shooting: u, unit tangent (scaled) and multipliers."""

    of: Orbits
    u: Array
    tangent: Array
    multipliers: Array
    reduced: Array

    @property
    def Omega(self) -> float:
        """Frequency of the excitation."""
        return float(self.u[-1])

    @property
    def largest(self) -> float:
        """Modulus of the largest multiplier."""
        return float(np.abs(self.multipliers).max())

    def extremes(self) -> Array:
        """Return the lowest and highest value (m, 2) of every element, by the cubic through samples and their rates."""
        motion = hb.time.integrate(self.of.model, self.u[:-1], self.of.nu, self.Omega, samples=1024)
        h = (motion.tau[1] - motion.tau[0]) / self.Omega
        out = []
        for d, v in zip(motion.d, motion.v * h, strict=True):
            d1, v1 = np.roll(d, -1), np.roll(v, -1)
            a, b = v + v1 - 2 * (d1 - d), 3 * (d1 - d) - 2 * v - v1
            with np.errstate(all="ignore"):
                roots = [(-b + sign * np.sqrt(b * b - 3 * a * v)) / (3 * a) for sign in (1, -1)]
                inside = [np.where((s > 0) & (s < 1), d + s * (v + s * (b + s * a)), d) for s in roots]
            ends = np.nan_to_num(np.array([*inside, d]), nan=float(d[0]))
            out.append([ends.min(), ends.max()])
        return np.array(out)


def locate_by_shooting(kind: str, orbits: Orbits, u: Array, tangent: Array, corner: tuple[int, int, float]) -> Orbit:
    """Return the special point near u, by the secant method for its test function along the curve.

    tangent : tangent of the curve (scaled). corner : for grazing points the element, 0 or 1 for its lowest or highest
    value, and the breakpoint.

    Raises
    ------
    NotFound
        If no motion is within `NEAR`.
    """
    test, slope = _test(kind, corner), orbits.slope(u)
    orbit = orbits.at(u, tangent, slope)
    tangent, u = orbit.tangent, orbit.u
    here, ahead = (0.0, test(orbit)), 1e-3
    for _ in range(9):
        try:
            orbit = orbits.at(u + ahead * orbits.scale * tangent, tangent, slope)
        except NotFound:
            ahead = 0.5 * (here[0] + ahead)
            continue
        there = ahead, test(orbit)
        rise = (there[1] - here[1]) / (there[0] - here[0])
        ahead = there[0] - there[1] / rise if rise else np.nan
        if not abs(ahead) <= NEAR:
            break
        if abs(ahead - there[0]) <= 1e-8:
            return orbit
        here = there if abs(there[1]) < abs(here[1]) else here
    raise NotFound(f"no {kind} near Omega = {u[-1]:.6g}")


def _test(kind: str, corner: tuple[int, int, float]) -> Callable[[Orbit], float]:
    if kind == "LP":
        return lambda orbit: float(orbit.tangent[-1])
    if kind == "PD":
        return lambda orbit: float(np.prod(orbit.multipliers + 1).real)
    if kind == "NS":
        return _pair
    element, side, level = corner
    return lambda orbit: float(orbit.extremes()[element, side]) - level


def _pair(orbit: Orbit) -> float:
    """Return log |mu| of the complex pair nearest to the unit circle."""
    mu = orbit.multipliers
    sizes = np.log(np.abs(mu[np.abs(mu.imag) > 1e-6 * np.abs(mu)]))
    if not sizes.size:
        raise NotFound("no complex pair")
    return float(sizes[np.argmin(np.abs(sizes))])


# ---- special points


@dataclass(frozen=True)
class ComparedPoint:
    """A special point: Omega of the curve and of the reference (nan if missing or false), stated error, and method."""

    machine: str
    kind: str
    Omega: float
    true: float
    stated: float
    by: str

    @property
    def error(self) -> float:
        """True error of Omega."""
        return abs(self.Omega - self.true)


@dataclass(frozen=True)
class Verdict:
    """Stability of a point (None: undecided), and its largest multiplier, of the curve and of the reference."""

    machine: str
    Omega: float
    stable: bool | None
    reported: float
    true: float

    @property
    def wrong(self) -> bool:
        """Whether the stability is decided and wrong; a multiplier on the unit circle is neither of both."""
        neutral = abs(self.true - 1) <= STABILITY_TOLERANCE
        return self.stable is not None and not neutral and self.stable != (self.true < 1)


@dataclass(frozen=True)
class ComparedJump:
    """Landing of a jump: rms of the first element of the curve (nan: no motion) and of another integration."""

    machine: str
    label: str
    Omega: float
    reported: float
    true: float
    right: bool
    note: str

    @property
    def sure(self) -> bool:
        """Return whether the motion is determined for every sweep: not indeterminate, not left slowly."""
        return "indeterminate" not in self.note and "slow" not in self.note


@dataclass(frozen=True)
class Comparison:
    """All comparisons of one machine."""

    machine: str
    points: list[ComparedPoint] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    jumps: list[ComparedJump] = field(default_factory=list)
    seconds: float = 0.0


def stated(point: Point) -> float:
    """Return the stated error of a special point; nan if it has none."""
    return float(getattr(point, "error", np.nan))


def reported_stability(point: Point) -> bool | None:
    """Return whether a point is stable; None if it is undecided."""
    return None if getattr(point, "stability", "") == "undecided" else point.stable


def curves(branch: Branch) -> list[Branch]:
    """Return a branch and the other branches of its span."""
    return [branch, *branch.others]


def compare(it: Machine, harmonics: int = 16, jumps: bool = True, seed: int = 0) -> Comparison:
    """Trace a machine by the default call and compare it with the references."""
    begun = time.process_time()
    branch = traced(it, harmonics)
    fine = traced(it, FINER * harmonics, accuracy=None)
    found, random = Comparison(it.name), np.random.default_rng(seed)
    found.points.extend(special_points(it, branch, fine, random))
    for one in curves(branch):
        found.verdicts.extend(verdicts(it, one, fine.problem, random))
    if jumps:
        found.jumps.extend(compared_jumps(it, branch))
    return Comparison(it.name, found.points, found.verdicts, found.jumps, time.process_time() - begun)


def traced(it: Machine, harmonics: int, **options: Any) -> Branch:
    """Return the response curve of a machine."""
    with warnings.catch_warnings(action="ignore"):
        return hb.trace(hb.HarmonicBalance(it.model, harmonics), "Omega", it.span, **options)


def special_points(it: Machine, branch: Branch, fine: Branch, random: np.random.Generator) -> list[ComparedPoint]:
    """Compare special points of a curve, at most `MAX_COMPARED_POINTS`, and return the missing ones.

    Grazing points at inner extrema are left out, because shooting solves for the highest and the lowest extremum.
    """
    mine, finer = (
        [(one, p) for one in curves(whole) for p in one.special if not p.note.startswith("inner extremum")]
        for whole in (branch, fine)
    )
    partner = dict(matched(it, [p for _, p in mine], [p for _, p in finer]))
    alone = random.permutation([i for i in range(len(mine)) if i not in partner])[: MAX_COMPARED_POINTS // 2].astype(
        int
    )
    more = [j for j in range(len(finer)) if j not in partner.values() and finer[j][1].kind in KINDS_SHOT]
    more = random.permutation(more)[: MAX_COMPARED_POINTS // 2].astype(int).tolist()
    both = random.permutation(list(partner))[: MAX_COMPARED_POINTS - len(alone) - len(more)].astype(int)
    out = []
    for i in (*sorted(both), *alone):
        pair = finer[partner[i]] if i in partner else mine[i]
        others = [
            p.parameters["Omega"]
            for _, p in (*finer, *mine)
            if p.kind == pair[1].kind and p is not pair[1] and p is not mine[i][1]
        ]
        out.append(_compared(it, mine[i][1], *pair, sure=i in partner, others=others))
    for j in more:
        one, p = finer[j]
        try:
            true = point_by_shooting(it, one, p)
        except NotFound:
            continue
        within = KNOWN * abs(it.span[1] - it.span[0])
        if not any(q.kind == p.kind and abs(q.parameters["Omega"] - true) < within for _, q in mine):
            out.append(ComparedPoint(it.name, p.kind, np.nan, true, np.nan, "shooting"))
    return out


def _compared(
    it: Machine, p: SpecialPoint, branch: Branch, near: SpecialPoint, sure: bool, others: Sequence[float]
) -> ComparedPoint:
    """Compare a special point; shooting starts from another point of a branch.

    sure : whether that point belongs to the finer trace. others : Omega of other points of its kind; a result nearer to
    one of them is refused.
    """
    Omega, true, by = p.parameters["Omega"], np.nan, "none"
    try:
        found = point_by_shooting(it, branch, near)
        if any(abs(found - other) < abs(found - near.parameters["Omega"]) for other in others):
            raise NotFound("shooting went to another point")
        true, by = found, "shooting"
    except NotFound:
        if sure:
            true, by = near.parameters["Omega"], "finer"
    return ComparedPoint(it.name, p.kind, Omega, true, stated(p), by)


def point_by_shooting(it: Machine, branch: Branch, point: SpecialPoint) -> float:
    """Return Omega of the special point near a point of a branch, by shooting.

    Raises
    ------
    NotFound
        If shooting does not find it.
    """
    if point.kind not in KINDS_SHOT:
        raise NotFound(f"{point.kind} is not computed by shooting")
    problem, here = branch.problem, point.parameters
    y = state_of(problem, problem.from_point(point), **here)
    orbits = Orbits(it.model, problem.nu, y, here["Omega"], abs(it.span[1] - it.span[0]))
    before, after = (branch[max(i, 0)] for i in (point.index - 1, min(point.index + 1, len(branch) - 1)))
    ends = [
        np.append(state_of(problem, problem.from_point(b), **b.parameters), b.parameters["Omega"])
        for b in (before, after)
    ]
    tangent = (ends[1] - ends[0]) / orbits.scale
    try:
        found = locate_by_shooting(
            point.kind, orbits, np.append(y, here["Omega"]), tangent / np.linalg.norm(tangent), _corner(branch, point)
        )
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise NotFound(str(error)) from error
    return found.Omega


def _corner(branch: Branch, point: SpecialPoint) -> tuple[int, int, float]:
    """Return element, side and breakpoint of a grazing point."""
    if point.kind != "GR":
        return 0, 0, 0.0
    problem = branch.problem
    which = list(problem.clearance_names).index(point.note.split(", ")[0])
    element = problem.clearance_elements[which]
    own = [i for i, j in enumerate(problem.clearance_elements) if j == element].index(which)
    return element, own % 2, float(problem.compiled({}).laws[element].breakpoints[own // 2])


def matched(it: Machine, mine: Sequence[SpecialPoint], finer: Sequence[SpecialPoint]) -> list[tuple[int, int]]:
    """Return pairs of points of one kind that are nearest to each other, within `SAME`."""
    out = []
    for kind in sorted({p.kind for p in mine}):
        a = [i for i, p in enumerate(mine) if p.kind == kind]
        b = [j for j, p in enumerate(finer) if p.kind == kind]
        far = np.array([[_distance(it, mine[i], finer[j]) for j in b] for i in a]).reshape(len(a), len(b))
        for i, j in zip(*scipy.optimize.linear_sum_assignment(np.minimum(far, SAME)), strict=True):
            if far[i, j] < SAME:
                out.append((a[i], b[j]))
    return out


def _distance(it: Machine, one: SpecialPoint, other: SpecialPoint) -> float:
    apart = abs(one.parameters["Omega"] - other.parameters["Omega"]) / abs(it.span[1] - it.span[0])
    if one.kind == "GR" and one.note.split(", ")[0] not in other.note.split(", "):
        return np.inf
    sizes = np.array([[p.amplitude("rms", j) for j in range(len(one.regime))] for p in (one, other)])
    return float(apart + np.linalg.norm(sizes[0] - sizes[1]) / (np.linalg.norm(sizes) or 1.0))


# ---- verdicts


def verdicts(it: Machine, branch: Branch, finer: hb.HarmonicBalance, random: np.random.Generator) -> list[Verdict]:
    """Compare the stability of points, half of them nearest to the unit circle, with multipliers by shooting.

    Close to a fold shooting may converge to the motion beyond it, whose displacements differ from the finer balance.
    Velocities are not compared: they converge slowly where the excitation has a breakpoint.
    """
    if branch.multipliers is None:
        return []
    plain = np.setdiff1d(np.arange(len(branch)), [p.index for p in branch.special])
    size = np.abs(branch.multipliers).max(axis=1, initial=0.0)[plain]
    close = plain[np.argsort(np.abs(size - 1))[: POINTS_PER_CURVE // 2]]
    some = random.choice(
        np.setdiff1d(plain, close), min(POINTS_PER_CURVE // 2, max(0, len(plain) - len(close))), replace=False
    )
    out = []
    for i in sorted({*close.tolist(), *some.tolist()}):
        point = branch[i]
        try:
            X = solve(finer, finer.from_point(point), point.parameters).X
            y = state_of(finer, X, **point.parameters)
            orbit = hb.time.shoot(it.model, point.parameters["Omega"], y, tolerance=1e-10)
        except (*SOLVER_ERRORS, ArithmeticError):
            continue
        n = len(y) // 2
        if np.linalg.norm(orbit.state[:n] - y[:n]) < SAME_MOTION * np.linalg.norm(y[:n]):
            sizes = [float(np.abs(mu).max(initial=0.0)) for mu in (point.multipliers, orbit.multipliers)]
            out.append(Verdict(it.name, point.parameters["Omega"], reported_stability(point), *sizes))
    return out


# ---- landings

BEYOND = 1.3e-4
"""Distance beyond the jump, over the span; `hbgear.time.jump_integration` uses other distances."""

PERIODS, PATIENCE = 2000, 20
"""Excitation periods of one integration, and the largest number of integrations until the motion has left the unstable
motion; disturbances grow slowly near a loss of stability."""

FARTHER = 8.0, 64.0
"""Factors of the distance beyond the jump for motions that have not left the unstable motion."""


def compared_jumps(it: Machine, branch: Branch) -> list[ComparedJump]:
    """Compare the jumps of a curve, decided by integration, with another integration from another distance."""
    out = []
    for jump in branch.jumps(landing="integrate"):
        for times in (1.0, *FARTHER):
            Omega = jump.value + times * jump.direction * BEYOND * float(np.ptp(branch.values))
            begin = _sizes(branch, jump.before, Omega)
            true = _settled(it, branch, jump, Omega, begin)
            after = np.full(len(true), np.nan) if jump.after is None else _sizes(branch, jump.after, Omega)
            right = _lands(jump, after, true)
            if right or not _alike(begin, true):  # both motions may have nearly the same size
                break
        out.append(ComparedJump(it.name, jump.label, jump.value, float(after[0]), float(true[0]), right, jump.note))
    return out


def _settled(it: Machine, branch: Branch, jump: Jump, Omega: float, begin: Array) -> Array:
    """Return the rms of the elements of the motion after a jump, once it has left the first motion (rms ``begin``).

    The integration continues for at least the same time after it has left, until it has settled.
    """
    state = state_of(branch.problem, branch.problem.from_point(jump.before), **jump.before.parameters)
    state = state * (1.0 + 1e-4 * np.random.default_rng(0).normal(size=len(state)))
    true, gone = begin, 0
    for taken in range(1, PATIENCE + 1):
        try:
            state = hb.time.integrate(it.model, state, PERIODS, Omega, method="exponential", samples=1).end
            seen = hb.time.integrate(it.model, state, 64, Omega, method="exponential", samples=64).d
        except ArithmeticError:
            return np.full(len(begin), np.inf)
        with np.errstate(invalid="ignore"):
            true = np.nan_to_num(seen.std(axis=-1), nan=np.inf)
        gone = gone or (0 if _alike(begin, true) else taken)
        if gone and taken >= 2 * gone:
            break
    return true


def _alike(one: Array, other: Array) -> bool:
    return bool(np.linalg.norm(one - other) <= 0.02 * np.linalg.norm(other))


def _sizes(branch: Branch, motion: Point, Omega: float) -> Array:
    """Return the rms of the elements of a motion at another frequency nearby."""
    problem = branch.problem.with_order(motion.layout.nu)  # type: ignore[union-attr]
    X = problem.from_point(motion)
    with contextlib.suppress(NoConvergence):
        X = solve(problem, X, {**motion.parameters, "Omega": Omega}).X
    return np.array([problem.layout.measure("rms", X, j) for j in range(problem.m)])


def _lands(jump: Jump, after: Array, true: Array) -> bool:
    """Return whether the integrated motion is the landing; without a landing, it is not periodic or unbounded."""
    if jump.after is None:
        return "not periodic" in jump.note or not np.isfinite(true).all()
    return _alike(after, true)


# ---- summary


def summary(found: Iterable[Comparison], worst: int = 15) -> str:
    """Return counts, and the points with the largest ratios of true and stated error."""
    found = list(found)
    points = [p for one in found for p in one.points]
    known = [p for p in points if np.isfinite(p.error)]
    lines = [f"{len(found)} machines, {sum(one.seconds for one in found):.0f} s"]
    for kind in sorted({p.kind for p in points}):
        some = [p for p in points if p.kind == kind]
        errors = [p.error for p in some if np.isfinite(p.error)] or [np.nan]
        false, missing = sum(np.isnan(p.true) for p in some), sum(np.isnan(p.Omega) for p in some)
        by = sum(p.by == "shooting" for p in some)
        lines.append(
            f"{kind}: {len(some)} points, {by} by shooting, {false} false, {missing} missing, error median "
            f"{np.median(errors):.1e}, largest {np.max(errors):.1e}"
        )
    ratio = np.array([p.error / max(p.stated, 1e-9) for p in known])
    if ratio.size:
        lines.append(
            f"true error below three times the stated one: {np.mean(ratio < 3):.1%}, below ten times: "
            f"{np.mean(ratio < 10):.1%}"
        )
    rows = [v for one in found for v in one.verdicts]
    wrong = [v for v in rows if v.wrong]
    undecided = sum(v.stable is None for v in rows)
    lines.append(f"{len(rows)} points: stability of {len(wrong)} wrong, {undecided} undecided")
    jumps = [j for one in found for j in one.jumps]
    lines.append(f"{len(jumps)} jumps: {sum(not j.right for j in jumps)} land elsewhere")
    lines += ["", "worst true error over stated error: machine, kind, curve, reference, error, stated"]
    order = np.argsort(-ratio)[:worst] if ratio.size else []
    lines += [_line(known[i]) for i in order]
    lines += ["", "missing or false:"] + [_line(p) for p in points if not np.isfinite(p.error)]
    lines += ["", "wrong stability: machine, Omega, stable, |mu| of the curve, of the reference"]
    lines += [f"{v.machine} {v.Omega:.7g} {v.stable} {v.reported:.7f} {v.true:.7f}" for v in wrong]
    lines += ["", "jumps that land elsewhere: machine, label, Omega, rms of the curve, of the reference, note"]
    lines += [
        f"{j.machine} {j.label} {j.Omega:.7g} {j.reported:.5g} {j.true:.5g} {j.note}" for j in jumps if not j.right
    ]
    return "\n".join(lines)


def _line(p: ComparedPoint) -> str:
    return f"{p.machine} {p.kind} {p.Omega:.9g} {p.true:.9g} {p.error:.1e} {p.stated:.1e} {p.by}"


def main() -> None:
    """Compare machines of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.random.truth", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("machines", nargs="*", metavar="KIND:NUMBER", help="these machines")
    parser.add_argument("--count", type=int, default=5, help="of each kind, if none are named")
    parser.add_argument("--first", type=int, default=0, help="number of the first of them")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--no-jumps", action="store_true", help="leave out the landings, which take the most time")
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.count)
    names = given.machines or [f"{kind}:{i}" for i in numbers for kind in given.kinds]
    found = []
    for name in names:
        kind, number = name.split(":")
        try:
            found.append(compare(machine(kind, int(number)), jumps=not given.no_jumps))
        except NoConvergence as error:
            print(f"{name}: {error}")
            continue
        one = found[-1]
        print(f"{name}: {one.seconds:.1f} s, {len(one.points)} points", flush=True)
        if given.machines:
            print("\n".join(map(str, [*map(asdict, one.points), *map(asdict, one.verdicts), *map(asdict, one.jumps)])))
    print(summary(found))


if __name__ == "__main__":
    main()
