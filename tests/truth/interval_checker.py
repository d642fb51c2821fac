"""Independent check of certificates of one mass with one element, in the interval arithmetic of mpmath.

It shares no code and no equations with hbgear: the unknowns are the phases of the contact instants, the speeds of the
gap there and Omega; the motion between them is the closed form

    d = D0 + D1 t + Re sum_l D_l e^(i l tau) + e^(-g t) (a cos w t + b sin w t),   or a + b e^(-2 g t) in free flight

and derivatives are computed by automatic differentiation.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
from mpmath import iv


class Interval:
    """Interval of mpmath that leaves products with dual numbers to them."""

    def __init__(self, x: Any) -> None:
        self.x = x.x if isinstance(x, Interval) else iv.mpf(x)

    def _apply(self, other: Any, name: str) -> Any:
        if isinstance(other, Dual):
            return NotImplemented
        return Interval(getattr(self.x, name)(other.x if isinstance(other, Interval) else iv.mpf(other)))

    def __add__(self, other: Any) -> Any:
        return self._apply(other, "__add__")

    def __mul__(self, other: Any) -> Any:
        return self._apply(other, "__mul__")

    __radd__, __rmul__ = __add__, __mul__

    def __sub__(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, Dual) else self + other * -1

    def __rsub__(self, other: Any) -> Any:
        return self * -1 + other

    def __neg__(self) -> Interval:
        return self * -1

    def inverse(self) -> Interval:
        return Interval(1 / self.x)

    def __truediv__(self, other: Any) -> Any:
        return self * Interval(other).inverse()

    @property
    def low(self) -> Any:
        return mpmath.mpf(self.x.a)

    @property
    def high(self) -> Any:
        return mpmath.mpf(self.x.b)

    @property
    def middle(self) -> Any:
        return mpmath.mpf(self.x.mid)


def hull(a: Any, b: Any) -> Interval:
    """Interval between two numbers of mpmath."""
    return Interval(iv.mpf([a, b]))


class Dual:
    """Number with derivatives, of intervals or of other such numbers."""

    def __init__(self, value: Any, slopes: list[Any]) -> None:
        self.value, self.slopes = value, slopes

    def _with(self, other: Any) -> Dual:
        return (
            other if isinstance(other, Dual) and _depth(other) == _depth(self) else Dual(other, [0] * len(self.slopes))
        )

    def __add__(self, other: Any) -> Dual:
        other = self._with(other)
        return Dual(self.value + other.value, [a + b for a, b in zip(self.slopes, other.slopes, strict=True)])

    def __mul__(self, other: Any) -> Dual:
        other = self._with(other)
        pairs = zip(self.slopes, other.slopes, strict=True)
        return Dual(self.value * other.value, [a * other.value + b * self.value for a, b in pairs])

    def inverse(self) -> Dual:
        one = _inverse(self.value)
        return Dual(one, [a * one * one * -1 for a in self.slopes])

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Dual:
        return self * -1

    def __sub__(self, other: Any) -> Dual:
        return self + other * -1

    def __rsub__(self, other: Any) -> Dual:
        return self * -1 + other


def _depth(x: Any) -> int:
    return 1 + _depth(x.value) if isinstance(x, Dual) else 0


def _inverse(x: Any) -> Any:
    return x.inverse()


def _function(x: Any, f: Any, slope: Any) -> Any:
    if isinstance(x, Dual):
        return Dual(_function(x.value, f, slope), [a * slope(x.value) for a in x.slopes])
    return Interval(f(x.x))


def exp(x: Any) -> Any:
    return _function(x, iv.exp, exp)


def sin(x: Any) -> Any:
    return _function(x, iv.sin, cos)


def cos(x: Any) -> Any:
    return _function(x, iv.cos, lambda y: sin(y) * -1)


class Oscillator:
    """M d'' + c d' + k(d) d = F0 + Omega^p ... from the coefficients of a certificate; d = q - e."""

    def __init__(self, data: dict[str, Any]) -> None:
        (element,) = data["elements"]
        self.M, K = Interval(data["M"][0][0]), Interval(data["K"][0][0])
        assert element["direction"] == ["1.0"] and not data["sections"]
        self.K, self.c, self.element = K, Interval(data["C"][0][0]) + Interval(element["damping"]), element
        self.loads = data["loads"]
        self.C_ground = Interval(data["C"][0][0])
        self.turn = Interval(iv.pi) * 2 * data["nu"]

    def breakpoint(self, number: int) -> Any:
        return Interval(self.element["breakpoints"][number])

    def spring(self, level: int) -> tuple[Any, Any]:
        """Slope and force at d = 0 of the line through the segment with ``level`` breakpoints below."""
        slope, force = Interval(0), Interval(0)
        below = [float(x) for x in self.element["breakpoints"][:level]]
        for spring in self.element["springs"]:
            k = Interval(spring["stiffness"]["mean"])
            corners, slopes = spring["corners"], [Interval(x) for x in spring["slopes"]]
            at = sum(float(x) in below for x in corners)
            # walk from d = 0, where the force is known, to the segment
            zero = sum(float(x) < 0 for x in corners)
            offset = Interval(spring["force_at_zero"])
            for i in range(zero, at):
                offset = offset + (slopes[i] - slopes[i + 1]) * Interval(corners[i])
            for i in range(at, zero):
                offset = offset + (slopes[i + 1] - slopes[i]) * Interval(corners[i])
            slope, force = slope + k * slopes[at], force + k * offset
        return slope, force

    def forcing(self, Omega: Any) -> tuple[Any, dict[int, tuple[Any, Any]]]:
        """Constant and harmonics (cosine, sine) on the right side of the equation of d, without the springs."""
        constant, table = Interval(0), {}

        def add(order: int, a: Any, b: Any) -> None:
            old = table.get(order, (Interval(0), Interval(0)))
            table[order] = (old[0] + a, old[1] + b)

        for load in self.loads:
            factor: Any = Interval(1)
            for _ in range(load["power"]):
                factor = factor * Omega
            constant = constant + sum((Interval(x) for x in load["constant"]), Interval(0)) * factor
            for order, vector in load["cosine"].items():
                add(int(order), factor * Interval(vector[0]), Interval(0))
            for order, vector in load["sine"].items():
                add(int(order), Interval(0), factor * Interval(vector[0]))
        e = self.element["displacement"]
        constant = constant - self.K * Interval(e["mean"])
        for name, is_sine in (("cosine", False), ("sine", True)):
            for order, text in enumerate(e[name], start=1):
                x, w = Interval(text), Omega * order
                inertia, damper = (self.M * (w * w) - self.K) * x, self.C_ground * w * x
                # -(M e'' + C e' + K e); the damper of the element acts on d'
                add(order, *((damper * -1, inertia) if is_sine else (inertia, damper)))
        return constant, table

    def advance(self, level: int, d: Any, v: Any, a: Any, b: Any, Omega: Any) -> tuple[Any, Any]:
        """Gap and its speed at phase b after d, v at phase a."""
        slope, offset = self.spring(level)
        k = self.K + slope
        constant, table = self.forcing(Omega)
        t = (b - a) * _inverse(Omega)
        at_a, at_b, rate_a, rate_b = [Interval(0)] * 4
        for order, (p, q) in table.items():
            w = Omega * order
            re, im = k - self.M * (w * w), self.c * w
            size = _inverse(re * re + im * im)
            x, y = (re * p - im * q) * size, (im * p + re * q) * size  # x cos + y sin
            ca, sa, cb, sb = cos(a * order), sin(a * order), cos(b * order), sin(b * order)
            at_a, at_b = at_a + x * ca + y * sa, at_b + x * cb + y * sb
            rate_a, rate_b = rate_a + w * (y * ca - x * sa), rate_b + w * (y * cb - x * sb)
        g = self.c / (self.M * 2)
        if k.low == 0 == k.high:
            speed = (constant - offset) * _inverse(self.c)
            B = (v - rate_a - speed) * ((g * -2).inverse())
            A = d - at_a - B
            decay = exp(t * g * -2)
            return at_b + A + speed * t + B * decay, rate_b + speed + B * decay * (g * -2)
        level_ = (constant - offset) * _inverse(k)
        w = Interval(iv.sqrt((k / self.M - g * g).x))
        A = d - at_a - level_
        B = (v - rate_a + A * g) * w.inverse()
        c, s, decay = cos(t * w), sin(t * w), exp(t * -g)
        x = (A * c + B * s) * decay
        return at_b + level_ + x, rate_b + (B * c - A * s) * w * decay - x * g


