"""Equations of a certified point, with their derivatives, in ball arithmetic.

    motion            B(u) = 0                                u = states and phases of the contact instants
    fold              B(u, Omega) = 0,  B_u v = 0,  l v = 1           multiplier 1
    period doubling   the same, with v that changes sign after a period   multiplier -1
    grazing           B(u, Omega) = 0,  h(t) = 0,  dh/dt(t) = 0           without the contact

B are the flows of the segments and the switching conditions, see `hbgear.harmonic.instants.shooting`. B_u v has the
derivatives of the second order that a proof needs. A regular Jacobian of these equations means that the fold is
quadratic, and that the multiplier passes -1 with nonzero speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.analysis.certificates.ball_system import Balls, BallSystem, balls, zeros
from hbgear.analysis.certificates.flows import Piece
from hbgear.harmonic.instants.pattern import Pattern, Switch

SIGNS = {"LP": 1, "PD": -1}
"""Sign of the null vector after one period."""


@dataclass(frozen=True)
class ContactOrder:
    """Order of the switches of a motion.

    Attributes
    ----------
    pattern : Pattern
        Switches, and the number of breakpoints below each gap in the segment that follows.
    turns : tuple of int
        For switches of fixed phase, the number of periods of the excitation to add to the phase of the section.
    grazing : tuple of int, optional
        Segment in which a gap grazes, element, breakpoint, and side (+1 from below). Empty otherwise.
    """

    pattern: Pattern
    turns: tuple[int, ...]
    grazing: tuple[int, int, int, int] | tuple[()] = ()

    def describe(self) -> dict[str, Any]:
        """Return plain data."""
        first = self.pattern.contacts[-1]
        return {
            "switches": [list(s) for s in self.pattern.switches],
            "turns": list(self.turns),
            "before": list(first.levels),
            "section": first.section,
            "grazing": list(self.grazing),
        }

    @staticmethod
    def of(data: Any) -> ContactOrder:
        """Return the order of plain data; raises InconsistentPatternError if switches cannot follow each other."""
        pattern = Pattern.of([Switch(*s) for s in data["switches"]], data["before"], data["section"])
        return ContactOrder(pattern, tuple(data["turns"]), tuple(data["grazing"]))


class PointEquations:
    """Equations of one kind of point.

    Parameters
    ----------
    system : BallSystem
        Coefficients.
    order : ContactOrder
        Order of the switches.
    kind : str
        "motion", "LP", "PD" or "GR".
    Omega : ball or None
        Frequency of a motion; None if it is an unknown.
    functional : sequence of balls
        Row l that scales the null vector of a fold or period doubling.
    """

    def __init__(
        self, system: BallSystem, order: ContactOrder, kind: str, Omega: Any = None, functional: Sequence[Any] = ()
    ) -> None:
        self.system, self.order, self.kind, self.Omega = system, order, kind, Omega
        self.functional = np.array(list(functional), dtype=object)
        self.K, self.r = order.pattern.count, system.r
        switches = order.pattern.switches
        self.free = [i for i, s in enumerate(switches) if not s.is_fixed]
        self.column = {i: self.K * self.r + n for n, i in enumerate(self.free)}
        self.n = self.K * self.r + len(self.free)
        self.size = {"motion": self.n, "GR": self.n + 2}.get(kind, 2 * self.n + 1)

    # ---- unknowns

    def states(self, z: Balls) -> Balls:
        """Return the states (K, 2n) at the switches."""
        return z[: self.K * self.r].reshape(self.K, self.r)

    def phases(self, z: Balls) -> list[Any]:
        """Return the phases of the K switches."""
        return [z[self.column[i]] if i in self.column else self._fixed_phase(i) for i in range(self.K)]

    def frequency(self, z: Balls) -> Any:
        """Return Omega."""
        return self.Omega if self.kind == "motion" else z[self.n]

    def _fixed_phase(self, i: int) -> Any:
        """Return the phase of a switch at which a section begins."""
        from flint import arb

        sections, section = self.system.data["sections"], self.order.pattern.switches[i].breakpoint
        start = arb(sections[section]) if sections else arb(0)
        return start + arb.pi() * (2 * self.order.turns[i])

    def ends(self, z: Balls) -> list[tuple[Any, Any]]:
        """Return the phases at which the segments begin and end."""
        tau = self.phases(z)
        return list(zip(tau, [*tau[1:], tau[0] + self.system.period], strict=True))

    def flows(self, z: Balls) -> list[Any]:
        """Return the flows of the segments."""
        Omega = self.frequency(z)
        return [
            self.system.flow(contacts.levels, 0.5 * (float(a.mid()) + float(b.mid())), Omega)
            for contacts, (a, b) in zip(self.order.pattern.contacts, self.ends(z), strict=True)
        ]

    # ---- equations

    def evaluate(self, z: Balls) -> tuple[Balls, Balls]:
        """Return the residual (size,) and its derivatives (size, size) at unknowns, which may be wide balls."""
        ends, x, flows = self.ends(z), self.states(z), self.flows(z)
        pieces = [Piece(self.system, flow, xi, *ab) for flow, xi, ab in zip(flows, x, ends, strict=True)]
        B, J = self._motion(x, self.phases(z), pieces)
        if self.kind == "motion":
            return B, J[:, :-1]
        if self.kind == "GR":
            return self._with_grazing(z, flows, B, J)
        return self._with_null_vector(z, pieces, B, J)

    def _motion(self, x: Balls, tau: list[Any], pieces: list[Piece]) -> tuple[Balls, Balls]:
        """Return B (n,) and its derivatives (n, n + 1) in u and Omega."""
        K, r, system = self.K, self.r, self.system
        B, J, unit = zeros(self.n), zeros(self.n, self.n + 1), balls(np.eye(r))
        for i, piece in enumerate(pieces):
            j = (i + 1) % K
            block, next_block = slice(i * r, i * r + r), slice(j * r, j * r + r)
            B[block] = x[j] - piece.G
            J[block, next_block] = J[block, next_block] + unit
            J[block, block] = J[block, block] - piece.G_x
            for switch, part in ((i, piece.G_a), (j, piece.G_b)):
                if switch in self.column:
                    J[block, self.column[switch]] = J[block, self.column[switch]] - part
            J[block, -1] = -piece.G_p
        for i, index in self.column.items():
            element, breakpoint, _ = self.order.pattern.switches[i]
            row, c = system.rows[element], system.functions(tau[i])
            B[index] = row[:r] @ x[i] + row[r:] @ c - system.breakpoints[element][breakpoint]
            J[index, i * r : i * r + r] = row[:r]
            J[index, index] = row[r:] @ (system.generator @ c)
        return B, J

    def _with_null_vector(self, z: Balls, pieces: list[Piece], B: Balls, J: Balls) -> tuple[Balls, Balls]:
        """Return the equations of a fold or a period doubling."""
        n, K, r, sign = self.n, self.K, self.r, SIGNS[self.kind]
        v, tau = z[n + 1 :], self.phases(z)
        F, out = zeros(self.size), zeros(self.size, self.size)
        F[:n], out[:n, : n + 1] = B, J
        rows, changed = zeros(n, n), zeros(n, n + 1)  # B_u of v, and the derivatives of B_u v in u and Omega
        for i, piece in enumerate(pieces):
            j, s = (i + 1) % K, sign if i == K - 1 else 1
            block, next_block = slice(i * r, i * r + r), slice(j * r, j * r + r)
            da, db = (v[self.column[k]] if k in self.column else 0 for k in (i, j))
            D, D_x, D_a, D_b, D_p = piece.second(v[block], da, db * s)
            F[n + i * r : n + i * r + r] = v[next_block] * s - D
            rows[block, next_block] = rows[block, next_block] + balls(np.eye(r)) * s
            rows[block, block] = rows[block, block] - piece.G_x
            changed[block, block] = changed[block, block] - D_x
            changed[block, n] = -D_p
            for k, part, change in ((i, piece.G_a, D_a), (j, piece.G_b * s, D_b)):
                if k in self.column:
                    rows[block, self.column[k]] = rows[block, self.column[k]] - part
                    changed[block, self.column[k]] = changed[block, self.column[k]] - change
        S = self.system.generator
        for i, index in self.column.items():
            row = self.system.rows[self.order.pattern.switches[i].element]
            c = self.system.functions(tau[i])
            slope = row[r:] @ (S @ c)
            F[n + index] = row[:r] @ v[i * r : i * r + r] + slope * v[index]
            rows[index, i * r : i * r + r], rows[index, index] = row[:r], slope
            changed[index, index] = row[r:] @ (S @ (S @ c)) * v[index]
        out[n : 2 * n, : n + 1], out[n : 2 * n, n + 1 :] = changed, rows
        F[2 * n], out[2 * n, n + 1 :] = self.functional @ v - 1, self.functional
        return F, out

    def _with_grazing(self, z: Balls, flows: list[Any], B: Balls, J: Balls) -> tuple[Balls, Balls]:
        """Return the equations of a grazing point at phase t, the last unknown."""
        n, r, system = self.n, self.r, self.system
        i, element, breakpoint, _ = self.order.grazing  # type: ignore[misc]
        t, x, a = z[n + 1], self.states(z)[i], self.phases(z)[i]
        piece, row = Piece(system, flows[i], x, a, t), system.rows[element]
        F, out = zeros(self.size), zeros(self.size, self.size)
        F[:n], out[:n, : n + 1] = B, J
        weight = row @ piece.A_b  # dh/dt = weight y
        F[n] = row @ piece.end - system.breakpoints[element][breakpoint]
        F[n + 1] = weight @ piece.end
        columns: list[tuple[Any, Balls]] = [(slice(i * r, i * r + r), piece.G_x), (n, piece.G_p)]
        if i in self.column:
            columns.append((self.column[i], piece.G_a))
        for column, part in columns:
            out[n, column], out[n + 1, column] = row[:r] @ part, weight[:r] @ part
        out[n + 1, n] = out[n + 1, n] + row @ (piece.A1_b @ piece.end)
        out[n, n + 1] = F[n + 1]
        out[n + 1, n + 1] = weight @ (piece.A_b @ piece.end) + row @ (piece.slope_b @ piece.end)
        return F, out
