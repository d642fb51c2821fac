"""Force laws of several displacements, p(d, v, tau) with d in R^p.

`hbgear.mechanics.VectorElement` gives such a law p directions. Each of them becomes one element, whose law is a
`Component` of the vector law. The forces are evaluated by AFT (alternating frequency/time).

Notes
-----
Contract: ``force(d, v, tau)`` takes arrays (p, N), (p, N), (N,) and returns the forces (p, N) and their derivatives
dp/dd and dp/dv (p, p, N), the first axis of which is the force. ``size`` is p. Forces must be continuous; ``edges``
returns functions that change sign where a derivative jumps.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, checked
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.laws import Forces, Law
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.series.periodic import Periodic


class VectorLaw(Law):
    """Force law of several displacements; see the contract in the header of the module.

    Examples
    --------
    >>> import hbgear as hb
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> @dataclass(frozen=True)
    ... class Pendulum(hb.mechanics.VectorLaw):
    ...     "A spring of length 1 that is stretched in two directions."
    ...     size = 2
    ...
    ...     def force(self, d, v, tau):
    ...         x, y = d
    ...         p = np.array([x * y, 0.5 * x**2])
    ...         return p, np.array([[y, x], [x, 0 * x]]), np.zeros((2, 2, len(x)))
    >>> both = hb.mechanics.VectorElement([[1.0, 0.0], [0.0, 1.0]], Pendulum())
    >>> len(both)
    2
    """

    @property
    @abstractmethod
    def size(self) -> int:
        """Number p of displacements."""

    @property
    def rated(self) -> bool:
        return True

    def edges(self, d: Array) -> Array:
        """Return functions (E, N) of displacements d (p, N) that change sign where a derivative jumps; none here."""
        return np.zeros((0, d.shape[1]))

    @property
    def grazes(self) -> bool:
        """Whether its edges are events of a curve; False if another element has the same edges."""
        return True

    @property
    def has_edges(self) -> bool:
        """Whether a derivative of the force jumps anywhere."""
        return bool(len(self.edges(np.zeros((self.size, 1)))))


@dataclass(frozen=True)
class Component(Law):  # numpydoc ignore=PR02
    """One direction of a vector law.

    Parameters
    ----------
    law : VectorLaw
        The law.
    index : int
        Number of the direction.

    Examples
    --------
    >>> import hbgear as hb
    >>> x, y = hb.mechanics.VectorElement([[1.0, 0.0], [0.0, 1.0]], hb.mechanics.RadialClearance(1.0, 0.1))
    >>> y.law.index
    1
    """

    law: VectorLaw
    index: int

    def __post_init__(self) -> None:
        if not isinstance(self.law, VectorLaw):
            raise TypeError(
                f"Component: law = {quoted(self.law)} must be a VectorLaw, such as RadialClearance(1.0, 0.1)"
            )

    @property
    def reference(self) -> float:
        return self.law.reference

    @property
    def rated(self) -> bool:
        return self.law.rated

    @property
    def steady(self) -> bool:
        return self.law.steady

    @property
    def phases(self) -> tuple[float, ...]:
        return self.law.phases

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """Return the force in the direction where all other displacements are zero."""
        d = np.asarray(d, dtype=float)
        state = np.zeros((2, self.law.size, d.size))
        state[0, self.index], state[1, self.index] = d.ravel(), np.broadcast_to(v, d.shape).ravel()
        p, kd, kv = self.law.force(state[0], state[1], np.broadcast_to(tau, d.shape).ravel())
        i = self.index
        return p[i].reshape(d.shape), kd[i, i].reshape(d.shape), kv[i, i].reshape(d.shape)


def vector_groups(laws: Sequence[Law]) -> tuple[tuple[np.ndarray, VectorLaw], ...]:
    """Return the numbers (p,) of the elements of each vector law among the laws of all elements, and the law.

    Raises
    ------
    ValueError
        If the components of a law are not all there, one after the other.
    """
    out, j = [], 0
    while j < len(laws):
        law = laws[j]
        if not isinstance(law, Component):
            j += 1
            continue
        p = law.law.size
        if [*laws[j : j + p]] != [Component(law.law, i) for i in range(p)]:
            raise ValueError(
                f"the {p} elements of a {type(law.law).__name__} must follow each other: give elements=[..., "
                "*VectorElement(directions, law)]"
            )
        out.append((np.arange(j, j + p), law.law))
        j += p
    return tuple(out)


@dataclass(frozen=True)
class RadialClearance(VectorLaw):  # numpydoc ignore=PR02
    """Contact of a shaft in a round hole with friction: rub, or a bearing with clearance.

        p = k max(r - clearance, 0) (n + friction t),   r = |d|,  n = d / r,  t = n turned by 90 degrees

    Parameters
    ----------
    k : float
        Contact stiffness, > 0 [force / length].
    clearance : float
        Radial clearance, >= 0 [length].
    friction : float, optional
        Coefficient of friction of a shaft that turns from the second direction to the first, so that friction pulls
        it from the first to the second. Default 0.

    Raises
    ------
    ValueError
        If k is not positive, the clearance is negative, or a number is not finite.

    Notes
    -----
    With z = x + i y the force is k (1 - clearance / r) (1 + i friction) z. The friction force is that of a shaft whose
    surface slides in one direction throughout.

    References
    ----------
    Muszynska, Rotordynamics (2005), https://doi.org/10.1201/9781420027792, for rub.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> law = hb.mechanics.RadialClearance(k=2.0, clearance=1.0, friction=0.1)
    >>> law.force(np.array([[3.0], [0.0]]), np.zeros((2, 1)), np.zeros(1))[0].round(12).tolist()
    [[4.0], [0.4]]
    """

    k: float
    clearance: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        checked("RadialClearance", "k", self.k, POSITIVE)
        checked("RadialClearance", "clearance", self.clearance, NOT_NEGATIVE)
        checked("RadialClearance", "friction", self.friction)

    size = 2
    rated = False
    steady = True

    @property
    def reference(self) -> float:
        return self.k

    def edges(self, d: Array) -> Array:
        return (np.hypot(*d) - self.clearance)[None] if self.clearance else np.zeros((0, d.shape[1]))

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        r = np.hypot(*d)
        closed = r > self.clearance
        n = np.divide(d, r, out=np.zeros_like(d), where=r > 0)
        fraction = np.where(closed, 1 - np.divide(self.clearance, r, out=np.zeros_like(r), where=closed & (r > 0)), 0.0)
        turn = np.array([[1.0, -self.friction], [self.friction, 1.0]])
        slope = np.where(closed, 1 - fraction, 0.0) * n[:, None] * n[None, :] + fraction * np.eye(2)[:, :, None]
        if not self.clearance:
            slope, fraction = np.repeat(np.eye(2)[:, :, None], len(r), axis=2), np.ones_like(r)
        kd = self.k * np.einsum("ij,jkn->ikn", turn, slope)
        return self.k * turn @ (fraction * d), kd, np.zeros_like(kd)


@dataclass(frozen=True)
class Polynomial(VectorLaw):  # numpydoc ignore=PR02
    """Polynomial of several displacements, such as the couplings of reduced thin structures.

        p_i = sum_t coefficients[t][i] prod_j d_j^exponents[t][j]

    Parameters
    ----------
    exponents : sequence of sequence of int, shape (T, p)
        Exponents >= 0 of each term.
    coefficients : sequence of sequence of float, shape (T, p)
        Factor of each term in each force.

    Raises
    ------
    ValueError
        If the shapes differ, an exponent is negative, or a number is not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> law = hb.mechanics.Polynomial(exponents=[[1, 2], [2, 1]], coefficients=[[1.0, 0.0], [0.0, 1.0]])
    >>> law.force(np.array([[2.0], [3.0]]), np.zeros((2, 1)), np.zeros(1))[0].ravel().tolist()
    [18.0, 12.0]
    """

    exponents: tuple[tuple[int, ...], ...]
    coefficients: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        powers, factors = np.array(self.exponents), np.array(self.coefficients, dtype=float)
        if powers.ndim != 2 or powers.shape != factors.shape or not powers.size:
            raise ValueError(
                f"Polynomial: exponents of shape {powers.shape} and coefficients of shape {factors.shape}; need one "
                "row for each term and one column for each displacement in both"
            )
        if powers.dtype.kind not in "iu" or powers.min() < 0 or not np.isfinite(factors).all():
            raise ValueError("Polynomial: exponents must be integers >= 0, and coefficients finite numbers")
        object.__setattr__(self, "exponents", tuple(map(tuple, powers.tolist())))
        object.__setattr__(self, "coefficients", tuple(map(tuple, factors.tolist())))

    @property
    def size(self) -> int:
        return len(self.exponents[0])

    rated = False
    steady = True

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        powers, factors = np.array(self.exponents), np.array(self.coefficients)
        p, slopes = factors.T @ np.prod(d ** powers[:, :, None], axis=1), []
        for j in range(self.size):
            lower = powers.copy()
            lower[:, j] = np.maximum(lower[:, j] - 1, 0)
            slopes.append((factors * powers[:, [j]]).T @ np.prod(d ** lower[:, :, None], axis=1))
        kd = np.stack(slopes, axis=1)
        return p, kd, np.zeros_like(kd)


@dataclass(frozen=True)
class Directed(VectorLaw):  # numpydoc ignore=PR02
    """Scalar law that measures in one direction and acts in another.

        p = (0, law(d_1, d_1', tau)),   d_1 in the first direction, force in the second one

    Parameters
    ----------
    law : Law
        Scalar law without memory whose force does not jump.

    Raises
    ------
    TypeError
        If it is not a scalar law.
    ValueError
        If it has friction sliders or contacts with dampers.

    Notes
    -----
    The stiffness matrix is not symmetric. An example is the friction between teeth, which is proportional to the force
    along the line of action and acts across it.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> law = hb.mechanics.Directed(hb.Unilateral(k=2.0))
    >>> law.force(np.array([[3.0], [1.0]]), np.zeros((2, 1)), np.zeros(1))[0].ravel().tolist()
    [0.0, 6.0]
    """

    law: Law

    def __post_init__(self) -> None:
        if not isinstance(self.law, Law) or isinstance(self.law, VectorLaw | Component):
            raise TypeError(f"Directed: law = {quoted(self.law)} must be a scalar law, such as Unilateral(1.0)")
        if self.law.sliders or self.law.damped:
            raise ValueError("Directed: a law with friction sliders or contacts with dampers acts where it measures")

    size = 2

    @property
    def rated(self) -> bool:
        return self.law.rated

    @property
    def steady(self) -> bool:
        return self.law.steady

    @property
    def reference(self) -> float:
        return self.law.reference

    @property
    def phases(self) -> tuple[float, ...]:
        return self.law.phases

    def edges(self, d: Array) -> Array:
        return d[0] - np.array(self.law.breakpoints).reshape(-1, 1)

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        forces = self.law.force(d[0], v[0], tau)
        p, kd, kv = np.zeros_like(d), np.zeros((2, *d.shape)), np.zeros((2, *d.shape))
        p[1], kd[1, 0], kv[1, 0] = forces
        return p, kd, kv


@dataclass(frozen=True)
class SlidingTeeth(VectorLaw):  # numpydoc ignore=PR02
    """Friction between the teeth of a mesh, beyond the force along the line of action.

        p = (0, across(d_1, tau), slide(d_1, tau))

    The first direction measures the mesh gap. The second one is that of the force across the line of action at the
    pitch point, and the third one that of the torque about the pitch point.

    Parameters
    ----------
    contacts : MeshContacts
        Contacts with friction (`ToothSliding`).

    Raises
    ------
    ValueError
        If they have no friction.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> supports = (hb.gears.Support("3e8 N/m", axial="1e8 N/m", tilt="5e5 N m/rad"),) * 2
    >>> pair = hb.GearPair(pinion, wheel, backlash="80 um")
    >>> model = pair.model(200.0, 0.04, "spatial", supports=supports, friction=0.05)
    >>> [element.name for element in model.system().elements]
    ['gap', 'friction 1', 'friction 2', 'friction 3']
    """

    contacts: MeshContacts

    def __post_init__(self) -> None:
        if not isinstance(self.contacts, MeshContacts) or self.contacts.sliding is None:
            raise ValueError("SlidingTeeth: contacts must be MeshContacts with sliding=ToothSliding(...)")

    size = 3
    grazes = False
    rated = False

    @property
    def reference(self) -> float:
        return self.contacts.reference

    @property
    def phases(self) -> tuple[float, ...]:
        sliding = self.contacts.sliding
        assert sliding is not None
        corners = {x for f in (*sliding.across, *sliding.slide) if isinstance(f, Periodic) for x in f.corners}
        return tuple(sorted({*self.contacts.phases, *corners}))

    def edges(self, d: Array) -> Array:
        return d[0] - np.array(self.contacts.breakpoints).reshape(-1, 1)

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        forces = self.contacts.sliding_forces(d[0], tau)
        p, kd = np.zeros_like(d), np.zeros((3, *d.shape))
        p[1:] = forces.across, forces.slide
        kd[1:, 0] = forces.slopes[1:]
        return p, kd, np.zeros_like(kd)
