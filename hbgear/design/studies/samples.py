"""Cases of a design study: every combination of given values, or a random sample of distributions.

    value of parameter j in case i = F_j^-1(u_ij)

    Latin hypercube   u_ij = (pi_j(i) + r) / n: one case in each of n intervals of equal probability of every parameter
    Monte Carlo       u_ij independent and uniform in (0, 1)
    Saltelli          blocks of cases a, b and, for each j, a with u_j of b: see `hbgear.design.uncertainty.sobol`

F_j is the cumulative distribution of parameter j. A longer Monte Carlo sample starts with the cases of a shorter one.

References
----------
McKay, Beckman & Conover (1979), Technometrics 21(2), https://doi.org/10.1080/00401706.1979.10489755.
Saltelli et al. (2010), Computer Physics Communications 181(2), https://doi.org/10.1016/j.cpc.2009.09.018.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.optional import needed
from hbgear.common.ranges import counted
from hbgear.common.text.messages import did_you_mean, quoted, shortened

METHODS = ("latin-hypercube", "monte-carlo", "saltelli")
"""Methods of random samples."""

DISTRIBUTIONS: dict[str, tuple[tuple[str, ...], Callable[..., Any]]] = {
    "uniform": (("low", "high"), lambda s, a, b: s.uniform(a, b - a)),
    "normal": (("mean", "deviation"), lambda s, mean, d: s.norm(mean, d)),
    "truncated_normal": (
        ("mean", "deviation", "low", "high"),
        lambda s, mean, d, a, b: s.truncnorm((a - mean) / d, (b - mean) / d, mean, d),
    ),
    "lognormal": (("median", "sigma"), lambda s, median, sigma: s.lognorm(sigma, scale=median)),
    "triangular": (("low", "mode", "high"), lambda s, a, c, b: s.triang((c - a) / (b - a), a, b - a)),
}
"""Distributions by name: names of their numbers, and distribution of scipy.stats.

