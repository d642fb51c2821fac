"""Coefficients of the equations of motion as exact decimals, the input of a proof.

    M q'' + C q' + K q + sum_j w_j [c_j d_j' + sum_i k_i(tau) g_i(d_j)] = sum_l Omega^p_l F_l(tau)
    d_j = w_j^T q - e_j(tau)

A binary number stands for a decimal: .05 is not representable, its shortest decimal is. All coefficients are written as
shortest decimals. A proof refers to the equations with exactly these decimals.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from hbgear.analysis.certificates.conditions import NotCertifiedError
from hbgear.harmonic.instants.equations import Equations
from hbgear.mechanics.laws.laws import PiecewiseLinear
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Periodic, Phased
from hbgear.mechanics.structures.elements import Element, Load

MAX_CERTIFIED_COORDINATES = 12
"""Largest number of coordinates: ball arithmetic of larger matrices takes minutes."""


def decimal(x: float) -> str:
    """Return the shortest decimal of a number."""
    return repr(float(x))


def coefficients_of(equations: Equations) -> dict[str, Any]:
    """Return the coefficients of a system with piecewise-linear laws as plain data; numbers are strings.

    They are M, C, K, elements, loads, sections (phases of breakpoints of the stiffness) and nu. NotCertifiedError is
    raised if the system has terms for which there is no proof.
    """
    system = equations.system
    _require_provable(system)
    sections = [decimal(x) for x in equations.starts] if any(e.law.phases for e in system.elements) else []
    return {
        "M": _matrix(system.M),
        "C": _matrix(system.C),
        "K": _matrix(system.K),
        "elements": [_element(e, equations.parallel(j)) for j, e in enumerate(system.elements)],
        "loads": [_load(load) for load in system.loads],
        "sections": sections,
        "nu": equations.nu,
    }


def _require_provable(system: System) -> None:
    """Raise an error for terms for which there is no proof."""
    reason = ""
    if system.speed is not None:
        reason = "the structure depends on speed"
    elif system.n > MAX_CERTIFIED_COORDINATES:
        reason = f"the model has {system.n} coordinates; at most {MAX_CERTIFIED_COORDINATES}"
    for element in system.elements:
        if isinstance(element.displacement, Periodic):
            reason = f"the displacement of {element.name} has breakpoints"
        phases = {x for spring in element.law.piecewise or () for x in getattr(spring.stiffness, "phases", ())}
        if phases != set(element.law.phases):
            reason = f"the stiffness of {element.name} has breakpoints without a jump"
    if reason:
        raise NotCertifiedError("model", f"{reason}: no proof is available for it")


def _matrix(A: Any) -> list[list[str]]:
    """Return a matrix as decimals."""
    dense = np.asarray(A.toarray() if hasattr(A, "toarray") else A, dtype=float)
    return [[decimal(x) for x in row] for row in dense]


def _element(element: Element, parallel: Sequence[Element]) -> dict[str, Any]:
    """Return an element as plain data, with the springs and dampers of the given elements ``parallel`` to it."""
    return {
        "name": element.name,
        "direction": [decimal(x) for x in np.asarray(element.direction, dtype=float)],
        "damping": str(sum((Decimal(decimal(e.damping)) for e in parallel), Decimal(0))),
        "displacement": _phased(element.displacement),
        "springs": [_spring(spring) for e in parallel for spring in e.law.piecewise or ()],
        "breakpoints": [decimal(x) for x in element.law.breakpoints],
    }


def _spring(spring: PiecewiseLinear) -> dict[str, Any]:
    """Return a spring as plain data."""
    return {
        "corners": [decimal(x) for x in spring.corners],
        "slopes": [decimal(x) for x in spring.slopes],
        "force_at_zero": decimal(spring.force_at_zero),
        "stiffness": _phased(spring.stiffness),
    }


def _phased(function: Phased) -> dict[str, Any]:
    """Return a function of the phase as plain data."""
    if isinstance(function, Series):
        return {
            "mean": decimal(function.mean),
            "cosine": [decimal(x) for x in function.cosine],
            "sine": [decimal(x) for x in function.sine],
        }
    return {
        "phases": [decimal(x) for x in function.phases],
        "coefficients": [[decimal(x) for x in row] for row in function.coefficients],
    }


def _load(load: Load) -> dict[str, Any]:
    """Return a load as plain data."""
    constant = [] if load.constant is None else [decimal(x) for x in np.asarray(load.constant)]
    tables = {
        name: {str(order): [decimal(x) for x in np.asarray(vector)] for order, vector in table.items()}
        for name, table in (("cosine", load.cosine), ("sine", load.sine))
    }
    return {"power": load.power, "constant": constant, **tables}
