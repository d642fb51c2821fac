"""Compiled steps of time integration, against closed forms, other integrators and each other."""

import os
import subprocess
import sys
from dataclasses import dataclass
from threading import Event

import numpy as np
import pytest
from machines import single_mass
from scipy.optimize import brentq

import hbgear as hb
from hbgear import Backlash, Cubic, Duffing, SpurPair, Unilateral
from hbgear.common.process.threads import begun, for_each, processors
from hbgear.gears import DoubleHelicalPair
from hbgear.mechanics import Law, Parallel, Periodic, Series
from hbgear.mechanics.laws.mesh_contacts import MeshContacts, ToothContact
from hbgear.time.exponential import integrator
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.law_table import LawTable
from hbgear.time.integration import integrate

WAVY = Series(mean=1.0, cosine=(0.2, 0.05), sine=(0.1,))
TWO_SPRINGS = Parallel((Backlash(0.5, 1.0, WAVY), Unilateral(0.7, 0.8)))
ALL_IN_ONE = Parallel((TWO_SPRINGS, Cubic(0.2, 0.1)))
TEETH = MeshContacts(
    (
        ToothContact(
            Periodic.trapezoidal(1.5, 0.0, 0.5, 0.1), Periodic.table([0, 2, 4], [0.1, 0.5, 0.2], kind="cubic")
        ),
        ToothContact(Periodic.rectangular(0.8, 0.0, 0.6, start=3.0), Series(0.4)),
        ToothContact(Series(0.9), Periodic.table([1, 3, 5], [-0.4, -0.2, -0.3]), side=-1),
    )
)
STEPPED_TEETH = MeshContacts(
    (
        ToothContact(Series(1.2), Periodic.rectangular(0.3, -0.1, 0.5, start=1.0)),
        ToothContact(Series(0.7), Series(-0.2), side=-1),
    )
)


@dataclass(frozen=True)
class Opaque(Law):
    """A law of an unknown class, with only the force and the breakpoints of another law."""

    law: Law

    @property
    def reference(self):
        return self.law.reference

    @property
    def breakpoints(self):
        return self.law.breakpoints

    @property
    def rated(self):
        return False

    def force(self, d, v, tau):
        return self.law.force(d, v, tau)


def machine(law):
    """Return two masses with a law between them and a stop at the second mass."""
    return hb.System(
        [[1.0, 0.0], [0.0, 0.6]],
        [[0.06, -0.03], [-0.03, 0.06]],
        [[0.5, -0.2], [-0.2, 0.7]],
        [hb.Element([1.0, -1.0], law, Series(cosine=(0.05,))), hb.Element([0.0, 1.0], Unilateral(2.0, 0.3))],
        hb.Load([0.3, 0.1], {1: [0.7, 0.0]}),
    )


MACHINES = {
    "parametric pair": (SpurPair(eps=(0.2, 0.1)), 0.8, [1.2, 0.1]),
    "Duffing": (Duffing(), 1.09, [0.5, -0.8]),
    "two springs": (machine(TWO_SPRINGS), 0.7, [0.4, -0.3, 0.5, 0.2]),
    "springs and a cubic": (machine(ALL_IN_ONE), 0.7, [0.4, -0.3, 0.5, 0.2]),
    "teeth": (machine(TEETH), 0.7, [0.4, -0.3, 0.5, 0.2]),
    "levels that jump": (machine(STEPPED_TEETH), 0.7, [0.4, -0.3, 0.5, 0.2]),
    "asked": (machine(Opaque(ALL_IN_ONE)), 0.7, [0.4, -0.3, 0.5, 0.2]),
}


# ---- accuracy


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_agrees_with_dop853(name):
    model, Omega, y = MACHINES[name]
    true = integrate(model, np.array(y), 2, Omega, tolerance=1e-13, samples=32)
    found = integrate(model, np.array(y), 2, Omega, method="exponential", steps=64, samples=32)
    np.testing.assert_allclose(found.end, true.end, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.d, true.d, rtol=0, atol=1e-9)
    assert len(true.switches) >= 3 or name == "Duffing"


