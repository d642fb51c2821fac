"""The modes of a structure as stability needs them: one of each conjugate pair, in parts that do not mix.

    z' = poles z - input u,   d = output z        u (m,) forces of the elements beyond their reference springs

A mode with output_j input_j = 0 for all elements takes no part. Of a large structure modes far above the frequencies of
a motion only give way, d = ... - rest u with their static flexibility: what they do beyond that goes with the square of
the ratio of the frequencies. With an orthogonal T that puts the sum and the differences of alike elements in the place
of their motions, T^T output and input T may fall into blocks: then modulations that are equal for alike elements keep
the blocks apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray


class HalfModes(NamedTuple):
    """Modes for kernels: one of each conjugate pair, the pairs before the real modes.

    poles (q,); output (g, q), doubled for pairs, and input (q, g) of g ports; ports (g,): the element whose slope
    each feels; rest (g, g): flexibility beside the modes.
    """

    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray
    ports: np.ndarray
    rest: Array


class Part(NamedTuple):
    """Modes that are carried together; size: number of real coordinates, twice that of the pairs and the real ones."""

    modes: HalfModes
    size: int


@dataclass(frozen=True)
class Parts:
    """All modes of a structure.

    whole : every mode that takes part; split : the same in parts that do not mix while alike elements move alike.
    idle : poles of the others, both of each pair, those that only give way among them. groups (m,) : first element that
    each is like. mobility (m,) : inverse modal masses of the elements. size : number of multipliers.
    """

    whole: Part
    split: tuple[Part, ...]
    idle: ComplexArray
    groups: np.ndarray
    mobility: Array
    size: int


_IDLE = 1e-15  # share in the static flexibility between the elements that is rounding


_REAL = 1e-13  # imaginary part, over the largest pole, that is rounding


_MIXED = 1e-11  # the same, of what would join two blocks


def parts_of(
    poles: ComplexArray, output: ComplexArray, input_: ComplexArray, groups: np.ndarray, reach: float = np.inf
) -> Parts:
    """From all poles (r,), output (m, r) and input (r, m); modes of frequencies above reach only give way."""
    residues = output.T[:, :, None] * input_[:, None, :]  # (r, m, m)
    share = np.abs(residues) / np.abs(poles)[:, None, None]
    largest = share.sum(axis=0).max(initial=0.0)
    fast = np.abs(poles) > reach
    idle = fast | (share.max(axis=(1, 2), initial=0.0) <= _IDLE * largest)
    rest = -(residues[fast] / poles[fast, None, None]).real.sum(axis=0)
    taking = np.flatnonzero(~idle)
    everything = _part(poles, output, input_, taking, np.arange(len(output)), rest)
    split: tuple[Part, ...] = (everything,)
    T = _sums_and_differences(groups)
    if T is not None:
        turned = T.T @ output, input_ @ T
        joined = (
            np.abs(turned[0].T[taking, :, None] * turned[1][taking, None, :]) / np.abs(poles[taking])[:, None, None]
        )
        stiff = T.T @ rest @ T
        count, block = scipy.sparse.csgraph.connected_components(joined.max(axis=0) + np.abs(stiff) > _MIXED * largest)
        owner = block[np.argmax(np.einsum("rii->ri", joined), axis=1)]
        split = tuple(
            _part(poles, turned[0][block == b], turned[1][:, block == b], taking[owner == b],
                  groups[block == b], stiff[np.ix_(block == b, block == b)]) for b in range(count)
        )  # fmt: skip
        if sum(part.size for part in split) != everything.size or len(split) == 1:
            split = (everything,)
    return Parts(everything, split, poles[idle], groups, mobility_of(poles, output, input_), len(poles))


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
) -> Part:
    """The modes number ``some``, seen through ports, and the flexibility beside them."""
    pairs, alone = (half[np.isin(half, some)] for half in halves(poles))
    kept = np.concatenate([pairs, alone])
    lam, out, push = (np.array(x, dtype=complex) for x in (poles[kept], output[:, kept], input_[kept]))
    k = len(pairs)
    out[:, :k] *= 2.0
    for x in (lam[k:], out[:, k:], push[k:]):
        x.imag = 0.0
    modes = HalfModes(
        lam, np.ascontiguousarray(out), np.ascontiguousarray(push), np.asarray(ports, dtype=np.int64),
        np.ascontiguousarray(rest),
    )  # fmt: skip
    return Part(modes, 2 * k + len(alone))
