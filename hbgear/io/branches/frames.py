"""Curves as pandas data frames and xarray data sets: `Branch.to_dataframe` and `Branch.to_xarray`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hbgear.common.optional import needed
from hbgear.common.text.symbols import unit_of, without_unit
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.stability import STABILITY_STATES
from hbgear.harmonic.equations.layout import layout_of
from hbgear.io.branches.columns import Column, about, columns_of, label_of, terms_of
from hbgear.mechanics.series.measures import default_measures

if TYPE_CHECKING:
    import pandas
    import xarray


def to_dataframe(branch: Branch) -> pandas.DataFrame:
    """Return a pandas data frame with one line per point.

    Parameters
    ----------
    branch : Branch
        Branch. If its span has other branches, the column ``curve`` comes first and holds their numbers.

    Returns
    -------
    pandas.DataFrame
        Columns as in the .csv file; units and descriptions are in ``attrs``.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> frame = hb.io.to_dataframe(curve)
    >>> len(frame) == len(curve), "rms_x" in frame.columns
    (True, True)
    """
    pd = needed("pandas", "data", "a data frame")
    curves = branch.curves
    frames = []
    all_columns: dict[str, Column] = {}
    for number, curve in enumerate(curves, 1):
        columns = columns_of(curve)
        all_columns |= columns
        frame = pd.DataFrame({name: _with_nan(column.values) for name, column in columns.items()})
        if len(curves) > 1:
            frame.insert(0, "curve", number)
        frames.append(frame)
    result: pandas.DataFrame = pd.concat(frames, ignore_index=True) if len(frames) > 1 else frames[0]
    result.attrs = {
        **about(branch),
        "units": {name: column.unit for name, column in all_columns.items()},
        "long_names": {name: column.meaning for name, column in all_columns.items()},
    }
    return result


def _with_nan(values: Any) -> Any:
    """Return numbers with nan for empty entries."""
    listed = list(values)
    numbers = any(isinstance(value, int | float) for value in listed)
    return np.array([np.nan if value == "" else value for value in listed]) if numbers else listed


def to_xarray(branch: Branch) -> xarray.Dataset:
    """Return a data set with the dimensions point, element, term, measure and multiplier.

    Units and long names are attributes. Complex multipliers are two variables, for all versions of NetCDF.

    Parameters
    ----------
    branch : Branch
        Branch.

    Returns
    -------
    xarray.Dataset
        The data set.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> data = hb.io.to_xarray(curve)
    >>> data.measure.values.tolist()
    ['rms', 'pp2', 'max', 'mean']
    """
    xr = needed("xarray", "data", "a data set")
    layout = layout_of(branch)
    columns = columns_of(branch)
    labels = layout.labels if layout else {}
    size = {"units": unit_of(labels.get("amplitude", "")), "symbol": without_unit(labels.get("amplitude", "gap"))}
    data: dict[str, Any] = {}
    for name in (*branch.tracked, "mesh_Hz", "pinion_rpm", "residual", "iterations", "error", "special", "landing"):
        if name in columns:
            data[name] = ("point", _array(columns[name].values), _attributes(columns[name].meaning, columns[name].unit))
    names = ", ".join(f"{i} {state}" for i, state in enumerate(STABILITY_STATES))
    codes = np.array([STABILITY_STATES.index(state) for state in branch.stability], dtype=np.int8)
    data["stability"] = ("point", codes, _attributes(f"stability: {names}", ""))
    if branch.multipliers is not None:
        for part in ("real", "imag"):
            meaning = _attributes(f"Floquet multipliers, {part} part", "1")
            data[f"multipliers_{part}"] = (("point", "multiplier"), getattr(branch.multipliers, part).copy(), meaning)
    coords: dict[str, Any] = {
        branch.parameter: ("point", branch.values, _attributes(*_words(label_of(branch, branch.parameter))))
    }
    if layout is None:
        data["X"] = (("point", "unknown"), branch.X, {"long_name": "unknowns"})
    else:
        measures = default_measures(same_unit=True)
        coords |= {"element": list(layout.elements), "term": terms_of(layout), "measure": list(measures)}
        elements = range(len(layout.elements))
        amplitude = np.array([[branch.amplitude(name, j) for j in elements] for name in measures])
        meanings = "; ".join(f"{name}: {entry.text}" for name, entry in measures.items())
        for name in default_measures().keys() - measures.keys():  # an array has one unit
            element_columns = [columns[f"{name}_{element}"] for element in layout.elements]
            values = np.stack([part.values for part in element_columns], axis=-1)
            data[name] = (
                ("point", "element"),
                values,
                _attributes(element_columns[0].meaning, element_columns[0].unit),
            )
        data["amplitude"] = (
            ("point", "element", "measure"),
            amplitude.transpose(2, 1, 0),
            {"long_name": "amplitude of the motion", "measures": meanings, **size},
        )
        data["coefficients"] = (
            ("point", "element", "term"),
            layout.spread(branch.X),
            {"long_name": "Fourier coefficients a0, a1, b1, ... over the phase tau / nu", "nu": layout.nu, **size},
        )
        data["regime"] = (
            ("point", "element"),
            branch.regime,
            {"long_name": f"impact regime: {', '.join(f'{i} {x}' for i, x in enumerate(layout.regimes))}, -1 unknown"},
        )
    for name, value in branch.fixed.items():
        data[name] = ((), value, _attributes(*_words(label_of(branch, name))))
    return xr.Dataset(data, coords, about(branch))


def _words(label: str) -> tuple[str, str]:
    return without_unit(label), unit_of(label)


def _attributes(meaning: str, unit: str) -> dict[str, str]:
    return {"long_name": meaning, **({"units": unit} if unit else {})}


def _array(values: Any) -> Any:
    """Return an array; texts get a fixed width, which every format can hold."""
    array = np.asarray(values)
    return array.astype(str) if array.dtype.kind in "OU" else array
