"""Which scatter matters: shares of the variance of a number of a study that parameters are to blame for.

    first   S_j = Var(E(Y | a_j)) / Var(Y)        a_j alone
    total   T_j = 1 - Var(E(Y | a_~j)) / Var(Y)   a_j with all others: what is left if all others are known

Estimated from blocks of cases in which parameters are exchanged one by one between two random rows
(`hbgear.design.studies.samples.saltelli`), by SALib. No linear approximation; the price is many cases.

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
from hbgear.design.studies.study import Cases

_NORMAL = 1.959964  # half of a 95 % interval in standard deviations


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the variance of a number.

    Parameters
    ----------
    quantity : str
        Which one, a column of the table.
    first, total : dict of str, tuple[float to float]
        By parameter, the index and its standard error.
    blocks, lost : int
        How many blocks of cases there are, and in how many of them the number is not known: they are left out. If they
        are not few, the indices are those of the rest only.

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
    """Sobol indices of a number of a study. Needs SALib: ``pip install 'hbgear[sobol]'``.

    Parameters
    ----------
    found : Cases
        Of `cases` with `saltelli`.
    quantity : str, default "peak"
        A column of ``found.table``, such as "peak", "peak_Omega", "jump_rising".
    seed : int, default 0
        Of the resampling that the standard errors are from: the same seed, the same errors.

    Raises
    ------
    KeyError
        If there is no such column.
    ValueError
        If the cases are of another sample, the number is not known in most of the blocks or does not vary, or SALib is
        not installed.

    Examples
    --------
    >>> import hbgear as hb
    >>> drawn = hb.design.saltelli(64, zeta=("uniform", 0.04, 0.06), F=("normal", 0.2, 0.01))
    >>> found = hb.design.cases(hb.Duffing(), drawn, ("peak",), harmonics=3)  # doctest: +SKIP
    >>> index, error = hb.design.sobol_indices(found, "peak").total["F"]  # doctest: +SKIP
    """
    counted("sobol_indices: seed", seed, least=0)
    if quantity not in found.table or quantity in ("case", "reason"):
        raise KeyError(f"there is no number '{quantity}'{did_you_mean(quantity, found.table)}")
    width = len(found.names) + 2
    Y = _blocks(found, quantity, width)
    known = np.isfinite(Y).all(axis=1)
    count, some = len(Y), int(known.sum())
    if 2 * some < count or some < 2:
        raise ValueError(f"{quantity} is known in {some} of {count} blocks of cases; too few for indices")
    if np.ptp(Y[known]) <= 1e-12 * np.abs(Y[known]).max():
        raise ValueError(f"{quantity} does not vary, so nothing is to blame for it")
    analyze = needed("SALib.analyze.sobol", "sobol", "Sobol indices").analyze
    asked = {"num_vars": len(found.names), "names": list(found.names), "bounds": [[0.0, 1.0]] * len(found.names)}
    told = analyze(asked, Y[known].ravel(), calc_second_order=False, seed=seed + 1)  # SALib takes 0 for no seed at all
    first, total = (
        {name: (float(told[key][j]), float(told[f"{key}_conf"][j]) / _NORMAL) for j, name in enumerate(found.names)}
        for key in ("S1", "ST")
    )
    return SobolIndices(quantity, first, total, count, count - some)


def _blocks(found: Cases, quantity: str, width: int) -> Array:
    """The number in each block of cases (B, parameters + 2), nan where it is not known."""
    values = np.full((found.total, len(found.names) + 1), np.nan)
    columns = [np.asarray(found.table[name], dtype=float) for name in (*found.names, quantity)]
    values[np.asarray(found.table["case"], dtype=int)] = np.column_stack(columns)
    if found.total % width:
        raise ValueError("the cases are no blocks of Saltelli's; take those of vary=saltelli(...)")
    blocks = values.reshape(-1, width, len(found.names) + 1)
    a = blocks[:, :1, :-1]
    with np.errstate(invalid="ignore"):
        same = (blocks[:, 1:-1, :-1] == a) | np.isnan(blocks[:, 1:-1, :-1] + a)
    if not (same | np.eye(len(found.names), dtype=bool)).all():
        raise ValueError("the cases are no blocks of Saltelli's; take those of vary=saltelli(...)")
    return np.asarray(blocks[..., -1])
