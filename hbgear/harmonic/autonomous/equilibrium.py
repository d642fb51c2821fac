"""Equilibria over a parameter, and their Hopf points.

    Z_0 d + g_0 + p(d, 0) = 0            d (m,) displacements of the elements
    M s^2 + (C + W c W^T) s + K + W k W^T singular,   k = dp/dd,  c = c_j + dp/dv

An equilibrium is stable if all eigenvalues s have negative real parts. At a Hopf point a pair +- i Omega crosses the
imaginary axis, and limit cycles of frequency Omega bifurcate. Its test function is the product of the sums of all pairs
of eigenvalues, scaled to [-1, 1].

References
----------
Kuznetsov, Elements of Applied Bifurcation Theory (2004), ch. 10, https://doi.org/10.1007/978-1-4757-3978-7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import Range
from hbgear.continuation.events.event import Event
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.autonomous.modes import STATIC_FREQUENCY
from hbgear.harmonic.autonomous.unforced import unforced_balance
from hbgear.harmonic.equations.static_state import forces_at, static_states
from hbgear.harmonic.structure.linear_structure import dense
from hbgear.harmonic.structure.massless import massless_modes
from hbgear.mechanics.models import Model

_IMAGINARY_TOLERANCE = 1e-6
"""Real part of an eigenvalue, relative to its modulus, up to which a located point is a Hopf point. A neutral saddle
has the same test function, but two real eigenvalues of opposite sign."""


@dataclass(frozen=True, eq=False)
class HopfPoint:
    """Hopf point of an equilibrium.

    Attributes
    ----------
    parameter : str
        Name of the parameter.
    value : float
        Its value.
    Omega : float
        Frequency of the limit cycles that bifurcate.
    rest : ndarray, shape (m,)
        Displacements of the elements at the equilibrium.
    shape : ndarray of complex, shape (m,)
        Displacements of the elements in the critical mode, of length one.
    error : float
        Estimated relative error of the value.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> hb.analysis.HopfPoint("damping", 0.2, 1.0, np.zeros(1), np.ones(1, dtype=complex), 0.0).Omega
    1.0
    """

    parameter: str
    value: float
    Omega: float
    rest: Array
    shape: ComplexArray
    error: float


class EquilibriumProblem(ContinuationProblem):
    """Equilibria of a model without periodic excitation: a problem for `trace` in a parameter of the model.

    Parameters
    ----------
    model : Model
        Model with constant matrices.

    Examples
    --------
    >>> import hbgear as hb
    >>> stop = hb.Duffing()
    >>> curve = hb.trace(hb.harmonic.EquilibriumProblem(stop), "zeta", (0.1, 0.2))
    >>> bool(abs(curve.X).max() < 1e-12)
    True
    """

    @checked_arguments()
    def __init__(self, model: Model) -> None:
        self.balance = unforced_balance(model, 1)
        self.model = model

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of elements."""
        return self.balance.m

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        """False if a law has breakpoints."""
        return not any(law.breakpoints for law in self.balance.compiled({}).laws)

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the model."""
        return self.balance.parameters

    def check_parameter(self, name: str) -> None:
        """Raise KeyError for a name that is not a parameter of the model."""
        self.balance.models.check_parameter(name)

    def range_of(self, name: str) -> Range:
        """Return the valid values of a parameter."""
        return self.balance.range_of(name)

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Array]:
        """Return the forces (m,) and the stiffness (m, m) at displacements X (m,)."""
        evaluator = self.balance.compiled(parameters)
        linear, s = evaluator.linear(STATIC_FREQUENCY), evaluator.structure
        p, k, _ = forces_at(evaluator, X, np.zeros(1))
        e, Z = evaluator.receptance.e[0].real, linear.Z[0].real
        R = s.force_sums @ (Z @ X + linear.g[0].real + p) + s.compatibility @ (X + e)
        return R, s.force_sums @ (Z + k) + s.compatibility

    def start(self, **parameters: float) -> Array:
        """Return a stable equilibrium if there is one, else another one.

        Raises
        ------
        ValueError
            If no equilibrium is found.
        """
        for state in static_states(self.balance.compiled(parameters), STATIC_FREQUENCY):
            if state.balanced:
                return state.d
        raise ValueError("no equilibrium was found: support the structure, or give start= the displacements")

    def eigenvalues(self, X: Array, parameters: Mapping[str, float]) -> tuple[ComplexArray, ComplexArray]:
        """Return the eigenvalues s (N,) of small motions about an equilibrium, and modes (m, N).

        N is 2n, less one for each coordinate with a damper and without mass, and two for one without both.
        """
        evaluator = self.balance.compiled(parameters)
        s, n = evaluator.structure, evaluator.structure.n
        _, k, c = forces_at(evaluator, X, np.zeros(1))
        M, C, K = (np.asarray(dense(A)) for A in (s.M, s.C, s.K))
        K, C = K + s.W @ (k - np.diag(s.kr)) @ s.W.T, C + s.W @ c @ s.W.T
        if s.system.massless:
            values, vectors, *_ = massless_modes(s.system, M, C, K, np.eye(n), np.eye(n))
            return values, s.W.T @ vectors
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        values, vectors = scipy.linalg.eig(A)
        return values, s.W.T @ vectors[:n]

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return the multipliers exp(s T), with T the period of the fastest eigenvalue."""
        values, _ = self.eigenvalues(X, parameters)
        largest = np.abs(values).max(initial=0.0) or 1.0
        return {"multipliers": np.exp(values * (2 * np.pi / largest))} if stability else {}

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file."""
        return {"curve": {"of": type(self).__name__}}


def _scaled_sum_product(values: ComplexArray) -> float:
    """Return the product of s_i + s_j over all pairs of eigenvalues, each scaled by |s_i| + |s_j|."""
    i, j = np.triu_indices(len(values), 1)
    size = np.abs(values[i]) + np.abs(values[j])
    ratio = (values[i] + values[j])[size > 0] / size[size > 0]
    product = np.prod(ratio)
    return float(np.sign(product.real) * np.abs(product) ** (1.0 / max(len(values) - 1, 1)))


@checked_arguments()
def hopf_points(model: Model, parameter: str, span: tuple[float, float], **options: Any) -> tuple[HopfPoint, ...]:
    """Return the Hopf points of an equilibrium over a parameter.

        det [M s^2 + (C + W c W^T) s + K + W k W^T] = 0,   s = +- i Omega

    The equilibrium is followed from the first value of the span; folds of equilibria are passed.

    Parameters
    ----------
    model : Model
        Model; its periodic excitation is left out, mean loads remain.
    parameter : str
        Name of a parameter of the model.
    span : (float, float)
        First and last value of the parameter.
    **options
        Arguments of `trace`.

    Returns
    -------
    tuple of HopfPoint
        Hopf points in the order of the curve; limit cycles begin there, see `limit_cycles`.

    Raises
    ------
    ValueError
        If the model has no equilibrium, or the structure depends on Omega, is measured or is too large.
    KeyError
        If the model has no such parameter.

    Examples
    --------
    A damper with negative viscous coefficient destabilises a mass:

    >>> import hbgear as hb
    >>> @hb.mechanics.model
    ... def mass(damping: float = 0.1) -> hb.System:
    ...     return hb.System([[1.0]], [[damping]], [[4.0]], [hb.Element([1.0], hb.Cubic(1.0))])
    >>> (hopf,) = hb.analysis.hopf_points(mass(), "damping", (0.1, -0.1))
    >>> bool(abs(hopf.value) < 1e-12 and abs(hopf.Omega - 2.0) < 1e-12)
    True
    """
    problem = EquilibriumProblem(model)
    if parameter == "Omega":
        raise KeyError("Omega is the frequency of the limit cycles; give a parameter of the model")

    def test(point: Point) -> float:
        return _scaled_sum_product(problem.eigenvalues(point.X, point.parameters)[0])

    event = Event("HB", test, "Hopf bifurcation: limit cycles begin")
    curve = trace(problem, parameter, span, events=[event], **({"cover": False} | options))
    return _hopf_points(problem, curve, parameter)


def _hopf_points(problem: EquilibriumProblem, curve: Branch, parameter: str) -> tuple[HopfPoint, ...]:
    """Return the located points of a curve at which a pair of eigenvalues is imaginary."""
    points = []
    for point in curve.special:
        if point.kind != "HB":
            continue
        values, modes = problem.eigenvalues(point.X, point.parameters)
        sizes = np.abs(values)
        upper = np.flatnonzero(values.imag > _IMAGINARY_TOLERANCE * sizes.max())
        if not upper.size:
            continue
        r = upper[np.argmin(np.abs(values.real[upper]))]
        if abs(values[r].real) <= _IMAGINARY_TOLERANCE * sizes[r]:
            shape = modes[:, r] / np.linalg.norm(modes[:, r])
            value = point.parameters[parameter]
            points.append(HopfPoint(parameter, value, float(values[r].imag), point.X.copy(), shape, point.error))
    return tuple(points)
