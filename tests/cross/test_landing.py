"""Landings of jumps by time integration: on the same curve, on another curve, or on an unknown motion."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

import hbgear as hb
from hbgear.analysis.jump_landings import MAX_MOTION_DIFFERENCE, landings
from hbgear.continuation.solvers.newton import solve
from hbgear.time.integration import state_of
from hbgear.time.jump_integration import JumpOutcome, integrate_jumps, jump_ends, landings_of

PERIODS = 400
"""Periods of the independent integration: four times the longest transient of these motions."""

FIXED = hb.SpurPair(
    zeta=0.025362646960700685,
    F_m=0.04687523896737403,
    eps=(0.2285778414227634, 0.1740535663071835, 0.04616433835141112),
    e=(0.008681086348321295,),
    phase="sin",
)


def random_pairs(count, seed=7):
    random = np.random.default_rng(seed)
    for _ in range(count):
        yield hb.SpurPair(
            zeta=random.uniform(0.02, 0.08),
            F_m=random.uniform(0.03, 0.15),
            eps=tuple(random.uniform(0.05, 0.25, 3) * [1.0, 0.7, 0.4]),
            e=(random.uniform(0.0, 0.05),),
            phase="sin",
        )


def traced(model):
    return hb.trace(hb.HarmonicBalance(model, 16), "Omega", (2.5, 0.3))


@pytest.fixture(scope="module")
def fixed():
    return traced(FIXED)


def ends_of(curve, share=2e-4, method="exponential"):
    """For each jump: Omega beyond it by a relative share, and two periods (256 samples each) of the final motion."""
    model, jumps = curve.problem.model, curve.jumps()
    if not jumps:
        return []
    Omega = np.array([jump.value * (1 + jump.direction * share) for jump in jumps])
    states = np.array(
        [state_of(curve.problem, curve.problem.from_point(j.before), **j.before.parameters) for j in jumps]
    )
    if method != "exponential":
        each = zip(states, Omega, strict=True)
        ends = [hb.time.integrate(model, state, 150, float(x), method=method, samples=1).end for state, x in each]
    else:
        ends = hb.time.integrate(model, states, PERIODS, Omega, method=method, samples=1).end
    return [
        (float(x), hb.time.integrate(model, end, 2, float(x), samples=256).d[0])
        for x, end in zip(Omega, ends, strict=True)
    ]


def is_where(curve, Omega, samples, point):
    """Whether two periods (256 samples each) equal the one-period motion of a point, solved at this Omega."""
    if point is None or point.layout.nu > 1:
        return False
    X = solve(curve.problem, point.X, {"Omega": Omega}).X
    d = curve.layout.samples(X, 0, 256, 0)[1]
    return np.sqrt(np.mean((samples - np.tile(d, 2)) ** 2)) <= MAX_MOTION_DIFFERENCE * samples.std()


@pytest.mark.slow
def test_several_stable_motions_and_the_right_one(fixed):
    """At LP1 the lower motion is nearest in coefficients; integration converges to the upper one, rms 0.093."""
    jump = next(j for j in fixed.jumps() if j.label == "LP1")
    assert jump.value == pytest.approx(0.75474, abs=1e-5)
    assert sorted(p.amplitude("rms") for p in jump.candidates) == pytest.approx([0.0221, 0.0930], abs=1e-4)
    assert (
        jump.after.amplitude("rms") == pytest.approx(0.0930, abs=1e-4)
        and jump.landing_description == "uncertain: nearest of 2"
    )
    Omega, samples = ends_of(dataclasses.replace(fixed, jump_records=(jump,)), method="DOP853")[0]
    assert samples.std() == pytest.approx(0.0931, abs=1e-4) and is_where(fixed, Omega, samples, jump.after)


def test_integration_decides(fixed):
    decided = fixed.jumps(landing="integrate")
    changed = [j.label for j, near in zip(decided, fixed.jumps(), strict=True) if j.after is not near.after]
    assert changed == ["LP3", "LP4"]  # the nearest motion is another one
    assert all(jump.landing_description == "integrated" and jump.after.stable for jump in decided)
    assert [jump.label for jump in decided if "indeterminate" in jump.note] == ["LP3", "LP5"]


@pytest.mark.slow
def test_forty_random_pairs():
    """Of 161 landings 149 are right by nearest coefficients, 153 by nearest amplitudes and 160 by integration.

    For an indeterminate jump the independent integration must end in one of the reported motions.
    """
    counts = np.zeros(5, dtype=int)
    for model in random_pairs(40):
        curve = traced(model)
        decided = curve.jumps(landing="integrate")
        for near, jump, (Omega, samples) in zip(curve.jumps(), decided, ends_of(curve), strict=True):
            coefficients = min(
                near.candidates, key=lambda p: np.linalg.norm(p.X - curve.problem.from_point(near.before)), default=None
            )
            right = [is_where(curve, Omega, samples, point) for point in (coefficients, near.after, jump.after)]
            ends = [one.rms[0] for one in jump_ends(curve, jump)]
            one_of = np.isclose(ends, samples.std(), rtol=0.02).any()
            unsure = "indeterminate" in jump.note or jump.after is None or jump.after.layout.nu > 1
            counts += [1, *right, right[2] or (unsure and one_of)]
    total, by_coefficients, by_amplitudes, integrated, agreed = counts
    assert by_coefficients < by_amplitudes < integrated and agreed == total
    assert (total, by_coefficients, by_amplitudes, integrated) == pytest.approx((161, 149, 153, 160), abs=1)


def test_an_unknown_motion_is_a_start_of_its_curve():
    """The doubled motion of a strongly excited pair jumps to motions of one and of four periods."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 16), "Omega", (2.6, 0.4))
    doubled = hb.switch(curve, "PD1")
    alone, _ = doubled.jumps(landing="integrate")
    assert alone.after.layout.nu == 1 and alone.after.stable and "on a curve that was not given" in alone.note
    down, up = doubled.jumps(landing="integrate", others=[curve])
    assert (down.label, down.note) == ("LP1", "") and is_at(curve, down.after)
    assert up.note.startswith("period 4, on a curve that was not given") and up.after.layout.nu == 4 and up.after.stable
    known = landings((dataclasses.replace(doubled, jump_records=(down, up)), curve))[0]
    assert [(one.branch, one.jump.after) for one in known] == [(1, down.after), (None, up.after)]
    problem = curve.problem.with_order(4)
    away = hb.trace(problem, "Omega", (up.value, up.value + 0.002), start=up.after, steps=hb.StepControl(max_points=4))
    assert len(away) > 2 and away.stable[0] and away.layout.nu == 4
    assert np.linalg.norm(problem.subharmonic_part(away.X[0])) > 0.01


