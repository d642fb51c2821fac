"""A model at one set of parameters as a table of numbers, the form in which kernels take it.

Every law that is known here is, for each element, a sum of piecewise-linear springs with periodic stiffness and a
cubic spring,

    p(d, tau) = sum_s k_s(tau) (g0_s + s0_s d + sum_i D_si max(d - x_i, 0)) + k1 d + k3 d^3

Of a compiled law of the user there is its address; others (a user's in Python, or those that shall be sampled) leave
nothing but their corners in the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.breakpoints import Corners
from hbgear.mechanics.laws.compiled_law import CompiledLaw
from hbgear.mechanics.laws.laws import Law, PiecewiseLinear, springs_of
from hbgear.mechanics.series.fourier import Series, stretch, to_complex
from hbgear.mechanics.series.periodic import Phased


class PackedLaws(NamedTuple):
    """Laws of m elements.

    level, owner (K,) : the corners x of all laws, element after element, and the element each belongs to.
    ramped (K,) : whether a spring of the table turns there.
    of (S,), base (S, 2), series (S, L) : of each spring its element, s0 and g0, and the two-sided coefficients of its
        stiffness at the basis harmonics shifts (L,), of which the first is 0; of one with corners 1, see `corners`.
    at, part (R,), change (R,) : of each change of slope its corner, its spring and D.
    cubic (m, 2) : k1 and k3.
    """

    level: Array
    owner: np.ndarray
    ramped: np.ndarray
    of: np.ndarray
    base: Array
    shifts: np.ndarray
    series: ComplexArray
    at: np.ndarray
    part: np.ndarray
    change: Array
    cubic: Array


class Own(NamedTuple):
    """Compiled laws of the user.

    element, address (Q,), given (Q, G) : of each its element, its code and its parameters.
    """

    element: np.ndarray
    address: np.ndarray
    given: Array


class PackedLinearPart(NamedTuple):
    """The linear part: poles (2, r) of the structure, real and imaginary parts, and residues (m m + L m, 2, r).

    These are of the receptance G, and behind it of what L loads do to the elements. springs (2, m) : reference
    stiffness and damping of elements. orders (K + 1,) : basis harmonics that are unknowns, 0..H unless only some are;
    left (L,) : those up to 2H that are none. moved (K + 1, m) : harmonics of the prescribed displacements. loads (L, 2)
    : power of Omega and place among the orders of each load. nu : subharmonic order.
    """

    poles: Array
    residues: Array
    springs: Array
    orders: np.ndarray
    left: np.ndarray
    moved: ComplexArray
    loads: np.ndarray
    nu: int


class PackedModel(NamedTuple):
    """A model for kernels: its laws, its linear part, the basis (2H + 1, N) on the grid of N samples, its corners.

    corners, own : None of a model that has none. Kernels are then compiled without the code for them, in two thirds of
    the time.
    """

    laws: PackedLaws
    linear: PackedLinearPart
    basis: Array
    corners: Corners | None
    own: Own | None


Springs = list[tuple[int, PiecewiseLinear]]
"""Springs of laws, each with the number of its element."""


def pack_laws(laws: Sequence[Law], sampled: bool, nu: int) -> tuple[PackedLaws, Springs, np.ndarray]:
    """The table of laws, the springs in it, and the numbers of the elements whose laws it does not hold."""
    known = [None if sampled else springs_of(law) for law in laws]
    springs = [(j, spring) for j, parts in enumerate(known) if parts for spring in parts[0]]
    rows = [_two_sided(_series_of(spring.stiffness), nu) for _, spring in springs]
    shifts = sorted({0} | {k for row in rows for k in np.flatnonzero(row).tolist()})
    series = np.zeros((len(springs), len(shifts)), dtype=complex)
    for own, row in zip(series, rows, strict=True):
        own[:] = [row[k] if k < len(row) else 0.0 for k in shifts]
    level = np.concatenate([np.empty(0), *(law.breakpoints for law in laws)])
    owner = np.repeat(np.arange(len(laws)), [len(law.breakpoints) for law in laws])
    place = {(int(j), float(x)): i for i, (j, x) in enumerate(zip(owner, level, strict=True))}
    base, ramps = np.zeros((len(springs), 2)), []
    for s, (j, spring) in enumerate(springs):
        g0, changes, corners = spring.ramps
        base[s] = spring.slopes[0], g0
        ramps += [(place[j, float(x)], s, float(D)) for x, D in zip(corners, changes, strict=True)]
    at, part, change = (np.array(column) for column in zip(*ramps, strict=True)) if ramps else ([], [], [])
    at = np.asarray(at, dtype=np.int64)
    ramped = np.zeros(len(level), dtype=bool)
    ramped[at] = True
    cubic = np.array([parts[1:] if parts else (0.0, 0.0) for parts in known], dtype=float).reshape(len(laws), 2)
    table = PackedLaws(
        level, owner.astype(np.int64), ramped,
        np.array([j for j, _ in springs], dtype=np.int64), base, np.array(shifts, dtype=np.int64), series,
        at, np.asarray(part, dtype=np.int64), np.asarray(change, dtype=float), cubic,
    )  # fmt: skip
    unknown = [parts is None and type(law) is not CompiledLaw for parts, law in zip(known, laws, strict=True)]
    return table, springs, np.flatnonzero(unknown)


def own_of(laws: Sequence[Law]) -> Own | None:
    """The compiled laws of a model, None if there are none."""
    own = [(j, law) for j, law in enumerate(laws) if isinstance(law, CompiledLaw)]
    if not own:
        return None
    given = np.zeros((len(own), 1 + max([0, *(len(law.parameters) for _, law in own)])))
    for row, (_, law) in zip(given, own, strict=True):
        row[: len(law.parameters)] = law.parameters
    return Own(
        np.array([j for j, _ in own], dtype=np.int64),
        np.array([law.address for _, law in own], dtype=np.int64),
        given,
    )


def in_two(z: ComplexArray) -> Array:
    """Real and imaginary parts (..., 2, r) of (..., r)."""
    out = np.empty((*z.shape[:-1], 2, z.shape[-1]))
    out[..., 0, :], out[..., 1, :] = z.real, z.imag
    return out


def _series_of(stiffness: Phased) -> Array:
    """The row of a Fourier series; 1 of what has corners, which stands in another table."""
    return stiffness.row() if isinstance(stiffness, Series) else np.ones(1)


def _two_sided(row: Array, nu: int) -> ComplexArray:
    c = to_complex(stretch(row, nu))
    c[1:] *= 0.5
    return c
