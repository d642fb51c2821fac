"""Compliance of one tooth by its strain energy: bending, shear and compression of the tooth, and the body it stands on.

    1/k_b = int ((x_F - x) cos(phi) - y_F sin(phi))^2 / (E I) dx,   1/k_s = int 1.2 cos^2(phi) / (G A) dx
    1/k_a = int sin^2(phi) / (E A) dx,   I = (2y)^3/12,   A = 2y      (over the face width)
    1/k_f = cos^2(phi)/E [L (u/S)^2 + M u/S + P (1 + Q tan^2(phi))]

x runs along the centre line of the tooth, y is its half thickness: the involute, and below it the trochoid that the
rounded tip of the rack leaves. The force acts at (x_F, y_F) on the flank, at an angle phi from the normal to the centre
line, which it meets at the height u over the root circle; S is the thickness there. L, M, P, Q are polynomials that
were fitted to finite elements of rings held inside. The ring is taken as narrow as the fit allows: what turns further
in is the inertia of the gear and no part of the mesh.

The section is that of the virtual spur gear in the normal plane. An internal tooth counts as that of a rack.

References
----------
Sainsot, Velex & Duverger (2004), J. Mech. Des. 126(4), 748-752, https://doi.org/10.1115/1.1758252.
Yang & Lin (1987), J. Mech. Trans. Autom. Des. 109(2), 189-196 (the strain energy of a tooth).
"""

from __future__ import annotations

from math import cos, pi, sin, tan

import numpy as np

from hbgear.common.arrays import Array
from hbgear.gears.drawing.gear import Gear
from hbgear.gears.drawing.geometry import involute

_SAINSOT = np.array([
    [-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045],
    [60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086],
    [-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236],
    [-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904],
])  # fmt: skip
"""Rows L, M, P, Q; columns of 1/theta^2, h^2, h/theta, 1/theta, h, 1."""
_RING = 1.4  # root radius over the radius at which the body is held, the least of the fit
_RACK = 1000.0  # teeth that make a rack
_NARROWEST = 0.01  # half angle of a tooth at its root, the least of the fit
_ON_FLANK, _ON_FILLET = 300, 150  # points of the outline


class Tooth:
    """Half outline of a tooth in the normal plane, and its compliance under a force on the flank.

    Parameters
    ----------
    gear : Gear
    """

    def __init__(self, gear: Gear) -> None:
        self.gear = gear
        self.teeth = _RACK if gear.internal else gear.virtual_teeth
        self.pitch = gear.module * self.teeth / 2
        self.base = self.pitch * cos(gear.pressure_angle)
        height = gear.sign * (gear.tip_diameter_used - gear.reference_diameter) / 2
        tip = self.pitch + height
        fillet = self._fillet()
        flank = np.linspace(max(fillet[0][-1], self.base), tip, _ON_FLANK)[1:]
        self.radius = np.concatenate([fillet[0], flank])
        self.half_angle = np.concatenate([fillet[1], self._involute(flank)])
        self.x, self.y = self.radius * np.cos(self.half_angle), self.radius * np.sin(self.half_angle)

    def _involute(self, radius: Array) -> Array:
        """Half the angle of the tooth at radii on the involute."""
        g = self.gear
        alpha = np.arccos(np.minimum(self.base / radius, 1.0))
        at_pitch = (pi / 2 + 2 * g.profile_shift * tan(g.pressure_angle)) / self.teeth
        angle: Array = at_pitch + involute(g.pressure_angle) - (np.tan(alpha) - alpha)
        return angle

    def _fillet(self) -> tuple[Array, Array]:
        """Radii and half angles of the trochoid, from the root circle to the involute.

        The centre of the rack's tip corner is c below the pitch line and E beside the middle of the rack's tooth. When
        it is u beside the pitch point, the corner touches the gear on the line from the pitch point through its centre.
        """
        g, m, alpha = self.gear, self.gear.module, self.gear.pressure_angle
        rho = g.rack_fillet * m
        c = (g.dedendum - g.profile_shift) * m - rho
        E = pi / 4 * m - g.dedendum * m * tan(alpha) - rho * (1 - sin(alpha)) / cos(alpha)
        u = np.linspace(0.0, max(c, 0.0) / tan(alpha), _ON_FILLET)
        with np.errstate(invalid="ignore"):
            stretched = 1 + rho / np.hypot(u, max(c, 1e-12))
        across, up = u * stretched, self.pitch - max(c, 1e-12) * stretched
        space = np.arctan2(across, up) - (u - E) / self.pitch  # from the middle of the space between the teeth
        return np.hypot(across, up), pi / self.teeth - space

    def compliance(self, height: Array) -> tuple[Array, Array]:
        """Compliance per width, and the depth of the tooth behind the contact.

        Parameters
        ----------
        height : ndarray, shape (P,)
            Of the contact over the reference circle [m].

        Returns
        -------
        compliance : ndarray, shape (P,)
            Displacement along the force for a force of 1 N per m of width [m^2/N].
        depth : ndarray, shape (P,)
            Distance along the force from the flank to the centre line [m].
        """
        radius = np.clip(self.pitch + height, max(self.base, self.radius[0]), self.radius[-1])
        half = np.interp(radius, self.radius, self.half_angle)
        phi = np.arccos(np.minimum(self.base / radius, 1.0)) - half
        x_F, y_F = radius * np.cos(half), radius * np.sin(half)
        energy = self._beam(x_F, y_F, phi)
        return energy + self._foundation(x_F, y_F, phi), y_F / np.cos(phi)

    def _beam(self, x_F: Array, y_F: Array, phi: Array) -> Array:
        """Bending, shear and compression, integrated by trapezoids from the root to the force."""
        g = self.gear
        G = g.E / (2 * (1 + g.poisson))
        c, s = np.cos(phi)[:, None], np.sin(phi)[:, None]
        x, y = self.x[None, :], self.y[None, :]
        arm = (x_F[:, None] - x) * c - y_F[:, None] * s
        density = arm**2 / (g.E * (2 * y) ** 3 / 12) + 1.2 * c**2 / (G * 2 * y) + s**2 / (g.E * 2 * y)
        step = np.maximum(np.diff(x, axis=1), 1e-12 * g.module)  # a sharp rack leaves a fillet of one point
        below = np.clip((x_F[:, None] - x[:, :-1]) / step, 0.0, 1.0)  # part of each interval below the force
        total: Array = np.sum((density[:, 1:] + density[:, :-1]) / 2 * step * below, axis=1)
        return total

    def _foundation(self, x_F: Array, y_F: Array, phi: Array) -> Array:
        g, root, theta = self.gear, self.radius[0], float(self.half_angle[0])
        within = max(theta, _NARROWEST)
        L, M, P, Q = _SAINSOT @ np.array([within**-2, _RING**2, _RING / within, 1 / within, _RING, 1.0])
        u = (x_F - y_F * np.tan(phi) - root) / (2 * root * theta)  # over S
        bent: Array = np.cos(phi) ** 2 / g.E * (L * u**2 + M * u + P * (1 + Q * np.tan(phi) ** 2))
        return bent
