"""Campbell diagram: natural frequencies over speed, and critical speeds at their intersections with excitation orders.

    [lambda^2 M + lambda C(Omega) + K(Omega)] phi = 0,   lambda = -delta + i omega,   critical: omega = order Omega

Each element acts with its damper and with its stiffness in the static equilibrium under the mean loads; an open gap has
no stiffness. Modes are tracked from one speed to the next by their shapes and frequencies.

The whirl w of a mode follows from the gyroscopic forces s Omega G q', with |G| = (G^T G)^(1/2):

    w = sign(s) Im(phi^H G^T phi) / (phi^H |G| phi),   -1 <= w <= 1

w = 1 if every disc tilts on a circle in the direction of its rotation (forward whirl; the frequency rises with speed),
w = -1 on a circle in the opposite direction (backward whirl), w = 0 if the tilts stay in a plane.
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
from hbgear.continuation.numerics.bracketed_root import find_root_bracketed
from hbgear.harmonic.equations.static_state import static_stiffness
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.frequency_units import scales
from hbgear.harmonic.structure.linear_structure import dense
from hbgear.harmonic.structure.massless import mass_basis, massless_modes
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.models import Model, System

_MAX_EIGENVALUE_COORDINATES = 1500
"""Largest number of coordinates; all modes are computed by a dense eigenvalue solver."""

_STIFFNESS_PHASES = 256
"""Number of phases of a period over which the slope of a law is averaged."""

_CLOSED_DISTANCE_RATIO = 1e3
"""Displacement of a closed element over its outermost breakpoint; the mean slope there is the closed stiffness."""

_MIN_GYROSCOPIC_RATIO = 1e-9
"""Gyroscopic term of a mode over the largest one, above which the mode has a whirl; smaller terms are rounding."""

_MAX_PLANAR_WHIRL = 1e-3
"""Absolute value of the whirl below which the orbit is a line."""

_MIN_OSCILLATION_RATIO = 1e-9
"""Imaginary part of a pole over the largest pole, above which the mode oscillates; smaller parts are rounding."""


@dataclass(frozen=True)
class CriticalSpeed:
    """Intersection of an order of the excitation with a natural frequency.

    Attributes
    ----------
    order : str
        Name of the order.
    mode : int
        Number of the mode, counted from 1 at the lowest speed.
    Omega : float
        Frequency of the excitation.
    frequency : float
        Natural frequency: order times Omega.
    damping : float
        Damping ratio of the mode.
    whirl : float
        Whirl w of the mode; nan without gyroscopic terms, or if they do not act on the mode.

    Examples
    --------
    >>> import hbgear as hb
    >>> [speed.order for speed in hb.analysis.campbell(hb.SpurPair(), (0.5, 1.5), {"mesh": 1.0}).critical]
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

    Attributes
    ----------
    Omega : ndarray, shape (P,)
        Frequencies of the excitation.
    frequencies : ndarray, shape (P, r)
        Damped natural angular frequencies, one column for each mode; nan where the mode does not oscillate.
    damping : ndarray, shape (P, r)
        Damping ratios delta / abs(lambda).
    orders : dict of str to float
        Ratio of the frequency of each order to Omega.
    critical : tuple of CriticalSpeed
        Critical speeds, the lowest Omega first.
    scales : dict of str to float
        Mesh frequency [Hz] and speed [r/min] at Omega = 1; empty if the model has no units.
    whirl : ndarray, shape (P, r)
        Whirl w of each mode; see the equation in the module header.
    closed : tuple of str
        Names of the elements with a stiffness.
    opened : tuple of str
        Names of the other elements, whose gaps are open.

    Examples
    --------
    >>> import hbgear as hb
    >>> diagram = hb.analysis.campbell(hb.gears.GearRotorBearing(), (0.2, 2.0), points=5)
    >>> diagram.frequencies.shape == (5, len(diagram.frequencies[0]))
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

    def __repr__(self) -> str:
        span = f"Omega = {self.Omega[0]:.6g} to {self.Omega[-1]:.6g}"
        return f"<Campbell: {span}, modes: {self.frequencies.shape[1]}, critical speeds: {len(self.critical)}>"


