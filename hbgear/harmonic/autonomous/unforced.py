"""Models without periodic excitation: mean loads, mean stiffness, mean prescribed displacements.

M q'' + C q' + K q + sum_j w_j [p_j(d_j, d_j') + c_j d_j'] = F_0,   d_j = w_j^T q - e_0j
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Self

import numpy as np

from hbgear.common.ranges import Range
from hbgear.mechanics.laws.laws import Law, Parallel
from hbgear.mechanics.models import Element, Load, Model, System
from hbgear.mechanics.series.fourier import Series


class Unforced(Model):
    """A model without its periodic excitation, at any of its parameters.

    Parameters
    ----------
    model : Model
        The model.
    """

    def __init__(self, model: Model) -> None:
        self.model = model

    def __repr__(self) -> str:
        return f"Unforced({self.model!r})"

    @property
    def parameters(self) -> dict[str, float]:
        return self.model.parameters

    @property
    def entries(self) -> dict[str, float]:
        return self.model.entries

    @property
    def ranges(self) -> Mapping[str, Range]:  # type: ignore[override]
        """Ranges of the parameters of the model."""
        return self.model.ranges

    @property
    def labels(self) -> Mapping[str, str]:  # type: ignore[override]
        """Labels of the model."""
        return self.model.labels

    def replace(self, /, **changes: float) -> Self:
        return type(self)(self.model.replace(**changes))

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
            "motions need a law that is constant in time, such as that of the mean mesh, model(mesh='tangent')"
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
