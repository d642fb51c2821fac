"""Additions to a finished branch: errors of reduced structures and of reduced stability, warnings.

A structure with many modes is reduced for the frequencies of a curve, and its stability is computed from the modes that
the stiffness of the elements excites. Both errors are estimated once per branch and stored in ``branch.meta``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.multipliers.floquet import is_reduced
from hbgear.harmonic.multipliers.floquet import reduction as stability_reduction
from hbgear.harmonic.structure.measured import STABILITY_NOT_AVAILABLE, MeasuredStructure
from hbgear.mechanics.plausibility import check_gaps, check_sliders, check_truncation
from hbgear.mechanics.reduction import Reduction


def postprocess(problem: Any, branch: Branch, observed: Sequence[Mapping[str, Any]]) -> Branch:
    """Return a branch of a `HarmonicBalance` with the errors of its reductions.

    Warn if automatic harmonics leave points above the tolerance, if no motion comes near a breakpoint of a law, or if
    no friction slider slips.
    """
    if problem.auto:
        _warn_of_truncation(problem, branch)
    branch = _with_structure_error(branch, problem.models.reduction(branch.fixed))
    if not observed:
        return branch
    clearances = [entry["clearance"] for entry in observed if "clearance" in entry]
    if branch.parameter == "Omega" and branch.status.complete and problem.pins is None:
        check_gaps(problem.clearance_names, np.array(clearances))
        check_sliders(problem.slider_names, np.array([entry["slip"] for entry in observed if "slip" in entry]))
    evaluator = problem.compiled(branch.fixed)
    return _with_stability_error(branch, evaluator)


def _warn_of_truncation(problem: Any, branch: Branch) -> None:
    above = np.flatnonzero(branch.error > problem.tolerance)
    if above.size:
        check_truncation(problem.tolerance, problem.H, branch.parameter, branch.values[above], branch.error[above])


def _with_structure_error(branch: Branch, reduction: tuple[Reduction, float] | None) -> Branch:
    """Return the branch with the numbers of modes and the error of the receptances."""
    if reduction is None:
        return branch
    structure, error = reduction
    entry = {"modes": structure.system.n, "of": structure.full.n, "error": error}
    return replace(branch, meta={**branch.meta, "structure": entry})


def _with_stability_error(branch: Branch, evaluator: Evaluator) -> Branch:
    """Return the branch with the error of the multipliers of its largest motion that truncated modes cause."""
    if isinstance(evaluator.structure, MeasuredStructure):
        return replace(branch, meta={**branch.meta, "stability": STABILITY_NOT_AVAILABLE})
    if branch.parameter != "Omega" or branch.multipliers is None or not is_reduced(evaluator):
        return branch
    largest = np.argsort(-np.linalg.norm(branch.X, axis=1))[:1]
    entry = stability_reduction(evaluator, np.ascontiguousarray(branch.X[largest]), branch.values[largest])
    return replace(branch, meta={**branch.meta, "stability": entry})
