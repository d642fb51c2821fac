"""Solutions of the harmonic balance as periodic motions: layout, forces, contact, stability, monitored quantities.

The functions of `hbgear.harmonic.equations.motion` compute the quantities of one motion at one parameter set. The class
calls them with the model at the given parameters, and adds Floquet multipliers and events, for `trace`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.events.event import Event
from hbgear.continuation.problem.base import Observed, observe_all
from hbgear.continuation.problem.curve_equations import CurveEquations, CurveSolutions
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.harmonic.balance.equations import HarmonicEquations
from hbgear.harmonic.balance.postprocess import postprocess
from hbgear.harmonic.balance.resolution import add_resolution_error
from hbgear.harmonic.bifurcations.codimension_two.curves import events_of_codimension_two
from hbgear.harmonic.bifurcations.events import motion_events
from hbgear.harmonic.bifurcations.no_contact import FirstContact
from hbgear.harmonic.equations import motion
from hbgear.harmonic.equations.evaluator import Crossings
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.equations.thresholds import THRESHOLDS, edged_laws
from hbgear.harmonic.multipliers.floquet import check_modes, floquet_multipliers
from hbgear.harmonic.stability.verification import verify_multipliers
from hbgear.harmonic.structure.measured import MeasuredStructure

FIRST_SLIP_DISTANCE = 1e-5
"""Margin of a slider, relative to the motion, below which a curve that ends is said to end at its first slip."""

_MONITORING_WORK = 2e8
"""Operations of one call of `observe_many` (about a second), after which Ctrl-C is handled."""


class PeriodicMotions(HarmonicEquations):
    """The harmonic balance with the quantities of its solutions."""

    # ---- unknowns

    def rows(self, X: Array) -> Array:
        """Return coefficients (..., m, 2H + 1) of all harmonics from unknowns (..., n)."""
        return self.discretization.spread(X)

    @property
    def layout(self) -> Layout:
        """Names and measures of the unknowns."""
        return self._cached("layout", (), self._build_layout)

    def _build_layout(self) -> Layout:
        elements = self.models.system({}).elements
        return Layout(
            harmonics=self.H,
            nu=self.nu,
            elements=tuple(e.name for e in elements),
            breakpoints=tuple(e.law.breakpoints for e in elements),
            labels=dict(self.model.labels),
            orders=None if self.selection is None else tuple(self.orders[1:].tolist()),
            edged=tuple(j for rows, _, _ in edged_laws(self.compiled({})) for j in rows.tolist()),
        )

    @property
    def dof_names(self) -> tuple[str, ...]:
        """Names of the coordinates of the structure."""
        reduction = self.models.reduction({})
        return tuple((self.compiled({}).system if reduction is None else reduction[0].full).dof_names)

    def from_point(self, point: Point) -> Array:
        """Return the unknowns of a point in this basis, unchanged if the point has no layout."""
        return self.from_layout(point.X, point.layout) if isinstance(point.layout, Layout) else point.X

    def from_layout(self, X: Array, layout: Layout) -> Array:
        """Return unknowns of another basis in this one: more or fewer harmonics, or a multiple of the period.

        Raises
        ------
        ValueError
            If the number of elements differs, or the motion is not periodic with this nu.
        """
        return self.discretization.from_layout(X, layout, self.compiled({}).retained)

    def resized(self, X: Array) -> Array:
        """Return unknowns of any number of harmonics, cut or padded to this number."""
        return X if len(X) == self.size else self.discretization.resized(X, self.compiled({}).retained)

    def subharmonic_part(self, X: Array) -> Array:
        """Return the coefficients that a basis of a smaller nu does not contain; empty for nu = 1."""
        return self.discretization.subharmonic_part(X)

    # ---- quantities of a motion

    def switching(self, X: Array, **parameters: float) -> Crossings:
        """Return the switching times theta in [0, 2 pi] of the basis period, at which elements cross breakpoints.

        ``row`` of the result numbers the breakpoints of all elements in order.
        """
        return self.compiled(parameters).crossings(X)

    @checked_arguments()
    def regime(self, X: Array, **parameters: float) -> np.ndarray:
        """Return the regime of each element (m,): 0 no impact, 1 single-sided, 2 double-sided; friction 3 to 5.

        It is the number of breakpoints of the law that the motion crosses, at most 2. With friction it is 3 if no
        slider of the element slips, 4 if some of them slip, and 5 if all slip.
        """
        return motion.regimes(self.compiled(parameters), X[None])[0]

    @checked_arguments()
    def clearance(self, X: Array, **parameters: float) -> Array:
        """Return the signed distances of the extrema of the elements from breakpoints: zero where contact grazes.

        Order: for each element and each of its breakpoints, lowest value and highest value minus breakpoint.
        """
        return self.threshold_distances("clearance", X, **parameters)

    def threshold_distances(self, kind: str, X: Array, **parameters: float) -> Array:
        """Return the distances of a motion from its thresholds of a kind: "clearance", "slip" or "edge"."""
        if "Omega" in parameters:  # clearances do not depend on it
            X = self._checked_unknowns(X, parameters)
        return THRESHOLDS[kind].distances(self.compiled(parameters), X[None])[0]

    def threshold(self, kind: str, X: Array, which: int, **parameters: float) -> tuple[float, Array]:
        """Return one entry of `threshold_distances`, and its derivative in the motion, rows (m, 2K - 1)."""
        return THRESHOLDS[kind].at(self.compiled(parameters), X, which)

    def threshold_names(self, kind: str) -> tuple[str, ...]:
        """Return the meaning of each entry of `threshold_distances`."""
        return THRESHOLDS[kind].names(self.compiled({}))

    def corners_met(self, X: Array, parameters: Mapping[str, float]) -> tuple[str, ...]:
        """Return the first slips at which a motion lies; the derivatives of the forces jump there."""
        margins = np.abs(self.threshold_distances("slip", X, **parameters))
        met = np.flatnonzero(margins <= FIRST_SLIP_DISTANCE * self.solution_norm(X))
        return tuple(f"the first slip of {self.slider_names[i]}" for i in met)

    @checked_arguments()
    def slider_positions(self, X: Array, theta: float = 0.0, **parameters: float) -> Array:
        """Return the positions of the friction sliders (Q,) at a basis phase theta."""
        X = self._checked_unknowns(X, parameters)
        return motion.slider_positions(self.compiled(parameters), X, theta)

    @property
    def slider_names(self) -> tuple[str, ...]:
        """Names of the friction sliders."""
        return self.threshold_names("slip")

    @property
    def clearance_names(self) -> tuple[str, ...]:
        """Meaning of each entry of `clearance`."""
        return self.threshold_names("clearance")

    @property
    def clearance_elements(self) -> tuple[int, ...]:
        """Element to which each entry of `clearance` belongs."""
        return tuple(j for j in self.compiled({}).element.tolist() for _ in range(2))

    def force_rows(self, X: Array, **parameters: float) -> Array:
        """Return the law force of each element, without its damper, as real rows (m, 2H + 1)."""
        return self.compiled(parameters).forces(X, parameters["Omega"])

    @checked_arguments()
    def mesh_forces(self, X: Array, **parameters: float) -> Array:
        """Return the whole force of each element, f_k + i k omega c d_k, as real rows (m, 2H + 1)."""
        X = self._checked_unknowns(X, parameters)
        return motion.mesh_forces(self.compiled(parameters), X, parameters["Omega"])

    @checked_arguments()
    def motion(self, X: Array, **parameters: float) -> Array:
        """Return the motion of every coordinate of the structure as real rows (n, 2H + 1)."""
        X = self._checked_unknowns(X, parameters)
        reduction = self.models.reduction(parameters)
        structure = None if reduction is None else reduction[0]
        return motion.coordinates(self.compiled(parameters), X, parameters["Omega"], structure)

    def truncation(self, X: Array, **parameters: float) -> float:
        """Return the estimated error (rms of the elements) from the force harmonics that the balance leaves out.

        The truncated harmonics H < k <= 2H, and lower orders that are not unknowns, drive the closed structure:
        delta d_k = -G_k f_k.
        """
        return motion.truncation_error(self.compiled(parameters), X, parameters["Omega"])

    @checked_arguments()
    def multipliers(
        self, X: Array, points: int | None = None, max_step: float | None = None, **parameters: float
    ) -> ComplexArray:
        """Return the Floquet multipliers of the motion over its period, largest first; see `floquet_multipliers`."""
        X = self._checked_unknowns(X, parameters)
        if points is not None:
            counted("points", points, 50)
        if max_step is not None:
            checked("multipliers", "max_step", max_step, POSITIVE)
        restricted = self.restricted_to("Omega", parameters["Omega"], parameters["Omega"], {})
        Omega = np.array([parameters.pop("Omega")])
        evaluator = restricted.compiled(parameters)
        extended = motion.with_driven_harmonics(evaluator, X[None], Omega)
        return floquet_multipliers(evaluator, extended, Omega, points=points, max_step=max_step)[0]

    # ---- curves

    def check_stability(self) -> None:
        """Raise ValueError if the modes of the structure, which multipliers need, are too many."""
        structure = self.compiled({}).structure
        if not structure.depends_on_speed and not isinstance(structure, MeasuredStructure):
            check_modes(structure)

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return the quantities stored with X: multipliers (if requested), regime, clearance, checked error."""
        u = np.append(X, parameters["Omega"])
        return observe_all(CurveEquations(self, "Omega", parameters), u[None], stability)[0]

    def observe_many(
        self, X: Array, name: str, values: Array, stability: bool = True, **parameters: float
    ) -> list[dict[str, Any]]:
        """Return `observe` of motions X (P, n) at values (P,) of a parameter, whose errors are not checked."""
        if name != "Omega":
            Omega = np.array([parameters.pop("Omega")])
            pairs = zip(X, values.tolist(), strict=True)
            return [
                self.observe_many(x[None], "Omega", Omega, stability, **parameters, **{name: value})[0]
                for x, value in pairs
            ]
        evaluator = self.compiled(parameters)
        observed, extended = motion.monitored_quantities(evaluator, X, values)
        if stability and not isinstance(evaluator.structure, MeasuredStructure):
            for quantities, mu in zip(observed, floquet_multipliers(evaluator, extended, values), strict=True):
                quantities["multipliers"] = mu
        return observed

    def check_errors(self, solutions: CurveSolutions, observed: Observed) -> None:
        """Replace truncation errors by the errors of resolution where these are larger.

        The error of resolution is the Newton step with twice the harmonics; see `hbgear.harmonic.balance.resolution`.
        """
        add_resolution_error(self, solutions, observed)

    @property
    def batch_size(self) -> int:  # type: ignore[override]
        """Motions per call of `observe_many`: fewer if all modes of a structure are propagated through the period."""
        structure = self.compiled({}).structure
        return 128 if self.reduce else min(max(int(_MONITORING_WORK / (2 * structure.n) ** 3), 2), 128)

    def events(self, parameter: str) -> tuple[Event, ...]:
        """Return period doublings, Neimark-Sacker points, grazing contacts, slips, ends of subharmonic branches."""
        return (FirstContact(),) if self.pins else motion_events(self.nu, bool(self.compiled({}).sliders))

    def codimension_two_events(self, curve: Any) -> tuple[Event, ...]:
        """Return the events of codimension two along a curve of special points."""
        return events_of_codimension_two(curve)

    def verify_stability(self, solutions: CurveSolutions, observed: Observed, work: Work | None = None) -> None:
        """Verify the stability of motions; see `hbgear.harmonic.stability.verification`.

        The error of the complex multipliers is estimated from those of a corrected motion. Where it reaches the unit
        circle, or the sign of a determinant contradicts the number of real multipliers beyond +1, the motion is
        refined: exactly in its switching times if laws are piecewise linear, else with up to eight times the harmonics,
        as far as ``work`` allows.
        """
        if not isinstance(self.compiled({}).structure, MeasuredStructure):
            verify_multipliers(self, solutions, observed, work)

    def postprocess(self, branch: Branch, observed: Sequence[Mapping[str, Any]]) -> Branch:
        """Return the branch with the errors of reductions; see `hbgear.harmonic.balance.postprocess`."""
        return postprocess(self, branch, observed)
