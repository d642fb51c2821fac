"""Periodic motions in contact instants: the second discretisation of models with piecewise-linear laws.

    x_{i+1} = Psi_i x_i + ...,   h(tau_i) = 0          states and phases at the contact instants, see `instants`

There is no truncation: the only tolerance is rounding. Points of a branch hold the exact Fourier coefficients of the
elements up to H, so that measures, files and figures are the same as with `HarmonicBalance`. H has no influence on the
curve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.instants.corrector import CurveState, Family
from hbgear.harmonic.instants.equations import Equations, EquationsAt
from hbgear.harmonic.instants.following import ExactCurve, Follower
from hbgear.harmonic.instants.refine import Approximation, ExactMotion, initial, solve
from hbgear.harmonic.instants.results import build_exact_branch
from hbgear.harmonic.instants.spectrum import coefficients
from hbgear.harmonic.stability.exact_motion import refine_motion
from hbgear.mechanics.models import Model
