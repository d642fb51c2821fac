"""Measures of the amplitude of periodic motions, and their registry.

    x(theta) = a0 + sum_{k=1..H} a_k cos(k theta) + b_k sin(k theta),   theta = tau / nu

    rms   sqrt(sum_k (a_k^2 + b_k^2) / 2), without the mean         pp2   (max x - min x) / 2
    max   max |x|                                                   mean  a0
    Hk    sqrt(a^2 + b^2) of harmonic k of the excitation, which is basis harmonic nu k; H1/2 for a subharmonic one

Measures are functions of coefficients, shape (..., 2H + 1), that return shape (...). Users add their own with
`register_measure`. Harmonics are measures without an entry in the registry.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.common.text.messages import origin_of, quoted
from hbgear.mechanics.series.fourier import extrema, harmonics_of, to_complex, to_real


def rms(X: Array) -> Array:
    """Return the root mean square of the alternating part."""
    return np.sqrt(0.5 * np.sum(X[..., 1:] ** 2, axis=-1))


def half_peak_to_peak(X: Array) -> Array:
    """Return half the distance between the largest and the smallest value."""
    low, _, high, _ = extrema(X)
    return (high - low) / 2


def largest(X: Array) -> Array:
    """Return the largest absolute value."""
    low, _, high, _ = extrema(X)
    return np.maximum(np.abs(low), np.abs(high))


def mean(X: Array) -> Array:
    """Return the mean over a period."""
    return X[..., 0].copy()


def harmonic(X: Array, k: int) -> Array:
    """Return the amplitude of basis harmonic k >= 1."""
    return np.hypot(X[..., 2 * k - 1], X[..., 2 * k])


@dataclass(frozen=True)
class Measure:
    """Entry of the registry of measures.

    Attributes
    ----------
    name : str
        Name in functions, on the command line and in column names.
    function : callable
        Function of coefficients (..., 2H + 1) that returns values (...).
    text : str
        Description for axes and tables, such as "half peak-to-peak".
    dimension : int
        Power of the unit of the motion: 1 for an amplitude, 0 for a ratio, 2 for a mean square.
    unit : str
        Unit, if it does not follow from the unit of the motion. Empty otherwise.
    peaks : bool
        Whether `hbgear.analysis.peaks` can locate its peaks: the measure must be smooth where it is largest.
    default : bool
        Whether tables, data sets and pages contain it without a request.
    """

    name: str
    function: Callable[[Array], Array]
    text: str
    dimension: int = 1
    unit: str = ""
    peaks: bool = True
    default: bool = False

    def unit_for(self, motion: str) -> str:
        """Return the unit of the measure for a unit of the motion; "-" for a ratio.

        The unit of the motion is "-" or "1" if it is dimensionless, and empty if it is unknown.
        """
        if self.unit or self.dimension == 0:
            return self.unit or "-"
        return motion if self.dimension == 1 or motion in ("", "-", "1") else f"{motion}^{self.dimension}"


MEASURES: dict[str, Measure] = {
    "rms": Measure("rms", rms, "alternating rms", default=True),
    "pp2": Measure("pp2", half_peak_to_peak, "half peak-to-peak", default=True),
    "max": Measure("max", largest, "largest magnitude", default=True),
    "mean": Measure("mean", mean, "mean", default=True),
}
"""Registered measures by name."""

BUILT_IN_MEASURES = tuple(MEASURES)
"""Names of the measures of hbgear."""

UNKNOWN_UNIT = " (model units)"
"""End of the text of a motion whose unit is unknown."""

_HARMONIC = re.compile(r"H(\d+)(?:/([1-9]\d*))?")

_Function = TypeVar("_Function", bound=Callable[..., Any])


@overload
def register_measure(
    function: _Function,
    /,
    *,
    name: str | None = None,
    text: str | None = None,
    dimension: int = 1,
    unit: str = "",
    peaks: bool = True,
    default: bool = False,
) -> _Function: ...


@overload
def register_measure(
    *,
    name: str | None = None,
    text: str | None = None,
    dimension: int = 1,
    unit: str = "",
    peaks: bool = True,
    default: bool = False,
) -> Callable[[_Function], _Function]: ...


def register_measure(
    function: Any = None,
    /,
    *,
    name: str | None = None,
    text: str | None = None,
    dimension: int = 1,
    unit: str = "",
    peaks: bool = True,
    default: bool = False,
) -> Any:
    """Register a measure of amplitude: a decorator of a function, or a call.

    The forms are ``@register_measure`` for the default options, ``@register_measure(dimension=0)`` with options, and
    ``register_measure(function, dimension=0)`` for a function that exists. The name can then be used wherever a measure
    is given: `Branch.amplitude`, figures, peaks, redesign.

    Parameters
    ----------
    function : callable
        Function of the coefficients ``(a0, a1, b1, ..., aH, bH)``, shape (..., 2H + 1), that returns one value for each
        set, shape (...). With subharmonic order nu the harmonics are those of Omega / nu.
    name : str, optional
        Name of letters, digits and "_". Default: the name of the function.
    text : str, optional
        Description for axes and tables. Default: the name.
    dimension : int, optional
        Power of the unit of the motion: 1 (default) for an amplitude, 0 for a ratio, 2 for a mean square.
    unit : str, optional
        Unit, if it does not follow from the unit of the motion.
    peaks : bool, optional
        Whether peaks can be located and followed. The measure must be smooth there: Newton's method uses difference
        quotients of it. The default is True.
    default : bool, optional
        Whether tables, data sets and pages contain it without a request. The default is False.

    Returns
    -------
    callable
        The function itself, or a decorator if it is called with options only.

    Raises
    ------
    TypeError
        If the measure is no function.
    ValueError
        If the name cannot be used, or the function does not return one finite value for each set of coefficients.

    Notes
    -----
    A function that is defined again, as in a notebook, replaces the first definition.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> @hb.harmonic.register_measure(text="distortion", dimension=0)
    ... def distortion(coefficients):
    ...     size = np.hypot(coefficients[..., 1::2], coefficients[..., 2::2])
    ...     return np.sqrt((size[..., 1:] ** 2).sum(axis=-1)) / size[..., 0]
    ...
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> curve.amplitude("distortion").shape == curve.values.shape
    True
    >>> hb.plot.response(curve, "distortion").get_ylabel()
    'distortion of $x$ [-]'

    Without options, the decorator is written without parentheses:

    >>> @hb.harmonic.register_measure
    ... def fundamental(coefficients):
    ...     return np.hypot(coefficients[..., 1], coefficients[..., 2])
    ...
    >>> bool((curve.amplitude("fundamental") == curve.amplitude("H1")).all())
    True
    """

    def register(function: Any) -> Any:
        if not callable(function):
            raise TypeError(f"register_measure needs a function of coefficients (..., 2H + 1), got {quoted(function)}")
        measure_name = str(getattr(function, "__name__", "")) if name is None else name
        _check_name(measure_name, function)
        _check_function(measure_name, function)
        MEASURES[measure_name] = Measure(measure_name, function, text or measure_name, dimension, unit, peaks, default)
        return function

    return register if function is None else register(function)


def _check_name(name: str, function: Callable[[Array], Array]) -> None:
    """Raise an error if a measure cannot have a name."""
    if re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII) is None or _HARMONIC.fullmatch(name):
        raise ValueError(
            f"register_measure: the name {quoted(name)} must be letters, digits and _, and not H1, H2, ...; "
            "give another one: register_measure(name=...)"
        )
    existing = MEASURES.get(name)
    if existing is not None and (name in BUILT_IN_MEASURES or origin_of(existing.function) != origin_of(function)):
        raise ValueError(
            f"register_measure: the name '{name}' belongs to {'.'.join(origin_of(existing.function))}; "
            "give another one: register_measure(name=...)"
        )


def _check_function(name: str, function: Callable[[Array], Array]) -> None:
    """Raise an error if a function of coefficients does not return one finite value for each set."""
    for H in (1, 3):
        X = np.cos(np.arange(2 * 3 * (2 * H + 1))).reshape(2, 3, -1)
        try:
            values = np.asarray(function(X.copy()), dtype=float)
            is_valid = values.shape == (2, 3) and np.isfinite(values).all()
            is_valid = is_valid and np.allclose(values[1, 2], function(X[1, 2].copy()), rtol=1e-9, atol=1e-12)
        except (IndexError, TypeError, ValueError) as error:
            raise ValueError(
                f"register_measure: the measure '{name}' fails for coefficients of shape (2, 3, {2 * H + 1}) "
                f"({type(error).__name__}: {error}); index them as X[..., i] and reduce over axis=-1"
            ) from error
        if not is_valid:
            raise ValueError(
                f"register_measure: the measure '{name}' must return one finite value for each set of coefficients: "
                f"shape (2, 3) for (2, 3, {2 * H + 1}), got shape {values.shape}; reduce over axis=-1"
            )


def is_measure(name: str) -> bool:
    """Return whether a name is that of a registered measure, or of a harmonic such as "H1" or "H1/2"."""
    return name in MEASURES or _HARMONIC.fullmatch(name) is not None


def default_measures(same_unit: bool = False) -> dict[str, Measure]:
    """Return the measures that tables, data sets and pages contain, by name.

    With ``same_unit`` those of another unit than the motion are left out.
    """
    return {
        name: entry
        for name, entry in MEASURES.items()
        if entry.default and not (same_unit and (entry.unit or entry.dimension != 1))
    }


def motion_text(labels: Mapping[str, str], elements: Sequence[str] = (), index: int = 0) -> str:
    """Return the symbol of the displacement of an element, with its name, in units of the model.

    The labels of the model are empty for matrices of the user.

    Examples
    --------
    >>> motion_text({"amplitude": "$d$ [-]"}, ["gap L", "gap R"], 1), motion_text({}, ["stop"])
    ('$d$ [-], gap R', '$d$, stop (model units)')
    """
    if "amplitude" in labels:
        return labels["amplitude"] + (f", {elements[index]}" if len(elements) > 1 else "")
    return f"$d$, {elements[index]}{UNKNOWN_UNIT}" if elements else f"$d${UNKNOWN_UNIT}"


def axis_text(name: str, motion: str) -> str:
    """Return the text of an axis of a measure: description, symbol and unit, for a motion such as "d [um]"."""
    entry = MEASURES.get(name)
    if entry is None:
        return f"harmonic {name[1:]} of {motion}"
    if not entry.unit and entry.dimension == 1:
        return f"{entry.text} of {motion}"
    bracket = re.search(r"\s*\[([^\[\]]*)\]", motion)
    unit = entry.unit_for(bracket[1] if bracket else "")
    symbol = motion.replace(bracket[0], "", 1) if bracket else motion
    if not entry.dimension:  # a ratio has no unit of the motion
        symbol = symbol.removesuffix(UNKNOWN_UNIT)
    return f"{entry.text} of {symbol}{f' [{unit}]' if unit else ''}"


def measure(name: str, X: Array, nu: int = 1) -> Array:
    """Return a measure of motions X (..., 2H + 1) over nu periods of the excitation, for each motion.

    The name is "rms", "pp2", "max", "mean", "H1", "H2", ...; with nu = 2 also "H1/2", "H3/2", ... ValueError is raised
    if there is no measure of that name, or no such harmonic among the H of the motions.
    """
    X = np.asarray(X, dtype=float)
    return function_of(name, harmonics_of(X), nu)(X)


def function_of(name: str, H: int, nu: int) -> Callable[[Array], Array]:
    """Return the function of a measure for coefficients of H harmonics; see `measure`."""
    if name in MEASURES:
        return MEASURES[name].function
    match = _HARMONIC.fullmatch(name)
    if match is None:
        raise ValueError(f"no measure '{name}'; there are {_names(H, nu)}")
    numerator, denominator = int(match[1]) * nu, int(match[2] or 1)
    if numerator % denominator or not 1 <= numerator // denominator <= H:
        raise ValueError(f"no harmonic '{name}' among H = {H} harmonics of order nu = {nu}; there are {_names(H, nu)}")
    return partial(harmonic, k=numerator // denominator)


def _names(H: int, nu: int) -> str:
    """Return the names of all measures of motions of H harmonics, for messages."""
    orders = [f"H{k // nu}" if k % nu == 0 else f"H{k}/{nu}" for k in range(1, H + 1)]
    return ", ".join([*MEASURES, *(orders if H <= 4 else [*orders[:2], "...", orders[-1]])])


def check_measure(caller: str, name: str) -> None:
    """Raise ValueError for the name of an unknown measure; the message names the caller."""
    if not is_measure(name):
        raise ValueError(f"{caller}: no measure '{name}'; there are {', '.join(MEASURES)}, H1, H2, ...")


def check_peaks(name: str) -> None:
    """Raise ValueError for an unknown measure, or one whose peaks cannot be located (``peaks=False``)."""
    check_measure("peaks", name)
    if name in MEASURES and not MEASURES[name].peaks:
        usable = ", ".join(key for key, entry in MEASURES.items() if entry.peaks)
        raise ValueError(
            f"peaks of '{name}' cannot be located, because it is registered with peaks=False; "
            f"use {usable} or H1, H2, ..."
        )


def check_displacement(caller: str, name: str) -> None:
    """Raise ValueError for an unknown measure, or one of another unit than the motion, which is no length.

    The message names the caller.
    """
    check_measure(caller, name)
    if name in MEASURES and (MEASURES[name].unit or MEASURES[name].dimension != 1):
        usable = ", ".join(key for key, entry in MEASURES.items() if entry.dimension == 1 and not entry.unit)
        raise ValueError(f"{caller}: the measure '{name}' is not a displacement; use {usable} or H1, H2, ...")


def derivative(X: Array, rate: ArrayLike, order: int) -> Array:
    """Return the coefficients of a derivative in time of rows X (..., 2H + 1), c_k (i k rate)^order, at rates (...)."""
    counted("derivative", order, least=0)
    c = to_complex(np.asarray(X, dtype=float))
    return to_real(c * (1j * np.arange(c.shape[-1]) * np.asarray(rate, dtype=float)[..., None]) ** order)
