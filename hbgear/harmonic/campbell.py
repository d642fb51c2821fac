"""Natural frequencies over speed, and where orders of the excitation meet them: critical speeds.

    [lambda^2 M + lambda C(Omega) + K(Omega)] phi = 0,   lambda = -delta + i omega,   critical: omega = order Omega

with elements closed by their mean stiffness and their dampers, as they are while all teeth are in mesh (laws without
corners by that at d = 0). Modes are
followed from one speed to the next by their shapes and frequencies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, Range, checked, counted
from hbgear.harmonic.receptance import dense
from hbgear.harmonic.speeds import scales
from hbgear.mechanics.laws import Law
from hbgear.mechanics.model import Model, System

_MOST = 1500  # coordinates whose modes are computed

_PHASES = 256  # of a period, at which the slope of a law is averaged

_FAR = 1e3  # times the outermost corner of a law, where it is closed

_OSCILLATES = 1e-9  # imaginary part of a pole, over the largest, above which a mode has a frequency


@dataclass(frozen=True)
class CriticalSpeed:
    """A frequency at which an order of the excitation meets a natural frequency.

    Parameters
    ----------
    order : name of the order.
    mode : number of the mode, counted from 1 at the lowest speed.
    Omega : frequency of the excitation.
    frequency : natural frequency there, the order times Omega.
    damping : damping ratio of the mode there.

    Examples
    --------
    >>> import hbgear as hb
    >>> [one.order for one in hb.campbell(hb.SpurPair(), (0.5, 1.5), {"mesh": 1.0}).critical]
    ['mesh']
    """

    order: str
    mode: int
    Omega: float
    frequency: float
    damping: float


@dataclass(frozen=True, eq=False)
class Campbell:
    """Natural frequencies over speed.

    Parameters
    ----------
    Omega : (P,) frequencies of the excitation.
    frequencies : (P, r) damped natural angular frequencies, a column for each mode; nan where it does not oscillate.
    damping : (P, r) damping ratios delta / |lambda|.
    orders : order over Omega by name.
    critical : where orders meet modes, the lowest Omega first.
    scales : Hz and r/min at Omega = 1, if the model knows its units.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.campbell(hb.GearRotorBearing(), (0.2, 2.0), points=5)
    >>> found.frequencies.shape == (5, len(found.frequencies[0]))
    True
    """

    Omega: Array
    frequencies: Array
    damping: Array
    orders: Mapping[str, float]
    critical: tuple[CriticalSpeed, ...]
    scales: Mapping[str, float]


@checked_arguments(orders="orders by name, such as {'mesh': 1.0, 'pinion shaft': 1 / 25}")
def campbell(
    model: Model, span: tuple[float, float], orders: Mapping[str, float] | None = None, points: int = 101,
    modes: int | None = None, closed: Sequence[bool] | bool = True,
) -> Campbell:  # fmt: skip
    """Natural frequencies of a model over the frequency of its excitation, and its critical speeds.

    Parameters
    ----------
    model : any `Model`; modes change with speed if its `System` has `SpeedTerms`.
    span : (from, to) of Omega.
    orders : order over Omega by name: 1 for the meshing of the teeth, 1/z for the shaft of a gear with z teeth; by
        default those of the model (`Model.orders`).
    points : P, where natural frequencies are computed; critical speeds are solved for between them.
    modes : how many of the lowest are kept; all by default.
    closed : whether elements are closed by the mean stiffness of their laws; one for all, or one each. A stop that is
        open at rest is not.

    Returns
    -------
    `Campbell`

    Raises
    ------
    ValueError
        If the span is empty or outside of a table, an order is not positive, ``closed`` does not fit the elements, or
        there are too many coordinates.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> tilt = hb.Element([1.0, 0.0], hb.Cubic(k1=0, k3=0))
    >>> whirl = hb.SpeedTerms(np.array([[0.0, 0.6], [-0.6, 0.0]]))
    >>> disc = hb.System(np.eye(2), None, np.eye(2), [tilt], hb.Load(cosine={1: [0.1, 0.0]}), speed=whirl)
    >>> [round(one.Omega, 4) for one in hb.campbell(disc, (0.1, 3.0), {"shaft": 1.0}).critical]
    [0.7906, 1.5811]
    """
    first, last = float(span[0]), float(span[1])
    checked("campbell", "the start of the span", first, POSITIVE)
    checked("campbell", "the end of the span", last, Range(above=first))
    counted("points", points, 10_000, least=2)
    named = dict(model.orders if orders is None else orders)
    for name, order in named.items():
        checked("campbell", f"order '{name}'", order, POSITIVE)
    system = model.system()
    if system.n > _MOST:
        raise ValueError(f"{system.n} coordinates are too many to compute all modes of: reduce the model, hb.reduce")
    if system.speed is not None and (first not in system.speed.range or last not in system.speed.range):
        raise ValueError(
            f"the span {first:g} to {last:g} leaves the tables of the model: Omega must {system.speed.range}"
        )
    keep = system.n if modes is None else counted("modes", modes, system.n)
    rotor = _Rotor(system, _springs(system, closed))
    Omega = np.linspace(first, last, points)
    found = _followed(rotor, Omega)
    lowest = np.argsort([next(p.imag for p in column if np.isfinite(p)) for column in found], kind="stable")[:keep]
    poles = np.array([found[i] for i in lowest]).T.reshape(points, -1)
    meetings = [one for name, ratio in named.items() for i in range(poles.shape[1])
                for one in _critical(rotor, Omega, poles[:, i], name, ratio, i + 1)]  # fmt: skip
    with np.errstate(invalid="ignore"):
        damping = -poles.real / np.abs(poles)
    return Campbell(
        Omega, poles.imag, damping, named, tuple(sorted(meetings, key=lambda one: one.Omega)), scales(model, {})
    )


def _springs(system: System, closed: Sequence[bool] | bool) -> Array:
    each = list(closed) if np.ndim(closed) else [bool(closed)] * len(system.elements)  # type: ignore[arg-type]
    if len(each) != len(system.elements):
        raise ValueError(f"closed has {len(each)} entries; need {len(system.elements)}, one for each element")
    return np.array([_stiffness(e.law, shut) for e, shut in zip(system.elements, each, strict=True)])


def _stiffness(law: Law, shut: bool) -> float:
    """Mean slope over a period of a law at rest; of one with corners that is shut, beyond all of them."""
    tau = 2 * np.pi * np.arange(_PHASES) / _PHASES
    far = _FAR * max(1.0, *map(abs, law.breakpoints)) if shut and law.breakpoints else 0.0
    return max(float(law.force(np.full(_PHASES, d), np.zeros(_PHASES), tau)[1].mean()) for d in (far, -far))


class _Rotor:
    """Poles with positive frequency and their shapes at any Omega."""

    def __init__(self, system: System, springs: Array) -> None:
        system.check_matrices()
        self.system, self.n = system, system.n
        W, dampers = system.W, np.array([e.damping for e in system.elements])
        self.inverse = np.linalg.inv(dense(system.M))
        self.more = (W * springs) @ W.T, (W * dampers) @ W.T

    def modes(self, Omega: float) -> tuple[ComplexArray, ComplexArray]:
        """(r,) poles, the lowest frequency first, and unit shapes (n, r), scaled by the masses."""
        system = self.system.at_speed(Omega)
        K, C = (self.inverse @ (dense(A) + B) for A, B in zip((system.K, system.C), self.more, strict=True))
        clock = np.sqrt(np.abs(K).max()) or 1.0
        A = np.block([[np.zeros_like(K), clock * np.eye(self.n)], [-K / clock, -C]])
        poles, V = scipy.linalg.eig(A)
        some = np.flatnonzero(poles.imag > _OSCILLATES * np.abs(poles).max(initial=0.0))
        some = some[np.argsort(poles[some].imag, kind="stable")]
        shapes = V[: self.n, some] / np.sqrt(np.abs(np.diag(self.inverse)))[:, None]
        return poles[some], shapes / np.linalg.norm(shapes, axis=0)

    def near(self, Omega: float, guess: complex) -> complex:
        """The pole at Omega that is nearest to a guess."""
        poles = self.modes(Omega)[0]
        return complex(poles[np.argmin(np.abs(poles - guess))])


def _followed(rotor: _Rotor, Omega: Array) -> list[ComplexArray]:
    """Poles (P,) of every mode that oscillates at any of the speeds, nan where it does not."""
    columns: list[ComplexArray] = []
    last: list[tuple[complex, ComplexArray]] = []  # pole and shape when the mode was last seen
    for p, w in enumerate(Omega.tolist()):
        poles, shapes = rotor.modes(w)
        pairs: dict[int, int] = {}
        if columns:
            seen = np.array([pole for pole, _ in last])
            alike = np.abs(np.array([shape.conj() @ shapes for _, shape in last])) ** 2
            apart = np.abs(seen[:, None] - poles) / (np.abs(seen[:, None]) + np.abs(poles))
            rows, taken = scipy.optimize.linear_sum_assignment(1 - alike + 4 * apart)
            pairs = dict(zip(taken.tolist(), rows.tolist(), strict=True))
        for j, pole in enumerate(poles.tolist()):
            if j not in pairs:
                columns.append(np.full(len(Omega), np.nan, dtype=complex))
                last.append((pole, shapes[:, j]))
                pairs[j] = len(columns) - 1
            columns[pairs[j]][p], last[pairs[j]] = pole, (pole, shapes[:, j])
    return columns


def _critical(
    rotor: _Rotor, Omega: Array, poles: ComplexArray, name: str, ratio: float, mode: int
) -> list[CriticalSpeed]:
    """Where the order meets the mode, between the speeds at which the poles (P,) are known."""
    out = []
    beyond = poles.imag - ratio * Omega
    for i in np.flatnonzero(beyond[:-1] * beyond[1:] <= 0).tolist():
        if beyond[i + 1] == 0 and i + 2 < len(Omega):
            continue  # found from the next piece

        def pole(w: float, i: int = i) -> complex:
            share = (w - Omega[i]) / (Omega[i + 1] - Omega[i])
            return rotor.near(w, complex(poles[i] + share * (poles[i + 1] - poles[i])))

        def apart(w: float, pole: object = pole) -> float:
            return pole(w).imag - ratio * w  # type: ignore[operator, no-any-return]

        ends = float(Omega[i]), float(Omega[i + 1])
        if apart(ends[0]) * apart(ends[1]) > 0:
            continue
        at = float(scipy.optimize.brentq(apart, *ends, xtol=1e-15 * ends[1], rtol=1e-14))
        here = pole(at)
        out.append(CriticalSpeed(name, mode, at, here.imag, -here.real / (abs(here) or 1.0)))
    return out
