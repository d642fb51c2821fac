"""Guesses from which Newton finds a first periodic motion.

The state of rest under the constant loads comes first, with the linear response about it. Other static states are
looked for where laws bend: at their corners, and where a smooth law has changed its stiffness by that of the structure.
No length comes from the unit in which a model is written.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.homotopy import solve_along
from hbgear.continuation.newton import NoConvergence, Solution, solve
from hbgear.continuation.problem import Evaluation, FullProblem
from hbgear.continuation.stepsize import StepControl
from hbgear.continuation.tracer import trace
from hbgear.harmonic.compiled import Compiled
from hbgear.harmonic.realbasis import derivative
from hbgear.mechanics.fourier import places, to_real
from hbgear.mechanics.references import bend


class Static(NamedTuple):
    """A static state of the elements: d (m,), the stiffness (m,) of laws there, whether it is balanced, and stable.

    flat : balanced, and neither stable nor unstable, as in a gap without load.
    """

    d: Array
    stiffness: Array
    balanced: bool
    stable: bool
    flat: bool = False


def guesses(compiled: Compiled, Omega: float) -> Iterator[Array]:
    """Linear responses about static states, and these states alone: the stable ones first."""
    for static in statics(compiled, Omega):
        d = _response(compiled, Omega, static)
        yield to_real(d).ravel()
        yield to_real(np.concatenate([d[:, :1], 0 * d[:, 1:]], axis=1)).ravel()


def statics(compiled: Compiled, Omega: float) -> Iterator[Static]:
    """Static states that Newton finds with harmonic 0 alone: of rest, and from several sides; the stable ones first.

    Where Newton finds no balance, its last iterate comes in the end.
    """
    rest = _balanced(compiled, Omega, -compiled.receptance.e[0].real)
    if rest.stable or rest.flat:
        yield rest
    reach = _reach(compiled, Omega) * _pushed(compiled, Omega)
    others = []
    for side in (1.5, -1.5, 4.0, -4.0):
        found = _balanced(compiled, Omega, side * reach)
        if found.stable:
            yield found
        elif np.isfinite(found.d).all():
            others.append(found)
    others += [] if rest.stable or rest.flat else [rest]
    yield from sorted(others, key=lambda one: not one.balanced)


def _balanced(compiled: Compiled, Omega: float, d: Array) -> Static:
    """The static state that Newton finds from displacements d (m,) of the elements."""
    linear, joint, ties = compiled.linear(Omega), compiled.structure.joint, compiled.structure.ties
    e, Z, g = compiled.receptance.e[0].real, linear.Z[0].real, linear.g[0].real
    for _ in range(_STEPS):
        p, k = _static(compiled.laws, d)
        r = joint @ (Z @ d + g + p) + ties @ (d + e)
        terms = np.abs(joint) @ (np.abs(Z) @ np.abs(d) + np.abs(g) + np.abs(p)) + np.abs(ties) @ np.abs(d + e)
        if np.linalg.norm(r) <= _ROUNDING * np.linalg.norm(terms):
            break
        step = np.linalg.lstsq(joint @ (Z + np.diag(k)) + ties, r, rcond=1e-12)[0]
        d = d - step
        if not np.isfinite(d).all() or (np.abs(step) <= _STATIC * np.abs(d)).all():
            break
    balanced = bool(np.isfinite(d).all() and np.linalg.norm(r) <= _BALANCED * np.linalg.norm(terms))
    own = joint[compiled.structure.own]  # forces on the others act through their ties
    A = Z[np.ix_(compiled.structure.own, compiled.structure.own)] + (own * k) @ own.T
    size = np.abs(Z).max(initial=0.0) + np.abs(k).max(initial=0.0)
    if not balanced:
        return Static(d, k, False, False)
    least = float(np.linalg.eigvalsh(0.5 * (A + A.T))[0])
    return Static(d, k, True, least > _FLAT * size, abs(least) <= _FLAT * size)


_STEPS = 50  # of Newton to a static state


_ROUNDING = 1e-13  # force left over, relative to the terms, that no step makes smaller


_STATIC = 1e-7  # step of Newton, relative, behind which a static state is one to all digits


_BALANCED = 1e-6  # force left over, relative to the terms it is the sum of, of a static state


_FLAT = 1e-9  # stiffness, relative, of a position that is arbitrary


def _response(compiled: Compiled, Omega: float, static: Static) -> Array:
    """Harmonics (m, K + 1) of the linear response about a static state."""
    linear, joint, ties = compiled.linear(Omega), compiled.structure.joint, compiled.structure.ties
    with np.errstate(all="ignore"):
        try:
            A = joint @ (linear.Z + np.diag(static.stiffness)) + ties
            b = linear.g @ joint.T + compiled.receptance.e @ ties.T
            d = np.linalg.solve(A, -b[..., None])[..., 0].T
        except np.linalg.LinAlgError:
            d = np.zeros((compiled.m, len(linear.Z)), dtype=complex)
    d[:, 0] = static.d
    return np.where(np.isfinite(d), d, 0.0)


def _reach(compiled: Compiled, Omega: float) -> Array:
    """Lengths (m,) at which laws change: corners, where a smooth law bends, or as far as the loads move the element."""
    springs = compiled.structure.kr
    reach = np.array([max(np.abs(law.breakpoints), default=0.0) for law in compiled.laws])
    if reach.all():
        return reach
    own = np.abs(np.diag(compiled.linear(Omega).Z[0].real) + _static(compiled.laws, np.zeros(compiled.m))[1])
    stiffness = np.where(own > _FLAT * springs, own, springs)  # what a smooth law must change by to matter
    for j in np.flatnonzero(reach == 0):
        reach[j] = 0.0 if compiled.laws[j].breakpoints else bend(compiled.laws[j], float(stiffness[j]))
    if not reach.all():
        whole = Static(np.zeros(compiled.m), springs, True, True)
        moved = np.abs(_response(compiled, Omega, whole)).sum(axis=1) + np.abs(_against(compiled, Omega))
        reach = np.where(reach == 0, moved, reach)
    return reach


def _against(compiled: Compiled, Omega: float) -> Array:
    """Where the constant load puts the elements (m,), as if their laws were linear springs."""
    linear, joint, ties = compiled.linear(Omega), compiled.structure.joint, compiled.structure.ties
    b = joint @ linear.g[0].real + ties @ compiled.receptance.e[0].real
    closed = joint @ (linear.Z[0].real + np.diag(compiled.structure.kr)) + ties
    d: Array = np.linalg.lstsq(closed, -b, rcond=1e-12)[0]
    return d


def _pushed(compiled: Compiled, Omega: float) -> Array:
    """Side, +1 or -1, to which the constant load pushes each element (m,)."""
    return np.where(_against(compiled, Omega) < 0, -1.0, 1.0)


def _static(laws: Any, d: Array) -> tuple[Array, Array]:
    """Mean over the phase of each law's force and stiffness at constant d (m,)."""
    tau, still = 2 * np.pi * np.arange(64) / 64, np.zeros(64)
    with np.errstate(all="ignore"):  # a law may have no value so far out
        out = [law.force(np.full(64, x), still, tau)[:2] for law, x in zip(laws, d, strict=True)]
    p, k = np.array(out).sum(axis=2).T / 64
    return p, k


