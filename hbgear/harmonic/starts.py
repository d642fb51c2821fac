"""Guesses from which Newton finds a first periodic motion."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.newton import NoConvergence, solve
from hbgear.continuation.stepsize import StepControl
from hbgear.continuation.tracer import trace
from hbgear.harmonic.compiled import Compiled
from hbgear.mechanics.fourier import to_real


def guesses(compiled: Compiled, Omega: float) -> Iterator[Array]:
    """Linear responses about the static states that Newton finds with harmonic 0 alone, from several sides."""
    linear, joint, ties = compiled.linear(Omega), compiled.structure.joint, compiled.structure.ties
    e = compiled.receptance.e
    reach = np.array([max(np.abs(law.breakpoints), default=1.0) or 1.0 for law in compiled.laws])
    reach *= _pushed(compiled, linear)
    for side in (1.5, -1.5, 0.0, 4.0, -4.0):
        d0 = side * reach
        for _ in range(50):
            p, k = _static(compiled.laws, d0)
            r = joint @ (linear.Z[0].real @ d0 + linear.g[0].real + p) + ties @ (d0 + e[0].real)
            J = joint @ (linear.Z[0].real + np.diag(k)) + ties
            step = np.linalg.lstsq(J, r, rcond=1e-12)[0]
            d0 = d0 - step
            if (np.abs(step) <= _STATIC * np.abs(reach)).all():
                break
        if not np.isfinite(d0).all():
            continue
        with np.errstate(all="ignore"):
            try:
                A, b = joint @ (linear.Z + np.diag(k)) + ties, linear.g @ joint.T + e @ ties.T
                d = np.linalg.solve(A, -b[..., None])[..., 0].T
            except np.linalg.LinAlgError:
                d = np.zeros((compiled.m, len(linear.Z)), dtype=complex)
        d[:, 0] = d0
        yield to_real(d).ravel()
        yield to_real(np.concatenate([d[:, :1], 0 * d[:, 1:]], axis=1)).ravel()


_STATIC = 1e-7  # step of Newton, over the reach of an element, behind which a static state is one to all digits


_ELSEWHERE = (1.1, 0.9, 1.3, 0.75, 1.8, 0.5, 3.0, 6.0)  # times the frequency, where a motion may be easier to find


def from_elsewhere(problem: Any, here: dict[str, float]) -> Array | None:
    """A motion at the parameters ``here`` on the curve of one found at another frequency; None if none leads there.

    problem : a `HarmonicBalance` that finds nothing from the `guesses` at this frequency.
    """
    Omega = here["Omega"]
    for other in (Omega * times for times in _ELSEWHERE):
        there = {**here, "Omega": other}
        for guess in guesses(problem.compiled(there), other):
            try:
                X = solve(problem, guess, there).X
            except NoConvergence:
                continue
            fixed = {name: value for name, value in here.items() if name != "Omega"}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of the other frequency nobody asked
                curve = trace(problem, "Omega", (other, Omega), X, at=fixed, steps=StepControl(max_points=1000),
                              stability=False, special=False, cover=False)  # fmt: skip
            if curve.values[-1] == Omega:
                try:  # with as many harmonics as are wanted
                    return solve(problem, problem.converted(curve[-1]), here).X
                except NoConvergence:
                    pass
            break
    return None


def _pushed(compiled: Compiled, linear: Any) -> Array:
    """Side, +1 or -1, to which the constant load pushes each element, as if its law were a linear spring (m,)."""
    joint, ties = compiled.structure.joint, compiled.structure.ties
    springs = np.diag([law.reference for law in compiled.laws])
    b = joint @ linear.g[0].real + ties @ compiled.receptance.e[0].real
    d0 = np.linalg.lstsq(joint @ (linear.Z[0].real + springs) + ties, -b, rcond=1e-12)[0]
    return np.where(d0 < 0, -1.0, 1.0)


def _static(laws: Any, d0: Array) -> tuple[Array, Array]:
    """Mean over the phase of each law's force and stiffness at constant d0 (m,)."""
    tau, still = 2 * np.pi * np.arange(64) / 64, np.zeros(64)
    out = [law.force(np.full(64, x), still, tau)[:2] for law, x in zip(laws, d0, strict=True)]
    p, k = np.array(out).sum(axis=2).T / 64
    return p, k
