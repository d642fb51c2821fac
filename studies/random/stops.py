"""Stability of a mass with a stop compared with motions computed exactly from contact to contact.

    python -m studies.random.stops --count 20 --every 4    # stiffnesses from 10 to 1e5, two dampings, two gaps
    python -m studies.random.stops --zeta 0.02 --gap 0     # one part of them
    python -m studies.random.stops --save stops.jsonl      # continues after an interruption

    q'' + c q' + q + k max(q - gap, 0) = F cos(Omega t)

Between two contact instants the motion is a matrix exponential of the state (q, q', 1, cos, sin); the instants are
bracketed roots. Newton on the state after a period gives the periodic motion at the same Omega, and the product of the
transition matrices its multipliers. It starts from the state of the harmonic balance with `FINER` times the harmonics:
next to a fold two motions lie close together, and from a coarse state Newton finds either of them. Not compared are a
point whose balance has no solution with more harmonics on the same side of the fold (sign of det(dR/dX), the parity of
the multipliers above +1), a motion that Newton finds elsewhere or on the other side, and one without contact. Curves of
hard stops are traced in contact instants. There shooting starts from the state (q, q' / sqrt(1 + k)) at the first one.
"""

from __future__ import annotations

import argparse
import itertools
import json
import random
import time
import warnings
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.time.integration import state_of

FINER = 8
"""Factor of the harmonics from whose state shooting starts."""

SAME = 2e-3
"""Distance of states at phase 0, relative to the size of the motion, up to which two motions are the same.

The motions on both sides of a fold are farther apart as soon as their multipliers differ from +1 by some per cent.
"""


@dataclass(frozen=True)
class Shot:
    """A row of a curve and the exact motion: verdicts, error of the largest modulus, and the stated one.

    Where no exact motion is compared, ``right`` is empty and ``off`` is nan.
    """

    row: int
    Omega: float
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

    def march(self, q: float, v: float, Omega: float, phase: float = 0.0) -> tuple[Array, Array, int]:
        """State and transition matrix a period after a phase of the load, and the number of contact instants."""
        y = np.array([q, v, 1.0, np.cos(phase), np.sin(phase)])
        T, t, Phi, count = 2 * np.pi / Omega, 0.0, np.eye(2), 0
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
        """Time of the next contact instant, looked for in steps h; None if it is later than ``most``.

        Each step is divided at the extremum of the gap, so a contact or a flight shorter than a step is not missed. The
        gap is monotone in both parts. At time 0 it may be a contact instant, from which it moves away.
        """

        def state(s: float) -> Array:
            moved: Array = scipy.linalg.expm(A * s) @ last
            return moved

        def beyond(s: float) -> float:
            return side * float(state(s)[0] - self.gap)

        step, t, last, inside = scipy.linalg.expm(A * h), 0.0, y, side * y[1] > 0
        while t < most:
            y = step @ last
            turns = last[1] * y[1] < 0
            middle = float(scipy.optimize.brentq(lambda s: state(s)[1], 0.0, h, xtol=1e-15)) if turns else h
            for low, high in ((0.0, middle), (middle, h))[: 1 + turns]:
                if inside and beyond(high) > 0:
                    at_once = beyond(low) >= 0
                    end = t + (low if at_once else float(scipy.optimize.brentq(beyond, low, high, xtol=1e-15)))
                    return end if end < most else None
                inside = True
            t, last = t + h, y
        return None

    def shoot(self, q: float, v: float, Omega: float, phase: float = 0.0) -> tuple[Array, Array] | None:
        """Return state and multipliers of the motion of Newton's method; None without contact or convergence."""
        y = np.array([q, v])
        for _ in range(12):
            end, Phi, _ = self.march(float(y[0]), float(y[1]), Omega, phase)
            step = np.linalg.solve(np.eye(2) - Phi, end - y)
            y = y + step
            if not np.linalg.norm(step) < 1e3:
                return None
            if np.linalg.norm(step) < 1e-9:
                _, Phi, count = self.march(float(y[0]), float(y[1]), Omega, phase)
                return (y, np.linalg.eigvals(Phi)) if count else None
        return None


def compared(stop: Stop, curve: Branch, every: int) -> list[Shot]:
    """Compare points with contact, except special points, with the exact motion."""
    special, out = {point.index for point in curve.special}, []
    for i in [i for i in np.flatnonzero(curve.regime[:, 0] > 0).tolist() if i not in special][::every]:
        largest, right, off = exact_modulus(stop, curve, i), "", np.nan
        if largest is not None:
            right = "stable" if largest <= 1 + STABILITY_TOLERANCE else "unstable"
            off = abs(largest - float(np.abs(curve.multipliers[i]).max()))  # type: ignore[index]
        out.append(Shot(i, float(curve.values[i]), curve.stability[i], right, off, float(curve.modulus_error[i])))  # type: ignore[index]
    return out


