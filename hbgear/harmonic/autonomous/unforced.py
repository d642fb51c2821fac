"""Models without periodic excitation: mean loads, mean stiffness, mean prescribed displacements.

M q'' + C q' + K q + sum_j w_j [p_j(d_j, d_j') + c_j d_j'] = F_0,   d_j = w_j^T q - e_0j
"""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np

from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.structure.derived_model import DerivedModel
from hbgear.mechanics.laws.laws import Law, Parallel
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.plausibility import ImplausibleInputWarning
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.structures.elements import Element, Load


class Unforced(DerivedModel):
    """A model without its periodic excitation, at any of its parameters."""

    def system(self) -> System:
        """Return the system of the model with mean loads, mean displacements and mean stiffness.

        Raises
        ------
        ValueError
            If a law depends on the phase and has no mean, or the structure depends on Omega or has no matrices.
        """
        system = self.model.system()
        if system.speed is not None or system.receptances is not None:
            kind = "depends on Omega" if system.speed is not None else "is measured"
            raise ValueError(
                f"the structure {kind}: free motions need constant matrices M, C and K; give a System at one speed"
            )
        constant = sum(
            (np.asarray(load.constant) for load in system.loads if load.constant is not None), np.zeros(system.n)
        )
        elements = [_unforced_element(element) for element in system.elements]
        return dataclasses.replace(system, elements=elements, load=Load(constant=constant))


def _unforced_element(element: Element) -> Element:
    """Return an element with a constant prescribed displacement and a law that does not depend on the phase."""
    mean = float(element.displacement.mean)
    return dataclasses.replace(element, law=_mean_law(element.law, element.name), displacement=Series(mean=mean))


def _mean_law(law: Law, name: str) -> Law:
    """Return a law with its mean stiffness over the phase; itself if it does not depend on the phase."""
    if law.steady or not _depends_on_phase(law):
        return law
    if law.piecewise is None:
        raise ValueError(
            f"the law of element '{name}' varies with the phase of the excitation, and its mean is not known: free "
            "motions need a law that is constant in time, such as that of the mean mesh: model(mesh='tangent'), in a "
            'file mesh_model = "tangent"'
        )
    springs = tuple(dataclasses.replace(s, stiffness=Series(mean=float(s.stiffness.mean))) for s in law.piecewise)
    return springs[0] if len(springs) == 1 else Parallel(springs)


_TRIAL_PHASES = np.linspace(0.1, 6.2, 17)
"""Phases [rad] at which a law is compared; they are not multiples of a common fraction of the period."""


def _depends_on_phase(law: Law) -> bool:
    """Return whether the force of a law differs between phases, at displacements of both signs."""
    if law.piecewise is not None:
        return any(spring.stiffness.varies for spring in law.piecewise)
    reach = max([1.0, *(2 * abs(x) for x in law.breakpoints)])
    d, tau = (x.ravel() for x in np.meshgrid(reach * np.linspace(-1.0, 1.0, 9), _TRIAL_PHASES))
    force = np.reshape(law.force(d, 0.3 * d, tau)[0], (len(_TRIAL_PHASES), -1))
    return bool(np.ptp(force, axis=0).max() > 0)


def unforced_balance(model: Model, harmonics: int, reduce: bool = False) -> HarmonicBalance:
    """Return the harmonic balance of a model without its periodic excitation; by default with the whole structure.

    Raises
    ------
    ValueError
        If the whole structure is too large for dense matrices, or as of `Unforced.system`.
    """
    # a model without excitation is intended here
    with warnings.catch_warnings(action="ignore", category=ImplausibleInputWarning):
        balance = HarmonicBalance(Unforced(model), harmonics, reduce=reduce)
    structure = balance.compiled({}).structure
    if structure.large and not reduce:
        raise ValueError(
            f"{structure.n} coordinates are too many for free motions: reduce the model first, "
            "hb.mechanics.reduce(model, modes=60)"
        )
    return balance
