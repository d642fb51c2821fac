"""Pseudo-arclength continuation of solutions of R(X, p) = 0, and their special points."""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _lazy

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.common.process.progress import Progress, ProgressCallback
    from hbgear.continuation.augmented.branch_point import BranchPointProblem
    from hbgear.continuation.augmented.fold import FoldProblem
    from hbgear.continuation.events.registry import register_event
    from hbgear.continuation.problem.adapter import as_problem
    from hbgear.continuation.problem.base import ContinuationProblem
    from hbgear.continuation.problem.evaluation import Evaluation

__all__ = [
    "BranchPointProblem",
    "ContinuationProblem",
    "Evaluation",
    "FoldProblem",
    "Progress",
    "ProgressCallback",
    "as_problem",
    "register_event",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _lazy.attached(__name__)
