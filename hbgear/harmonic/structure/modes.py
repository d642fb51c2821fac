"""Modes of a structure for the variational equation: one of each conjugate pair, in uncoupled blocks.

    z' = poles z - input u,   d = output z        u (m,) forces of the elements beyond their reference springs

A mode with output_j input_j = 0 for all elements is not coupled to them and is left out. In a large structure the modes
far above the frequencies of a motion are replaced by their static flexibility, d = ... - rest u. The error of this
residual flexibility is of second order in the ratio of the frequencies. If the elements are stiff compared with these
modes, the modes are replaced instead by one lumped mode per element, which matches three terms of the power series

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
    rest : ndarray, shape (g, g)
        Residual flexibility of the modes that are left out.
    """

    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray
    ports: np.ndarray
    rest: Array


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
    whole : ModalBlock
        All modes that are coupled to the elements.
    split : tuple of ModalBlock
        The same modes in blocks that are uncoupled as long as identical elements have equal stiffness.
    idle : ndarray
        Poles of the modes left out, both of each pair, the least damped first.
    groups : ndarray, shape (m,)
        First element that each element is identical to.
    mobility : ndarray, shape (m,)
        Inverse modal masses of the elements, from the coupled modes.
    size : int
        Number of multipliers.
    rest : ndarray, shape (m, m)
        Residual flexibility of the modes above the retained frequency.
    """

    whole: ModalBlock
    split: tuple[ModalBlock, ...]
    idle: ComplexArray
    groups: np.ndarray
    mobility: Array
    size: int
    rest: Array


_UNCOUPLED_SHARE = 1e-15
"""Relative part of the static flexibility up to which a mode counts as uncoupled from the elements (rounding)."""

_REAL_POLE_TOLERANCE = 1e-13
"""Imaginary part, relative to the largest pole, up to which a pole counts as real (rounding)."""

_BLOCK_COUPLING_TOLERANCE = 1e-11
"""Relative part of the flexibility up to which two ports count as uncoupled (rounding)."""

_MOMENT_SYMMETRY_TOLERANCE = 1e-10
"""Relative asymmetry or negative eigenvalue of the moments g_j up to which they count as rounding."""


def modal_blocks(
    poles: ComplexArray,
    output: ComplexArray,
    input_: ComplexArray,
    groups: np.ndarray,
    reach: float = np.inf,
    lumped: bool = False,
) -> ModalBlocks:
    """Return the blocks of modes from all poles (r,), output (m, r) and input (r, m).

    Modes above the frequency ``reach`` are replaced by their residual flexibility or, with ``lumped`` and if possible,
    by one mode per element.
    """
    T, fast = _mean_and_differences(groups), np.abs(poles) > reach
    idle, rest = poles[fast], np.zeros((len(output), len(output)))
    if fast.any():
        far = poles[fast], output[:, fast], input_[fast]
        rest = -((far[1] / far[0]) @ far[2]).real
        lumps = _lumped(*far, np.eye(len(output)) if T is None else T) if lumped else None
        near = poles[~fast], output[:, ~fast], input_[~fast]
        poles, output, input_ = near
        if lumps is not None:
            rest = np.zeros_like(rest)
            poles, output, input_ = _concatenated([near, lumps])
    residues = output.T[:, :, None] * input_[:, None, :]  # (r, m, m)
    share = np.abs(residues) / np.abs(poles)[:, None, None]
    largest = share.sum(axis=0).max(initial=0.0)
    still = share.max(axis=(1, 2), initial=0.0) <= _UNCOUPLED_SHARE * largest
    taking = np.flatnonzero(~still)
    everything = _block_of(poles, output, input_, taking, np.arange(len(output)), rest)
    split: tuple[ModalBlock, ...] = (everything,)
    if T is not None:
        turned = T.T @ output, input_ @ T
        joined = (
            np.abs(turned[0].T[taking, :, None] * turned[1][taking, None, :]) / np.abs(poles[taking])[:, None, None]
        )
        stiff = T.T @ rest @ T
        block = _blocks(joined.max(axis=0) + np.abs(stiff) > _BLOCK_COUPLING_TOLERANCE * largest)
        owner = block[np.argmax(np.einsum("rii->ri", joined), axis=1)]
        split = tuple(
            _block_of(poles, turned[0][block == b], turned[1][:, block == b], taking[owner == b],
                  groups[block == b], stiff[np.ix_(block == b, block == b)]) for b in range(block.max(initial=-1) + 1)
        )  # fmt: skip
        if sum(part.size for part in split) != everything.size or len(split) == 1:
            split = (everything,)
    mobility = mobility_of(poles[taking], output[:, taking], input_[taking])
    idle = np.concatenate([poles[still], idle])
    idle = idle[np.argsort(-idle.real, kind="stable")]
    return ModalBlocks(everything, split, idle, groups, mobility, everything.size + len(idle), rest)


def flexibilities(poles: ComplexArray, output: ComplexArray, input_: ComplexArray) -> tuple[Array, Array]:
    """Return the frequencies (r,) of the modes, ascending, and the residual flexibilities (r + 1, m) of the elements.

    Row i is the flexibility of all modes except the first i.
    """
    size = np.abs(poles)
    order = np.argsort(size, kind="stable")
    each = -(output / poles * input_.T).real[:, order]
    residual = np.zeros((len(poles) + 1, len(output)))
    residual[:-1] = np.cumsum(each.T[::-1], axis=0)[::-1]
    return size[order], residual


def _blocks(joined: np.ndarray) -> np.ndarray:
    """Return the block number of each of m ports, from whether two of them are coupled (m, m)."""
    if joined.all():
        return np.zeros(len(joined), dtype=int)
    blocks: np.ndarray = scipy.sparse.csgraph.connected_components(joined)[1]
    return blocks


def _lumped(
    poles: ComplexArray, output: ComplexArray, input_: ComplexArray, T: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
    """Return one lumped mode per element that replaces many modes (poles, output, input); None if not possible.

    Ports that the modes leave uncoupled in the orthogonal coordinates T (m, m) stay uncoupled.
    """
    powers = -1.0 / poles ** np.array([[1], [2], [3]])
    g = (((T.T @ output) * powers[:, None]) @ (input_ @ T)).real
    block = _blocks(np.abs(g[0]) > _BLOCK_COUPLING_TOLERANCE * np.abs(g[0]).max(initial=0.0))
    found = []
    for b in range(block.max(initial=-1) + 1):
        ports = np.flatnonzero(block == b)
        one = _lumped_block(g[:, ports[:, None], ports], float(np.abs(poles).max()))
        if one is None:
            return None
        found.append((one[0], T[:, ports] @ one[1], one[2] @ T[:, ports].T))
    return _concatenated(found)


def _concatenated(
    found: list[tuple[ComplexArray, ComplexArray, ComplexArray]],
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Concatenate poles, output and input of several sets of modes."""
    poles, output, input_ = zip(*found, strict=True)
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
    some = s > _MOMENT_SYMMETRY_TOLERANCE * s[-1]
    if not s[-1] > 0 or s[0] < -_MOMENT_SYMMETRY_TOLERANCE * s[-1]:
        return None
    V = Q[:, some] / np.sqrt(s[some])  # V^T g_0 V = 1
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
    mobility: Array = np.abs((output * poles * input_.T).sum(axis=1))
    return mobility


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


def _block_of(
    poles: ComplexArray, output: ComplexArray, input_: ComplexArray, some: np.ndarray, ports: np.ndarray, rest: Array
) -> ModalBlock:
    """Return the block of the modes with indices ``some``, at these ports, and with the residual flexibility."""
    taking = np.zeros(len(poles), dtype=bool)
    taking[some] = True
    pairs, alone = (half[taking[half]] for half in halves(poles))
    kept = np.concatenate([pairs, alone])
    lam, out, push = (np.array(x, dtype=complex) for x in (poles[kept], output[:, kept], input_[kept]))
    k = len(pairs)
    out[:, :k] *= 2.0
    for x in (lam[k:], out[:, k:], push[k:]):
        x.imag = 0.0
    modes = SymmetricPair(
        lam, np.ascontiguousarray(out), np.ascontiguousarray(push), np.asarray(ports, dtype=np.int64),
        np.ascontiguousarray(rest),
    )  # fmt: skip
    return ModalBlock(modes, 2 * k + len(alone))