def test_double_helical_pair_in_impact():
    """Fast shaft modes, several gaps and contact loss."""
    model, y = DoubleHelicalPair(zeta=0.05), np.zeros(48)
    true = integrate(model, y, 2, 0.86, tolerance=1e-12, samples=32)
    found = integrate(model, y, 2, 0.86, method="exponential", steps=48, samples=32)
    assert len(true.switches) >= 3
    np.testing.assert_allclose(found.d, true.d, rtol=0, atol=1e-8)


def pieces(Omega, zeta, b, mean, amplitude, start, end):
    """Return the final state and number of pieces of x'' + 2 zeta x' + f(x) = mean + amplitude cos(Omega t).

    f is a unit spring beyond a gap of half width b. Pieces are solved in closed form, contact times by bracketing.
    """
    t, (x, v), count = 0.0, start, 0
    on = 1 if x > b else -1 if x < -b else 0
    while t < end:
        k = float(on != 0)
        c = amplitude / (k - Omega**2 + 2j * zeta * Omega)

        def steady(s, k=k, c=c, on=on):
            """Return the particular solution of the piece and its derivative."""
            still, slope = (mean + b * on, 0.0) if k else (mean / (2 * zeta) * s, mean / (2 * zeta))
            wave = c * np.exp(1j * Omega * s)
            return np.array([still + wave.real, slope + (1j * Omega * wave).real])

        roots = np.roots([1.0, 2 * zeta, k])
        a = np.linalg.solve([[1, 1], roots], np.array([x, v]) - steady(t))

        def state(s, a=a, roots=roots, steady=steady, t=t):
            e = a * np.exp(roots * (s - t))
            return np.array([e.sum().real, (roots * e).sum().real]) + steady(s)

        grid = np.linspace(t, end, 4000)[1:]
        outside = [state(s)[0] for s in grid]
        level = {1: [b], 0: [-b, b], -1: [-b]}[on]
        gone = [i for i, y in enumerate(outside) if (y < b if on > 0 else y > -b if on < 0 else abs(y) > b)]
        count += 1
        if not gone:
            return state(end), count
        i = gone[0]
        edge = min(level, key=lambda corner: abs(corner - outside[i]))
        low = t if i == 0 else grid[i - 1]
        stop = brentq(lambda s, edge=edge: state(s)[0] - edge, low, grid[i], xtol=1e-15) if i else grid[0]
        (x, v), t = state(stop), stop
        on = 0 if on else (1 if edge > 0 else -1)
    raise AssertionError("unreachable")


@pytest.mark.parametrize("start", [(1.4, 0.2), (-0.3, -0.8), (0.2, 1.5)])
def test_impacts_in_closed_form(start):
    """A unit spring beyond a gap, against piecewise closed-form solutions, to 1e-10 after three periods."""
    Omega, zeta, b, mean, amplitude = 0.7, 0.08, 0.5, 0.15, 0.4
    true, count = pieces(Omega, zeta, b, mean, amplitude, start, 6 * np.pi / Omega)
    system = single_mass(Backlash(b), F=amplitude, mean=mean, c=2 * zeta, k=0.0)
    found = integrate(system, np.array(start), 3, Omega, method="exponential", steps=24)
    assert count > 5
    np.testing.assert_allclose(found.end, true, rtol=0, atol=1e-10)


# ---- the same steps in several ways


@pytest.mark.slow
def test_sampled_laws_move_like_tabulated_laws(rng):
    """Results of seven motions differ only by the tolerance of Newton's iterations, at most 1e-11."""
    y = rng.uniform(-1, 1, (7, 4))
    for law in (TWO_SPRINGS, ALL_IN_ONE):
        ends = [integrate(machine(each), y, 3, 0.7, method="exponential").end for each in (law, Opaque(law))]
        np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-11)


