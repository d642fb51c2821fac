"""Points of a branch: solutions, special points, and the jumps of slow sweeps."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.deprecation import renamed_attributes
from hbgear.common.ranges import counted
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.results.layout import LayoutProtocol, ReconstructsMotion, neutral_regime_of
from hbgear.continuation.results.stability import (
    MAX_MULTIPLIER_DEVIATION,
    STABILITY_CHANGING_KINDS,
    stability_codes,
    stability_names,
)

MAX_DERIVATIVE = 10
"""Largest order of a derivative in time. Displacement, velocity, acceleration and jerk are orders 0 to 3."""

LANDINGS = ("nearest", "integrate")
"""Methods by which the solution after a jump is chosen; values of `Jump.landing`."""


BIFURCATING = "bifurcating"
"""Value of `Jump.landing` where the sweep does not jump but continues on a bifurcating branch."""


def require_layout(layout: LayoutProtocol | None) -> LayoutProtocol:
    """Return the layout of the unknowns; raise ValueError if it is None."""
    if layout is None:
        raise ValueError("the problem does not describe its unknowns (layout is None); use X directly")
    return layout


def name_of_regime(codes: NDArray[np.int8], layout: LayoutProtocol | None) -> str:
    """Return the name of the most severe regime of elements, "unknown" if all codes are -1."""
    worst = int(np.max(codes, initial=-1))
    names = layout.regimes if layout else ()
    return names[min(worst, len(names) - 1)] if worst >= 0 and names else "unknown"


def dof_index(dof: int | str, names: Sequence[str]) -> int:
    """Return the index of a degree of freedom, given by index or name; KeyError if the model does not have it."""
    if isinstance(dof, str):
        if dof not in names:
            raise KeyError(f"the model has no degree of freedom '{dof}'{did_you_mean(dof, list(names))}")
        return list(names).index(dof)
    if not 0 <= dof < len(names):
        raise KeyError(f"the model has no degree of freedom {dof}; there are {len(names)}, from 0")
    return dof


def rows_of_dof(problem: Any, dof: int | str, X: Array, parameters: Sequence[Mapping[str, float]]) -> Array:
    """Return the coefficients (P, ...) of a degree of freedom, by index or name, in P solutions X (P, n).

    They are ``(a0, a1, b1, ..., aH, bH)`` for harmonic balance. ValueError is raised if the problem has no degrees of
    freedom, KeyError if the model does not have this one.
    """
    if not isinstance(problem, ReconstructsMotion):
        raise ValueError(f"dof={dof!r} needs a problem with degrees of freedom; {type(problem).__name__} has none")
    i = dof_index(dof, problem.dof_names)
    return np.array([problem.motion(x, **p)[i] for x, p in zip(X, parameters, strict=True)])


def measured(
    layout: LayoutProtocol, measure: str, rows: Array, parameters: Sequence[Mapping[str, float]], derivative: int
) -> Array:
    """Return a measure (P,) of amplitude, such as "rms", of the coefficients (P, ...) of an element in P solutions.

    ``derivative`` is the order of the derivative in time; the parameters are not used for displacements.
    """
    if derivative:
        columns = {name: np.array([p[name] for p in parameters]) for name in parameters[0]}
        rows = layout.in_time(rows, columns, derivative)
    return layout.measure_rows(measure, rows)


@renamed_attributes(verdict="stability")
@dataclass(frozen=True, eq=False, repr=False)
class Point:
    """One solution.

    Attributes
    ----------
    X : ndarray, shape (n,)
        Unknowns.
    parameters : dict of str to float
        All parameters. The parameter of the branch is the last one.
    residual : float
        Relative residual after the last iteration of the corrector.
    iterations : int
        Number of iterations of the corrector.
    multipliers : ndarray of complex, shape (r,), or None
        Multipliers of small disturbances (Floquet multipliers). None if they were not computed.
    regime : ndarray of int8, shape (m,)
        Regime code of each element, a position in ``layout.regimes``. -1 is unknown.
    error : float
        Estimated error of the solution, nan if unknown. For a `SpecialPoint` it is the error of its parameter value.
    layout : LayoutProtocol or None
        Description of the unknowns. None if the problem does not give it.
    label : str
        Label of a special point, such as "LP1".
    modulus_error : float
        Estimated error of the largest modulus of the multipliers. nan if unknown, or if the modulus is far from 1.
    problem : object or None
        Problem that the point solves, possibly with more unknowns than `X`. None if it is unknown. Files do not store
        it.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> point = curve[3]
    >>> point.stable, bool(point.amplitude("H1") == curve.amplitude("H1")[3])
    (True, True)
    """

    X: Array
    parameters: dict[str, float]
    residual: float
    iterations: int
    multipliers: ComplexArray | None
    regime: NDArray[np.int8]
    error: float
    layout: LayoutProtocol | None
    label: str = ""
    modulus_error: float = dataclasses.field(default=math.nan, kw_only=True)
    problem: Any = dataclasses.field(default=None, kw_only=True)

    @staticmethod
    def without_data(X: Array, parameters: dict[str, float], problem: Any) -> Point:
        """Return a point of a problem without monitored quantities."""
        regime = np.zeros(0, dtype=np.int8)
        return Point(X, parameters, 0.0, 0, None, regime, math.nan, problem.layout, problem=problem.original)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the problem, which is pickled once, with the branch."""
        return {**vars(self), "problem": None}

    def __repr__(self) -> str:
        position = "".join(f" at {name} = {self.parameters[name]:.6g}" for name in list(self.parameters)[-1:])
        return f"<{self.label or 'Point'}{position}, {self.stability_in_words}, {self.regime_name}>"

    @property
    def stability(self) -> str:
        """One of "stable", "unstable", "undecided", "neutral", "unknown" (no multipliers).

        It is undecided if the modulus error includes 1. A neutral motion is stable and belongs to a family at the same
        parameters: no friction slider slips.
        """
        if self.multipliers is None:
            return "unknown"
        codes = np.atleast_1d(stability_codes(self.multipliers, np.asarray(self.modulus_error)))
        return stability_names(codes, np.asarray(self.regime)[None], neutral_regime_of(self.layout))[0]

    @property
    def stability_in_words(self) -> str:
        """The stability for readers, such as "stable" or "stability unknown"."""
        return "stability unknown" if self.stability == "unknown" else self.stability

    @property
    def stable(self) -> bool | None:
        """True or False, or None if the stability is undecided or unknown."""
        return {"stable": True, "neutral": True, "unstable": False}.get(self.stability)

    @property
    def regime_name(self) -> str:
        """Name of the most severe regime among the elements."""
        return name_of_regime(self.regime, self.layout)

    @checked_arguments()
    def coefficients(self, element: int | str = 0) -> Array:
        """Return the unknowns of an element.

        Parameters
        ----------
        element : int or str, optional
            Index or name of the element. The default is 0.

        Returns
        -------
        ndarray
            For harmonic balance ``(a0, a1, b1, ..., aH, bH)``.
        """
        return require_layout(self.layout).rows(self.X, element).copy()

    @checked_arguments()
    def amplitude(
        self, measure: str = "rms", element: int | str = 0, dof: int | str | None = None, derivative: int = 0
    ) -> float:
        """Return a measure of amplitude of an element or of a degree of freedom.

        Parameters
        ----------
        measure : str, optional
            For harmonic balance "rms" (default), "pp2", "max", "mean", "H1", "H2", ...
        element : int or str, optional
            Index or name of the element. The default is 0.
        dof : int or str, optional
            Index or name of a degree of freedom, which is used instead of the element. It needs the problem of the
            point, which files do not store.
        derivative : int, optional
            0 for displacement (default), 1 for velocity, 2 for acceleration, in time.

        Returns
        -------
        float
            Value of the measure, in the units of the displacement.

        Raises
        ------
        ValueError
            If the measure does not exist, or the problem is needed but unknown.
        KeyError
            If the element or degree of freedom does not exist.
        """
        counted("derivative", derivative, MAX_DERIVATIVE, least=0)
        layout = require_layout(self.layout)
        if dof is None:
            rows = layout.rows(self.X[None], element)
        elif self.problem is None:
            raise ValueError(
                f"dof={dof!r} needs the problem of {self.label or 'the point'}, which is unknown; use the amplitude of "
                "the branch, which rebuilds it if it can"
            )
        else:
            rows = rows_of_dof(self.problem, dof, self.X[None], [self.parameters])
        return float(measured(layout, measure, rows, [self.parameters], derivative)[0])

    @checked_arguments()
    def samples(self, element: int | str = 0, count: int = 1024, order: int = 0) -> tuple[Array, Array]:
        """Return samples of an element over one period.

        Parameters
        ----------
        element : int or str, optional
            Index or name of the element. The default is 0.
        count : int, optional
            Number of samples. The default is 1024.
        order : int, optional
            Order of the derivative with respect to the phase. The default is 0, the displacement itself.

        Returns
        -------
        theta : ndarray, shape (count,)
            Phases, 0 <= theta < 2 pi.
        values : ndarray, shape (count,)
            Values of the element.
        """
        counted("order", order, least=0)
        counted("count", count, 10_000_000)
        return require_layout(self.layout).samples(self.X, element, count, order)


