"""A curve by mousai: no continuation, so a walk in Omega up and one down; runs in its own environment."""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.speed import peers_curve
from studies.speed.peers_curve import Curve, Problem

POINTS = 25
"""Frequencies of each walk."""


def trace(given: Problem) -> Curve:
    """The motions found at the frequencies up and down, each from the last one found."""
    import mousai  # type: ignore[import-not-found]

    n, H = len(given.M), given.harmonics
    inverse = np.linalg.inv(given.M)

    def acceleration(x: np.ndarray, v: np.ndarray, about: dict[str, Any]) -> np.ndarray:
        force = -given.C @ v - given.K @ x
        force[-1] -= given.spring(x[-1])
        Omega = about["omega"]
        force[0] += given.constant + given.cosine * Omega**given.order * np.cos(Omega * about["cur_time"])
        return (inverse @ force)[:, None]

    x = np.zeros((n, 2 * H + 1))
    if given.gap is not None:
        x += given.gap + given.constant / given.k
    up = np.linspace(*given.span, POINTS)
    Omegas, found = [], []
    for Omega in (*up, *up[::-1]):
        try:
            _, after, *_ = mousai.hb_time(acceleration, x, Omega, num_harmonics=H, params={}, f_tol=1e-8)
        except Exception:  # it raises what its solver raises, of any kind
            continue
        x = after
        spectrum = np.fft.rfft(x) / x.shape[1]
        spectrum[:, 1:] *= 2
        Omegas.append(Omega)
        found.append(spectrum)
    return np.array(Omegas), np.array(found)


if __name__ == "__main__":
    peers_curve.main(trace, warm_up=False)
