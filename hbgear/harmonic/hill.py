"""Floquet multipliers from Hill's matrix.

    z' = [A - B (k(theta) - kr) C] z,   z = e^{s t} sum_k z_k e^{i k theta},   |k| <= H,  theta = omega t

    [A - i k omega - s] z_k - B sum_l K_{k-l} C z_l = 0        K two-sided coefficients of k(theta) - kr

An eigenproblem of r (2H + 1) equations for the exponents s, whose multipliers are e^{s T}. Each exponent comes 2H + 1
times, shifted by i omega; of these copies those are the best whose vectors lie in the middle of the harmonics.

References
----------
Lazarus & Thomas (2010), C. R. Mecanique 338(9), https://doi.org/10.1016/j.crme.2010.07.020.
Guillot, Lazarus, Thomas, Vergez & Cochelin (2020), J. Comput. Phys. 416, https://doi.org/10.1016/j.jcp.2020.109477.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.compiled import Compiled

_LARGEST = 3000  # equations of an eigenproblem that takes some ten seconds


def hill_multipliers(compiled: Compiled, X: Array, Omega: float) -> ComplexArray:
    """Multipliers (r,) of one motion X (n,), largest first.

    Raises
    ------
    ValueError
        If a law must be asked for its slopes, or the matrix would be too large.
    """
    from hbgear.harmonic.projection import projected

    compiled = compiled.at(Omega)
    modes, H, m = compiled.structure.modes, compiled.H, compiled.m
    if compiled.asked:
        raise ValueError("Hill's matrix is made for laws that are known to hbgear, not for laws of your own")
    r = 0 if modes is None else len(modes.poles)
    if modes is None or r * (2 * H + 1) > _LARGEST:
        most = f"{r} x (2H + 1) = {r * (2 * H + 1):,}" if r else "too many"
        raise ValueError(f"Hill's matrix would have {most} equations; at most {_LARGEST:,} are solved: fewer harmonics")
    kappa, _, more = projected(compiled.numbers, compiled.spread(X).reshape(m, -1), 2 * H)
    slopes = kappa + more
    slopes[:, 0] -= compiled.numbers.linear.springs[0]
    k = np.arange(-H, H + 1)
    shift = k[:, None] - k
    K = np.where(shift >= 0, slopes[:, np.abs(shift)], slopes[:, np.abs(shift)].conj())  # (m, 2H + 1, 2H + 1)
    matrix = -np.einsum("rj,jkl,js->krls", modes.input, K, modes.output)
    at = np.arange(r)
    matrix[np.arange(2 * H + 1)[:, None], at, np.arange(2 * H + 1)[:, None], at] += (
        modes.poles - 1j * (Omega / compiled.nu) * k[:, None]
    )
    s, V = np.linalg.eig(matrix.reshape(r * (2 * H + 1), -1))
    share = np.square(np.abs(V.reshape(2 * H + 1, r, -1))).sum(axis=1)
    middle = np.abs(k @ share / share.sum(axis=0))
    mu: ComplexArray = np.exp(s[np.argsort(middle, kind="stable")[:r]] * (2 * np.pi * compiled.nu / Omega))
    return mu[np.argsort(-np.abs(mu), kind="stable")]
