"""Which cases a design study has: every combination of given values, or a random sample of distributions.

    Latin hypercube   u_ij = (pi_j(i) + r) / n: one case in each n-th of every parameter   value = F_j^-1(u_ij)
    Monte Carlo       u_ij independent and uniform in (0, 1)

    Saltelli          blocks of rows a, b and, for each j, a with u_j of b: see `hbgear.design.uncertainty.sobol`

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


DISTRIBUTIONS: dict[str, tuple[tuple[str, ...], Callable[..., Any]]] = {
    "uniform": (("low", "high"), lambda s, a, b: s.uniform(a, b - a)),
    "normal": (("mean", "deviation"), lambda s, mean, d: s.norm(mean, d)),
    "truncated_normal": (("mean", "deviation", "low", "high"),
                         lambda s, mean, d, a, b: s.truncnorm((a - mean) / d, (b - mean) / d, mean, d)),
    "lognormal": (("median", "sigma"), lambda s, median, sigma: s.lognorm(sigma, scale=median)),
    "triangular": (("low", "mode", "high"), lambda s, a, c, b: s.triang((c - a) / (b - a), a, b - a)),
}  # fmt: skip
"""Names, what their numbers mean, and how scipy.stats calls them; sigma is the deviation of the logarithm."""

_LEAST = 2.0**-53  # chance between neighbouring random numbers


@dataclass(frozen=True)
class Grid:
    """Every combination of values, ``values[name]`` for each parameter; the last one changes fastest."""

    values: Mapping[str, Sequence[Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that vary."""
        return tuple(self.values)

    @property
    def size(self) -> int:
        """Number of cases, known without listing them."""
        return math.prod(len(values) for values in self.values.values())

    def rows(self) -> Iterator[dict[str, Any]]:
        """The values of each case by name."""
        return (dict(zip(self.values, row, strict=True)) for row in product(*self.values.values()))