sigma is the standard deviation of the logarithm."""

_MIN_PROBABILITY = 2.0**-53
"""Distance of neighbouring random numbers; probabilities are kept this far from 0 and 1."""


@dataclass(frozen=True)
class Grid:
    """Every combination of the values ``values[name]`` of the parameters; the last parameter changes fastest."""

    values: Mapping[str, Sequence[Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that vary."""
        return tuple(self.values)

    @property
    def size(self) -> int:
        """Number of cases."""
        return math.prod(len(values) for values in self.values.values())

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the values of each case by name."""
        return (dict(zip(self.values, row, strict=True)) for row in product(*self.values.values()))


@dataclass(frozen=True)
class Sample:
    """Random sample of ``size`` cases.

    ``method`` is one of `METHODS`; each distribution is ``(name of DISTRIBUTIONS, number, ...)``.
    """

    method: str
    size: int
    seed: int
    distributions: Mapping[str, Sequence[Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that vary."""
        return tuple(self.distributions)

    def uniform(self) -> Array:
        """Return probabilities in (0, 1), shape (size, parameters)."""
        if self.method == "monte-carlo":
            return np.random.default_rng(self.seed).random((self.size, len(self.names)))
        if self.method == "saltelli":
            return self._blocks()
        from scipy.stats import qmc

        return np.asarray(qmc.LatinHypercube(len(self.names), seed=self.seed).random(self.size))

    def _blocks(self) -> Array:
        """Return the cases of the sequence of SALib, in blocks of parameters + 2."""
        width = len(self.names) + 2
        blocks = self.size // width
        if self.size % width or blocks & (blocks - 1):
            raise ValueError(
                f"{self.size} cases cannot be divided into blocks of {width} (for {len(self.names)} parameters) whose "
                f"number is a power of 2: use {width * 2 ** max(1, round(math.log2(self.size / width)))}"
            )
        sobol = needed("SALib.sample.sobol", "sobol", "a sample by Saltelli")
        settings = {"num_vars": len(self.names), "names": list(self.names), "bounds": [[0.0, 1.0]] * len(self.names)}
        u = sobol.sample(settings, blocks, calc_second_order=False, seed=self.seed)
        return np.asarray(u).clip(_MIN_PROBABILITY, 1 - _MIN_PROBABILITY)

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the values of each case by name."""
        u = self.uniform()
        columns = [distribution(x).ppf(u[:, j]) for j, x in enumerate(self.distributions.values())]
        return (dict(zip(self.names, map(float, row), strict=True)) for row in zip(*columns, strict=True))


def grid(**values: Sequence[Any]) -> Grid:
    """Return every combination of values of the fields of a model.

    Parameters
    ----------
    **values : sequence
        Values of each field.

    Returns
    -------
    Grid
        The cases; the last field changes fastest.

    Raises
    ------
    ValueError
        If there is no field, or a field has no value or one value twice.

    Examples
    --------
    >>> import hbgear as hb
    >>> two = hb.design.grid(zeta=[0.05, 0.06], F_m=[0.1, 0.2, 0.3])
    >>> [row["F_m"] for row in two.rows()], two.names
    ([0.1, 0.2, 0.3, 0.1, 0.2, 0.3], ('zeta', 'F_m'))
    """
    if not values:
        raise ValueError("a grid needs at least one parameter, such as grid(zeta=[0.04, 0.05])")
    for name, levels in values.items():
        listed = isinstance(levels, Collection) and not isinstance(levels, str) and getattr(levels, "ndim", 1) == 1
        if not listed or not len(levels):
            raise ValueError(f"grid: {name} = {quoted(levels)}: need a list of at least one value")
        if len({repr(x) for x in levels}) < len(levels):
            raise ValueError(f"grid: {name} has a value twice; give each once")
    return Grid({name: tuple(x.item() if isinstance(x, np.generic) else x for x in v) for name, v in values.items()})


def latin_hypercube(count: int, seed: int = 0, /, **distributions: Sequence[Any]) -> Sample:
    """Return a random sample with one case in each of ``count`` intervals of equal probability of every parameter.

    Parameters
    ----------
    count : int
        Number of cases.
    seed : int, default 0
        Seed of the random numbers.
    **distributions : sequence
        Distribution of each parameter, such as ``zeta=("uniform", 0.04, 0.08)``; `DISTRIBUTIONS` lists the names and
        numbers.

    Returns
    -------
    Sample
        The cases.

    Raises
    ------
    ValueError
        If the count is below 1, or the numbers of a distribution are not valid.
    KeyError
        If there is no such distribution.

    Examples
    --------
    >>> import hbgear as hb
    >>> drawn = hb.design.latin_hypercube(4, zeta=("uniform", 0.04, 0.06))
    >>> len(list(drawn.rows())), all(0.04 <= row["zeta"] <= 0.06 for row in drawn.rows())
    (4, True)
    """
    return _sample("latin-hypercube", count, seed, distributions)


def monte_carlo(count: int, seed: int = 0, /, **distributions: Sequence[Any]) -> Sample:
    """Return independent random cases, for example of manufacturing tolerances.

    The arguments and errors are the ones of `latin_hypercube`.

    Examples
    --------
    >>> import hbgear as hb
    >>> drawn = hb.design.monte_carlo(3, 7, zeta=("normal", 0.05, 0.001))
    >>> again = hb.design.monte_carlo(3, 7, zeta=("normal", 0.05, 0.001))
    >>> list(drawn.rows()) == list(again.rows())
    True
    """
    return _sample("monte-carlo", count, seed, distributions)


def saltelli(blocks: int, seed: int = 0, /, **distributions: Sequence[Any]) -> Sample:
    """Return the cases for `sobol_indices`: ``blocks`` blocks of as many cases as parameters and two more.

    It needs SALib, ``pip install 'hbgear[sobol]'``.

    Parameters
    ----------
    blocks : int
        Number of blocks, a power of 2.
    seed : int, default 0
        Seed of the random numbers.
    **distributions : sequence
        Distribution of each parameter, as in `latin_hypercube`.

    Returns
    -------
    Sample
        The cases.

    Raises
    ------
    ValueError
        If the number of blocks is not a power of 2, or the numbers of a distribution are not valid.
    KeyError
        If there is no such distribution.

    Examples
    --------
    >>> import hbgear as hb
    >>> drawn = hb.design.saltelli(8, zeta=("uniform", 0.04, 0.06), F_m=("normal", 0.1, 0.005))
    >>> drawn.size
    32
    """
    counted("blocks", blocks, 1_000_000)
    if blocks & (blocks - 1):
        raise ValueError(f"blocks = {blocks} must be a power of 2, such as {2 ** round(math.log2(blocks))}")
    return _sample("saltelli", blocks * (len(distributions) + 2), seed, distributions)


def _sample(method: str, count: int, seed: int, distributions: Mapping[str, Sequence[Any]]) -> Sample:
    counted("count", count, 10_000_000)
    counted("seed", seed, least=0)
    if not distributions:
        raise ValueError(
            f"a sample of {count} cases needs at least one parameter, such as zeta=('uniform', 0.04, 0.06)"
        )
    for definition in distributions.values():
        distribution(definition)
    return Sample(method, count, seed, {name: tuple(definition) for name, definition in distributions.items()})


def distribution(given: Sequence[Any]) -> Any:
    """Return the frozen distribution of scipy.stats for a definition such as ``("uniform", 0.04, 0.08)``.

    KeyError is raised for another name than those of `DISTRIBUTIONS`, ValueError if the number of its numbers is wrong,
    they are not finite or not in order, or its values overflow.
    """
    from scipy import stats

    if not isinstance(given, list | tuple):
        raise ValueError(f"the distribution {quoted(given)} must have a form such as ('uniform', low, high)")
    if not given or not isinstance(given[0], str) or given[0] not in DISTRIBUTIONS:
        name = shortened(str(given[0])) if given else ""
        raise KeyError(f"there is no distribution '{name}'{did_you_mean(name, DISTRIBUTIONS)}")
    name, *numbers = given
    meaning, make = DISTRIBUTIONS[name]
    need = f"need {', '.join(meaning)}"
    if len(numbers) != len(meaning) or not all(
        isinstance(x, int | float) and abs(x) <= sys.float_info.max for x in numbers
    ):
        raise ValueError(f"{name} of {quoted(numbers)}: {need}, {len(meaning)} finite numbers")
    bounds = [x for x, role in zip(numbers, meaning, strict=True) if role in ("low", "mode", "high")]
    positive = [x for x, role in zip(numbers, meaning, strict=True) if role in ("deviation", "sigma", "median")]
    if bounds != sorted(bounds) or (bounds and bounds[0] == bounds[-1]) or any(x <= 0 for x in positive):
        raise ValueError(f"{name} of {numbers}: {need}, in ascending order and not all equal, deviations positive")
    with np.errstate(all="ignore"):
        frozen = make(stats, *map(float, numbers))
        ends = frozen.ppf([_MIN_PROBABILITY, 0.5, 1 - _MIN_PROBABILITY])
    if not np.all(np.isfinite(ends)):
        raise ValueError(f"{name} of {numbers}: its values overflow; {need} that give smaller values")
    return frozen
