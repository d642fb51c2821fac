"""Modes of a structure for the variational equation: one of each conjugate pair, in uncoupled blocks.

    z' = poles z - input u,   d = output z        u (m,) forces of the elements beyond their reference springs

A mode with output_j input_j = 0 for all elements is not coupled to them and is left out. In a large structure the modes
far above the frequencies of a motion are replaced by their static flexibility, d = ... - flexibility u. The error of
this residual flexibility is of second order in the ratio of the frequencies. If the elements are stiff compared with
these modes, the modes are replaced instead by one lumped mode per element, which matches three terms of the power
series

    sum_r output_r input_r / (s - poles_r) = g_0 + g_1 s + g_2 s^2 + ...,   g_j = -sum_r output_r poles_r^-(j+1) input_r
    = g_0 (g_0 - g_1 s + (g_1 g_0^-1 g_1 - g_2) s^2)^-1 g_0 + ...           flexibility, damping and inertia

The error is then of fourth order if the damping is small. The matrices must be symmetric and positive definite, as they
are for a symmetric structure.

An orthogonal T transforms the displacements of identical elements to their mean and their differences. T^T output and
input T may then be block-diagonal. The blocks remain uncoupled as long as the stiffness of identical elements varies
equally.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray


class IndependentPorts(NamedTuple):
    """Ports of which all displacements and forces are combinations: fewer where there are more elements than modes.

    Attributes
    ----------
    output : ndarray, shape (c, q)
        Displacements of c ports in the modes, linearly independent.
    input : ndarray, shape (q, b)
        Excitation of the modes by forces at b ports, linearly independent.
    flexibility : ndarray, shape (c, b)
        Residual flexibility of these ports.
    measure : ndarray, shape (g, c)
        Displacements of all ports from those of the independent ones.
    action : ndarray, shape (b, g)
        Forces at the independent ports that act like those at all ports.
    """

    output: ComplexArray
    input: ComplexArray
    flexibility: Array
    measure: Array
    action: Array


class SymmetricPair(NamedTuple):
    """Modes for kernels: one of each conjugate pair, the complex pairs before the real modes.

    Attributes
    ----------
    poles : ndarray, shape (q,)
        Poles [1 / time].
    output : ndarray, shape (g, q)
        Displacements of g ports in the modes, doubled for pairs. A port is an element or a combination of identical
        elements.
    input : ndarray, shape (q, g)
        Excitation of the modes by forces at the ports.
    ports : ndarray, shape (g,)
        Number of the element whose stiffness acts at each port.
    flexibility : ndarray, shape (g, g)
        Residual flexibility of the modes that are left out.
    base : IndependentPorts
        Ports of which the others are combinations.
    """

    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray
    ports: np.ndarray
    flexibility: Array
    base: IndependentPorts

    @classmethod
    def of(
        cls, poles: ComplexArray, output: ComplexArray, input_: ComplexArray, ports: np.ndarray, flexibility: Array
    ) -> SymmetricPair:
        """Return modes with their independent ports."""
        measuring, measure = _independent_rows(np.hstack([output.real, output.imag, flexibility]))
        acting, action = _independent_rows(np.hstack([input_.real.T, input_.imag.T, flexibility.T]))
        base = IndependentPorts(
            np.ascontiguousarray(output[measuring]),
            np.ascontiguousarray(input_[:, acting]),
            np.ascontiguousarray(flexibility[np.ix_(measuring, acting)]),
            measure,
            np.ascontiguousarray(action.T),
        )
        arrays = np.ascontiguousarray(output), np.ascontiguousarray(input_)
        return cls(poles, *arrays, np.asarray(ports, dtype=np.int64), np.ascontiguousarray(flexibility), base)


class ModalBlock(NamedTuple):
    """Coupled modes, which are propagated together.

    Attributes
    ----------
    modes : SymmetricPair
        One mode of each conjugate pair, and the real modes.
    size : int
        Number of real coordinates: two per pair, one per real mode.
    """

    modes: SymmetricPair
    size: int


@dataclass(frozen=True)
class ModalBlocks:
    """All modes of a structure.

    Attributes
    ----------
    coupled : ModalBlock
        All modes that are coupled to the elements.
    blocks : tuple of ModalBlock
        The same modes in blocks that are uncoupled as long as identical elements have equal stiffness.
    omitted_poles : ndarray
        Poles of the modes left out, both of each pair, the least damped first.
    groups : ndarray, shape (m,)
        First element that each element is identical to.
    mobility : ndarray, shape (m,)
        Inverse modal masses of the elements, from the coupled modes.
    size : int
        Number of multipliers.
    flexibility : ndarray, shape (m, m)
        Residual flexibility of the modes above the retained frequency.
    """

    coupled: ModalBlock
    blocks: tuple[ModalBlock, ...]
    omitted_poles: ComplexArray
    groups: np.ndarray
    mobility: Array
    size: int
    flexibility: Array


_UNCOUPLED_SHARE = 1e-15
"""Relative part of the static flexibility up to which a mode counts as uncoupled from the elements (rounding)."""

_REAL_POLE_TOLERANCE = 1e-13
"""Imaginary part, relative to the largest pole, up to which a pole counts as real (rounding)."""

_BLOCK_COUPLING_TOLERANCE = 1e-11
"""Relative part of the flexibility up to which two ports count as uncoupled (rounding)."""

_DEPENDENCE_TOLERANCE = 1e-12
"""Part of a port that is no combination of others, relative to the port, up to which it is rounding."""

_MOMENT_SYMMETRY_TOLERANCE = 1e-10
"""Relative asymmetry or negative eigenvalue of the moments g_j up to which they count as rounding."""


ModeArrays = tuple[ComplexArray, ComplexArray, ComplexArray]
"""Poles (r,), output (m, r) and input (r, m) of r modes."""


def modal_blocks(modes: ModeArrays, groups: np.ndarray, reach: float = np.inf, lumped: bool = False) -> ModalBlocks:
    """Return the blocks of all modes.

    Modes above the frequency ``reach`` are replaced by their residual flexibility or, with ``lumped`` and if possible,
    by one mode per element.
    """
    poles, output, input_ = modes
    T, fast = _mean_and_differences(groups), np.abs(poles) > reach
    omitted, flexibility = poles[fast], np.zeros((len(output), len(output)))
    if fast.any():
        fast_modes = poles[fast], output[:, fast], input_[fast]
        flexibility = -((fast_modes[1] / fast_modes[0]) @ fast_modes[2]).real
        lumped_modes = _lumped(*fast_modes, np.eye(len(output)) if T is None else T) if lumped else None
        slow_modes = poles[~fast], output[:, ~fast], input_[~fast]
        poles, output, input_ = slow_modes
        if lumped_modes is not None:
            flexibility = np.zeros_like(flexibility)
            poles, output, input_ = _concatenated([slow_modes, lumped_modes])
    residues = output.T[:, :, None] * input_[:, None, :]  # (r, m, m)
    contributions = np.abs(residues) / np.abs(poles)[:, None, None]
    largest = contributions.sum(axis=0).max(initial=0.0)
    is_uncoupled = contributions.max(axis=(1, 2), initial=0.0) <= _UNCOUPLED_SHARE * largest
    active = np.flatnonzero(~is_uncoupled)
    whole_block = _block_of((poles, output, input_), active, np.arange(len(output)), flexibility)
    blocks: tuple[ModalBlock, ...] = (whole_block,)
    if T is not None:
        rotated = T.T @ output, input_ @ T
        coupling = (
            np.abs(rotated[0].T[active, :, None] * rotated[1][active, None, :]) / np.abs(poles[active])[:, None, None]
        )
        residual = T.T @ flexibility @ T
        block = _blocks(coupling.max(axis=0, initial=0.0) + np.abs(residual) > _BLOCK_COUPLING_TOLERANCE * largest)
        owner = block[np.argmax(np.einsum("rii->ri", coupling), axis=1)]
        blocks = ()
        for b in range(block.max(initial=-1) + 1):
            ports = block == b
            part, rest = (poles, rotated[0][ports], rotated[1][:, ports]), residual[np.ix_(ports, ports)]
            blocks = (*blocks, _block_of(part, active[owner == b], groups[ports], rest))
        if sum(part.size for part in blocks) != whole_block.size or len(blocks) == 1:
            blocks = (whole_block,)
    mobility = mobility_of(poles[active], output[:, active], input_[active])
    omitted = np.concatenate([poles[is_uncoupled], omitted])
    omitted = omitted[np.argsort(-omitted.real, kind="stable")]
    return ModalBlocks(whole_block, blocks, omitted, groups, mobility, whole_block.size + len(omitted), flexibility)


def flexibilities(poles: ComplexArray, output: ComplexArray, input_: ComplexArray) -> tuple[Array, Array]:
    """Return the frequencies (r,) of the modes, ascending, and the residual flexibilities (r + 1, m) of the elements.

    Row i is the flexibility of all modes except the first i.
    """
    size = np.abs(poles)
    order = np.argsort(size, kind="stable")
    contributions = -(output / poles * input_.T).real[:, order]
    residual = np.zeros((len(poles) + 1, len(output)))
    residual[:-1] = np.cumsum(contributions.T[::-1], axis=0)[::-1]
    return size[order], residual


def _blocks(is_coupled: np.ndarray) -> np.ndarray:
    """Return the block number of each of m ports, from whether two of them are coupled (m, m)."""
    if is_coupled.all():
        return np.zeros(len(is_coupled), dtype=int)
    return scipy.sparse.csgraph.connected_components(is_coupled)[1]


def _lumped(
    poles: ComplexArray, output: ComplexArray, input_: ComplexArray, T: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
    """Return one lumped mode per element that replaces many modes (poles, output, input); None if not possible.

    Ports that the modes leave uncoupled in the orthogonal coordinates T (m, m) stay uncoupled.
    """
    powers = -1.0 / poles ** np.array([[1], [2], [3]])
    g = (((T.T @ output) * powers[:, None]) @ (input_ @ T)).real
    block = _blocks(np.abs(g[0]) > _BLOCK_COUPLING_TOLERANCE * np.abs(g[0]).max(initial=0.0))
    mode_sets = []
    for b in range(block.max(initial=-1) + 1):
        ports = np.flatnonzero(block == b)
        lumped_modes = _lumped_block(g[:, ports[:, None], ports], float(np.abs(poles).max()))
        if lumped_modes is None:
            return None
        mode_sets.append((lumped_modes[0], T[:, ports] @ lumped_modes[1], lumped_modes[2] @ T[:, ports].T))
    return _concatenated(mode_sets)


def _concatenated(
    mode_sets: list[tuple[ComplexArray, ComplexArray, ComplexArray]],
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Concatenate poles, output and input of several sets of modes."""
    poles, output, input_ = zip(*mode_sets, strict=True)
    return np.concatenate(poles), np.concatenate(output, axis=1), np.concatenate(input_)


