"""Natural frequencies over speed, and where orders of the excitation meet them: critical speeds.

    [lambda^2 M + lambda C(Omega) + K(Omega)] phi = 0,   lambda = -delta + i omega,   critical: omega = order Omega

Elements act with their dampers and with their stiffness in the static equilibrium under the mean loads: a gap that is
open there has none. Modes are followed from one speed to the next by their shapes and frequencies.

The sense of whirl of a mode is that of the gyroscopic forces s Omega G q' on it, |G| = (G^T G)^(1/2):

    w = sign(s) Im(phi^H G^T phi) / (phi^H |G| phi),   -1 <= w <= 1

1 if every disc tilts on a circle in the direction in which its shaft turns (forward whirl, whose frequency rises with
speed), -1 on a circle against it (backward whirl), 0 if the tilts stay in a plane.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, Range, checked, counted
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.harmonic.equations.static_state import static_stiffness
from hbgear.harmonic.frequency_units import scales
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.structure.receptance import dense
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.models import Model, System

_MOST = 1500  # coordinates whose modes are computed

_PHASES = 256  # of a period, at which the slope of a law is averaged

_FAR = 1e3  # times the outermost corner of a law, where it is closed

_TILTS = 1e-9  # share of the gyroscopic terms in a mode, over the largest, above which it whirls in a sense

_PLANAR = 1e-3  # sense of whirl, below which the orbit is taken for a line

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
    whirl : sense of whirl w of the mode there; nan without gyroscopic terms, or of a mode that they do not act on.

    Examples
    --------
    >>> import hbgear as hb
    >>> [one.order for one in hb.analysis.campbell(hb.SpurPair(), (0.5, 1.5), {"mesh": 1.0}).critical]
    ['mesh']
    """

    order: str
    mode: int
    Omega: float
    frequency: float
    damping: float
    whirl: float = math.nan


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
    whirl : (P, r) sense of whirl w; equation at the head of this file.
    closed : names of the elements that act with a stiffness.
    opened : names of the others, whose gaps are open.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.analysis.campbell(hb.gears.GearRotorBearing(), (0.2, 2.0), points=5)
    >>> found.frequencies.shape == (5, len(found.frequencies[0]))
    True
    """

    Omega: Array
    frequencies: Array
    damping: Array
    orders: Mapping[str, float]
    critical: tuple[CriticalSpeed, ...]
    scales: Mapping[str, float]
    whirl: Array
    closed: tuple[str, ...]
    opened: tuple[str, ...]


@checked_arguments(orders="orders by name, such as {'mesh': 1.0, 'pinion shaft': 1 / 25}")
def campbell(
    model: Model, span: tuple[float, float], orders: Mapping[str, float] | None = None, points: int = 101,
    modes: int | None = None, closed: Mapping[str, bool] | Sequence[bool] | bool | None = None,
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
    closed : which elements are in contact, and act with the mean stiffness of their laws beyond all corners: True or
        False for all, one each, or some by name, such as {"stop": True}. By default, and of elements that are not
        named, the contacts and the stiffness are those of the static equilibrium at the lower end of the span.

    Returns
    -------
    `Campbell`

    Raises
    ------
    ValueError
        If the span is empty or outside of a table, an order is not positive, ``closed`` does not fit the elements, no
        static equilibrium is found, or there are too many coordinates.

    Warns
    -----
    UserWarning
        If elements open or close between the static equilibria at both ends of the span.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> tilt = hb.Element([1.0, 0.0], hb.Cubic(k1=0, k3=0))
    >>> whirl = hb.mechanics.SpeedTerms(np.array([[0.0, 0.6], [-0.6, 0.0]]))
    >>> disc = hb.System(np.eye(2), None, np.eye(2), [tilt], hb.Load(cosine={1: [0.1, 0.0]}), speed=whirl)
    >>> [round(one.Omega, 4) for one in hb.analysis.campbell(disc, (0.1, 3.0), {"shaft": 1.0}).critical]
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
        raise ValueError(
            f"{system.n} coordinates are too many to compute all modes of: reduce the model, hb.mechanics.reduce"
        )
    if system.speed is not None and (first not in system.speed.range or last not in system.speed.range):
        raise ValueError(
            f"the span {first:g} to {last:g} leaves the tables of the model: Omega must {system.speed.range}"
        )
    keep = system.n if modes is None else counted("modes", modes, system.n)
    springs = _springs(model, system, closed, (first, last))
    rotor = _Rotor(system, springs)
    Omega = np.linspace(first, last, points)
    found, senses = _followed(rotor, Omega)
    lowest = np.argsort([next(p.imag for p in column if np.isfinite(p)) for column in found], kind="stable")[:keep]
    poles, whirl = (np.array([each[i] for i in lowest]).T.reshape(points, -1) for each in (found, senses))
    meetings = [one for name, ratio in named.items() for i in range(poles.shape[1])
                for one in _critical(rotor, Omega, poles[:, i], name, ratio, i + 1)]  # fmt: skip
    with np.errstate(invalid="ignore"):
        damping = -poles.real / np.abs(poles)
    names = [e.name for e in system.elements]
    shut, free = (tuple(n for n, k in zip(names, springs, strict=True) if (k != 0) == side) for side in (True, False))
    critical = tuple(sorted(meetings, key=lambda one: one.Omega))
    return Campbell(Omega, poles.imag, damping, named, critical, scales(model, {}), whirl, shut, free)


def _springs(
    model: Model, system: System, closed: Mapping[str, bool] | Sequence[bool] | bool | None, span: tuple[float, float]
) -> Array:
    """Stiffness of each element (m,)."""
    system.check_matrices()
    names = [e.name for e in system.elements]
    given: list[bool | None]
    if closed is None or isinstance(closed, Mapping):
        by_name = closed or {}
        for name in by_name:
            if name not in names:
                raise KeyError(f"campbell: closed: there is no element {quoted(name)}{did_you_mean(name, names)}")
        given = [by_name.get(name) for name in names]
    else:
        given = [*np.atleast_1d(np.asarray(closed, dtype=bool)).tolist()] * (1 if np.ndim(closed) else len(names))
    if len(given) != len(names):
        raise ValueError(f"closed has {len(given)} entries; need {len(names)}, one for each element")
    if None not in given:
        return np.array([_stiffness(e.law, bool(shut)) for e, shut in zip(system.elements, given, strict=True)])
    at_rest = _static(model, span, [i for i, shut in enumerate(given) if shut is None], names)
    return np.array([at_rest[i] if shut is None else _stiffness(e.law, shut)
                     for i, (e, shut) in enumerate(zip(system.elements, given, strict=True))])  # fmt: skip


def _static(model: Model, span: tuple[float, float], asked: Sequence[int], names: Sequence[str]) -> Array:
    """Stiffness of all elements in the static equilibrium at the lower end of the span (m,)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one harmonic is enough for a static state
        compiled = HarmonicBalance(model, 1).compiled({})
    first, last = (static_stiffness(compiled, Omega) for Omega in span)
    if first is None or last is None:
        raise ValueError(
            "campbell: no static equilibrium is found at the ends of the span; say of every element whether it is "
            f"closed: closed={{{', '.join(f'{names[i]!r}: True' for i in asked)}}}"
        )
    changed = [names[i] for i in asked if (first[i] != 0) != (last[i] != 0)]
    if changed:
        warnings.warn(
            f"{', '.join(changed)}: the contact changes between the static equilibria at Omega = {span[0]:g} and "
            f"{span[1]:g}; natural frequencies are those with the contacts at {span[0]:g}",
            stacklevel=4,
        )
    return first


