"""Data of a branch: arrays over its points, indexing and stability.

    point i:  parameter = values[i],  unknowns X[i], which the layout of the problem describes (`LayoutProtocol`)

A point is stable if none of its multipliers lies outside the unit circle.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.deprecation import warn_renamed
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.layout import LayoutProtocol, RebuildsProblem, neutral_regime_of
from hbgear.continuation.results.point import Jump, Point, SpecialPoint, jump_with_problem, name_of_regime, with_problem
from hbgear.continuation.results.stability import STABLE, UNDECIDED, UNKNOWN, stability_codes, stability_names
from hbgear.continuation.results.status import Status

_ARRAY_TYPES: dict[str, tuple[Any, int]] = {
    "values": (float, 1),
    "X": (float, 2),
    "multipliers": (complex, 2),
    "iterations": (int, 1),
    "residual": (float, 1),
    "regime": (np.int8, 2),
    "error": (float, 1),
    "step": (float, 1),
    "modulus_error": (float, 1),
}
"""Type and number of dimensions of each array of a branch."""


_UNSAVED_FIELDS = ("problem", "event", "full_motion")
"""Fields that hold code, and the coordinates that a file stores separately."""


@dataclass(frozen=True, eq=False)
class FullMotion:
    """Coordinates of all points of a branch, for models that a file cannot rebuild.

    ``rows`` has the shape (P, n, ...): coefficients of each of the n coordinates, in the form of those of an element.
    """

    names: tuple[str, ...]
    rows: Array


def saved_fields(value: Any) -> dict[str, Any]:
    """Return the fields of a point, jump or branch that files store: all except those that hold code."""
    fields = dataclasses.fields(value)
    return {field.name: getattr(value, field.name) for field in fields if field.name not in _UNSAVED_FIELDS}


def relative_errors(X: Array, error: Array) -> Array:
    """Return the errors (P,) of solutions X (P, n) over their norms / sqrt 2, not finite at zero solutions."""
    with np.errstate(all="ignore"):
        return error * math.sqrt(2) / np.linalg.norm(X, axis=1)


@dataclass(frozen=True, eq=False, repr=False)
class BranchData:
    """Arrays over the P points of a branch; see `Branch` for the attributes."""

    parameter: str
    values: Array
    X: Array
    fixed: dict[str, float]
    tracked: dict[str, Array]
    multipliers: ComplexArray | None
    iterations: NDArray[np.int_]
    residual: Array
    regime: NDArray[np.int8]
    error: Array
    step: Array
    special: tuple[SpecialPoint, ...]
    jump_records: tuple[Jump, ...]
    status: Status
    message: str
    layout: LayoutProtocol | None
    meta: dict[str, Any]
    problem: Any = None
    others: tuple[BranchData, ...] = ()
    modulus_error: Array | None = None
    full_motion: FullMotion | None = None

    def __post_init__(self) -> None:
        self._share_problem()
        self._convert_arrays()
        self._check_shapes()
        labels = [point.label for point in self.special]
        if len(set(labels)) < len(labels):
            raise ValueError(f"Branch: labels of special points must be unique, got {', '.join(labels)}")

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._share_problem()

    def _share_problem(self) -> None:
        """Set the problem of the special points and of the jumps that have none."""
        if self.problem is None:
            return
        self._set("special", tuple(with_problem(point, self.problem) for point in self.special))
        self._set("jump_records", tuple(jump_with_problem(jump, self.problem) for jump in self.jump_records))

    def _convert_arrays(self) -> None:
        """Convert the arrays and the status to their types."""
        if self.modulus_error is None:
            self._set("modulus_error", np.full(np.size(self.values), math.nan))
        for name, (kind, _) in _ARRAY_TYPES.items():
            if (value := getattr(self, name)) is not None:
                self._set(name, np.asarray(value, dtype=kind))
        self._set("tracked", {name: np.asarray(x, dtype=float) for name, x in self.tracked.items()})
        self._set("status", Status(self.status))

    def _check_shapes(self) -> None:
        """Raise a ValueError if an array does not have one entry for each point."""
        arrays = {name: (getattr(self, name), ndim) for name, (_, ndim) in _ARRAY_TYPES.items()}
        for name, (array, ndim) in (arrays | {name: (x, 1) for name, x in self.tracked.items()}).items():
            if array is not None and (array.ndim != ndim or len(array) != len(self)):
                raise ValueError(f"Branch: {name} has shape {array.shape}; need {len(self)} points, one for each value")
        if self.layout and self.X.shape[1] != self.layout.width:
            raise ValueError(f"Branch: points of {self.X.shape[1]} unknowns do not fit {self.layout}")

    def _set(self, name: str, value: Any) -> None:
        """Set a field of this frozen object while it is made."""
        object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        span = f"{self.values[0]:.6g} to {self.values[-1]:.6g}, " if len(self) else ""
        labels = " ".join(point.label for point in self.special) or "no special points"
        suffix = f", {len(self.others)} other curve{'s' * (len(self.others) > 1)}" if self.others else ""
        return f"<Branch in {self.parameter}: {span}{len(self)} points, {labels}, {self.status}{suffix}>"

    def __len__(self) -> int:
        return self.values.size

    def __getitem__(self, key: int | str) -> Point:
        """Return a point by its number, or a special point by its label."""
        if isinstance(key, str):
            by_label = {point.label: point for point in self.special}
            if key not in by_label:
                raise KeyError(f"no special point '{key}' on this branch; it has: {', '.join(by_label) or 'none'}")
            return by_label[key]
        if not isinstance(key, int | np.integer):
            raise TypeError(f"Branch[{key!r}]: need the number of a point or the label of a special point")
        if not -len(self) <= key < len(self):
            raise IndexError(f"no point {key}; the branch has {len(self)} points")
        mu = None if self.multipliers is None else self.multipliers[key]
        return Point(
            self.X[key],
            self.parameters_at(key),
            float(self.residual[key]),
            int(self.iterations[key]),
            mu,
            self.regime[key],
            float(self.error[key]),
            self.layout,
            modulus_error=float(np.asarray(self.modulus_error)[key]),
            problem=self.problem,
        )

    @checked_arguments()
    def parameters_at(self, i: int) -> dict[str, float]:
        """Return all parameters of a point, that of the branch last; IndexError if there is no such point."""
        if not -len(self) <= i < len(self):
            raise IndexError(f"no point {quoted(i)}; the branch has {len(self)} points")
        tracked = {name: float(x[i]) for name, x in self.tracked.items()}
        return {**self.fixed, **tracked, self.parameter: float(self.values[i])}

    @property
    def stability_codes(self) -> NDArray[np.int_]:
        """Code of the stability of each point, shape (P,): 0 unstable, 1 stable, 2 undecided, 3 unknown."""
        if self.multipliers is None:
            return np.full(len(self), UNKNOWN)
        return stability_codes(self.multipliers, np.asarray(self.modulus_error))

    @property
    def stability(self) -> list[str]:
        """Stability of each point: "unstable", "stable", "undecided", "unknown" or "neutral"; see `Point.stability`."""
        return stability_names(self.stability_codes, self.regime, neutral_regime_of(self.layout))

    @property
    def stable(self) -> NDArray[np.bool_] | None:
        """True where a point is known to be stable, shape (P,). None if no multipliers were computed."""
        return None if self.multipliers is None else np.asarray(self.stability_codes == STABLE)

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """True where the error of the largest multiplier includes the unit circle, shape (P,)."""
        return np.asarray(self.stability_codes == UNDECIDED)

    @property
    def regimes(self) -> list[str]:
        """Name of the most severe regime among the elements, of each point."""
        return [name_of_regime(codes, self.layout) for codes in self.regime]

    @property
    def relative_error(self) -> float:
        """Largest estimated error of a point, relative to the norm of its unknowns over sqrt 2. nan if unknown."""
        relative = relative_errors(self.X, self.error)
        return math.nan if np.isnan(relative).all() else float(np.nanmax(relative))

    @property
    def unknown_errors(self) -> dict[str, float]:
        """Largest estimated error, relative to its value, of each parameter that is an unknown of free motions.

        nan if it is unknown. Empty for curves whose other parameters are constant.
        """
        return self.meta.get("unknown_errors", {})

    @property
    def asymptotes(self) -> dict[str, float]:
        """Parameter values at which the solutions grow without bound, beyond the "first" or the "last" point."""
        return self.meta.get("asymptotes", {})

    @property
    def unbounded_ends(self) -> list[tuple[int, float]]:
        """Number of the last point, 0 or -1, and asymptote of each end at which the solutions grow without bound."""
        return [(0 if end == "first" else -1, value) for end, value in self.asymptotes.items()]

    def require_problem(self) -> Any:
        """Return the problem. A branch from a file rebuilds it if the file describes the model.

        Returns
        -------
        object
            Problem of the branch.

        Raises
        ------
        ValueError
            If the problem is unknown.
        """
        problem = self._problem_or_none()
        if problem is None:
            raise ValueError(
                "this needs the problem of the branch, which is unknown; load the branch with "
                "hbgear.load(path, problem=HarmonicBalance(...))"
            )
        return problem

    def continued_problem(self) -> Any:
        """Return the problem of the equations of the curve, with which it or a branch of it is traced further.

        A file stores the problem of a response curve, but not of a curve of special points.

        Raises
        ------
        ValueError
            If the problem is unknown.
        """
        if self.problem is None and "curve" in self.meta:
            raise ValueError(
                "this needs the problem of the curve of special points, which files do not store; load it with "
                "hbgear.load(path, problem=...), or follow the special point again"
            )
        return self.require_problem()

    def rebuilt_problem(self) -> Any:
        """Return the problem that the header describes; None if its model is defined outside hbgear."""
        return self.layout.problem_of(self.meta) if isinstance(self.layout, RebuildsProblem) else None

    def _problem_or_none(self) -> Any:
        """Return the problem, rebuilt from the header if necessary, or None."""
        return self.rebuilt_problem() if self.problem is None else self.problem

    @property
    def known_problem(self) -> Any:
        """Deprecated: use `require_problem`."""
        warn_renamed("Branch.known_problem", "require_problem()", stacklevel=3)
        return self._problem_or_none()
