"""Exact projection of contacts with dampers, whose force jumps (Kelvin-Voigt).

    P_n = sum_l s_{n-l} y_l,   y = k delta + c delta',   s = indicator function of the contact

    s_n = sum over intervals (alpha, beta) of (exp(-i n alpha) - exp(-i n beta)) / (2 pi i n)

The contact acts where delta > 0; a clipped one also needs y > 0. The ends of the intervals are roots of delta and y.
Where y = 0 the force is continuous, and the end does not contribute to the derivative. Where delta = 0 the force jumps
by c delta'. The end moves by -d(delta) / (d delta / d theta), so that the velocity cancels,

    dP_n = sum_l s_{n-l} dy_l +- c omega exp(-i n theta) d(delta)(theta) / (2 pi)      + at a begin, - at an end

Each jump thus adds a matrix of rank one, which stays finite at grazing contact. The same jump in the variational
equation is an impulse of the size c times the disturbance of d.

References
----------
Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868, for exact projection.
Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems (2004),
https://doi.org/10.1007/978-3-540-44398-8, for saltation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.aft import product_matrices, roots_of
from hbgear.mechanics.laws.damped_contact import DampedContact
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.series.fourier import derive, evaluate, to_complex
from hbgear.mechanics.series.real_basis import after_derivative, derivative


class Intervals(NamedTuple):
    """Intervals of the basis phase in which a contact acts, and the jumps of its force.

    Attributes
    ----------
    ends : ndarray, shape (I, 2)
        Begin and end of each interval [rad]; the end may exceed 2 pi.
    jumps : ndarray, shape (J,)
        Phases of the jumps in [0, 2 pi).
    signs : ndarray, shape (J,)
        +1 for a jump at the begin of a contact, -1 for one at its end.
    """

    ends: Array
    jumps: Array
    signs: Array


class DampedContacts:
    """Laws that are sums of damped contacts, projected exactly.

    Parameters
    ----------
    laws : sequence of Law
        Laws of all elements.
    nu : int
        Subharmonic order.
    """

    def __init__(self, laws: Sequence[Law], nu: int) -> None:
        self.contacts = [(j, contact) for j, law in enumerate(laws) for contact in law.damped]
        self.nu = nu

    def add_to(self, coefficients: Array, Omega: float, R: Array, J: Array, dR: Array) -> float:
        """Add forces and slopes to R, J and dR of all elements; return the norm of the forces."""
        m, n = coefficients.shape
        omega, size, H = Omega / self.nu, 0.0, n // 2
        blocks = J.reshape(m, n, m, n)
        for j, contact in self.contacts:
            depth = contact.side * coefficients[j]
            depth[0] -= contact.gap
            rate = derivative(depth)
            contact_intervals = intervals(contact, coefficients[j], omega)
            T = product_matrices(_indicator(contact_intervals.ends, 2 * H)[None])[0]
            f = contact.side * (T @ (contact.k * depth + contact.c * omega * rate))
            R.reshape(m, n)[j] += f
            dR.reshape(m, n)[j] += contact.side * contact.c / self.nu * (T @ rate)
            blocks[j, :, j] += contact.k * T + contact.c * omega * after_derivative(T)
            if contact_intervals.jumps.size:
                waves = _basis(contact_intervals.jumps, H)
                blocks[j, :, j] += contact.c * omega * (_impulses(waves) * contact_intervals.signs) @ waves.T
            size += float(np.linalg.norm(f))
        return size

    def add_truncated(self, X: Array, Omega: Array, orders: np.ndarray, f: ComplexArray) -> None:
        """Add the truncated force harmonics ``orders`` (L,) of motions X (P, n) to f (P, m, L)."""
        P, m, _ = f.shape
        rows = X.reshape(P, m, -1)
        H = rows.shape[2] // 2
        for p, omega in enumerate((Omega / self.nu).tolist()):
            for j, contact in self.contacts:
                _, y = depth_and_force(contact, rows[p, j], omega)
                two_sided = np.concatenate([0.5 * y[:0:-1].conj(), [y[0]], 0.5 * y[1:]])
                s = _indicator(intervals(contact, rows[p, j], omega).ends, int(orders.max(initial=0)) + H)
                distance = np.abs(orders[:, None] - np.arange(-H, H + 1))
                is_negative = orders[:, None] < np.arange(-H, H + 1)
                f[p, j] += 2 * contact.side * (np.where(is_negative, s[distance].conj(), s[distance]) @ two_sided)


def depth_and_force(contact: DampedContact, row: Array, omega: float) -> tuple[ComplexArray, ComplexArray]:
    """Return the harmonics (H + 1,) of delta and y of a contact that acts at all times, from the row (2H + 1,)."""
    depth = contact.side * to_complex(row)
    depth[0] -= contact.gap
    return depth, contact.k * depth + contact.c * omega * derive(depth)


def intervals(contact: DampedContact, row: Array, omega: float) -> Intervals:
    """Return the intervals in which a contact acts, to rounding, from the row (2H + 1,) of the displacement."""
    depth, force = depth_and_force(contact, row, omega)
    roots = roots_of(depth)
    if contact.clipped:
        force_roots = roots_of(force)
        theta = np.concatenate([roots, force_roots])
        order = np.argsort(theta, kind="stable")
        theta, jumps = theta[order], (np.arange(len(theta)) < len(roots))[order]
    else:
        theta, jumps = roots, np.ones(len(roots), dtype=bool)
    if not theta.size:
        acts = contact.pushes(*_motion(row, omega, np.zeros(1)))[0]
        return Intervals(np.array([[0.0, 2 * np.pi]] if acts else []).reshape(-1, 2), np.zeros(0), np.zeros(0))
    ends = np.append(theta, theta[0] + 2 * np.pi)
    acts = contact.pushes(*_motion(row, omega, 0.5 * (ends[:-1] + ends[1:])))
    change = acts.astype(int) - np.roll(acts, 1).astype(int)
    is_jump = jumps & (change != 0)
    return Intervals(np.column_stack([ends[:-1], ends[1:]])[acts], theta[is_jump] % (2 * np.pi), change[is_jump])


def _motion(row: Array, omega: float, theta: Array) -> tuple[Array, Array]:
    """Return displacement and velocity at phases theta."""
    return evaluate(row, theta), omega * evaluate(row, theta, 1)


def _indicator(ends: Array, order: int) -> ComplexArray:
    """Return the two-sided coefficients n = 0..order of the indicator function of intervals (I, 2)."""
    n = np.arange(1, order + 1)
    waves = np.exp(-1j * n[:, None, None] * ends)
    harmonics = (waves[..., 0] - waves[..., 1]).sum(axis=1) / (2j * np.pi * n)
    mean = (ends[:, 1] - ends[:, 0]).sum() / (2 * np.pi)
    return np.concatenate([[mean], harmonics])


def _basis(theta: Array, H: int) -> Array:
    """Return the real basis (2H + 1, J) at phases theta (J,)."""
    angle = np.arange(1, H + 1)[:, None] * theta
    out = np.ones((2 * H + 1, len(theta)))
    out[1::2], out[2::2] = np.cos(angle), np.sin(angle)
    return out


def _impulses(waves: Array) -> Array:
    """Return the coefficients (2H + 1, J) of unit impulses at the phases of basis values (2H + 1, J)."""
    out = waves / np.pi
    out[0] *= 0.5
    return out