def _stiffness(law: Law, shut: bool) -> float:
    """Mean slope over a period of a law at rest; of one with corners that is shut, beyond all of them."""
    tau = 2 * np.pi * np.arange(_PHASES) / _PHASES
    far = _FAR * max(1.0, *map(abs, law.breakpoints)) if shut and law.breakpoints else 0.0
    return max(float(law.force(np.full(_PHASES, d), np.zeros(_PHASES), tau)[1].mean()) for d in (far, -far))


def whirl_word(whirl: float) -> str:
    """forward, backward, or planar; "-" if the sense of whirl is not known (nan).

    Examples
    --------
    >>> whirl_word(0.9), whirl_word(-0.2), whirl_word(float("nan"))
    ('forward', 'backward', '-')
    """
    if math.isnan(whirl):
        return "-"
    if abs(whirl) < _PLANAR:
        return "planar"
    return "forward" if whirl > 0 else "backward"


class _Rotor:
    """Poles with positive frequency and their shapes at any Omega."""

    def __init__(self, system: System, springs: Array) -> None:
        system.check_matrices()
        self.system, self.n = system, system.n
        W, dampers = system.W, np.array([e.damping for e in system.elements])
        self.inverse = np.linalg.inv(dense(system.M))
        self.gyroscopic = _gyroscopic(system)
        self.tilting = 0.0 if self.gyroscopic is None else float(np.abs(self.inverse @ self.gyroscopic[1]).max())
        self.more = (W * springs) @ W.T, (W * dampers) @ W.T

    def modes(self, Omega: float) -> tuple[ComplexArray, ComplexArray, Array]:
        """(r,) poles, lowest frequency first, unit shapes (n, r) scaled by the masses, and senses of whirl (r,)."""
        system = self.system.at_speed(Omega)
        K, C = (self.inverse @ (dense(A) + B) for A, B in zip((system.K, system.C), self.more, strict=True))
        clock = np.sqrt(np.abs(K).max()) or 1.0
        A = np.block([[np.zeros_like(K), clock * np.eye(self.n)], [-K / clock, -C]])
        poles, V = scipy.linalg.eig(A)
        some = np.flatnonzero(poles.imag > _OSCILLATES * np.abs(poles).max(initial=0.0))
        some = some[np.argsort(poles[some].imag, kind="stable")]
        whirl = self._whirl(V[: self.n, some])
        shapes = V[: self.n, some] / np.sqrt(np.abs(np.diag(self.inverse)))[:, None]
        return poles[some], shapes / np.linalg.norm(shapes, axis=0), whirl

    def _whirl(self, shapes: ComplexArray) -> Array:
        """Sense of whirl of shapes (n, r); nan of those on which the gyroscopic terms do not act."""
        if self.gyroscopic is None:
            return np.full(shapes.shape[1], np.nan)
        G, size = self.gyroscopic
        turning = -np.einsum("ir,ij,jr->r", shapes.conj(), G, shapes).imag
        tilting = np.einsum("ir,ij,jr->r", shapes.conj(), size, shapes).real
        mass = np.einsum("ir,ij,jr->r", shapes.conj(), dense(self.system.M), shapes).real
        acts = tilting > _TILTS * self.tilting * np.abs(mass)
        sense: Array = np.divide(turning, tilting, out=np.full(len(acts), np.nan), where=acts)
        return sense

    def near(self, Omega: float, guess: complex) -> tuple[complex, float]:
        """The pole at Omega that is nearest to a guess, and its sense of whirl."""
        poles, _, whirl = self.modes(Omega)
        i = np.argmin(np.abs(poles - guess))
        return complex(poles[i]), float(whirl[i])


