"""Kernel: matrix of the product with a periodic stiffness, Toeplitz plus Hankel in the real basis."""

from __future__ import annotations

from typing import Any

from hbgear.common.process.compiling import kernel


@kernel
def add_product(kappa: Any, orders: Any, T: Any) -> None:
    """Add the matrix of the product with kappa to T, in the real basis of some orders, of which the first is 0.

    The matrix is symmetric except for row and column 0.
    """
    T[0, 0] += kappa[0].real
    for k in range(1, orders.shape[0]):
        r, s = kappa[orders[k]].real, kappa[orders[k]].imag
        T[0, 2 * k - 1] += r
        T[0, 2 * k] -= s
        T[2 * k - 1, 0] += 2 * r
        T[2 * k, 0] -= 2 * s
        for i in range(1, k + 1):
            difference, total = kappa[orders[k] - orders[i]], kappa[orders[k] + orders[i]]
            r, s, p, q = difference.real, difference.imag, total.real, total.imag
            T[2 * k - 1, 2 * i - 1] += r + p
            T[2 * k - 1, 2 * i] += s - q
            T[2 * k, 2 * i - 1] -= s + q
            T[2 * k, 2 * i] += r - p
            if i < k:
                T[2 * i - 1, 2 * k - 1] += r + p
                T[2 * i, 2 * k - 1] += s - q
                T[2 * i - 1, 2 * k] -= s + q
                T[2 * i, 2 * k] += r - p
