"""Special points as problems of their own: the equations of the motion and one more.

    R(X, p) = 0,   g(X, p) = 0           unknowns U = (X, p), p the parameter in which the curve was traced

so that the same Newton locates them and the same `trace` follows them in a second parameter.

| class | g |
|---|---|
| Fold | bordered determinant of dR/dX: the curve turns in p |
| PeriodDoubling | the same for the half-integer harmonics, which decouple: a multiplier is -1 |
| Grazing | extremum of an element minus a corner of its law: the impact regime changes |
| Peak | derivative of an amplitude along the curve |

The derivative of g needs second derivatives of R only in one direction: a central difference of the exact Jacobian.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), ch. 3-4.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.common.given import need
from hbgear.common.ranges import Range, range_of
from hbgear.continuation.algebra import norm, unit_of
from hbgear.continuation.problem import Evaluation, jacobians, linearise

_STEP = 1e-5  # relative step of the directional differences


class Extra(NamedTuple):
    """The equations of the motion with their derivatives in p and name, and g with its own in X, p and name."""

    now: Evaluation
    R_name: Array | None
    g: float
    g_X: Array
    g_p: float
    g_name: float


class Sides(NamedTuple):
    """R and dR/dX a small step above and below in one parameter, and the distance between the two."""

    R: tuple[Array, Array]
    J: tuple[Array, Array]
    distance: float

    @property
    def dR(self) -> Array:
        """Central difference of R."""
        return (self.R[0] - self.R[1]) / self.distance

    @property
    def dJ(self) -> Array:
        """Central difference of dR/dX."""
        return (self.J[0] - self.J[1]) / self.distance


def sides(problem: Any, X: Array, here: Mapping[str, float], name: str) -> Sides:
    """R and dR/dX on both sides of a parameter; one-sided where its range ends."""
    h = _STEP * unit_of(problem, name, here[name])
    values, R, J = [], [], []
    for value in (here[name] + h, here[name] - h):
        try:
            r, j = problem.evaluate(X, **{**here, name: value})
        except ValueError:
            value = here[name]
            r, j = problem.evaluate(X, **here)
        values.append(value)
        R.append(r)
        J.append(j)
    return Sides((R[0], R[1]), (J[0], J[1]), values[0] - values[1])


def bends(problem: Any, X: Array, v: Array, here: Mapping[str, float], name: str) -> tuple[Array, Array]:
    """Derivatives (n, n) of dR/dX along v and in a parameter, by central differences."""
    h = _STEP * max(1e-3, norm(X)) / norm(v)
    if name != "Omega":  # which may take any value, so that all four can be evaluated at once
        plus, minus = (problem.evaluate(X + s * h * v, **here)[1] for s in (1, -1))
        return (plus - minus) / (2 * h), sides(problem, X, here, name).dJ
    e = _STEP * here[name]
    U = np.column_stack([np.array([X + h * v, X - h * v, X, X]), here[name] + e * np.array([0.0, 0.0, 1.0, -1.0])])
    J = jacobians(problem, U, name, here)
    return (J[0] - J[1]) / (2 * h), (J[2] - J[3]) / (2 * e)


class Augmented(ABC):
    """A problem with one more unknown parameter and one more equation; see the module.

    Parameters
    ----------
    problem : the problem whose special points are meant.
    parameter : the parameter of the curve they lie on (``"Omega"``); it becomes the last unknown.
    """

    turning_kind = "LP"
    """Label of a turning point of a curve of such points."""

    def __init__(self, problem: Any, parameter: str = "Omega") -> None:
        need(f"{type(self).__name__}(problem)", problem, "problem")
        if hasattr(problem, "check_parameter"):
            problem.check_parameter(parameter)
        self.problem, self.parameter = problem, parameter
        self._weight: float | None = None

    def _weighted(self, size: float, unit: float) -> float:
        """Factor that gives g (of size unit) the size of R; fixed at its first use, for it must not vary with X."""
        if self._weight is None:
            self._weight = size / unit
        return self._weight

    @abstractmethod
    def extra(self, X: Array, here: dict[str, float], name: str) -> Extra:
        """R and g at X with all parameters, and their derivatives; name may be empty."""

    @property
    def unknown_parameters(self) -> tuple[str, ...]:
        """Parameters that are unknowns here."""
        return (self.parameter,)

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the problem."""
        return dict(getattr(self.problem, "parameters", {}))

    @property
    def size(self) -> int | None:
        """Number of unknowns; None if the problem does not say its own."""
        size = getattr(self.problem, "size", None)
        return None if size is None else size + 1

    @property
    def layout(self) -> Any:
        """How X, the motion's part of the unknowns, is to be read."""
        return getattr(self.problem, "layout", None)

    def describe(self) -> dict[str, Any]:
        """Header of a saved branch."""
        about = self.problem.describe() if hasattr(self.problem, "describe") else {}
        return {**about, "curve": {"of": type(self).__name__, "in": self.parameter}}

    def check_parameter(self, name: str) -> None:
        """Refuse a parameter that is unknown to the problem or already an unknown."""
        if name == self.parameter:
            raise ValueError(
                f"a {type(self).__name__} in {name} cannot be followed in {name} again; choose a second parameter"
            )
        if hasattr(self.problem, "check_parameter"):
            self.problem.check_parameter(name)

    def range_of(self, name: str) -> Range:
        """Values a parameter may have."""
        return range_of(self.problem, name)

    def split(self, U: Array) -> tuple[Array, dict[str, float]]:
        """X of the problem and the parameter that belongs to it."""
        return U[:-1], {self.parameter: float(U[-1])}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Unknowns (X, parameter) of this problem.

        Raises
        ------
        ValueError
            If the motion has another number of harmonics.
        """
        size = getattr(self.problem, "size", len(X))
        if len(X) != size:
            raise ValueError(
                f"the start has {len(X)} coefficients, this problem {size}: follow special points with the harmonics "
                "of the curve they are on, such as Fold(curve.problem, 'Omega')"
            )
        return np.append(X, parameters[self.parameter])

    def motion_size(self, U: Array) -> float:
        """Size of the motion, which scales the arclength."""
        size = getattr(self.problem, "motion_size", None)
        return float(size(U[:-1])) if size else float(np.linalg.norm(U[:-1]))

    def observe(self, U: Array, stability: bool = False, **parameters: float) -> dict[str, Any]:
        """Regime and truncation error of the motion."""
        if not hasattr(self.problem, "observe"):
            return {}
        X, own = self.split(U)
        seen = self.problem.observe(X, stability=False, **{**parameters, **own})
        return {k: seen[k] for k in ("regime", "error")}

    def evaluate(self, U: Array, **parameters: float) -> tuple[Array, Array]:
        """Residual (n + 1,) of {R, g} and its Jacobian in (X, p)."""
        now = self.linearise(U, "", **parameters)
        return now.R, now.dR_dX

    def linearise(self, U: Array, name: str, **parameters: float) -> Evaluation:
        """{R, g}, its Jacobian in (X, p) and its derivative in a further parameter."""
        X, own = self.split(U)
        here = {**parameters, **own}
        extra = self.extra(X, here, name)
        n = len(X)
        J = np.empty((n + 1, n + 1))
        J[:n, :n], J[:n, n], J[n, :n], J[n, n] = extra.now.dR_dX, extra.now.dR_dp, extra.g_X, extra.g_p
        dR = np.zeros(n + 1)
        if name:
            dR[:n], dR[n] = extra.R_name, extra.g_name
        return Evaluation(np.append(extra.now.R, extra.g), J, dR, extra.now.size)


class _Borders:
    """Null vectors of a nearly singular matrix A: [A a; b^T 0] [v; g] = [0; 1], and the same for A^T and w."""

    def __init__(self, A: Array) -> None:
        u, s, vt = scipy.linalg.svd(A)
        self.a, self.b = u[:, -1], vt[-1]
        self.size = float(s[0])

    def null(self, A: Array) -> tuple[Array, Array, float]:
        """v, w and g; the borders are refined once so that the bordered matrix stays well posed far from here."""
        a, b, n = self.a, self.b, len(A)
        rhs = np.zeros(n + 1)
        rhs[-1] = 1.0
        v, w, g = b, a, 0.0
        B = np.zeros((n + 1, n + 1))
        B[:n, :n] = A
        for _ in range(2):
            B[:n, n], B[n, :n] = a, b
            lu = scipy.linalg.lu_factor(B)
            right, left = scipy.linalg.lu_solve(lu, rhs), scipy.linalg.lu_solve(lu, rhs, trans=1)
            v, w, g = right[:n], left[:n], float(right[n])
            a, b = w / np.linalg.norm(w), v / np.linalg.norm(v)
        return v, w, g


class Fold(Augmented):
    """Folds (LP) of a curve: g is the bordered determinant of dR/dX; dg = -w^T dJ v with its null vectors v, w.

    Parameters
    ----------
    problem, parameter : as for `Augmented`.

    Examples
    --------
    The curve of a fold in the damping, from a fold of a response curve::

        folds = trace(Fold(problem, "Omega"), "zeta", (0.05, 0.2), start=curve["LP1"])
    """

    turning_kind = "CP"

    def __init__(self, problem: Any, parameter: str = "Omega") -> None:
        super().__init__(problem, parameter)
        self._borders: _Borders | None = None

    def _prepare(self, A: Array, now: Evaluation) -> _Borders:
        """Borders from the first matrix seen; any regular choice gives the same zeros of g."""
        if self._borders is None:
            self._borders = _Borders(A)
            self._weighted(now.size, self._borders.size)
        return self._borders

    def rebased(self, U: Array, parameters: Mapping[str, float]) -> Self:
        """The same problem with its borders renewed at U.

        g is det(A) over the bordered determinant, which must not vanish on the way; a curve that goes far renews it.
        The new borders have positive products with the old ones, so that the sign of g is kept.
        """
        X, own = self.split(U)
        if self._borders is None:
            return self
        v, w, _ = self._borders.null(self._matrix(X, {**parameters, **own}))
        out = copy.copy(self)
        out._borders = copy.copy(self._borders)
        out._borders.a, out._borders.b = w / np.linalg.norm(w), v / np.linalg.norm(v)
        return out

    def extra(self, X: Array, here: dict[str, float], name: str) -> Extra:
        """See `Augmented.extra`."""
        now = linearise(self.problem, X, self.parameter, here)
        v, w, g = self._prepare(now.dR_dX, now).null(now.dR_dX)
        k = self._weighted(now.size, 1.0)
        along, across = bends(self.problem, X, v, here, self.parameter)
        there = sides(self.problem, X, here, name) if name else None
        return Extra(
            now, there and there.dR, k * g, -k * (w @ along),
            -k * float(w @ across @ v), -k * float(w @ there.dJ @ v) if there else 0.0,
        )  # fmt: skip

    def direction(self, U: Array, **parameters: float) -> int:
        """+1 if the motions of this fold exist below it only, -1 if above: the sense in which a sweep meets it.

        Along the curve p'' = -(w^T R_XX v v) / (w^T R_p) at a fold.
        """
        X, own = self.split(U)
        here = {**parameters, **own}
        now = linearise(self.problem, X, self.parameter, here)
        v, w, _ = _Borders(now.dR_dX).null(now.dR_dX)
        along, _ = bends(self.problem, X, v, here, self.parameter)
        return 1 if float(w @ along @ v) * float(w @ now.dR_dp) > 0 else -1

    def _matrix(self, X: Array, here: Mapping[str, float]) -> Array:
        return self.problem.evaluate(X, **here)[1]
