"""Scalar elements, loads and reactions of a structure.

    force of an element on the structure  -w [p(d, d', tau) + c d'],   d = w^T q - e(tau)
    load  F = Omega^power (F_0 + sum_l F_cl cos(l tau) + F_sl sin(l tau))

See `hbgear.mechanics.models` for the equations of motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import NamedFields, check
from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, Range, checked, counted
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.vector_laws import Component, VectorLaw
from hbgear.mechanics.series.fourier import MOST_HARMONICS, Series, real_numbers
from hbgear.mechanics.series.periodic import Periodic, Phased


@dataclass(frozen=True)
class Element(NamedFields):  # numpydoc ignore=PR02
    """Scalar element: direction, law, damper, prescribed displacement.

        d = direction^T q - displacement(tau),   force on the structure  -direction [law(d, d', tau) + damping d']

    Parameters
    ----------
    direction : array_like, shape (n,)
        Direction w in the coordinates.
    law : Law
        Force law.
    displacement : Series or Periodic, optional
        Prescribed displacement e(tau), which must be continuous. Default: zero.
    damping : float, optional
        Viscous coefficient c of the damper in parallel with the law, >= 0. Default 0.
    name : str, optional
        Name in tables and legends. Default: ``element 1``, ``element 2``, ...

    Raises
    ------
    ValueError
        If the direction is zero or not finite, damping is negative, or the displacement jumps.
    TypeError
        If the law is not a `Law`.

    Examples
    --------
    >>> import hbgear as hb
    >>> stop = hb.Element(direction=[1, 0], law=hb.Unilateral(k=1.0, gap=1.0), name="stop")
    >>> stop.name, stop.law.breakpoints
    ('stop', (1.0,))
    """

    direction: ArrayLike
    law: Law
    displacement: Phased = field(default_factory=Series)
    damping: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        check("Element", "name", self.name, str)
        owner = f"element '{self.name}'" if self.name else "Element"
        w = real_numbers(f"{owner}: direction", self.direction, "a vector of numbers")
        if w.ndim != 1 or not np.all(np.isfinite(w)) or not np.any(w):
            raise ValueError(f"{owner}: direction must be a finite non-zero vector, got {w}")
        if not isinstance(self.law, Law):
            raise TypeError(
                f"{owner}: law must be a hbgear Law, got {quoted(self.law)}; your own force is a class derived from "
                "hb.mechanics.Law, or an hb.mechanics.CompiledLaw"
            )
        if isinstance(self.law, VectorLaw):
            raise TypeError(
                f"{owner}: {type(self.law).__name__} has {self.law.size} displacements: use VectorElement(directions, "
                "law)"
            )
        if not isinstance(self.displacement, Phased):
            raise ValueError(f"{owner}: displacement = {self.displacement!r} must be a Series or a Periodic")
        if isinstance(self.displacement, Periodic) and not self.displacement.continuous:
            raise ValueError(
                f"{owner}: the displacement jumps at tau = {self.displacement.corners[0]:.4g} or at another "
                "breakpoint, where the force of the damper would be infinite; give it a steep ramp, by "
                "Periodic.trapezoidal or Periodic.table"
            )
        checked(owner, "damping", self.damping, NOT_NEGATIVE)
        w.flags.writeable = False
        object.__setattr__(self, "direction", w)


def VectorElement(
    directions: ArrayLike, law: VectorLaw, damping: float = 0.0, name: str = "", displacements: Sequence[Phased] = ()
) -> tuple[Element, ...]:
    """Return the elements of a law of several displacements, one for each direction.

        d = directions q - displacements(tau),   force on the structure  -directions^T [law(d, d', tau) + damping d']

    Parameters
    ----------
    directions : array_like, shape (p, n)
        Directions in the coordinates, in the order of the displacements of the law.
    law : VectorLaw
        Law with p displacements.
    damping : float, optional
        Viscous coefficient of a damper in each direction, >= 0. Default 0.
    name : str, optional
        Name; the elements are ``name 1``, ``name 2``, ...
    displacements : sequence of Series, optional
        Prescribed displacement in each direction. Default: zero.

    Returns
    -------
    tuple of Element
        The p elements, for ``elements=[..., *VectorElement(directions, law)]``.

    Raises
    ------
    TypeError
        If the law is not a `VectorLaw`.
    ValueError
        If the number of directions or displacements is not that of the law.

    Examples
    --------
    >>> import hbgear as hb
    >>> hole = hb.mechanics.RadialClearance(k=4.0, clearance=1.0)
    >>> rotor = hb.System(
    ...     [[1.0, 0.0], [0.0, 1.0]], [[0.1, 0.0], [0.0, 0.1]], [[1.0, 0.0], [0.0, 1.0]],
    ...     [*hb.mechanics.VectorElement([[1.0, 0.0], [0.0, 1.0]], hole, name="seal")],
    ...     hb.Load(cosine={1: [0.3, 0.0]}, sine={1: [0.0, 0.3]}, power=2))
    >>> [element.name for element in rotor.elements]
    ['seal 1', 'seal 2']
    """
    if not isinstance(law, VectorLaw):
        raise TypeError(f"VectorElement '{name}': law = {quoted(law)} must be a VectorLaw, such as RadialClearance")
    rows = real_numbers(
        f"VectorElement '{name}': directions", directions, "one vector of numbers for each displacement"
    )
    p = law.size
    if rows.ndim != 2 or len(rows) != p:
        raise ValueError(
            f"VectorElement '{name}': directions have the shape {rows.shape}; {type(law).__name__} needs {p} rows, one "
            "for each displacement"
        )
    offsets = tuple(displacements) or (Series(),) * p
    if len(offsets) != p:
        raise ValueError(f"VectorElement '{name}': {len(offsets)} displacements for {p} directions; give one for each")
    names = [f"{name} {i + 1}" if name else "" for i in range(p)]
    return tuple(Element(rows[i], Component(law, i), offsets[i], damping, names[i]) for i in range(p))


@dataclass(frozen=True)
class Load(NamedFields):  # numpydoc ignore=PR02
    """Periodic load on the coordinates.

        F(tau) = Omega^power (constant + sum_l cosine[l] cos(l tau) + sine[l] sin(l tau))

    Parameters
    ----------
    constant : array_like, shape (n,), optional
        Constant part. Default: zero.
    cosine, sine : dict, optional
        Amplitudes ``{l: (n,)}`` by harmonic number, l >= 1. Default: none.
    power : int, optional
        Exponent of Omega; 2 for an unbalance. Default 0.

    Raises
    ------
    ValueError
        If a harmonic number is not a positive integer or a vector is not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> torque = hb.Load(constant=[1.0, 0.0], cosine={1: [0.2, 0.0]})
    >>> unbalance = hb.Load(cosine={1: [1.0, 0.0]}, power=2)
    >>> unbalance.power
    2
    """

    constant: ArrayLike | None = None
    cosine: Mapping[int, ArrayLike] = field(default_factory=dict)
    sine: Mapping[int, ArrayLike] = field(default_factory=dict)
    power: int = 0

    def __post_init__(self) -> None:
        check("Load", "power", self.power, int)
        checked("Load", "power", self.power, Range(-20, 20))
        if self.constant is not None:
            object.__setattr__(self, "constant", real_numbers("Load: constant", self.constant, "a vector of numbers"))
        for name in ("cosine", "sine"):
            table = {}
            if not isinstance(getattr(self, name), Mapping):
                raise ValueError(f"Load.{name} = {getattr(self, name)!r} must be a dictionary {{harmonic: vector}}")
            for order, vector in getattr(self, name).items():
                if not isinstance(order, int | np.integer) or order < 1:
                    raise ValueError(f"Load.{name}: harmonic number {order!r} must be a positive integer")
                counted(f"Load.{name}: harmonic number", int(order), MOST_HARMONICS)
                table[int(order)] = real_numbers(f"Load.{name}[{order}]", vector, "a vector of numbers")
            object.__setattr__(self, name, table)
        for vector in self.vectors():
            if vector.ndim != 1 or not np.all(np.isfinite(vector)):
                raise ValueError(f"Load: every vector must be one-dimensional and finite, got {vector}")

    def vectors(self) -> list[Array]:
        """Return all load vectors."""
        first = [] if self.constant is None else [np.asarray(self.constant)]
        return first + [np.asarray(v) for v in [*self.cosine.values(), *self.sine.values()]]

    @property
    def order(self) -> int:
        """Highest harmonic number of the load."""
        return max([0, *self.cosine, *self.sine])

    def complex(self, n: int) -> dict[int, np.ndarray]:
        """Return the one-sided complex amplitudes ``{l: (n,)}`` without the factor Omega^power.

        Parameters
        ----------
        n : int
            Number of coordinates.

        Returns
        -------
        dict
            Amplitudes by harmonic number.
        """
        out: dict[int, np.ndarray] = {}
        if self.constant is not None:
            out[0] = np.asarray(self.constant, dtype=complex)
        for table, factor in ((self.cosine, 1.0), (self.sine, -1j)):
            for order, vector in table.items():
                out[order] = out.get(order, np.zeros(n, dtype=complex)) + factor * np.asarray(vector)
        return out


@dataclass(frozen=True, eq=False)
class Reaction(NamedFields):  # numpydoc ignore=PR02
    """Force of a linear support on the structure, in one direction or in several directions with one resultant.

        F = stiffness q + damping q'

    Parameters
    ----------
    stiffness, damping : array_like, shape (r, n)
        One row per direction, acting on the coordinates of the system and in its units.

    Raises
    ------
    ValueError
        If they are not finite matrices of the same shape.

    Examples
    --------
    >>> import hbgear as hb
    >>> spring = hb.mechanics.Reaction(stiffness=[[1.0, 0.0]], damping=[[0.1, 0.0]])
    >>> spring.stiffness.shape
    (1, 2)
    """

    stiffness: Any
    damping: Any

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping"):
            rows = real_numbers(f"Reaction: {name}", getattr(self, name), "a row of numbers for each direction")
            if rows.ndim != 2 or not rows.size or not np.isfinite(rows).all():
                raise ValueError(f"Reaction: {name} must be a finite matrix (directions, coordinates)")
            object.__setattr__(self, name, rows)
        if self.stiffness.shape != self.damping.shape:
            raise ValueError(
                f"Reaction: stiffness {self.stiffness.shape} and damping {self.damping.shape} must have the same shape"
            )