@checked_arguments(orders="orders by name, such as {'mesh': 1.0, 'pinion shaft': 1 / 25}")
def campbell(
    model: Model,
    span: tuple[float, float],
    orders: Mapping[str, float] | None = None,
    points: int = 101,
    modes: int | None = None,
    closed: Mapping[str, bool] | Sequence[bool] | bool | None = None,
) -> Campbell:
    """Compute the natural frequencies of a model over the excitation frequency, and its critical speeds.

    Parameters
    ----------
    model : Model
        Model. Its modes change with speed if its `System` has `SpeedTerms`.
    span : tuple of float
        First and last value of Omega.
    orders : dict of str to float, optional
        Ratio of the frequency of each order to Omega: 1 for the mesh, 1/z for the shaft of a gear with z teeth. By
        default `Model.orders`.
    points : int, optional
        Number P of frequencies; critical speeds are solved for between them. The default is 101.
    modes : int, optional
        Number of modes, the lowest first. By default all.
    closed : bool, sequence of bool or dict of str to bool, optional
        Elements in contact: one value for all elements, one for each, or by name, such as ``{"stop": True}``. An
        element in contact acts with the mean stiffness of its law beyond all breakpoints. By default, and for elements
        that are not named, contact and stiffness are taken from the static equilibrium at the lower end of the span.

    Returns
    -------
    Campbell
        Natural frequencies and critical speeds.

    Raises
    ------
    ValueError
        If the span is empty or outside of a table, an order is not positive, `closed` does not fit the elements, no
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
    >>> [round(speed.Omega, 4) for speed in hb.analysis.campbell(disc, (0.1, 3.0), {"shaft": 1.0}).critical]
    [0.7906, 1.5811]
    """
    first, last = float(span[0]), float(span[1])
    checked("campbell", "the start of the span", first, POSITIVE)
    checked("campbell", "the end of the span", last, Range(above=first))
    counted("points", points, 10_000, least=2)
    ratios = dict(model.orders if orders is None else orders)
    for name, order in ratios.items():
        checked("campbell", f"order '{name}'", order, POSITIVE)
    system = model.system()
    if system.n > _MAX_EIGENVALUE_COORDINATES:
        raise ValueError(
            f"campbell: the model has {system.n} coordinates, need at most {_MAX_EIGENVALUE_COORDINATES} to compute "
            "all modes; reduce the model with hb.mechanics.reduce"
        )
    if system.speed is not None and (first not in system.speed.range or last not in system.speed.range):
        raise ValueError(
            f"the span {first:g} to {last:g} exceeds the tables of the model: Omega must {system.speed.range}"
        )
    mode_count = system.n if modes is None else counted("modes", modes, system.n)
    stiffness = _element_stiffness(model, system, closed, (first, last))
    rotor = _Rotor(system, stiffness)
    Omega = np.linspace(first, last, points)
    mode_poles, mode_whirls = _track_modes(rotor, Omega)
    starts = [next(p.imag for p in column if np.isfinite(p)) for column in mode_poles]
    lowest = np.argsort(starts, kind="stable")[:mode_count]
    poles, whirl = (np.array([rows[i] for i in lowest]).T.reshape(points, -1) for rows in (mode_poles, mode_whirls))
    crossings = [
        crossing
        for name, ratio in ratios.items()
        for i in range(poles.shape[1])
        for crossing in _critical_speeds(rotor, Omega, poles[:, i], name, ratio, i + 1)
    ]
    with np.errstate(invalid="ignore"):
        damping = -poles.real / np.abs(poles)
    names = [e.name for e in system.elements]
    in_contact = tuple(name for name, row in zip(names, stiffness, strict=True) if row.any())
    opened = tuple(name for name, row in zip(names, stiffness, strict=True) if not row.any())
    critical = tuple(sorted(crossings, key=lambda speed: speed.Omega))
    return Campbell(Omega, poles.imag, damping, ratios, critical, scales(model, {}), whirl, in_contact, opened)


def _element_stiffness(
    model: Model, system: System, closed: Mapping[str, bool] | Sequence[bool] | bool | None, span: tuple[float, float]
) -> Array:
    """Return the stiffness of the elements, shape (m, m); diagonal but for laws of several displacements."""
    system.check_matrices()
    names = [e.name for e in system.elements]
    states: list[bool | None]
    if closed is None or isinstance(closed, Mapping):
        by_name = closed or {}
        for name in by_name:
            if name not in names:
                raise KeyError(f"campbell: closed: there is no element {quoted(name)}{did_you_mean(name, names)}")
        states = [by_name.get(name) for name in names]
    else:
        states = [*np.atleast_1d(np.asarray(closed, dtype=bool)).tolist()] * (1 if np.ndim(closed) else len(names))
    if len(states) != len(names):
        raise ValueError(f"closed has {len(states)} entries; need {len(names)}, one for each element")
    states = [
        False if state is None and _is_linear(e.law) else state
        for e, state in zip(system.elements, states, strict=True)
    ]
    if None not in states:
        return np.diag([_mean_slope(e.law, bool(state)) for e, state in zip(system.elements, states, strict=True)])
    static = _equilibrium_stiffness(model, span, [i for i, state in enumerate(states) if state is None], names)
    for i, (e, state) in enumerate(zip(system.elements, states, strict=True)):
        if state is not None:
            static[i] = 0.0
            static[i, i] = _mean_slope(e.law, state)
    return static