def test_contacts_of_constant_stiffness_and_level_are_a_backlash(rng):
    """Contacts on both sides at +-b are the law Backlash(b), with a prescribed displacement, to rounding."""
    contacts = MeshContacts((ToothContact(Series(1.3), Series(0.5)), ToothContact(Series(1.3), Series(-0.5), side=-1)))
    y = rng.uniform(-1, 1, (7, 4))
    ends = [
        integrate(machine(law), y, 3, 0.7, method="exponential", steps=40).end for law in (contacts, Backlash(0.5, 1.3))
    ]
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("law", [TEETH, STEPPED_TEETH], ids=["moving levels", "levels that jump"])
def test_contacts_of_teeth_need_no_more_steps(law):
    """Steps end where contacts begin and end, so that ten times as many change nothing but rounding."""
    y = np.array([0.4, -0.3, 0.5, 0.2])
    few, many = (integrate(machine(law), y, 3, 0.7, method="exponential", steps=n, samples=20) for n in (40, 400))
    np.testing.assert_allclose(few.d, many.d, rtol=0, atol=1e-10)
    assert not LawTable.of([law]).in_python.any()


def test_contacts_of_several_models_in_one_batch():
    """Each motion has the stiffness and the levels of its own model."""
    models = [machine(TEETH.scaled(factor, length)) for factor, length in ((1.0, 1.0), (1.3, 0.8), (0.6, 1.5))]
    y = np.tile([0.4, -0.3, 0.5, 0.2], (3, 1))
    together = integrate(models, y, 2, 0.7, method="exponential", steps=40).end
    for model, end in zip(models, together, strict=True):
        alone = integrate(model, y[0], 2, 0.7, method="exponential", steps=40).end
        np.testing.assert_allclose(end, alone, rtol=0, atol=1e-12)


def test_slices_of_helical_teeth_agree_with_dop853():
    """Forty contacts of a helical pair with tip relief, 900 breakpoints in a mesh period."""
    gears = [
        hb.gears.Gear(teeth=z, module="2 mm", face_width="25 mm", helix_angle=f"{angle} deg", tip_relief="6 um")
        for z, angle in ((23, 15), (41, -15))
    ]
    model = hb.GearPair(*gears, backlash="80 um").model(60.0, 0.04)
    assert len(model.system().elements[0].law.contacts) >= 40
    true = integrate(model, np.array([0.3, 0.0]), 2, 0.6, tolerance=1e-12, samples=50)
    found = integrate(model, np.array([0.3, 0.0]), 2, 0.6, method="exponential", samples=50)
    np.testing.assert_allclose(found.d, true.d, rtol=0, atol=1e-8)


def test_many_motions_over_threads_are_those_of_one(rng, monkeypatch):
    """Several threads, with tables evaluated as series, give the results of one thread to 1e-10."""
    drives = (
        (SpurPair(e=(0.1,)), 1),
        (machine(TWO_SPRINGS), 2),
        (machine(TEETH), 2),
        (DoubleHelicalPair(zeta=0.05), 24),
    )
    for model, n in drives:
        y = rng.uniform(-1.5, 1.5, (23, 2 * n)) * (1 if n < 24 else 1e-3)
        monkeypatch.setattr(integrator, "_MAX_SERIAL_COST", np.inf)
        alone = integrate(model, y, 2, 0.86, method="exponential", samples=32)
        monkeypatch.setattr(integrator, "_MAX_SERIAL_COST", 0.0)
        many = integrate(model, y, 2, 0.86, method="exponential", samples=32)
        assert ExponentialIntegrator(model, 0.86).steps.curves(True).turn.size > 0
        np.testing.assert_allclose(many.end, alone.end, rtol=0, atol=1e-10)
        np.testing.assert_allclose(many.d, alone.d, rtol=0, atol=1e-10)


def test_steps_in_one_go_are_the_steps(rng):
    """A machine with one gap has folded steps, which agree with single steps to 1e-12."""
    stepper, y = ExponentialIntegrator(SpurPair(e=(0.1,), eps=(0.2,)), 0.65), rng.uniform(-2, 2, (9, 2))
    assert stepper.steps.maps.size
    folded = stepper.start(y)
    stepper.advance(folded, 2)
    object.__setattr__(stepper.steps, "maps", np.empty((0, 0, 0, 0)))
    plain = stepper.start(y)
    stepper.advance(plain, 2)
    np.testing.assert_allclose(folded.zeta, plain.zeta, rtol=0, atol=1e-12)