@dataclass(frozen=True)
class Sample:
    """``size`` random cases; method: one of `METHODS`; distributions: ``(name of DISTRIBUTIONS, number, ...)``."""

    method: str
    size: int
    seed: int
    distributions: Mapping[str, Sequence[Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that vary."""
        return tuple(self.distributions)

    def uniform(self) -> Array:
        """(size, parameters) in (0, 1)."""
        if self.method == "monte-carlo":
            return np.random.default_rng(self.seed).random((self.size, len(self.names)))
        if self.method == "saltelli":
            return self._blocks()
        from scipy.stats import qmc

        return np.asarray(qmc.LatinHypercube(len(self.names), seed=self.seed).random(self.size))

    def _blocks(self) -> Array:
        """Rows of SALib's sequence, in blocks of parameters + 2."""
        width = len(self.names) + 2
        blocks = self.size // width
        if self.size % width or blocks & (blocks - 1):
            raise ValueError(
                f"{self.size} cases are no blocks of {width}, for {len(self.names)} parameters, as many as a power of "
                f"2: take {width * 2 ** max(1, round(math.log2(self.size / width)))}"
            )
        sobol = needed("SALib.sample.sobol", "sobol", "a sample by Saltelli")
        asked = {"num_vars": len(self.names), "names": list(self.names), "bounds": [[0.0, 1.0]] * len(self.names)}
        u = sobol.sample(asked, blocks, calc_second_order=False, seed=self.seed)
        return np.asarray(u).clip(_LEAST, 1 - _LEAST)

    def rows(self) -> Iterator[dict[str, Any]]:
        """The values of each case by name."""
        u = self.uniform()
        columns = [distribution(x).ppf(u[:, j]) for j, x in enumerate(self.distributions.values())]
        return (dict(zip(self.names, map(float, row), strict=True)) for row in zip(*columns, strict=True))


def grid(**values: Sequence[Any]) -> Grid:
    """Every combination of these values of the fields of a model.

    Raises
    ------
    ValueError
        If there is no parameter, or one has no value or the same value twice.

    Examples
    --------
    >>> import hbgear as hb
    >>> two = hb.design.grid(zeta=[0.05, 0.06], F_m=[0.1, 0.2, 0.3])
    >>> [row["F_m"] for row in two.rows()], two.names
    ([0.1, 0.2, 0.3, 0.1, 0.2, 0.3], ('zeta', 'F_m'))
    """
    if not values:
        raise ValueError("a grid needs at least one parameter: grid(zeta=[0.04, 0.05])")
    for name, each in values.items():
        listed = isinstance(each, Collection) and not isinstance(each, str) and getattr(each, "ndim", 1) == 1
        if not listed or not len(each):
            raise ValueError(f"grid: {name} = {quoted(each)}: need a list of at least one value")
        if len({repr(x) for x in each}) < len(each):
            raise ValueError(f"grid: {name} has a value twice; give each once")
    return Grid({name: tuple(x.item() if isinstance(x, np.generic) else x for x in v) for name, v in values.items()})


def latin_hypercube(count: int, seed: int = 0, /, **distributions: Sequence[Any]) -> Sample:
    """Cases spread evenly over each parameter: ``latin_hypercube(100, 1, zeta=("uniform", 0.04, 0.08))``.

    Raises
    ------
    ValueError, KeyError
        If the count is below 1, there is no such distribution, or its numbers do not fit.

    Examples
    --------
    >>> import hbgear as hb
    >>> drawn = hb.design.latin_hypercube(4, zeta=("uniform", 0.04, 0.06))
    >>> len(list(drawn.rows())), all(0.04 <= row["zeta"] <= 0.06 for row in drawn.rows())
    (4, True)
    """
    return _sample("latin-hypercube", count, seed, distributions)


def monte_carlo(count: int, seed: int = 0, /, **distributions: Sequence[Any]) -> Sample:
    """Independent random cases, such as manufacturing tolerances; arguments and errors as of `latin_hypercube`.

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
    """Cases of which `sobol_indices` are computed: ``blocks`` times as many as there are parameters and 2 more.

    Needs SALib, ``pip install 'hbgear[sobol]'``. Arguments otherwise as of `latin_hypercube`.

    Raises
    ------
    ValueError, KeyError
        If the blocks are no power of 2, there is no such distribution, or its numbers do not fit.

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
        raise ValueError(f"a sample of {count} cases in no parameter: name one, as in zeta=('uniform', 0.04, 0.06)")
    for each in distributions.values():
        distribution(each)
    return Sample(method, count, seed, {name: tuple(each) for name, each in distributions.items()})


def distribution(given: Sequence[Any]) -> Any:
    """The frozen distribution of scipy.stats for ``("uniform", 0.04, 0.08)`` and the like.

    Raises
    ------
    ValueError, KeyError
        If there is none of that name, its numbers are too few, too many, not finite or not in order, or its values are
        beyond all numbers.
    """
    from scipy import stats

    if not isinstance(given, list | tuple):
        raise ValueError(f"a distribution is given as ('uniform', low, high) or the like, not as {quoted(given)}")
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
    bounds = [x for x, what in zip(numbers, meaning, strict=True) if what in ("low", "mode", "high")]
    positive = [x for x, what in zip(numbers, meaning, strict=True) if what in ("deviation", "sigma", "median")]
    if bounds != sorted(bounds) or (bounds and bounds[0] == bounds[-1]) or any(x <= 0 for x in positive):
        raise ValueError(f"{name} of {numbers}: {need}, in ascending order and not all equal, deviations positive")
    with np.errstate(all="ignore"):
        made = make(stats, *map(float, numbers))
        ends = made.ppf([_LEAST, 0.5, 1 - _LEAST])
    if not np.all(np.isfinite(ends)):
        raise ValueError(f"{name} of {numbers}: its values reach beyond all numbers; {need} that give smaller ones")
    return made
