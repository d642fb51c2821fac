"""Sobol indices: contributions of the parameters to the variance of a result of a study.

    first order   S_j = Var(E(Y | a_j)) / Var(Y)         effect of a_j alone
    total         T_j = 1 - Var(E(Y | a_~j)) / Var(Y)    effect of a_j with its interactions

a_~j are all parameters except a_j. SALib estimates the indices from blocks of cases in which parameters are exchanged
one by one between two random cases (`hbgear.design.studies.samples.saltelli`). The indices do not assume a linear
model, but they need many cases.

References
----------
Sobol (2001), Mathematics and Computers in Simulation 55, https://doi.org/10.1016/S0378-4754(00)00270-6.
Saltelli et al. (2010), Computer Physics Communications 181(2), https://doi.org/10.1016/j.cpc.2009.09.018.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.optional import needed
from hbgear.common.ranges import counted
from hbgear.common.text.messages import did_you_mean
from hbgear.design.studies.case_results import Cases

_INTERVAL_SIGMAS = 1.959964
"""Half width of a 95 % confidence interval in standard deviations."""


@dataclass(frozen=True)
class SobolIndices:
    """Sobol indices of a result.

    Attributes
    ----------
    quantity : str
        Name of the result, a column of the table.
    first, total : dict of str to tuple[float, float]
        First-order and total index with standard error, by parameter.
    blocks, lost : int
        Number of blocks of cases, and number of blocks that are ignored because the result is unknown in a case. If
        many blocks are lost, the indices describe the remaining blocks only.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.design.SobolIndices("peak", {"zeta": (0.7, 0.05)}, {"zeta": (0.8, 0.04)}, 64, 0).total["zeta"]
    (0.8, 0.04)
    """

    quantity: str
    first: dict[str, tuple[float, float]]
    total: dict[str, tuple[float, float]]
    blocks: int
    lost: int


@checked_arguments(found="cases of saltelli(...)")
def sobol_indices(found: Cases, quantity: str = "peak", *, seed: int = 0) -> SobolIndices:
    """Compute Sobol indices of a result of a study. They need SALib: ``pip install 'hbgear[sobol]'``.

    Parameters
    ----------
    found : Cases
        Results of `cases` for a sample from `saltelli`.
    quantity : str, default "peak"
        Column of ``found.table`` or ``found.physical_table``, such as "peak", "peak_Omega" or "peak [um]".
    seed : int, default 0
        Seed of the resampling that estimates the standard errors.

    Returns
    -------
    SobolIndices
        Indices with standard errors.

    Raises
    ------
    KeyError
        If there is no such column.
    ValueError
        If the cases are another sample, the result is unknown in most of the blocks or does not vary, or SALib is not
        installed.

    Examples
    --------
    >>> import hbgear as hb
    >>> drawn = hb.design.saltelli(64, zeta=("uniform", 0.04, 0.06), F=("normal", 0.2, 0.01))
    >>> found = hb.design.cases(hb.Duffing(), drawn, ("peak",), harmonics=3)  # doctest: +SKIP
    >>> index, error = hb.design.sobol_indices(found, "peak").total["F"]  # doctest: +SKIP
    """
    counted("sobol_indices: seed", seed, least=0)
    table = found.table if quantity in found.table else found.physical_table
    if quantity not in table or quantity in ("case", "reason"):
        raise KeyError(f"there is no column '{quantity}'{did_you_mean(quantity, table)}")
    width = len(found.names) + 2
    Y = _blocks(found, table[quantity], width)
    valid = np.isfinite(Y).all(axis=1)
    count, count_valid = len(Y), int(valid.sum())
    if 2 * count_valid < count or count_valid < 2:
        raise ValueError(f"{quantity} is known in {count_valid} of {count} blocks of cases; too few for indices")
    if np.ptp(Y[valid]) <= 1e-12 * np.abs(Y[valid]).max():
        raise ValueError(f"{quantity} does not vary, so its indices are not defined")
    analyze = needed("SALib.analyze.sobol", "sobol", "Sobol indices").analyze
    settings = {"num_vars": len(found.names), "names": list(found.names), "bounds": [[0.0, 1.0]] * len(found.names)}
    indices = analyze(settings, Y[valid].ravel(), calc_second_order=False, seed=seed + 1)  # for SALib 0 means no seed
    first, total = (
        {
            name: (float(indices[key][j]), float(indices[f"{key}_conf"][j]) / _INTERVAL_SIGMAS)
            for j, name in enumerate(found.names)
        }
        for key in ("S1", "ST")
    )
    return SobolIndices(quantity, first, total, count, count - count_valid)


def _blocks(found: Cases, results: Array, width: int) -> Array:
    """Return the result in each block of cases (B, parameters + 2), nan if it is unknown."""
    values = np.full((found.total, len(found.names) + 1), np.nan)
    columns = [np.asarray(column, dtype=float) for column in (*(found.table[name] for name in found.names), results)]
    values[np.asarray(found.table["case"], dtype=int)] = np.column_stack(columns)
    if found.total % width:
        raise ValueError("the cases are not a sample from saltelli; compute them with vary=saltelli(...)")
    blocks = values.reshape(-1, width, len(found.names) + 1)
    a = blocks[:, :1, :-1]
    with np.errstate(invalid="ignore"):
        exchanged = (blocks[:, 1:-1, :-1] == a) | np.isnan(blocks[:, 1:-1, :-1] + a)
    if not (exchanged | np.eye(len(found.names), dtype=bool)).all():
        raise ValueError("the cases are not a sample from saltelli; compute them with vary=saltelli(...)")
    return np.asarray(blocks[..., -1])
