"""Branch: a traced curve of solutions, with its special points and jumps.

    point i:  parameter = values[i],  unknowns X[i], which the layout of the problem describes (`LayoutProtocol`)

A point is stable if none of its multipliers lies outside the unit circle. Saving, loading and plotting need no problem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.deprecation import renamed_attributes
from hbgear.common.facade import call
from hbgear.common.ranges import counted
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch_data import BranchData
from hbgear.continuation.results.facade import BranchFacade
from hbgear.continuation.results.point import (
    LANDINGS,
    MAX_DERIVATIVE,
    Jump,
    Point,
    dof_index,
    measured,
    require_layout,
    rows_of_dof,
)
from hbgear.continuation.results.reliability import branch_warnings


@renamed_attributes(doubts="warnings", verdicts="stability", recorded="full_motion")
@dataclass(frozen=True, eq=False, repr=False)
class Branch(BranchData, BranchFacade):
    """A curve of P solutions in one parameter.

    Attributes
    ----------
    parameter : str
        Name of the parameter that was varied.
    values : ndarray, shape (P,)
        Its values.
    X : ndarray, shape (P, n)
        Unknowns of each point, which `layout` describes.
    fixed : dict of str to float
        The parameters that were constant.
    tracked : dict of str to ndarray, shape (P,)
        The other parameters that vary along the branch.
    multipliers : ndarray of complex, shape (P, r), or None
        Multipliers of each point, of large structures the 32 largest of the modes that stability considers, followed
        by zeros. None if they were not computed, nan where the computation failed.
    iterations : ndarray of int, shape (P,)
        Number of iterations of the corrector.
    residual : ndarray, shape (P,)
        Relative residual.
    regime : ndarray of int8, shape (P, m)
        Regime code of each element, a position in ``layout.regimes``.
    error : ndarray, shape (P,)
        Estimated error of each solution.
    step : ndarray, shape (P,)
        Size of the step to each point, in scaled arclength.
    special : tuple of SpecialPoint
        Special points in the order of the branch.
    jump_records : tuple of Jump
        Jumps of slow sweeps; see `jumps`.
    status : Status
        Reason why the trace ended.
    message : str
        The same in one sentence.
    layout : LayoutProtocol or None
        Description of the unknowns.
    meta : dict
        Versions, model and settings in JSON types. ``{"asymptotes": {"last": value}}`` gives the parameter value at
        which the solutions grow without bound beyond the last (or the first) point.
    problem : object or None
        Problem that was traced. Files do not store it.
    others : tuple of Branch
        Other curves that cover the rest of the span; see ``cover`` of `trace`.
    modulus_error : ndarray, shape (P,)
        Estimated difference of the largest modulus of the multipliers from that of the nearest true motion, nan where
        the modulus is far from 1. Next to a fold the true motion at the same parameter may differ by more.
    full_motion : FullMotion or None
        All coordinates, read from a file whose model cannot be rebuilt.

    Raises
    ------
    ValueError
        If an array does not have P entries, or two special points have the same label.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> curve.message
    'Omega = 1.6 reached'
    >>> curve.values.shape == curve.stable.shape == curve.amplitude("pp2").shape
    True
    >>> curve.special[0]
    <LP1 at Omega = 1.10338, at its stability limit, no_impact>
    """

    others: tuple[Branch, ...] = ()

    @property
    def curves(self) -> tuple[Branch, ...]:
        """All curves of the span: this one, and `others`.

        Figures and tables count them from 1.
        """
        return (self, *self.others)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons why the branch is not reliable everywhere, or stopped early.

        Empty if there are no such reasons, or if its errors are unknown.
        """
        stopped = () if self.status.complete else (f"{self.status.in_words}: {self.message}",)
        return (*stopped, *branch_warnings(self))

    @checked_arguments()
    def jumps(self, landing: str | Lander | None = None, others: Sequence[Branch] = ()) -> tuple[Jump, ...]:
        """Return the jumps of slow sweeps along the branch.

        Jumps of the other curves of the span are not included. The jumps of all curves are
        ``[jump for curve in branch.curves for jump in curve.jumps()]``.

        Parameters
        ----------
        landing : {"nearest", "integrate"} or callable, optional
            How the solution after a jump is chosen. "nearest" takes the stable solution with the smallest distance
            from the one before, independent of the phase. "integrate" integrates in time from just beyond the jump to
            the steady state; see `hbgear.time.jump_integration`. A function ``(branch, others) -> branch`` returns a
            branch whose jumps have landings. By default the choice of the branch is kept, which is "nearest" at first.
        others : sequence of Branch, optional
            Further branches on which the integration may end.

        Returns
        -------
        tuple of Jump
            The jumps in the order of the branch.

        Raises
        ------
        ValueError
            If `landing` is unknown, or the problem that the integration needs is unknown.
        """
        if callable(landing):
            return landing(self, others).jump_records
        if landing not in (None, *LANDINGS):
            raise ValueError(f"landing = {quoted(landing)}: choose one of {', '.join(map(quoted, LANDINGS))}")
        if landing == "integrate":
            integrated: Branch = call("hbgear.time.jump_integration.integrate_jumps", self, others)
            return integrated.jump_records
        return self.jump_records

    @checked_arguments()
    def amplitude(
        self, measure: str = "rms", element: int | str = 0, dof: int | str | None = None, derivative: int = 0
    ) -> Array:
        """Return a measure of amplitude of each point.

        Parameters
        ----------
        measure : str, optional
            "rms" (default), "pp2", "max", "mean", "H1", "H2", ...; see `Point.amplitude`.
        element : int or str, optional
            Index or name of the element. The default is 0.
        dof : int or str, optional
            Index or name of a degree of freedom, which is used instead of the element. Files store the data that this
            needs, except for large models that hbgear cannot rebuild: these need the problem of the branch.
        derivative : int, optional
            0 for displacement (default), 1 for velocity, 2 for acceleration, in time.

        Returns
        -------
        ndarray, shape (P,)
            Values of the measure.

        Raises
        ------
        ValueError
            If the measure does not exist, or the problem is needed but unknown.
        KeyError
            If the element or degree of freedom does not exist.
        """
        return _amplitudes(self, measure, element, dof, derivative)

    @checked_arguments()
    def amplitude_error(
        self, measure: str = "rms", element: int | str = 0, dof: int | str | None = None, derivative: int = 0
    ) -> Array:
        """Return the estimated error of `amplitude`: its change if the number of harmonics is doubled.

        Each call computes the refined branch. For several measures compare with `refined` instead.

        Parameters
        ----------
        measure : str, optional
            Name of the measure. The default is "rms".
        element : int or str, optional
            Index or name of the element. The default is 0.
        dof : int or str, optional
            Index or name of a degree of freedom, which is used instead of the element.
        derivative : int, optional
            Order of the derivative in time. The default is 0.

        Returns
        -------
        ndarray, shape (P,)
            Estimated errors, nan for points without a solution at the higher resolution.

        Raises
        ------
        ValueError, KeyError
            For the reasons of `amplitude` and `refined`.

        Examples
        --------
        >>> import hbgear as hb
        >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.0))
        >>> bool(curve.amplitude_error("max").max() < 1e-3)
        True
        """
        coarse = self.amplitude(measure, element, dof, derivative)
        fine = self.refined().amplitude(measure, element, dof, derivative)
        return np.abs(fine - coarse)

    @checked_arguments()
    def peak(self, measure: str = "rms", element: int | str = 0) -> Point:
        """Return the point with the largest amplitude.

        Parameters
        ----------
        measure : str, optional
            Name of the measure. The default is "rms".
        element : int or str, optional
            Index or name of the element. The default is 0.

        Returns
        -------
        Point
            One of the points of the branch. `hbgear.analysis.peaks` locates peaks between points.
        """
        return self[int(np.nanargmax(self.amplitude(measure, element)))]


Lander: TypeAlias = Callable[[Branch, Sequence[Branch]], Branch]
"""Type of a function that returns a branch whose jumps have landings."""


def _amplitudes(
    branch: BranchData, measure: str, element: int | str, dof: int | str | None = None, derivative: int = 0
) -> Array:
    """Return a measure of amplitude (P,) of each point; see `Branch.amplitude`."""
    counted("derivative", derivative, MAX_DERIVATIVE, least=0)
    layout = require_layout(branch.layout)
    coefficients = layout.rows(branch.X, element) if dof is None else _coefficients_of_dof(branch, dof)
    parameters = [branch.parameters_at(i) for i in range(len(branch))] if derivative else []
    return measured(layout, measure, coefficients, parameters, derivative)


def _coefficients_of_dof(branch: BranchData, dof: int | str) -> Array:
    """Return the coefficients of a degree of freedom, (P, ...), from the file or from the problem."""
    stored = branch.full_motion if branch.problem is None else None
    if stored is not None and len(stored.rows) == len(branch):
        return stored.rows[:, dof_index(dof, stored.names)]
    problem = branch.require_problem()
    return rows_of_dof(problem, dof, branch.X, [branch.parameters_at(i) for i in range(len(branch))])
