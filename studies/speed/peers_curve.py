"""The problems of `peers`, and how a curve is judged. NumPy alone, so that the environments of the peers can import it.

All of them are M q'' + C q' + K q + s(q_last) = constant + cosine Omega^order cos(Omega t), the loads on the first
coordinate, s a cubic spring or one with backlash on the last; coefficients are complex, q = Re sum_k Q_k exp(i k tau).
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Curve = tuple[np.ndarray, np.ndarray]
"""Omega (P,) and coefficients (P, n, H + 1)."""


@dataclass(frozen=True, eq=False)
class Problem:
    """One equation of motion; ``gap`` None: cubic spring k x^3, else k times the backlash function of that half-gap."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    k: float
    gap: float | None
    constant: float
    cosine: float
    order: int
    harmonics: int
    span: tuple[float, float]

    def spring(self, x: Any) -> Any:
        """Force on the last coordinate."""
        return self.k * x**3 if self.gap is None else self.k * (x - np.clip(x, -self.gap, self.gap))


def problem(name: str) -> Problem:
    """``duffing``, ``spur``, or ``chain<n>``; a ValueError for any other name."""
    one = np.eye(1)
    if name == "duffing":
        return Problem(one, 0.1 * one, one, 0.1, None, 0.0, 0.18, 0, 7, (0.5, 1.6))
    if name == "spur":
        return Problem(one, 0.1 * one, 0 * one, 1.0, 1.0, 0.1, 0.05, 2, 10, (0.3, 1.5))
    if not name.startswith("chain"):
        raise ValueError(f"no problem '{name}'; there are duffing, spur, chain10, chain50, ...")
    n = int(name.removeprefix("chain"))
    first = 2 * np.sin(np.pi / (2 * (n + 1)))
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return Problem(np.eye(n), 0.02 * K, K, 0.5, None, 0.0, 0.1, 0, 5, (0.8 * first, 1.3 * first))


def samples(Q: np.ndarray, count: int = 1024) -> np.ndarray:
    """(..., count) values over a period."""
    spectrum = 0.5 * count * Q
    spectrum[..., 0] *= 2
    return np.fft.irfft(spectrum, count, axis=-1)


def residual(given: Problem, Omega: float, Q: np.ndarray) -> float:
    """Largest coefficient of the equation of motion, over the largest load; the same measure for every tool."""
    k = Omega * np.arange(given.harmonics + 1)
    R = given.K @ Q + 1j * k * (given.C @ Q) - k**2 * (given.M @ Q)
    force = np.fft.rfft(given.spring(samples(Q[-1])))[: given.harmonics + 1] / 1024
    R[-1] += np.concatenate([force[:1], 2 * force[1:]])
    load = np.array([given.constant, given.cosine * Omega**given.order])
    R[0, :2] -= load
    return float(np.abs(R).max() / np.abs(load).max())


def vertex(y: np.ndarray, row: int) -> float:
    """Extremum of the parabola through three values y[row - 1], y[row], y[row + 1] at equal steps."""
    low, top, high = y[row - 1 : row + 2]
    bend = low - 2 * top + high
    return float(top if bend == 0 else top - (high - low) ** 2 / (8 * bend))


def judged(given: Problem, curve: Curve, seconds: float, accepted: float = 1e-2) -> dict[str, Any]:
    """What is printed of a curve: time, converged points, and folds and peak by parabolas through neighbouring points.

    Points whose residual is above ``accepted`` are not converged and counted apart. A ValueError if fewer than
    three are left.
    """
    Omega, Q = curve
    residuals = np.array([residual(given, w, q) for w, q in zip(Omega, Q, strict=True)])
    good = residuals < accepted
    if good.sum() < 3:
        raise ValueError(f"{good.sum()} of {len(good)} points converged")
    Omega, top = Omega[good], np.abs(samples(Q[good, -1])).max(axis=-1)
    turns = [i for i in range(1, len(Omega) - 1) if (Omega[i] - Omega[i - 1]) * (Omega[i + 1] - Omega[i]) < 0]
    best = int(np.clip(np.argmax(top), 1, len(top) - 2))
    return {
        "seconds": seconds,
        "points": int(good.sum()),
        "failed": int((~good).sum()),
        "folds": [vertex(Omega, i) for i in turns],
        "peak": max(vertex(top, best), float(top.max())),
        "residual": float(residuals[good].max()),
    }


def main(trace: Callable[[Problem], Curve], warm_up: bool = True) -> None:
    """Command line of a peer's script: one argument, the problem; a warm-up where code is compiled; prints JSON."""
    name = sys.argv[1]
    given = problem(name)
    with contextlib.redirect_stdout(None):
        if warm_up:
            trace(problem("spur" if name == "spur" else "duffing"))
        start = time.perf_counter()
        curve = trace(given)
        seconds = time.perf_counter() - start
    print(json.dumps(judged(given, curve, seconds)))
