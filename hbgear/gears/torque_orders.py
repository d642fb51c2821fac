"""Harmonics of a torque in orders of its shaft, such as engine orders and the ripple of a motor.

    T(theta) = mean + sum_j amplitude_j cos(order_j theta + phase_j)

theta is the angle of rotation of the shaft. An order may be a fraction: a four-stroke engine has multiples of 1/2.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from math import cos, isfinite, sin, sqrt
from typing import Any

from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.common.units import to_si
from hbgear.mechanics.structures.elements import Load

LARGEST_DENOMINATOR = 60
"""Largest denominator of an order. With larger ones the common period with the meshes is too long for a balance."""

_ROUNDING = 1e-9
"""Accepted difference of an order from a fraction, such as of 0.3333333333 from 1/3."""

_EXAMPLE = "{2: '60 N m', 4: ('20 N m', '30 deg')}"

TorqueOrders = tuple[tuple[float, float, float], ...]
"""Harmonics of a torque: order of the shaft, amplitude [N m] and phase [rad] of each."""


def torque_orders(owner: str, harmonics: Any) -> TorqueOrders:
    """Return the harmonics of a torque: order, amplitude [N m] and phase [rad] of each, by ascending order.

    They are given as ``{order: amplitude}`` or ``{order: (amplitude, phase)}``, or as tuples of order, amplitude and
    phase; orders may be texts of numbers, such as "1/2". ValueError, in the name of the ``owner``, is raised if an
    order is not a positive fraction with a denominator up to 60, occurs twice, or a quantity is not valid.
    """
    rows = []
    for order, amplitude, phase in _rows(owner, harmonics):
        fraction = exact_order(owner, order)
        size = to_si(owner, "torque_orders", amplitude, "N m")
        angle = to_si(owner, "torque_orders", phase, "rad")
        if not isfinite(size) or not isfinite(angle):
            raise ValueError(f"{owner}: torque_orders = {quoted(harmonics)} must have finite amplitudes and phases")
        rows.append((float(fraction), size, angle))
    rows.sort()
    double = next((a[0] for a, b in pairwise(rows) if a[0] == b[0]), None)
    if double is not None:
        raise ValueError(f"{owner}: torque_orders has the order {double:g} twice; give its amplitude once")
    return tuple(rows)


def _rows(owner: str, terms: Any) -> Iterable[tuple[Any, Any, Any]]:
    """Yield order, amplitude and phase of each harmonic."""
    message = f"{owner}: torque_orders = {quoted(terms)} must be amplitudes by order of the shaft, such as {_EXAMPLE}"
    if isinstance(terms, Mapping):
        terms = [
            (order, *(row if isinstance(row, Sequence) and not isinstance(row, str) else (row,)))
            for order, row in terms.items()
        ]
    if isinstance(terms, str) or not isinstance(terms, Sequence):
        raise ValueError(message)
    for row in terms:
        if isinstance(row, str) or not isinstance(row, Sequence) or len(row) not in (2, 3):
            raise ValueError(message)
        yield row[0], row[1], row[2] if len(row) == 3 else 0.0


def exact_order(owner: str, order: Any) -> Fraction:
    """Return an order of a shaft as a fraction.

    Raises
    ------
    ValueError
        If it is not positive, or no fraction with a denominator up to 60.
    """
    try:
        number = Fraction(order.strip() if isinstance(order, str) else float(order))
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        raise ValueError(f"{owner}: order {quoted(order)} of the torque must be a number such as 2 or 1/2") from None
    fraction = number.limit_denominator(LARGEST_DENOMINATOR)
    if number <= 0 or abs(number - fraction) > _ROUNDING * number:
        raise ValueError(
            f"{owner}: order {quoted(order)} of the torque has no common base with the turns of its shaft below "
            f"{LARGEST_DENOMINATOR} turns; give a positive multiple of a simple fraction, such as 2 or 1/2"
        )
    return fraction


def common_divisor(a: Fraction, b: Fraction) -> Fraction:
    """Return the largest common divisor of two positive fractions."""
    while b:
        a, b = b, a % b
    return a


def mesh_multiple(owner: str, orders: TorqueOrders, mesh_speed: Fraction) -> int:
    """Return the frequency of a mesh over the common frequency with the torque orders of a shaft.

    ``mesh_speed`` is the frequency of the mesh over the speed of the shaft.
    """
    base = Fraction(1)
    for order, _, _ in orders:
        base = common_divisor(base, exact_order(owner, order) / mesh_speed)
    return int(1 / base)


def order_load(multiple: int, amplitude: float, angle: float, direction: Array) -> Load:
    """Return the load amplitude cos(multiple tau + angle) along a direction (n,)."""
    cosine, sine = amplitude * cos(angle) * direction, -amplitude * sin(angle) * direction
    return Load(cosine={multiple: cosine}, sine={multiple: sine})


def effective_torque(mean: float, orders: TorqueOrders) -> float:
    """Return the root mean square of a torque [N m], at which the stiffness of a mesh is computed."""
    return abs(mean) if not orders else sqrt(mean**2 + sum(amplitude**2 for _, amplitude, _ in orders) / 2)


def parse_torque_orders(option: str, text: str) -> dict[str, tuple[str, str]]:
    """Read amplitudes, with an optional phase, by order from a text such as "2: 60Nm, 4: 20Nm 30deg".

    Raises
    ------
    ValueError
        If an entry has no colon; the message names the option.
    """
    orders: dict[str, tuple[str, str]] = {}
    for entry in text.split(","):
        order, colon, rest = entry.partition(":")
        amplitude, _, phase = rest.strip().rpartition(" ") if rest.rstrip().endswith(("deg", "rad")) else (rest, "", "")
        if not colon or not amplitude.strip() or order.strip() in orders:
            raise ValueError(
                f'{option} {text}: need each order with its amplitude, such as {option} "2: 60Nm, 4: 20Nm 30deg"'
            )
        orders[order.strip()] = (amplitude.strip(), phase or "0 deg")
    return orders
