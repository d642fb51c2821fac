"""The modes of a structure as stability needs them: one of each conjugate pair, in parts that do not mix.

    z' = poles z - input u,   d = output z        u (m,) forces of the elements beyond their reference springs

A mode with output_j input_j = 0 for all elements takes no part. Of a large structure modes far above the frequencies
of a motion only give way, d = ... - rest u with their static flexibility: what they do beyond that goes with the square
of the ratio of the frequencies. Where the elements are stiff beside them, three terms of the power series that they are
to the elements are kept instead by one mode for each element,

    sum_r output_r input_r / (s - poles_r) = g_0 + g_1 s + g_2 s^2 + ...,   g_j = -sum_r output_r poles_r^-(j+1) input_r
    = g_0 (g_0 - g_1 s + (g_1 g_0^-1 g_1 - g_2) s^2)^-1 g_0 + ...           flexibility, damping and inertia

which leaves an error of the fourth power of that ratio where damping is small, if these matrices are those of a
structure (symmetric and positive, as those of a symmetric one are).

With an orthogonal T that puts the sum and the differences of alike elements in the place of their motions, T^T output
and input T may fall into blocks: then modulations that are equal for alike elements keep the blocks apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray


class SymmetricPair(NamedTuple):
    """Modes for kernels: one of each conjugate pair, the pairs before the real modes.

    poles (q,); output (g, q), doubled for pairs, and input (q, g) of g ports; ports (g,): the element whose slope
    each feels; rest (g, g): flexibility beside the modes.
    """

    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray
    ports: np.ndarray
    rest: Array


class ModalBlock(NamedTuple):
    """Modes that are carried together; size: number of real coordinates, twice that of the pairs and the real ones."""

    modes: SymmetricPair
    size: int


@dataclass(frozen=True)
class ModalBlocks:
    """All modes of a structure.

    whole : every mode that takes part; split : the same in parts that do not mix while alike elements move alike.
    idle : poles of the others, both of each pair, those above the reach among them; the least damped first. groups
    (m,) : first element that each is like. mobility (m,) : inverse modal masses of the elements, of the modes that take
    part. size : number of multipliers. rest (m, m) : flexibility beside the modes.
    """

    whole: ModalBlock
    split: tuple[ModalBlock, ...]
    idle: ComplexArray
    groups: np.ndarray
    mobility: Array
    size: int
    rest: Array


_IDLE = 1e-15  # share in the static flexibility between the elements that is rounding


_REAL = 1e-13  # imaginary part, over the largest pole, that is rounding


_MIXED = 1e-11  # the same, of what would join two blocks


_UNLIKE = 1e-10  # parts of matrices that are unlike those of a structure, relative, and rounding


def parts_of(
    poles: ComplexArray,
    output: ComplexArray,
    input_: ComplexArray,
    groups: np.ndarray,
    reach: float = np.inf,
    lumped: bool = False,
) -> ModalBlocks:
    """From all poles (r,), output (m, r) and input (r, m); modes of frequencies above reach only give way.

    lumped : with one mode for each element in their place, if they have such modes.
    """
    T, fast = _sums_and_differences(groups), np.abs(poles) > reach
    idle, rest = poles[fast], np.zeros((len(output), len(output)))
    if fast.any():
        far = poles[fast], output[:, fast], input_[fast]
        rest = -((far[1] / far[0]) @ far[2]).real
        lumps = _lumped(*far, np.eye(len(output)) if T is None else T) if lumped else None
        near = poles[~fast], output[:, ~fast], input_[~fast]
        poles, output, input_ = near
        if lumps is not None:
            rest = np.zeros_like(rest)
            poles, output, input_ = _together([near, lumps])
    residues = output.T[:, :, None] * input_[:, None, :]  # (r, m, m)
    share = np.abs(residues) / np.abs(poles)[:, None, None]
    largest = share.sum(axis=0).max(initial=0.0)
    still = share.max(axis=(1, 2), initial=0.0) <= _IDLE * largest
    taking = np.flatnonzero(~still)
    everything = _part(poles, output, input_, taking, np.arange(len(output)), rest)
    split: tuple[ModalBlock, ...] = (everything,)
    if T is not None:
        turned = T.T @ output, input_ @ T
        joined = (
            np.abs(turned[0].T[taking, :, None] * turned[1][taking, None, :]) / np.abs(poles[taking])[:, None, None]
        )
        stiff = T.T @ rest @ T
        block = _blocks(joined.max(axis=0) + np.abs(stiff) > _MIXED * largest)
        owner = block[np.argmax(np.einsum("rii->ri", joined), axis=1)]
        split = tuple(
            _part(poles, turned[0][block == b], turned[1][:, block == b], taking[owner == b],
                  groups[block == b], stiff[np.ix_(block == b, block == b)]) for b in range(block.max(initial=-1) + 1)
        )  # fmt: skip
        if sum(part.size for part in split) != everything.size or len(split) == 1:
            split = (everything,)
    mobility = mobility_of(poles[taking], output[:, taking], input_[taking])
    idle = np.concatenate([poles[still], idle])
    idle = idle[np.argsort(-idle.real, kind="stable")]
    return ModalBlocks(everything, split, idle, groups, mobility, everything.size + len(idle), rest)


def flexibilities(poles: ComplexArray, output: ComplexArray, input_: ComplexArray) -> tuple[Array, Array]:
    """Frequencies (r,) of the modes, ascending, and the flexibility (r + 1, m) of each element beside the first few."""
    size = np.abs(poles)
    order = np.argsort(size, kind="stable")
    each = -(output / poles * input_.T).real[:, order]
    beside = np.zeros((len(poles) + 1, len(output)))
    beside[:-1] = np.cumsum(each.T[::-1], axis=0)[::-1]
    return size[order], beside


def _blocks(joined: np.ndarray) -> np.ndarray:
    """Number of the block that each of m ports belongs to, from whether two of them are joined (m, m)."""
    if joined.all():
        return np.zeros(len(joined), dtype=int)
    blocks: np.ndarray = scipy.sparse.csgraph.connected_components(joined)[1]
    return blocks


def _lumped(
    poles: ComplexArray, output: ComplexArray, input_: ComplexArray, T: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
    """One mode for each element in the place of many (poles, output, input); None if there are no such modes.

    T (m, m) orthogonal: ports that the modes do not join in these coordinates are not joined by those either.
    """
    powers = -1.0 / poles ** np.array([[1], [2], [3]])
    g = (((T.T @ output) * powers[:, None]) @ (input_ @ T)).real
    block = _blocks(np.abs(g[0]) > _MIXED * np.abs(g[0]).max(initial=0.0))
    found = []
    for b in range(block.max(initial=-1) + 1):
        ports = np.flatnonzero(block == b)
        one = _lump(g[:, ports[:, None], ports], float(np.abs(poles).max()))
        if one is None:
            return None
        found.append((one[0], T[:, ports] @ one[1], one[2] @ T[:, ports].T))
    return _together(found)


def _together(
    found: list[tuple[ComplexArray, ComplexArray, ComplexArray]],
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Poles, output and input of all of several sets of modes."""
    poles, output, input_ = zip(*found, strict=True)
    return np.concatenate(poles), np.concatenate(output, axis=1), np.concatenate(input_)


