"""Contacts of gear meshes as elements of their own, on which the exponential method is exact.

    sum_j k_j(tau) max(d - level_j(tau), 0)   ->   elements with d_j = d - level_j(tau) and springs k_j(tau) max(d_j, 0)

The levels of a `MeshContacts` move, so that its law is not linear between constant breakpoints. With its level as a
prescribed displacement each contact is, and steps end where teeth touch or separate. The element of the mesh keeps its
place and its damper; the elements of its contacts follow all elements of the model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hbgear.mechanics.laws.laws import PiecewiseLinear
from hbgear.mechanics.laws.mesh_contacts import contacts_of, moving_springs_of
from hbgear.mechanics.models import Element, System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Periodic, Phased

MAX_CONTACTS = 12
"""Largest number of contacts of a mesh [-] with elements of their own: a step solves for the forces of all elements at
once. A helical pair in ten slices has 40, and is faster with the law in Python."""

MAX_JUMP_OF_LEVEL = 1e-7
"""Jump of a level [-], relative to its size, that is closed by a slope: tables of gaps leave 1e-8."""

_NO_SPRING = PiecewiseLinear((), (0.0,))


def with_contact_elements(system: System) -> System:
    """Return a system with an element for each contact of its meshes, after its own elements.

    Meshes with more than `MAX_CONTACTS` contacts, levels that jump, or harmonics of their own in the displacement of
    the element remain as they are.
    """
    own, added = list(system.elements), []
    for i, element in enumerate(own):
        made = _contact_elements(element)
        if made:
            own[i] = replace(element, law=_NO_SPRING)
            added += made
    return replace(system, elements=(*own, *added)) if added else system


def _contact_elements(element: Element) -> list[Element]:
    """Return the elements of the contacts of a mesh; empty if the element remains as it is."""
    known = moving_springs_of(element.law) if 0 < len(contacts_of(element.law)) <= MAX_CONTACTS else None
    out = []
    for number, (spring, level) in enumerate(known[0] if known else (), start=1):
        displacement = _displacement(element.displacement, level)
        if displacement is None:
            return []
        name = f"{element.name} contact {number}"
        out.append(replace(element, law=spring, displacement=displacement, damping=0.0, name=name))
    return out


def _displacement(given: Phased, level: Phased | None) -> Phased | None:
    """Return the sum of the displacement of an element and a level; None if it is no function of either kind."""
    if level is None or not level.varies:
        offset = 0.0 if level is None else level.mean
        if isinstance(given, Series):
            return replace(given, mean=given.mean + offset)
        return _raised(given, offset)
    assert isinstance(level, Periodic)
    if given.varies or np.abs(level.jumps[:, 0]).max() > MAX_JUMP_OF_LEVEL * level.bound:
        return None
    return _raised(_closed(level), given.mean)


def _raised(function: Periodic, offset: float) -> Periodic:
    """Return a function plus a constant."""
    return Periodic(function.phases, tuple((row[0] + offset, *row[1:]) for row in function.coefficients))


def _closed(level: Periodic) -> Periodic:
    """Return the function without jumps: each piece begins where the one before it ends, and its end is unchanged."""
    widths = np.diff([*level.phases, level.phases[0] + 2 * np.pi])
    rows = [
        (row[0] - jump, (row[1] if len(row) > 1 else 0.0) + jump / width, *row[2:])
        for row, jump, width in zip(level.coefficients, level.jumps[:, 0].tolist(), widths.tolist(), strict=True)
    ]
    return Periodic(level.phases, tuple(rows))
