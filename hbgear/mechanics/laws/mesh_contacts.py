"""Contacts of a gear mesh with stiffness and level prescribed over the phase, summed into one force.

    p(d, tau) = sum_j side_j k_j(tau) max(side_j (d - level_j(tau)), 0)

A contact is a pair of teeth, or a slice of it, on one flank. Its stiffness is zero outside its path of contact, and its
level is the displacement at which its gap closes: the initial gap on the driving flank (side +1), and minus the
backlash minus the initial gap on the back flank (side -1). All contacts act on one displacement, so that a mesh has the
unknowns of one element.

With friction between the teeth (`ToothSliding`) each contact also has a force across the line of action, which acts on
the pinion against its surface velocity, and a torque about the pitch point:

    across(d, tau) = sum_j a_j(tau) max(side_j (d - level_j(tau)), 0),   slide(d, tau) = sum_j b_j(tau) max(...)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.laws import Forces, Law, PiecewiseLinear, springs_of
from hbgear.mechanics.series.fourier import Series, is_listed
from hbgear.mechanics.series.periodic import Periodic, Phased, pieces_of
from hbgear.mechanics.series.piecewise_polynomial import TURN, PiecewisePolynomial, as_cubic


@dataclass(frozen=True)
class ToothContact(Law):  # numpydoc ignore=PR02
    """One-sided contact with prescribed stiffness and level.

        p(d, tau) = side k(tau) max(side (d - level(tau)), 0)

    Parameters
    ----------
    stiffness : Series or Periodic
        Contact stiffness k(tau) >= 0 [force / length]; zero where there is no contact.
    level : Series or Periodic
        Displacement at which the gap closes [length]: a `Periodic`, or a constant as ``Series(mean=...)``. Its values
        where the stiffness is zero have no effect.
    side : {1, -1}, optional
        +1 for contact above the level (default), -1 below it.

    Raises
    ------
    ValueError
        If the stiffness is negative or the level has harmonics but no breakpoints.
    """

    stiffness: Phased
    level: Phased
    side: int = 1

    def __post_init__(self) -> None:
        for name in ("stiffness", "level"):
            function = getattr(self, name)
            if not isinstance(function, Phased) or (isinstance(function, Series) and function.varies):
                raise ValueError(
                    f"ToothContact: {name} = {quoted(function)} must be a Periodic, or a constant such as "
                    "Series(mean=1.0)"
                )
        if self.side not in (1, -1):
            raise ValueError(f"ToothContact: side = {quoted(self.side)} must be 1 or -1")
        lowest = self.stiffness.extremes()[0] if isinstance(self.stiffness, Periodic) else self.stiffness.mean
        if lowest < -ROUNDING * self.stiffness.bound:
            raise ValueError(
                f"ToothContact: the stiffness has the minimum {lowest:.4g}; contacts push, so that it "
                "must not be negative: correct the values of the table"
            )

    @property
    def reference(self) -> float:
        return self.stiffness.mean

    @property
    def breakpoints(self) -> tuple[float, ...]:
        return (self.level.mean,)

    @property
    def phases(self) -> tuple[float, ...]:
        return tuple(sorted({*self.stiffness.corners, *self.level.corners}))

    rated = False

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        return self.bind(tau)(d, v)

    def bind(self, tau: Array) -> Callable[[Array, Array], Forces]:
        k, level = (function(tau) if function.varies else function.mean for function in (self.stiffness, self.level))

        def forces(d: Array, v: Array) -> Forces:
            closed = self.side * (d - level) > 0.0
            return k * np.where(closed, d - level, 0.0), k * closed, np.zeros_like(d)

        return forces


ROUNDING = 1e-9
"""Negative stiffness, relative to the largest value, that is attributed to rounding."""


@dataclass(frozen=True)
class ToothSliding:  # numpydoc ignore=PR02
    """Friction between the teeth of a mesh, for each of its contacts.

        a_j = mu sign(s - s_P) k_j,   b_j = mu |s - s_P| p_b k_j / r_b1
        M_1 / r_b1 = cosine p + lever across + slide,   P_loss = relative omega_1 r_b1 slide
        relative rotation: p + lever across + lever_slope slide

    s is the position of the contact on the path of contact in base pitches p_b, s_P the pitch point, mu the coefficient
    of friction, M_1 the torque of the mesh on the pinion and omega_1 its mean speed.

    Parameters
    ----------
    across, slide : tuple of Series or Periodic
        Functions a_j(tau) and b_j(tau) of each contact [force / length].
    lever : float
        Radius of curvature at the pitch point over the base radius: the tangent of the working pressure angle.
    lever_slope : float
        Factor of ``slide`` in the equation of the relative rotation, r_b1 m_c (r_b1/J_1 - r_b2/J_2); + for a ring.
    relative : float
        Sum of the speeds of both gears over that of the pinion, 1 + z_1/z_2; 1 - z_1/z_2 for a ring.
    radius : float
        Base radius of the pinion r_b1 [m].
    speed : float
        Speed of the pinion over Omega.
    normal : tuple of Series or Periodic, optional
        Stiffness k_j(tau) of the normal forces, if the stiffness of the contacts includes friction. Default (): the
        contacts have the normal forces.
    cosine : float, default 1.0
        Cosine of the angle between the force p and the transverse plane: that of the base helix angle if p is the force
        normal to the flanks, 1 if it is the transverse force.
    """

    across: tuple[Phased, ...]
    slide: tuple[Phased, ...]
    lever: float
    lever_slope: float
    relative: float
    radius: float
    speed: float
    normal: tuple[Phased, ...] = ()
    cosine: float = 1.0

    def changed(self, stiffness: Callable[[Phased], Phased]) -> ToothSliding:
        """Return the friction with changed functions of the phase."""
        across, slide, normal = (tuple(map(stiffness, row)) for row in (self.across, self.slide, self.normal))
        return replace(self, across=across, slide=slide, normal=normal)


class SlidingForces(NamedTuple):
    """Forces of a mesh with friction at displacements and phases.

    Attributes
    ----------
    normal, across, slide : ndarray, shape (N,)
        Force along the line of action, force across it, and torque about the pitch point over the base radius of the
        pinion.
    slopes : ndarray, shape (3, N)
        Their derivatives with respect to the displacement.
    """

    normal: Array
    across: Array
    slide: Array
    slopes: Array


@dataclass(frozen=True, repr=False)
class MeshContacts(Law):  # numpydoc ignore=PR02
    """Sum of contacts on one displacement: the force of a mesh from its pairs of teeth.

        p(d, tau) = sum_j side_j k_j(tau) max(side_j (d - level_j(tau)), 0)

    Parameters
    ----------
    contacts : sequence of ToothContact
        One or more contacts.
    sliding : ToothSliding or None, optional
        Friction between the teeth; default none. It does not change the force p: ``along`` has it included.
    meshes : int, default 1
        Number of mesh periods in the period of the functions of the phase.

    Raises
    ------
    ValueError
        If the sequence is empty, an entry is not a contact, or the friction has another number of contacts.
    """

    contacts: tuple[ToothContact, ...]
    sliding: ToothSliding | None = None
    meshes: int = 1

    def __post_init__(self) -> None:
        if not is_listed(self.contacts) or not self.contacts:
            raise ValueError(f"MeshContacts: contacts = {quoted(self.contacts)} must be one or more ToothContact")
        object.__setattr__(self, "contacts", tuple(self.contacts))
        if not all(type(contact) is ToothContact for contact in self.contacts):
            raise ValueError("MeshContacts: contacts must be objects of the class ToothContact")
        if self.sliding is not None and {len(self.sliding.across), len(self.sliding.slide)} != {len(self.contacts)}:
            raise ValueError(
                f"MeshContacts: sliding has {len(self.sliding.across)} and {len(self.sliding.slide)} functions for "
                f"{len(self.contacts)} contacts; give one of each for every contact"
            )

    def __repr__(self) -> str:
        return f"<MeshContacts: {len(self.contacts)} contacts of pairs of teeth>"  # their tables fill pages

    def widened(self, half_backlash: float) -> MeshContacts:
        """Return the contacts with levels moved away from zero by a half backlash."""
        return _widened(self, half_backlash)

    def scaled(self, stiffness: float, length: float) -> MeshContacts:
        """Return the contacts with stiffness and levels times factors."""
        return _scaled(self, stiffness, length)

    def changed(self, stiffness: Callable[[Phased], Phased], level: Callable[[Phased], Phased]) -> MeshContacts:
        """Return the contacts with changed functions of the phase, such as shifted ones."""
        sliding = None if self.sliding is None else self.sliding.changed(stiffness)
        return replace(
            self,
            contacts=tuple(
                ToothContact(stiffness(contact.stiffness), level(contact.level), contact.side)
                for contact in self.contacts
            ),
            sliding=sliding,
        )

    def turned(self, change: Callable[[Phased], Phased], order: int = 1) -> MeshContacts:
        """Return the contacts with all functions of the phase changed, which ``order`` periods are a period of."""
        contacts = self.changed(change, change)
        if order == 1:
            return contacts
        sliding = None if contacts.sliding is None else replace(contacts.sliding, speed=order * contacts.sliding.speed)
        return replace(contacts, sliding=sliding, meshes=order * self.meshes)

    def _with_stiffness(self, values: Sequence[Phased], sliding: ToothSliding | None) -> MeshContacts:
        contacts = zip(values, self.contacts, strict=True)
        return replace(self, contacts=tuple(ToothContact(k, c.level, c.side) for k, c in contacts), sliding=sliding)

    @property
    def normal(self) -> MeshContacts:
        """The contacts without friction: the forces along the line of action."""
        if self.sliding is None:
            return self
        return self._with_stiffness(self.sliding.normal or [contact.stiffness for contact in self.contacts], None)

    @property
    def along(self) -> MeshContacts:
        """The contacts with the force on the relative rotation, p + lever across + lever_slope slide."""
        sliding = self.sliding
        if sliding is None or sliding.normal:
            return self
        k = [
            c.stiffness
            if not any(map(_is_set, (a, b)))
            else _joined(
                pieces_of(c.stiffness)
                .plus(pieces_of(a).scaled(c.side * sliding.lever))
                .plus(pieces_of(b).scaled(c.side * sliding.lever_slope))
            )
            for c, a, b in zip(self.contacts, sliding.across, sliding.slide, strict=True)
        ]
        return self._with_stiffness(k, replace(sliding, normal=tuple(c.stiffness for c in self.contacts)))

    def sliding_forces(self, d: Array, tau: Array) -> SlidingForces:
        """Return the forces along and across the line of action and the torque about the pitch point.

        They belong to displacements and phases (N,), and are zero across without friction.
        """
        starts, rows, side = self._sliding_table
        values = _cubics_at(tau, starts, rows)
        depth = side * (np.asarray(d)[..., None] - values[..., 0, :])
        closed = depth > 0.0
        forces = np.sum(values[..., 1:, :] * (closed * depth)[..., None, :], axis=-1)
        slopes = np.sum(values[..., 1:, :] * (closed * side)[..., None, :], axis=-1)
        return SlidingForces(forces[..., 0], forces[..., 1], forces[..., 2], np.moveaxis(slopes, -1, 0))

    @cached_property
    def _sliding_table(self) -> tuple[Array, Array, Array]:
        """Beginnings (T,) of common segments, cubics (T, 4, J, 4) of level, +-k, a and b, and sides (J,)."""
        sliding, contacts = self.sliding, self.normal.contacts
        zeros = (Series(),) * len(contacts)
        across, slide = (zeros, zeros) if sliding is None else (sliding.across, sliding.slide)
        functions = [
            [pieces_of(contact.level) for contact in contacts],
            [pieces_of(contact.stiffness).scaled(float(contact.side)) for contact in contacts],
            *([pieces_of(f) for f in sequence] for sequence in (across, slide)),
        ]
        starts = _union([f.at for sequence in functions for f in sequence])
        return starts, _common_rows(functions, starts), np.array([float(contact.side) for contact in contacts])

    @cached_property
    def reference(self) -> float:
        """Mean stiffness of the flank with the larger one, with all of its gaps closed."""
        return max(sum(c.stiffness.mean for c in self.contacts if c.side == side) for side in (1, -1))

    @cached_property
    def breakpoints(self) -> tuple[float, ...]:
        """Displacements at which the flanks can come into contact: the first level of each side over the period."""
        return tuple(side * first_level(self.contacts, side).smallest for side in flanks_of(self.contacts))

    @cached_property
    def phases(self) -> tuple[float, ...]:
        return tuple(sorted({x for contact in self.contacts for x in contact.phases}))

    rated = False

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        return self.bind(tau)(d, v)

    def bind(self, tau: Array) -> Callable[[Array, Array], Forces]:
        starts, rows, side = self._table
        values = _cubics_at(tau, starts, rows)
        k, level = values[..., 0, :], values[..., 1, :]

        def forces(d: Array, v: Array) -> Forces:
            depth = np.asarray(d)[..., None] - level
            slope = k * (side * depth > 0.0)
            return (slope * depth).sum(axis=-1), slope.sum(axis=-1), np.zeros_like(d)

        return forces

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Beginnings (T,) of common segments, cubics (T, 2, J, 4) of stiffness and level, and sides (J,)."""
        functions = [[pieces_of(c.stiffness) for c in self.contacts], [pieces_of(c.level) for c in self.contacts]]
        starts = _union([f.at for sequence in functions for f in sequence])
        return starts, _common_rows(functions, starts), np.array([float(c.side) for c in self.contacts])


