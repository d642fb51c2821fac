"""Special points of a solution curve: what they are, and how each is located.

| kind | condition | located by |
|---|---|---|
| LP | fold: dR/dX singular, the curve turns in the parameter (a jump) | Newton on {R = 0, g = 0}, or a bracketed root of the tangent |
| PD | a multiplier passes -1 (period doubling) | bracketed root of det(Phi + 1) |
| NS | a complex pair of multipliers passes the unit circle (Neimark-Sacker) | bracketed root of its modulus |
| BP | two curves cross: det [J R_lambda; t^T] changes sign | bracketed root of the determinant |
| GR | an extremum of an element grazes a corner of its law: the impact regime changes | bracketed root of the clearance |

The bracketed root runs along the arc between two rows, where every point is corrected onto the curve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
from scipy.optimize import brentq

from hbgear.arc import Arc, Row, row_of
from hbgear.branch import NEUTRAL
from hbgear.fourier import Array, ComplexArray
from hbgear.newton import Evaluation, NoConvergence, Settings, Solution, bordered, linearise, solve


class Fold:
    """The folds of a problem, as a problem of its own.

        R(X, p) = 0,   g(X, p) = 0,   [J  a; b^T 0] [v; g] = [0; 1],   J = dR/dX

    g vanishes exactly where J is singular, and depends smoothly on X and p where J does. Its derivative is
    dg = -w^T dJ v with w the left null vector; w^T dJ v is a directional difference of the exact Jacobian.

    Parameters
    ----------
    problem : the problem whose folds are meant.
    parameter : the parameter in which it folds; it becomes the last unknown.
    near : (X, parameters) at or near a fold, which fixes the borders a and b.

    References
    ----------
    Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), ch. 3-4.
    """

    def __init__(self, problem: Any, parameter: str, near: tuple[Array, Mapping[str, float]]) -> None:
        self.problem, self.parameter = problem, parameter
        X, parameters = near
        now = linearise(problem, X, parameter, parameters)
        u, s, vt = la.svd(now.dR_dX)
        self._a, self._b = u[:, -1], vt[-1]
        # g has the unit of J; this weight makes it comparable with R
        self._weight = now.size / float(s[0])

    @property
    def unknown_parameters(self) -> tuple[str, ...]:
        """Parameters that are unknowns here."""
        return (self.parameter,)

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the problem."""
        return dict(getattr(self.problem, "parameters", {}))

    def split(self, U: Array) -> tuple[Array, dict[str, float]]:
        """X of the problem and the parameter that belongs to it."""
        return U[:-1], {self.parameter: float(U[-1])}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Unknowns (X, parameter) of this problem."""
        return np.append(X, parameters[self.parameter])

    def _null(self, J: Array) -> tuple[Array, Array, float]:
        """Right and left null vectors and g, with borders refined once so that they stay well posed."""
        a, b = self._a, self._b
        n = len(a)
        rhs = np.zeros(n + 1)
        rhs[-1] = 1.0
        v, w, g = b, a, 0.0
        for _ in range(2):
            A = np.zeros((n + 1, n + 1))
            A[:n, :n], A[:n, n], A[n, :n] = J, a, b
            lu = la.lu_factor(A)
            right, left = la.lu_solve(lu, rhs), la.lu_solve(lu, rhs, trans=1)
            v, w, g = right[:n], left[:n], float(right[n])
            a, b = w / np.linalg.norm(w), v / np.linalg.norm(v)
        return v, w, g

    def evaluate(self, U: Array, **parameters: float) -> tuple[Array, Array]:
        """Residual (n + 1,) and Jacobian (n + 1, n + 1) of {R, g} in (X, p)."""
        now = self.linearise(U, "", **parameters)
        return now.R, now.dR_dX

    def linearise(self, U: Array, name: str, **parameters: float) -> Evaluation:
        """As `HarmonicBalance.linearise`, for the extended system."""
        X, own = self.split(U)
        here = {**parameters, **own}
        now = linearise(self.problem, X, self.parameter, here)
        v, w, g = self._null(now.dR_dX)
        n = len(X)
        J = np.empty((n + 1, n + 1))
        J[:n, :n], J[:n, n] = now.dR_dX, now.dR_dp
        h = 1e-5 * max(1e-3, float(np.linalg.norm(X))) / float(np.linalg.norm(v))
        plus = self.problem.evaluate(X + h * v, **here)[1]
        minus = self.problem.evaluate(X - h * v, **here)[1]
        J[n, :n] = -self._weight * (w @ (plus - minus)) / (2 * h)
        J[n, n] = -self._weight * self._change(X, here, self.parameter, v, w)
        dR = np.zeros(n + 1)
        if name:
            dR[:n] = linearise(self.problem, X, name, here).dR_dp
            dR[n] = -self._weight * self._change(X, here, name, v, w)
        return Evaluation(np.append(now.R, self._weight * g), J, dR, now.size)

    def _change(self, X: Array, here: Mapping[str, float], name: str, v: Array, w: Array) -> float:
        """w^T dJ/dname v by central difference, one-sided where the range of the parameter ends."""
        h = 1e-5 * (abs(here[name]) or 1.0)
        ends: list[tuple[float, float]] = []
        for value in (here[name] + h, here[name] - h):
            try:
                J = self.problem.evaluate(X, **{**here, name: value})[1]
            except ValueError:
                value, J = here[name], self.problem.evaluate(X, **here)[1]
            ends.append((value, float(w @ J @ v)))
        return (ends[0][1] - ends[1][1]) / (ends[0][0] - ends[1][0])


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
    turned = a.tangent[-1] * b.tangent[-1] < 0
    crossed = a.orientation != b.orientation
    if turned:
        found.append(_fold(arc))
    if crossed:
        found.append(_root(arc, "BP", _determinant(arc)))
    if stability:
        found += _stability_changes(arc, turned or crossed)
    found += _grazing(arc)
    return sorted(found, key=lambda f: f.s)


def _root(arc: Arc, kind: str, test: Callable[[Row], float], note: str = "") -> Found:
    """Bracketed root of a test function along the arc; where correction fails, the nearer end, not located."""
    rows: dict[float, Row] = {0.0: arc.a, 1.0: arc.b}

    def value(s: float) -> float:
        if s not in rows:
            rows[s] = arc.at(s)
        return test(rows[s])

    try:
        s = float(brentq(value, 0.0, 1.0, xtol=1e-14, rtol=1e-13, maxiter=60))
        return Found(kind, s, rows[s], True, note)
    except (NoConvergence, np.linalg.LinAlgError, ValueError, RuntimeError):
        f0, f1 = abs(test(arc.a)), abs(test(arc.b))
        s = 0.0 if f0 < f1 else 1.0
        return Found(kind, s, rows[s], False, note)


def _fold(arc: Arc) -> Found:
    """Newton on {R, g} from where the tangent's component vanishes; bracketed where forces are sampled."""
    a, b = arc.a, arc.b
    s = a.tangent[-1] / (a.tangent[-1] - b.tangent[-1])
    if getattr(arc.problem, "smooth", True):
        try:
            return _newton_fold(arc, s)
        except (NoConvergence, np.linalg.LinAlgError):
            pass
    return _root(arc, "LP", lambda row: float(row.tangent[-1]))


