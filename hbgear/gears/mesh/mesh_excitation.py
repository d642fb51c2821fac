"""Mesh excitation of all gear models: mesh stiffness and transmission error over a mesh cycle.

    k(tau) = 1 - eps_scale sum_l eps_l cos(l tau - eps_lag_l)          or  m + eps_scale (stiffness(tau) - m)
    e(tau) = e_scale sum_l e_l cos(l tau - e_lag_l), or sin            or  e_scale error(tau)

m is the mean of ``stiffness``. The excitation is given by harmonic amplitudes or by functions of the phase, which may
have breakpoints and jumps. A tooth-resolved mesh is given by contacts, each with its own stiffness and initial gap over
the phase; they replace k(tau) and the backlash function.

With a fluctuating torque, or with errors of single teeth, Omega is the common frequency of mesh and shafts, and the
mesh has the order p: k(p tau) and e(p tau). The contacts of a mesh with errors of single teeth have a period of several
meshes, of which p is a multiple.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from math import pi
from typing import Any, Literal

import numpy as np

from hbgear.common.ranges import Range, counted
from hbgear.common.text.messages import quoted
from hbgear.mechanics.laws.laws import Backlash, Law, checked_contact
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.fourier import MOST_HARMONICS, Series, stretch, to_complex
from hbgear.mechanics.series.periodic import Periodic, Phased
from hbgear.mechanics.series.piecewise_polynomial import TURN
from hbgear.mechanics.structures.elements import Load
from hbgear.mechanics.structures.scales import Scales

SCALE_LABELS = {
    "eps_scale": r"factor of the stiffness amplitudes $\varepsilon_l$ [-]",
    "fluctuation_scale": "factor of the fluctuation [-]",
    "e_scale": r"factor of the error amplitudes $e_l$ [-]",
}
"""Labels of the factors of the excitation."""

USUAL_AMPLITUDES = {"eps": Range(-1, 1), "e": Range(-20, 20)}
"""Usual ranges of the amplitudes of the excitation."""


class MeshExcitation(Model):
    """Base class of models with these mesh excitation fields. A subclass may omit fields other than eps and e."""

    eps: tuple[float, ...] = ()
    e: tuple[float, ...] = ()
    phase: Literal["cos", "sin"] = "cos"
    eps_scale: float = 1.0
    e_scale: float = 1.0
    stiffness: Phased | None = None
    error: Phased | None = None
    contacts: MeshContacts | None = None
    eps_lag: tuple[float, ...] = ()
    e_lag: tuple[float, ...] = ()
    reference: tuple[float, ...] = ()
    mesh_order: int = 1
    fluctuation: Series | None = None
    fluctuation_scale: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        owner = type(self).__name__
        counted(f"{owner}: mesh_order", self.mesh_order, MOST_HARMONICS)
        if self.mesh_order > 1:
            low, high = type(self).default_span
            object.__setattr__(self, "default_span", (low / self.mesh_order, high / self.mesh_order))
            label = rf"$\Omega = \omega_\mathrm{{mesh}} / ({self.mesh_order}\,\omega_n)$ [-]"
            object.__setattr__(self, "labels", {**type(self).labels, "Omega": label})
        fields = {field.name for field in dataclasses.fields(self)}  # type: ignore[arg-type]
        for name in ("eps", "e"):
            object.__setattr__(self, name, amplitudes(owner, name, getattr(self, name)))
            if f"{name}_lag" in fields:
                lag = checked_lags(owner, name, getattr(self, name), getattr(self, f"{name}_lag"))
                object.__setattr__(self, f"{name}_lag", lag)
        check_mesh_stiffness(owner, self.stiffness, self.eps)
        if self.contacts is not None:
            self._check_contacts(owner)
        if "reference" in fields:
            object.__setattr__(self, "reference", amplitudes(owner, "reference", self.reference))
            scales_of(owner, self.reference)

    def _check_contacts(self, owner: str) -> None:
        """Raise an error if contacts are given together with another mesh stiffness."""
        if self.stiffness is not None or self.eps:
            raise ValueError(f"{owner}: contacts and a mesh stiffness are both given; give eps=() and no stiffness")
        check_contact_scale(owner, self.eps_scale, [self.contacts])
        meshes = self.contacts.meshes if self.contacts is not None else 1
        if self.mesh_order % meshes:
            raise ValueError(
                f"{owner}: the contacts have a period of {meshes} meshes, and mesh_order = {self.mesh_order} is not a "
                f"multiple of it; give mesh_order = {meshes}"
            )

    @property
    def parameters(self) -> dict[str, float]:
        """Float fields by name, without eps_scale for contacts."""
        return parameters_of_meshes(super().parameters, [self.contacts])

    def mesh_law(self, half_backlash: float) -> Law:
        """Return the force law of the mesh with a half backlash."""
        if self.contacts is None:
            return Backlash(b=half_backlash, stiffness=self.mesh_stiffness)
        return contacts_in_order(self.contacts, self.mesh_order).widened(half_backlash)

    @property
    def scales(self) -> Scales | None:
        return scales_of(type(self).__name__, self.reference, self.mesh_order)

    @property
    def mesh_names(self) -> tuple[str, ...]:
        """Names of the elements that are meshes."""
        return ("gap",)

    @property
    def orders(self) -> dict[str, float]:
        """Frequency of the mesh over Omega, if it differs from Omega."""
        return {"mesh": float(self.mesh_order)} if self.mesh_order > 1 else dict(super().orders)

    @property
    def mesh_stiffness(self) -> Phased:
        """Mesh stiffness over its mean, a function of the phase of Omega."""
        if self.stiffness is not None:
            return in_order(self.stiffness.varied(self.eps_scale), self.mesh_order)
        return in_order(mesh_stiffness(self.eps, self.eps_scale, self.eps_lag), self.mesh_order)

    @property
    def transmission_error(self) -> Phased:
        """Transmission error in half backlashes, a function of the phase of Omega."""
        if self.error is not None:
            return in_order(self.error.scaled(self.e_scale), self.mesh_order)
        return in_order(transmission_error(self.e, self.phase, self.e_scale, self.e_lag), self.mesh_order)

    def fluctuating_load(self, constant: Any, direction: Any) -> Load:
        """Return a load: a constant vector, and the fluctuation times the vector of its direction."""
        if self.fluctuation is None:
            return Load(constant=constant)
        row = (self.fluctuation_scale * self.fluctuation.row()).tolist()
        harmonics = [{k: x * np.asarray(direction) for k, x in enumerate(row[first::2], 1) if x} for first in (1, 2)]
        mean = np.asarray(constant) + row[0] * np.asarray(direction)
        return Load(constant=mean, cosine=harmonics[0], sine=harmonics[1])


def in_order(function: Phased, order: int, lag: float = 0.0) -> Phased:
    """Return f(order tau - lag) of a function f(tau)."""
    shifted: Phased = function.shifted(lag) if lag else function
    if order == 1:
        return shifted
    if isinstance(shifted, Series):
        c = to_complex(stretch(shifted.row(), order))
        return Series(shifted.mean, tuple(c.real[1:]), tuple(-c.imag[1:]))
    phases = [(phase + TURN * i) / order for i in range(order) for phase in shifted.phases]
    rows = [tuple(x * float(order) ** q for q, x in enumerate(row)) for row in shifted.coefficients] * order
    return Periodic(tuple(phases), tuple(rows))


def contacts_in_order(contacts: MeshContacts, order: int, lag: float = 0.0) -> MeshContacts:
    """Return contacts whose mesh has the phase order tau - lag; the order is a multiple of their number of meshes."""
    meshes = contacts.meshes
    if order == meshes and not lag:
        return contacts
    times = order // meshes
    return contacts.turned(lambda function: in_order(function, times, lag / meshes), times)


def check_contact_scale(owner: str, eps_scale: float, contacts: Sequence[MeshContacts | None]) -> None:
    """Raise an error if the stiffness amplitudes of contacts are scaled, which have none."""
    if eps_scale != 1.0 and any(mesh is not None for mesh in contacts):
        raise ValueError(
            f"{owner}: eps_scale = {eps_scale:g} has no meaning for contacts, whose stiffness is that of the pairs of "
            "teeth: give 1, or a mean-mesh model (mesh='tangent')"
        )


def parameters_of_meshes(parameters: dict[str, float], contacts: Sequence[MeshContacts | None]) -> dict[str, float]:
    """Return the parameters of a model without eps_scale if a mesh has contacts, see `check_contact_scale`."""
    if all(mesh is None for mesh in contacts):
        return parameters
    return {name: value for name, value in parameters.items() if name != "eps_scale"}


def check_mesh_stiffness(owner: str, stiffness: Phased | None, eps: tuple[float, ...]) -> None:
    """Raise an error if a given mesh stiffness is not valid; None is valid.

    Raises
    ------
    ValueError
        If it is not positive, or amplitudes eps are given as well.
    """
    if stiffness is not None:
        checked_contact(owner, stiffness)
        if eps:
            raise ValueError(f"{owner}: eps = {quoted(eps)} and a stiffness are both given; keep one, eps=() the other")


def amplitudes(owner: str, name: str, values: Any) -> tuple[float, ...]:
    """Return harmonic amplitudes as a tuple of floats; entry 0 is for l = 1.

    Raises
    ------
    ValueError
        If ``values`` is not a sequence of finite numbers, or too long for a `Series`.
    """
    try:
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise TypeError
        out = tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{owner}: {name} = {values!r} must be a sequence of numbers such as (0.1, 0.05)") from None
    if not np.all(np.isfinite(out)):
        raise ValueError(f"{owner}: {name} = {values!r} has entries that are not finite")
    counted(f"{owner}: number of entries of {name}", len(out), MOST_HARMONICS, least=0)
    return out


def lagged_series(values: tuple[float, ...], lag: tuple[float, ...], mean: float = 0.0) -> Series:
    """Return mean + sum_l values[l-1] cos(l tau - lag[l-1]); the phase lags [rad] are () for none."""
    if not lag:
        return Series(mean, values)
    c = np.asarray(values) * np.exp(1j * np.asarray(lag))
    return Series(mean, tuple(c.real), tuple(c.imag))


def checked_lags(owner: str, name: str, values: tuple[float, ...], lag: Any) -> tuple[float, ...]:
    """Return phase lags as a tuple of floats, one for each amplitude or ().

    Raises
    ------
    ValueError
        If the number of lags differs from zero and from the number of amplitudes.
    """
    out = amplitudes(owner, f"{name}_lag", lag)
    if out and len(out) != len(values):
        raise ValueError(
            f"{owner}: {name}_lag has {len(out)} entries and {name} has {len(values)}: give one lag for "
            "each amplitude, or () for none"
        )
    return out


def transmission_error(e: tuple[float, ...], phase: str, scale: float, lag: tuple[float, ...]) -> Series:
    """Return e(tau) = scale sum_l e[l-1] cos(l tau - lag[l-1]), or sin; the phase lags [rad] are () for none."""
    if phase == "cos" or not lag:
        return (lagged_series(e, lag) if phase == "cos" else Series(sine=e)).scaled(scale)
    return lagged_series(e, tuple(x + pi / 2 for x in lag)).scaled(scale)


def mesh_stiffness(eps: tuple[float, ...], scale: float = 1.0, lag: tuple[float, ...] = ()) -> Series:
    """Return k(tau) = 1 - scale sum_l eps[l-1] cos(l tau - lag[l-1]); the phase lags [rad] are () for none."""
    return lagged_series(tuple(-scale * amplitude for amplitude in eps), lag, 1.0)


def scales_of(owner: str, reference: tuple[float, ...], mesh_order: int = 1) -> Scales | None:
    """Return the `Scales` of a field ``reference``, or None for ().

    ``reference`` holds omega_n [rad/s], b_c [m], k_mean b_c [N] and the number of teeth of the pinion; ``mesh_order``
    is the frequency of the mesh over Omega.

    Raises
    ------
    ValueError
        If it is not empty and does not have four positive numbers.
    """
    if not reference:
        return None
    if len(reference) != 4 or not all(x > 0 for x in reference):
        raise ValueError(
            f"{owner}: reference = {reference!r} must be omega_n [rad/s], b_c [m], k_mean b_c [N] and the "
            "number of teeth of the pinion, all positive; or ()"
        )
    return Scales(*reference, mesh_order)