def _equilibrium_stiffness(
    model: Model, span: tuple[float, float], elements: Sequence[int], names: Sequence[str]
) -> Array:
    """Return the stiffness of all elements in the static equilibrium at the lower end of the span, shape (m, m).

    Warn if the contact of one of the numbered elements differs at the upper end.
    """
    with warnings.catch_warnings(action="ignore"):  # one harmonic is enough for a static equilibrium
        compiled = HarmonicBalance(model, 1).compiled({})
    first, last = (static_stiffness(compiled, Omega) for Omega in span)
    if first is None or last is None:
        raise ValueError(
            "campbell: no static equilibrium is found at the ends of the span; give the state of each element: "
            f"closed={{{', '.join(f'{names[i]!r}: True' for i in elements)}}}"
        )
    changed = [names[i] for i in elements if first[i].any() != last[i].any()]
    if changed:
        warnings.warn(
            f"{', '.join(changed)}: the contact changes between the static equilibria at Omega = {span[0]:g} and "
            f"{span[1]:g}; natural frequencies are computed with the contacts at {span[0]:g}; set them with closed=",
            stacklevel=4,
        )
    return first


def _is_linear(law: Law) -> bool:
    """Return whether the slope of a law is the same at all displacements, so that no static equilibrium is needed."""
    if law.breakpoints:
        return False
    d = np.array([-1.0, 0.0, 1.0, 1e3])
    slopes = law.force(d, np.zeros(4), np.zeros(4))[1]
    return bool((slopes == slopes[0]).all())


def _mean_slope(law: Law, closed: bool) -> float:
    """Return the mean slope of a law over a period at zero displacement, or beyond all breakpoints if it is closed."""
    if closed and isinstance(law, Component) and law.law.has_edges:
        return law.reference
    tau = 2 * np.pi * np.arange(_STIFFNESS_PHASES) / _STIFFNESS_PHASES
    outside = _CLOSED_DISTANCE_RATIO * max(1.0, *map(abs, law.breakpoints)) if closed and law.breakpoints else 0.0
    slopes = (
        law.force(np.full(_STIFFNESS_PHASES, d), np.zeros(_STIFFNESS_PHASES), tau)[1] for d in (outside, -outside)
    )
    return max(float(slope.mean()) for slope in slopes)


def whirl_word(whirl: float) -> str:
    """Return the whirl w of a mode, from -1 to 1, as a word; "-" for nan.

    Examples
    --------
    >>> whirl_word(0.9), whirl_word(-0.2), whirl_word(float("nan"))
    ('forward', 'backward', '-')
    """
    if math.isnan(whirl):
        return "-"
    if abs(whirl) < _MAX_PLANAR_WHIRL:
        return "planar"
    return "forward" if whirl > 0 else "backward"


class _Rotor:
    """Linear system with constant element stiffness: poles with positive frequency and mode shapes at any Omega."""

    def __init__(self, system: System, stiffness: Array) -> None:
        system.check_matrices()
        self.system, self.n = system, system.n
        W, dampers = system.W, np.array([e.damping for e in system.elements])
        M = dense(system.M)
        self.inverse = mass_basis(M) ** 2 if system.massless else np.linalg.inv(M)
        self.gyroscopic = _gyroscopic(system)
        scaled = None if self.gyroscopic is None else np.abs(self.inverse @ self.gyroscopic[1])
        self.gyroscopic_scale = 0.0 if scaled is None else float(scaled.max())
        self.element_matrices = W @ stiffness @ W.T, (W * dampers) @ W.T

    def modes(self, Omega: float) -> tuple[ComplexArray, ComplexArray, Array]:
        """Return poles (r,) with ascending frequency, mass-scaled unit shapes (n, r) and their whirl (r,)."""
        system, unit = self.system.at_speed(Omega), np.eye(self.n)
        K, C = (dense(A) + B for A, B in zip((system.K, system.C), self.element_matrices, strict=True))
        if system.massless:
            poles, V = massless_modes(system, dense(system.M), C, K, unit, unit)[:2]
        else:
            K, C = self.inverse @ K, self.inverse @ C
            rate = np.sqrt(np.abs(K).max()) or 1.0  # scales the velocities
            A = np.block([[np.zeros_like(K), rate * unit], [-K / rate, -C]])
            poles, V = scipy.linalg.eig(A)
        oscillating = np.flatnonzero(poles.imag > _MIN_OSCILLATION_RATIO * np.abs(poles).max(initial=0.0))
        oscillating = oscillating[np.argsort(poles[oscillating].imag, kind="stable")]
        whirl = self._whirl(V[: self.n, oscillating])
        shapes = V[: self.n, oscillating] / np.sqrt(np.abs(np.diag(self.inverse)))[:, None]
        return poles[oscillating], shapes / np.linalg.norm(shapes, axis=0), whirl

    def _whirl(self, shapes: ComplexArray) -> Array:
        """Return the whirl of mode shapes (n, r); nan where the gyroscopic terms do not act."""
        if self.gyroscopic is None:
            return np.full(shapes.shape[1], np.nan)
        G, absolute = self.gyroscopic
        signed = -np.einsum("ir,ij,jr->r", shapes.conj(), G, shapes).imag
        size = np.einsum("ir,ij,jr->r", shapes.conj(), absolute, shapes).real
        mass = np.einsum("ir,ij,jr->r", shapes.conj(), dense(self.system.M), shapes).real
        gyroscopic = size > _MIN_GYROSCOPIC_RATIO * self.gyroscopic_scale * np.abs(mass)
        return np.divide(signed, size, out=np.full(len(gyroscopic), np.nan), where=gyroscopic)

    def nearest_pole(self, Omega: float, guess: complex) -> tuple[complex, float]:
        """Return the pole at Omega that is nearest to a guess, and the whirl of its mode."""
        poles, _, whirl = self.modes(Omega)
        i = np.argmin(np.abs(poles - guess))
        return complex(poles[i]), float(whirl[i])


