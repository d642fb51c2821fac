r"""Planetary gear sets: sun, ring and carrier with N planets, each a rigid body that moves in the plane.

    M q'' + C q' + K q + sum_n (w_sn [k_sn(tau) f(d_sn) + c d_sn'] + w_rn [k_rn(tau) f(d_rn) + c d_rn']) = F
    d_sn = y_s cos(psi_n - a_s) - x_s sin(psi_n - a_s) + u_s - zeta_n sin a_s - eta_n cos a_s + u_n - e_sn(tau)
    d_rn = y_r cos(psi_n + a_r) - x_r sin(psi_n + a_r) + u_r + zeta_n sin a_r - eta_n cos a_r - u_n - e_rn(tau)
    bearing of planet n:  x_c cos psi_n + y_c sin psi_n - zeta_n,   y_c cos psi_n - x_c sin psi_n + u_c - eta_n

The coordinates are in the frame of the carrier: x, y of carrier, ring and sun, radial and tangential displacement zeta,
eta of a planet at psi_n, and u, the rotation times the base radius (for the carrier: the radius of the planet centres).
tau = Omega t is the mesh phase. All 2N meshes have the same frequency; their phases follow from the numbers of teeth.

If the carrier turns, M q'' becomes M q'' + Omega_c G q' - Omega_c^2 M_xy q in its frame (``carrier_rotation``), with
eta_n - u_c instead of eta_n in the last term, so that a rotation of the whole set needs no force.

Dimensionless form returned by `PlanetarySet.system`: unit of length b_sp (1 um without backlash), of time
sqrt(m_p/k_sp), of force k_sp times the length.

References
----------
Lin and Parker (1999), Analytical characterization of the unique properties of planetary gear free vibration, J. Vib.
Acoust. 121(3), 316-321, https://doi.org/10.1115/1.2893982.
Parker and Lin (2004), J. Mech. Des. 126(2), 365-370, https://doi.org/10.1115/1.1667892 (phases).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin, sqrt
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.gears.drawing.pair import GearPair
from hbgear.gears.mesh.mesh_excitation import in_order, mesh_stiffness
from hbgear.gears.planets.planetary_drawing import drawn_fields
from hbgear.gears.planets.planetary_kinematics import MEMBERS
from hbgear.gears.planets.planetary_layout import PlanetaryLayout
from hbgear.gears.planets.planetary_modes import PlanetMode, natural_modes, turning_frame
from hbgear.gears.torque_orders import exact_order, order_load
from hbgear.mechanics.laws.laws import Backlash, Law
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.structures.elements import Element, Load
from hbgear.mechanics.structures.speed_terms import SpeedTerms

_LETTERS = dict(zip(MEMBERS, "crs", strict=True))


@dataclass(frozen=True)
class PlanetarySet(PlanetaryLayout):  # numpydoc ignore=PR02
    """Planetary gear set with backlash in all meshes; the module docstring states the equations.

    The defaults are the machine of Lin and Parker (1999) with four planets. Backlash, excitation and damping are not
    from the paper.

    Parameters
    ----------
    teeth_s, teeth_p, teeth_r : int, optional
        Numbers of teeth, z_r = z_s + 2 z_p except for profile shifts.
    planets : int, default 4
        Number N of planets.
    spacing : tuple of float, optional
        Positions psi_n of the planets [degrees], rounded or not, near multiples of 360 / (z_s + z_r) from the first;
        () for equal spacing.
    fixed : {"ring", "sun", "carrier"}, default "ring"
        Member that does not turn, held by ``k_t``.
    driver : {"ring", "sun", "carrier"}, default "sun"
        Driving member; the third member is driven.
    torque : float, default 300.0
        Torque on the sun [N m], counter-clockwise, for every driver; the other torques follow from it.
    r_s : float, default 38.7e-3
        Base radius of the sun [m].
    m_s, m_p, m_r, m_c : float, optional
        Masses of sun, planet, ring and carrier [kg].
    J_s, J_p, J_r, J_c : float, optional
        Moments of inertia over the squares of the base radii, for the carrier over the square of the radius of the
        planet centres [kg].
    k_sp, k_rp : float, default 5e8
        Mean stiffness of the meshes of a planet with sun and ring [N/m].
    k_s, k_r, k_c, k_p : float, default 1e8
        Stiffness of the bearings of sun, ring, carrier, and of a planet in the carrier [N/m].
    k_t : float, default 1e9
        Stiffness that holds the fixed member against rotation [N/m at its base radius].
    alpha_s_deg, alpha_r_deg : float, default 24.6
        Pressure angles of the meshes with sun and ring [degrees].
    zeta, zeta_b : float, default 0.03
        Damping ratios of each mesh with the inertias it joins, and of bearings with the masses they support.
    b_sp, b_rp : float, default 20e-6
        Half backlashes [m].
    eps_sp, eps_rp : tuple of float, optional
        Amplitudes of the stiffness over its mean, k = k_mean [1 - sum_l eps_l cos(l tau_n)].
    e_sp, e_rp : tuple of float, optional
        Amplitudes of the transmission errors [m], e = sum_l e_l cos(l tau_n).
    contacts_sp, contacts_rp : MeshContacts or None, optional
        Contacts of tooth-resolved meshes instead of eps: stiffness over k_sp or k_rp and initial gaps [m], without
        backlash, of a gear that drives; a pair of teeth is at the pitch point, in the middle of the face, at tau_n = 0.
        `PlanetarySet.of` computes them from drawings.
    eps_scale, e_scale, torque_scale : float, default 1.0
        Factors of all eps, all e and the torque, for use as continuation parameters.
    torque_orders : mapping, optional
        Harmonics of the torque on the driver by order of its rotation, such as ``{2: "60 N m"}``, or ``{2: ("60 N m",
        "30 deg")}`` with a phase; see `hbgear.gears.torque_orders`. Omega is then the common frequency of mesh and
        orders. The torques on the other members are constant.
    fluctuation_scale : float, default 1.0
        Factor of these harmonics, for use as a continuation parameter.
    planet_errors : tuple of float, optional
        Tangential position errors of the planets [m]; () for none.
    thickness_p : float, default 0.5
        Mean thickness of a planet tooth on its working pitch circles with sun and ring, over the pitch. The phase
        between both meshes of a planet depends on it; profile shifts change it.
    carrier_rotation : bool, default False
        True to include the Coriolis and centripetal terms of the turning carrier, and that the bearings of the central
        members do not turn with it.

    Raises
    ------
    ValueError
        If a value is out of its range, the planets collide or cannot be assembled, or tooth numbers do not match.

    Examples
    --------
    >>> import hbgear as hb
    >>> planetary = hb.gears.PlanetarySet(26, 34, 94, planets=3)
    >>> [round(mode.frequency, 1) for mode in planetary.modes() if mode.kind == "rotational"]
    [0.0, 1475.7, 1930.3, 2658.3, 7462.8, 11775.3]
    >>> planetary.phasing, hb.gears.PlanetarySet(28, 36, 100, planets=4).phasing
    ('sequential', 'in phase')
    """

    @classmethod
    def of(cls, sun: GearPair, ring: GearPair, torque: Any, **others: Any) -> PlanetarySet:
        """Return the set of the pairs of sun and planet and of planet and ring, with meshes resolved into tooth pairs.

        Teeth, base radius of the sun, masses and inertias of the gears, meshes, backlashes and angles follow from the
        pairs.

        Parameters
        ----------
        sun, ring : GearPair
            Pair of sun and planet, and pair of planet and ring.
        torque : float or str
            Torque on the sun [N m], which all planets share equally.
        **others : object
            Other fields, such as planets, zeta, and the mass and inertia of the carrier.

        Raises
        ------
        ValueError
            If the pairs do not have the same planet, or the wheel of the second pair is not a ring.

        Examples
        --------
        >>> import hbgear as hb
        >>> sun, planet = (hb.gears.Gear(z, "3 mm", "20 mm", tip_relief="10 um") for z in (28, 36))
        >>> ring = hb.gears.Gear(100, "3 mm", "20 mm", internal=True, tip_diameter="296 mm")
        >>> pairs = hb.GearPair(sun, planet, backlash="60 um"), hb.GearPair(planet, ring, backlash="60 um")
        >>> hb.gears.PlanetarySet.of(*pairs, "300 N m", planets=4, m_c=8.0, J_c=6.0).phasing
        'in phase'
        """
        return cls(**{**drawn_fields(sun, ring, torque, others.get("planets", cls.planets)), **others})

    # ---- matrices in SI units

    @property
    def dof_names(self) -> list[str]:
        """Names of the coordinates: x, y, u of carrier, ring and sun, then zeta, eta, u of the planets."""
        central = [f"{axis}_{name}" for name in MEMBERS for axis in "xyu"]
        return central + [f"{axis}_p{n + 1}" for n in range(self.planets) for axis in ("zeta", "eta", "u")]

    @property
    def _masses(self) -> Array:
        """Diagonal of M."""
        masses = [(getattr(self, f"m_{i}"),) * 2 + (getattr(self, f"J_{i}"),) for i in [*"crs", *"p" * self.planets]]
        return np.concatenate(masses)

    def _springs(self) -> list[tuple[float, float, Array]]:
        """Return stiffness, supported mass and direction of every linear spring."""
        n = 9 + 3 * self.planets
        unit = np.eye(n)
        springs = []
        for i, name in enumerate(MEMBERS):
            k, m = (getattr(self, f"{letter}_{_LETTERS[name]}") for letter in "km")
            springs += [(k, m, unit[3 * i]), (k, m, unit[3 * i + 1])]
            if name == self.fixed:
                springs.append((self.k_t, getattr(self, f"J_{_LETTERS[name]}"), unit[3 * i + 2]))
        for p, psi in enumerate(self.angles):
            start = 9 + 3 * p
            radial = cos(psi) * unit[0] + sin(psi) * unit[1] - unit[start]
            tangential = cos(psi) * unit[1] - sin(psi) * unit[0] + unit[2] - unit[start + 1]
            springs += [(self.k_p, self.m_p, radial), (self.k_p, self.m_p, tangential)]
        return springs

    def structure(self) -> tuple[Array, Array, Array]:
        """Return M, C, K without the meshes, in SI units."""
        M = np.diag(self._masses)
        C, K = np.zeros((2, *M.shape))
        for k, m, w in self._springs():
            K += k * np.outer(w, w)
            C += 2 * self.zeta_b * sqrt(k * m) * np.outer(w, w)
        return M, C, K

    def mesh_vectors(self) -> Array:
        """Return the directions of the gaps as columns, the meshes of the sun first, in SI units."""
        a_s, a_r = radians(self.alpha_s_deg), radians(self.alpha_r_deg)
        columns = []
        for ring in (False, True):
            for p, psi in enumerate(self.angles):
                w, first, start = np.zeros(9 + 3 * self.planets), 3 if ring else 6, 9 + 3 * p
                mesh_angle = psi + a_r if ring else psi - a_s
                w[first : first + 3] = -sin(mesh_angle), cos(mesh_angle), 1.0
                w[start : start + 3] = (sin(a_r), -cos(a_r), -1.0) if ring else (-sin(a_s), -cos(a_s), 1.0)
                columns.append(w)
        return np.array(columns).T

    def _load(self) -> Array:
        """Return the constant load: the torque on the sun and the reactions of the other members that turn."""
        F = self.torque_scale * self.torque / self.r_s
        cosines = cos(radians(self.alpha_s_deg)) + cos(radians(self.alpha_r_deg))
        load = np.zeros(9 + 3 * self.planets)
        for i, (name, force) in enumerate(zip(MEMBERS, (-F * cosines, F, F), strict=True)):
            if name != self.fixed:
                load[3 * i + 2] = force
        return load

    def modes(self) -> tuple[PlanetMode, ...]:
        """Return the undamped natural modes with all teeth in contact at their mean stiffness, in ascending order."""
        M, _, K = self.structure()
        W = self.mesh_vectors()
        return natural_modes(M, K + (W * np.repeat([self.k_sp, self.k_rp], self.planets)) @ W.T)

    # ---- the dimensionless system

    def system(self) -> System:
        """Return the dimensionless equations of motion with one element for each mesh."""
        M, C, K = self.structure()
        length, force = self.b_c, self.k_sp * self.b_c
        errors = self.planet_errors or (0.0,) * self.planets
        gaps, lags = [], self.kinematics.lags
        carrier = self.orders.get("carrier", 0.0) * (1 if self.speeds["carrier"] > 0 else -1)
        for j, (name, w) in enumerate(zip(self.mesh_names, self.mesh_vectors().T, strict=True)):
            pair, n = ("rp", j - self.planets) if j >= self.planets else ("sp", j)
            k = getattr(self, f"k_{pair}")
            alpha = radians(getattr(self, f"alpha_{pair[0]}_deg"))
            error = Series(cosine=getattr(self, f"e_{pair}")).shifted(lags[j]).scaled(self.e_scale / length)
            joined = 1 / (1 / self.J_p + 1 / (self.J_r if pair == "rp" else self.J_s))
            gaps.append(
                Element(
                    direction=w,
                    law=self._mesh_law(pair, lags[j]),
                    displacement=in_order(
                        Series(errors[n] * cos(alpha) / length, error.cosine, error.sine), self.mesh_order
                    ),
                    damping=2 * self.zeta * sqrt(k * joined) / sqrt(self.k_sp * self.m_p),
                    name=name,
                )
            )
        return System(
            M=M / self.m_p,
            C=C / sqrt(self.k_sp * self.m_p),
            K=K / self.k_sp,
            elements=gaps,
            load=[Load(constant=self._load() / force), *self._fluctuations(force)],
            dof_names=self.dof_names,
            speed=self._turning_frame(carrier) if self.carrier_rotation and carrier else None,
        )

    def _turning_frame(self, speed: float) -> SpeedTerms:
        """Return the terms of the frame of the carrier, which turns at ``speed`` times Omega."""
        k, m = (np.array([getattr(self, f"{letter}_{_LETTERS[name]}") for name in MEMBERS]) for letter in "km")
        dampers = 2 * self.zeta_b * np.sqrt(k * m) / sqrt(self.k_sp * self.m_p)
        return turning_frame(self._masses / self.m_p, dampers, speed)

    def _fluctuations(self, force: float) -> list[Load]:
        """Return the loads T cos(order theta + phase) of the driver, theta its angle since tau = 0."""
        r_p = self.r_s * self.teeth_p / self.teeth_s
        radii = {
            "carrier": (self.r_s + r_p) / cos(radians(self.alpha_s_deg)),
            "ring": self.r_s * self.teeth_r / self.teeth_s,
            "sun": self.r_s,
        }
        sense = 1 if self.speeds[self.driver] > 0 else -1
        unit = np.eye(9 + 3 * self.planets)[3 * MEMBERS.index(self.driver) + 2]
        direction = sense * self.fluctuation_scale / (radii[self.driver] * force) * unit
        loads = []
        for order, amplitude, phase in self.torque_orders if self.fluctuation_scale else ():
            multiple = int(exact_order("PlanetarySet", order) / self.kinematics.mesh_speed * self.mesh_order)
            loads.append(order_load(multiple, amplitude, phase, direction))
        return loads

    def _mesh_law(self, pair: str, lag: float) -> Law:
        """Return the dimensionless force law of a mesh with the sun ("sp") or the ring ("rp")."""
        b, ratio = getattr(self, f"b_{pair}") / self.b_c, getattr(self, f"k_{pair}") / self.k_sp
        contacts: MeshContacts | None = getattr(self, f"contacts_{pair}")
        if contacts is None:
            stiffness = mesh_stiffness(getattr(self, f"eps_{pair}"), self.eps_scale).shifted(lag)
            return Backlash(b=b, stiffness=in_order(stiffness.scaled(ratio), self.mesh_order))
        backward = self.kinematics.backward

        def in_common_period(function: Phased) -> Phased:
            directed: Phased = function.reversed() if backward else function
            return in_order(directed, self.mesh_order, lag)

        return contacts.changed(in_common_period, in_common_period).scaled(ratio, 1 / self.b_c).widened(b)
