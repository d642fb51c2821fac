"""Curves of trains, planetary sets and systems come back from their files with the model that they were traced with."""

import json

import numpy as np
import pytest
import scipy

import hbgear as hb
from hbgear.harmonic.models import model_registry
from hbgear.mechanics.models import describe

pytestmark = pytest.mark.slow


def train():
    """Two meshes in line: wheels in the plane, a table over speed, functions with corners, a shaft."""
    wheels = [
        hb.gears.Wheel("in", 1e-3, 1.0, teeth=20, base_radius=0.028, moves="plane", torque=50.0),
        hb.gears.Wheel("idler", 2e-3, teeth=30, base_radius=0.042),
        hb.gears.Wheel("out", 4e-3, teeth=40, base_radius=0.056),
        hb.gears.Wheel("mill", 2e-2),
    ]
    k = hb.mechanics.Periodic.trapezoidal(1.2, 0.8, 0.6, 0.1)
    meshes = [
        hb.gears.Mesh("in", "idler", 4e8, 4e-5, stiffness=k, direction=0.0),
        hb.gears.Mesh("idler", "out", 3e8, 4e-5, eps=(0.2,), e=(1e-6, 2e-7), e_lag=(0.1, 0.0)),
    ]
    table = hb.mechanics.MatrixTable([1.0, 1e4], [1e7 * np.eye(2), 2e7 * np.eye(2)])
    return hb.gears.Train(
        wheels,
        meshes,
        [hb.gears.Shaft("out", "mill", 1e6)],
        [hb.gears.Bearing("in", 1e8, 1e8, table=table)],
        balance="mill",
    )


def system(law=hb.Backlash(0.1, 2.0), matrix=np.asarray):  # noqa: B008
    gap = hb.Element([1.0, -1.0], law, hb.mechanics.Series(0.0, (0.01,)), 0.05, name="gap")
    loads = [hb.Load([0.1, 0.0], {1: [0.2, 0.0]}, {3: [0.0, 0.1]}), hb.Load(cosine={1: [0.01, 0.0]}, power=2)]
    terms = hb.mechanics.SpeedTerms(
        matrix(np.array([[0.0, 0.2], [-0.2, 0.0]])),
        0.5,
        stiffness=hb.mechanics.MatrixTable([0.2, 3.0], [np.eye(2), 2 * np.eye(2)]),
    )
    return hb.System(
        matrix(np.eye(2)), matrix(0.05 * np.eye(2)), matrix(np.diag([1.0, 2.0])), [gap], loads, ["a", "b"], terms
    )


def epicyclic():
    """A stepped planet whose ring is held."""
    wheel, mesh = hb.gears.Wheel, hb.gears.Mesh
    gears = [
        wheel("sun", 1e-4, teeth=24, base_radius=0.0225526),
        wheel("large", 2e-4, 0.5, teeth=30, base_radius=0.0281908, x=0.054),
        wheel("small", 1e-4, 0.3, teeth=18, base_radius=0.0117099, x=0.054),
        wheel("ring", 1e-2, teeth=96, base_radius=0.0624533, internal=True),
    ]
    meshes = [mesh("sun", "large", 4e8, 20e-6, (0.1,)), mesh("small", "ring", 4e8, 20e-6, (0.1,))]
    return hb.gears.EpicyclicSet(gears, meshes, 0.004, 3, (("large", "small"),))


MACHINES = {
    "train": train,
    "planetary": lambda: hb.gears.PlanetarySet(26, 34, 94, planets=3, carrier_rotation=True),
    "epicyclic": epicyclic,
    "system": system,
    "sparse": lambda: system(hb.mechanics.Parallel((hb.Backlash(0.1, 2.0), hb.Cubic(0.1))), scipy.sparse.csr_array),
}


@pytest.mark.parametrize("name", MACHINES)
def test_models_come_back_from_their_description(name):
    model = MACHINES[name]()
    about = json.loads(json.dumps(describe(model)))
    again = model_registry.rebuild_model(about)
    assert describe(again) == about and "left_out" not in about
    one, other = (hb.HarmonicBalance(each, 3) for each in (model, again))
    Omega = 1.1
    X = np.linspace(-2.0, 3.0, one.size)
    for a, b in zip(one.evaluate(X, Omega=Omega), other.evaluate(X, Omega=Omega), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["train", "system"])
def test_curves_go_on_from_their_file_alone(name, tmp_path):
    problem = hb.HarmonicBalance(MACHINES[name](), 4)
    part = hb.trace(problem, "Omega", (1.3, 0.9), steps=hb.StepControl(max_points=15))
    part.save(tmp_path / "part.npz")
    again = hb.load(tmp_path / "part.npz")
    with np.load(tmp_path / "part.npz") as archive:
        assert not [key for key in archive.files if key.startswith("motions")]
    whole, expected = hb.extend(again), hb.extend(part)
    np.testing.assert_array_equal(whole.X, expected.X)
    np.testing.assert_array_equal(again.amplitude(dof=0), part.amplitude(dof=0))
    assert hb.validate(again, 1).ok == hb.validate(part, 1).ok
    mine, others = (hb.analysis.machine_quantities(curve).columns for curve in (again, part))
    assert len(mine) > 3 and mine.keys() == others.keys()
    for title, column in mine.items():
        np.testing.assert_array_equal(column, others[title])


class Law(hb.mechanics.Law):
    """A law that is not of hbgear."""

    def force(self, d, v, tau):
        return d**3, 3 * d**2, 0 * d

    @property
    def reference(self):
        return 1.0


def test_invalid_data_are_not_rebuilt():
    """Nothing is put in its place either: gyroscopic terms, bearings."""
    plain = system()
    fast = hb.mechanics.SpeedTerms(stiffness=lambda Omega: np.eye(2))
    for model, named in (
        (system(Law()), "elements"),
        (hb.System(plain.M, plain.C, plain.K, plain.elements, speed=fast), "speed"),
        (hb.System(np.eye(300), None, np.eye(300), [hb.Element(np.ones(300), hb.Backlash())]), "M"),
    ):
        about = describe(model)
        assert named in about["left_out"]
        with pytest.raises(ValueError, match=f"does not hold its .*'{named}'"):
            model_registry.rebuild_model(about)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"part": "Popen", "fields": {}}, "no part 'Popen'"),
        ({"part": "Wheel", "fields": {"name": "a", "inertia": 1.0, "colour": 2}}, "no field 'colour'"),
        ({"part": "Wheel", "fields": {"name": "a", "inertia": -1.0}}, "inertia"),
        ({"sparse": 10**9, "row": [], "column": [], "values": []}, "no 1000000000 rows"),
        ({"sparse": 2, "row": [5], "column": [0], "values": [1.0]}, "index"),
        ({"array": [[1.0], [2.0, 3.0]]}, "inhomogeneous"),
        ({"array": ["x"]}, "could not convert"),
        ({"else": 1}, "no value of a model"),
        ([3.0], "Wheel"),
    ],
)
def test_damaged_descriptions_are_refused(value, said):
    about = describe(train())
    about["fields"]["wheels"] = [value] if isinstance(value, dict) else value
    with pytest.raises((ValueError, KeyError, TypeError), match=said):
        model_registry.rebuild_model(about)