@lru_cache(maxsize=32)  # a drawn pair assembles its model for each value of a parameter
def _scaled(law: MeshContacts, stiffness: float, length: float) -> MeshContacts:
    return law.changed(lambda k: k.scaled(stiffness), lambda level: level.scaled(length))


@lru_cache(maxsize=32)  # a model assembles its system for each motion that is evaluated
def _widened(law: MeshContacts, half_backlash: float) -> MeshContacts:
    return replace(
        law,
        contacts=tuple(
            ToothContact(contact.stiffness, _plus(contact.level, contact.side * half_backlash), contact.side)
            for contact in law.contacts
        ),
    )


class MovingSpring(NamedTuple):
    """Piecewise-linear spring of the displacement d - level(tau); without a level, of d."""

    spring: PiecewiseLinear
    level: Phased | None


def _common_rows(functions: Sequence[Sequence[PiecewisePolynomial]], starts: Array) -> Array:
    """Return cubics (T, F, J, 4) of F functions of J contacts from given phases on."""
    rows = np.array([[as_cubic(f.rows_at(starts)) for f in sequence] for sequence in functions])
    return np.ascontiguousarray(np.moveaxis(rows, 2, 0))


def _is_set(function: Phased) -> bool:
    return function.bound > 0.0


def _joined(pieces: PiecewisePolynomial) -> Periodic:
    return Periodic(tuple(pieces.at.tolist()), tuple(tuple(row) for row in pieces.rows.tolist()))


