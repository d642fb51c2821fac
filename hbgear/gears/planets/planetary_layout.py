"""Members of a `PlanetarySet`: checks, kinematics and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import radians, sqrt
from typing import Any, ClassVar, Literal

from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, counted
from hbgear.gears.mesh.mesh_excitation import amplitudes, check_contact_scale, parameters_of_meshes
from hbgear.gears.planets.planetary_kinematics import PlanetaryKinematics
from hbgear.gears.torque_orders import mesh_multiple, torque_orders
from hbgear.gears.trains.train_components import check_half_backlash
from hbgear.mechanics.laws.mesh_contacts import MeshContacts
from hbgear.mechanics.models import Model
from hbgear.mechanics.structures.scales import Scales

DEFAULT_LENGTH = 1e-6  # [m], unit of length of a set without backlash

_POSITIVE = ("m_s", "m_p", "m_r", "m_c", "J_s", "J_p", "J_r", "J_c", "k_sp", "k_rp", "k_p", "k_t", "r_s")

_NOT_NEGATIVE = ("k_s", "k_r", "k_c", "zeta", "zeta_b", "b_sp", "b_rp", "torque")


@dataclass(frozen=True)
class PlanetaryLayout(Model):
    """Members of a planetary set with their speeds, phases and units; `PlanetarySet` states the fields."""

    teeth_s: int = 28
    teeth_p: int = 36
    teeth_r: int = 100
    planets: int = 4
    spacing: tuple[float, ...] = ()
    fixed: Literal["ring", "sun", "carrier"] = "ring"
    driver: Literal["ring", "sun", "carrier"] = "sun"
    torque: float = 300.0
    r_s: float = 38.7e-3
    m_s: float = 0.4
    m_p: float = 0.66
    m_r: float = 2.35
    m_c: float = 5.43
    J_s: float = 0.39
    J_p: float = 0.61
    J_r: float = 3.0
    J_c: float = 6.29
    k_sp: float = 5e8
    k_rp: float = 5e8
    k_s: float = 1e8
    k_r: float = 1e8
    k_c: float = 1e8
    k_p: float = 1e8
    k_t: float = 1e9
    alpha_s_deg: float = 24.6
    alpha_r_deg: float = 24.6
    zeta: float = 0.03
    zeta_b: float = 0.03
    b_sp: float = 20e-6
    b_rp: float = 20e-6
    eps_sp: tuple[float, ...] = (0.2, 0.05)
    eps_rp: tuple[float, ...] = (0.2, 0.05)
    e_sp: tuple[float, ...] = ()
    e_rp: tuple[float, ...] = ()
    eps_scale: float = 1.0
    e_scale: float = 1.0
    torque_scale: float = 1.0
    planet_errors: tuple[float, ...] = ()
    carrier_rotation: bool = False
    contacts_sp: MeshContacts | None = None
    contacts_rp: MeshContacts | None = None
    torque_orders: Any = ()
    fluctuation_scale: float = 1.0
    thickness_p: float = 0.5

    labels: ClassVar[Mapping[str, str]] = {
        "Omega": r"$\Omega = \omega_\mathrm{mesh}/\sqrt{k_{sp}/m_p}$ [-]",
        "amplitude": r"$d / b_{sp}$ [-]",
        "torque": r"torque on the sun [N m]",
        "zeta": r"damping ratio of the meshes $\zeta$ [-]",
        "zeta_b": r"damping ratio of the bearings $\zeta_b$ [-]",
        "b_sp": r"half backlash $b_{sp}$ [m]",
        "b_rp": r"half backlash $b_{rp}$ [m]",
        **{name: rf"${name[0]}_{{{name[2:]}}}$ [N/m]" for name in ("k_sp", "k_rp", "k_s", "k_r", "k_c", "k_p", "k_t")},
        **{f"{letter}_{i}": rf"${letter}_{i}$ [kg]" for letter in "mJ" for i in "sprc"},
        "r_s": r"$r_s$ [m]",
        "alpha_s_deg": r"$\alpha_s$ [deg]",
        "alpha_r_deg": r"$\alpha_r$ [deg]",
        "eps_scale": r"factor of the stiffness amplitudes [-]",
        "e_scale": r"factor of the errors [-]",
        "torque_scale": "factor of the torque [-]",
        "fluctuation_scale": "factor of the torque orders [-]",
        "thickness_p": "thickness of the planet teeth over the pitch [-]",
    }
    default_span: ClassVar[tuple[float, float]] = (2.3, 0.5)
    ranges: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(_POSITIVE, POSITIVE),
        **dict.fromkeys(_NOT_NEGATIVE, NOT_NEGATIVE),
        **dict.fromkeys(("alpha_s_deg", "alpha_r_deg"), Range(above=0, below=60)),
        "thickness_p": Range(above=0, below=1),
    }
    usual: ClassVar[Mapping[str, Range]] = {
        **dict.fromkeys(("b_sp", "b_rp"), Range(0, 2e-3)),
        **dict.fromkeys(("zeta", "zeta_b"), Range(0, 1)),
        "torque": Range(0, 1e8),
        "r_s": Range(1e-3, 10),
        **dict.fromkeys(("eps_sp", "eps_rp"), Range(-1, 1)),
        **dict.fromkeys(("e_sp", "e_rp", "planet_errors"), Range(-1e-3, 1e-3)),
    }

    @property
    def title(self) -> str:
        """Tooth counts, number of planets and torque."""
        teeth = f"{self.teeth_s}/{self.teeth_p}/{self.teeth_r}"
        return f"Planetary set {teeth}, {self.planets} planet{'s' * (self.planets != 1)}, {self.torque:g} N m"

    def __post_init__(self) -> None:
        object.__setattr__(self, "torque_orders", torque_orders("PlanetarySet", self.torque_orders))
        super().__post_init__()
        for name in ("eps_sp", "eps_rp", "e_sp", "e_rp", "spacing", "planet_errors"):
            object.__setattr__(self, name, amplitudes("PlanetarySet", name, getattr(self, name)))
        for name in ("b_sp", "b_rp"):
            check_half_backlash("PlanetarySet", name, getattr(self, name))
        check_contact_scale("PlanetarySet", self.eps_scale, [self.contacts_sp, self.contacts_rp])
        for mesh in ("sp", "rp"):
            if getattr(self, f"contacts_{mesh}") is not None and getattr(self, f"eps_{mesh}"):
                raise ValueError(f"PlanetarySet: contacts_{mesh} and eps_{mesh} are both given; give eps_{mesh}=()")
        counted("PlanetarySet: planets", self.planets, 40, least=1)
        for name in ("teeth_s", "teeth_p", "teeth_r"):
            counted(f"PlanetarySet: {name}", getattr(self, name), 10_000, least=4)
        if self.fixed == self.driver:
            raise ValueError(f"PlanetarySet: the {self.fixed} cannot drive and be fixed; name another driver")
        for name in ("spacing", "planet_errors"):
            values = getattr(self, name)
            if values and len(values) != self.planets:
                raise ValueError(
                    f"PlanetarySet: {name} has {len(values)} entries; need {self.planets}, one for each planet"
                )
        self.kinematics.check()

    @property
    def parameters(self) -> dict[str, float]:
        """Float fields by name, without eps_scale if a mesh has contacts."""
        return parameters_of_meshes(super().parameters, [self.contacts_sp, self.contacts_rp])

    # ---- kinematics

    @property
    def angles(self) -> tuple[float, ...]:
        """Positions psi_n of the planets [rad], at which their teeth match exactly."""
        return self.kinematics.positions

    @cached_property
    def kinematics(self) -> PlanetaryKinematics:
        """Speeds of the members and phases of the meshes."""
        degrees = self.spacing or tuple(360 * n / self.planets for n in range(self.planets))
        return PlanetaryKinematics(
            self.teeth_s,
            self.teeth_p,
            self.teeth_r,
            tuple(radians(x) for x in degrees),
            self.fixed,
            self.driver,
            self.thickness_p,
        )

    @property
    def speeds(self) -> dict[str, Fraction]:
        """Speeds of the members over the speed of the driver, whose torque has the same sign as its speed."""
        return self.kinematics.speeds

    @property
    def lags(self) -> dict[str, float]:
        """Phase lag of each mesh behind the mesh of the first planet with the sun [rad]."""
        return dict(zip(self.mesh_names, self.kinematics.lags, strict=True))

    @property
    def mesh_names(self) -> list[str]:
        """Names of the elements: "sun-p1", ..., "ring-p1", ..."""
        return [f"{member}-p{n + 1}" for member in ("sun", "ring") for n in range(self.planets)]

    @property
    def sharing(self) -> list[str]:
        """Names of the meshes of the sun, between which the load is shared."""
        return self.mesh_names[: self.planets]

    @property
    def phasing(self) -> str:
        """Phasing of the planets at the sun: "in phase", "sequential", "counter-phase" or "uneven".

        The planets mesh simultaneously, z_s mod N = 0; in two alternating groups half a mesh period apart, z_s mod N =
        N/2; in three or more groups at equal steps; or otherwise. `excitation` returns the resultant of the forces.
        """
        return self.kinematics.phasing

    def excitation(self, harmonic: int = 1) -> tuple[str, ...]:
        """Return the resultants of the sun meshes that a mesh harmonic excites: "torque", "force", both or neither.

        The torque is sum_n exp(-i l lag_n), the force sum_n exp(-i l lag_n +- i psi_n), over the N planets. With equal
        spacing and k = l z_s mod N, the torque remains for k = 0 and excites rotational modes, the force for k = 1 or N
        - 1 and excites translational modes; for other k both cancel and planet modes are excited.

        Parameters
        ----------
        harmonic : int, default 1
            Harmonic l of the mesh frequency.

        Returns
        -------
        tuple of str
            Resultants that do not cancel.
        """
        return self.kinematics.excitation(harmonic)

    @property
    def orders(self) -> dict[str, float]:
        """Frequencies over Omega of the mesh and of the members that turn."""
        p, mesh = self.mesh_order, self.kinematics.mesh_speed
        return {"mesh": float(p)} | {name: abs(float(p * speed / mesh)) for name, speed in self.speeds.items() if speed}

    @cached_property
    def mesh_order(self) -> int:
        """Mesh frequency over Omega: above 1 if the torque has orders of the driver."""
        return mesh_multiple("PlanetarySet", self.torque_orders, self.kinematics.mesh_speed)

    # ---- units

    @property
    def b_c(self) -> float:
        """Unit of length [m]."""
        return self.b_sp or self.b_rp or DEFAULT_LENGTH

    @property
    def omega_n(self) -> float:
        """Angular frequency of Omega = 1, sqrt(k_sp/m_p) [rad/s]."""
        return sqrt(self.k_sp / self.m_p)

    @property
    def scales(self) -> Scales:
        """Scales whose speed is the speed of the driver."""
        p = self.mesh_order
        return Scales(self.omega_n, self.b_c, self.k_sp * self.b_c, p / self.orders[self.driver], p)
