"""Table of the derivatives of the quantities of a point."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hbgear.analysis.parameter_sensitivity.units import LENGTH
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import csv_table
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.harmonic.models.frequency_units import PINION


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity:
    """Derivatives of the quantities of a point in the parameters of its model.

    Attributes
    ----------
    label : str
        Label of the point.
    parameters : tuple of str
        A names of parameters; entries of tuples as ``eps[0]``.
    values : ndarray, shape (A,)
        Values of the parameters.
    quantities : tuple of str
        Q names: the parameter of the branch, "mesh Hz" and "pinion r/min" if the model has `Scales`, and the amplitude
        ("pp2", with `Scales` also "pp2 m"; of a jump "pp2 before" and "pp2 after").
    sizes : ndarray, shape (Q,)
        Values of the quantities.
    slopes : ndarray, shape (Q, A)
        Derivatives in the units of quantity and parameter; nan where the derivative does not exist.
    units : mapping of str to str
        Units of the parameters that have one.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> table = hb.analysis.sensitivity(curve["LP1"])
    >>> table.quantities
    ('Omega', 'rms')
    >>> max(table.percent("Omega"), key=table.percent("Omega").get)
    'F'
    """

    label: str
    parameters: tuple[str, ...]
    values: Array
    quantities: tuple[str, ...]
    sizes: Array
    slopes: Array
    units: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        largest = next(iter(self.percent()), "")
        quantities = ", ".join(self.quantities)
        return f"<Sensitivity of {self.label}: {quantities} in {len(self.parameters)} parameters; {largest}>"

    @checked_arguments()
    def shown(self, dimensionless: bool = False) -> tuple[str, ...]:
        """Return the quantities in physical units if they are known, with the speed of the pinion instead of Omega.

        Parameters
        ----------
        dimensionless : bool, optional
            Whether all quantities are returned; default False.

        Returns
        -------
        tuple of str
            Names of quantities.
        """
        if dimensionless or PINION not in self.quantities:
            return self.quantities
        hidden = {name for name in self.quantities if f"{name} {LENGTH}" in self.quantities}
        quantities = [PINION if name == "Omega" else name for name in self.quantities if name not in hidden]
        return tuple(dict.fromkeys(quantities))

    @checked_arguments()
    def size(self, quantity: str = "") -> float:
        """Return the value of a quantity.

        Parameters
        ----------
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        float
            Value.
        """
        return float(self.sizes[self._index(quantity)])

    @checked_arguments()
    def of(self, quantity: str = "") -> dict[str, float]:
        """Return the derivatives of a quantity in each parameter.

        Parameters
        ----------
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        dict of str to float
            Derivative by name of the parameter.

        Raises
        ------
        KeyError
            If there is no such quantity.
        """
        return dict(zip(self.parameters, self.slopes[self._index(quantity)].tolist(), strict=True))

    @checked_arguments()
    def percent(self, quantity: str = "") -> dict[str, float]:
        """Return the change of a quantity in percent for one percent of each parameter that is not zero.

        Parameters
        ----------
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        dict of str to float
            Change [%] by name of the parameter, the largest first, nan last.

        Raises
        ------
        KeyError
            If there is no such quantity.
        """
        i = self._index(quantity)
        change = self.slopes[i] * self.values / (self.sizes[i] or math.nan)
        order = np.argsort(-np.abs(change), kind="stable")
        return {self.parameters[a]: float(change[a]) for a in order if self.values[a]}

    @checked_arguments(spread="a dictionary of standard deviations by name, such as {'zeta': 0.002}")
    def scatter(self, spread: Mapping[str, float], quantity: str = "") -> float:
        """Return the standard deviation of a quantity for independent small deviations of parameters, to first order.

            s^2 = sum_a (dquantity/da s_a)^2

        Parameters
        ----------
        spread : dict of str to float
            Standard deviations of parameters by name, in their units.
        quantity : str, optional
            Name of the quantity. By default the first one.

        Returns
        -------
        float
            Standard deviation in the unit of the quantity.

        Raises
        ------
        KeyError, ValueError
            If there is no such quantity or parameter, or a deviation is negative.
        """
        slopes = self.of(quantity)
        for name, deviation in spread.items():
            if name not in slopes:
                raise KeyError(f"no derivative in '{name}'{did_you_mean(name, slopes)}")
            if not deviation >= 0:
                raise ValueError(f"spread: {name} = {quoted(deviation)} must be a standard deviation of at least 0")
        return math.sqrt(sum((slopes[name] * deviation) ** 2 for name, deviation in spread.items()))

    @checked_arguments()
    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a .csv file with parameter, value and derivatives of each quantity; no file is left after an error.

        Parameters
        ----------
        path : str or path-like
            File. Its name ends in .csv.

        Raises
        ------
        ValueError
            If the name of the file has another ending.
        """
        if not str(path).endswith(".csv"):
            raise ValueError(f"'{path}' must end in .csv")
        with csv_table(path) as writer:
            writer.writerow(["parameter", "value", *(f"d {quantity}" for quantity in self.quantities)])
            writer.writerow(["", "", *self.sizes.tolist()])
            for row in zip(self.parameters, self.values.tolist(), *self.slopes.tolist(), strict=True):
                writer.writerow(row)

    def _index(self, quantity: str) -> int:
        """Return the number of a quantity."""
        if quantity and quantity not in self.quantities:
            raise KeyError(f"no derivatives of '{quantity}'{did_you_mean(quantity, self.quantities)}")
        return self.quantities.index(quantity) if quantity else 0