def _plus(function: Phased, offset: float) -> Phased:
    """Return a function plus a constant."""
    if isinstance(function, Series):
        return Series(function.mean + offset)
    return Periodic(function.phases, tuple((row[0] + offset, *row[1:]) for row in function.coefficients))


def flanks_of(contacts: Sequence[ToothContact]) -> tuple[int, ...]:
    """Return the sides that have contacts, -1 before +1."""
    return tuple(sorted({contact.side for contact in contacts}))


def contacts_of(law: Law) -> tuple[ToothContact, ...]:
    """Return the contacts of a law; empty for laws of another form."""
    if type(law) is ToothContact:
        return (law,)
    return law.contacts if type(law) is MeshContacts else ()


def moving_springs_of(law: Law) -> tuple[tuple[MovingSpring, ...], float, float] | None:
    """Split a law into springs of moving displacements and a cubic spring k1, k3; None if it is not a sum of these."""
    contacts = contacts_of(law)
    if contacts:
        springs = (PiecewiseLinear((0.0,), _SLOPES[c.side], stiffness=c.stiffness) for c in contacts)
        return tuple(MovingSpring(spring, c.level) for spring, c in zip(springs, contacts, strict=True)), 0.0, 0.0
    split = springs_of(law)
    return None if split is None else (tuple(MovingSpring(spring, None) for spring in split[0]), *split[1:])


