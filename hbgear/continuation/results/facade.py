"""Facade of `Branch`: files, tables, data frames and notebooks, one line each.

The functions live in `hbgear.io`, `hbgear.plot` and `hbgear.continuation.curve.refinement`; see `hbgear.common.facade`.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.facade import call

if TYPE_CHECKING:
    import pandas
    import xarray

    from hbgear.continuation.results.point import Point


class BranchFacade:
    """Methods of a branch that other packages implement."""

    def _repr_html_(self) -> str:
        """Return a summary, the jumps and the figure, for notebooks."""
        return call("hbgear.plot.notebook.branch_html", self)

    @checked_arguments()
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an .npz file with a JSON header; `load` returns the same numbers.

        The file is replaced only after it was written completely.
        """
        call("hbgear.io.branches.npz.save", self, path)

    @checked_arguments()
    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a table of the points (.csv), or all arrays for MATLAB and Octave (.mat).

        A .csv file begins with lines "# name = text" that describe the curve and its columns; ``explained`` of a .mat
        file describes its variables.
        """
        call("hbgear.io.branches.tables.export", self, path)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the columns of the .csv as a pandas DataFrame, including the other curves of the span.

        Its ``attrs`` describe the curve, and hold ``units`` and ``long_names`` by column. Needs ``hbgear[data]``.

        Raises
        ------
        ValueError
            If pandas is not installed.
        """
        return call("hbgear.io.branches.frames.to_dataframe", self)

    def to_xarray(self) -> xarray.Dataset:
        """Return an xarray Dataset with named dimensions, units and long names; ``.to_netcdf(path)`` writes it.

        Dimensions are point, element, term (a0, a1, b1, ...), measure and multiplier; the parameter is a coordinate of
        the points. ``curve.to_xarray().amplitude.sel(measure="pp2")``. Needs ``hbgear[data]``.

        Raises
        ------
        ValueError
            If xarray is not installed.
        """
        return call("hbgear.io.branches.frames.to_xarray", self)

    @checked_arguments()
    def at(self, value: float) -> tuple[Point, ...]:
        """Return all solutions of the branch and of the other curves of its span at a value of the parameter.

        The solutions between two points are computed by Newton's method, with their multipliers.

        Parameters
        ----------
        value : float
            Value of the parameter.

        Returns
        -------
        tuple of Point
            Solutions in the order of the curves, stable and unstable.

        Raises
        ------
        ValueError
            If no curve reaches the value, or the problem is unknown.

        Examples
        --------
        A gear pair has three motions at one speed, of which two are stable:

        >>> import hbgear as hb
        >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.3, 0.6))
        >>> [(round(float(point.amplitude("rms")), 3), point.stability) for point in curve.at(0.8)]
        [(0.202, 'stable'), (0.124, 'unstable'), (0.061, 'stable')]
        """
        return call("hbgear.continuation.tracing.jumps.points_at", self, value)

    def refined(self) -> Any:
        """Return the branch with twice the harmonics: each point is replaced by the nearest solution.

        The parameter of a point may change slightly. Measures, regimes, contact instants and multipliers are those of
        the more accurate motions; their differences estimate the error of this branch (`amplitude_error`). Points
        without a solution at the higher resolution are nan.

        Raises
        ------
        ValueError
            If the branch has no problem, is a curve of special points, or has the largest number of harmonics.

        Examples
        --------
        >>> import hbgear as hb
        >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.0, 0.8))
        >>> better = curve.refined()
        >>> better.layout.harmonics, len(better) == len(curve), bool(better.error.max() < curve.error.max())
        (16, True, True)
        """
        return call("hbgear.continuation.curve.refinement.refine_branch", self)
