"""Load shares of planets against statics by linear algebra, and against 1/3 for three planets and a free sun."""

import numpy as np
import pytest

import hbgear as hb

STILL = {"eps_sp": (), "eps_rp": ()}


@pytest.fixture
def shares():
    def of(machine, meshes=None, Omega=1.0):
        problem = hb.HarmonicBalance(machine, 8)
        curve = hb.trace(problem, "Omega", (Omega, 1.001 * Omega), stability=False)
        return hb.analysis.load_sharing(curve, meshes)

    return of


def statics(machine):
    """Forces of all meshes at rest: (K + W k W^T) q = F + W k (e + b), all teeth in contact on the drive side."""
    k = np.repeat([machine.k_sp, machine.k_rp], machine.planets)
    W, K, unit = machine.mesh_vectors(), machine.structure()[2], machine.b_c
    errors = np.repeat([0.0, 0.0], machine.planets)
    for j, element in enumerate(machine.system().elements):
        errors[j] = element.displacement.mean * unit
    gap = errors + np.repeat([machine.b_sp, machine.b_rp], machine.planets)
    q = np.linalg.lstsq(K + (W * k) @ W.T, machine._load() + W @ (k * gap), rcond=1e-14)[0]
    force = k * (W.T @ q - gap)
    assert (force > 0).all()
    return force


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
@pytest.mark.parametrize("errors", [(10e-6, 0.0, 0.0, 0.0), (4e-6, -3e-6, 7e-6, 1e-6)])
def test_shares_at_rest_are_those_of_statics(shares, errors):
    machine = hb.gears.PlanetarySet(planet_errors=errors, **STILL)
    force = statics(machine)
    for first, meshes in ((0, None), (4, machine.mesh_names[4:])):
        found, own = shares(machine, meshes), force[first : first + 4]
        np.testing.assert_allclose(found.share[0], own / own.sum(), rtol=1e-7)
        np.testing.assert_allclose(found.factor[0], 4 * own / own.sum(), rtol=1e-7)
        assert np.ptp(found.share[0]) > 1e-2


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
def test_three_planets_share_alike_if_the_sun_is_free(shares):
    """Equilibrium of a sun without lateral support determines the three forces: shares are 1/3 for any errors."""
    errors = (10e-6, -5e-6, 0.0)
    free, held = (
        hb.gears.PlanetarySet(26, 34, 94, planets=3, planet_errors=errors, k_s=k, **STILL) for k in (1.0, 1e9)
    )
    np.testing.assert_allclose(shares(free).share[0], 1 / 3, rtol=1e-6)
    assert np.ptp(shares(held).share[0]) > 0.02


def test_factors_hold_the_dynamic_factor(shares):
    """For equal planets that mesh in phase, shares are 1/N and load factors equal the dynamic factor."""
    machine = hb.gears.PlanetarySet()
    found = shares(machine, Omega=1.9)
    np.testing.assert_allclose(found.share, 0.25, rtol=1e-9)
    point = hb.analysis.machine_quantities(found.curve, "sun-p2")["dynamic factor"]
    np.testing.assert_allclose(found.factor, np.tile(point[:, None], 4), rtol=1e-6)
    assert point[0] > 1.1


def test_from_a_file_and_of_a_train(tmp_path):
    wheels = [hb.gears.Wheel("a", 1e-3, teeth=20, base_radius=0.028, torque=50.0)]
    wheels += [hb.gears.Wheel(name, 1e-3, teeth=20, base_radius=0.028) for name in "bc"]
    meshes = [hb.gears.Mesh("a", "b", 4e8, 4e-5, eps=(0.1,)), hb.gears.Mesh("a", "c", 4e8, 4e-5, eps=(0.1,))]
    train = hb.gears.Train(wheels, meshes, [hb.gears.Shaft("b", "c", 3e5)], balance="c")
    curve = hb.trace(hb.HarmonicBalance(train, 6), "Omega", (0.6, 0.602), stability=False)
    curve.save(tmp_path / "train.npz")
    found, again = hb.analysis.load_sharing(curve), hb.analysis.load_sharing(hb.load(tmp_path / "train.npz"))
    assert found.meshes == ("a-b", "a-c")
    np.testing.assert_array_equal(again.factor, found.factor)
    np.testing.assert_allclose(found.share.sum(axis=1), 1.0, rtol=1e-12)
    assert found.share[0, 0] < 0.45  # the shaft between the gears is flexible


def test_bad_input(shares):
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.81))
    with pytest.raises(ValueError, match="need two or more elements"):
        hb.analysis.load_sharing(curve)
    planets = shares(hb.gears.PlanetarySet()).curve
    with pytest.raises(KeyError, match="no element 'sun-p9'"):
        hb.analysis.load_sharing(planets, ["sun-p1", "sun-p9"])
    with pytest.raises(TypeError, match="needs a list of names of elements"):
        hb.analysis.load_sharing(planets, "sun-p1")
    idle = hb.gears.PlanetarySet(torque=0.0, e_sp=(1e-6,), **STILL)
    with pytest.raises(ValueError, match=r"the mean load of .* is zero"):
        hb.analysis.load_sharing(hb.trace(hb.HarmonicBalance(idle, 8), "Omega", (1.0, 1.001), stability=False))
