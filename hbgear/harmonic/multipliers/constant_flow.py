"""Kernels: exact flow of the variational equation over a time in which the stiffness of all elements is constant.

    z' = poles z - input u,   u = D (output z - rest u) - p         D dp/dd - kr, p = k y of sliders that stick
    u = (1 + D rest)^-1 (D output z - p)
    z' = F z + b,   z(h) = e^{F h} z(0) + h phi_1(F h) b            phi_1(x) = (e^x - 1) / x

phi_1 of F h / 2^n is summed as a Taylor series and doubled n times:

    h_2 = 2 h,   h_2 phi_1(F h_2) = (1 + e^{F h}) h phi_1(F h),   e^{F h_2} = (e^{F h})^2

This module is imported when its first kernel is needed, see `hbgear.common.process.compiling`.

References
----------
Higham, Functions of Matrices (2008), chapter 10, https://doi.org/10.1137/1.9780898717778.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.compiling import kernel
from hbgear.continuation.numerics.gauss_kernels import add_product, solve_in_place

TAYLOR_DEGREE = 15
"""Degree of the Taylor series of phi_1."""

TAYLOR_RADIUS = 0.5
"""Largest norm of the matrix in the Taylor series, whose remainder is 1e-18 there."""


class FlowWorkspace(NamedTuple):
    """Preallocated arrays of a flow of 2q real modal coordinates and g ports, for matrices of r columns.

    Attributes
    ----------
    ports : ndarray, shape (g, g + 2q + r)
        System of equations [1 + D rest, D output, -p], and its solution.
    F, exponential, phi, product : ndarray, shape (2q, 2q)
        F h, e^{F h}, h phi_1(F h), and a product of matrices.
    b, constant : ndarray, shape (2q, r)
        b, and h phi_1(F h) b.
    displacements : ndarray, shape (g, r)
        Displacements of the ports at the end of a segment.
    """

    ports: Array
    F: Array
    exponential: Array
    phi: Array
    product: Array
    b: Array
    constant: Array
    displacements: Array


@kernel
def flow_workspace(g: int, q: int, columns: int) -> Any:
    """Return a `FlowWorkspace` for g ports, q modes and a number of columns."""
    n = 2 * q
    return FlowWorkspace(
        np.empty((g, g + n + columns)),
        np.empty((n, n)),
        np.empty((n, n)),
        np.empty((n, n)),
        np.empty((n, n)),
        np.empty((n, columns)),
        np.empty((n, columns)),
        np.empty((g, columns)),
    )


@kernel
def fill_flow(modes: Any, D: Any, forces: Any, h: float, flow: Any) -> None:
    """Compute the flow over a time h with modulations D (g,) and constant ``forces`` (g, r) of the ports."""
    g, q, ports, F, b = D.shape[0], modes.poles.shape[0], flow.ports, flow.F, flow.b
    _solve_ports(modes, D, forces, ports)
    _set_diagonal(0.0, F)
    _set_diagonal(0.0, b)
    for k in range(q):
        pole = modes.poles[k]
        F[k, k], F[k, q + k], F[q + k, k], F[q + k, q + k] = pole.real, -pole.imag, pole.imag, pole.real
        for p in range(g):
            x, y = modes.input[k, p].real, modes.input[k, p].imag
            for n in range(2 * q):
                F[k, n] -= x * ports[p, g + n]
                F[q + k, n] -= y * ports[p, g + n]
            for n in range(b.shape[1]):
                b[k, n] -= x * ports[p, g + 2 * q + n]
                b[q + k, n] -= y * ports[p, g + 2 * q + n]
    _exponentiate(h, flow)
    _set_diagonal(0.0, flow.constant)
    add_product(flow.phi, b, 1.0, flow.constant)


@kernel
def _solve_ports(modes: Any, D: Any, forces: Any, ports: Any) -> None:
    """Fill [1 + D rest, D output, -forces] of the equations of the ports and solve them; modes are real numbers."""
    g, q = D.shape[0], modes.poles.shape[0]
    for p in range(g):
        for e in range(g):
            ports[p, e] = D[p] * modes.flexibility[p, e] + (1.0 if p == e else 0.0)
        for k in range(q):
            ports[p, g + k], ports[p, g + q + k] = D[p] * modes.output[p, k].real, -D[p] * modes.output[p, k].imag
        for n in range(forces.shape[1]):
            ports[p, g + 2 * q + n] = -forces[p, n]
    solve_in_place(ports)


@kernel
def _set_diagonal(value: float, out: Any) -> None:
    """Set ``out`` to a value on the diagonal and zero elsewhere."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = value if i == j else 0.0


@kernel
def _exponentiate(h: float, flow: Any) -> None:
    """Compute e^{F h} and h phi_1(F h) by scaling and squaring."""
    F, E, phi, product = flow.F, flow.exponential, flow.phi, flow.product
    n, size = F.shape[0], 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(F[i, j])
        size = max(size, row * h)
    doublings = 0
    while size > TAYLOR_RADIUS:
        size *= 0.5
        h *= 0.5
        doublings += 1
    _set_diagonal(1.0, phi)
    for degree in range(TAYLOR_DEGREE + 1, 1, -1):  # phi_1 = 1 + x / 2 (1 + x / 3 (1 + ...)), Horner's rule
        _set_diagonal(1.0, product)
        add_product(F, phi, h / degree, product)
        _copy(product, 1.0, phi)
    _set_diagonal(1.0, E)
    add_product(F, phi, h, E)
    _copy(product, h, phi)
    for _ in range(doublings):
        _copy(phi, 1.0, product)
        add_product(E, phi, 1.0, product)
        _copy(product, 1.0, phi)
        _set_diagonal(0.0, product)
        add_product(E, E, 1.0, product)
        _copy(product, 1.0, E)


@kernel
def _copy(A: Any, factor: float, out: Any) -> None:
    """Set ``out`` to factor A."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i, j] = factor * A[i, j]


@kernel
def apply_flow(flow: Any, state: Any) -> None:
    """Replace the state (2q, r) by e^{F h} state + h phi_1(F h) b."""
    _copy(flow.constant, 1.0, flow.b)
    add_product(flow.exponential, state, 1.0, flow.b)
    _copy(flow.b, 1.0, state)


@kernel
def fill_displacements(modes: Any, D: Any, state: Any, forces: Any, flow: Any) -> None:
    """Compute the displacements output z - rest u of the ports in a state (2q, r) with modulations D (g,)."""
    g, q, ports, d = D.shape[0], modes.poles.shape[0], flow.ports, flow.displacements
    _solve_ports(modes, D, forces, ports)
    for p in range(g):
        for k in range(2 * q):
            for n in range(d.shape[1]):
                ports[p, g + 2 * q + n] += ports[p, g + k] * state[k, n]
    _set_diagonal(0.0, d)
    for p in range(g):
        for k in range(q):
            x, y = modes.output[p, k].real, modes.output[p, k].imag
            for n in range(d.shape[1]):
                d[p, n] += x * state[k, n] - y * state[q + k, n]
        for e in range(g):
            for n in range(d.shape[1]):
                d[p, n] -= modes.flexibility[p, e] * ports[e, g + 2 * q + n]
