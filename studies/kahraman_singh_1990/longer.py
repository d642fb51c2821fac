"""Branches of longer periods, from a motion of a sweep, and branches that start at their period doublings.

A sweep knows the state (x, x') at tau = 0 of a motion of nu periods. Shooting closes it, its harmonics start the
harmonic balance of order nu, and continuation does the rest. Where its branch ends on one of half the period, that one
is followed instead, down to a branch that no other one leads to: a closed curve, or one that is known already.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

import hbgear as hb
from hbgear.analysis.branch_search.multistart import complete_branch
from hbgear.common.arrays import Array
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series import measures
from hbgear.mechanics.series.fourier import evaluate, resize, to_complex, to_real
from hbgear.time.frequency_sweep import Sweep
from hbgear.time.shooting import Orbit

HARMONICS = 16
"""Of the excitation, in branches that start from a sweep."""


def order(branch: hb.Branch) -> int:
    """nu: how many periods of the excitation its motions take."""
    assert branch.layout is not None
    return branch.layout.nu


def orbit(pair: hb.SpurPair, Omega: float, x: float, rate: float, nu: int) -> Orbit:
    """The motion of nu periods with about this displacement and rate at tau = 0, closed by shooting."""
    error = pair.transmission_error.row()
    state = [x + evaluate(error, 0.0)[0], rate + Omega * evaluate(error, 0.0, 1)[0]]  # q = x + e
    return hb.time.shoot(pair, Omega, state, nu)


def root(pair: hb.SpurPair, found: Orbit, span: tuple[float, float]) -> hb.Branch:
    """The branch a motion belongs to or, if that doubles from another one, the first of its ancestors."""
    problem = hb.HarmonicBalance(pair, HARMONICS * found.nu, nu=found.nu)
    X, Omega = found.rows(problem.H).ravel(), found.Omega
    while True:
        X = solve(problem, X, {**problem.parameters, "Omega": Omega}).X
        branch = complete_branch(problem, X, Omega, span, hb.StepControl(), stability=True)
        if branch.status != Status.MERGED or problem.nu % 2:
            return branch
        X, Omega = _halved(branch.X[-1]), float(branch.values[-1])
        problem = hb.HarmonicBalance(pair, problem.H // 2, nu=problem.nu // 2)


def _halved(X: Array) -> Array:
    """A motion as one of half the period, in whose basis it has its even harmonics only."""
    return to_real(to_complex(X)[::2])


def doubled(branch: hb.Branch, span: tuple[float, float]) -> tuple[hb.Branch, ...]:
    """The branches of twice the period that leave at period doublings, each once: they join the branch again."""
    found: list[hb.Branch] = []
    left = [point for point in branch.special if point.kind == "PD"]
    while left:
        found.append(hb.switch(branch, left.pop(0).label, span))
        if found[-1].status == Status.MERGED and left:
            left.remove(_joined(found[-1], left))
    return tuple(found)


def _joined(branch: hb.Branch, doublings: list[hb.SpecialPoint]) -> hb.SpecialPoint:
    """At which of these points of its parent a branch ends."""
    Omega, X = float(branch.values[-1]), _halved(branch.X[-1])

    def away(point: hb.SpecialPoint) -> float:
        mine = resize(point.coefficients()[None], (len(X) - 1) // 2)[0]
        return float(abs(point.parameters["Omega"] - Omega) + np.linalg.norm(mine - X))

    return min(doublings, key=away)


def family(branch: hb.Branch, span: tuple[float, float], longest: int) -> list[hb.Branch]:
    """A branch and all that double from it, and from those in turn, up to a longest period."""
    out = [branch]
    for parent in out:  # grows as branches are found
        if 2 * order(parent) <= longest:
            out += doubled(parent, span)
    return out


def motions_at(branch: hb.Branch, Omega: float) -> list[Array]:
    """Unknowns of every stable motion of a branch at exactly this frequency."""
    stable, here = np.asarray(branch.stable), {**branch.problem.parameters, "Omega": Omega}
    found = []
    for place in crossings_at(branch, Omega):
        if stable[place.index : place.index + 2].any():
            try:
                found.append(solve(branch.problem, place.interpolate(branch.X), here).X)
            except hb.NoConvergence:
                continue
    return found


def lies_on(branches: Iterable[hb.Branch], swept: Sweep, i: int) -> bool:
    """Whether row i of a sweep is a motion of one of the branches: its period, and its rms to a thousandth."""
    rms, Omega, nu = float(swept.rms[i, 0]), float(swept.values[i]), int(swept.period[i])
    motions = [X for branch in branches if order(branch) == nu for X in motions_at(branch, Omega)]
    return any(abs(float(measures.rms(X)) - rms) < 1e-3 * rms for X in motions)


def isolated(
    pair: hb.SpurPair, known: list[hb.Branch], sweeps: Iterable[Sweep], span: tuple[float, float], longest: int
) -> list[hb.Branch]:
    """Branches, with those that double from them, of the swept motions of longer periods that lie on none known."""
    out: list[hb.Branch] = []
    for swept in sweeps:
        for i in np.flatnonzero(swept.period > 1):
            if not lies_on([*known, *out], swept, int(i)):
                x, rate = swept.points[i][0, 0]
                found = orbit(pair, float(swept.values[i]), float(x), float(rate), int(swept.period[i]))
                out += family(root(pair, found, span), span, longest)
    return out