@dataclass(frozen=True, eq=False, repr=False)
class SpecialPoint(Point):
    """A point at which the branch or its stability changes.

    A special point whose error is too large at the resolution of the branch is solved for with more unknowns, which
    `layout` describes. The point of the branch with the number `index` then only lies near it.

    Attributes
    ----------
    kind : str
        "LP" (fold), "PD" (period doubling), "NS" (Neimark-Sacker), "BP" (branch point), "GR" (grazing), "CP" (cusp),
        ... The label is the kind with a number.
    index : int
        Number of the point of the branch that holds it.
    located : bool
        True if the point was solved for. Otherwise it is only known to lie in `interval`.
    interval : tuple of float
        Parameter values of the points that bracket it.
    note : str
        Remark on how it was located.
    meaning : str
        Description of the event.
    marker : str
        Marker of figures.
    event : Event or None
        Event that located it. Files do not store it.
    error : float
        Estimated error of its parameter value, nan if unknown.
    truncation : float
        Estimated truncation error of its solution, nan if unknown.
    certificate : dict or None
        Certificate of the point as plain data, see `hbgear.analysis.Certificate.attached_to`. None without one.
    at_all_phases : bool
        Whether a contact begins at all phases at once, as all around a circular whirl. The multipliers jump there.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> fold = curve["LP1"]
    >>> fold.kind, fold.located, round(fold.parameters["Omega"], 3)
    ('LP', True, 1.103)
    """

    kind: str = ""
    index: int = -1
    located: bool = True
    interval: tuple[float, float] = (float("nan"), float("nan"))
    note: str = ""
    meaning: str = ""
    marker: str = ""
    event: Any = None
    truncation: float = math.nan
    certificate: dict[str, Any] | None = None
    at_all_phases: bool = False

    @property
    def stability_in_words(self) -> str:
        """The stability for readers; "at its stability limit" where a multiplier crosses the unit circle, none outside.

        The modulus of this multiplier is one up to the error of the solution, which decides between `stable` and not.
        That of a fold next to a grazing may differ by more than in other points: the fold is located without it.
        """
        if self.multipliers is None or self.kind not in STABILITY_CHANGING_KINDS:
            return super().stability_in_words
        mu = self.multipliers
        if self.kind == "LP" and self.located and mu.size:
            mu = np.append(np.delete(mu, np.abs(mu - 1).argmin()), 1.0)
        deviation = abs(np.abs(mu).max(initial=0.0) - 1.0)
        return "at its stability limit" if deviation <= MAX_MULTIPLIER_DEVIATION else super().stability_in_words

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the event, which may hold a function that cannot be pickled."""
        return {**super().__getstate__(), "event": None}


@renamed_attributes(decided="landing_description")
@dataclass(frozen=True, eq=False)
class Jump:
    """A jump: a slow sweep leaves the branch at a special point and lands on another solution.

    Attributes
    ----------
    label : str
        Label of the special point.
    parameter : str
        Name of the parameter of the sweep.
    value : float
        Value of the parameter at the jump.
    direction : int
        +1 if the parameter increases, -1 if it decreases.
    before, after : Point
        Solutions before and after the jump. `after` is None if no stable solution is known at `value`.
    landing : {"nearest", "integrate", "bifurcating"}
        How `after` was chosen: the nearest stable solution; integration in time from `before`; or no jump, because the
        sweep continues on a stable branch that bifurcates at `before`, of which `after` is the first solution.
    candidates : tuple of Point
        Stable solutions at `value`, of all curves that were searched.
    note : str
        Result of the integration, if it is not a solution of these curves.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> jump = curve.jumps()[0]
    >>> jump.label, jump.direction, round(jump.value, 3)
    ('LP1', 1, 1.103)
    >>> jump.before.amplitude("H1") > jump.after.amplitude("H1")
    True
    """

    label: str
    parameter: str
    value: float
    direction: int
    before: Point
    after: Point | None
    landing: str = "nearest"
    candidates: tuple[Point, ...] = ()
    note: str = ""

    @property
    def is_uncertain(self) -> bool:
        """Whether `after` is the nearest of several stable solutions; only an integration finds the actual one."""
        return self.landing == "nearest" and len(self.candidates) > 1

    @property
    def landing_description(self) -> str:
        """Description of how `after` was chosen, such as "uncertain: nearest of 2"."""
        if self.landing == "integrate":
            return "integrated"
        if self.landing == BIFURCATING:
            return "continues on the bifurcating branch"
        return f"uncertain: nearest of {len(self.candidates)}" if self.is_uncertain else "nearest"


_AnyPoint = TypeVar("_AnyPoint", bound=Point)


def with_problem(point: _AnyPoint, problem: Any) -> _AnyPoint:
    """Return a point that refers to its problem, at its resolution: a special point may have more unknowns.

    A problem that the point has already is kept.
    """
    if point.problem is not None:
        return point
    resized = getattr(problem, "at_resolution_of", None)
    return dataclasses.replace(point, problem=problem if resized is None else resized(point))


def jump_with_problem(jump: Jump, problem: Any) -> Jump:
    """Return a jump whose points refer to their problem; problems that they have already are kept."""
    points = (jump.before, *(() if jump.after is None else (jump.after,)), *jump.candidates)
    if all(point.problem is not None for point in points):
        return jump
    return dataclasses.replace(
        jump,
        before=with_problem(jump.before, problem),
        after=jump.after and with_problem(jump.after, problem),
        candidates=tuple(with_problem(point, problem) for point in jump.candidates),
    )
