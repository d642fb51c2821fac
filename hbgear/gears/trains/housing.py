"""Housing of a train as matrices: bearings are attached to some of its coordinates instead of the ground.

    M q_h'' + C q_h' + K q_h + sum over seats of s f = 0,   f = k (x_wheel - s^T q_h) + c (x_wheel' - s^T q_h')

s selects the coordinate of a seat.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.gears.pairs.support import AXES
from hbgear.mechanics.structures.matrices import coordinate_names, square

SEAT_DIRECTIONS = AXES[:3]
"""Directions in which a bearing can be attached to a housing."""


@dataclass(frozen=True, eq=False)
class Housing:  # numpydoc ignore=PR02
    """Housing, foundation or test rig, from a finite element program or by hand, in SI units.

    Parameters
    ----------
    M, K : array_like, shape (h, h)
        Mass [kg] and stiffness [N/m] of displacements [m], dense or scipy.sparse.
    C : array_like, shape (h, h), optional
        Damping matrix [N s/m]. Default None: no damping.
    names : sequence of str, optional
        Names of the h coordinates. Default: ``h1, h2, ...``.
    seats : mapping of str to mapping of str to str, optional
        Coordinates to which bearings are attached: ``{"pinion": {"x": "h1", "y": "h2"}}`` for the bearings of that
        wheel. Other directions are attached to the ground.

    Raises
    ------
    ValueError
        If matrices are not square, not finite or of different sizes, or a seat names an unknown coordinate.

    Examples
    --------
    >>> import hbgear as hb
    >>> box = hb.gears.Housing([[40.0]], [[2e9]], names=["side"], seats={"pinion": {"y": "side"}})
    >>> box.n
    1
    """

    M: Any
    K: Any
    C: Any = None
    names: Sequence[str] = ()
    seats: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        for name in ("M", "K", "C"):
            if getattr(self, name) is None and name == "C":
                set_(self, "C", np.zeros(self.M.shape))
            matrix = square(f"Housing: {name}", getattr(self, name), None if name == "M" else self.n)
            set_(self, name, matrix.toarray() if hasattr(matrix, "toarray") else matrix)
        set_(self, "names", coordinate_names("Housing: names", self.names, self.n, "h"))
        if not isinstance(self.seats, Mapping) or not all(isinstance(x, Mapping) for x in self.seats.values()):
            raise ValueError(
                f"Housing: seats = {quoted(self.seats)} must be a dict such as {{'pinion': {{'x': 'h1'}}}}"
            )
        for wheel, seat in self.seats.items():
            for axis, name in seat.items():
                if axis not in SEAT_DIRECTIONS:
                    raise ValueError(
                        f"Housing: seat of '{wheel}': '{axis}' must be one of {', '.join(SEAT_DIRECTIONS)}"
                    )
                if name not in self.names:
                    raise ValueError(
                        f"Housing: seat of '{wheel}': there is no coordinate {quoted(name)}"
                        f"{did_you_mean(str(name), self.names)}"
                    )

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.M)

    def seat(self, wheel: str, axis: int) -> Array:
        """Return the vector (h,) with 1 at the coordinate that supports a bearing of a wheel in a direction, else 0."""
        name = self.seats.get(wheel, {}).get(AXES[axis]) if axis < len(SEAT_DIRECTIONS) else None
        return np.array([float(coordinate == name) for coordinate in self.names])
