"""A curve by pyHarm: arclength continuation with its own step control; runs in its own environment."""

from __future__ import annotations

import logging
import warnings
from typing import Any

import numpy as np

from studies.speed import peers_curve
from studies.speed.peers_curve import Curve, Problem

STEPS = {1: 0.05, 10: 0.2, 50: 0.2, 100: 0.3, 200: 0.4}
"""Longest step by number of coordinates, for about as many points as hbgear sets; shorter with backlash."""


def described(given: Problem) -> dict[str, Any]:
    """The input of pyHarm."""
    n = len(given.M)

    def on(node: int, **kind: Any) -> dict[str, Any]:
        return {"connect": {"S": [node]}, "dirs": [0]} | kind

    law = (
        {"type": "GOElement", "xo": 3, "dto": 0}
        if given.gap is None
        else {"type": "PenaltyBilateralGap", "g": given.gap}
    )
    # dto counts time derivatives: the second one of amp cos(tau) is -amp Omega^2 cos(tau)
    amplitude = -given.cosine if given.order == 2 else given.cosine
    connectors = {
        "spring": on(n - 1, k=given.k, **law),
        "drive": on(0, type="GOForcing", ho=1, dto=given.order, amp=amplitude),
    }
    if given.constant:
        connectors["mean"] = on(0, type="GOForcing", ho=0, dto=0, amp=given.constant)
    step = STEPS.get(n, 0.1) if given.gap is None else 0.015
    return {
        "system": {"type": "Base", "nh": given.harmonics, "nti": 32 if given.gap is None else 128},
        "substructures": {"S": {"matrix": {"M": given.M, "C": given.C, "K": given.K}, "ndofs": 1}},
        "connectors": connectors,
        "analysis": {
            "frf": {
                "study": "frf",
                "ds_max": step,
                "ds0": step / 4,
                "ds_min": 1e-6,
                "verbose": False,
                "puls_inf": given.span[0],
                "puls_sup": given.span[1],
                "sign_ds": 1,
            }
        },
    }


def trace(given: Problem) -> Curve:
    """The accepted points."""
    from pyHarm.Maestro import Maestro  # type: ignore[import-not-found]

    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    n, H = len(given.M), given.harmonics
    start = None
    if given.gap is not None:  # in contact: without it K = 0 gives no start
        start = np.zeros(2 * H + 1)
        start[0] = given.gap + given.constant / given.k
    machine = Maestro(described(given))
    machine.operate(x0=start)
    points = np.array([found.x for found in machine.nls["frf"].SolList if found.flag_accepted])
    rows = points[:, :-1].reshape(len(points), 2 * H + 1, n)
    Q = np.concatenate([rows[:, :1], rows[:, 1::2] - 1j * rows[:, 2::2]], axis=1)
    return points[:, -1], Q.transpose(0, 2, 1)


if __name__ == "__main__":
    peers_curve.main(trace)
