"""Verdicts on motions: periodic, quasi-periodic or chaotic, by the largest Lyapunov exponent and weighted averages.

    W(z) = sum_p w(p / T) z_p / sum_p w(p / T),   w(t) = exp(-1 / (t (1 - t)))         z_p state after p periods

The weighted average over T periods of a smooth quasi-periodic motion converges faster than every power of 1 / T; that
of a chaotic motion like T^(-1/2). The number of equal digits of the averages over two successive sections,

    digits = -log10 (|W_1 - W_2| / size of the motion),

therefore separates the two. The tests, in this order:

* periodic: the state repeats after k excitation periods to the tolerance of `SteadyStateSettings`;
* undecided: the distance from the state k periods before, of the likely period k, still decays or grows by a tenth;
* quasi-periodic: at least 4 equal digits, and a disturbance grows by less than a factor e^0.02 per period;
* chaotic: fewer than 4 equal digits, and a disturbance grows by more than this factor;
* undecided: the two numbers contradict each other.

References
----------
Das, Saiki, Sander & Yorke (2017), Nonlinearity 30(11), https://doi.org/10.1088/1361-6544/aa84c2.
Sander & Meiss (2020), Physica D 411, https://doi.org/10.1016/j.physd.2020.132569, for the number of digits as a test.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.autonomous.tori.stability import birkhoff_weights
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.modal_states import StateBatch
from hbgear.time.steady_state import MIN_CHAOTIC_GROWTH

AVERAGED = 1000
"""Number of excitation periods of each of the two averages [-]. Tori of two masses have 9 to 13 equal digits, chaotic
Duffing oscillators 1 to 2."""

MIN_EQUAL_DIGITS = 4.0
"""Number of equal digits [-] from which a motion is regular."""

_MAX_CHANGE_OF_RETURNS = 0.1
"""Relative change of the mean distance of returns between two sections [-] above which a motion is still transient."""

_MEMORY = 2**22
"""Largest number of stored entries [-] of the states of a batch."""


class Verdict(StrEnum):
    """Kind of a motion, see `hbgear.time.attractors.verdicts` for the tests.

    Examples
    --------
    >>> import hbgear as hb
    >>> diagram = hb.time.bifurcation_diagram(hb.Duffing(zeta=0.3), "Omega", (0.5, 0.6), "up", values=2)
    >>> diagram.verdicts[0][0] == hb.time.Verdict.PERIODIC
    True
    """

    PERIODIC = "periodic"
    """The motion repeats after a number of excitation periods."""
    QUASI_PERIODIC = "quasi-periodic"
    """The motion has several frequencies without a common base."""
    CHAOTIC = "chaotic"
    """Neighbouring motions separate exponentially."""
    UNDECIDED = "undecided"
    """The tests disagree, or the motion is still transient."""


def equal_digits(integrator: ExponentialIntegrator, motions: StateBatch, lag: np.ndarray) -> tuple[Array, Array]:
    """Return the equal digits (B,) of two weighted averages, and the change of the returns between the two sections.

    ``lag`` is the likely period k (B,) of each motion; the change (B,) is that of the mean distance |z_{p + k} - z_p|.
    The motions are replaced by their states at the end.
    """
    count = len(motions.d)
    digits, change = np.empty(count), np.empty(count)
    block = max(1, _MEMORY // (2 * AVERAGED * motions.zeta.shape[1]))
    w = birkhoff_weights(AVERAGED)
    for first in range(0, count, block):
        batch = np.arange(first, min(first + block, count))
        selected, part = motions.select(batch), integrator.select(batch)
        states = np.empty((2 * AVERAGED, *selected.zeta.shape))
        part.stroboscopic_map(selected, states)
        motions.replace(batch, selected)
        x = states * part.weights()
        first_half, second_half = x[:AVERAGED], x[AVERAGED:]
        size = np.sqrt(np.mean(np.sum((x - x.mean(axis=0)) ** 2, axis=-1), axis=0))
        distance = np.linalg.norm(np.einsum("p,pbq->bq", w, first_half - second_half), axis=-1)
        digits[batch] = -np.log10(np.maximum(distance, 1e-16 * size) / np.maximum(size, 1e-300))
        for i, k in enumerate(np.maximum(lag[batch], 1)):
            before, after = (np.linalg.norm(z[k:, i] - z[:-k, i], axis=-1).mean() for z in (first_half, second_half))
            change[batch[i]] = abs(after - before) / max(before, 1e-300)
    return digits, change


def verdict_of(period: int, growth: float, digits: float, change: float) -> Verdict:
    """Return the verdict on a motion from the numbers of the tests."""
    if period:
        return Verdict.PERIODIC
    if not np.isfinite(growth):
        return Verdict.UNDECIDED
    if digits >= MIN_EQUAL_DIGITS and growth <= MIN_CHAOTIC_GROWTH and change <= _MAX_CHANGE_OF_RETURNS:
        return Verdict.QUASI_PERIODIC
    return Verdict.CHAOTIC if digits < MIN_EQUAL_DIGITS and growth > MIN_CHAOTIC_GROWTH else Verdict.UNDECIDED
