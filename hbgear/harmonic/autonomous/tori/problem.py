"""Harmonic balance of two frequencies: quasi-periodic motions on a torus.

    d_k + G(w_k) [p_k(d, d') - kr d_k + g_k] = 0,   w_k = k_1 Omega / nu + k_2 Omega_2
    <d x_ref / d theta_2, x> = 0                                           unknowns (X, Omega_2)

G are the receptances of the structure with the reference springs kr, g_k the loads and prescribed displacements (only
k_2 = 0). The forces are sampled on a grid of both phases (AFT). The second condition selects one of the motions that
differ by a shift of the second phase.

References
----------
Schilder, Vogt, Schreiber & Osinga (2006), Int. J. Numer. Meth. Eng. 67, https://doi.org/10.1002/nme.1632.
Guskov & Thouverez (2012), J. Vib. Acoust. 134(3), https://doi.org/10.1115/1.4005823.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import Range
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem, Observed
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.autonomous.tori.basis import TorusBasis
from hbgear.harmonic.autonomous.tori.ends import TorusMergeEvent, locking_remark, smoothness_event
from hbgear.harmonic.autonomous.tori.errors import check_errors
from hbgear.harmonic.autonomous.tori.layout import SECOND, TorusLayout
from hbgear.harmonic.autonomous.tori.stability import growth_of, stability_remark
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.multipliers.sampled_slopes import slope_pairs
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.models import Model, describe

_LARGEST_LOGARITHM = 300.0
"""Logarithm of the largest growth in a period that is represented [-]."""


class _Forces(NamedTuple):
    """Coefficients p (m, K) of the forces, and the slopes (S, N1, N2) in d and d' (None without dependence).

    The slopes are those of `slope_pairs`: of the force of one element in the displacement of another one or its own.
    """

    p: ComplexArray
    stiffness: Array
    damping: Array | None


class TorusProblem(ContinuationProblem):
    """Quasi-periodic motions in a parameter: a problem for `trace`, with the second frequency unknown.

    Parameters
    ----------
    balance : HarmonicBalance
        Balance of the periodic motions.
    basis : TorusBasis
        Fourier basis of the two phases.

    Raises
    ------
    ValueError
        If the structure is measured or too large for its modes, elements measure dependent displacements, or a law has
        memory.

    Examples
    --------
    See `hbgear.analysis.torus`.

    >>> import hbgear as hb
    >>> from hbgear.harmonic.autonomous.tori.basis import TorusBasis
    >>> hb.harmonic.TorusProblem(hb.HarmonicBalance(hb.Duffing(), 3), TorusBasis(3, 2)).unknown_parameters
    ('Omega_2',)
    """

    free_phase = True
    """Whether the second phase of a motion is arbitrary: the second frequency is not prescribed."""
    usual_parameter = "Omega"
    unknown_parameters = (SECOND,)
    singular_hint = "the two frequencies lock"

    def __init__(self, balance: HarmonicBalance, basis: TorusBasis) -> None:
        evaluator = balance.compiled({})
        structure = evaluator.structure
        if structure.modes is None and not structure.depends_on_speed:
            raise ValueError("tori need the modes of the structure, which is measured or too large: reduce it first")
        if structure.constrained:
            raise ValueError(
                "tori need elements with independent displacements: join elements on the same displacement"
            )
        if evaluator.sliders:
            raise ValueError("tori need laws without memory; friction sliders have one: use hb.time.integrate")
        self.balance, self.basis, self._phase = balance, basis, np.zeros(balance.m * basis.width)

    def __repr__(self) -> str:
        return f"TorusProblem({self.balance.model!r}, {self.resolution})"

    # ---- parameters and unknowns

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of unknowns: the coefficients and the second frequency."""
        return self.balance.m * self.basis.width + 1

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        """Whether the Jacobian is differentiable: no law has breakpoints."""
        evaluator = self.balance.compiled({})
        return not (len(evaluator.breakpoints) or any(law.has_edges for _, law in evaluator.vectors))

    @property
    def resolution(self) -> str:
        """Harmonics in words."""
        return f"H = ({self.basis.H1}, {self.basis.H2})"

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the model."""
        return self.balance.parameters

    @property
    def layout(self) -> TorusLayout:
        """Names and measures of the unknowns."""
        names = tuple(element.name for element in self.balance.compiled({}).system.elements)
        b, labels = self.basis, dict(self.balance.model.labels)
        return TorusLayout((b.H1, b.H2), names, self.balance.nu, labels, b.odd, b.dense, b.band, b.ratio, b.half)

    def check_parameter(self, name: str) -> None:
        """Raise KeyError for a name other than Omega and the parameters of the model."""
        if name == SECOND:
            raise ValueError(f"{SECOND} is an unknown of a torus; trace it in Omega or in a parameter of the model")
        self.balance.check_parameter(name)

    def range_of(self, name: str) -> Range:
        """Return the valid values of a parameter."""
        return self.balance.range_of(name)

    def unit_of(self, name: str, value: float) -> float:
        """Return the size relative to which a parameter change is small."""
        return self.balance.unit_of(name, value)

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Return ``Omega`` if it is not given."""
        return self.balance.missing(known)

    def split(self, X: Array) -> tuple[Array, dict[str, float]]:
        """Return the coefficients, and the second frequency by name."""
        return X[:-1], {SECOND: float(X[-1])}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Return the unknowns of this problem from coefficients and all parameters."""
        return np.append(X, parameters[SECOND])

    def solution_norm(self, X: Array) -> float:
        """Return the norm of the coefficients, which scales the arclength."""
        return norm(X[:-1])

    def with_borders_at(self, X: Array, parameters: Mapping[str, float], renew: bool = False) -> Self:
        """Return the problem with the phase condition relative to a motion, if ``renew`` or it has none."""
        if not renew and self._phase.any():
            return self
        b = self.shifted(X[:-1])
        if not b.any():
            return self
        out = copy.copy(self)
        out._phase = b / norm(b)
        return out

    def shifted(self, X: Array) -> Array:
        """Return the coefficients (n,) of the derivative of a motion in the second phase."""
        c = self.basis.to_complex(X.reshape(self.balance.m, -1))
        return self.basis.to_real(1j * self.basis.k[:, 1] * c).ravel()

    def modulation(self, X: Array) -> Array:
        """Return the coefficients with the second phase (k_2 > 0), zero for a periodic motion."""
        c = self.basis.to_complex(X.reshape(self.balance.m, -1))
        return self.basis.to_real(np.where(self.basis.k[:, 1] > 0, c, 0.0)).ravel()

    # ---- equations

    def evaluator_at(self, parameters: Mapping[str, float]) -> Evaluator:
        """Return the model at some parameters, with the structure at Omega; the second frequency is left out."""
        evaluator = self.balance.compiled({name: x for name, x in parameters.items() if name != SECOND})
        return evaluator.at(parameters["Omega"])

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return the residual, its Jacobian, its derivative in a parameter and the size of its terms."""
        d, unknown = self.split(X)
        basis, evaluator = self.basis, self.evaluator_at(parameters)
        m, n = evaluator.m, len(d)
        omega = np.array([parameters["Omega"] / self.balance.nu, unknown[SECOND]])
        w = basis.k @ omega
        c = basis.to_complex(d.reshape(m, -1))
        forces = self.forces(evaluator, c, w)
        G, dG = evaluator.structure.transfer(1j * w)
        dG = 1j * dG  # in w
        kr = evaluator.structure.kr
        g, dg = _constants(basis, evaluator, parameters["Omega"])
        load = forces.p - kr[:, None] * c + g
        R = c + np.einsum("kij,jk->ik", G, load)
        change = np.einsum("kij,jk->ik", dG, load)
        pairs = slope_pairs(evaluator)
        slopes = np.array([basis.product(s) for s in forces.stiffness])
        rates = None if forces.damping is None else np.array([basis.product(s) for s in forces.damping])
        if rates is not None:
            slopes = slopes + np.array([_after_derivative(matrix, w) for matrix in rates])
        # the receptances G contain the reference springs
        slopes[:m, np.arange(basis.width), np.arange(basis.width)] -= kr[:, None]
        A = np.zeros((n + 1, n + 1))
        A[:n, :n] = _applied(G, slopes, pairs).reshape(n, n)
        A[np.arange(n), np.arange(n)] += 1.0
        A[:n, n] = self._in_frequency(1, change, G, rates, pairs, d)
        size = norm(basis.to_real(c)) + norm(basis.to_real(load - g)) * float(np.abs(G).max(initial=0.0)) + 1e-300
        weight = size / max(norm(d), 1e-300)
        A[n, :n] = weight * self._phase
        out = np.append(basis.to_real(R).ravel(), weight * (self._phase @ d))
        rate = np.zeros(n + 1)
        if name == "Omega" and not self.balance.compiled({}).structure.depends_on_speed:
            constant = basis.to_real(np.einsum("kij,jk->ik", G, dg)).ravel()
            rate[:n] = self._in_frequency(0, change, G, rates, pairs, d) / self.balance.nu + constant
        elif name:
            values = {**parameters, SECOND: unknown[SECOND]}
            (rate,) = parameter_derivatives(self, name, values, lambda p: (self.linearise(X, "", **p).R,))
        return Evaluation(out, A, rate, size)

    def _in_frequency(
        self, i: int, change: ComplexArray, G: ComplexArray, rates: Array | None, pairs: np.ndarray, d: Array
    ) -> Array:
        """Return the derivative (n,) of the balance in one of the two basis frequencies."""
        basis, m = self.basis, self.balance.m
        out = basis.to_real(change * basis.k[:, i])
        if rates is not None:
            derivative = basis.to_real(1j * basis.k[:, i] * basis.to_complex(d.reshape(m, -1)))
            force = np.zeros_like(derivative)
            np.add.at(force, pairs[:, 0], np.einsum("sab,sb->sa", rates, derivative[pairs[:, 1]]))
            out += basis.to_real(np.einsum("kij,jk->ik", G, basis.to_complex(force)))
        return out.ravel()

    def forces(self, evaluator: Evaluator, c: ComplexArray, w: Array) -> _Forces:
        """Return forces and slopes of the laws at a motion with coefficients (m, K) and frequencies (K,)."""
        basis, m = self.basis, len(c)
        d, v = basis.samples(np.stack([c, 1j * w * c]))
        grid = np.meshgrid(*(2 * np.pi * np.arange(N) / N for N in basis.shape), indexing="ij")
        p, stiffness, damping = (
            x.reshape(-1, *basis.shape)
            for x in self._laws(evaluator, d.reshape(m, -1), v.reshape(m, -1), np.stack(grid, axis=-1).reshape(-1, 2))
        )
        return _Forces(basis.coefficients(p), stiffness, damping if damping.any() else None)

    def _laws(self, evaluator: Evaluator, d: Array, v: Array, theta: Array) -> tuple[Array, Array, Array]:
        """Return the forces (m, T) and their slopes in d and v, (S, T) each, at T points with phases theta (T, 2)."""
        phases, pairs = self._phases(evaluator, theta), slope_pairs(evaluator).tolist()
        p, stiffness, damping = np.zeros(d.shape), *np.zeros((2, len(pairs), len(theta)))
        for j, law in enumerate(evaluator.laws):
            if not isinstance(law, Component):
                p[j], stiffness[j], damping[j] = law.force(d[j], v[j], phases[j])
        for elements, law in evaluator.vectors:
            p[elements], kd, kv = law.force(d[elements], v[elements], phases[elements[0]])
            for a, b in np.ndindex(law.size, law.size):
                position = pairs.index([elements[a], elements[b]])
                stiffness[position], damping[position] = kd[a, b], kv[a, b]
        return p, stiffness, damping

    def slopes(self, X: Array, parameters: Mapping[str, float], t: Array, phi: Array) -> tuple[Array, Array | None]:
        """Return the slopes of `slope_pairs` in d and d' along a motion (B, S, T); None without the latter.

        The motion begins at the phases 0 and phi (B,), and t (T,) are instants.
        """
        d, unknown = self.split(X)
        basis, evaluator = self.basis, self.evaluator_at(parameters)
        omega = np.array([parameters["Omega"] / self.balance.nu, unknown[SECOND]])
        w, c = basis.k @ omega, basis.to_complex(d.reshape(self.balance.m, -1))
        table = np.zeros((2, len(c), len(t), basis.H2 + 1), dtype=complex)
        waves = np.stack([c, 1j * w * c])[:, :, None] * np.exp(1j * np.outer(t, w))
        for k2 in range(basis.H2 + 1):
            table[..., k2] = waves[..., basis.k[:, 1] == k2].sum(axis=-1)
        gap, rate = (table @ np.exp(1j * np.outer(np.arange(basis.H2 + 1), phi))).real.transpose(0, 1, 3, 2)
        theta = np.stack(np.broadcast_arrays(omega[0] * t, phi[:, None] + omega[1] * t), axis=-1).reshape(-1, 2)
        _, k, b = self._laws(evaluator, gap.reshape(len(c), -1), rate.reshape(len(c), -1), theta)
        k, b = (x.reshape(-1, len(phi), len(t)).transpose(1, 0, 2) for x in (k, b))
        return k, b if b.any() else None

    def _phases(self, evaluator: Evaluator, theta: Array) -> list[Array]:
        """Return the phase tau (T,) of the law of each element at phases theta (T, 2)."""
        return [self.balance.nu * theta[:, 0]] * evaluator.m

    def _second_loads(self, parameters: Mapping[str, float]) -> ComplexArray:
        """Return the loads (K, n) on the coordinates with the second phase; zero for a torus of unknown frequency."""
        return np.zeros((len(self.basis.k), self.balance.compiled({}).structure.n), dtype=complex)

    @property
    def model(self) -> Model:
        """The model with all excitations."""
        return self.balance.model

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return the regime, the rms of the outermost coefficients as a coarse error, and the stability.

        The only multiplier is the factor by which disturbances grow in a period 2 pi nu / Omega.
        """
        out = {"regime": np.zeros(self.balance.m, dtype=np.int8), "error": self.layout.outermost_rms(X[:-1])}
        if not stability:
            return out
        growth = growth_of(self, X, parameters)
        factor = math.exp(min(growth.rate, _LARGEST_LOGARITHM))
        error = factor * math.expm1(min(growth.error, _LARGEST_LOGARITHM))
        return out | {"multipliers": np.array([factor + 0j]), "modulus_error": error}

    def check_errors(self, solutions: CurveSolutions, observed: Observed) -> None:
        """Replace errors by Newton steps with twice the harmonics; see `hbgear.harmonic.autonomous.tori.errors`."""
        check_errors(self, solutions, observed)

    def motion(self, X: Array, **parameters: float) -> ComplexArray:
        """Return the coefficients (n, K) of all coordinates of a motion X (n,), with Omega and Omega_2 given."""
        basis = self.basis
        evaluator = self.evaluator_at(parameters)
        structure, receptance = evaluator.structure, evaluator.receptance
        w = basis.k @ np.array([parameters["Omega"] / self.balance.nu, parameters[SECOND]])
        c = basis.to_complex(X.reshape(self.balance.m, -1))
        u = (self.forces(evaluator, c, w).p - structure.kr[:, None] * c).T
        rhs = -(u @ structure.W.T)
        F, e = receptance.loads(parameters["Omega"]), receptance.e
        for i, order in zip(*basis.periodic(len(F)), strict=True):
            rhs[i] += F[order] + ((structure.kr + 1j * w[i] * structure.c) * e[order]) @ structure.W.T
        rhs += self._second_loads(parameters)
        return np.array([structure.solve(wk, rhs[i][:, None])[:, 0] for i, wk in enumerate(w)]).T

    def events(self, parameter: str) -> tuple[Any, ...]:
        """Return the ends of a branch of tori: a periodic motion, or a spectrum that does not decay."""
        return TorusMergeEvent(), smoothness_event()

    def remarks(self, branch: Branch) -> Sequence[str]:
        """Return locking as the reason of the end, and where the stability is not determined."""
        return locking_remark(branch), stability_remark(branch)

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file."""
        return {
            "model": describe(self.model),
            "balance": self.balance.discretization.describe(None),
            "torus": {"harmonics": [self.basis.H1, self.basis.H2], "odd": self.basis.odd, "dense": self.basis.dense},
        }