def _lump(g: Array, highest: float) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
    """Modes of the structure with the flexibility g_0 + g_1 s + g_2 s^2; None if that is none of a structure.

    highest : frequency of the modes they stand for, of which theirs are means.
    """
    if np.any(np.abs(g - g.transpose(0, 2, 1)).max(axis=(1, 2)) > _UNLIKE * np.abs(g).max(axis=(1, 2))):
        return None
    s, Q = np.linalg.eigh(g[0])
    some = s > _UNLIKE * s[-1]
    if not s[-1] > 0 or s[0] < -_UNLIKE * s[-1]:
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
    if digits * size.max() > _UNLIKE * size.min() or size.max() > 2 * highest or np.any(poles.real > digits * size):
        return None
    ports = g[0] @ V
    return poles.astype(complex), ports @ right[:q], inverse[:, q:] @ Mi @ ports.T


def mobility_of(poles: ComplexArray, output: ComplexArray, input_: ComplexArray) -> Array:
    """Inverse modal masses (m,) of the elements: what a unit force does to the speed of its own gap at once."""
    mobility: Array = np.abs((output * poles * input_.T).sum(axis=1))
    return mobility


def halves(poles: ComplexArray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of one pole of each conjugate pair, and of the real poles."""
    real = np.abs(poles.imag) <= _REAL * np.abs(poles).max(initial=0.0)
    return np.flatnonzero(~real & (poles.imag > 0)), np.flatnonzero(real)


def _sums_and_differences(groups: np.ndarray) -> Array | None:
    """Orthogonal T (m, m): in each group of alike elements the mean, then differences; None if none are alike."""
    m = len(groups)
    if len(np.unique(groups)) == m:
        return None
    T = np.zeros((m, m))
    for first in np.unique(groups):
        members = np.flatnonzero(groups == first)
        T[np.ix_(members, members)] = scipy.linalg.helmert(len(members), full=True).T
    return T


def _part(
    poles: ComplexArray, output: ComplexArray, input_: ComplexArray, some: np.ndarray, ports: np.ndarray, rest: Array
) -> ModalBlock:
    """The modes number ``some``, seen through ports, and the flexibility beside them."""
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
