"""Shafts as beams: Timoshenko elements with rotary inertia, shear and gyroscopic terms between two wheels of a train.

Bending in one plane, with the displacement w and the slope phi of the section at both ends of an element of length L:

    w = sum_i N_i(z) q_i,   phi = sum_i P_i(z) q_i,   q = (w_1, phi_1, w_2, phi_2),   Phi = 12 E I / (kappa A G L^2)
    M = int rho A N N^T + rho I P P^T dz,   K = int E I P' P'^T + kappa A G (N' - P)(N' - P)^T dz

The slope is phi = theta_y in the plane of x and phi = -theta_x in the plane of y. For a turning shaft, G = 2 int rho I
P P^T dz couples both planes. Torsion and extension have linear shape functions.

References
----------
Nelson (1980), A finite rotating shaft element using Timoshenko beam theory, J. Mech. Des. 102(4), 793-803,
https://doi.org/10.1115/1.3254824. Cowper (1966), J. Appl. Mech. 33(2), 335-340, https://doi.org/10.1115/1.3625046
(kappa). Friedman and Kosmatka (1993), Comput. Struct. 47(3), 473-481, https://doi.org/10.1016/0045-7949(93)90243-7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, counted
from hbgear.common.units import OptionalQuantityField, QuantityField
from hbgear.gears.trains.train_components import check_ends

BENDING_PLANES = (((0, 1.0), (4, 1.0)), ((1, 1.0), (3, -1.0)))
"""For bending in x and in y: index (of six coordinates per node) and sign of the displacement and of the slope."""


@dataclass(frozen=True)
class Beam:  # numpydoc ignore=PR02
    """Round shaft with distributed mass between two wheels that move in space, made of Timoshenko elements.

    Parameters
    ----------
    first, second : str
        Names of the wheels; the first one has the smaller z.
    outer, inner : float or str, optional
        Outer diameter and inner diameter (default 0) [m].
    length : float or str, optional
        Length [m]. Default: the distance of the wheels in z.
    E, poisson, density : float or str, optional
        Young's modulus [Pa] (default 2.06e11), Poisson's ratio (default 0.3) and density [kg/m^3] (default 7850; 0 for
        a massless shaft).
    elements : int, default 4
        Number of elements. The error of a natural frequency decreases as O(elements^-2).
    damping : float or str, default 0.02
        Modal damping ratio of the free shaft including its two wheels.

    Raises
    ------
    ValueError
        If a quantity has another unit or is out of range, or both ends are the same wheel.

    Examples
    --------
    >>> import hbgear as hb
    >>> shaft = hb.gears.Beam("motor", "pinion", outer="40 mm", length="300 mm", elements=4)
    >>> round(shaft.torsion), round(shaft.mass, 3)
    (66376, 2.959)
    """

    first: str
    second: str
    outer: QuantityField = QuantityField("m", POSITIVE, Range(1e-4, 20))
    length: OptionalQuantityField = OptionalQuantityField("m", POSITIVE, Range(1e-4, 1e3))
    inner: QuantityField = QuantityField("m", NOT_NEGATIVE, Range(0, 20), 0.0)
    E: QuantityField = QuantityField("Pa", POSITIVE, Range(1e6, 1e13), 2.06e11)
    poisson: QuantityField = QuantityField("", Range(above=-1, high=0.5), Range(-1, 0.5), 0.3)
    density: QuantityField = QuantityField("kg/m^3", NOT_NEGATIVE, Range(0, 3e4), 7850.0)
    elements: int = 4
    damping: QuantityField = QuantityField("", NOT_NEGATIVE, Range(0, 1), 0.02)

    def __post_init__(self) -> None:
        check_ends("Beam", self.first, self.second)
        counted("Beam: elements", self.elements, 50)
        if self.inner >= self.outer:
            raise ValueError(f"Beam: inner = {self.inner:g} m must be smaller than outer = {self.outer:g} m")

    @property
    def name(self) -> str:
        """Name in tables and error messages."""
        return f"{self.first}-{self.second}"

    @property
    def area(self) -> float:
        """Cross-sectional area A [m^2]."""
        return pi * (self.outer**2 - self.inner**2) / 4

    @property
    def second_moment(self) -> float:
        """Second moment of area I about a diameter [m^4]."""
        return pi * (self.outer**4 - self.inner**4) / 64

    @property
    def shear_coefficient(self) -> float:
        """Shear coefficient kappa of a solid or hollow round section (Cowper 1966)."""
        nu, m2 = self.poisson, (self.inner / self.outer) ** 2
        p = (1 + m2) ** 2
        return 6 * (1 + nu) * p / ((7 + 6 * nu) * p + (20 + 12 * nu) * m2)

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.density * self.area * self._length

    @property
    def torsion(self) -> float:
        """Torsional stiffness [N m/rad]."""
        return self.E / (2 * (1 + self.poisson)) * 2 * self.second_moment / self._length

    @property
    def _length(self) -> float:
        if self.length is None:
            raise ValueError(f"Beam {self.name}: give its length, or different z of its wheels")
        return self.length

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the nodes between the two wheels."""
        return tuple(f"{self.name} {i}" for i in range(1, self.elements))

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M, K and G of all nodes from first to second, six coordinates each, of order 6 (elements + 1).

        G is multiplied by the speed of the shaft, counter-clockwise positive.
        """
        element = self._element(self._length / self.elements)
        total = np.zeros((3, *[6 * (self.elements + 1)] * 2))
        for i in range(self.elements):
            total[:, 6 * i : 6 * i + 12, 6 * i : 6 * i + 12] += element
        return total[0], total[1], total[2]

    def dampers(self, first: Array, second: Array) -> Array:
        """Return the damping matrix 2 damping M (M^-1 K)^(1/2) of all nodes.

        ``first`` and ``second`` are the inertias (6,) of the wheels, which M contains.
        """
        M, K, _ = self.matrices
        M = M + np.diag(np.concatenate([first, np.zeros(len(M) - 12), second]))
        squares, modes = scipy.linalg.eigh(K, M)
        return M @ (modes * (2 * self.damping * np.sqrt(np.maximum(squares, 0.0)))) @ modes.T @ M

    def _element(self, L: float) -> Array:
        """Return M, K, G (3, 12, 12) of one element of length L."""
        A, I, E = self.area, self.second_moment, self.E  # noqa: E741
        G = E / (2 * (1 + self.poisson))
        shear = self.shear_coefficient * A * G
        N, P, dN, dP, weights = _shapes(L, 12 * E * I / (shear * L**2))
        rotary = self.density * I * (P * weights) @ P.T
        mass = self.density * A * (N * weights) @ N.T + rotary
        stiff = E * I * (dP * weights) @ dP.T + shear * ((dN - P) * weights) @ (dN - P).T
        out = np.zeros((3, 12, 12))
        planes = []
        for (w, sign_w), (phi, sign_phi) in BENDING_PLANES:
            indices, signs = np.array([w, phi, 6 + w, 6 + phi]), np.array([sign_w, sign_phi, sign_w, sign_phi])
            planes.append((indices, signs))
            for i, matrix in enumerate((mass, stiff)):
                out[i][np.ix_(indices, indices)] += np.outer(signs, signs) * matrix
        (x, signs_x), (y, signs_y) = planes
        out[2][np.ix_(x, y)] = 2 * np.outer(signs_x, signs_y) * rotary
        out[2][np.ix_(y, x)] = -out[2][np.ix_(x, y)].T
        even, linear = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
        for axis, inertia, spring in ((2, A, E * A), (5, 2 * I, 2 * G * I)):
            indices = np.array([axis, 6 + axis])
            out[0][np.ix_(indices, indices)] = self.density * inertia * L * linear
            out[1][np.ix_(indices, indices)] = spring / L * even
        return out


def _shapes(L: float, shear: float) -> tuple[Array, Array, Array, Array, Array]:
    """Return N, P and their derivatives (4, points), and Gauss weights (points,).

    The quadrature integrates products of these functions exactly.
    """
    x, w = np.polynomial.legendre.leggauss(4)
    s = (x + 1) / 2
    N = np.array(
        [
            2 * s**3 - 3 * s**2 - shear * s + 1 + shear,
            L * (s**3 - (2 + shear / 2) * s**2 + (1 + shear / 2) * s),
            -(2 * s**3) + 3 * s**2 + shear * s,
            L * (s**3 - (1 - shear / 2) * s**2 - shear / 2 * s),
        ]
    )
    dN = (
        np.array(
            [
                6 * s**2 - 6 * s - shear,
                L * (3 * s**2 - (4 + shear) * s + 1 + shear / 2),
                -6 * s**2 + 6 * s + shear,
                L * (3 * s**2 - (2 - shear) * s - shear / 2),
            ]
        )
        / L
    )
    P = np.array(
        [6 * (s**2 - s) / L, 3 * s**2 - (4 + shear) * s + 1 + shear, -6 * (s**2 - s) / L, 3 * s**2 - (2 - shear) * s]
    )
    dP = np.array([6 * (2 * s - 1) / L, 6 * s - 4 - shear, -6 * (2 * s - 1) / L, 6 * s - 2 + shear]) / L
    return N / (1 + shear), P / (1 + shear), dN / (1 + shear), dP / (1 + shear), w * L / 2