def _gyroscopic(system: System) -> tuple[Array, Array] | None:
    """Return sign(s) G and (G^T G)^(1/2), both (n, n); None without gyroscopic terms that change with speed."""
    speed = system.speed
    if speed is None or speed.gyroscopic is None or not speed.ratio:
        return None
    G = np.sign(speed.ratio) * dense(speed.gyroscopic)
    values, vectors = np.linalg.eigh(1j * G)  # G is skew-symmetric: i G is Hermitian, with real eigenvalues
    return G, ((vectors * np.abs(values)) @ vectors.conj().T).real


def _track_modes(rotor: _Rotor, Omega: Array) -> tuple[list[ComplexArray], list[Array]]:
    """Return poles (P,) and whirl (P,) of each mode that oscillates at any of the speeds; nan where it does not.

    Modes of adjacent speeds are assigned to each other by the smallest total of 1 - MAC + 4 d, with the modal assurance
    criterion MAC of the shapes and the relative distance d of the poles.
    """
    columns: list[ComplexArray] = []
    whirls: list[Array] = []
    last: list[tuple[complex, ComplexArray]] = []  # pole and shape of each mode at the last speed where it oscillates
    for p, w in enumerate(Omega.tolist()):
        poles, shapes, whirl = rotor.modes(w)
        column_of: dict[int, int] = {}
        if columns:
            previous = np.array([pole for pole, _ in last])
            assurance = np.abs(np.array([shape.conj() @ shapes for _, shape in last])) ** 2
            distance = np.abs(previous[:, None] - poles) / (np.abs(previous[:, None]) + np.abs(poles))
            if assurance.size == 1:  # without importing scipy.optimize, which takes half a second
                column_of = {0: 0}
            else:
                old, new = scipy.optimize.linear_sum_assignment(1 - assurance + 4 * distance)
                column_of = dict(zip(new.tolist(), old.tolist(), strict=True))
        for j, pole in enumerate(poles.tolist()):
            if j not in column_of:
                columns.append(np.full(len(Omega), np.nan, dtype=complex))
                whirls.append(np.full(len(Omega), np.nan))
                last.append((pole, shapes[:, j]))
                column_of[j] = len(columns) - 1
            columns[column_of[j]][p], last[column_of[j]] = pole, (pole, shapes[:, j])
            whirls[column_of[j]][p] = whirl[j]
    return columns, whirls


def _critical_speeds(
    rotor: _Rotor, Omega: Array, poles: ComplexArray, name: str, ratio: float, mode: int
) -> list[CriticalSpeed]:
    """Return the intersections of an order with a mode of known poles (P,)."""
    out = []
    difference = poles.imag - ratio * Omega
    for i in np.flatnonzero(difference[:-1] * difference[1:] <= 0).tolist():
        if difference[i + 1] == 0 and i + 2 < len(Omega):
            continue  # the next interval starts with this root

        def pole(w: float, i: int = i) -> tuple[complex, float]:
            fraction = (w - Omega[i]) / (Omega[i + 1] - Omega[i])
            return rotor.nearest_pole(w, complex(poles[i] + fraction * (poles[i + 1] - poles[i])))

        def frequency_difference(w: float, pole: object = pole) -> float:
            return pole(w)[0].imag - ratio * w  # type: ignore[operator]

        ends = float(Omega[i]), float(Omega[i + 1])
        if frequency_difference(ends[0]) * frequency_difference(ends[1]) > 0:
            continue
        root = find_root_bracketed(frequency_difference, *ends, 1e-15 * ends[1])
        eigenvalue, whirl = pole(root)
        out.append(CriticalSpeed(name, mode, root, eigenvalue.imag, -eigenvalue.real / (abs(eigenvalue) or 1.0), whirl))
    return out