class _Damped(FullProblem):
    """The balance with dampers parallel to the elements that hold them still at s = 0 and are gone at s = 1.

        R_0 = 0,   s^3 R_k + (1 - s)^3 i (k / nu) kr d_k = 0,  k > 0

    With damping the power of the loads bounds the velocity, so the path cannot run off to infinity while s < 1; it
    starts at a static state, and ends at a motion if there is but one such state. The third power spreads dampers
    over many orders of magnitude along the path, for contacts may be stiff compared with the structure.
    """

    def __init__(self, problem: Any, here: Mapping[str, float]) -> None:
        self.problem, self.here = problem, here
        compiled = problem.compiled(dict(here))
        kept = places(compiled.orders)
        rates = derivative(np.eye(2 * compiled.H + 1)).T[np.ix_(kept, kept)] / problem.nu
        self.dampers = np.kron(np.diag(compiled.structure.kr), rates)
        self.moving = np.tile(kept > 0, compiled.m)

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """The equations at s."""
        s, now = parameters["s"], self.problem.linearise(X, "", **self.here)
        share, damped = np.where(self.moving, s**_POWER, 1.0), self.dampers @ X
        held = (1 - s) ** _POWER
        R = share * now.R + held * damped
        J = share[:, None] * now.dR_dX + held * self.dampers
        rate = np.where(self.moving, s ** (_POWER - 1) * now.R, 0.0) - (1 - s) ** (_POWER - 1) * damped
        return Evaluation(R, J, _POWER * rate, now.size)


_POWER = 3


def from_damped(problem: Any, here: dict[str, float]) -> Solution:
    """A motion at parameters on the path from a static state, held by dampers that are taken away.

    problem : a `HarmonicBalance`.

    Raises
    ------
    NoConvergence
        If no path from a static state reaches one.
    """
    compiled = problem.compiled(here)
    failure: NoConvergence | None = None
    for static in statics(compiled, here["Omega"]):
        if not static.balanced:
            continue
        d = np.zeros((compiled.m, len(compiled.orders)), dtype=complex)
        d[:, 0] = static.d
        X = to_real(d).ravel()
        try:
            return solve_along(_Damped(problem, here), problem, X, here, steps=600)
        except NoConvergence as error:
            failure = failure or error
    raise failure or NoConvergence("there is no static state", np.zeros(problem.size), here, [])


_ELSEWHERE = (1.1, 0.9, 1.3, 0.75, 1.8, 0.5, 3.0, 6.0)  # times the frequency, where a motion may be easier to find


def from_elsewhere(problem: Any, here: dict[str, float]) -> Array | None:
    """A motion at the parameters ``here`` on the curve of one found at another frequency; None if none leads there.

    problem : a `HarmonicBalance` that finds nothing from the `guesses` at this frequency.
    """
    Omega = here["Omega"]
    for other in (Omega * times for times in _ELSEWHERE):
        there = {**here, "Omega": other}
        for guess in guesses(problem.compiled(there), other):
            try:
                X = solve(problem, guess, there).X
            except NoConvergence:
                continue
            fixed = {name: value for name, value in here.items() if name != "Omega"}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of the other frequency nobody asked
                curve = trace(problem, "Omega", (other, Omega), X, at=fixed, steps=StepControl(max_points=1000),
                              stability=False, special=False, cover=False)  # fmt: skip
            if curve.values[-1] == Omega:
                try:  # with as many harmonics as are wanted
                    return solve(problem, problem.converted(curve[-1]), here).X
                except NoConvergence:
                    pass
            break
    return None