def exact_modulus(stop: Stop, curve: Branch, i: int) -> float | None:
    """Largest modulus of the multipliers of the exact motion next to point i; None if shooting does not find it."""
    Omega, X, sign = float(curve.values[i]), curve.X[i], 0
    try:
        if isinstance(curve.problem, hb.ContactInstants):
            known = curve.problem.exact_motion(X, Omega=Omega)
            phase, start = float(known.instants[0]), known.states[0] * (1.0, np.sqrt(1 + stop.k))
        else:
            finer = curve.problem.with_order(1, FINER * curve.layout.harmonics)  # type: ignore[union-attr]
            row, phase = solve(finer, finer.resized(X), {"Omega": Omega}).X, 0.0
            start, sign = state_of(finer, row, Omega=Omega), determinant_sign(finer, row, Omega)
            if sign != determinant_sign(curve.problem, X, Omega):
                return None
    except NoConvergence:
        return None
    found = stop.shoot(float(start[0]), float(start[1]), Omega, phase)
    if found is None or np.abs(found[0] - start).max() > SAME * np.linalg.norm(X[1:]) * max(1.0, Omega):
        return None
    beyond = np.count_nonzero((found[1].real > 1) & (found[1].imag == 0))
    return float(np.abs(found[1]).max()) if sign in (0, (-1) ** beyond) else None


def determinant_sign(problem: hb.HarmonicBalance, X: Array, Omega: float) -> int:
    """Sign of det(dR/dX) of a motion, which differs on both sides of a fold."""
    return int(np.linalg.slogdet(np.asarray(problem.linearise(X, "", Omega=Omega).dR_dX))[0])


def main() -> None:
    """Scan stiffnesses, dampings and gaps; a line for each curve."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20, help="stiffnesses from 10 to 1e5")
    parser.add_argument("--every", type=int, default=4, help="rows with contact, of which one is compared")
    parser.add_argument("--zeta", type=float, nargs="+", default=[0.02, 0.1], help="damping ratios")
    parser.add_argument("--gap", type=float, nargs="+", default=[0.0, 0.5], help="gaps")
    parser.add_argument("--save", type=Path, help="file of finished curves (JSON lines); the scan continues after them")
    given = parser.parse_args()
    stiffnesses = np.geomspace(10.0, 1e5, given.count).tolist()
    cases = list(itertools.product(given.zeta, given.gap, stiffnesses))
    random.Random(0).shuffle(cases)  # an interrupted scan has curves of all kinds
    done = {tuple(one["case"]): one for one in map(json.loads, read_lines(given.save))}
    for case in cases:
        if case not in done:
            done[case] = scanned(*case, given.every)
            if given.save:
                with given.save.open("a") as file:
                    print(json.dumps(done[case]), file=file)
        one = done[case]
        zeta, gap, k = case
        shots, seconds = [Shot(*row) for row in one["shots"]], one["seconds"]
        print(f"zeta {zeta}, gap {gap}, k {k:.4g}: {summary(shots)}, {seconds:.1f} s, {one['status']}", flush=True)
    total = [Shot(*row) for case in cases for row in done[case]["shots"]]
    print(f"all: {summary(total)}")


def read_lines(path: Path | None) -> list[str]:
    """Lines of a file; none without a file."""
    return path.read_text().splitlines() if path and path.exists() else []


def scanned(zeta: float, gap: float, k: float, every: int) -> dict[str, Any]:
    """One curve as plain data: case, points compared, seconds of the trace, and status."""
    stop, start = Stop(2 * zeta, k, gap, 0.1), time.process_time()
    with warnings.catch_warnings(action="ignore"):
        curve = hb.trace(hb.HarmonicBalance(stop.system, 16), "Omega", (2.2, 0.4))
    seconds = time.process_time() - start
    shots = [astuple(shot) for shot in compared(stop, curve, every)]
    return {"case": (zeta, gap, k), "shots": shots, "seconds": seconds, "status": curve.status.value}


def summary(shots: list[Shot]) -> str:
    """The numbers of points, of points compared, and of wrong and undecided verdicts, in words."""
    undecided = sum(shot.verdict == "undecided" for shot in shots)
    held = [shot for shot in shots if shot.right]
    wrong = [shot for shot in held if shot.verdict not in (shot.right, "undecided")]
    rows = ", ".join(f"{shot.row} at {shot.Omega:.9g} is {shot.right}, off {shot.off:.1e}" for shot in wrong[:5])
    return f"{len(shots)} points, {undecided} undecided, {len(held)} compared, {len(wrong)} wrong [{rows}]"


if __name__ == "__main__":
    main()