def _gyroscopic(system: System) -> tuple[Array, Array] | None:
    """sign(s) G and |G| = (G^T G)^(1/2), both (n, n); None if no gyroscopic terms change with speed."""
    speed = system.speed
    if speed is None or speed.gyroscopic is None or not speed.ratio:
        return None
    G = np.sign(speed.ratio) * dense(speed.gyroscopic)
    values, vectors = np.linalg.eigh(1j * G)  # G is skew-symmetric: i G is Hermitian, with real eigenvalues
    return G, ((vectors * np.abs(values)) @ vectors.conj().T).real


def _followed(rotor: _Rotor, Omega: Array) -> tuple[list[ComplexArray], list[Array]]:
    """Poles (P,) of every mode that oscillates at any of the speeds, and their senses of whirl; nan where not."""
    columns: list[ComplexArray] = []
    senses: list[Array] = []
    last: list[tuple[complex, ComplexArray]] = []  # pole and shape when the mode was last seen
    for p, w in enumerate(Omega.tolist()):
        poles, shapes, whirl = rotor.modes(w)
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
                senses.append(np.full(len(Omega), np.nan))
                last.append((pole, shapes[:, j]))
                pairs[j] = len(columns) - 1
            columns[pairs[j]][p], last[pairs[j]] = pole, (pole, shapes[:, j])
            senses[pairs[j]][p] = whirl[j]
    return columns, senses


def _critical(
    rotor: _Rotor, Omega: Array, poles: ComplexArray, name: str, ratio: float, mode: int
) -> list[CriticalSpeed]:
    """Where the order meets the mode, between the speeds at which the poles (P,) are known."""
    out = []
    beyond = poles.imag - ratio * Omega
    for i in np.flatnonzero(beyond[:-1] * beyond[1:] <= 0).tolist():
        if beyond[i + 1] == 0 and i + 2 < len(Omega):
            continue  # found from the next piece

        def pole(w: float, i: int = i) -> tuple[complex, float]:
            share = (w - Omega[i]) / (Omega[i + 1] - Omega[i])
            return rotor.near(w, complex(poles[i] + share * (poles[i + 1] - poles[i])))

        def apart(w: float, pole: object = pole) -> float:
            return pole(w)[0].imag - ratio * w  # type: ignore[operator, no-any-return]

        ends = float(Omega[i]), float(Omega[i + 1])
        if apart(ends[0]) * apart(ends[1]) > 0:
            continue
        at = float(scipy.optimize.brentq(apart, *ends, xtol=1e-15 * ends[1], rtol=1e-14))
        here, whirl = pole(at)
        out.append(CriticalSpeed(name, mode, at, here.imag, -here.real / (abs(here) or 1.0), whirl))
    return out