def _lumped_block(g: Array, highest: float) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
    """Return the modes of the structure with the flexibility g_0 + g_1 s + g_2 s^2; None if it is not symmetric.

    None too if a mass or a flexibility is not positive, or a pole is unstable or above twice ``highest``, the highest
    frequency of the replaced modes.
    """
    if np.any(
        np.abs(g - g.transpose(0, 2, 1)).max(axis=(1, 2)) > _MOMENT_SYMMETRY_TOLERANCE * np.abs(g).max(axis=(1, 2))
    ):
        return None
    s, Q = np.linalg.eigh(g[0])
    is_positive = s > _MOMENT_SYMMETRY_TOLERANCE * s[-1]
    if not s[-1] > 0 or s[0] < -_MOMENT_SYMMETRY_TOLERANCE * s[-1]:
        return None
    V = Q[:, is_positive] / np.sqrt(s[is_positive])  # V^T g_0 V = 1
    C = -V.T @ g[1] @ V
    M, q = C @ C - V.T @ g[2] @ V, len(C)
    try:
        Mi = np.linalg.inv(M)
        A = np.zeros((2 * q, 2 * q))
        A[:q, q:], A[q:, :q], A[q:, q:] = np.eye(q), -Mi, -Mi @ C
        poles, right = np.linalg.eig(A)
        inverse = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return None
    digits = np.linalg.norm(right) * np.linalg.norm(inverse) * np.finfo(float).eps
    size = np.abs(poles)
    if (
        digits * size.max() > _MOMENT_SYMMETRY_TOLERANCE * size.min()
        or size.max() > 2 * highest
        or np.any(poles.real > digits * size)
    ):
        return None
    ports = g[0] @ V
    return poles.astype(complex), ports @ right[:q], inverse[:, q:] @ Mi @ ports.T