class Envelope(NamedTuple):
    """First level of the contacts of a flank over the period, and its smallest value times the side of the flank."""

    level: PiecewisePolynomial
    smallest: float


@lru_cache(maxsize=32)
def first_level(contacts: tuple[ToothContact, ...], side: int) -> Envelope:
    """Return the level of the contacts of a side with the smallest side * level of those that exist at each phase.

    It jumps where a contact begins or ends. Where no contact exists, it is larger than all levels by their range.
    """
    side_contacts = [contact for contact in contacts if contact.side == side]
    levels = [pieces_of(contact.level).scaled(float(side)) for contact in side_contacts]
    stiffnesses = [pieces_of(contact.stiffness) for contact in side_contacts]
    starts = _union([x.at for x in (*levels, *stiffnesses)])
    rows = np.array([as_cubic(x.rows_at(starts)) for x in levels])
    present = np.array([np.any(x.rows_at(starts) != 0.0, axis=1) for x in stiffnesses])
    width = np.diff(np.append(starts, TURN))
    x = width[:, None] * np.linspace(0.0, 1.0, 5)
    values = np.polynomial.polynomial.polyval(x[None], np.moveaxis(rows, 2, 0)[..., None], tensor=False)
    bound = float(np.abs(values).max())
    no_contact = np.array([bound + max(float(np.ptp(values)), 1.0), 0.0, 0.0, 0.0])
    values[~present] = np.inf
    first = np.argmin(values, axis=0)
    piece_starts, out = [], []
    for i in range(len(starts)):
        if not present[:, i].any():
            piece_starts.append(starts[i])
            out.append(no_contact)
            continue
        if (first[i] == first[i, 0]).all():
            piece_starts.append(starts[i])
            out.append(rows[first[i, 0], i])
            continue
        for start, index in _crossings(rows[:, i], np.flatnonzero(present[:, i]), float(width[i])):
            piece_starts.append(starts[i] + start)
            out.append(
                np.polynomial.polynomial.Polynomial(rows[index, i])(
                    np.polynomial.polynomial.Polynomial([start, 1.0])
                ).coef
            )
    pieces = PiecewisePolynomial(np.array(piece_starts), np.concatenate([as_cubic(row[None]) for row in out]))
    ends = np.linspace(0.0, 1.0, 9) * pieces.widths[:, None]
    smallest = np.polynomial.polynomial.polyval(ends, pieces.rows.T[..., None], tensor=False).min()
    return Envelope(pieces.scaled(float(side)), float(smallest))


