"""Claims of the paper's figures compared with the results of this model, with computed verdicts.

    python -m studies.dong_2022.claims [--quick] [-o DIR]

A claim is a list of conditions on the results: reproduced if all of them hold, in part if some do, else refuted. The
amplitude is half the peak-to-peak of the left gap in units of b_c, the displacement the largest |d|. A jump is a fold
that a slow sweep runs into. All claims are compared with two readings of what the paper leaves open: the default of
`DoubleHelicalPair`, and the one that `search` found by its agreement with Figures 3 and 4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

import hbgear as hb
from hbgear.mechanics.series import measures
from studies import study
from studies.dong_2022 import base

Results = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """What the claims need of one response curve.

    peak, peak_at : largest amplitude and its Omega. slope : steepest rise |dA/dOmega|, at slope_at.
    jumps : Omega of the jumps. regimes : those that occur on stable motions.
    superharmonics : Omega of local peaks below 0.65.
    displacement : largest |d|. height : largest change of amplitude at a jump, 0 without jumps.
    """

    peak: float
    peak_at: float
    slope: float
    slope_at: float
    jumps: tuple[float, ...]
    regimes: tuple[str, ...]
    superharmonics: tuple[float, ...]
    displacement: float = np.nan
    height: float = 0.0

    @property
    def linear(self) -> bool:
        """Whether the teeth never lose contact."""
        return self.regimes == ("no_impact",)


@dataclass(frozen=True)
class Claim:
    """One claim: what the paper says, what was measured (text from results), conditions, and why it is so.

    A claim without conditions needs a part that the model does not have.
    """

    figure: str
    text: str
    measured: Callable[[Results], str]
    conditions: tuple[Callable[[Results], bool], ...]
    reason: str

    def verdict(self, r: Results) -> str:
        """One of "reproduced", "in part", "refuted", "not modelled"."""
        if not self.conditions:
            return "not modelled"
        held = [bool(condition(r)) for condition in self.conditions]
        return "reproduced" if all(held) else "in part" if any(held) else "refuted"


def case(branch: hb.Branch) -> Case:
    """The numbers of a response curve."""
    peaks = hb.analysis.peaks(branch, "pp2")
    top = max(peaks, key=lambda point: point.amplitude("pp2"))
    stable = np.ones(len(branch), dtype=bool) if branch.stable is None else branch.stable
    regimes = {name for name, ok in zip(branch.regimes, stable, strict=True) if ok}
    return Case(
        top.amplitude("pp2"),
        top.parameters["Omega"],
        *steepest(branch),
        tuple(jump.value for jump in branch.jumps()),
        tuple(sorted(regimes)),
        tuple(point.parameters["Omega"] for point in peaks if point.parameters["Omega"] < 0.65),
        float(branch.amplitude("max").max()),
        max((jump_height(jump) for jump in branch.jumps()), default=0.0),
    )


def jump_height(jump: hb.Jump) -> float:
    """Change of the amplitude at a jump; 0 if the motion after it is not known."""
    if jump.before is None or jump.after is None:
        return 0.0
    return abs(jump.after.amplitude("pp2") - jump.before.amplitude("pp2"))


def steepest(branch: hb.Branch) -> tuple[float, float]:
    """Largest |dA/dOmega| between rows, and where; without folds, between rows so close that it is the derivative."""
    i, slope = _between_rows(branch)
    if not any(point.kind == "LP" for point in branch.special):
        first, last = max(i - 1, 0), min(i + 2, len(branch) - 1)
        span = float(branch.values[first]), float(branch.values[last])
        branch = hb.trace(
            branch.problem,
            "Omega",
            span,
            branch[first],
            steps=hb.StepControl(max_step=0.01),
            stability=False,
            special=False,
        )
        i, slope = _between_rows(branch)
    return slope, float(branch.values[i : i + 2].mean())


def _between_rows(branch: hb.Branch) -> tuple[int, float]:
    """The row behind which the amplitude changes most for its Omega, and |dA/dOmega| there."""
    change, step = (np.abs(np.diff(y)) for y in (branch.amplitude("pp2"), branch.values))
    slopes = np.divide(change, step, out=np.zeros_like(change), where=step > 1e-9)
    return int(np.argmax(slopes)), float(slopes.max())


def motion(point: hb.Point) -> dict[str, Any]:
    """Regime, least gap, stability and the amplitudes of all orders of one motion."""
    row = point.coefficients()
    orders = np.hypot(row[1::2], row[2::2])
    low = float(point.samples()[1].min())
    return {"regime": point.regime_name, "least": low, "stable": point.stable, "orders": orders}


def opposition(point: hb.Point) -> tuple[float, float]:
    """|d_L + d_R| and |d_L - d_R| of the half orders of a doubled motion (norms of their Fourier coefficients).

    The first is zero if the halves move in opposite phase, the second if they move alike.
    """
    left, right = (point.coefficients(j)[1:].reshape(-1, 2)[::2] for j in (0, 1))
    return float(np.linalg.norm(left + right)), float(np.linalg.norm(left - right))


def doubling(curve: hb.Branch) -> dict[str, Any] | None:
    """The motion of two periods at Omega = 1/3, and where that of one period is unstable; None if it is stable."""
    places = sorted((point.parameters["Omega"], point.label) for point in curve.special if point.kind == "PD")
    below, above = ([place for place in places if (place[0] > 1 / 3) == side] for side in (False, True))
    if not (below and above) or base.at(curve, 1 / 3).stable:
        return None
    point = base.at(hb.switch(curve, above[0][1]), 1 / 3)
    return {**motion(point), "opposition": opposition(point), "unstable": (below[-1][0], above[0][0])}


READINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "found": {"torque": 700.0, "phi_deg": -10.0, "mesh_helix": "base"},
}
"""Readings as changes of `DoubleHelicalPair`; the second, of `search`, has the torque of the paper over both halves."""


def run(quick: bool = False) -> dict[str, Results]:
    """All results by reading; the quick form has the base case with few harmonics everywhere."""
    return {name: results(reading, quick) for name, reading in READINGS.items()}


def results(reading: dict[str, Any], quick: bool) -> Results:
    """All curves of the figures in one reading."""
    H = 8 if quick else 16

    def of(**changes: Any) -> Case:
        return case(base.curve(H, **reading, **({} if quick else changes)))

    def loaded(torque: float, **changes: Any) -> Case:
        both = {**reading, "torque": torque * reading.get("torque", 1400.0) / 1400.0, **changes}
        return case(base.curve(H, **(reading if quick else both)))

    curve = base.curve(H, **reading)
    frequencies = {"1": 1.0, "1/2": 0.5, "1/3": 1 / 3}
    return {
        "base": of(),
        "motions": {name: motion(base.at(curve, Omega)) for name, Omega in frequencies.items()},
        "doubled": doubling(curve),
        "W": [of(W=W) for W in base.W],
        "eps": [of(eps=eps) for eps in base.EPS],
        "eps W": [of(eps=eps, W=0.6) for eps in base.EPS],
        "zeta": [of(zeta=zeta) for zeta in base.ZETA],
        "zeta W": [of(zeta=zeta, W=0.6) for zeta in base.ZETA],
        "e": [of(e=e) for e in base.E],
        "e W": [of(e=e, W=0.6) for e in base.E],
        "torque": [loaded(torque) for torque in base.TORQUE],
        "torque W": [loaded(torque, W=0.6) for torque in base.TORQUE],
        "b": backlash(reading, quick),
    }


def backlash(reading: dict[str, Any], quick: bool) -> list[list[float]]:
    """Amplitude [um] at 400, 600, 1200 r/min (rows: measured backlash) with e(t) of fixed length in metres."""
    out = []
    for b in base.B[:: 3 if quick else 1]:
        e = tuple(x * 25e-6 / (b / 2) for x in hb.gears.DoubleHelicalPair().e)
        pair = hb.gears.DoubleHelicalPair(b_c=b / 2, e=e, **reading)
        problem = hb.HarmonicBalance(pair, 8)
        row = []
        for speed in base.SPEEDS:
            Omega = pair.from_pinion_speed(speed)
            X = problem.start(Omega)
            row.append(float(measures.measure("pp2", X.reshape(2, -1)[0])) * pair.b_c * 1e6)
        out.append(row)
    return out


def rising(values: list[float], tolerance: float = 1e-6) -> bool:
    """Whether each is larger than the one before by more than a relative tolerance."""
    return all(b > a * (1 + tolerance) for a, b in pairwise(values))


def displacements(cases: list[Case]) -> list[float]:
    """Their largest displacements."""
    return [c.displacement for c in cases]


def wider(figure: str, name: str, sets: str) -> Claim:
    """The claim that a wider backlash makes the displacement larger in every set of a figure."""
    return Claim(
        figure,
        f"displacement at W = 0.6 larger than at W = 0, for every {sets}",
        lambda r: f"{amounts(displacements(r[name]))} at W = 0; {amounts(displacements(r[name + ' W']))} at W = 0.6",
        (lambda r: all(b > a for a, b in zip(displacements(r[name]), displacements(r[name + " W"]), strict=True)),),
        "W is added to the gap; the alternating motion is the same",
    )


def peaks(cases: list[Case]) -> list[float]:
    """Their peak amplitudes."""
    return [c.peak for c in cases]


def near(values: tuple[float, ...], target: float, within: float) -> bool:
    """Whether one of the values is that near to the target."""
    return any(abs(x - target) <= within for x in values)


def share(orders: np.ndarray, which: slice) -> float:
    """Part of the power of the alternating motion that some orders have."""
    return float(np.sum(orders[which] ** 2) / np.sum(orders**2))


def strongest(orders: np.ndarray) -> float:
    """Part of the power of the alternating motion that the strongest order has: 1 for an ellipse."""
    return float(np.max(orders) ** 2 / np.sum(orders**2))


def three_lines(orders: np.ndarray) -> bool:
    """Whether mesh orders 1, 2, 3 have 99 % of the power, each a twentieth of the strongest at least."""
    return share(orders, slice(3)) > 0.99 and float(np.min(orders[:3])) > np.max(orders) / 20


def two_lines(orders: np.ndarray) -> bool:
    """Whether mesh orders 1 and 2 have 99 % of the power, and no other order a tenth of the strongest."""
    return share(orders, slice(2)) > 0.99 and float(np.max(orders[2:])) < np.max(orders) / 10


def third(r: Results) -> dict[str, Any]:
    """The motion of two periods at Omega = 1/3 if there is one, else that of one period."""
    found: dict[str, Any] = r["doubled"] or r["motions"]["1/3"]
    return found


def half_orders(r: Results) -> str:
    """The first orders of the motion of two periods at Omega = 1/3."""
    doubled = r["doubled"]
    return f"; two periods: orders 1/2, 1, 3/2: {amounts(doubled['orders'][:3])}, {words(doubled)}" if doubled else ""


def words(m: dict[str, Any] | None) -> str:
    """Regime and stability of a motion."""
    if m is None:
        return "none"
    return f"{m['regime']}, {'stable' if m['stable'] else 'unstable'}"


def amounts(values: Iterable[float]) -> str:
    """Numbers of a table."""
    return ", ".join(f"{x:.4f}" for x in values)


def folds(cases: list[Case]) -> str:
    """Jump frequencies of several cases."""
    return "; ".join(", ".join(f"{x:.4f}" for x in c.jumps) or "none" for c in cases)


CLAIMS = (
    Claim(
        "3",
        "Omega = 1: near ellipse",
        lambda r: f"order 1 has {share(r['motions']['1']['orders'], slice(1)):.4f} of the power",
        (lambda r: share(r["motions"]["1"]["orders"], slice(1)) > 0.99,),
        "close above the main resonance order 1 is by far the strongest",
    ),
    Claim(
        "3",
        "Omega = 1: single-sided impact",
        lambda r: f"{r['motions']['1']['regime']}, least gap {r['motions']['1']['least']:.4f} b_c",
        (lambda r: r["motions"]["1"]["regime"] == "single_sided",),
        "the teeth lose contact only while the least gap is below b_c, just below Omega = 1",
    ),
    Claim(
        "3",
        "Omega = 1/2 and 1/3: closed curves, not circular",
        lambda r: (
            "the strongest order has "
            + amounts([strongest(m["orders"]) for m in (r["motions"]["1/2"], r["motions"]["1/3"], third(r))])
            + " of the power at 1/2, at 1/3, at 1/3 on the stable motion"
        ),
        (
            lambda r: strongest(r["motions"]["1/2"]["orders"]) < 0.9,
            lambda r: strongest(r["motions"]["1/3"]["orders"]) < 0.9,
            lambda r: strongest(third(r)["orders"]) < 0.9,
        ),
        "superharmonics are as strong as order 1; at 1/3 the stable curve closes after two periods",
    ),
    Claim(
        "3",
        "Omega = 1/2: no impact",
        lambda r: words(r["motions"]["1/2"]),
        (lambda r: r["motions"]["1/2"]["regime"] == "no_impact", lambda r: r["motions"]["1/2"]["stable"]),
        "the dynamic gap motion is smaller than the static closure",
    ),
    Claim(
        "3",
        "Omega = 1/3: no impact",
        lambda r: f"one period: {words(r['motions']['1/3'])}; two periods: {words(r['doubled'])}",
        (
            lambda r: r["motions"]["1/3"]["regime"] == "no_impact",
            lambda r: third(r)["stable"] and third(r)["regime"] == "no_impact",
        ),
        "only the symmetric motion, which is unstable, has none; in the stable motion of two periods the teeth "
        "lose contact",
    ),
    Claim(
        "4",
        "base case: jump at 0.89",
        lambda r: f"jumps: {folds([r['base']])}; steepest rise {r['base'].slope:.1f} at {r['base'].slope_at:.4f}",
        (lambda r: near(r["base"].jumps, 0.89, 0.01), lambda r: abs(r["base"].slope_at - 0.89) < 0.02),
        "a steep rise where the teeth begin to lose contact, without a fold: the case lies just above a "
        "cusp in damping",
    ),
    Claim(
        "4",
        "only no impact and single-sided impact",
        lambda r: ", ".join(r["base"].regimes),
        (lambda r: set(r["base"].regimes) == {"no_impact", "single_sided"},),
        "no gap comes near the tooth back at -b_c",
    ),
    Claim(
        "4",
        "superharmonic peaks near 1/2 and 1/3",
        lambda r: "peaks at " + amounts(list(r["base"].superharmonics)),
        (lambda r: near(r["base"].superharmonics, 0.5, 0.06), lambda r: near(r["base"].superharmonics, 1 / 3, 0.04)),
        "harmonics 2 and 3 of stiffness and error excite the main resonance",
    ),
    Claim(
        "5",
        "displacement amplitude grows with backlash W",
        lambda r: f"largest displacement {amounts(displacements(r['W']))}; half peak-to-peak " + amounts(peaks(r["W"])),
        (lambda r: rising(displacements(r["W"])),),
        "W shifts the gap by a constant, and with it the largest displacement; the alternating motion does not "
        "change while no tooth makes contact at its back. Where two motions are stable W can decide which is reached "
        "from rest (from_rest)",
    ),
    Claim(
        "5",
        "the jump remains for every W",
        lambda r: f"jumps: {folds(r['W'])}",
        (lambda r: all(c.jumps for c in r["W"]),),
        "the curve of the alternating motion is the same for every W",
    ),
    Claim(
        "5",
        "jump frequency leans to the right with W",
        lambda r: "peak at " + amounts([c.peak_at for c in r["W"]]),
        (lambda r: rising([c.peak_at for c in r["W"]], 1e-4),),
        "the same shift invariance; started from rest, a case with two folds does lean to the right (from_rest)",
    ),
    Claim(
        "6",
        "amplitude falls with smaller stiffness variation",
        lambda r: "peaks " + amounts(peaks(r["eps"])),
        (lambda r: rising(peaks(r["eps"])[::-1]),),
        "the stiffness variation is the main excitation",
    ),
    Claim(
        "6",
        "the jump vanishes with smaller stiffness variation",
        lambda r: "steepest rise " + amounts([c.slope for c in r["eps"]]) + f"; jumps: {folds(r['eps'])}",
        (
            lambda r: bool(r["eps"][0].jumps),
            lambda r: rising([c.slope for c in r["eps"]][::-1]),
            lambda r: not r["eps"][-1].jumps,
        ),
        "the rise weakens as claimed; the base case has no fold to lose",
    ),
    Claim(
        "6",
        "at W = 0.6, eps_1 = 0.13 is linear",
        lambda r: ", ".join(r["eps W"][1].regimes),
        (lambda r: r["eps W"][1].linear,),
        "the teeth do not lose contact with this stiffness, at W = 0 either",
    ),
    wider("6", "eps", "stiffness variation"),
    Claim(
        "7",
        "amplitude falls with damping",
        lambda r: "peaks " + amounts(peaks(r["zeta"])),
        (lambda r: rising(peaks(r["zeta"])[::-1]),),
        "damping limits the resonance",
    ),
    Claim(
        "7",
        "damping reduces the jump",
        lambda r: "steepest rise " + amounts([c.slope for c in r["zeta"]]) + f"; jumps: {folds(r['zeta'])}",
        (lambda r: bool(r["zeta"][0].jumps), lambda r: rising([c.slope for c in r["zeta"]][::-1])),
        "the rise weakens as claimed; the folds are already gone at zeta = 0.063",
    ),
    Claim(
        "7",
        "at W = 0.6, zeta = 0.07 is linear",
        lambda r: ", ".join(r["zeta W"][1].regimes),
        (lambda r: r["zeta W"][1].linear,),
        "whether the teeth lose contact does not depend on W",
    ),
    wider("7", "zeta", "damping"),
    Claim(
        "8",
        "larger error, larger amplitude",
        lambda r: "peaks " + amounts(peaks(r["e"])),
        (lambda r: rising(peaks(r["e"])[::-1]),),
        "error and stiffness variation add with their phases, which differ by the reading of the sign of e",
    ),
    Claim(
        "8",
        "larger error, larger jump",
        lambda r: "largest change at a jump " + amounts([c.height for c in r["e"]]),
        (lambda r: r["e"][0].height > 0, lambda r: rising([c.height for c in r["e"]][::-1])),
        "only the largest error makes folds at this load",
    ),
    Claim(
        "8",
        "e = 0 still jumps",
        lambda r: f"jumps: {folds([r['e'][-1]])}; " + ", ".join(r["e"][-1].regimes),
        (lambda r: bool(r["e"][-1].jumps),),
        "loss of contact alone does not make a fold at this damping",
    ),
    wider("8", "e", "error"),
    Claim(
        "9",
        "more load, larger amplitude",
        lambda r: "peaks " + amounts(peaks(r["torque"])),
        (lambda r: rising(peaks(r["torque"])),),
        "with the load grows the force of the stiffness variation",
    ),
    Claim(
        "9",
        "with the load the peak leans to the right",
        lambda r: "peak at " + amounts([c.peak_at for c in r["torque"]]),
        (lambda r: rising([c.peak_at for c in r["torque"]]),),
        "the teeth lose contact less and the softening is smaller",
    ),
    Claim(
        "9",
        "with enough load the system is linear",
        lambda r: ", ".join(r["torque"][-1].regimes),
        (lambda r: r["torque"][-1].linear, lambda r: not r["torque"][-1].jumps),
        "closure and stiffness excitation both grow with the load: no jump, but the teeth lose contact",
    ),
    wider("9", "torque", "load"),
    Claim(
        "abstract, conclusion 3",
        "damping and load constrain the amplitude",
        lambda r: (
            f"over damping {amounts(peaks(r['zeta']))}; over load {amounts(peaks(r['torque']))}, relative "
            "to the load " + amounts([c.peak / T * 1400 for c, T in zip(r["torque"], base.TORQUE, strict=False)])
        ),
        (lambda r: rising(peaks(r["zeta"])[::-1]), lambda r: rising(peaks(r["torque"])[::-1])),
        "damping does; the load does only relative to itself, and the text on Figure 9 says the opposite",
    ),
    Claim(
        "14",
        "Omega = 1/3: mesh orders 1, 2, 3",
        lambda r: f"{amounts(r['motions']['1/3']['orders'][:3])}, {words(r['motions']['1/3'])}" + half_orders(r),
        (lambda r: three_lines(r["motions"]["1/3"]["orders"]), lambda r: r["motions"]["1/3"]["stable"]),
        "so has the symmetric motion; the stable one has half orders as well",
    ),
    Claim(
        "15",
        "theory, Omega = 1/2: mesh orders 1 and 2, no third",
        lambda r: amounts(r["motions"]["1/2"]["orders"][:3]),
        (lambda r: two_lines(r["motions"]["1/2"]["orders"]),),
        "the second order is in resonance; the third is at most a tenth of it and would not be seen in a figure",
    ),
    Claim(
        "15",
        "rig, 600 r/min: also the third mesh order",
        lambda r: amounts(r["motions"]["1/2"]["orders"][:3]),
        (lambda r: three_lines(r["motions"]["1/2"]["orders"]),),
        "stiffness and error have a third harmonic, but Omega = 1/2 is far from its resonance",
    ),
    Claim(
        "16",
        "Omega = 1: one line at the mesh frequency",
        lambda r: amounts(r["motions"]["1"]["orders"][:3]),
        (lambda r: share(r["motions"]["1"]["orders"], slice(1)) > 0.99,),
        "close above the main resonance",
    ),
    Claim(
        "16",
        "rig, 1200 r/min: sidebands of the mesh line",
        lambda r: "mesh orders only",
        (),
        "sidebands need an excitation at shaft speed, such as eccentricity or pitch errors; the equations have none",
    ),
    Claim(
        "17",
        "amplitude grows with backlash on the rig",
        lambda r: "at 1200 r/min [um] " + ", ".join(f"{row[-1]:.5f}" for row in r["b"]),
        (lambda r: rising([row[-1] for row in r["b"]]),),
        "the teeth stay in mesh at these speeds, where backlash has no effect",
    ),
    Claim(
        "18",
        "amplitude grows with speed",
        lambda r: "400, 600, 1200 r/min [um] " + amounts(r["b"][0]),
        (lambda r: rising(r["b"][0]),),
        "these speeds are Omega = 0.03 to 0.1 of this model, far below its resonances",
    ),
)
"""All claims, in the order of the figures."""


def verdicts(results: Results) -> list[str]:
    """One for each of `CLAIMS`."""
    return [claim.verdict(results) for claim in CLAIMS]


def report(both: dict[str, Results]) -> str:
    """The table of claims in Markdown, with the verdicts in each reading."""
    names = {"default": "default", "found": "reading found by search"}
    found = {name: verdicts(results) for name, results in both.items()}
    lines = []
    for name, some in found.items():
        counts = ", ".join(f"{some.count(verdict)} {verdict}" for verdict in VERDICTS)
        changes = ", ".join(f"{field} = {value}" for field, value in READINGS[name].items())
        lines += [f"{names[name].capitalize()}{f' ({changes})' if changes else ''}: {counts}.", ""]
    head = ["figure", "the paper says"]
    for name in both:
        head += [f"measured, {names[name]}", "verdict"]
    lines += ["| " + " | ".join([*head, "because, in the default reading"]) + " |", "|" + " --- |" * (len(head) + 1)]
    for i, claim in enumerate(CLAIMS):
        cells = [claim.figure, claim.text]
        for name, results in both.items():
            cells += [claim.measured(results), found[name][i]]
        lines.append("| " + " | ".join([*cells, claim.reason]) + " |")
    return "\n".join([*lines, "", NOTE, "", instability(both["default"]["doubled"]), ""])


VERDICTS = ("reproduced", "in part", "refuted", "not modelled")
"""In this order in the counts."""

NOTE = (
    "The second reading was found by a search for agreement with the statements of Figures 3 and 4 (search); for these "
    "its verdicts are no test. Loads of Figure 9 are 0.5 to 2 times the load of the base case of each reading."
)
"""Below the table."""


def instability(doubled: dict[str, Any] | None) -> str:
    """What the base case does around Omega = 1/3, as a sentence."""
    if doubled is None:
        return "The base motion of one period is stable at Omega = 1/3."
    low, high = doubled["unstable"]
    alike, opposite = doubled["opposition"]
    how = "in opposite phase" if alike < 1e-6 * opposite else "not in opposite phase"
    return (
        f"Between Omega = {low:.5f} and {high:.5f} the base motion of one period is unstable by period doubling. The "
        f"halves then move {how}: of the half orders at 1/3 |d_L + d_R| = {alike:.1e} and |d_L - d_R| = {opposite:.4f}."
    )


if __name__ == "__main__":
    study.main()
