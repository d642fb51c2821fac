"""Epicyclic gear sets, rotation only: stepped planets, meshing planets (Ravigneaux), several suns and rings.

    M theta'' + sum_j w_j [k_j(tau) f(d_j) + c_j d_j'] = T,      d_j = w_j^T theta - e_j(tau)
    w_j:  mesh of wheels a and b  +-r_a (theta_a - theta_c) +-r_b (theta_b - theta_c)
    Willis:  omega_i = omega_c + s_i omega_rel,    s_i from the numbers of teeth with the carrier at rest
    static:  sum T_i omega_i = 0,    sum T_i = 0,  over driver, output and fixed member
    assembly of simple planets: (z_s + z_r) / N whole;  of stepped ones: (z_r + z_s z_b / z_a) / N a multiple of
    gcd(z_a, z_b) / z_a, with z_a at the sun and z_b at the ring

In the frame of the carrier all axes are at rest: the set is a `Train`, from which directions, tooth frequencies and
phases of the meshes follow. The rotation of the carrier is one more coordinate. The inertia of the carrier includes the
masses of the planets at their distances from the axis. Forces on bearings, and motions of the axes, are in
`PlanetarySet`.

References
----------
Willis (1841), Principles of Mechanism, Parker. Parker & Lin (2004), J. Mech. Des. 126(2), 365-370,
https://doi.org/10.1115/1.1667892 (phases).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from math import hypot, pi

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.gears.mesh.mesh_excitation import contacts_in_order, in_order
from hbgear.gears.planets.epicyclic_layout import CARRIER, EpicyclicLayout
from hbgear.gears.torque_orders import exact_order, order_load
from hbgear.gears.trains.train_kinematics import kinematics
from hbgear.mechanics.laws.laws import Law, PiecewiseLinear
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.models import System
from hbgear.mechanics.structures.elements import Element, Load

ZERO_SQUARE = 1e-9
"""Square of a frequency, over the largest one, that is attributed to rounding."""


@dataclass(frozen=True)
class EpicyclicSet(EpicyclicLayout):  # numpydoc ignore=PR02
    """Gears on a carrier with N equal groups of planets; the module docstring states the equations.

    Parameters
    ----------
    wheels : tuple of Wheel
        Central gears, at x = y = 0, and the gears of the first group of planets at their positions in the frame of the
        carrier. Further groups are turned by 360 / N degrees. All have ``moves="torsion"``.
    meshes : tuple of Mesh
        Meshes of the first group, also between two planets.
    carrier_inertia : float, default 0.01
        Moment of inertia of the carrier without planets [kg m^2].
    planets : int, default 3
        Number N of groups.
    bodies : tuple of tuple of str, optional
        Names of planet gears that are one body, a stepped planet, such as ``(("large", "small"),)``.
    driver, output, fixed : str
        Driving, driven and resting member: the name of a central gear, or "carrier". Other central gears turn without
        load.
    torque : float, default 100.0
        Torque on the driver [N m], positive in the direction of its rotation.
    torque_scale, backlash_scale, eps_scale, e_scale : float, default 1.0
        Factors of the torque, all backlashes, stiffness amplitudes and errors, for use as continuation parameters.
    torque_orders : mapping, optional
        Harmonics of the torque on the driver by order of its rotation, such as ``{2: "60 N m"}``, or ``{2: ("60 N m",
        "30 deg")}`` with a phase at tau = 0; see `hbgear.gears.torque_orders`. Omega is then the common frequency of
        meshes and orders, and `common_order` the frequency of the meshes over it.
    fluctuation_scale : float, default 1.0
        Factor of the amplitudes of the torque orders.

    Raises
    ------
    ValueError
        If a name is unknown, the members do not turn, teeth do not fit, or a wheel or mesh has what this model does not
        have: other motions than rotation, torques, friction, errors of single teeth.

    Examples
    --------
    A stepped planet: the ring is held, and the carrier turns 1 + (30 x 96) / (24 x 18) times slower than the sun.

    >>> import hbgear as hb
    >>> wheel = hb.gears.Wheel
    >>> gears = [wheel("sun", 1e-4, teeth=24, base_radius="22.5526 mm"),
    ...     wheel("large", 2e-4, 0.5, teeth=30, base_radius="28.1908 mm", x="54 mm"),
    ...     wheel("small", 1e-4, 0.3, teeth=18, base_radius="11.7099 mm", x="54 mm"),
    ...     wheel("ring", 1e-2, teeth=96, base_radius="62.4533 mm", internal=True)]
    >>> meshes = [hb.gears.Mesh("sun", "large", "4e8 N/m", "20 um"), hb.gears.Mesh("small", "ring", "4e8 N/m", "20 um")]
    >>> stepped = hb.gears.EpicyclicSet(gears, meshes, planets=3, bodies=(("large", "small"),))
    >>> stepped.ratio, round(stepped.torques["ring"])
    (Fraction(23, 3), 667)
    """

    @property
    def mesh_torques(self) -> dict[str, float | None]:
        """Static torque of each mesh on its first wheel [N m], the share of one planet, for `Mesh.of`.

        The meshes are those of the first group; None where several of them share the load. They do not include
        `torque_scale`.

        Examples
        --------
        >>> import hbgear as hb
        >>> wheel, mesh = hb.gears.Wheel, hb.gears.Mesh
        >>> gears = [wheel("sun", 1e-4, teeth=24, base_radius="22 mm"),
        ...     wheel("planet", 2e-4, 0.5, teeth=36, base_radius="33 mm", x="60 mm"),
        ...     wheel("ring", 1e-2, teeth=96, base_radius="88 mm", internal=True)]
        >>> meshes = [mesh("sun", "planet", "4e8 N/m"), mesh("planet", "ring", "4e8 N/m")]
        >>> simple = hb.gears.EpicyclicSet(gears, meshes, planets=4, torque=100.0)
        >>> {name: round(torque, 6) for name, torque in simple.mesh_torques.items()}
        {'sun-planet': 25.0, 'planet-ring': 37.5}
        """
        external = self._external_torques(self.torque / self.planets)
        loaded = {
            name: dataclasses.replace(wheel, torque=external.get(name, 0.0)) for name, wheel in self._by_name.items()
        }
        forces = kinematics(loaded, self._shafts(("",)), self.meshes).forces
        return {
            mesh.name: None if force is None else force * loaded[mesh.first].base_radius
            for mesh, force in zip(self.meshes, forces, strict=True)
        }

    @cached_property
    def _coordinates(self) -> dict[str, tuple[tuple[str, ...], float]]:
        """Gears that turn together, and the radius of the unit of rotation, by the name of the coordinate."""
        coordinates: dict[str, tuple[tuple[str, ...], float]] = {
            name: ((name,), self._by_name[name].base_radius) for name in self._central if name != self.fixed
        }
        bodies = [*self.bodies, *((name,) for name in self._planet_gears if all(name not in b for b in self.bodies))]
        for n in range(self.planets):
            for body in bodies:
                gears = tuple(f"{name}{n + 1}" for name in body)
                coordinates["-".join(gears)] = gears, self._by_name[body[0]].base_radius
        if self.fixed != CARRIER:
            coordinates[CARRIER] = (), max(hypot(wheel.x, wheel.y) for wheel in self.wheels)
        return coordinates

    def structure(self) -> tuple[Array, Array]:
        """Return the inertias (n,) [kg m^2] of the coordinates and the directions (n, m) of the gaps [m/rad]."""
        train = self.train
        index = {wheel.name: i for i, wheel in enumerate(train.wheels)}
        inertia = np.array([wheel.inertia for wheel in train.wheels])
        orbit = sum(wheel.mass * (wheel.x**2 + wheel.y**2) for wheel in train.wheels)
        W = train.mesh_vectors()
        rows, J = [], []
        for name, (gears, _) in self._coordinates.items():
            members = [index[gear] for gear in gears]
            rows.append(W[members].sum(axis=0) if name != CARRIER else -W.sum(axis=0))
            J.append(inertia[members].sum() if name != CARRIER else self.carrier_inertia + orbit)
        return np.array(J), np.array(rows)

    @property
    def natural_frequencies(self) -> Array:
        """Undamped natural frequencies with all teeth in contact at their mean stiffness [Hz], ascending."""
        J, W = self.structure()
        k = np.array([mesh.k_mean for mesh in self.train.meshes])
        square = scipy.linalg.eigh((W * k) @ W.T, np.diag(J), eigvals_only=True)
        return np.sqrt(np.where(square > ZERO_SQUARE * square.max(), square, 0.0)) / (2 * pi)

    def system(self) -> System:
        """Return the dimensionless equations of motion with one element for each mesh, in the units of the train."""
        train, torques = self.train, self.torques
        J, W = self.structure()
        S = np.array([1 / radius for _, radius in self._coordinates.values()])
        gaps = [
            dataclasses.replace(in_common_period(element, self.common_order), direction=S * w)
            for element, w in zip(train.system().elements, W.T, strict=True)
        ]
        S_F = S / (train.k_mean * train.b_c)
        mean = Load(constant=S_F * np.array([torques.get(name, 0.0) for name in self._coordinates]))
        return System(
            M=np.diag(J * S**2 / train.m_c),
            C=None,
            K=np.zeros((len(J), len(J))),
            elements=gaps,
            load=[mean, *self._fluctuations(S_F)],
            dof_names=[f"u_{name}" for name in self._coordinates],
        )

    def _fluctuations(self, scale: Array) -> list[Load]:
        """Return the loads T cos(order theta + phase) of the driver, theta its angle since tau = 0."""
        unit = scale * np.array([float(name == self.driver) for name in self._coordinates]) * self.fluctuation_scale
        loads = []
        for order, amplitude, phase in self.torque_orders if self.fluctuation_scale else ():
            multiple = int(exact_order("EpicyclicSet", order) / self._mesh_speed * self.common_order)
            loads.append(order_load(multiple, amplitude, phase, unit))
        return loads


def in_common_period(element: Element, times: int) -> Element:
    """Return the element of a mesh whose functions of tau have a whole multiple of its frequency."""
    if times == 1:
        return element
    law: Law = element.law
    if isinstance(law, MeshContacts):
        law = contacts_in_order(law, times * law.meshes)
    elif isinstance(law, PiecewiseLinear):
        law = dataclasses.replace(law, stiffness=in_order(law.stiffness, times))
    return dataclasses.replace(element, law=law, displacement=in_order(element.displacement, times))
