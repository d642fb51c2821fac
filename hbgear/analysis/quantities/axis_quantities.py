"""Quantities on the axes of figures and in the columns of tables, in physical units if the model has `Scales`.

    n [r/min] = pinion_speed(1) Omega,   x [um] = 1e6 length xbar

`Abscissa` is the parameter of branches; Omega becomes the speed of the pinion if it is a known multiple on each branch.
`Ordinate` is a measure of amplitude, or an engineering quantity such as the dynamic factor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from hbgear.analysis.quantities.engineering_quantities import (
    OTHER_NAMES,
    are_meshes,
    machine_quantities,
    problem_along,
    transmission_error,
)
from hbgear.analysis.quantities.length_units import MICROMETRE, dimension_of, factor_of, in_figure, in_micrometres
from hbgear.common.arrays import Array
from hbgear.common.text.digits import short
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.harmonic.autonomous.backbone import AMPLITUDE
from hbgear.harmonic.autonomous.tori.layout import TorusLayout
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.models.frequency_units import (
    MESH,
    PINION,
    common_scales,
    length_scale,
    model_of,
    same_scales,
    scales,
)
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.measures import MEASURES, axis_text, is_measure, motion_text

SHORT_NAMES = {"dte": "dte, half peak-to-peak", "force": "force, largest", "acceleration": "acceleration, rms"}
"""Engineering quantities by the short names that measures may have."""

DTE = "dte, half peak-to-peak"
"""Name of the dynamic transmission error among the engineering quantities."""

QUANTITIES = (*SHORT_NAMES, *SHORT_NAMES.values(), *OTHER_NAMES, *OTHER_NAMES.values(), "acceleration, level")
"""Names of engineering quantities that may be shown instead of an amplitude."""

SPEED_LABEL = "speed of the pinion [r/min]"
"""Label of an axis of frequencies in physical units."""


def kind_of(branch: Branch) -> Literal["periodic", "tori", "backbone"]:
    """Return the kind of motions of a branch in a response figure.

    Examples
    --------
    >>> import hbgear as hb
    >>> kind_of(hb.analysis.backbone(hb.Duffing(), span=(0.01, 0.1), harmonics=3))
    'backbone'
    """
    if isinstance(branch.layout, TorusLayout):
        return "tori"
    return "backbone" if branch.parameter == AMPLITUDE and "modal_damping" in branch.tracked else "periodic"


def same_unit_of_amplitude(branches: Sequence[Branch]) -> bool:
    """Return whether the amplitudes of branches have one unit: all models have a unit of length, or none of them."""
    has_length = {length_scale(model_of(branch), branch.parameters_at(0)) is not None for branch in branches}
    return len(has_length) == 1


def usual_measure(branch: Branch, dimensionless: bool = False, element: int | str = 0) -> str:
    """Return the measure that is shown by default: the transmission error of a mesh in physical units, otherwise "pp2".

    A bearing has no transmission error, and amplitudes that are ``dimensionless`` keep the unit of the model.

    Examples
    --------
    >>> import hbgear as hb
    >>> usual_measure(hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9)))
    'pp2'
    """
    layout, model = layout_of(branch), model_of(branch)
    if dimensionless or layout is None or length_scale(model, {}) is None:
        return "pp2"
    if not are_meshes(model, layout)[layout.index(element)]:
        return "pp2"
    try:
        problem_along(branch)
    except ValueError:
        return "pp2"
    return "dte"


class OmegaAxis:
    """Omega on an axis or in a table, as speed of the pinion if Omega = 1 is a known speed.

    Parameters
    ----------
    speeds : mapping of str to float
        Values of Omega = 1 in physical units by `MESH` and `PINION`; empty if the model has no scales, and without
        `MESH` if the number of teeth differs.
    label : str, optional
        Label of the axis of Omega.
    dimensionless : bool, optional
        Whether Omega is kept; default False.

    Attributes
    ----------
    scale : float
        Value on the axis for Omega = 1.
    hertz : float
        Mesh frequency [Hz] for Omega = 1; 1 if Omega is kept.
    label : str
        Label of the axis.
    name : str
        Header of a column: "pinion r/min" or "Omega".
    above : dict of str to float
        Scales of additional axes by `MESH` and `PINION`, relative to the axis.

    Examples
    --------
    >>> axis = OmegaAxis({"mesh Hz": 500.0, "pinion r/min": 1500.0})
    >>> axis.text(0.5), OmegaAxis({}).text(0.5)
    ('750 r/min', 'Omega = 0.5')
    """

    def __init__(self, speeds: Mapping[str, float], label: str = r"$\Omega$", dimensionless: bool = False) -> None:
        self.scale, self.hertz, self.label, self.name, self.above = 1.0, 1.0, label, "Omega", dict(speeds)
        if speeds and not dimensionless:
            self.scale, self.hertz = speeds[PINION], speeds.get(MESH, math.nan)
            self.label, self.name = SPEED_LABEL, PINION
            self.above = {MESH: speeds[MESH] / speeds[PINION]} if MESH in speeds else {}

    @classmethod
    def of(cls, model: Model | None, dimensionless: bool = False) -> OmegaAxis:
        """Return the axis of a model."""
        label = str(model.labels.get("Omega", r"$\Omega$")) if model is not None else r"$\Omega$"
        return cls(scales(model, {}), label, dimensionless)

    @classmethod
    def of_ends(cls, folds: Sequence[Branch], label: str, dimensionless: bool = False) -> OmegaAxis:
        """Return the axis of fold curves, on which the unit of Omega may change: Omega is kept then."""
        speeds = [scales(model_of(fold), fold.parameters_at(i)) for fold in folds for i in (0, -1)]
        return cls(same_scales(speeds), label, dimensionless)

    @property
    def is_speed(self) -> bool:
        """Whether the axis is the speed of the pinion."""
        return self.name == PINION

    def number(self, Omega: float, digits: int = 6) -> str:
        """Return the value on the axis as text."""
        return short(self.scale * Omega, digits)

    def text(self, Omega: float, digits: int = 6) -> str:
        """Return the value with its unit, such as "9000 r/min", or "Omega = 0.8"."""
        return f"{self.number(Omega, digits)} r/min" if self.is_speed else f"Omega = {self.number(Omega, digits)}"

    def title(self, Omega: float) -> str:
        """Return `text` in the notation of figures, with five digits."""
        return self.text(Omega, 5).replace("Omega", r"$\Omega$")


def axis_scales(model_scales: Sequence[dict[str, float]], dimensionless: bool = False) -> dict[str, float]:
    """Return the scales of an axis for models of several scales, see `OmegaAxis`; empty if a model has no scales.

    Speeds in r/min may be compared if their scales differ. An axis of Omega has speeds above it only if they are equal.
    The scales are those of the first model, without `MESH` if its ratio to `PINION` differs.

    Examples
    --------
    >>> axis_scales([{"mesh Hz": 500.0, "pinion r/min": 1500.0}, {"mesh Hz": 600.0, "pinion r/min": 1800.0}])
    {'mesh Hz': 500.0, 'pinion r/min': 1500.0}
    """
    if dimensionless or not model_scales or not all(model_scales):
        return same_scales(model_scales)
    ratios = [scales[MESH] / scales[PINION] for scales in model_scales]
    return model_scales[0] if np.allclose(ratios, ratios[0]) else {PINION: model_scales[0][PINION]}


class Abscissa:
    """Parameter of branches on the horizontal axis of a figure.

    Parameters
    ----------
    branches : sequence of Branch
        Branches of a figure.
    dimensionless : bool, optional
        Whether Omega is kept; default False.

    Attributes
    ----------
    scale : float
        Value on the axis for a parameter of one on the first branch.
    hertz : float
        Mesh frequency [Hz] for a parameter of one on the first branch; 1 if Omega is kept.
    label : str
        Label of the axis.
    above : dict of str to float
        Scales of additional axes by `MESH` and `PINION`, relative to the axis.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), 4), "Omega", (1.6, 1.5))
    >>> Abscissa([curve]).label, Abscissa([curve], dimensionless=True).scale
    ('speed of the pinion [r/min]', 1.0)
    """

    def __init__(self, branches: Sequence[Branch], dimensionless: bool = False) -> None:
        speeds = [common_scales([branch]) for branch in branches]
        first, layout = branches[0], layout_of(branches[0])
        names = layout.labels if layout else {}
        label = r"$\Omega$" if first.parameter == "Omega" else first.parameter
        axis = OmegaAxis(axis_scales(speeds, dimensionless), str(names.get(first.parameter, label)), dimensionless)
        self.scale, self.hertz, self.label, self.above = axis.scale, axis.hertz, axis.label, axis.above
        self._is_speed = axis.is_speed
        self._scales = {id(branch): (branch, x.get(PINION, 1.0)) for branch, x in zip(branches, speeds, strict=True)}

    def along(self, branch: Branch) -> Array:
        """Return the values at the points of a branch."""
        return self._scale_of(branch) * branch.values

    def at(self, branch: Branch, value: float) -> float:
        """Return the value on the axis of a parameter of a branch."""
        return float(self._scale_of(branch) * value)

    def _scale_of(self, branch: Branch) -> float:
        """Return the value on the axis for a parameter of one on a branch (computed once)."""
        if not self._is_speed:
            return self.scale
        if id(branch) not in self._scales:
            speeds = common_scales([branch])
            self._scales[id(branch)] = branch, speeds.get(PINION, self.scale)  # a reference, so that the id stays valid
        return self._scales[id(branch)][1]


class Ordinate:
    """Measure of amplitude of an element, or engineering quantity, of points of branches.

    Parameters
    ----------
    measure : str
        Measure, see `Branch.amplitude`, or name of a quantity of `machine_quantities`; the short names "dte", "force"
        and "acceleration" are allowed.
    element : int or str, optional
        Element by number or name; default 0.
    dof : int or str, optional
        Coordinate for accelerations.
    dimensionless : bool, optional
        Whether amplitudes keep the unit of the model; default False.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), 4), "Omega", (1.6, 1.5))
    >>> Ordinate("pp2").header(curve), Ordinate("pp2", dimensionless=True).header(curve)
    ('pp2 [um]', 'pp2')
    >>> Ordinate("dte").header(curve)
    'dte, half peak-to-peak [um]'
    """

    def __init__(
        self, measure: str, element: int | str = 0, dof: int | str | None = None, dimensionless: bool = False
    ) -> None:
        self.measure, self.element, self.dof = SHORT_NAMES.get(measure, measure), element, dof
        self.dimensionless = dimensionless
        self._computed: dict[int, tuple[Branch, Array]] = {}
        self._lengths: dict[Any, float | None] = {}

    @property
    def is_amplitude(self) -> bool:
        """Whether it is a measure of amplitude, which is known without the equations."""
        return is_measure(self.measure)

    def prepared(self, branch: Branch) -> Branch:
        """Return the branch, with its problem if the quantity is computed from it; ValueError if that is unknown."""
        if branch.problem is not None or self.is_amplitude:
            return branch
        try:
            return replace(branch, problem=problem_along(branch))
        except ValueError as error:
            names = ", ".join(MEASURES)
            raise ValueError(f"no measure {quoted(self.measure)}; there are {names}, H1, H2, ...; {error}") from None

    def along(self, branch: Branch) -> Array:
        """Return the values at the points of a branch (computed once); ValueError if they are unknown at all points."""
        computed = self._computed.get(id(branch))
        if computed is not None:
            return computed[1]
        if self.is_amplitude:
            values = branch.amplitude(self.measure, self.element) * self._factors(branch)
        else:
            values = self._quantity(branch)
            if not np.isfinite(values).any():
                raise ValueError(
                    f"there is no {self.measure} to draw, as the static force is zero; draw another "
                    "quantity, such as 'force, largest'"
                )
        self._computed[id(branch)] = branch, values  # the branch is kept, so that its id is not used again
        return values

    def at(self, point: Point, branch: Branch | None = None) -> float:
        """Return the value at a point of a branch."""
        if not self.is_amplitude:
            return float(self._quantity(point)[0])
        model = getattr(point.problem, "model", None) or (model_of(branch) if branch is not None else None)
        return float(point.amplitude(self.measure, self.element)) * self._factor(model, dict(point.parameters))

    def label(self, branch: Branch) -> str:
        """Return the label of the axis."""
        if self.is_amplitude:
            return in_figure(axis_text(self.measure, self.motion(branch)))
        title = machine_quantities(self.prepared(branch)[0], self.element, self.dof).title(self.measure)
        title = in_figure(title.replace("dte, half peak-to-peak", "dynamic transmission error, half peak-to-peak"))
        return title + (f" of {self.dof}" if self.dof is not None and self.measure.startswith("acc") else "")

    def header(self, branch: Branch) -> str:
        """Return the header of a column of a table."""
        if not self.is_amplitude:
            return machine_quantities(self.prepared(branch)[0], self.element, self.dof).title(self.measure)
        dimension = dimension_of(self.measure)
        unit = f"{MICROMETRE}^{dimension}" if dimension > 1 else MICROMETRE
        has_length = dimension and self._length(model_of(branch), branch.parameters_at(0)) is not None
        return f"{self.measure} [{unit}]" if has_length else self.measure

    def motion(self, branch: Branch) -> str:
        """Return the symbol of the motion of the element with its unit."""
        layout = layout_of(branch)
        if layout is None:
            return motion_text({})
        index = layout.index(self.element)
        if self._length(model_of(branch), branch.parameters_at(0)) is None:
            return motion_text(layout.labels, layout.elements, index)
        name = f", {layout.elements[index]}" if len(layout.elements) > 1 else ""
        return in_micrometres(motion_text(layout.labels), name)

    def _length(self, model: Model | None, parameters: dict[str, float]) -> float | None:
        """Return the unit of length [m]; None if amplitudes keep the unit of the model."""
        if self.dimensionless or model is None:
            return None
        changed = {name: value for name, value in parameters.items() if name != "Omega"}
        key = id(model), tuple(changed.items())
        if key not in self._lengths:
            self._lengths[key] = length_scale(model, changed)
        return self._lengths[key]

    def factor(self, branch: Branch) -> float:
        """Return the unit of amplitudes [um] at the first point of a branch; 1 if it keeps the unit of the model."""
        return self._factor(model_of(branch), branch.parameters_at(0))

    def _factor(self, model: Model | None, parameters: dict[str, float]) -> float:
        return float(factor_of(self.measure, self._length(model, parameters)))

    def _factors(self, branch: Branch) -> Array:
        model = model_of(branch)
        fixed = branch.parameter == "Omega" and not branch.tracked
        points = range(1 if fixed else len(branch))
        return np.array([self._factor(model, branch.parameters_at(i)) for i in points])

    def _quantity(self, motions: Branch | Point) -> Array:
        """Return an engineering quantity of the points of a branch, or of one point."""
        if self.measure in (DTE, OTHER_NAMES[DTE]):
            return transmission_error(motions, self.element)
        quantities = machine_quantities(motions, self.element, self.dof)
        try:
            return quantities[self.measure]
        except KeyError as error:
            raise KeyError(f"{error.args[0]}; measures are {', '.join(MEASURES)}, H1, H2, ...") from None