class Checker:
    """Krawczyk's test in unknowns (tau_1, v_1, tau_2, v_2, ..., Omega) and a null vector, of a motion, LP or PD."""

    def __init__(self, claim: dict[str, Any]) -> None:
        iv.prec, mpmath.mp.prec = 170, 170
        self.kind, self.system = claim["kind"], Oscillator(claim["equations"])
        self.switches = [tuple(s) for s in claim["order"]["switches"]]
        self.K, level = len(self.switches), claim["order"]["before"][0]
        self.levels = []
        for _, _, sign in self.switches:
            level += sign
            self.levels.append(level)
        self.Omega = Interval(claim["Omega"])
        center = [Interval(x) for x in claim["center"]]
        K, n = self.K, 3 * self.K
        x, tau = center[: 2 * K], center[2 * K : n]
        Omega = self.Omega if self.kind == "motion" else center[n]
        self.start = [part for i in range(K) for part in (tau[i], x[2 * i + 1] - Omega * self._e(tau[i], 1))]
        self.extra: list[Any] = []
        if self.kind != "motion":
            f = center[n + 1 :]
            null = [
                part
                for i in range(K)
                for part in (f[2 * K + i], f[2 * i + 1] - Omega * self._e(tau[i], 2) * f[2 * K + i])
            ]
            self.scaled = max(range(2 * K), key=lambda i: abs(float(null[i].middle)))
            self.extra = [Omega] + [x / null[self.scaled] for x in null]

    def _e(self, tau: Any, order: int) -> Any:
        """Derivative of the prescribed displacement in the phase."""
        e = self.system.element["displacement"]
        a = [(n, Interval(x), Interval(0)) for n, x in enumerate(e["cosine"], start=1)]
        b = [(n, Interval(0), Interval(x)) for n, x in enumerate(e["sine"], start=1)]
        total = Interval(0)
        for n, x, y in a + b:
            for _ in range(order):
                x, y = y * n, x * -n
            total = total + x * cos(tau * n) + y * sin(tau * n)
        return total

    def motion(self, u: list[Any], Omega: Any) -> list[Any]:
        """Residual of all segments."""
        out = []
        for i in range(self.K):
            j = (i + 1) % self.K
            end = u[2 * j] + (self.system.turn if j == 0 else 0)
            d, v = self.system.advance(
                self.levels[i], self.system.breakpoint(self.switches[i][1]), u[2 * i + 1], u[2 * i], end, Omega
            )
            out += [d - self.system.breakpoint(self.switches[j][1]), v - u[2 * j + 1]]
        return out

    def residual(self, z: list[Any]) -> list[Any]:
        n = 2 * self.K
        if self.kind == "motion":
            return self.motion(z, self.Omega)
        u, Omega, null = z[:n], z[n], z[n + 1 :]
        sign = 1 if self.kind == "LP" else -1
        out = self.motion(u, Omega)
        for i in range(self.K):  # derivative of segment i along the null vector, which changes sign after a period
            lifted = [Dual(x, [y]) for x, y in zip(u, null, strict=True)]
            if i == self.K - 1:
                for p in (0, 1):
                    other = (Dual(u[p], [null[p] * sign]), lifted[p])
                    lifted[p] = other[0]
            j = (i + 1) % self.K
            begin = [Dual(u[2 * i + p], [null[2 * i + p]]) for p in (0, 1)]
            end = lifted[2 * j] + (self.system.turn if j == 0 else 0)
            d, v = self.system.advance(
                self.levels[i], self.system.breakpoint(self.switches[i][1]), begin[1], begin[0], end, Dual(Omega, [0])
            )
            out += [d.slopes[0], (v - lifted[2 * j + 1]).slopes[0]]
        return [*out, null[self.scaled] - 1]

    def evaluate(self, z: list[Any]) -> tuple[list[Any], list[list[Any]]]:
        n = len(z)
        duals = [Dual(x, [Interval(int(i == k)) for k in range(n)]) for i, x in enumerate(z)]
        F = self.residual(duals)
        return [f.value for f in F], [[Interval(s) for s in f.slopes] for f in F]

    def krawczyk(self, radius: str) -> list[Any] | None:
        """Image of the box of half width ``radius`` if it lies in its interior, else None."""
        center = [Interval(x.middle) for x in (*self.start, *self.extra)]
        n, r = len(center), Interval(radius)
        Z = [x + r * hull(-1, 1) for x in center]
        F, J = self.evaluate(center)[0], self.evaluate(Z)[1]
        Y = np.linalg.inv(np.array([[float(x.middle) for x in row] for row in J]))
        out = []
        for i in range(n):
            y = [Interval(float(x)) for x in Y[i]]
            value = center[i] - sum((a * b for a, b in zip(y, F, strict=True)), Interval(0))
            for k in range(n):
                entry = Interval(int(i == k)) - sum((y[p] * J[p][k] for p in range(n)), Interval(0))
                value = value + entry * (Z[k] - center[k])
            out.append(value)
        inside = all(z.low < k.low and k.high < z.high for z, k in zip(Z, out, strict=True))
        return out if inside else None

    def signs_hold(self, image: list[Any]) -> bool:
        """Whether all gaps stay between their breakpoints in the box, by intervals of the phase."""
        Omega = self.Omega if self.kind == "motion" else image[2 * self.K]
        for i, level in enumerate(self.levels):
            j = (i + 1) % self.K
            a, b = image[2 * i], image[2 * j] + (self.system.turn if j == 0 else 0)
            for k, sign in ((level - 1, 1), (level, -1)):
                if 0 <= k < len(self.system.element["breakpoints"]):
                    ends = [self.switches[x][1] == k for x in (i, j)]
                    if not self._positive(image, i, Omega, a, b, k, sign, ends, 0):
                        return False
        return True

    def _positive(
        self, image: list[Any], i: int, Omega: Any, a: Any, b: Any, k: int, sign: int, ends: list[bool], depth: int
    ) -> bool:
        tau = hull(a.low, b.high)
        d, v = self.system.advance(
            self.levels[i], self.system.breakpoint(self.switches[i][1]), image[2 * i + 1], image[2 * i], tau, Omega
        )
        left, right = ends
        if not (left or right) and ((d - self.system.breakpoint(k)) * sign).low > 0:
            return True
        if left != right and (v * sign * (1 if left else -1)).low > 0:
            return True
        if depth > 14:
            return False
        middle = Interval((a.low + b.high) / 2)
        return self._positive(image, i, Omega, a, middle, k, sign, [left, False], depth + 1) and self._positive(
            image, i, Omega, middle, b, k, sign, [False, right], depth + 1
        )
