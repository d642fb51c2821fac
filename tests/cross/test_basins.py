"""Basins of attraction over planes of initial states: labels agree with integrations of single initial states."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import hbgear as hb
from hbgear import plot
from hbgear.time import basins_of_attraction as module
from hbgear.time.basins_of_attraction import basins
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.observation import observe
from hbgear.time.steady_state import SteadyStateSettings, settle

PAIR, OMEGA = hb.SpurPair(e=(0.1,)), 0.65


def two_masses():
    """The spur pair with two attractors and a light absorber that changes them little; two elements."""
    mesh = PAIR.system()
    element = mesh.elements[0]
    M, C, K = np.diag([mesh.M[0, 0], 0.05]), np.array([[0.0, 0.0], [0.0, 0.02]]), np.diag([0.0, 0.3])
    C[0, 0], K[0, 0] = mesh.C[0, 0] + 0.01, mesh.K[0, 0] + 0.02
    C[0, 1] = C[1, 0] = -0.01
    K[0, 1] = K[1, 0] = -0.02
    gap = hb.Element([1.0, 0.0], element.law, element.displacement, element.damping, name="mesh")
    stop = hb.Element([0.0, 1.0], hb.Unilateral(1.0, 5.0), name="stop")
    loads = [
        hb.Load(
            None if load.constant is None else [*load.constant, 0.0],
            {k: [*x, 0.0] for k, x in load.cosine.items()},
            {k: [*x, 0.0] for k, x in load.sine.items()},
            load.power,
        )
        for load in mesh.loads
    ]
    return hb.System(M, C, K, [gap, stop], loads)


@pytest.fixture(scope="module")
def found():
    return basins(two_masses(), OMEGA, (-2, 2), (-1.5, 1.5), (14, 10), element="mesh")


def test_two_coordinates(found):
    assert (
        found.element == "mesh" and found.status.complete and sum(a.share for a in found.attractors) == pytest.approx(1)
    )
    assert len({round(a.rms, 3) for a in found.attractors if a.period}) >= 2
    stepper = ExponentialIntegrator(two_masses(), OMEGA)
    for y, x in ((2, 3), (7, 11), (5, 6)):
        e = hb.SpurPair(e=(0.1,)).system().elements[0].displacement
        flight = stepper.start([[found.d[x] + float(e(0.0)), 0.0, found.v[y], 0.0]])
        assert flight.d[0, 0] == pytest.approx(found.d[x]) and flight.v[0, 0] == pytest.approx(found.v[y], abs=1e-9)
        settle(stepper, flight)
        rms = observe(stepper, flight, 1).rms[0]
        assert rms == pytest.approx(found.attractors[found.label[y, x]].rms, abs=1e-5)


def test_a_plane_of_directions_is_that_of_the_element_where_they_are_the_same(found):
    """With diagonal inertia the element displaces one coordinate only; at the origin its gap is zero."""
    e = hb.SpurPair(e=(0.1,)).system().elements[0].displacement
    same = basins(
        two_masses(),
        OMEGA,
        (-2, 2),
        (-1.5, 1.5),
        (14, 10),
        start=[float(e(0.0)), 0.0, 0.0, 0.0],
        plane=[[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    )
    assert same.element == ""
    np.testing.assert_array_equal(same.label, found.label)
    assert [a.period for a in same.attractors] == [a.period for a in found.attractors]


def test_starts_of_an_element_go_through_the_state_given():
    """Initial states are the given state plus displacements in the direction M^-1 w of the element."""
    pair, start = hb.gears.DoubleHelicalPair(), np.linspace(-0.2, 0.2, 48)
    stepper, system = ExponentialIntegrator(pair, 0.9), pair.system()
    origin, directions = module._plane(stepper, system, 0.9, 1, start, None)
    flight = stepper.start(origin + np.array([[0.7, -0.4]]) @ directions)
    assert flight.d[0, 1] == pytest.approx(0.7) and flight.v[0, 1] == pytest.approx(-0.4)
    moved = origin + 0.7 * directions[0] - 0.4 * directions[1] - start
    force = system.M @ moved[:24]
    w = system.W[:, 1]
    np.testing.assert_allclose(force, w * (force @ w) / (w @ w), atol=1e-10 * np.abs(force).max())


def test_who_is_caught_would_have_settled_there(monkeypatch):
    """Labels are the same if every motion is integrated to its steady state."""
    shape = (40, 32)
    quick = basins(PAIR, OMEGA, (-2, 3), (-1.5, 1.5), shape)
    monkeypatch.setattr(module._Search, "nearby", lambda self, z, before: np.zeros(len(z), dtype=int))
    whole = basins(PAIR, OMEGA, (-2, 3), (-1.5, 1.5), shape)
    np.testing.assert_array_equal(quick.label, whole.label)
    assert [a.period for a in quick.attractors] == [a.period for a in whole.attractors] == [1, 1]


def test_attractors_of_several_periods_and_none():
    """An attractor of four periods, and a chaotic one (period 0, 128 points)."""
    doubled = basins(PAIR, 1.5, (0, 2), (-1, 1), (5, 4), settling=SteadyStateSettings(1e-6, longest=600))
    assert doubled.attractors[0].period == 4 and doubled.attractors[0].points.shape == (4, 2)
    chaotic = basins(PAIR, 1.66, (0, 2), (-1, 1), (3, 2), settling=SteadyStateSettings(1e-6, longest=300))
    assert chaotic.attractors[0].period == 0 and chaotic.attractors[0].points.shape == (128, 2)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({}, ValueError, "24 coordinates and 2 elements: select one of 'gap L', 'gap R'"),
        ({"element": "L"}, KeyError, "no element 'L'; choose one of 'gap L', 'gap R'"),
        ({"element": 0, "plane": np.eye(48)[:2]}, ValueError, "give only one"),
        ({"element": 0, "start": [0.0, 1.0]}, ValueError, "give a state .* of 48 finite numbers"),
        ({"plane": np.eye(24)[:2]}, ValueError, r"plane of shape \(2, 24\): give two directions \(2, 48\)"),
        ({"plane": [np.eye(48)[0]] * 2}, ValueError, "linearly independent"),
        ({"element": 0, "shape": (10**6, 10**6)}, ValueError, "is more than"),
    ],
)
def test_bad_input(options, error, words):
    with pytest.raises(error, match=words):
        basins(hb.gears.DoubleHelicalPair(), 0.9, **options)


def test_figure_and_table(found, tmp_path):
    found.export(tmp_path / "basins.csv")
    table = np.genfromtxt(tmp_path / "basins.csv", delimiter=",", names=True)
    assert len(table) == 140 and set(table["attractor"]) == set(found.label.ravel())
    np.testing.assert_array_equal(table["d"].reshape(10, 14)[0], found.d)
    with pytest.raises(ValueError, match=r"must end in \.csv"):
        found.export(tmp_path / "basins.txt")
    ax = plot.basins(found)
    assert "tau" in ax.get_xlabel()
    plt.close("all")


def test_a_frequency_in_another_unit_is_reported():
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="times the highest natural frequency"):
        hb.time.basins(hb.Duffing(zeta=0.2), 6000.0, shape=(2, 2), settling=SteadyStateSettings(1e-2, 20))


def test_units_of_the_figure():
    """Displacements in um, rates in m/s and the frequency in r/min are the values of the model times its scales."""
    model = hb.SpurPair(e=(0.1,), reference=(38000.0, 37.6e-6, 15000.0, 25))
    few = basins(model, 0.65, (-2, 3), (-1.5, 1.5), (3, 2))
    plain, ax = plot.basins(few, model=model, dimensionless=True), plot.basins(few, model=model)
    assert ax.get_xlabel().startswith("gap [\N{MICRO SIGN}m]") or "[\N{MICRO SIGN}m]" in ax.get_xlabel()
    assert "[m/s]" in ax.get_ylabel() and ax.get_title() == f"{0.65 * model.scales.pinion_speed(1.0):.5g} r/min"
    assert plain.get_title() == r"$\Omega$ = 0.65"
    rate = 37.6e-6 * 38000.0  # m/s
    for now, before, unit in ((ax.get_xlim(), plain.get_xlim(), 37.6), (ax.get_ylim(), plain.get_ylim(), rate)):
        np.testing.assert_allclose(now, unit * np.array(before), rtol=1e-12)
    for now, before in zip(ax.lines, plain.lines, strict=True):
        np.testing.assert_allclose(now.get_xydata(), before.get_xydata() * [37.6, rate], rtol=1e-12)
    plt.close("all")
