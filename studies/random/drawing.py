"""Random numbers of which machines are made."""

import numpy as np

EXTREME = 1 / 8
"""Share of machines that are extreme."""

Span = tuple[float, float]
"""Range of Omega, from and to."""


def logarithmic(random: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def falling(random: np.random.Generator, first: float, most: int) -> tuple[float, ...]:
    """Amplitudes of up to ``most`` harmonics, each at most 0.8 of the one before; none at all at times."""
    count = int(random.integers(0, most + 1))
    return tuple((first * np.cumprod([1.0, *random.uniform(0.1, 0.8, count)])[:count]).tolist())