def is_at(curve, point):
    """Whether the nearest point of a curve has the coefficients of a point, to 5 %."""
    near = np.argmin(np.linalg.norm(curve.X - point.X, axis=1) + np.abs(curve.values - point.parameters["Omega"]))
    return np.linalg.norm(curve.X[near] - point.X) < 0.05 * np.linalg.norm(point.X)


def test_aperiodic_and_resting_motions_are_reported():
    curve = traced(FIXED)
    jump = curve.jumps()[0]
    lost = JumpOutcome(jump.value, 0, np.array([0.3]), 3000, None)
    away = JumpOutcome(jump.value, 0, np.array([np.inf]), 20, None)
    (there, tries), (_, others) = landings_of((curve,), jump, [lost, away, lost])
    assert there.after is None and there.landing == "integrate" and (tries, others) == ([lost, lost], [away])
    assert there.note == "rms 0.3, not periodic; indeterminate: 2 of 3 tries, 1: the motion diverges"


def test_without_its_problem_nothing_is_integrated(fixed, tmp_path):
    decided = integrate_jumps(fixed)
    decided.save(tmp_path / "fixed.npz")
    again = hb.load(tmp_path / "fixed.npz")
    for a, b in zip(again.jumps(), decided.jumps(), strict=True):
        assert (a.landing, a.note, a.landing_description) == (b.landing, b.note, "integrated")
        assert np.array_equal(a.after.X, b.after.X) and len(a.candidates) == len(b.candidates)
    with pytest.raises(ValueError, match="landing='integrate' needs a curve of periodic motions with its problem"):
        replace(again, problem=None).jumps(landing="integrate")
    with pytest.raises(ValueError, match="landing = 'farthest': choose one of 'nearest', 'integrate'"):
        again.jumps(landing="farthest")


