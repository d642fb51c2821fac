"""Kinematics of planetary gear sets: speeds of the members, phases of the meshes, assembly.

    z_s omega_s + z_r omega_r = (z_s + z_r) omega_c
    mesh n:  k(tau - lag_n),   lag_n from the positions of the planets and the numbers of teeth
    assembly:  psi_n - psi_1 = 2 pi i / (z_s + z_r),   i integer

References
----------
Parker and Lin (2004), J. Mech. Des. 126(2), 365-370, https://doi.org/10.1115/1.1667892 (phases).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import pi

import numpy as np

from hbgear.common.ranges import counted
from hbgear.gears.trains.train_components import Mesh, Wheel
from hbgear.gears.trains.train_kinematics import kinematics

MEMBERS = ("carrier", "ring", "sun")
"""Central members, in the order of their coordinates."""

RESULTANT_TOLERANCE = 1e-6  # sums of unit vectors below this fraction of their number are rounding errors


@dataclass(frozen=True)
class PlanetaryKinematics:
    """Motion of the rigid members of a planetary set, and the phases of its meshes.

    Attributes
    ----------
    teeth_s, teeth_p, teeth_r : int
        Numbers of teeth of sun, planet and ring.
    angles : tuple of float
        Given positions psi_n of the planets [rad]; see `positions`.
    fixed, driver : {"ring", "sun", "carrier"}
        Member that does not turn, and driving member.
    thickness_p : float, default 0.5
        Mean thickness of a planet tooth at the sun and at the ring over the pitch.
    """

    teeth_s: int
    teeth_p: int
    teeth_r: int
    angles: tuple[float, ...]
    fixed: str
    driver: str
    thickness_p: float = 0.5

    @property
    def planets(self) -> int:
        """Number N of planets."""
        return len(self.angles)

    @cached_property
    def positions(self) -> tuple[float, ...]:
        """Positions [rad] at which the teeth match exactly: the given ones without their rounding."""
        pitch = 2 * pi / (self.teeth_s + self.teeth_r)
        first = self.angles[0]
        return tuple(first + pitch * round((psi - first) / pitch) for psi in self.angles)

    @property
    def speeds(self) -> dict[str, Fraction]:
        """Speeds of the members over the speed of the driver, whose torque has the same sign as its speed."""
        z = {"sun": Fraction(self.teeth_s), "ring": Fraction(self.teeth_r)}
        z["carrier"] = -z["sun"] - z["ring"]  # z_s w_s + z_r w_r = (z_s + z_r) w_c
        third = next(name for name in MEMBERS if name not in (self.fixed, self.driver))
        speeds = {self.driver: Fraction(1), self.fixed: Fraction(0), third: -z[self.driver] / z[third]}
        sign = -1 if self.driver == "carrier" else 1  # the torques on the sun and on the ring are positive
        return {name: sign * speeds[name] for name in MEMBERS}

    @property
    def mesh_speed(self) -> Fraction:
        """Mesh frequency over the speed of the driver."""
        return self.teeth_s * abs(self.speeds["sun"] - self.speeds["carrier"])

    @property
    def backward(self) -> bool:
        """Whether the sun turns clockwise in the frame of the carrier."""
        return self.speeds["sun"] < self.speeds["carrier"]

    @cached_property
    def lags(self) -> tuple[float, ...]:
        """Phase lags [rad] of the N meshes with the sun, then with the ring, of a train in the frame of the carrier."""
        wheels = {
            "sun": Wheel("sun", 1.0, teeth=self.teeth_s, base_radius=0.4 * self.teeth_s, torque=1.0),
            "ring": Wheel(
                "ring",
                1.0,
                teeth=self.teeth_r,
                base_radius=0.4 * self.teeth_r,
                internal=True,
                torque=self.teeth_r / self.teeth_s,
            ),
        }
        names = [f"p{n + 1}" for n in range(self.planets)]
        for name in names:
            wheels[name] = Wheel(name, 1.0, teeth=self.teeth_p, base_radius=0.4 * self.teeth_p)
        t, places = self.thickness_p, list(zip(names, self.positions, strict=True))
        meshes = [Mesh("sun", name, 1e8, direction=psi, thickness=(1 - t, t)) for name, psi in places]
        # the centre of the ring lies on the opposite side of the planet
        meshes += [Mesh(name, "ring", 1e8, direction=psi + pi, thickness=(t, 1 - t)) for name, psi in places]
        return kinematics(wheels, (), meshes, backward=self.backward).lags

    # ---- phases

    @property
    def phasing(self) -> str:
        """Phasing of the planets at the sun; see `PlanetarySet.phasing`."""
        turns = np.sort(np.round(np.mod(np.array(self.lags[: self.planets]) / (2 * pi) + 1e-5, 1.0), 4))
        groups, counts = np.unique(turns, return_counts=True)
        if len(groups) == 1:
            return "in phase"
        equal = np.abs(np.diff(groups) - 1 / len(groups)).max() < 1e-3 and len(set(counts)) == 1
        if not equal:
            return "uneven"
        return "counter-phase" if len(groups) == 2 else "sequential"

    def excitation(self, harmonic: int = 1) -> tuple[str, ...]:
        """Return the resultants that a mesh harmonic excites; see `PlanetarySet.excitation`."""
        counted("PlanetarySet: harmonic", harmonic, 10_000)
        waves = np.exp(-1j * harmonic * np.array(self.lags[: self.planets]))
        psi = np.array(self.positions)
        sums = {"torque": [np.ones(self.planets)], "force": [np.exp(1j * psi), np.exp(-1j * psi)]}
        limit = RESULTANT_TOLERANCE * self.planets
        return tuple(name for name, vectors in sums.items() if max(abs(waves @ v) for v in vectors) > limit)

    # ---- assembly

    def check(self) -> None:
        """Raise ValueError if the teeth do not fit, planets touch each other or cannot be assembled."""
        self._check_teeth()
        self._check_assembly()

    def _check_teeth(self) -> None:
        expected = self.teeth_s + 2 * self.teeth_p
        if abs(self.teeth_r - expected) > max(2.0, 0.05 * expected):
            raise ValueError(
                f"PlanetarySet: {self.teeth_p} teeth of a planet do not fit between {self.teeth_s} of the sun and "
                f"{self.teeth_r} of the ring: z_r = z_s + 2 z_p = {expected}, within two teeth for profile shifts"
            )

    def _check_assembly(self) -> None:
        """Raise an error if planets touch each other or their teeth do not match the positions."""
        psi = np.sort(np.mod(self.angles, 2 * pi))
        gaps = np.diff(np.append(psi, psi[0] + 2 * pi))
        size = (self.teeth_p + 2) / (self.teeth_s + self.teeth_p)  # tip diameter over twice the centre distance
        if self.planets > 1 and np.sin(np.minimum(gaps, pi) / 2).min() <= size:
            angle = float(np.degrees(gaps.min()))
            raise ValueError(
                f"PlanetarySet: planets {angle:.4g} degrees apart collide; with {self.teeth_p} teeth on a circle of "
                f"{self.teeth_s + self.teeth_p} they need more than {np.degrees(2 * np.arcsin(min(size, 1.0))):.4g}"
            )
        tooth_sum = self.teeth_s + self.teeth_r
        steps = tooth_sum * (np.asarray(self.angles) - self.angles[0]) / (2 * pi)
        deviations = np.abs(steps - np.round(steps))
        if deviations.max() > 1e-3:
            n = int(np.argmax(deviations))
            nearest = np.degrees(self.angles[0] + 2 * pi * np.round(steps[n]) / tooth_sum)
            raise ValueError(
                f"PlanetarySet: planet {n + 1} cannot be assembled at {np.degrees(self.angles[n]):.6g} degrees: the "
                f"angle from the first planet must be a multiple of 360 / (z_s + z_r) = {360 / tooth_sum:.6g}; the "
                f"nearest position is {nearest:.6g}; equal spacing requires that (z_s + z_r) / N = "
                f"{tooth_sum}/{self.planets} is whole"
            )
