"""Equations of motion of a piecewise-linear system, linear between its contact instants.

    dy/dtau = [A(contacts, section) + sum_s kappa_s(tau) b_s r_s^T] y,   y = (x, c),   dc/dtau = S c

x is the state of the structure. Loads and prescribed displacements are sums of the functions c = (1, s, s^2, s^3, cos l
tau, sin l tau, ...), so that a singular stiffness matrix (free flight) is no special case. Where a stiffness or a
displacement has breakpoints, the period is divided into sections, s is the phase since the section began, and the
coefficients of the sums are constant on a section. Springs of constant stiffness are part of A; the others keep their
factor kappa_s(tau).

Elements with the same gap and breakpoints pass each breakpoint at one instant. The first of them has the sum of their
laws and dampers, so that one switch represents this instant; the others are without force.

The state is x = L (q, q' / clock) with coordinates scaled by their masses. Motions that no spring, damper or element
resists (rigid rotation) change no gap and no force. They are removed by taking the quotient,

    A r = 0, D r = 0:   x = r a + N y,   dy/dt = N^+ (A N y + ...)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.structure.linear_structure import dense
from hbgear.mechanics.laws.laws import Parallel, PiecewiseLinear
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series, derive, evaluate, to_complex, to_real
from hbgear.mechanics.series.periodic import Periodic, Phased
from hbgear.mechanics.series.piecewise_polynomial import TURN
from hbgear.mechanics.structures.elements import Element

UNOBSERVED_SINGULAR_VALUE = 1e-11
"""Singular value, relative to the largest, up to which a direction has no effect."""

MAX_COORDINATES = 60
"""Largest number of coordinates of a structure; the state is integrated as a whole."""

DEGREE = 3
"""Degree of the polynomials of a `Periodic`."""


class NotPiecewiseLinear(ValueError):
    """The model has no contact instants: a law is not piecewise linear, or the structure is too large."""


class Contacts(NamedTuple):
    """Section of the period, and the number of breakpoints below the gap of each element."""

    section: int
    levels: tuple[int, ...]


@dataclass(frozen=True)
class Flow:
    """The flow dy/dtau = (A + sum_s kappa_s(tau) b_s r_s^T) y between two instants.

    A (N, N); b, r (S, N); stiffness : the S factors kappa; rate : an upper bound of the norm of the matrix;
    with constant stiffness the largest modulus of an eigenvalue.
    """

    A: Array
    b: Array
    r: Array
    stiffness: tuple[Phased, ...]
    rate: float


class Equations:
    """Equations of a `System` at one set of parameters, for every Omega.

    ``given`` is the system as it was given, ``first`` (m,) the number of the element that has the force of each one,
    see `first_parallel`.

    Parameters
    ----------
    system : System
        A system whose laws are all piecewise linear.
    nu : int, optional
        Number of excitation periods in one period of the motion. The default is 1.
    stiffness : float, optional
        Factor of the forces of all elements. The default is 1.

    Raises
    ------
    NotPiecewiseLinear
        If a law is not a sum of piecewise-linear springs, the structure has more than 60 coordinates, or parts of it
        are known by receptances only.
    """

    def __init__(self, system: System, nu: int = 1, stiffness: float = 1.0) -> None:
        _require_piecewise_linear(system)
        self.first = first_parallel(system.elements)
        self.given, self.system = system, _with_sums(system, self.first)
        self.nu, self.m, self.stiffness = nu, len(system.elements), stiffness
        self.breakpoints = tuple(element.law.breakpoints for element in self.system.elements)
        self._displacements: dict[int, Array] = {}
        self._bounds: dict[tuple[Contacts, ...], Array] = {}
        self._springs: dict[tuple[int, int], tuple[tuple[Phased, float, float], ...]] = {}
        self.constant_flows: dict[Contacts, Flow | None] = {}
        self.constant_matrices: dict[tuple[Contacts, ...], Array | None] = {}  # of flows at Omega = 1

    def parallel(self, j: int) -> list[Element]:
        """Return the given elements whose forces element j has."""
        return [self.given.elements[i] for i, number in enumerate(self.first) if number == j]

    @cached_property
    def starts(self) -> Array:
        """Phases in [0, 2 pi) at which sections begin, ascending; a single section begins at 0."""
        breakpoints = {x for e in self.system.elements for x in (*e.law.phases, *e.displacement.corners)}
        return np.array(sorted(breakpoints)) if breakpoints else np.zeros(1)

    @cached_property
    def orders(self) -> tuple[int, ...]:
        """Harmonics of the excitation in c."""
        loads = {order for load in self.system.loads for order in load.complex(self.system.n) if order}
        for e in self.system.elements:
            if isinstance(e.displacement, Series):
                c = to_complex(e.displacement.row())
                loads |= set(np.flatnonzero(c[1:]) + 1)
        return tuple(sorted(int(order) for order in loads))

    @cached_property
    def _orders(self) -> Array:
        """`orders` as an array of floats."""
        return np.array(self.orders, dtype=float)

    @cached_property
    def degree(self) -> int:
        """Highest power of s in c."""
        return DEGREE if any(isinstance(e.displacement, Periodic) for e in self.system.elements) else 0

    @property
    def count(self) -> int:
        """Number of the functions c."""
        return 1 + self.degree + 2 * len(self.orders)

    def section(self, tau: float) -> int:
        """Return the number of the section at a phase; at a breakpoint the section that follows."""
        return (int(np.searchsorted(self.starts, tau % TURN, side="right")) - 1) % len(self.starts)

    def functions(self, tau: Array, sections: Sequence[int]) -> Array:
        """Return c (K, count) at phases tau (K,), each in its section."""
        return self.fill_functions(tau, sections, np.empty((len(tau), self.count)))

    def fill_functions(self, tau: Array, sections: Sequence[int], out: Array) -> Array:
        """Set ``out`` (K, count) to `functions`, and return it."""
        d = self.degree
        out[:, 0] = 1.0
        if d:
            s = (tau - self.starts[list(sections)] + math.pi) % TURN - math.pi
            s = np.where(s < -1e-9, s + TURN, s)
            out[:, 1 : d + 1] = s[:, None] ** np.arange(1, d + 1)
        angles = np.multiply.outer(tau, self._orders)
        np.cos(angles, out=out[:, d + 1 :: 2])
        np.sin(angles, out=out[:, d + 2 :: 2])
        return out

    @cached_property
    def generator(self) -> Array:
        """S (count, count)."""
        S, d = np.zeros((self.count, self.count)), self.degree
        for power in range(1, d + 1):
            S[power, power - 1] = power
        for i, order in enumerate(self.orders):
            column = 1 + d + 2 * i
            S[column, column + 1], S[column + 1, column] = -order, order
        return S

    def displacements(self, section: int) -> Array:
        """Return the coefficients (m, count) of the prescribed displacements of the elements on a section."""
        coefficients = self._displacements.get(section)
        if coefficients is None:
            coefficients = self._displacements[section] = self._displacement_coefficients(section)
        return coefficients

    def _displacement_coefficients(self, section: int) -> Array:
        """Compute `displacements` of a section."""
        E = np.zeros((self.m, self.count))
        for row, element in zip(E, self.system.elements, strict=True):
            e = element.displacement
            if isinstance(e, Periodic):
                start = self.starts[section] + 1e-9
                derivatives = [float(e(start, n)) for n in range(DEGREE + 1)]
                row[: DEGREE + 1] = shifted_polynomial(derivatives, -1e-9)
                continue
            row[0], c = e.mean, e.row()
            for i, order in enumerate(self.orders):
                if order <= e.order:
                    row[1 + self.degree + 2 * i :][:2] = c[2 * order - 1 : 2 * order + 1]
        return E

    def bounds(self, contacts: tuple[Contacts, ...]) -> Array:
        """Return the breakpoints (K, m, 2) below and above each gap in segments; -inf or inf without one."""
        bounds = self._bounds.get(contacts)
        if bounds is None:
            extended = [(-math.inf, *points, math.inf) for points in self.breakpoints]
            bounds = self._bounds[contacts] = np.array(
                [
                    [points[level : level + 2] for points, level in zip(extended, segment.levels, strict=True)]
                    for segment in contacts
                ],
                dtype=float,
            )
        return bounds

    def at(self, Omega: float) -> EquationsAt:
        """Return the equations at a frequency of the excitation."""
        return EquationsAt(self, Omega)

    @cached_property
    def fixed(self) -> StateSpace:
        """The structure, if it does not depend on Omega."""
        return StateSpace(self.system, self.system.C, self.system.K)

    @cached_property
    def is_inverse(self) -> bool:
        """Whether all forces are independent of Omega, so that A is A_1 / Omega + S."""
        system = self.system
        driven = any(
            e.damping and e.displacement.row()[1:].any() if isinstance(e.displacement, Series) else e.damping
            for e in system.elements
        )
        return system.speed is None and not driven and all(load.power == 0 for load in system.loads)

    def structure(self, Omega: float) -> StateSpace:
        """Return the structure at a frequency."""
        system = self.system
        if system.speed is None:
            return self.fixed
        C, K = system.speed.at(Omega, system.n)
        return StateSpace(system, system.C + C, system.K + K)

    def springs(self, j: int, level: int) -> tuple[tuple[Phased, float, float], ...]:
        """Return stiffness, slope and offset of each spring of element j with ``level`` of its breakpoints below d."""
        springs = self._springs.get((j, level))
        if springs is None:
            below, law = np.array(self.breakpoints[j])[:level], self.system.elements[j].law
            segments = (_linear_segment(spring, below) for spring in law.piecewise or ())
            springs = tuple((k, self.stiffness * slope, self.stiffness * offset) for k, slope, offset in segments)
            self._springs[j, level] = springs
        return springs


def first_parallel(elements: Sequence[Element]) -> list[int]:
    """Return, for each element, the number of the first one that passes the same breakpoints at the same instants."""
    first: list[int] = []
    for i, element in enumerate(elements):
        first.append(next((j for j in range(i) if first[j] == j and _is_parallel(elements[j], element)), i))
    return first


def _is_parallel(a: Element, b: Element) -> bool:
    """Return whether two elements have the same gap and the same breakpoints."""
    return (
        bool(a.law.breakpoints)
        and a.law.breakpoints == b.law.breakpoints
        and np.array_equal(a.direction, b.direction)
        and a.displacement == b.displacement
    )


def _with_sums(system: System, first: Sequence[int]) -> System:
    """Return the same system with the forces of parallel elements in the first of them."""
    elements = list(system.elements)
    for i, j in enumerate(first):
        if i != j:
            a, b = elements[j], elements[i]
            law, name = Parallel((a.law, b.law)), f"{a.name}, {b.name}"
            elements[j] = replace(a, law=law, damping=a.damping + b.damping, name=name)
            elements[i] = replace(b, law=PiecewiseLinear((), (0.0,)), damping=0.0)
    return replace(system, elements=elements)


class StateSpace:
    """State-space form of a structure with the dampers of its elements: x' = A x + B p + force f,   d + e = D x.

    A (r, r); input (r, n) of forces on coordinates; D (m, r); reduce (r, 2n) of (q, q'); W, damping of the elements.
    C and K are the matrices of the coordinates at one Omega.
    """

    def __init__(self, system: System, C: Any, K: Any) -> None:
        M, C, K = (dense(A) for A in (system.M, C, K))
        W, n = system.W, system.n
        self.W, self.damping = W, np.array([e.damping for e in system.elements])
        # states of one size: coordinates in units of the root of their mass, time in units of the fastest spring
        s = 1.0 / np.sqrt(np.abs(np.diag(M)) + (np.diag(M) == 0) * (np.abs(np.diag(M)).max() or 1.0))
        references = np.array([e.law.reference for e in system.elements])
        closed = K + (W * references) @ W.T
        Mi = np.linalg.inv(M * np.outer(s, s))
        clock = math.sqrt(np.abs(Mi @ (closed * np.outer(s, s))).max()) or 1.0
        A = np.zeros((2 * n, 2 * n))
        A[:n, n:] = clock * np.eye(n)
        A[n:, :n] = -Mi @ (K * np.outer(s, s)) / clock
        A[n:, n:] = -Mi @ ((C + (W * self.damping) @ W.T) * np.outer(s, s))
        force = np.concatenate([np.zeros((n, n)), Mi * s / clock])
        D = np.concatenate([W.T * s, np.zeros((len(references), n))], axis=1)
        L = np.diag(np.concatenate([1 / s, 1 / (s * clock)]))
        self.A, self.input, self.D, self.reduce = _observable_part(A, force, D, L)
        self.gaps: dict[int, Array] = {}  # of each section, see `EquationsAt.gaps`
        self.switching_rows: dict[Any, tuple[Array, Array]] = {}  # of each pattern, see `shooting.switching_rows`


class EquationsAt:
    """`Equations` at one Omega: flows of contact patterns, gaps and their derivatives."""

    def __init__(self, equations: Equations, Omega: float) -> None:
        self.equations, self.Omega = equations, float(Omega)
        self.structure = equations.structure(self.Omega)
        self.size = len(self.structure.A)
        self._flows: dict[Contacts, Flow] = {}
        self._forcing: dict[int, Array] = {}  # of each section

    @cached_property
    def input(self) -> Array:
        """Derivatives (r, m) of the state by the forces of the elements."""
        return self.structure.input @ self.structure.W / self.Omega

    @property
    def period(self) -> float:
        """Phase after which a motion repeats."""
        return TURN * self.equations.nu

    def extended(self, x: Array, tau: float, section: int) -> Array:
        """Return y = (x, c)."""
        return self.extended_states(x[None], np.array([tau]), [section])[0]

    def extended_states(self, x: Array, tau: Array, sections: Sequence[int]) -> Array:
        """Return y (K, N) of states x (K, r) at phases tau (K,), each in its section."""
        y = np.empty((len(x), self.size + self.equations.count))
        y[:, : self.size] = x
        self.equations.fill_functions(tau, sections, y[:, self.size :])
        return y

    def gaps(self, section: int) -> Array:
        """Return the rows (m, N) that map y to the gaps of all elements."""
        rows = self.structure.gaps.get(section)
        if rows is None:
            blocks = [self.structure.D, -self.equations.displacements(section)]
            rows = self.structure.gaps[section] = np.concatenate(blocks, axis=1)
        return rows

    def flow(self, contacts: Contacts) -> Flow:
        """Return the flow for the contacts of all elements."""
        flow = self._flows.get(contacts)
        if flow is None:
            flow = self._flows[contacts] = self._constant_flow(contacts) or self._assemble_flow(contacts)
        return flow

    def flows(self, contacts: tuple[Contacts, ...]) -> tuple[Array, dict[int, Flow]]:
        """Return the matrices A (K, N, N) of several flows, and the flows of varying stiffness by their number."""
        stored = self.equations.constant_matrices
        if contacts not in stored:
            units = [unit.A for unit in map(self._unit_flow, contacts) if unit is not None]
            stored[contacts] = np.array(units) if len(units) == len(contacts) else None
        matrices = stored[contacts]
        if matrices is not None:
            A = matrices.copy()
            A[:, : self.size] /= self.Omega
            return A, {}
        flows = [self.flow(segment) for segment in contacts]
        return np.array([flow.A for flow in flows]), {k: flow for k, flow in enumerate(flows) if flow.stiffness}

    def _unit_flow(self, contacts: Contacts) -> Flow | None:
        """Return the flow at Omega = 1, assembled once; None if A is not A_1 / Omega + S with constant A_1."""
        equations = self.equations
        if not equations.is_inverse:
            return None
        if contacts not in equations.constant_flows:
            unit = equations.at(1.0)._assemble_flow(contacts)
            fastest = float(np.abs(np.linalg.eigvals(self.structure_matrix(unit))).max(initial=0.0))
            equations.constant_flows[contacts] = None if unit.stiffness else replace(unit, rate=fastest)
        return equations.constant_flows[contacts]

    def _constant_flow(self, contacts: Contacts) -> Flow | None:
        """Return A_1 / Omega + S; None if A has other powers of Omega or the stiffness varies."""
        unit = self._unit_flow(contacts)
        if unit is None:
            return None
        A = unit.A.copy()
        A[: self.size] /= self.Omega
        return Flow(A, unit.b, unit.r, (), max(unit.rate / self.Omega, *self.equations.orders, 1.0))

    def structure_matrix(self, flow: Flow) -> Array:
        """Return the part of A that acts on the state of the structure."""
        return flow.A[: self.size, : self.size]

    def _assemble_flow(self, contacts: Contacts) -> Flow:
        """Compute `flow` for the contacts of all elements."""
        equations, r = self.equations, self.size
        A = np.zeros((r + equations.count, r + equations.count))
        A[:r, :r] = self.structure.A / self.Omega
        A[r:, r:] = equations.generator
        A[:r, r:] = self._forcing_coefficients(contacts.section)
        gaps, b, rows, factors, rate = self.gaps(contacts.section), [], [], [], 0.0
        for j, level in enumerate(contacts.levels):
            for stiffness, slope, offset in equations.springs(j, level):
                row = slope * gaps[j]
                row[r] += offset
                if not row.any():
                    continue
                k = _constant_stiffness(stiffness, equations.starts[contacts.section])
                if k is not None:
                    A[:r] -= k * np.outer(self.input[:, j], row)
                    continue
                b.append(np.concatenate([-self.input[:, j], np.zeros(equations.count)]))
                rows.append(row)
                factors.append(stiffness)
                rate += stiffness.bound * np.abs(b[-1]).max() * np.abs(row).sum()
        none = np.zeros((0, len(A)))
        rate += float(np.abs(A).sum(axis=0).max())
        return Flow(A, np.array(b) if b else none, np.array(rows) if rows else none, tuple(factors), rate)

    def _forcing_coefficients(self, section: int) -> Array:
        """Return the coefficients (r, count) of loads and prescribed displacements in the derivative of the state."""
        coefficients = self._forcing.get(section)
        if coefficients is None:
            coefficients = self._forcing[section] = self._compute_forcing(section)
        return coefficients

    def _compute_forcing(self, section: int) -> Array:
        """Compute `_forcing_coefficients` of a section."""
        equations, structure = self.equations, self.structure
        f = np.zeros((equations.system.n, equations.count))
        for load in equations.system.loads:
            for order, amplitude in load.complex(len(f)).items():
                amplitude = self.Omega**load.power * amplitude
                if order == 0:
                    f[:, 0] += amplitude.real
                    continue
                column = 1 + equations.degree + 2 * equations.orders.index(order)
                f[:, column] += amplitude.real
                f[:, column + 1] -= amplitude.imag
        rates = self.Omega * equations.displacements(section) @ equations.generator
        f += (structure.W * structure.damping) @ rates
        return structure.input @ f / self.Omega

    def state(self, rows: Array, tau: float) -> Array:
        """Return the state x of a motion with real Fourier coefficients ``rows`` (n, 2H + 1) of all coordinates."""
        theta = tau / self.equations.nu
        velocity = self.Omega / self.equations.nu * evaluate(to_real(derive(to_complex(rows))), theta)[:, 0]
        return self.structure.reduce @ np.concatenate([evaluate(rows, theta)[:, 0], velocity])


def _require_piecewise_linear(system: System) -> None:
    """Raise an error if a system has no contact instants."""
    for element in system.elements:
        if element.law.piecewise is None:
            raise NotPiecewiseLinear(
                f"the law of {element.name}, {type(element.law).__name__}, is not piecewise linear: contact instants "
                "are computed for Unilateral, Backlash, PiecewiseLinear and sums of them"
            )
        if element.law.sliders:
            raise NotPiecewiseLinear(
                f"the law of {element.name} has friction: contact instants need laws without memory"
            )
    if system.n > MAX_COORDINATES:
        raise NotPiecewiseLinear(
            f"{system.n} coordinates are too many for contact instants; at most {MAX_COORDINATES}: reduce the model "
            "first, hb.mechanics.reduce(model, modes=...)"
        )
    if system.massless:
        raise NotPiecewiseLinear(f"contact instants need a mass of every coordinate, and '{system.massless}' has none")
    if system.receptances is not None:
        raise NotPiecewiseLinear(
            "contact instants need M, C and K of all coordinates, but some coordinates have receptances only"
        )


def _observable_part(A: Array, force: Array, D: Array, L: Array) -> tuple[Array, Array, Array, Array]:
    """Return the state space without directions r of A r = 0 and D r = 0, on which nothing depends."""
    while len(A):
        stacked = np.concatenate([A / (np.abs(A).max() or 1.0), D / (np.abs(D).max() or 1.0)])
        _, sizes, vt = np.linalg.svd(stacked)
        observable = sizes > UNOBSERVED_SINGULAR_VALUE * sizes.max(initial=0.0)
        if observable.all():
            break
        N = vt[observable]  # orthonormal: its transpose is the basis, itself the left inverse that removes r
        A, force, D, L = N @ A @ N.T, N @ force, D @ N.T, N @ L
    return A, force, D, L


def _linear_segment(spring: PiecewiseLinear, below: Array) -> tuple[Phased, float, float]:
    """Return stiffness, slope and offset of a spring for d above the breakpoints ``below`` and below all others."""
    g0, changes, breakpoints = spring.ramps
    is_below = np.isin(breakpoints, below)
    slope = spring.slopes[0] + float(changes[is_below].sum())
    return spring.stiffness, slope, g0 - float(changes[is_below] @ breakpoints[is_below])


def _constant_stiffness(stiffness: Phased, start: float) -> float | None:
    """Return the value of a stiffness that is constant on a section; None if it varies there."""
    if not stiffness.varies:
        return float(stiffness.mean)
    if isinstance(stiffness, Periodic):
        derivatives = [float(stiffness(start + 1e-9, n)) for n in range(DEGREE + 1)]
        if not any(derivatives[1:]):
            return derivatives[0]
    return None


def shifted_polynomial(derivatives: Sequence[Any], shift: float) -> list[Any]:
    """Return the coefficients of powers of s about a shifted point, from derivatives of a polynomial at the point."""
    c = [d / math.factorial(n) for n, d in enumerate(derivatives)]
    return [
        sum(c[n] * math.comb(n, power) * shift ** (n - power) for n in range(power, len(c))) for power in range(len(c))
    ]