@pytest.mark.slow
def test_along_a_load():
    """Jumps of a Duffing oscillator along its load at one frequency, in both directions between two motions."""
    problem = hb.HarmonicBalance(hb.Duffing(k3=0.2), 9)
    curve = hb.trace(problem, "F", (0.02, 1.0), at={"Omega": 1.3})
    near, decided = curve.jumps(), curve.jumps(landing="integrate")
    assert [jump.direction for jump in decided] == [1, -1]
    assert [a.after for a in near] == [b.after for b in decided] and all(jump.after.stable for jump in decided)


@pytest.mark.slow
def test_validate_looks_at_the_jumps(fixed):
    report = hb.validate(fixed, 1)
    assert [jump.label for jump in report.jumps if not jump.ok] == ["LP4"] and not report.ok
    assert "5 of 6 jumps agree" in report.summary
    assert report.jumps[2].status == "agrees in 3 of 8 tries: indeterminate"  # of LP3
    decided = hb.validate(integrate_jumps(fixed), ["LP4"])
    assert [(jump.label, jump.status) for jump in decided.jumps] == [("LP4", "agrees")]
    assert not hb.validate(fixed, 1, landing="nearest").jumps
    headers, rows = report.jump_table()
    assert len(headers) == len(rows[0]) and rows[3][-1] == "lands on another stable motion of the curve"


# ---- a period doubling in front of a fold


@pytest.mark.slow
def test_a_sweep_continues_on_the_doubled_motion_in_front_of_a_fold():
    """The sweep leaves at a supercritical period doubling; the nearest motion of the mesh period is not reached."""
    gears = [hb.gears.Gear(z, "2 mm", "20 mm") for z in (20, 35, 50)]
    wheels = [
        hb.gears.Wheel.of(name, gear, x=x, torque=torque)
        for name, gear, x, torque in zip(
            ("in", "idler", "out"), gears, (0.0, 0.055, 0.14), (50.0, 0.0, -125.0), strict=True
        )
    ]
    pairs = hb.GearPair(gears[0], gears[1], "60 um"), hb.GearPair(gears[1], gears[2], "60 um")
    meshes = [
        hb.gears.Mesh.of("in", "idler", pairs[0], 50.0, 0.05),
        hb.gears.Mesh.of("idler", "out", pairs[1], 87.5, 0.05),
    ]
    curve = hb.trace(hb.HarmonicBalance(hb.gears.Train(wheels, meshes), 16), "Omega", (1.0, 0.8))
    fold = next(p for p in curve.special if p.kind == "LP" and p.parameters["Omega"] < 0.87)
    doubling = max((p for p in curve.special if p.kind == "PD" and p.index < fold.index), key=lambda p: p.index)
    assert curve[doubling.index - 1].stable and not curve[doubling.index + 1].stable
    assert not {jump.label for jump in curve.jumps()} & {fold.label, doubling.label}
    jump = hb.Jump(doubling.label, "Omega", doubling.parameters["Omega"], -1, doubling, None)
    (found, *_), *_ = [group for _, group in landings_of((curve,), jump, jump_ends(curve, jump))]
    assert found.period == 2
    doubled = hb.switch(curve, doubling.label)
    (at,) = [
        i
        for i in range(len(doubled) - 1)
        if (doubled.values[i] - found.value) * (doubled.values[i + 1] - found.value) <= 0
    ][:1]
    assert doubled[at].stable and found.motion is not None
    assert found.motion.amplitude("rms") == pytest.approx(doubled[at].amplitude("rms"), rel=0.02)
    assert found.motion.amplitude("rms") > 1.01 * doubling.amplitude("rms")
