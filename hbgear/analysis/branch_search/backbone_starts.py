"""Starts of resonant motions from backbones: free motions whose frequency is a multiple of the basis frequency.

    q(t) = q_s(t) + q_b(t + phi / w),   w = p Omega / nu

q_b is the motion of frequency w on the backbone of a mode, q_s the smallest known motion. Lightly damped motions in
resonance lie close to the backbone, and so do isolated branches, whose phases phi to the excitation are unknown.

References
----------
Kuether, Renson, Detroux, Grappasonni, Kerschen & Allen (2015), Nonlinear normal modes, modal interactions and isolated
resonance curves, https://arxiv.org/abs/1604.05567.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import SEARCH_ERRORS
from hbgear.continuation.stepping.control import StepControl
from hbgear.harmonic.autonomous.backbone_curve import backbone
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.series.fourier import to_complex, to_real

MODES = 3
"""Number of modes, in ascending frequency, whose backbones are traced."""

BACKBONE_HARMONICS = 7
"""Largest number of harmonics of a backbone, which only yields starts."""

AMPLITUDES = (0.03, 30.0)
"""Range of amplitudes of a backbone, over the size of the known motions or gaps."""

FREE_PHASES = 6
"""Number of phases of a free motion to the excitation, over the range of phases that differ by whole periods."""

SUPERHARMONICS = 3
"""Largest multiple of the excitation frequency that is a frequency of free motions."""

_STEPS = StepControl(first_step=0.02, max_step=0.1, max_points=150)


class BackboneStarts:
    """Starts of resonant motions of a problem, whose known motions or gaps have a given size."""

    def __init__(self, problem: HarmonicBalance, size: float) -> None:
        self.problem, self.size = problem, size

    @cached_property
    def curves(self) -> list[Branch]:
        """Backbones of the lowest modes; modes without a backbone are left out."""
        low, high = (factor * self.size for factor in AMPLITUDES)
        H = max(1, min(BACKBONE_HARMONICS, self.problem.H // self.problem.nu))
        curves = []
        for mode in range(1, MODES + 1):
            with suppress(*SEARCH_ERRORS):
                curve = backbone(
                    self.problem.model,
                    mode,
                    (low, high),
                    harmonics=H,
                    stability=False,
                    special=False,
                    accuracy=None,
                    steps=_STEPS,
                )
                curves.append(raise_if_interrupted(curve))
        return curves

    def at(self, Omega: float, motions: Sequence[Array]) -> Iterator[Array]:
        """Yield starts at a frequency, for each free motion and each of its phases."""
        m, nu = self.problem.m, self.problem.nu
        smallest = min(motions, key=self.problem.solution_norm, default=np.zeros(self.problem.size))
        for p in range(1, max(nu, SUPERHARMONICS) + 1):
            if p > nu and p % nu:
                continue
            for free in self._free_motions(p * Omega / nu):
                for phase in np.arange(FREE_PHASES) / FREE_PHASES * 2 * np.pi / nu:
                    start = to_complex(smallest.reshape(m, -1)).copy()
                    self._add(start, free, p, float(phase))
                    yield to_real(start).ravel()

    def _free_motions(self, frequency: float) -> Iterator[ComplexArray]:
        """Yield the harmonics (m, H + 1) of the free motions of a frequency."""
        for curve in self.curves:
            w = curve.tracked["Omega"] - frequency
            for i in np.flatnonzero(w[1:] * w[:-1] <= 0).tolist():
                fraction = w[i] / (w[i] - w[i + 1]) if w[i] != w[i + 1] else 0.0
                X = (1 - fraction) * curve.X[i] + fraction * curve.X[i + 1]
                yield to_complex(X.reshape(self.problem.m, -1))

    def _add(self, start: ComplexArray, free: ComplexArray, p: int, phase: float) -> None:
        """Add a free motion of p times the basis frequency to a motion, whose mean it replaces."""
        start[:, 0] = free[:, 0]
        places = {int(order): i for i, order in enumerate(self.problem.orders)}
        for k in range(1, free.shape[1]):
            if k * p in places:
                start[:, places[k * p]] += free[:, k] * np.exp(1j * k * phase)