def _constants(basis: TorusBasis, evaluator: Evaluator, Omega: float) -> tuple[ComplexArray, ComplexArray]:
    """Return g and its derivative in Omega, (m, K) each."""
    constants = evaluator.linear(Omega).constants
    out = np.zeros((2, evaluator.m, len(basis.k)), dtype=complex)
    positions, orders = basis.periodic(constants.shape[1])
    out[:, :, positions] = constants[:, orders].transpose(0, 2, 1)
    return out[0], out[1]


def _after_derivative(product: Array, w: Array) -> Array:
    """Return a matrix (2K - 1, 2K - 1) times the derivative in time, for frequencies w (K,)."""
    K, out = len(w), np.zeros_like(product)
    out[:, 1:K] = -product[:, K:] * w[1:]
    out[:, K:] = product[:, 1:K] * w[1:]
    return out


def _applied(G: ComplexArray, slopes: Array, pairs: np.ndarray) -> Array:
    """Return G applied to slopes (S, w, w) of pairs (S, 2), (m, w, m, w), w = 2K - 1, in real form; G is (K, m, m)."""
    (K, m), width = G.shape[:2], slopes.shape[1]
    out = np.zeros((m, width, m, width))
    for (j, q), P in zip(pairs.tolist(), slopes, strict=True):
        for i in range(m):
            re, im = G[:, i, j].real[:, None], G[:, i, j].imag[:, None]
            out[i, :K, q] += re * P[:K]
            out[i, 1:K, q] += im[1:] * P[K:]
            out[i, K:, q] += re[1:] * P[K:] - im[1:] * P[1:K]
    return out
