"""Stability of a mass with a stop compared with motions computed exactly from contact to contact.

    python -m studies.random.stops --count 20 --every 4    # stiffnesses from 10 to 1e5, two dampings, two gaps

    q'' + c q' + q + k max(q - gap, 0) = F cos(Omega t)

Between two contact instants the motion is a matrix exponential of the state (q, q', 1, cos, sin); the instants are
bracketed roots. Newton on the state after a period gives the periodic motion at the same Omega, and the product of the
transition matrices its multipliers. It starts from the state of the harmonic balance with `FINER` times the harmonics:
next to a fold two motions lie close together, and from a coarse state Newton finds either of them. Not compared are a
point whose balance has no solution with more harmonics on the same side of the fold (sign of det(dR/dX)), a motion that
Newton finds elsewhere, and one without contact.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass

import numpy as np
import scipy

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import NoConvergence, linearise, solve

FINER = 8
"""Factor of the harmonics from whose state shooting starts."""

SAME = 2e-3
"""Distance of states at phase 0, relative to the size of the motion, up to which two motions are the same.

The motions on both sides of a fold are farther apart as soon as their multipliers differ from +1 by some per cent.
"""


@dataclass(frozen=True)
class Shot:
    """A row of a curve and the exact motion: verdicts, error of the largest modulus, and the stated one."""

    row: int
    verdict: str
    right: str
    off: float
    error: float


@dataclass(frozen=True)
class Stop:
    """One mass with a stop."""

    c: float
    k: float
    gap: float
    F: float

    @property
    def system(self) -> hb.System:
        """The model."""
        stop = hb.Element([1.0], hb.Unilateral(k=self.k, gap=self.gap), name="stop")
        return hb.System([[1.0]], [[self.c]], [[1.0]], [stop], hb.Load(cosine={1: [self.F]}))

    def matrix(self, contact: bool, Omega: float) -> Array:
        """Rates (5, 5) of the state (q, v, 1, cos, sin)."""
        k = self.k if contact else 0.0
        A = np.zeros((5, 5))
        A[0, 1], A[1, :4] = 1.0, (-1.0 - k, -self.c, k * self.gap, self.F)
        A[3, 4], A[4, 3] = -Omega, Omega
        return A

    def march(self, q: float, v: float, Omega: float) -> tuple[Array, Array, int]:
        """State and transition matrix after a period, and the number of contact instants."""
        T, t, y, Phi, count = 2 * np.pi / Omega, 0.0, np.array([q, v, 1.0, 1.0, 0.0]), np.eye(2), 0
        contact = q > self.gap
        while t < T:
            A, h = self.matrix(contact, Omega), 0.05 / np.sqrt(1 + (self.k if contact else 0.0) + Omega**2)
            end = self._end(A, -1.0 if contact else 1.0, y, h, T - t)
            E = scipy.linalg.expm(A * (T - t if end is None else end))
            y, Phi, t = E @ y, E[:2, :2] @ Phi, T if end is None else t + end
            if end is not None:
                contact, count = not contact, count + 1
        return y[:2], Phi, count

    def _end(self, A: Array, side: float, y: Array, h: float, most: float) -> float | None:
        """Time of the next contact instant, looked for in steps h; None if it is later than ``most``."""

        def gap(s: float) -> float:
            return float((scipy.linalg.expm(A * s) @ last)[0]) - self.gap

        step, t, last = scipy.linalg.expm(A * h), 0.0, y
        while t < most:
            y = step @ last
            if side * (y[0] - self.gap) > 0 and side * y[1] > 0:
                low = 0.0 if t > 0 and side * gap(0.0) <= 0 else 1e-6 * h
                end = t + float(scipy.optimize.brentq(gap, low, h, xtol=1e-15)) if side * gap(low) < 0 else t
                return end if end < most else None
            t, last = t + h, y
        return None

    def shoot(self, q: float, v: float, Omega: float) -> tuple[Array, Array] | None:
        """Return state and multipliers of the motion of Newton's method; None without contact or convergence."""
        y = np.array([q, v])
        for _ in range(12):
            end, Phi, _ = self.march(float(y[0]), float(y[1]), Omega)
            step = np.linalg.solve(np.eye(2) - Phi, end - y)
            y = y + step
            if not np.linalg.norm(step) < 1e3:
                return None
            if np.linalg.norm(step) < 1e-9:
                _, Phi, count = self.march(float(y[0]), float(y[1]), Omega)
                return (y, np.linalg.eigvals(Phi)) if count else None
        return None


def compared(stop: Stop, curve: Branch, every: int) -> list[Shot]:
    """Compare points with contact, except special points, with the exact motion."""
    special, out = {point.index for point in curve.special}, []
    H = curve.layout.harmonics  # type: ignore[union-attr]
    finer, k = curve.problem.with_order(1, FINER * H), np.arange(1, FINER * H + 1)
    for i in [i for i in np.flatnonzero(curve.regime[:, 0] > 0).tolist() if i not in special][::every]:
        Omega = float(curve.values[i])
        try:
            row = solve(finer, finer.resized(curve.X[i]), {"Omega": Omega}).X
        except NoConvergence:
            continue
        if determinant_sign(finer, row, Omega) != determinant_sign(curve.problem, curve.X[i], Omega):
            continue
        start = np.array([row[0] + row[1::2].sum(), Omega * (k * row[2::2]).sum()])
        found = stop.shoot(float(start[0]), float(start[1]), Omega)
        if found is None or np.abs(found[0] - start).max() > SAME * np.linalg.norm(row[1:]) * max(1.0, Omega):
            continue
        right, mine = float(np.abs(found[1]).max()), float(np.abs(curve.multipliers[i]).max())  # type: ignore[index]
        verdict = "stable" if right <= 1 + STABILITY_TOLERANCE else "unstable"
        out.append(Shot(i, curve.stability[i], verdict, abs(right - mine), float(curve.modulus_error[i])))  # type: ignore[index]
    return out


def determinant_sign(problem: hb.HarmonicBalance, X: Array, Omega: float) -> int:
    """Sign of det(dR/dX) of a motion, which differs on both sides of a fold."""
    return int(np.linalg.slogdet(np.asarray(linearise(problem, X, "", {"Omega": Omega}).dR_dX))[0])


def main() -> None:
    """Scan stiffnesses, dampings and gaps; a line for each curve."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20, help="stiffnesses from 10 to 1e5")
    parser.add_argument("--every", type=int, default=4, help="rows with contact, of which one is compared")
    given = parser.parse_args()
    total: list[Shot] = []
    for zeta in (0.02, 0.1):
        for gap in (0.0, 0.5):
            for k in np.geomspace(10.0, 1e5, given.count).tolist():
                stop, start = Stop(2 * zeta, k, gap, 0.1), time.process_time()
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    curve = hb.trace(hb.HarmonicBalance(stop.system, 16), "Omega", (2.2, 0.4))
                seconds = time.process_time() - start
                shots = compared(stop, curve, given.every)
                total += shots
                print(
                    f"zeta {zeta}, gap {gap}, k {k:.4g}: {summary(shots)}, {seconds:.1f} s, {curve.status}", flush=True
                )
    print(f"all: {summary(total)}")


def summary(shots: list[Shot]) -> str:
    """The numbers of wrong and undecided verdicts, in words."""
    undecided = sum(shot.verdict == "undecided" for shot in shots)
    wrong = [shot.row for shot in shots if shot.verdict not in (shot.right, "undecided")]
    return f"{len(shots)} compared, {len(wrong)} wrong {wrong[:5]}, {undecided} undecided"


if __name__ == "__main__":
    main()