def test_a_stepper_at_another_frequency(rng):
    y = rng.uniform(-1, 1, (3, 48)) * 1e-3
    stepper = ExponentialIntegrator(DoubleHelicalPair(), 0.6)
    stepper.advance(stepper.start(y))
    found, fresh = stepper.at(0.9), ExponentialIntegrator(DoubleHelicalPair(), 0.9)
    ends = []
    for each in (found, fresh):
        flight = each.start(y)
        each.advance(flight)
        ends.append(each.states(flight))
    np.testing.assert_array_equal(ends[0], ends[1])


@pytest.mark.slow
def test_steps_run_as_they_are_written_where_nothing_compiles():
    """The same code without compilation by Numba gives the same result to 1e-12."""
    code = (
        "import hbgear as hb; print(hb.time.integrate(hb.SpurPair(eps=(0.2,)), [1.2, 0.1], 1, 0.8, "
        "method='exponential', samples=16).end.tolist())"
    )
    ends = []
    for off in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": off}
        out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
        ends.append(np.array(eval(out.stdout)))
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12)


# ---- laws as tables


@pytest.mark.parametrize(
    "law", [TWO_SPRINGS, ALL_IN_ONE, Cubic(1.0, -0.5), Backlash(0.0), SpurPair().system().elements[0].law]
)
def test_tables_are_the_laws(law, rng):
    table = LawTable.of([law])
    d, tau = rng.uniform(-2, 2, 40), rng.uniform(0, 2 * np.pi, 40)
    piece = np.sum(d[:, None] > table.high[0], axis=1)
    assert np.all((table.low[0, piece] <= d) & (d <= table.high[0, piece]))
    waves = np.exp(1j * tau[:, None] * np.arange(table.stiffness.shape[1]))
    k = (waves @ table.stiffness.T).real
    p = (k * (table.slope[:, piece].T * d[:, None] + table.offset[:, piece].T)).sum(axis=1)
    p += table.cubic[0, 0] * d + table.cubic[0, 1] * d**3
    assert not table.in_python.any()
    np.testing.assert_allclose(p, law.force(d, 0 * d, tau)[0], rtol=0, atol=1e-13)


def test_laws_without_a_table_are_sampled():
    class Quartic(Cubic):
        """A subclass with another force."""

        def force(self, d, v, tau):
            return d**4, 4 * d**3, 0 * d

    for law in (Opaque(Cubic(1.0)), Quartic(1.0), Parallel((Backlash(), Quartic(1.0)))):
        assert LawTable.of([law, Backlash()]).in_python.tolist() == [True, False]


# ---- threads


def test_an_error_in_a_thread_ends_the_others():
    seen, begun = [], Event()

    def work(item, stop):
        if item == 0:
            begun.wait(10)
            raise ArithmeticError("broken")
        begun.set()
        seen.append((item, stop.wait(10)))

    if processors() > 1:
        with pytest.raises(ArithmeticError, match="broken"):
            for_each(work, range(2))
        assert seen == [(1, True)]


def test_background_work_ends_with_its_block():
    import threading

    asked = threading.Event()

    def work(item, stop):
        if item == "wait":
            return stop.wait(10)
        asked.wait(10)
        return item

    with begun(work, ["first", "wait"]) as futures:
        assert not futures[0].done()
        asked.set()
        assert futures[0].result() == "first"
        if processors() > 1:
            assert not futures[1].done()
    assert futures[1].cancelled() or futures[1].result()
    with begun(work, []) as futures:
        assert futures == []


def test_one_item_is_worked_on_in_this_thread():
    import threading

    seen = []
    for_each(lambda item, stop: seen.append((item, threading.current_thread(), stop.is_set())), [5])
    assert seen == [(5, threading.main_thread(), False)]