def _newton_fold(arc: Arc, s: float) -> Found:
    u = arc.guess(s)
    parameters = {**arc.parameters, arc.name: float(u[-1])}
    fold = Fold(arc.problem, arc.name, (u[:-1], parameters))
    settings = Settings(arc.settings.tolerance, arc.settings.step_tolerance, 6)
    solution = solve(fold, u, dict(arc.parameters) | {arc.name: float(u[-1])}, arc.name, settings)
    U = solution.X
    chord = (arc.b.u - arc.a.u) / arc.scale
    place = float(chord @ ((U - arc.a.u) / arc.scale) / (chord @ chord))
    away = np.linalg.norm((U - u) / arc.scale)
    if not -0.05 <= place <= 1.05 or away > 0.5 * np.linalg.norm(chord):
        raise NoConvergence("Newton left the arc", U, parameters, [])
    now = linearise(arc.problem, U[:-1], arc.name, {**arc.parameters, arc.name: float(U[-1])})
    point = Solution(U[:-1], float(U[-1]), now, solution.iterations, float(np.linalg.norm(now.R)) / now.size)
    return Found("LP", min(max(place, 0.0), 1.0), row_of(point, chord / arc.scale, arc.scale), True)


def _determinant(arc: Arc) -> Callable[[Row], float]:
    """Signed bordered determinant, relative to its size at the first row."""

    def logdet(row: Row) -> tuple[float, float]:
        sign, log = np.linalg.slogdet(bordered(row.solution.evaluation, row.tangent / arc.scale**2))
        return float(sign), float(log)

    reference = logdet(arc.a)[1]

    def value(row: Row) -> float:
        sign, log = logdet(row)
        return sign * float(np.exp(min(log - reference, 50.0)))

    return value


def _unstable(mu: ComplexArray) -> int:
    return int(np.sum(np.abs(mu) > 1 + NEUTRAL))


def _stability_changes(arc: Arc, explained: bool) -> list[Found]:
    """Period doublings and Neimark-Sacker points from the multipliers of both rows."""
    ma, mb = arc.a.observed.get("multipliers"), arc.b.observed.get("multipliers")
    if ma is None or mb is None or not (np.all(np.isfinite(ma)) and np.all(np.isfinite(mb))):
        return []
    multipliers = arc.problem.multipliers

    def at(row: Row) -> ComplexArray:
        known = row.observed.get("multipliers")
        return known if known is not None else multipliers(row.solution.X, **{**arc.parameters, arc.name: row.value})

    out: list[Found] = []
    doubling = np.prod(ma + 1).real * np.prod(mb + 1).real < 0
    if doubling:
        out.append(_root(arc, "PD", lambda row: float(np.prod(at(row) + 1).real)))
    low, high = sorted((_unstable(ma), _unstable(mb)))
    if high - low - int(doubling) - int(explained) >= 2:
        out.append(_root(arc, "NS", lambda row: float(np.sort(np.abs(at(row)))[::-1][low] - 1.0)))
    return out


def _grazing(arc: Arc) -> list[Found]:
    """Extrema that pass a corner of a law; elements that graze together are one point."""
    ca, cb = arc.a.observed.get("clearance"), arc.b.observed.get("clearance")
    if ca is None or cb is None:
        return []
    out: list[Found] = []
    for i in np.flatnonzero(ca * cb < 0):

        def test(row: Row, i: int = int(i)) -> float:
            known = row.observed.get("clearance")
            if known is None:
                known = arc.problem.clearance(row.solution.X, **{**arc.parameters, arc.name: row.value})
            return float(known[i])

        point = _root(arc, "GR", test, arc.problem.clearance_names[i])
        twin = next((j for j, other in enumerate(out) if abs(other.s - point.s) < 1e-6), None)
        if twin is None:
            out.append(point)
        else:
            old = out[twin]
            out[twin] = Found("GR", old.s, old.row, old.located, f"{old.note}, {point.note}")
    return out