def _crossings(rows: Array, present: np.ndarray, width: float) -> list[tuple[float, int]]:
    """Return where each smallest polynomial (n, 4) begins on an interval, with its number."""
    cuts = {0.0, width}
    for i in range(len(present)):
        for j in range(i):
            difference = np.trim_zeros(rows[present[i]] - rows[present[j]], "b")
            if len(difference) > 1:
                roots = np.polynomial.polynomial.polyroots(difference)
                cuts |= {float(x.real) for x in roots if abs(x.imag) < 1e-12 and 0.0 < x.real < width}
    ordered = sorted(cuts)
    out: list[tuple[float, int]] = []
    for a, b in pairwise(ordered):
        values = np.polynomial.polynomial.polyval(0.5 * (a + b), rows[present].T)
        lowest = int(present[int(np.argmin(values))])
        if not out or out[-1][1] != lowest:
            out.append((a, lowest))
    return out


def _cubics_at(tau: Array, starts: Array, rows: Array) -> Array:
    """Return the values (..., F, J) at phases tau (...) of cubics, rows (T, F, J, 4) from the phases ``starts`` on."""
    phase = np.mod(tau, TURN)
    piece = np.searchsorted(starts, phase, side="right") - 1
    x, c = (phase - starts[piece])[..., None, None], rows[piece]
    return c[..., 0] + x * (c[..., 1] + x * (c[..., 2] + x * c[..., 3]))


def _union(beginnings: Sequence[Array]) -> Array:
    """Return all beginnings of segments, ascending, without those that are equal to rounding."""
    starts = np.unique(np.concatenate(beginnings))
    return starts[np.diff(starts, prepend=-np.inf) > 1e-12]


_SLOPES = {1: (0.0, 1.0), -1: (1.0, 0.0)}
"""Slopes below and above the level of contacts of each side."""