def mobility_of(poles: ComplexArray, output: ComplexArray, input_: ComplexArray) -> Array:
    """Return the inverse modal masses (m,) of the elements: the initial acceleration by a unit force at the element."""
    return np.abs((output * poles * input_.T).sum(axis=1))


def halves(poles: ComplexArray) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of one pole of each conjugate pair, and of the real poles."""
    real = np.abs(poles.imag) <= _REAL_POLE_TOLERANCE * np.abs(poles).max(initial=0.0)
    return np.flatnonzero(~real & (poles.imag > 0)), np.flatnonzero(real)


def _mean_and_differences(groups: np.ndarray) -> Array | None:
    """Return T (m, m): the mean and the differences of each group of identical elements; None without such groups."""
    m = len(groups)
    if len(np.unique(groups)) == m:
        return None
    T = np.zeros((m, m))
    for first in np.unique(groups):
        members = np.flatnonzero(groups == first)
        T[np.ix_(members, members)] = scipy.linalg.helmert(len(members), full=True).T
    return T


def _block_of(modes: ModeArrays, indices: np.ndarray, ports: np.ndarray, flexibility: Array) -> ModalBlock:
    """Return the block of the modes with these indices and ports, and with the residual flexibility."""
    poles, output, input_ = modes
    is_selected = np.zeros(len(poles), dtype=bool)
    is_selected[indices] = True
    pairs, reals = (half[is_selected[half]] for half in halves(poles))
    order = np.concatenate([pairs, reals])
    lam, out, force = (np.array(x, dtype=complex) for x in (poles[order], output[:, order], input_[order]))
    k = len(pairs)
    out[:, :k] *= 2.0
    for x in (lam[k:], out[:, k:], force[k:]):
        x.imag = 0.0
    return ModalBlock(SymmetricPair.of(lam, out, force, ports, flexibility), 2 * k + len(reals))


def _independent_rows(A: Array) -> tuple[np.ndarray, Array]:
    """Return the numbers (c,) of independent rows of A (g, n), at least one, and T (g, c) with A = T A[rows]."""
    size = np.linalg.norm(A, axis=1)
    scaled = A / np.where(size > 0, size, 1.0)[:, None]
    R, order = scipy.linalg.qr(scaled.T, mode="r", pivoting=True)
    rank = max(int(np.count_nonzero(np.abs(np.diag(R)) > _DEPENDENCE_TOLERANCE)), 1)
    rows, others = np.sort(order[:rank]), np.sort(order[rank:])
    T = np.zeros((len(A), rank))
    T[rows] = np.eye(rank)
    T[others] = np.linalg.lstsq(scaled[rows].T, scaled[others].T, rcond=None)[0].T * size[others, None] / size[rows]
    return rows, T
